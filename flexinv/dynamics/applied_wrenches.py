"""Springs between points and given forces on nodes at one instant, and the efforts that they ask of the joints (compiled).

The formulas are those of `inverse_dynamics.compute_applied_forces`, for callers that have one instant and no time to allocate:

    spring   pull = stiffness (l - rest) or its law, + damping l', on both ends towards each other
    force    constant in the world, or a follower in its node's frame
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexinv.dynamics.loads import TINY, build_law_tables, build_load_table, build_loads, evaluate_pull
from flexinv.inverse.nodal_sums import add_outboard_forces, fill_instant_forces
from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.memory import make_contiguous
from flexinv.kernels.records import send_by_address
from flexinv.kernels.vec3 import ZERO, add, add_pair, apply, cross, dot, mat, put_pair, scale, sub, tapply, vec, vec_at
from flexinv.kinematics.configuration import build_nodes, move_nodes
from flexinv.kinematics.mesh import Mesh, find_attachment_node
from flexinv.kinematics.tree import Frames, Joints, take_sample
from flexinv.model.links import Attachment
from flexinv.model.owned_cache import make_owner_cache
from flexinv.typing import Array, Indices, Mask


@send_by_address
class AppliedLoads(NamedTuple):
    """Springs between points and constant forces, one row each.

    node : (forces,); place : (forces, 3) [m] lever arm in the node's frame; follower : (forces,)
    wrench : (forces, 6) [N], [N m] in world axes or a follower's node axes
    first_node, second_node : (springs,) nodes of the ends, -1 the world
    first_place, second_place : (springs, 3) [m] in the frames of these nodes
    stiffness [N/m], rest [m], damping [N s/m], law .. pieces : as `dynamics.loads.SpringRows`
    """

    node: Indices
    place: Array
    follower: Mask
    wrench: Array
    first_node: Indices
    second_node: Indices
    first_place: Array
    second_place: Array
    stiffness: Array
    rest: Array
    damping: Array
    law: Indices
    gas: Array
    first: Indices
    last: Indices
    pieces: Array


@make_owner_cache()
def build_applied_loads(mesh: Mesh) -> AppliedLoads:
    """Return the springs between points [N/m], [m], [N s/m] and the given forces at t = 0 [N], [N m] of a mesh."""
    forces = build_loads(mesh, 0)
    springs = mesh.mechanism.springs
    first, second = (_list_ends(mesh, ends) for ends in ([s.first for s in springs], [s.second for s in springs]))
    stiffness, rest, damping = (
        np.array([(s.stiffness, s.rest, s.damping) for s in springs], dtype=float).reshape(-1, 3).T.copy()
    )
    law, gas, begin, last, pieces = build_law_tables(springs)
    return AppliedLoads(
        node=forces.node, place=forces.place, follower=forces.follower, wrench=build_load_table(mesh, np.zeros(1))[0],
        first_node=first[0], second_node=second[0], first_place=first[1], second_place=second[1],
        stiffness=stiffness, rest=rest, damping=damping, law=law, gas=gas, first=begin, last=last, pieces=pieces,
    )  # fmt: skip


def _list_ends(mesh: Mesh, ends: Sequence[Attachment]) -> tuple[Indices, Array]:
    """Nodes of the ends of springs, and where these are in their frames, (springs, 3) [m]."""
    nodes = np.array([find_attachment_node(mesh, end) for end in ends], dtype=np.int64)
    return nodes, np.array([end.placement.position for end in ends], dtype=float).reshape(-1, 3)


@jit_inner
def _compute_end(frames, n, place):
    """Lever arm, position and velocity of a point of a node, or of the world."""
    if n < 0:
        return ZERO, vec(place), ZERO
    r = mat(frames.r[n])
    arm = apply(r, vec(place))
    spin = apply(r, cross(vec(frames.w[n]), vec(place)))
    return arm, add(vec(frames.x[n]), arm), add(vec(frames.v[n]), spin)


@jit_inner
def _add_wrench(frames, n, arm, force, moment, line):
    """Take a force at a lever arm and a moment off the wrench of a node; return their power [W]."""
    if n < 0:
        return 0.0
    turn = add(moment, cross(arm, force))
    add_pair(line[n], scale(-1.0, force), scale(-1.0, turn))
    return dot(force, vec(frames.v[n])) + dot(turn, apply(mat(frames.r[n]), vec(frames.w[n])))


@jit_inner
def take_applied_wrenches(loads, frames, line):
    """Take springs and forces off the wrenches of their nodes, ``line`` (nodes, 6) [N], [N m]; return their power [W]."""
    power = 0.0
    for k in range(len(loads.stiffness)):
        a = loads.first_node[k]
        b = loads.second_node[k]
        arm_a, xa, va = _compute_end(frames, a, loads.first_place[k])
        arm_b, xb, vb = _compute_end(frames, b, loads.second_place[k])
        gap = sub(xb, xa)
        length = np.sqrt(dot(gap, gap))
        along = scale(1.0 / max(length, TINY), gap)
        pull, _ = evaluate_pull(loads, k, length)
        pulls = scale(pull + loads.damping[k] * dot(along, sub(vb, va)), along)  # on a, towards b
        power += _add_wrench(frames, a, arm_a, pulls, ZERO, line)
        power += _add_wrench(frames, b, arm_b, scale(-1.0, pulls), ZERO, line)
    for k in range(len(loads.node)):
        n = loads.node[k]
        r = mat(frames.r[n])
        force = vec(loads.wrench[k])
        moment = vec_at(loads.wrench[k], 3)
        if loads.follower[k]:
            force = apply(r, force)
            moment = apply(r, moment)
        power += _add_wrench(frames, n, apply(r, vec(loads.place[k])), force, moment, line)
    return power


@jit
def fill_applied_efforts(nodes, loads, motion, scratch, samples, out):
    """Set the efforts that the joints of a rigid mechanism give against springs and forces [N m], [N], (samples, nv).

    motion : q (samples, nq), qd, qdd (samples, nv) [rad or m, s]; scratch : `Joints` and `Frames` of all nodes, the latter with a
    leading axis of one sample, and wrenches (nodes, 6); out : (samples, nv)
    """
    q, qd, qdd = motion
    joints, frames, line = scratch
    now = take_sample(frames, 0)
    for s in range(samples):
        move_nodes(nodes, q[s], qd[s], qdd[s], joints, now)
        for n in range(line.shape[0]):
            put_pair(line[n], ZERO, ZERO)
        take_applied_wrenches(loads, now, line)
        add_outboard_forces(nodes.parent, now.x, line)
        for n in range(line.shape[0]):
            if nodes.freedoms[n] > 0:
                turned = mat(now.r[n])
                force = tapply(turned, vec(line[n]))
                moment = tapply(turned, vec_at(line[n], 3))
                for i in range(nodes.freedoms[n]):
                    effort = dot(vec(nodes.slide[n, i]), force) + dot(vec(nodes.turn[n, i]), moment)
                    out[s, nodes.v_index[n] + i] = effort


@jit
def fill_link_wrenches(nodes, masses, loads, motion, scratch):
    """Place all nodes of a rigid mechanism at one sample, and sum on and beyond each what must act on it [m, rad, s, N].

    motion : q (1 or more, nq), qd, qdd, of which the first sample is taken; scratch : as of `fill_applied_efforts`
    """
    q, qd, qdd = motion
    joints, frames, line = scratch
    now = take_sample(frames, 0)
    move_nodes(nodes, q[0], qd[0], qdd[0], joints, now)
    fill_instant_forces(masses, now, line)
    take_applied_wrenches(loads, now, line)
    add_outboard_forces(nodes.parent, now.x, line)


def compute_applied_efforts(mesh: Mesh, q: Array, qd: Array, qdd: Array) -> Array:
    """Return the efforts that the joints of a rigid mechanism give against springs and forces [N m], [N], (samples, nv).

    q : (samples, nq), qd, qdd : (samples, nv) [rad or m, s]
    """
    out = np.zeros(qd.shape)
    motion = make_contiguous(q), make_contiguous(qd), make_contiguous(qdd)
    loads = build_applied_loads(mesh)
    fill_applied_efforts(build_nodes(mesh), loads, motion, make_scratch(mesh), len(out), out)
    return out


def make_scratch(mesh: Mesh) -> tuple[Joints, Frames, Array]:
    """Return room for the motion of all nodes at one sample [m, rad, s], and for their wrenches [N], [N m]."""
    vector = mesh.size, 3
    matrix = mesh.size, 3, 3
    joints = Joints(*(np.zeros(shape) for shape in (*3 * [vector], matrix, *2 * [vector])))
    frames = Frames(*(np.zeros((1, *shape)) for shape in (vector, matrix, *4 * [vector])))
    return joints, frames, np.zeros((mesh.size, 6))
