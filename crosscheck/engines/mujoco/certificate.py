"""Certificate of MuJoCo's model: body_mass, mj_fullM, qfrc_bias at rest, xaxis, efc_J of its equalities."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from crosscheck.engines.mujoco import loops as mujoco_loops
from crosscheck.engines.mujoco.joints import Built, effort_from_engine, to_engine
from crosscheck.engines.mujoco.model import build
from crosscheck.engines.shared import loop_closure as assembly
from crosscheck.engines.shared.prescribed import beyond_a_tree
from crosscheck.engines.shared.probe_states import Array, about_origin, carried, configurations
from crosscheck.measures.certificate import Certificate
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism


def certify(mechanism: Mechanism, case: Case, engine: str) -> Certificate:
    """Return mass [kg], centre of mass [m], mass matrix [kg m^2], [kg], gravity torque [N m], [N], axes, closures."""
    built = build(mechanism, extend=mujoco_loops.furnish(mechanism) if beyond_a_tree(mechanism) else None)
    model = built.model
    data = mujoco.MjData(built.model)
    q = configurations(mechanism, case)
    rest = np.zeros((len(q), mechanism.nv))
    state = to_engine(mechanism, built, q, rest, rest)
    moving = model.body_weldid != 0
    mass = np.where(moving, model.body_mass, 0.0)
    com = np.empty((len(q), 3))
    gravity = np.empty((len(q), model.nv))
    matrix = np.empty((len(q), model.nv, model.nv))
    axes: dict[str, list[Array]] = {j.name: [] for j in mechanism.joints if j.nv == 1}
    for k in range(len(q)):
        data.qpos[:] = state.q[k]
        data.qvel[:] = 0.0
        mujoco.mj_forward(model, data)
        com[k] = mass @ data.xipos / (mass.sum() or 1.0)
        gravity[k] = data.qfrc_bias
        mujoco.mj_fullM(model, data, matrix[k])
        for name, rows in axes.items():
            rows.append(data.xaxis[model.joint(name).id].copy())
    residual, rank = _closures(mechanism, case, built)
    lumps = _lumps(mechanism, built, data, mass)
    return Certificate(
        mass=float(mass.sum()),
        masses=_masses(mechanism, built, mass),
        moments={name: moment for name, (moment, _) in lumps.items()},
        inertias={name: tensor for name, (_, tensor) in lumps.items()},
        com=com,
        mass_matrix=_in_order(mechanism, built, q, matrix),
        gravity=effort_from_engine(mechanism, built, q, gravity),
        axes={name: np.array(rows) for name, rows in axes.items()},
        order=_order(mechanism, built),
        residual=residual,
        rank=rank,
        **_passive(mechanism, built),
        **_ends(mechanism, built),
    )


def _passive(mechanism: Mechanism, built: Built) -> dict[str, Any]:
    """Damping and dry friction of joints, springs in joints and tendons, from the compiled model's own arrays."""
    model = built.model
    moving = [j for j in mechanism.joints if j.nv]
    springs: dict[str, float] = {}
    for joint in (j for j in moving if j.nv == 1):
        number = int(model.dof_jntid[built.v_at[joint.name]])
        if model.jnt_stiffness[number].any() or joint.stiffness:
            springs[f"{joint.name}: stiffness"] = float(np.ravel(model.jnt_stiffness[number])[0])
            springs[f"{joint.name}: rest"] = float(model.qpos_spring[built.q_at[joint.name]])
    for spring in mechanism.springs:
        tendon = model.tendon(spring.name).id
        springs[f"{spring.name}: stiffness"] = float(np.ravel(model.tendon_stiffness[tendon])[0])
        springs[f"{spring.name}: rest"] = float(model.tendon_lengthspring[tendon][0])
        springs[f"{spring.name}: damping"] = float(np.ravel(model.tendon_damping[tendon])[0])
    return {
        "damping": {j.name: float(np.ravel(model.dof_damping[built.v_at[j.name]])[0]) for j in moving},
        "friction": {j.name: float(model.dof_frictionloss[built.v_at[j.name]]) for j in moving},
        "springs": springs,
    }


