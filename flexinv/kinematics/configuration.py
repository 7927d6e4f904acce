"""Joints in compiled code: relative motion of nodes from coordinates, motion of all nodes, and steps of the coordinates.

A joint with one coordinate moves its node by its motion subspace (s, t), both constant in the parent's frame and in its own:
    p = p_0 + q R_0 s      R = R_0 exp(q t)      p' = q' R_0 s      w = q' t        (and likewise p'', al)
"""

from __future__ import annotations

import math
from typing import NamedTuple

from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.records import send_by_address
from flexinv.kernels.so3 import quadratic
from flexinv.kernels.vec3 import ZERO, add, apply, cross, dot, mat, mul, put_at, scale, vec, vec_at
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.tree import compute_child_motion, take_joints, take_sample, write_joint
from flexinv.model.joint_kinds import CONTINUOUS, FREE, SPHERICAL
from flexinv.typing import Array, Indices


@send_by_address
class Nodes(NamedTuple):
    """The nodes of a mesh: see `mesh.Mesh` [-], [m]."""

    parent: Indices
    kind: Indices
    offset: Array
    rotation: Array
    freedoms: Indices
    slide: Array
    turn: Array
    q_index: Indices
    v_index: Indices


def build_nodes(mesh: Mesh) -> Nodes:
    """Return the nodes [m], [-] of a mesh as kernels take them."""
    subspace = mesh.freedoms, mesh.slide, mesh.turn
    return Nodes(mesh.parent, mesh.kind, mesh.offset, mesh.rotation, *subspace, mesh.q_index, mesh.v_index)


@jit_inner
def turn_of(q, first):
    """Return the rotation matrix [-] of the quaternion x, y, z, w at ``first``, normalised first."""
    u = vec_at(q, first)
    w = q[first + 3]
    size = dot(u, u) + w * w
    return quadratic(u, 1.0 - 2.0 * dot(u, u) / size, 2.0 * w / size, 2.0 / size)


@jit_inner
def move_joint(n, nodes, q, qd, qdd, joints):
    """Set the relative motion of node n [m, rad, s] from the coordinates of its joint."""
    kind = nodes.kind[n]
    i = nodes.q_index[n]
    k = nodes.v_index[n]
    placed = mat(nodes.rotation[n])
    p = vec(nodes.offset[n])
    if k < 0:
        write_joint(n, joints, p, ZERO, ZERO, placed, ZERO, ZERO)
    elif kind == SPHERICAL:
        turn = mul(placed, turn_of(q, i))
        write_joint(n, joints, p, ZERO, ZERO, turn, vec_at(qd, k), vec_at(qdd, k))
    elif kind == FREE:
        turn = mul(placed, turn_of(q, i + 3))
        v = vec_at(qd, k)
        w = vec_at(qd, k + 3)
        dp = apply(turn, v)
        ddp = apply(turn, add(vec_at(qdd, k), cross(w, v)))
        write_joint(n, joints, add(p, apply(placed, vec_at(q, i))), dp, ddp, turn, w, vec_at(qdd, k + 3))
    else:
        _move_scalar_joint(n, nodes, q, qd, qdd, joints)


@jit_inner
def _move_scalar_joint(n, nodes, q, qd, qdd, joints):
    """The same of a joint with one velocity coordinate, which slides, turns or does both along one axis."""
    i = nodes.q_index[n]
    k = nodes.v_index[n]
    placed = mat(nodes.rotation[n])
    slide = vec(nodes.slide[n, 0])
    axis = vec(nodes.turn[n, 0])
    p = vec(nodes.offset[n])
    dp = ZERO
    ddp = ZERO
    turn = placed
    w = ZERO
    al = ZERO
    if dot(slide, slide) > 0.0:
        along = apply(placed, slide)
        p = add(p, scale(q[i], along))
        dp = scale(qd[k], along)
        ddp = scale(qdd[k], along)
    if dot(axis, axis) > 0.0:
        c, s = (q[i], q[i + 1]) if nodes.kind[n] == CONTINUOUS else (math.cos(q[i]), math.sin(q[i]))
        turn = mul(placed, quadratic(axis, c, s, 1.0 - c))
        w = scale(qd[k], axis)
        al = scale(qdd[k], axis)
    write_joint(n, joints, p, dp, ddp, turn, w, al)


