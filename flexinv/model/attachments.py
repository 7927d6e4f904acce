"""Attachments of links beside their joints, as frozen data: closures of loops, springs between points, given forces."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from flexinv.model.joint_kinds import KINDS
from flexinv.model.links import Attachment, Frozen
from flexinv.model.spring_laws import Law
from flexinv.typing import Array

# closure kind -> number of constraints that it puts on the relative motion of its two frames
CLOSURES: dict[str, int] = {
    "fixed": 6,
    "revolute": 5,
    "prismatic": 5,
    "cylindrical": 4,
    "universal": 4,
    "spherical": 3,
    "point-on-line": 2,
    "coupling": 1,
}

# Joints that a coupling may tie: those whose coordinate is one number that counts whole turns.
COUPLED = tuple(name for name, kind in KINDS.items() if kind.counts_turns)
COUPLED_JOINTS = f"{', '.join(COUPLED[:-1])} and {COUPLED[-1]} joints"  # in words

# What a closure does that begins to act on frames in relative motion: refuse, or stop it at once (perfectly plastic).
IMPACTS = ("error", "plastic")


@dataclass(frozen=True)
class Closure(Frozen):
    """A joint that closes a loop: it ties the second frame to the first as a joint of its kind would; or a gear between joints.

    kind : a key of ``CLOSURES``; factors, offset : of a coupling, which ties coordinates of joints of the kinds ``COUPLED`` and
        no frames (both on the world): sum factor q = offset, joint names and factors [-], [rad/m]; offset [rad] or [m]
    axis : (3,) [-], unit, in both frames: the free axis of a revolute, prismatic or cylindrical closure, the line of
        point-on-line (in the first frame), the axis of a universal closure that stays with the first frame
    second_axis : (3,) [-], universal: the axis that stays with the second frame
    active : intervals (start, end) [s] in which it acts; empty: always
    capture : it ties the frames where they stand when it begins to act, as a hand that grasps; False: they must have met
    impact : what happens when it begins to act on frames that move against each other: one of ``IMPACTS``
    """

    name: str
    kind: str
    first: Attachment
    second: Attachment
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    second_axis: Array = field(default_factory=lambda: np.array([0.0, 1.0, 0.0]))
    active: tuple[tuple[float, float], ...] = ()
    capture: bool = False
    impact: str = "error"
    factors: tuple[tuple[str, float], ...] = ()
    offset: float = 0.0


@dataclass(frozen=True)
class Spring:
    """A spring and damper between two points: it pulls with  stiffness (l - rest) + damping l'  along their line.

    stiffness : [N/m]; rest : [m], length without force; damping : [N s/m]
    law : of a spring that is not linear; its pull takes the place of  stiffness (l - rest), and stiffness is 0
    """

    name: str
    first: Attachment
    second: Attachment
    stiffness: float
    rest: float = 0.0
    damping: float = 0.0
    law: Law | None = None

    def pull(self, length: Array) -> Array:
        """Return the pull without its damping [N] at lengths [m] (any shape)."""
        return self.stiffness * (length - self.rest) if self.law is None else self.law.pull(length, self.rest)


@dataclass(frozen=True)
class Force(Frozen):
    """A force and a moment on a point of a link, constant or linear between the rows of a table.

    wrench : (n, 6) force [N] then moment [N m]; time : (n,) [s], one row and time 0 for a constant one
    follower : axes of the attachment's frame, which move with the link; else world axes
    """

    name: str
    at: Attachment
    wrench: Array
    time: Array = field(default_factory=lambda: np.zeros(1))
    follower: bool = False
