"""Refinement of steps and mesh until error bars are as small as was asked; never finer than that.

Steps are 1/n of the coarsest, n on a ladder whose rungs share samples.  Of three rungs a < b < c come two extrapolated answers,
P0 of a, b and P of b, c, of order p in the step (4 where the expansion in even powers holds).  Their errors fall by
r = (c/a)^(p/2), so that

    |P - P0| >= (r - 1) |error of P|,      bar = |P - P0| max(1, 3/2 / (r - 1))

with the p that two triples of rungs show, p = 2 where there is one: with c = 2 a the bar is three times the error at order 4, 1.5
times at order 2, never less.  Where P does not converge (jumps inside a step: friction that sticks) but the plain answers do, the
plain one is returned with the bar of a first-order sequence, |T_c - T_a|.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from flexinv.analysis.evaluation import FirstStep, add_joint_efforts, run_second_step
from flexinv.analysis.extrapolation import compute_weighted_sum, take_every_sample, weights
from flexinv.analysis.nearby import find_largest_nearby
from flexinv.analysis.task import Settings
from flexinv.errors import ConvergenceError, TooFewElements
from flexinv.kinematics.mesh import Mesh
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.model.owned_cache import make_owner_cache
from flexinv.typing import Array

SHARE_OF_STEPS = 0.7  # part of what is asked that errors of steps may take; the mesh gets what is left
# An expansion below the first order is none; the second is taken for granted where nothing shows one.
LEAST_ORDER = 0.5
ASSUMED_ORDER = 2.0
MARGIN = 1.5  # what an order seen on so few rungs may be off by, as a factor on the bar
# A jump of more rungs goes by an order that so few steps cannot show; before so many triples nothing is given up.
MOST_RUNGS = 4
TRIPLES_SEEN = 3
# An accuracy that is asked: below this part of the range rounding of accelerations is met; above a tenth nothing is asked.
FINEST = 1e-9
COARSEST = 0.1
# More steps times nodes than this in one run are a wish that no step meets: an undamped vibration that never ends.
MOST_NODE_STEPS = 2_000_000
# Meshes of beams, (times the elements of the mechanism, order), each better than that before; meshed links have twice the modes.
MESHES = ((1, 4), (1, 6), (1, 8), (1, 10), (2, 8), (2, 10), (4, 8), (4, 10))
# A bar is the largest difference within this part of the run: steps as long as half an oscillation leave an error that is largest
# elsewhere than the difference that shows it.
AROUND = 0.05
# A difference to the next mesh is nearly the whole error of a mesh, as errors fall by several times from one to the next.
OF_MESH = 1.5
# A range below this part of the largest of its unit (of the mechanism's length, of a radian) is taken to be that part: nobody
# asks for digits of what hardly moves.
SMALLEST_RANGE = 1e-3


class Quantities(NamedTuple):
    """Quantities of which an accuracy is asked, or their ranges over time without the samples.

    torque : (samples, drives) efforts [N m], [N]; tip : (samples, links, 3) [m], of ranges (links,)
    free : (samples, n) coordinates of joints without a motion [rad], [m], [-]
    """

    torque: Array
    tip: Array
    free: Array

    def take_samples(self, every: int) -> Quantities:
        """Return every ``every``-th sample [-]."""
        return Quantities(*(part[::every] for part in self))

    def compute_errors(self, one: Quantities, other: Quantities) -> Array:
        """Return differences (samples, quantities) in parts of these ranges [-]: efforts, tips, free coordinates side by side."""
        tip = np.linalg.norm(one.tip - other.tip, axis=2)
        torque = np.abs(one.torque - other.torque)
        free = np.abs(one.free - other.free)
        return np.hstack([torque / self.torque, tip / self.tip, free / self.free])

    def compute_largest_errors(self, one: Quantities, other: Quantities) -> Array:
        """Return the largest `errors` near each sample (samples, quantities) in parts of these ranges [-]."""
        return find_largest_nearby(self.compute_errors(one, other), AROUND)


def collect_quantities(mesh: Mesh, first: FirstStep) -> Quantities:
    """Return the results of the second step [N m], [N], [m] and the coordinates of the passive joints [rad], [m], [-]."""
    m = mesh.mechanism
    found = run_second_step(mesh, first)
    tau = add_joint_efforts(m, first, found.tau, found.reaction)[0]
    free = [j.name in first.smooth for j in m.joints for _ in range(j.nq)]
    return Quantities(tau[:, m.actuated], np.swapaxes(found.tip, 0, 1), first.joints[0][:, np.array(free, dtype=bool)])


def ranges(mesh: Mesh, known: Quantities) -> Quantities:
    """Return the ranges of quantities over time [N m], [N], [m], [rad], none below `SMALLEST_RANGE`."""
    m = mesh.mechanism
    tiny = np.finfo(float).tiny
    force = np.array([f for joint in m.joints for f in KINDS[joint.kind].translations], dtype=bool)[m.actuated]
    torque = np.ptp(known.torque, axis=0)
    peak = np.abs(known.torque).max(axis=0)
    for group in (force, ~force):
        torque[group] = np.maximum(torque[group], SMALLEST_RANGE * peak[group].max(initial=0.0))
    tip = np.maximum(np.linalg.norm(np.ptp(known.tip, axis=0), axis=1), SMALLEST_RANGE * mesh.length)
    free = np.maximum(np.ptp(known.free, axis=0), SMALLEST_RANGE)
    return Quantities(np.maximum(torque, tiny), np.maximum(tip, tiny), free)


@dataclass(frozen=True)
class StepGrid:
    """Stretches of equal steps, ends : (stretches + 1,) [s], where they begin and end; counts : coarsest steps of each [-]."""

    ends: Array
    counts: tuple[int, ...]

    @property
    def total(self) -> int:
        """Return the number of coarsest steps [-]."""
        return sum(self.counts)

    def list_steps(self, finer: int) -> Array:
        """Return all instants [s] where ``finer`` steps [-] make a coarsest one."""
        stretches = zip(self.ends[:-1], np.diff(self.ends), finer * np.array(self.counts), strict=True)
        parts = [first + length * (np.arange(n) / n) for first, length, n in stretches]
        return np.concatenate([*parts, self.ends[-1:]])

    def list_seams(self, finer: int) -> tuple[int, ...]:
        """Return the samples [-] of `steps` at which one stretch ends and the next begins."""
        return tuple(int(k) for k in finer * np.cumsum(self.counts)[:-1])

    def compute_longest_step(self, finer: int) -> float:
        """Return the longest step [s] of `steps`."""
        return float((np.diff(self.ends) / np.array(self.counts)).max()) / finer


@dataclass(frozen=True)
class Problem:
    """A task that can be solved at any steps and on any mesh.

    run : mechanism, instants [s], samples at which steps change, settings -> mesh, first step at the instants that are kept
    accuracy : asked, part of ranges [-]; jumps : of its accelerations [s]; marched : integrated in time, else exact everywhere
    """

    mechanism: Mechanism
    grid: StepGrid
    run: Callable[[Mechanism, Array, tuple[int, ...], Settings], tuple[Mesh, FirstStep]]
    settings: Settings
    accuracy: float
    jumps: tuple[float, ...] = ()
    marched: bool = True


@dataclass(frozen=True)
class Level:
    """A run at 1/``finer`` of the coarsest step [-], its first step, its quantities, ``samples_per_step`` to a coarsest step."""

    finer: int
    samples_per_step: int
    mesh: Mesh
    settings: Settings
    first: FirstStep
    quantities: Quantities


@dataclass(frozen=True)
class Answer:
    """Answer of a refinement: levels to combine, their weights [-], and bars (samples, quantities) in parts of the ranges [-].

    samples_per_step : samples to a coarsest step; apart : largest difference of two answers of three rungs;
    order : that they show [-]
    longest : of the three rungs, 1/``longest`` of the coarsest step [-]
    """

    levels: tuple[Level, ...]
    weight: Array
    samples_per_step: int
    bars: Array
    ranges: Quantities
    apart: float
    order: float
    longest: int

    @property
    def bar(self) -> float:
        """Return the largest bar [-]."""
        return float(self.bars.max())


def compute_refinement(index: int) -> int:
    """Return the ladder of refinements: 1, 2, 3, 4, 6, 8, 12, 16, 24 ... [-]."""
    return 1 if index == 0 else (2 if index % 2 else 3) * 2 ** ((index - 1) // 2)


@make_owner_cache()
def apply_mesh(mechanism: Mechanism, mesh: int) -> Mechanism:
    """Return the mechanism with a mesh of `MESHES` [-] on its beams, the same one for all steps; of order 1 only one element."""
    times, order = MESHES[mesh]
    links = list(mechanism.links)
    for k, link in enumerate(links):
        if link.beam is not None:
            count = 1 if link.beam.order == 1 else link.beam.elements  # elements of order 1 are many
            links[k] = replace(link, beam=replace(link.beam, elements=times * count, order=order))
    finer = replace(mechanism, links=tuple(links)) if mechanism.beams else mechanism
    return finer.add_modes(2**mesh) if mesh else finer


@dataclass
class Refinement:
    """Runs of one problem that are already made, by mesh and refinement; None where Newton failed at so long steps.

    failure : of Newton, the last; answer_gaps : refinements [-] and how far answers were apart [-]
    """

    problem: Problem
    levels: dict[tuple[int, int], Level | None] = field(default_factory=dict)
    failure: ConvergenceError | None = None
    answer_gaps: list[tuple[int, float]] = field(default_factory=list)

    @property
    def order(self) -> float:
        """Return the order in the step that all answers seen so far show [-]."""
        (first, wide), (last, narrow) = (
            (self.answer_gaps[0], self.answer_gaps[-1]) if len(self.answer_gaps) > 1 else ((1, 1.0), (2, 0.25))
        )
        return float(np.log(wide / narrow) / np.log(last / first)) if narrow > 0.0 and last > first else ASSUMED_ORDER

    def run_level(self, mesh: int, finer: int) -> Level | None:
        """Return a run [m, rad, s, N], made where it is not yet."""
        if (mesh, finer) in self.levels:
            return self.levels[mesh, finer]
        p = self.problem
        grid = self.problem.grid
        mechanism = apply_mesh(self.problem.mechanism, mesh)
        kept = max(1, 2 ** int(np.log2(finer)) // 2)
        whole = bool(mechanism.closures) and not mechanism.is_rigid  # of which every step is kept
        settings = replace(p.settings, step=grid.compute_longest_step(finer), every=1 if whole else finer // kept)
        try:
            made, first = p.run(mechanism, grid.list_steps(finer), grid.list_seams(finer), settings)
        except ConvergenceError as error:
            self.failure = error
            self.levels[mesh, finer] = None
            return None
        first = take_every_sample(first, (len(first.time) - 1) // (kept * grid.total))
        self.levels[mesh, finer] = result = Level(finer, kept, made, settings, first, collect_quantities(made, first))
        return result

    def run_three_levels(self, mesh: int, index: int) -> tuple[Level, Level, Level] | None:
        """Return the runs of three rungs from ``index`` [-] on, None where one of them failed."""
        a, b, c = (self.run_level(mesh, compute_refinement(index + k)) for k in range(3))
        return None if a is None or b is None or c is None else (a, b, c)


def find_cheapest_answer(refinement: Refinement) -> Answer:
    """Return the cheapest answer whose bars are within the accuracy asked [-].

    Raises ConvergenceError where steps or meshes that can be paid for do not reach it, with what to change.
    """
    answer: Answer | None = None
    mesh, index = _find_coarsest_mesh(refinement)
    while True:
        answer, index = _find_fine_steps(refinement, mesh, index, answer)
        if refinement.problem.mechanism.is_rigid:
            return answer
        # At the longest steps of the three rungs: what meshes differ by hardly depends on the step, or falls with it; only where
        # something jumps undamped it grows, 1 to 2 times from these steps to the shortest.
        whole = replace(answer, bars=answer.bars + OF_MESH * _compute_mesh_errors(refinement, mesh, answer.longest))
        if whole.bar <= refinement.problem.accuracy:
            return whole
        mesh += 1
        if mesh + 1 >= len(MESHES):
            raise make_accuracy_error(refinement, whole)


def _find_coarsest_mesh(refinement: Refinement) -> tuple[int, int]:
    """The coarsest mesh whose error, as the coarsest steps that converge show it, leaves enough to the steps; and their rung."""
    last = 0 if refinement.problem.mechanism.is_rigid else len(MESHES) - 2
    mesh = index = 0
    while refinement.run_level(mesh, compute_refinement(index + 2)) is None:
        if not isinstance(refinement.failure, TooFewElements):
            index += 1
            _check_budget(refinement, index, None)
        elif mesh == last:
            raise refinement.failure
        else:
            mesh += 1
    finer = compute_refinement(index + 2)
    asked = (1.0 - SHARE_OF_STEPS) * refinement.problem.accuracy
    while mesh < last and _compute_mesh_errors(refinement, mesh, finer).max() > asked:
        mesh += 1
    return mesh, index


def _find_fine_steps(refinement: Refinement, mesh: int, index: int, before: Answer | None) -> tuple[Answer, int]:
    """The first answer on one mesh whose bar of the steps is small enough, from a rung on; and its rung."""
    asked = SHARE_OF_STEPS * refinement.problem.accuracy
    while True:
        if (three := refinement.run_three_levels(mesh, index)) is None:
            index += 1
            _check_budget(refinement, index, before)
            continue
        answer = make_extrapolated_answer(three, before)
        for one in (answer, make_plain_answer(three)):
            if one.bar <= asked:
                return one, index
        # so many rungs, of which two halve the step, that the order of the answer leads to the bar asked
        order = 4.0 if before is None else max(answer.order, ASSUMED_ORDER)
        index += int(np.clip(np.floor(2.0 * np.log2(answer.bar / asked) / order), 1, MOST_RUNGS))
        _check_budget(refinement, index, answer)
        before = answer
        refinement.answer_gaps.append((answer.levels[0].finer, answer.apart))


def make_extrapolated_answer(three: tuple[Level, Level, Level], before: Answer | None) -> Answer:
    """Return the answer of the two finer of three runs [-], with the order seen since the answer ``before``."""
    a, b, c = three
    found = [level.quantities.take_samples(level.samples_per_step // a.samples_per_step) for level in three]
    coarse = mixed(found[:2], weights((a.finer, b.finer)))
    fine = mixed(found[1:], weights((b.finer, c.finer)))
    bars = (scale := ranges(c.mesh, found[2])).compute_largest_errors(fine, coarse)
    apart = float(bars.max())
    order = ASSUMED_ORDER if before is None else before.order
    if before is not None and before.levels[0].finer < b.finer and min(apart, before.apart) > 0.0:
        order = float(np.log(before.apart / apart) / np.log(b.finer / before.levels[0].finer))
    contraction = (c.finer / a.finer) ** (max(order, LEAST_ORDER) / 2)
    bars = bars * max(1.0, MARGIN / (contraction - 1.0))
    return Answer((b, c), weights((b.finer, c.finer)), a.samples_per_step, bars, scale, apart, order, a.finer)


def make_plain_answer(three: tuple[Level, Level, Level]) -> Answer:
    """Return the finest of three runs as it is, its bar [-] that of first order, infinite where they do not converge."""
    a, _, c = three
    found = [level.quantities.take_samples(level.samples_per_step // three[0].samples_per_step) for level in three]
    scale = ranges(c.mesh, found[2])
    first, second, both = (scale.compute_largest_errors(found[k], found[j]) for k, j in ((1, 0), (2, 1), (2, 0)))
    bars = both if second.max() < first.max() else np.full_like(both, np.inf)
    return Answer((c,), np.ones(1), a.samples_per_step, bars, scale, float(both.max()), 1.0, a.finer)


def mixed(found: Sequence[Quantities], weight: Array) -> Quantities:
    """Return the weighted sum of quantities [N m], [N], [m], [rad]."""
    return Quantities(*(compute_weighted_sum(parts, weight) for parts in zip(*found, strict=True)))


def _compute_mesh_errors(refinement: Refinement, mesh: int, finer: int) -> Array:
    """Differences (samples, quantities) of a mesh to the next one at 1/``finer`` of the coarsest step, infinite if one fails."""
    here = refinement.run_level(mesh, finer)
    there = refinement.run_level(mesh + 1, finer)
    if here is None or there is None:
        return np.array([[np.inf]])
    return ranges(there.mesh, there.quantities).compute_largest_errors(there.quantities, here.quantities)


def _check_budget(refinement: Refinement, index: int, answer: Answer | None) -> None:
    """Raise an error where the rungs from ``index`` [-] on take too many steps, or will before the answer is good enough."""
    nodes = 1 if answer is None else answer.levels[-1].mesh.size
    most = MOST_NODE_STEPS / (nodes * refinement.problem.grid.total)
    if compute_refinement(index + 2) > most:
        raise make_accuracy_error(refinement, answer)
    if answer is None or len(refinement.answer_gaps) < TRIPLES_SEEN:
        return
    more = answer.bar / refinement.problem.accuracy
    if answer.levels[-1].finer * more ** (1.0 / max(refinement.order, LEAST_ORDER)) > most:
        raise make_accuracy_error(refinement, answer)


def make_accuracy_error(refinement: Refinement, answer: Answer | None) -> ConvergenceError:
    """Return the error of an accuracy that is not reached: how far it goes, why, and what to write instead [-], [s]."""
    p = refinement.problem
    if answer is None:
        return refinement.failure or ConvergenceError(f"mechanism '{p.mechanism.name}': no step leads to a motion")
    shortest = p.grid.compute_longest_step(answer.levels[-1].finer)
    reached = answer.bar if np.isfinite(answer.bar) else answer.apart
    size = 10.0 ** np.floor(np.log10(reached))
    possible = np.ceil(reached / size) * size
    larger = f", or accuracy = {possible:g}" if possible <= COARSEST else ""
    return ConvergenceError(
        f"mechanism '{p.mechanism.name}': accuracy = {p.accuracy:g} is out of reach: at steps of {shortest:.3g} s errors are "
        f"{reached:.2g} of the range and fall with the power {max(refinement.order, 0.0):.1f} of the step, as of vibrations "
        "that something sudden excites and nothing damps; write damping (retardation_s of a section, or a ratio in [damping]) or "
        f"a smoother law such as 'nonic'{larger}"
    )
