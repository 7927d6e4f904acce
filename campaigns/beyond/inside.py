"""Mistakes in an engine's own model after it is built, or in its switches: what no mechanism file shows."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np

from campaigns.beyond import edits
from campaigns.beyond.fault import ALL, CorrectAnswer, Fault, FaultScenario, RecipeTopic, draw_one
from flexinv.model.mechanism import Joint, Mechanism

CHAPTER = RecipeTopic("inside the engine")
LEAST = 1e-2  # [kg m^2]: what MuJoCo's boundinertia is set to in many model files found on the net


def _open_mujoco_faults() -> Any:
    """The module that knows MuJoCo, on machines that have it: a scene of MuJoCo is drawn on no other."""
    return importlib.import_module("campaigns.beyond.engines.mujoco")


def _open_pinocchio_faults() -> Any:
    """The module that knows Pinocchio."""
    return importlib.import_module("campaigns.beyond.engines.pinocchio")


def _draw_joint(scenario: FaultScenario, rng: np.random.Generator) -> Joint | None:
    joint: Joint | None = draw_one(rng, [j for j in scenario.mechanism.joints if j.nv == 1])
    return joint


def _make_model_fault(
    words: str,
    kinds: tuple[str, ...],
    at: tuple[str, ...],
    change: Callable[[Any, Mechanism], None],
    near: tuple[str, ...] = (),
) -> Fault:
    return Fault(words, ((CorrectAnswer(kinds, at),),), (CorrectAnswer(near, at),) if near else (), built=change)


def _is_mujoco(scenario: FaultScenario) -> bool:
    return scenario.engine == "mujoco"


@CHAPTER("body in MuJoCo", 0.99, 1.05)
def make_body_mass_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """body_mass of a compiled model was changed, body_inertia was not."""
    if not _is_mujoco(scenario) or scenario.mechanism.urdf is not None:
        return None
    link, body = draw_one(rng, edits.list_moving_bodies(scenario.mechanism))

    def update_model(built_model: Any, mechanism: Mechanism) -> None:
        _open_mujoco_faults().scale_body_mass(built_model, f"{link.name}/{body.name}", size)

    at = edits.list_body_names(scenario.mechanism, link.name, body.name)
    return _make_model_fault(
        f"body_mass of {link.name} x{size}", ("mass",), at, update_model, ("com", "inertia", "payload")
    )


@CHAPTER("ipos in MuJoCo", 1e-3)
def make_body_ipos_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """body_ipos of a compiled model is off by some millimetres."""
    if not _is_mujoco(scenario) or scenario.mechanism.urdf is not None:
        return None
    link, body = draw_one(rng, edits.list_moving_bodies(scenario.mechanism))
    by = size * rng.normal(size=3)

    def update_model(built_model: Any, mechanism: Mechanism) -> None:
        _open_mujoco_faults().move_body_centre(built_model, f"{link.name}/{body.name}", by)

    at = edits.list_body_names(scenario.mechanism, link.name, body.name)
    return _make_model_fault(
        f"body_ipos of {link.name} off", ("com",), at, update_model, ("mass", "payload", "inertia")
    )


@CHAPTER("boundinertia", 1.0)
def make_boundinertia_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """MuJoCo's boundinertia: every principal inertia below a bound is raised to it."""
    if not _is_mujoco(scenario):
        return None

    def update_model(built_model: Any, mechanism: Mechanism) -> None:
        _open_mujoco_faults().apply_inertia_bound(built_model, LEAST)

    names = tuple(link.name for link in scenario.mechanism.links)
    only = names if len(edits.list_moving_bodies(scenario.mechanism)) == 1 else ()
    fault = _make_model_fault(f"inertia is at least {LEAST}", ("inertia",), (ALL, *only), update_model)
    return Fault(fault.words, fault.parts, (CorrectAnswer(("inertia", "rotor")),), built=fault.built)


