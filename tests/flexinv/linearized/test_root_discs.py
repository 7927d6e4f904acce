"""Discs that hold roots: they see wrong vectors and roots that are there twice, and leave good bars small."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from flexinv.linearized.complex_roots import find_roots
from flexinv.linearized.root_discs import compute_root_discs
from flexinv.typing import Array, Complex, Sparse


def sparse(matrix: Array) -> Sparse:
    return scipy.sparse.csc_array(matrix)


def floating(seed: int) -> tuple[tuple[Sparse, Sparse, Sparse], Array]:
    """A chain x'' = 0, y'' = 40 x, ... of four, beside three that swing, fall and creep, in mixed coordinates [kg, N, m, s].

    Also the roots [1/s] of these three: the eight zeros have one vector, and are the eighth root of what rounding leaves of K.
    """
    stiffness = np.diag([0.0, 0.0, 0.0, 0.0, 9.0, -4.0, 30.0])
    stiffness[[1, 2, 3], [0, 1, 2]] = -40.0
    damping = np.diag([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 20.0])
    turned = np.random.default_rng(seed).normal(size=(7, 7)) + 2 * np.eye(7)
    parts = tuple(sparse(turned.T @ part @ turned) for part in (np.eye(7), damping, stiffness))
    return parts, np.array([-2.0, 2.0, -10 + np.sqrt(70), 3j, -10 - np.sqrt(70)])


def pencil() -> tuple[Array, Array, Complex, Complex, Complex]:
    """A pencil of eight roots, with right and left vectors."""
    dice = np.random.default_rng(4)
    a = dice.normal(size=(8, 8))
    b = dice.normal(size=(8, 8)) + 4 * np.eye(8)
    root, left, right = scipy.linalg.eig(a, b, left=True, right=True)
    return a, b, root, right, left


def exact_roots(a: Array, b: Array) -> Complex:
    return np.asarray(scipy.linalg.eigvals(a, b))


def apart(found: Complex, exact: Complex) -> Array:
    return np.asarray(np.abs(found[:, None] - exact[None]).min(axis=1))


def test_right_vectors_have_discs_of_rounding() -> None:
    a, b, root, right, left = pencil()
    centre, radius = compute_root_discs(a, b, root, right, left, 0.0)
    assert (apart(centre, exact_roots(a, b)) <= radius).all()
    assert (radius < 1e-11).all()  # 1e-13 times condition numbers of some tens


@pytest.mark.parametrize("off", [1e-9, 1e-6, 1e-3])
def test_discs_are_of_second_order_in_what_vectors_are_off(off: float) -> None:
    a, b, root, right, left = pencil()
    dice = np.random.default_rng(5)
    right = right + off * dice.normal(size=right.shape)
    centre, radius = compute_root_discs(a, b, root, right, left, 0.0)
    assert (apart(centre, exact_roots(a, b)) <= radius).all()
    assert (radius < 1e-10 + 1e3 * off**2).all()


def test_discs_of_wrong_vectors_hold_all_roots() -> None:
    a, b, root, right, left = pencil()
    dice = np.random.default_rng(6)
    right = right + 0.3 * dice.normal(size=right.shape)
    centre, radius = compute_root_discs(a, b, root, right, left, 0.0)
    assert (apart(exact_roots(a, b), centre) <= radius.max()).all()
    assert radius.max() > 0.1


def test_a_root_that_is_there_twice_is_not_proved() -> None:
    a, b, root, right, left = pencil()
    twice = np.array([0, 0, 2, 3, 4, 5, 6, 7])
    _, radius = compute_root_discs(a, b, root[twice], right[:, twice], left[:, twice], 0.0)
    assert not (radius < 1e3).any()


def test_equal_roots_with_vectors_of_their_own_keep_small_discs() -> None:
    """Any vectors of a double root are right: left and right ones need not match."""
    a = np.diag([1.0, 1.0, 1.0, 5.0])
    dice = np.random.default_rng(7)
    right = scipy.linalg.block_diag(dice.normal(size=(3, 3)), 1.0)
    left = scipy.linalg.block_diag(dice.normal(size=(3, 3)), 1.0)
    centre, radius = compute_root_discs(a, np.eye(4), np.diag(a).astype(complex), right, left, 0.0)
    np.testing.assert_allclose(centre, np.diag(a), rtol=1e-12)
    assert (radius < 1e-9).all()  # 1e-13, the condition of the vectors, and five radii of three that touch


@pytest.mark.parametrize("chain", [2, 3, 4])
def test_a_chain_has_discs_of_the_root_of_rounding_and_spoils_no_others(chain: int) -> None:
    """A Jordan block with one vector: rounding moves its roots by the root of 1e-16."""
    a = np.diag([0.0] * chain + [3.0, -5.0, 70.0]) + np.diag([1.0] * (chain - 1) + [0.0] * 3, 1)
    dice = np.random.default_rng(2)
    turned = dice.normal(size=a.shape)
    a = turned @ a @ np.linalg.inv(turned)
    root, left, right = scipy.linalg.eig(a, left=True, right=True)
    centre, radius = compute_root_discs(a, np.eye(len(a)), root, right, left, 0.0)
    exact = np.array([0.0, 3.0, -5.0, 70.0])
    assert (apart(centre, exact) <= radius).all()
    slow = np.abs(centre) < 1.0
    assert slow.sum() == chain
    assert (radius[~slow] < 1e-9).all()
    assert (radius[slow] < 100 * 1e-11 ** (1 / chain)).all()  # 1e-13 of A, whose entries are some hundred


@pytest.mark.parametrize("seed", range(6))
def test_roots_of_an_end_that_sees_nothing_are_not_taken(seed: int) -> None:
    """They were off by up to 0.8 1/s, ten orders more than their bars.

    The slow end has a shift of 1e-6 of the fastest motion, far below what rounding leaves of eight zeros together: all its roots
    are wrong.  As many lie below the fastest as there are, so that the count was right.
    """
    parts, exact = floating(seed)
    found = find_roots(*parts)
    apart = np.abs(found.root[:, None] - exact[None])
    nearest = apart.argmin(axis=0)
    assert (apart.min(axis=0) <= found.bar[nearest]).all()
    assert (found.bar[nearest] < 1e-7).all()  # 1e-13 of condition numbers of up to 1e4


def test_zeros_together_have_bars_that_reach_zero() -> None:
    parts, exact = floating(0)
    found = find_roots(*parts)
    others = np.abs(found.root[:, None] - exact[None]).min(axis=1) > 1e-3
    assert (np.abs(found.root) <= found.bar)[others].all()
