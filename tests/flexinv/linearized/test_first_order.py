"""Which motions have roots of their own, and that none of them is lost: counts by the argument principle, and words."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import scipy

from flexinv.errors import ConvergenceError, ModelWarning
from flexinv.linearized import first_order
from flexinv.linearized.complex_roots import find_roots
from flexinv.typing import Array, Sparse

# Roundings of a few unknowns.
ROUNDING = 1e-12
# A time of a damper without inertia [s]: below 1e-7 of the period of the motion with inertia.
FOLLOWS = 6e-8


def sparse(matrix: Array) -> Sparse:
    return scipy.sparse.csc_array(matrix)


def tied(stiff: float) -> tuple[Sparse, Sparse, Sparse]:
    """A mass on a spring beside two motions without inertia, C e' + K e = 0 [kg, N, m, s].

    A stiff spring ties them to each other.  Of the common motion K is 2 and C is 2e-6, of the other one 2 stiff and 2 stiff 1e-6.
    """
    mass = np.diag([1.0, 0.0, 0.0])
    both = np.array([[1.0, 1.0], [1.0, 1.0]])
    against = np.array([[1.0, -1.0], [-1.0, 1.0]])
    stiffness = np.zeros((3, 3))
    damping = np.zeros((3, 3))
    stiffness[0, 0] = 9.0
    stiffness[1:, 1:] = both + stiff * against
    damping[1:, 1:] = 1e-6 * (both + stiff * against)
    return sparse(mass), sparse(damping), sparse(stiffness)


@pytest.mark.parametrize("stiff", [1.0, 1e3, 1e5])
def test_a_soft_motion_without_inertia_among_stiff_ones_has_its_root(stiff: float) -> None:
    """Its C was judged over the stiffness of each freedom alone, and one root of -1e6 1/s was left out."""
    roots = find_roots(*tied(stiff))
    # of the entries, 1e-16 times their sizes over that of the soft motion
    np.testing.assert_allclose(roots.root, [3j, -1e6, -1e6], rtol=1e-15 * max(stiff, 1e3))


def test_what_is_known_less_well_than_to_rounding_of_itself_keeps_its_bar() -> None:
    """Newton's method waited for 1e-14 of a root that stiff springs leave 1e-11 of, and its bar was all of the root.

    A mass in a row of springs 1, 1 and 1e5 N/m, with no mass beyond, and at the end a spring and a damper to the ground.
    """
    stiff = 1e5
    along = np.array([1.0, 0.0, 0.0])
    first = np.array([1.0, -1.0, 0.0])
    second = np.array([0.0, 1.0, -1.0])
    end = np.array([0.0, 0.0, 1.0])
    springs = ((1.0, along), (1.0, first), (stiff, second), (1.0, end))
    stiffness = sum(k * np.outer(way, way) for k, way in springs)
    roots = find_roots(sparse(np.diag(along)), sparse(FOLLOWS * np.outer(end, end)), sparse(stiffness))

    def row(s: complex) -> complex:
        return s * s + 1.0 + 1.0 / (1.0 + 1.0 / stiff + 1.0 / (1.0 + FOLLOWS * s))

    exact = scipy.optimize.newton(row, 1.2j, tol=1e-15)
    off = np.abs(roots.root[0] - exact)
    assert off <= roots.bar[0] < 1e-13 * stiff * np.abs(exact)


def test_a_damper_that_rounding_hides_is_said() -> None:
    """C of the last motion is 1e-13 of the largest, 1e-5 s: a root of -1e5 1/s, or rounding of a damper beside it."""
    mass = np.diag([1.0, 0.0, 0.0])
    stiffness = np.diag([1.0, 1e8, 1.0])
    with pytest.warns(
        ModelWarning, match=r"whether 1 motion\(s\) without inertia have a root of their own, beyond 1e\+05 1/s"
    ):
        roots = find_roots(sparse(mass), sparse(np.diag([0.0, 1e8, 1e-5])), sparse(stiffness))
    np.testing.assert_allclose(np.sort_complex(roots.root), [-1.0, 1j], rtol=ROUNDING)


def apart() -> tuple[Sparse, Sparse, Sparse]:
    """Undamped masses of 1 kg with 1, 2, 300 and 400 1/s [kg, N, m, s]."""
    return tuple(sparse(np.diag(part)) for part in (np.ones(4), np.zeros(4), np.array([1.0, 2.0, 300.0, 400.0]) ** 2))


def test_a_root_that_both_ends_have_lost_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both take the pair of 2 1/s for one of 500 1/s: it is not known, and within each circle two are missed."""

    def moved(values: first_order.PencilRoots) -> first_order.PencilRoots:
        root, right, left = values
        off = np.isclose(np.abs(root), 2.0)
        fastest = np.abs(root).argmax()
        taken = np.where(off, fastest, np.arange(len(root)))
        return np.where(off, 1.25 * root[taken], root), right[:, taken], left[:, taken]

    direct = first_order._solve_direct
    slow = first_order._find_slow_roots
    assert len(find_roots(*apart()).root) == 4
    monkeypatch.setattr(first_order, "_solve_direct", lambda *given: moved(direct(*given)))
    monkeypatch.setattr(first_order, "_find_slow_roots", lambda *given: (moved(slow(*given)[0]), 0.0))
    with pytest.warns(ModelWarning, match="that none of 8 roots is lost is not proved"):
        roots = find_roots(*apart())
    assert roots.bar[-1] > 0.1 * np.abs(roots.root[-1])


def test_a_root_that_is_lost_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fast end takes a pair of 400 1/s for one of 1 1/s, with vectors and all: it is there twice, and another is lost."""

    def taken(values: first_order.PencilRoots) -> first_order.PencilRoots:
        root, right, left = values
        slowest = np.flatnonzero(np.isclose(np.abs(root), 1.0))
        fastest = np.flatnonzero(np.isclose(np.abs(root), 400.0))
        order = np.arange(len(root))
        order[fastest] = slowest
        return root[order], right[:, order], left[:, order]

    direct = first_order._solve_direct
    slow = first_order._find_slow_roots
    monkeypatch.setattr(first_order, "_solve_direct", lambda *given: taken(direct(*given)))
    monkeypatch.setattr(first_order, "_find_slow_roots", lambda *given: (taken(slow(*given)[0]), 0.0))
    with pytest.raises(ConvergenceError, match="of 8 roots 2 are lost, or there twice"):
        find_roots(*apart())


@pytest.mark.parametrize(("missed", "said"), [(None, "is not proved"), (2, "2 are lost")])
def test_what_the_count_says_is_said(missed: int | None, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(first_order, "count_missing_roots", lambda *_: missed)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises((ModelWarning, ConvergenceError), match=said):
            find_roots(*apart())


def test_several_zeros_together_are_no_lost_roots() -> None:
    """x'' = 0, y'' = x: rounding leaves four roots of 1e-4 of the others, that either end has elsewhere."""
    stiffness = np.diag([0.0, 0.0, 4.0])
    stiffness[1, 0] = -1.0
    turned = scipy.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    matrices = (turned.T @ part @ turned for part in (np.eye(3), np.zeros((3, 3)), stiffness))
    roots = find_roots(*(sparse(part) for part in matrices))
    swings = roots.root[np.abs(roots.root) > 1.0]
    np.testing.assert_allclose(swings, [2j], rtol=1e-7)
