"""Matching of joints: by name, by name without a prefix, else by structure; what stays ambiguous is asked for.

Where one machine has a joint more, numbers in names may count otherwise: `numbers` says where structure is believed instead.

Structure: children of matched members are assigned so that the sum of costs over whole subtrees is least (Kuhn and Munkres).  The
cost of a pair is what they show wherever zeros and frames stand (`PairCosts.compute_invariant_cost`), and how far their axes
lie apart on carriers
that are laid on one another (`overlay`).  An assignment whose exchange of two costs about as little is a guess, and none is made.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations, takewhile

import scipy  # its parts are loaded when they are asked for

from crosscheck.equivalence.matching.costs import IMPOSSIBLE, PairCosts
from crosscheck.equivalence.matching.numbers import find_renumbered_joints
from crosscheck.equivalence.matching.overlaid_trees import OverlaidTrees
from crosscheck.equivalence.tree import SCALARS, Tree
from flexinv.errors import InputError
from flexinv.model.mechanism import Array

# Cost of the best assignment over that with two children exchanged, from which on it is a guess.
GUESS = 0.5
ALMOST = 1e-6  # costs below that are equal: rounding of printed numbers


@dataclass(frozen=True)
class Match:
    """Pairs of joints of two trees, by joint of the first.

    how : by joint "name", "prefix", "stated", "structure", or "numbers": by structure, against the numbers in names
    certainty : by joint, 1 less the cost over that of the next best [-]
    """

    pairs: Mapping[str, str]
    how: Mapping[str, str] = field(default_factory=dict)
    certainty: Mapping[str, float] = field(default_factory=dict)

    @property
    def words(self) -> str:
        """Return the ways in which joints were matched, in a sentence."""
        ways = {
            "name": "by name",
            "prefix": "by name without prefix",
            "stated": "as stated",
            "structure": "by structure",
            "numbers": "by structure, against the numbers in their names",
        }
        counted = {way: [j for j, how in self.how.items() if how == way] for way in ways}
        parts = [f"{len(joints)} {ways[way]}" for way, joints in counted.items() if joints]
        unsure = [self.certainty[j] for j in (*counted["structure"], *counted["numbers"])]
        return (", ".join(parts) or "none") + (f" (certainty {min(unsure):.2f})" if unsure else "")


def match(first: Tree, second: Tree, stated: Mapping[str, str]) -> Match:
    """Return the joint of the second tree that each of the first is.

    stated : pairs by joint of the first, which hold whatever the structure says
    Raises InputError for names that do not exist, and where two joints could be exchanged.
    """
    _check(first, second, stated)
    named = match_by_name(first.moving, second.moving, stated)
    names = {a: (b, way) for a, (b, way) in named.items() if _can_match_coordinates(first, second, a, b)}
    pairs = {a: b for a, (b, _) in names.items()}
    how = {a: way for a, (_, way) in names.items()}
    certainty = dict.fromkeys(pairs, 1.0)
    other, doubt = find_renumbered_joints(PairCosts(first, second), pairs) if not stated else ({}, 1.0)
    if other:
        kept = {a: b for a, b in pairs.items() if a not in other and b not in other.values()}
        pairs = kept | other
        how = {a: how[a] for a in kept} | dict.fromkeys(other, "numbers")
        certainty = dict.fromkeys(kept, 1.0) | dict.fromkeys(other, 1.0 - doubt)
    Assignment(first, second, pairs, how, certainty).match_children(-1, -1)
    return Match(pairs, how, certainty)


def _check(first: Tree, second: Tree, stated: Mapping[str, str]) -> None:
    for side, tree, names in (("A", first, stated.keys()), ("B", second, stated.values())):
        for name in names:
            if name not in tree.moving:
                raise InputError(
                    f"--match: {side} has no moving joint {name!r}; it has {', '.join(list(tree.moving)[:30])}"
                )
    for a, b in stated.items():
        if not _can_match_coordinates(first, second, a, b):
            kinds = first.members[first.moving[a]].kind, second.members[second.moving[b]].kind
            raise InputError(
                f"--match {a}={b}: a {kinds[0]} joint and a {kinds[1]} one: no coordinate of one is the other's"
            )
    if len(set(stated.values())) < len(stated):
        raise InputError("--match: a joint of B is named twice; write each once")


def _can_match_coordinates(first: Tree, second: Tree, a: str, b: str) -> bool:
    """Return True if two joints have coordinates that can be those of one another: of one kind, or one number each."""
    kinds = first.members[first.moving[a]].kind, second.members[second.moving[b]].kind
    return kinds[0] == kinds[1] or all(kind in SCALARS for kind in kinds)


def match_by_name(first: Iterable[str], second: Iterable[str], stated: Mapping[str, str]) -> dict[str, tuple[str, str]]:
    """Return by name of the first the one of the second [-], and how: "stated", "name", "prefix"."""
    name = {a: (b, "stated") for a, b in stated.items()}
    rest_a = [a for a in first if a not in stated]
    rest_b = [b for b in second if b not in stated.values()]
    name |= {a: (a, "name") for a in rest_a if a in rest_b}
    left_a = [a for a in rest_a if a not in name]
    left_b = [b for b in rest_b if b not in name]
    plain_a = _drop_common_affixes(left_a, rest_a)
    plain_b = _drop_common_affixes(left_b, rest_b)
    for a in left_a:
        same = [b for b in left_b if plain_b[b] == plain_a[a]]
        if len(same) == 1 and sum(plain_a[x] == plain_a[a] for x in left_a) == 1:
            name[a] = (same[0], "prefix")
    return name


def _drop_common_affixes(names: list[str], whole: list[str]) -> dict[str, str]:
    """Names without the prefix that all joints of a machine share, and without what readers and writers differ in."""
    letters = zip(*whole, strict=False) if len(whole) > 1 else ()
    shared = takewhile(lambda column: len(set(column)) == 1, letters)
    prefix = "".join(column[0] for column in shared)
    prefix = prefix.rstrip("0123456789")
    return {name: re.sub(r"[^a-z0-9]|joint", "", name.removeprefix(prefix).lower()) for name in names}


@dataclass(frozen=True)
class Assignment:
    """A matching that grows from the roots: members of one tree to those of the other; fixed ones are looked through."""

    first: Tree
    second: Tree
    pairs: dict[str, str]
    how: dict[str, str]
    certainty: dict[str, float]

    def match_children(self, a: int, b: int) -> None:
        """Assign what two matched members carry to one another, and go on beyond."""
        moving_children = self.first.list_moving_children(a)
        second = self.second.list_moving_children(b)
        for k in moving_children:
            joint = self.first.members[k].joint
            if joint in self.pairs:
                self.match_children(k, self.second.moving[self.pairs[joint]])
        free = [k for k in moving_children if self.first.members[k].joint not in self.pairs]
        taken = set(self.pairs.values())
        open_ = [k for k in second if self.second.members[k].joint not in taken]
        if free and open_:
            for k, other in self._solve_assignment((a, b), free, open_):
                self.match_children(k, other)

    @cached_property
    def overlay(self) -> OverlaidTrees:
        """Return both trees, whose carriers can be laid on one another."""
        return OverlaidTrees.build_for(self.first, self.second)

    def _solve_assignment(self, before: tuple[int, int], first: list[int], second: list[int]) -> list[tuple[int, int]]:
        above = _find_moving_member(self.first, before[0]), _find_moving_member(self.second, before[1])
        costs = self.overlay.compute_costs(above, first, second)
        rows, columns = scipy.optimize.linear_sum_assignment(costs)
        assignment = []
        for row, column in zip(rows, columns, strict=True):
            if costs[row, column] >= IMPOSSIBLE:
                continue
            a = self.first.members[first[row]].joint
            b = self.second.members[second[column]].joint
            self.pairs[a] = b
            self.how[a] = "structure"
            self.certainty[a] = 1.0
            assignment.append((first[row], second[column]))
        self._check_exchanges(costs, list(zip(rows, columns, strict=True)), first, second)
        return assignment

    def _check_exchanges(
        self, costs: Array, chosen: list[tuple[int, int]], first: list[int], second: list[int]
    ) -> None:
        """Refuse where two pairs could be exchanged at about the same cost."""
        for (r1, c1), (r2, c2) in combinations(chosen, 2):
            now = costs[r1, c1] + costs[r2, c2]
            other = costs[r1, c2] + costs[r2, c1]
            doubt = (now + ALMOST) / (other + ALMOST)
            names = [self.first.members[first[r]].joint for r in (r1, r2)]
            if other < IMPOSSIBLE and doubt > GUESS:
                both = [self.second.members[second[c]].joint for c in (c1, c2)]
                raise InputError(
                    f"joints {names[0]!r} and {names[1]!r} could each be {both[0]!r} or {both[1]!r}: names and structure leave "
                    f"it open; write --match {names[0]}={both[0]} (or {names[0]}={both[1]})"
                )
            for name in names:
                self.certainty[name] = min(self.certainty[name], 1.0 - doubt)


def _find_moving_member(tree: Tree, index: int) -> int:
    """The member itself, or the one before it that moves, -1 the world."""
    while index >= 0 and tree.members[index].kind == "fixed":
        index = tree.members[index].parent
    return index
