"""Lift of Drake's plants: URDF, SDF and MJCF as Drake's parser reads them, or a ``MultibodyPlant`` in memory, as a mechanism.

    bodies        a link each; their frame is moved to the joint that carries them
    joints        revolute, prismatic, screw, universal (axes x, y of its frames), ball, weld; floating, from where it begins
    drives        damping and spring of the joint, rotor inertia and gear of its actuator: rotor gear^2 at the joint; a plant has
                  no dry friction, that of an SDF is the file's
    mimic         coupler constraints of Drake, as the URDF states them
    told          what Drake writes to its log while it reads: inertias that it replaces, tags that it ignores

Source: drake 1.51.1, pydrake.multibody.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from crosscheck_drake_dynamics import dynamics_of
from pydrake.multibody import parsing, tree
from pydrake.multibody import plant as multibody

from crosscheck.lifting.assembly import BodyJoint, assembled
from crosscheck.lifting.description import Description
from crosscheck.lifting.names import name_words, unique_names
from crosscheck.lifting.printed import printed_of_sdf
from crosscheck.lifting.sdf import SdfStatements, features_of, read_stated, with_stated
from crosscheck.lifting.urdf import mimics
from flexinv.errors import InputError
from flexinv.files.from_urdf import read_xml
from flexinv.model.mechanism import WORLD, Closure, Inertia, Limits, Mechanism, Placement

KINDS = {
    "revolute": "revolute", "prismatic": "prismatic", "weld": "fixed", "screw": "helical", "universal": "universal",
    "ball_rpy": "spherical", "quaternion_floating": "free", "rpy_floating": "free",
}  # fmt: skip
FORMATS = {"robot": "urdf", "sdf": "sdf", "mujoco": "mjcf"}


def lifts(source: Any) -> bool:
    """Return True for a plant of Drake in memory."""
    return isinstance(source, multibody.MultibodyPlant)


def lift(source: Any) -> Description:
    """Return the description of a file, or of a finalized plant [m, kg, rad].  Raises InputError with Drake's words."""
    if lifts(source):
        if not source.is_finalized():
            raise InputError("a plant of Drake that is not finalized; write plant.Finalize() before it is compared")
        return _described(source, "MultibodyPlant", "live", [])
    path = Path(source)
    told: list[str] = []
    plant = read_plant(path, told)
    return _described(plant, path.name, _format(path), told, path)


def read_plant(path: Path, messages: list[str]) -> Any:
    """Return the finalized plant of a file as Drake's parser reads it; messages : takes what it logs.  Raises InputError."""
    kind = _format(path)
    plant = multibody.MultibodyPlant(0.0)
    log_lines = _LogLines(messages)
    logger = logging.getLogger("drake")
    logger.addHandler(log_lines)
    passed_on, logger.propagate = logger.propagate, False
    try:
        parsing.Parser(plant).AddModels(str(path.resolve()))
        pull = read_stated(path).gravity if kind == "sdf" else None
        if pull is not None:
            plant.mutable_gravity_field().set_gravity_vector(pull)
            messages.append(
                f"gravity: Drake leaves out what an SDF says of it; taken as the file states it, {pull.tolist()} m/s^2"
            )
        if kind == "urdf":
            _hold(plant, _floating(read_xml(path)))
        plant.Finalize()
    except (RuntimeError, ValueError, SystemExit) as error:
        raise InputError(f"{path}: Drake refuses it: {' '.join(str(error).split())[:400]}") from None
    finally:
        logger.removeHandler(log_lines)
        logger.propagate = passed_on
    return plant


class _LogLines(logging.Handler):
    """Lines that Drake logs, each once."""

    def __init__(self, lines: list[str]) -> None:
        super().__init__(logging.WARNING)
        self.lines = lines

    def emit(self, record: logging.LogRecord) -> None:
        words = "Drake: " + " ".join(record.getMessage().split())[:300]
        if words not in self.lines:
            self.lines.append(words)


def _format(path: Path) -> str:
    return FORMATS.get(read_xml(path).tag, "sdf")


def _floating(robot: Element) -> set[str]:
    """The links that a URDF hangs on a floating joint: Drake leaves them free."""
    ends = [joint.find("child") for joint in robot.findall("joint") if joint.get("type") == "floating"]
    return {end.get("link", "") for end in ends if end is not None}


def _hold(plant: Any, free: set[str]) -> None:
    """Weld the roots that a URDF leaves open; SDF and MJCF say themselves what is free."""
    carried = {int(plant.get_joint(tree.JointIndex(k)).child_body().index()) for k in range(plant.num_joints())}
    for k in range(1, plant.num_bodies()):
        body = plant.get_body(tree.BodyIndex(k))
        if k not in carried and body.name() not in free:
            plant.WeldFrames(plant.world_frame(), body.body_frame())


