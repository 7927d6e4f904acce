"""The reference certificate: what flexinv computes from the mechanism."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from crosscheck.engines.shared.probe_states import (
    Array,
    collect_joint_bodies,
    configurations,
    list_probe_rates,
    move_inertia_to_origin,
)
from crosscheck.measures.certificate import (
    COMPARED_MODES,
    INTERFACE_AXES,
    TIMES_MODES,
    AttachmentData,
    Certificate,
    TorqueSlopes,
)
from flexinv.analysis.solve import solve
from flexinv.constraints.allocation import count_ranks
from flexinv.constraints.closures import build_constraint_rows, compute_constraint_jacobian
from flexinv.errors import InputError
from flexinv.files.load_cases import Case
from flexinv.kinematics.mesh import Mesh, build
from flexinv.kinematics.nodal_motion import NodalMotion, compute_rigid_motion
from flexinv.model.mechanism import WORLD, Beam, Body, Mechanism, Placement, Section
from flexinv.model.part import MeshedPart
from flexinv.parts.reductions import find_reduction
from flexinv.rigid.joint_torques import joint_torques
from flexinv.rigid.torque_derivatives import torque_derivatives

SPRING = ("stiffness", "rest", "damping")
# Ends of closures that have an axis, by the kind: a point on a line has one at its first end only.
AXES = {(kind, end) for kind in ("revolute", "prismatic", "cylindrical") for end in ("first", "second")}
AXES |= {("point-on-line", "first"), ("universal", "first")}
AMONG = 400  # points of the quadrature of a beam's compliance: exact for linear tables to 1e-6


def certify(mechanism: Mechanism, case: Case, engine: str) -> Certificate:
    """Return mass [kg], centre of mass [m], mass matrix, gravity torque, axes, stiffness [N], [N m^2] and closures."""
    return build_certificate(mechanism, case)


def build_certificate(mechanism: Mechanism, case: Case, slopes: bool = True) -> Certificate:
    """Return the certificate of `certify` [kg], [m], [N m]; slopes : False without derivatives of torques, most of its time."""
    if not mechanism.is_rigid:
        return replace(_build_flexible_certificate(mechanism), **collect_attachment_data(mechanism))
    q = configurations(mechanism, case)
    tree = replace(mechanism, closures=(), springs=(), forces=())
    mesh = build(tree)
    rest = np.zeros((len(q), tree.nv))
    motion = compute_rigid_motion(mesh, q, rest, rest)
    moving = _find_moving_links(tree)
    weights = np.where([tree.links[k].name in moving for k in mesh.link], mesh.mass, 0.0)
    rank = _compute_closure_rank(mechanism, case) if mechanism.closures else None
    lumps = {
        name: _compute_lumped_inertia(mesh, motion, name, bodies) for name, bodies in collect_joint_bodies(tree).items()
    }
    gravity, matrix = _compute_gravity_and_mass(tree, q)
    return Certificate(
        mass=float(weights.sum()),
        masses={name: sum(b.inertia.mass for _, b in bodies) for name, bodies in collect_joint_bodies(tree).items()},
        moments={name: moment for name, (moment, _) in lumps.items()},
        inertias={name: tensor for name, (_, tensor) in lumps.items()},
        com=np.einsum("n,snx->sx", weights, motion.x) / (weights.sum() or 1.0),  # (sample, xyz)
        mass_matrix=matrix,
        gravity=gravity,
        **(_compute_torque_slopes(tree, q) if slopes else {}),
        axes=_compute_joint_axes(tree, mesh.joint_node, motion),
        order=tuple(j.name for j in tree.joints if j.nv),
        residual=None,
        rank=rank,
        **collect_attachment_data(mechanism),
    )


def _compute_torque_slopes(tree: Mechanism, q: Array) -> TorqueSlopes:
    """Derivatives of the tree's efforts by place and rate at the probes."""
    probe = list_probe_rates(tree)
    if probe is None:
        return {}
    slopes = torque_derivatives(tree, q, *probe, passive=False)
    return {"torque_by_place": slopes.q, "torque_by_rate": slopes.qd}


