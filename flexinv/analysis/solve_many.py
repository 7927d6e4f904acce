"""solve_many: many payloads, stiffnesses, motions or mechanisms with one call, spread over threads.

Scenarios that are alike (beams in a plane, one structure, one time grid, whatever else differs) are integrated many in one
compiled call: what they share is prepared once, their series stand in one piece of memory, short marches run side by side as well
as long ones.  Each other is a `solve` of its own, which holds no lock.  Each result is, bit for bit, that of `solve` alone.
"""

from __future__ import annotations

from _thread import start_new_thread
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from inspect import signature
from itertools import repeat
from queue import SimpleQueue
from threading import Lock
from typing import Any

import numpy as np

from flexinv.analysis.batch_kernel import Designs, Results, Tasks, integrate_scenarios
from flexinv.analysis.evaluation import FirstStep, assemble_solution, build_skeleton, list_array_shapes
from flexinv.analysis.solution import Solution
from flexinv.analysis.solve import solve
from flexinv.analysis.task import Progress, Settings, build_time_grid, check_settings
from flexinv.analysis.trajectory import make_march_error
from flexinv.dynamics.generalized_alpha import (
    EARLY,
    EXACT,
    SUBSTEPS,
    build_start_scheme,
    list_early_rows,
    list_early_times,
)
from flexinv.dynamics.system import Trajectory, has_padding, list_history_shapes
from flexinv.errors import FlexinvError, InputError
from flexinv.inverse.nodal_sums import SecondStepArrays
from flexinv.kernels.memory import begin_shared_memory, make_adjacent_arrays
from flexinv.kernels.records import join_records
from flexinv.kernels.threads.affinity import count_processors, move_to_processor, processor_now, read_thread_limit
from flexinv.kinematics.mesh import Mesh, build
from flexinv.linearized.modal_damping import apply_stated_ratio
from flexinv.model.by_value import ByValue
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion, evaluate_motion
from flexinv.model.owned_cache import make_owner_cache
from flexinv.planar.detection import Plane, find_plane
from flexinv.planar.model import PlanarModel, build_planar_model
from flexinv.planar.solver import PlanarMarch
from flexinv.rigid.prepare import THREADS
from flexinv.typing import Array, Triple
from flexinv.validation import check_callable, check_whole_number, find_nearest_word

Each = Sequence[Mapping[str, Any]] | None
Asked = tuple[Mechanism, Motion, Mapping[str, Any]]  # the last are options of its own
OPTIONS = tuple(signature(solve).parameters)[2:]  # what a scenario may say beside its mechanism and its motion
# Options of `solve` that scenarios that are alike may state; all others keep their defaults.
ALIKE = {"step", "end", "spectral_radius", "tolerance"}
# Numbers in the series of the scenarios that stand in one piece of memory, 64 MiB: it lasts as long as any of them.
RUN = 1 << 23
# Instants that a thread marches before it makes solutions of what it has: some milliseconds, while others march.
INSTANTS_AT_ONCE = 1 << 12


@dataclass(frozen=True, eq=False)
class Batch(ByValue):
    """Results of the scenarios of one `solve_many`, in their order.

    solutions : a Solution for each scenario, None where it failed; errors : number of the scenario -> what stopped it
    """

    solutions: tuple[Solution | None, ...]
    errors: dict[int, Exception]

    def all(self) -> list[Solution]:
        """Return all solutions; raises the first error if there is one."""
        for error in self.errors.values():
            raise error
        return [solution for solution in self.solutions if solution is not None]


def solve_many(
    mechanisms: Mechanism | Sequence[Mechanism], motions: Motion | Sequence[Motion], step: float, each: Each = None,
    threads: int | None = None, progress: Progress | None = None, **options: Any,
) -> Batch:  # fmt: skip
    """Return the solutions of many scenarios: `solve` of every mechanism with every motion that stands beside it.

    mechanisms, motions : one, or a list with one for each scenario; ``step`` and ``options`` are those of `solve`  [s]
    each : for every scenario the options in which it differs, for example {"start": {"swing": 0.1}} or {"step": 1e-4}
    threads : how many work at a time [-], by default one for every processor that the process may use
    progress : called with 1 after every scenario, from any thread but one at a time
    A scenario that fails does not stop the others: its error is kept.  Raises InputError for lists of unequal length.
    """
    scenarios = _list_scenarios(mechanisms, motions, each)
    _check_options(options, "")
    check_callable("progress", progress, "a function that is called with 1 after every scenario")
    count = _resolve_thread_count(threads)
    lock = Lock()
    results = list[Solution | Exception | None](repeat(None, len(scenarios)))
    prepared = prepare_all(scenarios, {"step": step, **options})
    runs = [run for run in match_scenarios(prepared) if len(run) > 1]
    joined = {k for run in runs for k in run}
    ahead = deque(k for k in range(len(scenarios)) if k not in joined)

    def solve_next_tasks() -> None:
        with begin_shared_memory():
            while ahead:
                try:
                    scenario = scenarios[k := ahead.popleft()]
                except IndexError:  # another thread has taken it
                    return
                results[k] = _solve_alone(scenario, {"step": step, **options})
                if progress is not None:
                    with lock:
                        progress(1)

    for run in runs:
        for k, result in zip(run, solve_alike([prepared[k] for k in run], count, progress), strict=True):
            results[k] = result
    if len(joined) < len(scenarios):
        run_in_threads(solve_next_tasks, ahead.clear, min(count, len(scenarios) - len(joined)))
    return _join_results(results)


