"""Efforts of one instant of a march with what acts beside its joints: springs between points, forces, closed loops (compiled).

    tau = L T (P - applied - C^T lambda) + springs of joints that turn without end, over whole turns

lambda are the multipliers that the step has found.  `balance.evaluate_guarded_torques` is the same without all that.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flexinv.constraints.closures import build_constraint_rows
from flexinv.constraints.equations import Rows
from flexinv.dynamics.applied_wrenches import AppliedLoads, build_applied_loads, take_applied_wrenches
from flexinv.elements.joint_law import take_joint_law
from flexinv.inverse.balance import add_step, compute_instant_energies
from flexinv.inverse.nodal_sums import add_outboard_forces, fill_instant_forces, fill_projected_efforts
from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.records import send_by_address
from flexinv.kernels.vec3 import ZERO, add, add_pair, apply, cross, mat, scale, sub, vec
from flexinv.kinematics.configuration import read_coordinate
from flexinv.kinematics.mesh import Mesh
from flexinv.model.joint_kinds import CONTINUOUS
from flexinv.typing import Array


@send_by_address
class InstantLoads(NamedTuple):
    """Loads of one instant beside the joints.

    applied : springs between points and given forces; rows : constraints of the closures
    multipliers : (rows,) of the closures, which the march sets [N], [N m]
    wound : (nodes,) angle of each spring in a joint that turns without end, whole turns included [rad], 0 at the start
    """

    applied: AppliedLoads
    rows: Rows
    multipliers: Array
    wound: Array


def build_instant_loads(mesh: Mesh, multipliers: Array) -> InstantLoads:
    """Return the loads of a mesh [N], [N m], [rad] with the multipliers (rows,) that a march sets."""
    return InstantLoads(build_applied_loads(mesh), build_constraint_rows(mesh), multipliers, np.zeros(mesh.size))


@jit_inner
def _take_wrench(frames, n, arm, force, moment, line):
    """Take a force at a lever arm and a moment, all in the world, off the wrench of a node."""
    if n >= 0:
        add_pair(line[n], scale(-1.0, force), scale(-1.0, add(moment, cross(arm, force))))


@jit_inner
def _turn_with(frames, n, vector):
    """A vector of a node's frame in the world, or one of the world."""
    return vec(vector) if n < 0 else apply(mat(frames.r[n]), vec(vector))


@jit_inner
def take_closure_wrenches(rows, multipliers, frames, line):
    """Take what closures do off the wrenches of their nodes, ``line`` (nodes, 6) [N], [N m] in the world.

    position u . d : lambda u on B at its point, and the opposite there on A
    direction u . w : lambda w x u on B, and the opposite on A
    """
    for k in range(len(multipliers)):
        a = rows.a[k]
        b = rows.b[k]
        u = scale(multipliers[k], _turn_with(frames, a, rows.u[k]))
        back = scale(-1.0, u)
        if rows.direction[k]:
            turn = cross(_turn_with(frames, b, rows.w[k]), u)
            _take_wrench(frames, b, ZERO, ZERO, turn, line)
            _take_wrench(frames, a, ZERO, ZERO, scale(-1.0, turn), line)
            continue
        arm = _turn_with(frames, b, rows.place_b[k])
        point = add(vec(frames.x[b]), arm) if b >= 0 else arm
        _take_wrench(frames, b, arm, u, ZERO, line)
        if a >= 0:
            _take_wrench(frames, a, sub(point, vec(frames.x[a])), back, ZERO, line)


@jit_inner
def _add_winding_efforts(nodes, drives, q, wound, tau):
    """Add what springs of joints that turn without end ask for whole turns, and remember where they are wound to."""
    for n in range(len(wound)):
        if drives.freedoms[n] == 0 or nodes.kind[n] != CONTINUOUS:
            continue
        stiffness = take_joint_law(drives.law, n).stiffness
        if stiffness != 0.0:
            angle = read_coordinate(n, nodes, q)
            turns = 2.0 * math.pi * np.round((wound[n] - angle) / (2.0 * math.pi))
            wound[n] = angle + turns
            tau[nodes.v_index[n]] += stiffness * turns


@jit
def evaluate_loaded_torques(nodes, drives, masses, frames, motion, instant, loads, tau):
    """Set the efforts of one instant (nv,) [N m], [N], and add its step; return if it is judged, and its energies [J]."""
    fill_instant_forces(masses, frames, instant.line)
    power = take_applied_wrenches(loads.applied, frames, instant.line)
    take_closure_wrenches(loads.rows, loads.multipliers, frames, instant.line)
    add_outboard_forces(nodes.parent, frames.x, instant.line)
    fill_projected_efforts(nodes, drives, frames, instant.line, motion, tau)
    _add_winding_efforts(nodes, drives, motion[0], loads.wound, tau)
    holds, potential, driven = compute_instant_energies(masses, frames, instant.stored, instant.driven, tau, motion[1])
    return add_step(instant.account, holds, potential, driven + power), holds, potential
