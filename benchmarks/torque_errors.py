"""Torque errors beside Exudyn: the time in which either reaches an error of the torque, each with its best settings for it.

flexinv: one extrapolation of `accuracy`, on the coarsest mesh that reaches it.  Exudyn: the mesh, the number of steps and the way
of Newton with which it is fastest, sought on a ladder; where the longest run that can be paid for does not reach an error, it
takes longer than that run.
"""

from __future__ import annotations

import sys
import time as clock
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import accuracy
from benchmarks.accuracy import (
    EXTRAPOLATIONS,
    KEPT,
    Marches,
    compute_peak_error,
    compute_reference,
    make_reference_row,
)
from benchmarks.engines import open_calls
from benchmarks.flexible import make_slender_beam, replace_beams
from benchmarks.targets import add_verdict, make_metric
from benchmarks.timing import Call, compute_time_ratio, run_calls_in_turns
from flexinv.analysis.accurate import solve_problem
from flexinv.analysis.refinement import MESHES as MESHES_OF_BEAMS
from flexinv.analysis.refinement import Problem, StepGrid, apply_mesh
from flexinv.analysis.task import Settings
from flexinv.files.load_cases import Case, load_cases
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

ASKED = 100.0  # times as fast as Exudyn at an error of 1e-6
MESHES = (8, 12, 16, 24, 32, 48, 64, 96)  # elements of every beam in Exudyn
# steps to a coarsest one with which a mesh begins, and how many more come next
FIRST = 16
MORE = 2**0.5
STUCK = 0.8  # an error that so many more steps leave at this part of it is the mesh's
LONGEST = 5.0  # [s] of one run of Exudyn
# Rungs before its last one at which the next mesh begins: steps that are too long for one mesh are for the next.
AGAIN = 3
SHORTEST = 256, 384  # refinements of two marches whose error is the mesh's
SAME = 1e-9  # of the run: breaks of a motion and samples closer than this are one instant

TEXT = f"""Time to a torque error, over the peak of each torque, for a smooth law ('nonic'), without gravity and damping. flexinv:
one extrapolation, on the coarsest mesh that reaches the error. Exudyn: of meshes of {MESHES[0]} to {MESHES[-1]} elements, of
numbers of steps and of a Jacobian that lasts or is made once a step those that reach the error in the shortest time; its fast
build, generalized-alpha with a spectral radius of 0.8, Newton's increments below 1e-9, SolveDynamic alone, without sensors. Where
no run of {LONGEST:g} s reaches an error, the longest one stands for it, and Exudyn takes longer than that. In the plane its cable
knows neither shear nor rotary inertia, and both codes are given little of them. All times are of whole calls; of a closed loop,
whose joints without a drive both codes find, Exudyn's is that of its model and march."""
COLUMNS = (
    ("arm", "mechanism", ""),
    ("asked_error", "error asked", "of the peak"),
    ("method", "method", ""),
    ("setting", "setting", ""),
    ("error", "true error", "of the peak"),
    ("time", "time", "s"),
    ("faster", "flexinv is faster", "-"),
    ("asked", "asked", "-"),
)


@dataclass(frozen=True)
class TorqueErrorCase:
    """A case, Exudyn's formulation ("ancf" or "ge"), and what is asked at 1e-6 [-], or None."""

    model: str
    case: str
    formulation: str
    target: float | None


ARMS = (
    TorqueErrorCase("flex_one_link", "cycloid", "ancf", ASKED),
    TorqueErrorCase("flex_two_link", "cycloid", "ancf", None),
    TorqueErrorCase("spatial_arm", "reach", "ge", ASKED),
    TorqueErrorCase("four_bar_flexible", "turn", "ancf", None),
)


def run_study(
    models: str,
    arms: list[str] | None = None,
    errors: list[float] | None = None,
    seconds: float = accuracy.SECONDS,
    longest: float = LONGEST,
) -> dict[str, Any]:
    """Return the table: time [s] and true error [-] of both codes, by mechanism and error asked."""
    sys.exudynFast = True  # type: ignore[attr-defined]  # before anything imports it: the build without range checks
    rows: list[dict[str, Any]] = []
    for arm in ARMS:
        if arm.model in (arms or [a.model for a in ARMS]):
            rows += list_arm_rows(arm, Path(models), tuple(errors or accuracy.ERRORS), seconds, longest)
    return {"text": TEXT, "columns": COLUMNS, "rows": rows}


