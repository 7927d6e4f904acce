"""Residual vibration: the closed form is what the arm does after its end, and a shaper takes away what it says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import flexinv
from flexinv.errors import InputError
from flexinv.kinematics.mesh import build
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.linearized.residual_vibration import compute_residual_vibration
from flexinv.model.links import Body, Inertia, Link
from flexinv.model.mechanism import WORLD, Joint, Mechanism
from flexinv.model.motion import Motion

MODELS = Path(__file__).resolve().parents[3] / "models"
STEP = 2e-4  # [s]: the slowest mode of the arm has a period of 0.025 s


@pytest.fixture(scope="module")
def arm() -> Mechanism:
    return flexinv.load_mechanism(MODELS / "flex_one_link")


def _turn(angle: float, hold: float = STEP) -> Motion:
    return Motion.point_to_point({"hub": 0.0}, {"hub": angle}, 0.05, hold=hold)


def test_the_tip_goes_as_far_as_it_says_and_no_further(arm: Mechanism) -> None:
    """The arm rings for 1 s after a turn of 1 degree; its modes meet to 2 % within that time, and the march loses below 1 %."""
    angle = np.radians(1.0)
    ends = flexinv.solve(arm, _turn(angle), STEP, spectral_radius=1.0)
    found = ends.find_residual_vibration()
    rings = flexinv.solve(arm, _turn(angle, hold=1.0), STEP, spectral_radius=1.0)
    rest = 0.4 * np.array([np.cos(angle), np.sin(angle), 0.0])
    after = rings.time > 0.05
    distance = np.linalg.norm(rings.tip["link"][after] - rest, axis=1)
    assert distance.max() == pytest.approx(found.reach["link"], rel=0.03)
    assert distance.max() <= found.reach["link"] * 1.01
    energy = (rings.balance.kinetic + rings.balance.elastic + rings.balance.potential)[after]
    assert energy.mean() == pytest.approx(found.energy, rel=0.01)
    assert found.missed < 0.02  # a small motion: the tip bends by 3 mm in 0.4 m
    assert "ResidualVibration" in repr(found)
    assert found.frame()["energy [J]"].sum() == pytest.approx(found.energy)


def test_energy_in_space_is_what_the_arm_has_above_its_rest_under_gravity() -> None:
    """The tip swings by 0.065 m of 1 m: the energy differs by the square of the angles, below 1 %."""
    arm = flexinv.load_mechanism(MODELS / "spatial_arm")
    motion = Motion.point_to_point({"yaw": 0.0, "pitch": 0.1}, {"yaw": 0.2, "pitch": 0.3}, 0.3, hold=1e-3)
    ends = flexinv.solve(arm, motion, 1e-3, initial="static", spectral_radius=1.0)
    rest = flexinv.statics(arm, q=ends.q[-1])
    now, there = ((one.balance.kinetic + one.balance.elastic + one.balance.potential)[-1] for one in (ends, rest))
    assert ends.find_residual_vibration().energy == pytest.approx(now - there, rel=0.01)


def test_a_shaper_leaves_the_part_of_the_energy_that_it_says(arm: Mechanism) -> None:
    """ZV for a mode 5 % off the first: V^2 of its energy; 3 % for the small change of the frequency by the turn's rate."""
    angle = np.radians(1.0)
    motion = _turn(angle)
    plain = flexinv.solve(arm, motion, STEP, spectral_radius=1.0).find_residual_vibration()
    first = float(plain.modes.frequency[0])
    shaper = flexinv.make_shaper("ZV", 1.05 * first)
    shaped = flexinv.solve(arm, motion.shaped(shaper), STEP, spectral_radius=1.0).find_residual_vibration()
    part = shaped.energy_by_mode[0] / plain.energy_by_mode[0]
    assert part == pytest.approx(float(shaper.compute_vibration(first)) ** 2, rel=0.03)


def _put_on_a_spring(frequency: float) -> Mechanism:
    """A mass of 1 kg on a spring, on a cart that is driven: a frequency [Hz] and no other."""
    link = Link("mass", (Body("load", Inertia(1.0)),))
    along = np.array([1.0, 0.0, 0.0])
    drive = Joint("drive", "prismatic", WORLD, "cart", axis=along)
    spring = Joint(
        "spring", "prismatic", "cart", "mass", axis=along, actuated=False, stiffness=(2 * np.pi * frequency) ** 2
    )
    return Mechanism("cart", (Link("cart", (Body("cart", Inertia(1.0)),)), link), (drive, spring))


# Of a mode at r times the frequency, without damping (Singer and Seering 1990; Singhose, Derezinski and Singer 1996, EI of 5 %).
CURVES = {
    "ZV": lambda r: np.abs(np.cos(np.pi * r / 2)),
    "ZVD": lambda r: np.cos(np.pi * r / 2) ** 2,
    "EI": lambda r: np.abs(0.475 + 0.525 * np.cos(np.pi * r)),
}


