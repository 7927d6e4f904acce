"""Planar mechanisms with beams in Exudyn: 2-D bodies, ``ANCFCable2D`` or ``BeamGeometricallyExact2D`` (3 nodes).

Conventions, as a map and its dual.

    plane         x_world = P x with P = (e1, e2, n), n along the joint axes; bodies start at angle 0, so that every
                  coordinate of the engine is the change since the start
    coordinate    angle of child - angle of parent = s (q - q_0), s = axis . n: ``ObjectConnectorCoordinate`` between
                  the rotation coordinates, position by ``ObjectJointRevolute2D`` (both know velocities: index 2 works)
    tau           s times the moment on the child = -s Force of the coordinate connector
    wrench        force on the child = -Force of the revolute joint (world axes of the plane)
    root lock     ``ObjectJointGeneric`` (1, 1, 0, 0, 0, 1): force on the beam = -ForceLocal (root axes)

``ANCFCable2D`` is a Bernoulli-Euler beam: no shear, no rotary inertia; its strains are relative to the reference.
Source: exudyn 1.13.6, measured against a rigid rod in tests/crosscheck/engines/exudyn/test_beams.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, TypedDict

import exudyn as exu
import numpy as np
from exudyn.itemInterface import (
    MarkerBodyRigid,
    MarkerNodeCoordinate,
    MarkerNodeRigid,
    NodePoint2DSlope1,
    NodePointGround,
    NodeRigidBody2D,
    ObjectANCFCable2D,
    ObjectBeamGeometricallyExact2D,
    ObjectConnectorCoordinate,
    ObjectJointGeneric,
    ObjectRigidBody2D,
    SensorNode,
    SensorObject,
)

from crosscheck.engines.exudyn.integration import Begin, Driver, Key, Plan, Sensors, Table, integrate
from crosscheck.engines.exudyn.models import connectors as exudyn_closing
from crosscheck.engines.exudyn.models import planar_connectors as exudyn_flat
from crosscheck.engines.exudyn.models.frames import (
    Array,
    build_frame_along,
    compose,
    compute_scalar_coordinate,
    take_joint_q,
    turn,
)
from crosscheck.engines.exudyn.models.layout import Frame, Layout, Mesh, build_mesh, find_attachment_frame
from crosscheck.engines.exudyn.models.parts import Model, Outcome, add_gravity, build_pose_matrix, make_empty_model
from flexinv.model.mechanism import Beam, Closure, Force, Joint, Mechanism, Placement

OUT = exu.OutputVariableType
Z = np.array([0.0, 0.0, 1.0])
# Directions and heights come from files with some 9 digits; what is off by less is meant to be in the plane.
IN_PLANE = 1e-9
# Kinds of joints that a driver moves in the plane, and those that closures may move there.
DRIVEN_IN_PLANE = ("revolute", "continuous")
FREE_IN_PLANE = (*DRIVEN_IN_PLANE, "prismatic")


def find_plane(mechanism: Mechanism, layout: Layout, free: frozenset[str] = frozenset()) -> Array | str:
    """Return P (3, 3) [-] whose third column is the normal of the plane, or why the mechanism is not planar.

    Planar means a mirror: everything is its own image in one plane, so nothing leaves it and no reaction does.
    free : joints without a driver, which closures move: they may slide in the plane
    """
    moving = [joint for joint in mechanism.joints if joint.nv]
    for joint in moving:
        if joint.kind not in (FREE_IN_PLANE if joint.name in free else DRIVEN_IN_PLANE):
            return f"joint {joint.name} is {joint.kind}"
    axes = {j.name: layout.compute_start_pose(layout.joint[j.name]).rotation @ j.axis for j in moving}
    normal = next((axes[j.name] for j in moving if j.kind != "prismatic"), None)
    if normal is None:
        return "no joint moves" if not moving else "no joint turns"
    reason = (
        _describe_leaning_axis(mechanism, layout, axes, normal)
        or _describe_asymmetry(mechanism, layout, normal)
        or exudyn_closing.describe_leaning_force(mechanism, layout, normal, IN_PLANE)
        or _describe_height_offsets(mechanism, layout, normal)
    )
    return reason or build_frame_along(normal)[:, [1, 2, 0]]


def _describe_leaning_axis(
    mechanism: Mechanism, layout: Layout, axes: Mapping[str, Array], normal: Array
) -> str | None:
    """Return the joint, the gravity or the closure that leans to the plane, in words, or None; axes : by joint, world [-]."""
    for name, axis in axes.items():
        if reason := exudyn_flat.describe_leaning_axis(mechanism.joint_of[name], axis, normal, IN_PLANE):
            return reason
    if abs(mechanism.gravity @ normal) > IN_PLANE * np.linalg.norm(mechanism.gravity):
        return "gravity leans out of the plane"
    for closure in mechanism.closures:
        for at in (closure.first, closure.second):
            axis = layout.compute_start_pose(find_attachment_frame(layout, at)).rotation @ closure.axis
            if reason := exudyn_flat.describe_leaning_axis(closure, axis, normal, IN_PLANE):
                return reason
    return None


def _describe_asymmetry(mechanism: Mechanism, layout: Layout, normal: Array) -> str | None:
    """Return the section or inertia that is not its own mirror image, in words, or None."""
    if mechanism.meshed:
        return f"{mechanism.meshed[0].name} is a mesh"
    for link in mechanism.beams:
        assert link.beam is not None
        local = layout.compute_start_pose(layout.root[link.name]).rotation.T @ normal  # (xyz of the section)
        if np.abs(local).max() < 1.0 - IN_PLANE or abs(local[0]) > IN_PLANE:
            return f"no principal axis of the section of {link.name} is normal to the plane"
        if np.abs(link.beam.curvature - local * (link.beam.curvature @ local)).max() > IN_PLANE:
            return f"{link.name} is curved or twisted out of the plane"
    for group in layout.groups[1:]:
        turned = group.start.rotation @ group.inertia.tensor @ group.start.rotation.T @ normal
        if np.linalg.norm(np.cross(turned, normal)) > IN_PLANE * np.linalg.norm(group.inertia.tensor):
            return f"the inertia of what {group.joint or group.station} carries leans out of the plane"
    return None


def _describe_height_offsets(mechanism: Mechanism, layout: Layout, normal: Array) -> str | None:
    """Return that joints, beams and masses lie at different heights over the plane, or None."""
    points = [layout.compute_start_pose(f).position for f in [*layout.joint.values(), *layout.root.values()]]
    points += exudyn_closing.list_attachment_points(mechanism, layout)
    points += [g.start.position + g.start.rotation @ g.inertia.com for g in layout.groups[1:] if g.inertia.mass]
    if np.ptp(np.array(points) @ normal) > IN_PLANE * np.linalg.norm(points, axis=1).max():
        return "joints, beams and masses lie at different heights over the plane"
    return None


@dataclass(frozen=True)
class Drawing:
    """A planar model: layout, plane P, cable or geometrically exact, number of elements, and the engine's system.

    free : joints without a driver, which closures move, where they start [rad], [m]
    """

    mechanism: Mechanism
    layout: Layout
    plane: Array
    cable: bool
    elements: int
    model: Model
    free: Mapping[str, float]

    def convert_frame_to_plane(self, frame: Frame) -> tuple[Array, float]:
        """Return position (3,) [m] and angle of the x axis [rad] of a frame in the plane, at the start."""
        return self.convert_pose_to_plane(self.layout.compute_start_pose(frame))

    def convert_pose_to_plane(self, pose: Placement) -> tuple[Array, float]:
        """Return position (3,) [m] with zero height and angle of the x axis [rad] of a pose in the plane."""
        p = self.plane.T @ pose.position * (1, 1, 0)
        x = self.plane.T @ pose.rotation[:, 0]
        return p, float(np.arctan2(x[1], x[0]))


def build(
    mechanism: Mechanism,
    layout: Layout,
    plane: Array,
    cable: bool,
    elements: int,
    free: Mapping[str, float] = MappingProxyType({}),
) -> Drawing:
    """Return an assembled planar system; the drivers wait for their motion.

    free : joints without a driver, which closures move, where they start [rad], [m]
    """
    d = Drawing(mechanism, layout, plane, cable, elements, make_empty_model(), free)
    zero = d.model.mbs.AddNode(NodePointGround())
    d.model.node[0] = zero
    for index in range(1, len(layout.groups)):
        _add_body(d, index)
    for link in mechanism.beams:
        assert link.beam is not None
        _add_beam(d, link.name, link.beam)
    for joint in mechanism.joints:
        if joint.nv:
            _add_joint(d, joint)
    for closure in mechanism.closures:
        d.model.closure[closure.name] = _add_connector(d, closure)
    exudyn_closing.add_loads(
        d.model, mechanism, layout, lambda frame: _add_marker(d, frame), lambda force: _compute_load_axes(d, force)
    )
    d.model.mbs.Assemble()
    return d


def _compute_load_axes(drawing: Drawing, force: Force) -> Array:
    """Return the rotation from the table of a force to the axes of its load: those of the plane, or of its marker."""
    if not force.follower:
        return drawing.plane.T
    frame = exudyn_closing.compute_marker_frame(drawing.layout, force.at, np.eye(3))
    return np.asarray(
        turn(Z, -drawing.convert_frame_to_plane(frame)[1])
        @ drawing.plane.T
        @ drawing.layout.compute_start_pose(frame).rotation
    )


def _add_body(drawing: Drawing, index: int) -> None:
    """Add the body of a group: reference point at its centre of mass, angle 0 at the start."""
    group = drawing.layout.groups[index]
    mbs = drawing.model.mbs
    centre = _compute_mass_centre(drawing, index)
    arm = drawing.plane.T @ group.start.rotation @ group.inertia.com
    spin = float(drawing.plane.T[2] @ group.spin)
    velocity = drawing.plane.T @ group.velocity + spin * np.cross(Z, arm)
    normal = group.start.rotation.T @ drawing.plane[:, 2]
    inertia = float(normal @ group.inertia.tensor @ normal)
    node = NodeRigidBody2D(referenceCoordinates=[*centre[:2], 0.0], initialVelocities=[*velocity[:2], spin])
    drawing.model.node[index] = mbs.AddNode(node)
    body = ObjectRigidBody2D(mass=group.inertia.mass, inertia=inertia, nodeNumber=drawing.model.node[index])
    drawing.model.body[index] = mbs.AddObject(body)
    add_gravity(drawing.model, drawing.model.body[index], drawing.plane.T @ drawing.mechanism.gravity * (1, 1, 0))


def _compute_mass_centre(drawing: Drawing, index: int) -> Array:
    group = drawing.layout.groups[index]
    return drawing.convert_pose_to_plane(Placement(group.start.position + group.start.rotation @ group.inertia.com))[0]


def _add_marker(drawing: Drawing, frame: Frame) -> Any:
    """Return a marker with the position and the orientation of a frame on its group's body or on the ground."""
    at, angle = drawing.convert_frame_to_plane(frame)
    local = at - (_compute_mass_centre(drawing, frame.group) if frame.group else np.zeros(3))
    number = drawing.model.body[frame.group] if frame.group else drawing.model.ground
    return drawing.model.mbs.AddMarker(
        MarkerBodyRigid(bodyNumber=number, localHT=build_pose_matrix(local, turn(Z, angle)))
    )


