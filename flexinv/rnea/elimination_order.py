"""The order in which rows of G are combined, found once for a mechanism: see `loop_allocation`.

Passive coordinates go one after the other, first those in fewest rows; the pattern of what may be other than zero is carried
along, with the numbers of one sample beside it, which say where a pivot can be.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from flexinv.kernels.simd import BLOCK
from flexinv.rnea.loop_layout import SIX, SIX_ROWS, Operation
from flexinv.typing import Array

# A pivot of the sample, whose joints stand anywhere, is above this part of the largest entry; without one there is no order.
PIVOT = 1e-6


@dataclass(frozen=True)
class Step:
    """One step of a plan: what it does; where numbers stand in the work space [-], and pairs of such places."""

    operation: Operation
    first: int
    second: int
    third: int
    pairs: tuple[tuple[int, int], ...] = ()

    @property
    def words(self) -> tuple[int, ...]:
        """Return the step as kernels read it [-]."""
        places = self.first, self.second, self.third, *(at for pair in self.pairs for at in pair)
        return self.operation, len(self.pairs), *places


@dataclass
class Elimination:
    """Rows as they are combined.

    rows : for each row, velocity coordinate -> where its entry stands in the work space [-]; numbers : (rows, nv) of a sample
    places : (rows, nv) where entries stand, those among them that are zero; 0 where there are none
    sizes : for each coordinate, where the squares of its column stand; constant : those of them that are
    take : finds room for so many rows more; steps : so far; fills : entries that are zero at first
    """

    rows: list[dict[int, int]]
    numbers: Array
    places: NDArray[np.int64]
    sizes: dict[int, list[int]]
    take: Callable[[int], int]
    constant: frozenset[int] = frozenset()
    steps: list[Step] = field(default_factory=list)
    fills: list[int] = field(default_factory=list)

    def step(
        self,
        operation: Operation,
        first: int = 0,
        second: int = 0,
        third: int = 0,
        pairs: Sequence[tuple[int, int]] = (),
    ) -> None:
        """Write one step [-]."""
        self.steps.append(Step(operation, first, second, third, tuple(pairs)))

    def eliminate(self, column: int, among: list[int]) -> int | None:
        """Combine the rows ``among`` that have an entry in a column, until one of them has; return it [-], None without one.

        It is held against all sizes of the column but the first one, which is left to who solves for it.
        """
        candidates = sorted((r for r in among if column in self.rows[r]), key=lambda r: len(self.rows[r]))
        if not candidates or not np.abs(self.numbers[candidates, column]).max() > PIVOT * np.abs(self.numbers).max():
            return None
        pivot, one, n = candidates[0], self.rows[candidates[0]], self.numbers
        for other in candidates[1:]:
            two = self.rows[other]
            for row, missing, there in ((pivot, one, two), (other, two, one)):
                for c in there.keys() - missing.keys():
                    missing[c] = int(self.places[row, c]) or self.empty()
            pairs = [(one[c], two[c]) for c in sorted(one, key=lambda c: one[c]) if c != column]
            self.step(Operation.PAIR, one[column], two.pop(column), pairs=pairs)
            if abs(n[other, column]) > abs(n[pivot, column]):
                n[[pivot, other]] = n[[other, pivot]]
            if n[pivot, column] != 0.0:
                n[other] -= n[other, column] / n[pivot, column] * n[pivot]
            n[other, column] = 0.0
        for size in self.sizes[column][1:]:
            self.step(Operation.CHECK_PIVOT, one[column], size)
        return pivot

    def empty(self) -> int:
        """Return room for an entry that is zero at first [-]."""
        self.fills.append(self.take(1))
        return self.fills[-1]


def sharing(
    elimination: Elimination, effort: Sequence[int], passive: list[int], drives: list[int], beyond: int, weights: int
) -> bool:
    """Write the steps [-] that share efforts out; return whether there are any that do.

    effort : (nv,) where efforts stand; beyond : how many rows drives have against each other; weights : where theirs stand
    """
    e, left = elimination, [r for r, row in enumerate(elimination.rows) if row]
    if not beyond and _are_six(e, left, passive, effort):
        at = e.take(SIX_ROWS)
        sizes = [(e.sizes[c][0], 0) for c in passive]
        e.step(Operation.ALL_SIX, e.rows[left[0]][passive[0]], effort[passive[0]], at, sizes)
        for i, r in enumerate(left):
            driven = [(entry, effort[c]) for c, entry in sorted(e.rows[r].items()) if c in drives]
            e.step(Operation.TAKE, third=at + i * BLOCK, pairs=driven)
        return True
    order, solved, against = sorted(passive, reverse=True), list[tuple[int, int]](), list[int]()
    while order:
        column = min(order, key=lambda c: _cost(e, left, c))
        pivot = e.eliminate(column, left)
        if pivot is None:
            return False
        order.remove(column)
        left.remove(pivot)
        solved.append((column, pivot))
    for _ in range(beyond):
        column = max(drives, key=lambda c: float(np.abs(e.numbers[left, c]).max(initial=0.0)))
        pivot = e.eliminate(column, left)
        if pivot is None:
            return False
        left.remove(pivot)
        against.append(pivot)
        e.step(Operation.CHECK_PIVOT, e.rows[pivot][column], e.sizes[column][0])
    for r in left:
        for c, entry in e.rows[r].items():
            for size in e.sizes[c]:
                e.step(Operation.CHECK_EMPTY, entry, size)
    for column, pivot in solved:
        others = [(entry, effort[c]) for c, entry in sorted(e.rows[pivot].items()) if c != column]
        e.step(Operation.SOLVE, e.rows[pivot][column], effort[column], e.sizes[column][0], others)
    _project(e, effort, against, drives, weights)
    return True


def _are_six(elimination: Elimination, left: list[int], passive: list[int], effort: Sequence[int]) -> bool:
    """Return True if six rows and efforts of six passive coordinates are contiguous, constant in size, not singular."""
    sizes = [elimination.sizes[c] for c in passive]
    if not len(left) == len(passive) == SIX or any(len(s) != 1 or s[0] not in elimination.constant for s in sizes):
        return False
    first = elimination.rows[left[0]].get(passive[0], 0)
    entries = [elimination.rows[r].get(c, 0) - first for r in left for c in passive]
    efforts = [effort[c] - effort[passive[0]] for c in passive]
    values = np.linalg.svd(elimination.numbers[np.ix_(left, passive)], compute_uv=False)
    contiguous = (BLOCK * np.arange(SIX * SIX)).tolist()
    return entries == contiguous and efforts == contiguous[:SIX] and bool(values[-1] > PIVOT * values[0])


def _cost(elimination: Elimination, left: list[int], column: int) -> tuple[int, int]:
    """Rows that have an entry in a column, and their entries."""
    own = [elimination.rows[r] for r in left if column in elimination.rows[r]]
    return len(own), sum(len(row) for row in own)


def _project(
    elimination: Elimination, effort: Sequence[int], against: list[int], drives: list[int], weights: int
) -> None:
    """Take from the efforts, row by row, what drives do against each other; Gram's and Schmidt's modified order."""
    e, rows = elimination, [elimination.rows[r] for r in against]
    for row in rows:
        row.update({c: e.empty() for c in drives if c not in row})
    targets = [[row[c] for c in drives] for row in rows]
    for i, own in enumerate(targets):
        e.step(Operation.NORM, second=weights, pairs=[(at, at) for at in own])
        for target in ([effort[c] for c in drives], *targets[i + 1 :]):
            pairs = list(zip(own, target, strict=True))
            e.step(Operation.INNER, second=weights, pairs=pairs)
            e.step(Operation.PROJECT, pairs=pairs)