def _ends(mechanism: Mechanism, built: Built) -> dict[str, Any]:
    """Return points and axes of MuJoCo's equalities on each link, in the link's frame: places of their sites."""
    model = built.model
    points = {}
    axes = {}
    for closure in mechanism.closures:
        if closure.kind not in mujoco_loops.EQUALITIES:
            continue
        for end in ("first", "second"):
            here = model.site(f"{closure.name}/{end}0").pos
            points[f"{closure.name}: {end}"] = here.copy()
            if closure.kind == "revolute":  # two points on the axis, a metre apart
                axes[f"{closure.name}: {end}"] = model.site(f"{closure.name}/{end}1").pos - here
    return {"closure_points": points, "closure_axes": axes}


def _masses(mechanism: Mechanism, built: Built, mass: Array) -> dict[str, float]:
    """Mass of all bodies welded to the child of each moving joint."""
    weld = built.model.body_weldid
    child = {j.name: built.body[j.child] for j in mechanism.joints if j.name in carried(mechanism)}
    return {name: float(mass[weld == weld[body]].sum()) for name, body in child.items()}


def _lumps(mechanism: Mechanism, built: Built, data: mujoco.MjData, mass: Array) -> dict[str, tuple[Array, Array]]:
    """First moment and tensor about the child's origin, along its axes, of all bodies welded to it, by moving joint."""
    model = built.model
    found = {}
    for name in carried(mechanism):
        child = built.body[mechanism.joint_of[name].child]
        axes = data.xmat[child].reshape(3, 3)
        moment = np.zeros(3)
        tensor = np.zeros((3, 3))
        for body in np.flatnonzero(model.body_weldid == model.body_weldid[child]):
            turn = axes.T @ data.ximat[body].reshape(3, 3)
            own = turn @ np.diag(model.body_inertia[body]) @ turn.T
            m, i = about_origin(float(mass[body]), axes.T @ (data.xipos[body] - data.xpos[child]), own)
            moment = moment + m
            tensor = tensor + i
        found[name] = (moment, tensor)
    return found


def _in_order(mechanism: Mechanism, built: Built, q: Array, matrix: Array) -> Array:
    """The mass matrix in the mechanism's coordinates: the dual of the map, on both sides."""
    half = [effort_from_engine(mechanism, built, q, matrix[:, :, k]) for k in range(matrix.shape[2])]
    rows = np.stack(half, axis=2)  # (configuration, coordinate, MuJoCo's coordinate)
    whole = [effort_from_engine(mechanism, built, q, rows[:, k, :]) for k in range(rows.shape[1])]
    return np.stack(whole, axis=1)


def _order(mechanism: Mechanism, built: Built) -> tuple[str, ...]:
    return tuple(sorted(built.v_at, key=lambda name: built.v_at[name]))


def _closures(mechanism: Mechanism, case: Case, built: Built) -> tuple[float | None, int | None]:
    """Largest residual of the closures' equations and the rank of MuJoCo's own rows, where the motion starts; as guessed
    where they do not close."""
    if not mechanism.closures or any(c.active for c in mechanism.closures):
        return None, None

    def motion(time: Array) -> tuple[Array, Array, Array]:
        q, qd, qdd = case.motion.evaluate(mechanism, time)
        state = to_engine(mechanism, built, assembly.guessed(mechanism, case, q), qd, qdd)
        return state.q, state.v, state.a

    tree = mujoco_loops.Tree(mechanism, built, mujoco_loops.state_of(built, mechanism), motion)
    place, rate, _ = motion(np.zeros(1))
    closes = True
    try:
        place, rate, _ = mujoco_loops.closed_state(tree, assembly.left_out(mechanism, case), np.zeros(1))
    except assembly.AssemblyError:
        closes = False
    rows = assembly.rows_of(mechanism.closures, tree.pairs(place[0], rate[0]))
    native = not mujoco_loops.without_equality(mechanism)
    g = mujoco_loops.native_rows(tree) if native else rows.g
    return float(np.abs(rows.phi).max()) if closes else None, assembly.rank(g)