def _add_connector(drawing: Drawing, one: Joint | Closure) -> Any:
    markers = [
        _add_marker(drawing, end) for end in exudyn_flat.compute_marker_frames(drawing.layout, one, drawing.plane[:, 2])
    ]
    return exudyn_flat.add_connector(drawing.model.mbs, one.kind, markers)


def _add_joint(drawing: Drawing, joint: Joint) -> None:
    mbs = drawing.model.mbs
    name = joint.name
    seat = drawing.layout.joint[joint.name]
    child = next(k for k, g in enumerate(drawing.layout.groups) if g.joint == name)
    pin = _add_connector(drawing, joint)
    angles = [
        mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=drawing.model.node[k], coordinate=2 if k else 0))
        for k in (seat.group, child)
    ]
    if name in drawing.free:
        drawing.model.joint[name] = (pin,)
        if drawing.mechanism.beams:  # where all is rigid, these efforts follow from the motion afterwards
            exudyn_flat.add_spring_damper(mbs, joint, angles, compute_axis_sign(drawing, joint), drawing.free[name])
        return
    motor = mbs.AddObject(ObjectConnectorCoordinate(markerNumbers=angles))
    drawing.model.joint[name] = (pin, motor)


def _add_beam(drawing: Drawing, name: str, beam: Beam) -> None:
    mbs = drawing.model.mbs
    root = drawing.layout.root[name]
    cells = build_mesh(beam, drawing.layout.stations[name], drawing.elements, 2 if drawing.cable else 3)
    nodes = [mbs.AddNode(_make_node(drawing, root, pose)) for pose in cells.pose]
    drawing.model.beam[name] = nodes
    for k in range(len(cells.lengths)):
        number = mbs.AddObject(_make_element(drawing, root, beam, cells, nodes, k))
        add_gravity(drawing.model, number, drawing.plane.T @ drawing.mechanism.gravity * (1, 1, 0))
    drawing.model.lock[name] = _add_lock(drawing, _add_marker(drawing, root), nodes[0])
    for index, group in enumerate(drawing.layout.groups):
        if group.station is not None and group.station[0] == name:
            _add_lock(
                drawing, _add_marker(drawing, Frame(index, Placement())), nodes[cells.find_node(group.station[1])]
            )