def list_arm_rows(
    arm: TorqueErrorCase, models: Path, errors: tuple[float, ...], seconds: float, longest: float
) -> Iterator[dict[str, Any]]:
    """Yield the rows of one mechanism: its reference, then both codes by error [-]; seconds [s] of timing by error."""
    mechanism, case = prepare_arm_case(arm, models)
    problem = make_equal_steps(solve_problem(mechanism, case.motion, min(errors), Settings(), {"start": case.start}))
    known, apart = compute_reference(problem, min(errors))
    head = make_reference_row(arm.model, apart, min(errors))
    yield head
    if head["verdict"] != "within":
        return
    ladder = RunLadder(arm, mechanism, case, known, problem.grid, longest)
    for asked in errors:
        yield from _list_code_rows(arm, Marches(problem, known), ladder, asked, seconds)


def prepare_arm_case(arm: TorqueErrorCase, models: Path) -> tuple[Mechanism, Case]:
    """Return the mechanism as both codes get it, and its case, the motion by the law 'nonic'."""
    mechanism, motion = accuracy.prepare_arm_case(
        accuracy.AccuracyCase(arm.model, arm.case, "consistent", 0.0, None), models
    )
    case = replace(load_cases(models / arm.model, mechanism)[arm.case], motion=motion, initial="consistent")
    if arm.formulation == "ancf":
        mechanism = replace_beams(mechanism, make_slender_beam)
    return replace(mechanism, gravity=np.zeros(3)), case


def make_equal_steps(problem: Problem) -> Problem:
    """Return the problem with coarsest steps that are all equal, as Exudyn has them, and still meet every break [s]."""
    ends = problem.grid.ends
    for count in range(problem.grid.total, 8 * problem.grid.total):
        at = ends / ends[-1] * count
        if np.abs(at - np.round(at)).max() < SAME * count:
            return replace(problem, grid=StepGrid(ends[[0, -1]], (count,)))
    raise ValueError(f"mechanism '{problem.mechanism.name}': no equal steps meet all breaks of the motion")


@dataclass(frozen=True)
class ExudynRun:
    """A run of Exudyn: what it was, its torque error [-], and the time it took with its sensors [s]."""

    march: Any
    error: float
    time: float


@dataclass
class RunLadder:
    """Runs of Exudyn that were made for one mechanism, by elements and way of Newton, from few steps to many.

    known : torques (samples, drives) [N m], [N]; longest : [s] of one run
    """

    arm: TorqueErrorCase
    mechanism: Mechanism
    case: Case
    known: Array
    grid: StepGrid
    longest: float
    made: dict[tuple[int, bool], list[ExudynRun]] = field(default_factory=dict)
    begun: dict[tuple[int, bool], int] = field(default_factory=dict)

    def find_fastest_run(self, accuracy: float) -> ExudynRun:
        """Return the fastest run that reaches an error [-], else the one that took longest."""
        for elements in MESHES:
            for keeps in (True, False):
                self._run_finer_steps(
                    elements,
                    keeps,
                    accuracy,
                    min((one.time for one in self._list_accurate_runs(accuracy)), default=self.longest),
                )
        return min(
            self._list_accurate_runs(accuracy),
            key=lambda one: one.time,
            default=max(self._list_runs(), key=lambda one: one.time),
        )

    def _list_runs(self) -> list[ExudynRun]:
        return [one for own in self.made.values() for one in own]

    def _list_accurate_runs(self, accuracy: float) -> list[ExudynRun]:
        return [one for one in self._list_runs() if one.error <= accuracy]

    def _run_finer_steps(self, elements: int, keeps: bool, accuracy: float, longest: float) -> None:
        """Take more steps until an error is reached, the mesh allows none smaller, or a run takes longer than ``longest`` [s]."""
        runs = self.made.setdefault((elements, keeps), [])
        first = self.begun.setdefault((elements, keeps), self._find_first_level(elements, keeps))
        while not runs or runs[-1].error > accuracy:
            stuck = len(runs) > 1 and runs[-1].error > STUCK * runs[-2].error
            if stuck or (runs and MORE * runs[-1].time > longest):
                return
            made = self._run(elements, keeps, round(FIRST * MORE ** (first + len(runs))))
            if made is None:
                return
            runs.append(made)

    def _find_first_level(self, elements: int, keeps: bool) -> int:
        """Return the rung with which a mesh begins: little before that where the one before it has ended."""
        coarser = MESHES.index(elements) - 1
        before = (MESHES[coarser], keeps)
        return max(0, self.begun[before] + len(self.made[before]) - AGAIN) if coarser >= 0 else 0

    def _run(self, elements: int, keeps: bool, finer: int) -> ExudynRun | None:
        exudyn = open_calls("exudyn")
        finer = KEPT * max(1, round(finer / KEPT))
        steps = finer * self.grid.total
        end = float(self.grid.ends[-1])
        march = exudyn.TorqueMarch(
            self.mechanism, self.case, self.arm.formulation, elements, steps, end, len(self.known) - 1, keeps
        )
        start = clock.perf_counter()
        try:
            torque = march.compute_torques()
        except exudyn.ExudynFailure:
            return None
        return ExudynRun(
            march, compute_peak_error(torque[:, self.mechanism.actuated], self.known), clock.perf_counter() - start
        )


