"""The paper's second step over all samples at once: nodal forces, joint efforts, balances, tips (compiled).

Every sample's motion is read once and all that follows from it is written, so that it costs a tenth of the march before it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.inverse.nodal_sums import own_force, sum_outboard
from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.records import by_address
from flexinv.kernels.vec3 import add, apply, cross, dot, mat, put, sub, tapply, vec, vec_at
from flexinv.typing import Array


@by_address
class Skeleton(NamedTuple):
    """Data of a mesh that the second step reads.

    parent : (nodes,); mass [kg], inertia [kg m^2] : of the nodes; gravity : (3,) [m/s^2]
    freedoms, v_index : (nodes,) of the node's joint; slide, turn : (nodes, 6, 3) its axes in the node's frame [-]
    joint : (joints,) nodes of the children's link frames
    tip : (links,) node, point : (links, 3) and place [m] of each link's tip in its frame
    root, end : (beams,) first and last section; straight : (beams, 3) from one to the other, stress-free, in the first [m]
    """

    parent: NDArray[np.int64]
    mass: Array
    inertia: Array
    gravity: Array
    freedoms: NDArray[np.int64]
    v_index: NDArray[np.int64]
    slide: Array
    turn: Array
    joint: NDArray[np.int64]
    tip: NDArray[np.int64]
    point: Array
    root: NDArray[np.int64]
    end: NDArray[np.int64]
    straight: Array


@by_address
class Moving(NamedTuple):
    """The arrays of a `NodalMotion`, (samples, nodes, ...) [m, rad, s]."""

    x: Array
    rotation: Array
    v: Array
    omega: Array
    a: Array
    alpha: Array


@by_address
class Given(NamedTuple):
    """Inputs of the second step: results of the time integration and data of the task.

    wrench : (samples, nodes, 6), energy : (samples, 3) of `dynamics.solver.Trajectory` [N], [N m], [J], [W]
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


@by_address
class Found(NamedTuple):
    """Results of the second step.

    force, moment : (samples, nodes, 3) P and Q of `nodal_sums.own_force` less what is applied [N], [N m]
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
def second_step_samples(skeleton, moving, given, line, out):
    """Fill ``out`` (`Found`) from skeleton, motion and what is given [m, rad, s, N, J]; line : (nodes, 6) scratch."""
    supplied, work, start = 0.0, 0.0, 0.0
    for s in range(moving.x.shape[0]):
        outside = _forces(s, skeleton, moving, given, out)
        sum_outboard(skeleton.parent, moving.x[s], out.force[s], out.moment[s], line)
        tau = _efforts(s, skeleton, moving, given, line, out)
        _places(s, skeleton, moving, out)
        kinetic, potential, moved = _energies(s, skeleton, moving, given, out)
        energy = kinetic + potential + given.energy[s, 0]
        before, supplied = supplied, tau + outside - given.energy[s, 2]
        if s == 0:
            start = energy
        else:
            work += 0.5 * (given.time[s] - given.time[s - 1]) * (supplied + before)
        if len(given.brought) > 0:
            work += given.brought[s]
        out.kinetic[s], out.potential[s] = kinetic, potential
        out.power[s], out.work[s] = tau - moved - given.energy[s, 1], work - (energy - start)


@jit_inner
def _forces(s, skeleton, moving, given, out):
    """Set the nodal forces; return the power of those that are applied [W]."""
    gravity, power = vec(skeleton.gravity), 0.0
    for n in range(len(skeleton.parent)):
        p, q = own_force(
            skeleton.mass[n],
            skeleton.inertia[n],
            gravity,
            moving.rotation[s, n],
            moving.omega[s, n],
            moving.a[s, n],
            moving.alpha[s, n],
        )
        if given.force.shape[0] > 0:
            force, moment = vec(given.force[s, n]), vec(given.moment[s, n])
            power += dot(force, vec(moving.v[s, n])) + dot(
                moment, apply(mat(moving.rotation[s, n]), vec(moving.omega[s, n]))
            )
            p, q = sub(p, force), sub(q, moment)
        put(out.force[s, n], 0, p)
        put(out.moment[s, n], 0, q)
    return power


@jit_inner
def _efforts(s, skeleton, moving, given, line, out):
    """Set what the joints carry and give; return the power of their efforts [W]."""
    power = 0.0
    for n in range(len(skeleton.parent)):
        if skeleton.freedoms[n] > 0:
            turned = mat(moving.rotation[s, n])
            force, moment = tapply(turned, vec_at(line[n], 0)), tapply(turned, vec_at(line[n], 3))
            pull, twist = tapply(turned, vec_at(given.wrench[s, n], 0)), vec_at(given.wrench[s, n], 3)
            for i in range(skeleton.freedoms[n]):
                v, slide, turn = skeleton.v_index[n] + i, vec(skeleton.slide[n, i]), vec(skeleton.turn[n, i])
                effort = dot(slide, force) + dot(turn, moment)
                out.tau[s, v], out.reaction[s, v] = effort, dot(slide, pull) + dot(turn, twist)
                power += effort * given.qd[s, v]
    for j in range(len(skeleton.joint)):
        n = skeleton.joint[j]
        turned = mat(moving.rotation[s, n])
        put(out.wrench[j, s], 0, tapply(turned, vec_at(line[n], 0)))
        put(out.wrench[j, s], 3, tapply(turned, vec_at(line[n], 3)))
    return power


@jit_inner
def _places(s, skeleton, moving, out):
    """Set tips and deflections."""
    for i in range(len(skeleton.tip)):
        n = skeleton.tip[i]
        put(out.tip[i, s], 0, add(vec(moving.x[s, n]), apply(mat(moving.rotation[s, n]), vec(skeleton.point[i]))))
    for i in range(len(skeleton.root)):
        along = sub(vec(moving.x[s, skeleton.end[i]]), vec(moving.x[s, skeleton.root[i]]))
        put(
            out.deflection[i, s],
            0,
            sub(tapply(mat(moving.rotation[s, skeleton.root[i]]), along), vec(skeleton.straight[i])),
        )


@jit_inner
def _energies(s, skeleton, moving, given, out):
    """Set the balance of momentum about the origin; return kinetic and potential energy [J] and the power P . v + Q . w [W].

    momentum : what the base gives (wrenches of the nodes that hang on the world) less sum P, sum x x P + Q
    """
    gravity, kinetic, potential, power, none = vec(skeleton.gravity), 0.0, 0.0, 0.0, (0.0, 0.0, 0.0)
    base_push, base_turn, push, turn = none, none, none, none
    for n in range(len(skeleton.parent)):
        place, speed, w, turned = (
            vec(moving.x[s, n]),
            vec(moving.v[s, n]),
            vec(moving.omega[s, n]),
            mat(moving.rotation[s, n]),
        )
        p, q = vec(out.force[s, n]), vec(out.moment[s, n])
        kinetic += 0.5 * (skeleton.mass[n] * dot(speed, speed) + dot(w, apply(mat(skeleton.inertia[n]), w)))
        potential -= skeleton.mass[n] * dot(gravity, place)
        power += dot(p, speed) + dot(q, apply(turned, w))
        push, turn = add(push, p), add(turn, add(cross(place, p), q))
        if skeleton.parent[n] < 0:
            force, moment = vec_at(given.wrench[s, n], 0), apply(turned, vec_at(given.wrench[s, n], 3))
            base_push, base_turn = add(base_push, force), add(base_turn, add(cross(place, force), moment))
    put(out.momentum[s], 0, sub(base_push, push))
    put(out.momentum[s], 3, sub(base_turn, turn))
    return kinetic, potential, power
