"""Nodal forces P, their sums along the tree and joint efforts, tau = L T P without the matrices, over all samples (compiled).

Every sample's motion is read once, at the speed of the memory, and all that follows from it is written: nodal forces, joint
efforts, balances, tips.  So the second step costs a tenth of the march before it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexinv.elements.joint_law import compute_joint_effort, take_joint_law
from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.records import send_by_address
from flexinv.kernels.vec3 import (
    ZERO,
    add,
    add_pair,
    apply,
    cross,
    dot,
    mat,
    pair,
    put,
    put_pair,
    scale,
    sub,
    tapply,
    tapply_pair,
    vec,
)
from flexinv.kinematics.configuration import read_coordinate
from flexinv.kinematics.tree import compute_wrench_effort, take_sample
from flexinv.typing import Array, Indices


@jit_inner
def compute_nodal_force(masses, n, frames):
    """Return P = M (a - g) [N] and Q = R (J al + w x J w) [N m] of node n; masses : `Masses`, or what has its fields."""
    w = vec(frames.w[n])
    tensor = mat(masses.inertia[n])
    body = add(apply(tensor, vec(frames.al[n])), cross(w, apply(tensor, w)))
    force = scale(masses.mass[n], sub(vec(frames.a[n]), vec(masses.gravity)))
    return force, apply(mat(frames.r[n]), body)


@send_by_address
class Masses(NamedTuple):
    """Inertia of the nodes, mass (nodes,) [kg] and tensor (nodes, 3, 3) [kg m^2] in their frames; gravity (3,) [m/s^2]."""

    mass: Array
    inertia: Array
    gravity: Array


@jit
def fill_nodal_forces(masses, frames, force, moment):
    """Set P and Q of `compute_nodal_force` [N], [N m] of every node, (samples, nodes, 3)."""
    for s in range(force.shape[0]):
        now = take_sample(frames, s)
        for n in range(force.shape[1]):
            p, q = compute_nodal_force(masses, n, now)
            put(force[s, n], p)
            put(moment[s, n], q)


@jit
def fill_outboard_sums(parent, x, force, moment, out):
    """Set the sums of `fill_sample_sums` at all samples, (samples, nodes, 6) [N], [N m]."""
    for s in range(x.shape[0]):
        fill_sample_sums(parent, x[s], force[s], moment[s], out[s])


@jit_inner
def fill_sample_sums(parent, x, force, moment, line):
    """Set ``line`` (nodes, 6) to the force [N] and moment [N m] on and beyond every node at one sample, moments about it."""
    for n in range(parent.shape[0]):
        put_pair(line[n], vec(force[n]), vec(moment[n]))
    add_outboard_forces(parent, x, line)


@jit_inner
def add_outboard_forces(parent, x, line):
    """Add to every node's force [N] and moment [N m], ``line`` (nodes, 6), those beyond it, the moments about the node."""
    for n in range(parent.shape[0] - 1, -1, -1):
        m = parent[n]
        if m >= 0:
            push, turn = pair(line[n])
            add_pair(line[m], push, add(turn, cross(sub(vec(x[n]), vec(x[m])), push)))


@jit
def fill_sums_in_frames(parent, nodes, x, rotation, force, moment, line, out):
    """Set sums of `fill_outboard_sums` of some ``nodes``, in their frames, (nodes, samples, 6) [N], [N m]; line : scratch."""
    for s in range(x.shape[0]):
        fill_sample_sums(parent, x[s], force[s], moment[s], line)
        for k in range(nodes.shape[0]):
            put_pair(out[k, s], *tapply_pair(mat(rotation[s, nodes[k]]), pair(line[nodes[k]])))


@send_by_address
class Drives(NamedTuple):
    """Joints by node, and what their drives take besides.

    freedoms : (nodes,); slide, turn : (nodes, 6, 3) axes in the node's frame [-]
    law : (5, nodes) as `mechanism.Mechanism.drive_table`
    """

    freedoms: Indices
    slide: Array
    turn: Array
    law: Array


