"""Differences of matched members, each in A's frames: bodies, axes, places, kinds, drives, conventions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from crosscheck.equivalence.alignment.member_alignment import SAME, MemberAlignment
from crosscheck.equivalence.difference import Change, Difference
from crosscheck.equivalence.digits import VECTOR, PairedDigits
from crosscheck.equivalence.hints import describe_factor, describe_tensor_change, describe_vector_change
from crosscheck.equivalence.tree import SCALARS, Member
from crosscheck.lifting.rigid import apply_placement, compute_angle, move_inertia
from flexinv.model.mechanism import Array, Limits, Placement

DRIVES = {
    "rotor_inertia": ("rotor inertia", "kg m^2", "kg"),
    "damping": ("damping", "N m s/rad", "N s/m"),
    "friction": ("dry friction", "N m", "N"),
    "stiffness": ("spring stiffness", "N m/rad", "N/m"),
}
START = "pose at zero"
SIGN = "sign of coordinate"
ZERO = "zero of coordinate"
LEFT_LIMITS = (
    "its limits are the same numbers in both files, so that one of them allows other places: looks like a mistake"
)
BOUNDS = ("lower", "upper", "effort", "velocity")
NOISE = 1e-12  # [m], [-], [kg m^2] as shown: rounding of frames that are turned there and back
# A limit that large binds no machine [rad], [m], [N m], [N], [1/s]; formats that demand one are given such.
UNBOUND = 1e8
TURN = 2 * np.pi  # [rad]


@dataclass(frozen=True)
class MemberPair:
    """A member of A with the one of B, and how they are aligned; size : of the machines [m]; printed : digits of both."""

    one: Member
    two: Member
    alignment: MemberAlignment
    size: float
    printed: PairedDigits

    @property
    def joint(self) -> str:
        """Return the joint in words."""
        return f"joint {self.one.joint}"

    @property
    def link(self) -> str:
        """Return the link in words."""
        return f"link {self.one.name}"

    def compute_joint_rounding(self, quantity: str) -> float:
        """Return the part of a joint that printed digits leave open [the quantity's unit]; 0 where none are printed."""
        return self.printed.compute_joint_rounding(self.one, self.two, quantity)

    def compute_body_rounding(self, quantity: str) -> float:
        """Return the part of a body that printed digits leave open [the quantity's unit]; 0 where none are printed."""
        return self.printed.compute_body_rounding(self.one, self.two, quantity)

    def make_change(self, name: str, value: Any) -> Change:
        """Return the change of one field of A's member [unit of the field]."""
        return self.alignment.first, name, value


def list_member_differences(pair: MemberPair) -> Iterator[Difference]:
    """Yield every difference of two matched members [unit of each]."""
    yield from list_joint_differences(pair)
    yield from list_body_differences(pair)
    yield from list_drive_differences(pair)


def list_joint_differences(pair: MemberPair) -> Iterator[Difference]:
    """Yield differences of kind, place, axis [m], [rad], and of how the coordinate counts."""
    one = pair.one
    two = pair.two
    seat = pair.alignment
    if one.kind != two.kind:
        edits = (pair.make_change("kind", two.kind), pair.make_change("axis", seat.frame.rotation @ two.axis))
        yield Difference("rigid", "kind of joint", pair.joint, 1.0, "-", one.kind, two.kind, edits, structural=True)
        return
    yield from _compare_placement(pair)
    if one.kind not in SCALARS:
        return
    axis = seat.frame.rotation @ two.axis * seat.sign
    tilt = float(np.arctan2(np.linalg.norm(np.cross(one.axis, axis)), one.axis @ axis))
    if tilt > SAME:
        digits = pair.compute_joint_rounding("axis") + pair.compute_joint_rounding("rotation")
        changes = (pair.make_change("axis", axis),)
        shown = format_vector(one.axis), format_vector(axis)
        yield Difference("rigid", "joint axis", pair.joint, tilt, "rad", *shown, changes, printed=digits)
    elif tilt > 0.0:
        yield _make_silent_difference(pair, "axis", axis)
    if one.kind == "helical" and abs(one.pitch - two.pitch) > SAME * abs(one.pitch):
        yield _make_scalar_difference(pair, "rigid", "pitch", "pitch", two.pitch, "m")
    unit = "m" if one.kind == "prismatic" else "rad"
    if seat.sign < 0:
        yield Difference("convention", SIGN, pair.joint, 2.0, "-", "+", "-", hints=_describe_unchanged_limits(pair))
    if abs(seat.offset) > SAME * (pair.size if unit == "m" else 1.0):
        digits = pair.compute_joint_rounding("shift" if unit == "m" else "zero")
        yield Difference(
            "convention", ZERO, pair.joint, abs(seat.offset), unit, "0", f"{seat.offset:.9g}",
            hints=(*describe_factor(seat.offset, 0.0), *_describe_unchanged_limits(pair)), printed=digits,
        )  # fmt: skip


def _compare_placement(pair: MemberPair) -> Iterator[Difference]:
    one = pair.one
    rest = pair.alignment.rest
    way = float(np.linalg.norm(rest.position))
    turn = compute_angle(rest.rotation)
    target = apply_placement(one.placement, rest)
    if one.kind == "free":
        yield from _compare_start_pose(pair, target, way, turn)
        return
    if way > SAME * pair.size:
        changes = (pair.make_change("placement position", target.position),)
        shown = format_vector(one.placement.position), format_vector(target.position)
        hints = describe_vector_change(target.position, one.placement.position)
        digits = pair.compute_joint_rounding("position")
        yield Difference("rigid", "position of joint", pair.joint, way, "m", *shown, changes, hints, printed=digits)
    elif way > 0.0:
        yield _make_silent_difference(pair, "placement position", target.position)
    if turn > SAME:
        changes = (pair.make_change("placement rotation", target.rotation),)
        digits = pair.compute_joint_rounding("rotation")
        shown = _format_rpy(one.placement.rotation), _format_rpy(target.rotation)
        yield Difference("rigid", "orientation of joint", pair.joint, turn, "rad", *shown, changes, printed=digits)
    elif turn > 0.0:
        yield _make_silent_difference(pair, "placement rotation", target.rotation)


def _make_silent_difference(pair: MemberPair, name: str, value: Any) -> Difference:
    """Put right a difference too small to be named: many of them add up."""
    return Difference("rigid", "", pair.joint, 0.0, "-", "", "", (pair.make_change(name, value),))


def _compare_start_pose(pair: MemberPair, target: Placement, way: float, turn: float) -> Iterator[Difference]:
    """Compare the pose of a floating base at zero [m], [rad]: its coordinates count from there; what acts on it is the same."""
    one = pair.one
    yield _make_silent_difference(pair, "placement position", target.position)
    yield _make_silent_difference(pair, "placement rotation", target.rotation)
    for size, unit, bound, a, b in (
        (way, "m", SAME * pair.size, format_vector(one.placement.position), format_vector(target.position)),
        (turn, "rad", SAME, _format_rpy(one.placement.rotation), _format_rpy(target.rotation)),
    ):
        if size > bound:
            hints = ("where the base begins: no torque feels it",)
            yield Difference("convention", START, pair.joint, size, unit, a, b, hints=hints)


def list_body_differences(pair: MemberPair) -> Iterator[Difference]:
    """Yield differences of mass [kg], centre of mass [m] and tensor [kg m^2] of a link."""
    one = pair.one
    there = move_inertia(pair.alignment.frame, pair.two.inertia)
    if abs(there.mass - one.mass) > SAME * max(one.mass, there.mass):
        yield _make_scalar_difference(pair, "rigid", "mass", "mass", there.mass, "kg", pair.link)
    gap = float(np.linalg.norm(there.com - one.com))
    if there.mass and (one.mass or one.tensor.any()) and gap > SAME * pair.size:
        shown = format_vector(one.com), format_vector(there.com)
        hints = describe_vector_change(there.com, one.com)
        changes = (pair.make_change("com", there.com),)
        digits = VECTOR * pair.compute_body_rounding("com")
        yield Difference("rigid", "centre of mass", pair.link, gap, "m", *shown, changes, hints, printed=digits)
    elif gap > 0.0:
        yield Difference("rigid", "", pair.link, 0.0, "-", "", "", (pair.make_change("com", there.com),))
    off = float(np.abs(there.tensor - one.tensor).max())
    if off > SAME * max(float(np.abs(one.tensor).max()), float(np.abs(there.tensor).max())):
        shown = _format_tensor(one.tensor), _format_tensor(there.tensor)
        hints = describe_tensor_change(one.inertia, there)
        changes = (pair.make_change("tensor", there.tensor),)
        digits = pair.compute_body_rounding("tensor")
        yield Difference("rigid", "inertia tensor", pair.link, off, "kg m^2", *shown, changes, hints, printed=digits)


def list_drive_differences(pair: MemberPair) -> Iterator[Difference]:
    """Yield differences of rotor, damping, friction, spring, gear [-] and limits."""
    one = pair.one
    two = pair.two
    if one.kind == "fixed":
        return
    for name, (cause, turning, sliding) in DRIVES.items():
        first = getattr(one, name)
        second = getattr(two, name)
        if abs(first - second) > SAME * max(abs(first), abs(second)):
            unit = sliding if one.kind == "prismatic" else turning
            yield _make_scalar_difference(pair, "drive", cause, name, second, unit)
    yield from _compare_rest(pair)
    gear = pair.alignment.sign * two.gear
    if one.gear and two.gear and abs(one.gear - gear) > SAME * abs(one.gear):
        yield _make_scalar_difference(pair, "drive", "gear", "gear", gear, "-")
    yield from _compare_limits(pair)


def _compare_rest(pair: MemberPair) -> Iterator[Difference]:
    """The rest of both springs, B's in A's coordinate."""
    one = pair.one
    two = pair.two
    rest = pair.alignment.sign * two.rest + pair.alignment.offset
    if one.stiffness and two.stiffness and abs(rest - one.rest) > SAME:
        unit = "m" if one.kind == "prismatic" else "rad"
        yield _make_scalar_difference(pair, "drive", "rest of spring", "rest", rest, unit)
    elif two.stiffness and rest != one.rest:
        yield Difference("drive", "", pair.joint, 0.0, "-", "", "", (pair.make_change("rest", rest),))


def _compare_limits(pair: MemberPair) -> Iterator[Difference]:
    """Limits, B's in A's coordinate; one that a file does not state is none."""
    first = pair.one.limits
    second = _map_limits(pair.two.limits, pair.alignment)
    # Where the coordinate counts otherwise and its range was left, that is one thing, which the convention says.
    left = (pair.alignment.sign < 0 or pair.alignment.offset) and _close(first, pair.two.limits)
    unit = "m" if pair.one.kind == "prismatic" else "rad"
    units = dict(zip(BOUNDS, (unit, unit, "N" if unit == "m" else "N m", f"{unit}/s"), strict=True))
    for name in BOUNDS[2:] if left else BOUNDS:
        a = _resolve_limit(getattr(first, name))
        b = _resolve_limit(getattr(second, name))
        if name in BOUNDS[:2] and np.isfinite(a) != np.isfinite(b):
            values = ("none", f"{b:.9g}") if np.isfinite(b) else (f"{a:.9g}", "none")
            changes = (pair.make_change(f"limits {name}", b),)
            yield Difference("limits", f"{name} limit", pair.joint, 1.0, "-", values[0], values[1], changes)
        if np.isfinite(a) and np.isfinite(b) and abs(a - b) > SAME * max(abs(a), abs(b), 1e-3):
            changes = (pair.make_change(f"limits {name}", b),)
            digits = 0.5e-4 * max(abs(a), abs(b))
            yield Difference(
                "limits", f"{name} limit", pair.joint, abs(b - a), units[name], f"{a:.9g}", f"{b:.9g}", changes,
                describe_factor(b, a), printed=digits,
            )  # fmt: skip


def _resolve_limit(limit: float) -> float:
    return limit if abs(limit) < UNBOUND else float(np.copysign(np.inf, limit))


def _describe_unchanged_limits(pair: MemberPair) -> tuple[str, ...]:
    """Words where the limits are the same numbers although the coordinate counts otherwise: the sign of a mistake."""
    first = pair.one.limits
    second = pair.two.limits
    if not np.isfinite(first.lower) or not _close(first, second):
        return ()
    seats = [pair.alignment]
    if pair.one.kind == "revolute":  # a whole turn on, a hinge is in the same place
        seats += [replace(pair.alignment, offset=pair.alignment.offset + way) for way in (-TURN, TURN)]
    return () if any(_close(first, _map_limits(second, seat)) for seat in seats) else (LEFT_LIMITS,)


def _map_limits(limits: Limits, alignment: MemberAlignment) -> Limits:
    ends = sorted((alignment.sign * limits.lower + alignment.offset, alignment.sign * limits.upper + alignment.offset))
    return Limits(limits.effort, limits.velocity, *ends)


def _close(one: Limits, two: Limits) -> bool:
    """Compare two stated ranges, to the six digits that some writers keep."""
    pairs = [(getattr(one, name), getattr(two, name)) for name in BOUNDS[:2]]
    return all(a == b or abs(a - b) <= 1e-5 * abs(a) for a, b in pairs)


def _make_scalar_difference(
    pair: MemberPair, family: str, cause: str, name: str, value: float, unit: str, place: str = ""
) -> Difference:
    first = float(getattr(pair.one, name))
    digits = pair.compute_body_rounding(name) if place else pair.compute_joint_rounding(name)
    return Difference(
        family, cause, place or pair.joint, abs(value - first), unit, f"{first:.9g}", f"{value:.9g}",
        (pair.make_change(name, value),), describe_factor(value, first), printed=digits,
    )  # fmt: skip


def format_vector(numbers: Array) -> str:
    """Return numbers as text [any unit]; what is rounding beside the largest of them is zero."""
    small = max(NOISE, SAME * float(np.abs(numbers).max(initial=0.0)))
    return " ".join(f"{x:.9g}" for x in np.where(np.abs(numbers) < small, 0.0, numbers))


def format_placement(frame: Placement) -> str:
    """Return a frame as text: position [m], and its turn [rad] where it has one."""
    turn = compute_angle(frame.rotation)
    return format_vector(frame.position) + (f", {_format_rpy(frame.rotation)}" if turn > SAME else "")


def _format_rpy(rotation: Array) -> str:
    from crosscheck.engines.shared.urdf_text import compute_roll_pitch_yaw

    return format_vector(np.array(compute_roll_pitch_yaw(rotation))) + " rpy"


def _format_tensor(tensor: Array) -> str:
    return format_vector(tensor[np.triu_indices(3)])
