"""Arms that bend: flexinv beside Exudyn on the same motion, time beside error.

The reference is flexinv's with fine steps and meshes of order 8; Exudyn's finest run has to agree with it.  Exudyn's cable
in the plane knows neither shear nor rotary inertia: the arms in the plane are given so little of both, to both codes,
that they are the same beam.
"""

from __future__ import annotations

import importlib
import sys
import time as clock
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.engines import open_calls
from benchmarks.targets import add_verdict, make_metric
from benchmarks.timing import Call, Times, compute_time_ratio, run_calls_in_turns
from crosscheck.measures.mechanisms import read_mechanism
from flexinv.analysis.solve import solve
from flexinv.files.load_cases import load_cases
from flexinv.model.mechanism import Beam, Mechanism
from flexinv.model.motion import Motion
from flexinv.typing import Array

ASKED = 10.0  # times as fast as Exudyn in the plane, at an error as small or smaller
SAMPLE = 1e-3  # [s] between the samples at which errors are taken; every step divides it
SECONDS = 10.0  # for each mechanism: five turns of everything, or more
# What flexinv's Newton may leave, over the length: its errors here are 1e-5 and more.
TOLERANCE = 1e-9
# So little shear and rotary inertia that the arms' tips move by less than 1e-6 of their length: hundred times as stiff,
# a hundredth of the inertia (as they are, the two codes differ by 2.7e-5, with this by 2.6e-7).
LITTLE = 100.0

TEXT = """The arm (without gravity) makes its motion and vibrates. Time is that of the whole run: for flexinv from the model to
torques, wrenches and histories of all nodes, for Exudyn its SolveDynamic alone, without sensors and files. Exudyn runs as it
is fastest: the build without range checks, reduced integration, modified or full Newton, dense or sparse matrices, tolerances
of 1e-6, whichever of these is fastest here. Its joints get their motion once per step in the plane; in space, where it has no
parameter for that, by functions in Python that look a list up, some 30 calls a step, which its time contains. flexinv's Newton
may leave 1e-9 of the length. Both integrate by generalized-alpha with a spectral radius of 0.8.

The error is the largest distance of a tip from where the reference has it, over the arm's length. Faster: how many times as
long Exudyn takes as the fastest run of flexinv whose error is as small or smaller, up to what the step itself leaves: a coarse
mesh whose error happens to cancel that of the step counts as exact as Exudyn's finest mesh with that step. Without this
allowance it is the column "strictly"."""

COLUMNS = (
    ("arm", "arm", ""),
    ("method", "method", ""),
    ("elements", "elements per link", ""),
    ("step", "step", "s"),
    ("time", "time", "s"),
    ("per_step", "one step", "µs"),
    ("error", "error", "of the length"),
    ("faster", "flexinv is faster", "-"),
    ("asked", "asked", "-"),
    ("by", "with", ""),
    ("strictly", "strictly", "-"),
    ("setting", "setting", ""),
)
PLOT = {"x": "time", "y": "error", "group": "curve", "log": True}


@dataclass(frozen=True)
class FlexibleCase:
    """A case that is run: its model and case, Exudyn's formulation, finest run of either code for the reference.

    end : [s]; target : [-] or None; reference, finest : (elements, step [s]) of flexinv (of order 8) and of Exudyn
    agreement : largest distance of their tips, over the length, at which the reference counts as converged [-]
    """

    model: str
    case: str
    formulation: str
    target: float | None
    reference: tuple[int, float]
    finest: tuple[int, float]
    agreement: float
    end: float = 0.5


# Measured: 3e-7 in the plane, 1.2e-5 in space, where Exudyn's beams are of low order; twice to ten times that is allowed.
ARMS = (
    FlexibleCase("flex_one_link", "cycloid", "ancf", ASKED, (2, 2.5e-5), (32, 2.5e-5), 3e-6),
    FlexibleCase("flex_two_link", "cycloid", "ancf", ASKED, (2, 2.5e-5), (32, 2.5e-5), 3e-6),
    FlexibleCase("spatial_arm", "reach", "ge", None, (1, 1e-4), (32, 5e-4), 3e-5),
)


@dataclass(frozen=True)
class Grid:
    """Runs to make: Exudyn's elements, flexinv's elements of order 1 and of order 4, and their steps [s].

    finer : steps of flexinv alone, for Exudyn's runs whose error lies between those of two steps
    """

    exudyn: tuple[int, ...] = (4, 16, 64, 256)
    linear: tuple[int, ...] = (4, 16, 64, 256)
    spectral: tuple[int, ...] = (1, 2, 4)
    steps: tuple[float, ...] = (1e-3, 5e-4, 2.5e-4)
    finer: tuple[float, ...] = (1e-3 / 3, 1.25e-4)


