"""USD by the reader of its authors (package usd-core): the bodies, masses and joints of UsdPhysics as a mechanism.

    bodies        prims with RigidBodyAPI; their frame is the prim's, without its scale, which lengths are multiplied with
    masses        as `ComputeMassProperties` of UsdPhysics gives them: what MassAPI states, else density and shapes
    joints        revolute, prismatic, spherical, fixed; one of six axes by those that are free, slides first, with bodies
                  without mass between; limits of revolute ones are in degrees; a joint that is excluded from
                  the articulation closes a loop
    passive       armature, damping, friction, springs, mimics of engines' own attributes: `usd_joints`
    features      what engines do and no mechanism can say: `usd_features`
    proof         none: usd-core computes no dynamics
    drives        DriveAPI states gains of a controller, per degree: they are told, and are no part of a mechanism
    units         of the stage: metersPerUnit, kilogramsPerUnit; a stage whose up axis is Y is turned to Z

Source: https://openusd.org/release/api/usd_physics_page_front.html
"""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from crosscheck.lifting.assembly import BodyJoint, JointFields, assembled
from crosscheck.lifting.description import Description
from crosscheck.lifting.names import name_words, unique_names
from crosscheck.lifting.reader_dynamics import Feature
from crosscheck.lifting.rigid import apply_placement, compute_relative_pose, turned
from crosscheck.lifting.usd_features import find_features, find_scenes, has_gravity, is_in_radians, read_disabled_flags
from crosscheck.lifting.usd_joints import (
    JointPrim,
    Units,
    build_couplings,
    read_effort_limit,
    read_passive_values,
    read_speed_limit,
)
from flexinv.errors import InputError
from flexinv.model.mechanism import WORLD, Array, Inertia, Limits, Placement

PACKAGE = "usd-core"
SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
AXES = {"X": np.array([1.0, 0.0, 0.0]), "Y": np.array([0.0, 1.0, 0.0]), "Z": np.array([0.0, 0.0, 1.0])}
EARTH = 9.81  # [m/s^2], what a scene without a magnitude means
SINGLE = float(np.finfo(np.float32).eps)
UNPROVEN = "usd-core reads the stage and computes no dynamics to hold it against"


def can_read_usd() -> bool:
    """Return True if usd-core is installed."""
    return importlib.util.find_spec("pxr") is not None


def lift_usd(path: Path) -> Description:
    """Return the mechanism of a USD stage [m, kg, rad] and what it drops.  Raises InputError."""
    from pxr import Tf, Usd  # an extra, and 30 MB: loaded when a stage is read

    if path.suffix.lower() not in SUFFIXES:
        raise InputError(
            f"{path}\n  given:    what begins as USD, under the suffix {path.suffix or 'none'}\n"
            f"  expected: one of {', '.join(SUFFIXES)}, by which USD's own library knows its formats\n"
            "  write:    the file under its own suffix; or, if it is no USD, the file of the machine"
        )
    try:
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        raise InputError(
            f"{path}\n  given:    what USD refuses: {_format_error(error)}\n  expected: a stage that USD's own library opens\n"
            "  write:    usdcat FILE, which shows where it breaks; or the file as it was exported"
        ) from None
    return _Stage(stage, path).build_description()


def _format_error(error: Exception) -> str:
    """Return the library's message without the places of its own code."""
    said = re.findall(r" : '(.*?)'\s*$", str(error), re.DOTALL | re.MULTILINE) or [str(error)]
    plain = [re.sub(r"pxrInternal\w*?__", "", " ".join(words.split())) for words in said]
    return "; ".join(dict.fromkeys(plain))[:300]


