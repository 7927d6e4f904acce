"""Exudyn: rigid mechanisms by its kinematic tree or in time, flexible ones by two beam formulations in time.

    exudyn        rigid trees, every joint kind: KinematicTree66, tau = M qdd + f (exact, no time integration)
    exudyn-dae    the same mechanisms in redundant coordinates, every joint a prescribed constraint, in time; also loops
                  that open and close (`exudyn.phases`)
    exudyn-ancf   absolute nodal coordinates: ANCFCable2D in the plane, ANCFBeam in space
    exudyn-ge     geometrically exact: BeamGeometricallyExact2D (3 nodes) in the plane, BeamGeometricallyExact in space;
                  links that are meshes by ObjectFFRFreducedOrder with Exudyn's own Craig-Bampton basis
                  (the last three also closed loops, springs and forces: `exudyn.loops`)

Options: ``elements`` (per beam), ``step`` [s], ``refinement`` (each doubles the elements and halves the step),
``spectral_radius`` (generalized-alpha of index 3, in the place of index 2 where that is the default).
The modules `exudyn.rigid`, `exudyn.planar` and `exudyn.spatial` give the conventions; what the bodies need is completed here
to the effort of the actuator: + rotor inertia qdd + damping qd + friction sign(qd).
"""

from __future__ import annotations

import time as clock

import exudyn as exu

from crosscheck.engines.base import Options, beside, sample_times
from crosscheck.engines.exudyn import loops as exudyn_loops
from crosscheck.engines.exudyn import phases as exudyn_phases
from crosscheck.engines.exudyn import rigid as exudyn_rigid
from crosscheck.engines.exudyn import switched as exudyn_switched
from crosscheck.engines.exudyn.integration import quiet
from crosscheck.engines.exudyn.models import planar as exudyn_planar
from crosscheck.engines.exudyn.models import spatial as exudyn_spatial
from crosscheck.engines.exudyn.run_in_time import ANCF, DAE, EXACT, TREE, TimedRun, build_start_layout, integrate_tree
from crosscheck.engines.shared.prescribed import (
    describe_coupled_sections,
    describe_nontree_parts,
    missing_motion,
    passive_effort,
    rotor_effort,
)
from crosscheck.measures.mechanisms import check_resolved
from crosscheck.measures.record import Record, compute_fingerprint, make_wrench_series, torque_series, vector_series
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism

# What this adapter offers beside (`crosscheck.engines.base`).
certify = beside("crosscheck.engines.exudyn.certificate", "certify")
export = beside("crosscheck.engines.exudyn.export", "export")
replay = beside("crosscheck.engines.exudyn.replay", "replay")
lift = beside("crosscheck.engines.exudyn.lift", "lift")
lifts = beside("crosscheck.engines.exudyn.lift", "lifts")
MESHES = True
READS = ()  # formats of files; models come in memory


def version() -> str:
    """Return the version of Exudyn."""
    return str(exu.__version__)


def abilities() -> str:
    """Return one sentence: what Exudyn can do here."""
    return (
        "Rigid inverse dynamics of every joint kind (KinematicTree66, or in time); flexible and mixed trees in time "
        "with prescribed joints, by ANCF (cable in the plane, beam in space) or geometrically exact beams; closed loops, "
        "springs and forces in time, rigid (exudyn-dae) or with beams, also where closures act for a while."
    )


def unsupported(mechanism: Mechanism, case: Case, engine: str) -> str | None:
    """Return the reason why Exudyn cannot do this case, or None."""
    beyond = describe_nontree_parts(mechanism)
    if beyond and engine != TREE:
        return _describe_loop_refusal(mechanism, case, engine)
    if (reason := beyond or missing_motion(mechanism, case)) is not None:
        return f"{reason}; see {DAE if mechanism.is_rigid else f'{ANCF} and {EXACT}'}" if beyond else reason
    names = ", ".join(link.name for link in mechanism.flexible)
    if engine in (TREE, DAE):
        if names:
            return f"{engine} has rigid bodies only; flexible here: {names}"
        return None if engine == TREE else _describe_refusal(mechanism, case, engine)
    return _describe_refusal(mechanism, case, engine) if names else f"no link bends: see {TREE} and {DAE}"


def _describe_loop_refusal(mechanism: Mechanism, case: Case, engine: str) -> str | None:
    """Return the reason why there is no model in time with closures, springs or forces, or None."""
    if (reason := describe_coupled_sections(mechanism, "Exudyn's beams")) is not None:
        return reason
    if exudyn_phases.has_switched_closures(mechanism):
        if engine == DAE:
            return exudyn_phases.describe_refusal(mechanism, case)
        if mechanism.beams:
            return exudyn_switched.describe_refusal(mechanism, case, engine)
    return exudyn_loops.describe_refusal(mechanism, case, engine)


def _describe_refusal(mechanism: Mechanism, case: Case, engine: str) -> str | None:
    """Return the reason why there is no model in time, or None; the tree of rigid bodies has no such limits."""
    if mechanism.meshed and engine != EXACT:
        return f"links that are meshes are told to {EXACT} alone; here: {', '.join(m.name for m in mechanism.meshed)}"
    if (reason := describe_coupled_sections(mechanism, "Exudyn's beams")) is not None:
        return reason
    layout = build_start_layout(mechanism, case)
    if not isinstance(exudyn_planar.find_plane(mechanism, layout), str):
        return None
    left_out = exudyn_spatial.describe_damping_loss(mechanism) if engine == EXACT else None
    return exudyn_spatial.describe_refusal(mechanism) or left_out


def run(mechanism: Mechanism, case: Case, engine: str, options: Options) -> Record:
    """Return torque [N m] or [N], wrench [N], [N m], tip, deflection [m] and axial [N] on the sample times."""
    check_resolved(mechanism)
    with quiet():
        made = _run_formulation(mechanism, case, engine, options)
    return Record(
        engine=engine,
        version=version(),
        settings=made.settings,
        time=sample_times(case),
        series=made.series,
        wall_time=made.wall,
        model_hash=compute_fingerprint(mechanism),
        budget=made.budget,
    )


def _run_formulation(mechanism: Mechanism, case: Case, engine: str, options: Options) -> TimedRun:
    if engine == TREE:
        return _run_tree(mechanism, case)
    if mechanism.beams and exudyn_phases.has_switched_closures(mechanism):
        return exudyn_switched.integrate_switched_beams(mechanism, case, engine, options)
    if exudyn_phases.has_switched_closures(mechanism):
        return exudyn_phases.integrate_phases(mechanism, case, options)
    if describe_nontree_parts(mechanism):
        return exudyn_loops.integrate_loops(mechanism, case, engine, options)
    return integrate_tree(mechanism, case, engine, options)


def _run_tree(mechanism: Mechanism, case: Case) -> TimedRun:
    q, qd, qdd = case.motion.evaluate(mechanism, sample_times(case))
    start = clock.perf_counter()
    result = exudyn_rigid.compute_inverse_dynamics(mechanism, q, qd, qdd, wrench="wrench" in case.quantities)
    wall = clock.perf_counter() - start
    drive = rotor_effort(mechanism, qdd) + passive_effort(mechanism, qd)
    made = torque_series(mechanism, result.torque + drive)
    for name, tip in result.tip.items():
        made |= vector_series(f"tip/{name}", "m", tip)
    for name, wrench in result.wrench.items():
        made |= make_wrench_series(name, wrench)
    return TimedRun(made, {"algorithm": "KinematicTree66, M qdd + f"}, wall)