@jit
def fill_instant_torques(nodes, drives, masses, frames, line, motion, tau):
    """Set the effort of every joint coordinate, (nv,) [N m] or [N], from the motion of all nodes at one instant.

    P = M (a - g), summed from the leaves (line : (nodes, 6) scratch), along the axes; plus what the drive takes
    motion : q (nq,), qd, qdd (nv,)
    """
    fill_instant_forces(masses, frames, line)
    add_outboard_forces(nodes.parent, frames.x, line)
    fill_projected_efforts(nodes, drives, frames, line, motion, tau)


@jit_inner
def fill_instant_forces(masses, frames, line):
    """Set P and Q of every node at one instant, ``line`` (nodes, 6) [N], [N m]."""
    for n in range(line.shape[0]):
        put_pair(line[n], *compute_nodal_force(masses, n, frames))


@jit_inner
def fill_projected_efforts(nodes, drives, frames, line, motion, tau):
    """Set the efforts of driven joints (nv,) [N m], [N] by sums ``line`` (nodes, 6) on and beyond their nodes, and their laws."""
    q, qd, qdd = motion
    for n in range(nodes.parent.shape[0]):
        if drives.freedoms[n] > 0:
            wrench = tapply_pair(mat(frames.r[n]), pair(line[n]))
            law = take_joint_law(drives.law, n)
            place = read_coordinate(n, nodes, q) if law.stiffness != 0.0 else law.rest
            for i in range(drives.freedoms[n]):
                v = nodes.v_index[n] + i
                effort = compute_wrench_effort(drives, n, i, wrench)
                tau[v] = effort + compute_joint_effort(law, place, qd[v], qdd[v], np.sign(qd[v]))


@send_by_address
class Skeleton(NamedTuple):
    """Data of a mesh that the second step reads.

    parent : (nodes,); mass [kg], inertia [kg m^2] : of the nodes; gravity : (3,) [m/s^2]
    freedoms, v_index : (nodes,) of the node's joint; slide, turn : (nodes, 6, 3) its axes in the node's frame [-]
    joint : (joints,) nodes of the children's link frames
    tip : (links,) node, point : (links, 3) and place [m] of each link's tip in its frame
    root, end : (beams,) first and last section; straight : (beams, 3) from one to the other, stress-free, in the first [m]
    """

    parent: Indices
    mass: Array
    inertia: Array
    gravity: Array
    freedoms: Indices
    v_index: Indices
    slide: Array
    turn: Array
    joint: Indices
    tip: Indices
    point: Array
    root: Indices
    end: Indices
    straight: Array


@send_by_address
class SecondStepInputs(NamedTuple):
    """Inputs of the second step: results of the time integration and data of the task.

    wrench : (samples, nodes, 6), energy : (samples, 3) of `dynamics.system.Trajectory` [N], [N m], [J], [W]
    force, moment : (samples, nodes, 3), or no samples: what is applied to the nodes (world) [N], [N m]
    brought : (samples or 0,) energy that impacts bring at once [J]
    qd : (samples, nv) [rad/s], [m/s]; time : (samples,) [s]
    """

    wrench: Array
    energy: Array
    force: Array
    moment: Array
    brought: Array
    qd: Array
    time: Array


@send_by_address
class SecondStepArrays(NamedTuple):
    """Results of the second step.

    force, moment : (samples, nodes, 3) P and Q of `compute_nodal_force` less what is applied [N], [N m]
    tau, reaction : (samples, nv) efforts along the joints, of P and of the wrenches of the elastic side [N m], [N]
    wrench : (joints, samples, 6) of all that is on and beyond a joint, in its node's frame [N], [N m]
    tip : (links, samples, 3) [m]; deflection : (beams, samples, 3) [m]
    kinetic, potential, power, work : (samples,), momentum : (samples, 6) of `balance.Balance` [J], [W], [N], [N m]
    """

    force: Array
    moment: Array
    tau: Array
    reaction: Array
    wrench: Array
    tip: Array
    deflection: Array
    kinetic: Array
    potential: Array
    power: Array
    work: Array
    momentum: Array


