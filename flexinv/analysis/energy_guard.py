"""Energy guard of a march that nobody sees as a whole: an error where energy comes from nowhere, call by call.

`balance.Balance.check` looks at the samples of a solution; here the same sums are carried on from one instant to the next.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexinv.errors import ConvergenceError
from flexinv.inverse.balance import REASON, ROUNDING, carried
from flexinv.kernels.jit import jit
from flexinv.kernels.vec3 import apply, dot, mat, vec
from flexinv.kinematics.mesh import Mesh
from flexinv.typing import Array


@dataclass(eq=False)
class EnergyGuard:
    """Energies and work of a march so far.

    mesh : what moves; passive : joints without a motion; step : time between two instants [s]
    held, potential : kinetic and elastic energy at the start, and that of gravity [J]; power : of the last instant [W]
    work : that drives and forces did [J]; worked : the same, every part positive [J]; steps : that were made [-]
    """

    mesh: Mesh
    passive: frozenset[str]
    step: float
    held: float = 0.0
    potential: float = 0.0
    power: float = 0.0
    work: float = 0.0
    worked: float = 0.0
    steps: int = 0

    def begin(self, held: float, potential: float, power: float) -> None:
        """Set the start: kinetic and elastic energy, potential energy [J]; power of drives and forces [W]."""
        self.held, self.potential = held, potential
        self.power, self.work, self.worked, self.steps = power, 0.0, 0.0, 0

    def look(self, holds: float, potential: float, power: float, qd: Array) -> None:
        """Add a step and raise ConvergenceError where kinetic and elastic energy exceed what was put in beyond all reason.

        holds : kinetic and elastic energy [J]; potential [J]; power : of drives and forces [W]; qd : (nv,) [1/s]
        """
        done = self.step * (self.power + power) / 2
        self.power, self.work, self.worked, self.steps = (
            power,
            self.work + done,
            self.worked + abs(done),
            self.steps + 1,
        )
        from_nowhere = holds + potential - self.held - self.potential - self.work
        if from_nowhere <= (1 - 1 / REASON) * holds:
            return
        most = self.held + self.worked + abs(potential - self.potential)
        most += float(carried(self.mesh, np.asarray(qd, dtype=float)[None], set(self.passive))[0])
        stiffness = float(self.mesh.elements.stiffness[..., 3:].max()) / self.mesh.length
        if from_nowhere > REASON * most + ROUNDING * stiffness:
            raise ConvergenceError(
                f"controller: mechanism '{self.mesh.mechanism.name}', at call {self.steps} after start (step {self.step:g} s): "
                f"kinetic and elastic energy are {holds:.3g} J, of which at most {most:.3g} J were put in, so that the march has "
                f"left the motion; write step = {self.step / 4:.3g}, or check forces, moments and stiffness"
            )


@jit
def instant_energies(mass, inertia, gravity, seen, driven, tau, qd):
    """Return kinetic and elastic energy, that of gravity [J], and the power of drives [W] at one instant.

    sum 1/2 (m v.v + w.J w) + elastic, - sum m g.x, sum tau qd of driven coordinates;
    seen : x, v, omega (nodes, 3), and (3,) of which the first is the elastic energy; driven : (nv,) 1 or 0
    """
    x, v, omega, stored = seen
    held, potential, power, g = stored[0], 0.0, 0.0, vec(gravity)
    for n in range(len(mass)):
        w = vec(omega[n])
        held += 0.5 * (mass[n] * dot(vec(v[n]), vec(v[n])) + dot(w, apply(mat(inertia[n]), w)))
        potential -= mass[n] * dot(g, vec(x[n]))
    for k in range(len(driven)):
        if driven[k] != 0.0:
            power += tau[k] * qd[k]
    return held, potential, power
