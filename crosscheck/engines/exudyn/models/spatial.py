"""Mechanisms in space in Exudyn: bodies with Euler parameters, ``ANCFBeam`` or ``BeamGeometricallyExact``.

Conventions, as a map and its dual.

    joint         ``ObjectJointGeneric`` with all six axes held; its offset turns marker 0 by Rx(a) Ry(b) Rz(c), so
                  every prescribed joint is one connector: marker 0 at the seat, turned as the child is at the start,
                  marker 1 on the child, x of both along the joint's axis.  Prismatic: x is held by a second connector.
                  Index 3 only: 1.13.6 has no offset at velocity level.
    wrench        force on the child = -ForceLocal, in the frame of marker 0 *without* the offset;
                  moment on the child = (-, +, +) TorqueLocal in the frame of marker 1: its components are the
                  multipliers of z0.y1, z0.x1, x0.y1, which turn about +x, -y, -z
    tau           the components of that wrench along the joint's partial velocities

What ``ANCFBeam`` of 1.13.6 does otherwise than its name says (read in CObjectANCFBeam.cpp, measured in the tests):
    rotary inertia  its mass matrix is W^T J W on the *sum* of the rates of the two slopes, W = diag(1/2, 1, 1), along
                    world axes whatever the direction of the beam.  With J = (rho I_x / 2) diag(4, 1, 1) it is
                    isotropic: right for the twist and, where rho I_y = rho I_z, for bending.
    start           the difference of the slopes has no mass, so the engine finds no initial accelerations and the
                    multipliers at t = 0 are 0 (``Plan.extrapolate``)
    weight          its load integral runs over 0..L instead of -L/2..L/2, so that a mass-proportional load acts on the
                    second node alone (the moment at the root is too large by 1 / elements); weights go on nodes here
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import exudyn as exu
import numpy as np
from exudyn.itemInterface import (
    Force,
    MarkerBodyRigid,
    MarkerNodePosition,
    MarkerNodeRigid,
    NodePointSlope23,
    NodeRigidBodyEP,
    ObjectANCFBeam,
    ObjectBeamGeometricallyExact,
    ObjectJointGeneric,
    ObjectRigidBody,
    SensorBody,
    SensorNode,
    SensorObject,
)

from crosscheck.engines.exudyn.integration import Begin, Driver, Key, Plan, Sensors, Table, integrate
from crosscheck.engines.exudyn.models import connectors as exudyn_closing
from crosscheck.engines.exudyn.models.frames import (
    Array,
    build_frame_along,
    can_slide,
    can_turn,
    compose,
    compute_joint_pose,
    convert_to_quaternion,
    convert_to_tait_bryan,
    take_joint_q,
)
from crosscheck.engines.exudyn.models.layout import Frame, Layout, Mesh, build_mesh
from crosscheck.engines.exudyn.models.meshes import add_part
from crosscheck.engines.exudyn.models.meshes import describe_refusal as describe_mesh_refusal
from crosscheck.engines.exudyn.models.parts import (
    Model,
    Outcome,
    Poses,
    add_gravity,
    build_pose_matrix,
    make_empty_model,
)
from flexinv.model.mechanism import WORLD, Beam, Closure, Joint, Mechanism, Placement
from flexinv.model.part import MeshedPart

OUT = exu.OutputVariableType
MOMENT_SIGNS = np.array([-1.0, 1.0, 1.0])
LOCKED = [1, 1, 1, 1, 1, 1]
# Axes held by the connectors of a joint with a motion, by whether it slides along its axis (x) and turns: a held position is
# offset along world axes where all three are held by one connector, and else its force is given in axes that turn with an angle.
CONNECTORS = {
    (False, True): [LOCKED],
    (True, False): [[0, 1, 1, 1, 1, 1], [1, 0, 0, 0, 0, 0]],
    (True, True): [[0, 0, 0, 1, 1, 1], [0, 1, 1, 0, 0, 0], [1, 0, 0, 0, 0, 0]],
}


@dataclass(frozen=True)
class Drawing:
    """A spatial model: layout, ANCF or geometrically exact, number of elements, and the engine's system.

    free : joints without a driver, which closures move; held : which of its six equations every closure keeps
    """

    mechanism: Mechanism
    layout: Layout
    ancf: bool
    elements: int
    model: Model
    free: frozenset[str] = frozenset()
    held: Mapping[str, list[int]] = field(default_factory=dict)

    def find_child_group(self, joint: str) -> int:
        """Return the group that a joint carries."""
        return next(k for k, g in enumerate(self.layout.groups) if g.joint == joint)


def describe_refusal(mechanism: Mechanism) -> str | None:
    """Return the reason why a mechanism cannot be modelled in space, or None."""
    for joint in mechanism.joints:
        if joint.kind == "free" and joint.parent != WORLD:
            return f"joint {joint.name}: Exudyn's offset of a held position is along world axes, its parent moves"
        if not joint.actuated and joint.kind not in exudyn_closing.HELD:
            return f"joint {joint.name}: no connector of Exudyn is a {joint.kind} joint without a drive"
    for link in mechanism.beams:
        if link.beam is not None and link.beam.curvature.any():
            return f"{link.name} is curved: both of Exudyn's beams in space are straight without stress"
    return describe_mesh_refusal(mechanism)


def describe_damping_loss(mechanism: Mechanism) -> str | None:
    """Return the reason why ``BeamGeometricallyExact`` is another beam, or None (``ANCFBeam`` applies its damping)."""
    for link in mechanism.beams:
        if link.beam is not None and link.beam.section.damping is not None and link.beam.section.damping.any():
            return f"{link.name} is damped: Exudyn's geometrically exact beam in space takes a damping matrix and leaves it out"
    return None


def build(
    mechanism: Mechanism,
    layout: Layout,
    ancf: bool,
    elements: int,
    free: frozenset[str] = frozenset(),
    held: Mapping[str, list[int]] = MappingProxyType({}),
) -> Drawing:
    """Return an assembled spatial system; the drivers wait for their motion.

    free : joints without a driver; held : which of its six equations [-] every closure keeps
    """
    d = Drawing(mechanism, layout, ancf, elements, make_empty_model(), free, held)
    for index in range(1, len(layout.groups)):
        _add_body(d, index)
    for link in mechanism.beams:
        assert link.beam is not None
        _add_beam(d, link.name, link.beam)
    for link in mechanism.meshed:
        assert link.part is not None
        _add_mesh(d, link.name, link.part)
    for joint in mechanism.joints:
        if joint.nv:
            _add_joint(d, joint)
    for closure in mechanism.closures:
        _add_closure(d, closure)
    exudyn_closing.add_loads(d.model, mechanism, layout, lambda frame: _add_marker(d, frame), lambda force: np.eye(3))
    d.model.mbs.Assemble()
    return d


def _add_body(drawing: Drawing, index: int) -> None:
    """Add the body of a group: reference point at its centre of mass, axes along the group's frame."""
    group = drawing.layout.groups[index]
    mbs = drawing.model.mbs
    inertia = drawing.layout.groups[index].inertia
    arm = group.start.rotation @ inertia.com
    velocity = group.velocity + np.cross(group.spin, arm)
    node = _make_rigid_node(Placement(group.start.position + arm, group.start.rotation), velocity, group.spin)
    drawing.model.node[index] = mbs.AddNode(node)
    t = inertia.tensor
    six = [t[0, 0], t[1, 1], t[2, 2], t[1, 2], t[0, 2], t[0, 1]]
    body = ObjectRigidBody(mass=inertia.mass, inertia=six, nodeNumber=drawing.model.node[index])
    drawing.model.body[index] = mbs.AddObject(body)
    add_gravity(drawing.model, drawing.model.body[index], drawing.mechanism.gravity)


