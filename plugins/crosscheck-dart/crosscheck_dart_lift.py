"""Lift of DART's skeletons: URDF and SDF as DART's parsers read them, or a ``Skeleton`` in memory, as a mechanism.

    bodies        a link each; their frame is moved to the joint that carries them
    joints        revolute, prismatic, screw, universal, ball, weld, free
    drives        damping, Coulomb friction, spring and limits of the joint; DART knows no rotor inertia
    mimic         of joints whose actuator is one, as the URDF states it
    defaults      a URDF's root is held (the file does not say); links without inertia get none (DART's default is 1 kg)

DART 6.20 reads SDF up to 1.6 and leaves out the rotation of inertial frames there, without a word: Drake reads them right.
Source: dartpy 6.20.0.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import tostring

import dartpy as dart
import numpy as np
from crosscheck_dart_dynamics import dynamics_of

from crosscheck.lifting.assembly import BodyJoint, assembled
from crosscheck.lifting.description import Description
from crosscheck.lifting.sdf import SdfStatements, features_of, read_stated
from crosscheck.lifting.urdf import mimics
from flexinv.errors import InputError
from flexinv.files.from_urdf import read_xml
from flexinv.model.mechanism import WORLD, Closure, Inertia, Limits, Mechanism, Placement

KINDS = {
    "RevoluteJoint": "revolute", "PrismaticJoint": "prismatic", "WeldJoint": "fixed", "ScrewJoint": "helical",
    "UniversalJoint": "universal", "BallJoint": "spherical", "FreeJoint": "free",
}  # fmt: skip
NOTHING = 1e-300  # [kg], [kg m^2]: DART refuses 0
TURNED = "inertial frames: DART's reader of SDF leaves out their rotation"


def lifts(source: Any) -> bool:
    """Return True for a skeleton of DART in memory."""
    return isinstance(source, dart.dynamics.Skeleton)


def lift(source: Any) -> Description:
    """Return the description of a file, or of a skeleton in memory [m, kg, rad].  Raises InputError."""
    if lifts(source):
        return _described(source, source.getName() or "Skeleton", "live", ())
    path = Path(source)
    skeleton, kind = read_skeleton(path)
    return _described(skeleton, path.name, kind, (TURNED,) if kind == "sdf" else (), path)


def read_skeleton(path: Path) -> tuple[Any, str]:
    """Return the skeleton of a file as DART's parsers read it, and the file's format [-].  Raises InputError."""
    tag = read_xml(path).tag
    kind = {"robot": "urdf", "sdf": "sdf"}.get(tag)
    if kind is None:
        raise InputError(f"{path}: DART reads URDF and SDF; its reader of <{tag}> leaves masses and stiffnesses out")
    try:
        skeleton = _urdf(path) if kind == "urdf" else _sdf(path)
    except RuntimeError as error:
        raise InputError(f"{path}: DART refuses it: {' '.join(str(error).split())}") from None
    if skeleton is None:
        raise InputError(f"{path}: DART refuses it without a reason; it does so for SDF beyond 1.6")
    return skeleton, kind


def _urdf(path: Path) -> Any:
    loader, options = dart.utils.DartLoader(), dart.utils.DartLoaderOptions()
    options.mDefaultRootJointType = dart.utils.DartLoaderRootJointType.FIXED
    options.mDefaultInertia = dart.dynamics.Inertia(NOTHING, np.zeros(3), NOTHING * np.eye(3))
    loader.setOptions(options)
    robot = read_xml(path)
    for part in robot:
        for shape in [one for one in part if one.tag in ("visual", "collision")]:
            part.remove(shape)  # DART refuses a file whose meshes it does not find; they say nothing of dynamics
    return loader.parseSkeletonString(tostring(robot, encoding="unicode"), dart.common.Uri(f"file://{path.resolve()}"))


def _sdf(path: Path) -> Any:
    return dart.utils.SdfParser.readSkeleton(dart.common.Uri(f"file://{path.resolve()}"))


def _described(skeleton: Any, label: str, kind: str, dropped: tuple[str, ...], path: Path | None = None) -> Description:
    nodes = [skeleton.getBodyNode(k) for k in range(skeleton.getNumBodyNodes())]
    names = {node.getName(): _name(node.getName()) for node in nodes}
    bodies = {names[node.getName()]: _inertia(node) for node in nodes}
    joints = [_joint(node, names) for node in nodes]
    gravity = np.array(skeleton.getGravity(), dtype=float)
    made = assembled(label, bodies, joints, gravity, {})
    couplings, lost = _couplings([node.getParentJoint() for node in nodes], made, path)
    mechanism = replace(made, closures=(*made.closures, *couplings))
    stated = read_stated(path) if kind == "sdf" and path is not None else SdfStatements()
    links = {scoped: scoped.rpartition("::")[2] for scoped in (*stated.added, *stated.floating)}
    description = Description(
        label, mechanism, kind, "dart", {}, (*dropped, *lost), file=path, root_stated=kind != "urdf",
        gravity_stated=kind == "live", features=features_of(stated, links),
    )  # fmt: skip
    try:
        return replace(description, dynamics=dynamics_of(skeleton, mechanism, label))
    except InputError as error:
        return replace(description, unproven=str(error))


def _name(name: str) -> str:
    return f"{name} body" if name == WORLD else name


def _inertia(node: Any) -> Inertia:
    found = node.getInertia()
    mass = float(found.getMass())
    if mass <= NOTHING:
        return Inertia(0.0)
    return Inertia(mass, np.ravel(node.getLocalCOM()), np.array(found.getMoment(), dtype=float))


def _joint(node: Any, names: dict[str, str]) -> BodyJoint:
    joint, carrier = node.getParentJoint(), node.getParentBodyNode()
    kind = KINDS.get(joint.getType())
    if kind is None:
        raise InputError(f"joint {joint.getName()!r} is a {joint.getType()}: expected one of {', '.join(KINDS)}")
    frames = [_placement(f()) for f in (joint.getTransformFromParentBodyNode, joint.getTransformFromChildBodyNode)]
    axes: dict[str, Any] = {}
    if kind == "universal":
        axes = {"axis": np.ravel(joint.getAxis1()), "second_axis": np.ravel(joint.getAxis2())}
    elif kind in ("revolute", "prismatic", "helical"):
        axes = {"axis": np.ravel(joint.getAxis())}
    parent = names[carrier.getName()] if carrier is not None else WORLD
    own = dict(_own(joint, kind))
    return BodyJoint(
        joint.getName(), kind, parent, names[node.getName()], frames[0], frames[1], **axes, joint_fields=own
    )


def _own(joint: Any, kind: str) -> Iterator[tuple[str, Any]]:
    """Yield passive numbers [N m s], [N m], [N m/rad], limits [rad], [m] and pitch [m] of a joint."""
    if kind in ("fixed", "free"):
        return
    yield "damping", float(joint.getDampingCoefficient(0))
    yield "friction", float(joint.getCoulombFriction(0))
    if kind not in ("revolute", "prismatic", "helical"):
        return
    if stiffness := float(joint.getSpringStiffness(0)):
        yield "stiffness", stiffness
        yield "rest", float(joint.getRestPosition(0))
    if kind == "helical":
        yield "pitch", float(joint.getPitch())
    effort, speed = float(joint.getForceUpperLimit(0)) or np.inf, float(joint.getVelocityUpperLimit(0)) or np.inf
    yield "limits", Limits(effort, speed, float(joint.getPositionLowerLimit(0)), float(joint.getPositionUpperLimit(0)))


def _couplings(joints: list[Any], made: Mechanism, path: Path | None) -> tuple[tuple[Closure, ...], tuple[str, ...]]:
    """Couplings of mimic joints: DART's Python does not tell of which, so they are those of the URDF, if they are as many."""
    count = sum(
        1 for one in joints if one.getNumDofs() == 1 and one.getActuatorType() == dart.dynamics.ActuatorType.MIMIC
    )
    if not count:
        return (), ()
    robot = None if path is None else read_xml(path)
    stated = mimics(robot, made, path)[0] if robot is not None and path is not None and robot.tag == "robot" else ()
    if len(stated) == count:
        return stated, ()
    return (), (f"{count} mimic joints: DART's Python interface does not tell what they follow",)


def _placement(pose: Any) -> Placement:
    full = np.array(pose.matrix(), dtype=float)
    return Placement(full[:3, 3], full[:3, :3])
