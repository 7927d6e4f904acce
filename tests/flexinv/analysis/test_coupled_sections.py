"""Coupled sections against what is exact: cantilevers, helices, frequencies, rotors, and one beam about several axes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize
from coupled_beams import (
    BEND_TWIST,
    DIAGONAL,
    E1,
    EXTENSION_TWIST,
    cantilever,
    compute_frequency_function,
    couple,
    find_linear_tip,
    full,
    mass_about,
    section,
    turned_about_x,
)
from flexible_examples import TREE_MOTION, spatial_tree

import flexinv
from flexinv import Load
from flexinv.elements.beam_law import build_beam_laws
from flexinv.kernels.so3 import exp_so3, log_so3, tangent3
from flexinv.linearized.linear_model import linear_model
from flexinv.linearized.natural_modes import natural_modes
from flexinv.linearized.steady_modes import steady_modes
from flexinv.model.mechanism import Beam, Joint, Link, Mechanism, Placement, Section
from flexinv.typing import Array

LENGTH = 0.8
# Half the difference of the answers to a load and to its opposite has no quadratic part; the cubic one is strains squared,
# 1e-10 of it at strains of 1e-5, and rounding is 1e-16 over 1e-5.
SMALL = 1e-5
EXACT = 1e-8
FLUTTERS = pytest.mark.filterwarnings("ignore:.*complex. flutter:flexinv.ModelWarning")
STIFFNESSES = {"bend-twist": BEND_TWIST, "extension-twist": EXTENSION_TWIST, "full": full()}


def find_small_tip(stiffness: Array, wrench: Array) -> Array:
    """Displacement and rotation of the tip for a unit of a small load."""
    beam = cantilever(section(stiffness), 6, length=LENGTH)
    tips = []
    for sign in (SMALL, -SMALL):
        s = flexinv.statics(beam, [Load("beam", force=sign * wrench[:3], moment=sign * wrench[3:])])
        turn = s.nodes.rotation[0, s.mesh.tip_node["beam"]]
        tips.append(np.concatenate([s.deflection["beam"][0], log_so3(turn)]))
    return np.asarray((tips[0] - tips[1]) / (2 * SMALL))


@FLUTTERS
@pytest.mark.parametrize("name", STIFFNESSES)
@pytest.mark.parametrize("component", range(6))
def test_small_loads_bend_and_twist_a_cantilever_as_linear_theory_has_it(name: str, component: int) -> None:
    wrench = np.eye(6)[component]
    exact = find_linear_tip(np.linalg.inv(STIFFNESSES[name]), wrench, LENGTH)
    np.testing.assert_allclose(
        find_small_tip(STIFFNESSES[name], wrench), exact, rtol=0, atol=EXACT * np.abs(exact).max()
    )


@FLUTTERS
@pytest.mark.parametrize(
    "wrong", [couple((3, 4, -0.4)), couple((3, 5, 0.4)), couple((0, 4, 0.4)), np.diag(DIAGONAL)],
    ids=["sign", "other bending", "other coupling", "none"],
)  # fmt: skip
def test_a_coupling_of_another_sign_or_place_is_seen(wrong: Array) -> None:
    wrench = np.array([0.0, 0.0, 1.0, 1.0, 1.0, 0.0])
    exact = find_linear_tip(np.linalg.inv(BEND_TWIST), wrench, LENGTH)
    assert np.abs(find_small_tip(wrong, wrench) - exact).max() > 1e-2 * np.abs(exact).max()


def test_a_transposed_block_is_seen() -> None:
    """Forces by curvatures in the place of moments by strains: symmetric again, but another beam."""
    c = full(3)
    wrong = c.copy()
    wrong[:3, 3:] = c[3:, :3]
    wrong[3:, :3] = c[:3, 3:]
    wrench = np.array([1.0, 2.0, -1.0, 0.3, 0.2, 0.1])
    exact = find_linear_tip(np.linalg.inv(c), wrench, LENGTH)
    assert np.abs(find_linear_tip(np.linalg.inv(wrong), wrench, LENGTH) - exact).max() > 1e-2 * np.abs(exact).max()
    np.testing.assert_allclose(find_small_tip(c, wrench), exact, rtol=0, atol=EXACT * np.abs(exact).max())


def find_helix(compliance: Array, pull: float, bend: float) -> tuple[Array, Array]:
    """Strain and resultants (6,) that are constant along a beam: R n and R m + x x R n stay, so n is along kappa, and

    kappa x m + (e1 + gamma) x n = 0,  n = pull kappa,  (gamma, kappa) = C^-1 (n, m),  |kappa| = bend
    """

    def evaluate(unknown: Array) -> Array:
        kappa = unknown[:3]
        resultants = np.concatenate([pull * kappa, unknown[3:]])
        strain = compliance @ resultants
        free = np.cross(kappa, unknown[3:]) + np.cross(E1 + strain[:3], pull * kappa)
        return np.concatenate([strain[3:] - kappa, free, [kappa @ kappa - bend**2]])

    start = np.linalg.eigh(compliance[3:, 3:])[1][:, -1] * bend
    guess = np.concatenate([start, np.linalg.solve(compliance[3:, 3:], start)])
    found = scipy.optimize.least_squares(evaluate, guess, xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert np.abs(found.fun).max() < 1e-12
    resultants = np.concatenate([pull * found.x[:3], found.x[3:]])
    return compliance @ resultants, resultants


@FLUTTERS
@pytest.mark.parametrize("pull", [0.0, 0.4])
@pytest.mark.parametrize("name", STIFFNESSES)
def test_an_end_wrench_makes_a_helix(name: str, pull: float) -> None:
    """A constant strain is an equilibrium far from the straight beam: x = H(s kappa)^T s (e1 + gamma), R = exp(s kappa)."""
    strain, resultants = find_helix(np.linalg.inv(STIFFNESSES[name]), pull, 2.0)
    turn = exp_so3(LENGTH * strain[3:])
    place = tangent3(LENGTH * strain[3:]).T @ (LENGTH * (E1 + strain[:3]))
    load = Load("beam", force=turn @ resultants[:3], moment=turn @ resultants[3:])
    s = flexinv.statics(cantilever(section(STIFFNESSES[name]), 8, 2, LENGTH), [load])
    assert np.abs(place - LENGTH * E1).max() > 0.05
    # two elements of order 8 interpolate an arc of 1.6 rad to 1e-12
    np.testing.assert_allclose(s.tip["beam"][0], place, rtol=0, atol=EXACT)
    np.testing.assert_allclose(s.nodes.rotation[0, s.mesh.tip_node["beam"]], turn, rtol=0, atol=EXACT)
    np.testing.assert_allclose(
        s.internal["beam"][0], np.tile(resultants, (16, 1)), atol=EXACT * np.abs(resultants).max()
    )


MASSES = {"on the axis": mass_about(0.0, 0.0, product=0.0), "off the axis": mass_about(0.03, -0.02)}


@pytest.mark.parametrize("mass", MASSES)
@pytest.mark.parametrize("name", STIFFNESSES)
def test_natural_frequencies_of_a_coupled_cantilever(name: str, mass: str) -> None:
    """Every one of the lowest six is a root of the exact equation (`compute_frequency_function`), to 1e-8."""
    own = section(STIFFNESSES[name], MASSES[mass])
    modes = natural_modes(cantilever(own, 14, length=LENGTH), count=6)
    for omega in 2 * np.pi * modes.frequency:
        ends = [
            compute_frequency_function(STIFFNESSES[name], MASSES[mass], LENGTH, omega * (1 + side * EXACT))
            for side in (-1, 1)
        ]
        assert ends[0] * ends[1] < 0.0


def test_frequencies_of_another_coupling_are_others() -> None:
    modes = natural_modes(cantilever(section(BEND_TWIST, MASSES["off the axis"]), 14, length=LENGTH), count=6)
    for stiffness, mass in ((couple((3, 4, -0.4)), mass_about(0.03, -0.02)), (BEND_TWIST, mass_about(0.03, 0.02))):
        signs = [
            [compute_frequency_function(stiffness, mass, LENGTH, omega * (1 + side * 1e-4)) > 0.0 for side in (-1, 1)]
            for omega in 2 * np.pi * modes.frequency
        ]
        assert any(low == high for low, high in signs)


def test_extension_and_torsion_swing_together() -> None:
    """Of C and M of the axial motion and the twist alone: frequencies (2 n - 1) / (4 L) sqrt(eigenvalues of M^-1 C)."""
    mass = MASSES["on the axis"]
    modes = natural_modes(cantilever(section(EXTENSION_TWIST, mass), 14, length=LENGTH))
    both = [0, 3]
    speeds = np.sqrt(scipy.linalg.eigvalsh(EXTENSION_TWIST[np.ix_(both, both)], mass[np.ix_(both, both)]))
    for wave in (1, 3):
        for speed in speeds:
            exact = wave * speed / (4 * LENGTH)
            assert np.abs(modes.frequency / exact - 1).min() < EXACT


def rotor(own: Section, order: int = 10) -> Mechanism:
    link = Link("blade", (), Beam(LENGTH, own, 1, order))
    return Mechanism("rotor", (link,), (Joint("hub", "revolute", "world", "blade"),), gravity=np.zeros(3))


def test_a_turning_beam_is_twisted_by_its_centrifugal_force() -> None:
    """With rho I_y = rho I_z no moment twists, so that c gamma + GJ kappa = 0, and the pull acts against E* = EA - c^2 / GJ:

    E* w'' + rho A W^2 w = 0 of the place w(s):  w = sin(k s) / (k cos(k L)),  k^2 = rho A W^2 / E*; twist -c / GJ (w(L) - L)
    """
    mass = mass_about(0.0, 0.0, product=0.0)
    mass[5, 5] = mass[4, 4]
    ea, gj, c = EXTENSION_TWIST[0, 0], EXTENSION_TWIST[3, 3], EXTENSION_TWIST[0, 3]
    rate = 6.0
    found = steady_modes(rotor(section(EXTENSION_TWIST, mass)), rates={"hub": rate}, count=2)
    k = np.sqrt(mass[0, 0] * rate**2 / (ea - c**2 / gj))
    end = np.sin(k * LENGTH) / (k * np.cos(k * LENGTH))
    tip = found.mesh.tip_node["blade"]
    twist = -c / gj * (end - LENGTH)
    assert end > 1.02 * LENGTH
    assert abs(twist) > 0.05
    np.testing.assert_allclose(found.position[tip], [end, 0.0, 0.0], rtol=0, atol=EXACT)
    np.testing.assert_allclose(log_so3(found.orientation[tip]), [twist, 0.0, 0.0], rtol=0, atol=EXACT)


def moved_tree(own: Section, y: float, z: float, angle: float, order: int) -> Mechanism:
    """`spatial_tree` with a straight boom of one section, described about another axis; joints and bodies stay where they are."""
    tree = spatial_tree()
    there = Placement(np.array([0.0, y, z]), turned_about_x(angle))
    links = []
    for link in tree.links:
        if link.beam is None:
            links.append(link)
            continue
        root = join(link.beam.placement, there)
        beam = Beam(link.beam.length, own.move_axis(y, z, angle), 2, order, placement=root)
        body = link.bodies[0]
        com = there.rotation.T @ (body.inertia.com - there.position)
        tensor = there.rotation.T @ body.inertia.tensor @ there.rotation
        inertia = replace(body.inertia, com=com, tensor=tensor)
        links.append(replace(link, beam=beam, bodies=(replace(body, inertia=inertia),)))
    back = Placement(-there.rotation.T @ there.position, there.rotation.T)
    joints = [
        replace(joint, station=1.0 if joint.station is None else joint.station, placement=join(back, joint.placement))
        if joint.parent == "boom"
        else joint
        for joint in tree.joints
    ]
    return replace(tree, links=tuple(links), joints=tuple(joints))


def join(a: Placement, b: Placement) -> Placement:
    return Placement(a.position + a.rotation @ b.position, a.rotation @ b.rotation)


COUPLED = section(full(2), mass_about(0.004, -0.006, 0.06, 1e-5) * 1.0, 2e-4 * full(5))


def with_section_of_the_first_axis(mechanism: Mechanism) -> Mechanism:
    """The machine in which only the section was not moved to its new axis."""

    def change(link: Link) -> Link:
        return link if link.beam is None else replace(link, beam=replace(link.beam, section=COUPLED))

    return replace(mechanism, links=tuple(map(change, mechanism.links)))


def test_a_section_turned_about_its_axis_is_the_same_machine() -> None:
    """Every strain and every interpolation is turned: rounding is left, which a motion of 50 steps carries along."""
    turned = moved_tree(COUPLED, 0.0, 0.0, 0.7, 5)
    a, b, wrong = (
        flexinv.solve(m, TREE_MOTION, 2e-3, end=0.1, initial="static")
        for m in (moved_tree(COUPLED, 0.0, 0.0, 0.0, 5), turned, with_section_of_the_first_axis(turned))
    )
    size = np.abs(a.torque).max(axis=0)
    assert (np.abs(a.torque - b.torque) / size).max() < 1e-9
    assert (np.abs(a.torque - wrong.torque) / size).max() > 1e-3


def test_a_section_about_another_axis_is_the_same_machine() -> None:
    """Another axis is interpolated in another way: in two elements of order 6 nothing of that is left."""
    moved = moved_tree(COUPLED, 0.012, -0.008, -0.4, 6)
    base, other, wrong = (moved_tree(COUPLED, 0.0, 0.0, 0.0, 6), moved, with_section_of_the_first_axis(moved))
    load = {"link": "hand", "force": [0.0, 0.3, -0.2]}
    here, there, off = (flexinv.statics(m, [Load(**load)]) for m in (base, other, wrong))
    np.testing.assert_allclose(there.torque, here.torque, rtol=0, atol=EXACT * np.abs(here.torque).max())
    np.testing.assert_allclose(there.tip["hand"], here.tip["hand"], rtol=0, atol=EXACT)
    assert np.abs(off.tip["hand"] - here.tip["hand"]).max() > 1e-3
    first, second, third = (natural_modes(m, count=5).frequency for m in (base, other, wrong))
    np.testing.assert_allclose(second, first, rtol=EXACT)
    assert np.abs(third / first - 1.0).max() > 1e-3


def test_power_and_momentum_balance_of_a_coupled_machine() -> None:
    s = flexinv.solve(moved_tree(COUPLED, 0.0, 0.0, 0.0, 5), TREE_MOTION, 2e-3, initial="static")
    power = np.abs(s.torque_all * s.qd).max()
    assert np.abs(s.balance.dissipated).max() > 1e-6 * power
    assert np.abs(s.power_residual).max() < 1e-8 * power
    assert np.abs(s.momentum_residual).max() < 1e-8 * np.abs(s.wrench["slew"]).max()


def swing(rate: float = 1.0) -> flexinv.Motion:
    return flexinv.Motion.point_to_point([0.0], [rate], 0.2, hold=0.1)


def test_a_free_swing_keeps_its_energy() -> None:
    """Without drives and damping kinetic and elastic energy and that of gravity stay together, up to the step's square."""
    beam = Beam(LENGTH, section(full(2), MASSES["off the axis"]), 1, 4)
    pin = Joint("pin", "revolute", "world", "beam", axis=np.array([0.0, 1.0, 0.0]), actuated=False)
    m = Mechanism("pendulum", (Link("beam", (), beam),), (pin,), gravity=np.array([0.0, 0.0, -9.81]))
    drifts = []
    for step in (2e-3, 1e-3):
        s = flexinv.simulate(m, [0.0, 0.2], step=step, spectral_radius=1.0)
        total = s.balance.kinetic + s.balance.elastic + s.balance.potential
        drifts.append(np.ptp(total) / np.ptp(s.balance.potential))
    assert drifts[1] < 1e-4
    assert drifts[0] / drifts[1] == pytest.approx(4.0, rel=0.2)


