"""Alignment: which pose of B's frame in A's makes two members the same body, and which offsets and signs follow.

The frame of a link is a convention, and so is where the machine stands.  Of all alignments the one is taken whose list of
differences is the shortest and smallest (`lengths`), over poses that the members themselves suggest (`poses`); that nothing
differs is tried first.  With  T  the pose of B's frame in A's,  X  that of a joint on its carrier, c what a member carries:

    S(T)  =  frame(T) + body(T) + sum over c of min over T_c ( joint(T, T_c) + S(T_c) ),      X' = T X_B T_c^-1  against  X_A

which is found from the tips to the base.  The world of B stands in that of A by a pose as well: the motion of the base.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from crosscheck.equivalence.alignment.lengths import DescriptionLengths
from crosscheck.equivalence.alignment.member_alignment import MemberAlignment, make_joint_alignment
from crosscheck.equivalence.alignment.poses import MemberPoses
from crosscheck.equivalence.tree import Tree
from flexinv.model.mechanism import Placement

MOST = 6  # poses of a member that are followed
BASES = 4  # poses of the base that are followed to the tips
NEAR = 1e-9  # [m], [rad]: poses that are one
# Of lengths: a thousandth of a digit is no reason to leave the pose in which both machines stand as they are.
TIE = 1e-3


@dataclass(frozen=True)
class Alignment:
    """Seats of all pairs, parents first, and the pose of B's world in A's [m]; length : of the list of what differs [-]."""

    alignments: list[MemberAlignment]
    motion: Placement = field(default_factory=Placement)
    length: float = 0.0


def find_alignment(first: Tree, second: Tree, pairs: list[tuple[int, int]], size: float) -> Alignment:
    """Return the alignment of every pair of members, parents first; size : of the machines [m].

    First all stands as it is, and a member in which that leaves no difference is not looked at again.  Where differences are
    left, they may be owed to any member before them, and to the base: for those all poses are tried.
    """
    lengths = DescriptionLengths(first, second, dict(pairs), size)
    search = AlignmentSearch(lengths, MemberPoses(lengths))
    best = search.find_best_alignment(Placement())
    search.doubted = search.list_differing_members(best)
    if not search.doubted and not lengths.compute_base_code_length(Placement()):
        return best
    for least, motion in ((0.0, Placement()), *search.list_base_motions()):
        if least >= best.length:
            break
        other = search.find_best_alignment(motion)
        if other.length < best.length - NEAR:
            best = other
    return best


@dataclass
class AlignmentSearch:
    """The search for the shortest list of differences; the poses of each member that are followed are kept by its number.

    doubted : members of which all poses are tried, also where nothing differs in them
    """

    lengths: DescriptionLengths
    poses: MemberPoses
    doubted: set[int] = field(default_factory=set)
    candidate_poses: dict[int, list[Placement]] = field(default_factory=dict)

    def find_best_alignment(self, motion: Placement) -> Alignment:
        """Return the best alignment where B's world stands so in A's [m]."""
        first = self.lengths.first
        partner = self.lengths.partner
        self.candidate_poses = {-1: [motion]}
        for a in sorted(partner):
            self.candidate_poses[a] = self._list_candidate_poses(a, self.candidate_poses[first.members[a].parent])
        sums: dict[int, list[float]] = {}
        chosen: dict[tuple[int, int], int] = {}
        for a in [*sorted(partner, reverse=True), -1]:
            sums[a] = [
                self._compute_subtree_length(a, k, pose, sums, chosen) for k, pose in enumerate(self.candidate_poses[a])
            ]
        seats: list[MemberAlignment] = []
        taken = {-1: 0}
        for a in sorted(partner):
            carrier = first.members[a].parent
            taken[a] = chosen[a, taken[carrier]]
            before = self.candidate_poses[carrier][taken[carrier]]
            frame = self.candidate_poses[a][taken[a]]
            seats.append(
                make_joint_alignment(
                    first.members[a], self.lengths.second.members[partner[a]], (a, partner[a]), before, frame
                )
            )
        total = (
            sums[-1][0]
            + self.lengths.compute_base_code_length(motion)
            + self.lengths.compute_ground_code_length(motion)
        )
        return Alignment(seats, motion, total)

    def _compute_subtree_length(
        self, a: int, k: int, pose: Placement, sums: dict[int, list[float]], chosen: dict[tuple[int, int], int]
    ) -> float:
        """The length of all that a member carries in one of its poses; which pose of each child that takes is kept."""
        total = (
            self.lengths.compute_frame_code_length(pose) + self.lengths.compute_body_code_length(a, pose)
            if a >= 0
            else 0.0
        )
        for c in self.lengths.first.list_children(a):
            if c not in self.lengths.partner:
                continue
            ways = [
                self.lengths.compute_joint_code_length(c, pose, there) + sums[c][m]
                for m, there in enumerate(self.candidate_poses[c])
            ]
            least = min(ways)
            chosen[c, k] = next(m for m, way in enumerate(ways) if way <= least + TIE)
            total += ways[chosen[c, k]]
        return total

    def _list_candidate_poses(self, a: int, carriers: Iterable[Placement]) -> list[Placement]:
        """The poses of a member that are followed: one where nothing differs in it for any pose of its carrier."""
        found: list[tuple[float, Placement]] = []
        known: set[bytes] = set()
        for before in carriers:
            still = self.poses.compute_unmoved_pose(a, before)
            alone = a not in self.doubted and not self._compute_pose_length(a, before, still)
            tried = [still] if alone else [still, *self.poses.list_other_poses(a, still)]
            for pose in tried:
                if (key := _make_pose_key(pose)) not in known:
                    known.add(key)
                    found.append(
                        (
                            self._compute_pose_length(a, before, pose) + self.lengths.compute_frame_code_length(pose),
                            pose,
                        )
                    )
        found.sort(key=lambda one: round(one[0] / TIE))
        return [pose for _, pose in found[:MOST]]

    def _compute_pose_length(self, a: int, before: Placement, pose: Placement) -> float:
        return self.lengths.compute_joint_code_length(a, before, pose) + self.lengths.compute_content_code_length(
            a, pose
        )

    def list_differing_members(self, best: Alignment) -> set[int]:
        """Return the members in which something differs, and all that carry them."""
        lengths = self.lengths
        frames = {-1: best.motion} | {seat.first: seat.frame for seat in best.alignments}
        differing_members: set[int] = set()
        for a, frame in frames.items():
            carrier = lengths.first.members[a].parent if a >= 0 else -1
            off = (
                a >= 0
                and max(
                    lengths.compute_joint_code_length(a, frames[carrier], frame),
                    lengths.compute_body_code_length(a, frame),
                )
                > 0.0
            )
            while off and a >= 0:
                differing_members.add(a)
                a = lengths.first.members[a].parent
        return differing_members

    def list_base_motions(self) -> list[tuple[float, Placement]]:
        """Return the motions of the base that most of what stands on the world agrees with, the shortest first [-], [m]."""
        lengths = self.lengths
        roots = [a for a in lengths.first.list_children(-1) if a in lengths.partner]
        found: list[tuple[float, Placement]] = []
        known = {_make_pose_key(Placement())}
        for motion in self.poses.list_base_motions(roots):
            if (key := _make_pose_key(motion)) in known:
                continue
            known.add(key)
            length = lengths.compute_base_code_length(motion) + lengths.compute_ground_code_length(motion)
            for a in roots:
                still = self.poses.compute_unmoved_pose(a, motion)
                length += min(lengths.compute_joint_code_length(a, motion, pose) for pose in (still, Placement()))
            found.append((length, motion))
        found.sort(key=lambda one: one[0])
        return found[:BASES]


def _make_pose_key(pose: Placement) -> bytes:
    """The same bytes for poses that are one to rounding."""
    numbers = np.concatenate([pose.position, pose.rotation.ravel()])
    return (np.round(numbers / NEAR) + 0.0).astype(np.int64).tobytes()
