"""Switching in the march: closures begin and cease to act between two steps, at an instant that is a sample."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from flexinv.constraints.closures import Rows, captured, constraint_rows
from flexinv.constraints.impacts import Impact, check_meeting, jump_forces, kinetic_energy, names_of
from flexinv.constraints.phases import Phase, Stretch
from flexinv.constraints.reactions import closing
from flexinv.dynamics.constraint_rows import Ties, set_ties
from flexinv.dynamics.initial_state import accept, consistent_accelerations
from flexinv.dynamics.solver import Solver, Trajectory, record_instant
from flexinv.inverse.inverse_dynamics import NodalForces, joint_wrenches, project
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.kinematics.tree import Joints
from flexinv.typing import Array

# Nodal motion and rates (nv,) of the joints on one side of an instant.
Side = tuple[NodalMotion, Array]


@dataclass
class Switching:
    """Phases of the march still to come, and the stretches and impacts [N s] of those that have begun."""

    phases: list[Phase]
    stretches: list[Stretch] = field(default_factory=list)
    impacts: list[Impact] = field(default_factory=list)

    @property
    def never(self) -> bool:
        """Return True if all closures act all the time [-]."""
        return len(self.phases) == 1 and bool(self.phases[0].active.all())

    def begin(self, mesh: Mesh, ties: Ties | None) -> None:
        """Let the closures of the first phase act, with the frames [m] that the mechanism states."""
        rows = constraint_rows(mesh)
        self.stretches.append(Stretch(self.phases[0], rows))
        if ties is not None:
            set_ties(ties, rows, self.phases[0].active)

    @property
    def samples(self) -> dict[int, Phase]:
        """Phases after the first by the sample at which they begin."""
        return {phase.first: phase for phase in self.phases[1:]}

    def switch(self, solver: Solver, phase: Phase, joints: Joints, qd: Array, time: float, out: Trajectory) -> None:
        """Go over to another phase at one sample of ``out``, which holds its left-hand limit and gets the right-hand one.

        joints, qd : right-hand limit of the prescribed motion there [m, rad, s]; time [s]
        Raises InputError for frames that have not met or move against each other (`impacts.check_meeting`).
        """
        mesh, s, sample = solver.mesh, solver.state, phase.first
        m = mesh.mechanism
        last, original = self.stretches[-1], constraint_rows(mesh)
        begins = phase.active & ~last.phase.active
        one = NodalMotion(*(part.copy() for part in out.rows(sample, sample + 1).histories()[:6]))
        catches = begins & np.array([c.capture for c in m.closures])
        rows = captured(m, original, last.rows, one, catches)
        check_meeting(mesh, rows, one, begins, time)
        rows = captured(
            m, original, rows, one, begins
        )  # the rest, below `impacts.OPEN`: the next step shall not jerk it away
        self.stretches.append(Stretch(phase, rows))
        set_ties(solver.border.ties, rows, phase.active)
        s.u[:], s.du[:] = s.u0, s.du0
        before = _rates(solver, qd)
        impulses = solver.collide(joints)
        accept(s)
        consistent_accelerations(solver, joints, f"at t = {time:g} s")
        record_instant(solver, sample, out)
        if any(m.closures[int(k)].impact == "plastic" for k in np.flatnonzero(begins)):
            two = out.rows(sample, sample + 1).motion
            sides = (one, before), (two, _rates(solver, qd))
            self.impacts.append(_impact(mesh, rows, begins, sides, impulses, time))


def _impact(
    mesh: Mesh, rows: Rows, begins: NDArray[np.bool_], sides: tuple[Side, Side], impulses: Array, time: float
) -> Impact:
    """The impulses of an impact between two nodal motions, each with its rates, of one instant: the same L T P as torques."""
    (one, before), (two, after) = sides
    pushed, shown = closing(mesh, two, rows, impulses[None])
    jump = jump_forces(mesh, one, two)
    wrenches = joint_wrenches(mesh, two, NodalForces(jump.force - pushed.force, jump.moment - pushed.moment))
    torque = project(mesh, two, wrenches)[0] + mesh.mechanism.drive_table[0] * (after - before)
    work = float(torque @ (before + after)) / 2
    lost = kinetic_energy(mesh, one, before) - kinetic_energy(mesh, two, after) + work
    reaction = {name: values[0] for name, values in shown.items()}
    return Impact(time, names_of(mesh.mechanism, begins), torque, reaction, work, lost)


def _rates(solver: Solver, qd: Array) -> Array:
    """Rates (nv,) of all joints now: the prescribed ones, and those of the passive joints among the unknowns."""
    out, t, mesh = qd.copy(), solver.topology, solver.mesh
    for n in np.flatnonzero(t.freedoms):
        first, v = t.offset[t.block[n]] + t.column[n], mesh.v_index[n]
        out[v : v + t.freedoms[n]] = solver.state.u[first : first + t.freedoms[n]]
    return out
