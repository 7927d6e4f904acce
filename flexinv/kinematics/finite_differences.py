"""The paper's incremental mode: velocities and accelerations from differences of nodal positions over the steps.

Second-order formulas, so the torque error falls with the square of the step:
    inside   x'_n = (x_(n+1) - x_(n-1)) / 2h,      x''_n = (x_(n+1) - 2 x_n + x_(n-1)) / h^2
    ends     x'_0 = (-3 x_0 + 4 x_1 - x_2) / 2h,   x''_0 = (2 x_0 - 5 x_1 + 4 x_2 - x_3) / h^2
and for rotations the increments phi_n = log(R_n^T R_(n+1)) / h, which are mid-step angular velocities in the body frame:
    w_n = (phi_n + phi_(n-1)) / 2,                 al_n = (phi_n - phi_(n-1)) / h     (linear extrapolation at the ends).
"""

from __future__ import annotations

import numpy as np

from flexinv.errors import InputError
from flexinv.kernels.so3 import log_so3
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.typing import Array

ORDER = 2  # of the formulas above, in the step


FEWEST_SAMPLES = 4  # that the formulas at the ends need


def check_samples(samples: int, step: float) -> None:
    """Raise InputError if there are too few samples of ``step`` [s] for the difference formulas."""
    if samples < FEWEST_SAMPLES:
        raise InputError(
            f"the incremental mode needs at least {FEWEST_SAMPLES} samples, step = {step:g} s gives {samples}: "
            "write a smaller step"
        )


def differenced(motion: NodalMotion, step: float) -> NodalMotion:
    """Return the motion with v, a, omega, alpha from differences of poses over ``step`` [s].

    Raises InputError with fewer than four samples.
    """
    check_samples(len(motion.x), step)
    v, a = np.empty_like(motion.x), np.empty_like(motion.x)
    x = motion.x
    v[1:-1], a[1:-1] = (x[2:] - x[:-2]) / (2 * step), (x[2:] - 2 * x[1:-1] + x[:-2]) / step**2
    v[0], v[-1] = (-3 * x[0] + 4 * x[1] - x[2]) / (2 * step), (3 * x[-1] - 4 * x[-2] + x[-3]) / (2 * step)
    a[0] = (2 * x[0] - 5 * x[1] + 4 * x[2] - x[3]) / step**2
    a[-1] = (2 * x[-1] - 5 * x[-2] + 4 * x[-3] - x[-4]) / step**2
    turn = np.einsum("snji,snjk->snik", motion.rotation[:-1], motion.rotation[1:])
    phi = log_so3(turn) / step  # (step, node, xyz)
    omega, alpha = np.empty_like(x), np.empty_like(x)
    omega[1:-1], alpha[1:-1] = 0.5 * (phi[1:] + phi[:-1]), (phi[1:] - phi[:-1]) / step
    omega[0], omega[-1] = 1.5 * phi[0] - 0.5 * phi[1], 1.5 * phi[-1] - 0.5 * phi[-2]
    alpha[0], alpha[-1] = _end(phi[:3], step), -_end(phi[:-4:-1], step)
    return NodalMotion(motion.x, motion.rotation, v, omega, a, alpha)


def _end(phi: Array, step: float) -> Array:
    """First derivative at the outer end of three mid-step values: (-2 phi_0 + 3 phi_1 - phi_2) / h, second order."""
    return np.asarray((-2 * phi[0] + 3 * phi[1] - phi[2]) / step)
