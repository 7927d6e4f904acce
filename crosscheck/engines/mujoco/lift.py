"""Lift of MuJoCo's models: any file that its compiler reads, as shipped, or an ``mjModel`` in memory, as a mechanism.

    body          a link; its frame is that of the body, moved to the anchor of its last joint
    joints        one after the other in one body: links without mass between them
    ref           a joint's coordinate is ``ref`` where the file draws it: the placement is turned back by it
    inertia       about the centre of mass, R diag(I) R^T with R of ``iquat``
    effort        the largest that actuators and joint allow (`read_effort_limits`)
    actuators     armature and damping of those on a joint, times gear^2, are the joint's
    equality      joint: a coupling (its linear part), of fixed tendons: a coupling of their joints, connect: a spherical closure,
                  two of them between the same bodies: a revolute one, weld: a fixed one; between bodies or sites
    flags         what they disable is not there: gravity, springs, dampers, dry friction, limits, equalities
    the rest      features (`mujoco.compiled.features`), and what no effort feels, in words

Defaults, ``fusestatic``, ``inertiafromgeom`` and classes are the compiler's.  Source: mujoco 4.0.0, mjmodel.h.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, TypedDict

import mujoco
import numpy as np

from crosscheck.engines.mujoco.compiled.features import (
    DAMPER_OFF,
    FRICTION_OFF,
    GRAVITY_OFF,
    LIMIT_OFF,
    SPRING_OFF,
    find_features,
    remove_features,
)
from crosscheck.engines.mujoco.compiled.names import (
    OBJECT,
    find_actuators,
    list_joint_names,
    make_free_name,
    read_gear,
    resolve_joint_name,
    resolve_name,
)
from crosscheck.engines.mujoco.compiled.tendons import is_active, is_disabled, read_linear_law
from crosscheck.engines.mujoco.effort_limits import read_effort_limits
from crosscheck.engines.mujoco.named_files import check_named_files
from crosscheck.engines.mujoco.own_dynamics import OwnDynamics, find_joint_addresses
from crosscheck.engines.mujoco.shape_masses import find_shape_masses
from crosscheck.lifting.description import Description
from crosscheck.lifting.hinges import replace_points_by_hinges
from crosscheck.lifting.printed import read_mjcf_digits
from flexinv.errors import InputError
from flexinv.files.from_urdf import read_xml
from flexinv.model.mechanism import (
    WORLD,
    Array,
    Attachment,
    Body,
    Closure,
    Inertia,
    Joint,
    Limits,
    Link,
    Mechanism,
    Placement,
)

# What MuJoCo's own code raises: RuntimeError where an exception of C++ came through, as of memory that is not there.
REFUSALS = (ValueError, OSError, RuntimeError, mujoco.FatalError)
JOINT_KIND = mujoco.mjtJoint
EQUALITY = mujoco.mjtEq
KINDS = {
    JOINT_KIND.mjJNT_FREE: "free",
    JOINT_KIND.mjJNT_BALL: "spherical",
    JOINT_KIND.mjJNT_SLIDE: "prismatic",
    JOINT_KIND.mjJNT_HINGE: "revolute",
}
# Inertial frames that MuJoCo takes along the body's axes: what it finds to be less than about 1e-8 is zero for it.
ALONG_BODY = (mujoco.mjtSameFrame.mjSAMEFRAME_BODY, mujoco.mjtSameFrame.mjSAMEFRAME_BODYROT)
NO_PART = "no part of a mechanism"
PARTS = (
    ("ntendon", "tendon", "limits and actuators on them are not compared"),
    ("nflex", "flexible body", NO_PART),
    ("nplugin", "plugin", NO_PART),
    ("npair", "contact pair", NO_PART),
)


def lifts(source: Any) -> bool:
    """Return True for a model of MuJoCo in memory."""
    return isinstance(source, mujoco.MjModel | mujoco.MjSpec)


def lift(source: Any, label: str = "") -> Description:
    """Return the description of a file, or of a model in memory [m, kg, rad].  Raises InputError with MuJoCo's words."""
    if isinstance(source, mujoco.MjModel):
        return _build_description(source, label or "mjModel", "live", ())
    if isinstance(source, mujoco.MjSpec):
        return _build_description(_build_model(source, "MjSpec"), label or "MjSpec", "live", ())
    path = Path(source)
    root = read_xml(path)
    check_named_files(path, root)
    model, dropped = _read(path)
    if model.nbody < 2:
        raise InputError(
            f"{path}\n  given:    a model without bodies\n  expected: <worldbody> with at least one <body>\n"
            "  write:    the file that holds the machine, if this one holds a scene or settings only"
        )
    kind = "urdf" if root.tag == "robot" else "mjcf"
    description = _build_description(model, label or path.name, kind, dropped)
    printed = read_mjcf_digits(root) if kind == "mjcf" else {}
    stated = kind != "urdf"
    masses = find_shape_masses(path, model) if kind == "mjcf" and not dropped else {}
    return replace(
        description, file=path, root_stated=stated, gravity_stated=stated, printed=printed, shape_masses=masses
    )


