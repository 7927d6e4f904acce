"""follow with drives, with damping in beams and with a pose: against the exact inverse by frequency, and as theorems."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path as Folder

import numpy as np
from hub_arm import HUB, LENGTH, ROTOR, beam, hub_arm, torque_by_frequency

import flexinv
from flexinv import Mechanism, Path, follow
from flexinv.analysis.motor_side import motor_side
from flexinv.kinematics.mesh import build
from flexinv.kinematics.nodal_motion import compute_rigid_motion
from flexinv.model.mechanism import Drive, Joint, build_drive_model
from flexinv.tracking.follow import Following
from flexinv.tracking.inverse_kinematics import resolve_frame

STROKE, DURATION, STEP, REST = 0.01, 1.0, 4e-3, 2.0
RATIO = 5.0
# Of the largest torque: h^2 / 12 times the square of the path's fastest part, some 20 rad/s (falls with the square of the step:
# tests/flexinv/tracking/test_follow.py); below it the stroke's square.
OF_STEP = 6e-4
RETARDATION = 2e-3  # s: 17 rad/s, the second mode with the rotor held, is damped by 1.7 % of critical


def path() -> Path:
    return Path.arc([LENGTH, 0, 0], [0, 0, 0], STROKE, DURATION)


def followed(m: Mechanism) -> Following:
    return follow(m, path(), "link", STEP, before=REST, after=REST)


def exact(f: Following, retardation: float = 0.0) -> np.ndarray:
    pushed = path().evaluate(f.time)
    along = np.stack([-pushed.x[:, 1], pushed.x[:, 0]], axis=1) / LENGTH
    return torque_by_frequency(np.einsum("si,si->s", pushed.a[:, :2], along), STEP, True, retardation)


def off(torque: np.ndarray, wanted: np.ndarray) -> float:
    return float(np.abs(torque - wanted).max() / np.abs(wanted).max())


# ------------------------------------------------------------------------------------------------------- beam damping


def test_a_damped_arm_against_the_exact_inverse() -> None:
    f = followed(hub_arm(8, retardation=RETARDATION))
    assert off(f.solution.torque[:, 0], exact(f, RETARDATION)) < OF_STEP
    assert off(f.solution.torque[:, 0], exact(f)) > 2 * OF_STEP  # damping is seen
    assert f.solution.balance.dissipated.max() > 0
    # the power balance holds with velocities, accelerations and rates of strain of one instant
    assert np.abs(f.solution.power_residual).max() < 1e-9 * np.abs(f.solution.torque * f.solution.qd).max()


def test_a_damped_arm_replayed(root: Folder) -> None:
    """Two links, damped: the torques of stable inversion bring the tip along its path, and both march and horizon damp alike."""
    m = damped(flexinv.load_mechanism(root / "models" / "flex_two_link"), 1e-3)
    arc = Path.arc([0.3, 0, 0], [0.2, 0, 0], np.pi / 2, 0.3)
    start = {"joint1": -0.5, "joint2": 1.0}
    f = follow(m, arc, "link2", 1e-3, start=start)
    assert f.distance(f.solution).max() < 1e-10 * arc.length
    assert f.distance(f.replay("stable inversion")).max() < 1e-3 * arc.length
    assert f.solution.balance.dissipated.max() > 0


def damped(m: Mechanism, time: float) -> Mechanism:
    links = []
    for link in m.links:
        if link.beam is not None:
            section = link.beam.section
            section = replace(section, damping=time * section.stiffness)
            links.append(replace(link, beam=replace(link.beam, section=section)))
        else:
            links.append(link)
    return replace(m, links=tuple(links))


# ------------------------------------------------------------------------------------------------------------- drives


@cache
def driven(moves: str) -> Following:
    """The same arm: rotor and hub spring as a drive."""
    drive = Drive(ratio=RATIO, rotor_inertia=ROTOR / RATIO**2, stiffness=HUB, torque_constant=0.1, moves=moves)
    joint = Joint("hub", "revolute", "world", "link", drive=drive)
    m = build_drive_model(Mechanism("driven arm", (beam(8),), (joint,), gravity=np.zeros(3)))
    return followed(m)


def test_a_drive_that_moves_the_motor_is_rotor_and_spring() -> None:
    f = driven("motor")
    assert off(f.solution.torque[:, 0], exact(f)) < OF_STEP
    motor = motor_side(f.solution)["hub"]
    assert off(RATIO * motor.torque, exact(f)) < OF_STEP
    np.testing.assert_allclose(motor.current, motor.torque / 0.1)


def test_a_drive_that_moves_the_link_needs_the_same_motor() -> None:
    """Flatness: from the link's torque and its two derivatives comes what the motor does in the other model."""
    f, other = driven("link"), driven("motor")
    motor, expected = (motor_side(one.solution)["hub"] for one in (f, other))
    scale = np.ptp(expected.torque)
    # twice differentiated by splines: samples at both ends of the window rest
    assert np.abs(motor.torque - expected.torque).max() < OF_STEP * scale
    assert np.abs(motor.angle - expected.angle).max() < OF_STEP * np.ptp(expected.angle)
    assert (
        np.abs(f.solution.torque[:, 0] - other.solution.torque[:, 0]).max() > 0.1 * RATIO * scale
    )  # without the rotor