QUICK = Grid((4, 16), (4, 16), (1, 2), (1e-3, 5e-4), ())


@dataclass(frozen=True)
class Run:
    """One run: who, its mesh and step [s], what runs it, and where it leaves the tips (samples, 3) [m]."""

    method: str
    elements: int
    step: float
    call: Call
    tips: dict[str, Array]
    setting: str = ""


def run_study(
    models: str, arms: list[str] | None = None, quick: bool = False, seconds: float = SECONDS
) -> dict[str, Any]:
    """Return the table: time [s] and error [-] of every run of the arms."""
    sys.exudynFast = True  # type: ignore[attr-defined]  # before anything imports it: the build without range checks
    rows: list[dict[str, Any]] = []
    for arm in ARMS:
        if arm.model in (arms or [a.model for a in ARMS]):
            rows += list_arm_rows(arm, Path(models), QUICK if quick else Grid(), seconds)
    return {"text": TEXT, "columns": COLUMNS, "rows": rows, "plot": PLOT}


def list_arm_rows(arm: FlexibleCase, models: Path, grid: Grid, seconds: float) -> list[dict[str, Any]]:
    """Return the rows of one arm: its reference first, then all runs; seconds [s] for their timing."""
    mechanism, motion = prepare_arm_case(arm, models)
    length = sum(link.beam.length for link in mechanism.beams if link.beam)
    reference = solve_tip_positions(mechanism.with_mesh(arm.reference[0], 8), motion, arm.reference[1], arm.end)
    finest = find_fastest_setting(arm, mechanism, motion, *arm.finest, any_setting=True)
    apart = compute_tip_distance(finest.tips, reference) / length
    head = _make_row(arm, finest) | {
        "error": apart,
        "by": "the reference: two codes agree",
        "time": None,
        "per_step": None,
    }
    if apart > arm.agreement:
        return [head | {"verdict": "deviation", "by": f"no reference: two codes agree to {arm.agreement:g} only"}]
    runs = [*_run_flexinv(arm, mechanism, motion, grid), *_run_exudyn(arm, mechanism, motion, grid)]
    times = run_calls_in_turns({str(k): run.call for k, run in enumerate(runs)}, seconds)
    errors = [compute_tip_distance(run.tips, reference) / length for run in runs]
    rows = [head | {"verdict": "within", "curve": "the two references apart"}]
    for k, run in enumerate(runs):
        taken = times[str(k)].compute_quartiles().median
        row = _make_row(arm, run) | {"time": taken, "per_step": 1e6 * taken * run.step / arm.end, "error": errors[k]}
        if run.method.startswith("Exudyn"):
            row |= _compare_with_flexinv(arm, run, runs, errors, k, times)
        rows.append(add_verdict(row))
    return rows


def prepare_arm_case(arm: FlexibleCase, models: Path) -> tuple[Mechanism, Motion]:
    """Return the mechanism as both codes get it, and its motion."""
    mechanism = read_mechanism(models / arm.model)
    motion = load_cases(models / arm.model, mechanism)[arm.case].motion
    if arm.formulation == "ancf":
        mechanism = replace_beams(mechanism, make_slender_beam)
    return replace(mechanism, gravity=np.zeros(3)), motion


def replace_beams(mechanism: Mechanism, change: Callable[[Beam], Beam]) -> Mechanism:
    """Return a mechanism with all its beams changed [-]."""
    links = tuple(link if link.beam is None else replace(link, beam=change(link.beam)) for link in mechanism.links)
    return replace(mechanism, links=links)


def make_slender_beam(beam: Beam) -> Beam:
    """Return a beam that hardly shears and whose sections hardly resist turning [N], [kg m]."""
    s = beam.section
    stiffness = s.stiffness * np.where(np.isin(np.arange(6), (1, 2)), LITTLE, 1.0)
    return replace(beam, section=replace(s, stiffness=stiffness, rotary_inertia=s.rotary_inertia / LITTLE))


def solve_tip_positions(mechanism: Mechanism, motion: Motion, step: float, end: float) -> dict[str, Array]:
    """Return flexinv's positions of the beams' tips, (samples, 3) [m], every SAMPLE; step, end [s]."""
    tip = solve(mechanism, motion, step, end=end, tolerance=TOLERANCE).tip
    return {link.name: tip[link.name][:: round(SAMPLE / step)] for link in mechanism.beams}


