"""MuJoCo: mj_inverse on its own model, with armature, damping and dry friction inside the engine.

Conventions (the coordinates of each joint: `mujoco.joints`).

    tau           qfrc_inverse = M a + bias - passive - constraint: the actuator's effort as the mechanism means it,
                  armature, damping, springs and dry friction included.  At exactly zero speed dry friction is a set: MuJoCo
                  takes the end that the acceleration points to, the mechanism zero; there its friction is taken out.
    wrench        mj_rnePostConstraint: cfrc_int of a body is the (moment, force) that its parent exerts on it and on
                  all it carries, at the centre of mass of the whole tree, in world axes; moved to the joint:
                      F = X^T f_int,  M = X^T (m_int + (c - x) x f_int)      (X, x: pose of the link)
    loops         "mujoco" by projection, "mujoco-equality" as MuJoCo gives it: `mujoco.loops`.

Source: mujoco 4.0.0, engine_inverse.c, engine_core_smooth.c; the tests compare with closed forms and with Pinocchio.
"""

from __future__ import annotations

import time as clock
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from crosscheck.engines.base import Options, beside, sample_times
from crosscheck.engines.mujoco import loops as mujoco_loops
from crosscheck.engines.mujoco.joints import (
    BuiltModel,
    State,
    convert_effort_from_engine,
    convert_from_engine,
    convert_to_engine,
    describe_joint_refusal,
)
from crosscheck.engines.mujoco.model import build
from crosscheck.engines.shared import loop_closure as assembly
from crosscheck.engines.shared import phases
from crosscheck.engines.shared.prescribed import describe_nontree_parts, missing_motion
from crosscheck.measures.record import (
    Record,
    Series,
    make_reaction_series,
    make_wrench_series,
    torque_series,
    vector_series,
)
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism

Array = NDArray[np.float64]
EQUALITY = "mujoco-equality"
SOFT = (
    "an equality constraint is soft: where the motion closes the loops exactly its force is zero, however stiff it is, "
    "and mj_inverse gives the efforts of the open tree, on passive joints too"
)


# What this adapter offers beside (`crosscheck.engines.base`).
certify = beside("crosscheck.engines.mujoco.certificate", "certify")
export = beside("crosscheck.engines.mujoco.export", "export")
replay = beside("crosscheck.engines.mujoco.replay", "replay")
lift = beside("crosscheck.engines.mujoco.lift", "lift")
lifts = beside("crosscheck.engines.mujoco.lift", "lifts")
dynamics = beside("crosscheck.engines.mujoco.own_dynamics", "dynamics")


def version() -> str:
    """Return the version of MuJoCo."""
    return str(mujoco.mj_versionString())


def abilities() -> str:
    """Return one sentence: what MuJoCo can do here."""
    return (
        "Rigid inverse dynamics by mj_inverse with armature, damping and dry friction in the engine, joint wrenches "
        "and tips, closed loops by projection (mujoco-equality: by soft equality constraints, as it gives them), springs "
        "and forces, URDF by its own parser where it accepts the inertias; beams: see mujoco-flex."
    )


def unsupported(mechanism: Mechanism, case: Case, engine: str) -> str | None:
    """Return the reason why MuJoCo cannot do this case, or None."""
    if not mechanism.is_rigid:
        names = ", ".join(link.name for link in mechanism.beams)
        return f"rigid bodies only here, one beam in mujoco-flex; flexible: {names}"
    for joint in mechanism.joints:
        if (reason := describe_joint_refusal(mechanism, joint)) is not None:
            return reason
    if bent := [spring.name for spring in mechanism.springs if spring.law is not None]:
        return f"MuJoCo's tendons pull linearly; with a law of another kind: {', '.join(bent)}"
    if engine == EQUALITY:
        if not mechanism.closures:
            return "no closed loop: see mujoco"
        if kinds := mujoco_loops.list_missing_equalities(mechanism):
            return f"no equality constraint of MuJoCo makes up the closures {', '.join(kinds)}: see mujoco"
    return assembly.describe_refusal(mechanism) if mechanism.closures else missing_motion(mechanism, case)


def run(mechanism: Mechanism, case: Case, engine: str, options: Options) -> Record:
    """Return torque [N m] or [N], tip [m], wrench [N], [N m]; "skipped" in MuJoCo's words if it refuses the model."""
    time = sample_times(case)
    start = clock.perf_counter()
    with collect_warnings() as words:
        try:
            built = build(
                mechanism,
                extend=mujoco_loops.make_loop_extender(mechanism) if describe_nontree_parts(mechanism) else None,
            )
        except ValueError as error:
            return Record(engine=engine, status="skipped", message=f"MuJoCo refuses the model: {_join_lines(error)}")
        result = _compute_dynamics(mechanism, case, built, time, engine)
    wall = clock.perf_counter() - start
    algorithm = "mj_inverse, equality off, projected on efc_J" if mechanism.closures else "mj_inverse"
    return Record(
        engine=engine,
        version=version(),
        message="; ".join(dict.fromkeys([*words, *([SOFT] if engine == EQUALITY else [])])),
        settings={
            "algorithm": "mj_inverse, equality on" if engine == EQUALITY else algorithm,
            "model": "URDF" if mechanism.urdf else "MjSpec",
            "raised to mjMINVAL": list(built.floored),
        },
        time=time,
        series=_collect_series(mechanism, result),
        wall_time=wall,
    )


