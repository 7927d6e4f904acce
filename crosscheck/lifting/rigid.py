"""Rigid motions of frames and of what bodies are, in NumPy: composed, inverted, applied to inertias, which are joined."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from flexinv.model.mechanism import Array, Inertia, Placement
from flexinv.model.parallel_axis import compute_parallel_axis_term


def apply_placement(outer: Placement, inner: Placement) -> Placement:
    """Return a frame that is stated in another one in the frame of that one [m]."""
    return Placement(outer.position + outer.rotation @ inner.position, outer.rotation @ inner.rotation)


def inverse(frame: Placement) -> Placement:
    """Return the outer frame in the inner one [m]."""
    turn = frame.rotation.T
    return Placement(-turn @ frame.position, turn)


def compute_relative_pose(first: Placement, second: Placement) -> Placement:
    """Return the second of two frames of one space in the first [m]."""
    return apply_placement(inverse(first), second)


def move_inertia(frame: Placement, body: Inertia) -> Inertia:
    """Return a body that is stated in a frame in the frame outside of it [kg, m, kg m^2]."""
    turn = frame.rotation
    return Inertia.build_unchecked(body.mass, frame.position + turn @ body.com, turn @ body.tensor @ turn.T)


def join_bodies(parts: Iterable[Inertia]) -> Inertia:
    """Return bodies of one frame as one body [kg, m, kg m^2]; tensors by Steiner's theorem.

    A body without mass keeps its centre where it is alone; its tensor is added as it is.
    """
    parts = [part for part in parts if part.mass or part.tensor.any()]
    if len(parts) == 1:
        return parts[0]
    mass = sum(part.mass for part in parts)
    com = sum((part.mass * part.com for part in parts), np.zeros(3)) / (mass or 1.0)
    tensor = np.zeros((3, 3))
    for part in parts:
        tensor = tensor + part.tensor + compute_parallel_axis_term(part.mass, part.com - com)
    return Inertia.build_unchecked(float(mass), com, tensor)


def compute_angle(rotation: Array) -> float:
    """Return the angle of a rotation [rad], with full digits near zero and near a half turn."""
    skew = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    return float(np.arctan2(np.linalg.norm(skew) / 2, (np.trace(rotation) - 1) / 2))


def compute_angle_about(rotation: Array, axis: Array) -> float:
    """Return the angle [rad] by which a rotation turns vectors across an axis about it: exact if it is a turn about the axis."""
    skew = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    return float(np.arctan2(axis @ skew / 2, (np.trace(rotation) - axis @ rotation @ axis) / 2))


def turned(axis: Array, turn: float) -> Array:
    """Return the rotation (3, 3) [-] by an angle [rad] about an axis: Rodrigues's formula."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    made: Array = np.eye(3) + np.sin(turn) * cross + (1 - np.cos(turn)) * cross @ cross
    return made


def build_adjoint(frame: Placement) -> Array:
    """Return Ad (6, 6) [-], [m]: the velocity (v, w) of a frame's origin as that of the outer one, both in their own axes."""
    x, y, z = frame.position
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn = frame.rotation
    return np.block([[turn, cross @ turn], [np.zeros((3, 3)), turn]])


def convert_to_quaternion(rotation: Array) -> Array:
    """Return x, y, z, w [-] of a rotation: the largest of the four is computed from the trace (Shepperd)."""
    squares = np.array([*(2 * np.diag(rotation) - np.trace(rotation)), np.trace(rotation)])
    k = int(np.argmax(squares))
    q = np.empty(4)
    q[k] = np.sqrt(1 + squares[k]) / 2
    antisymmetric = [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    if k == 3:
        q[:3] = np.array(antisymmetric) / (4 * q[3])
        return q
    for other in {0, 1, 2} - {k}:
        q[other] = (rotation[k, other] + rotation[other, k]) / (4 * q[k])
    q[3] = antisymmetric[k] / (4 * q[k])
    return q


def cross(a: Array, b: Array) -> Array:
    """Return a x b [any unit] of two plain vectors (3,): numpy's own takes ten times as long."""
    ax, ay, az = a.tolist()
    bx, by, bz = b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def compute_norm(vector: Array) -> float:
    """Return the length of a plain vector (3,) [its unit]: numpy's own takes several times as long."""
    x, y, z = vector.tolist()
    return math.sqrt(x * x + y * y + z * z)