def _make_node(drawing: Drawing, root: Frame, pose: Placement) -> Any:
    at, angle = drawing.convert_pose_to_plane(compose(drawing.layout.compute_start_pose(root), pose))
    carrier = drawing.layout.groups[root.group]
    spin = float(drawing.plane.T[2] @ carrier.spin)
    velocity = drawing.plane.T @ carrier.velocity + spin * np.cross(
        Z, at - drawing.convert_pose_to_plane(carrier.start)[0]
    )
    tangent = turn(Z, angle)[:2, 0]
    if drawing.cable:
        rate = spin * np.array([-tangent[1], tangent[0]])
        return NodePoint2DSlope1(referenceCoordinates=[*at[:2], *tangent], initialVelocities=[*velocity[:2], *rate])
    return NodeRigidBody2D(referenceCoordinates=[*at[:2], angle], initialVelocities=[*velocity[:2], spin])


class BeamNumbers(TypedDict):
    """Numbers of an element in the plane, as Exudyn's elements call them [m], [kg/m], [N m^2], [N], [N m^2 s], [N s]."""

    length: float
    massPerLength: float
    bendingStiffness: float
    axialStiffness: float
    bendingDamping: float
    axialDamping: float


def _make_element(drawing: Drawing, root: Frame, beam: Beam, cells: Mesh, nodes: list[Any], k: int) -> Any:
    """Return element k: bending about the section axis that is normal to the plane, shear along the other."""
    stiffness, mass, rotary = cells.sections[k]
    damping = cells.damping[k]
    normal = drawing.layout.compute_start_pose(root).rotation.T @ drawing.plane[:, 2]
    about = int(np.argmax(np.abs(normal)))  # 1: y, 2: z
    common: BeamNumbers = {
        "length": cells.lengths[k],
        "massPerLength": mass,
        "bendingStiffness": stiffness[3 + about],
        "axialStiffness": stiffness[0],
        "bendingDamping": damping[3 + about],
        "axialDamping": damping[0],
    }
    if drawing.cable:
        # Reduced integration 2: Lobatto and Gauss points that avoid membrane locking.
        return ObjectANCFCable2D(
            nodeNumbers=nodes[k : k + 2], **common, useReducedOrderIntegration=2, strainIsRelativeToReference=1.0
        )
    return ObjectBeamGeometricallyExact2D(
        nodeNumbers=nodes[2 * k : 2 * k + 3],
        crossSectionInertia=rotary[about],
        shearStiffness=stiffness[3 - about],
        shearDamping=damping[3 - about],
        referenceCurvature=float(beam.curvature @ normal),
        includeReferenceRotations=True,
        **common,
    )


