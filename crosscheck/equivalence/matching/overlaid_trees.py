"""Children of two members in one frame: which joint of the second stands where one of the first does.

Frames of links, zeros of joints and the place of the base are conventions, so where a joint stands on its carrier is known only
once the carriers' frames are.  Tried are the poses that their bodies suggest, and those in which one of the joints is another
one (`poses`); the one is taken in which all joints together are nearest to others.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded when they are asked for

from crosscheck.equivalence.alignment.lengths import DescriptionLengths
from crosscheck.equivalence.alignment.poses import MemberPoses
from crosscheck.equivalence.matching.costs import IMPOSSIBLE, PairCosts
from crosscheck.equivalence.tree import SCALARS, Tree, join_into_carriers
from crosscheck.lifting.rigid import apply_placement, compute_norm, cross
from flexinv.model.mechanism import Array, Placement

FAR = 2.0  # cost of a joint that stands nowhere near
NEAR = 1e-6  # cost below which a pose is taken without another look


def join_fixed_links(tree: Tree) -> tuple[Tree, dict[int, int]]:
    """Return a tree whose fixed links are merged, and new numbers by old ones [-]."""
    return join_into_carriers(tree, [k for k, member in enumerate(tree.members) if member.kind == "fixed"])


@dataclass(frozen=True)
class OverlaidTrees:
    """Two trees without fixed links, their costs, and the numbers that members have there by those that they had."""

    plain: PairCosts
    first: Mapping[int, int]
    second: Mapping[int, int]

    @classmethod
    def build_for(cls, first: Tree, second: Tree) -> OverlaidTrees:
        """Return two trees that are laid on one another [-]."""
        one, ours = join_fixed_links(first)
        two, theirs = join_fixed_links(second)
        return cls(PairCosts(one, two), ours, theirs)

    def compute_costs(self, before: tuple[int, int], first: list[int], second: list[int]) -> Array:
        """Return the costs [-] of joints of two members, (ours, theirs): what they show, and where they stand.

        before : the moving members that carry them, -1 the world
        """
        above = self.first.get(before[0], -1), self.second.get(before[1], -1)
        mine = [self.first[k] for k in first]
        yours = [self.second[k] for k in second]
        shown = np.array([[compute_subtree_cost(self.plain, above, k, m) for m in yours] for k in mine])
        return shown + self._compute_placement_costs(above, mine, yours, shown) if shown.size > 1 else shown

    def _compute_placement_costs(
        self, above: tuple[int, int], first: list[int], second: list[int], shown: Array
    ) -> Array:
        """Costs of joints by where they stand on carriers that are laid on one another."""
        best = np.full(shown.shape, FAR)
        least = np.inf, np.inf
        for frame in self._list_trial_frames(*above, first, second):
            found = np.array([[self._compute_joint_gap(k, m, frame) for m in second] for k in first])
            rows, columns = scipy.optimize.linear_sum_assignment(found + shown)
            total = float((found + shown)[rows, columns].sum())
            if total > least[0] + NEAR:
                continue
            chosen = [(first[i], second[j]) for i, j in zip(rows, columns, strict=True)]
            rest = sum(self._compute_pose_code_length(k, m, frame) for k, m in chosen)
            if total < least[0] - NEAR or rest < least[1] - NEAR:
                best = found
                least = (total, rest)
            if rest <= NEAR and float(found[rows, columns].sum()) <= NEAR:
                break
        return best

    def _compute_pose_code_length(self, k: int, m: int, frame: Placement) -> float:
        """The length of what has to be told of a joint and its body in a pose of its carrier: between poses that are as near."""
        lengths = DescriptionLengths(self.plain.first, self.plain.second, {k: m}, self.plain.size)
        poses = MemberPoses(lengths)
        still = poses.compute_unmoved_pose(k, frame)
        if self.plain.first.members[k].kind != self.plain.second.members[m].kind:
            return 0.0
        tried = [still, *poses.list_other_poses(k, still)]
        frames = [
            lengths.compute_joint_code_length(k, frame, pose) + lengths.compute_content_code_length(k, pose)
            for pose in tried
        ]
        return min(frames)

    def _list_trial_frames(self, a: int, b: int, first: list[int], second: list[int]) -> Iterator[Placement]:
        one = self.plain.first
        two = self.plain.second
        size = self.plain.size
        yield Placement()
        trials = [(k, m) for k in first for m in second if one.members[k].kind == two.members[m].kind]
        if a < 0:
            for k, m in trials:
                yield from MemberPoses(DescriptionLengths(one, two, {k: m}, size)).list_base_motions([k])
            return
        yield from MemberPoses(DescriptionLengths(one, two, {a: b}, size)).list_poses_by_content(a)
        for k, m in trials:
            yield from MemberPoses(DescriptionLengths(one, two, {a: b, k: m}, size)).list_poses_by_content(a)

    def _compute_joint_gap(self, k: int, m: int, frame: Placement) -> float:
        """Distance of two joints' axes, and of masses along these, over the size of the machines; sine of their angle."""
        first = self.plain.first.members[k]
        second = self.plain.second.members[m]
        size = self.plain.size
        there = apply_placement(frame, second.placement)
        gap = there.position - first.placement.position
        if first.kind not in SCALARS:
            return min(compute_norm(gap) / size, FAR)
        along = first.placement.rotation @ first.axis
        other = there.rotation @ second.axis
        total = compute_norm(cross(along, other))
        if first.kind != "prismatic":
            # Two legs may turn about one line: how far along it their masses are, no zero and no frame changes.
            way = gap + there.rotation @ second.com - first.placement.rotation @ first.com
            total += compute_norm(cross(along, gap)) / size
            total += abs(float(along @ way)) / size if first.mass and second.mass else 0.0
        return min(total, FAR)


def compute_subtree_cost(costs: PairCosts, before: tuple[int, int], a: int, b: int) -> float:
    """Return the cost [-] of what two members and all that they carry show; before : the moving pair before, -1 the world."""
    invariant_cost = costs.compute_invariant_cost(before, a, b)
    if invariant_cost >= IMPOSSIBLE:
        return IMPOSSIBLE
    moving_children = costs.first.list_moving_children(a)
    second = costs.second.list_moving_children(b)
    lonely = abs(len(moving_children) - len(second))
    if not moving_children or not second:
        return invariant_cost + lonely
    table = np.array([[compute_subtree_cost(costs, (a, b), k, m) for m in second] for k in moving_children])
    rows, columns = scipy.optimize.linear_sum_assignment(table)
    return invariant_cost + lonely + float(np.minimum(table[rows, columns], 2.0).sum())