def read_model(path: Path) -> Any:
    """Return the model that MuJoCo's compiler makes of a file.  Raises InputError with its words."""
    return _read(path)[0]


def _read(path: Path) -> tuple[Any, tuple[str, ...]]:
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except REFUSALS as error:
        raise InputError(f"{path}: MuJoCo refuses it: {_format_error(error)}") from None
    try:
        return spec.compile(), ()
    except REFUSALS as error:
        words = _format_error(error)
    if "mesh" not in words and "file" not in words.lower() and "texture" not in words:
        raise InputError(f"{path}: MuJoCo refuses it: {words}")
    spec = mujoco.MjSpec.from_file(str(path))
    _remove_files(spec, path)
    return _build_model(spec, str(path)), (
        f"geometry: MuJoCo does not find it ({words}); read without meshes and pictures",
    )


def _build_model(spec: Any, name: str) -> Any:
    try:
        return spec.compile()
    except REFUSALS as error:
        raise InputError(f"{name}: MuJoCo refuses it: {_format_error(error)}") from None


def _format_error(error: Exception) -> str:
    return " ".join(str(error).split()).removeprefix("Error: ")


def _remove_files(spec: Any, path: Path) -> None:
    """Take what names other files out of a specification; InputError where masses come from it."""
    shaped = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF, mujoco.mjtGeom.mjGEOM_HFIELD)
    always = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    for geom in [g for g in spec.geoms if g.type in shaped or g.meshname]:  # a primitive may be fitted to a mesh
        body = geom.parent
        weighs = always or not body.explicitinertial
        if body.name != WORLD and weighs and geom.mass != 0.0 and geom.density != 0.0:
            raise InputError(
                f"{path}: body {body.name!r} gets its mass from a mesh that is not there, or cannot be read; "
                "put the mesh where the file says, or write <inertial> in the body"
            )
        spec.delete(geom)
    for kind in (spec.meshes, spec.textures, spec.materials, spec.hfields, spec.skins):
        for part in list(kind):
            spec.delete(part)
    for geom in [*spec.geoms, *spec.sites]:
        geom.material = ""


def _build_description(model: Any, label: str, kind: str, dropped: tuple[str, ...]) -> Description:
    links, joints = _read_tree(model)
    efforts, uneven = read_effort_limits(model)
    names = {resolve_joint_name(model, index): effort for index, effort in efforts.items()}
    joints = [replace(j, limits=replace(j.limits, effort=names.get(j.name, np.inf))) for j in joints]
    closures, lost = _read_closures(model, {joint.name: joint for joint in joints})
    mechanism = Mechanism(
        name=label,
        links=tuple(links),
        joints=tuple(joints),
        gravity=np.zeros(3) if is_disabled(model, GRAVITY_OFF) else np.array(model.opt.gravity),
        closures=tuple(closures),
    )
    gears = dict(_list_gears(model))
    own_dynamics = OwnDynamics(model, mechanism, find_joint_addresses(model, list_joint_names(model)), remove_features)
    return Description(
        label, mechanism, kind, "mujoco", gears, (*dropped, *lost, *uneven, *_list_other_parts(model)),
        features=find_features(model), dynamics=own_dynamics,
    )  # fmt: skip