def collect_attachment_data(mechanism: Mechanism) -> AttachmentData:
    """Return damping, friction, springs, closure points and axes of a mechanism: what is stated of them, nothing computed."""
    ends = [
        (f"{c.name}: {end}", c, at)
        for c in mechanism.closures
        if c.kind != "coupling"
        for end, at in (("first", c.first), ("second", c.second))
    ]
    springs = [(f"{s.name}: {key}", float(getattr(s, key))) for s in mechanism.springs for key in SPRING]
    springs += [
        (f"{j.name}: {key}", float(getattr(j, key))) for j in mechanism.joints if j.stiffness for key in SPRING[:2]
    ]
    return {
        "damping": {j.name: float(j.damping) for j in mechanism.joints if j.nv},
        "friction": {j.name: float(j.friction) for j in mechanism.joints if j.nv},
        "springs": dict(springs),
        "closure_points": {name: at.placement.position for name, _, at in ends},
        "closure_axes": {
            name: at.placement.rotation @ c.axis for name, c, at in ends if (c.kind, name.rsplit(": ")[-1]) in AXES
        },
    }


def _build_flexible_certificate(mechanism: Mechanism) -> Certificate:
    """Mass and stiffness of beams; masses, moments and inertias of what joints, and sections of beams, carry."""
    lumps = _collect_lumps(mechanism)
    straight = {x.name: x.beam for x in mechanism.beams if x.beam is not None and not x.beam.curvature.any()}
    return Certificate(
        mass=_compute_moving_mass(mechanism),
        masses={name: sum(part[0] for part in parts) for name, parts in lumps.items()},
        moments={name: np.sum([part[1] for part in parts], axis=0) for name, parts in lumps.items()},
        inertias={name: np.sum([part[2] for part in parts], axis=0) for name, parts in lumps.items()},
        beam_masses={name: _integrate_beam_mass(beam) for name, beam in straight.items()},
        beam_moments={name: _integrate_beam_mass(beam, 1) for name, beam in straight.items()},
        stiffness=compute_beam_stiffness(mechanism),
        part_stiffness=_collect_part_values(mechanism, _compute_part_stiffness),
        part_frequencies=_collect_part_values(mechanism, _compute_part_frequencies),
    )


def _collect_part_values(
    mechanism: Mechanism, compute: Callable[[str, MeshedPart], dict[str, float]]
) -> dict[str, float]:
    """Values of all meshed links, computed of each by its name and part."""
    found = [compute(link.name, link.part) for link in mechanism.meshed if link.part is not None]
    return {key: value for values in found for key, value in values.items()}


def _compute_part_stiffness(name: str, part: MeshedPart) -> dict[str, float]:
    """Load over motion of the frame of every moved interface, 1 / (W K^-1 W^T)_ii of its motions W by amplitudes."""
    reduced = find_reduction(part)
    out: dict[str, float] = {}
    for number, one in enumerate(part.moved):
        moves = np.vstack([reduced.moves[number], reduced.turns[number]])
        compliance = (moves**2 / reduced.modal_stiffness).sum(axis=1)
        out |= {
            f"{name}: {one.name} {axis}": float(1.0 / c) for axis, c in zip(INTERFACE_AXES, compliance, strict=True)
        }
    return out


def _compute_part_frequencies(name: str, part: MeshedPart) -> dict[str, float]:
    """Frequencies held at the root, and of the shapes with rigid motions beside them held nowhere [Hz], with twice the modes."""
    try:
        reduced = find_reduction(replace(part, modes=TIMES_MODES * part.modes))
    except InputError:  # so many modes it does not have
        return {}
    return {
        f"{name}: {way} {k + 1}": float(frequency)
        for way, frequencies in (("held", reduced.frequency), ("free", reduced.compute_free_frequencies()))
        for k, frequency in enumerate(frequencies[:COMPARED_MODES])
    }


def _collect_lumps(mechanism: Mechanism) -> dict[str, list[tuple[float, Array, Array]]]:
    """Mass, first moment and tensor [kg], [kg m], [kg m^2] of every body, by what carries it and in that frame."""
    carriers = find_carriers(mechanism)
    lumps: dict[str, list[tuple[float, Array, Array]]] = {}
    for link in mechanism.links:
        for body in link.bodies:
            name, place = carriers[link.name]
            if link.beam is not None:
                name, place = _find_section(link.name, link.beam, body.station or 0.0, (name, place))
            if link.part is not None and body.interface:
                name, place = _find_interface(link.name, link.part, body.interface, (name, place))
            turned = _apply_placement(place, Placement(body.inertia.com, np.eye(3)))
            tensor = turned.rotation @ body.inertia.tensor @ turned.rotation.T
            second = move_inertia_to_origin(body.inertia.mass, turned.position, tensor)
            lumps.setdefault(name, []).append((body.inertia.mass, *second))
        if link.part is not None:
            name, place = carriers[link.name]
            lumps.setdefault(name, []).append(_compute_part_weight(link.part, place))
            for one in link.part.moved:
                lumps.setdefault(f"{link.name} at {one.name}", []).append((0.0, np.zeros(3), np.zeros((3, 3))))
    return lumps


