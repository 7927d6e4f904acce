"""Error bars of the few slowest roots of many: they hold against dense results, for wrong vectors as for right ones."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial
from typing import Any

import numpy as np
import pytest
import scipy
from numpy.typing import NDArray
from vibrating_beams import bar

from flexinv.dynamics.solver import Solver
from flexinv.errors import ConvergenceError
from flexinv.linearized import slowest_modes, slowest_roots
from flexinv.linearized.closed_motions import find_allowed_motions
from flexinv.linearized.complex_roots import Roots, find_circulatory_modes, find_roots
from flexinv.linearized.modes import resolve_setup
from flexinv.linearized.rest_position import compute_rest_matrices, find_rest_position
from flexinv.linearized.root_discs import compute_root_discs
from flexinv.linearized.slowest_modes import find_slowest_circulatory
from flexinv.linearized.slowest_roots import find_slowest_roots
from flexinv.typing import Array, Complex, Sparse

COUNT = 8
MECHANISMS = {
    "Beck's column": bar(15, push=10.0, follower=True),
    "fluttering": bar(15, push=40.0, follower=True),
    "hinged and pushed along": bar(15, "revolute", push=5.0, follower=True),
    "clamped": bar(15),
}
FOLLOWERS = [name for name in MECHANISMS if name != "clamped"]


@cache
def matrices(name: str) -> tuple[Sparse, Sparse, Sparse]:
    """M, C and K [kg, N, m, s] at rest, with a damping that is proportional to neither."""
    mechanism = MECHANISMS[name]
    free = [joint.name for joint in mechanism.joints if joint.nv]
    mesh, at, moving = resolve_setup(mechanism, None, free or None, None)
    solver = Solver.build_for(mesh, set(moving))
    mass, _, stiffness = compute_rest_matrices(solver, find_rest_position(solver, at)[0])
    allowed = find_allowed_motions(solver)
    m, k = (scipy.sparse.csc_array(allowed.T @ part @ allowed) for part in (mass, stiffness))
    uneven = scipy.sparse.diags_array(np.linspace(0.0, 0.1, m.shape[0]))
    return m, scipy.sparse.csc_array(1e-6 * k + uneven @ m @ uneven), k


@cache
def dense_roots(name: str) -> Roots:
    """All roots of the dense matrices [1/s], with bars."""
    return find_roots(*matrices(name))


@cache
def dense_modes(name: str) -> tuple[NDArray[Any], NDArray[Any], Array]:
    """All omega^2 of the dense matrices [1/s^2], their shapes and bars."""
    m, _, k = matrices(name)
    return find_circulatory_modes(k, m)


def pencil(seed: int) -> tuple[Array, Array, Complex, Complex, Complex, Complex]:
    """A pencil of 40 roots, all of them, and the slowest ones with right and left vectors."""
    dice = np.random.default_rng(seed)
    a = dice.normal(size=(40, 40))
    b = dice.normal(size=(40, 40)) / 7 + 2 * np.eye(40)
    root, left, right = scipy.linalg.eig(a, b, left=True, right=True)
    order = np.argsort(np.abs(root))
    count = 10 + int(np.isclose(np.abs(root[order[9]]), np.abs(root[order[10]])))
    own = order[:count]
    return a, b, root, root[own], right[:, own], left[:, own]


def find_apart(root: Complex, exact: Complex) -> Array:
    return np.asarray(np.abs(root[:, None] - exact[None]).min(axis=1))


@pytest.mark.parametrize("off", [0.0, 1e-9, 1e-6, 1e-3, 0.3])
@pytest.mark.parametrize("seed", range(4))
def test_discs_of_few_roots_hold_whatever_vectors_are(off: float, seed: int) -> None:
    """Right vectors are off, left ones, or both; what is left out of the pencil is seen."""
    a, b, exact, root, right, left = pencil(seed)
    dice = np.random.default_rng(seed)
    wrong, other = (part + off * dice.normal(size=part.shape) for part in (right, left))
    sparse = scipy.sparse.csc_array(a), scipy.sparse.csc_array(b)
    for z, w in ((wrong, left), (right, other), (wrong, other)):
        centre, radius = compute_root_discs(*sparse, root, z, w, 0.0)
        assert (find_apart(centre, exact) <= radius).all()
        if off <= 1e-6:
            assert (radius < 1e-9 + 1e3 * off).all()  # rounding by condition numbers of some tens; of first order


def test_without_what_is_left_out_discs_would_be_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pencil that is diagonal: one vector that is a mixture of two has a disc of nothing but for the residual."""
    a = scipy.sparse.csc_array(np.diag([1.0, 2.0, 3.0]))
    b = scipy.sparse.csc_array(np.eye(3))
    mixed = np.array([[1.0], [1.0], [0.0]])
    centre, radius = compute_root_discs(a, b, np.array([1.5 + 0j]), mixed, mixed, 0.0)
    assert centre[0] == pytest.approx(1.5)
    assert radius[0] >= 0.5