def _described(plant: Any, label: str, kind: str, messages: list[str], path: Path | None = None) -> Description:
    names = _names(plant, messages)
    bodies = {names[k]: _inertia(plant.get_body(tree.BodyIndex(k))) for k in range(1, plant.num_bodies())}
    called = joint_names(plant, messages)
    rotors, gears, efforts = _actuators(plant, called)
    joints = [
        _begun(plant, _joint(plant.get_joint(tree.JointIndex(k)), called[k], names, rotors, efforts), k)
        for k in range(plant.num_joints())
    ]
    gravity = np.array(plant.gravity_field().gravity_vector())
    mechanism = assembled(label, bodies, joints, gravity, {})
    mechanism = _sprung(plant, mechanism, called)
    stated = read_stated(path) if kind == "sdf" and path is not None else SdfStatements()
    scopes = _scoped(plant, called)
    mechanism, lost = with_stated(mechanism, stated, lambda name: scopes.get(name, ""))
    if kind != "sdf":
        mechanism = replace(mechanism, closures=(*mechanism.closures, *_couplings(plant, mechanism, path, messages)))
    if stated.friction:
        lost = [*lost, "dry friction: Drake's plant has none; taken as the file states it"]
    printed = printed_of_sdf(read_xml(path)) if kind == "sdf" and path is not None else {}
    description = Description(
        label, mechanism, kind, "drake", gears, (*messages, *lost), printed, file=path, root_stated=kind != "urdf",
        gravity_stated=kind in ("mjcf", "live") or stated.gravity is not None,
        features=features_of(stated, dict(zip(_paths(plant), names[1:], strict=True))),
    )  # fmt: skip
    by_name = {name: plant.get_joint(tree.JointIndex(k)) for k, name in enumerate(called)}
    try:
        return replace(description, dynamics=dynamics_of(plant, mechanism, by_name, label))
    except InputError as error:
        return replace(description, unproven=str(error))


def _begun(plant: Any, joint: BodyJoint, number: int) -> BodyJoint:
    """A joint; a floating one counts from where its body is at the beginning, a screw has the axis that it turns about."""
    theirs = plant.get_joint(tree.JointIndex(number))
    context = plant.CreateDefaultContext()
    if joint.kind == "free":
        return replace(joint, on_parent=_placement(plant.GetFreeBodyPose(context, theirs.child_body())))
    if joint.kind == "helical":  # whose axis Drake's Python does not tell: sin(1) axis after a turn by 1 rad
        places = plant.GetPositions(context).copy()
        places[theirs.position_start()] = 1.0
        plant.SetPositions(context, places)
        pose = plant.CalcRelativeTransform(context, theirs.frame_on_parent(), theirs.frame_on_child())
        turn = np.array(pose.rotation().matrix())
        axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        return replace(joint, axis=axis / np.linalg.norm(axis))
    return joint


def _sprung(plant: Any, mechanism: Mechanism, called: list[str]) -> Mechanism:
    """The mechanism with springs of single joints, measured: Drake's Python does not tell the force elements of a plant.

    Without gravity and at rest the plant's force elements have at a joint  tau = -k (q - rest),  at q = 0 and q = 1.
    """
    field = plant.mutable_gravity_field()
    stated = np.array(field.gravity_vector())
    field.set_gravity_vector(np.zeros(3))
    context = plant.CreateDefaultContext()
    springs: dict[str, dict[str, float]] = {}
    for k, name in enumerate(called):
        joint = plant.get_joint(tree.JointIndex(k))
        if KINDS.get(joint.type_name()) in ("revolute", "prismatic"):
            still, moved = (_force(plant, context, joint, position) for position in (0.0, 1.0))
            if stiffness := still - moved:
                springs[name] = {"stiffness": stiffness, "rest": still / stiffness}
    field.set_gravity_vector(stated)
    joints = tuple(replace(joint, **springs.get(joint.name, {})) for joint in mechanism.joints)
    return replace(mechanism, joints=joints)


def _force(plant: Any, context: Any, joint: Any, position: float) -> float:
    """The generalized force [N m], [N] of all force elements at a joint, at a position [rad], [m] of it alone."""
    places = plant.GetPositions(context)
    moved = places.copy()
    moved[joint.position_start()] = position
    plant.SetPositions(context, moved)
    forces = tree.MultibodyForces(plant)
    plant.CalcForceElementsContribution(context, forces)
    plant.SetPositions(context, places)
    return float(forces.generalized_forces()[joint.velocity_start()])


def _paths(plant: Any) -> list[str]:
    """Scoped names of bodies by number, without the world."""
    bodies = [plant.get_body(tree.BodyIndex(k)) for k in range(1, plant.num_bodies())]
    return [f"{plant.GetModelInstanceName(body.model_instance())}::{body.name()}" for body in bodies]


def _scoped(plant: Any, called: list[str]) -> dict[str, str]:
    """Names of joints by their scoped names."""
    joints = [plant.get_joint(tree.JointIndex(k)) for k in range(plant.num_joints())]
    paths = [f"{plant.GetModelInstanceName(joint.model_instance())}::{joint.name()}" for joint in joints]
    return dict(zip(paths, called, strict=True))


