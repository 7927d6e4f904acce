"""Roots with gyroscopic terms and dampers: what one shift lost, error bars, freedoms without inertia, and proofs of counts."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest
import scipy
from vibrating_beams import bar

import flexinv
from flexinv.errors import ConvergenceError, ModelWarning
from flexinv.linearized import slowest_modes, slowest_roots
from flexinv.linearized import steady_modes as steady
from flexinv.linearized.complex_roots import roots
from flexinv.linearized.linear_model import linear_model
from flexinv.linearized.natural_modes import natural_modes
from flexinv.linearized.root_counts import missed_within
from flexinv.linearized.steady_modes import steady_modes
from flexinv.model.mechanism import WORLD, Body, Inertia, Joint, Link, Mechanism, with_retardation
from flexinv.typing import Array, Sparse

# Roundings of a few unknowns.
ROUNDING = 1e-12


def sparse(matrix: Array) -> Sparse:
    return scipy.sparse.csc_array(matrix)


def test_slow_and_fast_roots_beside_one_without_stiffness_are_exact() -> None:
    """About one shift 7e3 1/s was off by 3e-3 of itself beside 1e9 1/s and a free motion."""
    frequency = np.array([0.0, 1e-1, 1.0, 7e3, 1e6, 1e9])
    found = roots(*(sparse(np.diag(part)) for part in (np.ones(6), np.zeros(6), frequency**2)))
    exact = np.sort(np.concatenate([[0.0], frequency]))  # of the free motion both
    off = np.abs(np.abs(found.root) - exact)
    assert (off <= found.bar).all()
    assert (off[2:] < ROUNDING * exact[2:]).all()


def test_dampers_on_what_has_no_inertia_are_roots_of_their_own() -> None:
    """c x' + k x = 0 beside a mass on a spring: three roots."""
    found = roots(sparse(np.diag([1.0, 0.0])), sparse(np.diag([0.0, 2.0])), sparse(np.diag([9.0, 4.0])))
    np.testing.assert_allclose(found.root, [-2.0, 3.0j], rtol=ROUNDING)


def test_gyroscopic_terms_move_what_follows() -> None:
    """x'' + x + g e' = 0, k e = g x': e follows the rate of x, and (1 + g^2 / k) x'' + x = 0."""
    gyroscopic = np.array([[0.0, 2.0], [-2.0, 0.0]])
    found = roots(sparse(np.diag([1.0, 0.0])), sparse(gyroscopic), sparse(np.diag([1.0, 4.0])))
    np.testing.assert_allclose(found.root, [1j / np.sqrt(2.0)], rtol=ROUNDING)


def test_light_damping_is_no_rounding() -> None:
    """A part of critical damping of 1e-9 was taken for rounding."""
    found = roots(sparse(np.eye(1)), sparse([[2e-9]]), sparse(np.eye(1)))
    np.testing.assert_allclose(found.root.real, [-1e-9], rtol=1e-6)


def disc(damping: float, inertia: float) -> Mechanism:
    """A disc on a spring in a hinge, and a pointer beside it that a spring and a damper hold."""
    own = {"stiffness": 3.0, "actuated": False}
    joints = (
        Joint("hinge", "revolute", WORLD, "disc", stiffness=2.0),
        Joint("pointer", "revolute", "disc", "needle", damping=damping, **own),
    )
    links = tuple(
        Link(name, (Body(name, Inertia(1.0, np.zeros(3), size * np.eye(3))),))
        for name, size in (("disc", 0.5), ("needle", inertia))
    )
    return Mechanism("disc", links, joints, np.zeros(3))


def test_a_state_space_has_the_state_of_a_damper_without_inertia() -> None:
    """It was left out, and the pointer followed at once: -0.2 +- 2 1/s of the disc were 2i."""
    exact = np.roots([0.4 * 0.5, 3.0 * 0.5, 0.4 * 5.0 - 0.4 * 3.0, 6.0])
    model = linear_model(disc(0.4, 0.0))
    light = linear_model(disc(0.4, 1e-9))
    assert model.A.shape == (3, 3)
    assert model.states == ("mode 1", "massless 1", "mode 1 rate")
    np.testing.assert_allclose(np.sort_complex(model.poles), np.sort_complex(exact), rtol=1e-9)
    s = 0.3 + 2j
    answers = [m.C @ np.linalg.solve(s * np.eye(len(m.A)) - m.A, m.B) + m.D for m in (model, light)]
    np.testing.assert_allclose(answers[0], answers[1], rtol=0, atol=1e-7)  # 1e-9 of an inertia, answers of 1


