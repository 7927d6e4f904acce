"""Trees that are compared: a mechanism as members, each a link on its joint, every number a field that can be exchanged.

A member's frame is its link's frame.  Universal joints are two members, continuous joints revolute ones without limits, all
bodies of a link are one.  ``parts`` are the links that a member was merged from, in its frame.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypedDict

import numpy as np

from crosscheck.lifting.rigid import apply_placement, join_bodies, move_inertia
from flexinv.model.mechanism import WORLD, Array, Body, Inertia, Joint, Limits, Link, Mechanism, Placement

SCALARS = ("revolute", "prismatic", "helical")
PASSIVE = ("rotor_inertia", "damping", "friction", "stiffness", "rest")


@dataclass(frozen=True)
class Member:
    """A link and the joint that carries it.

    name, joint : of the link and of the joint; kind : revolute, prismatic, helical, spherical, free or fixed
    parent : number of the member that carries it, -1 the world; placement : of the joint in the parent's frame [m]
    axis : (3,) [-] in the joint's frame, which is the member's too; pitch : [m]
    mass [kg], com (3,) [m], tensor (3, 3) [kg m^2] about the centre of mass : of the link, in its frame
    parts : links that make it up, with their own inertia in the member's frame
    rotor_inertia ... rest, limits : as a `Joint` has them; gear : of its actuator [-], 0 without one
    ground : pose in the world of the link that stands still and carries it, where that was merged into the world [m]
    """

    name: str
    joint: str
    kind: str
    parent: int
    placement: Placement
    axis: Array
    pitch: float = 0.0
    mass: float = 0.0
    com: Array = field(default_factory=lambda: np.zeros(3))
    tensor: Array = field(default_factory=lambda: np.zeros((3, 3)))
    parts: tuple[tuple[str, Inertia], ...] = ()
    rotor_inertia: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    limits: Limits = field(default_factory=Limits)
    gear: float = 0.0
    ground: Placement | None = None

    def replace_fields(self, name: str, value: Any) -> Member:
        """Return the member with another field [unit of the field].

        "placement position", "limits lower" are parts of one; "part mass NAME" is that of one of the bodies that make it up.
        """
        record, _, part = name.partition(" ")
        if record == "part":
            part_name, _, body = part.partition(" ")
            return self._replace_part(part_name, body, value)
        return replace(self, **{record: replace(getattr(self, record), **{part: value}) if part else value})

    def _replace_part(self, name: str, part: str, value: Any) -> Member:
        parts = tuple(
            (part_name, body.replace_unchecked(**{name: value}) if part_name == part else body)
            for part_name, body in self.parts
        )
        whole = join_bodies([body for _, body in parts])
        return replace(self, parts=parts, mass=whole.mass, com=whole.com, tensor=whole.tensor)

    @property
    def inertia(self) -> Inertia:
        """Return mass [kg], centre [m] and tensor [kg m^2] as one record."""
        return Inertia.build_unchecked(self.mass, self.com, self.tensor)


@dataclass(frozen=True)
class Tree:
    """Members, parents before children, under gravity (3,) [m/s^2]; couplings: factors by joint [-], offset [rad], by name."""

    members: tuple[Member, ...]
    gravity: Array
    couplings: Mapping[str, tuple[Mapping[str, float], float]] = field(default_factory=dict)

    def list_children(self, index: int) -> list[int]:
        """Return the numbers of the members that a member carries."""
        return self._children.get(index, [])

    def list_moving_children(self, index: int) -> list[int]:
        """Return the moving members that a member carries, fixed ones between them left out; -1 : the world."""
        return self._carried.get(index, [])

    def count_moving(self, index: int) -> int:
        """Return the number of moving members from one on [-], itself among them."""
        return self._moving_from[index]

    @cached_property
    def _moving_from(self) -> dict[int, int]:
        result: dict[int, int] = {}
        for index in reversed(range(len(self.members))):
            result[index] = 1 + sum(result[k] for k in self.list_moving_children(index))
        return result

    @cached_property
    def _children(self) -> dict[int, list[int]]:
        result: dict[int, list[int]] = {}
        for k, member in enumerate(self.members):
            result.setdefault(member.parent, []).append(k)
        return result

    @cached_property
    def _carried(self) -> dict[int, list[int]]:
        result: dict[int, list[int]] = {}
        for index in range(len(self.members) - 1, -2, -1):  # who is carried comes after who carries it
            carried = [result[k] if self.members[k].kind == "fixed" else [k] for k in self.list_children(index)]
            result[index] = [k for some in carried for k in some]
        return result

    @property
    def moving(self) -> dict[str, int]:
        """Return the numbers of the members that move, by joint."""
        return {member.joint: k for k, member in enumerate(self.members) if member.kind != "fixed"}

    def compute_poses(self) -> list[Placement]:
        """Return the frame of every member in the world, all joints at zero [m]."""
        poses: list[Placement] = []
        for member in self.members:
            poses.append(
                apply_placement(poses[member.parent], member.placement) if member.parent >= 0 else member.placement
            )
        return poses

    def replace_fields(self, changes: Iterable[tuple[int, str, Any]]) -> Tree:
        """Return the tree with other fields, (member or -1 for the tree itself, field, value) each [unit of it]."""
        members = list(self.members)
        fields = {}
        for index, name, value in changes:
            if index < 0:
                fields[name] = value
            else:
                members[index] = members[index].replace_fields(name, value)
        return replace(self, members=tuple(members), **fields)


def build_tree(mechanism: Mechanism, gears: Mapping[str, float]) -> Tree:
    """Return the members of a rigid mechanism; gears : by joint [-]."""
    members: list[Member] = []
    number = {WORLD: -1}
    for joint in mechanism.joints:
        for member in _list_members(mechanism, joint, number[joint.parent], len(members), gears.get(joint.name, 0.0)):
            members.append(member)
        number[joint.child] = len(members) - 1
    couplings = {c.name: (dict(c.factors), c.offset) for c in mechanism.closures if c.kind == "coupling"}
    return Tree(tuple(members), np.asarray(mechanism.gravity), couplings)


class PassiveNumbers(TypedDict):
    """Numbers of a joint as a `Joint` has them."""

    rotor_inertia: float
    damping: float
    friction: float
    stiffness: float
    rest: float


class BodyFields(TypedDict):
    """Fields of a `Member` about its body [kg], [m], [kg m^2]."""

    mass: float
    com: Array
    tensor: Array
    parts: tuple[tuple[str, Inertia], ...]


def _list_members(mechanism: Mechanism, joint: Joint, parent: int, count: int, gear: float) -> Iterator[Member]:
    link = mechanism.link_of[joint.child]
    body = join_bodies([part.inertia for part in link.bodies])
    passive: PassiveNumbers = {
        "rotor_inertia": joint.rotor_inertia,
        "damping": joint.damping,
        "friction": joint.friction,
        "stiffness": joint.stiffness,
        "rest": joint.rest,
    }
    bodies: BodyFields = {
        "mass": body.mass,
        "com": body.com,
        "tensor": body.tensor,
        "parts": _list_named_bodies(link, body),
    }
    if joint.kind == "universal":
        names = joint.name + ".1", joint.name + ".2"
        yield Member(f"{joint.name}.between", names[0], "revolute", parent, joint.placement, joint.axis, **passive)
        yield Member(link.name, names[1], "revolute", count, Placement(), joint.second_axis, **passive, **bodies)
        return
    kind = "revolute" if joint.kind == "continuous" else joint.kind
    yield Member(
        link.name, joint.name, kind, parent, joint.placement, joint.axis, joint.pitch, limits=joint.limits, gear=gear,
        **passive, **bodies,
    )  # fmt: skip


def _list_named_bodies(link: Link, body: Inertia) -> tuple[tuple[str, Inertia], ...]:
    """The bodies of a link by their names, which a payload has of its own; one body has that of its link."""
    names = [part.name for part in link.bodies]
    if len(names) < 2 or len(set(names)) < len(names):
        return ((link.name, body),)
    return tuple((part.name, part.inertia) for part in link.bodies)


def join_into_carriers(tree: Tree, still: Iterable[int]) -> tuple[Tree, dict[int, int]]:
    """Return the tree with members merged into their carriers where they stand at zero, and new numbers by old ones.

    What is merged into the world is left out, but for its pose where it carries a member: it does not move.
    """
    still = set(still)
    number = {-1: -1}
    seats = {-1: (-1, Placement())}
    members = []  # type: ignore[var-annotated]
    for k, member in enumerate(tree.members):
        carrier, place = seats[member.parent]
        here = apply_placement(place, member.placement)
        if k in still:
            seats[k] = (carrier, here)
            if carrier >= 0:
                members[carrier] = _add_to_carrier(members[carrier], here, member)
            continue
        number[k] = len(members)
        seats[k] = (number[k], Placement())
        ground = place if carrier < 0 <= member.parent else member.ground
        members.append(replace(member, parent=carrier, placement=here, ground=ground))
    return replace(tree, members=tuple(members)), number


def _add_to_carrier(carrier: Member, place: Placement, member: Member) -> Member:
    parts = (*carrier.parts, *((name, move_inertia(place, body)) for name, body in member.parts))
    body = join_bodies([inertia for _, inertia in parts])
    return replace(carrier, parts=parts, mass=body.mass, com=body.com, tensor=body.tensor)


def build_mechanism(tree: Tree) -> Mechanism:
    """Return the tree as a mechanism of the same coordinates [m, kg, rad]; couplings are left to who compares them."""
    links = {-1: WORLD} | {k: f"link {k}" for k in range(len(tree.members))}
    made = [
        Joint(
            member.joint, member.kind, links[member.parent], links[k], member.placement, axis=member.axis, pitch=member.pitch,
            **({name: getattr(member, name) for name in PASSIVE} if member.kind in SCALARS else
               {name: getattr(member, name) for name in PASSIVE[:3]}),
        )
        for k, member in enumerate(tree.members)
    ]  # fmt: skip
    bodies = [Link(links[k], (Body("body", member.inertia),)) for k, member in enumerate(tree.members)]
    return Mechanism("compared", tuple(bodies), tuple(made), gravity=tree.gravity)
