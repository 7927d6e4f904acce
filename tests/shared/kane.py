"""Inverse dynamics of a rigid tree from first principles, as a judge that shares nothing with anyone's algorithm.

Poses along the motion are second-order Taylor series in time (exact products of truncated series, no differences), so
accelerations are read off, and Kane's equations give the efforts:

    tau_k = sum over bodies of  m (c'' - g) . dc'/dv_k  +  (R (J al + w x J w)) . dw/dv_k
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexinv.model.mechanism import WORLD, Body, Joint, Link, Mechanism
from flexinv.typing import Array


@dataclass(frozen=True)
class Pose:
    """Taylor series of a frame: x (order, 3), rotation (order, 3, 3), coefficients of t^0, t^1, t^2."""

    x: Array
    rotation: Array


def skew(w: Array) -> Array:
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def product(a: Array, b: Array) -> Array:
    """Product of two truncated series of matrices, or of a matrix and a vector."""
    return np.array([sum(a[i] @ b[k - i] for i in range(k + 1)) for k in range(3)])


def turning(start: Array, phi1: Array, phi2: Array) -> Array:
    """Series of ``start @ exp(phi1 t + phi2 t^2)``."""
    first = skew(phi1)
    return np.array([start, start @ first, start @ (skew(phi2) + first @ first / 2)])


def about(axis: Array, angle: float) -> Array:
    """exp([axis] angle): Rodrigues' formula."""
    k = skew(axis)
    return np.asarray(np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k)


def quaternion(q: Array) -> Array:
    x, y, z, w = q
    v = np.array([x, y, z])
    return np.asarray(np.eye(3) + 2 * w * skew(v) + 2 * skew(v) @ skew(v))


def joint_pose(joint: Joint, q: Array, v: Array, a: Array) -> Pose:
    still = np.zeros((3, 3))
    fixed = np.array([np.eye(3), still, still])
    rest = np.zeros((3, 3))
    match joint.kind:
        case "fixed":
            return Pose(rest, fixed)
        case "prismatic":
            return Pose(np.outer([q[0], v[0], a[0] / 2], joint.axis), fixed)
        case "revolute":
            return Pose(rest, turning(about(joint.axis, q[0]), v[0] * joint.axis, a[0] / 2 * joint.axis))
        case "helical":
            way = joint.pitch / (2 * np.pi) * np.outer([q[0], v[0], a[0] / 2], joint.axis)
            return Pose(way, turning(about(joint.axis, q[0]), v[0] * joint.axis, a[0] / 2 * joint.axis))
        case "continuous":
            angle = float(np.arctan2(q[1], q[0]))
            return Pose(rest, turning(about(joint.axis, angle), v[0] * joint.axis, a[0] / 2 * joint.axis))
        case "universal":
            one, two = (
                turning(about(axis, q[k]), v[k] * axis, a[k] / 2 * axis)
                for k, axis in enumerate((joint.axis, joint.second_axis))
            )
            return Pose(rest, product(one, two))
        case "spherical":
            return Pose(rest, turning(quaternion(q), v, a / 2))
        case "free":
            rotation = turning(quaternion(q[3:]), v[3:], a[3:] / 2)
            start = rotation[0]
            bias = np.cross(v[3:], v[:3])  # x'' = R (v' + w x v)
            return Pose(np.array([q[:3], start @ v[:3], start @ (a[:3] + bias) / 2]), rotation)
    raise ValueError(joint.kind)


def poses(mechanism: Mechanism, q: Array, v: Array, a: Array) -> dict[str, Pose]:
    """Series of every link frame at one sample."""
    nothing = np.zeros((2, 3, 3))
    out = {WORLD: Pose(np.zeros((3, 3)), np.concatenate([np.eye(3)[None], nothing]))}
    for joint in mechanism.joints:
        rates = mechanism.v_slices[joint.name]
        moved = joint_pose(joint, q[mechanism.q_slices[joint.name]], v[rates], a[rates])
        place = np.concatenate([joint.placement.rotation[None], nothing])
        x = product(place, moved.x[:, :, None])[:, :, 0]
        x[0] += joint.placement.position
        parent = out[joint.parent]
        out[joint.child] = Pose(
            parent.x + product(parent.rotation, x[:, :, None])[:, :, 0],
            product(parent.rotation, product(place, moved.rotation)),
        )
    return out


def spin(pose: Pose) -> tuple[Array, Array]:
    """Angular velocity and acceleration, world frame, from R' and R''."""
    start, rate, half = pose.rotation
    omega = rate @ start.T
    alpha = 2 * half @ start.T - omega @ omega
    return tuple(np.array([m[2, 1], m[0, 2], m[1, 0]]) for m in (omega, alpha))  # type: ignore[return-value]


def body_forces(mechanism: Mechanism, link: Link, body: Body, pose: Pose) -> tuple[Array, Array, Array]:
    """Centre of mass, force and moment about it that the body's motion takes; world frame."""
    start = pose.rotation[0]
    com = pose.x + pose.rotation @ body.inertia.com
    omega, alpha = spin(pose)
    tensor = start @ body.inertia.tensor @ start.T
    force = body.inertia.mass * (2 * com[2] - mechanism.gravity)
    return com[0], force, tensor @ alpha + np.cross(omega, tensor @ omega)


def torque(mechanism: Mechanism, q: Array, v: Array, a: Array) -> Array:
    """Effort of one sample, (nv,), with rotor inertia, damping and dry friction."""
    where = poses(mechanism, q, v, a)
    tau = np.array(
        [j.rotor_inertia * a[k] + j.damping * v[k] + j.friction * np.sign(v[k]) for j, k in _coordinates(mechanism)]
    )
    for k in range(mechanism.nv):
        unit = np.eye(mechanism.nv)[k]
        partial = poses(mechanism, q, unit, np.zeros(mechanism.nv))
        for link in mechanism.links:
            for body in link.bodies:
                _, force, moment = body_forces(mechanism, link, body, where[link.name])
                virtual = partial[link.name].x[1] + partial[link.name].rotation[1] @ body.inertia.com
                tau[k] += force @ virtual + moment @ spin(partial[link.name])[0]
    return tau


def _coordinates(mechanism: Mechanism) -> list[tuple[Joint, int]]:
    joints = [j for j in mechanism.joints for _ in range(j.nv)]
    return list(zip(joints, range(mechanism.nv), strict=True))


def wrench(mechanism: Mechanism, joint: Joint, q: Array, v: Array, a: Array) -> Array:
    """Force and moment on the child, at the joint, in the child's frame, (6,)."""
    where = poses(mechanism, q, v, a)
    origin, frame = where[joint.child].x[0], where[joint.child].rotation[0]
    total = np.zeros((2, 3))
    for name in outboard(mechanism, joint):
        for body in mechanism.link_of[name].bodies:
            com, force, moment = body_forces(mechanism, mechanism.link_of[name], body, where[name])
            total += np.array([force, moment + np.cross(com - origin, force)])
    return np.concatenate([frame.T @ total[0], frame.T @ total[1]])


def outboard(mechanism: Mechanism, joint: Joint) -> set[str]:
    """Names of the links that the joint carries."""
    carried = {joint.child}
    for other in mechanism.joints:  # parents before children
        if other.parent in carried:
            carried.add(other.child)
    return carried


def tip(mechanism: Mechanism, link: Link, q: Array) -> Array:
    """Position of a link's tip, world frame, (3,)."""
    zero = np.zeros(mechanism.nv)
    pose = poses(mechanism, q, zero, zero)[link.name]
    return np.asarray(pose.x[0] + pose.rotation[0] @ link.tip)
