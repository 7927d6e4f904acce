"""Scenarios of `solve_many` that are alike: beams in a plane, one structure, one time grid, whatever else differs.

What they share is prepared once, their series stand in one piece of memory, and a thread marches many of them in one compiled
call: short marches run side by side as well as long ones.  Each gives, bit for bit, what `solve` gives alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from threading import Lock
from typing import Any

import numpy as np

from flexinv.analysis.batch_kernel import Designs, Results, Schemes, Tasks, march_alike
from flexinv.analysis.evaluation import FirstStep, found_shapes, skeleton, solution_of
from flexinv.analysis.settings import Settings, checked
from flexinv.analysis.solution import Solution
from flexinv.analysis.task import Progress, time_grid
from flexinv.analysis.trajectory import Turned, failure
from flexinv.dynamics.generalized_alpha import EARLY, EXACT, SUBSTEPS, Scheme, early_rows, early_times, start_up
from flexinv.dynamics.solver import Trajectory, has_padding, history_shapes
from flexinv.dynamics.system import Histories
from flexinv.errors import FlexinvError
from flexinv.inverse.trajectory_pass import Found
from flexinv.kernels.memory import together
from flexinv.kernels.records import stacked
from flexinv.kinematics.mesh import Mesh, build
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion, motion_table
from flexinv.model.owned_cache import kept_with_owner
from flexinv.planar.detection import Plane, find_plane
from flexinv.planar.model import planar_model
from flexinv.planar.solver import PlanarMarch
from flexinv.typing import Array, Triple

# Options of `solve` that such scenarios may state; all others keep their defaults.
OPTIONS = {"step", "end", "spectral_radius", "tolerance"}
# Numbers in the series of the scenarios that stand in one piece of memory, 64 MiB: it lasts as long as any of them.
RUN = 1 << 23
# Instants that a thread marches before it makes solutions of what it has: some milliseconds, while others march.
AT_ONCE = 1 << 12
SideBySide = Callable[[Callable[[], None], Callable[[], None], int], None]


@dataclass(frozen=True)
class Scenario:
    """One of them: its mesh, its motion, what its joints do at the samples ``time`` [s] and how it is marched."""

    mesh: Mesh
    motion: Motion
    table: Triple
    time: Array
    scheme: Scheme
    settings: Settings


def prepare_all(
    scenarios: Sequence[tuple[Mechanism, Motion, Mapping[str, Any]]], options: Mapping[str, Any]
) -> dict[int, Scenario]:
    """Return by their numbers [-] the scenarios that may have others that are alike; `options` are those of all."""
    known: dict[tuple[Mechanism, Motion], Scenario | None] = {}
    out = {}
    for k, (mechanism, motion, own) in enumerate(scenarios):
        pair = mechanism, motion
        if own or pair not in known:
            one = scenario_of(mechanism, motion, {**options, **own})
            known |= {} if own else {pair: one}
        else:
            one = known[pair]
        if one is not None:
            out[k] = one
    return out


def scenario_of(mechanism: Mechanism, motion: Motion, options: Mapping[str, Any]) -> Scenario | None:
    """Return the scenario [s] if it may have others that are alike, else None: `solve` does it then, or says what is wrong."""
    if not isinstance(mechanism, Mechanism) or not isinstance(motion, Motion) or "step" not in options:
        return None
    try:
        if set(options) - OPTIONS or mechanism.is_rigid or mechanism.closures or motion.jumps:
            return None
        given = options["step"], options.get("tolerance", EXACT), options.get("spectral_radius", 0.8)
        if not all(isinstance(number, Real) and not isinstance(number, bool) for number in given):
            return None
        step, tolerance, radius = (float(number) for number in given)
        if len(motion.joints(mechanism)) < sum(joint.nv > 0 for joint in mechanism.joints):
            return None
        mesh, time = build(mechanism), time_grid(motion, step, options.get("end"), 1)
        if not isinstance(find_plane(mesh), Plane) or len(time) * mesh.size * 50 > RUN:
            return None
        settings = checked(step, radius, tolerance)
        return Scenario(mesh, motion, motion_table(motion, mechanism, step, len(time)), time, settings.scheme, settings)
    except FlexinvError:  # `solve` says of this one what it is
        return None


def alike(scenarios: Mapping[int, Scenario]) -> list[list[int]]:
    """Return the numbers [-] of those that are alike, in runs that stand in one piece of memory."""
    groups: dict[Any, list[int]] = {}
    for k, one in scenarios.items():
        groups.setdefault((_structure(one.mesh), one.scheme, len(one.time)), []).append(k)
    runs = []
    for group in groups.values():
        one = scenarios[group[0]]
        most = max(1, RUN // (len(one.time) * one.mesh.size * 50))
        runs += [group[first : first + most] for first in range(0, len(group), most)]
    return runs


@kept_with_owner()
def _structure(mesh: Mesh) -> tuple[Any, ...]:
    """Return a key (shapes and whole numbers) that two planar meshes share if they differ in their numbers only."""
    m, k = planar_model(mesh, frozenset()), skeleton(mesh)
    parts = [np.asarray(part) for record in (m.tree, m.elements, m.space, k, m.place) for part in record]
    parts += [m.constraints.single, m.constraints.block, m.constraints.member, m.joints.given, m.joints.turns_on]
    return tuple((part.shape, b"" if part.dtype == float else part.tobytes()) for part in parts)


@kept_with_owner(most=8)
def _designs(first: Mesh, meshes: tuple[Mesh, ...]) -> Designs:
    """The meshes, of which the ``first`` keeps this."""
    models = [planar_model(mesh, frozenset()) for mesh in meshes]
    tree, elements, space = (stacked([getattr(m, name) for m in models]) for name in ("tree", "elements", "space"))
    over = np.stack([m.constraints.over for m in models])
    return Designs(tree, elements, space, stacked([skeleton(mesh) for mesh in meshes]), over)


def solve_alike(
    scenarios: Sequence[Scenario], threads: int, side_by_side: SideBySide, progress: Progress | None
) -> list[Solution | Exception]:
    """Return the solution of each scenario [m, rad, s, N] or what stopped it, with so many threads [-] at most."""
    first = scenarios[0]
    designs = _designs(first.mesh, tuple(dict.fromkeys(one.mesh for one in scenarios)))
    tasks = _tasks(scenarios)
    out, found = _room(first, len(scenarios))
    ahead, left, lock = np.zeros(8, dtype=np.uint64), np.zeros(len(scenarios)), Lock()
    schemes = Schemes(first.scheme, start_up(first.scheme))
    ended, results = np.zeros((len(scenarios), 3), dtype=np.int64), list[Any](scenarios)
    whole = Results(out, found, ended, left)
    most = 1 if progress is not None else min(max(1, AT_ONCE // len(first.time)), -(-len(scenarios) // threads))

    def work() -> None:
        own, line = PlanarMarch.ready(first.mesh, ()), np.empty((first.mesh.size, 6))
        mine = np.zeros(most, dtype=np.int64)
        while ahead[0] < len(scenarios):
            done = march_alike(ahead, mine, designs, tasks, schemes, own.system, line, whole)
            for n in mine[:done].tolist():
                results[n] = _solution(scenarios[n], n, out, found)
            if done < most and (n := int(mine[done])) < len(scenarios):
                results[n] = _failure(scenarios[n], ended[n].tolist(), float(left[n]), own.turned)
                own = PlanarMarch.of(first.mesh, ())  # what has failed may have left numbers that are none
            elif done == 0:  # others have taken the rest
                break
            if progress is not None:
                with lock:
                    progress(1)
        own.leave(())

    side_by_side(work, lambda: ahead.fill(len(scenarios)), min(threads, len(scenarios)))
    return results


def _failure(one: Scenario, ended: list[int], left: float, turned: Turned) -> Exception | None:
    (status, instant, count), step = ended, one.scheme.h
    if instant < 0:  # see `batch_kernel`
        times, result = early_times(one.time[: EARLY + 1]), (status, -1 - instant, count, left)
        return failure(one.mesh, result, times, step, begins=False, turned=turned, parts=SUBSTEPS)
    return failure(one.mesh, (status, instant, count, left), one.time, step, turned=turned)


def _tasks(scenarios: Sequence[Scenario]) -> Tasks:
    first, model = scenarios[0], planar_model(scenarios[0].mesh, frozenset())
    meshes = {mesh: k for k, mesh in enumerate(dict.fromkeys(one.mesh for one in scenarios))}
    firsts = {id(one.table[0]): one for one in scenarios}
    number = {key: k for k, key in enumerate(firsts)}
    given = np.stack([model.joints.coordinates(*one.table) for one in firsts.values()])
    joint = np.zeros((len(firsts), first.mesh.size, 3))
    joint[:, model.joints.node] = given[:, 0]
    instants = np.arange(len(first.time))
    return Tasks(
        design=np.array([meshes[one.mesh] for one in scenarios]),
        motion=np.array([number[id(one.table[0])] for one in scenarios]),
        joint=joint, given=given, qd=np.stack([one.table[1] for one in firsts.values()]),
        early=_early(scenarios, list(firsts.values()), given), early_row=early_rows(instants[1 : EARLY + 1]),
        row=instants, time=first.time, none=np.empty((0, 0, 0)), never=np.empty(0),
    )  # fmt: skip


def _early(scenarios: Sequence[Scenario], firsts: list[Scenario], given: Array) -> Array:
    """Return joint coordinates at the parts of the first steps, (motions, parts, joints, 3), no parts if all rest."""
    model, time = planar_model(scenarios[0].mesh, frozenset()), early_times(scenarios[0].time[: EARLY + 1])
    if not given[:, 0, :, 1:].any() and not any(one.mesh.mechanism.gravity.any() for one in scenarios):
        return np.zeros((len(firsts), 0, *given.shape[2:]))
    tables = [one.motion.evaluate(one.mesh.mechanism, time, "left") for one in firsts]
    return np.stack([model.joints.coordinates(*table) for table in tables])


def _room(first: Scenario, scenarios: int) -> tuple[Histories, Found]:
    """Series of all scenarios, one after the other in memory."""
    mesh, samples = first.mesh, len(first.time)
    shapes = [*history_shapes(mesh, samples), (samples, 3), *found_shapes(mesh, samples)]
    whole, large = [(scenarios, *shape) for shape in shapes], len(shapes) - len(Found._fields) + 2  # two of nodes
    x, r, v, w, a, al, wrench, internal, energy, *forces = together(*whole[:large])
    if has_padding(mesh):
        internal[:] = 0.0
    none, iterations = np.empty((scenarios, samples, 0)), np.zeros((scenarios, samples), dtype=np.int64)
    found = Found(*forces, *(np.empty(shape) for shape in whole[large:]))  # see `evaluation.second_step`
    return Histories(x, r, v, w, a, al, wrench, internal, energy, none, iterations), found


def _solution(one: Scenario, n: int, out: Histories, found: Found) -> Solution:
    x, r, v, w, a, al, wrench, internal, energy, multipliers, iterations = (part[n] for part in out)
    trajectory = Trajectory(NodalMotion(x, r, v, w, a, al), wrench, internal, energy, multipliers, iterations)
    q, qd, qdd = (part.copy() for part in one.table)
    own = Found(*(part[n] for part in found))
    return solution_of(one.mesh, FirstStep(trajectory, one.time, (q, qd, qdd)), own, one.settings)