def test_a_linear_model_has_the_frequencies_of_the_beam() -> None:
    own = cantilever(section(full(), MASSES["off the axis"], 1e-3 * full(4)), 6, length=LENGTH)
    hinged = replace(own, joints=(replace(own.joints[0], kind="revolute"),))
    modes = steady_modes(hinged, free=(), count=4)
    poles = linear_model(hinged, free=(), modes=None).poles
    for root in modes.root:
        assert np.abs(poles - root).min() < 1e-8 * abs(root)
    assert (modes.damping_ratio > 1e-4).all()


def test_many_scenarios_are_those_of_one_at_a_time() -> None:
    """Coupled in the plane, of one structure and not: beside one another as alone."""
    in_plane = [couple((0, 5, part), (1, 5, 0.2)) for part in (0.2, -0.3)]
    machines = [
        rotor(section(c, mass_about(0.02, 0.0, product=0.0)), 4) for c in [*in_plane, np.diag(DIAGONAL), full()]
    ]
    many = flexinv.solve_many(machines, swing(), 2e-3)
    for m, together in zip(machines, many.solutions, strict=True):
        alone = flexinv.solve(m, swing(), 2e-3)
        np.testing.assert_allclose(together.torque, alone.torque, rtol=0, atol=1e-12 * np.abs(alone.torque).max())


