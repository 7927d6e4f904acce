"""Energy guard of a march that nobody sees as a whole: an error where energy comes from nowhere, call by call.

`balance.Balance.check` looks at the samples of a solution; here the same sums are carried on from one instant to the next.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from flexinv.errors import ConvergenceError
from flexinv.inverse.balance import REASON, ROUNDING, carried
from flexinv.inverse.nodal_sums import instant_torques
from flexinv.kernels.jit import jit
from flexinv.kernels.vec3 import apply, dot, mat, vec
from flexinv.kinematics.mesh import Mesh
from flexinv.typing import Array


@dataclass(eq=False)
class EnergyGuard:
    """Energies and work of a march so far.

    mesh : what moves; passive : joints without a motion; step : time between two instants [s]
    account : (7,) kinetic and elastic energy at the start, that of gravity there [J]; power of the last instant [W]; work of drives
        and forces, the same with every part positive [J]; steps that were made [-]; time of a step [s]
    """

    mesh: Mesh
    passive: frozenset[str]
    step: float
    account: Array = field(default_factory=lambda: np.zeros(7))

    def begin(self, held: float, potential: float, power: float) -> None:
        """Set the start: kinetic and elastic energy, potential energy [J]; power of drives and forces [W]."""
        self.account[:] = held, potential, power, 0.0, 0.0, 0.0, self.step

    def look(self, holds: float, potential: float, power: float, qd: Array) -> None:
        """Add a step and raise ConvergenceError where kinetic and elastic energy exceed what was put in beyond all reason.

        holds : kinetic and elastic energy [J]; potential [J]; power : of drives and forces [W]; qd : (nv,) [1/s]
        """
        if add_step(self.account, holds, potential, power):
            self.judge(holds, potential, qd)

    def judge(self, holds: float, potential: float, qd: Array) -> None:
        """Raise ConvergenceError where the energy of a step that was added [J] comes from nowhere; qd : (nv,) [1/s]."""
        held, at_start, _, work, worked, steps, _ = self.account.tolist()
        from_nowhere = holds + potential - held - at_start - work
        most = held + worked + abs(potential - at_start)
        most += float(carried(self.mesh, np.asarray(qd, dtype=float)[None], set(self.passive))[0])
        stiffness = float(self.mesh.elements.stiffness[..., 3:].max()) / self.mesh.length
        if from_nowhere > REASON * most + ROUNDING * stiffness:
            raise ConvergenceError(
                f"controller: mechanism '{self.mesh.mechanism.name}', at call {steps:.0f} after start (step {self.step:g} s): "
                f"kinetic and elastic energy are {holds:.3g} J, of which at most {most:.3g} J were put in, so that the march has "
                f"left the motion; write step = {self.step / 4:.3g}, or check forces, moments and stiffness"
            )


class Instant(NamedTuple):
    """What a controller knows of an instant beside the motion: all arrays are written or read in place.

    stored : (3,) the first is the elastic energy [J]; driven : (nv,) 1 or 0; line : (nodes, 6) scratch; account : `EnergyGuard`
    """

    stored: Array
    driven: Array
    line: Array
    account: Array


@jit
def guarded_torques(nodes, drives, masses, frames, motion, instant, tau):
    """Set the efforts of one instant as `instant_torques` does, add its step; return whether to judge it, and its energies [J]."""
    instant_torques(nodes, drives, masses, frames, instant.line, motion, tau)
    holds, potential, power = instant_energies(masses, frames, instant.stored, instant.driven, tau, motion[1])
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
def instant_energies(masses, frames, stored, driven, tau, qd):
    """Return kinetic and elastic energy, that of gravity [J], and the power of drives [W] at one instant.

    sum 1/2 (m v.v + w.J w) + elastic, - sum m g.x, sum tau qd of driven coordinates;
    stored : (3,) of which the first is the elastic energy; driven : (nv,) 1 or 0
    """
    held, potential, power, g = stored[0], 0.0, 0.0, vec(masses.gravity)
    for n in range(len(masses.mass)):
        v, w = vec(frames.v[n]), vec(frames.w[n])
        held += 0.5 * (masses.mass[n] * dot(v, v) + dot(w, apply(mat(masses.inertia[n]), w)))
        potential -= masses.mass[n] * dot(g, vec(frames.x[n]))
    for k in range(len(driven)):
        if driven[k] != 0.0:
            power += tau[k] * qd[k]
    return held, potential, power
