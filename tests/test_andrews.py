"""Andrews' squeezer: the reference meets the published digits, and inverse dynamics of its motion returns its motor."""

from __future__ import annotations

from pathlib import Path

import andrews
import numpy as np
import pytest

import flexinv
from flexinv.constraints.continuation import compute_mobility
from flexinv.files.load_cases import Case, load_cases
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

pytestmark = pytest.mark.slow  # what they share is computed once, and takes seconds

STEP, END, DRIVE = 1e-4, 0.03, andrews.P["drive"]


@pytest.fixture(scope="module")
def truth() -> andrews.Series:
    """The integrated motion, five samples between two of flexinv's, a little beyond the end."""
    return andrews.series(0.0305, 1526)


@pytest.fixture(scope="module")
def squeezer(root: Path) -> tuple[Mechanism, Case]:
    mechanism = flexinv.load_mechanism(root / "models" / "andrews_squeezer")
    return mechanism, load_cases(root / "models" / "andrews_squeezer", mechanism)["spin_up"]


@pytest.fixture(scope="module")
def solution(squeezer: tuple[Mechanism, Case], truth: andrews.Series) -> flexinv.Solution:
    """K1 as in the reference, the other six joints from guesses of five digits."""
    mechanism, case = squeezer
    motion = flexinv.Motion.from_samples(truth.time, {"beta": truth.q[:, 0]})
    return flexinv.solve(mechanism, motion, step=STEP, end=END, start=case.start)


def at_samples(values: Array) -> Array:
    return values[::5][: round(END / STEP) + 1]


def joints(solution: flexinv.Solution, values: Array) -> Array:
    """(samples, 7) in the order of the reference."""
    return np.stack([values[:, solution.mechanism.velocity_names.index(name)] for name in andrews.NAMES], axis=1)


def test_reference_starts_as_published() -> None:
    q, v = np.array(andrews.DATA["initial"]["q"]), np.zeros(7)
    assert np.abs(andrews.constraints(q, v)[0]).max() < 1e-16  # closed to rounding of 0.07 m
    a, lam = andrews.accelerations(q, v)
    published = andrews.DATA["at 0 s"]
    assert np.allclose(a, published["a"], rtol=1e-14, atol=1e-11)  # 1e-15 of the largest
    assert np.allclose(lam, published["lam"], rtol=1e-14, atol=1e-13)


def test_reference_meets_the_published_digits(truth: andrews.Series) -> None:
    """PSIDE at tolerances of 1e-14: positions and velocities to 1e-7, accelerations and multipliers to 3e-6 (the issue's)."""
    last, published = round(END / 2e-5), andrews.DATA["at 0.03 s"]
    assert truth.time[last] == pytest.approx(END, abs=1e-15)
    assert np.allclose(truth.q[last], published["q"], rtol=1e-7, atol=0)
    assert np.allclose(truth.v[last], published["v"], rtol=1e-7, atol=0)
    assert np.allclose(truth.a[last], published["a"], rtol=3e-6, atol=0)
    assert np.allclose(truth.lam[last], published["lam"], rtol=3e-6, atol=0)


def test_a_wrong_mass_misses_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """The digits see the equations: the mass of K3 as one help page prints it is caught."""
    monkeypatch.setitem(andrews.P, "m3", 0.02372)
    q, v = andrews.series(END, 31).q[-1], andrews.DATA["at 0.03 s"]["q"]
    assert not np.allclose(q, v, rtol=1e-5, atol=0)


def test_motor_gives_what_drives_the_reference(solution: flexinv.Solution) -> None:
    """0.033 N m within 1e-6 at every sample; the quintic spline through samples of 20 us leaves 6e-8 of it."""
    assert len(solution.time) == 301
    assert solution.torque_names == ("beta",)
    assert np.abs(solution.torque[:, 0] - DRIVE).max() < 1e-6
    assert np.abs(solution.unactuated).max() < 1e-9 * DRIVE  # rounding of forces of 300 N at arms of 0.07 m


def test_passive_joints_move_as_in_the_reference(solution: flexinv.Solution, truth: andrews.Series) -> None:
    """Positions follow from K1's to rounding; rates and accelerations as accurate as the spline's."""
    for ours, theirs, accuracy in (
        (solution.q, truth.q, 1e-13),  # both are closed to 1e-15 m of links from 0.007 m
        (solution.qd, truth.v, 1e-9),  # h^5 of the spline
        (solution.qdd, truth.a, 1e-6),  # h^4 of the spline
    ):
        exact = at_samples(theirs)
        scale = np.abs(exact).max(axis=0)
        assert np.all(np.abs(joints(solution, ours) - exact).max(axis=0) < accuracy * np.maximum(scale, 1.0))