def _read_tree(model: Any) -> tuple[list[Link], list[Joint]]:
    """Links and joints, and by body where its link frame stands in the body's frame (3,) [m]: at its last anchor."""
    links: list[Link] = []
    joints: list[Joint] = []
    names = {0: WORLD}
    anchors = {0: np.zeros(3)}
    for body in range(1, model.nbody):
        name = names[body] = resolve_name(model, OBJECT.mjOBJ_BODY, body, "body")
        parent = int(model.body_parentid[body])
        frame = Placement(model.body_pos[body] - anchors[parent], _convert_quaternion(model.body_quat[body]))
        first = int(model.body_jntadr[body])
        count = int(model.body_jntnum[body])
        carrier = names[parent]
        anchor = np.zeros(3)
        for k in range(count):
            between = make_free_name(model, OBJECT.mjOBJ_BODY, f"{name} before joint {k + 2}")
            child = name if k == count - 1 else between
            free = model.jnt_type[first + k] == JOINT_KIND.mjJNT_FREE
            point = np.zeros(3) if free else np.array(model.jnt_pos[first + k])
            at = Placement(frame.position + frame.rotation @ (point - anchor), frame.rotation)
            joints.append(_read_joint(model, first + k, carrier, child, at))
            links.append(Link(child))
            carrier = child
            frame = Placement()
            anchor = point
        if not count:
            weld = make_free_name(model, OBJECT.mjOBJ_JOINT, f"{name} on {carrier}")
            joints.append(Joint(weld, "fixed", carrier, name, frame, actuated=False))
            links.append(Link(name))
        anchors[body] = anchor
        links[-1] = Link(name, tuple(_list_bodies(model, body, name, anchor)))
    return links, joints  # MuJoCo numbers bodies depth-first


def _list_bodies(model: Any, body: int, name: str, anchor: Array) -> Iterator[Body]:
    mass = float(model.body_mass[body])
    same = mujoco.mjtSameFrame(int(model.body_sameframe[body]))
    turn = np.eye(3) if same in ALONG_BODY else _convert_quaternion(model.body_iquat[body])
    com = np.zeros(3) if same == mujoco.mjtSameFrame.mjSAMEFRAME_BODY else np.array(model.body_ipos[body])
    tensor = turn @ np.diag(model.body_inertia[body]) @ turn.T
    if mass or tensor.any():
        yield Body(name, Inertia.build_unchecked(mass, com - anchor, (tensor + tensor.T) / 2))


def _read_joint(model: Any, index: int, parent: str, child: str, at: Placement) -> Joint:
    kind = KINDS[JOINT_KIND(int(model.jnt_type[index]))]
    name = resolve_joint_name(model, index)
    start = int(model.jnt_qposadr[index])
    axis = np.array(model.jnt_axis[index])
    if kind not in ("revolute", "prismatic"):
        return Joint(name, kind, parent, child, at, actuated=kind != "free", **_read_passive_values(model, index))
    ref = float(model.qpos0[start])
    limited = bool(model.jnt_limited[index]) and not is_disabled(model, LIMIT_OFF)
    back = at.rotation @ (_compute_rotation(axis, -ref) if kind == "revolute" else np.eye(3))
    place = at.position - (at.rotation @ axis * ref if kind == "prismatic" else 0.0)
    limits = (
        Limits(lower=float(model.jnt_range[index][0]), upper=float(model.jnt_range[index][1])) if limited else Limits()
    )
    stiffness = 0.0 if is_disabled(model, SPRING_OFF) else float(model.jnt_stiffness[index])
    return Joint(
        name,
        kind,
        parent,
        child,
        Placement(place, back),
        axis=axis,
        limits=limits,
        stiffness=stiffness,
        rest=float(model.qpos_spring[start]) if stiffness else 0.0,
        **_read_passive_values(model, index),
    )


class PassiveValues(TypedDict):
    """Numbers of a joint's drive [kg m^2], [N m s], [N m]."""

    rotor_inertia: float
    damping: float
    friction: float


def _read_passive_values(model: Any, index: int) -> PassiveValues:
    """Numbers of a joint's drive [kg m^2], [N m s], [N m]; what of a free one acts along world axes is a feature."""
    dof = int(model.jnt_dofadr[index])
    rotor = float(model.dof_armature[dof])
    damping = float(model.dof_damping[dof])
    for k in find_actuators(model, index):
        rotor += read_gear(model, k) ** 2 * float(model.actuator_armature[k])
        damping += read_gear(model, k) ** 2 * float(model.actuator_damping[k])
    numbers: PassiveValues = {
        "rotor_inertia": rotor,
        "damping": 0.0 if is_disabled(model, DAMPER_OFF) else damping,
        "friction": 0.0 if is_disabled(model, FRICTION_OFF) else float(model.dof_frictionloss[dof]),
    }
    if model.jnt_type[index] == JOINT_KIND.mjJNT_FREE:
        numbers["rotor_inertia"] = 0.0
        numbers["friction"] = 0.0
    return numbers


def _convert_quaternion(quaternion: Any) -> Array:
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, np.ascontiguousarray(quaternion, dtype=np.float64))
    return matrix.reshape(3, 3)


def _compute_rotation(axis: Array, angle: float) -> Array:
    quaternion = np.empty(4)
    mujoco.mju_axisAngle2Quat(quaternion, axis, angle)
    return _convert_quaternion(quaternion)


