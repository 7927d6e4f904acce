"""Impacts: closures that begin to act on frames in relative motion stop it at once, perfectly plastic.

The closures and the drives, which keep their own velocities, give impulses:  M (v+ - v-) = G^T Lambda + S J,  G v+ = 0.
Impulses are the inverse dynamics of the jump of velocity, so the same L T P gives them: P = M (v+ - v-).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexinv.constraints.closures import Rows, residuals
from flexinv.errors import InputError
from flexinv.inverse.inverse_dynamics import NodalForces, project
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

# Frames that meet with a relative velocity below this part of the fastest node's (of the mechanism's length, or 1 rad, per
# second where all is slower: from rest to rest there is nothing else to compare with) meet at rest: Newton leaves 1e-13,
# splines of samples 1e-9.
MEETING = 1e-6
# Frames further apart than this part of the mechanism's length (or 1 rad) have not met.
OPEN = 1e-6


@dataclass(frozen=True)
class Impact:
    """Plastic impact: impulses and energy loss at the instant at which closures begin to act.

    time [s]; closures : names of those that begin to act
    torque : (nv,) impulses of the drives [N m s], [N s]; reaction : closure -> (6,) impulse [N s] and its moment [N m s] on the
        second link, at the closure and in its axes there; work : of the drives' impulses [J]; energy : lost energy [J]
    """

    time: float
    closures: tuple[str, ...]
    torque: Array
    reaction: dict[str, Array]
    work: float
    energy: float


def check_meeting(mesh: Mesh, rows: Rows, motion: NodalMotion, begins: NDArray[np.bool_], time: float) -> None:
    """Raise InputError where closures begin to act [s] on frames that have not met, or that move against each other.

    rows : with the frames that they will tie; motion : one sample, just before; begins : (closures,)
    Frames may stand apart where the closure captures, and move where its impact is plastic.
    """
    m = mesh.mechanism
    scale = np.where(rows.direction, 1.0, mesh.length)
    apart, rate = (np.abs(part[0]) / scale for part in residuals(motion, rows)[:2])
    fastest = max(np.abs(motion.v).max() / mesh.length, np.abs(motion.omega).max(), 1.0)
    for index in np.flatnonzero(begins):
        closure, own = m.closures[int(index)], rows.closure == index
        if apart[own].max() > OPEN:
            worst = int(np.flatnonzero(own)[np.argmax(apart[own])])
            gap = f"{apart[worst]:.2g} rad" if rows.direction[worst] else f"{apart[worst] * mesh.length:.2g} m"
            raise InputError(
                f"mechanism '{m.name}', t = {time:g} s: closure '{closure.name}' begins to act on frames that are {gap} apart; "
                "bring them together, or write capture = true to tie them where they stand"
            )
        if closure.impact == "error" and rate[own].max() > MEETING * fastest:
            worst = int(np.flatnonzero(own)[np.argmax(rate[own])])
            speed = f"{rate[worst]:.3g} rad/s" if rows.direction[worst] else f"{rate[worst] * mesh.length:.3g} m/s"
            raise InputError(
                f"mechanism '{m.name}', t = {time:g} s: closure '{closure.name}' begins to act on frames that move against each "
                f"other with {speed}, which takes an impulse; let the frames meet with equal velocities, or write "
                'impact = "plastic"'
            )


def jump_forces(mesh: Mesh, before: NodalMotion, after: NodalMotion) -> NodalForces:
    """Return the impulses P = M (v+ - v-) [N s], [N m s] of all nodes at one instant (one sample each), world frame."""
    force = mesh.mass[:, None] * (after.v - before.v)  # (1, node, xyz)
    spin = np.einsum("nij,snj->sni", mesh.inertia, after.omega - before.omega)
    return NodalForces(force, np.einsum("snij,snj->sni", after.rotation, spin))


def jump_efforts(mesh: Mesh, before: NodalMotion, after: NodalMotion, change: Array) -> Array:
    """Return the impulse along every joint coordinate, (nv,) [N m s], [N s], before drives and closures share it.

    change : (nv,) jump of the joint rates, which the rotors follow
    """
    tau = project(mesh, after, jump_forces(mesh, before, after))[0]
    return np.asarray(tau + mesh.mechanism.drive_table[0] * change)


def kinetic_energy(mesh: Mesh, motion: NodalMotion, qd: Array) -> float:
    """Return the kinetic energy [J] of nodes and rotors at one instant (one sample; qd (nv,) [1/s])."""
    moving = np.einsum("n,ni,ni->", mesh.mass, motion.v[0], motion.v[0])
    turning = np.einsum("nij,ni,nj->", mesh.inertia, motion.omega[0], motion.omega[0])
    return float(0.5 * (moving + turning + mesh.mechanism.drive_table[0] @ qd**2))


def names_of(mechanism: Mechanism, which: NDArray[np.bool_]) -> tuple[str, ...]:
    """Return the names of the closures ``which`` (closures,) [-]."""
    return tuple(c.name for c, begins in zip(mechanism.closures, which, strict=True) if begins)