def _compute_part_weight(part: MeshedPart, place: Placement) -> tuple[float, Array, Array]:
    """Mass, first moment and inertia of an undeformed mesh about the origin of the frame that carries its link."""
    reduced = find_reduction(part)
    at = place.position + reduced.points @ place.rotation.T
    weights = np.asarray(reduced.mass.sum(axis=0)).ravel()
    second = at.T @ (reduced.mass @ at)
    return float(weights.sum()), weights @ at, np.trace(second) * np.eye(3) - second


def _find_interface(link: str, part: MeshedPart, name: str, carrier: tuple[str, Placement]) -> tuple[str, Placement]:
    """The frame of an interface and the pose in it: its own, but at the root that of what carries the link."""
    if name != part.root:
        return f"{link} at {name}", Placement()
    return carrier[0], _apply_placement(carrier[1], Placement(part.interface_of[name].origin))


def _find_section(link: str, beam: Beam, station: float, carrier: tuple[str, Placement]) -> tuple[str, Placement]:
    """The frame of a cross-section and the pose in it: its own, but at the root that of what carries the link."""
    if station:
        return f"{link} at {station:g}", Placement()
    name, place = carrier
    return name, _apply_placement(place, beam.placement)


def find_carriers(mechanism: Mechanism) -> dict[str, tuple[str, Placement]]:
    """Return by link the joint, or the place on a beam, that carries it, and its pose in that frame."""
    carriers: dict[str, tuple[str, Placement]] = {WORLD: ("world", Placement())}
    for joint in mechanism.joints:
        name, place = carriers[joint.parent]
        beam = None if joint.parent == WORLD else mechanism.link_of[joint.parent].beam
        part = None if joint.parent == WORLD else mechanism.link_of[joint.parent].part
        if part is not None and joint.interface:
            name, place = _find_interface(joint.parent, part, joint.interface, (name, place))
        if beam is not None and joint.station is not None:
            name, place = _find_section(joint.parent, beam, joint.station, (name, place))
        carriers[joint.child] = (
            (joint.name, Placement()) if joint.nv else (name, _apply_placement(place, joint.placement))
        )
    return carriers


def _apply_placement(outer: Placement, inner: Placement) -> Placement:
    return Placement(outer.position + outer.rotation @ inner.position, outer.rotation @ inner.rotation)


def _compute_lumped_inertia(
    mesh: Mesh, motion: NodalMotion, joint: str, bodies: list[tuple[str, Body]]
) -> tuple[Array, Array]:
    """First moment and tensor of bodies about the origin of a joint's child, along its axes."""
    at = mesh.joint_node[joint]
    origin = motion.x[0, at]
    axes = motion.rotation[0, at]
    moment = np.zeros(3)
    tensor = np.zeros((3, 3))
    for link, body in bodies:
        node = mesh.body_node[link, body.name]
        turn = axes.T @ motion.rotation[0, node]
        m, i = move_inertia_to_origin(
            body.inertia.mass, axes.T @ (motion.x[0, node] - origin), turn @ body.inertia.tensor @ turn.T
        )
        moment = moment + m
        tensor = tensor + i
    return moment, tensor


def _compute_gravity_and_mass(tree: Mechanism, q: Array) -> tuple[Array, Array]:
    """Return g = tau(q, 0, 0) (configurations, nv) [N m], [N], and tau(q, 0, e_j) - g (configurations, nv, nv) [kg m^2], [kg].

    One call for all of them: a mechanism that is asked once takes longer to prepare than to be asked.
    """
    units = np.concatenate([np.zeros((1, tree.nv)), np.eye(tree.nv)])
    many = np.tile(q, (len(units), 1))
    accelerations = np.repeat(units, len(q), axis=0)
    efforts = joint_torques(tree, many, np.zeros_like(accelerations), accelerations, passive=False, threads=1)
    gravity, *columns = efforts.reshape(len(units), len(q), tree.nv)
    matrix = np.stack([column - gravity for column in columns], axis=2) if columns else np.zeros((len(q), 0, 0))
    return gravity, matrix


