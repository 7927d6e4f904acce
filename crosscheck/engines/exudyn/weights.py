"""Weights of Exudyn's models in time: masses, first moments and inertias from the engine's own mass matrix.

With t_k the unit translation along axis k and r_k the places of all nodes along it (slopes of ANCF nodes included),

    mass = t^T M t      m c_k = t_k^T M r_k      J = G M_rot G^T / 16   (Euler parameters, M_rot = G^T J G, G G^T = 4 1)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import exudyn as exu
import numpy as np

from crosscheck.engines.exudyn.models import planar as exudyn_planar
from crosscheck.engines.exudyn.models import spatial as exudyn_spatial
from crosscheck.engines.exudyn.models.frames import Array
from crosscheck.engines.exudyn.models.layout import Group
from crosscheck.engines.exudyn.models.meshes import compute_weight
from crosscheck.engines.exudyn.run_in_time import ANCF, build_start_layout
from crosscheck.engines.shared.probe_states import move_inertia_to_origin
from crosscheck.measures.certificate import Certificate
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism

ELEMENTS = 8
Drawing = exudyn_planar.Drawing | exudyn_spatial.Drawing
# Coordinates of a node that are lengths along the first axis, by how many it has; those along the others follow.
ALONG = {3: (0,), 4: (0, 2), 7: (0,), 9: (0, 3, 6)}


@dataclass(frozen=True)
class Weights:
    """The mass matrix (coordinates, coordinates) of a model where it starts, and the coordinates there."""

    matrix: Array
    start: Array


def build_weight_certificate(mechanism: Mechanism, case: Case, engine: str) -> Certificate:
    """Return masses [kg], first moments [kg m] and inertias [kg m^2] of what joints and beams carry, and of beams."""
    tree = replace(mechanism, closures=(), springs=(), forces=())
    layout = build_start_layout(mechanism, case)  # of the whole: the motion need not give joints that closures move
    plane = exudyn_planar.find_plane(tree, layout)
    d: Drawing
    if isinstance(plane, str):
        d = exudyn_spatial.build(tree, layout, engine == ANCF, ELEMENTS)
    else:
        d = exudyn_planar.build(tree, layout, plane, engine == ANCF, ELEMENTS)
    scales = _assemble_mass_matrix(d)
    groups = {_format_group_name(layout.groups[k]): (k, node) for k, node in d.model.node.items() if k}
    masses = {name: _compute_mass(d, scales, [node]) for name, (_, node) in groups.items()}
    beams = {name: _compute_mass(d, scales, nodes) for name, nodes in d.model.beam.items()}
    lumps = {}
    if isinstance(d, exudyn_spatial.Drawing):  # a plane model knows one of three moments
        lumps = {name: _compute_group_inertia(d, scales, k, node) for name, (k, node) in groups.items()}
    for name, (mass, moment, tensor) in _compute_mesh_weights(d).items():
        masses[name] += mass
        lumps[name] = lumps[name][0] + moment, lumps[name][1] + tensor
    return Certificate(
        mass=sum(masses.values()) + sum(beams.values()),
        masses=masses,
        moments={name: moment for name, (moment, _) in lumps.items()},
        inertias={name: tensor for name, (_, tensor) in lumps.items()},
        beam_masses=beams,
        beam_moments={name: _compute_beam_moment(d, scales, name) for name in beams},
    )


def _compute_mesh_weights(drawing: Drawing) -> dict[str, tuple[float, Array, Array]]:
    """Mass, first moment and inertia of meshed links about the frames of the groups that carry them, by group."""
    found = {}
    for link in drawing.mechanism.meshed:
        assert link.part is not None
        frame = drawing.layout.link[link.name]
        if frame.group:
            found[_format_group_name(drawing.layout.groups[frame.group])] = compute_weight(link.part, frame.placement)
    return found


def _format_group_name(group: Group) -> str:
    if group.interface is not None:
        return "{} at {}".format(*group.interface)
    return group.joint if group.joint is not None else "{} at {:g}".format(*group.station or ("", 0.0))


def _assemble_mass_matrix(drawing: Drawing) -> Weights:
    mbs = drawing.model.mbs
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    solver: Any = exu.MainSolverStatic()
    solver.InitializeSolver(mbs, settings)
    solver.ComputeMassMatrix(mbs, 1.0)
    matrix = np.array(solver.GetSystemMassMatrix())
    solver.FinalizeSolver(mbs, settings)
    return Weights(matrix, np.array(mbs.systemData.GetODE2Coordinates(exu.ConfigurationType.Reference)))


def _compute_mass(drawing: Drawing, scales: Weights, nodes: list[int]) -> float:
    at = [drawing.model.mbs.GetNodeODE2Index(node) for node in nodes]
    return float(scales.matrix[np.ix_(at, at)].sum())


def _compute_beam_moment(drawing: Drawing, scales: Weights, beam: str) -> float:
    """First moment of a beam about its root, along its axis [kg m]."""
    nodes = drawing.model.beam[beam]
    mbs = drawing.model.mbs
    at = np.array([mbs.GetNodeODE2Index(node) for node in nodes])
    flat = isinstance(drawing, exudyn_planar.Drawing)
    size = len(mbs.GetNode(nodes[0])["referenceCoordinates"])
    lengths = np.concatenate([at + k for k in ALONG[size]])
    root = drawing.layout.compute_start_pose(drawing.layout.root[beam])
    axes = drawing.plane.T if isinstance(drawing, exudyn_planar.Drawing) else np.eye(3)
    moment = np.zeros(3)
    for k in range(2 if flat else 3):
        rows = scales.matrix[np.ix_(at + k, lengths + k)]
        moment[k] = (rows @ scales.start[lengths + k]).sum()
    mass = float(scales.matrix[np.ix_(at, at)].sum())
    return float((axes @ root.rotation[:, 0]) @ (moment - mass * (axes @ root.position)))


def _compute_group_inertia(
    drawing: exudyn_spatial.Drawing, scales: Weights, group: int, node: int
) -> tuple[Array, Array]:
    """First moment and inertia about the origin of a group's frame, along its axes."""
    at = drawing.model.mbs.GetNodeODE2Index(node)
    start = drawing.layout.groups[group].start
    e0, e1, e2, e3 = scales.start[at + 3 : at + 7]
    g = 2.0 * np.array([[-e1, e0, e3, -e2], [-e2, -e3, e0, e1], [-e3, e2, -e1, e0]])
    turns = slice(at + 3, at + 7)
    tensor = g @ scales.matrix[turns, turns] @ g.T / 16.0
    com = start.rotation.T @ (scales.start[at : at + 3] - start.position)
    return move_inertia_to_origin(float(scales.matrix[at, at]), com, tensor)
