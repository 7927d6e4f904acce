"""Rotations, joint poses and beam axes for Exudyn's models: small, own code, shared with nobody.

A pose is a ``Placement``: ``x_A = position + rotation @ x_B``.  Poses over time are a pair ``position (samples, 3)``
and ``rotation (samples, 3, 3)``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexinv.model.mechanism import Beam, Inertia, Joint, Mechanism, Placement

Array = NDArray[np.float64]
ONE = np.eye(3)


def turn(axis: Array, angle: Array | float) -> Array:
    """Return the rotation about a unit axis, R = 1 + sin(a) [n] + (1 - cos(a)) [n]^2 (Rodrigues).

    axis : (3,) [-]; angle : (...) [rad]; returns : (..., 3, 3) [-]
    """
    n = skew(axis)
    a = np.asarray(angle, dtype=np.float64)[..., None, None]
    return np.asarray(ONE + np.sin(a) * n + (1.0 - np.cos(a)) * (n @ n))


def skew(v: Array) -> Array:
    """Return the matrix of the cross product, skew(v) @ x = v x x.  v : (3,); returns : (3, 3)."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def convert_from_quaternion(q: Array) -> Array:
    """Return R of unit quaternions x, y, z, w.  q : (samples, 4) [-]; returns : (samples, 3, 3) [-]."""
    x, y, z, w = q.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)  # (sample, row, column)


def convert_to_quaternion(r: Array) -> Array:
    """Return the unit quaternion w, x, y, z of one rotation (Exudyn's order), the largest component from the trace.

    r : (3, 3) [-]; returns : (4,) [-]
    """
    # 4 q q^T is linear in R; its column of largest diagonal gives q without loss of digits (Shepperd 1978).
    k = np.empty((4, 4))
    k[0, 0] = 1.0 + np.trace(r)
    k[1:, 1:] = r + r.T + (1.0 - np.trace(r)) * np.eye(3)
    k[0, 1:] = k[1:, 0] = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    column = k[:, int(np.argmax(np.diag(k)))]
    return np.asarray(column / np.linalg.norm(column))


def convert_to_tait_bryan(r: Array) -> Array:
    """Return angles a, b, c with R = Rx(a) Ry(b) Rz(c), Exudyn's ``RotXYZ``.

    r : (samples, 3, 3) [-]; returns : (samples, 3) [rad]
    """
    b = np.arcsin(np.clip(r[:, 0, 2], -1.0, 1.0))
    a = np.arctan2(-r[:, 1, 2], r[:, 2, 2])
    rest = np.swapaxes(turn(np.array([1.0, 0.0, 0.0]), a), 1, 2) @ r  # Ry(b) Rz(c), right also where b is +-90 degrees
    c = np.arctan2(rest[:, 1, 0], rest[:, 1, 1])
    return np.stack([a, b, c], axis=1)  # (sample, angle)


def build_frame_along(x: Array, hint: Array | None = None) -> Array:
    """Return a rotation whose first column is the unit vector x and whose second lies nearest to ``hint``.

    x, hint : (3,) [-]; returns : (3, 3) [-]
    """
    y = np.eye(3)[int(np.argmin(np.abs(x)))] if hint is None else hint
    y = y - x * float(x @ y)
    y = y / np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def compute_scalar_coordinate(joint: Joint, q: Array) -> Array:
    """Return the coordinate of a revolute, continuous, prismatic or helical joint as one continuous number.

    q : (samples, nq of the joint); returns : (samples,) [rad] or [m]
    """
    if joint.kind == "continuous":
        return np.asarray(np.unwrap(np.arctan2(q[:, 1], q[:, 0])))
    return q[:, 0]


def compute_joint_pose(joint: Joint, q: Array) -> tuple[Array, Array]:
    """Return the child's frame in the joint frame.

    q : (samples, nq of the joint); returns : position (samples, 3) [m], rotation (samples, 3, 3) [-]
    """
    n = len(q)
    if joint.kind in ("revolute", "continuous"):
        return np.zeros((n, 3)), turn(joint.axis, compute_scalar_coordinate(joint, q))
    p = np.zeros((n, 3))
    r = np.tile(ONE, (n, 1, 1))
    if joint.kind == "prismatic":
        p = q * joint.axis
    elif joint.kind == "helical":  # no joint of Exudyn: its motion and its dual are prescribed
        p = joint.pitch / (2 * np.pi) * q * joint.axis
        r = turn(joint.axis, q[:, 0])
    elif joint.kind == "universal":
        r = turn(joint.axis, q[:, 0]) @ turn(joint.second_axis, q[:, 1])
    elif joint.kind in ("spherical", "free"):
        r = convert_from_quaternion(q[:, -4:])
        p = q[:, :3] if joint.kind == "free" else p
    return p, r


