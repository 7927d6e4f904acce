"""Elimination by blocks against LAPACK: chains, rows that repeat others, one block for all, cost."""

from __future__ import annotations

import numpy as np
import pytest

from flexinv.kernels.dense import Blocks, Pivots, build_blocks, factorise_blocks, solve_blocks
from flexinv.kernels.jit import jit
from flexinv.typing import Array

LEAST = 1e-10
# Backward stable solvers agree to the condition of the matrix; ten for sums of some tens of terms.
LEVEL = 10 * np.finfo(float).eps


@jit
def factored(m, blocks, least, pivots):
    """Factors in place."""
    factorise_blocks(m, blocks, least, pivots)


@jit
def solved(m, blocks, pivots, right, x):
    """Solution into x."""
    solve_blocks(m, blocks, pivots, right, x)


def solution(m: Array, blocks: Blocks, *rights: Array) -> list[Array]:
    """Return the solutions for some right sides with one factorisation."""
    room, pivots, result = m.copy(), Pivots.build_for(len(m)), []
    factored(room, blocks, LEAST, pivots)
    for right in rights:
        result.append(np.empty(len(m)))
        solved(room, blocks, pivots, right.copy(), result[-1])
    return result


def chain(lengths: list[int], seed: int) -> tuple[Array, Blocks]:
    """A matrix of closures that share parts with their neighbours, metres beside radians, not quite symmetric; and its blocks."""
    rng, ends = np.random.default_rng(seed), np.cumsum([0, *lengths])
    parts = len(lengths) + 1
    coupled = np.zeros((parts, len(lengths)), dtype=bool)
    g = np.zeros((ends[-1], 9 * parts))
    for k in range(len(lengths)):
        coupled[k : k + 2, k] = True
        g[ends[k] : ends[k + 1], 9 * k : 9 * k + 18] = rng.normal(size=(lengths[k], 18))
    units = np.where(np.arange(ends[-1]) % 2, 1e3, 1e-3)
    m = units[:, None] * (g @ g.T) * units
    return m * (1 + 1e-3 * rng.normal(size=m.shape)), build_blocks(lengths, coupled)


@pytest.mark.parametrize("lengths", [[1], [2], [5], [5, 5], [2] * 7, [5, 3, 1, 6, 2], []])
def test_a_chain_is_solved_as_a_full_matrix(lengths: list[int]) -> None:
    m, blocks = chain(lengths, len(lengths))
    over = 1 / np.sqrt(np.diag(m))
    rng = np.random.default_rng(0)
    wanted = [over * rng.normal(size=len(m)) for _ in range(2)]
    whole = build_blocks([len(m)], np.ones((1, 1), dtype=bool))
    level = LEVEL * np.linalg.cond(m * np.outer(over, over)) if len(m) else 0.0
    for way in (blocks, whole):
        for x, expected in zip(solution(m, way, *(m @ x for x in wanted)), wanted, strict=True):
            assert np.abs((x - expected) / over).max(initial=0.0) <= level * np.abs(expected / over).max(initial=0.0)


def test_a_ring_fills_in_and_is_solved_all_the_same() -> None:
    """Each block is coupled to two others: what is eliminated first couples those that were not coupled."""
    rng, count = np.random.default_rng(2), 6
    coupled = np.eye(count, dtype=bool) | np.roll(np.eye(count, dtype=bool), 1, axis=0)
    g = np.repeat(np.repeat(coupled.T, 3, axis=0), 5, axis=1) * rng.normal(size=(3 * count, 5 * count))
    m, x = g @ g.T, rng.normal(size=3 * count)
    (result,) = solution(m, build_blocks([3] * count, coupled), m @ x)
    assert np.abs(result - x).max() < LEVEL * np.linalg.cond(m) * np.abs(x).max()


@pytest.mark.parametrize("way", ["blocks", "whole"])
def test_rows_that_repeat_others_have_no_part_in_the_solution(way: str) -> None:
    """One row repeats another of its block, one repeats one of another block, one is zero."""
    m, blocks = chain([3, 5], 7)
    m = (m + m.T) / 2
    pick = np.eye(8)
    pick[2], pick[5], pick[7] = pick[0], 0.0, pick[1] + pick[4]
    whole = pick @ m @ pick.T
    right = whole @ np.ones(8)
    everywhere = build_blocks([8], np.ones((1, 1), dtype=bool))
    (result,) = solution(whole, blocks if way == "blocks" else everywhere, right)
    over = np.sqrt(np.diag(whole))
    assert (result == 0.0).sum() == 3
    assert result[5] == 0.0
    left = (whole @ result - right) / np.where(over > 0.0, over, 1.0)
    assert np.abs(left).max() < 1e-12 * np.abs(right[over > 0.0] / over[over > 0.0]).max()


def test_couplings_of_a_chain_are_as_many_as_it_is_long() -> None:
    """Those that elimination adds included, in whichever order the blocks stand."""
    coupled = np.zeros((41, 40), dtype=bool)
    for k in range(40):
        coupled[k : k + 2, k] = True
    mixed = coupled[:, np.random.default_rng(0).permutation(40)]
    assert len(build_blocks([5] * 40, coupled).beside) == len(build_blocks([5] * 40, mixed).beside) == 39
