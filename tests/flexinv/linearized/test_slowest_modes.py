"""Spectra of large meshes: sparse ones equal dense ones, use memory in proportion to the mesh, and prove that none is missed."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from vibrating_beams import bar

import flexinv
from flexinv.errors import ConvergenceError, InputError, ModelWarning
from flexinv.linearized import modes as module
from flexinv.linearized import slowest_modes
from flexinv.linearized.eigenvalues import ONE_AND_ALL, choose_shift
from flexinv.linearized.modes import Modes
from flexinv.linearized.natural_modes import natural_modes
from flexinv.model.mechanism import (
    WORLD,
    Attachment,
    Closure,
    Joint,
    Mechanism,
    Placement,
)
from flexinv.typing import Array, Sparse

# Omega^2 by two orders of elimination; the stiffness of a mesh of 60 nodes in a metre is 1e5 times that of its slowest motion.
BOTH = 1e-8


def dense(mechanism: Mechanism, free: list[str] | None, count: int, monkeypatch: pytest.MonkeyPatch) -> Modes:
    with monkeypatch.context() as patch:
        patch.setattr(module, "ONE_AND_ALL", 10**9)
        return natural_modes(mechanism, free=free, count=count)


def held_at_its_tip() -> Mechanism:
    place = Attachment(WORLD, Placement(np.array([1.0, 0.0, 0.0])))
    return replace(bar(15), closures=(Closure("tip", "revolute", place, Attachment("bar", Placement(), 1.0)),))


CASES = {
    "clamped": bar(15),
    "without rotary inertia": bar(15, thick=False),
    "hinged": bar(15, "revolute"),
    "free": bar(15, "free"),
    "pushed": bar(15, push=1.0),
    "buckled": bar(15, push=4.0),
    "held at its tip": held_at_its_tip(),
    "Beck's column": bar(15, push=10.0, follower=True),
    "fluttering": bar(15, push=40.0, follower=True),
    "hinged and pushed along": bar(15, "revolute", push=5.0, follower=True),
}
UNSTABLE = {"buckled": "divergence", "fluttering": "flutter"}
RIGID = {"hinged": 1, "free": 6, "hinged and pushed along": 1}


@pytest.mark.reported("D10")
@pytest.mark.parametrize("name", CASES)
def test_few_modes_of_many_are_those_of_the_dense_matrices(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    mechanism, count = CASES[name], 8
    free = [joint.name for joint in mechanism.joints if joint.nv] or None
    result, all_at_once = natural_modes(mechanism, free=free, count=count), dense(mechanism, free, count, monkeypatch)
    assert 6 * result.mesh.size > ONE_AND_ALL
    assert result.stability == all_at_once.stability
    assert result.stability[0] == UNSTABLE.get(name, "rigid motion" if name in RIGID else "stable")
    assert result.stability.count("rigid motion") == RIGID.get(name, 0)
    np.testing.assert_allclose(result.squared, all_at_once.squared, rtol=BOTH)
    # of modal mass one: the norm of shapes that a double root mixes is that of both together
    sizes = [(np.abs(one.displacement) ** 2).sum(axis=(1, 2)) for one in (result, all_at_once)]
    if name not in {"free", "fluttering"}:  # of which the last root kept may be one of two
        np.testing.assert_allclose(sizes[0].sum(), sizes[1].sum(), rtol=1e-6)


def test_a_push_that_turns_along_leaves_a_hinge_its_rigid_motion() -> None:
    """Of few elements, too: other motions are not lost beside one without stiffness."""
    modes = natural_modes(bar(2, "revolute", push=5.0, follower=True), free=["root"], count=6)
    assert modes.stability == ("rigid motion", *5 * ("stable",))


def peak(elements: int) -> int:
    """Most memory [bytes] of arrays at once."""
    tracemalloc.start()
    try:
        assert natural_modes(bar(elements), count=4).stability == 4 * ("stable",)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.reported("D10")
def test_memory_grows_with_the_mesh_and_not_with_its_square() -> None:
    few, many = peak(50), peak(200)
    assert many < 5 * few  # four times the mesh; its square is sixteen times as much
    unknowns = 6 * 4 * 200
    assert many < unknowns**2 * 8 / 4  # bytes of one dense matrix over four


def test_a_large_column_that_flutters_is_found_by_statics() -> None:
    with pytest.warns(ModelWarning, match="complex: flutter"):
        assert not flexinv.statics(bar(15, push=40.0, follower=True)).stable
    assert flexinv.statics(bar(15, push=10.0, follower=True)).stable


def test_a_mode_that_is_missed_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bending about y and z have the same frequency: one of the two is what a Krylov subspace finds late."""
    lanczos = slowest_modes._run_lanczos

    def without_the_second(k: Sparse, m: Sparse, shift: float, count: int) -> tuple[Array, Array]:
        squared, shapes = lanczos(k, m, shift, count)
        return np.delete(squared, 1), np.delete(shapes, 1, axis=1)

    monkeypatch.setattr(slowest_modes, "_run_lanczos", without_the_second)
    with pytest.raises(ConvergenceError, match="some are missed"):
        natural_modes(bar(15), count=4)


def test_all_modes_of_a_large_mesh_are_not_found_without_a_word() -> None:
    with pytest.warns(ModelWarning, match=r"of 1200 modes the 30 slowest are found; write count"):
        assert len(natural_modes(bar(50)).squared) == 30


def test_a_large_mesh_without_inertia_and_stiffness_is_refused() -> None:
    """A ring of a bar that may spin about its axis freely, without rotary inertia."""
    spins = replace(bar(15, thick=False), joints=(Joint("root", "spherical", WORLD, "bar"),))
    with pytest.raises(InputError, match="neither inertia nor stiffness"):
        natural_modes(spins, free=["root"], count=4)


def test_the_shift_is_near_the_slowest_motion_with_stiffness() -> None:
    assert choose_shift(np.array([1e-9, 4.0, 9.0]), 1e-6) == pytest.approx(4 * 1.37)
    assert choose_shift(np.array([4.0, 9.0]), 1e-6) == 1e-6