def _names(plant: Any, messages: list[str]) -> list[str]:
    """Names of bodies by number, with that of their model where two are called the same; what is, is told."""
    bodies = [plant.get_body(tree.BodyIndex(k)) for k in range(1, plant.num_bodies())]
    return [WORLD, *_named("links", plant, bodies, messages)]


def joint_names(plant: Any, messages: list[str]) -> list[str]:
    """Return the names of joints by number [-], with that of their model where two are called the same; messages : takes that."""
    return _named("joints", plant, [plant.get_joint(tree.JointIndex(k)) for k in range(plant.num_joints())], messages)


def _named(kind: str, plant: Any, parts: list[Any], messages: list[str]) -> list[str]:
    plain = [part.name() for part in parts]
    paths = [f"{plant.GetModelInstanceName(part.model_instance())}::{part.name()}" for part in parts]
    names = unique_names(plain, paths, (WORLD,))
    messages += name_words(kind, plain, names)
    return names


def _inertia(body: Any) -> Inertia:
    found = body.default_spatial_inertia()
    mass, com = float(found.get_mass()), np.array(found.get_com())
    if mass == 0.0:
        return Inertia(0.0)
    about = np.array(found.CalcRotationalInertia().CopyToFullMatrix3())
    return Inertia(mass, com, about - mass * (com @ com * np.eye(3) - np.outer(com, com)))


def _actuators(plant: Any, called: list[str]) -> tuple[dict[str, float], dict[str, float], dict[str, float]]:
    """Reflected rotors [kg m^2], gears [-] and largest efforts [N m] by joint."""
    rotors: dict[str, float] = {}
    gears: dict[str, float] = {}
    efforts: dict[str, float] = {}
    for index in plant.GetJointActuatorIndices():
        actuator = plant.get_joint_actuator(index)
        name, gear = called[int(actuator.joint().index())], float(actuator.default_gear_ratio())
        rotors[name] = rotors.get(name, 0.0) + float(actuator.default_rotor_inertia()) * gear**2
        gears[name], efforts[name] = gear, float(actuator.effort_limit())
    return rotors, gears, efforts


def _joint(
    joint: Any, name: str, names: list[str], rotors: dict[str, float], efforts: dict[str, float]
) -> BodyJoint:  # fmt: skip
    word = joint.type_name()
    if word not in KINDS:
        raise InputError(f"joint {name!r} is {word}: expected one of {', '.join(KINDS)}")
    kind = KINDS[word]
    on_parent = joint.frame_on_parent().GetFixedPoseInBodyFrame()
    on_child = joint.frame_on_child().GetFixedPoseInBodyFrame()
    axes: dict[str, Any] = {}
    if kind == "fixed":
        on_parent = on_parent.multiply(joint.X_FM())
    elif kind == "universal":
        axes = {"axis": np.array([1.0, 0.0, 0.0]), "second_axis": np.array([0.0, 1.0, 0.0])}
    elif kind in ("revolute", "prismatic"):
        get = {"revolute": "revolute_axis", "prismatic": "translation_axis"}[kind]
        axes = {"axis": np.array(getattr(joint, get)())}
    ends = names[int(joint.parent_body().index())], names[int(joint.child_body().index())]
    own = dict(_own(joint, kind, rotors.get(name, 0.0), efforts.get(name, np.inf)))
    return BodyJoint(name, kind, *ends, _placement(on_parent), _placement(on_child), **axes, joint_fields=own)


def _own(joint: Any, kind: str, rotor: float, effort: float) -> Iterator[tuple[str, Any]]:
    """Yield limits [rad], [m] and passive numbers [N m s], [kg m^2] of a joint."""
    if kind in ("fixed", "free"):
        return
    if hasattr(joint, "default_damping"):
        yield "damping", float(np.ravel(joint.default_damping())[0])
    if rotor:
        yield "rotor_inertia", rotor
    if kind == "helical":
        yield "pitch", float(joint.screw_pitch())
    if kind in ("revolute", "prismatic"):
        bounds = [float(f()[0]) for f in (joint.position_lower_limits, joint.position_upper_limits)]
        speed = float(joint.velocity_upper_limits()[0])
        yield "limits", Limits(effort or np.inf, speed or np.inf, *bounds)


def _placement(pose: Any) -> Placement:
    return Placement(np.array(pose.translation()), np.array(pose.rotation().matrix()))


def _couplings(plant: Any, mechanism: Mechanism, path: Path | None, messages: list[str]) -> tuple[Closure, ...]:
    """Couplers of joints: Drake's Python does not tell them, so those of a URDF are what it mimics, if they are as many."""
    count = plant.num_constraints()
    if not count:
        return ()
    robot = None if path is None else read_xml(path)
    made = mimics(robot, mechanism, path)[0] if robot is not None and path is not None and robot.tag == "robot" else ()
    if len(made) == count:
        return made
    messages.append(f"{count} constraints: Drake's Python interface does not tell which joints they couple")
    return ()
