"""Certificate of MuJoCo's model: body_mass, mj_fullM, qfrc_bias at rest, xaxis, efc_J of its equalities."""

from __future__ import annotations

import mujoco
import numpy as np

from crosscheck.engines.mujoco import loops as mujoco_loops
from crosscheck.engines.mujoco.joints import BuiltModel, convert_effort_from_engine, convert_to_engine
from crosscheck.engines.mujoco.model import build
from crosscheck.engines.shared import loop_closure as assembly
from crosscheck.engines.shared.prescribed import describe_nontree_parts
from crosscheck.engines.shared.probe_states import (
    Array,
    collect_joint_bodies,
    configurations,
    list_probe_rates,
    move_inertia_to_origin,
)
from crosscheck.measures.certificate import Certificate, ClosureEnds, PassiveElements, RestDynamics, TorqueSlopes
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism

# Weights of f(x + k s) over s, exact for polynomials of degree six; torques are sums of sines of angles, and squares of rates.
DIFFERENCES = {-3: -1 / 60, -2: 9 / 60, -1: -45 / 60, 1: 45 / 60, 2: -9 / 60, 3: 1 / 60}
PLACE_CHANGE = 0.02  # [rad], [m]
RATE_CHANGE = 1.0  # [rad/s], [m/s]


def certify(mechanism: Mechanism, case: Case, engine: str) -> Certificate:
    """Return mass [kg], centre of mass [m], mass matrix [kg m^2], [kg], gravity torque [N m], [N], axes, closures."""
    built = build(
        mechanism, extend=mujoco_loops.make_loop_extender(mechanism) if describe_nontree_parts(mechanism) else None
    )
    model = built.model
    data = mujoco.MjData(model)
    mass = np.where(model.body_weldid != 0, model.body_mass, 0.0)
    q = configurations(mechanism, case)
    slopes = _compute_torque_slopes(mechanism, built, data, q)
    dynamics = _compute_rest_dynamics(mechanism, built, data, mass, q)
    residual, rank = _compute_closure_residual(mechanism, case, built)
    lumps = _compute_joint_inertias(mechanism, built, data, mass)
    return Certificate(
        mass=float(mass.sum()),
        masses=_compute_joint_masses(mechanism, built, mass),
        moments={name: moment for name, (moment, _) in lumps.items()},
        inertias={name: tensor for name, (_, tensor) in lumps.items()},
        order=_list_joint_order(mechanism, built),
        residual=residual,
        rank=rank,
        **dynamics,
        **slopes,
        **_read_passive_elements(mechanism, built),
        **_read_closure_ends(mechanism, built),
    )


def _compute_rest_dynamics(
    mechanism: Mechanism, built_model: BuiltModel, data: mujoco.MjData, mass: Array, q: Array
) -> RestDynamics:
    """Return centre of mass, mass matrix, gravity torque and axes by configuration; data is left at the last one.

    q : (configurations, nq) [rad], [m]; mass : of bodies that move [kg]
    """
    model = built_model.model
    rest = np.zeros((len(q), mechanism.nv))
    state = convert_to_engine(mechanism, built_model, q, rest, rest)
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
    return {
        "com": com,
        "mass_matrix": _convert_mass_matrix(mechanism, built_model, q, matrix),
        "gravity": convert_effort_from_engine(mechanism, built_model, q, gravity),
        "axes": {name: np.array(rows) for name, rows in axes.items()},
    }


def _compute_torque_slopes(
    mechanism: Mechanism, built_model: BuiltModel, data: mujoco.MjData, q: Array
) -> TorqueSlopes:
    """Derivatives of the tree's efforts by place and rate at the probes: differences of mj_rne, which knows no rotor."""
    probe = list_probe_rates(mechanism)
    if probe is None:
        return {}
    model = built_model.model
    state = convert_to_engine(mechanism, built_model, q, *probe)
    effort = np.empty(model.nv)
    slopes = np.zeros((2, len(q), model.nv, model.nv))
    for k in range(len(q)):
        for which, change in enumerate((PLACE_CHANGE, RATE_CHANGE)):
            for column in range(model.nv):
                for away, weight in DIFFERENCES.items():
                    data.qpos[:] = state.q[k]
                    data.qvel[:] = state.v[k]
                    data.qacc[:] = state.a[k]
                    (data.qvel if which else data.qpos)[column] += away * change
                    mujoco.mj_fwdPosition(model, data)
                    mujoco.mj_fwdVelocity(model, data)
                    mujoco.mj_rne(model, data, 1, effort)
                    slopes[which, k, :, column] += weight / change * effort
    by_place, by_rate = (_convert_mass_matrix(mechanism, built_model, q, one) for one in slopes)
    return {"torque_by_place": by_place, "torque_by_rate": by_rate}


