"""Closures that act for a while, in Pinocchio: one mechanism after the other, each from where the one before has come to.

Between two switching instants the closures that act are those of an ordinary closed mechanism; nothing else changes.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from crosscheck.engines import assembly, pinocchio_loops
from crosscheck.engines.pinocchio_loops import Held
from crosscheck.engines.pinocchio_model import Built, Dynamics
from flexinv.files.case import Case
from flexinv.mechanism import Mechanism

Array = NDArray[np.float64]
SAME = 1e-9  # [s]: times are decimals in a binary machine


def switched(mechanism: Mechanism) -> bool:
    """Return whether a closure acts only for a while."""
    return any(c.active for c in mechanism.closures)


def held(mechanism: Mechanism, case: Case, built: Built, time: Array) -> Held:
    """Return efforts and wrenches [N m], [N] over all phases; closures that do not act have no wrench."""
    parts = []
    for first, last in pairwise(_bounds(mechanism, time)):
        now = _acting(mechanism, float(time[first]))
        span = time[first : min(last + 1, len(time))]  # with the instant at which the next phase begins
        state = pinocchio_loops.motion(now, case, built, span)
        case = replace(case, start=_places(now, case, state[0][-1]))
        mine = slice(0, last - first)
        parts.append(pinocchio_loops.held(now, built, span[mine], tuple(part[mine] for part in state)))  # type: ignore[arg-type]
    names = [c.name for c in mechanism.closures]
    wrenches = {n: np.concatenate([p.closures.get(n, np.zeros((len(p.torque), 6))) for p in parts]) for n in names}
    dynamics = Dynamics(
        torque=np.concatenate([p.dynamics.torque for p in parts]),
        wrench=_joined([p.dynamics.wrench for p in parts]),
        tip=_joined([p.dynamics.tip for p in parts]),
    )
    return Held(np.concatenate([p.torque for p in parts]), dynamics, wrenches)


def _joined(parts: list[dict[str, Array]]) -> dict[str, Array]:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _bounds(mechanism: Mechanism, time: Array) -> list[int]:
    """First samples of all phases, and the number of samples."""
    instants = {t for c in mechanism.closures for interval in c.active for t in interval if time[0] < t < time[-1]}
    return sorted({0, len(time), *(int(np.searchsorted(time, t - SAME)) for t in instants)})


def _acting(mechanism: Mechanism, time: float) -> Mechanism:
    """The mechanism with the closures that act at a time, for good."""
    acting = [c for c in mechanism.closures if not c.active or any(a - SAME <= time < b - SAME for a, b in c.active)]
    return replace(mechanism, closures=tuple(replace(c, active=()) for c in acting))


def _places(mechanism: Mechanism, case: Case, q: Array) -> dict[str, Array]:
    """Where the joints that the motion leaves out have come to."""
    return {name: q[mechanism.q_slices[name]] for name in assembly.left_out(mechanism, case)}
