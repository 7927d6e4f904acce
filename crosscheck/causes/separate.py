"""Trial motions that would tell causes apart where this motion cannot, of the same joints, by flexinv's own columns.

Of every trial the columns of the causes are compared: two of them are apart where the sine of the angle between them is
not small.  For rigid trees; elsewhere the causes' own words have to do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from crosscheck.causes.fit import IMPOSSIBLE, Fit, compute_effect
from crosscheck.causes.model import Model, compute_effort_scales, is_tree, open_tree
from crosscheck.causes.subject import States
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

APART = 0.1  # sine of the angle between two columns: a fit then leaves a tenth of one to the other
SAMPLES = 41
SWING = 0.6  # [rad], [m] of the trial motions


def find_separating_motion(model: Model, fits: Sequence[Fit]) -> str:
    """Return the trial motion that tells all of the causes apart, or what is known of them in words."""
    if is_tree(model.base):
        for words, trial in TRIALS.items():
            if _can_separate(_replace_motion(model, trial), fits):
                return words
    return "; or ".join(dict.fromkeys(f.cause.shows for f in fits))


def _can_separate(model: Model, fits: Sequence[Fit]) -> bool:
    """Return True if no two of the causes have parallel columns; one that does not show is told by its absence."""
    try:
        columns = [compute_effect(model, f.cause, f.target, f.size) for f in fits]
    except IMPOSSIBLE:
        return False
    large = max(float(np.linalg.norm(c)) for c in columns)
    units = [c / n if (n := float(np.linalg.norm(c))) > APART * large else 0.0 * c for c in columns]
    pairs = [(a, b) for k, a in enumerate(units) for b in units[:k]]
    return large > 0.0 and all(np.sqrt(max(0.0, 1.0 - float(a @ b) ** 2)) > APART for a, b in pairs)


def _replace_motion(model: Model, trial: Callable[[Mechanism, Array], States]) -> Model:
    """Return the model of the same subject in another motion."""
    mechanism = model.base.mechanism
    states = trial(mechanism, np.linspace(0.0, 1.0, SAMPLES))
    subject = model.base.add_state_change(lambda harmed, given: states)
    torque = open_tree(mechanism, states)
    return replace(
        model,
        base=replace(model.base, case=subject.case),
        rows=np.arange(SAMPLES),
        states=states,
        torque=torque,
        scale=compute_effort_scales(mechanism, torque),
    )


def _evaluate_sine_motion(mechanism: Mechanism, time: Array, pace: float) -> States:
    """Every scalar joint swings at a rhythm of its own, others rest; pace [-] scales speeds, its square accelerations."""
    q = np.tile(mechanism.neutral, (len(time), 1))
    qd = np.zeros((len(time), mechanism.nv))
    qdd = np.zeros((len(time), mechanism.nv))
    for k, joint in enumerate(j for j in mechanism.joints if j.nv == j.nq == 1):
        w = 2 * np.pi * (1.0 + 0.37 * k)
        phase = 0.9 * k
        place = mechanism.q_slices[joint.name].start
        rate = mechanism.v_slices[joint.name].start
        q[:, place] = SWING * np.sin(w * time + phase)
        qd[:, rate] = pace * SWING * w * np.cos(w * time + phase)
        qdd[:, rate] = -(pace**2) * SWING * w**2 * np.sin(w * time + phase)
    return States(time, q, qd, qdd)


TRIALS: dict[str, Callable[[Mechanism, Array], States]] = {
    "holding still at several places": lambda mechanism, time: _evaluate_sine_motion(mechanism, time, 0.0),
    "all joints moved slowly, each at a rhythm of its own": lambda mechanism, time: _evaluate_sine_motion(
        mechanism, time, 0.2
    ),
    "all joints moved quickly, each at a rhythm of its own": lambda mechanism, time: _evaluate_sine_motion(
        mechanism, time, 3.0
    ),
}