def _make_rigid_node(pose: Placement, velocity: Array, spin: Array) -> Any:
    """Return a node with Euler parameters e; e' = 1/2 (0, w) e with w in the world (quaternion product)."""
    e = convert_to_quaternion(pose.rotation)
    rate = 0.5 * np.array([-spin @ e[1:], *(e[0] * spin + np.cross(spin, e[1:]))])
    return NodeRigidBodyEP(referenceCoordinates=[*pose.position, *e], initialVelocities=[*velocity, *rate])


def _add_marker(drawing: Drawing, frame: Frame) -> Any:
    """Return a marker with the position and the orientation of a frame on its group's body or on the ground."""
    centre = drawing.layout.groups[frame.group].inertia.com if frame.group else np.zeros(3)
    local = frame.placement.position - centre
    number = drawing.model.body[frame.group] if frame.group else drawing.model.ground
    ht = build_pose_matrix(local, frame.placement.rotation)
    return drawing.model.mbs.AddMarker(MarkerBodyRigid(bodyNumber=number, localHT=ht))


def _build_marker_axes(joint: Joint) -> Array:
    """Return the frame (3, 3) of a joint's markers in the child's frame: x along the axis, y near the second one."""
    return build_frame_along(joint.axis, joint.second_axis if joint.kind == "universal" else None)