def _join_lines(error: BaseException) -> str:
    return " | ".join(line.strip() for line in str(error).splitlines() if line.strip())


@contextmanager
def collect_warnings() -> Iterator[list[str]]:
    """Collect MuJoCo's warnings, which it would otherwise write to the console and to ./MUJOCO_LOG.TXT."""
    words: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(words.append)
    try:
        yield words
    finally:
        mujoco.set_mju_user_warning(before)


# ------------------------------------------------------------------------------------------------------ what it says


@dataclass(frozen=True)
class Dynamics:
    """Results of MuJoCo, in the mechanism's order.

    torque : (samples, nv) [N m] or [N]; wrench : (samples, 6) [N], [N m] by joint; tip : (samples, 3) [m] by link
    closures : (samples, 6) [N], [N m] on the second frame of every closure
    """

    torque: Array
    wrench: dict[str, Array]
    tip: dict[str, Array]
    closures: dict[str, Array] = field(default_factory=dict)


def compute_inverse_dynamics(
    mechanism: Mechanism, built_model: BuiltModel, q: Array, qd: Array, qdd: Array
) -> Dynamics:
    """Return mj_inverse of every sample: q (samples, nq), qd, qdd (samples, nv) [rad or m, s], in mechanism order."""
    state = convert_to_engine(mechanism, built_model, q, qd, qdd)
    return _convert_results(mechanism, built_model, q, _evaluate(built_model.model, state))


def _convert_results(mechanism: Mechanism, built_model: BuiltModel, q: Array, raw: RawArrays) -> Dynamics:
    carried = {j.name: built_model.body[j.child] for j in mechanism.joints if j.child in built_model.body}
    return Dynamics(
        torque=convert_effort_from_engine(mechanism, built_model, q, raw.effort),
        wrench={name: compute_body_wrench(built_model.model, raw, body) for name, body in carried.items()},
        tip={
            name: compute_point_position(raw, body, mechanism.link_of[name].tip)
            for name, body in built_model.body.items()
        },
    )


def _compute_dynamics(mechanism: Mechanism, case: Case, built_model: BuiltModel, time: Array, engine: str) -> Dynamics:
    if not describe_nontree_parts(mechanism):
        return compute_inverse_dynamics(mechanism, built_model, *case.motion.evaluate(mechanism, time))

    followed = solve_phases(mechanism, case, built_model, time)
    part = _compute_soft_efforts if engine == EQUALITY else _solve_phase_efforts
    parts = [
        part(_build_tree(phase.mechanism, phase.case, built_model), State(*state), phase.time)
        for phase, state in followed
    ]
    return Dynamics(
        torque=np.concatenate([p.torque for p in parts]),
        wrench=phases.join_series(p.wrench for p in parts),
        tip=phases.join_series(p.tip for p in parts),
        closures={}
        if engine == EQUALITY
        else phases.join_series(phases.fill_wrenches(mechanism, p.closures, len(p.torque)) for p in parts),
    )


def solve_phases(
    mechanism: Mechanism, case: Case, built_model: BuiltModel, time: Array
) -> list[tuple[phases.Phase, phases.State]]:
    """Return every phase with its motion on the closures in MuJoCo's coordinates, (samples, ...) [rad], [m], [s]."""

    def solve_closed(now: Mechanism, here: Case, span: Array) -> phases.State:
        tree = _build_tree(now, here, built_model)
        return (
            mujoco_loops.solve_closed_state(tree, assembly.find_unprescribed_joints(now, here), span)
            if now.closures
            else tree.evaluate_motion(span)
        )

    return phases.solve_phases(
        mechanism, case, time, solve_closed, lambda q: convert_from_engine(mechanism, built_model, q)
    )


def _build_tree(mechanism: Mechanism, case: Case, built_model: BuiltModel) -> mujoco_loops.Tree:
    return mujoco_loops.Tree(
        mechanism,
        built_model,
        mujoco_loops.build_data(built_model, mechanism),
        mujoco_loops.make_motion(mechanism, case, built_model),
    )


