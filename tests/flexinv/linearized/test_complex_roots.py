"""Roots with gyroscopic terms and dampers: what one shift lost, error bars, freedoms without inertia, and proofs of counts."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest
import scipy
from vibrating_beams import bar

import flexinv
from campaigns.spectra_reference import Pencil, spectrum_of
from flexinv.errors import ConvergenceError, ModelWarning
from flexinv.linearized import slowest_modes, slowest_roots
from flexinv.linearized import steady_modes as steady
from flexinv.linearized.complex_roots import find_rate_driven_motions, find_roots
from flexinv.linearized.eigenvalues import split_by_inertia
from flexinv.linearized.linear_model import compute_poles, linear_model
from flexinv.linearized.natural_modes import natural_modes
from flexinv.linearized.root_counts import count_missing_roots
from flexinv.linearized.state_space import Basis, LeftOut, build_state_space
from flexinv.linearized.steady_modes import steady_modes
from flexinv.model.mechanism import (
    WORLD,
    Attachment,
    Body,
    Inertia,
    Joint,
    Link,
    Mechanism,
    Placement,
    Spring,
    with_retardation,
)
from flexinv.typing import Array, Sparse

# Roundings of a few unknowns.
ROUNDING = 1e-12


def sparse(matrix: Array) -> Sparse:
    return scipy.sparse.csc_array(matrix)


def test_slow_and_fast_roots_beside_one_without_stiffness_are_exact() -> None:
    """About one shift 7e3 1/s was off by 3e-3 of itself beside 1e9 1/s and a free motion."""
    frequency = np.array([0.0, 1e-1, 1.0, 7e3, 1e6, 1e9])
    roots = find_roots(*(sparse(np.diag(part)) for part in (np.ones(6), np.zeros(6), frequency**2)))
    exact = np.sort(np.concatenate([[0.0], frequency]))  # of the free motion both
    off = np.abs(np.abs(roots.root) - exact)
    assert (off <= roots.bar).all()
    assert (off[2:] < ROUNDING * exact[2:]).all()


def test_dampers_on_what_has_no_inertia_are_roots_of_their_own() -> None:
    """c x' + k x = 0 beside a mass on a spring: three roots."""
    roots = find_roots(sparse(np.diag([1.0, 0.0])), sparse(np.diag([0.0, 2.0])), sparse(np.diag([9.0, 4.0])))
    np.testing.assert_allclose(roots.root, [-2.0, 3.0j], rtol=ROUNDING)


def test_gyroscopic_terms_move_what_follows() -> None:
    """x'' + x + g e' = 0, k e = g x': e follows the rate of x, and (1 + g^2 / k) x'' + x = 0."""
    gyroscopic = np.array([[0.0, 2.0], [-2.0, 0.0]])
    roots = find_roots(sparse(np.diag([1.0, 0.0])), sparse(gyroscopic), sparse(np.diag([1.0, 4.0])))
    np.testing.assert_allclose(roots.root, [1j / np.sqrt(2.0)], rtol=ROUNDING)


@pytest.mark.parametrize("squared", [2.0, 3.0, 7.0, 11.0, 13.0, 156.9276888, 1e6 / 7.0])
def test_both_roots_of_what_falls_are_found(squared: float) -> None:
    """Of +w and -w, equal in size but for rounding, both ends had the same one on their side of the place where they part."""
    roots = find_roots(sparse([[1.0]]), sparse([[0.0]]), sparse([[-squared]]))
    np.testing.assert_allclose(np.sort(roots.root.real), np.sqrt(squared) * np.array([-1.0, 1.0]), rtol=ROUNDING)


def test_light_damping_is_no_rounding() -> None:
    """A part of critical damping of 1e-9 was taken for rounding."""
    roots = find_roots(sparse(np.eye(1)), sparse([[2e-9]]), sparse(np.eye(1)))
    np.testing.assert_allclose(roots.root.real, [-1e-9], rtol=1e-6)


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
    result, right = (steady_modes(one, free=["root"], count=4) for one in (rotor, bar(6, "revolute")))
    off = np.abs(result.root - right.root)
    assert (off <= result.root_error + right.root_error).all()
    assert (result.root_error[2:] > 1e-6 * np.abs(result.root[2:])).any()
    np.testing.assert_allclose(result.frequency_error, result.root_error / (2 * np.pi))
    assert copy.deepcopy(result) == result
    assert (steady_modes(disc(0.4, 0.1), free=["hinge"]).root_error < 1e-11).all()