def test_a_root_that_is_there_twice_among_few_is_not_proved() -> None:
    a, b, _, root, right, left = pencil(0)
    twice = np.array([0, 0, *range(2, len(root))])
    _, radius = compute_root_discs(a, b, root[twice], right[:, twice], left[:, twice], 0.0)
    assert not (radius < 1e3).any()


@pytest.mark.parametrize("name", MECHANISMS)
def test_bars_of_damped_roots_hold_against_dense_ones(name: str) -> None:
    m, c, k = matrices(name)
    few = find_slowest_roots(m, c, k, COUNT)
    every = dense_roots(name)
    apart = np.abs(few.root[:, None] - every.root[None])
    nearest = apart.argmin(axis=1)
    assert (apart.min(axis=1) <= few.bar + every.bar[nearest]).all()
    moves = np.abs(few.root) > 0.0
    assert (few.bar[moves] < 1e-3 * np.abs(few.root[moves])).all()


@pytest.mark.parametrize("name", FOLLOWERS)
def test_bars_of_circulatory_modes_hold_against_dense_ones(name: str) -> None:
    m, _, k = matrices(name)
    squared, _, bars = find_slowest_circulatory(k, m, COUNT)
    every, _, known = dense_modes(name)
    apart = np.abs(squared[:, None] - every[None])
    nearest = apart.argmin(axis=1)
    assert (apart.min(axis=1) <= bars + known[nearest]).all()
    moves = np.abs(squared) > 0.0
    assert (bars[moves] < 1e-4 * np.abs(squared[moves])).all()


def plant(monkeypatch: pytest.MonkeyPatch, module: Any, off: float) -> None:
    """Let Arnoldi's vectors be off by a part of their own, right and left ones."""
    arnoldi = module._run_arnoldi
    dice = np.random.default_rng(3)

    def find_wrong(*arguments: Any) -> tuple[Complex, Complex, Complex]:
        values, *vectors = arnoldi(*arguments)
        right, left = (part * (1.0 + off * dice.normal(size=part.shape)) for part in vectors)
        return values, right, left

    monkeypatch.setattr(module, "_run_arnoldi", find_wrong)


@pytest.mark.parametrize("off", [1e-9, 1e-7, 1e-6, 1e-5, 1e-3])
def test_planted_wrong_vectors_are_seen(off: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """By bars that are wide enough, or by an error: a beam's fast motions are stiffer by eight orders than its slow ones."""
    m, c, k = matrices("Beck's column")
    every = dense_roots("Beck's column").root
    squares = dense_modes("Beck's column")[0]
    plant(monkeypatch, slowest_roots, off)
    plant(monkeypatch, slowest_modes, off)
    with suppress(ConvergenceError):
        found = find_slowest_roots(m, c, k, COUNT)
        assert (find_apart(found.root, every) <= found.bar).all()
    with suppress(ConvergenceError):
        squared, _, bars = find_slowest_circulatory(k, m, COUNT)
        assert (find_apart(squared, squares) <= bars).all()


@pytest.mark.parametrize("module", [slowest_roots, slowest_modes])
def test_a_root_that_is_found_twice_is_an_error(module: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes the place of another: their number was right."""
    m, c, k = matrices("fluttering")
    arnoldi = module._run_arnoldi

    def find_twice(*arguments: Any) -> tuple[Complex, Complex, Complex]:
        values, right, left = arnoldi(*arguments)
        order = np.argsort(np.abs(values))
        lost = order[4:6]  # a pair of one, or two of a pair of two
        there = order[2:4]
        for part in (values, right, left):
            part[..., lost] = part[..., there]
        return values, right, left

    monkeypatch.setattr(module, "_run_arnoldi", find_twice)
    find: Callable[[], object] = partial(find_slowest_roots, m, c, k, COUNT)
    if module is slowest_modes:
        find = partial(find_slowest_circulatory, k, m, COUNT)
    with pytest.raises(ConvergenceError, match="is not proved"):
        find()
