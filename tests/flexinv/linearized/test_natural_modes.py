"""Natural frequencies: exact beams, pendulums, loops, and what gravity and forces in closures do to them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flexible_examples import STRIP, spatial_tree
from kernels import derivative
from scipy.linalg import lu_factor, lu_solve
from scipy.optimize import brentq
from scipy.sparse import csc_array
from vibrating_beams import CLAMPED, PINNED, ROWS, cantilever, in_plane, pendulum, rod, thin

from flexinv.dynamics.solver import Solver
from flexinv.errors import InputError
from flexinv.files.load_mechanism import load_mechanism
from flexinv.kinematics.mesh import build
from flexinv.linearized import modes as modes_module
from flexinv.linearized import rest_position as module
from flexinv.linearized.eigenvalues import SOFT, _find_inverse_roots, find_undamped_modes
from flexinv.linearized.linear_model import linear_model
from flexinv.linearized.modes import compute_frequency_rounding
from flexinv.linearized.natural_modes import natural_modes
from flexinv.linearized.rest_position import compute_tip_displacements
from flexinv.linearized.steady_modes import steady_modes
from flexinv.model.mechanism import (
    WORLD,
    Attachment,
    Beam,
    Body,
    Closure,
    Inertia,
    Joint,
    Link,
    Mechanism,
    Placement,
)
from flexinv.typing import Array

EPS = np.finfo(float).eps
# What two elements of order 8 leave of the fourth frequency of the stockiest beam (measured 1e-7 there, less elsewhere).
SPECTRAL = 1e-6
G = 9.81


@pytest.mark.parametrize("thickness", sorted({row["h_m"] for row in ROWS}))
def test_timoshenko_cantilevers(thickness: str) -> None:
    rows = [row for row in ROWS if row["h_m"] == thickness]
    modes = natural_modes(cantilever(rows[0]))
    exact = [float(row["f_Timoshenko_Hz"]) for row in rows]
    assert len(exact) == 4
    np.testing.assert_allclose(modes.frequency[in_plane(modes)][:4], exact, rtol=SPECTRAL)


def test_bending_without_shear_is_another_table() -> None:
    """The same check refuses the table's other column, Euler and Bernoulli's."""
    rows = [row for row in ROWS if row["h_m"] == "0.1"]
    modes = natural_modes(cantilever(rows[0]))
    exact = np.array([float(row["f_EB_Hz"]) for row in rows])
    assert (np.abs(modes.frequency[in_plane(modes)][:4] / exact - 1) > 5e-3).all()


@pytest.mark.parametrize(("kind", "root"), [("fixed", CLAMPED), ("revolute", PINNED)])
def test_a_closure_at_the_tip_holds_the_beam(kind: str, root: float) -> None:
    end = Attachment(WORLD, Placement(np.array([1.0, 0.0, 0.0])))
    modes = natural_modes(thin((Closure("end", kind, end, Attachment("beam", Placement(), 1.0)),)))
    # GA = 1e9 of EI / L^2: shear lowers the frequency by 1e-8
    assert np.sqrt(modes.squared[in_plane(modes)[0]]) == pytest.approx(root**2, rel=SPECTRAL)
    moves = np.concatenate([modes.displacement, modes.rotation], axis=2)
    assert (
        np.abs(compute_tip_displacements(modes.mesh, moves, modes.orientation)["beam"]).max()
        < 1e-10 * np.abs(modes.displacement).max()
    )


def test_a_rod_swings_about_its_end() -> None:
    modes = natural_modes(pendulum(1), free=["q0"])
    np.testing.assert_allclose(modes.squared, 1.5 * G / 0.5, rtol=10 * EPS)
    assert modes.link == ("rod 0",)
    upright = natural_modes(pendulum(1), q=[np.pi], free=["q0"])
    np.testing.assert_allclose(
        upright.squared, -1.5 * G / 0.5, rtol=1e-9
    )  # the shift that makes K definite takes digits
    assert np.isnan(upright.frequency).all()


def test_a_double_pendulum_has_the_textbook_frequencies() -> None:
    """M = m l^2 [[4/3, 1/2], [1/2, 1/3]], K = m g l [[3/2, 0], [0, 1/2]] in absolute angles, m l^2 = 0.3."""
    mass, stiffness = np.array([[4 / 3, 1 / 2], [1 / 2, 1 / 3]]), np.diag([1.5, 0.5])
    exact = np.sort(np.linalg.eigvals(np.linalg.solve(mass, stiffness))) * G / 0.5
    np.testing.assert_allclose(natural_modes(pendulum(2), free=["q0", "q1"]).squared, exact, rtol=100 * EPS)


R, BAR, M_ROD, M_BAR = 0.4, 0.7, 0.6, 1.5


def swing(gap: float = BAR, gravity: float = G) -> Mechanism:
    """A bar on two equal rods that hang from pivots ``gap`` apart (x is down)."""
    links = rod("left", R, M_ROD), rod("bar", BAR, M_BAR), rod("right", R, M_ROD)
    turned = Placement(np.array([R, 0.0, 0.0]), np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    joints = (
        Joint("a", "revolute", WORLD, "left", actuated=False),
        Joint("b", "revolute", "left", "bar", turned, actuated=False),
        Joint("c", "revolute", WORLD, "right", Placement(np.array([0.0, gap, 0.0])), actuated=False),
    )
    ends = (Attachment(name, Placement(np.array([x, 0.0, 0.0]))) for name, x in (("bar", BAR), ("right", R)))
    return Mechanism("swing", links, joints, np.array([gravity, 0.0, 0.0]), (Closure("d", "revolute", *ends),))


def by_hand(gap: float) -> tuple[float, float]:
    """omega^2 [1/s^2] of the swing from its energies as functions of the left rod's angle, and that angle at rest."""
    rest = np.arcsin((gap - BAR) / 2 / R)

    def places(h: float) -> Array:
        a = rest + h
        left = R * np.array([np.cos(a), np.sin(a)])

        def far(c: float) -> float:
            return float(np.hypot(R * np.cos(c) - left[0], gap + R * np.sin(c) - left[1])) - BAR

        c = brentq(far, h - rest - 0.3, h - rest + 0.3, xtol=1e-15)
        right = np.array([R * np.cos(c), gap + R * np.sin(c)])
        return np.array([a, c, np.arctan2(*(right - left)[::-1]), *(left + right) / 2])

    rate = derivative(places)
    mass = M_ROD * R**2 / 3 * (rate[0] ** 2 + rate[1] ** 2) + M_BAR * (BAR**2 / 12 * rate[2] ** 2 + rate[3:] @ rate[3:])

    def weight(h: float) -> Array:
        a, c, _, x, _ = places(h)
        return np.array(-G * (M_ROD * R / 2 * (np.cos(a) + np.cos(c)) + M_BAR * x))

    return float(derivative(lambda h: derivative(lambda k: weight(h + k))) / mass), float(rest)


