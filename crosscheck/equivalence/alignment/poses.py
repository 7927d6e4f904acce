"""Poses that are tried for B's frame in A's: those that the joint, the body and what hangs on it suggest.

A pose is fixed by what a rigid part shows (`lengths.RigidPartContent`): its own axis, centres of mass, tensors, lines of joints.
From a pose in which one direction agrees, each of the others gives an angle about it, and each point a way along it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from crosscheck.equivalence.alignment.lengths import HINGES, DescriptionLengths
from crosscheck.equivalence.alignment.member_alignment import SEEN
from crosscheck.equivalence.tree import SCALARS, Member
from crosscheck.lifting.rigid import apply_placement, compute_norm, compute_relative_pose, cross, inverse, turned
from flexinv.model.mechanism import Array, Placement

INTRINSIC = 4  # poses by what a member shows alone, that are kept
SPREAD = 1e-3  # relative: principal moments nearer than that show no axes
TURNS = 10  # angles about an axis that are tried
PRIMARY = 4  # directions of which one is taken to agree


@dataclass
class MemberPoses:
    """The poses of the members of two trees; known : by member what it suggests whatever carries it."""

    lengths: DescriptionLengths
    known: dict[int, list[Placement]] = field(default_factory=dict)

    def compute_unmoved_pose(self, a: int, before: Placement) -> Placement:
        """Return the pose that leaves both machines where they stand at zero; before : of the carrier [m]."""
        one, two = self._find_member_pair(a)
        return self._move_onto_axis(a, compute_relative_pose(one.placement, apply_placement(before, two.placement)))

    def list_other_poses(self, a: int, still: Placement) -> Iterator[Placement]:
        """Yield other poses of a member: the same frame, its axis turned onto A's, turned zeros, and what it shows alone [m]."""
        one, _ = self._find_member_pair(a)
        yield self._move_onto_axis(a, Placement())
        if one.kind in SCALARS:
            straight = self._turn_onto_axis(a, still)
            yield straight
            yield from self._list_turned_frames(a, straight)
        yield from self.list_poses_by_content(a)

    def _find_member_pair(self, a: int) -> tuple[Member, Member]:
        return self.lengths.first.members[a], self.lengths.second.members[self.lengths.partner[a]]

    def _move_onto_axis(self, a: int, frame: Placement) -> Placement:
        """The frame moved across B's axis until that leads through A's origin: only its direction is then A's to change."""
        one, two = self._find_member_pair(a)
        if one.kind not in HINGES:
            return Placement(np.zeros(3), frame.rotation) if one.kind == "spherical" else frame
        axis = frame.rotation @ two.axis
        return Placement(float(frame.position @ axis) * axis, frame.rotation)

    def _turn_onto_axis(self, a: int, frame: Placement) -> Placement:
        """The frame turned by the least angle that brings B's axis onto A's, or onto its opposite."""
        one, two = self._find_member_pair(a)
        axis = frame.rotation @ two.axis
        turn = _compute_least_rotation(axis, one.axis if one.axis @ axis >= 0.0 else -one.axis)
        return self._move_onto_axis(a, Placement(turn @ frame.position, turn @ frame.rotation))

    def _list_turned_frames(self, a: int, frame: Placement) -> Iterator[Placement]:
        """Yield a frame whose axis is A's turned about it, and moved along it, until something that it shows agrees."""
        one, _ = self._find_member_pair(a)
        turns = [0.0, *(self._list_axis_angles(a, frame) if one.kind in HINGES else ())]
        for turn in turns:
            there = apply_placement(Placement(rotation=turned(one.axis, turn)), frame)
            yield there
            for way in self._list_axis_shifts(a, there):
                yield Placement(there.position + way * one.axis, there.rotation)

    def _list_axis_angles(self, a: int, frame: Placement) -> list[float]:
        """Angles about A's axis by which something that both show agrees, or their limits do [rad]."""
        one, two = self._find_member_pair(a)
        found = [
            -offset
            for offset in _list_coordinate_offsets(
                one, two, 1.0 if one.axis @ frame.rotation @ two.axis >= 0.0 else -1.0
            )
        ]
        found += self._list_matching_angles(a, one.axis, frame, points=True)
        return _drop_near_duplicates(found, 1e-9)[:TURNS]

    def _list_matching_angles(self, a: int, axis: Array, frame: Placement, points: bool) -> list[float]:
        """Angles about an axis of A by which directions agree, and points where they count from the frame's origin [rad]."""
        matching_angles = []
        for first, second in self._list_vector_pairs(a, axis, frame, points):
            turn = _turn_between(axis, second, first)
            if turn is not None:
                matching_angles.append(turn)
        for first, second in self._list_direction_pairs(a):
            turn = _turn_between(axis, frame.rotation @ second, first)
            if turn is not None:
                matching_angles += [turn, turn + np.pi]
        return matching_angles

    def _list_vector_pairs(self, a: int, axis: Array, frame: Placement, points: bool) -> Iterator[tuple[Array, Array]]:
        """Yield vectors of A and B, B's in A's frame, whose directions count: places, what tensors make of the axis."""
        content = self.lengths.collect_rigid_content(a)
        size = self.lengths.size
        for one, two in content.bodies:
            if not one.mass or not two.mass:
                continue
            if points:
                yield one.com / size, (frame.position + frame.rotation @ two.com) / size
            largest = float(np.abs(one.tensor).max()) or 1.0
            there = frame.rotation @ two.tensor @ frame.rotation.T
            yield one.tensor @ axis / largest, there @ axis / largest
        if points:
            for kind, (at, along), (other, across) in content.hung:
                second = apply_placement(frame, other)
                if kind in HINGES:
                    yield tuple(  # type: ignore[misc]
                        _find_nearest_point(axis, pose.position, pose.rotation @ line) / size
                        for pose, line in ((at, along), (second, across))
                    )
                elif kind != "prismatic":
                    yield at.position / size, second.position / size

    def _list_direction_pairs(self, a: int) -> Iterator[tuple[Array, Array]]:
        """Yield directions of A and B that count in both ways: axes of joints, principal axes."""
        content = self.lengths.collect_rigid_content(a)
        for kind, (at, along), (other, across) in content.hung:
            if kind in SCALARS:
                yield at.rotation @ along, other.rotation @ across
        for one, two in content.bodies:
            if one.mass and two.mass:
                yield from _list_principal_axes(one.tensor, two.tensor)

    def _list_axis_shifts(self, a: int, frame: Placement) -> list[float]:
        """Ways along A's axis by which a point of both agrees [m]."""
        one, _ = self._find_member_pair(a)
        found = [float(gap @ one.axis) for gap in self._list_point_gaps(a, frame, one.axis)]
        return _drop_near_duplicates(found, 1e-9 * self.lengths.size)[:TURNS]

    def _list_point_gaps(self, a: int, frame: Placement, axis: Array | None) -> Iterator[Array]:
        """Yield the ways from B's points to A's: centres of mass, places on lines nearest to an axis, places of joints."""
        content = self.lengths.collect_rigid_content(a)
        for one, two in content.bodies:
            if one.mass and two.mass:
                yield one.com - (frame.position + frame.rotation @ two.com)
        for kind, (at, along), (other, across) in content.hung:
            there = apply_placement(frame, other)
            if kind in HINGES and axis is not None:
                first = at.rotation @ along
                second = there.rotation @ across
                if compute_norm(cross(axis, first)) > SPREAD:
                    yield _find_nearest_point(axis, at.position, first) - _find_nearest_point(
                        axis, there.position, second
                    )
            elif kind != "prismatic":
                yield at.position - there.position

    def list_poses_by_content(self, a: int) -> list[Placement]:
        """Return poses by what a member shows alone, whatever carries it, the best first [m]."""
        if a not in self.known:
            tried: dict[float, Placement] = {}
            for pose in self._list_registered_poses(a):
                there = self._move_onto_axis(a, pose)
                tried[self.lengths.compute_content_code_length(a, there) + 1e-6 * len(tried)] = there
            self.known[a] = [tried[key] for key in sorted(tried)[:INTRINSIC]]
        return self.known[a]

    def _list_registered_poses(self, a: int) -> Iterator[Placement]:
        one, two = self._find_member_pair(a)
        axes = [(one.axis, two.axis)]
        primary = axes if one.kind in SCALARS else [*self._list_direction_pairs(a), *self._list_arm_pairs(a)][:PRIMARY]
        for first, second in primary:
            for sign in (1.0, -1.0):
                base = Placement(rotation=_compute_least_rotation(second, sign * first))
                turns = [0.0, *self._list_matching_angles(a, first, base, points=one.kind in HINGES)]
                for turn in _drop_near_duplicates(turns, 1e-9)[:TURNS]:
                    there = Placement(rotation=turned(first, turn) @ base.rotation)
                    yield from self._list_placed_frames(a, there)

    def _list_arm_pairs(self, a: int) -> Iterator[tuple[Array, Array]]:
        """Yield ways between two points of a rigid part, in A and in B [-]."""
        points = [
            (one.com, two.com) for one, two in self.lengths.collect_rigid_content(a).bodies if one.mass and two.mass
        ]
        points += [
            (first[0].position, second[0].position) for _, first, second in self.lengths.collect_rigid_content(a).hung
        ]
        for first, second in points[1:]:
            arms = first - points[0][0], second - points[0][1]
            sizes = [compute_norm(arm) for arm in arms]
            if min(sizes) > SPREAD * self.lengths.size:
                yield arms[0] / sizes[0], arms[1] / sizes[1]

    def _list_placed_frames(self, a: int, frame: Placement) -> Iterator[Placement]:
        """Yield a turned frame where points of both agree."""
        one, _ = self._find_member_pair(a)
        yield frame
        if one.kind in HINGES:
            for way in self._list_axis_shifts(a, frame):
                yield Placement(way * one.axis, frame.rotation)
        elif one.kind != "spherical":
            for gap in self._list_point_gaps(a, frame, None):
                yield Placement(frame.position + gap, frame.rotation)
            yield from self._fit_frame_to_hinges(a, frame)

    def _fit_frame_to_hinges(self, a: int, frame: Placement) -> Iterator[Placement]:
        """Yield the frame moved so that the lines of all hinges agree best: sum of (1 - u u^T)(way - gap) least."""
        matrix = np.zeros((3, 3))
        right = np.zeros(3)
        for kind, (at, along), (other, _) in self.lengths.collect_rigid_content(a).hung:
            if kind in HINGES:
                axis = at.rotation @ along
                across = np.eye(3) - np.outer(axis, axis)
                matrix = matrix + across
                right = right + across @ (at.position - apply_placement(frame, other).position)
        if np.linalg.matrix_rank(matrix, tol=SPREAD) == 3:
            yield Placement(frame.position + np.linalg.solve(matrix, right), frame.rotation)

    def list_base_motions(self, roots: Iterable[int]) -> Iterator[Placement]:
        """Yield motions of the base: by each joint that stands on the world, its zero as it is or gravity as it is [m]."""
        first = self.lengths.first.gravity
        second = self.lengths.second.gravity
        if compute_norm(first) and compute_norm(second):
            yield Placement(
                rotation=_compute_least_rotation(second / compute_norm(second), first / compute_norm(first))
            )
        for a in roots:
            one, two = self._find_member_pair(a)
            for pose in (self._move_onto_axis(a, Placement()), *self.list_poses_by_content(a)):
                back = apply_placement(pose, inverse(two.placement))
                yield apply_placement(one.placement, back)
                if one.kind not in SCALARS:
                    continue
                sign = 1.0 if one.axis @ pose.rotation @ two.axis >= 0.0 else -1.0
                offsets = list(_list_coordinate_offsets(one, two, sign))
                if one.kind == "prismatic":
                    for offset in offsets:
                        yield apply_placement(apply_placement(one.placement, Placement(offset * one.axis)), back)
                    continue
                down = one.placement.rotation.T @ first
                turn = _turn_between(one.axis, back.rotation @ second, down) if first.any() and second.any() else None
                offsets += [] if turn is None else [turn]
                for offset in offsets:
                    yield apply_placement(
                        apply_placement(one.placement, Placement(rotation=turned(one.axis, offset))), back
                    )


