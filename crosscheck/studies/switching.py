"""Phases of mechanisms that open and close, against the separate mechanisms: the torques of every engine with its own.

A separate mechanism has the closures of one phase for good and nothing of the others; it starts where the phase starts.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Literal, TypedDict

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import null_space, qr

from crosscheck.engines import ENGINES, adapter, describe_missing_package
from crosscheck.engines.base import sample_times
from crosscheck.engines.shared import phases
from crosscheck.measures.limits import Verdict
from crosscheck.measures.mechanisms import read_mechanism
from crosscheck.measures.record import Record
from crosscheck.verdicts.study_table import StudyTable
from flexinv.analysis.solution import Solution
from flexinv.analysis.solve import solve
from flexinv.constraints.closures import build_constraint_rows, compute_constraint_jacobian
from flexinv.errors import InputError
from flexinv.files.load_cases import Case, load_cases
from flexinv.kinematics.mesh import build
from flexinv.kinematics.nodal_motion import compute_rigid_motion
from flexinv.model.mechanism import WORLD, Mechanism
from flexinv.model.motion import Motion
from flexinv.typing import Triple

# Largest difference over the range of the torque.  Engines of closed formulas: what is asked for of rigid phases.  In
# time: the bound of the engine itself, twice.
BOUNDS = {"flexinv": 1e-9, "pinocchio": 1e-9, "mujoco": 1e-9, "exudyn-dae": 2e-6}
IN_TIME = {"exudyn-dae"}  # starts a phase in motion with a transient: only where all phases start at rest
# Where phases start in motion the splines through the samples of joints that a loop ties contradict each other: their
# accelerations by some 1e-7 (measured in models/walker; it falls with the spacing of the samples).
CONTRADICTION = 1e-6
OPTIONS = {"error": False}

TEXT = """Mechanisms whose closures act for a while, in every engine that takes them: the torques of each phase against
those of the separate mechanism in the same engine. That mechanism has the closures of the phase for good. Bodies without
drives that these tie to the world alone (a bar on its table) are left away: what remains is an open tree. Where the motion
gives more coordinates than the closed mechanism has freedoms, the separate one is given as many as it has, and the other
joints follow from its closures. So no phase is compared with itself.

