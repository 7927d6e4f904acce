"""Numbers in names count joints, they do not name them: where one machine has a joint more, the third of both is two joints.

An arm of six joints and one of seven with a joint more in its upper arm both have a ``joint_3``; the first one's is the other's
``joint_4``.  Both trees are laid over one another anew: each pair of members costs what `PairCosts.compute_step_cost` says of
it after the pair before, p, which zeros of coordinates do not change; a member that is left out of either costs one.
With  F  the least cost of what two members carry, over all assignments,

    C(p; a, b) = min( step(p; a, b) + F(a, b),  1 + C(p; next of a, b),  1 + C(p; a, next of b),  joints from a and from b on )

A member is left out between others only where it carries one.  What that gives stands against names only where they are off by
as much as a whole joint, where it costs less than half of what they do, and where it reads nothing but numbers otherwise.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy  # its parts are loaded when they are asked for

from crosscheck.equivalence.matching.costs import IMPOSSIBLE, PairCosts
from crosscheck.equivalence.tree import Tree

LEFT_OUT = 1.0  # cost of a joint that the other machine has not
LESS = 0.5  # of the cost of the names, below which structure is believed
Laid = tuple[float, tuple[tuple[int, int], ...]]


def find_renumbered_joints(costs: PairCosts, named: Mapping[str, str]) -> tuple[dict[str, str], float]:
    """Return the joints of the second by those of the first, where structure reads numbers otherwise than names, and the doubt.

    named : joints by name; the doubt is the cost over that of the names [-].  What agrees with the names is left out.
    """
    first = costs.first.moving
    second = costs.second.moving
    lonely = len(first) + len(second) - 2 * len(named)
    if not lonely or not any(_has_common_number(a, b) for a, b in named.items()):
        return {}, 1.0
    off = _compute_naming_cost(costs, {first[a]: second[b] for a, b in named.items()})
    if off < LEFT_OUT:
        return {}, 1.0
    least, pairs = Overlay(costs).find_best_forest((-1, -1), -1, -1)
    found = {costs.first.members[a].joint: costs.second.members[b].joint for a, b in pairs}
    more = LEFT_OUT * abs(len(first) - len(second))  # left out in any case
    doubt = (least - more) / (off + LEFT_OUT * lonely - more)
    broken = {a for a, b in named.items() if found.get(a) != b}
    if doubt >= LESS or len(found) < len(named) or not all(_has_common_number(a, named[a]) for a in broken):
        return {}, 1.0
    renamed = _list_renamed_joints(found, named, broken)
    return {a: found[a] for a in first if a in renamed}, doubt


def _list_renamed_joints(found: Mapping[str, str], named: Mapping[str, str], broken: set[str]) -> set[str]:
    """Joints of the first whose names are not believed, and those whose counterparts had been given to such."""
    taken = {named[a] for a in broken}
    return {a for a, b in found.items() if a in broken or b in taken}


def _compute_naming_cost(costs: PairCosts, named: Mapping[int, int]) -> float:
    """Cost of pairs of members by name [-], those that are left out aside."""
    total = 0.0
    for a, b in named.items():
        before = _find_ancestor(costs.first, a, set(named)), _find_ancestor(costs.second, b, set(named.values()))
        alike = named.get(before[0], -1) == before[1]
        total += costs.compute_step_cost(before, a, b) if alike else LEFT_OUT
    return total


def _find_ancestor(tree: Tree, index: int, among: set[int]) -> int:
    """The nearest member before one that is among some, -1 the world."""
    index = tree.members[index].parent
    while index >= 0 and index not in among:
        index = tree.members[index].parent
    return index


def _has_common_number(one: str, other: str) -> bool:
    """Return True if a name of both has a number in it, so that another number would be another joint of the same name."""
    return bool(re.search(r"\d", one) and re.search(r"\d", other))


@dataclass
class Overlay:
    """Two trees laid over one another: the least cost and the pairs of two members with all they carry, kept once found."""

    costs: PairCosts
    known: dict[tuple[int, int, int, int], Laid] = field(default_factory=dict)

    def find_best_overlay(self, before: tuple[int, int], a: int, b: int) -> Laid:
        """Return the least cost [-] and the pairs of what two members are and carry; before : the pair that carries them."""
        key = (*before, a, b)
        if key not in self.known:
            self.known[key] = min(self._list_overlays(before, a, b), key=lambda choice: choice[0])
        return self.known[key]

    def _list_overlays(self, before: tuple[int, int], a: int, b: int) -> Iterator[Laid]:
        yield LEFT_OUT * (self.costs.first.count_moving(a) + self.costs.second.count_moving(b)), ()
        step_cost = self.costs.compute_step_cost(before, a, b)
        if step_cost < IMPOSSIBLE:
            beyond, pairs = self.find_best_forest((a, b), a, b)
            yield step_cost + beyond, ((a, b), *pairs)
        moving_children = self.costs.first.list_moving_children(a)
        second = self.costs.second.list_moving_children(b)
        for one, two in [
            *([(moving_children[0], b)] if len(moving_children) == 1 else []),
            *([(a, second[0])] if len(second) == 1 else []),
        ]:
            cost, pairs = self.find_best_overlay(before, one, two)
            yield LEFT_OUT + cost, pairs

    def find_best_forest(self, before: tuple[int, int], a: int, b: int) -> Laid:
        """Return the least cost [-] and the pairs of all that two members carry, -1 the world; before : the last pair."""
        moving_children = self.costs.first.list_moving_children(a)
        second = self.costs.second.list_moving_children(b)
        n = len(moving_children)
        m = len(second)
        if not n or not m:
            return LEFT_OUT * (
                sum(map(self.costs.first.count_moving, moving_children))
                + sum(map(self.costs.second.count_moving, second))
            ), ()
        table = np.zeros((n + m, n + m))
        table[:n, m:] = np.array([self.costs.first.count_moving(k) for k in moving_children]).reshape(n, 1)
        table[n:, :m] = np.array([self.costs.second.count_moving(k) for k in second])
        for i, one in enumerate(moving_children):
            for j, two in enumerate(second):
                table[i, j] = self.find_best_overlay(before, one, two)[0]
        rows, columns = scipy.optimize.linear_sum_assignment(table)
        chosen = [(moving_children[i], second[j]) for i, j in zip(rows, columns, strict=True) if i < n and j < m]
        pairs = tuple(pair for one, two in chosen for pair in self.find_best_overlay(before, one, two)[1])
        return float(table[rows, columns].sum()), pairs