def _read_passive_elements(mechanism: Mechanism, built_model: BuiltModel) -> PassiveElements:
    """Damping and dry friction of joints, springs in joints and tendons, from the compiled model's own arrays."""
    model = built_model.model
    moving = [j for j in mechanism.joints if j.nv]
    springs: dict[str, float] = {}
    for joint in (j for j in moving if j.nv == 1):
        number = int(model.dof_jntid[built_model.v_at[joint.name]])
        if model.jnt_stiffness[number].any() or joint.stiffness:
            springs[f"{joint.name}: stiffness"] = float(np.ravel(model.jnt_stiffness[number])[0])
            springs[f"{joint.name}: rest"] = float(model.qpos_spring[built_model.q_at[joint.name]])
    for spring in mechanism.springs:
        tendon = model.tendon(spring.name).id
        springs[f"{spring.name}: stiffness"] = float(np.ravel(model.tendon_stiffness[tendon])[0])
        springs[f"{spring.name}: rest"] = float(model.tendon_lengthspring[tendon][0])
        springs[f"{spring.name}: damping"] = float(np.ravel(model.tendon_damping[tendon])[0])
    return {
        "damping": {j.name: float(np.ravel(model.dof_damping[built_model.v_at[j.name]])[0]) for j in moving},
        "friction": {j.name: float(model.dof_frictionloss[built_model.v_at[j.name]]) for j in moving},
        "springs": springs,
    }


def _read_closure_ends(mechanism: Mechanism, built_model: BuiltModel) -> ClosureEnds:
    """Return points and axes of MuJoCo's equalities on each link, in the link's frame: places of their sites."""
    model = built_model.model
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


def _compute_joint_masses(mechanism: Mechanism, built_model: BuiltModel, mass: Array) -> dict[str, float]:
    """Mass of all bodies welded to the child of each moving joint."""
    weld = built_model.model.body_weldid
    child = {j.name: built_model.body[j.child] for j in mechanism.joints if j.name in collect_joint_bodies(mechanism)}
    return {name: float(mass[weld == weld[body]].sum()) for name, body in child.items()}


def _compute_joint_inertias(
    mechanism: Mechanism, built_model: BuiltModel, data: mujoco.MjData, mass: Array
) -> dict[str, tuple[Array, Array]]:
    """First moment and tensor about the child's origin, along its axes, of all bodies welded to it, by moving joint."""
    model = built_model.model
    joint_inertias = {}
    for name in collect_joint_bodies(mechanism):
        child = built_model.body[mechanism.joint_of[name].child]
        axes = data.xmat[child].reshape(3, 3)
        moment = np.zeros(3)
        tensor = np.zeros((3, 3))
        for body in np.flatnonzero(model.body_weldid == model.body_weldid[child]):
            turn = axes.T @ data.ximat[body].reshape(3, 3)
            central = turn @ np.diag(model.body_inertia[body]) @ turn.T
            m, i = move_inertia_to_origin(float(mass[body]), axes.T @ (data.xipos[body] - data.xpos[child]), central)
            moment = moment + m
            tensor = tensor + i
        joint_inertias[name] = (moment, tensor)
    return joint_inertias


def _convert_mass_matrix(mechanism: Mechanism, built_model: BuiltModel, q: Array, matrix: Array) -> Array:
    """The mass matrix in the mechanism's coordinates: the dual of the map, on both sides."""
    half = [convert_effort_from_engine(mechanism, built_model, q, matrix[:, :, k]) for k in range(matrix.shape[2])]
    rows = np.stack(half, axis=2)  # (configuration, coordinate, MuJoCo's coordinate)
    whole = [convert_effort_from_engine(mechanism, built_model, q, rows[:, k, :]) for k in range(rows.shape[1])]
    return np.stack(whole, axis=1)


def _list_joint_order(mechanism: Mechanism, built_model: BuiltModel) -> tuple[str, ...]:
    return tuple(sorted(built_model.v_at, key=lambda name: built_model.v_at[name]))


def _compute_closure_residual(
    mechanism: Mechanism, case: Case, built_model: BuiltModel
) -> tuple[float | None, int | None]:
    """Largest residual of the closures' equations and the rank of MuJoCo's own rows, where the motion starts; as guessed
    where they do not close."""
    if not mechanism.closures or any(c.active for c in mechanism.closures):
        return None, None
    motion = mujoco_loops.make_motion(mechanism, case, built_model)
    tree = mujoco_loops.Tree(mechanism, built_model, mujoco_loops.build_data(built_model, mechanism), motion)
    place, rate, _ = motion(np.zeros(1))
    closes = True
    try:
        place, rate, _ = mujoco_loops.solve_closed_state(
            tree, assembly.find_unprescribed_joints(mechanism, case), np.zeros(1)
        )
    except assembly.AssemblyError:
        closes = False
    rows = assembly.assemble_rows(mechanism.closures, tree.compute_frame_pairs(place[0], rate[0]))
    native = not mujoco_loops.list_missing_equalities(mechanism)
    g = mujoco_loops.compute_equality_rows(tree) if native else rows.g
    return float(np.abs(rows.phi).max()) if closes else None, assembly.compute_rank(g)