def _add_joint(drawing: Drawing, joint: Joint) -> None:
    if joint.name in drawing.free:
        _add_free_joint(drawing, joint)
        return
    mbs = drawing.model.mbs
    seat = drawing.layout.joint[joint.name]
    child = drawing.find_child_group(joint.name)
    axes = Placement(np.zeros(3), _build_marker_axes(joint))
    start = _compute_relative_pose(drawing, seat, child)
    markers = [
        _add_marker(drawing, Frame(seat.group, compose(start, axes))),
        _add_marker(drawing, Frame(child, axes)),
    ]
    held = CONNECTORS[can_slide(joint), can_turn(joint)]
    objects = [mbs.AddObject(ObjectJointGeneric(markerNumbers=markers, constrainedAxes=axes)) for axes in held]
    drawing.model.joint[joint.name] = tuple(objects)


def _compute_marker_frames(drawing: Drawing, one: Joint | Closure) -> tuple[Frame, Frame]:
    """Return the frames of the two markers of a joint without a driver or of a closure."""
    zero, axes = exudyn_closing.compute_marker_axes(one)
    if isinstance(one, Closure):
        return exudyn_closing.compute_marker_frame(
            drawing.layout, one.first, zero
        ), exudyn_closing.compute_marker_frame(drawing.layout, one.second, axes)
    seat = drawing.layout.joint[one.name]
    turned = Frame(seat.group, compose(seat.placement, Placement(np.zeros(3), zero)))
    return turned, Frame(drawing.find_child_group(one.name), Placement(np.zeros(3), axes))


def _add_free_joint(drawing: Drawing, joint: Joint) -> None:
    held = exudyn_closing.HELD[joint.kind]
    markers = [_add_marker(drawing, end) for end in _compute_marker_frames(drawing, joint)]
    made = ObjectJointGeneric(markerNumbers=markers, constrainedAxes=list(held))
    drawing.model.joint[joint.name] = (drawing.model.mbs.AddObject(made),) if any(held) else ()


def _add_closure(drawing: Drawing, closure: Closure) -> None:
    markers = [_add_marker(drawing, end) for end in _compute_marker_frames(drawing, closure)]
    made = ObjectJointGeneric(markerNumbers=markers, constrainedAxes=list(drawing.held[closure.name]))
    drawing.model.closure[closure.name] = drawing.model.mbs.AddObject(made)


def _compute_relative_pose(drawing: Drawing, frame: Frame, child: int) -> Placement:
    """Return the child's pose in its parent group's frame at the start."""
    parent = drawing.layout.groups[frame.group].start
    start = drawing.layout.groups[child].start
    turned = parent.rotation.T
    return Placement(turned @ (start.position - parent.position), turned @ start.rotation)


def _add_beam(drawing: Drawing, name: str, beam: Beam) -> None:
    mbs = drawing.model.mbs
    root = drawing.layout.root[name]
    cells = build_mesh(beam, drawing.layout.stations[name], drawing.elements)
    nodes = [mbs.AddNode(_make_beam_node(drawing, root, pose)) for pose in cells.pose]
    drawing.model.beam[name] = nodes
    elements = [mbs.AddObject(_make_element(drawing, cells, nodes, k)) for k in range(len(cells.lengths))]
    if drawing.ancf:
        _add_node_weights(drawing, cells, nodes)
    else:
        for element in elements:
            add_gravity(drawing.model, element, drawing.mechanism.gravity)
    drawing.model.lock[name] = _add_lock(drawing, _add_marker(drawing, root), nodes[0])
    for index, group in enumerate(drawing.layout.groups):
        if group.station is not None and group.station[0] == name:
            _add_lock(
                drawing, _add_marker(drawing, Frame(index, Placement())), nodes[cells.find_node(group.station[1])]
            )


def _add_mesh(drawing: Drawing, name: str, part: MeshedPart) -> None:
    """Add a meshed link in a floating frame, and lock its interfaces to the groups that go with them."""
    mbs = drawing.model.mbs
    link = drawing.layout.link[name]
    carrier = drawing.layout.groups[link.group]
    start = drawing.layout.compute_start_pose(link)
    velocity = carrier.velocity + np.cross(carrier.spin, start.position - carrier.start.position)
    markers = add_part(mbs, part, start, velocity, carrier.spin, drawing.mechanism.gravity)
    for interface, marker in markers.items():
        held = [_add_marker(drawing, drawing.layout.interface[name, interface]), marker]
        mbs.AddObject(ObjectJointGeneric(markerNumbers=held, constrainedAxes=LOCKED))


