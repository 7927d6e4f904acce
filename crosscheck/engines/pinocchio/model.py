"""Pinocchio's model of a mechanism, from primary data or by its own URDF parser, and rnea on it: see `pinocchio.adapter`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from crosscheck.engines.shared.urdf_source import check_joints, read_source
from flexinv.model.mechanism import WORLD, Inertia, Joint, Mechanism, Placement

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BuiltModel:
    """Pinocchio's model of a mechanism and where everything is in it.

    q_order, v_order : the mechanism's coordinate k is the model's coordinate order[k]
    joint : Pinocchio's joint index and the placement of the child's frame there, by joint name (fixed joints have none)
    tip : joint index and point (3,) [m] in that joint's frame, by link name
    link : joint index and the link's frame there, by link name, the world (joint 0) included
    """

    model: Any
    q_order: NDArray[np.intp]
    v_order: NDArray[np.intp]
    joint: dict[str, tuple[int, Any]]
    tip: dict[str, tuple[int, Array]]
    link: dict[str, tuple[int, Any]]


def build(mechanism: Mechanism) -> BuiltModel:
    """Return Pinocchio's own model.  Raises ValueError where its URDF parser finds other joints than the mechanism."""
    model, at = _build_from_urdf(mechanism) if mechanism.urdf else _build_from_data(mechanism)
    model.gravity = pin.Motion(mechanism.gravity, np.zeros(3))
    moving = [j for j in mechanism.joints if j.nv]
    ids = {j.name: model.getJointId(_resolve_joint_name(mechanism, j)) for j in moving}
    for j in moving:
        first = model.joints[ids[j.name]].idx_v
        model.armature[first : first + j.nv] = j.rotor_inertia
    tip = {link.name: (at[link.name][0], at[link.name][1].act(link.tip)) for link in mechanism.links}
    return BuiltModel(
        model=model,
        q_order=_build_order([(model.joints[ids[j.name]].idx_q, j.nq) for j in moving]),
        v_order=_build_order([(model.joints[ids[j.name]].idx_v, j.nv) for j in moving]),
        joint={j.name: (ids[j.name], at[j.child][1]) for j in moving},
        tip=tip,
        link={WORLD: (0, pin.SE3.Identity())} | at,
    )


def _build_order(blocks: list[tuple[int, int]]) -> NDArray[np.intp]:
    return np.array([first + k for first, size in blocks for k in range(size)], dtype=np.intp)


def _resolve_joint_name(mechanism: Mechanism, joint: Joint) -> str:
    """Names of Pinocchio's parser: the free base that it adds to a URDF is its ``root_joint``."""
    return "root_joint" if mechanism.urdf and joint is mechanism.joints[0] and joint.kind == "free" else joint.name


def _build_from_data(mechanism: Mechanism) -> tuple[Any, dict[str, tuple[int, Any]]]:
    """Return the model and, for each link, the joint that carries it with the link frame's placement there."""
    model = pin.Model()
    at = {WORLD: (0, pin.SE3.Identity())}
    for joint in mechanism.joints:
        parent, frame = at[joint.parent]
        placement = frame * _convert_to_se3(joint.placement)
        if joint.kind == "fixed":
            at[joint.child] = (parent, placement)
        else:
            turn = _build_z_frame(joint) if joint.kind == "continuous" else pin.SE3.Identity()
            index = model.addJoint(parent, _make_joint_model(joint), placement * turn, joint.name)
            at[joint.child] = (index, turn.inverse())
        for body in mechanism.link_of[joint.child].bodies:
            model.appendBodyToJoint(at[joint.child][0], _convert_inertia(body.inertia), at[joint.child][1])
    return model, at


def _build_from_urdf(mechanism: Mechanism) -> tuple[Any, dict[str, tuple[int, Any]]]:
    """Return the model that Pinocchio's parser makes of the URDF, with the bodies that the mechanism lays over it."""
    base = [pin.JointModelFreeFlyer()] if mechanism.joints[0].kind == "free" else []
    source = read_source(mechanism)
    model = pin.buildModelFromXML(source.whole, *base)
    check_joints(mechanism, "Pinocchio", [n for n in list(model.names)[1:] if n != "root_joint"])
    at: dict[str, tuple[int, Any]] = {}
    for name, theirs in source.named.items():
        frame = model.frames[model.getFrameId(theirs, pin.FrameType.BODY)]
        at[name] = (frame.parentJoint, frame.placement)
    for name, body in source.overlays:
        model.appendBodyToJoint(at[name][0], _convert_inertia(body.inertia), at[name][1])
    return model, at


