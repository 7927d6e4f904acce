"""Lengths of lists of differences: of two that explain as much, the one is taken that is shorter and whose sizes are smaller.

A difference of relative size x costs one line, and the digits that are needed to tell it:

    length(x)  =  0  where  x <= SEEN,      1 + log10(x / SEEN)  else

A convention is told in HALF of that, and so are limits: of two lists that explain as much, the one is taken in which nothing
differs that a torque feels.  Limits that move with a zero follow from it and add nothing; limits whose numbers stay while the
zero moves are one thing more, and no number.

A frame of a link that stands elsewhere is told in FRAME of that, which is a little less than a zero: a link that is round about
its joint's axis shows no zero, and its frame alone stands elsewhere.  But it is told: that both files state a body by the same
numbers in the same frame is no accident.  Where a finger's zero moved, its centre of mass stands elsewhere in a frame that did
not turn with it; both explain every torque, and the first is told without another frame.

So do links that stand still and carry joints, whatever they are called: where a base turned and the zero on it turned back, the
joint stands where it stood and its limits seem to have moved; that its carrier stands elsewhere shows that they have not.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from crosscheck.equivalence.alignment.member_alignment import (
    SAME,
    SEEN,
    MemberAlignment,
    has_same_limits,
    is_same_as_printed,
    make_joint_alignment,
)
from crosscheck.equivalence.tree import SCALARS, Member, Tree
from crosscheck.lifting.rigid import (
    apply_placement,
    compute_angle,
    compute_norm,
    compute_relative_pose,
    cross,
    move_inertia,
)
from flexinv.model.mechanism import Array, Inertia, Placement

HALF = 0.5  # of the length of a difference: how conventions and limits weigh
# The same, of frames.  Less than HALF, as said above; and a centre of mass on the other side of its joint, as far as the machine
# is large, length(1) = 7, stays shorter than half a turn of frame and zero together: (FRAME + HALF) length(pi) > 7.
FRAME = 0.45
HINGES = ("revolute", "helical")


def compute_code_length(size: float) -> float:
    """Return the length of a difference by its relative size [-]."""
    return 1.0 + float(np.log10(size / SEEN)) if size > SEEN else 0.0


@dataclass(frozen=True)
class RigidPartContent:
    """A rigid part of both trees as it shows its frame: bodies, and joints that hang on it, in the frame of its first member.

    bodies : inertias of both [kg, m, kg m^2]; hung : kind, placements [m] and axes [-] of both
    """

    bodies: list[tuple[Inertia, Inertia]]
    hung: list[tuple[str, tuple[Placement, Array], tuple[Placement, Array]]]


@dataclass
class DescriptionLengths:
    """Two trees whose members are matched, partner by number in the first, and what differs in poses; size : of both [m]."""

    first: Tree
    second: Tree
    partner: dict[int, int]
    size: float
    known: dict[int, RigidPartContent] = field(default_factory=dict)

    def compute_frame_code_length(self, frame: Placement) -> float:
        """Return the length of a frame of B that stands so in A's [m]."""
        return FRAME * compute_code_length(max(compute_norm(frame.position) / self.size, compute_angle(frame.rotation)))

    def compute_joint_code_length(self, a: int, before: Placement, frame: Placement) -> float:
        """Return the length of what differs in a joint, where its carrier and its own frame stand so [m]."""
        one = self.first.members[a]
        two = self.second.members[self.partner[a]]
        if one.kind == "free":
            return 0.0
        joint_alignment = make_joint_alignment(one, two, (a, self.partner[a]), before, frame)
        way = compute_norm(joint_alignment.rest.position) / self.size
        total = compute_code_length(way) + compute_code_length(compute_angle(joint_alignment.rest.rotation))
        if one.kind in SCALARS:
            total += compute_code_length(compute_norm(cross(one.axis, frame.rotation @ two.axis))) + float(
                joint_alignment.sign < 0.0
            )
            total += HALF * compute_code_length(
                abs(joint_alignment.offset) / (self.size if one.kind == "prismatic" else 1.0)
            )
            total += self._compute_limit_code_length(one, two, joint_alignment)
        return total

    def _compute_limit_code_length(self, one: Member, two: Member, alignment: MemberAlignment) -> float:
        """The length of limits and rests of springs that do not agree in these coordinates."""
        total = 0.0
        first = one.limits.lower, one.limits.upper
        moved_on = sorted(
            (alignment.sign * two.limits.lower + alignment.offset, alignment.sign * two.limits.upper + alignment.offset)
        )
        ends = [(a, b) for a, b in zip(first, moved_on, strict=True) if not is_same_as_printed(a, b)]
        stayed = (alignment.sign < 0.0 or alignment.offset) and has_same_limits(one, two)
        if ends:
            total += HALF if stayed else sum(HALF * compute_code_length(min(abs(a - b), 2 * np.pi)) for a, b in ends)
        if one.stiffness and two.stiffness:
            total += compute_code_length(abs(alignment.sign * two.rest + alignment.offset - one.rest))
        return total

    def compute_body_code_length(self, a: int, frame: Placement) -> float:
        """Return the length of what differs in where a link's mass is, in a pose of B's frame in A's [m]."""
        one = self.first.members[a]
        two = self.second.members[self.partner[a]]
        return self._compute_inertia_code_length(one.inertia, move_inertia(frame, two.inertia))

    def _compute_inertia_code_length(self, one: Inertia, there: Inertia) -> float:
        if not one.mass or not there.mass:
            return 0.0
        total = compute_code_length(compute_norm(there.com - one.com) / self.size)
        largest = float(np.abs(one.tensor).max())
        return total + (
            compute_code_length(float(np.abs(there.tensor - one.tensor).max()) / largest) if largest else 0.0
        )

    def compute_content_code_length(self, a: int, frame: Placement) -> float:
        """Return the length of what differs in all that shows how a rigid part stands, in a pose of B's frame in A's [m]."""
        content = self.collect_rigid_content(a)
        total = sum(self._compute_inertia_code_length(one, move_inertia(frame, two)) for one, two in content.bodies)
        return total + sum(self._compute_child_code_length(*hung, frame) for hung in content.hung)

    def _compute_child_code_length(
        self, kind: str, first: tuple[Placement, Array], second: tuple[Placement, Array], frame: Placement
    ) -> float:
        gap = frame.position + frame.rotation @ second[0].position - first[0].position
        if kind not in SCALARS:
            return compute_code_length(compute_norm(gap) / self.size)
        along = first[0].rotation @ first[1]
        total = compute_code_length(compute_norm(cross(along, frame.rotation @ (second[0].rotation @ second[1]))))
        return total + (compute_code_length(compute_norm(cross(along, gap)) / self.size) if kind in HINGES else 0.0)

    def collect_rigid_content(self, a: int) -> RigidPartContent:
        """Return the bodies and joints by which a member and all that is fixed to it show how they stand, found once [kg, m]."""
        if a not in self.known:
            one = self.first.members[a]
            two = self.second.members[self.partner[a]]
            rigid_part_content = RigidPartContent([(one.inertia, two.inertia)], [])
            self._collect_children(a, Placement(), Placement(), rigid_part_content)
            self.known[a] = rigid_part_content
        return self.known[a]

    def _collect_children(self, a: int, first: Placement, second: Placement, found: RigidPartContent) -> None:
        for c in self.first.list_children(a):
            if c not in self.partner:
                continue
            one = self.first.members[c]
            two = self.second.members[self.partner[c]]
            here = apply_placement(first, one.placement)
            there = apply_placement(second, two.placement)
            if one.kind == "fixed":
                found.bodies.append((move_inertia(here, one.inertia), move_inertia(there, two.inertia)))
                self._collect_children(c, here, there, found)
            elif one.kind == two.kind:
                found.hung.append((one.kind, (here, one.axis), (there, two.axis)))

    def compute_base_code_length(self, motion: Placement) -> float:
        """Return the length of a motion of the base, or of gravity where that is what differs [m]."""
        first = self.first.gravity
        second = self.second.gravity
        pull = max(compute_norm(first), compute_norm(second)) or 1.0
        code_length = compute_code_length(compute_norm(motion.rotation @ second - first) / pull)
        size = max(compute_norm(motion.position) / self.size, compute_angle(motion.rotation))
        if size <= SAME:
            return code_length
        changed = compute_code_length(compute_norm(second - first) / pull)
        # Gravity that stays the same in the world while the base turns is felt, and is the motion's: one difference.
        if code_length:
            return compute_code_length(size) + (code_length if changed else 0.0)
        return HALF * compute_code_length(size)

    def compute_ground_code_length(self, motion: Placement) -> float:
        """Return the length of the frames of links that stand still and carry joints, where B's world stands so in A's [m]."""
        return sum(
            self.compute_frame_code_length(compute_relative_pose(one, apply_placement(motion, two)))
            for one, two in self._grounds
        )

    @cached_property
    def _grounds(self) -> list[tuple[Placement, Placement]]:
        """The poses in both worlds of links that stand still and were merged into them, once for each of A [m]."""
        pairs = [(self.first.members[a].ground, self.second.members[b].ground) for a, b in self.partner.items()]
        known = {
            one.position.tobytes() + one.rotation.tobytes(): (one, two)
            for one, two in pairs
            if one is not None and two is not None
        }
        return list(known.values())
