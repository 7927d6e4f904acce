"""Lift of Drake's plants: URDF, SDF and MJCF as Drake's parser reads them, or a ``MultibodyPlant`` in memory, as a mechanism.

    bodies        a link each; their frame is moved to the joint that carries them
    joints        revolute, prismatic, screw, universal (axes x, y of its frames), ball, weld, floating
    drives        damping of the joint, rotor inertia and gear of its actuator: rotor gear^2 at the joint; dry friction unknown
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

import numpy as np
from pydrake.multibody import parsing, tree
from pydrake.multibody import plant as multibody

from crosscheck.lifting.assembly import Between, assembled
from crosscheck.lifting.description import Description
from crosscheck.lifting.names import name_words, unique_names
from crosscheck.lifting.printed import printed_of_sdf
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
    kind = _format(path)
    plant = multibody.MultibodyPlant(0.0)
    told = _Told()
    logger = logging.getLogger("drake")
    logger.addHandler(told)
    passed_on, logger.propagate = logger.propagate, False
    try:
        parser = parsing.Parser(plant)
        parser.AddModels(str(path.resolve()))
        if kind != "sdf":
            _hold(plant)
        plant.Finalize()
    except (RuntimeError, ValueError, SystemExit) as error:
        raise InputError(f"{path}: Drake refuses it: {' '.join(str(error).split())[:400]}") from None
    finally:
        logger.removeHandler(told)
        logger.propagate = passed_on
    return _described(plant, path.name, kind, told.lines, path)


class _Told(logging.Handler):
    """Lines that Drake logs, each once."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        words = "Drake: " + " ".join(record.getMessage().split())[:300]
        if words not in self.lines:
            self.lines.append(words)


def _format(path: Path) -> str:
    return FORMATS.get(read_xml(path).tag, "sdf")


def _hold(plant: Any) -> None:
    """Weld roots that the file leaves free: a URDF does not say, an MJCF says so by a free joint of its own."""
    carried = {int(plant.get_joint(tree.JointIndex(k)).child_body().index()) for k in range(plant.num_joints())}
    for k in range(1, plant.num_bodies()):
        if k not in carried:
            plant.WeldFrames(plant.world_frame(), plant.get_body(tree.BodyIndex(k)).body_frame())


def _described(plant: Any, label: str, kind: str, told: list[str], path: Path | None = None) -> Description:
    names = _names(plant, told)
    bodies = {names[k]: _inertia(plant.get_body(tree.BodyIndex(k))) for k in range(1, plant.num_bodies())}
    called = _joint_names(plant, told)
    rotors, gears, efforts = _actuators(plant, called)
    joints = [
        _joint(plant.get_joint(tree.JointIndex(k)), called[k], names, rotors, efforts)
        for k in range(plant.num_joints())
    ]
    gravity = np.array(plant.gravity_field().gravity_vector())
    mechanism = assembled(label, bodies, joints, gravity, {})
    closures = (*mechanism.closures, *_couplings(plant, mechanism, path, told))
    mechanism = replace(mechanism, closures=closures)
    pulled = kind in ("mjcf", "live")  # Drake leaves out what an SDF says of gravity
    printed = printed_of_sdf(read_xml(path)) if kind == "sdf" and path is not None else {}
    held = kind != "urdf"
    return Description(
        label, mechanism, kind, "drake", gears, tuple(told), printed, file=path, root_stated=held, gravity_stated=pulled
    )


def _names(plant: Any, told: list[str]) -> list[str]:
    """Names of bodies by number, with that of their model where two are called the same; what is, is told."""
    bodies = [plant.get_body(tree.BodyIndex(k)) for k in range(1, plant.num_bodies())]
    return [WORLD, *_named("links", plant, bodies, told)]


def _joint_names(plant: Any, told: list[str]) -> list[str]:
    """Names of joints by number, as those of bodies."""
    return _named("joints", plant, [plant.get_joint(tree.JointIndex(k)) for k in range(plant.num_joints())], told)


def _named(kind: str, plant: Any, parts: list[Any], told: list[str]) -> list[str]:
    plain = [part.name() for part in parts]
    paths = [f"{plant.GetModelInstanceName(part.model_instance())}::{part.name()}" for part in parts]
    names = unique_names(plain, paths, (WORLD,))
    told += name_words(kind, plain, names)
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
) -> Between:  # fmt: skip
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
    elif kind in ("revolute", "prismatic", "helical"):
        get = {"revolute": "revolute_axis", "prismatic": "translation_axis", "helical": "screw_axis"}[kind]
        axes = {"axis": np.array(getattr(joint, get)())}
    ends = names[int(joint.parent_body().index())], names[int(joint.child_body().index())]
    own = dict(_own(joint, kind, rotors.get(name, 0.0), efforts.get(name, np.inf)))
    return Between(name, kind, *ends, _placement(on_parent), _placement(on_child), **axes, own=own)


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


def _couplings(plant: Any, mechanism: Mechanism, path: Path | None, told: list[str]) -> tuple[Closure, ...]:
    """Couplers of joints: Drake's Python does not tell them, so those of a URDF are what it mimics, if they are as many."""
    count = plant.num_constraints()
    if not count:
        return ()
    robot = None if path is None else read_xml(path)
    made = mimics(robot, mechanism, path)[0] if robot is not None and path is not None and robot.tag == "robot" else ()
    if len(made) == count:
        return made
    told.append(f"{count} constraints: Drake's Python interface does not tell which joints they couple")
    return ()
