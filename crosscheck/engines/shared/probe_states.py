"""Probe states for certificates of all engines: configurations and rates from primary data alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crosscheck.engines.shared.loop_closure import apply_guess
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import WORLD, Body, Mechanism
from flexinv.model.motion import evaluate_motion

Array = NDArray[np.float64]
TURN = 0.35  # [rad], [m] per configuration: joints that the motion leaves out stand at other places each time
COUNT = 4
PLAIN_KINDS = ("revolute", "continuous", "prismatic")


def configurations(mechanism: Mechanism, case: Case) -> Array:
    """Return configurations of the cut tree (4, nq) [rad], [m]: along the motion, and joints without one turned about.

    They need not close any loop: masses, gravity and axes of the tree are asked, whatever ties its links.
    """
    time = np.linspace(0.0, case.end, COUNT)
    q = apply_guess(mechanism, case, evaluate_motion(case.motion, mechanism, time)[0])
    given = set(case.motion.joints(mechanism))
    for k, joint in enumerate(j for j in mechanism.joints if j.nv and j.name not in given):
        if joint.nq == 1:
            q[:, mechanism.q_slices[joint.name]] += (TURN * np.arange(COUNT) * (1 + k % 3))[:, None]
    return q


def list_probe_rates(mechanism: Mechanism) -> tuple[Array, Array] | None:
    """Return rates and accelerations (4, nv) [rad/s], [m/s], [rad/s^2], [m/s^2] at which slopes of torques are asked.

    The same for every engine.  None where a joint's coordinate is no angle and no length, by which slopes have many forms.
    """
    moving = [joint for joint in mechanism.joints if joint.nv]
    if not moving or any(joint.kind not in PLAIN_KINDS for joint in moving):
        return None
    rates, accelerations = np.random.default_rng(41).normal(size=(2, COUNT, mechanism.nv))
    return rates, accelerations


def move_inertia_to_origin(mass: float, com: Array, tensor: Array) -> tuple[Array, Array]:
    """Return first moment m c (3,) [kg m] and tensor about the origin (3, 3) [kg m^2] of a body.

    tensor : about its centre of mass;  I_o = I_c + m (|c|^2 1 - c c^T)
    """
    return mass * com, tensor + mass * (float(com @ com) * np.eye(3) - np.outer(com, com))


def collect_joint_bodies(mechanism: Mechanism) -> dict[str, list[tuple[str, Body]]]:
    """Return the bodies (with their links) that each moving joint carries up to the next one; of beams, their bodies."""
    mover: dict[str, str | None] = {WORLD: None}
    joint_bodies: dict[str, list[tuple[str, Body]]] = {j.name: [] for j in mechanism.joints if j.nv}
    for joint in mechanism.joints:
        mover[joint.child] = joint.name if joint.nv else mover[joint.parent]
        name = mover[joint.child]
        if name is not None:
            joint_bodies[name] += [(joint.child, body) for body in mechanism.link_of[joint.child].bodies]
    return joint_bodies