def compute_joint_twist(joint: Joint, q: Array, qd: Array) -> tuple[Array, Array]:
    """Return velocity and angular velocity of the child relative to the joint frame, in the child's frame.

    q : (nq of the joint,); qd : (nv of the joint,); returns : (3,) [m/s], (3,) [rad/s]
    """
    v = np.zeros(3)
    w = np.zeros(3)
    if joint.kind in ("revolute", "continuous"):
        w = joint.axis * qd[0]
    elif joint.kind == "prismatic":
        v = joint.axis * qd[0]
    elif joint.kind == "helical":
        v = joint.pitch / (2 * np.pi) * joint.axis * qd[0]
        w = joint.axis * qd[0]
    elif joint.kind == "universal":
        w = turn(joint.second_axis, q[1]).T @ joint.axis * qd[0] + joint.second_axis * qd[1]
    elif joint.kind == "spherical":
        w = qd
    elif joint.kind == "free":
        v = qd[:3]
        w = qd[3:]
    return v, w


def can_slide(joint: Joint) -> bool:
    """Return True if a joint with one coordinate slides along its axis."""
    return bool(joint.nv == 1 and compute_joint_twist(joint, np.zeros(joint.nq), np.ones(1))[0].any())


def can_turn(joint: Joint) -> bool:
    """Return False only if a joint with one coordinate does not turn."""
    return bool(joint.nv != 1 or compute_joint_twist(joint, np.zeros(joint.nq), np.ones(1))[1].any())


def compute_effort_axes(joint: Joint, q: Array) -> tuple[Array, Array]:
    """Return the axes that map the joint's wrench to its efforts: effort_k = force . F_k + moment . M_k.

    The columns are the partial velocities of the child in its own frame, so this is the dual of ``compute_joint_twist``.
    q : (samples, nq of the joint); returns : F and M (samples, nv of the joint, 3) [-]
    """
    f = np.zeros((len(q), joint.nv, 3))
    m = np.zeros((len(q), joint.nv, 3))
    for s in range(len(q)):
        for k, unit in enumerate(np.eye(joint.nv)):
            f[s, k], m[s, k] = compute_joint_twist(joint, q[s], unit)
    return f, m


def compose(outer: Placement, inner: Placement) -> Placement:
    """Return X_AC = X_AB X_BC."""
    return Placement(outer.position + outer.rotation @ inner.position, outer.rotation @ inner.rotation)


def inverse(outer: Placement) -> Placement:
    """Return X_BA of X_AB."""
    return Placement(-outer.rotation.T @ outer.position, outer.rotation.T)


def compute_section_pose(beam: Beam, s: float) -> Placement:
    """Return the undeformed cross-section frame at arc length s in the root frame: an arc of constant curvature.

    R(s) = exp(s k), x(s) = int_0^s R e_1 ds.     s : [m]
    """
    size = float(np.linalg.norm(beam.curvature))
    if size == 0.0:
        return Placement(np.array([s, 0.0, 0.0]), np.eye(3))
    n = beam.curvature / size
    a = size * s
    big = skew(n)
    v = s * np.eye(3) + (1.0 - np.cos(a)) / size * big + (a - np.sin(a)) / size * (big @ big)
    return Placement(v[:, 0], turn(n, a))


def evaluate_section(beam: Beam, fraction: float) -> tuple[Array, float, Array]:
    """Return stiffness (6,) [N, N m^2], mass per length [kg/m] and rotary inertia (3,) [kg m] at a fraction [-]."""
    s = beam.section.check_independent("Exudyn's beams")
    stiffness = np.array([np.interp(fraction, s.stations, c) for c in s.stiffness.T])
    rotary = np.array([np.interp(fraction, s.stations, c) for c in s.rotary_inertia.T])
    return stiffness, float(np.interp(fraction, s.stations, s.mass_per_length)), rotary


def evaluate_damping(beam: Beam, fraction: float) -> Array:
    """Return stress by rate of strain (6,) [N s, N m^2 s] at a fraction [-], in the order of the stiffness."""
    s = beam.section.check_independent("Exudyn's beams")
    if s.damping is None:
        return np.zeros(6)
    return np.array([np.interp(fraction, s.stations, c) for c in s.damping.T])


def join_inertias(parts: list[tuple[Inertia, Placement]]) -> Inertia:
    """Return one body of several that are fixed to each other (Huygens-Steiner).

    parts : inertia and its frame in the common frame
    """
    mass = sum(i.mass for i, _ in parts)
    if mass == 0.0:
        tensors = [x.rotation @ i.tensor @ x.rotation.T for i, x in parts]
        return Inertia.build_unchecked(0.0, np.zeros(3), sum(tensors, np.zeros((3, 3))))
    points = [x.position + x.rotation @ i.com for i, x in parts]
    com = sum((i.mass * p for (i, _), p in zip(parts, points, strict=True)), np.zeros(3)) / mass
    tensor = np.zeros((3, 3))
    for (i, x), p in zip(parts, points, strict=True):
        d = skew(p - com)
        tensor = tensor + x.rotation @ i.tensor @ x.rotation.T - i.mass * d @ d
    return Inertia.build_unchecked(mass, com, tensor)


def take_joint_q(mechanism: Mechanism, joint: Joint, q: Array) -> Array:
    """Return the columns of one joint.  q : (samples, nq); returns : (samples, nq of the joint)."""
    return q[:, mechanism.q_slices[joint.name]]
