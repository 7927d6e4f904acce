"""Nodal forces, their sums along the tree and over it, sample by sample: each number is read once, at the speed of the memory."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.elements.joint_law import JointLaw, own_effort
from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.records import by_address
from flexinv.kernels.vec3 import add, add_to, apply, cross, dot, mat, put, scale, sub, tapply, vec, vec_at
from flexinv.kinematics.configuration import coordinate
from flexinv.typing import Array


@jit_inner
def own_force(mass, inertia, gravity, rotation, omega, a, alpha):
    """Return P = M (a - g) [N] and Q = R (J al + w x J w) [N m] of one node at one sample."""
    w, tensor = vec(omega), mat(inertia)
    body = add(apply(tensor, vec(alpha)), cross(w, apply(tensor, w)))
    return scale(mass, sub(vec(a), gravity)), apply(mat(rotation), body)


@by_address
class Masses(NamedTuple):
    """Inertia of the nodes, mass (nodes,) [kg] and tensor (nodes, 3, 3) [kg m^2] in their frames; gravity (3,) [m/s^2]."""

    mass: Array
    inertia: Array
    gravity: Array


@jit
def nodal_samples(masses, frames, force, moment):
    """Set P and Q of `own_force` [N], [N m] of every node, (samples, nodes, 3)."""
    gravity = vec(masses.gravity)
    for s in range(force.shape[0]):
        for n in range(force.shape[1]):
            r, w, a, al = frames.r[s, n], frames.w[s, n], frames.a[s, n], frames.al[s, n]
            p, q = own_force(masses.mass[n], masses.inertia[n], gravity, r, w, a, al)
            put(force[s, n], 0, p)
            put(moment[s, n], 0, q)


@jit
def sum_samples(parent, x, force, moment, line):
    """Add to every node's force [N] and moment [N m] those beyond it, the moments about the node, in place; line as below."""
    for s in range(x.shape[0]):
        sum_outboard(parent, x[s], force[s], moment[s], line)
        for n in range(parent.shape[0]):
            put(force[s, n], 0, vec(line[n]))
            put(moment[s, n], 0, vec_at(line[n], 3))


@jit
def in_frame(node, rotation, force, moment, out):
    """Set force [N] and moment [N m] of one node in the node's own frame, (samples, 6)."""
    for s in range(rotation.shape[0]):
        turn = mat(rotation[s, node])
        put(out[s], 0, tapply(turn, vec(force[s, node])))
        put(out[s], 3, tapply(turn, vec(moment[s, node])))


@jit_inner
def sum_outboard(parent, x, force, moment, line):
    """Set ``line`` (nodes, 6) to the force [N] and moment [N m] on and beyond every node at one sample, moments about it."""
    for n in range(parent.shape[0]):
        put(line[n], 0, vec(force[n]))
        put(line[n], 3, vec(moment[n]))
    sum_line(parent, x, line)


@jit_inner
def sum_line(parent, x, line):
    """Add to every node's force [N] and moment [N m], ``line`` (nodes, 6), those beyond it, the moments about the node."""
    for n in range(parent.shape[0] - 1, -1, -1):
        m = parent[n]
        if m >= 0:
            push = vec_at(line[n], 0)
            add_to(line[m], 0, push)
            add_to(line[m], 3, add(vec_at(line[n], 3), cross(sub(vec(x[n]), vec(x[m])), push)))


@jit
def sum_in_frames(parent, nodes, x, rotation, force, moment, line, out):
    """Set the sums of `sum_samples` of some ``nodes`` only, in their own frames, (nodes, samples, 6) [N], [N m].

    line : (all nodes, 6) scratch, the sums of one sample
    """
    for s in range(x.shape[0]):
        sum_outboard(parent, x[s], force[s], moment[s], line)
        for k in range(nodes.shape[0]):
            turn = mat(rotation[s, nodes[k]])
            put(out[k, s], 0, tapply(turn, vec_at(line[nodes[k]], 0)))
            put(out[k, s], 3, tapply(turn, vec_at(line[nodes[k]], 3)))


@by_address
class Drives(NamedTuple):
    """Joints by node, and what their drives take besides.

    freedoms : (nodes,); slide, turn : (nodes, 6, 3) axes in the node's frame [-]
    rotor, damping, friction, stiffness, rest : (nodes,) [kg m^2], [N m s], [N m], [N m/rad], [rad] or of a sliding joint
    """

    freedoms: NDArray[np.int64]
    slide: Array
    turn: Array
    rotor: Array
    damping: Array
    friction: Array
    stiffness: Array
    rest: Array


@jit
def instant_torques(nodes, drives, masses, frames, line, motion, tau):
    """Set the effort of every joint coordinate, (nv,) [N m] or [N], from the motion of all nodes at one instant.

    P = M (a - g), summed from the leaves (line : (nodes, 6) scratch), along the axes; plus what the drive takes
    motion : q (nq,), qd, qdd (nv,)
    """
    gravity, (q, qd, qdd) = vec(masses.gravity), motion
    for n in range(nodes.parent.shape[0]):
        r, w, a, al = frames.r[n], frames.w[n], frames.a[n], frames.al[n]
        force, moment = own_force(masses.mass[n], masses.inertia[n], gravity, r, w, a, al)
        put(line[n], 0, force)
        put(line[n], 3, moment)
    sum_line(nodes.parent, frames.x, line)
    for n in range(nodes.parent.shape[0]):
        if drives.freedoms[n] > 0:
            turned = mat(frames.r[n])
            force, moment = tapply(turned, vec_at(line[n], 0)), tapply(turned, vec_at(line[n], 3))
            for i in range(drives.freedoms[n]):
                v = nodes.v_index[n] + i
                effort = dot(vec(drives.slide[n, i]), force) + dot(vec(drives.turn[n, i]), moment)
                place = coordinate(n, nodes, q) if drives.stiffness[n] != 0.0 else drives.rest[n]
                law = JointLaw(
                    drives.rotor[n], drives.damping[n], drives.friction[n], drives.stiffness[n], drives.rest[n]
                )
                tau[v] = effort + own_effort(law, place, qd[v], qdd[v], np.sign(qd[v]))
