"""Mistakes in an engine's own model after it is built, or in its switches: what no mechanism file shows."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np

from crosscheck.beyond import edits
from crosscheck.beyond.fault import ALL, Chapter, Fault, Scene, Truth, pick
from flexinv.model.mechanism import Joint, Mechanism

CHAPTER = Chapter("inside the engine")
LEAST = 1e-2  # [kg m^2]: what MuJoCo's boundinertia is set to in many model files found on the net


def _mujoco_harm() -> Any:
    """The module that knows MuJoCo, on machines that have it: a scene of MuJoCo is drawn on no other."""
    return importlib.import_module("crosscheck.engines.mujoco.harm")


def _pinocchio_harm() -> Any:
    """The module that knows Pinocchio."""
    return importlib.import_module("crosscheck.engines.pinocchio.harm")


def _joint_of(scene: Scene, rng: np.random.Generator) -> Joint | None:
    found: Joint | None = pick(rng, [j for j in scene.mechanism.joints if j.nv == 1])
    return found


def _built(
    words: str,
    kinds: tuple[str, ...],
    at: tuple[str, ...],
    change: Callable[[Any, Mechanism], None],
    near: tuple[str, ...] = (),
) -> Fault:
    return Fault(words, ((Truth(kinds, at),),), (Truth(near, at),) if near else (), built=change)


def _mujoco(scene: Scene) -> bool:
    return scene.engine == "mujoco"


@CHAPTER("body in MuJoCo", 0.99, 1.05)
def mujoco_mass(scene: Scene, rng: np.random.Generator, size: float) -> Fault | None:
    """body_mass of a compiled model was changed, body_inertia was not."""
    if not _mujoco(scene) or scene.mechanism.urdf is not None:
        return None
    link, body = pick(rng, edits.moving(scene.mechanism))

    def change(built: Any, mechanism: Mechanism) -> None:
        _mujoco_harm().body_mass(built, f"{link.name}/{body.name}", size)

    at = edits.places(scene.mechanism, link.name, body.name)
    return _built(f"body_mass of {link.name} x{size}", ("mass",), at, change, ("com", "inertia", "payload"))


@CHAPTER("ipos in MuJoCo", 1e-3)
def mujoco_ipos(scene: Scene, rng: np.random.Generator, size: float) -> Fault | None:
    """body_ipos of a compiled model is off by some millimetres."""
    if not _mujoco(scene) or scene.mechanism.urdf is not None:
        return None
    link, body = pick(rng, edits.moving(scene.mechanism))
    by = size * rng.normal(size=3)

    def change(built: Any, mechanism: Mechanism) -> None:
        _mujoco_harm().body_ipos(built, f"{link.name}/{body.name}", by)

    at = edits.places(scene.mechanism, link.name, body.name)
    return _built(f"body_ipos of {link.name} off", ("com",), at, change, ("mass", "payload", "inertia"))


@CHAPTER("boundinertia", 1.0)
def mujoco_bound(scene: Scene, rng: np.random.Generator, size: float) -> Fault | None:
    """MuJoCo's boundinertia: every principal inertia below a bound is raised to it."""
    if not _mujoco(scene):
        return None

    def change(built: Any, mechanism: Mechanism) -> None:
        _mujoco_harm().bound_inertia(built, LEAST)

    names = tuple(link.name for link in scene.mechanism.links)
    only = names if len(edits.moving(scene.mechanism)) == 1 else ()
    fault = _built(f"inertia is at least {LEAST}", ("inertia",), (ALL, *only), change)
    return Fault(fault.words, fault.parts, (Truth(("inertia", "rotor")),), built=fault.built)


@CHAPTER("settotalmass", 1.0)
def mujoco_total(scene: Scene, rng: np.random.Generator, size: float) -> Fault | None:
    """MuJoCo's settotalmass: all masses and inertias are scaled to a round total."""
    if not _mujoco(scene):
        return None

    def change(built: Any, mechanism: Mechanism) -> None:
        _mujoco_harm().total_mass(built, lambda total: 1.001 * max(float(np.round(total, 1)), 0.1))

    only = scene.mechanism.links[0].name
    at = (ALL, only) if len(edits.moving(scene.mechanism)) == 1 else (ALL,)
    fault = _built("the total mass was set to a round number", ("mass",), at, change)
    return Fault(fault.words, fault.parts, (Truth(("mass",)),), built=fault.built)


