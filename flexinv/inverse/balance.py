"""Checks that are free: power and momentum balance of a solution, from nodal motion and forces alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexinv.errors import ConvergenceError
from flexinv.kinematics.mesh import Mesh
from flexinv.typing import Array

# Energy that comes from nowhere, in parts of all that was put in: beyond this it is no time error of a step that is too long.
REASON = 10.0
# Energies below this part of what a beam stores when it bends by a radian are rounding.
ROUNDING = 1e-12


@dataclass(frozen=True)
class Balance:
    """Energies and what is left of the balances (`trajectory_pass`).

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

    def check(self, mesh: Mesh, time: Array, qd: Array, passive: set[str], step: float) -> None:
        """Raise ConvergenceError where kinetic and elastic energy exceed what was put in beyond all reason (`REASON`).

        Put in are the energy of the start, the work of drives and forces, that of gravity, and what a motion that is given to the
        joints carries; time (samples,) [s], qd (samples, nv) [rad/s], [m/s], passive : joints without one, step [s]
        """
        holds, from_nowhere = self.kinetic + self.elastic, -self.work
        if not len(mesh.elements.order) or not (from_nowhere > (1 - 1 / REASON) * holds).any():
            return
        fallen = np.abs(self.potential - self.potential[0])
        worked = np.abs(
            np.diff(self.work + holds + self.potential, prepend=holds[0] + self.potential[0] + self.work[0])
        )
        most = np.maximum.accumulate(fallen + carried(mesh, qd, passive)) + holds[0] + np.cumsum(worked)
        stiffness = mesh.elements.stiffness[..., 3:].max() / mesh.length
        beyond = from_nowhere > REASON * most + ROUNDING * stiffness
        if beyond.any():
            first = int(np.argmax(beyond))
            at = f"at t = {time[first]:g} s (step {step:g} s)"
            raise ConvergenceError(
                f"mechanism '{mesh.mechanism.name}', {at}: kinetic and elastic energy are {holds[first]:.3g} J, of which at most "
                f"{most[first]:.3g} J were put in, so that the march has left the motion; write step = {step / 4:.3g}, or check "
                "that forces, moments and stiffness are what you mean"
            )


def carried(mesh: Mesh, qd: Array, passive: set[str]) -> Array:
    """Return the kinetic energy of the total mass at the speed of the given joint rates at full length, (samples,) [J]."""
    m, speed = mesh.mechanism, np.zeros(len(qd))
    driven = np.array([joint.name not in passive for joint in m.joints for _ in range(joint.nv)], dtype=bool)
    for n in np.flatnonzero(mesh.v_index >= 0):
        own = slice(mesh.v_index[n], mesh.v_index[n] + mesh.freedoms[n])
        reach = np.linalg.norm(mesh.slide[n], axis=1) + mesh.length * np.linalg.norm(mesh.turn[n], axis=1)
        speed += np.abs(qd[:, own]) @ (reach[: mesh.freedoms[n]] * driven[own])
    return np.asarray(0.5 * mesh.mass.sum() * speed**2)
