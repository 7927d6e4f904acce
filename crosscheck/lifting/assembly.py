"""Assembly of a mechanism from bodies with frames of their own, and joints that stand somewhere on both of their bodies.

Readers of SDF and USD, and most models in memory, tell bodies and joints in any order, joints also from the child to the parent,
and joints that close loops.  Here they become a tree whose link frames sit at the joints, and closures:

    X_PF, X_CM    the joint's frames on the bodies that it joins; the mechanism's link frame of C is M, its joint's placement in
                  the link frame of P is  X_PM^-1 X_PF
    reversed      a joint whose child is nearer to the world turns about -axis, so that its coordinate stays what it was
    loose         a body that no joint leads to hangs on the world by a free joint, where it stands
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TypedDict

import numpy as np

from crosscheck.lifting.rigid import apply_placement, inverse, move_inertia
from flexinv.errors import InputError
from flexinv.model.mechanism import (
    CLOSURES,
    WORLD,
    Array,
    Attachment,
    Body,
    Closure,
    Inertia,
    Joint,
    Limits,
    Link,
    Mechanism,
    Placement,
)  # fmt: skip

Bodies = Mapping[str, Inertia]


class JointFields(TypedDict, total=False):
    """Fields of a `Joint` that a reader finds: limits, rotor [kg m^2], damping [N m s], friction [N m], spring [N m/rad]."""

    limits: Limits
    rotor_inertia: float
    damping: float
    friction: float
    stiffness: float
    rest: float


@dataclass(frozen=True)
class BodyJoint:
    """A joint between two bodies, WORLD one of them perhaps.

    on_parent, on_child : its frame on each [m]; axis, second_axis : (3,) [-] in that frame
    joint_fields : further fields of a `Joint` (limits, damping [N m s], ...); closes : it is stated to close a loop
    """

    name: str
    kind: str
    parent: str
    child: str
    on_parent: Placement = field(default_factory=Placement)
    on_child: Placement = field(default_factory=Placement)
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    second_axis: Array = field(default_factory=lambda: np.array([0.0, 1.0, 0.0]))
    joint_fields: JointFields = field(default_factory=JointFields)
    closes: bool = False

    @property
    def turned(self) -> BodyJoint:
        """Return the same joint from its child to its parent; its coordinate stays what it was [rad], [m]."""
        if self.kind == "universal":
            raise InputError(
                f"joint {self.name!r}: a universal joint is stated from the wrong end; exchange its bodies"
            )
        return replace(
            self,
            parent=self.child,
            child=self.parent,
            on_parent=self.on_child,
            on_child=self.on_parent,
            axis=-self.axis,
        )


@dataclass
class TreeBuilder:
    """A tree in the making: joints that wait for one of their bodies, joints made, and those that close loops.

    frames : of the bodies that it reaches, where their links' frames stand on them [m]
    """

    waiting: list[BodyJoint]
    spare: list[BodyJoint]
    made: list[Joint] = field(default_factory=list)
    frames: dict[str, Placement] = field(default_factory=lambda: {WORLD: Placement()})

    def add_branch(self, root: str) -> None:
        """Add all that joints lead to from a body that is there."""
        stack = [root]
        while stack:
            stack += self._add_carried(stack.pop())[::-1]

    def _add_carried(self, carrier: str) -> list[str]:
        """Add the bodies that joints of one body lead to; return them."""
        touching = [one for one in self.waiting if carrier in (one.parent, one.child)]
        self.waiting = [one for one in self.waiting if one not in touching]
        reached = []
        for one in touching:
            ordered = one if one.parent == carrier else one.turned
            if ordered.child in self.frames:
                self.spare.append(one)
                continue
            self.frames[ordered.child] = ordered.on_child
            self.made.append(_make_joint(ordered, self.frames[carrier]))
            reached.append(ordered.child)
        return reached

    def add_loose_body(self, body: str, pose: Placement) -> None:
        """Add a body that no joint leads to, at its pose in the world [m], and all that it carries."""
        self.frames[body] = Placement()
        self.made.append(_make_free_joint(body, pose, {one.name for one in self.waiting}))
        self.add_branch(body)


def assembled(
    label: str, bodies: Bodies, joints: Iterable[BodyJoint], gravity: Array, poses: Mapping[str, Placement]
) -> Mechanism:
    """Return the mechanism of bodies and joints [m, kg, rad], what closes loops as closures.

    bodies : inertia of each in its own frame [kg, m, kg m^2]; gravity : (3,) [m/s^2]
    joints : those that are stated to close a loop do
    poses : where bodies stand that no joint leads to, in the world [m]
    Raises InputError for a loop that a joint closes for which there is no closure.
    """
    every = list(joints)
    tree = TreeBuilder([one for one in every if not one.closes], [one for one in every if one.closes])
    carried = {one.child for one in tree.waiting}
    tree.add_branch(WORLD)
    for body in sorted(bodies, key=lambda name: name in carried):
        if body not in tree.frames:
            tree.add_loose_body(body, poses.get(body, Placement()))
    ordered = list_depth_first(tree.made)
    links = tuple(_make_link(joint.child, bodies[joint.child], tree.frames[joint.child]) for joint in ordered)
    closures = tuple(_make_closure(one, tree.frames) for one in tree.spare)
    return Mechanism(label, links, ordered, gravity=gravity, closures=closures)


def _make_free_joint(body: str, pose: Placement, names: set[str]) -> Joint:
    name = "root_joint"
    while name in names:
        name += "_"
    return Joint(name if body == "" else f"{name} {body}", "free", WORLD, body, pose, actuated=False)


def _make_joint(one: BodyJoint, carrier: Placement) -> Joint:
    at = apply_placement(inverse(carrier), one.on_parent)
    fields = one.joint_fields.copy()
    if one.kind not in ("revolute", "prismatic", "continuous", "helical"):
        fields.pop("limits", None)
    return Joint(
        one.name, one.kind, one.parent, one.child, at, axis=one.axis, second_axis=one.second_axis,
        actuated=one.kind not in ("fixed", "free"), **fields,
    )  # fmt: skip


def _make_link(name: str, body: Inertia, frame: Placement) -> Link:
    if not body.mass and not body.tensor.any():
        return Link(name)
    return Link(name, (Body(name, move_inertia(inverse(frame), body)),))


def _make_closure(one: BodyJoint, frames: Mapping[str, Placement]) -> Closure:
    kind = "revolute" if one.kind == "continuous" else one.kind
    if kind not in CLOSURES:
        raise InputError(
            f"joint {one.name!r} closes a loop, and no closure is {one.kind}; known: {', '.join(CLOSURES)}"
        )
    ends = [
        Attachment(body, apply_placement(inverse(frames[body]), at))
        for body, at in ((one.parent, one.on_parent), (one.child, one.on_child))
    ]
    return Closure(one.name, kind, ends[0], ends[1], axis=one.axis, second_axis=one.second_axis)


def list_depth_first(joints: list[Joint]) -> tuple[Joint, ...]:
    """Return joints parents first [m], the subtree of each before its next sibling."""
    children: dict[str, list[Joint]] = {}
    for joint in joints:
        children.setdefault(joint.parent, []).append(joint)
    ordered: list[Joint] = []
    stack = children.get(WORLD, [])[::-1]
    while stack:
        joint = stack.pop()
        ordered.append(joint)
        stack += children.get(joint.child, [])[::-1]
    return tuple(ordered)
