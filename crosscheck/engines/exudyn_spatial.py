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

from crosscheck.engines import exudyn_closing
from crosscheck.engines.exudyn_frames import (
    Array,
    compose,
    frame_along,
    joint_pose,
    joint_q,
    scalar_coordinate,
    tait_bryan,
    to_quaternion,
)
from crosscheck.engines.exudyn_layout import Frame, Layout, Mesh, mesh
from crosscheck.engines.exudyn_parts import Model, Outcome, Poses, empty, homogeneous, weigh
from crosscheck.engines.exudyn_solve import Driver, Key, Plan, Sensors, Table, solve
from flexinv.mechanism import WORLD, Beam, Closure, Joint, Mechanism, Placement

OUT = exu.OutputVariableType
MOMENT_SIGNS = np.array([-1.0, 1.0, 1.0])
LOCKED = [1, 1, 1, 1, 1, 1]


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

    def child(self, joint: str) -> int:
        """Return the group that a joint carries."""
        return next(k for k, g in enumerate(self.layout.groups) if g.joint == joint)


def unsupported(mechanism: Mechanism) -> str | None:
    """Return why a mechanism cannot be modelled in space, or None."""
    for joint in mechanism.joints:
        if joint.kind == "free" and joint.parent != WORLD:
            return f"joint {joint.name}: Exudyn's offset of a held position is along world axes, its parent moves"
    for link in mechanism.beams:
        if link.beam is not None and link.beam.curvature.any():
            return f"{link.name} is curved: both of Exudyn's beams in space are straight without stress"
    return None


def damping_left_out(mechanism: Mechanism) -> str | None:
    """Return why ``BeamGeometricallyExact`` is not the beam that is meant, or None (``ANCFBeam`` applies its damping)."""
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
    d = Drawing(mechanism, layout, ancf, elements, empty(), free, held)
    for index in range(1, len(layout.groups)):
        _add_body(d, index)
    for link in mechanism.beams:
        assert link.beam is not None
        _add_beam(d, link.name, link.beam)
    for joint in mechanism.joints:
        if joint.nv:
            _add_joint(d, joint)
    for closure in mechanism.closures:
        _add_closure(d, closure)
    exudyn_closing.load(d.model, mechanism, layout, lambda frame: _marker(d, frame), lambda force: np.eye(3))
    d.model.mbs.Assemble()
    return d


def _add_body(d: Drawing, index: int) -> None:
    """Add the body of a group: reference point at its centre of mass, axes along the group's frame."""
    group, mbs, inertia = d.layout.groups[index], d.model.mbs, d.layout.groups[index].inertia
    arm = group.start.rotation @ inertia.com
    velocity = group.velocity + np.cross(group.spin, arm)
    node = _rigid_node(Placement(group.start.position + arm, group.start.rotation), velocity, group.spin)
    d.model.node[index] = mbs.AddNode(node)
    t = inertia.tensor
    six = [t[0, 0], t[1, 1], t[2, 2], t[1, 2], t[0, 2], t[0, 1]]
    body = ObjectRigidBody(mass=inertia.mass, inertia=six, nodeNumber=d.model.node[index])
    d.model.body[index] = mbs.AddObject(body)
    weigh(d.model, d.model.body[index], d.mechanism.gravity)


def _rigid_node(pose: Placement, velocity: Array, spin: Array) -> Any:
    """Return a node with Euler parameters e; e' = 1/2 (0, w) e with w in the world (quaternion product)."""
    e = to_quaternion(pose.rotation)
    rate = 0.5 * np.array([-spin @ e[1:], *(e[0] * spin + np.cross(spin, e[1:]))])
    return NodeRigidBodyEP(referenceCoordinates=[*pose.position, *e], initialVelocities=[*velocity, *rate])


