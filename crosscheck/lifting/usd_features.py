"""Features of a stage: what engines make of its scene, bodies and unknown prims, and no mechanism can say; the scene's gravity.

fluid, gravcomp     MuJoCo's density, viscosity, wind, ``mjc:body:gravcomp``; PhysX's ``disableGravity`` compensates all of it
body-damping        PhysX's linear and angular damping of bodies
tendon, gear        tendons of PhysX and MuJoCo, joints of types that usd-core does not know
gravity             none where ``newton:gravityEnabled`` or ``mjc:flag:gravity`` switch it off
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from crosscheck.lifting.reader_dynamics import Feature, Parameter
from crosscheck.lifting.usd_joints import read_number

FLAGS = ("spring", "damper", "frictionloss")
FLUID = ("density", "viscosity")
TENDON = "Tendon"


def read_disabled_flags(stage: Any) -> frozenset[str]:
    """Return the flags of MuJoCo's that the stage's scenes switch off [-]: "mjc:flag:spring"."""
    keys = [f"mjc:flag:{flag}" for flag in FLAGS]
    return frozenset(key for prim in find_scenes(stage) for key in keys if prim.GetAttribute(key).Get() is False)


def find_scenes(stage: Any) -> list[Any]:
    """Return the prims that are a scene."""
    from pxr import UsdPhysics  # an extra, loaded when a stage is read

    return [prim for prim in stage.Traverse() if prim.IsA(UsdPhysics.Scene)]


def has_gravity(scene: Any) -> bool:
    """Return False where a scene switches gravity off."""
    keys = "newton:gravityEnabled", "mjc:flag:gravity"
    return not any(scene.GetAttribute(key).HasAuthoredValue() and not scene.GetAttribute(key).Get() for key in keys)


def is_in_radians(stage: Any) -> bool | None:
    """Return True if MuJoCo's attributes have angles in radians; None where no scene states it."""
    for prim in find_scenes(stage):
        attribute = prim.GetAttribute("mjc:compiler:angle")
        if attribute.HasAuthoredValue():
            return str(attribute.Get()) == "radian"
        if "MjcSceneAPI" in list_api_schemas(prim):
            return False  # what the schema falls back on
    return None


def list_api_schemas(prim: Any) -> list[str]:
    """Return the names of applied schemas [-] as they are written, known to usd-core or not."""
    listed = prim.GetMetadata("apiSchemas")
    return [] if listed is None else [str(name) for name in listed.GetAddedOrExplicitItems()]


def find_features(stage: Any, bodies: Mapping[Any, str]) -> Iterator[Feature]:
    """Yield the features of scenes, bodies and prims that no joint's numbers are; bodies : names by prim path."""
    for prim in find_scenes(stage):
        numbers: dict[str, Parameter] = {key: read_number(prim, f"mjc:option:{key}") or 0.0 for key in FLUID}
        if any(numbers.values()):
            wind = prim.GetAttribute("mjc:option:wind").Get()
            numbers["wind"] = tuple(float(x) for x in (np.zeros(3) if wind is None else np.ravel(wind)))
            yield Feature("fluid", "the world", numbers)
    for path, name in bodies.items():
        yield from _list_body_features(stage.GetPrimAtPath(path), name)
    for prim in stage.Traverse():
        yield from _list_unknown_features(prim)


def _list_body_features(prim: Any, name: str) -> Iterator[Feature]:
    floats = prim.GetAttribute("physxRigidBody:disableGravity").Get()
    if value := 1.0 if floats else read_number(prim, "mjc:body:gravcomp"):
        yield Feature("gravcomp", f"link {name}", {"gravcomp": value})
    numbers: dict[str, Parameter] = {}
    for key in ("linearDamping", "angularDamping"):
        if value := read_number(prim, f"physxRigidBody:{key}"):
            numbers[key] = value
    if numbers:
        yield Feature("body-damping", f"link {name}", numbers)


def _list_unknown_features(prim: Any) -> Iterator[Feature]:
    """Yield a joint whose type usd-core does not know, such as a gear of PhysX, and tendons."""
    kind = str(prim.GetTypeName())
    place = f"prim {prim.GetPath()}"
    if kind.startswith("Physx") and kind.endswith("Joint"):
        ratio = read_number(prim, "physics:gearRatio") or read_number(prim, "physics:ratio") or 0.0
        yield Feature("gear", place, {"kind": kind, "ratio": ratio}, felt=False)
    names = [name for name in list_api_schemas(prim) if TENDON in name]
    if TENDON in kind or names:
        yield Feature("tendon", place, {"kind": names[0] if names else kind})