def compute_tip_distance(ours: dict[str, Array], theirs: dict[str, Array]) -> float:
    """Return the largest distance [m] of a tip in two runs."""
    return max(float(np.linalg.norm(ours[name] - theirs[name], axis=1).max()) for name in theirs)


def _run_flexinv(arm: FlexibleCase, mechanism: Mechanism, motion: Motion, grid: Grid) -> Iterator[Run]:
    for order, meshes in ((1, grid.linear), (4, grid.spectral)):
        for elements in meshes:
            meshed = mechanism.with_mesh(elements, order)
            for step in (*grid.steps, *grid.finer):
                tips = solve_tip_positions(meshed, motion, step, arm.end)
                call = Call(lambda m=meshed, h=step: solve(m, motion, h, end=arm.end, tolerance=TOLERANCE))  # type: ignore[misc]
                yield Run(f"flexinv, order {order}", elements, step, call, tips)


def _run_exudyn(arm: FlexibleCase, mechanism: Mechanism, motion: Motion, grid: Grid) -> Iterator[Run]:
    failed = importlib.import_module("crosscheck.engines.exudyn.integration").ExudynFailure
    for elements in grid.exudyn:
        for step in grid.steps:
            with suppress(failed):  # where no setting converges there is no run to compare with
                yield find_fastest_setting(arm, mechanism, motion, elements, step)


def find_fastest_setting(
    arm: FlexibleCase, mechanism: Mechanism, motion: Motion, elements: int, step: float, any_setting: bool = False
) -> Run:
    """Return Exudyn's run with the setting that is fastest here, or with any; step [s].

    Raises ExudynFailure where none converges.
    """
    exudyn = open_calls("exudyn")
    march = exudyn.March(mechanism, motion, arm.formulation, elements, step, arm.end)
    found: list[tuple[float, Any, dict[str, Array]]] = []
    trouble = exudyn.ExudynFailure("nothing was tried")
    for setting in march.list_settings():
        if found and (any_setting or setting.tolerance > found[0][1].tolerance):
            break
        try:
            start = clock.process_time()
            tips = march.sample_tips(setting, SAMPLE)
        except exudyn.ExudynFailure as error:
            trouble = error
            continue
        found.append((clock.process_time() - start, setting, tips))
    if not found:
        raise trouble
    _, setting, tips = min(found, key=lambda one: one[0])
    name = {"ancf": "Exudyn, ANCF cable", "ge": "Exudyn, geometrically exact"}[arm.formulation]
    return Run(name, elements, step, Call(march.make_runner(setting)), tips, str(setting))


def _make_row(arm: FlexibleCase, run: Run) -> dict[str, Any]:
    named = {"arm": arm.model, "method": run.method, "elements": run.elements, "step": run.step, "setting": run.setting}
    return named | {"curve": f"{run.method}, {run.elements}"}


def _compare_with_flexinv(
    arm: FlexibleCase, run: Run, runs: list[Run], errors: list[float], k: int, times: dict[str, Times]
) -> dict[str, Any]:
    """Beside the fastest run of flexinv with an error as small or smaller: how much faster it is."""
    beside = [n for n, r in enumerate(runs) if r.method == run.method and r.step == run.step]
    of_the_step = errors[max(beside, key=lambda n: runs[n].elements)]
    strict = _find_fastest_run(runs, errors, errors[k], times)
    n = _find_fastest_run(runs, errors, max(errors[k], of_the_step), times)
    if n is None:
        return {"by": "no run of flexinv here is as exact"}
    found = compute_time_ratio(times[str(k)], times[str(n)])
    own = runs[n]
    name = f"{arm.model}: times as fast as Exudyn's {run.elements} elements at {run.step:g} s, at its error or less"
    by = f"{own.elements} x order {own.method[-1]}, {own.step:g} s"
    one = make_metric(name, found.median, "-", lower=arm.target, spread=f"{found.low:.3g} .. {found.high:.3g}; {by}")
    strictly = None if strict is None else compute_time_ratio(times[str(k)], times[str(strict)]).median
    return {"faster": found.median, "asked": arm.target, "by": by, "strictly": strictly, "metric": one}


def _find_fastest_run(runs: list[Run], errors: list[float], error: float, times: dict[str, Times]) -> int | None:
    """The number of flexinv's fastest run with at most this error [-]."""
    good = [n for n, run in enumerate(runs) if run.method.startswith("flexinv") and errors[n] <= error]
    return min(good, key=lambda n: times[str(n)].compute_quartiles().median, default=None)