def _add_lock(drawing: Drawing, marker: Any, node: Any) -> Any:
    """Hold a node's position and angle to a frame that is turned as the node is at the start."""
    markers = [marker, drawing.model.mbs.AddMarker(MarkerNodeRigid(nodeNumber=node))]
    return drawing.model.mbs.AddObject(ObjectJointGeneric(markerNumbers=markers, constrainedAxes=[1, 1, 0, 0, 0, 1]))


def run(drawing: Drawing, plan: Plan, q: Array, qd: Array, begin: Begin | None = None) -> Outcome:
    """Integrate and return what moved and what it took.

    q, qd : (steps + 1, nq) and (steps + 1, nv), the motion at every step; more rows where the run begins after the layout's start
    begin : puts the system where it begins, if not at the layout's start
    """
    steps = plan.steps + 1
    moving = [j for j in drawing.mechanism.joints if j.nv]
    for joint in moving:
        if joint.name in drawing.free:
            continue
        sign = compute_axis_sign(drawing, joint)
        angle = sign * compute_scalar_coordinate(joint, take_joint_q(drawing.mechanism, joint, q))
        rate = sign * qd[:, drawing.mechanism.v_slices[joint.name]][:, 0]
        offset = _make_user_function(plan, (angle - angle[0])[-steps:])
        offset_t = _make_user_function(plan, rate[-steps:])
        drawing.model.drivers.append(Driver(drawing.model.joint[joint.name][1], offset, offset_t))
    seen = integrate(drawing.model.mbs, plan, drawing.model.drivers, *add_sensors(drawing), drawing.model.loads, begin)
    pose = {index: _compute_group_poses(drawing, index, seen) for index in range(len(drawing.layout.groups))}
    return Outcome(
        pose=pose,
        end={
            name: convert_to_world(drawing, drawing.layout.root[name], seen["end", name]) for name in drawing.model.beam
        },
        wrench={j.name: _compute_joint_wrench(drawing, j, pose, seen) for j in moving},
        root={name: -seen["lock", name] for name in drawing.model.lock},
        closure={c.name: _compute_reaction(drawing, c, pose, seen) for c in drawing.mechanism.closures},
    )