def _make_beam_node(drawing: Drawing, root: Frame, pose: Placement) -> Any:
    carrier = drawing.layout.groups[root.group]
    at = compose(drawing.layout.compute_start_pose(root), pose)
    velocity = carrier.velocity + np.cross(carrier.spin, at.position - carrier.start.position)
    if not drawing.ancf:
        return _make_rigid_node(at, velocity, carrier.spin)
    slopes = at.rotation[:, 1:].T  # (slope, xyz)
    rates = np.cross(carrier.spin, slopes)
    return NodePointSlope23(
        referenceCoordinates=[*at.position, *slopes.ravel()], initialVelocities=[*velocity, *rates.ravel()]
    )


def _make_element(drawing: Drawing, cells: Mesh, nodes: list[Any], k: int) -> Any:
    stiffness, mass, rotary = cells.sections[k]
    section = exu.BeamSection()
    section.stiffnessMatrix = np.diag(stiffness)
    section.dampingMatrix = np.diag(cells.damping[k])
    section.massPerLength = mass
    section.inertia = rotary[0] / 2 * np.diag([4.0, 1.0, 1.0]) if drawing.ancf else np.diag(rotary)
    kind = ObjectANCFBeam if drawing.ancf else ObjectBeamGeometricallyExact
    return kind(nodeNumbers=nodes[k : k + 2], length=cells.lengths[k], sectionData=section)


def _add_node_weights(drawing: Drawing, cells: Mesh, nodes: list[Any]) -> None:
    """Put half of the weight of each element on each of its nodes: the consistent load of linear shape functions."""
    halves = np.array([mass * length / 2 for (_, mass, _), length in zip(cells.sections, cells.lengths, strict=True)])
    for node, mass in zip(nodes, np.append(halves, 0.0) + np.append(0.0, halves), strict=True):
        marker = drawing.model.mbs.AddMarker(MarkerNodePosition(nodeNumber=node))
        drawing.model.mbs.AddLoad(Force(markerNumber=marker, loadVector=list(mass * drawing.mechanism.gravity)))


def _add_lock(drawing: Drawing, marker: Any, node: Any) -> Any:
    """Hold a node's position and orientation to a frame that is turned as the node is at the start."""
    markers = [marker, drawing.model.mbs.AddMarker(MarkerNodeRigid(nodeNumber=node))]
    return drawing.model.mbs.AddObject(ObjectJointGeneric(markerNumbers=markers, constrainedAxes=LOCKED))


def run(drawing: Drawing, plan: Plan, q: Array, begin: Begin | None = None) -> Outcome:
    """Integrate and return what moved and what it took.

    q : (steps + 1, nq), the motion at every step; more rows where the run begins after the layout's start
    begin : puts the system where it begins, if not at the layout's start
    """
    moving = [j for j in drawing.mechanism.joints if j.nv]
    for joint in moving:
        if joint.name in drawing.free:
            continue
        joint_q = take_joint_q(drawing.mechanism, joint, q)
        for number, rows in zip(
            drawing.model.joint[joint.name], _compute_offsets(drawing, joint, joint_q), strict=True
        ):
            drawing.model.drivers.append(Driver(number, _make_user_function(plan, rows[-plan.steps - 1 :])))
    seen = integrate(drawing.model.mbs, plan, drawing.model.drivers, *_add_sensors(drawing), drawing.model.loads, begin)
    pose = {index: _compute_group_poses(drawing, index, seen) for index in range(len(drawing.layout.groups))}
    return Outcome(
        pose=pose,
        end={name: seen["end", name] for name in drawing.model.beam},
        wrench={j.name: _compute_joint_wrench(drawing, j, pose, seen) for j in moving},
        root={name: -seen["lock", name] for name in drawing.model.lock},
        closure={c.name: _compute_reaction(drawing, c, pose, seen) for c in drawing.mechanism.closures},
    )


