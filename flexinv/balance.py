"""Checks that are free: power and momentum balance of a solution, from nodal motion and forces alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexinv.inverse import NodalForces
from flexinv.mechanism import Array
from flexinv.mesh import Mesh
from flexinv.nodal import NodalMotion


@dataclass(frozen=True)
class Balance:
    """Energies and what is left of the balances.

    kinetic, potential, elastic : (samples,) [J]
    power : (samples,) [W] residual of  tau . qd = sum P . v + Q . w + elastic power, at every instant
    work : (samples,) [J] residual of  integral (tau . qd + power of applied forces) dt = change of energy
        (trapezoidal: time error shows here)
    momentum : (samples, 6) [N], [N m] reaction at the base (elastic side) less sum P and sum x x P + Q (inertia side)
    """

    kinetic: Array
    potential: Array
    elastic: Array
    power: Array
    work: Array
    momentum: Array


def balance(
    mesh: Mesh,
    motion: NodalMotion,
    forces: NodalForces,
    tau: Array,
    qd: Array,
    base: Array,
    elastic: Array,
    time: Array,
    applied: NodalForces | None = None,
    brought: Array | None = None,
) -> Balance:
    """Return the balances of a motion.

    forces : P and Q of all nodes [N], [N m]; tau : (samples, nv) joint efforts L T P without drive efforts [N m], [N]
    base : (samples, 6) reaction of the base on the mechanism about the origin, world, from the kinematics step
    elastic : (samples, 2) elastic energy [J] and its rate [W]; applied : springs, loads and closures, if any
    brought : (samples,) energy that impacts bring at once [J], if any
    """
    spin = np.einsum("nij,snj->sni", mesh.inertia, motion.omega)
    kinetic = 0.5 * np.einsum("n,sni,sni->s", mesh.mass, motion.v, motion.v)
    kinetic += 0.5 * np.einsum("sni,sni->s", motion.omega, spin)
    potential = -np.einsum("n,sni,i->s", mesh.mass, motion.x, mesh.mechanism.gravity)
    given = np.einsum("sv,sv->s", tau, qd)
    energy = kinetic + potential + elastic[:, 0]
    supplied = given if applied is None else given + _power(motion, applied)
    work = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(time) * (supplied[1:] + supplied[:-1]))])
    if brought is not None:
        work += np.cumsum(brought)
    total = np.hstack([forces.force.sum(axis=1), (np.cross(motion.x, forces.force) + forces.moment).sum(axis=1)])
    power = given - _power(motion, forces) - elastic[:, 1]
    return Balance(kinetic, potential, elastic[:, 0], power, work - (energy - energy[0]), base - total)


def _power(motion: NodalMotion, forces: NodalForces) -> Array:
    """Sum of P . v + Q . w over all nodes, (samples,) [W]."""
    turning = np.einsum("snij,snj->sni", motion.rotation, motion.omega)  # (sample, node, xyz), world frame
    pushed = np.einsum("sni,sni->s", forces.force, motion.v)
    return np.asarray(pushed + np.einsum("sni,sni->s", forces.moment, turning))


def base_reaction(mesh: Mesh, motion: NodalMotion, wrench: Array) -> Array:
    """Return the sum of the wrenches of all nodes that hang on the world, (samples, 6) [N], [N m] about the origin.

    wrench : (samples, nodes, 6) force (world) and moment (own frame) on each node from its own rigid part
    """
    roots = np.flatnonzero(mesh.parent < 0)
    force = wrench[:, roots, :3]
    moment = np.einsum("snij,snj->sni", motion.rotation[:, roots], wrench[:, roots, 3:])
    return np.hstack([force.sum(axis=1), (np.cross(motion.x[:, roots], force) + moment).sum(axis=1)])