def _convert_to_se3(placement: Placement) -> Any:
    return pin.SE3(placement.rotation, placement.position)


def _build_z_frame(joint: Joint) -> Any:
    """A: the frame whose z axis is the joint's axis."""
    return pin.SE3(pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), joint.axis).matrix(), np.zeros(3))


def _convert_inertia(inertia: Inertia) -> Any:
    """Pinocchio's body.  Its constructor refuses moments below 0, rounding of a thin rod's among them; its parser takes them."""
    body = pin.Inertia(inertia.mass, inertia.com, np.zeros((3, 3)))
    body.inertia = inertia.tensor
    return body


def _make_joint_model(joint: Joint) -> Any:
    match joint.kind:
        case "revolute":
            return pin.JointModelRevoluteUnaligned(joint.axis)
        case "continuous":
            return pin.JointModelRUBZ()
        case "prismatic":
            return pin.JointModelPrismaticUnaligned(joint.axis)
        case "helical":  # its pitch is the way per radian, the mechanism's the way per turn
            return pin.JointModelHelicalUnaligned(joint.axis, joint.pitch / (2 * np.pi))
        case "spherical":
            return pin.JointModelSpherical()
        case "universal":
            return pin.JointModelUniversal(joint.axis, joint.second_axis)
        case "free":
            return pin.JointModelFreeFlyer()
    raise ValueError(f"joint {joint.name!r}: no Pinocchio joint for kind {joint.kind!r}")


# ------------------------------------------------------------------------------------------------------ what it says


@dataclass(frozen=True)
class Dynamics:
    """Results of Pinocchio, in the mechanism's order.

    torque : (samples, nv) [N m] or [N], without damping and friction; wrench : (samples, 6) [N], [N m] by joint;
    tip : (samples, 3) [m] by link
    """

    torque: Array
    wrench: dict[str, Array]
    tip: dict[str, Array]


def convert_to_engine(built_model: BuiltModel, q: Array, qd: Array, qdd: Array) -> tuple[Array, Array, Array]:
    """Return q (samples, nq), v and a (samples, nv) [rad or m, s] in the order of Pinocchio's model."""
    engine = (
        np.empty((len(q), built_model.model.nq)),
        np.empty((len(q), built_model.model.nv)),
        np.empty((len(q), built_model.model.nv)),
    )
    for theirs, mine, order in zip(
        engine, (q, qd, qdd), (built_model.q_order, built_model.v_order, built_model.v_order), strict=True
    ):
        theirs[:, order] = mine
    return engine


def compute_inverse_dynamics(
    built_model: BuiltModel, q: Array, qd: Array, qdd: Array, external: Sequence[Any] = ()
) -> Dynamics:
    """Return rnea of every sample, q (samples, nq), qd and qdd (samples, nv) [rad or m, s] in the mechanism's order.

    external : per sample what acts from outside on every joint's body, [N], [N m] in that joint's frame (none: nothing)
    """
    model = built_model.model
    data = built_model.model.createData()
    engine = convert_to_engine(built_model, q, qd, qdd)
    torque = np.empty((len(q), model.nv))
    wrench = {name: np.empty((len(q), 6)) for name in built_model.joint}
    tip = {name: np.empty((len(q), 3)) for name in built_model.tip}
    for k, (qk, vk, ak) in enumerate(zip(*engine, strict=True)):
        torque[k] = pin.rnea(model, data, qk, vk, ak, *external[k : k + 1])
        for name, (index, frame) in built_model.joint.items():
            wrench[name][k] = frame.actInv(data.f[index]).vector
        pin.forwardKinematics(model, data, qk)
        for name, (index, point) in built_model.tip.items():
            tip[name][k] = data.oMi[index].act(point)
    return Dynamics(torque[:, built_model.v_order], wrench, tip)
