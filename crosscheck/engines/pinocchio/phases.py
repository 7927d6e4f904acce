"""Closed loops in Pinocchio over all phases: one mechanism after the other, each from where the one before has come to."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crosscheck.engines.pinocchio import loops as pinocchio_loops
from crosscheck.engines.pinocchio.loops import ClosedDynamics
from crosscheck.engines.pinocchio.model import BuiltModel, Dynamics
from crosscheck.engines.shared import phases
from crosscheck.engines.shared.phases import Phase
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism

Array = NDArray[np.float64]


def solve_phases(
    mechanism: Mechanism, case: Case, built_model: BuiltModel, time: Array
) -> list[tuple[Phase, phases.State]]:
    """Return every phase with its motion on the closures, (samples, ...) [rad], [m], [s] in the mechanism's order."""

    def solve_closed(now: Mechanism, here: Case, span: Array) -> phases.State:
        return pinocchio_loops.solve_motion(now, here, built_model, span)

    return phases.solve_phases(mechanism, case, time, solve_closed)


def solve_phase_efforts(mechanism: Mechanism, case: Case, built_model: BuiltModel, time: Array) -> ClosedDynamics:
    """Return efforts and wrenches [N m], [N] over all phases; closures that do not act have no wrench."""
    followed = solve_phases(mechanism, case, built_model, time)
    parts = [
        pinocchio_loops.solve_efforts(phase.mechanism, built_model, phase.time, state) for phase, state in followed
    ]
    dynamics = Dynamics(
        torque=np.concatenate([p.dynamics.torque for p in parts]),
        wrench=phases.join_series(p.dynamics.wrench for p in parts),
        tip=phases.join_series(p.dynamics.tip for p in parts),
    )
    wrenches = phases.join_series(phases.fill_wrenches(mechanism, p.closures, len(p.torque)) for p in parts)
    return ClosedDynamics(np.concatenate([p.torque for p in parts]), dynamics, wrenches)