def find_coarsest_mesh(marches: Marches, accuracy: float) -> tuple[Marches, tuple[int, ...]] | None:
    """Return the coarsest mesh on which two marches, extrapolated, reach an error [-], and their refinements [-]."""
    for mesh in range(len(MESHES_OF_BEAMS)):
        here = replace(marches, mechanism=apply_mesh(marches.problem.mechanism, mesh))
        if here.compute_error(here.compute_extrapolated_torques(SHORTEST)) <= accuracy:
            pair = here.find_refinements(accuracy, EXTRAPOLATIONS["one extrapolation"])
            return None if pair is None else (here, pair)
    return None


def _list_code_rows(
    arm: TorqueErrorCase, marches: Marches, ladder: RunLadder, asked: float, seconds: float
) -> Iterator[dict[str, Any]]:
    """Yield the rows of one mechanism and error [-]; seconds [s] of timing."""
    named = {"arm": arm.model, "asked_error": asked}
    coarsest_mesh = find_coarsest_mesh(marches, asked)
    fastest_run = ladder.find_fastest_run(asked)
    if coarsest_mesh is None:
        yield named | {"method": "flexinv", "verdict": "skipped", "message": f"{asked:g} is not reached"}
        return
    here, pair = coarsest_mesh
    times = run_calls_in_turns(
        {
            "flexinv": Call(lambda: here.compute_extrapolated_torques(pair)),
            "Exudyn": Call(fastest_run.march.make_runner()),
        },
        seconds,
    )
    order = max(link.beam.order for link in here.mechanism.beams if link.beam) if here.mechanism else 0
    setting = f"order {order}, {sum(pair) * here.problem.grid.total} steps"
    own = {
        "method": "flexinv",
        "setting": setting,
        "error": here.compute_error(here.compute_extrapolated_torques(pair)),
    }
    yield add_verdict(named | own | {"time": times["flexinv"].compute_quartiles().median})
    reaches = fastest_run.error <= asked
    found = compute_time_ratio(times["Exudyn"], times["flexinv"])
    more = "" if reaches else ", at least"
    target = arm.target if asked == min(accuracy.ERRORS) else None
    name = f"{arm.model}: torque error {asked:g}, times as fast as Exudyn{more}"
    one = make_metric(name, found.median, "-", lower=target, spread=f"{found.low:.3g} .. {found.high:.3g}")
    method = "Exudyn" if reaches else "Exudyn, not reached"
    row = {
        "method": method,
        "setting": str(fastest_run.march),
        "error": fastest_run.error,
        "time": times["Exudyn"].compute_quartiles().median,
    }
    yield add_verdict(named | row | {"faster": found.median, "asked": target, "metric": one})
