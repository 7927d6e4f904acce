"""Joints of MuJoCo: how each kind is made up, and its coordinates and efforts as a map and its dual.

Conventions: R0, p0: placement of a free joint; R: rotation of its quaternion.

    coordinates   hinge, slide: the number itself.  continuous (cos, sin) -> angle atan2(sin, cos).  Universal: two
                  hinges of one body, R = exp(a1 q1) exp(a2 q2).  Quaternions x, y, z, w -> w, x, y, z.
                  Ball: angular velocity in the child's frame, as in the mechanism.
    helical       a hinge and behind it a slide on the same axis, of one body, in the ratio h = pitch / (2 pi):
                      qpos = (q, h q), qvel = (v, h v), qacc = (a, h a)        dual: tau = tau_hinge + h f_slide
                  (a joint equality would tie them by a soft force, which is zero where the motion keeps the ratio)
    free joint    qpos = (p0 + R0 p, R0 R): absolute in the world.  qvel = (linear in the WORLD, angular in the body):
                      v_mj = R0 R v            w_mj = w
                      a_mj = R0 R (v' + w x v) al_mj = w'     (v' is the rate of body components: hence the bias w x v)
                  dual, from equal power:
                      f    = (R0 R)^T f_mj     m    = m_mj

Source: mujoco 4.0.0; the tests compare with closed forms and with Pinocchio.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import scipy  # its parts are loaded when they are asked for
from numpy.typing import NDArray

from flexinv.model.mechanism import WORLD, Joint, Mechanism

Array = NDArray[np.float64]
HINGE = mujoco.mjtJoint.mjJNT_HINGE
SLIDE = mujoco.mjtJoint.mjJNT_SLIDE
TYPES = {
    "revolute": HINGE,
    "continuous": HINGE,
    "prismatic": SLIDE,
    "universal": HINGE,
    "helical": HINGE,
    "spherical": mujoco.mjtJoint.mjJNT_BALL,
}
# Dry friction is a soft constraint in MuJoCo: force -clip(D (qacc + B qvel), +-frictionloss).  The direct form of
# solref, (-stiffness, -damping), with a damping rate B of 1e12 / s makes it sign(qvel) for every speed above about
# 1e-11 rad/s.
STIFF_FRICTION = (-1.0, -1e12)


@dataclass(frozen=True)
class BuiltModel:
    """A compiled model and where the mechanism's coordinates stand in it.

    q_at, v_at : first index in qpos and in qvel, by joint name; body : index by link name
    floored : links whose mass or inertia had to be raised to FLOOR
    """

    model: Any
    q_at: dict[str, int]
    v_at: dict[str, int]
    body: dict[str, int]
    floored: tuple[str, ...] = ()


def list_joint_names(joint: Joint) -> list[str]:
    """Return the names of the MuJoCo joints that make up one joint: a universal joint is two hinges of one body."""
    return [f"{joint.name}.1", f"{joint.name}.2"] if joint.kind == "universal" else [joint.name]


def compute_screw_lead(joint: Joint) -> float:
    """Return the way of a screw along its axis per radian about it [m/rad]."""
    return float(joint.pitch / (2 * np.pi))


def describe_joint_refusal(mechanism: Mechanism, joint: Joint) -> str | None:
    """Return the reason why MuJoCo cannot have a joint of a mechanism, or None."""
    if joint.kind == "helical" and mechanism.closures:
        return f"in closed loops MuJoCo has no screw; {joint.name!r} is a hinge and a slide that only the motion keeps in step"
    if joint.kind != "free":
        return None
    if joint.parent != WORLD:
        return f"a free joint of MuJoCo hangs on the world only; {joint.name!r} hangs on {joint.parent!r}"
    if joint.rotor_inertia or joint.friction:
        return f"MuJoCo's armature and dry friction act along world axes, those of {joint.name!r} along the body's"
    return None


def add_joints(link: Any, joint: Joint) -> None:
    """Give a body the joints that make up its joint [rad], [m]."""
    if joint.kind == "free":
        apply_passive_values(link.add_freejoint(name=joint.name), joint)
    elif joint.kind != "fixed":
        for name, axis in zip(list_joint_names(joint), (joint.axis, joint.second_axis), strict=False):
            apply_passive_values(link.add_joint(name=name, type=TYPES[joint.kind], axis=axis), joint)
    if joint.kind == "helical":
        link.add_joint(name=f"{joint.name}.advance", type=SLIDE, axis=joint.axis)


def apply_passive_values(made: Any, joint: Joint) -> None:
    """Set armature, damping, dry friction and spring of a joint of MuJoCo [kg m^2], [N m s], [N m], [N m/rad]."""
    made.armature = joint.rotor_inertia
    made.frictionloss = joint.friction
    made.damping[0] = joint.damping  # the linear coefficient of a polynomial in the speed
    made.solref_friction = STIFF_FRICTION
    made.stiffness[0] = joint.stiffness
    made.springref = joint.rest


@dataclass(frozen=True)
class State:
    """Coordinates of all samples as MuJoCo wants them: q (samples, nq), v and a (samples, nv)."""

    q: Array
    v: Array
    a: Array


def convert_to_engine(mechanism: Mechanism, built_model: BuiltModel, q: Array, qd: Array, qdd: Array) -> State:
    """Return MuJoCo's qpos, qvel and qacc of q (samples, nq), qd, qdd (samples, nv) [rad or m, s]."""
    model = built_model.model
    out = State(np.empty((len(q), model.nq)), np.empty((len(q), model.nv)), np.empty((len(q), model.nv)))
    for joint in mechanism.joints:
        if joint.nv == 0:
            continue
        mine = q[:, mechanism.q_slices[joint.name]]
        rates = mechanism.v_slices[joint.name]
        at = built_model.q_at[joint.name]
        v = built_model.v_at[joint.name]
        position = _convert_position(joint, mine)
        out.q[:, at : at + position.shape[1]] = position
        out.v[:, v : v + joint.nv] = qd[:, rates]
        out.a[:, v : v + joint.nv] = qdd[:, rates]
        if joint.kind == "helical":
            out.v[:, v + 1], out.a[:, v + 1] = (
                compute_screw_lead(joint) * out.v[:, v],
                compute_screw_lead(joint) * out.a[:, v],
            )
        if joint.kind == "free":
            turn = _compute_world_rotation(joint, mine)
            linear = qd[:, rates][:, :3]
            angular = qd[:, rates][:, 3:]
            out.v[:, v : v + 3] = turn.apply(linear)
            out.a[:, v : v + 3] = turn.apply(qdd[:, rates][:, :3] + np.cross(angular, linear))
    return out


