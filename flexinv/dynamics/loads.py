"""Given forces and moments on points of nodes, as the march takes them (compiled).

A dead load keeps its direction in the world, a follower in the node's frame; at a lever arm p (node's frame) it is

    dead      force F, moment about the node (own frame)  R^T M + p x R^T F
    follower  force R F, moment  M + p x F
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.kernels.jit import jit_inner
from flexinv.kernels.records import by_address
from flexinv.kernels.vec3 import add, add_to, apply, cross, mat, scale, tapply, vec, vec_at
from flexinv.kinematics.mesh import Mesh, attachment_node
from flexinv.typing import Array


@by_address
class Loads(NamedTuple):
    """Loads on points of nodes, one row each.

    node : (loads,); place : (loads, 3) [m] lever arm in the node's frame; follower : (loads,)
    wrench : (loads, 6) force [N] then moment [N m] now, in world axes or a follower's node axes
    effort : (unknowns,) of the drives of torque-driven joints now [N m], [N]
    level : (1,) part of all loads, springs and gravity that acts [-]: 1, less while an equilibrium is approached
    """

    node: NDArray[np.int64]
    place: Array
    follower: NDArray[np.bool_]
    wrench: Array
    effort: Array
    level: Array


def loads_of(mesh: Mesh, unknowns: int) -> Loads:
    """Return the given forces of a mechanism on its links, wrenches [N], [N m] and efforts still zero."""
    forces = [f for f in mesh.mechanism.forces if attachment_node(mesh, f.at) >= 0]
    nodes = np.array([attachment_node(mesh, f.at) for f in forces], dtype=np.int64)
    place = np.array([f.at.placement.position for f in forces], dtype=float).reshape(-1, 3)
    follower = np.array([f.follower for f in forces], dtype=bool)
    return Loads(nodes, place, follower, np.zeros((len(forces), 6)), np.zeros(unknowns), np.ones(1))


def load_table(mesh: Mesh, time: Array) -> Array:
    """Return the wrenches of `loads_of` over ``time`` (samples,) [s], (samples, loads, 6) [N], [N m]."""
    forces = [f for f in mesh.mechanism.forces if attachment_node(mesh, f.at) >= 0]
    out = np.zeros((len(time), len(forces), 6))
    for k, force in enumerate(forces):
        out[:, k] = np.stack([np.interp(time, force.time, column) for column in force.wrench.T], axis=1)
        if force.follower:  # from the attachment's axes to the node's
            turn = force.at.placement.rotation
            out[:, k] = np.hstack([out[:, k, :3] @ turn.T, out[:, k, 3:] @ turn.T])
    return out


@jit_inner
def set_loads(loads, wrenches, efforts):
    """Set the wrenches (loads, 6) [N], [N m] and, where there are any, the drives' efforts (unknowns,) [N m], [N]."""
    for k in range(len(loads.node)):
        for i in range(6):
            loads.wrench[k, i] = wrenches[k, i]
    for i in range(len(efforts)):
        loads.effort[i] = efforts[i]


@jit_inner
def add_loads(topology, frames, variation, loads, work, want_tangent):
    """Take the loads off the wrenches of their nodes, and their variation off that of the wrenches [N], [N m]."""
    for k in range(len(loads.node)):
        n, p = loads.node[k], vec(loads.place[k])
        r = mat(frames.r[n])
        force, moment = scale(loads.level[0], vec(loads.wrench[k])), scale(loads.level[0], vec_at(loads.wrench[k], 3))
        own = force if loads.follower[k] else tapply(r, force)
        turn = moment if loads.follower[k] else tapply(r, moment)
        add_to(work.wrench[n], 0, scale(-1.0, apply(r, own)))
        add_to(work.wrench[n], 3, scale(-1.0, add(turn, cross(p, own))))
        for c in range(topology.size[topology.block[n]] if want_tangent else 0):
            theta = vec(variation.t[n, c])
            if loads.follower[k]:
                add_to(work.dwrench[n, c], 0, apply(r, cross(own, theta)))
            else:  # d(R^T F) = R^T F x theta
                add_to(work.dwrench[n, c], 3, add(cross(theta, turn), cross(p, cross(theta, own))))