def _marker(d: Drawing, frame: Frame) -> Any:
    """Return a marker with the position and the orientation of a frame on its group's body or on the ground."""
    centre = d.layout.groups[frame.group].inertia.com if frame.group else np.zeros(3)
    local = frame.placement.position - centre
    number = d.model.body[frame.group] if frame.group else d.model.ground
    ht = homogeneous(local, frame.placement.rotation)
    return d.model.mbs.AddMarker(MarkerBodyRigid(bodyNumber=number, localHT=ht))


def _axes(joint: Joint) -> Array:
    """Return the frame (3, 3) of a joint's markers in the child's frame: x along the axis, y near the second one."""
    return frame_along(joint.axis, joint.second_axis if joint.kind == "universal" else None)


def _add_joint(d: Drawing, joint: Joint) -> None:
    if joint.name in d.free:
        _add_free_joint(d, joint)
        return
    mbs, seat, child = d.model.mbs, d.layout.joint[joint.name], d.child(joint.name)
    axes = Placement(np.zeros(3), _axes(joint))
    start = _relative(d, seat, child)
    markers = [
        _marker(d, Frame(seat.group, compose(start, axes))),
        _marker(d, Frame(child, axes)),
    ]
    slides = joint.kind == "prismatic"
    held = [0, 1, 1, 1, 1, 1] if slides else LOCKED
    objects = [mbs.AddObject(ObjectJointGeneric(markerNumbers=markers, constrainedAxes=held))]
    if slides:
        objects.append(mbs.AddObject(ObjectJointGeneric(markerNumbers=markers, constrainedAxes=[1, 0, 0, 0, 0, 0])))
    d.model.joint[joint.name] = tuple(objects)


def _ends(d: Drawing, one: Joint | Closure) -> tuple[Frame, Frame]:
    """Return the frames of the two markers of a joint without a driver or of a closure."""
    zero, axes = exudyn_closing.marker_axes(one)
    if isinstance(one, Closure):
        return exudyn_closing.frame_of(d.layout, one.first, zero), exudyn_closing.frame_of(d.layout, one.second, axes)
    seat = d.layout.joint[one.name]
    turned = Frame(seat.group, compose(seat.placement, Placement(np.zeros(3), zero)))
    return turned, Frame(d.child(one.name), Placement(np.zeros(3), axes))


def _add_free_joint(d: Drawing, joint: Joint) -> None:
    held = exudyn_closing.HELD[joint.kind]
    markers = [_marker(d, end) for end in _ends(d, joint)]
    made = ObjectJointGeneric(markerNumbers=markers, constrainedAxes=list(held))
    d.model.joint[joint.name] = (d.model.mbs.AddObject(made),) if any(held) else ()


def _add_closure(d: Drawing, closure: Closure) -> None:
    markers = [_marker(d, end) for end in _ends(d, closure)]
    made = ObjectJointGeneric(markerNumbers=markers, constrainedAxes=list(d.held[closure.name]))
    d.model.closure[closure.name] = d.model.mbs.AddObject(made)


def _relative(d: Drawing, seat: Frame, child: int) -> Placement:
    """Return the child's pose in its parent group's frame at the start."""
    parent, own = d.layout.groups[seat.group].start, d.layout.groups[child].start
    turned = parent.rotation.T
    return Placement(turned @ (own.position - parent.position), turned @ own.rotation)


def _add_beam(d: Drawing, name: str, beam: Beam) -> None:
    mbs, root = d.model.mbs, d.layout.root[name]
    cells = mesh(beam, d.layout.stations[name], d.elements)
    nodes = [mbs.AddNode(_beam_node(d, root, pose)) for pose in cells.pose]
    d.model.beam[name] = nodes
    elements = [mbs.AddObject(_element(d, cells, nodes, k)) for k in range(len(cells.lengths))]
    if d.ancf:
        _weigh_nodes(d, cells, nodes)
    else:
        for element in elements:
            weigh(d.model, element, d.mechanism.gravity)
    d.model.lock[name] = _lock(d, _marker(d, root), nodes[0])
    for index, group in enumerate(d.layout.groups):
        if group.station is not None and group.station[0] == name:
            _lock(d, _marker(d, Frame(index, Placement())), nodes[cells.node(group.station[1])])


