"""Export of an Exudyn run: a Python script that builds the same system item by item and reads its efforts.

The tree of rigid bodies is written as arrays of ``KinematicTree66``; models in time are recorded while they run
(`script`).  There the effort along a joint is one component of one reaction (see the heads of `exudyn.planar`,
`exudyn.spatial`): the moment or force along the connector's x axis, or the force of the coordinate connector.

In rigid loops these stand on the joints that the motion gives; ``shares.npz`` takes them, and what joints take themselves,
to the drives: our own numbers, from the Jacobian of the closures (`exudyn.chain.shared`).
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from crosscheck.arrays import write_arrays
from crosscheck.engines.base import sample_times
from crosscheck.engines.exudyn import adapter
from crosscheck.engines.exudyn import integration as exudyn_solve
from crosscheck.engines.exudyn import loops as exudyn_loops
from crosscheck.engines.exudyn import phases as exudyn_phases
from crosscheck.engines.exudyn import rigid as exudyn_rigid
from crosscheck.engines.exudyn.integration import Plan, compute_step_times
from crosscheck.engines.exudyn.lead_in import build_history
from crosscheck.engines.exudyn.models import chain as exudyn_chain
from crosscheck.engines.exudyn.models.frames import compose
from crosscheck.engines.exudyn.models.layout import Layout
from crosscheck.engines.exudyn.run_in_time import TREE, build_start_layout, choose
from crosscheck.engines.exudyn.script import RecordedSolve, collect_runs, write_model_code
from crosscheck.engines.shared.export_files import (
    Array,
    JointNumbers,
    JointSpring,
    Motion,
    NotExported,
    check_rigid,
    write,
)
from crosscheck.engines.shared.prescribed import describe_nontree_parts
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism, Placement

HEAD = '''"""The model, item by item, and the solver's settings."""

from __future__ import annotations

import exudyn as exu
import numpy as np
from exudyn.itemInterface import *  # noqa: F403


def section(massPerLength, inertia, stiffnessMatrix, dampingMatrix):
    made = exu.BeamSection()
    made.massPerLength, made.inertia = massPerLength, np.array(inertia)
    made.stiffnessMatrix, made.dampingMatrix = np.array(stiffnessMatrix), np.array(dampingMatrix)
    return made


def gas(rest, force, travel, exponent):
    """Return the pull of a gas spring: force / (1 - (l - rest) / travel)^exponent, and its damping."""

    def pull(mbs, t, item, longer, rate, stiffness, damping, offset):
        return force * (1 - longer / travel) ** -exponent + damping * rate

    return pull


def pieces(rest, rows):
    """Return the pull of a table: rows of a start and the coefficients of falling powers of l - start, and its damping."""

    def pull(mbs, t, item, longer, rate, stiffness, damping, offset):
        start, *powers = ([rows[0]] + [row for row in rows[1:] if rest + longer >= row[0]])[-1]
        return float(np.polyval(powers, rest + longer - start)) + damping * rate

    return pull
