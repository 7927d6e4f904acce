"""Checks that are free: power and momentum balance of a solution, from nodal motion and forces alone."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from flexinv.errors import ConvergenceError
from flexinv.inverse.nodal_sums import fill_instant_torques
from flexinv.kernels.jit import jit
from flexinv.kernels.records import send_by_address
from flexinv.kernels.vec3 import apply, dot, mat, vec
from flexinv.kinematics.mesh import Mesh
from flexinv.typing import Array

# Energy that comes from nowhere, in parts of all that was put in: beyond this it is no time error of a step that is too long.
REASON = 10.0
ENERGY_ROUNDING = 1e-12  # energies below this part of what a beam stores when it bends by a radian are rounding


@dataclass(frozen=True)
class Balance:
    """Energies and what is left of the balances (`nodal_sums`).

    kinetic, potential, elastic : (samples,) [J]; dissipated : (samples,) [W] by the damping of beams
    power : (samples,) [W] residual of  tau . qd = sum P . v + Q . w + power of internal forces, at every instant
    work : (samples,) [J] residual of  integral (tau . qd + power of applied forces - dissipated) dt = change of energy
        (trapezoidal: time error shows here)
    meshes : (samples compared, nv) [N m], [N] efforts by P = M (a - g) of every finite-element node of meshed links less those
        of the reduced equations (`part_forces`); no samples without such links
    momentum : (samples, 6) [N], [N m] reaction at the base (elastic side) less sum P and sum x x P + Q (inertia side)
    """

    kinetic: Array
    potential: Array
    elastic: Array
    power: Array
    work: Array
    momentum: Array
    dissipated: Array
    meshes: Array = field(default_factory=lambda: np.empty((0, 0)))

    def check(self, mesh: Mesh, time: Array, qd: Array, passive: Collection[str], step: float) -> None:
        """Raise ConvergenceError where kinetic and elastic energy exceed what was put in beyond all reason (`REASON`).

        Put in are the energy of the start, the work of drives and forces, that of gravity, and what a motion that is given to the
        joints carries; time (samples,) [s], qd (samples, nv) [rad/s], [m/s], passive : joints without one, step [s]
        """
        holds = self.kinetic + self.elastic
        from_nowhere = -self.work
        if mesh.mechanism.is_rigid or not (from_nowhere > (1 - 1 / REASON) * holds).any():
            return
        fallen = np.abs(self.potential - self.potential[0])
        whole = self.work + holds + self.potential
        worked = np.abs(np.diff(whole, prepend=whole[0]))
        most = np.maximum.accumulate(fallen + compute_carried_energy(mesh, qd, passive)) + holds[0] + np.cumsum(worked)
        beyond = find_excessive_energies(mesh, from_nowhere, most)
        if beyond.any():
            first = int(np.argmax(beyond))
            at = f"at t = {time[first]:g} s (step {step:g} s)"
            raise ConvergenceError(
                f"mechanism '{mesh.mechanism.name}', {at}: kinetic and elastic energy are {holds[first]:.3g} J, of which at most "
                f"{most[first]:.3g} J were put in, so that the march has left the motion; write step = {step / 4:.3g}, or check "
                "that forces, moments and stiffness are what you mean"
            )


def compute_carried_energy(mesh: Mesh, qd: Array, passive: Collection[str]) -> Array:
    """Return the kinetic energy of the total mass at the speed of the given joint rates at full length, (samples,) [J]."""
    m = mesh.mechanism
    speed = np.zeros(len(qd))
    driven = np.array([joint.name not in passive for joint in m.joints for _ in range(joint.nv)], dtype=bool)
    for n in np.flatnonzero(mesh.v_index >= 0):
        columns = slice(mesh.v_index[n], mesh.v_index[n] + mesh.freedoms[n])
        reach = np.linalg.norm(mesh.slide[n], axis=1) + mesh.length * np.linalg.norm(mesh.turn[n], axis=1)
        speed += np.abs(qd[:, columns]) @ (reach[: mesh.freedoms[n]] * driven[columns])
    return np.asarray(0.5 * mesh.mass.sum() * speed**2)


def find_excessive_energies(mesh: Mesh, from_nowhere: Array | float, most: Array | float) -> Array:
    """Return a mask [-] of energies from nowhere [J] that exceed what was put in at ``most`` [J] beyond all reason (`REASON`)."""
    return np.asarray(from_nowhere > REASON * np.asarray(most) + compute_energy_rounding(mesh))


def compute_energy_rounding(mesh: Mesh) -> float:
    """Return the energy below which nothing is said of where it comes from [J].

    `ENERGY_ROUNDING` of a beam bent by a radian, or of a meshed link bent by the mechanism's length.
    """
    beam = mesh.elements.stiffness[..., 3:].max(initial=0.0) / mesh.length
    softest = mesh.shapes.stiffness[:, 0].max(initial=0.0) if mesh.shapes.stiffness.size else 0.0
    return float(ENERGY_ROUNDING * max(beam, softest * mesh.length**2))


@send_by_address
class Instant(NamedTuple):
    """Arrays of one instant of a controller beside the motion, read and written in place.

    stored : (3,) the first is the elastic energy [J]; driven : (nv,) 1 or 0; line : (nodes, 6) scratch
    account : (7,) kinetic and elastic energy at the start, that of gravity there [J]; power of the last instant [W]; work of
        drives and forces, the same with every part positive [J]; steps that were made [-]; time of a step [s]
    """

    stored: Array
    driven: Array
    line: Array
    account: Array


@jit
def evaluate_guarded_torques(nodes, drives, masses, frames, motion, instant, tau):
    """Set the efforts of one instant by `fill_instant_torques`, add its step; return if it is judged, and its energies [J]."""
    fill_instant_torques(nodes, drives, masses, frames, instant.line, motion, tau)
    holds, potential, power = compute_instant_energies(masses, frames, instant.stored, instant.driven, tau, motion[1])
    return add_step(instant.account, holds, potential, power), holds, potential


@jit
def add_step(account, holds, potential, power):
    """Add the work of a step [J]; return True where more than a part of what moves and bends [J] comes from nowhere."""
    done = account[6] * (account[2] + power) / 2
    account[2] = power
    account[3] += done
    account[4] += abs(done)
    account[5] += 1.0
    from_nowhere = holds + potential - account[0] - account[1] - account[3]
    return not from_nowhere <= (1 - 1 / REASON) * holds


@jit
def compute_instant_energies(masses, frames, stored, driven, tau, qd):
    """Return kinetic and elastic energy, that of gravity [J], and the power of drives [W] at one instant; see `Instant`.

    sum 1/2 (m v.v + w.J w) + elastic, - sum m g.x, sum tau qd of driven coordinates
    """
    held = stored[0]
    potential = 0.0
    power = 0.0
    g = vec(masses.gravity)
    for n in range(len(masses.mass)):
        v = vec(frames.v[n])
        w = vec(frames.w[n])
        held += 0.5 * (masses.mass[n] * dot(v, v) + dot(w, apply(mat(masses.inertia[n]), w)))
        potential -= masses.mass[n] * dot(g, vec(frames.x[n]))
    for k in range(len(driven)):
        if driven[k] != 0.0:
            power += tau[k] * qd[k]
    return held, potential, power
