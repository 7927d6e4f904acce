"""Sparse QR of kernels against LAPACK: fronts, least squares, least norms, ranks, conditions."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from flexinv.kernels import sparse_qr
from flexinv.kernels.fronts import Fronts, build_fronts
from flexinv.kernels.jit import jit
from flexinv.kernels.sparse_qr import (
    FrontFactors,
    compute_condition_estimate,
    factorise_qr,
    fill_zeros,
    solve_upper,
    turn_beside,
    write_entry,
)
from flexinv.typing import Array

# Rounding of a few hundred operations.
LEVEL = 300 * np.finfo(float).eps


@jit
def factored(fronts, qr, a):
    """Rank of a (lanes, rows, columns)."""
    fill_zeros(qr)
    for e in range(fronts.entry.shape[0]):
        for k in range(a.shape[0]):
            write_entry(fronts, qr, e, k, a[k, fronts.entry[e, 0], fronts.entry[e, 1]])
    return factorise_qr(fronts, qr)


@jit
def least_squares(fronts, qr, y, x):
    """R^-1 Q^T y."""
    sparse_qr.solve_least_squares(fronts, qr, y, x)


@jit
def least_norm(fronts, qr, x, y):
    """Q R^-T x."""
    sparse_qr.solve_least_norm(fronts, qr, x, y)


@jit
def beside(fronts, qr, out):
    """Vectors that no column reaches."""
    for n in range(out.shape[0]):
        turn_beside(fronts, qr, n, out[n])


@jit
def moved(fronts, qr, x):
    """-R^-1 R_free x of free columns x."""
    solve_upper(fronts, qr, x)


@jit
def condition(fronts, qr, x, sign):
    """Estimate of the condition number."""
    return compute_condition_estimate(fronts, qr, x, sign)


def chain(loops: int, lanes: int, seed: int = 0) -> Array:
    """A chain of loops: every closure has five rows of two unknowns and one of the next, and two of its rows repeat others."""
    rng = np.random.default_rng(seed)
    matrix = np.zeros((lanes, 5 * loops, 2 * loops))
    for loop in range(loops):
        own = matrix[:, 5 * loop : 5 * loop + 5, 2 * loop : 2 * loop + 3]
        own[:, :3] = rng.normal(size=own[:, :3].shape)
        own[:, 3:] = own[:, :2]
    return matrix


def fan(loops: int, lanes: int, seed: int = 0) -> Array:
    """Loops that hang on one another, each closed with the ground: rows of a loop have entries of all before it, and one more."""
    rng = np.random.default_rng(seed)
    matrix = np.zeros((lanes, 5 * loops, 2 * loops))
    for loop in range(loops):
        own = matrix[:, 5 * loop : 5 * loop + 5]
        own[:, :3, : 2 * loop : 2] = rng.normal(size=(lanes, 3, loop))
        own[:, :3, 2 * loop : 2 * loop + 2] = rng.normal(size=(lanes, 3, 2))
        own[:, 3:] = own[:, :2]
    return matrix


def full(rows: int, columns: int, lanes: int) -> Array:
    return np.random.default_rng(rows).normal(size=(lanes, rows, columns))


MATRICES = {
    "one loop": (chain, 1),
    "chain": (chain, 12),
    "fan": (fan, 6),
    "square": (full, 12, 12),
    "tall": (full, 9, 3),
    "one column": (full, 4, 1),
}


def of(matrix: Array, last: NDArray[np.bool_] | None = None) -> tuple[Fronts, FrontFactors]:
    fronts = build_fronts(matrix.any(axis=0), last)
    return fronts, FrontFactors.build_for(fronts, len(matrix))


@pytest.mark.parametrize("lanes", [1, 16])
@pytest.mark.parametrize("name", MATRICES)
def test_solves_as_lapack_does(name: str, lanes: int) -> None:
    make, *sizes = MATRICES[name]
    a = make(*sizes, lanes)
    fronts, qr = of(a)
    _, rows, columns = a.shape
    assert factored(fronts, qr, a) == columns
    rng = np.random.default_rng(1)
    y, x = rng.normal(size=(rows, lanes)), np.full((columns, lanes), np.nan)
    least_squares(fronts, qr, y, x)
    given, result = rng.normal(size=(columns, lanes)), np.zeros((rows, lanes))
    least_norm(fronts, qr, given.copy(), result)
    for k in range(lanes):
        expected, level = np.linalg.lstsq(a[k], y[:, k], rcond=None)[0], np.linalg.cond(a[k]) * LEVEL
        assert np.abs(x[:, k] - expected).max() < np.linalg.cond(a[k]) * level * np.abs(expected).max()
        expected = np.linalg.lstsq(a[k].T, given[:, k], rcond=None)[0]
        assert np.abs(result[:, k] - expected).max() < level * np.abs(expected).max()


@pytest.mark.parametrize("last", [[0, 1], [3, 8], [22, 23]])
def test_free_columns_are_the_last_ones_that_can_be(last: list[int]) -> None:
    """A chain of which two closures are open: two unknowns are free, and the others follow from them."""
    a = chain(12, 1)
    a[0, 20:25], a[0, 50:55] = 0.0, 0.0
    mask = np.zeros(24, dtype=bool)
    mask[last] = True
    fronts, qr = of(a, mask)
    rank = factored(fronts, qr, a)
    assert rank == np.linalg.matrix_rank(a[0])
    own = np.concatenate(
        [np.arange(fronts.first[f], fronts.first[f] + fronts.pivots[f]) for f in range(len(fronts.pivots))]
    )
    free = fronts.column[own[qr.pivot[own] < 0]]
    assert len(free) == 24 - rank
    before = np.linalg.matrix_rank(a[0][:, ~mask])  # all the rank that the others have is theirs
    assert (~mask[free]).sum() == (~mask).sum() - before
    for column in free:
        x = np.zeros((24, 1))
        x[column] = 1.0
        moved(fronts, qr, x)
        assert np.abs(a[0] @ x).max() < np.abs(x).max() * LEVEL


@pytest.mark.parametrize("lanes", [1, 16])
def test_vectors_behind_the_columns_of_one_front_complete_a_basis(lanes: int) -> None:
    a = full(7, 7, lanes)
    a[:, :, 3:] = 0.0  # columns that are not there
    fronts, qr = of(np.ones_like(a))
    assert factored(fronts, qr, a) == 3
    out = np.full((4, 7, lanes), np.nan)
    beside(fronts, qr, out)
    for k in range(lanes):
        assert np.abs(out[:, :, k] @ out[:, :, k].T - np.eye(4)).max() < LEVEL
        assert np.abs(out[:, :, k] @ a[k]).max() < LEVEL * np.abs(a).max()


def test_a_rank_is_told_or_in_doubt() -> None:
    a = full(5, 3, 1)
    for size, rank in ((0.0, 2), (1e-9, -1), (1e-3, 3), (np.nan, -1)):
        b = a.copy()
        b[0, :, 2] = a[0, :, 0] + size * a[0, :, 2]
        assert factored(*of(b), b) == rank, size
    both = np.concatenate([a, a])
    both[1, :, 2] = both[1, :, 0]  # of full rank in one lane only
    assert factored(*of(both), both) == -1
    assert factored(*of(np.zeros((1, 5, 3))), np.zeros((1, 5, 3))) == 0


def test_values_of_a_chain_are_as_many_as_it_is_long() -> None:
    """Its fronts stay as small as those of one loop, in whichever order its columns stand."""
    sizes = []
    for loops in (10, 40):
        pattern = chain(loops, 1)[0] != 0.0
        sizes.append(build_fronts(pattern[:, np.random.default_rng(0).permutation(2 * loops)]).start[-1])
    assert sizes[1] < 4.5 * sizes[0]


@pytest.mark.parametrize("seed", range(20))
def test_an_estimate_of_a_condition_is_no_smaller_and_not_much_larger(seed: int) -> None:
    a = chain(1 + seed, 1, seed)
    fronts, qr = of(a)
    columns = a.shape[2]
    assert factored(fronts, qr, a) == columns
    estimate = condition(fronts, qr, *np.zeros((2, columns, 1)))
    assert np.linalg.cond(a[0]) <= estimate <= columns**1.5 * np.linalg.cond(a[0])