'''
PLAIN = {"error": False}  # the runs that the result itself needs
COORDINATES = ("revolute", "continuous", "prismatic")


def export(mechanism: Mechanism, case: Case, engine: str, effort: Array, folder: Path) -> None:
    """Write model and script; effort : (samples, nv) [N m] or [N] expected, in mechanism order.

    Raises NotExported in time for drives on joints of several coordinates.
    """
    if engine == TREE:
        check_rigid(mechanism, engine)
    if mechanism.meshed:
        raise NotExported("links that are meshes are not exported yet")
    if (reason := adapter.unsupported(mechanism, case, engine)) is not None:
        raise NotExported(reason)
    if mechanism.beams and exudyn_phases.has_switched_closures(mechanism):
        raise NotExported(
            "beams with closures that act for a while: every phase begins with the state of the one before"
        )
    time = sample_times(case)
    motion = Motion(
        time, *_evaluate_state(mechanism, case, time), effort, mechanism.coordinate_names, mechanism.velocity_names
    )
    if engine == TREE:
        _write_tree(mechanism, motion, folder)
    else:
        _write_time_model(mechanism, case, engine, motion, folder)


def _evaluate_state(mechanism: Mechanism, case: Case, time: Array) -> tuple[Array, Array, Array]:
    """Return q (samples, nq), qd, qdd (samples, nv) [rad], [m], ... of all joints, those that rigid loops move, too."""
    if exudyn_phases.has_switched_closures(mechanism):
        parts = [state for _, state in exudyn_phases.solve_phases(mechanism, case)]
        q, qd, qdd = (np.concatenate([part[k] for part in parts]) for k in range(3))
        return q, qd, qdd
    if mechanism.closures and mechanism.is_rigid:
        return exudyn_chain.evaluate_closed_motion(mechanism, case, time)
    return case.motion.evaluate(mechanism, time)


class JointProperties(JointNumbers):
    """Properties of joints, and the springs in them."""

    joint_springs: list[JointSpring]


class TreeSettings(JointProperties):
    """All that ``settings.json`` says of a tree of rigid bodies."""

    engine: str
    types: list[str]
    parents: list[int]
    gravity: list[float]


class _MovedByLoops(TypedDict, total=False):
    moved_by_loops: list[str]


class ModelSettings(JointProperties, _MovedByLoops):
    """All that ``settings.json`` says of models in time; weights : of their efforts [-]."""

    engine: str
    runs: list[ModelRun]
    weights: list[float]


# From when on which connectors act: time [s] and numbers of objects.
ActingObjects = TypedDict("ActingObjects", {"from": float, "objects": list[int]})


class ModelRun(TypedDict):
    """One solve of a model: its plan (see ``Plan``), its drivers, and where its efforts are read: object, component, factor."""

    end: float
    step: float
    sample: float
    steps: int
    lead: float
    index2: bool
    spectral_radius: float
    tolerance: float
    extrapolate: bool
    keeps: bool
    static_start: bool
    drivers: list[int]
    effort: list[list[list[float]]]
    switched: list[int]
    acting: list[ActingObjects]


def _collect_joint_properties(mechanism: Mechanism, without: frozenset[str]) -> JointProperties:
    """Return the properties of the joints themselves [kg m^2], [N m s/rad], [N m], ..., zero for joints in ``without``."""
    weighted = [(j, 0.0 if j.name in without else 1.0) for j in mechanism.joints for _ in range(j.nv)]
    springs = [j for j in mechanism.joints if j.stiffness and j.name not in without]
    return {
        "rotor_inertia": [factor * float(j.rotor_inertia) for j, factor in weighted],
        "damping": [factor * float(j.damping) for j, factor in weighted],
        "friction": [factor * float(j.friction) for j, factor in weighted],
        "joint_springs": [
            {
                "joint": j.name,
                "stiffness": j.stiffness,
                "rest": j.rest,
                "v": mechanism.v_slices[j.name].start,
                "q": list(range(*mechanism.q_slices[j.name].indices(mechanism.nq))),
            }
            for j in springs
        ],
    }


@dataclass(frozen=True)
class ModelView:
    """View of a model in time: its layout, its plane (None in space), joints without a drive of their own."""

    layout: Layout
    plane: Array | None
    free: frozenset[str] = frozenset()


def _build_look(mechanism: Mechanism, case: Case, engine: str) -> ModelView:
    if exudyn_phases.has_switched_closures(mechanism):
        followed = exudyn_phases.ClosedRun(mechanism, case, exudyn_phases.solve_phases(mechanism, case))
        return ModelView(followed.layout, None, followed.switching.free)
    if describe_nontree_parts(mechanism) is None:
        return ModelView(build_start_layout(mechanism, case), choose(mechanism, case, engine, PLAIN).plane)
    history = build_history(mechanism, case, exudyn_loops.compute_coarsest_step(case, PLAIN))
    model = exudyn_loops.build_model(mechanism, case, engine, history)
    return ModelView(model.layout, model.plane, frozenset(model.free))


def _write_tree(mechanism: Mechanism, motion: Motion, folder: Path) -> None:
    tree = exudyn_rigid.build(mechanism, wrench=False)
    angle, rate, rate2 = exudyn_rigid.compute_elementary_motion(mechanism, tree, motion.q, motion.v, motion.a)
    moving: dict[str, Array] = {}
    for name, (first, before, after) in tree.moving.items():
        places = zip(*exudyn_rigid.compute_moving_pose(mechanism, mechanism.joint_of[name], motion.q), strict=True)
        frames = [compose(compose(before, Placement(*place)), after) for place in places]
        moving[f"moving_{first}"] = np.array([exudyn_rigid.build_transform66(frame) for frame in frames])
    moving |= {"transforms": np.array(tree.transforms), "inertias": np.array(tree.inertias)}
    moving |= {"share": exudyn_rigid.build_share_matrix(mechanism, tree), "angle": angle, "rate": rate, "rate2": rate2}
    write_arrays(folder / "model.npz", moving)
    settings: TreeSettings = {
        "engine": TREE,
        **_collect_joint_properties(mechanism, frozenset()),
        "types": tree.types,
        "parents": [int(p) for p in tree.parents],
        "gravity": mechanism.gravity.tolist(),
    }
    write(folder, motion, "run_exudyn_tree.py.txt", {}, settings)


def _write_time_model(mechanism: Mechanism, case: Case, engine: str, motion: Motion, folder: Path) -> None:
    look = _build_look(mechanism, case, engine)
    _check_joints(mechanism, look)
    with collect_runs() as runs:
        adapter.run(mechanism, case, engine, PLAIN)
    final_runs = _list_final_runs(runs)
    texts = [write_model_code(run).replace("def build(", f"def build_{k}(", 1) for k, run in enumerate(final_runs)]
    told = inspect.getsource(exudyn_solve.build_solver_settings)
    arrays = {name: values for k, run in enumerate(final_runs) for name, values in _sample_drivers(k, run)}
    write_arrays(folder / "drivers.npz", arrays)
    moved: _MovedByLoops = {}
    if look.free and not mechanism.is_rigid:
        moved["moved_by_loops"] = sorted(look.free)  # motion.csv has nothing of them
    settings: ModelSettings = {
        "engine": engine,
        "runs": [_run(mechanism, look, run) for run in final_runs],
        "weights": [1.0] if len(final_runs) == 1 else [-1 / 3, 4 / 3],
        **moved,
        # beside beams, damping and springs of joints without a drive are connectors of the model
        **_collect_joint_properties(mechanism, frozenset() if mechanism.is_rigid else look.free),
    }
    if mechanism.closures and mechanism.is_rigid:
        shares = _compute_drive_shares(mechanism, case, motion.q)
        write_arrays(folder / "shares.npz", {"shares": shares})  # (sample, drive, joint)
    text = "\n\n".join([HEAD, told, *texts])
    write(folder, motion, "run_exudyn.py.txt", {"model.py": text}, settings)


def _check_joints(mechanism: Mechanism, look: ModelView) -> None:
    """Raise NotExported where a joint's efforts depend on its position."""
    for joint in mechanism.joints:
        if joint.nv and joint.kind not in COORDINATES and joint.name not in look.free:
            raise NotExported(
                f"joint {joint.name!r}: its efforts depend on the position of a {joint.kind} joint; for models in time "
                f"{', '.join(COORDINATES)} joints are exported"
            )


def _sample_drivers(k: int, run: RecordedSolve) -> Iterator[tuple[str, Array]]:
    """Yield what the user functions of run k are at every step, with the names of the arrays."""
    for d, driver in enumerate(run.drivers):
        yield f"offset_{k}_{d}", _sample_user_function(run.plan, driver.offset, 0, 0)
        if driver.rate is not None:
            yield f"rate_{k}_{d}", _sample_user_function(run.plan, driver.rate, 0, 0)
    for number, load in run.loads.items():
        yield f"load_{k}_{int(number)}", _sample_user_function(run.plan, load, None)


def _compute_drive_shares(mechanism: Mechanism, case: Case, q: Array) -> Array:
    """Return the drives' efforts per effort of joints that the motion gives, (samples, nv, nv) [-]; q : (samples, nq)."""
    if exudyn_phases.has_switched_closures(mechanism):
        return exudyn_phases.compute_drive_shares(mechanism, exudyn_phases.solve_phases(mechanism, case))
    units = (np.tile(unit, (len(q), 1)) for unit in np.eye(mechanism.nv))
    return np.stack([exudyn_chain.split_sampled_efforts(mechanism, case, q, unit) for unit in units], axis=2)


def _list_final_runs(runs: list[RecordedSolve]) -> list[RecordedSolve]:
    """Return the run that held of every model: a stalled one is repeated at once with a looser tolerance."""
    last = {(run.plan.step, len(run.calls)): run for run in runs}
    return list(last.values())


def _sample_user_function(plan: Plan, function: Callable[..., Any], *more: Any) -> Array:
    """Return the values of a user function at every step, (steps + 1, columns)."""
    return np.array([np.atleast_1d(function(None, float(t), *more)) for t in compute_step_times(plan) + plan.lead])


def _run(mechanism: Mechanism, look: ModelView, run: RecordedSolve) -> ModelRun:
    plan = run.plan
    effort: list[list[list[float]]] = []
    for joint in mechanism.joints:
        if not joint.nv:
            continue
        if joint.name in look.free:
            effort += [[] for _ in range(joint.nv)]
        elif look.plane is not None:
            axis = look.layout.compute_start_pose(look.layout.joint[joint.name]).rotation @ joint.axis
            effort.append([[int(run.reactions["motor", joint.name]), 0, -float(np.sign(look.plane[:, 2] @ axis))]])
        elif joint.kind == "prismatic":
            keys = [key for key in run.reactions if key[:2] == ("force", joint.name)]
            effort.append([[int(run.reactions[key]), 0, -1.0] for key in keys])
        else:
            effort.append([[int(run.reactions["moment", joint.name]), 0, -1.0]])
    return {
        "end": plan.end,
        "step": plan.step,
        "sample": plan.sample,
        "steps": plan.steps,
        "lead": plan.lead,
        "index2": plan.index2,
        "spectral_radius": plan.spectral_radius,
        "tolerance": plan.tolerance,
        "extrapolate": plan.extrapolate,
        "keeps": plan.keeps,
        "static_start": plan.static_start,
        "drivers": [int(d.number) for d in run.drivers],
        "effort": effort,
        "switched": list(run.switched),
        "acting": [{"from": start, "objects": list(on)} for start, on in run.acting],
    }