@jit
def fill_second_step(skeleton, moving, given, line, out):
    """Fill ``out`` from skeleton, motion (`Frames` of all samples) and what is given [m, N, J]; line : (nodes, 6) scratch."""
    supplied = 0.0
    work = 0.0
    start = 0.0
    for s in range(moving.x.shape[0]):
        now = take_sample(moving, s)
        outside = _fill_forces(s, skeleton, now, given, out)
        fill_sample_sums(skeleton.parent, now.x, out.force[s], out.moment[s], line)
        tau = _fill_efforts(s, skeleton, now, given, line, out)
        for i in range(len(skeleton.tip)):
            n = skeleton.tip[i]
            put(out.tip[i, s], add(vec(now.x[n]), apply(mat(now.r[n]), vec(skeleton.point[i]))))
        for i in range(len(skeleton.root)):
            n = skeleton.root[i]
            along = tapply(mat(now.r[n]), sub(vec(now.x[skeleton.end[i]]), vec(now.x[n])))
            put(out.deflection[i, s], sub(along, vec(skeleton.straight[i])))
        kinetic, potential, moved = _fill_energies(s, skeleton, now, given, out)
        energy = kinetic + potential + given.energy[s, 0]
        before = supplied
        supplied = tau + outside - given.energy[s, 2]
        if s == 0:
            start = energy
        else:
            work += 0.5 * (given.time[s] - given.time[s - 1]) * (supplied + before)
        if len(given.brought) > 0:
            work += given.brought[s]
        out.kinetic[s] = kinetic
        out.potential[s] = potential
        out.power[s] = tau - moved - given.energy[s, 1]
        out.work[s] = work - (energy - start)


@jit_inner
def _fill_forces(s, skeleton, now, given, out):
    """Set the nodal forces; return the power of those that are applied [W]."""
    power = 0.0
    for n in range(len(skeleton.parent)):
        p, q = compute_nodal_force(skeleton, n, now)
        if given.force.shape[0] > 0:
            force = vec(given.force[s, n])
            moment = vec(given.moment[s, n])
            power += dot(force, vec(now.v[n])) + dot(moment, apply(mat(now.r[n]), vec(now.w[n])))
            p = sub(p, force)
            q = sub(q, moment)
        put(out.force[s, n], p)
        put(out.moment[s, n], q)
    return power


@jit_inner
def _fill_efforts(s, skeleton, now, given, line, out):
    """Set what the joints carry and give; return the power of their efforts [W]."""
    power = 0.0
    for n in range(len(skeleton.parent)):
        if skeleton.freedoms[n] > 0:
            turned = mat(now.r[n])
            wrench = tapply_pair(turned, pair(line[n]))
            pull, twist = pair(given.wrench[s, n])
            pull = tapply(turned, pull)
            for i in range(skeleton.freedoms[n]):
                v = skeleton.v_index[n] + i
                effort = compute_wrench_effort(skeleton, n, i, wrench)
                out.tau[s, v] = effort
                out.reaction[s, v] = compute_wrench_effort(skeleton, n, i, (pull, twist))
                power += effort * given.qd[s, v]
    for j in range(len(skeleton.joint)):
        n = skeleton.joint[j]
        put_pair(out.wrench[j, s], *tapply_pair(mat(now.r[n]), pair(line[n])))
    return power


@jit_inner
def _fill_energies(s, skeleton, now, given, out):
    """Set the balance of momentum about the origin; return kinetic and potential energy [J] and the power P . v + Q . w [W].

    momentum : what the base gives (wrenches of the nodes that hang on the world) less sum P, sum x x P + Q
    """
    gravity = vec(skeleton.gravity)
    kinetic = 0.0
    potential = 0.0
    power = 0.0
    base_push = ZERO
    base_turn = ZERO
    push = ZERO
    turn = ZERO
    for n in range(len(skeleton.parent)):
        place = vec(now.x[n])
        speed = vec(now.v[n])
        w = vec(now.w[n])
        turned = mat(now.r[n])
        p = vec(out.force[s, n])
        q = vec(out.moment[s, n])
        kinetic += 0.5 * (skeleton.mass[n] * dot(speed, speed) + dot(w, apply(mat(skeleton.inertia[n]), w)))
        potential -= skeleton.mass[n] * dot(gravity, place)
        power += dot(p, speed) + dot(q, apply(turned, w))
        push = add(push, p)
        turn = add(turn, add(cross(place, p), q))
        if skeleton.parent[n] < 0:
            force, moment = pair(given.wrench[s, n])
            base_push = add(base_push, force)
            base_turn = add(base_turn, add(cross(place, force), apply(turned, moment)))
    put_pair(out.momentum[s], sub(base_push, push), sub(base_turn, turn))
    return kinetic, potential, power
