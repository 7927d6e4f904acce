"""Checks that are free: power and momentum balance of a solution, from nodal motion and forces alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexinv.inverse import NodalForces, plain
from flexinv.mechanism import Array
from flexinv.mesh import Mesh
from flexinv.nodal import NodalMotion
from flexinv.sums import energy_samples, power_samples, root_samples


@dataclass(frozen=True)
class Balance:
    """Energies and what is left of the balances.

    kinetic, potential, elastic : (samples,) [J]; dissipated : (samples,) [W] by the damping of beams
    power : (samples,) [W] residual of  tau . qd = sum P . v + Q . w + power of internal forces, at every instant
    work : (samples,) [J] residual of  integral (tau . qd + power of applied forces - dissipated) dt = change of energy
        (trapezoidal: time error shows here)
    momentum : (samples, 6) [N], [N m] reaction at the base (elastic side) less sum P and sum x x P + Q (inertia side)
    """

    kinetic: Array
    potential: Array
    elastic: Array
    power: Array
    work: Array
    momentum: Array
    dissipated: Array


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
    elastic : (samples, 3) elastic energy [J], power of internal forces and what of it is dissipated [W]
    applied : springs, loads and closures, if any
    brought : (samples,) energy that impacts bring at once [J], if any
    """
    sums, total = np.empty((len(time), 3)), np.empty((len(time), 6))
    moving = (plain(part) for part in (motion.x, motion.rotation, motion.v, motion.omega, forces.force, forces.moment))
    energy_samples(mesh.mass, mesh.inertia, plain(mesh.mechanism.gravity), *moving, sums, total)
    kinetic, potential, moved = sums.T.copy()
    given = np.einsum("sv,sv->s", tau, qd)
    energy = kinetic + potential + elastic[:, 0]
    dissipated = elastic[:, 2]
    supplied = (given if applied is None else given + _power(motion, applied)) - dissipated
    work = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(time) * (supplied[1:] + supplied[:-1]))])
    if brought is not None:
        work += np.cumsum(brought)
    power = given - moved - elastic[:, 1]
    return Balance(kinetic, potential, elastic[:, 0], power, work - (energy - energy[0]), base - total, dissipated)


def _power(motion: NodalMotion, forces: NodalForces) -> Array:
    """Sum of P . v + Q . w over all nodes, (samples,) [W]."""
    power = np.zeros(len(motion.v))
    parts = motion.rotation, motion.v, motion.omega, forces.force, forces.moment
    power_samples(*(plain(part) for part in parts), power)
    return power


def base_reaction(mesh: Mesh, motion: NodalMotion, wrench: Array) -> Array:
    """Return the sum of the wrenches of all nodes that hang on the world, (samples, 6) [N], [N m] about the origin.

    wrench : (samples, nodes, 6) force (world) and moment (own frame) on each node from its own rigid part
    """
    total = np.zeros((len(motion.x), 6))
    root_samples(np.flatnonzero(mesh.parent < 0), plain(motion.x), plain(motion.rotation), plain(wrench), total)
    return total
