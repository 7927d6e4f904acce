"""Certificate of Pinocchio's model: crba, computeGeneralizedGravity, centerOfMass, joint Jacobians."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from crosscheck.engines.pinocchio import loops as pinocchio_loops
from crosscheck.engines.pinocchio.model import BuiltModel, build, convert_to_engine
from crosscheck.engines.shared import loop_closure as assembly
from crosscheck.engines.shared.prescribed import collect_passive_elements
from crosscheck.engines.shared.probe_states import Array, configurations, list_probe_rates, move_inertia_to_origin
from crosscheck.measures.certificate import Certificate, ClosureEnds, RestDynamics, TorqueSlopes
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism, Placement

TURNING = ("revolute", "prismatic", "cylindrical")  # closures with the same axis at both ends


def certify(mechanism: Mechanism, case: Case, engine: str) -> Certificate:
    """Return mass [kg], centre of mass [m], mass matrix [kg m^2], [kg], gravity torque [N m], [N], axes, closures."""
    built = build(mechanism)
    model = built.model
    q = configurations(mechanism, case)
    rest = np.zeros((len(q), mechanism.nv))
    places = convert_to_engine(built, q, rest, rest)[0]
    residual, rank = _compute_closure_residual(mechanism, case, built)
    lumps = {name: frame.actInv(model.inertias[index]) for name, (index, frame) in built.joint.items()}
    second = {name: move_inertia_to_origin(float(i.mass), i.lever, i.inertia) for name, i in lumps.items()}
    return Certificate(
        mass=float(pin.computeTotalMass(model)),
        masses={name: float(model.inertias[index].mass) for name, (index, _) in built.joint.items()},
        moments={name: moment for name, (moment, _) in second.items()},
        inertias={name: tensor for name, (_, tensor) in second.items()},
        order=tuple(_resolve_joint_name(mechanism, name) for name in list(model.names)[1:]),
        residual=residual,
        rank=rank,
        **_compute_rest_dynamics(mechanism, built, places),
        **_compute_torque_slopes(mechanism, built, q),
        **collect_passive_elements(mechanism),
        **_read_closure_ends(mechanism, case, built),
    )


def _compute_rest_dynamics(mechanism: Mechanism, built_model: BuiltModel, places: Array) -> RestDynamics:
    """Return centre of mass, mass matrix, gravity torque and axes by configuration, in the mechanism's order of coordinates."""
    model = built_model.model
    data = model.createData()
    order = built_model.v_order
    matrix = np.empty((len(places), model.nv, model.nv))
    gravity = np.empty((len(places), model.nv))
    com = np.empty((len(places), 3))
    for k, place in enumerate(places):
        upper = np.triu(pin.crba(model, data, place))
        matrix[k] = upper + np.triu(upper, 1).T
        gravity[k] = pin.computeGeneralizedGravity(model, data, place)
        com[k] = pin.centerOfMass(model, data, place)
    return {
        "com": com,
        "mass_matrix": matrix[:, order][:, :, order],
        "gravity": gravity[:, order],
        "axes": _compute_joint_axes(mechanism, built_model, places),
    }


def _compute_torque_slopes(mechanism: Mechanism, built_model: BuiltModel, q: Array) -> TorqueSlopes:
    """Derivatives of the tree's efforts by place and rate at the probes: computeRNEADerivatives."""
    probe = list_probe_rates(mechanism)
    if probe is None:
        return {}
    model = built_model.model
    data = model.createData()
    order = built_model.v_order
    slopes = np.empty((2, len(q), model.nv, model.nv))
    for k, state in enumerate(zip(*convert_to_engine(built_model, q, *probe), strict=True)):
        by_place, by_rate, _ = pin.computeRNEADerivatives(model, data, *state)
        slopes[0, k] = by_place
        slopes[1, k] = by_rate
    by_place, by_rate = slopes[:, :, order][..., order]
    return {"torque_by_place": by_place, "torque_by_rate": by_rate}


def _read_closure_ends(mechanism: Mechanism, case: Case, built_model: BuiltModel) -> ClosureEnds:
    """Return points and axes of closures on each link, in its frame: poses of Pinocchio's frames beside those of links."""
    tree = pinocchio_loops.Tree(mechanism, built_model, built_model.model.createData(), case)
    place, rate, _ = tree.evaluate_motion(np.zeros(1))
    tree.update_kinematics(place[0], rate[0])
    points = {}
    axes = {}
    for closure in (c for c in mechanism.closures if c.kind != "coupling"):
        for end, at in (("first", closure.first), ("second", closure.second)):
            frame = tree.compute_frame(replace(at, placement=Placement()))
            seen = tree.compute_frame(at)
            points[f"{closure.name}: {end}"] = frame.r.T @ (seen.x - frame.x)
            if closure.kind in TURNING or (end == "first" and closure.kind in ("universal", "point-on-line")):
                axes[f"{closure.name}: {end}"] = frame.r.T @ seen.r @ closure.axis
    return {"closure_points": points, "closure_axes": axes}


def _resolve_joint_name(mechanism: Mechanism, name: str) -> str:
    return mechanism.joints[0].name if name == "root_joint" else name


def _compute_joint_axes(mechanism: Mechanism, built_model: BuiltModel, places: Array) -> dict[str, Array]:
    """Columns of the joints' Jacobians in the world: angular of hinges, linear of slides."""
    model = built_model.model
    data = built_model.model.createData()
    found: dict[str, list[Array]] = {j.name: [] for j in mechanism.joints if j.nv == 1}
    for place in places:
        pin.computeJointJacobians(model, data, place)
        for joint in mechanism.joints:
            if joint.nv == 1:
                column = np.array(data.J).reshape(6, model.nv)[
                    :, built_model.v_order[mechanism.v_slices[joint.name].start]
                ]  # a copy
                found[joint.name].append(column[:3] if joint.kind == "prismatic" else column[3:])
    return {name: np.array(rows) for name, rows in found.items()}


def _compute_closure_residual(
    mechanism: Mechanism, case: Case, built_model: BuiltModel
) -> tuple[float | None, int | None]:
    """Largest residual of the closures' equations and their rank, where the motion starts; as guessed if they do not close."""
    if not mechanism.closures or any(c.active for c in mechanism.closures):
        return None, None
    tree = pinocchio_loops.Tree(mechanism, built_model, built_model.model.createData(), case)
    place, rate, _ = tree.evaluate_motion(np.zeros(1))
    closes = True
    try:
        place, rate, _ = convert_to_engine(
            built_model, *pinocchio_loops.solve_motion(mechanism, case, built_model, np.zeros(1))
        )
    except assembly.AssemblyError:
        closes = False
    rows = assembly.assemble_rows(mechanism.closures, tree.compute_frame_pairs(place[0], rate[0]))
    return float(np.abs(rows.phi).max()) if closes else None, assembly.compute_rank(rows.g)