def compute_axis_sign(drawing: Drawing, joint: Joint) -> float:
    """Return 1 or -1 [-]: how a joint's axis lies along the normal."""
    return float(
        drawing.plane[:, 2] @ drawing.layout.compute_start_pose(drawing.layout.joint[joint.name]).rotation @ joint.axis
    )


def _make_user_function(plan: Plan, values: Array) -> Any:
    table = Table(plan.step, values)
    return lambda mbs, t, item, offset: table(t)


def add_sensors(drawing: Drawing) -> tuple[Sensors, Sensors]:
    """Return the sensors of motions and of reactions, by what they see and whose it is."""
    add = drawing.model.mbs.AddSensor
    states: dict[Key, Any] = {
        ("pose", index): (drawing.model.node[index], OUT.Coordinates) for index in drawing.model.body
    }
    states |= {("end", name): (numbers[-1], OUT.Position) for name, numbers in drawing.model.beam.items()}
    items: dict[Key, Any] = {("lock", name): (number, OUT.ForceLocal) for name, number in drawing.model.lock.items()}
    for joint in drawing.mechanism.joints:
        if joint.nv:
            numbers = drawing.model.joint[joint.name]
            items |= _list_connector_outputs(joint, ("pin", joint.name), numbers[0])
            if len(numbers) > 1:
                items["motor", joint.name] = (numbers[1], OUT.Force)
    for closure in drawing.mechanism.closures:
        items |= _list_connector_outputs(closure, ("closure", closure.name), drawing.model.closure[closure.name])
    motions = {
        k: add(SensorNode(nodeNumber=n, outputVariableType=v, storeInternal=True)) for k, (n, v) in states.items()
    }
    reactions = {
        k: add(SensorObject(objectNumber=n, outputVariableType=v, storeInternal=True)) for k, (n, v) in items.items()
    }
    return motions, reactions