@pytest.mark.parametrize("gap", [BAR, 0.5, 1.0])
def test_a_swing_is_a_loop_that_gravity_stiffens(gap: float) -> None:
    exact, rest = by_hand(gap)
    modes = natural_modes(swing(gap), q=[rest, -rest, -rest])
    assert modes.free == ("a", "b", "c")
    # the second difference of an energy of some J known to 1e-16, over steps of 1e-3
    np.testing.assert_allclose(modes.squared, exact, rtol=1e-9)


def test_half_of_the_bar_hangs_on_the_closure(monkeypatch: pytest.MonkeyPatch) -> None:
    exact, rest = by_hand(0.5)
    monkeypatch.setattr(module, "compute_tie_stiffness", lambda solver, joints: 0.0)
    assert abs(natural_modes(swing(0.5), q=[rest, -rest, -rest]).squared[0] / exact - 1) > 0.04
    parallel = G * (M_ROD + M_BAR) / (R * (M_ROD * 2 / 3 + M_BAR))  # where the bar does not turn
    assert by_hand(BAR)[0] == pytest.approx(parallel, rel=1e-9)


def test_nothing_holds_a_swing_without_gravity() -> None:
    assert abs(natural_modes(swing(gravity=0.0)).squared[0]) < 1e-9


def hanging(count: int) -> Mechanism:
    """Rods on ball joints, a metre of 1 kg in all: each spins about itself without stiffness."""
    length, mass = 1.0 / count, 1.0 / count
    tensor = mass * length**2 / 12 * np.diag([1e-3, 1.0, 1.0])
    bodies = (Body("rod", Inertia(mass, np.array([length / 2, 0.0, 0.0]), tensor)),)
    links = tuple(Link(f"rod {k}", bodies) for k in range(count))
    joints = tuple(
        Joint(f"q{k}", "spherical", WORLD if k == 0 else f"rod {k - 1}", f"rod {k}",
              Placement(np.array([length if k else 0.0, 0, 0]))) for k in range(count)
    )  # fmt: skip
    return Mechanism("chain", links, joints, gravity=np.array([G, 0.0, 0.0]))