Where phases start in motion the bound is wider: the samples of joints that a loop ties contradict each other by that much
between the closed mechanism, which follows some of them, and the motion. Exudyn is asked only where all phases start at
rest: a start in motion costs it a transient, which the whole does not have."""

COLUMNS = (
    ("mechanism", "mechanism", ""),
    ("case", "case", ""),
    ("engine", "engine", ""),
    ("phase", "phase", "s"),
    ("closures", "closures that act", ""),
    ("joints", "separate mechanism", ""),
    ("error", "largest difference", "of the range"),
    ("bound", "bound", "of the range"),
)


@dataclass(frozen=True, eq=False)
class MotionExcerpt(Motion):
    """A part of a motion: from a time on, of some joints.

    since : [s]; names : of the joints that it gives
    """

    since: float = 0.0
    names: frozenset[str] = frozenset()

    def joints(self, mechanism: Mechanism) -> tuple[str, ...]:
        """Return the names of the joints [-] that the excerpt gives."""
        return tuple(name for name in super().joints(mechanism) if name in self.names)

    def evaluate(self, mechanism: Mechanism, time: ArrayLike, side: Literal["left", "right"] = "right") -> Triple:
        """Return q, qd, qdd of the whole motion, times (samples,) [s] counted from the start of the excerpt."""
        return super().evaluate(mechanism, np.asarray(time, dtype=np.float64) + self.since, side)


@dataclass(frozen=True)
class PhaseProblem:
    """The mechanism of one phase and its case; samples : which of the whole belong to it."""

    mechanism: Mechanism
    case: Case
    samples: slice
    closures: tuple[str, ...]
    at_rest: bool


class PhaseRow(TypedDict):
    """A line of the table: one phase in one engine; error, bound : over the range of the torque [-]."""

    mechanism: str
    case: str
    engine: str
    phase: str
    closures: str
    joints: str
    error: float
    bound: float
    verdict: Verdict


def run_study(models: str) -> StudyTable:
    """Return the table of the report; differences over the range of the torque [-]."""
    rows: list[PhaseRow] = []
    for folder in sorted(path.parent for path in Path(models).glob("*/mechanism.toml")):
        try:
            mechanism = read_mechanism(folder)
        except InputError:
            continue  # the matrix of models says so
        if mechanism.is_rigid and any(c.active for c in mechanism.closures):
            for case in load_cases(folder, mechanism).values():
                rows += list_case_rows(mechanism, case)
    if not rows:
        return {
            "status": "skipped",
            "message": "there is no mechanism with closures that act for a while among the models",
        }
    return {"text": TEXT, "columns": COLUMNS, "rows": rows}


def list_case_rows(mechanism: Mechanism, case: Case) -> list[PhaseRow]:
    """Return one row per engine and phase; differences over the range [-]."""
    parts = split_phases(mechanism, case)
    rest = all(part.at_rest for part in parts)
    return [
        row
        for name in BOUNDS
        if describe_missing_package(ENGINES[name]) is None and (rest or name not in IN_TIME)
        for row in list_engine_rows(name, mechanism, case, parts, BOUNDS[name] if rest else CONTRADICTION)
    ]


def list_engine_rows(
    name: str, mechanism: Mechanism, case: Case, parts: list[PhaseProblem], bound: float
) -> Iterator[PhaseRow]:
    """Yield one row per phase of an engine; differences over the range of the whole torque, and their bound [-]."""
    module = adapter(ENGINES[name])
    time = sample_times(case)
    whole = module.run(mechanism, case, name, OPTIONS)
    span = max(np.ptp(one.values) for one in whole.series.values() if one.quantity == "torque")
    for part in parts:
        result = module.run(part.mechanism, part.case, name, OPTIONS)
        error = float(compute_largest_difference(whole, result, part) / span)
        ends = time[part.samples][[0, -1]]
        yield {
            "mechanism": mechanism.name,
            "case": case.name,
            "engine": name,
            "phase": f"{ends[0]:g} to {ends[1]:g}",
            "closures": ", ".join(part.closures) or "none",
            "joints": describe(part),
            "error": error,
            "bound": bound,
            "verdict": "within" if error <= bound else "deviation",
        }


def compute_largest_difference(whole: Record, alone: Record, part: PhaseProblem) -> float:
    """Return the largest difference of any torque that both give [N m], [N]."""
    names = [n for n, one in alone.series.items() if one.quantity == "torque"]
    samples = len(alone.series[names[0]].values)
    cut = slice(part.samples.start, part.samples.start + samples)
    return max(float(np.abs(alone.series[n].values - whole.series[n].values[cut]).max()) for n in names)


def describe(part: PhaseProblem) -> str:
    """Return the separate mechanism in words."""
    given = part.case.motion.joints(part.mechanism)
    if not part.mechanism.closures:
        return "open tree"
    return f"closed, given {', '.join(given)}"


# ------------------------------------------------------------------------------------------- the separate mechanisms


def split_phases(mechanism: Mechanism, case: Case) -> list[PhaseProblem]:
    """Return the mechanism of every phase with its case; times [s] start anew in each."""
    time = sample_times(case)
    s = solve(mechanism, case.motion, case.sample, end=case.end, start=case.start)
    bounds = phases.list_phase_bounds(mechanism, time)
    return [_take_phase(s, case, first, last) for first, last in pairwise(bounds)]


def _take_phase(solution: Solution, case: Case, first: int, last: int) -> PhaseProblem:
    time = sample_times(case)
    now = _remove_idle_bodies(phases.apply_active_closures(solution.mechanism, float(time[first])), case)
    names = _choose_driven_joints(solution, now, case, (first + last) // 2)
    motion = MotionExcerpt(case.motion.tracks, case.motion.duration, float(time[first]), frozenset(names))
    start = {
        j.name: solution.q[first, solution.mechanism.q_slices[j.name]]
        for j in now.joints
        if j.nv and j.name not in names
    }
    end = (last - 1 - first) * case.sample
    phase_case = replace(case, motion=motion, start=start, end=end)
    still = not (np.abs(solution.qd[first]).max() > 1e-6 or np.abs(solution.qdd[first]).max() > 1e-3)
    acting = tuple(c.name for c in phases.apply_active_closures(solution.mechanism, float(time[first])).closures)
    return PhaseProblem(now, phase_case, slice(first, last), acting, still)


def _remove_idle_bodies(mechanism: Mechanism, case: Case) -> Mechanism:
    """Without the bodies that nothing drives and that closures tie to the world or to each other only."""
    idle = _find_idle_bodies(mechanism, case)
    lost = idle | {WORLD}
    kept = [c for c in mechanism.closures if not {c.first.link, c.second.link} <= lost]
    held = {link for c in kept for link in (c.first.link, c.second.link)}
    held |= {j.parent for j in mechanism.joints if j.child not in idle}
    if idle & held or not idle:
        return mechanism
    return replace(
        mechanism,
        links=tuple(link for link in mechanism.links if link.name not in idle),
        joints=tuple(j for j in mechanism.joints if j.child not in idle),
        closures=tuple(kept),
    )


def _find_idle_bodies(mechanism: Mechanism, case: Case) -> set[str]:
    """Bodies that hang on the world by joints that nothing drives or moves."""
    given = set(case.motion.joints(mechanism))
    idle: set[str] = set()
    for joint in mechanism.joints:  # parents come before their children
        hangs = joint.parent == WORLD or joint.parent in idle
        if hangs and not joint.actuated and joint.name not in given:
            idle.add(joint.child)
    return idle


def _choose_driven_joints(solution: Solution, now: Mechanism, case: Case, sample: int) -> set[str]:
    """As many joints of the motion as the closed mechanism has freedoms, those that tell them apart best."""
    names = [j.name for j in now.joints if j.name in case.motion.joints(now)]
    if not now.closures:
        return set(names)
    mesh = build(now)
    q = np.concatenate([solution.q[sample, solution.mechanism.q_slices[j.name]] for j in now.joints])
    rest = np.zeros((1, now.nv))
    motions = null_space(
        compute_constraint_jacobian(mesh, compute_rigid_motion(mesh, q[None], rest, rest), build_constraint_rows(mesh))[
            0
        ],
        rcond=1e-9,
    )
    columns = [now.v_slices[name].start for name in names]
    _, _, order = qr(motions[columns].T, pivoting=True, mode="economic")
    return {names[k] for k in order[: motions.shape[1]]}