@jit_inner
def move_joints(nodes, q, qd, qdd, joints):
    """Set the relative motion of all nodes [m, rad, s] from the joints' coordinates."""
    for n in range(nodes.parent.shape[0]):
        move_joint(n, nodes, q, qd, qdd, joints)


@jit_inner
def move_nodes(nodes, q, qd, qdd, joints, frames):
    """Set the motion of all nodes [m, rad, s] from the coordinates."""
    for n in range(nodes.parent.shape[0]):
        move_joint(n, nodes, q, qd, qdd, joints)
        compute_child_motion(n, nodes.parent[n], frames, joints)


@jit_inner
def _turn(q, first, d):
    """The quaternion at ``first`` times that of the rotation vector d: R(q) exp(d)."""
    angle = math.sqrt(dot(d, d))
    step = scale(0.5 * (math.sin(0.5 * angle) / (0.5 * angle) if angle > 0.0 else 1.0), d)
    c = math.cos(0.5 * angle)
    imaginary = vec_at(q, first)
    real = q[first + 3]
    vector = add(add(scale(real, step), scale(c, imaginary)), cross(imaginary, step))
    scalar = real * c - dot(imaginary, step)
    size = 1.0 / math.sqrt(dot(vector, vector) + scalar * scalar)
    put_at(q, first, scale(size, vector))
    q[first + 3] = size * scalar


@jit_inner
def integrate_coordinates(nodes, q, d):
    """Move q [rad], [m] in place along the increment d of the velocity coordinates; joints with none stay as they are."""
    for n in range(nodes.parent.shape[0]):
        kind = nodes.kind[n]
        i = nodes.q_index[n]
        k = nodes.v_index[n]
        if k < 0:
            continue
        if kind == CONTINUOUS:
            if d[k] != 0.0:
                c = math.cos(d[k])
                s = math.sin(d[k])
                x = q[i] * c - q[i + 1] * s
                y = q[i] * s + q[i + 1] * c
                size = 1.0 / math.sqrt(x * x + y * y)
                q[i] = size * x
                q[i + 1] = size * y
        elif kind == SPHERICAL:
            psi = vec_at(d, k)
            if dot(psi, psi) > 0.0:
                _turn(q, i, psi)
        elif kind == FREE:
            move = vec_at(d, k)
            psi = vec_at(d, k + 3)
            if dot(move, move) + dot(psi, psi) > 0.0:
                put_at(q, i, add(vec_at(q, i), apply(turn_of(q, i + 3), move)))
                _turn(q, i + 3, psi)
        else:
            q[i] += d[k]


@jit
def integrate_array(nodes, q, d):
    """Move q (nq,) [rad], [m] in place by `integrate_coordinates`."""
    integrate_coordinates(nodes, q, d)


@jit
def fill_relative_motion(nodes, q, qd, qdd, out):
    """Set the relative motion of all nodes, `Joints` (samples, nodes, ...) [m, rad, s], from the joints' coordinates."""
    for s in range(q.shape[0]):
        move_joints(nodes, q[s], qd[s], qdd[s], take_joints(out, s))


@jit
def fill_world_motion(nodes, q, qd, qdd, joints, frames):
    """Set the motion of all nodes in the world, (samples, nodes, ...) [m, rad, s]; joints : scratch of one sample."""
    for s in range(q.shape[0]):
        move_nodes(nodes, q[s], qd[s], qdd[s], joints, take_sample(frames, s))


@jit_inner
def read_coordinate(n, nodes, q):
    """Return the coordinate [rad], [m] of a joint that has one; of a continuous joint the angle in -pi .. pi."""
    i = nodes.q_index[n]
    return math.atan2(q[i + 1], q[i]) if nodes.kind[n] == CONTINUOUS else q[i]


@jit
def fill_relative(nodes, q, qd, qdd, joints):
    """Set the relative motion of all nodes [m, rad, s] by `move_joints`."""
    move_joints(nodes, q, qd, qdd, joints)


@jit
def fill_given(nodes, q, qd, qdd, prescribed, given):
    """Set coordinate, rate and its rate [rad], [m], [1/s] of joints that turn or slide, (joints, 3) in the order of nodes.

    prescribed : (nodes,) whether a node has a joint with a motion that is given
    """
    k = 0
    for n in range(nodes.parent.shape[0]):
        if prescribed[n]:
            v = nodes.v_index[n]
            given[k, 0] = read_coordinate(n, nodes, q)
            given[k, 1] = qd[v]
            given[k, 2] = qdd[v]
            k += 1
