"""The compiled projection against singular values: the same equations by another factorisation."""

from __future__ import annotations

import numpy as np
import pytest

from flexinv.constraints.allocation import split_by_svd, split_efforts
from flexinv.constraints.allocation_kernel import AllocatedEfforts
from flexinv.typing import Array

# Rounding of two dozen operations a row, enlarged by condition numbers of some tens.
ROUNDING = 1e-12


def _closures(rng: np.random.Generator, samples: int, rows: int, nv: int, rank: int) -> Array:
    """G of a given rank: its rows repeat each other where there are more of them."""
    return np.asarray(rng.normal(size=(samples, rows, rank)) @ rng.normal(size=(samples, rank, nv)))


def _spans(space: Array) -> Array:
    """Projector on the columns of every sample: the same for every basis."""
    q = np.linalg.qr(space)[0]
    return np.asarray(q @ q.transpose(0, 2, 1))


def _apart(ours: AllocatedEfforts, svd: AllocatedEfforts) -> float:
    """Largest difference over the size of the result and its condition number [-]; infinite where freedoms differ."""
    if ours.preload.shape != svd.preload.shape:
        return float("inf")
    size, worst = np.abs(svd.tau).max() + np.abs(svd.multipliers).max(), svd.condition.max()
    pairs = (ours.tau, svd.tau), (ours.multipliers, svd.multipliers), (ours.left, svd.left)
    parts = [np.abs(a - b).max() / size for a, b in pairs]
    parts.append(np.abs(ours.condition / svd.condition - 1).max())
    if ours.preload.shape[2]:
        parts.append(np.abs(_spans(ours.preload) - _spans(svd.preload)).max())
    return float(max(parts) / worst)


@pytest.mark.parametrize(
    ("rows", "nv", "rank", "drives"),
    [(5, 3, 2, 1), (3, 3, 2, 2), (6, 7, 5, 2), (9, 8, 4, 6), (30, 24, 18, 6), (2, 5, 2, 5), (1, 2, 1, 1)],
)
def test_equals_singular_values(rows: int, nv: int, rank: int, drives: int) -> None:
    """Determinate and redundant drives, redundant constraints, weights; a drive may stand anywhere."""
    rng = np.random.default_rng(rows + nv)
    g, tree = _closures(rng, 40, rows, nv, rank), rng.normal(size=(40, nv))
    driven = np.zeros(nv, dtype=bool)
    driven[rng.permutation(nv)[:drives]] = True
    weight = rng.uniform(0.2, 5.0, drives)
    for w in (None, weight):
        root = np.ones(drives) if w is None else np.sqrt(w)
        assert _apart(split_efforts(g, tree, driven, w), split_by_svd(g, tree, driven, root)) < ROUNDING


def test_doubtful_samples_are_left_to_singular_values() -> None:
    """A rank that changes, or pivots of 1e-9, between certain samples: each is what it is by itself."""
    rng = np.random.default_rng(3)
    g, tree = _closures(rng, 6, 4, 4, 3), rng.normal(size=(6, 4))
    g[2] = _closures(rng, 1, 4, 4, 4)[0]  # nothing moves
    g[4] = _closures(rng, 1, 4, 4, 2)[0] + 1e-9 * rng.normal(size=(4, 4))
    driven = np.array([True, False, True, False])
    both = split_efforts(g, tree, driven), split_by_svd(g, tree, driven, np.ones(2))
    for k in range(6):
        one, two = (
            AllocatedEfforts(s.tau[[k]], s.multipliers[[k]], s.left[[k]], s.preload[[k]], s.condition[[k]])
            for s in both
        )
        if k in (2, 4):
            assert np.array_equal(one.tau, two.tau)
            assert np.array_equal(one.condition, two.condition)
            assert np.array_equal(one.multipliers, two.multipliers)
        else:
            bare = (s._replace(preload=s.preload[:, :, :0]) for s in (one, two))
            assert _apart(*bare) < ROUNDING
    assert both[0].preload.shape == both[1].preload.shape


def test_all_in_doubt() -> None:
    g, tree = np.tile(np.eye(2), (3, 1, 1)), np.ones((3, 2))
    ours, svd = (
        split_efforts(g, tree, np.array([True, False])),
        split_by_svd(g, tree, np.array([True, False]), np.ones(1)),
    )
    assert np.array_equal(ours.multipliers, svd.multipliers)
    assert ours.preload.shape == svd.preload.shape


def test_closures_that_tie_nothing_leave_the_efforts_as_they_are() -> None:
    """No row says anything, in some samples but for rounding: zeros of their neighbours in the block do not become NaN."""
    rng = np.random.default_rng(4)
    g, tree = np.zeros((9, 3, 4)), rng.normal(size=(9, 4))
    g[2, 1], g[8, 1] = 3e-17, 2e-16
    shares = split_efforts(g, tree, np.ones(4, dtype=bool))
    others = np.flatnonzero(~g.any(axis=(1, 2)))
    assert np.array_equal(shares.tau[others], tree[others])
    assert np.isfinite(shares.tau).all()
