"""Accuracy: time to a torque error, by plain steps, one extrapolation, two, and ``accuracy=``, which finds steps and mesh itself.

They all use flexinv's own march; the reference is an extrapolation on the finest mesh, by steps far shorter, whose own error is
shown.  Exudyn beside it stands in `torque_errors`, and by tips in the parts one-link, two-link and spatial.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.targets import add_verdict, make_metric
from benchmarks.timing import Call, Times, compute_time_ratio, run_calls_in_turns
from crosscheck.measures.mechanisms import read_mechanism
from flexinv.analysis.accurate import solve_problem
from flexinv.analysis.evaluation import FirstStep, run_second_step
from flexinv.analysis.extrapolation import compute_extrapolated_step, take_every_sample, weights
from flexinv.analysis.refinement import Problem, Refinement, mixed
from flexinv.analysis.solution import Solution
from flexinv.analysis.solve import solve
from flexinv.analysis.task import Settings
from flexinv.errors import ConvergenceError
from flexinv.files.load_cases import load_cases
from flexinv.kinematics.mesh import Mesh
from flexinv.model.mechanism import Mechanism, with_retardation
from flexinv.model.motion import Motion
from flexinv.typing import Array

ASKED = 8.0  # times as fast as plain steps at an error of 1e-6, by one extrapolation
ERRORS = (1e-3, 1e-4, 1e-5, 1e-6)  # of the peak of the torque
KEPT = 2  # samples to a coarsest step at which torques are compared; refinements are multiples of it
MOST = 4096  # refinement of plain steps
# What marches are extrapolated: how much finer each is than the first.
EXTRAPOLATIONS = {
    "one extrapolation": ((1.0, 1.5), (1.0, 1.75)),
    "two extrapolations": ((1.0, 4 / 3, 5 / 3), (1.0, 1.4, 3.4)),
}
LEFT = 1e-4  # what Newton leaves in the marches that are timed, over the least error: the reference's leaves rounding
NEAR = 0.03  # of the fewest steps that reach an error, to which they are sought
SECONDS = 6.0  # for each mechanism and error

TEXT = """Time to a torque error, over the peak of each torque, for a smooth law ('nonic'). Plain: steps so short that the march
reaches the error, on the mesh that accuracy= has chosen for it. One extrapolation: two marches with steps of which one is 3/2 or
7/4 of the other, as few as reach the error. Two extrapolations: three marches, whose steps are as 1, 3/4, 3/5 or as 1, 5/7, 5/17.
accuracy=: flexinv.solve finds steps, mesh and error bar itself, which takes several marches, and knows nothing of the reference;
it is asked for the same error, over the range. In the others Newton leaves a ten-thousandth of the least error. All times are of
whole calls, to torques."""

COLUMNS = (
    ("arm", "mechanism", ""),
    ("asked_error", "error asked", "of the peak"),
    ("method", "method", ""),
    ("mesh", "elements x order", ""),
    ("steps", "steps", ""),
    ("error", "true error", "of the peak"),
    ("time", "time", "s"),
    ("faster", "times as fast as plain", "-"),
    ("asked", "asked", "-"),
)


@dataclass(frozen=True)
class AccuracyCase:
    """A case that is solved, by the law 'nonic'; retardation [s] of its beams; target: least ratio at 1e-6 [-], or None."""

    model: str
    case: str
    initial: str
    retardation: float
    target: float | None


ARMS = (
    AccuracyCase("flex_one_link", "cycloid", "consistent", 0.0, ASKED),
    AccuracyCase("flex_two_link", "cycloid", "consistent", 0.0, None),
    AccuracyCase("spatial_arm", "reach", "static", 1e-3, ASKED),
    AccuracyCase("four_bar_flexible", "turn", "static", 1e-4, None),
)


def run_study(
    models: str, arms: list[str] | None = None, errors: list[float] | None = None, seconds: float = SECONDS
) -> dict[str, Any]:
    """Return the table: time [s] and true error [-] of each method, mechanism and error asked."""
    rows: list[dict[str, Any]] = []
    for arm in ARMS:
        if arm.model in (arms or [a.model for a in ARMS]):
            rows += list_arm_rows(arm, Path(models), tuple(errors or ERRORS), seconds)
    return {"text": TEXT, "columns": COLUMNS, "rows": rows}


def list_arm_rows(
    arm: AccuracyCase, models: Path, errors: tuple[float, ...], seconds: float
) -> Iterator[dict[str, Any]]:
    """Yield the rows of one mechanism: its reference first, then each method by error [-]; seconds [s] of timing by error."""
    mechanism, motion = prepare_arm_case(arm, models)
    problem = solve_problem(mechanism, motion, min(errors), Settings(initial=arm.initial), {})
    known, apart = compute_reference(problem, min(errors))
    head = make_reference_row(arm.model, apart, min(errors))
    yield head
    if head["verdict"] != "within":
        return
    timed = replace(problem, settings=replace(problem.settings, tolerance=LEFT * min(errors)))
    for asked in errors:
        yield from _list_method_rows(arm, Marches(timed, known), motion, asked, seconds)


def prepare_arm_case(arm: AccuracyCase, models: Path) -> tuple[Mechanism, Motion]:
    """Return the mechanism, and its motion by the law 'nonic'."""
    mechanism = read_mechanism(models / arm.model)
    motion = load_cases(models / arm.model, mechanism)[arm.case].motion
    if arm.retardation:
        mechanism = with_retardation(mechanism, arm.retardation)
    tracks = tuple(replace(track, law="nonic") if hasattr(track, "law") else track for track in motion.tracks)
    return mechanism, replace(motion, tracks=tracks)


def compute_reference(problem: Problem, least: float) -> tuple[Array, float]:
    """Return the torques (samples, drives) [N m], [N] at `KEPT` samples to a coarsest step, and their own error [-].

    Steps are halved until two answers are closer than a fortieth of the ``least`` error [-], or no shorter ones can be paid for.
    """
    refinement = Refinement(problem)
    before = None
    apart = np.inf
    for mesh, finer in ((5, 32), (6, 64), (7, 128), (7, 192), (7, 256), (7, 384), (7, 512), (7, 768), (7, 1024)):
        pair = [refinement.run_level(mesh, n) for n in (finer // 2, finer)]
        if any(one is None for one in pair):
            continue
        found = mixed(
            [one.quantities.take_samples(one.samples_per_step // KEPT) for one in pair if one is not None],
            weights((finer // 2, finer)),
        )
        if before is not None:
            apart = compute_peak_error(before, found.torque)
        before = found.torque
        if apart < least / 40.0:
            break
    if before is None:
        raise refinement.failure or ConvergenceError(f"mechanism '{problem.mechanism.name}': no reference")
    return before, apart


def make_reference_row(model: str, apart: float, least: float) -> dict[str, Any]:
    """Return the row of a reference, which has to be known to a twentieth of the ``least`` error asked [-]."""
    row = {"arm": model, "method": "reference", "error": apart, "verdict": "within"}
    if apart < least / 20.0:
        return row
    return row | {"verdict": "deviation", "message": f"no reference: it is known to {apart:.1g} of the peak only"}


def compute_peak_error(torque: Array, known: Array) -> float:
    """Return the largest error of a torque (samples, drives) [N m], [N] over the peak of each [-]."""
    return float((np.abs(torque - known).max(axis=0) / np.abs(known).max(axis=0)).max())


@dataclass(frozen=True)
class Marches:
    """Marches of one problem on one mesh, held against ``known`` torques (samples, drives) [N m], [N]."""

    problem: Problem
    known: Array
    mechanism: Mechanism | None = None

    def run_first_step(self, finer: int) -> tuple[Mesh, FirstStep]:
        """Return a march at 1/``finer`` of the coarsest step [-], and its samples that are compared [m, rad, s, N]."""
        p = self.problem
        mechanism = self.mechanism or self.problem.mechanism
        whole = bool(mechanism.closures)
        own = replace(p.settings, step=p.grid.compute_longest_step(finer), every=1 if whole else finer // KEPT)
        mesh, made = p.run(mechanism, p.grid.list_steps(finer), p.grid.list_seams(finer), own)
        return mesh, take_every_sample(made, finer // KEPT if whole else 1)

    def compute_plain_torques(self, finer: int) -> Array:
        """Return the torques [N m], [N] of one march."""
        mesh, first = self.run_first_step(finer)
        return np.asarray(run_second_step(mesh, first).tau[:, mesh.mechanism.actuated])

    def compute_extrapolated_torques(self, finer: tuple[int, ...]) -> Array:
        """Return the torques [N m], [N] of some marches, extrapolated."""
        marched = [self.run_first_step(n) for n in finer]
        mesh, _ = marched[-1]
        first = compute_extrapolated_step(mesh.mechanism, [first for _, first in marched], weights(finer))
        return np.asarray(run_second_step(mesh, first).tau[:, mesh.mechanism.actuated])

    def compute_error(self, torque: Array) -> float:
        """Return the error of torques [N m], [N] over their peaks [-]."""
        return compute_peak_error(torque, self.known)

    def find_plain_refinement(self, accuracy: float) -> int | None:
        """Return the refinement at which a march reaches an error [-]."""
        known = 16 * KEPT
        return _find_least_refinement(
            lambda finer: self.compute_error(self.compute_plain_torques(finer)) <= accuracy,
            known * np.sqrt(self.compute_error(self.compute_plain_torques(known)) / accuracy),
        )

    def find_refinements(self, accuracy: float, apart: tuple[tuple[float, ...], ...]) -> tuple[int, ...] | None:
        """Return the refinements of which marches, extrapolated, reach an error [-] by the fewest steps.

        apart : for each choice of marches, how much finer each is than the first
        """
        found = []
        for ratios in apart:

            def scale_refinements(least: int, ratios: tuple[float, ...] = ratios) -> tuple[int, ...]:
                return tuple(_compute_multiple(ratio * least) for ratio in ratios)

            def has_reached_error(least: int, finer: Callable[[int], tuple[int, ...]] = scale_refinements) -> bool:
                try:
                    return (
                        len({*finer(least)}) == len(finer(least))
                        and self.compute_error(self.compute_extrapolated_torques(finer(least))) <= accuracy
                    )
                except ConvergenceError:
                    return False

            least = _find_least_refinement(has_reached_error, 2 * KEPT)
            if least is not None:
                found.append(scale_refinements(least))
        return min(found, key=sum, default=None)


def _compute_multiple(finer: float) -> int:
    return max(KEPT, KEPT * int(np.ceil(finer / KEPT)))


def _find_least_refinement(reaches: Callable[[int], bool], guess: float) -> int | None:
    """The least refinement that reaches something, a multiple of `KEPT` to within `NEAR` [-]; None beyond `MOST`."""
    below = 0
    finer = _compute_multiple(guess)
    while not reaches(finer):
        below = finer
        finer = _compute_multiple(1.25 * finer + 1)
        if finer > MOST:
            return None
    while finer - below > max(KEPT, NEAR * finer):
        middle = _compute_multiple((finer + below) / 2 - KEPT / 2)
        if not below < middle < finer:
            break
        below, finer = (below, middle) if reaches(middle) else (middle, finer)
    return finer


def _list_method_rows(
    arm: AccuracyCase, marches: Marches, motion: Motion, accuracy: float, seconds: float
) -> Iterator[dict[str, Any]]:
    """Yield the rows of one mechanism and error [-]; seconds [s] of timing."""
    mechanism = marches.problem.mechanism

    of_range = accuracy * float((np.abs(marches.known).max(axis=0) / np.ptp(marches.known, axis=0)).min())

    def solve_to_accuracy() -> Solution:
        return solve(mechanism, motion, accuracy=of_range, initial=arm.initial)

    named = {"arm": arm.model, "asked_error": accuracy}
    try:
        answer = solve_to_accuracy()
    except ConvergenceError as refused:
        yield named | {"method": "accuracy=", "verdict": "skipped", "message": str(refused)}
        return
    here = replace(marches, mechanism=answer.mechanism)
    plain = here.find_plain_refinement(accuracy)
    calls = {"accuracy=": Call(solve_to_accuracy)}
    told = {"accuracy=": (0, _compute_sampled_error(here, answer.torque))}
    grid = here.problem.grid.total
    if plain is not None:
        calls["plain"] = Call(lambda: here.compute_plain_torques(plain))
        told["plain"] = (plain * grid, here.compute_error(here.compute_plain_torques(plain)))
    for method, apart in EXTRAPOLATIONS.items():
        if (some := here.find_refinements(accuracy, apart)) is not None:
            calls[method] = Call(partial(here.compute_extrapolated_torques, some))
            told[method] = (sum(some) * grid, here.compute_error(here.compute_extrapolated_torques(some)))
    times = run_calls_in_turns(calls, seconds)
    beams = {(link.beam.elements, link.beam.order) for link in answer.mechanism.links if link.beam}
    mesh = ", ".join(f"{count} x {order}" for count, order in sorted(beams))
    for method in ("plain", *EXTRAPOLATIONS, "accuracy="):
        if method not in times:
            yield named | {"method": method, "verdict": "skipped", "message": f"{accuracy:g} is not reached"}
            continue
        steps, error = told[method]
        row = named | {"method": method, "mesh": mesh, "steps": steps or None, "error": error}
        row |= {"time": times[method].compute_quartiles().median}
        yield add_verdict(row | _compare_with_plain_steps(arm, accuracy, method, times))


def _compare_with_plain_steps(
    arm: AccuracyCase, accuracy: float, method: str, times: dict[str, Times]
) -> dict[str, Any]:
    """The time of plain steps over that of a method, judged where something is asked."""
    if method == "plain" or "plain" not in times:
        return {}
    found = compute_time_ratio(times["plain"], times[method])
    least = arm.target if method == "one extrapolation" and accuracy == min(ERRORS) else None
    name = f"{arm.model}: torque error {accuracy:g} by {method}, times as fast as plain steps"
    one = make_metric(name, found.median, "-", lower=least, spread=f"{found.low:.3g} .. {found.high:.3g}")
    return {"faster": found.median, "asked": least, "metric": one}


def _compute_sampled_error(marches: Marches, torque: Array) -> float:
    """Return the error [-] of torques (samples, drives) [N m], [N] at a multiple or a part of the samples that are compared."""
    there = len(torque) - 1
    here = len(marches.known) - 1
    if there >= here:
        return compute_peak_error(torque[:: there // here], marches.known)
    return compute_peak_error(torque, marches.known[:: here // there])