def _find_moving_links(tree: Mechanism) -> set[str]:
    """Links that are not welded to the world."""
    still = {WORLD}
    for joint in tree.joints:
        if joint.nv == 0 and joint.parent in still:
            still.add(joint.child)
    return {link.name for link in tree.links} - still


def _compute_joint_axes(tree: Mechanism, nodes: dict[str, int], motion: NodalMotion) -> dict[str, Array]:
    """Axes of joints with one coordinate: the child's frame turns about it, so that it is the same in both frames."""
    return {j.name: motion.rotation[:, nodes[j.name]] @ j.axis for j in tree.joints if j.nv == 1}


def _compute_closure_rank(mechanism: Mechanism, case: Case) -> int:
    """Rank of the closures' Jacobian at the start of the case (of those that act then)."""
    solution = solve(mechanism, case.motion, case.sample, end=case.sample, start=case.start)
    mesh = build(mechanism)
    first = slice(0, 1)
    motion = compute_rigid_motion(mesh, solution.q[first], solution.qd[first], solution.qdd[first])
    rows = build_constraint_rows(mesh)
    acts = np.array([not c.active or c.active[0][0] <= 0.0 for c in mechanism.closures])
    g = compute_constraint_jacobian(mesh, motion, rows)[0][acts[rows.closure]]
    return int(count_ranks(np.linalg.svd(g, compute_uv=False)))


def _compute_moving_mass(mechanism: Mechanism) -> float:
    """Mass of all bodies and beams that move [kg]."""
    moving = _find_moving_links(mechanism)
    links = [link for link in mechanism.links if link.name in moving]
    bodies = sum(body.inertia.mass for link in links for body in link.bodies)
    meshes = sum(float(find_reduction(link.part).mass.sum()) for link in links if link.part is not None)
    return bodies + meshes + sum(_integrate_beam_mass(link.beam) for link in links if link.beam is not None)


def _integrate_beam_mass(beam: Beam, power: int = 0) -> float:
    """Return int rho A s^power ds along a straight beam [kg], [kg m]."""
    s = beam.section
    along = (
        np.interp(_make_quadrature_points(), s.stations, s.mass_per_length)
        * (beam.length * _make_quadrature_points()) ** power
    )
    return beam.length * float(along.mean())


def compute_beam_stiffness(mechanism: Mechanism) -> dict[str, float]:
    """Return length over compliance, 1 / mean(1 / stiffness), of every straight beam: EA, GJ, EI_y, EI_z [N], [N m^2].

    Of a coupled section it is that of each strain under its own stress alone, from the diagonal of C^-1.
    """
    beam_stiffness = {}
    for link in mechanism.beams:
        assert link.beam is not None
        section = link.beam.section
        for name, column in {"EA": 0, "GA_y": 1, "GA_z": 2, "GJ": 3, "EI_y": 4, "EI_z": 5}.items():
            if section.has_coupled_strains:
                compliance = _evaluate_compliance(section)[:, column]
                beam_stiffness[f"{link.name}: {name}"] = float(1.0 / np.mean(compliance))
                continue
            along = np.interp(_make_quadrature_points(), section.stations, section.stiffness[:, column])
            beam_stiffness[f"{link.name}: {name}"] = float(1.0 / np.mean(1.0 / along))
    return beam_stiffness


def _evaluate_compliance(section: Section) -> Array:
    """Diagonals of C^-1 along a beam, (points, 6) [1/N], [1/(N m^2)]."""
    table = section.stiffness_matrices.reshape(-1, 36)
    along = np.column_stack([np.interp(_make_quadrature_points(), section.stations, column) for column in table.T])
    return np.asarray(np.diagonal(np.linalg.inv(along.reshape(-1, 6, 6)), axis1=1, axis2=2))


def _make_quadrature_points() -> Array:
    return np.asarray((np.arange(AMONG) + 0.5) / AMONG, dtype=np.float64)