def _list_connector_outputs(one: Joint | Closure, key: Key, number: Any) -> dict[Key, Any]:
    """Return the forces that a connector has to be asked for, by the keys that `_compute_connector_wrench` looks up."""
    if one.kind in exudyn_flat.PINS:
        return {key: (number, OUT.Force)}
    return {key: (number, OUT.ForceLocal), (*key, "torque"): (number, OUT.TorqueLocal)}


def _compute_group_poses(drawing: Drawing, index: int, sensor_values: dict[Key, Array]) -> tuple[Array, Array]:
    """Return position (samples, 3) [m] and rotation (samples, 3, 3) [-] of a group's frame in the world."""
    group = drawing.layout.groups[index]
    if index == 0:
        samples = len(next(iter(sensor_values.values())))
        return np.zeros((samples, 3)), np.tile(np.eye(3), (samples, 1, 1))
    u = sensor_values["pose", index]
    centre = _compute_mass_centre(drawing, index)
    r = turn(Z, u[:, 2])
    flat = centre + u * (1, 1, 0) + r @ (drawing.convert_pose_to_plane(group.start)[0] - centre)
    position = flat @ drawing.plane.T + drawing.plane[:, 2] * (drawing.plane[:, 2] @ group.start.position)
    return position, drawing.plane @ r @ drawing.plane.T @ group.start.rotation


def convert_to_world(drawing: Drawing, root: Frame, flat: Array) -> Array:
    """Return points of the plane (samples, 3) in the world, at the height of a frame [m]."""
    return flat @ drawing.plane.T + drawing.plane[:, 2] * (
        drawing.plane[:, 2] @ drawing.layout.compute_start_pose(root).position
    )


def _compute_joint_wrench(
    drawing: Drawing, joint: Joint, pose: dict[int, tuple[Array, Array]], sensor_values: dict[Key, Array]
) -> Array:
    """Return force [N] and moment [N m] on the child at the joint in the child's frame, (samples, 6)."""
    both = _compute_connector_wrench(drawing, joint, ("pin", joint.name), pose, sensor_values)
    if joint.name not in drawing.free:
        both[:, 1] -= sensor_values["motor", joint.name] * drawing.plane[:, 2]
    child = next(k for k, g in enumerate(drawing.layout.groups) if g.joint == joint.name)
    return np.asarray(both @ pose[child][1]).reshape(len(both), 6)


def _compute_reaction(
    drawing: Drawing, closure: Closure, pose: dict[int, tuple[Array, Array]], sensor_values: dict[Key, Array]
) -> Array:
    """Return force [N] and moment [N m] on the second frame of a closure along its axes, (samples, 6)."""
    both = _compute_connector_wrench(drawing, closure, ("closure", closure.name), pose, sensor_values)
    second = find_attachment_frame(drawing.layout, closure.second)
    return np.asarray(both @ (pose[second.group][1] @ second.placement.rotation)).reshape(len(both), 6)


def _compute_connector_wrench(
    drawing: Drawing,
    one: Joint | Closure,
    key: Key,
    pose: dict[int, tuple[Array, Array]],
    sensor_values: dict[Key, Array],
) -> Array:
    """Return force [N] and moment [N m] of a connector on its second frame in the world, (samples, 2, 3)."""
    first = exudyn_flat.compute_marker_frames(drawing.layout, one, drawing.plane[:, 2])[0]
    axes = pose[first.group][1] @ first.placement.rotation
    return exudyn_flat.compute_wrench(
        one.kind, sensor_values[key], sensor_values.get((*key, "torque")), axes, drawing.plane
    ).reshape(-1, 2, 3)
