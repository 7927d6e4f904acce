"""Nodal results of prepared functions beside the efforts: motion of every node, forces on it, wrenches of the joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexinv.constraints.allocation import GivenLoops
from flexinv.constraints.closures import constraint_rows
from flexinv.constraints.reactions import closing
from flexinv.inverse.applied_forces import applied_forces, joint_springs
from flexinv.inverse.inverse_dynamics import NodalForces, inverse_dynamics, nodal_forces, own_wrenches
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.kinematics.rigid_motion import rigid_motion
from flexinv.typing import Array


@dataclass(frozen=True)
class NodalResult:
    """The motion and the forces of all nodes, of `TorqueFunction.nodal`.

    torque : (samples, nv) effort of every joint coordinate, as `TorqueFunction.torques` has it [N m], [N]
    motion : of all nodes, world frame (`NodalMotion`); forces : P, what acts on every node so that it moves as it does
    wrench : joint -> (samples, 6) force [N] and moment [N m] on the child, at the joint, in the child's link frame
    reaction : closure -> (samples, 6) the same on its second link, as `Solution.loops` has it; empty without closures
    node : link -> number of its link frame's node; body : (link, body) -> number of the node at its centre of mass
    """

    torque: Array
    motion: NodalMotion
    forces: NodalForces
    wrench: dict[str, Array]
    reaction: dict[str, Array]
    node: dict[str, int]
    body: dict[tuple[str, str], int]


def nodal_result(mesh: Mesh, loops: GivenLoops | None, passive: bool, q: Array, qd: Array, qdd: Array) -> NodalResult:
    """Return the motion, forces and wrenches [m, rad, s, N] of q (samples, nq), qd, qdd (samples, nv).

    passive : joint springs, damping and dry friction are part of the efforts; loops : of the closures, where there are some
    Raises InputError for a motion that the closures do not allow, or that the drives cannot give.
    """
    m, motion = mesh.mechanism, rigid_motion(mesh, q, qd, qdd)
    acting = applied_forces(mesh, motion, np.zeros(len(q)))
    second = inverse_dynamics(mesh, motion, qd, qdd, acting, passive)
    torque, forces, wrenches = second.torque, second.forces, second.wrenches
    if passive:
        torque = torque + joint_springs(m, q, history=False)
    reaction: dict[str, Array] = {}
    if loops is not None:
        rows, shares = constraint_rows(mesh), loops.shares(q, qd, qdd, torque)
        pushed, reaction = closing(mesh, motion, rows, shares.multipliers)
        forces = nodal_forces(mesh, motion, pushed + acting)
        wrenches, torque = own_wrenches(mesh, motion, forces), shares.tau
    wrench = {name: wrenches[node] for name, node in mesh.joint_node.items()}
    node = {joint.child: mesh.joint_node[joint.name] for joint in m.joints}
    return NodalResult(torque, motion, forces, wrench, reaction, node, dict(mesh.body_node))