def run_in_threads(work: Callable[[], None], stop: Callable[[], None], threads: int) -> None:
    """Let so many threads [-] do the same work, this one among them; what stops one stops all, and is raised.

    Threads are started at the lowest level: `Thread.start` waits until the new one has the interpreter, for as long as a short
    scenario takes a quarter of.
    """
    ended = SimpleQueue[BaseException | None]()
    here = processor_now()

    def run_thread(number: int) -> None:
        try:
            if number:
                move_to_processor(number, here)
            work()
        except BaseException as error:
            stop()
            ended.put(error)
        else:
            ended.put(None)

    begun = 1
    try:
        for number in range(1, threads):
            start_new_thread(run_thread, (number,))
            begun += 1
    except RuntimeError:  # no more threads: those that are there have to do
        pass
    run_thread(0)
    try:
        errors = [ended.get() for _ in range(begun)]
    except KeyboardInterrupt:
        stop()
        raise
    for error in errors:
        if error is not None:
            raise error


def _resolve_thread_count(threads: int | None) -> int:
    if threads is None:
        return count_processors()
    return min(check_whole_number("threads", threads, 1, THREADS), read_thread_limit())


def _solve_alone(scenario: Asked, options: Mapping[str, Any]) -> Solution | Exception:
    """The solution of a scenario, or whatever stops it."""
    mechanism, motion, changed = scenario
    try:
        return solve(mechanism, motion, **{**options, **changed})
    except Exception as error:
        return error


def _join_results(results: Sequence[Solution | Exception | None]) -> Batch:
    errors = {k: result for k, result in enumerate(results) if isinstance(result, Exception)}
    return Batch(tuple(result if isinstance(result, Solution) else None for result in results), errors)


def _list_scenarios(
    mechanisms: Mechanism | Sequence[Mechanism], motions: Motion | Sequence[Motion], each: Each
) -> list[Asked]:
    for name, value, kind in (("mechanisms", mechanisms, Mechanism), ("motions", motions, Motion)):
        if isinstance(value, str) or not isinstance(value, (kind, Sequence)):
            expected = f"expected one {kind.__name__} or a list; write list({name})"
            raise InputError(f"solve_many: {name} is a {type(value).__name__}: {expected}")
    _check_each(each)
    given = {"motions": motions, "mechanisms": mechanisms, "each": each}
    lengths = {name: len(value) for name, value in given.items() if isinstance(value, Sequence)}
    if len(set(lengths.values())) > 1:
        found = ", ".join(f"{name} has {count}" for name, count in lengths.items())
        raise InputError(f"solve_many: {found}: expected lists of equal length, one entry for each scenario")
    count = next(iter(lengths.values()), 1)
    columns = (
        repeat(mechanisms, count) if isinstance(mechanisms, Mechanism) else mechanisms,
        repeat(motions, count) if isinstance(motions, Motion) else motions,
        repeat({}, count) if each is None else each,
    )
    return list(zip(*columns, strict=True))


def _check_options(options: Mapping[str, Any], where: str) -> None:
    for name in options:
        if name not in OPTIONS:
            write = f"; write {like!r}" if (like := find_nearest_word(str(name), OPTIONS)) else ""
            expected = f"expected some of {', '.join(OPTIONS)}{write}"
            raise InputError(f"solve_many: {where}{name!r} is no option of solve: {expected}")


@dataclass(frozen=True)
class Scenario:
    """One of them: its mesh, its motion, what its joints do at the samples ``time`` [s] and how it is marched."""

    mesh: Mesh
    motion: Motion
    table: Triple
    time: Array
    settings: Settings


def prepare_all(scenarios: Sequence[Asked], options: Mapping[str, Any]) -> dict[int, Scenario]:
    """Return by their numbers [-] the scenarios that may have others that are alike; `options` are those of all."""
    known = dict[Any, Scenario | None]()
    out = dict[int, Scenario]()
    for k, (mechanism, motion, changed) in enumerate(scenarios):
        key = k if changed else (id(mechanism), id(motion))
        if key not in known:
            known[key] = make_scenario(mechanism, motion, {**options, **changed})
        if (one := known[key]) is not None:
            out[k] = one
    return out


