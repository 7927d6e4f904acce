"""Torques drive an arm of Exudyn's own beams: its joints are free, every drive a couple on the two bodies that it joins.

The planar model of `exudyn.planar` with all joints free.  A drive's effort tau > 0 turns the child up against the parent:
+s tau on the rotation of the child's body, -s tau on that of the body that carries the joint, s = axis . n.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from exudyn.itemInterface import LoadCoordinate, MarkerNodeCoordinate

from crosscheck.engines.exudyn.integration import Plan, Table, compute_step_size, integrate, quiet
from crosscheck.engines.exudyn.models import planar as exudyn_planar
from crosscheck.engines.exudyn.models.layout import build_layout
from crosscheck.engines.exudyn.models.planar import Drawing
from crosscheck.engines.exudyn.run_in_time import NEWTON
from crosscheck.engines.shared.replay import Array, DriveTorques
from flexinv.model.mechanism import Joint, Mechanism


def describe_refusal(mechanism: Mechanism, q: Array) -> str | None:
    """Return the reason why torques cannot drive this mechanism here, or None."""
    for joint in mechanism.joints:
        if joint.nv and (joint.kind != "revolute" or joint.rotor_inertia or joint.friction):
            return f"joint {joint.name}: replayed in Exudyn are revolute joints without rotor inertia and dry friction"
    if mechanism.gravity.any() or mechanism.closures or mechanism.springs or mechanism.forces:
        return (
            "replayed in Exudyn are open arms without gravity, springs between points and forces, which rest straight"
        )
    plane = exudyn_planar.find_plane(mechanism, build_layout(mechanism, q, np.zeros(mechanism.nv)))
    return plane if isinstance(plane, str) else None


def replay(
    mechanism: Mechanism, drive: DriveTorques, elements: int, step: float, cable: bool = False
) -> dict[str, Array]:
    """Return the paths of the beams' ends, by link (samples, 3) [m], at the times of the torque.

    elements : of every beam; step : of time at most [s]; the torque is linear between its samples
    cable : ``ANCFCable2D`` instead of ``BeamGeometricallyExact2D``
    """
    if reason := describe_refusal(mechanism, drive.q):
        raise ValueError(reason)
    layout = build_layout(mechanism, drive.q, np.zeros(mechanism.nv))
    plane = exudyn_planar.find_plane(mechanism, layout)
    assert not isinstance(plane, str)
    end = drive.spacing * (len(drive.torque) - 1)
    plan = Plan(
        end, compute_step_size(drive.spacing, step), drive.spacing, index2=True, spectral_radius=0.5, tolerance=NEWTON
    )
    start = {j.name: float(drive.q[mechanism.q_slices[j.name]][0]) for j in mechanism.joints if j.nv}
    with quiet():
        d = exudyn_planar.build(mechanism, layout, plane, cable, elements, start)
        _add_drive_loads(d, drive, plan)
        seen = integrate(d.model.mbs, plan, [], *exudyn_planar.add_sensors(d))
    return {name: exudyn_planar.convert_to_world(d, layout.root[name], seen["end", name]) for name in d.model.beam}


def _add_drive_loads(drawing: Drawing, drive: DriveTorques, plan: Plan) -> None:
    """Add the loads of all drives and assemble once more."""
    given = drive.spacing * np.arange(len(drive.torque))
    times = plan.step * np.arange(plan.steps + 1)
    driven = [joint for joint in drawing.mechanism.joints if joint.nv and joint.actuated]
    for joint, torque in zip(driven, drive.torque.T, strict=True):
        table = Table(plan.step, np.interp(times, given, torque)[:, None])
        sign = exudyn_planar.compute_axis_sign(drawing, joint)
        _add_load(drawing, _find_child_group(drawing, joint), table, sign)
        _add_load(drawing, drawing.layout.joint[joint.name].group, table, -sign)
    drawing.model.mbs.Assemble()


def _find_child_group(drawing: Drawing, joint: Joint) -> int:
    return next(k for k, group in enumerate(drawing.layout.groups) if group.joint == joint.name)


def _add_load(drawing: Drawing, group: int, table: Table, sign: float) -> None:
    if group == 0:  # the world
        return
    marker = drawing.model.mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=drawing.model.node[group], coordinate=2))
    drawing.model.mbs.AddLoad(
        LoadCoordinate(markerNumber=marker, load=1.0, loadUserFunction=_make_load_function(table, sign))
    )


def _make_load_function(table: Table, sign: float) -> Any:
    return lambda mbs, time, load: sign * float(table(time)[0])