@pytest.mark.parametrize("kind", CURVES)
def test_what_is_left_over_the_error_of_the_frequency_is_the_shapers_curve(kind: str) -> None:
    """Periods of a march in steps of 1/400 of one are off by 2e-5 (trapezoidal rule): phases of three by 4e-4."""
    shaper = flexinv.make_shaper(kind, 1.0, vibration=0.05) if kind == "EI" else flexinv.make_shaper(kind, 1.0)
    motion = Motion.point_to_point({"drive": 0.0}, {"drive": 1.0}, 0.35, hold=2.5e-3, law="nonic")
    for r in np.linspace(0.6, 1.4, 9):
        cart = _put_on_a_spring(r)
        shaped, plain = (
            _compute_amplitude(flexinv.solve(cart, one, 2.5e-3, spectral_radius=1.0), r)
            for one in (motion.shaped(shaper), motion)
        )
        assert shaped / plain == pytest.approx(CURVES[kind](r), abs=1e-3)


def _compute_amplitude(ends: flexinv.Solution, frequency: float) -> float:
    """How far the mass goes on swinging [m]."""
    return float(np.hypot(ends.q[-1, 1], ends.qd[-1, 1] / (2 * np.pi * frequency)))


def test_shape_motion_takes_the_modes_at_the_end(arm: Mechanism) -> None:
    motion = _turn(np.radians(1.0))
    shaped = flexinv.make_shaped_motion(arm, motion, "ZVD")
    assert shaped.motion == motion.shaped(shaped.shaper)
    assert shaped.frequency == pytest.approx(
        np.full((5, 1), shaped.frequency[0, 0]), rel=1e-9
    )  # one joint: the same everywhere
    assert shaped.vibration.max() < 1e-9
    left = flexinv.solve(arm, shaped.motion, STEP).find_residual_vibration()
    plain = flexinv.solve(arm, motion, STEP).find_residual_vibration()
    assert left.energy_by_mode[0] < 1e-4 * plain.energy_by_mode[0]  # the march's steps move the frequency by some 1e-4


def test_motions_that_have_not_ended_are_refused(arm: Mechanism) -> None:
    midway = flexinv.solve(arm, _turn(0.1), STEP, end=0.03)
    with pytest.raises(InputError, match="joint 'hub' still moves by"):
        midway.find_residual_vibration()


def test_rigid_arms_and_unknown_joints_are_refused(arm: Mechanism) -> None:
    rigid = flexinv.load_mechanism(MODELS / "rigid_one_link")
    joint = rigid.joints[0].name
    still = Motion.point_to_point({joint: 0.0}, {joint: 0.1}, 0.1)
    with pytest.raises(InputError, match="no link is a beam"):
        flexinv.solve(rigid, still, 1e-2).find_residual_vibration()
    with pytest.raises(InputError, match="free joint 'elbow'"):
        flexinv.solve(arm, _turn(0.01), STEP).find_residual_vibration(free=["elbow"])


def test_closures_that_switch_are_refused() -> None:
    bar = flexinv.load_mechanism(MODELS / "four_bar_flexible")
    switched = replace(bar, closures=tuple(replace(one, active=((0.0, 1.0),)) for one in bar.closures))
    still = np.zeros((1, bar.nv))
    nodes = NodalMotion.make_uninitialized(1, 0)
    with pytest.raises(InputError, match="its closures switch"):
        compute_residual_vibration(build(switched), (np.zeros((1, bar.nq)), still, still), (), nodes, {})


def test_an_arm_that_stands_on_a_free_hub_is_refused(arm: Mechanism) -> None:
    """Gravity along the beam towards its hub: it falls, and swings about nothing."""
    upright = replace(arm, gravity=np.array([-9.81, 0.0, 0.0]))
    motion = Motion.point_to_point({"hub": 0.01}, {"hub": 0.0}, 0.05, hold=STEP)
    with pytest.raises(InputError, match="divergence at the end of the motion"):
        flexinv.solve(upright, motion, STEP).find_residual_vibration(free=["hub"])


def test_a_free_joint_with_a_rotor_is_refused(arm: Mechanism) -> None:
    hub = replace(arm.joints[0], rotor_inertia=0.01)
    solution = flexinv.solve(replace(arm, joints=(hub,)), _turn(0.01), STEP)
    with pytest.raises(InputError, match="is free and has a rotor"):
        solution.find_residual_vibration(free=["hub"])


def test_more_modes_than_there_are_cannot_be_shaped_for(arm: Mechanism) -> None:
    with pytest.raises(InputError, match="write modes = "):
        flexinv.make_shaped_motion(arm, _turn(0.01), modes=500)
