"""A motion that tells apart what logs so far cannot: bounded Fourier series, chosen by what they leave of the uncertainty.

q_j(t) = middle_j + w(t) sum_n a_jn sin(2 pi n t / T) + b_jn cos(2 pi n t / T),   w from rest to rest
score = sum of log variances of the parameters after the motion, by  (cov^-1 + J^T W J)^-1

Each series is scaled to the joint's limits, or to the range and rate of the log where the mechanism states none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosscheck.identification.drives.efforts import compute_channel_rate
from crosscheck.identification.estimation.fit import PER_PERIOD, TOLD, Fit, build_problem, compute_jacobian
from crosscheck.identification.logs.log import Log
from crosscheck.identification.machine import Machine, has_friction
from crosscheck.identification.readings import Run, compute_measured_motion
from crosscheck.identification.responses.response import MeasuredMotion, build_response
from flexinv.typing import Array

HARMONICS = 5
RAMP = 0.1  # of the duration, from rest and to rest
# series drawn, and small changes of the best one
CANDIDATES = 12
REFINED = 12
SHRINK = 0.3  # size of the changes
ALLOWED = 0.9  # of a limit


@dataclass(frozen=True)
class Proposal:
    """A motion [s], [rad], [m]: time (samples,), q (samples, joints), and in words what it would tell beside the logs."""

    time: Array
    names: tuple[str, ...]
    q: Array
    words: list[str]


def find_exciting_motion(machine: Machine, fit: Fit, log: Log, seconds: float = 10.0) -> Proposal:
    """Return the best of some dozen bounded Fourier series of that duration [s], with what it would tell [-].

    log : its ranges and rates bound the motion where the mechanism states no limits [rad], [m]
    """
    random = np.random.default_rng(0)  # the same logs propose the same motion
    measured_motion = compute_measured_motion(machine, log)
    bounds = [_find_motion_bounds(machine, measured_motion, k) for k in range(len(measured_motion.names))]
    shape = (len(measured_motion.names), 2, HARMONICS)
    fine = np.arange(0.0, seconds, log.spacing)
    best = random.normal(size=shape)
    least, after = _compute_motion_score(machine, fit, best, seconds, bounds)
    for k in range(CANDIDATES + REFINED):
        tried = random.normal(size=shape) if k < CANDIDATES else best + SHRINK * random.normal(size=shape)
        score, variance = _compute_motion_score(machine, fit, tried, seconds, bounds)
        if score < least:
            best = tried
            least = score
            after = variance
    before = np.sqrt(np.diag(fit.covariance))
    names = machine.space.describe_parameters()
    news = [k for k in range(len(names)) if np.sqrt(after[k]) < TOLD <= before[k]]
    words = [f"this motion would tell {names[k]}: {before[k]:.2g} of the prior's width is left now, {np.sqrt(after[k]):.2g} then"
             for k in news]  # fmt: skip
    left = [names[k] for k in range(len(names)) if np.sqrt(after[k]) >= TOLD]
    words += [f"no motion that was tried tells {', '.join(left)}"] if left else []
    return Proposal(fine, measured_motion.names, _evaluate_fourier_series(best, fine, seconds, bounds)[0], words)


Bounds = tuple[float, float, float]  # middle, half range, largest rate


def _find_motion_bounds(machine: Machine, measured_motion: MeasuredMotion, k: int) -> Bounds:
    limits = machine.mechanism.joint_of[measured_motion.names[k]].limits
    low = measured_motion.q[:, k].min()
    high = measured_motion.q[:, k].max()
    if np.isfinite([limits.lower, limits.upper]).all():
        low = limits.lower
        high = limits.upper
    rate = limits.velocity if np.isfinite(limits.velocity) else float(np.abs(measured_motion.qd[:, k]).max())
    return float(low + high) / 2.0, ALLOWED * float(high - low) / 2.0, ALLOWED * float(rate)


def _evaluate_fourier_series(
    coefficients: Array, time: Array, seconds: float, bounds: list[Bounds]
) -> tuple[Array, Array, Array]:
    """Angles, rates and accelerations (samples, joints) of coefficients (joints, 2, harmonics), inside the bounds."""
    ramp = np.clip(np.minimum(time, seconds - time) / (RAMP * seconds), 0.0, 1.0)
    window = ramp**4 * (35.0 - 84.0 * ramp + 70.0 * ramp**2 - 20.0 * ramp**3)
    angle = 2.0 * np.pi * np.arange(1, HARMONICS + 1) * time[:, None] / seconds
    q = window[:, None] * (np.sin(angle) @ coefficients[:, 0].T + np.cos(angle) @ coefficients[:, 1].T)
    spacing = float(time[1] - time[0])
    qd = np.gradient(q, spacing, axis=0)
    size = np.array([
        min(half / max(np.abs(q[:, k]).max(), 1e-12), rate / max(np.abs(qd[:, k]).max(), 1e-12))
        for k, (_, half, rate) in enumerate(bounds)
    ])  # fmt: skip
    middle = np.array([b[0] for b in bounds])
    return middle + q * size, qd * size, np.gradient(qd, spacing, axis=0) * size


def _compute_motion_score(
    machine: Machine, fit: Fit, coefficients: Array, seconds: float, bounds: list[Bounds]
) -> tuple[float, Array]:
    """Sum of log variances after the motion, and the variances (parameters,)."""
    time = np.arange(0.0, seconds, 1.0 / (PER_PERIOD * machine.settings.bandwidth_Hz))
    motion = MeasuredMotion(
        time, tuple(machine.settings.joints), *_evaluate_fourier_series(coefficients, time, seconds, bounds)
    )
    tell = build_response(machine.mechanism, machine.space, machine.settings, motion)
    moving = np.column_stack([
        np.abs(compute_channel_rate(machine, motion, c)) > machine.settings.still_rad_per_s if has_friction(machine, c)
        else np.ones(len(time), dtype=bool)
        for c in machine.channels
    ])  # fmt: skip
    run = Run("proposed", time, motion, tell, None, moving, moving)
    slopes = compute_jacobian(build_problem(machine, (run,)), fit.z)
    precision = np.linalg.inv(fit.covariance)
    for j, spread, agree in zip(slopes, fit.spread, fit.agree, strict=True):
        precision = precision + j.T @ j / (spread**2 * agree)
    variance = np.diag(np.linalg.inv(precision))
    return float(np.sum(np.log(variance))), variance