def _compute_offsets(drawing: Drawing, joint: Joint, q: Array) -> list[Array]:
    """Return the offsets (steps + 1, 6) [m], [rad] of each of a joint's connectors, zero at the start."""
    p, r = compute_joint_pose(joint, q)
    axes = _build_marker_axes(joint)
    angles = convert_to_tait_bryan(axes.T @ r[0].T @ r @ axes)
    if can_slide(joint):
        slide = p @ joint.axis
        still = np.zeros((len(q), 6))
        turned = [np.pad(angles, ((0, 0), (3, 0)))] if can_turn(joint) else []
        return [*turned, still, np.pad((slide - slide[0])[:, None], ((0, 0), (0, 5)))]
    start_pose = drawing.layout.compute_start_pose(drawing.layout.joint[joint.name])
    return [np.hstack([(p - p[0]) @ start_pose.rotation.T, angles])]


def _make_user_function(plan: Plan, values: Array) -> Any:
    table = Table(plan.step, values)
    return lambda mbs, t, item, parameters: table(t)


def _add_sensors(drawing: Drawing) -> tuple[Sensors, Sensors]:
    """Return the sensors of motions and of reactions, by what they see and whose it is."""
    add = drawing.model.mbs.AddSensor
    motions: Sensors = {}
    for index, body in drawing.model.body.items():
        at = {
            "bodyNumber": body,
            "localPosition": list(-drawing.layout.groups[index].inertia.com),
            "storeInternal": True,
        }
        motions["position", index] = add(SensorBody(outputVariableType=OUT.Position, **at))
        motions["rotation", index] = add(SensorBody(outputVariableType=OUT.RotationMatrix, **at))
    for name, nodes in drawing.model.beam.items():
        end = SensorNode(nodeNumber=nodes[-1], outputVariableType=OUT.Position, storeInternal=True)
        motions["end", name] = add(end)
    items: dict[Key, Any] = {("lock", name): (number, OUT.ForceLocal) for name, number in drawing.model.lock.items()}
    for name, numbers in drawing.model.joint.items():
        items |= {("force", name, k): (number, OUT.ForceLocal) for k, number in enumerate(numbers)}
        if numbers:
            items["moment", name] = (numbers[0], OUT.TorqueLocal)
    for name, number in drawing.model.closure.items():
        items |= {("force", name, 0): (number, OUT.ForceLocal), ("moment", name): (number, OUT.TorqueLocal)}
    reactions = {
        k: add(SensorObject(objectNumber=n, outputVariableType=v, storeInternal=True)) for k, (n, v) in items.items()
    }
    return motions, reactions


def _compute_group_poses(d: Drawing, index: int, sensor_values: dict[Key, Array]) -> Poses:
    samples = len(next(iter(sensor_values.values())))
    if index == 0:
        return np.zeros((samples, 3)), np.tile(np.eye(3), (samples, 1, 1))
    return sensor_values["position", index], sensor_values["rotation", index].reshape(samples, 3, 3)


def _compute_joint_wrench(
    drawing: Drawing, joint: Joint, pose: dict[int, Poses], sensor_values: dict[Key, Array]
) -> Array:
    """Return force [N] and moment [N m] on the child at the joint in the child's frame, (samples, 6)."""
    if joint.name in drawing.free:
        return _compute_reaction(drawing, joint, pose, sensor_values)
    seat = drawing.layout.joint[joint.name]
    child = drawing.find_child_group(joint.name)
    axes = _build_marker_axes(joint)
    force = -sum(sensor_values["force", joint.name, k] for k in range(len(drawing.model.joint[joint.name])))
    marker = pose[seat.group][1] @ _compute_relative_pose(drawing, seat, child).rotation @ axes
    to_child = np.swapaxes(pose[child][1], 1, 2) @ marker
    moment = MOMENT_SIGNS * sensor_values["moment", joint.name]
    return np.hstack([np.einsum("sij,sj->si", to_child, force), moment @ axes.T])  # (sample, component)


def _compute_reaction(
    drawing: Drawing, one: Joint | Closure, pose: dict[int, Poses], sensor_values: dict[Key, Array]
) -> Array:
    """Return the wrench of a closure, or a joint without a driver, on its second frame, along its axes, (samples, 6)."""
    first, second = (pose[end.group][1] @ end.placement.rotation for end in _compute_marker_frames(drawing, one))
    if ("moment", one.name) not in sensor_values:
        return np.zeros((len(first), 6))
    held = drawing.held.get(one.name, exudyn_closing.HELD[one.kind])
    wrench = exudyn_closing.compute_connector_wrench(
        held, sensor_values["force", one.name, 0], sensor_values["moment", one.name], first, second
    )
    axes = second @ exudyn_closing.compute_marker_axes(one)[1].T
    return np.hstack([np.einsum("sji,sj->si", axes, part) for part in (wrench[:, :3], wrench[:, 3:])])