def test_an_accuracy_is_kept() -> None:
    machine = rotor(section(full(), MASSES["off the axis"], 2e-3 * full()), 4)
    asked = flexinv.solve(machine, swing(), accuracy=1e-3)
    fine = flexinv.solve(machine.with_mesh(2, 8), swing(), 2.5e-4)
    exact = np.interp(asked.time, fine.time, fine.torque[:, 0])
    span = np.ptp(exact)
    assert asked.torque_error is not None
    assert asked.torque_error.max() < 1e-3 * span
    assert np.abs(asked.torque[:, 0] - exact).max() < 1e-3 * span


def test_equal_matrices_are_equal_sections_and_nobody_can_write_to_them() -> None:
    import copy
    import pickle

    one = section(full(), MASSES["off the axis"])
    for twin in (section(full(), MASSES["off the axis"]), copy.deepcopy(one), pickle.loads(pickle.dumps(one))):
        assert twin == one
        assert hash(twin) == hash(one)
    assert section(full(1), MASSES["off the axis"]) != one
    assert section(full(), MASSES["on the axis"]) != one
    with pytest.raises(ValueError, match="read-only"):
        one.stiffness[0, 0, 3] = 0.0


def test_the_law_is_what_python_and_kernels_have_in_common() -> None:
    """Stress resultants along a bent beam are those that the law makes of the strains of its helix."""
    own = section(full())
    strain, resultants = find_helix(np.linalg.inv(full()), 0.4, 2.0)
    (law,) = build_beam_laws(own)
    np.testing.assert_allclose(law.resultants(strain), resultants, rtol=1e-12)
    np.testing.assert_allclose(law.tangent(strain), full(), rtol=1e-15)
    several = np.stack([strain, 2.0 * strain])
    np.testing.assert_allclose(law.resultants(several), np.stack([resultants, 2.0 * resultants]), rtol=1e-12)
    assert law.tangent(several).shape == (2, 6, 6)
    (plain,) = build_beam_laws(section(np.diag(DIAGONAL)))
    assert plain.coupling is None
    np.testing.assert_array_equal(plain.resultants(strain), DIAGONAL * strain)