def test_published_state_is_met(solution: flexinv.Solution) -> None:
    published = andrews.DATA["at 0.03 s"]
    assert np.allclose(joints(solution, solution.q)[-1], published["q"], rtol=1e-7, atol=0)
    assert np.allclose(joints(solution, solution.qd)[-1], published["v"], rtol=1e-7, atol=0)
    assert np.allclose(joints(solution, solution.qdd)[-1], published["a"], rtol=3e-6, atol=0)


def reactions(solution: flexinv.Solution) -> Array:
    """(samples, 6) world forces on K3, K4 and K6 at E: closures give them in the second link's axes."""
    assert solution.loops is not None
    parts = []
    for link, angle in (("K3", ("gamma",)), ("K4", ("delta", "Phi")), ("K6", ("epsilon", "Omega"))):
        turned = sum(solution.q[:, solution.mechanism.velocity_names.index(name)] for name in angle)
        fx, fy = solution.loops.reaction[f"E_{link}"][:, :2].T
        parts += [np.cos(turned) * fx - np.sin(turned) * fy, np.sin(turned) * fx + np.cos(turned) * fy]
    return np.stack(parts, axis=1)


def test_closure_reactions_are_the_multipliers(solution: flexinv.Solution, truth: andrews.Series) -> None:
    """g = E of K2 - E of the others, M a + G^T lambda = f: lambda is the force on K3, K4 and K6, up to 300 N."""
    exact = at_samples(truth.lam)
    assert np.abs(reactions(solution) - exact).max() < 1e-6 * np.abs(exact).max()  # as the accelerations
    assert np.allclose(reactions(solution)[-1], andrews.DATA["at 0.03 s"]["lam"], rtol=3e-6, atol=0)


def test_pins_carry_nothing_out_of_the_plane(solution: flexinv.Solution) -> None:
    """The redundant rows are left at zero (least norm), and the ball's moment is none."""
    assert solution.loops is not None
    for wrench in solution.loops.reaction.values():
        assert np.abs(wrench[:, 2:]).max() < 1e-12 * np.abs(wrench).max()  # rounding


def test_power_of_the_motor_and_the_spring_balances(solution: flexinv.Solution) -> None:
    """Motor's work = kinetic energy + spring energy gained, from rest: the spline's error of the torque times the turn."""
    work = DRIVE * (solution.q[-1, 0] - solution.q[0, 0])
    angle = solution.q[[0, -1], solution.mechanism.velocity_names.index("gamma")]
    d = np.stack(
        [
            andrews.P["xb"] + 0.02 * np.cos(angle) + 0.018 * np.sin(angle),
            andrews.P["yb"] + 0.02 * np.sin(angle) - 0.018 * np.cos(angle),
        ],
        axis=1,
    )
    stretch = np.linalg.norm(d - [andrews.P["xc"], andrews.P["yc"]], axis=1) - andrews.P["l0"]
    spring = 0.5 * andrews.P["c0"] * (stretch[1] ** 2 - stretch[0] ** 2)
    q, v = joints(solution, solution.q)[-1], joints(solution, solution.qd)[-1]
    assert 0.5 * v @ andrews.mass_matrix(q) @ v + spring == pytest.approx(work, rel=1e-8)  # rates are good to 1e-9


def test_one_freedom_and_three_redundant_constraints(solution: flexinv.Solution) -> None:
    mobility = compute_mobility(solution.mesh, solution.q[0])
    assert vars(mobility) == {"freedoms": 1, "constraints": 9, "redundant": 3}


def test_the_case_file_is_this_motion(squeezer: tuple[Mechanism, Case], truth: andrews.Series) -> None:
    """beta.csv holds the reference to 1e-14 of a radian in 16."""
    mechanism, case = squeezer
    assert case.end == END
    q, _, _ = case.motion.evaluate(mechanism, truth.time)
    assert (
        np.abs(q[:, mechanism.velocity_names.index("beta")] - truth.q[:, 0]).max() < 1e-11
    )  # two machines' integration