def test_bars_of_poles_hold() -> None:
    model, right = (linear_model(bar(n, "revolute"), modes=3) for n in (1, 6))
    off = np.abs(model.poles - right.poles)
    assert (off <= model.pole_error + right.pole_error).all()
    assert model.pole_error.max() > 0.5 * off.max() > 0.0
    assert copy.deepcopy(model) == model


# ------------------------------------------------------------------- what follows, and what is nearly as fast as that


FOLLOWS = 6e-8  # [s]: below 1e-7 of the period of the motion with inertia


def slides(time: float) -> Mechanism:
    """Three slides in a row, each on a spring of 1 N/m, and one on all: 1 kg, then two without mass, damped with times [s]."""
    along = np.array([1.0, 0.0, 0.0])
    damping = (0.0, time, FOLLOWS)
    links = tuple(Link(f"link {k}", (Body("weight", Inertia(1.0)),) if k == 0 else ()) for k in range(3))
    joints = tuple(
        Joint(
            f"slide {k}", "prismatic", f"link {k - 1}" if k else WORLD, f"link {k}", axis=along, stiffness=1.0,
            damping=damping[k], actuated=k == 0,
        )
        for k in range(3)
    )  # fmt: skip
    behind = Attachment(WORLD, Placement(-along))
    return Mechanism(
        "slides", links, joints, np.zeros(3), springs=(Spring("all", behind, Attachment("link 2"), 1.0, 1.0),)
    )


def fast_root(time: float) -> float:
    """The root of det (s^2 M + s C + K) that the second slide has without the damper of the third, -3 / (2 time), or near it."""
    mass = np.diag([1.0, 0.0, 0.0])
    damping = np.diag([0.0, time, FOLLOWS])

    def determinant(s: float) -> float:
        return float(np.linalg.det(mass + damping / s + (np.eye(3) + 1.0) / s**2))

    return float(scipy.optimize.brentq(determinant, -1.8 / time, -1.2 / time, xtol=1e-300, rtol=1e-15))


@pytest.mark.parametrize("time", [2e-6, 1e-6, 2e-7])
def test_a_root_that_is_nearly_as_fast_as_what_follows_is_exact(time: float) -> None:
    """It was off by (|s| FOLLOWS)^2, 2e-4 to 2e-2 of it, with an error bar of rounding."""
    modes = steady_modes(slides(time), free=["slide 0", "slide 1", "slide 2"])
    off = abs(modes.root[-1] - fast_root(time))
    assert off < ROUNDING * abs(modes.root[-1])
    assert off <= modes.rounding[-1]


@pytest.mark.parametrize("time", [2e-6, 1e-6, 2e-7])
def test_dampers_beside_each_other_leave_the_pole_of_one_exact(time: float) -> None:
    """What follows is taken apart by C over K, and takes no part in the motion of the other: it was off by 2e-4 to 2e-2."""
    model = linear_model(slides(time))
    off = abs(model.poles[-1] - fast_root(time))
    assert off <= compute_poles(model.A)[1][-1]  # of rounding alone
    assert copy.deepcopy(model) == model


@pytest.mark.parametrize("time", [2e-6, 1e-6, 4e-7])
def test_the_bar_of_a_pole_covers_what_follows_it_not_quite_at_once(time: float) -> None:
    """Gyroscopic terms tie what follows to what is damped: A has no state for it, the pole is off by (|s| FOLLOWS)^2."""
    mass = np.diag([1.0, 0.0, 0.0])
    stiffness = np.eye(3) + 1.0
    gyroscopic = 0.1 * time
    damping = np.array([[0.0, 0.0, 0.0], [0.0, time, gyroscopic], [0.0, -gyroscopic, FOLLOWS]])
    split = split_by_inertia(sparse(mass))
    moved, held = find_rate_driven_motions(split, sparse(damping), sparse(stiffness))
    assert held.shape[1] == 1
    every = np.hstack([part.toarray() for part in (split.massive, moved, held)])
    space = build_state_space(Basis(every, every, 0, 1, 1, 1), (mass, damping, stiffness), np.zeros((3, 0)))
    poles, bars = compute_poles(space.a, space.left_out)
    exact = spectrum_of(Pencil(mass, damping, stiffness, np.eye(3), float(np.abs(stiffness).max())))
    off = np.abs(exact.root - poles[-1]).min()
    assert off > 1e3 * compute_poles(space.a)[1][-1]  # of rounding alone
    assert off <= bars[-1] < 1.1 * off  # the move is a hundredth of the pole, and so are the orders that are bounded


def test_a_pole_as_fast_as_what_follows_is_not_known() -> None:
    left_out = LeftOut(np.array([[1e-9]]), 1.0)
    np.testing.assert_allclose(left_out.move(np.array([-0.1, -2.0]), np.array([1e-9, 1e-9])), [1e-11 / 0.9, 2.0])