def test_bars_of_roots_hold_and_are_none_of_rigid_mechanisms_but_rounding() -> None:
    rotor = bar(1, "revolute")
    found, right = (steady_modes(one, free=["root"], count=4) for one in (rotor, bar(6, "revolute")))
    off = np.abs(found.root - right.root)
    assert (off <= found.root_error + right.root_error).all()
    assert (found.root_error[2:] > 1e-6 * np.abs(found.root[2:])).any()
    np.testing.assert_allclose(found.frequency_error, found.root_error / (2 * np.pi))
    assert copy.deepcopy(found) == found
    assert (steady_modes(disc(0.4, 0.1), free=["hinge"]).root_error < 1e-11).all()


def test_bars_of_poles_hold() -> None:
    model, right = (linear_model(bar(n, "revolute"), modes=3) for n in (1, 6))
    off = np.abs(model.poles - right.poles)
    assert (off <= model.pole_error + right.pole_error).all()
    assert model.pole_error.max() > 0.5 * off.max() > 0.0
    assert copy.deepcopy(model) == model


# ------------------------------------------------------------------------------------------------- damped columns


def test_damping_may_make_a_column_flutter_that_is_stable_without() -> None:
    """Beck's column flutters at 20.05 EI / L^2, with light inner damping at 10.94 (Bolotin): `stable` was True there."""
    for push, without, damped in ((8.0, True, True), (15.0, True, False), (22.0, False, False)):
        column = bar(2, push=push, follower=True, thick=False)
        for one, stable in ((column, without), (with_retardation(column, 1e-5), damped)):
            if stable:
                assert flexinv.statics(one).stable is True
                continue
            with pytest.warns(ModelWarning, match="flutter"):
                assert flexinv.statics(one).stable is False


def test_of_many_motions_statics_says_which_were_looked_at() -> None:
    column = bar(15, push=5.0, follower=True)
    found = flexinv.statics(with_retardation(column, 1e-5))
    assert found.stable is True
    assert any("30 slowest were looked at" in note for note in found.notes)


# ---------------------------------------------------------------------------------------- large meshes, and counts


@pytest.mark.parametrize("damped", [False, True])
def test_few_roots_of_many_are_those_of_the_dense_matrices(damped: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    column = bar(15, "revolute", push=5.0, follower=True)
    column = with_retardation(column, 1e-6) if damped else column
    found = steady_modes(column, free=["root"], count=6)
    monkeypatch.setattr(steady, "ONE_AND_ALL", 10**9)
    dense = steady_modes(column, free=["root"], count=6)
    # of pairs of roots of a square bar that lie together, which its bars know
    assert (np.abs(found.root - dense.root) <= found.rounding + dense.rounding + 1e-8 * np.abs(dense.root)).all()


def test_roots_within_a_circle_are_counted() -> None:
    rng = np.random.default_rng(1)
    k, m = rng.normal(size=(30, 30)), np.diag(rng.uniform(1, 2, 30))
    exact = scipy.linalg.eigvals(k, m)
    size = np.sort(np.abs(exact))
    radius = float(size[11] + size[12]) / 2

    def at(z: complex) -> Sparse:
        return scipy.sparse.csc_array(k - z * m)

    inside = int((np.abs(exact) < radius).sum())
    assert missed_within(radius, exact, at) == 0
    assert missed_within(radius, np.zeros(0, dtype=complex), at) == inside
    real = np.flatnonzero((exact.imag == 0.0) & (np.abs(exact) < radius))
    pair = np.flatnonzero((exact.imag != 0.0) & (np.abs(exact) < radius))
    if len(real):
        assert missed_within(radius, np.delete(exact, real[0]), at) == 1
    both = np.isclose(exact, exact[pair[0]]) | np.isclose(exact, exact[pair[0]].conj())
    assert missed_within(radius, exact[~both], at) == 2


def test_a_mode_that_is_missed_under_a_push_that_turns_along_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    column = bar(15, push=10.0, follower=True)
    right = slowest_modes._arnoldi

    def without_first(*arguments: object) -> tuple[Array, ...]:
        squared, *shapes = right(*arguments)  # type: ignore[arg-type]
        slowest = np.abs(squared).argmin()
        return np.delete(squared, slowest), *(np.delete(part, slowest, axis=1) for part in shapes)

    monkeypatch.setattr(slowest_modes, "_arnoldi", without_first)
    with pytest.raises(ConvergenceError, match="is not proved"):
        natural_modes(column, count=4)
    other = slowest_roots._arnoldi

    def without_slowest(*arguments: object) -> tuple[Array, ...]:
        root, *shapes = other(*arguments)  # type: ignore[arg-type]
        keep = ~np.isclose(np.abs(root), np.abs(root).min(), rtol=1e-6)
        return root[keep], *(part[:, keep] for part in shapes)

    monkeypatch.setattr(slowest_roots, "_arnoldi", without_slowest)
    with pytest.raises(ConvergenceError, match="is not proved"):
        steady_modes(replace(column, name="other"), count=4)
