"""Lift of Pinocchio's models: any file that its parsers read, as shipped, or a ``pin.Model`` in memory, as a mechanism.

Fixed joints are merged by the parsers, and so are their bodies: a joint's body is one link here, named as the first body frame at
the joint.  Armature, damping, dry friction and limits are the model's; its parser of URDF reads the limits of ``limit`` and the
damping and friction of ``dynamics``.  Source: pinocchio 4.1, joint-*.hpp.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from crosscheck.engines.pinocchio.own_dynamics import build_dynamics
from crosscheck.lifting.description import Description
from crosscheck.lifting.hinges import replace_points_by_hinges
from crosscheck.lifting.names import unique_names
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

AXES = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}


def lifts(source: Any) -> bool:
    """Return True for a model of Pinocchio in memory."""
    return isinstance(source, pin.Model)


def lift(source: Any, label: str = "") -> Description:
    """Return the description of a file, or of a model in memory [m, kg, rad].  Raises InputError with Pinocchio's words."""
    if isinstance(source, pin.Model):
        return _build_description(source, label or source.name, "live", None)
    path = Path(source)
    kind = "urdf" if read_xml(path).tag == "robot" else "mjcf"
    try:
        model, ties = (pin.buildModelFromUrdf(str(path)), []) if kind == "urdf" else _read_mjcf(path)
    except (ValueError, RuntimeError, IndexError, TypeError) as error:
        raise InputError(f"{path}: Pinocchio refuses it: {' '.join(str(error).split())}") from None
    return _build_description(model, label or path.name, kind, path, ties)


def _read_mjcf(path: Path) -> tuple[Any, list[Any]]:
    """The model of an MJCF, and what closes its loops: anchors of points and of frames."""
    model, points, frames = pin.buildModelAndConstraintsFromMJCF(str(path))
    return model, [*points, *frames]


def _build_description(model: Any, label: str, kind: str, path: Path | None, ties: Iterable[Any] = ()) -> Description:
    model = _apply_unique_names(model)
    names = _list_body_names(model)
    joints: list[Joint] = []
    links: list[Link] = []
    closures: list[Closure] = []
    held = model.inertias[0]
    if held.mass:  # what the parser found welded to the world
        joints.append(Joint("base on world", "fixed", WORLD, names[0], actuated=False))
        links.append(Link(names[0], (Body(names[0], _convert_inertia(held)),)))
    for k in range(1, model.njoints):
        parent = names[model.parents[k]] if model.parents[k] else WORLD
        joint = _read_joint(model, k, parent, names[k])
        joints.append(joint)
        body = _convert_inertia(model.inertias[k])
        links.append(Link(names[k], (Body(names[k], body),) if body.mass or body.tensor.any() else ()))
        if "Mimic" in model.joints[k].shortname():
            closures.append(_read_mimic(model, k))
    closures += replace_points_by_hinges(_read_tie(tie, [WORLD, *names[1:]], k) for k, tie in enumerate(ties))
    mechanism = Mechanism(
        name=label,
        links=tuple(links),
        joints=tuple(joints),
        gravity=np.array(model.gravity.linear),
        closures=tuple(closures),
    )
    stated = kind != "urdf"
    description = Description(label, mechanism, kind, "pinocchio", file=path, root_stated=stated, gravity_stated=stated)
    try:
        return replace(description, dynamics=build_dynamics(model, mechanism, label))
    except InputError as error:
        return replace(description, unproven=str(error))


def _list_body_names(model: Any) -> list[str]:
    """Name of the first body frame at every joint, that of the joint where there is none."""
    found: dict[int, str] = {}
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY:
            found.setdefault(frame.parentJoint, frame.name)
    names = [found.get(k, f"body of {model.names[k]}") for k in range(model.njoints)]
    plain = ["base" if name == WORLD else name for name in names[1:]]
    paths = [f"{name} of {joint}" for name, joint in zip(plain, list(model.names)[1:], strict=True)]
    moving = unique_names(plain, paths)
    return ["held base" if "base" in moving else "base", *moving]


def _apply_unique_names(model: Any) -> Any:
    """The model with joints that have a name each, after those before them where a model in memory has one twice."""
    paths = [""]
    for k in range(1, model.njoints):
        paths.append(f"{paths[model.parents[k]]}/{model.names[k]}")
    names = unique_names(list(model.names), [path.lstrip("/") for path in paths])
    if names == list(model.names):
        return model
    named = model.copy()
    for k, name in enumerate(names):
        named.names[k] = name
    return named


