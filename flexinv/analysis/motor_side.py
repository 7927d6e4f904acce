"""Drives with a gear and an elastic joint between motor and link: Spong's reduced model.

The rotor's kinetic energy is that of its spin about its own axis alone (M. W. Spong, *Modeling and control of elastic joint
robots*, J. Dyn. Sys. Meas. Control 109, 1987): with theta the motor's angle, N the gear ratio, q the joint's angle and
delta = theta / N - q

    link     M(q) q'' + ... = tau,         tau = k delta + d delta'
    motor    J theta'' + f(theta') + tau / N = tau_m,       current = tau_m / k_t
    friction f(w) = v w + (c + (s - c) exp(-(w / w_s)^2)) sign(w)          viscous, Coulomb, Stribeck

Either the link is prescribed (`moves = "link"`): the motor's motion then follows from the torque and, without d, from its
second derivative (flatness: the motion must have four continuous derivatives).  Or the motor (`moves = "motor"`): the drive
is then a driven joint with the rotor and a passive joint with the spring, and the link swings (`mechanism.expanded`).  With a
rigid gear they are the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.analysis.solution import Solution
from flexinv.errors import InputError
from flexinv.kinematics.nodal_motion import read_scalar_coordinate
from flexinv.model.by_value import ByValue
from flexinv.model.mechanism import Drive, Joint
from flexinv.typing import Array
from flexinv.validation import check_kind

# A second derivative that changes by more when every second sample is left out is none: too rough a motion, or samples too few.
ROUGH = 0.1
FEWEST = 16  # samples that its quintic splines need


@dataclass(frozen=True, eq=False)
class MotorSide(ByValue):
    """Motion, torque and current of one motor over the samples of a solution.

    angle, rate, acceleration : (samples,) of the motor's shaft [rad], [rad/s], [rad/s^2]
    torque : (samples,) of the motor [N m]; current : (samples,) [A], nan without a torque constant
    transmitted : (samples,) torque of the elastic joint on the link [N m]
    """

    angle: Array
    rate: Array
    acceleration: Array
    torque: Array
    current: Array
    transmitted: Array


def evaluate_friction(drive: Drive, rate: Array) -> Array:
    """Return f, (samples,) [N m] at the motor's shaft, for its rate (samples,) [rad/s]."""
    more = drive.static - drive.coulomb
    bump = more * np.exp(-((rate / drive.stribeck) ** 2)) if more > 0.0 else np.zeros_like(rate)
    return drive.viscous * rate + (drive.coulomb + bump) * np.sign(rate)


def motor_side(solution: Solution) -> dict[str, MotorSide]:
    """Return motion, torque and current of every motor, by joint [rad], [N m], [A]; empty for a mechanism without drives.

    Raises InputError where the link of an elastic drive is moved and its torque has no second derivative.
    """
    joints = check_kind("solution", solution, Solution).mechanism.joints
    return {j.name: _compute_motor_side(solution, j, j.drive) for j in joints if j.drive is not None}


def _compute_motor_side(solution: Solution, joint: Joint, drive: Drive) -> MotorSide:
    m = solution.mechanism
    n = drive.ratio
    at = solution.mechanism.v_slices[joint.name].start
    tau = solution.torque_all[:, at]
    rate = solution.qd[:, at]
    acceleration = solution.qdd[:, at]
    angle = read_scalar_coordinate(joint, solution.q[:, m.q_slices[joint.name]])
    if not drive.stiffness or drive.moves == "motor":
        lost = n**2 * drive.rotor_inertia * acceleration + n * evaluate_friction(replace(drive, static=0.0), n * rate)
        transmitted = tau - lost
    else:
        transmitted = tau
        lag = _compute_spring_lag(drive, solution.time, tau, joint.name)
        angle = angle + lag[0]
        rate = rate + lag[1]
        acceleration = acceleration + lag[2]
    torque = n * drive.rotor_inertia * acceleration + evaluate_friction(drive, n * rate) + transmitted / n
    current = torque / drive.torque_constant if drive.torque_constant else np.full_like(torque, np.nan)
    return MotorSide(n * angle, n * rate, n * acceleration, torque, current, transmitted)


def _compute_spring_lag(drive: Drive, time: Array, tau: Array, name: str) -> tuple[Array, Array, Array]:
    """delta, delta', delta'' (samples,) by which the motor, at the joint, runs ahead of the link: k delta + d delta' = tau."""
    of = f"drive of joint {name!r}"
    if len(time) < FEWEST:
        raise InputError(f"{of}: {len(time)} samples, expected {FEWEST} or more: take a smaller step")
    stiff_lag = _compute_stiff_lag(drive, time, tau)
    coarse = _compute_stiff_lag(drive, time[::2], tau[::2])
    change = np.abs(stiff_lag[2][::2] - coarse[2]).max()
    if change > ROUGH * np.abs(stiff_lag[2]).max():
        raise InputError(
            f"{of}: the second derivative of its torque changes by {change / np.abs(stiff_lag[2]).max():.0%} with "
            "every second sample, so the link cannot be moved like this through an elastic joint; expected a motion with four "
            'continuous derivatives (samples joined by splines) and a small step, or write moves = "motor" in its drive'
        )
    return stiff_lag


def _compute_stiff_lag(drive: Drive, time: Array, tau: Array) -> tuple[Array, Array, Array]:
    spline = scipy.interpolate.make_interp_spline(time, tau, k=5)
    rate, second = (spline.derivative(k)(time) for k in (1, 2))
    k = drive.stiffness
    d = drive.damping
    step = float(time[1] - time[0])
    if not d:
        return tau / k, rate / k, second / k
    # k delta + d delta' = tau and its derivatives, from rest: delta' = 0, d delta'' = tau' at the first sample
    lag = _solve_spring_damper(k, d, step, tau, tau[0] / k)
    return lag, _solve_spring_damper(k, d, step, rate, 0.0), _solve_spring_damper(k, d, step, second, rate[0] / d)


def _solve_spring_damper(k: float, d: float, step: float, force: Array, start: float) -> Array:
    """x of k x + d x' = force (samples,), exact for a force that is linear between samples."""
    part = float(np.exp(-k / d * step))
    trend = np.diff(force) / step * d / k
    push = (force[1:] - trend - part * (force[:-1] - trend)) / k
    return np.append(start, scipy.signal.lfilter([1.0], [1.0, -part], push, zi=[part * start])[0])
