"""Features of a compiled model of MuJoCo: what mj_inverse feels, or what ties joints, and no mechanism can say.

Each kind has a name, finds its features in a model, and is switched off in a copy of it.  What MuJoCo's flags disable is none.

    gravcomp          body_gravcomp: a force against gravity at the body's centre of mass
    fluid             density, viscosity, wind, and ellipsoids of shapes
    spring-law        stiffness of higher order,  (k0 + k1 |x| + k2 x^2) x  of hinges and slides
    ball-spring       springs of ball joints towards their reference orientation
    free-spring       springs of free joints towards their reference pose
    damper-law        damping of higher order,  (d0 + d1 |v| + d2 v^2) v,  of joints and of actuators on them
    plastic           springs that yield
    free-armature, free-friction   of free joints: they act along world axes, those of a mechanism along the body's
    tendon-spring, tendon-damper, tendon-armature, tendon-friction   of tendons, with those of actuators on them
    flex              elasticity of bodies that bend
    plugin            forces that programs add; they cannot be switched off
    coupling-law, tendon-equality   equalities that are no linear law of joints' coordinates
    actuation         actuators that are switched off

Source: mujoco 4.0.0, mjmodel.h; engine_passive.c.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from crosscheck.engines.mujoco.compiled.names import (
    find_actuators,
    read_gear,
    resolve_body_name,
    resolve_joint_name,
    resolve_name,
    resolve_tendon_name,
)  # fmt: skip
from crosscheck.engines.mujoco.compiled.tendons import (
    OTHERS,
    convert_to_tuple,
    find_coupling_laws,
    find_other_equalities,
    find_tendon_equalities,
    is_disabled,
    make_equality_remover,
    make_tendon_finder,
    make_tendon_remover,
    read_tendon_armature,
    read_tendon_damper,
    read_tendon_friction,
    read_tendon_spring,
    remove_nonlinear_terms,
)
from crosscheck.lifting.reader_dynamics import Feature, Parameter

DISABLE = mujoco.mjtDisableBit
JOINT = mujoco.mjtJoint
EQUALITY = mujoco.mjtEq
SCALAR = (JOINT.mjJNT_HINGE, JOINT.mjJNT_SLIDE)
SPRING_OFF = int(DISABLE.mjDSBL_SPRING)
DAMPER_OFF = int(DISABLE.mjDSBL_DAMPER)
CONSTRAINT_OFF = int(DISABLE.mjDSBL_CONSTRAINT)
FRICTION_OFF = int(DISABLE.mjDSBL_FRICTIONLOSS) | CONSTRAINT_OFF
LIMIT_OFF = int(DISABLE.mjDSBL_LIMIT) | CONSTRAINT_OFF
GRAVITY_OFF = int(DISABLE.mjDSBL_GRAVITY)
ACTUATION_OFF = int(DISABLE.mjDSBL_ACTUATION)
FLEX = ("flex_stiffness", "flex_bending", "flex_damping", "flex_edgestiffness", "flex_edgedamping")


@dataclass(frozen=True)
class Kind:
    """A kind of features: its name, what finds them in a model, and what switches them off in a copy of it."""

    name: str
    find: Callable[[Any], Iterator[Feature]]
    switch_off: Callable[[Any], None]


def find_features(model: Any) -> tuple[Feature, ...]:
    """Return all features of a compiled model."""
    return tuple(feature for kind in KINDS for feature in kind.find(model))


def remove_features(model: Any, names: Collection[str]) -> None:
    """Switch the features of some names off in a model."""
    for kind in KINDS:
        if kind.name in names:
            kind.switch_off(model)


def _make_array_setter(**arrays: float) -> Callable[[Any], None]:
    """A function that sets whole arrays of a model to a number."""

    def fill_arrays(model: Any) -> None:
        for name, value in arrays.items():
            getattr(model, name)[...] = value

    return fill_arrays


def _find_gravcomp(model: Any) -> Iterator[Feature]:
    for body in np.flatnonzero(model.body_gravcomp):
        if not is_disabled(model, GRAVITY_OFF):
            value = float(model.body_gravcomp[body])
            yield Feature("gravcomp", f"link {resolve_body_name(model, int(body))}", {"gravcomp": value})


def _find_fluid(model: Any) -> Iterator[Feature]:
    option = model.opt
    if not (option.density or option.viscosity):
        return
    numbers: dict[str, Parameter] = {
        "density": float(option.density), "viscosity": float(option.viscosity), "wind": convert_to_tuple(option.wind),
    }  # fmt: skip
    for geom in np.flatnonzero(model.geom_fluid[:, 0]):
        numbers[f"shape {geom}"] = convert_to_tuple(model.geom_fluid[geom])
    yield Feature("fluid", "the world", numbers)


def _remove_fluid(model: Any) -> None:
    model.opt.density = 0.0
    model.opt.viscosity = 0.0


def _find_springs(name: str, types: tuple[Any, ...], law: bool) -> Callable[[Any], Iterator[Feature]]:
    """A function that finds springs of joints of some types; law : those only that have coefficients of higher order."""

    def find(model: Any) -> Iterator[Feature]:
        for index in range(model.njnt):
            if JOINT(int(model.jnt_type[index])) not in types or is_disabled(model, SPRING_OFF):
                continue
            more = np.ravel(model.jnt_stiffnesspoly[index])
            if more.any() or (model.jnt_stiffness[index] and not law):
                start = int(model.jnt_qposadr[index])
                count = {JOINT.mjJNT_FREE: 7, JOINT.mjJNT_BALL: 4}.get(JOINT(int(model.jnt_type[index])), 1)
                numbers: dict[str, Parameter] = {
                    "stiffness": convert_to_tuple([model.jnt_stiffness[index], *more]),
                    "rest": convert_to_tuple(model.qpos_spring[start : start + count]),
                }
                yield Feature(name, f"joint {resolve_joint_name(model, index)}", numbers)

    return find


def _make_spring_remover(types: tuple[Any, ...], law: bool) -> Callable[[Any], None]:
    def remove_springs(model: Any) -> None:
        for index in range(model.njnt):
            if JOINT(int(model.jnt_type[index])) in types:
                model.jnt_stiffnesspoly[index] = 0.0
                if not law:
                    model.jnt_stiffness[index] = 0.0

    return remove_springs


def _find_damper_laws(model: Any) -> Iterator[Feature]:
    for index in range(model.njnt):
        if is_disabled(model, DAMPER_OFF):
            return
        more = np.array(model.dof_dampingpoly[int(model.jnt_dofadr[index])], dtype=float)
        for k in find_actuators(model, index):
            more = more + read_gear(model, k) ** 2 * np.ravel(model.actuator_dampingpoly[k])
        if more.any():
            yield Feature(
                "damper-law", f"joint {resolve_joint_name(model, index)}", {"higher orders": convert_to_tuple(more)}
            )


def _find_plastic(model: Any) -> Iterator[Feature]:
    if is_disabled(model, SPRING_OFF):
        return
    for index in range(model.njnt):
        if model.jnt_plasticadr[index] >= 0:
            numbers: dict[str, Parameter] = {"yield": float(model.jnt_springyield[index])}
            name = resolve_joint_name(model, index)
            yield Feature("plastic", f"joint {name}", numbers, felt=False, joints=(name,))
    for index in range(model.ntendon):
        if model.tendon_plasticadr[index] >= 0:
            numbers = {"yield": float(model.tendon_springyield[index])}
            yield Feature("plastic", f"tendon {resolve_tendon_name(model, index)}", numbers, felt=False)


def _find_of_free(name: str, key: str, array: str, flags: int) -> Callable[[Any], Iterator[Feature]]:
    """A function that finds a number of free joints that acts along world axes."""

    def find(model: Any) -> Iterator[Feature]:
        for index in range(model.njnt):
            if JOINT(int(model.jnt_type[index])) != JOINT.mjJNT_FREE or is_disabled(model, flags):
                continue
            first = int(model.jnt_dofadr[index])
            value = float(getattr(model, array)[first])
            if array == "dof_armature":
                value += sum(
                    read_gear(model, k) ** 2 * float(model.actuator_armature[k]) for k in find_actuators(model, index)
                )
            if value:
                yield Feature(name, f"joint {resolve_joint_name(model, index)}", {key: value})

    return find


def _make_free_remover(array: str) -> Callable[[Any], None]:
    def remove_values(model: Any) -> None:
        for index in range(model.njnt):
            if JOINT(int(model.jnt_type[index])) != JOINT.mjJNT_FREE:
                continue
            first = int(model.jnt_dofadr[index])
            getattr(model, array)[first : first + 6] = 0.0
            if array == "dof_armature":
                for k in find_actuators(model, index):
                    model.actuator_armature[k] = 0.0

    return remove_values


def _find_flex(model: Any) -> Iterator[Feature]:
    for index in range(model.nflex):
        name = resolve_name(model, mujoco.mjtObj.mjOBJ_FLEX, index, "flex")
        numbers: dict[str, Parameter] = {"points": float(model.flex_vertnum[index])}
        for array in FLEX:
            values = np.ravel(getattr(model, array))
            numbers[array.removeprefix("flex_")] = float(np.abs(values).sum())
        yield Feature("flex", f"body that bends {name}", numbers)


def _find_plugins(model: Any) -> Iterator[Feature]:
    for array, count in (("body_plugin", model.nbody), ("geom_plugin", model.ngeom)):
        for index in range(count):
            instance = int(getattr(model, array)[index])
            if instance >= 0:
                place = resolve_body_name(model, index) if array == "body_plugin" else f"shape {index}"
                yield Feature("plugin", f"link {place}", {"settings": _read_plugin_settings(model, instance)})


def _read_plugin_settings(model: Any, instance: int) -> str:
    """The settings of an instance of a plugin as text."""
    bounds = [*(int(at) for at in model.plugin_attradr), int(model.npluginattr)]
    letters = bytes(int(code) & 255 for code in np.ravel(model.plugin_attr)[bounds[instance] : bounds[instance + 1]])
    return letters.decode(errors="replace").replace("\0", " ").strip()


def _find_actuation(model: Any) -> Iterator[Feature]:
    if not model.nactuator:
        return
    if is_disabled(model, ACTUATION_OFF):
        yield Feature("actuation", "the world", {"actuators": "switched off"}, felt=False)
    groups = [k for k in range(model.nactuator) if model.opt.disableactuator >> int(model.actuator_group[k]) & 1]
    if groups:
        names = ", ".join(resolve_name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, k, "actuator") for k in groups)
        yield Feature("actuation", f"actuators {names}", {"switched off": names}, felt=False)


def _remove_nothing(model: Any) -> None:
    """Leave a model as it is: the feature cannot be switched off, or neither efforts nor equations feel it."""


KINDS = (
    Kind("gravcomp", _find_gravcomp, _make_array_setter(body_gravcomp=0.0)),
    Kind("fluid", _find_fluid, _remove_fluid),
    Kind("spring-law", _find_springs("spring-law", SCALAR, True), _make_spring_remover(SCALAR, True)),
    Kind(
        "ball-spring",
        _find_springs("ball-spring", (JOINT.mjJNT_BALL,), False),
        _make_spring_remover((JOINT.mjJNT_BALL,), False),
    ),
    Kind(
        "free-spring",
        _find_springs("free-spring", (JOINT.mjJNT_FREE,), False),
        _make_spring_remover((JOINT.mjJNT_FREE,), False),
    ),
    Kind("damper-law", _find_damper_laws, _make_array_setter(dof_dampingpoly=0.0, actuator_dampingpoly=0.0)),
    Kind("plastic", _find_plastic, _make_array_setter(jnt_plasticadr=-1, tendon_plasticadr=-1)),
    Kind("free-armature", _find_of_free("free-armature", "armature", "dof_armature", 0), _make_free_remover("dof_armature")),
    Kind(
        "free-friction", _find_of_free("free-friction", "frictionloss", "dof_frictionloss", FRICTION_OFF),
        _make_free_remover("dof_frictionloss"),
    ),
    Kind(
        "tendon-spring", make_tendon_finder("tendon-spring", SPRING_OFF, read_tendon_spring),
        make_tendon_remover("tendon_stiffness", "tendon_stiffnesspoly"),
    ),
    Kind(
        "tendon-damper", make_tendon_finder("tendon-damper", DAMPER_OFF, read_tendon_damper),
        make_tendon_remover("tendon_damping", "tendon_dampingpoly", "actuator_damping", "actuator_dampingpoly"),
    ),
    Kind(
        "tendon-armature", make_tendon_finder("tendon-armature", 0, read_tendon_armature),
        make_tendon_remover("tendon_armature", "actuator_armature"),
    ),
    Kind(
        "tendon-friction", make_tendon_finder("tendon-friction", FRICTION_OFF, read_tendon_friction),
        make_tendon_remover("tendon_frictionloss"),
    ),
    Kind("flex", _find_flex, _make_array_setter(**dict.fromkeys(FLEX, 0.0))),
    Kind("plugin", _find_plugins, _remove_nothing),
    Kind("coupling-law", find_coupling_laws, remove_nonlinear_terms),
    Kind("tendon-equality", find_tendon_equalities, make_equality_remover(EQUALITY.mjEQ_TENDON, linear=True)),
    Kind("equality", find_other_equalities, make_equality_remover(*OTHERS)),
    Kind("actuation", _find_actuation, _remove_nothing),
)  # fmt: skip
