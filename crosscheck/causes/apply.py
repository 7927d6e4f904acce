"""Application of a subject's output transformations to an engine's efforts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crosscheck.causes.subject import States, Subject
from crosscheck.engines.base import sample_times
from crosscheck.measures.record import Record


def with_efforts(record: Record, subject: Subject) -> Record:
    """Return a record after the changes of a subject's efforts [N m], [N]."""
    names = [f"torque/{n}" for n in subject.mechanism.velocity_names]
    effort = np.array([record.series[n].values for n in names]).T
    states = States(record.time, *subject.case.motion.evaluate(subject.mechanism, sample_times(subject.case)))
    for change in subject.effort:
        effort = change(subject.mechanism, states, effort)
    made = {n: replace(record.series[n], values=effort[:, k]) for k, n in enumerate(names)}
    return replace(record, series={**record.series, **made})
