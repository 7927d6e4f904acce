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
from flexinv.rnea.loop_layout import MOST_TOGETHER, Operation
from flexinv.typing import Array

# A pivot of the sample, whose joints stand anywhere, is above this part of the largest entry; without one there is no order.
PIVOT = 1e-6
# Passive coordinates from which on rows of drives stay as they are, where that is possible: what is undone costs a pass as well.
MANY = 3


@dataclass(frozen=True)
class Step:
    """One step of a plan.

    operation : what it does; side_by_side : entries before the pivot's that TOGETHER and BOTH combine in one pass [-]
    first, second, third : where numbers stand in the work space [-]; pairs : of such places
    """

    operation: Operation
    first: int
    second: int
    third: int
    pairs: tuple[tuple[int, int], ...] = ()
    side_by_side: int = 0

    @property
    def words(self) -> tuple[int, ...]:
        """Return the step as kernels read it [-]."""
        kind = self.operation + max(self.side_by_side - 1, 0)
        return kind, len(self.pairs), self.first, self.second, self.third, *(at for pair in self.pairs for at in pair)


@dataclass
class Elimination:
    """Rows as they are combined.

    rows : for each row, velocity coordinate -> where its entry stands in the work space [-]; numbers : (rows, nv) of a sample
    places : (rows, nv) where entries stand, those among them that are zero; 0 where there are none
    sizes : for each coordinate, where the squares of its column stand; take : finds room for so many rows more
    scratch : where a block works; steps : so far; fills : entries that are zero at first
    combined : pairs of rows and where their factors are kept, if they are; constant : sizes that are
    """

    rows: list[dict[int, int]]
    numbers: Array
    places: NDArray[np.int64]
    sizes: dict[int, list[int]]
    take: Callable[[int], int]
    scratch: int
    steps: list[Step] = field(default_factory=list)
    fills: list[int] = field(default_factory=list)
    combined: list[tuple[int, int, int]] | None = None
    constant: frozenset[int] = frozenset()

    def step(
        self,
        operation: Operation,
        first: int = 0,
        second: int = 0,
        pairs: Sequence[tuple[int, int]] = (),
        third: int | None = None,
        side_by_side: int = 0,
    ) -> None:
        """Write one step [-]."""
        where = self.scratch if third is None else third
        self.steps.append(Step(operation, first, second, where, tuple(pairs), side_by_side))

    def eliminate(self, column: int, among: list[int]) -> int | None:
        """Combine the rows ``among`` that have an entry in a column, until one of them has; return it [-], None without one.

        It is held against all sizes of the column but the first one, which is left to who solves for it.
        """
        candidates = sorted((r for r in among if column in self.rows[r]), key=lambda r: len(self.rows[r]))
        if not candidates or not np.abs(self.numbers[candidates, column]).max() > PIVOT * np.abs(self.numbers).max():
            return None
        pivot = candidates[0]
        for other in candidates[1:]:
            self._pair(pivot, other, column)
        for size in self.sizes[column][1:]:
            self.step(Operation.CHECK_PIVOT, self.rows[pivot][column], size)
        return pivot

    def _pair(self, pivot: int, other: int, column: int) -> None:
        one, two, n = self.rows[pivot], self.rows[other], self.numbers
        for row, missing, there in ((pivot, one, two), (other, two, one)):
            for c in there.keys() - missing.keys():
                missing[c] = int(self.places[row, c]) or self.empty()
        kept = self.scratch
        if self.combined is not None:
            kept = self.take(2)
            self.combined.append((pivot, other, kept))
        pairs = [(one[c], two[c]) for c in sorted(one, key=lambda c: one[c]) if c != column]
        if _side_by_side(pairs, (one[column], two[column])):
            self._together(len(pairs), *pairs[0], kept)
        else:
            self.step(Operation.PAIR, one[column], two[column], pairs, kept)
        del two[column]
        if abs(n[other, column]) > abs(n[pivot, column]):
            n[[pivot, other]] = n[[other, pivot]]
        if n[pivot, column] != 0.0:
            n[other] -= n[other, column] / n[pivot, column] * n[pivot]
        n[other, column] = 0.0

    def _together(self, count: int, one: int, other: int, kept: int) -> None:
        """Write the step of two rows, or of three, where the one before had the same pivot and how is not kept."""
        before = self.steps[-1] if self.steps and self.combined is None else None
        if before and (before.operation, before.first, before.side_by_side) == (Operation.TOGETHER, one, count):
            self.steps[-1] = Step(Operation.BOTH, one, before.second, other, side_by_side=count)
        else:
            self.step(Operation.TOGETHER, one, other, third=kept, side_by_side=count)

    def empty(self) -> int:
        """Return room for an entry that is zero at first [-]."""
        self.fills.append(self.take(1))
        return self.fills[-1]

    def undo(self, multiplier: dict[int, int]) -> None:
        """Write the steps [-] from multipliers of combined rows to those of rows as they were."""
        assert self.combined is not None
        for pivot, other, kept in reversed(self.combined):
            self.step(Operation.UNDO, multiplier[pivot], multiplier[other], third=kept)


def _side_by_side(pairs: list[tuple[int, int]], last: tuple[int, int]) -> bool:
    """Return True if the entries of two rows are contiguous in memory, those of the pivot's column last."""
    if not 1 <= len(pairs) <= MOST_TOGETHER:
        return False
    return all(pair[k] == last[k] - (len(pairs) - i) * BLOCK for i, pair in enumerate(pairs) for k in (0, 1))