@pytest.mark.slow
@pytest.mark.parametrize("count", [3, 10, 20, 40])
def test_a_chain_of_ball_joints_swings_as_about_a_steady_motion(count: int) -> None:
    """Spins without stiffness, a third of all motions, take nothing from the others; 1e-7 of 40 links are left by both."""
    chain = hanging(count)
    free = [joint.name for joint in chain.joints]
    result, steady = natural_modes(chain, free=free), steady_modes(chain, free=free).frequency
    assert np.array_equal(result.frequency[:count], np.zeros(count))
    np.testing.assert_allclose(result.frequency[count:], steady[steady > 0.0], rtol=1e-6)
    model = linear_model(chain, free=free)
    roots = np.sort(abs(np.linalg.eigvals(model.A).imag))[2 * count :: 2] / (2 * np.pi)
    np.testing.assert_allclose(roots, result.frequency[count:], rtol=1e-6)


def test_a_rigid_rotation_is_zero_and_no_instability(root: Path) -> None:
    """Negative by rounding it was nan, which says unstable; a real instability beside it still is."""
    for name in ("flex_one_link", "flex_two_link"):
        arm = load_mechanism(root / "models" / name)
        free = [joint.name for joint in arm.joints]
        modes = natural_modes(arm, free=free)
        assert np.array_equal(modes.frequency[: len(free)], np.zeros(len(free)))
        assert modes.frequency[len(free)] > 10.0
    arm = load_mechanism(
        root / "models" / "spatial_arm"
    )  # its second joint lifts it: it lies, and falls to either side
    modes = natural_modes(arm, free=[joint.name for joint in arm.joints])
    assert np.isnan(modes.frequency).tolist()[:3] == [True, False, False]
    assert modes.frequency[1] == 0.0


def test_damping_leaves_what_solvers_share_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """A mechanism's topology is kept for all solvers: friction is no damping here, and stays in it all the while."""
    dry = pendulum(2)
    dry = replace(dry, joints=tuple(replace(joint, friction=0.3) for joint in dry.joints))
    solver = Solver.build_for(build(dry), {"q0", "q1"})
    shared, seen, tied = solver.topology.drives[2], [], module.compute_tied_matrices

    def watched(own: Solver, joints: module.Joints) -> module.Matrices:
        seen.append((shared.max(), own.topology.drives[2].max()))
        return tied(own, joints)

    monkeypatch.setattr(module, "compute_tied_matrices", watched)
    assert (
        abs(module.compute_rest_matrices(solver, module.find_rest_position(solver, np.zeros(2))[0]).damping).max()
        == 0.0
    )
    assert seen[-1] == (0.3, 0.0)
    assert shared.max() == 0.3


def test_modes_are_orthonormal_in_the_masses() -> None:
    modes = natural_modes(spatial_tree(), q=[0.2, 0.3, -0.4, 0.01])
    mesh, rotation = modes.mesh, modes.rotation
    kinetic = np.einsum("n,ank,bnk->ab", mesh.mass, modes.displacement, modes.displacement)  # (mode, mode)
    kinetic += np.einsum("ani,nij,bnj->ab", rotation, mesh.inertia, rotation)
    lowest = slice(10)  # the eigensolver is exact for the lowest; the highest, 1e4 times theirs, lose 1e8 roundings
    np.testing.assert_allclose(kinetic[lowest, lowest], np.eye(10), atol=1e-10)
    assert (np.diff(modes.squared) > 0).all()


def test_a_weight_at_the_tip_lowers_the_frequency_as_it_presses() -> None:
    """A beam upright under a tip mass: the first frequency falls with gravity, about as 1 - load / buckling load."""
    body = Body("ball", Inertia(0.3), 1.0)
    joint = Joint("root", "fixed", WORLD, "mast")
    mast = Mechanism("mast", (Link("mast", (body,), Beam(0.4, STRIP, 2, 6)),), (joint,))
    lowest = [natural_modes(replace(mast, gravity=np.array([g, 0.0, 0.0]))).squared[0] for g in (0.0, -G, G)]
    load = (0.3 + 0.37 * 0.4 * 0.056) * G / (np.pi**2 * 0.46 / (4 * 0.4**2))  # beam's own weight: 0.37 of it (Rayleigh)
    # the slope goes from 2/5 (static shape, no load) to 4 / pi^2 (buckling shape), 1.3 %; as much for the beam's own weight
    np.testing.assert_allclose(np.array(lowest[1:]) / lowest[0] - 1, [-load, load], rtol=0.026)