@CHAPTER("settotalmass", 1.0)
def make_settotalmass_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """MuJoCo's settotalmass: all masses and inertias are scaled to a round total."""
    if not _is_mujoco(scenario):
        return None

    def update_model(built_model: Any, mechanism: Mechanism) -> None:
        _open_mujoco_faults().scale_total_mass(built_model, lambda total: 1.001 * max(float(np.round(total, 1)), 0.1))

    only = scenario.mechanism.links[0].name
    at = (ALL, only) if len(edits.list_moving_bodies(scenario.mechanism)) == 1 else (ALL,)
    fault = _make_model_fault("the total mass was set to a round number", ("mass",), at, update_model)
    return Fault(fault.words, fault.parts, (CorrectAnswer(("mass",)),), built=fault.built)


@CHAPTER("discrete inverse", 1.0)
def make_invdiscrete_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """MuJoCo's invdiscrete: the inverse of its discrete step, where damping is taken implicitly."""
    if not _is_mujoco(scenario) or not any(j.damping for j in scenario.mechanism.joints):
        return None

    def update_model(built_model: Any, mechanism: Mechanism) -> None:
        _open_mujoco_faults().apply_discrete_inverse(built_model)

    return _make_model_fault("invdiscrete is on", ("implicit damping",), (), update_model, ("viscous", "rotor"))


@CHAPTER("medium", 1.2, 1000.0)
def make_fluid_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The model moves through air or water: MuJoCo's option density, with a little viscosity."""
    if not _is_mujoco(scenario):
        return None

    def update_model(built_model: Any, mechanism: Mechanism) -> None:
        built_model.model.opt.density = size
        built_model.model.opt.viscosity = 1e-3 * size / 1000.0

    kinds = ("quadratic drag", "medium")
    return _make_model_fault(f"a medium of {size} kg/m^3", kinds, (), update_model, ("viscous", "dry friction"))


@CHAPTER("damping disabled", 1.0)
def make_disabled_damper_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """MuJoCo's dampers are disabled by a flag; the model still has them."""
    damped = [j for j in scenario.mechanism.joints if j.damping]
    if not _is_mujoco(scenario) or not damped:
        return None

    def update_model(built_model: Any, mechanism: Mechanism) -> None:
        _open_mujoco_faults().remove_dampers(built_model)

    alone = (damped[0].name,) if len(damped) == 1 else ()
    return _make_model_fault("dampers are disabled", ("viscous",), (ALL, *alone), update_model)


@CHAPTER("order of a symmetric tensor", 1.0)
def make_inertia_order_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """Pinocchio's six numbers of a tensor are xx, xy, yy, xz, yz, zz; they were given as xx, yy, zz, xy, xz, yz."""
    if scenario.engine != "pinocchio" or (joint := _draw_joint(scenario, rng)) is None:
        return None

    def update_model(built_model: Any, mechanism: Mechanism) -> None:
        _open_pinocchio_faults().replace_inertia_order(built_model, joint.name)

    at = edits.list_body_names(scenario.mechanism, joint.child)
    return _make_model_fault(
        f"six numbers of {joint.child} in another order", ("inertia",), at, update_model, ("mass", "com", "rotor")
    )


@CHAPTER("lever in Pinocchio", 0.02)
def make_lever_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The lever of all that a joint of Pinocchio carries is a part longer."""
    if scenario.engine != "pinocchio" or (joint := _draw_joint(scenario, rng)) is None:
        return None

    def update_model(built_model: Any, mechanism: Mechanism) -> None:
        _open_pinocchio_faults().scale_mass_lever(built_model, joint.name, 1.0 + size)

    at = edits.list_body_names(scenario.mechanism, joint.child)
    return _make_model_fault(
        f"lever of {joint.child} x{1 + size}", ("com",), at, update_model, ("mass", "payload", "inertia")
    )


@CHAPTER("armature lost in Pinocchio", 1.0)
def make_missing_armature_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """Pinocchio's armature was never set."""
    have = [j for j in scenario.mechanism.joints if j.rotor_inertia]
    if scenario.engine != "pinocchio" or not have:
        return None

    def update_model(built_model: Any, mechanism: Mechanism) -> None:
        _open_pinocchio_faults().remove_armature(built_model)

    alone = (have[0].name,) if len(have) == 1 else ()
    return _make_model_fault("armature is zero", ("rotor",), (ALL, *alone), update_model)
