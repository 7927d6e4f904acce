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
* A massless link on a moving joint gets FLOOR for mass and inertia and is listed in ``BuiltModel.floored``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from crosscheck.engines.mujoco.joints import BuiltModel, add_joints, apply_passive_values, list_joint_names
from crosscheck.engines.shared.urdf_source import check_joints, read_source
from flexinv.model.mechanism import WORLD, Body, Mechanism
from flexinv.typing import Array

FLOOR = 2e-15  # [kg], [kg m^2]: twice mjMINVAL, so that rounding cannot bring it below


def build(mechanism: Mechanism, fuse: bool = False, extend: Callable[[Any], None] | None = None) -> BuiltModel:
    """Return MuJoCo's compiled model.  Raises ValueError with MuJoCo's words where it refuses the mechanism.

    fuse : weld bodies without joints into their parents; extend : what to add to the MjSpec before it is compiled
    """
    spec, floored = _build_from_urdf(mechanism) if mechanism.urdf else _build_from_data(mechanism)
    spec.compiler.fusestatic = fuse
    spec.option.gravity = mechanism.gravity
    if extend is not None:
        extend(spec)
    model = spec.compile()
    first = {j.name: model.joint(list_joint_names(j)[0]) for j in mechanism.joints if j.nv}
    return BuiltModel(
        model=model,
        q_at={name: int(joint.qposadr[0]) for name, joint in first.items()},
        v_at={name: int(joint.dofadr[0]) for name, joint in first.items()},
        body={} if fuse else {link.name: model.body(link.name).id for link in mechanism.links},
        floored=floored,
    )


def _build_from_data(mechanism: Mechanism) -> tuple[Any, tuple[str, ...]]:
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    bodies = {WORLD: spec.worldbody}
    floored = []
    for joint in mechanism.joints:
        link = bodies[joint.child] = bodies[joint.parent].add_body(
            name=joint.child,
            pos=joint.placement.position,
            quat=convert_to_quaternion(joint.placement.rotation),
            ipos=np.zeros(3),
            explicitinertial=True,
        )
        add_joints(link, joint)
        carried = mechanism.link_of[joint.child].bodies
        raised = [_add_body(link, f"{joint.child}/{body.name}", body) for body in carried]
        massless = joint.nv > 0 and not any(body.inertia.mass > FLOOR for body in carried)
        if massless:
            link.mass = FLOOR
            link.inertia = np.full(3, FLOOR)
        if massless or any(raised):
            floored.append(joint.child)
    return spec, tuple(floored)


def _build_from_urdf(mechanism: Mechanism) -> tuple[Any, tuple[str, ...]]:
    source = read_source(mechanism)
    spec = mujoco.MjSpec.from_string(source.text)
    check_joints(mechanism, "MuJoCo", [joint.name for joint in spec.joints])
    root = mechanism.joints[0]
    if root.kind == "free":
        spec.body(root.child).add_freejoint(name=root.name)
    for joint in mechanism.joints:
        if joint.nv:
            apply_passive_values(spec.joint(joint.name), joint)
    for link, body in source.overlays:
        _add_body(spec.body(link), f"{link}/{body.name}", body)
    return spec, ()


def _add_body(link: Any, name: str, body: Body) -> bool:
    """Add a body that moves with the link; return whether its inertia had to be raised to the floor."""
    principal, axes, raised = compute_principal_inertia(body.inertia.tensor)
    link.add_body(
        name=name,
        mass=body.inertia.mass,
        ipos=body.inertia.com,
        inertia=principal,
        iquat=convert_to_quaternion(axes),
        explicitinertial=True,
    )
    return raised


def compute_principal_inertia(tensor: Array) -> tuple[Array, NDArray[np.float64], bool]:
    """Return principal inertias (3,) [kg m^2], their axes (3, 3) as right-handed columns, and whether FLOOR was needed.

    Deficits of the size of rounding are filled; a tensor that no body can have stays what it is, for MuJoCo to refuse.
    """
    if not (tensor - np.diag(np.diag(tensor))).any():
        principal = np.diag(tensor).copy()
        axes = np.eye(3)
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


def convert_to_quaternion(rotation: Array) -> Array:
    """Return w, x, y, z [-] of a rotation matrix, by MuJoCo's own function."""
    wxyz = np.empty(4)
    mujoco.mju_mat2Quat(wxyz, np.ascontiguousarray(rotation, dtype=np.float64).ravel())
    return wxyz
