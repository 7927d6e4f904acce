"""Fronts of a sparse matrix: the order in which `kernels.sparse_qr` eliminates its columns, found once from its pattern."""

from __future__ import annotations

from collections.abc import Sequence, Sized
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from flexinv.kernels.records import send_by_address
from flexinv.typing import Indices, Mask

SMALL = 6  # a front of no more columns takes its child in: one loop of a chain, and no more zeros than that


@send_by_address
class Fronts(NamedTuple):
    """Fronts of a sparse QR, each before the one that takes what it leaves.

    columns : of the matrix; first : (fronts + 1,) of each front's columns in ``column``
    pivots : (fronts,) how many of those it eliminates; column : (columns of fronts,) of the matrix
    place : (columns of fronts,) among those of the parent, -1 for own ones; begin : (fronts + 1,) first row of each front
    source : (rows of fronts,) row of the matrix, -1 where a child's row comes; start : (fronts + 1,) first value of each front
    parent : (fronts,) which takes what is left, or -1; base : (fronts,) first row there
    entry : (entries, 3) row and column of the matrix, and its value's place
    """

    columns: int
    first: Indices
    pivots: Indices
    column: Indices
    place: Indices
    begin: Indices
    source: Indices
    start: Indices
    parent: Indices
    base: Indices
    entry: Indices


def build_fronts(pattern: Mask, last: Mask | None = None) -> Fronts:
    """Return the fronts of a matrix [-] whose entries may stand where ``pattern`` (rows, columns) says.

    last : (columns,) that are eliminated after all others, and so are free where columns depend on each other
    """
    after = np.zeros(pattern.shape[1], dtype=bool) if last is None else last
    return _build_fronts(pattern.shape, pattern.tobytes(), after.tobytes())


@lru_cache(maxsize=256)
def _build_fronts(shape: tuple[int, int], entries: bytes, last: bytes) -> Fronts:
    """The fronts of a pattern: the same closures are asked for again and again."""
    pattern = np.frombuffer(entries, dtype=bool).reshape(shape)
    count = shape[1]
    order, further = find_least_degree_order(pattern, np.frombuffer(last, dtype=bool))
    turn = np.empty(count, dtype=np.int64)
    turn[order] = np.arange(count)
    groups = _join_fronts([[c] for c in order], [sorted(f, key=lambda c: turn[c]) for f in further])
    front = {column: f for f, (pivots, _) in enumerate(groups) for column in pivots}
    rows = _list_rows(pattern, front, len(groups))
    # the arrays: rows and values one front after the other
    parent = [front[others[0]] if others else -1 for _, others in groups]
    source, base = _list_sources(rows, groups, parent)
    local = [{column: k for k, column in enumerate(pivots + others)} for pivots, others in groups]
    place = [[-1] * len(pivots) + [local[parent[f]][c] for c in others] for f, (pivots, others) in enumerate(groups)]
    tall = _count_each(source)
    wide = _count_each(local)
    start = _compute_offsets(tall * wide)
    return Fronts(
        columns=count,
        first=_compute_offsets(wide),
        pivots=np.array([len(pivots) for pivots, _ in groups], dtype=np.int64),
        column=_join_parts([list(columns) for columns in local]),
        place=_join_parts(place),
        begin=_compute_offsets(tall),
        source=_join_parts(source),
        start=start,
        parent=np.array(parent, dtype=np.int64),
        base=np.array(base, dtype=np.int64),
        entry=_list_entries(pattern, rows, local, start, tall),
    )


def _list_rows(pattern: Mask, front: dict[int, int], fronts: int) -> list[list[int]]:
    """Rows of the matrix of each front: a row belongs to the first that eliminates one of its columns."""
    rows: list[list[int]] = [[] for _ in range(fronts)]
    for r, row in enumerate(pattern):
        where = np.flatnonzero(row).tolist()
        if where:
            rows[min(front[c] for c in where)].append(r)
    return rows


def _list_sources(
    rows: list[list[int]], groups: list[tuple[list[int], list[int]]], parent: list[int]
) -> tuple[list[list[int]], list[int]]:
    """All rows of each front, -1 where a child's comes, and the first that it fills in its parent."""
    source = [list(row) for row in rows]
    base = [0] * len(groups)
    for f, (_, others) in enumerate(groups):
        if others:
            above = source[parent[f]]
            base[f] = len(above)
            above += [-1] * min(len(source[f]), len(others))
    return source, base


def _list_entries(
    pattern: Mask, rows: list[list[int]], local: list[dict[int, int]], start: Indices, tall: Indices
) -> Indices:
    """Row and column of every entry of the matrix, and its value's place, column by column of its front."""
    entry = [
        (r, int(c), int(start[f] + local[f][int(c)] * tall[f] + k))
        for f, members in enumerate(rows)
        for k, r in enumerate(members)
        for c in np.flatnonzero(pattern[r])
    ]
    return np.array(entry, dtype=np.int64).reshape(-1, 3)


def find_least_degree_order(pattern: Mask, last: Mask | None = None) -> tuple[list[int], list[set[int]]]:
    """Return columns of a pattern (rows, columns) in an order of least degree [-], and with each what is coupled to it later.

    last : (columns,) that come after all others
    """
    count = pattern.shape[1]
    beside: list[set[int]] = [set() for _ in range(count)]
    for row in pattern:
        where = set(np.flatnonzero(row).tolist())
        for c in where:
            beside[c] |= where - {c}
    left = set(range(count))
    order = []
    further = []
    while left:
        c = min(left, key=lambda c: (last is not None and bool(last[c]), len(beside[c]), c))
        left.remove(c)
        order.append(c)
        further.append(beside[c])
        for other in beside[c]:
            beside[other] |= beside[c]
            beside[other] -= {c, other}
    return order, further


def _join_fronts(pivots: list[list[int]], further: list[list[int]]) -> list[tuple[list[int], list[int]]]:
    """Own and other columns of fronts: a child whose columns are its parent's, or few with them, is one front with it."""
    holder = {column: f for f, columns in enumerate(pivots) for column in columns}
    gone = set()
    for f in range(len(pivots)):
        if not further[f]:
            continue
        parent = holder[further[f][0]]
        wide = len(pivots[parent]) + len(further[parent])
        if len(further[f]) == wide or len(pivots[f]) + wide <= SMALL:
            pivots[parent] = pivots[f] + pivots[parent]
            for column in pivots[f]:
                holder[column] = parent
            gone.add(f)
    return [(pivots[f], further[f]) for f in range(len(pivots)) if f not in gone]


def _count_each(parts: Sequence[Sized]) -> Indices:
    return np.array([len(part) for part in parts], dtype=np.int64)


def _compute_offsets(counts: Indices) -> Indices:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def _join_parts(parts: list[list[int]]) -> Indices:
    return np.array([item for part in parts for item in part], dtype=np.int64)