def _beam_node(d: Drawing, root: Frame, pose: Placement) -> Any:
    carrier = d.layout.groups[root.group]
    at = compose(d.layout.start(root), pose)
    velocity = carrier.velocity + np.cross(carrier.spin, at.position - carrier.start.position)
    if not d.ancf:
        return _rigid_node(at, velocity, carrier.spin)
    slopes = at.rotation[:, 1:].T  # (slope, xyz)
    rates = np.cross(carrier.spin, slopes)
    return NodePointSlope23(
        referenceCoordinates=[*at.position, *slopes.ravel()], initialVelocities=[*velocity, *rates.ravel()]
    )


def _element(d: Drawing, cells: Mesh, nodes: list[Any], k: int) -> Any:
    stiffness, mass, rotary = cells.sections[k]
    section = exu.BeamSection()
    section.stiffnessMatrix = np.diag(stiffness)
    section.dampingMatrix = np.diag(cells.damping[k])
    section.massPerLength = mass
    section.inertia = rotary[0] / 2 * np.diag([4.0, 1.0, 1.0]) if d.ancf else np.diag(rotary)
    kind = ObjectANCFBeam if d.ancf else ObjectBeamGeometricallyExact
    return kind(nodeNumbers=nodes[k : k + 2], length=cells.lengths[k], sectionData=section)


def _weigh_nodes(d: Drawing, cells: Mesh, nodes: list[Any]) -> None:
    """Put half of the weight of each element on each of its nodes: the consistent load of linear shape functions."""
    halves = np.array([mass * length / 2 for (_, mass, _), length in zip(cells.sections, cells.lengths, strict=True)])
    for node, mass in zip(nodes, np.append(halves, 0.0) + np.append(0.0, halves), strict=True):
        marker = d.model.mbs.AddMarker(MarkerNodePosition(nodeNumber=node))
        d.model.mbs.AddLoad(Force(markerNumber=marker, loadVector=list(mass * d.mechanism.gravity)))


def _lock(d: Drawing, marker: Any, node: Any) -> Any:
    """Hold a node's position and orientation to a frame that is turned as the node is at the start."""
    markers = [marker, d.model.mbs.AddMarker(MarkerNodeRigid(nodeNumber=node))]
    return d.model.mbs.AddObject(ObjectJointGeneric(markerNumbers=markers, constrainedAxes=LOCKED))


def run(d: Drawing, plan: Plan, q: Array) -> Outcome:
    """Integrate and return what moved and what it took.  q : (steps + 1, nq), the motion at every step."""
    moving = [j for j in d.mechanism.joints if j.nv]
    for joint in moving:
        if joint.name in d.free:
            continue
        own = joint_q(d.mechanism, joint, q)
        for number, rows in zip(d.model.joint[joint.name], _offsets(d, joint, own), strict=True):
            d.model.drivers.append(Driver(number, _user_function(plan, rows)))
    seen = solve(d.model.mbs, plan, d.model.drivers, *_sensors(d), d.model.loads)
    pose = {index: _pose(d, index, seen) for index in range(len(d.layout.groups))}
    return Outcome(
        pose=pose,
        end={name: seen["end", name] for name in d.model.beam},
        wrench={j.name: _wrench(d, j, pose, seen) for j in moving},
        root={name: -seen["lock", name] for name in d.model.lock},
        closure={c.name: _reaction(d, c, pose, seen) for c in d.mechanism.closures},
    )


def _offsets(d: Drawing, joint: Joint, q: Array) -> list[Array]:
    """Return the offsets (steps + 1, 6) [m], [rad] of each of a joint's connectors, zero at the start."""
    p, r = joint_pose(joint, q)
    axes = _axes(joint)
    angles = tait_bryan(axes.T @ r[0].T @ r @ axes)
    if joint.kind == "prismatic":
        slide = scalar_coordinate(joint, q)
        return [np.zeros((len(q), 6)), np.pad((slide - slide[0])[:, None], ((0, 0), (0, 5)))]
    seat = d.layout.start(d.layout.joint[joint.name])
    return [np.hstack([(p - p[0]) @ seat.rotation.T, angles])]


