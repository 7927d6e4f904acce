"""Closures that act for a while: one closed mechanism after the other, each from where the one before has come to.

Between two switching instants the closures that act are those of an ordinary closed mechanism; an engine that closes loops
closes these.  At an instant the phase that begins there holds (a closure acts from its start to before its end).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from crosscheck.engines.shared.loop_closure import AssemblyError, find_unprescribed_joints
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism

Array = NDArray[np.float64]
State = tuple[Array, Array, Array]
SAME = 1e-9  # [s]: times are decimals in a binary machine
# Rates before and after a switch agree to this part of the largest one (of 1 rad/s or 1 m/s where all is slower): splines
# through samples differ from what closures ask for by some 1e-9.
MEETING = 1e-6


@dataclass(frozen=True)
class Phase:
    """A stretch of samples: its closures act throughout, and the case's start is where the phase before has ended.

    samples : which of the whole; time : (samples,) [s] of them
    """

    mechanism: Mechanism
    case: Case
    samples: slice
    time: Array


def solve_phases(
    mechanism: Mechanism,
    case: Case,
    time: Array,
    closed: Callable[[Mechanism, Case, Array], State],
    ours: Callable[[Array], Array] = np.asarray,
) -> list[tuple[Phase, State]]:
    """Return every phase with the motion (samples, ...) [rad], [m], [s] that an engine closes, in the engine's coordinates.

    closed : mechanism, case, time -> q, v, a; ours : (samples, nq) of the engine -> of the mechanism
    Raises AssemblyError where closures that begin to act meet with unequal velocities, and where nothing moves a joint.
    """
    out: list[tuple[Phase, State]] = []
    before: Array | None = None
    for first, last in pairwise(list_phase_bounds(mechanism, time)):
        now = apply_active_closures(mechanism, float(time[first]))
        span = time[first : min(last + 1, len(time))]  # with the instant at which the next phase begins
        if not now.closures and (loose := find_unprescribed_joints(now, case)):
            raise AssemblyError(
                f"from t = {time[first]:g} s on no closure acts and {', '.join(sorted(loose))} has no motion"
            )
        state = closed(now, case, span)
        if before is not None and not _has_impact(now, out[-1][0].mechanism):
            _check_rates(before, state[1][0], float(time[first]), now)
        mine = slice(0, last - first)
        q, v, a = (part[mine] for part in state)
        out.append((Phase(now, case, slice(first, last), span[mine]), (q, v, a)))
        case = replace(case, start=_take_free_coordinates(now, case, ours(state[0][-1:])[0]))
        before = state[1][-1]
    return out


def _has_impact(now: Mechanism, before: Mechanism) -> bool:
    """Return True if a closure that begins to act may stop its frames at once; rates of joints with a motion are theirs."""
    old = {c.name for c in before.closures}
    return any(c.impact == "plastic" for c in now.closures if c.name not in old)


def _check_rates(before: Array, after: Array, time: float, now: Mechanism) -> None:
    size = max(float(np.abs(before).max(initial=0.0)), float(np.abs(after).max(initial=0.0)), 1.0)
    if (change := np.abs(after - before).max(initial=0.0)) > MEETING * size:
        names = ", ".join(c.name for c in now.closures) or "none"
        raise AssemblyError(
            f"the closures that act from t = {time:g} s on ({names}) change a rate by {change:.3g} at once: that takes an impulse"
        )


def list_phase_bounds(mechanism: Mechanism, time: Array) -> list[int]:
    """Return the first samples [-] of all phases, and the number of samples."""
    instants = {t for c in mechanism.closures for interval in c.active for t in interval if time[0] < t < time[-1]}
    return sorted({0, len(time), *(int(np.searchsorted(time, t - SAME)) for t in instants)})


def apply_active_closures(mechanism: Mechanism, time: float) -> Mechanism:
    """Return the mechanism with the closures that act at a time [s], for good."""
    there = [c for c in mechanism.closures if not c.active or any(a - SAME <= time < b - SAME for a, b in c.active)]
    return replace(mechanism, closures=tuple(replace(c, active=()) for c in there))


def _take_free_coordinates(mechanism: Mechanism, case: Case, q: Array) -> dict[str, Array]:
    """Return the coordinates that the joints without a motion have reached."""
    return {name: q[mechanism.q_slices[name]] for name in find_unprescribed_joints(mechanism, case)}


def join_series(parts: Iterable[dict[str, Array]]) -> dict[str, Array]:
    """Return series (samples, ...) of all phases by name, one after the other [units as given]."""
    listed = list(parts)
    return {name: np.concatenate([part[name] for part in listed]) for name in listed[0]}


def fill_wrenches(mechanism: Mechanism, wrenches: dict[str, Array], samples: int) -> dict[str, Array]:
    """Return the wrenches (samples, 6) [N], [N m] of all closures of a mechanism: zero of those that do not act.

    A coupling ties no frames: it has none.
    """
    framed = [c.name for c in mechanism.closures if c.kind != "coupling"]
    return {name: wrenches.get(name, np.zeros((samples, 6))) for name in framed}