def _list_gears(model: Any) -> Iterator[tuple[str, float]]:
    """Yield joint and gear [-] of every actuator that drives one joint."""
    for index in range(model.njnt):
        for k in find_actuators(model, index):
            yield resolve_joint_name(model, index), read_gear(model, k)


def _read_closures(model: Any, joints: dict[str, Joint]) -> tuple[list[Closure], list[str]]:
    made: list[Closure] = []
    dropped: list[str] = []
    for k in range(model.neq):
        name = resolve_name(model, OBJECT.mjOBJ_EQUALITY, k, "equality")
        kind = EQUALITY(int(model.eq_type[k]))
        if not is_active(model, k):
            dropped.append(f"equality {name!r}: it is not active at the beginning, or a flag disables it")
        elif kind == EQUALITY.mjEQ_JOINT:
            made.append(_read_coupling(model, k, name))
        elif kind == EQUALITY.mjEQ_TENDON and (law := read_linear_law(model, k)) is not None:
            factors, offset = law
            here = Attachment(WORLD)
            made.append(Closure(name, "coupling", here, here, factors=tuple(factors.items()), offset=offset))
        elif kind in (EQUALITY.mjEQ_CONNECT, EQUALITY.mjEQ_WELD):
            tie = _read_body_tie if model.eq_objtype[k] == OBJECT.mjOBJ_BODY else _read_site_tie
            made.append(tie(model, k, name, kind == EQUALITY.mjEQ_WELD))
    return replace_points_by_hinges(made), dropped


def _read_site_tie(model: Any, k: int, name: str, weld: bool) -> Closure:
    ends = []
    for site in (int(model.eq_obj1id[k]), int(model.eq_obj2id[k])):
        body = int(model.site_bodyid[site])
        point = model.site_pos[site]
        turn = _convert_quaternion(model.site_quat[site])
        link, anchor = (
            (resolve_name(model, OBJECT.mjOBJ_BODY, body, "body"), read_anchor(model, body))
            if body
            else (WORLD, np.zeros(3))
        )
        ends.append(Attachment(link, Placement(point - anchor, turn)))
    return Closure(name, "fixed" if weld else "spherical", ends[0], ends[1])


def _read_coupling(model: Any, k: int, name: str) -> Closure:
    """q1 - q1_0 = a0 + a1 (q2 - q2_0)."""
    here = Attachment(WORLD)
    first = int(model.eq_obj1id[k])
    second = int(model.eq_obj2id[k])
    start = float(model.eq_data[k][0])
    slope = float(model.eq_data[k][1])
    offset = start + float(model.qpos0[model.jnt_qposadr[first]])
    factors = [(resolve_joint_name(model, first), 1.0)]
    if second >= 0:
        offset -= slope * float(model.qpos0[model.jnt_qposadr[second]])
        factors.append((resolve_joint_name(model, second), -slope))
    return Closure(name, "coupling", here, here, factors=tuple(factors), offset=offset)


def _read_body_tie(model: Any, k: int, name: str, weld: bool) -> Closure:
    ends = [int(model.eq_obj1id[k]), int(model.eq_obj2id[k])]
    points = (model.eq_data[k][3:6], model.eq_data[k][:3]) if weld else (model.eq_data[k][:3], model.eq_data[k][3:6])
    turns = (_convert_quaternion(model.eq_data[k][6:10]), np.eye(3)) if weld else (np.eye(3), np.eye(3))
    first, second = (
        Attachment(
            resolve_name(model, OBJECT.mjOBJ_BODY, body, "body"), Placement(point - read_anchor(model, body), turn)
        )
        if body
        else Attachment(WORLD, Placement(np.array(point), turn))
        for body, point, turn in zip(ends, points, turns, strict=True)
    )
    return Closure(name, "fixed" if weld else "spherical", first, second)


def read_anchor(model: Any, body: int) -> Array:
    """Return the place of a body's link in the body's frame (3,) [m]: at the anchor of its last joint."""
    count = int(model.body_jntnum[body])
    first = int(model.body_jntadr[body])
    if not count or model.jnt_type[first + count - 1] == JOINT_KIND.mjJNT_FREE:
        return np.zeros(3)
    return np.array(model.jnt_pos[first + count - 1])


def _list_other_parts(model: Any) -> Iterator[str]:
    """Yield what a mechanism has no word for, and no effort feels."""
    for attribute, word, why in PARTS:
        if count := int(getattr(model, attribute, 0)):
            yield f"{count} {word}{'s' * (count > 1)}: {why}"
    if np.any(model.actuator_biastype):
        yield "actuators with feedback of position or velocity: their gains are no part of a mechanism"