def _user_function(plan: Plan, values: Array) -> Any:
    table = Table(plan.step, values)
    return lambda mbs, t, item, parameters: list(table(t))


def _sensors(d: Drawing) -> tuple[Sensors, Sensors]:
    """Return the sensors of motions and of reactions, by what they see and whose it is."""
    add = d.model.mbs.AddSensor
    motions: Sensors = {}
    for index, body in d.model.body.items():
        at = {"bodyNumber": body, "localPosition": list(-d.layout.groups[index].inertia.com), "storeInternal": True}
        motions["position", index] = add(SensorBody(outputVariableType=OUT.Position, **at))
        motions["rotation", index] = add(SensorBody(outputVariableType=OUT.RotationMatrix, **at))
    for name, nodes in d.model.beam.items():
        end = SensorNode(nodeNumber=nodes[-1], outputVariableType=OUT.Position, storeInternal=True)
        motions["end", name] = add(end)
    items: dict[Key, Any] = {("lock", name): (number, OUT.ForceLocal) for name, number in d.model.lock.items()}
    for name, numbers in d.model.joint.items():
        items |= {("force", name, k): (number, OUT.ForceLocal) for k, number in enumerate(numbers)}
        if numbers:
            items["moment", name] = (numbers[0], OUT.TorqueLocal)
    for name, number in d.model.closure.items():
        items |= {("force", name, 0): (number, OUT.ForceLocal), ("moment", name): (number, OUT.TorqueLocal)}
    reactions = {
        k: add(SensorObject(objectNumber=n, outputVariableType=v, storeInternal=True)) for k, (n, v) in items.items()
    }
    return motions, reactions


def _pose(d: Drawing, index: int, seen: dict[Key, Array]) -> Poses:
    samples = len(next(iter(seen.values())))
    if index == 0:
        return np.zeros((samples, 3)), np.tile(np.eye(3), (samples, 1, 1))
    return seen["position", index], seen["rotation", index].reshape(samples, 3, 3)


def _wrench(d: Drawing, joint: Joint, pose: dict[int, Poses], seen: dict[Key, Array]) -> Array:
    """Return force [N] and moment [N m] on the child at the joint in the child's frame, (samples, 6)."""
    if joint.name in d.free:
        return _reaction(d, joint, pose, seen)
    seat, child = d.layout.joint[joint.name], d.child(joint.name)
    axes = _axes(joint)
    force = -sum(seen["force", joint.name, k] for k in range(len(d.model.joint[joint.name])))
    marker = pose[seat.group][1] @ _relative(d, seat, child).rotation @ axes
    to_child = np.swapaxes(pose[child][1], 1, 2) @ marker
    moment = MOMENT_SIGNS * seen["moment", joint.name]
    return np.hstack([np.einsum("sij,sj->si", to_child, force), moment @ axes.T])  # (sample, component)


def _reaction(d: Drawing, one: Joint | Closure, pose: dict[int, Poses], seen: dict[Key, Array]) -> Array:
    """Return what a joint without a driver or a closure puts on its second frame, along that frame's axes, (samples, 6)."""
    first, second = (pose[end.group][1] @ end.placement.rotation for end in _ends(d, one))
    if ("moment", one.name) not in seen:
        return np.zeros((len(first), 6))
    held = d.held.get(one.name, exudyn_closing.HELD[one.kind])
    wrench = exudyn_closing.wrench_of(held, seen["force", one.name, 0], seen["moment", one.name], first, second)
    own = second @ exudyn_closing.marker_axes(one)[1].T
    return np.hstack([np.einsum("sji,sj->si", own, part) for part in (wrench[:, :3], wrench[:, 3:])])