@dataclass
class _Stage:
    """One stage: its units, bodies by prim path, bodies without mass between axes of one joint, and what is dropped."""

    stage: Any
    path: Path
    dropped: list[str] = field(default_factory=list)
    between: list[str] = field(default_factory=list)
    features: list[Feature] = field(default_factory=list)
    joint_prims: dict[Any, JointPrim] = field(default_factory=dict)

    def __post_init__(self) -> None:
        from pxr import UsdGeom, UsdPhysics

        self.meter = float(UsdGeom.GetStageMetersPerUnit(self.stage))
        self.kilogram = float(UsdPhysics.GetStageKilogramsPerUnit(self.stage))
        self.radian = is_in_radians(self.stage)
        self.units = Units(self.meter, self.kilogram, self.radian is not False)
        self.flags_off = read_disabled_flags(self.stage)
        self.up = UsdGeom.GetStageUpAxis(self.stage)
        self.world = turned(AXES["X"], np.pi / 2) if self.up == "Y" else np.eye(3)
        self.cache = UsdGeom.XformCache()
        every = list(self.stage.Traverse())
        self.names = self.make_names(
            "bodies", [p for p in every if p.HasAPI(UsdPhysics.RigidBodyAPI) and _is_enabled(p)]
        )
        self.tied = [p for p in every if p.IsA(UsdPhysics.Joint) and _is_tying(p)]
        self.joint_names = self.make_names("joints", self.tied)

    def make_names(self, kind: str, prims: list[Any]) -> dict[Any, str]:
        """Return names of bodies or joints by prim path [-]: where one stands twice, the path; said in `dropped`."""
        plain = [p.GetName() for p in prims]
        paths = [p.GetPath() for p in prims]
        names = unique_names(plain, [str(path).lstrip("/") for path in paths], (WORLD,))
        self.dropped += name_words(kind, plain, names)
        return dict(zip(paths, names, strict=True))

    def build_description(self) -> Description:
        """Return the description of the stage [m, kg, rad]."""
        if not self.names:
            raise InputError(
                f"{self.path}\n  given:    a stage without bodies\n  expected: prims with PhysicsRigidBodyAPI\n"
                "  write:    the file with the physics, if this one holds shapes only"
            )
        if self.up == "Y":
            self.dropped.append("up axis Y: the world is turned so that Z is up")
        bodies = {name: self.read_inertia(self.stage.GetPrimAtPath(path)) for path, name in self.names.items()}
        poses = {name: self.compute_pose(self.stage.GetPrimAtPath(path))[0] for path, name in self.names.items()}
        joints = [one for p in self.tied for one in self.list_joints(p)]
        bodies |= {name: Inertia(0.0) for name in self.between}
        gravity, stated = self.read_gravity()
        label = self.path.name
        mechanism = assembled(label, bodies, joints, gravity, poses)
        laws, lost, features = build_couplings(self.joint_prims)
        mechanism = replace(mechanism, closures=(*mechanism.closures, *laws))
        features += [*self.features, *find_features(self.stage, self.names)]
        return Description(
            label, mechanism, "usd", "usd-core", {}, (*self.dropped, *lost), file=self.path, gravity_stated=stated,
            precision=SINGLE,  # its vectors and masses are single precision
            features=tuple(features), unproven=UNPROVEN,
        )  # fmt: skip

    def compute_pose(self, prim: Any) -> tuple[Placement, Array]:
        """Return a prim's frame in the world [m], and its scale (3,) [-]."""
        matrix = np.array(self.cache.GetLocalToWorldTransform(prim))
        scale = np.linalg.norm(matrix[:3, :3], axis=1)
        rotation = (matrix[:3, :3] / scale[:, None]).T
        return Placement(self.world @ matrix[3, :3] * self.meter, self.world @ rotation), scale

    def read_inertia(self, prim: Any) -> Inertia:
        """Return mass [kg], centre [m] and tensor [kg m^2] of a body, in its frame."""
        stated = [prim.GetAttribute(f"physics:{key}").Get() for key in ("mass", "diagonalInertia", "centerOfMass")]
        mass, moments, com = (np.zeros(3) if value is None else np.array(value, dtype=float) for value in stated)
        turn = _convert_quaternion(prim.GetAttribute("physics:principalAxes").Get())
        there = {
            "mass": mass.any(),
            "inertia": moments.any(),
            "centre": stated[2] is not None and np.isfinite(com).all(),
        }
        missing = [key for key, known in there.items() if not known]
        if missing:
            mass, moments, com, turn = self.compute_mass_properties(prim, missing, turn)
        unit = self.kilogram * self.meter**2
        tensor = turn @ np.diag(moments) @ turn.T
        whole = prim.GetAttribute("newton:inertia").Get()
        if whole is not None and len(whole) == 6:
            tensor = np.array(whole, dtype=float)[[[0, 3, 4], [3, 1, 5], [4, 5, 2]]]
        scale = self.compute_pose(prim)[1]
        return Inertia.build_unchecked(
            float(np.ravel(mass)[0]) * self.kilogram, com * scale * self.meter, unit * tensor
        )

    def compute_mass_properties(self, prim: Any, missing: list[str], turn: Array) -> tuple[Any, Array, Array, Array]:
        """Return mass, moments, centre and axes as UsdPhysics computes them from what is stated and from shapes."""
        from pxr import UsdPhysics

        from crosscheck.lifting.usd_shapes import compute_shape_mass

        shapes: list[Any] = []

        def add_shape_mass(shape: Any) -> Any:
            shapes.append(shape)
            return compute_shape_mass(shape, prim, self.cache)

        found = UsdPhysics.RigidBodyAPI(prim).ComputeMassProperties(add_shape_mass)
        mass = found[0]
        moments = np.array(found[1], dtype=float)
        com = np.array(found[2], dtype=float)
        if not shapes and ("mass" in missing or "inertia" in missing):
            raise InputError(
                f"{self.path}\n  given:    body {prim.GetName()!r} without {' and '.join(missing)}, and without colliders\n"
                "  expected: a mass and moments of inertia\n  write:    physics:mass, physics:diagonalInertia"
            )
        return mass, moments, com, _convert_quaternion(found[3]) if "inertia" in missing else turn

    def list_joints(self, prim: Any) -> Iterator[BodyJoint]:
        """Yield a joint between two bodies, by axis where it has several; none, with a line on that, where it ties none."""
        from pxr import UsdPhysics

        name = self.joint_names[prim.GetPath()]
        steps = self.split_joint(prim)
        joint = UsdPhysics.Joint(prim)
        first = self.end(joint, 0)
        second = self.end(joint, 1)
        if first[0] == second[0] or not steps:
            words = f"both of its ends are on {first[0]}" if steps else "all of its axes are free"
            self.dropped.append(f"joint {name}: {words}")
            return
        closes = bool(joint.GetExcludeFromArticulationAttr().Get())
        ends = [first]
        kind = steps[0][0]
        single = len(steps) == 1 and kind in ("revolute", "prismatic") and not closes
        self.joint_prims[prim.GetPath()] = JointPrim(
            prim, name if single else "", kind, self.units.compute_coordinate_unit(kind)
        )
        for _, axis in steps[:-1]:
            between = f"{name} after {axis}"
            self.between.append(between)
            ends.append((between, Placement()))
        ends.append((second[0], Placement()))
        for k, (kind, axis) in enumerate(steps):
            called = f"{name}.{axis}" if len(steps) > 1 else name
            drive = self.read_drive(prim, called, kind, axis[-1:])
            on_child, last = (second[1], True) if k == len(steps) - 1 else (Placement(), False)
            yield BodyJoint(
                called, kind, ends[k][0], ends[k + 1][0], ends[k][1], on_child,
                AXES[axis[-1:] if kind != "spherical" else "Z"], joint_fields=drive, closes=closes and last,
            )  # fmt: skip

    def split_joint(self, prim: Any) -> list[tuple[str, str]]:
        """Return kind and axis of the joints, one after the other, that a joint is [-]; none where all is free."""
        name = self.joint_names[prim.GetPath()]
        kind = prim.GetTypeName().removeprefix("Physics").removesuffix("Joint").lower()
        if kind == "":
            return self.list_free_axes(prim)
        if kind not in ("revolute", "prismatic", "spherical", "fixed"):
            raise InputError(
                f"{self.path}\n  given:    joint {name!r} of type {prim.GetTypeName()}\n"
                "  expected: a revolute, prismatic, spherical or fixed joint, or a PhysicsJoint with limits\n"
                "  write:    its free axes as such joints, one after the other"
            )
        cones = [prim.GetAttribute(f"physics:coneAngle{k}Limit").Get() for k in (0, 1)]
        if kind == "spherical" and any(cone is not None and 0 <= cone < np.inf for cone in cones):
            self.dropped.append(f"joint {name}: the cone that limits a ball joint is no part of a mechanism")
        return [(kind, prim.GetAttribute("physics:axis").Get() or "Z")]

    def list_free_axes(self, prim: Any) -> list[tuple[str, str]]:
        """Return the free axes of a joint of six: those that its limits do not lock (low above high) [-].

        Translations come first, along the axes of the first body.  Of two rotations USD states no order.
        """
        slides = self._list_movable_axes(prim, "trans")
        turns = self._list_movable_axes(prim, "rot")
        name = self.joint_names[prim.GetPath()]
        steps = [("prismatic", axis) for axis in slides]
        if len(turns) == 3:
            if len(slides) == 3:
                return []
            if any(np.isfinite(end) for axis in turns for end in self._read_axis_limits(prim, axis)):
                self.dropped.append(f"joint {name}: the limits of its three rotations are no part of a ball joint")
            return [*steps, ("spherical", "rot")]
        if len(turns) == 2:
            one, two = (axis[-1] for axis in turns)
            self.dropped.append(
                f"joint {name}: USD states no order of its two free rotations; taken as about {one} of the first body, then "
                f"about {two} of the second"
            )
        steps += [("revolute", axis) for axis in turns]
        return steps or [("fixed", "Z")]

    def _list_movable_axes(self, prim: Any, way: str) -> list[str]:
        return [f"{way}{axis}" for axis in AXES if self._can_move(prim, f"{way}{axis}")]

    def _read_axis_limits(self, prim: Any, axis: str) -> list[float]:
        """The low and the high end of a free axis [degree], [unit of the stage]; infinite where it is not stated."""
        stated = [prim.GetAttribute(f"limit:{axis}:physics:{end}").Get() for end in ("low", "high")]
        return [np.inf if end is None else float(end) for end in stated]

    def _can_move(self, prim: Any, axis: str) -> bool:
        low, high = (prim.GetAttribute(f"limit:{axis}:physics:{end}").Get() for end in ("low", "high"))
        return low is None or high is None or low <= high

    def end(self, joint: Any, which: int) -> tuple[str, Placement]:
        """Return the body of one end of a joint, and the joint's frame there [m]."""
        targets = (joint.GetBody0Rel() if which == 0 else joint.GetBody1Rel()).GetTargets()
        place, turn = (joint.GetPrim().GetAttribute(f"physics:{key}{which}").Get() for key in ("localPos", "localRot"))
        prim = self.stage.GetPrimAtPath(targets[0]) if targets else None
        if prim is None or not prim.IsValid():
            return WORLD, Placement(
                self.world @ np.array(place, dtype=float) * self.meter, self.world @ _convert_quaternion(turn)
            )
        frame, scale = self.compute_pose(prim)
        local = Placement(np.array(place, dtype=float) * scale * self.meter, _convert_quaternion(turn))
        while prim.IsValid() and prim.GetPath() not in self.names and not prim.IsPseudoRoot():
            prim = prim.GetParent()
        if prim.GetPath() not in self.names:
            return WORLD, apply_placement(frame, local)
        return self.names[prim.GetPath()], apply_placement(
            compute_relative_pose(self.compute_pose(prim)[0], frame), local
        )

    def read_drive(self, prim: Any, name: str, kind: str, axis: str) -> JointFields:
        """Return limits [rad], [m] and passive numbers of a joint; gains of its drive are dropped."""
        if kind == "fixed":
            return {}
        passive_values = read_passive_values(prim, name, kind, axis, self.units, self.flags_off)
        self.dropped += passive_values.notes
        self.features += passive_values.features
        if kind == "revolute" and passive_values.joint_fields.get("rest") and self.radian is None:
            self.dropped.append(f"mjc:springref of joint {name}: no scene states mjc:compiler:angle; read as radians")
        if kind == "spherical":
            return passive_values.joint_fields
        return {"limits": self.read_limits(prim, name, kind, axis), **passive_values.joint_fields}

    def read_limits(self, prim: Any, name: str, kind: str, axis: str) -> Limits:
        """Return the limits of a joint [rad], [m], [N m], [N], [rad/s], [m/s]; gains of its drive are told."""
        unit = self.units.compute_coordinate_unit(kind)
        turn = "angular" if kind == "revolute" else "linear"
        keys = ("physics:lowerLimit", "physics:upperLimit")
        six = prim.GetTypeName() == "PhysicsJoint"
        if six:
            turn = f"{'rot' if kind == 'revolute' else 'trans'}{axis}"
            keys = (f"limit:{turn}:physics:low", f"limit:{turn}:physics:high")
        stated = [prim.GetAttribute(key).Get() for key in keys]
        low, high = (end if value is None else value for value, end in zip(stated, (-np.inf, np.inf), strict=True))
        most = min(read_effort_limit(prim, kind, self.units), self._read_drive_limit(prim, name, kind, turn))
        fastest = read_speed_limit(prim, kind, axis if six else "", self.units)
        return Limits(most, fastest, *(float(x) * unit if np.isfinite(x) else float(x) for x in (low, high)))

    def _read_drive_limit(self, prim: Any, name: str, kind: str, turn: str) -> float:
        """Return the largest effort of a joint's drive [N m], [N], infinite where there is none; its gains are told."""
        drive = f"drive:{turn}:physics"
        if not (prim.HasAttribute(f"{drive}:stiffness") or prim.HasAttribute(f"{drive}:damping")):
            return np.inf
        unit = self.units.compute_coordinate_unit(kind)
        force = self.units.compute_effort_unit(kind)
        gains = [prim.GetAttribute(f"{drive}:{key}").Get() or 0.0 for key in ("stiffness", "damping")]
        told = [f"{float(gain) * force / unit:.6g}" for gain in gains]
        words = f"stiffness {told[0]}, damping {told[1]} per {'radian' if kind == 'revolute' else 'metre'}"
        self.dropped.append(f"drive of joint {name}: {words} are gains of a controller")
        most = prim.GetAttribute(f"{drive}:maxForce").Get()
        return float(most) * force if most is not None and np.isfinite(most) and most > 0 else np.inf

    def read_gravity(self) -> tuple[Array, bool]:
        """Return gravity (3,) [m/s^2] as the scene states it, and whether there is a scene that does."""
        from pxr import UsdPhysics

        down = -AXES[self.up]
        prims = find_scenes(self.stage)
        if not prims:
            return self.world @ down * EARTH, False
        if not has_gravity(prims[0]):
            return np.zeros(3), True
        scene = UsdPhysics.Scene(prims[0])
        along = np.array(scene.GetGravityDirectionAttr().Get(), dtype=float)
        size = float(scene.GetGravityMagnitudeAttr().Get())
        length = float(np.linalg.norm(along))
        pull = size * self.meter if np.isfinite(size) and size >= 0 else EARTH
        return self.world @ (along / length if length else down) * pull, True


def _is_enabled(prim: Any) -> bool:
    value = prim.GetAttribute("physics:rigidBodyEnabled").Get()
    return value is None or bool(value)


def _is_tying(prim: Any) -> bool:
    value = prim.GetAttribute("physics:jointEnabled").Get()
    return value is None or bool(value)


def _convert_quaternion(quaternion: Any) -> Array:
    """The rotation (3, 3) [-] of one of Gf's quaternions; of none, or of zeros, which mean that, the identity."""
    if quaternion is None:
        return np.eye(3)
    w = float(quaternion.GetReal())
    x, y, z = (float(c) for c in quaternion.GetImaginary())
    size = np.sqrt(w * w + x * x + y * y + z * z)
    if size == 0.0:
        return np.eye(3)
    w, x, y, z = (c / size for c in (w, x, y, z))
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
