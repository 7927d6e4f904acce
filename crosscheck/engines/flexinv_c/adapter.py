"""The exported library as an engine: `flexinv.export_c`, compiled by the system's C compiler, in a process without Python.

What a rigid mechanism needs is the motion of all its joints, as `flexinv.prepare` takes it.  A mechanism with beams makes the
steps of the case one after the other from rest, as `flexinv.Controller` does.  Loops of rigid links are closed by flexinv first:
a controller, too, gives the library the motion of all joints, and says which closures act.
"""

from __future__ import annotations

import time as clock
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from crosscheck.engines.base import Options, beside, sample_times
from crosscheck.engines.flexinv_c.program import (
    NO_COMPILER,
    LibrarySettings,
    Program,
    Question,
    build_program,
)
from crosscheck.engines.shared.prescribed import missing_motion
from crosscheck.measures.record import Record, torque_series
from flexinv import __version__
from flexinv.analysis.solve import solve
from flexinv.errors import InputError
from flexinv.export.acting_sets import find_acting_set
from flexinv.export.given_forces import list_moved_forces, replace_changing_forces
from flexinv.export.link_library import find_compiler
from flexinv.export.machine_code import NATIVE
from flexinv.export.refusals import check_exportable
from flexinv.files.load_cases import Case
from flexinv.kinematics.mesh import build
from flexinv.linearized.modal_damping import apply_stated_ratio
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Triple

Array = NDArray[np.float64]


# What this adapter offers beside (`crosscheck.engines.base`).
MESHES = True
certify = beside("crosscheck.engines.flexinv_c.certificate", "certify")


def version() -> str:
    """Return the version of flexinv, whose kernels stand in the library."""
    return str(__version__)


def abilities() -> str:
    """Return one sentence: what the exported library can do here."""
    return (
        "Torques of the C library that flexinv export-c writes, in a process without Python: rigid trees and loops, and "
        "mechanisms with beams or meshed links that begin at rest and move without jumps of acceleration; needs a C compiler."
    )


def unsupported(mechanism: Mechanism, case: Case, engine: str) -> str | None:
    """Return the reason why there is no library of this case, or None."""
    if find_compiler(NATIVE) is None:
        return NO_COMPILER
    try:
        check_exportable(replace_changing_forces(mechanism))
    except InputError as refusal:
        return str(refusal)
    return _describe_rigid_refusal(mechanism, case) if mechanism.is_rigid else _describe_march_refusal(mechanism, case)


def _describe_rigid_refusal(mechanism: Mechanism, case: Case) -> str | None:
    winding = [j.name for j in mechanism.joints if KINDS[j.kind].circle and j.stiffness]
    if winding:
        return f"the library counts no turns, by which the springs in {', '.join(winding)} are wound"
    return None if mechanism.closures else missing_motion(mechanism, case)


def _describe_march_refusal(mechanism: Mechanism, case: Case) -> str | None:
    """The reason of a case that a march of single steps from rest does not make: jumps, a start that moves, idle joints."""
    given = case.motion.joints(mechanism)
    idle = [j.name for j in mechanism.joints if j.nv and not j.actuated and j.name in given]
    if idle:
        return f"the motion gives {', '.join(idle)} without a drive, which the library carries on by its dynamics"
    between = [t for t in case.motion.jumps if 0.0 <= t < case.end]
    if between:
        return f"accelerations jump at t = {between[0]:g} s, of which a controller's single steps are not told"
    _, qd, _ = case.motion.evaluate(mechanism, np.zeros(1))
    return "the motion does not begin at rest, as the library does" if qd.any() else None


def run(mechanism: Mechanism, case: Case, engine: str, options: Options) -> Record:
    """Return the torque [N m] or [N] on the sample times of the case; "skipped" where it begins too suddenly for the library."""
    mechanism = case.meshed(mechanism)
    try:
        plan = plan_case(mechanism, case)
        program = make_program(mechanism, plan.settings)
    except InputError as refusal:
        return Record(engine, "skipped", str(refusal), version())
    start = clock.perf_counter()
    answers = program.ask(plan.questions)
    wall = clock.perf_counter() - start
    return Record(
        engine=engine,
        version=version(),
        settings={"calls": len(plan.questions), "size of the program [bytes]": len(program.data)},
        time=sample_times(case),
        series=torque_series(mechanism, np.array(answers[:: plan.every])),
        wall_time=wall,
    )


@dataclass(frozen=True)
class CasePlan:
    """Settings of the library of a case, its questions, and every which answer belongs to a sample."""

    settings: LibrarySettings
    questions: list[Question]
    every: int


def plan_case(mechanism: Mechanism, case: Case) -> CasePlan:
    """Return the questions of a case [rad or m, s]: samples of a rigid mechanism, steps of one with beams."""
    every = round(case.sample / case.step)
    if mechanism.is_rigid:
        motion = _evaluate_rigid_motion(mechanism, case, every)
        samples = sample_times(case)
        forces = _evaluate_forces(mechanism, samples)
        phases = [find_acting_set(mechanism, time) for time in samples.tolist()]
        questions = [Question("torque", *row) for row in zip(*motion, forces, phases, strict=True)]
        return CasePlan(make_rigid_settings(mechanism, motion[0][0]), questions, 1)
    count = every * (len(sample_times(case)) - 1)
    time = case.step * np.arange(count + 1)
    q, qd, qdd = case.motion.evaluate(mechanism, time, "left")
    start = q[0] if mechanism.actuated.all() else _find_start(mechanism, case)
    settings = LibrarySettings(tuple(start.tolist()), case.step, case.initial, case.spectral_radius)
    names = ["last_torque", *count * ["step"]]
    rows = zip(names, q, qd, qdd, _evaluate_forces(mechanism, time), strict=True)
    return CasePlan(settings, [Question(*row) for row in rows], every)


def _evaluate_forces(mechanism: Mechanism, time: NDArray[np.floating]) -> Array:
    """Wrenches of the given forces on links at some times (samples,), (samples, forces, 6) [N], [N m]."""
    forces = list_moved_forces(build(apply_stated_ratio(mechanism)))
    made = [np.stack([np.interp(time, one.time, column) for column in one.wrench.T], axis=1) for one in forces]
    return np.stack(made, axis=1) if made else np.zeros((len(time), 0, 6))


def _evaluate_rigid_motion(mechanism: Mechanism, case: Case, every: int) -> Triple:
    """q, qd, qdd of all joints on the sample times, in loops as flexinv closes them."""
    if not mechanism.closures:
        return case.motion.evaluate(mechanism, sample_times(case))
    found = solve(mechanism, case.motion, case.step, end=case.end, start=case.start)
    return found.q[::every], found.qd[::every], found.qdd[::every]


def _find_start(mechanism: Mechanism, case: Case) -> Array:
    """Coordinates (nq,) of the undeformed mechanism at the start, joints without a drive where case and loops have them."""
    q: Array = solve(mechanism, case.motion, case.step, end=case.step, start=case.start).q[0]
    return q


def make_rigid_settings(mechanism: Mechanism, q: Array) -> LibrarySettings:
    """Return the settings of a rigid mechanism that is asked at q (nq,) [rad], [m]."""
    return LibrarySettings(tuple(q.tolist()) if mechanism.closures else None)


@lru_cache(maxsize=4)
def make_program(mechanism: Mechanism, settings: LibrarySettings) -> Program:
    """Return the program of a mechanism [-] that was asked for lately; InputError as `build_program`."""
    return build_program(mechanism, settings)
