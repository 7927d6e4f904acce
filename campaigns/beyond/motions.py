"""Motions that are not those of the case: late, faster, differentiated badly, or those of another joint."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

import numpy as np

from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.typing import Array

Change = Callable[[Mechanism, Array, Array, Array], tuple[Array, Array, Array]]


class ReplacedMotion:
    """A motion that is evaluated by another function, and is the old one in everything else."""

    def __init__(self, motion: Motion, evaluate: Callable[..., tuple[Array, ...]]) -> None:
        """Keep both."""
        self._motion = motion
        self._evaluate = evaluate

    def evaluate(self, mechanism: Mechanism, time: Array, *side: Any) -> tuple[Array, ...]:
        """Return q, qd, qdd [rad], [m], [1/s], [1/s^2]."""
        return self._evaluate(mechanism, np.asarray(time, dtype=float), *side)

    def __getattr__(self, name: str) -> Any:
        """Return everything else from the motion."""
        return getattr(self._motion, name)


def replace_motion(case: Case, change: Change) -> Case:
    """Return the case with q, qd and qdd changed sample by sample."""
    old = case.motion

    def evaluate(mechanism: Mechanism, time: Array, *side: Any) -> tuple[Array, ...]:
        return change(mechanism, *old.evaluate(mechanism, time, *side))

    return replace(case, motion=cast(Motion, ReplacedMotion(old, evaluate)))


def replace_time(case: Case, clock: Callable[[Array], Array], rate: float = 1.0) -> Case:
    """Return the case with its motion read at other times [s]; rate : of the other clock [-]."""
    old = case.motion

    def evaluate(mechanism: Mechanism, time: Array, *side: Any) -> tuple[Array, ...]:
        q, qd, qdd = old.evaluate(mechanism, clock(time), *side)
        return q, rate * qd, rate**2 * qdd

    return replace(case, motion=cast(Motion, ReplacedMotion(old, evaluate)))


def replace_by_differences(case: Case, step: float, backward: bool) -> Case:
    """Return the case with rates and accelerations from differences of the rates over a step [s].

    backward : from this and the last sample, as a controller does it; else from both neighbours
    """
    old = case.motion

    def evaluate(mechanism: Mechanism, time: Array, *side: Any) -> tuple[Array, ...]:
        q, qd, _ = old.evaluate(mechanism, time)
        # of joints whose coordinates are numbers the rates are those of q; rotations keep their own rates
        before = old.evaluate(mechanism, np.maximum(time - step, 0.0))
        after = old.evaluate(mechanism, time if backward else time + step)
        span = np.where(time - step < 0.0, 0.0 if backward else step, step if backward else 2.0 * step)[:, None]
        qdd = np.divide(after[1] - before[1], span, out=np.zeros_like(qd), where=span > 0.0)
        if q.shape == qd.shape:
            qd = np.divide(after[0] - before[0], span, out=np.zeros_like(qd), where=span > 0.0)
        return q, qd, qdd

    return replace(case, motion=cast(Motion, ReplacedMotion(old, evaluate)))