@CHAPTER("discrete inverse", 1.0)
def mujoco_discrete(scene: Scene, rng: np.random.Generator, size: float) -> Fault | None:
    """MuJoCo's invdiscrete: the inverse of its discrete step, where damping is taken implicitly."""
    if not _mujoco(scene) or not any(j.damping for j in scene.mechanism.joints):
        return None

    def change(built: Any, mechanism: Mechanism) -> None:
        _mujoco_harm().discretely(built)

    return _built("invdiscrete is on", ("implicit damping",), (), change, ("viscous", "rotor"))


@CHAPTER("medium", 1.2, 1000.0)
def mujoco_medium(scene: Scene, rng: np.random.Generator, size: float) -> Fault | None:
    """The model moves through air or water: MuJoCo's option density, with a little viscosity."""
    if not _mujoco(scene):
        return None

    def change(built: Any, mechanism: Mechanism) -> None:
        built.model.opt.density = size
        built.model.opt.viscosity = 1e-3 * size / 1000.0

    kinds = ("quadratic drag", "medium")
    return _built(f"a medium of {size} kg/m^3", kinds, (), change, ("viscous", "dry friction"))


@CHAPTER("damping disabled", 1.0)
def mujoco_passive(scene: Scene, rng: np.random.Generator, size: float) -> Fault | None:
    """MuJoCo's dampers are disabled by a flag; the model still has them."""
    damped = [j for j in scene.mechanism.joints if j.damping]
    if not _mujoco(scene) or not damped:
        return None

    def change(built: Any, mechanism: Mechanism) -> None:
        _mujoco_harm().without_dampers(built)

    alone = (damped[0].name,) if len(damped) == 1 else ()
    return _built("dampers are disabled", ("viscous",), (ALL, *alone), change)


@CHAPTER("order of a symmetric tensor", 1.0)
def pinocchio_order(scene: Scene, rng: np.random.Generator, size: float) -> Fault | None:
    """Pinocchio's six numbers of a tensor are xx, xy, yy, xz, yz, zz; they were given as xx, yy, zz, xy, xz, yz."""
    if scene.engine != "pinocchio" or (joint := _joint_of(scene, rng)) is None:
        return None

    def change(built: Any, mechanism: Mechanism) -> None:
        _pinocchio_harm().other_order(built, joint.name)

    at = edits.places(scene.mechanism, joint.child)
    return _built(f"six numbers of {joint.child} in another order", ("inertia",), at, change, ("mass", "com", "rotor"))


@CHAPTER("lever in Pinocchio", 0.02)
def pinocchio_lever(scene: Scene, rng: np.random.Generator, size: float) -> Fault | None:
    """The lever of all that a joint of Pinocchio carries is a part longer."""
    if scene.engine != "pinocchio" or (joint := _joint_of(scene, rng)) is None:
        return None

    def change(built: Any, mechanism: Mechanism) -> None:
        _pinocchio_harm().longer_lever(built, joint.name, 1.0 + size)

    at = edits.places(scene.mechanism, joint.child)
    return _built(f"lever of {joint.child} x{1 + size}", ("com",), at, change, ("mass", "payload", "inertia"))


@CHAPTER("armature lost in Pinocchio", 1.0)
def pinocchio_armature(scene: Scene, rng: np.random.Generator, size: float) -> Fault | None:
    """Pinocchio's armature was never set."""
    have = [j for j in scene.mechanism.joints if j.rotor_inertia]
    if scene.engine != "pinocchio" or not have:
        return None

    def change(built: Any, mechanism: Mechanism) -> None:
        _pinocchio_harm().without_armature(built)

    alone = (have[0].name,) if len(have) == 1 else ()
    return _built("armature is zero", ("rotor",), (ALL, *alone), change)
