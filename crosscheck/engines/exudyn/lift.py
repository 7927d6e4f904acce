"""Lift of Exudyn's kinematic trees in memory: ``KinematicTree66``, ``ObjectKinematicTree``, ``Robot``, a ``MainSystem``.

    joints        one of Rx, Ry, Rz, Px, Py, Pz each, at the offset and with the rotation from the parent's joint frame
    links         their frame is that of their joint; a robot's link stands at ``localHT`` behind it
    inertia       about the centre of mass; of a ``KinematicTree66`` (6, 6) about the frame's origin, brought to the centre
    names         Exudyn has none: joint 0, joint 1, ..., to be matched by structure

Source: exudyn 1.13.6, kinematicTree.py, robotics/roboticsCore.py, ObjectKinematicTree.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import exudyn as exu
import numpy as np
from exudyn.itemInterface import ObjectKinematicTree
from exudyn.kinematicTree import KinematicTree66
from exudyn.rigidBodyUtilities import T66toHT
from exudyn.robotics import Robot

from crosscheck.engines.exudyn.own_dynamics import TreeData, build_dynamics
from crosscheck.lifting.assembly import BodyJoint, assembled
from crosscheck.lifting.description import Description
from crosscheck.lifting.rigid import apply_placement, inverse, move_inertia
from flexinv.errors import InputError
from flexinv.model.mechanism import WORLD, Inertia, Placement

KINDS = {"R": "revolute", "P": "prismatic"}
AXES = {"x": np.array([1.0, 0.0, 0.0]), "y": np.array([0.0, 1.0, 0.0]), "z": np.array([0.0, 0.0, 1.0])}
WORDS = {"Revolute": "R", "Prismatic": "P"}
READS = ()  # formats of files: none, models come in memory


class Part(NamedTuple):
    """A joint with its link: type such as Rz, number of the parent or -1, placement [m], inertia in the joint's frame."""

    type: str
    parent: int
    placement: Placement
    inertia: Inertia


def lifts(source: Any) -> bool:
    """Return True for a kinematic tree of Exudyn in memory."""
    return isinstance(source, KinematicTree66 | ObjectKinematicTree | Robot | exu.MainSystem)


def lift(source: Any, label: str = "") -> Description:
    """Return the description of a tree in memory [m, kg, rad].  Raises InputError for a system without one tree."""
    if not lifts(source):
        raise InputError(
            f"{source}: Exudyn reads no files of robots; give a kinematic tree, a Robot or a MainSystem in Python"
        )
    parts, gravity, told = _read_parts(source)
    name = label or type(source).__name__
    joints = [
        BodyJoint(
            f"joint {k}", KINDS[one.type[0]], f"link {one.parent}" if one.parent >= 0 else WORLD, f"link {k}",
            one.placement, axis=AXES[one.type[1].lower()],
        )
        for k, one in enumerate(parts)
    ]  # fmt: skip
    bodies = {f"link {k}": one.inertia for k, one in enumerate(parts)}
    mechanism = assembled(name, bodies, joints, np.array(gravity, dtype=float), {})
    description = Description(name, mechanism, "live", "exudyn")
    try:
        return replace(description, dynamics=build_dynamics(source, told, mechanism))
    except InputError as error:
        return replace(description, unproven=str(error))


def _read_parts(source: Any) -> tuple[list[Part], Any, TreeData | None]:
    """Parts, gravity [m/s^2], and the dictionary of an object of a system."""
    if isinstance(source, KinematicTree66):
        return list(_read_tree66(source)), source.gravity, None
    if isinstance(source, Robot):
        return list(_read_robot(source)), source.gravity, None
    told = _find_system_tree(source) if isinstance(source, exu.MainSystem) else source.GetDictionary()
    return list(_read_tree_object(told)), told["gravity"], told


def _read_tree66(tree: Any) -> Iterator[Part]:
    for k, kind in enumerate(tree.jointTypes):
        back = np.asarray(T66toHT(np.asarray(tree.transformations[k])))  # child X parent: the parent in the child
        about = np.asarray(tree.inertias[k])
        mass = float(about[5, 5])
        first = about[:3, 3:]  # m [c]x
        com = np.array([first[2, 1], first[0, 2], first[1, 0]]) / (mass or 1.0)
        tensor = about[:3, :3] - mass * (com @ com * np.eye(3) - np.outer(com, com))
        at = inverse(Placement(back[:3, 3], back[:3, :3]))
        yield Part(kind, int(tree.parents[k]), at, Inertia.build_unchecked(mass, com, tensor))


def _read_robot(robot: Any) -> Iterator[Part]:
    behind = [_convert_placement(link.localHT) for link in robot.links]
    for k, link in enumerate(robot.links):
        parent = int(robot.GetParentIndex(k)) if robot.HasParent(k) else -1
        carrier = behind[parent] if parent >= 0 else _convert_placement(robot.GetBaseHT())
        body = Inertia.build_unchecked(
            float(link.mass), np.array(link.COM, dtype=float), np.array(link.inertia, dtype=float)
        )
        yield Part(
            link.jointType,
            parent,
            apply_placement(carrier, _convert_placement(link.preHT)),
            move_inertia(behind[k], body),
        )


def _convert_placement(transformation: Any) -> Placement:
    full = transformation.HT44() if hasattr(transformation, "HT44") else transformation
    pose = np.array(full, dtype=float)
    return Placement(pose[:3, 3], pose[:3, :3])


def _find_system_tree(system: Any) -> TreeData:
    count = system.systemData.NumberOfObjects()
    trees = [told for k in range(count) if (told := system.GetObject(k))["objectType"] == "KinematicTree"]
    if len(trees) != 1:
        raise InputError(
            f"a MainSystem with {len(trees)} kinematic trees: expected one; give the ObjectKinematicTree itself"
        )
    system_tree: TreeData = trees[0]
    return system_tree


def _read_tree_object(data: TreeData) -> Iterator[Part]:
    base = Placement(np.array(data.get("baseOffset", np.zeros(3)), dtype=float))
    for k, kind in enumerate(data["jointTypes"]):
        word = str(kind).rpartition(".")[2]
        name = next((letter + word[-1].lower() for start, letter in WORDS.items() if word.startswith(start)), None)
        if name is None:
            raise InputError(f"joint {k} of the tree is {word}: expected Revolute or Prismatic about X, Y or Z")
        parent = int(data["linkParents"][k])
        at = _read_joint_frame(data, k)
        com, inertia = (
            np.array(_convert_to_lists(items)[k], dtype=float) for items in (data["linkCOMs"], data["linkInertiasCOM"])
        )
        yield Part(
            name,
            parent,
            at if parent >= 0 else apply_placement(base, at),
            Inertia.build_unchecked(float(data["linkMasses"][k]), com, inertia),
        )


def _read_joint_frame(data: TreeData, k: int) -> Placement:
    if data.get("jointHTs") is not None and len(_convert_to_lists(data["jointHTs"])):
        return _convert_placement(_convert_to_lists(data["jointHTs"])[k])
    offset, turn = (
        np.array(_convert_to_lists(items)[k], dtype=float)
        for items in (data["jointOffsets"], data["jointTransformations"])
    )
    return Placement(offset, turn)


def _convert_to_lists(items: Any) -> Any:
    """Exudyn's lists of vectors and matrices as plain ones."""
    return items.GetPythonObject() if hasattr(items, "GetPythonObject") else items
