"""Static probes of Exudyn's beams: one beam of the mechanism alone, clamped, pulled, twisted, bent and sheared at its end.

    EA = N L / u_x      GJ = M_x L / phi_x      EI_y = M_y L / phi_y      EI_z = M_z L / phi_z
    GA_y = Q_y L / u_y, GA_z = Q_z L / u_z      of the same beam, made RIGID times as stiff in bending: shear alone is left

The same elements, sections and integration as in the engine's runs, half as many of them; loads that strain by 1e-4 and
turn by 1e-3 rad, so that what is not linear is 1e-6 of the answer.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import exudyn as exu
import numpy as np
import scipy  # its parts are loaded when they are asked for
from exudyn.itemInterface import Force, MarkerNodeRigid, Torque

from crosscheck.engines.exudyn.models import planar as exudyn_planar
from crosscheck.engines.exudyn.models import spatial as exudyn_spatial
from crosscheck.engines.exudyn.models.frames import Array, build_frame_along
from crosscheck.engines.exudyn.models.layout import build_layout
from crosscheck.engines.exudyn.run_in_time import ANCF, build_start_layout
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import WORLD, Beam, Joint, Link, Mechanism, Placement

OUT = exu.OutputVariableType
# [-], [rad]
STRAIN = 1e-4
TURN = 1e-3
ELEMENTS = 8
# Bending adds GA L^2 / (3 EI) of the shear, up to 1e5 of slender beams: a part of 1e-5 is left of it.
RIGID = 1e10
AXES = {"EA": 0, "GA_y": 1, "GA_z": 2, "GJ": 0, "EI_y": 1, "EI_z": 2}
COLUMNS = {"EA": 0, "GA_y": 1, "GA_z": 2, "GJ": 3, "EI_y": 4, "EI_z": 5}
PUSHED = ("EA", "GA_y", "GA_z")  # by a force; the others are turned by a moment
Drawing = exudyn_planar.Drawing | exudyn_spatial.Drawing


def compute_probe_stiffness(mechanism: Mechanism, case: Case, engine: str) -> dict[str, float]:
    """Return the stiffness of every straight beam from static probes: EA, GA_y, GA_z [N], GJ, EI_y, EI_z [N m^2].

    ``ANCFCable2D`` has no shear; in a plane EA, one shear and one bending stiffness can be asked for.
    """
    layout = build_start_layout(mechanism, case)
    plane = exudyn_planar.find_plane(mechanism, layout)
    probe_stiffness: dict[str, float] = {}
    for link in mechanism.beams:
        beam = link.beam
        if beam is None or beam.curvature.any():
            continue
        normal = (
            None
            if isinstance(plane, str)
            else layout.compute_start_pose(layout.root[link.name]).rotation.T @ plane[:, 2]
        )
        for name in _list_stiffness_names(engine, normal):
            probe_stiffness[f"{link.name}: {name}"] = _compute_stiffness(beam, name, engine, normal)
    return probe_stiffness


def _list_stiffness_names(engine: str, normal: Array | None) -> tuple[str, ...]:
    """Return the names of the stiffnesses to probe in space, or in a plane with this normal (section axes)."""
    if normal is None:
        return tuple(COLUMNS)
    bending, shear = {1: ("EI_y", "GA_z"), 2: ("EI_z", "GA_y")}[int(np.argmax(np.abs(normal)))]
    return ("EA", bending) if engine == ANCF else ("EA", bending, shear)


def _compute_stiffness(beam: Beam, name: str, engine: str, normal: Array | None) -> float:
    """Return one stiffness of one beam [N] or [N m^2]."""
    d = _build_clamped_beam(_make_stiff_beam(beam) if name.startswith("GA") else beam, engine, normal)
    mbs = d.model.mbs
    tip = d.model.beam["beam"][-1]
    guess = float(np.mean(beam.section.stiffness[:, COLUMNS[name]]))
    axis = np.eye(3)[AXES[name]]
    size = guess * STRAIN if name in PUSHED else guess * TURN / beam.length
    turned = d.plane.T @ axis if isinstance(d, exudyn_planar.Drawing) else axis
    marker = mbs.AddMarker(MarkerNodeRigid(nodeNumber=tip))
    kind = Force if name in PUSHED else Torque
    mbs.AddLoad(kind(markerNumber=marker, loadVector=list(size * turned)))
    mbs.Assemble()
    mbs.SolveStatic(_build_static_settings())
    shift, turn = (
        _read_planar_displacement(d, tip)
        if isinstance(d, exudyn_planar.Drawing)
        else _read_spatial_displacement(mbs, tip)
    )
    return size * beam.length / float(turned @ (shift if name in PUSHED else turn))


def _make_stiff_beam(beam: Beam) -> Beam:
    """Return a beam that hardly bends."""
    stiffness = beam.section.stiffness.copy()
    stiffness[:, 4:] *= RIGID
    return replace(beam, section=replace(beam.section, stiffness=stiffness))


def _build_clamped_beam(beam: Beam, engine: str, normal: Array | None) -> Drawing:
    """Return the engine's model of one beam, clamped to the world."""
    alone = Mechanism(
        "probe",
        (Link("beam", beam=replace(beam, placement=Placement())),),
        (Joint("clamp", "fixed", WORLD, "beam"),),
        gravity=np.zeros(3),
    )
    layout = build_layout(alone, np.zeros(0), np.zeros(0))
    if normal is None:
        return exudyn_spatial.build(alone, layout, engine == ANCF, ELEMENTS)
    return exudyn_planar.build(alone, layout, build_frame_along(normal)[:, [1, 2, 0]], engine == ANCF, ELEMENTS)


def _build_static_settings() -> exu.SimulationSettings:
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.staticSolver.newton.relativeTolerance = settings.staticSolver.newton.absoluteTolerance = 1e-9
    settings.staticSolver.newton.residualMode = 1
    settings.staticSolver.newton.useModifiedNewton = False
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    return settings


def _read_planar_displacement(drawing: exudyn_planar.Drawing, node: Any) -> tuple[Array, Array]:
    """Return the displacement (3,) [m] and rotation (3,) [rad] of a node of the plane, along the plane's axes."""
    u = np.array(drawing.model.mbs.GetNodeOutput(node, OUT.Coordinates))
    along = drawing.plane.T @ np.eye(3)[0]
    turn = u[2] if len(u) == 3 else along[0] * u[3] - along[1] * u[2]  # a cable's slope instead of an angle
    return np.array([*u[:2], 0.0]), np.array([0.0, 0.0, turn])


def _read_spatial_displacement(mbs: Any, node: Any) -> tuple[Array, Array]:
    """Return the displacement (3,) [m] and rotation (3,) [rad] of a node in space, along the world's axes."""
    turn = np.array(mbs.GetNodeOutput(node, OUT.RotationMatrix)).reshape(3, 3)
    rotation = scipy.spatial.transform.Rotation.from_matrix(turn)
    return np.array(mbs.GetNodeOutput(node, OUT.Displacement)), rotation.as_rotvec()