def _convert_inertia(found: Any) -> Inertia:
    return Inertia.build_unchecked(float(found.mass), np.array(found.lever), np.array(found.inertia))


def _read_joint(model: Any, k: int, parent: str, child: str) -> Joint:
    kind, axes, pitch = _resolve_joint_kind(model.joints[k], model.names[k])
    at = Placement(np.array(model.jointPlacements[k].translation), np.array(model.jointPlacements[k].rotation))
    first = model.joints[k].idx_v
    return Joint(
        model.names[k], kind, parent, child, at, axis=axes[0], second_axis=axes[-1], pitch=pitch,
        limits=_read_limits(model, k, kind), actuated=kind != "free",
        rotor_inertia=_take_number(model.armature, first), damping=_take_number(model.damping, first),
        friction=_take_number(model.upperDryFrictionLimit, first),
    )  # fmt: skip


def _take_number(values: Any, index: int) -> float:
    return float(values[index]) if 0 <= index < len(values) else 0.0


def _read_limits(model: Any, k: int, kind: str) -> Limits:
    joint = model.joints[k]
    effort = _read_bound(model.upperEffortLimit, joint.idx_v)
    velocity = _read_bound(model.upperVelocityLimit, joint.idx_v)
    if kind not in ("revolute", "prismatic", "helical"):
        return Limits(effort, velocity)
    lower = float(model.lowerPositionLimit[joint.idx_q])
    upper = float(model.upperPositionLimit[joint.idx_q])
    far = 1e300  # the parser's word for no limit is the largest number
    return Limits(effort, velocity, lower if lower > -far else -np.inf, upper if upper < far else np.inf)


def _read_bound(values: Any, index: int) -> float:
    """Largest effort or speed; zero and the largest number mean that none is stated."""
    value = _take_number(values, index)
    return value if 0.0 < value < 1e300 else np.inf


def _resolve_joint_kind(joint: Any, name: str) -> tuple[str, tuple[Array, ...], float]:
    """Kind, axes and pitch [m] of a turn of one of Pinocchio's joints."""
    word = joint.shortname().removeprefix("JointModel")
    plain = word.removeprefix("Mimic").strip("<>_")
    z = np.array(AXES["Z"])
    for prefix, kind in (("RUB", "continuous"), ("R", "revolute"), ("P", "prismatic")):
        if plain.startswith(prefix) and plain[len(prefix) :] in AXES:
            return kind, (np.array(AXES[plain[len(prefix) :]]),), 0.0
    inner = joint.extract() if hasattr(joint, "extract") else joint
    if plain in ("RevoluteUnaligned", "RevoluteUnboundedUnaligned", "PrismaticUnaligned"):
        kinds = {"RevoluteUnaligned": "revolute", "PrismaticUnaligned": "prismatic"}
        return kinds.get(plain, "continuous"), (np.array(inner.axis),), 0.0
    if plain.startswith("H"):
        axis = np.array(AXES[plain[1:]]) if plain[1:] in AXES else np.array(inner.axis)
        return "helical", (axis,), float(inner.pitch) * 2 * np.pi
    if plain == "Universal":
        return "universal", (np.array(inner.axis1), np.array(inner.axis2)), 0.0
    if plain in ("Spherical", "FreeFlyer"):
        return {"Spherical": "spherical", "FreeFlyer": "free"}[plain], (z,), 0.0
    raise InputError(f"joint {name!r}: a mechanism has no joint like Pinocchio's {word}")


def _read_tie(tie: Any, links: list[str], number: int) -> Closure:
    """The closure of an anchor of points or frames; links : by joint, the world first."""
    ends = [
        Attachment(links[joint], Placement(np.array(at.translation), np.array(at.rotation)))
        for joint, at in ((tie.joint1_id, tie.joint1_placement), (tie.joint2_id, tie.joint2_placement))
    ]
    kind = "spherical" if isinstance(tie, pin.PointAnchorConstraintModel) else "fixed"
    return Closure(f"{kind} {number}", kind, ends[0], ends[1])


def _read_mimic(model: Any, k: int) -> Closure:
    joint = model.joints[k].extract()
    here = Attachment(WORLD)
    other = model.names[joint.id_primary] if hasattr(joint, "id_primary") else model.names[joint.jmodel_ref.id]
    factors = ((model.names[k], 1.0), (other, -float(joint.scaling)))
    return Closure(f"mimic {model.names[k]}", "coupling", here, here, factors=factors, offset=float(joint.offset))