def _list_coordinate_offsets(one: Member, two: Member, sign: float) -> Iterator[float]:
    """Yield A's coordinate at B's zero by which limits, or rests of springs, agree [rad]."""
    ends = (two.limits.lower, two.limits.upper) if sign > 0 else (-two.limits.upper, -two.limits.lower)
    for first, second in zip((one.limits.lower, one.limits.upper), ends, strict=True):
        if np.isfinite(first) and np.isfinite(second) and max(abs(first), abs(second)) < 1e8:
            yield first - second
    if one.stiffness and two.stiffness:
        yield one.rest - sign * two.rest


def _compute_least_rotation(start: Array, end: Array) -> Array:
    """The rotation by the least angle from one unit vector to another."""
    normal = cross(start, end)
    sine = compute_norm(normal)
    if sine < 1e-12:
        if start @ end > 0.0:
            return np.eye(3)
        across = cross(start, np.eye(3)[int(np.argmin(np.abs(start)))])
        return turned(across / compute_norm(across), np.pi)
    return turned(normal / sine, float(np.arctan2(sine, start @ end)))


def _turn_between(axis: Array, start: Array, end: Array) -> float | None:
    """The angle [rad] about an axis from one vector to another; None where one of them lies along it."""
    u = start - (start @ axis) * axis
    v = end - (end @ axis) * axis
    if min(compute_norm(u), compute_norm(v)) <= SEEN:
        return None
    return float(np.arctan2(axis @ cross(u, v), u @ v))


def _find_nearest_point(axis: Array, point: Array, direction: Array) -> Array:
    """The point of a line that is nearest to an axis through the origin; of a line along it the one that is given."""
    across = direction - (direction @ axis) * axis
    square = float(across @ across)
    if square <= SPREAD**2:
        return point
    radial = point - (point @ axis) * axis
    return np.asarray(point - (radial @ across) / square * direction)


def _list_principal_axes(first: Array, second: Array) -> Iterator[tuple[Array, Array]]:
    """Yield the principal axes that both tensors show, those of moments that are no other's."""
    moments, axes = np.linalg.eigh(first)
    _, others = np.linalg.eigh(second)
    scale = float(moments[2]) or 1.0
    for k in range(3):
        gap = min(abs(float(moments[k] - moments[m])) for m in range(3) if m != k)
        if gap > SPREAD * scale:
            yield axes[:, k], others[:, k]


def _drop_near_duplicates(numbers: Iterable[float], near: float) -> list[float]:
    result: list[float] = []
    for number in numbers:
        if all(abs(number - other) > near for other in result):
            result.append(number)
    return result