def make_scenario(mechanism: Mechanism, motion: Motion, options: Mapping[str, Any]) -> Scenario | None:
    """Return the scenario [s] if it may have others that are alike, else None: `solve` does it then, or says what is wrong."""
    if not isinstance(mechanism, Mechanism) or not isinstance(motion, Motion) or "step" not in options:
        return None
    try:
        if set(options) - ALIKE or mechanism.is_rigid or mechanism.closures or motion.jumps:
            return None
        if len(motion.joints(mechanism)) < sum(joint.nv > 0 for joint in mechanism.joints):
            return None
        mesh = build(apply_stated_ratio(mechanism))
        time = build_time_grid(motion, options["step"], options.get("end"), 1)
        if not isinstance(find_plane(mesh), Plane) or len(time) * mesh.size * 50 > RUN:
            return None
        settings = check_settings(options["step"], options.get("spectral_radius", 0.8), options.get("tolerance", EXACT))
        moved = evaluate_motion(motion, mechanism, settings.step * np.arange(len(time)))
        return Scenario(mesh, motion, moved, time, settings)
    except FlexinvError:  # `solve` says of this one what it is
        return None


def match_scenarios(scenarios: Mapping[int, Scenario]) -> list[list[int]]:
    """Return the numbers [-] of those that are alike, in runs that stand in one piece of memory."""
    groups = dict[Any, list[int]]()
    runs = list[list[int]]()
    for k, one in scenarios.items():
        groups.setdefault((_make_structure_key(one.mesh), one.settings, len(one.time)), []).append(k)
    for group in groups.values():
        one = scenarios[group[0]]
        most = max(1, RUN // (len(one.time) * one.mesh.size * 50))
        runs += [group[first : first + most] for first in range(0, len(group), most)]
    return runs


@make_owner_cache()
def _make_structure_key(mesh: Mesh) -> tuple[Any, ...]:
    """Return a key (shapes and whole numbers) that two planar meshes share if they differ in their numbers only."""
    m = build_planar_model(mesh, frozenset())
    k = build_skeleton(mesh)
    parts = [np.asarray(part) for record in (m.tree, m.elements, m.space, k, m.place) for part in record]
    parts += [m.masses.single, m.masses.block, m.masses.member, m.joints.prescribed, m.joints.turns_on]
    return tuple((part.shape, b"" if part.dtype == float else part.tobytes()) for part in parts)


@make_owner_cache(most=8)
def _build_designs(first: Mesh, meshes: tuple[Mesh, ...]) -> Designs:
    """The meshes, of which the ``first`` keeps this."""
    models = [build_planar_model(mesh, frozenset()) for mesh in meshes]
    tree, elements, space = (join_records([getattr(m, name) for m in models]) for name in ("tree", "elements", "space"))
    over = np.stack([m.masses.over for m in models])
    return Designs(tree, elements, space, join_records([build_skeleton(mesh) for mesh in meshes]), over)


def _check_each(each: Each) -> None:
    """Raise InputError unless there are options for every scenario, and such that `solve` has."""
    if each is not None and not (isinstance(each, Sequence) and all(isinstance(changed, Mapping) for changed in each)):
        such = '[{"step": 1e-3}, {}]; options of all scenarios are arguments of solve_many'
        expected = f"expected a list with a table of options for every scenario, such as {such}"
        raise InputError(f"solve_many: each is a {type(each).__name__}: {expected}")
    for k, changed in enumerate(each or ()):
        _check_options(changed, f"each[{k}]: ")


def solve_alike(scenarios: Sequence[Scenario], threads: int, progress: Progress | None) -> list[Solution | Exception]:
    """Return the solution of each scenario [m, rad, s, N] or what stopped it, with so many threads [-] at most."""
    first = scenarios[0]
    tasks = _build_tasks(scenarios)
    designs = _build_designs(first.mesh, tuple(dict.fromkeys(one.mesh for one in scenarios)))
    out, found = _make_result_arrays(first, len(scenarios))
    ahead = np.zeros(8, dtype=np.uint64)
    left = np.zeros(len(scenarios))
    lock = Lock()
    ended = np.zeros((len(scenarios), 3), dtype=np.int64)
    results = list[Any](scenarios)
    made = Results(out, found, ended, left)
    most = 1
    if progress is None:
        most = min(max(1, INSTANTS_AT_ONCE // len(first.time)), -(-len(scenarios) // threads))

    def solve_next_scenarios() -> None:
        march = PlanarMarch.take_reusable(first.mesh, ())
        line = np.empty((first.mesh.size, 6))
        mine = np.zeros(most, dtype=np.int64)
        while ahead[0] < len(scenarios):
            done = integrate_scenarios(ahead, mine, designs, tasks, march.system, line, made)
            for n in mine[:done].tolist():
                results[n] = _assemble_scenario(scenarios[n], made, n)
            if done < most and (n := int(mine[done])) < len(scenarios):
                results[n] = _make_scenario_error(scenarios[n], made, n, march)
                march = PlanarMarch.build_for(first.mesh, ())  # what has failed may have left numbers that are none
            elif done == 0:  # others have taken the rest
                break
            if progress is not None:
                with lock:
                    progress(1)
        march.make_reusable(())

    run_in_threads(solve_next_scenarios, lambda: ahead.fill(len(scenarios)), min(threads, len(scenarios)))
    return results


def _assemble_scenario(scenario: Scenario, made: Results, n: int) -> Solution:
    """The solution of the scenario number n, from its part of the series."""
    second = SecondStepArrays(*(part[n] for part in made.second_step))
    q, qd, qdd = (part.copy() for part in scenario.table)
    step = FirstStep(Trajectory._make(part[n] for part in made.histories), scenario.time, (q, qd, qdd))
    return assemble_solution(scenario.mesh, step, scenario.settings, second)


def _make_scenario_error(scenario: Scenario, made: Results, n: int, march: PlanarMarch) -> Exception | None:
    """The error that stopped the scenario number n in a march."""
    status, instant, count = made.ended[n].tolist()
    early = instant < 0  # see `batch_kernel`
    times, parts = (list_early_times(scenario.time[: EARLY + 1]), SUBSTEPS) if early else (scenario.time, 1)
    result = status, -1 - instant if early else instant, count, float(made.left[n])
    marched = (scenario.mesh, ())
    return make_march_error(
        marched, result, times, scenario.settings.step, not early, march.compute_section_turn, parts
    )


def _build_tasks(scenarios: Sequence[Scenario]) -> Tasks:
    first = scenarios[0]
    model = build_planar_model(scenarios[0].mesh, frozenset())
    meshes = {mesh: k for k, mesh in enumerate(dict.fromkeys(one.mesh for one in scenarios))}
    firsts = {id(one.table[0]): one for one in scenarios}
    number = {key: k for k, key in enumerate(firsts)}
    given = np.stack([model.joints.collect_coordinates(*one.table) for one in firsts.values()])
    joint = np.zeros((len(firsts), first.mesh.size, 3))
    instants = np.arange(len(first.time))
    joint[:, model.joints.node] = given[:, 0]
    early = np.zeros((len(firsts), 0, *given.shape[2:]))  # at the parts of the first steps, none if all rest
    if given[:, 0, :, 1:].any() or any(one.mesh.mechanism.gravity.any() for one in scenarios):
        early = _collect_early_coordinates(model, list(firsts.values()))
    return Tasks(
        design=np.array([meshes[one.mesh] for one in scenarios]),
        motion=np.array([number[id(one.table[0])] for one in scenarios]),
        joint=joint, prescribed_motion=given, qd=np.stack([one.table[1] for one in firsts.values()]),
        early=early, early_row=list_early_rows(instants[1 : EARLY + 1]),
        row=instants, time=first.time, none=np.empty((0, 0, 0)), never=np.empty(0),
        scheme=first.settings.scheme, first_scheme=build_start_scheme(first.settings.scheme),
    )  # fmt: skip


def _collect_early_coordinates(model: PlanarModel, scenarios: Sequence[Scenario]) -> Array:
    """The motion of the joints at the parts of the first steps, of one scenario for each motion."""
    ends = list_early_times(scenarios[0].time[: EARLY + 1])
    tables = [one.motion.evaluate(one.mesh.mechanism, ends, "left") for one in scenarios]
    return np.stack([model.joints.collect_coordinates(*table) for table in tables])


def _make_result_arrays(first: Scenario, scenarios: int) -> tuple[Trajectory, SecondStepArrays]:
    """Series of all scenarios, one after the other in memory."""
    mesh = first.mesh
    samples = len(first.time)
    shapes = [*list_history_shapes(mesh, samples), (samples, 3), *list_array_shapes(mesh, samples)]
    stacks = [(scenarios, *shape) for shape in shapes]
    large = len(shapes) - len(SecondStepArrays._fields) + 2  # of the second step two are of all nodes
    *motion, wrench, internal, energy = (adjacent_arrays := make_adjacent_arrays(*stacks[:large]))[:9]
    if has_padding(mesh):
        internal[:] = 0.0
    none = np.empty((scenarios, samples, 0))
    iterations = np.zeros((scenarios, samples), dtype=np.int64)
    second_step_arrays = SecondStepArrays(
        *adjacent_arrays[9:], *(np.empty(shape) for shape in stacks[large:])
    )  # see `evaluation.second_step`
    return Trajectory._make([*motion, wrench, internal, energy, none, iterations]), second_step_arrays
