"""Pinocchio: recursive Newton-Euler on its own model, built from primary data or read by its own URDF parser.

Conventions, as a map and its dual.

    coordinates   q, v, a are Pinocchio's own (the mechanism file uses its layout): continuous (cos, sin), quaternions
                  x, y, z, w, a free joint's velocity linear then angular in the child's frame.  The map is a
                  permutation of joints (the URDF parser orders siblings by itself), its dual is the same permutation.
    tau           pin.rnea = M(q) a + C(q, v) v + g(q) with M including the armature; damping and dry friction are data
                  in its model that rnea does not apply.  Actuator effort is therefore rnea + d v + f sign(v).
    wrench        data.f[i] is what the parent exerts on everything from joint i outward, at the joint, in the child's
                  frame: exactly "on the child, in the link's frame".  The armature is not in it.  Fixed joints are no
                  joints here (their bodies are appended to the joint before), so they have no wrench.
    universal     JointModelUniversal(a1, a2): R = exp(a1 q1) exp(a2 q2).
    continuous    Pinocchio's Python has unbounded joints about x, y, z only: about any axis a it is the one about z
                  between the constant rotations A and A^T with A z = a, A exp(z q) A^T = exp(a q); the link's frame is
                  then turned by A^T in the joint's frame, its wrench by A.
    loops         the cut tree, and our own projection on the Jacobians of its frames: `pinocchio.loops`.

Source: pinocchio 4.1.0, rnea.hpp and joint-*.hpp; the tests compare with closed forms and finite differences.
"""

from __future__ import annotations

import time as clock

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from crosscheck.engines.base import Options, beside, sample_times
from crosscheck.engines.pinocchio import loops as pinocchio_loops
from crosscheck.engines.pinocchio import phases as pinocchio_phases
from crosscheck.engines.pinocchio.model import BuiltModel, build, compute_inverse_dynamics
from crosscheck.engines.shared import loop_closure as assembly
from crosscheck.engines.shared.prescribed import describe_nontree_parts, missing_motion, passive_effort
from crosscheck.measures.record import (
    Record,
    Series,
    make_reaction_series,
    make_wrench_series,
    torque_series,
    vector_series,
)
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism

__all__ = [
    "BuiltModel", "abilities", "build", "certify", "compute_inverse_dynamics", "export", "passive_effort", "replay",
    "run", "unsupported", "version",
]  # fmt: skip

Array = NDArray[np.float64]


# What this adapter offers beside (`crosscheck.engines.base`).
certify = beside("crosscheck.engines.pinocchio.certificate", "certify")
export = beside("crosscheck.engines.pinocchio.export", "export")
replay = beside("crosscheck.engines.pinocchio.replay", "replay")
lift = beside("crosscheck.engines.pinocchio.lift", "lift")
lifts = beside("crosscheck.engines.pinocchio.lift", "lifts")
dynamics = beside("crosscheck.engines.pinocchio.own_dynamics", "dynamics")


def version() -> str:
    """Return the version of Pinocchio."""
    return str(pin.__version__)


def abilities() -> str:
    """Return one sentence: what Pinocchio can do here."""
    return (
        "Rigid inverse dynamics by recursive Newton-Euler (rnea), joint wrenches and tips, every joint kind, closed loops "
        "by projection, springs and forces, URDF by its own parser; no flexible links."
    )


def unsupported(mechanism: Mechanism, case: Case, engine: str) -> str | None:
    """Return the reason why Pinocchio cannot do this case, or None."""
    if not mechanism.is_rigid:
        names = ", ".join(link.name for link in mechanism.beams)
        return f"Pinocchio has rigid bodies only; flexible here: {names}"
    return assembly.describe_refusal(mechanism) if mechanism.closures else missing_motion(mechanism, case)


def run(mechanism: Mechanism, case: Case, engine: str, options: Options) -> Record:
    """Return torque [N m] or [N], tip [m] and wrench [N], [N m] on the sample times of the case."""
    time = sample_times(case)
    start = clock.perf_counter()
    built = build(mechanism)
    held = _solve_efforts(mechanism, case, built, time)
    wall = clock.perf_counter() - start
    algorithm = "rnea, projected on the closures' Jacobian" if mechanism.closures else "rnea"
    return Record(
        engine=engine,
        version=version(),
        settings={"algorithm": algorithm, "model": "URDF" if mechanism.urdf else "Model.addJoint"},
        time=time,
        series=_collect_series(mechanism, held),
        wall_time=wall,
    )


def _solve_efforts(
    mechanism: Mechanism, case: Case, built_model: BuiltModel, time: Array
) -> pinocchio_loops.ClosedDynamics:
    """Efforts and wrenches: of loops, phase by phase, or of an open tree."""
    if mechanism.closures:
        return pinocchio_phases.solve_phase_efforts(mechanism, case, built_model, time)
    state = pinocchio_loops.solve_motion(mechanism, case, built_model, time)
    if describe_nontree_parts(mechanism):
        return pinocchio_loops.solve_efforts(mechanism, built_model, time, state)
    result = compute_inverse_dynamics(built_model, *state)
    return pinocchio_loops.ClosedDynamics(result.torque + passive_effort(mechanism, state[1]), result)


def _collect_series(mechanism: Mechanism, held: pinocchio_loops.ClosedDynamics) -> dict[str, Series]:
    out = torque_series(mechanism, held.torque)
    for link, place in held.dynamics.tip.items():
        out |= vector_series(f"tip/{link}", "m", place)
    for joint, wrench in held.dynamics.wrench.items():
        out |= make_wrench_series(joint, wrench)
    for closure, wrench in held.closures.items():
        out |= make_reaction_series(closure, wrench)
    return out
