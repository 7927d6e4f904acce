"""Springs between points and given forces on nodes at one instant, and the efforts that they ask of the joints (compiled).

The formulas are those of `inverse_dynamics.compute_applied_forces`, for callers that have one instant and no time to allocate:

    spring   pull = stiffness (l - rest) or its law, + damping l', on both ends towards each other
    force    constant in the world, or a follower in its node's frame
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexinv.constraints.equations import compute_gap
from flexinv.dynamics.loads import (
    TINY,
    Loads,
    SpringLaws,
    build_load_table,
    build_loads,
    build_spring_laws,
    evaluate_pull,
)
from flexinv.inverse.nodal_sums import add_outboard_forces, fill_instant_forces
from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.memory import make_contiguous
from flexinv.kernels.records import send_by_address
from flexinv.kernels.vec3 import ZERO, add, add_pair, apply, cross, dot, mat, pair, put_pair, scale, tapply_pair, vec
from flexinv.kinematics.configuration import build_nodes, move_nodes
from flexinv.kinematics.mesh import Mesh, find_attachment_node
from flexinv.kinematics.tree import Frames, Joints, compute_wrench_effort, make_room, take_sample
from flexinv.model.links import Attachment
from flexinv.model.owned_cache import make_owner_cache
from flexinv.typing import Array, Indices


@send_by_address
class AppliedLoads(NamedTuple):
    """Springs between points and constant forces.

    forces : given ones, wrenches [N], [N m] at t = 0; laws : of the springs
    first_node, second_node : (springs,) nodes of the ends, -1 the world
    first_place, second_place : (springs, 3) [m] in the frames of these nodes
    """

    forces: Loads
    laws: SpringLaws
    first_node: Indices
    second_node: Indices
    first_place: Array
    second_place: Array


@make_owner_cache()
def build_applied_loads(mesh: Mesh) -> AppliedLoads:
    """Return the springs between points [N/m], [m], [N s/m] and the given forces at t = 0 [N], [N m] of a mesh."""
    springs = mesh.mechanism.springs
    (a, place_a), (b, place_b) = (
        _list_ends(mesh, ends) for ends in ([s.first for s in springs], [s.second for s in springs])
    )
    forces = build_loads(mesh, 0)._replace(wrench=build_load_table(mesh, np.zeros(1))[0])
    return AppliedLoads(forces, build_spring_laws(springs), a, b, place_a, place_b)


def _list_ends(mesh: Mesh, ends: Sequence[Attachment]) -> tuple[Indices, Array]:
    """Nodes of the ends of springs, and where these are in their frames, (springs, 3) [m]."""
    nodes = np.array([find_attachment_node(mesh, end) for end in ends], dtype=np.int64)
    return nodes, np.array([end.placement.position for end in ends], dtype=float).reshape(-1, 3)


@jit_inner
def _take_wrench(frames, n, place, force, moment, line):
    """Take a force at a place of a node and a moment, in the world, off the wrench of the node; return their power [W]."""
    if n < 0:
        return 0.0
    r = mat(frames.r[n])
    turn = add(moment, cross(apply(r, vec(place)), force))
    add_pair(line[n], scale(-1.0, force), scale(-1.0, turn))
    return dot(force, vec(frames.v[n])) + dot(turn, apply(r, vec(frames.w[n])))


@jit_inner
def take_applied_wrenches(loads, frames, line):
    """Take springs and forces off the wrenches of their nodes, ``line`` (nodes, 6) [N], [N m]; return their power [W]."""
    power = 0.0
    laws = loads.laws
    for k in range(len(laws.stiffness)):
        a = loads.first_node[k]
        b = loads.second_node[k]
        gap, rate, _ = compute_gap(frames, a, b, vec(loads.first_place[k]), vec(loads.second_place[k]))
        length = np.sqrt(dot(gap, gap))
        along = scale(1.0 / max(length, TINY), gap)
        pull, _ = evaluate_pull(laws, k, length)
        pulls = scale(pull + laws.damping[k] * dot(along, rate), along)  # on a, towards b
        power += _take_wrench(frames, a, loads.first_place[k], pulls, ZERO, line)
        power += _take_wrench(frames, b, loads.second_place[k], scale(-1.0, pulls), ZERO, line)
    forces = loads.forces
    for k in range(len(forces.node)):
        n = forces.node[k]
        force, moment = pair(forces.wrench[k])
        if forces.follower[k]:
            r = mat(frames.r[n])
            force = apply(r, force)
            moment = apply(r, moment)
        power += _take_wrench(frames, n, forces.place[k], force, moment, line)
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
                wrench = tapply_pair(mat(now.r[n]), pair(line[n]))
                for i in range(nodes.freedoms[n]):
                    out[s, nodes.v_index[n] + i] = compute_wrench_effort(nodes, n, i, wrench)


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
    return make_room(Joints, mesh.size), make_room(Frames, 1, mesh.size), np.zeros((mesh.size, 6))
