"""torque_derivatives: derivatives of the torques by q, qd and qdd (by inertial parameters: `torque_regressor`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexinv.elements.joint_law import build_joint_laws
from flexinv.errors import InputError
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import compute_rigid_motion
from flexinv.model.by_value import ByValue
from flexinv.model.mechanism import Mechanism
from flexinv.rigid.derivative_kernel import AXIS_CELLS, BODY_CELLS, CarriedBodies, fill_torque_derivatives
from flexinv.rigid.joint_arrays import convert_to_states
from flexinv.rigid.prepare import prepare
from flexinv.rnea.body_table import Bodies
from flexinv.typing import Array
from flexinv.validation import check_flag

NODAL_SAMPLES = 512  # samples whose nodal motion is in memory at once, where springs and given forces act on nodes


@dataclass(frozen=True, eq=False)
class TorqueDerivatives(ByValue):
    """Derivatives of the torques, (samples, nv, nv) [N m], [N] per unit of the second axis' coordinate.

    q : by the place; where a coordinate is no number (quaternions, free joints) by the motion in its own frame, as qd is
    qd : by the rate; qdd : by the acceleration: the joint-space mass matrix and rotors
    """

    q: Array
    qd: Array
    qdd: Array


def _find_carried_bodies(mesh: Mesh, bodies: Bodies) -> CarriedBodies:
    """The bodies as the kernel takes them: mass, first moments and inertia in the axes of their nodes."""
    count = len(bodies.node)
    inertia = np.zeros((count, 3, 3))
    h = np.zeros((count, 3))
    for i, (r, row) in enumerate(zip(bodies.axes[1:], bodies.numbers[1:], strict=True), start=1):
        xx, yy, zz, xy, xz, yz = row[16:22]
        second = r @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ r.T
        inertia[i] = np.trace(second) * np.eye(3) - second
        h[i] = r @ row[13:16]
    mass = np.where(np.arange(count) > 0, bodies.numbers[:, 12], 0.0)
    parent = bodies.tree[:, 1].astype(np.int64)
    at = np.maximum(bodies.node, 0)
    at_axes = mesh.v_index[at], mesh.freedoms[at], mesh.slide[at], mesh.turn[at]
    return CarriedBodies(parent, bodies.node, *at_axes, mass, h, inertia)


def torque_derivatives(
    mechanism: Mechanism, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, passive: bool = True
) -> TorqueDerivatives:
    """Return d tau / dq, d tau / dqd, d tau / dqdd (samples, nv, nv) [N m], [N] per rad, m, and per second, of a rigid tree.

    q : (samples, nq) [rad], [m]; qd, qdd : (samples, nv); one sample may be a plain vector
    passive : joint springs and damping count (dry friction has no slope but at rest, where it has none at all)

    Raises InputError for a flexible mechanism, closures, springs between points or given forces, wrong shapes.
    Equals Pinocchio's ``computeRNEADerivatives`` to rounding; equations at the head of `derivative_kernel`.
    """
    states = convert_to_states(mechanism, q, qd, qdd)
    passive = check_flag("passive", passive)
    for what in ("springs", "forces"):
        if getattr(mechanism, what):
            raise InputError(
                f"torque_derivatives: mechanism '{mechanism.name}' has {what} between points or on links, whose derivative is "
                "not given; take differences of flexinv.joint_torques"
            )
    f = prepare(mechanism, passive, 1)  # no work is shared out here
    samples = len(states[0])
    out = TorqueDerivatives(*(np.zeros((samples, mechanism.nv, mechanism.nv)) for _ in range(3)))
    carried = _find_carried_bodies(f.mesh, f.bodies)
    gravity = np.array(mechanism.gravity, dtype=float)
    scratch = np.zeros((mechanism.nv, AXIS_CELLS)), np.zeros((len(carried.node), BODY_CELLS))
    for start in range(0, samples if mechanism.nv else 0, NODAL_SAMPLES):
        part = slice(start, start + NODAL_SAMPLES)
        motion = compute_rigid_motion(f.mesh, *(state[part] for state in states)).frames
        fill_torque_derivatives(carried, gravity, motion, *scratch, out.q[part], out.qd[part], out.qdd[part])
    diagonal = np.arange(mechanism.nv)
    law = build_joint_laws(mechanism)
    out.qdd[:, diagonal, diagonal] += law.rotor
    if passive:
        out.q[:, diagonal, diagonal] += law.stiffness
        out.qd[:, diagonal, diagonal] += law.damping
    return out
