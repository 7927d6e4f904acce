"""Drives with elastic joints: what the motor does against closed forms, and the way back through its own motion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.polynomial import Polynomial

import flexinv
from flexinv.analysis.motor_side import evaluate_friction, motor_side
from flexinv.errors import InputError
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Body, Drive, Inertia, Joint, Link, Mechanism, build_drive_model
from flexinv.typing import Array

# Smooth to the fourth derivative at both ends: 0 to 1.
MOVE = Polynomial([0, 0, 0, 0, 0, 126, -420, 540, -315, 70])
INERTIA = 0.5  # kg m^2 about the joint
DRIVE = Drive(ratio=50.0, rotor_inertia=1e-4, stiffness=400.0, torque_constant=0.08)


def rod(drive: Drive, gravity: float = 0.0) -> Mechanism:
    """A link of INERTIA about a vertical axis (or with gravity along -y) and its drive."""
    body = Body("rod", Inertia(2.0, np.array([0.25, 0.0, 0.0]), (INERTIA - 2.0 * 0.25**2) * np.eye(3)))
    joint = Joint("q", "revolute", "world", "rod", drive=drive)
    return build_drive_model(
        Mechanism("rod", (Link("rod", (body,)),), (joint,), gravity=np.array([0.0, -gravity, 0.0]))
    )


def sampled(values: Array, time: Array) -> flexinv.Motion:
    return flexinv.Motion.from_samples(time, {"q": values})


def swing(step: float = 1e-3) -> tuple[Array, flexinv.Motion]:
    time = np.arange(0.0, 1.0 + step / 2, step)
    return time, sampled(MOVE(time), time)


def test_the_motor_runs_ahead_of_the_link() -> None:
    """theta = N (q + I q'' / k), tau_m = N J (q'' + I q'''' / k) + I q'' / N."""
    time, motion = swing()
    result = motor_side(flexinv.solve(rod(DRIVE), motion, 1e-3))["q"]
    n, k = DRIVE.ratio, DRIVE.stiffness
    q, qdd, snap = (MOVE.deriv(m)(time) for m in (0, 2, 4))
    # the motion's spline knows accelerations to 1e-16 / h^2 = 1e-10 and its torque's second derivative to as much over h^2
    # again: 1e-4 of a unit, k times less in the motor; its own error is h^4 of the tenth derivative
    np.testing.assert_allclose(result.angle, n * (q + INERTIA * qdd / k), rtol=0, atol=1e-7)
    np.testing.assert_allclose(result.transmitted, INERTIA * qdd, rtol=0, atol=1e-6)
    expected = n * DRIVE.rotor_inertia * (qdd + INERTIA * snap / k) + INERTIA * qdd / n
    assert np.abs(result.torque - expected).max() < 1e-3 * np.abs(expected).max()
    np.testing.assert_allclose(result.current, result.torque / 0.08, rtol=1e-14)
    rigid = n * DRIVE.rotor_inertia * qdd + INERTIA * qdd / n
    assert np.abs(result.torque - rigid).max() > 0.02 * np.abs(expected).max()  # the spring is seen


def test_a_damper_in_the_joint() -> None:
    """k delta + d delta' = tau, delta' and delta'' its derivatives: checked by differences of what comes out."""
    time, motion = swing()
    drive = replace(DRIVE, damping=4.0)
    solution = flexinv.solve(rod(drive), motion, 1e-3)
    result = motor_side(solution)["q"]
    lag = result.angle / drive.ratio - solution.q[:, 0]
    lag_rate = result.rate / drive.ratio - solution.qd[:, 0]
    tau = INERTIA * solution.qdd[:, 0]
    # forces are taken as linear between samples: h^2 tau'' / 12 tau'' up to 300 N m/s^2: 3e-5, for tau and for tau'
    np.testing.assert_allclose(drive.stiffness * lag + drive.damping * lag_rate, tau, rtol=0, atol=1e-4)
    inner = slice(2, -2)
    # central differences over 2 ms of motions with time constants of 0.1 s: (0.02)^2 / 6 of the largest value
    np.testing.assert_allclose(
        np.gradient(lag, time)[inner], lag_rate[inner], rtol=0, atol=1e-3 * np.abs(lag_rate).max()
    )


@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_the_motors_motion_brings_the_link_back(gravity: float) -> None:
    """The motor's angle from the link's motion, given to the same drive as the motion of its motor, moves the link like that."""
    drive = replace(DRIVE, damping=0.5)
    time, motion = swing()
    there = flexinv.solve(rod(drive, gravity), motion, 1e-3)
    motor = motor_side(there)["q"]
    elastic = rod(replace(drive, moves="motor"), gravity)
    assert [j.name for j in elastic.joints] == ["q", "q.spring"]
    start = {"q.spring": float(there.q[0, 0] - motor.angle[0] / drive.ratio)}
    back = flexinv.solve(elastic, sampled(motor.angle / drive.ratio, time), 1e-3, start=start)
    link = back.q[:, 0] + back.q[:, 1]
    # second order in the step: (omega h)^2 / 12 of the deflection, omega = sqrt(k / I) = 28 rad/s: 7e-5 of 0.02 rad, and 1.5e-6
    # of what it moves
    assert np.abs(link - there.q[:, 0]).max() < 1e-5
    again = motor_side(back)["q"]
    assert np.abs(again.torque - motor.torque).max() < 2e-3 * np.abs(motor.torque).max()
    assert np.abs(again.transmitted - motor.transmitted).max() < 2e-3 * np.abs(motor.transmitted).max()
    # without the lead the link does not come: the same check fails
    led = flexinv.solve(elastic, motion, 1e-3, start=start)
    assert np.abs(led.q.sum(axis=1) - there.q[:, 0]).max() > 1e-3


def test_a_rigid_gear_is_a_rotor_in_the_joint() -> None:
    drive = replace(DRIVE, stiffness=0.0, viscous=1e-4, coulomb=0.02)
    _, motion = swing()
    solution = flexinv.solve(rod(drive), motion, 1e-3)
    result, n = motor_side(solution)["q"], drive.ratio
    np.testing.assert_allclose(result.torque, solution.torque[:, 0] / n, rtol=0, atol=1e-14)
    assert solution.mechanism.joints[0].rotor_inertia == n**2 * drive.rotor_inertia
    stuck = replace(drive, static=0.05, stribeck=2.0)
    more = motor_side(flexinv.solve(rod(stuck), motion, 1e-3))["q"]
    bump = 0.03 * np.exp(-((result.rate / 2.0) ** 2)) * np.sign(result.rate)
    np.testing.assert_allclose(more.torque - result.torque, bump, rtol=0, atol=1e-14)


def test_friction_of_stribeck() -> None:
    drive = Drive(viscous=0.1, coulomb=1.0, static=1.5, stribeck=2.0)
    np.testing.assert_allclose(
        evaluate_friction(drive, np.array([0.0, 2.0, -2.0, 100.0])),
        [0.0, 0.2 + 1.0 + 0.5 / np.e, -(0.2 + 1.0 + 0.5 / np.e), 11.0], rtol=1e-15,
    )  # fmt: skip


def test_a_jerky_link_is_refused() -> None:
    jump = flexinv.Motion.point_to_point({"q": 0.0}, {"q": 1.0}, 1.0, law="cycloid", hold=0.2, delay=0.2)
    solution = flexinv.solve(rod(DRIVE), jump, 1e-3)
    with pytest.raises(InputError, match=r"joint 'q': the second derivative of its torque .* moves = \"motor\""):
        motor_side(solution)
    assert flexinv.solve(rod(replace(DRIVE, moves="motor")), jump, 1e-3).q.shape[1] == 2  # the motor may
    with pytest.raises(InputError, match="expected 16 or more"):
        motor_side(flexinv.solve(rod(DRIVE), swing()[1], 0.1))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"kind": "spherical"}, "a drive moves one coordinate .*the joint is spherical"),
        ({"damping": 1.0}, "beside a drive"),
        ({"stiffness": 1.0}, "beside a drive"),
    ],
)
def test_what_a_drive_cannot_stand_beside(change: dict[str, object], words: str) -> None:
    joint = replace(Joint("q", "revolute", "world", "rod", drive=replace(DRIVE, stiffness=0.0)), **change)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=words):
        build_drive_model(Mechanism("rod", (Link("rod"),), (joint,)))


FILE = """
title = "a rod"
source = "test"
gravity_m_per_s2 = [0, 0, 0]
[links]
rod = { kind = "rigid", mass_kg = 1, rod = { length_m = 1 } }
[joints.q]
kind = "revolute"
parent = "world"
child = "rod"
axis = [0, 0, 1]
[joints.q.drive]
gear_ratio = 50
motor_inertia_kgm2 = 1e-4
stiffness_Nm_per_rad = 400
torque_constant_Nm_per_A = 0.08
coulomb_Nm = 0.01
"""


def test_files_state_drives(tmp_path: Path) -> None:
    (tmp_path / "mechanism.toml").write_text(FILE, encoding="utf-8")
    assert load_mechanism(tmp_path).joints[0].drive == replace(DRIVE, coulomb=0.01)
    (tmp_path / "mechanism.toml").write_text(FILE + 'moves = "motor"\n', encoding="utf-8")
    mechanism = load_mechanism(tmp_path)
    assert [j.name for j in mechanism.joints] == ["q", "q.spring"]
    assert (mechanism.joints[0].rotor_inertia, mechanism.joints[0].friction) == (0.25, 0.5)
    (tmp_path / "mechanism.toml").write_text(FILE + "static_Nm = 0.001\n", encoding="utf-8")
    with pytest.raises(InputError, match="at least coulomb_Nm"):
        load_mechanism(tmp_path)


# ------------------------------------------------------------------------------------------- joints that slide, robots


def slide(drive: Drive) -> Mechanism:
    """A carriage of 2 kg along x."""
    joint = Joint("q", "prismatic", "world", "rod", axis=np.array([1.0, 0.0, 0.0]), drive=drive)
    body = Body("rod", Inertia(2.0))
    return build_drive_model(Mechanism("slide", (Link("rod", (body,)),), (joint,), gravity=np.zeros(3)))


SCREW = Drive(ratio=400.0, rotor_inertia=1e-5, stiffness=2e3, torque_constant=0.08)  # rad/m, N/m


def test_a_screw_moves_a_carriage() -> None:
    """theta = N (q + m q'' / k), tau_m = N J (q'' + m q'''' / k) + m q'' / N, as in a joint that turns."""
    time, motion = swing()
    result = motor_side(flexinv.solve(slide(SCREW), motion, 1e-3))["q"]
    n, k = SCREW.ratio, SCREW.stiffness
    q, qdd, snap = (MOVE.deriv(m)(time) for m in (0, 2, 4))
    # as in `test_the_motor_runs_ahead_of_the_link`, where N I / k is 0.06: here N m / k = 0.4 of the spline's accelerations
    np.testing.assert_allclose(result.angle, n * (q + 2.0 * qdd / k), rtol=0, atol=1e-6)
    expected = n * SCREW.rotor_inertia * (qdd + 2.0 * snap / k) + 2.0 * qdd / n
    assert np.abs(result.torque - expected).max() < 1e-3 * np.abs(expected).max()


def test_the_screws_motor_brings_the_carriage_back() -> None:
    time, motion = swing()
    motor = motor_side(flexinv.solve(slide(SCREW), motion, 1e-3))["q"]
    elastic = slide(replace(SCREW, moves="motor"))
    assert [(j.name, j.kind) for j in elastic.joints] == [("q", "prismatic"), ("q.spring", "prismatic")]
    back = flexinv.solve(elastic, sampled(motor.angle / SCREW.ratio, time), 1e-3)
    # second order in the step: (omega h)^2 / 12 of the spring's way of 9 mm, omega = sqrt(k / m) = 32 rad/s, and its swinging
    assert np.abs(back.q.sum(axis=1) - MOVE(time)).max() < 2e-5
    again = motor_side(back)["q"]
    assert np.abs(again.torque - motor.torque).max() < 2e-3 * np.abs(motor.torque).max()


SLIDE = """
title = "a carriage"
source = "test"
gravity_m_per_s2 = [0, 0, 0]
[links]
rod = { kind = "rigid", mass_kg = 2, rod = { length_m = 1 } }
[joints.q]
kind = "prismatic"
parent = "world"
child = "rod"
axis = [1, 0, 0]
[joints.q.drive]
gear_ratio_rad_per_m = 400
motor_inertia_kgm2 = 1e-5
stiffness_N_per_m = 2e3
torque_constant_Nm_per_A = 0.08
"""


def test_files_state_drives_of_joints_that_slide(tmp_path: Path) -> None:
    file = tmp_path / "mechanism.toml"
    file.write_text(SLIDE, encoding="utf-8")
    assert load_mechanism(tmp_path).joints[0].drive == SCREW
    for wrong in (SLIDE.replace("ratio_rad_per_m", "ratio"), SLIDE.replace("gear_ratio_rad_per_m = 400\n", "")):
        file.write_text(wrong, encoding="utf-8")
        with pytest.raises(InputError, match=r"gear_ratio_rad_per_m"):
            load_mechanism(tmp_path)


ROBOT = """
title = "a robot with a drive in its elbow"
source = "test"
[urdf]
package = "example-robot-data"
path = "ur_description/urdf/ur5_robot.urdf"
[overlay.joints.elbow_joint.drive]
gear_ratio = 101
motor_inertia_kgm2 = 2e-5
viscous_Nms_per_rad = 1e-5
"""


def test_a_robot_from_a_urdf_gets_a_drive(tmp_path: Path) -> None:
    file = tmp_path / "mechanism.toml"
    file.write_text(ROBOT, encoding="utf-8")
    robot = load_mechanism(tmp_path)
    elbow, turned = robot.joint_of["elbow_joint"], 101**2
    assert (elbow.rotor_inertia, elbow.damping) == (pytest.approx(turned * 2e-5), pytest.approx(turned * 1e-5))
    still = np.zeros(robot.nq)
    mass = flexinv.torque_derivatives(robot, still, still, still).qdd[0, 2, 2]
    bare = replace(robot, joints=tuple(replace(j, drive=None, rotor_inertia=0.0) for j in robot.joints))
    without = flexinv.torque_derivatives(bare, still, still, still).qdd[0, 2, 2]
    assert mass - without == pytest.approx(turned * 2e-5)
    file.write_text(ROBOT + 'stiffness_Nm_per_rad = 1e4\nmoves = "motor"\n', encoding="utf-8")
    names = [j.name for j in load_mechanism(tmp_path).joints if j.nv]
    assert names[names.index("elbow_joint") + 1] == "elbow_joint.spring"
    file.write_text(ROBOT + "gear_rato = 3\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"overlay.joints.elbow_joint.drive.*gear_rat"):
        load_mechanism(tmp_path)


@pytest.mark.parametrize("drive", [replace(DRIVE, stiffness=0.0), replace(DRIVE, moves="motor")])
def test_a_drive_that_is_not_part_of_the_mechanism_is_refused(drive: Drive) -> None:
    """What is built in Python may forget to expand it: no tool may leave out its rotor in silence."""
    joint, one = Joint("q", "revolute", "world", "rod", drive=drive), np.zeros(1)
    bare = Mechanism("rod", (Link("rod", (Body("rod", Inertia(1.0)),)),), (joint,))
    words = r"joint 'q': its drive is not part of the mechanism yet; write flexinv.model.mechanism.build_drive_model"
    for ask in (flexinv.joint_torques, flexinv.torque_regressor, flexinv.torque_derivatives):
        with pytest.raises(InputError, match=words):
            ask(bare, one, one, one)
    with pytest.raises(InputError, match=words):
        flexinv.Controller.of(bare)
