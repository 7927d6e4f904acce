"""The law of a joint: the effort that its own rotor, damper, dry friction and spring take, written once for all passes.

    effort = rotor q'' + damping q' + friction direction + stiffness (place - rest)

``direction`` is sign(q') where the rate is prescribed.  In time integration it is tanh(q' / FRICTION_RATE): a slope instead of a
jump at rest.  Python calls these functions with arrays; kernels take in their text.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexinv.kernels.jit import jit_formula, jit_inner
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

# The rate at which smooth dry friction reaches three quarters of its size; how large it may be: `analysis/evaluation._direction`.
FRICTION_RATE = 1e-3  # [rad/s] or [m/s]

Numbers = Array | float


class JointLaw(NamedTuple):
    """Data of the law, of one coordinate (kernels) or of all of them, (nv,).

    rotor : [kg m^2] or [kg]; damping : [N m s] or [N s/m]; friction : [N m] or [N]
    stiffness : [N m/rad] or [N/m] of the spring, which rests at ``rest`` [rad] or [m]
    """

    rotor: Numbers
    damping: Numbers
    friction: Numbers
    stiffness: Numbers
    rest: Numbers


def build_joint_laws(mechanism: Mechanism) -> JointLaw:
    """Return the laws of all velocity coordinates, (nv,) each [kg m^2], [N m s], [N m], [N m/rad], [rad]."""
    return JointLaw(*mechanism.drive_table)


@jit_inner
def take_joint_law(drives: Array, n: int) -> JointLaw:
    """Return the law of one joint [kg m^2], [N m s], [N m], [N m/rad], [rad] from ``drives``, (5, nodes)."""
    return JointLaw(drives[0, n], drives[1, n], drives[2, n], drives[3, n], drives[4, n])


@jit_formula
def compute_moving_effort(law: JointLaw, rate: Numbers, acceleration: Numbers) -> Numbers:
    """Return the effort of rotor and damper [N m], [N]."""
    return law.rotor * acceleration + law.damping * rate


@jit_formula
def compute_resisting_effort(law: JointLaw, place: Numbers, direction: Numbers) -> Numbers:
    """Return the effort of dry friction and of the spring [N m], [N]; direction : of the rate, -1 .. 1 [-]."""
    return law.friction * direction + law.stiffness * (place - law.rest)


@jit_formula
def compute_joint_effort(
    law: JointLaw, place: Numbers, rate: Numbers, acceleration: Numbers, direction: Numbers
) -> Numbers:
    """Return all that the joint itself takes from its actuator [N m], [N]."""
    return compute_moving_effort(law, rate, acceleration) + compute_resisting_effort(law, place, direction)


@jit_formula
def compute_smooth_direction(rate: Numbers) -> Numbers:
    """Return the direction of a rate [rad/s], [m/s] with a slope at rest, -1 .. 1 [-]."""
    return np.tanh(rate / FRICTION_RATE)


@jit_formula
def compute_effort_slope(law: JointLaw, direction: Numbers, by_rate: Numbers, by_acceleration: Numbers) -> Numbers:
    """Return the slope of `compute_joint_effort` by the coordinate [N m/rad], [N/m], with `compute_smooth_direction`.

    by_rate, by_acceleration : derivatives of rate and acceleration by the coordinate, as the integrator gives them [1/s], [1/s^2]
    """
    damping = law.damping + law.friction * (1.0 - direction * direction) / FRICTION_RATE
    return law.stiffness + by_rate * damping + by_acceleration * law.rotor


def compute_law_derivatives(place: Array, rate: Array, acceleration: Array, direction: Array) -> list[Array]:
    """Return the derivatives of `compute_joint_effort` by rotor, damping, friction, stiffness and stiffness rest [any unit]."""
    return [acceleration, rate, direction, place, -np.ones_like(place)]
