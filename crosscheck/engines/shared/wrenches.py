"""Wrenches that act on links beside their joints, at points: springs, given forces and closures.

For engines that take external forces; an engine with springs of its own uses those.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crosscheck.engines.shared.loop_closure import ClosureRows, FrameMotion
from flexinv.model.mechanism import Attachment, Force, Mechanism, Spring

Array = NDArray[np.float64]
Look = Callable[[Attachment], FrameMotion]


@dataclass(frozen=True)
class AppliedWrench:
    """A force (3,) [N] and a moment (3,) [N m] on a link at a point x (3,) [m], all in the world."""

    link: str
    x: Array
    force: Array
    moment: Array


def compute_applied_forces(mechanism: Mechanism, time: float, look: Look) -> list[AppliedWrench]:
    """Return the forces of springs and given forces at a time [s]; look: an attachment's frame in the world."""
    pulls = [push for spring in mechanism.springs for push in _compute_spring_forces(spring, look)]
    return pulls + [_evaluate_force(force, time, look) for force in mechanism.forces]


def _compute_spring_forces(spring: Spring, look: Look) -> Iterator[AppliedWrench]:
    """k (l - rest), or the spring's law, + d l' at both ends, towards the other one."""
    first = look(spring.first)
    second = look(spring.second)
    gap = second.x - first.x
    length = float(np.linalg.norm(gap))
    along = gap / length if length else gap
    rate = float(along @ (second.v - first.v))
    pull = (float(spring.evaluate_pull(np.asarray(length))) + spring.damping * rate) * along
    yield AppliedWrench(spring.first.link, first.x, pull, np.zeros(3))
    yield AppliedWrench(spring.second.link, second.x, -pull, np.zeros(3))


def _evaluate_force(force: Force, time: float, look: Look) -> AppliedWrench:
    at = look(force.at)
    wrench = evaluate_wrench(force, time)
    axes = at.r if force.follower else np.eye(3)
    return AppliedWrench(force.at.link, at.x, axes @ wrench[:3], axes @ wrench[3:])


def evaluate_wrench(force: Force, time: float) -> Array:
    """Return force [N] and moment [N m] (6,) of its table at a time [s], in the axes in which they are given."""
    if len(force.time) == 1:  # engines ask a hundred thousand times
        return np.array(force.wrench[0])
    return np.array([np.interp(time, force.time, column) for column in force.wrench.T], dtype=np.float64)


def compute_closure_forces(
    mechanism: Mechanism, pairs: list[tuple[FrameMotion, FrameMotion]], rows: ClosureRows, multipliers: Array
) -> list[AppliedWrench]:
    """Return the forces of closures: on the second link at its frame, on the first the opposite at the same point.

    multipliers : (rows,) [N], [N m]
    """
    closure_forces = []
    for index, (closure, (_, second)) in enumerate(zip(mechanism.closures, pairs, strict=True)):
        multiplier = np.where(rows.closure == index, multipliers, 0.0)
        force = multiplier @ rows.force
        moment = multiplier @ rows.moment
        closure_forces.append(AppliedWrench(closure.second.link, second.x, force, moment))
        closure_forces.append(AppliedWrench(closure.first.link, second.x, -force, -moment))
    return closure_forces


def compute_reactions(made: list[AppliedWrench], pairs: list[tuple[FrameMotion, FrameMotion]]) -> Array:
    """Return force [N] and moment [N m] on each closure's second frame, there and along its axes, (closures, 6)."""
    both = [(push, second) for push, (_, second) in zip(made[::2], pairs, strict=True)]
    return np.array([[*(at.r.T @ push.force), *(at.r.T @ push.moment)] for push, at in both]).reshape(-1, 6)