def _convert_position(joint: Joint, q: Array) -> Array:
    if joint.kind == "continuous":
        return np.unwrap(np.arctan2(q[:, 1], q[:, 0]))[:, None]
    if joint.kind == "helical":
        return np.hstack([q, compute_screw_lead(joint) * q])
    if joint.kind == "spherical":
        return np.roll(q, 1, axis=1)
    if joint.kind == "free":
        place = joint.placement.position + q[:, :3] @ joint.placement.rotation.T
        return np.hstack([place, np.roll(_compute_world_rotation(joint, q).as_quat(), 1, axis=1)])
    return q


def _compute_world_rotation(joint: Joint, q: Array) -> scipy.spatial.transform.Rotation:
    """R0 R of a free joint, all samples."""
    rotation = scipy.spatial.transform.Rotation
    return rotation.from_matrix(joint.placement.rotation) * rotation.from_quat(q[:, 3:])


def convert_from_engine(mechanism: Mechanism, built_model: BuiltModel, position: Array) -> Array:
    """Return the mechanism's q (samples, nq) [rad], [m] of MuJoCo's qpos (samples, nq of the model)."""
    out = np.empty((len(position), mechanism.nq))
    for joint in mechanism.joints:
        if joint.nv == 0:
            continue
        at = built_model.q_at[joint.name]
        columns = mechanism.q_slices[joint.name]
        theirs = position[:, at : at + (1 if joint.kind == "continuous" else joint.nq)]
        if joint.kind == "continuous":
            theirs = np.hstack([np.cos(theirs), np.sin(theirs)])
        elif joint.kind == "spherical":
            theirs = np.roll(theirs, -1, axis=1)
        elif joint.kind == "free":
            seat = scipy.spatial.transform.Rotation.from_matrix(joint.placement.rotation).inv()
            turn = seat * scipy.spatial.transform.Rotation.from_quat(np.roll(theirs[:, 3:], -1, axis=1))
            theirs = np.hstack([seat.apply(theirs[:, :3] - joint.placement.position), turn.as_quat()])
        out[:, columns] = theirs
    return out


def convert_effort_from_engine(mechanism: Mechanism, built_model: BuiltModel, q: Array, force: Array) -> Array:
    """Return the mechanism's efforts (samples, nv) [N m] or [N] of MuJoCo's generalized forces: the dual of the map."""
    out = np.empty((len(force), mechanism.nv))
    for joint in mechanism.joints:
        if joint.nv == 0:
            continue
        v = built_model.v_at[joint.name]
        rates = mechanism.v_slices[joint.name]
        theirs = force[:, v : v + joint.nv].copy()
        if joint.kind == "helical":
            theirs[:, 0] += compute_screw_lead(joint) * force[:, v + 1]
        if joint.kind == "free":
            theirs[:, :3] = (
                _compute_world_rotation(joint, q[:, mechanism.q_slices[joint.name]]).inv().apply(theirs[:, :3])
            )
        out[:, rates] = theirs
    return out