def test_what_cannot_be_is_said() -> None:
    with pytest.raises(InputError, match=r"nothing of 'pendulum' can move.*free=\[\.\.\.\] with names of q0, q1"):
        natural_modes(pendulum(2))
    with pytest.raises(InputError, match="free joint 'q7': 'pendulum' moves by q0"):
        natural_modes(pendulum(1), free=["q7"])
    with pytest.raises(InputError, match=r"expected \(1,\) finite numbers"):
        natural_modes(pendulum(1), q=[0.0, 1.0])
    bare = replace(pendulum(1), links=(Link("rod 0", ()),))
    with pytest.raises(InputError, match="neither inertia nor stiffness"):
        natural_modes(bare, free=["q0"])


# By how much the slow one of the motions below leans on eight others.  That changes omega^2 by some of its squares, 1e-9, and
# gives stiffness of 0.1 to the first freedom, of which rounding, 1e-17, is a part of 1e-9 of the slow one's 1e-8.
LEAN, LEANING = 1e-5, 1e-8


@pytest.mark.parametrize("seed", range(6))
def test_a_motion_that_has_next_to_no_stiffness_costs_no_other_one(seed: int) -> None:
    """By 1 / omega^2 alone, 1e17 apart, the fastest are lost: up to 80 % of omega^2, or as a whole where rounding is negative."""
    dice = np.random.default_rng(seed)
    exact = np.array([1e-8, 2.3e4, 6.4e4, 8e5, 2.4e6, 1.1e7, 8.9e7, 1.2e8, 9.7e8])
    stiffness = np.zeros((9, 9))
    turn = np.linalg.qr(dice.normal(size=(8, 8)))[0]
    stiffness[1:, 1:] = turn @ np.diag(exact[1:]) @ turn.T
    stiffness[0, 0] = exact[0]
    leaning = np.eye(9)
    leaning[1:, 0] = LEAN * dice.normal(size=8)
    squared, shapes = find_undamped_modes(csc_array(leaning.T @ stiffness @ leaning), csc_array(np.eye(9)))
    np.testing.assert_allclose(squared, exact, rtol=LEANING)
    np.testing.assert_allclose(shapes.T @ shapes, np.eye(9), rtol=0, atol=LEANING)


def test_a_stiffness_that_rounding_makes_indefinite_is_still_looked_at() -> None:
    """The slowest root of three is lost in rounding of the others, and one shift shows all to its own size."""
    values, vectors, shift = _find_inverse_roots(np.diag([1.0, -1e-18, 4.0]), np.eye(3))
    assert 0.0 < shift <= 10.0 * SOFT * 4.0
    np.testing.assert_allclose(np.sort(1.0 / values - shift), [0.0, 1.0, 4.0], rtol=0, atol=8.0 * EPS)
    np.testing.assert_allclose(np.abs(vectors[1]).max() ** 2, values.max(), rtol=8.0 * EPS)


@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="long double is no longer than double here")
def test_slow_modes_are_those_of_the_stiffness_to_its_rounding(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Inverse iteration with residuals in long double on the same K and M: both agree to the stated bars, 1e-9 and less.

    A slow mode of springs that hold stiff strips is 1e-12 of the fastest: factors of K alone gave it to 1e-7.
    """
    seen: list[csc_array] = []

    def find(stiffness: csc_array, mass: csc_array) -> tuple[Array, Array]:
        seen.extend((stiffness, mass))
        return find_undamped_modes(stiffness, mass)

    monkeypatch.setattr(modes_module, "find_undamped_modes", find)
    arm = load_mechanism(root / "models" / "quanser_2dsfl")
    modes = natural_modes(arm, count=1, free=["clamp1", "clamp2"])
    k, m = (part.toarray().astype(np.longdouble) for part in seen)
    factors = lu_factor(k.astype(float))
    x = np.ones(len(k), dtype=np.longdouble)
    for _ in range(12):
        right = m @ x / np.sqrt(x @ m @ x)
        x = np.zeros(len(k), dtype=np.longdouble)
        for _ in range(8):  # each leaves a thousandth of what was left
            x += lu_solve(factors, (right - k @ x).astype(float))
    exact = np.sqrt((x @ k @ x) / (x @ m @ x)) / (2 * np.pi)
    known = compute_frequency_rounding(modes)[0] / modes.frequency[0]
    assert 1e-10 < known < 1e-8
    assert abs(float(modes.frequency[0] / exact) - 1.0) < known
