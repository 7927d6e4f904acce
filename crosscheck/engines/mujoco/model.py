"""MuJoCo's own model of a mechanism, by its model-editing interface (MjSpec) or by its own URDF parser.

No geometry, no limits, no contacts: only inertia, joints, and their armature, damping, dry friction and springs.
Every link is a body of its own (``fusestatic`` off), every ``Body`` of a link a body welded to it, so MuJoCo itself
does all composition of inertia.

Traps, and what is done about them
* A moving body needs mass and principal inertia of at least mjMINVAL = 1e-15 (a thin rod has none about its axis, a
  point mass none at all): what is smaller is raised to FLOOR.  In units of torque that is FLOOR times an acceleration.
* Principal inertias that violate A + B >= C by rounding (flat plates) are refused: that rounding, no more, is added.
* A body with explicit inertia and no ``ipos`` gets its own ``pos`` for one, so every ``ipos`` is stated.
* A new MjSpec takes angles (springref) in degrees: the switch is turned off; URDFs are in radians.
* A massless link on a moving joint gets FLOOR for mass and inertia and is listed in ``Built.floored``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from crosscheck.engines.shared.urdf_source import check_joints, read_source
from flexinv.model.mechanism import WORLD, Body, Joint, Mechanism
from flexinv.typing import Array

FLOOR = 2e-15  # [kg], [kg m^2]: twice mjMINVAL, so that rounding cannot bring it below
HINGE, SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
TYPES = {
    "revolute": HINGE,
    "continuous": HINGE,
    "prismatic": SLIDE,
    "universal": HINGE,
    "spherical": mujoco.mjtJoint.mjJNT_BALL,
}
# Dry friction is a soft constraint in MuJoCo: force -clip(D (qacc + B qvel), +-frictionloss).  The direct form of
# solref, (-stiffness, -damping), with a damping rate B of 1e12 / s makes it sign(qvel) for every speed above about
# 1e-11 rad/s.
STIFF_FRICTION = (-1.0, -1e12)


@dataclass(frozen=True)
class Built:
    """A compiled model and where the mechanism's coordinates stand in it.

    q_at, v_at : first index in qpos and in qvel, by joint name; body : index by link name
    floored : links whose mass or inertia had to be raised to FLOOR
    """

    model: Any
    q_at: dict[str, int]
    v_at: dict[str, int]
    body: dict[str, int]
    floored: tuple[str, ...] = ()


def build(mechanism: Mechanism, fuse: bool = False, extend: Callable[[Any], None] | None = None) -> Built:
    """Return MuJoCo's compiled model.  Raises ValueError with MuJoCo's words where it refuses the mechanism.

    fuse : weld bodies without joints into their parents; extend : what to add to the MjSpec before it is compiled
    """
    spec, floored = _from_urdf(mechanism) if mechanism.urdf else _from_data(mechanism)
    spec.compiler.fusestatic = fuse
    spec.option.gravity = mechanism.gravity
    if extend is not None:
        extend(spec)
    model = spec.compile()
    first = {j.name: model.joint(_names(j)[0]) for j in mechanism.joints if j.nv}
    return Built(
        model=model,
        q_at={name: int(joint.qposadr[0]) for name, joint in first.items()},
        v_at={name: int(joint.dofadr[0]) for name, joint in first.items()},
        body={} if fuse else {link.name: model.body(link.name).id for link in mechanism.links},
        floored=floored,
    )


def _names(joint: Joint) -> list[str]:
    """Names of the MuJoCo joints that make up one joint: a universal joint is two hinges of one body."""
    return [f"{joint.name}.1", f"{joint.name}.2"] if joint.kind == "universal" else [joint.name]


def _from_data(mechanism: Mechanism) -> tuple[Any, tuple[str, ...]]:
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    bodies = {WORLD: spec.worldbody}
    floored = []
    for joint in mechanism.joints:
        link = bodies[joint.child] = bodies[joint.parent].add_body(
            name=joint.child,
            pos=joint.placement.position,
            quat=quaternion(joint.placement.rotation),
            ipos=np.zeros(3),
            explicitinertial=True,
        )
        _add_joints(link, joint)
        carried = mechanism.link_of[joint.child].bodies
        raised = [_weld(link, f"{joint.child}/{body.name}", body) for body in carried]
        massless = joint.nv > 0 and not any(body.inertia.mass > FLOOR for body in carried)
        if massless:
            link.mass, link.inertia = FLOOR, np.full(3, FLOOR)
        if massless or any(raised):
            floored.append(joint.child)
    return spec, tuple(floored)


def _from_urdf(mechanism: Mechanism) -> tuple[Any, tuple[str, ...]]:
    source = read_source(mechanism)
    spec = mujoco.MjSpec.from_string(source.text)
    check_joints(mechanism, "MuJoCo", [joint.name for joint in spec.joints])
    root = mechanism.joints[0]
    if root.kind == "free":
        spec.body(root.child).add_freejoint(name=root.name)
    for joint in mechanism.joints:
        if joint.nv:
            _passive(spec.joint(joint.name), joint)
    for link, body in source.overlays:
        _weld(spec.body(link), f"{link}/{body.name}", body)
    return spec, ()


def _add_joints(link: Any, joint: Joint) -> None:
    if joint.kind == "free":
        _passive(link.add_freejoint(name=joint.name), joint)
    elif joint.kind != "fixed":
        for name, axis in zip(_names(joint), (joint.axis, joint.second_axis), strict=False):
            _passive(link.add_joint(name=name, type=TYPES[joint.kind], axis=axis), joint)


def _passive(made: Any, joint: Joint) -> None:
    made.armature, made.frictionloss = joint.rotor_inertia, joint.friction
    made.damping[0] = joint.damping  # the linear coefficient of a polynomial in the speed
    made.solref_friction = STIFF_FRICTION
    made.stiffness[0], made.springref = joint.stiffness, joint.rest


def _weld(link: Any, name: str, body: Body) -> bool:
    """Add a body that moves with the link; return whether its inertia had to be raised to the floor."""
    principal, axes, raised = principal_inertia(body.inertia.tensor)
    link.add_body(
        name=name,
        mass=body.inertia.mass,
        ipos=body.inertia.com,
        inertia=principal,
        iquat=quaternion(axes),
        explicitinertial=True,
    )
    return raised


def principal_inertia(tensor: Array) -> tuple[Array, NDArray[np.float64], bool]:
    """Return principal inertias (3,) [kg m^2], their axes (3, 3) as right-handed columns, and whether FLOOR was needed.

    Deficits of the size of rounding are filled; a tensor that no body can have stays what it is, for MuJoCo to refuse.
    """
    if not (tensor - np.diag(np.diag(tensor))).any():
        principal, axes = np.diag(tensor).copy(), np.eye(3)
    else:
        principal, axes = np.linalg.eigh(tensor)
        axes = axes * np.sign(np.linalg.det(axes))
    rounding = 8 * np.finfo(float).eps * np.abs(principal).max()  # of a 3 x 3 eigenvalue problem and one addition
    small = (principal < FLOOR) & (principal > -rounding - FLOOR)
    principal = np.where(small, FLOOR, principal)
    low = np.argsort(principal)[:2]
    deficit = principal.max() - principal[low].sum()
    if 0 < deficit <= rounding:
        principal[low] += deficit
    return principal, axes, bool(small.any())


def quaternion(rotation: Array) -> Array:
    """Return w, x, y, z [-] of a rotation matrix, by MuJoCo's own function."""
    wxyz = np.empty(4)
    mujoco.mju_mat2Quat(wxyz, np.ascontiguousarray(rotation, dtype=np.float64).ravel())
    return wxyz
