"""Application of a subject's output transformations to an engine's efforts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crosscheck.causes.subject import States, Subject
from crosscheck.measures.record import Record


def apply_effort_changes(record: Record, subject: Subject, states: States) -> Record:
    """Return a record after the changes of a subject's efforts [N m], [N]; states : motion of all joints at its samples."""
    names = [f"torque/{n}" for n in subject.mechanism.velocity_names]
    effort = np.array([record.series[n].values for n in names]).T
    for change in subject.effort:
        effort = change(subject.mechanism, states, effort)
    made = {n: replace(record.series[n], values=effort[:, k]) for k, n in enumerate(names)}
    return replace(record, series={**record.series, **made})