def sharing(
    elimination: Elimination, effort: Sequence[int], passive: list[int], drives: list[int], beyond: int, weights: int
) -> bool:
    """Write the steps [-] that share efforts out; return whether there are any that do.

    effort : (nv,) where efforts stand; beyond : how many rows drives have against each other; weights : where theirs stand
    """
    left, whole = [r for r, row in enumerate(elimination.rows) if row], [dict(row) for row in elimination.rows]
    apart = len(left) == len(passive) >= MANY and not beyond
    if apart and _are_six(elimination, left, passive, effort):
        at = elimination.take(6)
        elimination.step(
            Operation.ALL_SIX,
            whole[left[0]][passive[0]],
            effort[passive[0]],
            [(elimination.sizes[c][0], 0) for c in passive],
            at,
        )
        for i, r in enumerate(left):
            elimination.step(Operation.TAKE, pairs=_driven(whole[r], effort, drives), third=at + i * BLOCK)
        return True
    if apart:
        elimination.rows = [{c: at for c, at in row.items() if c in passive} for row in elimination.rows]
        elimination.combined = []
    solved = _triangle(elimination, left, passive)
    if solved is None:
        return False
    against: list[int] = []
    for _ in range(beyond):
        column = max(drives, key=lambda c: float(np.abs(elimination.numbers[left, c]).max(initial=0.0)))
        pivot = elimination.eliminate(column, left)
        if pivot is None:
            return False
        left.remove(pivot)
        against.append(pivot)
        elimination.step(Operation.CHECK_PIVOT, elimination.rows[pivot][column], elimination.sizes[column][0])
    for r in left:
        for c in elimination.rows[r]:
            for size in elimination.sizes[c]:
                elimination.step(Operation.CHECK_EMPTY, elimination.rows[r][c], size)
    multiplier = {pivot: elimination.take(1) if apart else elimination.scratch for _, pivot in solved}
    for column, pivot in solved:
        others = [(at, effort[c]) for c, at in sorted(elimination.rows[pivot].items()) if c != column]
        size = elimination.sizes[column][0]
        entry, pairs = elimination.rows[pivot][column], [(size, size), *others]
        elimination.step(Operation.SOLVE, entry, effort[column], pairs, multiplier[pivot])
    if apart:
        elimination.undo(multiplier)
        for r, at in multiplier.items():
            elimination.step(Operation.TAKE, pairs=_driven(whole[r], effort, drives), third=at)
    _project(elimination, effort, against, drives, weights)
    return True


def _driven(row: dict[int, int], effort: Sequence[int], drives: list[int]) -> list[tuple[int, int]]:
    """The entries of drives in a row, and their efforts."""
    return [(row[c], effort[c]) for c in sorted(row) if c in drives]


def _are_six(elimination: Elimination, left: list[int], passive: list[int], effort: Sequence[int]) -> bool:
    """Return True if six rows and efforts of six passive coordinates are contiguous, constant in size, not singular."""
    if len(left) != 6 or any(
        len(elimination.sizes[c]) != 1 or elimination.sizes[c][0] not in elimination.constant for c in passive
    ):
        return False
    first = elimination.rows[left[0]].get(passive[0], 0)
    entries = [[elimination.rows[r].get(c, 0) - first for c in passive] for r in left]
    efforts = [effort[c] - effort[passive[0]] for c in passive]
    values = np.linalg.svd(elimination.numbers[np.ix_(left, passive)], compute_uv=False)
    side_by_side = entries == (BLOCK * np.arange(36).reshape(6, 6)).tolist() and efforts == [
        BLOCK * i for i in range(6)
    ]
    return side_by_side and bool(values[-1] > PIVOT * values[0])


def _triangle(elimination: Elimination, left: list[int], passive: list[int]) -> list[tuple[int, int]] | None:
    """Combine rows until passive coordinates have one each, which leave ``left``; coordinates and rows in order."""
    order, solved = sorted(passive, reverse=True), list[tuple[int, int]]()
    while order:
        column = min(order, key=lambda c: _cost(elimination, left, c))
        pivot = elimination.eliminate(column, left)
        if pivot is None:
            return None
        order.remove(column)
        left.remove(pivot)
        solved.append((column, pivot))
    return solved


def order_of(numbers: Array, passive: list[int]) -> list[int]:
    """Return passive coordinates [-] in the order in which they go from rows (rows, nv) of a sample; none without an order."""
    places = np.ones(numbers.shape, dtype=np.int64)
    patterns = [{int(c): 0 for c in np.flatnonzero(row)} for row in numbers]
    e = Elimination(patterns, numbers.copy(), places, {c: [] for c in passive}, lambda count: 0, 0)
    return [column for column, _ in _triangle(e, list(range(len(numbers))), passive) or []]


def _cost(elimination: Elimination, left: list[int], column: int) -> tuple[int, int]:
    """Rows that have an entry in a column, and their entries."""
    own = [elimination.rows[r] for r in left if column in elimination.rows[r]]
    return len(own), sum(len(row) for row in own)


def _project(
    elimination: Elimination, effort: Sequence[int], against: list[int], drives: list[int], weights: int
) -> None:
    """Take from the efforts, row by row, what drives do against each other; Gram's and Schmidt's modified order."""
    for i, r in enumerate(against):
        for s in against[i:]:
            for c in drives:
                if c not in elimination.rows[s]:
                    elimination.rows[s][c] = elimination.empty()
        own = [elimination.rows[r][c] for c in drives]
        elimination.step(Operation.NORM, 0, weights, [(at, at) for at in own])
        for target in (
            [effort[c] for c in drives],
            *([elimination.rows[s][c] for c in drives] for s in against[i + 1 :]),
        ):
            pairs = list(zip(own, target, strict=True))
            elimination.step(Operation.INNER, 0, weights, pairs)
            elimination.step(Operation.PROJECT, 0, 0, pairs)