def _solve_phase_efforts(tree: mujoco_loops.Tree, state: State, time: Array) -> Dynamics:
    """Return drives' efforts, wrenches and tips of one phase: the tree's efforts shared out to drives and closures."""
    mechanism = tree.mechanism
    built = tree.built
    driven = np.zeros(built.model.nv, dtype=bool)
    weight = np.ones(built.model.nv)
    for joint in (j for j in mechanism.joints if j.nv):
        columns = slice(built.v_at[joint.name], built.v_at[joint.name] + joint.nv)
        driven[columns] = joint.actuated
        weight[columns] = joint.weight
    raw = make_empty_raw(built.model, len(time))
    wrench = np.empty((len(time), len(mechanism.closures), 6))
    for k, t in enumerate(time):
        _fill_state(tree, state, k)
        shares = mujoco_loops.split_state_efforts(tree, float(t), driven, weight)
        mujoco_loops.write_applied_wrenches(tree, shares.acting)
        fill_sample(built.model, tree.data, raw, k, shares.effort)
        wrench[k] = shares.closures
    results = _convert_results(mechanism, built, convert_from_engine(mechanism, built, state.q), raw)
    return replace(results, closures={c.name: wrench[:, k] for k, c in enumerate(mechanism.closures)})


def _fill_state(tree: mujoco_loops.Tree, state: State, k: int) -> None:
    tree.data.qpos[:] = state.q[k]
    tree.data.qvel[:] = state.v[k]
    tree.data.qacc[:] = state.a[k]


def _compute_soft_efforts(tree: mujoco_loops.Tree, state: State, time: Array) -> Dynamics:
    """Return the efforts of mj_inverse with its equality constraints on [N m] or [N], less given forces; nothing else."""
    out = np.empty_like(state.v)
    for k, t in enumerate(time):
        _fill_state(tree, state, k)
        mujoco.mj_inverse(tree.built.model, tree.data)
        out[k] = tree.data.qfrc_inverse - mujoco_loops.compute_generalized_forces(tree, float(t))
    q = convert_from_engine(tree.mechanism, tree.built, state.q)
    return Dynamics(convert_effort_from_engine(tree.mechanism, tree.built, q, out), {}, {})


@dataclass(frozen=True)
class RawArrays:
    """Arrays that MuJoCo leaves in its data, by sample.

    effort : (samples, nv); cfrc_int : (samples, bodies, 6); subtree_com, xpos : (samples, bodies, 3) [m];
    xmat : (samples, bodies, 3, 3)
    """

    effort: Array
    cfrc_int: Array
    subtree_com: Array
    xpos: Array
    xmat: Array


def _evaluate(model: mujoco.MjModel, state: State) -> RawArrays:
    data = mujoco.MjData(model)
    raw = make_empty_raw(model, len(state.q))
    for k in range(len(state.q)):
        data.qpos[:] = state.q[k]
        data.qvel[:] = state.v[k]
        data.qacc[:] = state.a[k]
        mujoco.mj_inverse(model, data)
        # friction of a joint at rest: taken out, see the head of the file
        fill_sample(model, data, raw, k, data.qfrc_inverse + np.where(state.v[k] == 0.0, data.qfrc_constraint, 0.0))
    return raw


def make_empty_raw(model: mujoco.MjModel, samples: int) -> RawArrays:
    """Return room for the data of all samples [N m], [N], [m]."""
    shapes = [(model.nv,), (model.nbody, 6), (model.nbody, 3), (model.nbody, 3), (model.nbody, 3, 3)]
    return RawArrays(*(np.empty((samples, *shape)) for shape in shapes))


def fill_sample(model: mujoco.MjModel, data: mujoco.MjData, raw: RawArrays, k: int, effort: Array) -> None:
    """Write sample k: effort (nv,) [N m] or [N] as given, everything else from ``data``, whose qacc is set."""
    mujoco.mj_rnePostConstraint(model, data)
    raw.effort[k] = effort
    raw.cfrc_int[k] = data.cfrc_int
    raw.subtree_com[k] = data.subtree_com
    raw.xpos[k] = data.xpos
    raw.xmat[k] = data.xmat.reshape(-1, 3, 3)


def compute_body_wrench(model: mujoco.MjModel, raw: RawArrays, body: int) -> Array:
    """Return the wrench of the parent on a body, at the body's frame and along its axes, (samples, 6) [N], [N m]."""
    moment = raw.cfrc_int[:, body, :3]
    force = raw.cfrc_int[:, body, 3:]
    arm = raw.subtree_com[:, model.body_rootid[body]] - raw.xpos[:, body]
    both = np.stack([force, moment + np.cross(arm, force)], axis=1)  # (sample, force or moment, xyz)
    return np.asarray((both @ raw.xmat[:, body]).reshape(-1, 6))


def compute_point_position(raw: RawArrays, body: int, point: Array) -> Array:
    """Return the position of a body's point (3,) [m] in the world, (samples, 3) [m]."""
    return np.asarray(raw.xpos[:, body] + raw.xmat[:, body] @ point)


def _collect_series(mechanism: Mechanism, result: Dynamics) -> dict[str, Series]:
    out = torque_series(mechanism, result.torque)
    for link, place in result.tip.items():
        out |= vector_series(f"tip/{link}", "m", place)
    for joint, wrench in result.wrench.items():
        out |= make_wrench_series(joint, wrench)
    for closure, wrench in result.closures.items():
        out |= make_reaction_series(closure, wrench)
    return out
