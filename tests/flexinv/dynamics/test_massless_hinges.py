"""Hinges where nothing has inertia: solved where something else determines the motion, an error that names them where not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import flexinv
from flexinv.analysis import trajectory
from flexinv.analysis.controller import Controller
from flexinv.dynamics.idle_joints import find_idle
from flexinv.kinematics.mesh import build

BEAM = """
title = "A beam that is driven, and what hangs at its tip"
source = "made for this test"
gravity_m_per_s2 = [0, {gravity}, 0]

[sections.s]
EA_N = 1e6
GA_N = 1e6
GJ_Nm2 = 50
EI_Nm2 = {{ y = 50, z = 20 }}
mass_per_length_kg_per_m = 1
rho_I_kgm = {{ y = {rho_I}, z = {rho_I}, x = 1e-3 }}

[links.b]
kind = "beam"
length_m = 1
section = "s"

[joints.j]
kind = "revolute"
parent = "world"
child = "b"
axis = [0, 0, 1]

[links.c]
kind = "rigid"
mass_kg = 0.3
rod = {{ length_m = 0.3 }}
"""
HINGE = """
[joints.{name}]
kind = "revolute"
parent = "{parent}"
child = "{child}"
axis = [0, 0, 1]
actuated = false
"""
BETWEEN = '[links.m]\nkind = "rigid"\nmassless = true\n'
SPRING = "stiffness_Nm_per_rad = 3\n"
MOTION = flexinv.Motion.point_to_point({"j": 0.0}, {"j": 1.0}, duration=0.3)
STEP = 1e-3
# A rotary inertia that stands for none [kg m], 2e-8 of what the arm has about its joint, and what it changes twice by its double.
SMALL = 1e-8
SAME = 5e-11  # what is left of their squares, and rounding: 1e-11
# Rounding of the equilibrium that the march begins with turns so light a section in the first steps: 2e-8 of the range of the
# rates, half as much at half the step, and another number with another library of linear algebra.
SAME_RATE = 1e-7


CASES = [(0.0, SPRING, "consistent"), (0.0, "", "consistent"), (-9.81, "", "static")]


def loaded(folder: Path, text: str) -> flexinv.Mechanism:
    folder.mkdir()
    (folder / "mechanism.toml").write_text(text, encoding="utf-8")
    return flexinv.load_mechanism(folder)


def single(folder: Path, rho_I: float, gravity: float, spring: str) -> flexinv.Mechanism:
    hinge = HINGE.format(name="p", parent="b", child="c") + "station = 1.0\n" + spring
    return loaded(folder, BEAM.format(rho_I=rho_I, gravity=gravity) + hinge)


def double(folder: Path, springs: str) -> flexinv.Mechanism:
    first = HINGE.format(name="p", parent="b", child="m") + "station = 1.0\n" + springs
    second = HINGE.format(name="p2", parent="m", child="c") + springs
    return loaded(folder, BEAM.format(rho_I=0, gravity=0) + BETWEEN + first + second)


@pytest.mark.reported("D4")
@pytest.mark.parametrize("in_space", [False, True])
@pytest.mark.parametrize(("gravity", "spring", "initial"), CASES)
def test_hinge_on_a_section_without_rotary_inertia(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, gravity: float, spring: str, initial: str, in_space: bool
) -> None:
    """Torque, hinge angle and rate are those of a rotary inertia that vanishes, drawn from two small ones."""
    if in_space:
        monkeypatch.setattr(trajectory, "build_planar_march", lambda mesh, passive: None)
    result = []
    for name, rho_I in (("none", 0.0), ("small", SMALL), ("twice", 2.0 * SMALL)):
        mechanism = single(tmp_path / name, rho_I, gravity, spring)
        start = {"p": -np.pi / 2} if initial == "static" else None
        result.append(flexinv.solve(mechanism, MOTION, STEP, initial=initial, start=start))
    none, small, twice = result
    for name, most in (("torque", SAME), ("q", SAME), ("qd", SAME_RATE)):
        vanished = 2.0 * getattr(small, name) - getattr(twice, name)
        assert np.abs(getattr(none, name) - vanished).max() < most * np.abs(vanished).max()


def test_springs_in_series(tmp_path: Path) -> None:
    """Two coincident hinges with a massless link between are one hinge of half the stiffness, each with half the angle."""
    two = flexinv.solve(double(tmp_path / "two", SPRING.replace("3", "6")), MOTION, STEP)
    one = flexinv.solve(single(tmp_path / "one", 0.0, 0.0, SPRING), MOTION, STEP)
    # Both marches stop where increments are rounding, of accelerations 1e-10 (see planar/test_solver.py).
    assert np.abs(two.torque - one.torque).max() < 1e-9 * np.abs(one.torque).max()
    for half in two.q[:, 1:].T:
        assert np.abs(2 * half - one.q[:, 1]).max() < 1e-9


@pytest.mark.reported("D4")
def test_idle_hinges_are_named(tmp_path: Path) -> None:
    """Without springs nothing says how the massless link between two hinges turns: by every entrance an error says so."""
    mechanism = double(tmp_path / "idle", "")
    reason = r"joints 'p' and 'p2' move against each other, and nothing resists that.*mass.*stiffness_Nm_per_rad"
    with pytest.raises(flexinv.ConvergenceError, match=reason):
        flexinv.solve(mechanism, MOTION, STEP)
    with pytest.raises(flexinv.ConvergenceError, match=reason):
        flexinv.simulate(mechanism, [0.0, 0.01], [[0.1], [0.1]], STEP)
    with pytest.raises(flexinv.ConvergenceError, match=reason):
        Controller.of(mechanism, STEP)


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning", "ignore:overflow:RuntimeWarning")
def test_masses_beyond_all_numbers_name_no_idle_joint(tmp_path: Path) -> None:
    """A mass of 1e308 kg, 100 m out, has an inertia that is no number: what resists cannot be said, and no error rises."""
    mechanism = double(tmp_path / "idle", "")
    (body,) = mechanism.links[-1].bodies
    heavy = replace(body, inertia=replace(body.inertia, mass=1e308, com=np.array([100.0, 0.0, 0.0])))
    links = (*mechanism.links[:-1], replace(mechanism.links[-1], bodies=(heavy,)))
    passive = frozenset({"p", "p2"})
    assert find_idle(build(mechanism), passive) == [["p", "p2"]]
    assert find_idle(build(replace(mechanism, links=links)), passive) == []


def test_only_idle_joints_are_named(tmp_path: Path) -> None:
    """A damper or a spring resists; a joint along a rod that turns nothing is named alone."""
    held = double(tmp_path / "held", SPRING)
    assert find_idle(build(held), frozenset({"p", "p2"})) == []
    damped = double(tmp_path / "damped", "damping_Nms_per_rad = 0.01\n")
    assert find_idle(build(damped), frozenset({"p", "p2"})) == []
    along = HINGE.format(name="z", parent="b", child="c").replace("[0, 0, 1]", "[1, 0, 0]") + "station = 1.0\n"
    rod = loaded(tmp_path / "rod", BEAM.format(rho_I=0, gravity=0) + along)
    assert find_idle(build(rod), frozenset({"z"})) == [["z"]]
    with pytest.raises(flexinv.ConvergenceError, match="joint 'z' moves, and nothing resists that"):
        flexinv.solve(rod, MOTION, STEP)