@pytest.mark.parametrize("seed", range(5))
def test_roots_of_several_dampers_are_those_of_the_whole_pencil(seed: int) -> None:
    """Two motions with inertia, three with dampers of 1e-6 s, three that follow: as QZ of all of it finds them."""
    dice = np.random.default_rng(seed)
    part = dice.normal(size=(8, 8))
    stiffness = part @ part.T + 4 * np.eye(8)
    damping = np.zeros((8, 8))
    damping[2:5, 2:5] = 1e-5 * np.diag(dice.uniform(1.0, 3.0, 3))
    damping[5:, 5:] = FOLLOWS * np.diag(dice.uniform(0.5, 2.0, 3))
    mass = np.diag([1.0, 2.0, *np.zeros(6)])
    roots = find_roots(sparse(mass), sparse(damping), sparse(stiffness))
    exact = spectrum_of(Pencil(mass, damping, stiffness, np.eye(8), float(np.abs(stiffness).max())))
    apart = np.abs(roots.root[:, None] - exact.root[None])
    assert len(roots.root) == 2 + 3  # of each pair one, and those of what follows are beyond all
    bars = exact.bars(ROUNDING)[apart.argmin(axis=1)]
    assert (apart.min(axis=1) <= roots.bar + bars).all()
    assert (roots.bar < 1e-9 * np.abs(roots.root)).all()


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
    column = bar(13, push=5.0, follower=True)
    solution = flexinv.statics(with_retardation(column, 1e-5))
    assert solution.stable is True
    assert any("30 slowest were looked at" in note for note in solution.notes)


# ---------------------------------------------------------------------------------------- large meshes, and counts


@pytest.mark.parametrize("damped", [False, True])
def test_few_roots_of_many_are_those_of_the_dense_matrices(damped: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    column = bar(13, "revolute", push=5.0, follower=True)
    column = with_retardation(column, 1e-6) if damped else column
    modes = steady_modes(column, free=["root"], count=6)
    monkeypatch.setattr(steady, "ONE_AND_ALL", 10**9)
    dense = steady_modes(column, free=["root"], count=6)
    # of pairs of roots of a square bar that lie together, which its bars know
    assert (np.abs(modes.root - dense.root) <= modes.rounding + dense.rounding + 1e-8 * np.abs(dense.root)).all()


def test_roots_within_a_circle_are_counted() -> None:
    rng = np.random.default_rng(1)
    k, m = rng.normal(size=(30, 30)), np.diag(rng.uniform(1, 2, 30))
    exact = scipy.linalg.eigvals(k, m)
    size = np.sort(np.abs(exact))
    radius = float(size[11] + size[12]) / 2

    def at(z: complex) -> Sparse:
        return scipy.sparse.csc_array(k - z * m)

    inside = int((np.abs(exact) < radius).sum())
    assert count_missing_roots(radius, exact, at) == 0
    assert count_missing_roots(radius, np.zeros(0, dtype=complex), at) == inside
    real = np.flatnonzero((exact.imag == 0.0) & (np.abs(exact) < radius))
    pair = np.flatnonzero((exact.imag != 0.0) & (np.abs(exact) < radius))
    if len(real):
        assert count_missing_roots(radius, np.delete(exact, real[0]), at) == 1
    both = np.isclose(exact, exact[pair[0]]) | np.isclose(exact, exact[pair[0]].conj())
    assert count_missing_roots(radius, exact[~both], at) == 2


def test_a_mode_that_is_missed_under_a_push_that_turns_along_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    column = bar(15, push=10.0, follower=True)
    right = slowest_modes._run_arnoldi

    def without_first(*arguments: object) -> tuple[Array, ...]:
        squared, *shapes = right(*arguments)  # type: ignore[arg-type]
        slowest = np.abs(squared).argmin()
        return np.delete(squared, slowest), *(np.delete(part, slowest, axis=1) for part in shapes)

    monkeypatch.setattr(slowest_modes, "_run_arnoldi", without_first)
    with pytest.raises(ConvergenceError, match="is not proved"):
        natural_modes(column, count=4)
    other = slowest_roots._run_arnoldi

    def without_slowest(*arguments: object) -> tuple[Array, ...]:
        root, *shapes = other(*arguments)  # type: ignore[arg-type]
        keep = ~np.isclose(np.abs(root), np.abs(root).min(), rtol=1e-6)
        return root[keep], *(part[:, keep] for part in shapes)

    monkeypatch.setattr(slowest_roots, "_run_arnoldi", without_slowest)
    with pytest.raises(ConvergenceError, match="is not proved"):
        steady_modes(replace(column, name="other"), count=4)