def test_a_rigid_gear_is_followed(root: Folder) -> None:
    """Rigid links with a rotor in a joint: the torque holds what the rotor takes."""
    m = flexinv.load_mechanism(root / "models" / "rigid_3r")
    drive = Drive(ratio=50.0, rotor_inertia=1e-4)
    geared = build_drive_model(replace(m, joints=(replace(m.joints[0], drive=drive), *m.joints[1:])))
    line = Path.line([0.45, -0.1, 0], [0.35, 0.1, 0], 0.5)
    start = {j.name: angle for j, angle in zip(m.joints, (-0.8, 1.0, 0.5), strict=True)}
    name = m.links[-1].name
    plain, more = (follow(one, line, name, 2e-3, start=start).solution for one in (m, geared))
    rotor = np.zeros_like(plain.torque)
    rotor[:, 0] = 50.0**2 * 1e-4 * plain.qdd[:, 0]
    np.testing.assert_allclose(more.torque - plain.torque, rotor, rtol=0, atol=1e-10)


# --------------------------------------------------------------------------------------------------------------- pose


def test_a_pose_is_followed_by_the_bent_arm(root: Folder) -> None:
    """Six drives, six wishes: position and orientation of the hand, while the forearm bends."""
    m = flexinv.load_mechanism(root / "models" / "ur5_flexible_forearm")
    start = {"shoulder_lift_joint": -1.3, "elbow_joint": 1.5, "wrist_1_joint": -0.8, "wrist_2_joint": -1.0}
    mesh = build(m)
    q, still = m.neutral, np.zeros((1, m.nv))
    for name, value in start.items():
        q[m.q_slices[name]] = value
    begins = resolve_frame(mesh, "wrist_3_link").compute_poses(compute_rigid_motion(mesh, q[None], still, still))
    assert begins.rotation is not None
    turn = begins.rotation[0]
    to = flexinv.kernels.so3.exp_so3(np.array([0.0, 0.2, 0.3])) @ turn
    line = Path.line(begins.x[0], begins.x[0] + [0.08, 0.06, -0.05], 0.5).turning(turn, to)
    f = follow(m, line, "wrist_3_link", 5e-3, start=start)
    missed = {name: turned(f, line, solution) for name, solution in (("found", f.solution), ("naive", f.joint_space))}
    assert f.distance(f.solution).max() < 1e-10
    assert missed["found"] < 1e-9  # rad
    assert missed["naive"] > 1e-3
    peak = np.abs(f.solution.torque).max()
    np.testing.assert_allclose(f.solution.reaction, f.solution.torque_all, rtol=0, atol=1e-8 * peak)


def turned(f: Following, line: Path, solution: flexinv.Solution) -> float:
    """The largest angle between the frame and its wish [rad]."""
    wanted, now = line.evaluate(f.time).rotation, f.frame.compute_poses(solution.nodes).rotation
    assert wanted is not None
    assert now is not None
    return float(np.linalg.norm(flexinv.kernels.so3.log_so3(np.swapaxes(wanted, 1, 2) @ now), axis=1).max())


def test_drives_without_a_rotor_give_what_the_link_needs() -> None:
    """There is no inertia between torque and link: with a spring there or without, the torque is the same."""
    result = []
    for stiffness in (0.0, 50.0):
        drive = Drive(ratio=2.0, stiffness=stiffness, moves="motor")
        joint = Joint("hub", "revolute", "world", "link", drive=drive)
        f = followed(build_drive_model(Mechanism("light drive", (beam(6),), (joint,), gravity=np.zeros(3))))
        missed = f.frame.compute_poses(f.solution.nodes).x - f.wanted
        # along the arc, which is what one drive can do
        assert np.abs(np.einsum("srt,sr->st", f.reach.within, missed)).max() < 1e-10
        result.append(f.solution.torque[:, 0])
    # the beam's axial and shear stiffness, 1e9 N, times rounding
    assert off(result[1], result[0]) < 1e-6
