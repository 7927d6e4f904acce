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

from crosscheck.engines.mujoco.names import (
    ON_TENDON,
    actuators_on,
    body_name,
    gear_of,
    joint_name,
    name_of,
    tendon_name,
)  # fmt: skip
from crosscheck.lifting.reader_dynamics import Feature, Parameter

DISABLE, JOINT, EQUALITY = mujoco.mjtDisableBit, mujoco.mjtJoint, mujoco.mjtEq
OTHERS = tuple(
    kind
    for kind in EQUALITY.__members__.values()
    if kind.name not in ("mjEQ_JOINT", "mjEQ_TENDON", "mjEQ_CONNECT", "mjEQ_WELD")
)
SCALAR = (JOINT.mjJNT_HINGE, JOINT.mjJNT_SLIDE)
SPRING_OFF, DAMPER_OFF = int(DISABLE.mjDSBL_SPRING), int(DISABLE.mjDSBL_DAMPER)
CONSTRAINT_OFF = int(DISABLE.mjDSBL_CONSTRAINT)
FRICTION_OFF = int(DISABLE.mjDSBL_FRICTIONLOSS) | CONSTRAINT_OFF
EQUALITY_OFF = int(DISABLE.mjDSBL_EQUALITY) | CONSTRAINT_OFF
LIMIT_OFF = int(DISABLE.mjDSBL_LIMIT) | CONSTRAINT_OFF
GRAVITY_OFF, ACTUATION_OFF = int(DISABLE.mjDSBL_GRAVITY), int(DISABLE.mjDSBL_ACTUATION)
FLEX = ("flex_stiffness", "flex_bending", "flex_damping", "flex_edgestiffness", "flex_edgedamping")


@dataclass(frozen=True)
class Kind:
    """A kind of features: its name, what finds them in a model, and what switches them off in a copy of it."""

    name: str
    find: Callable[[Any], Iterator[Feature]]
    switch_off: Callable[[Any], None]


def off(model: Any, flags: int) -> bool:
    """Return True if one of some flags of MuJoCo's disables a part of the physics."""
    return bool(model.opt.disableflags & flags)


def find_features(model: Any) -> tuple[Feature, ...]:
    """Return all features of a compiled model."""
    return tuple(feature for kind in KINDS for feature in kind.find(model))


def switch_off(model: Any, names: Collection[str]) -> None:
    """Switch the features of some names off in a model."""
    for kind in KINDS:
        if kind.name in names:
            kind.switch_off(model)


def _row(values: Any) -> tuple[float, ...]:
    return tuple(float(value) for value in np.ravel(values))


def _set(**arrays: float) -> Callable[[Any], None]:
    """What sets whole arrays of a model to a number."""

    def switch(model: Any) -> None:
        for name, value in arrays.items():
            getattr(model, name)[...] = value

    return switch


def _find_gravcomp(model: Any) -> Iterator[Feature]:
    for body in np.flatnonzero(model.body_gravcomp):
        if not off(model, GRAVITY_OFF):
            value = float(model.body_gravcomp[body])
            yield Feature("gravcomp", f"link {body_name(model, int(body))}", {"gravcomp": value})


def _find_fluid(model: Any) -> Iterator[Feature]:
    option = model.opt
    if not (option.density or option.viscosity):
        return
    numbers: dict[str, Parameter] = {
        "density": float(option.density), "viscosity": float(option.viscosity), "wind": _row(option.wind),
    }  # fmt: skip
    for geom in np.flatnonzero(model.geom_fluid[:, 0]):
        numbers[f"shape {geom}"] = _row(model.geom_fluid[geom])
    yield Feature("fluid", "the world", numbers)


def _fluid_off(model: Any) -> None:
    model.opt.density = 0.0
    model.opt.viscosity = 0.0


def _find_springs(name: str, types: tuple[Any, ...], law: bool) -> Callable[[Any], Iterator[Feature]]:
    """What finds springs of joints of some types; law : those only that have coefficients of higher order."""

    def find(model: Any) -> Iterator[Feature]:
        for index in range(model.njnt):
            if JOINT(int(model.jnt_type[index])) not in types or off(model, SPRING_OFF):
                continue
            more = np.ravel(model.jnt_stiffnesspoly[index])
            if more.any() or (model.jnt_stiffness[index] and not law):
                start = int(model.jnt_qposadr[index])
                count = {JOINT.mjJNT_FREE: 7, JOINT.mjJNT_BALL: 4}.get(JOINT(int(model.jnt_type[index])), 1)
                numbers: dict[str, Parameter] = {
                    "stiffness": _row([model.jnt_stiffness[index], *more]),
                    "rest": _row(model.qpos_spring[start : start + count]),
                }
                yield Feature(name, f"joint {joint_name(model, index)}", numbers)

    return find


def _springs_off(types: tuple[Any, ...], law: bool) -> Callable[[Any], None]:
    def switch(model: Any) -> None:
        for index in range(model.njnt):
            if JOINT(int(model.jnt_type[index])) in types:
                model.jnt_stiffnesspoly[index] = 0.0
                if not law:
                    model.jnt_stiffness[index] = 0.0

    return switch


def _find_damper_laws(model: Any) -> Iterator[Feature]:
    for index in range(model.njnt):
        if off(model, DAMPER_OFF):
            return
        more = np.array(model.dof_dampingpoly[int(model.jnt_dofadr[index])], dtype=float)
        for k in actuators_on(model, index):
            more = more + gear_of(model, k) ** 2 * np.ravel(model.actuator_dampingpoly[k])
        if more.any():
            yield Feature("damper-law", f"joint {joint_name(model, index)}", {"higher orders": _row(more)})


def _find_plastic(model: Any) -> Iterator[Feature]:
    if off(model, SPRING_OFF):
        return
    for index in range(model.njnt):
        if model.jnt_plasticadr[index] >= 0:
            numbers: dict[str, Parameter] = {"yield": float(model.jnt_springyield[index])}
            yield Feature("plastic", f"joint {joint_name(model, index)}", numbers)
    for index in range(model.ntendon):
        if model.tendon_plasticadr[index] >= 0:
            numbers = {"yield": float(model.tendon_springyield[index])}
            yield Feature("plastic", f"tendon {tendon_name(model, index)}", numbers)


def _find_of_free(name: str, key: str, array: str, flags: int) -> Callable[[Any], Iterator[Feature]]:
    """What finds a number of free joints that acts along world axes."""

    def find(model: Any) -> Iterator[Feature]:
        for index in range(model.njnt):
            if JOINT(int(model.jnt_type[index])) != JOINT.mjJNT_FREE or off(model, flags):
                continue
            first = int(model.jnt_dofadr[index])
            value = float(getattr(model, array)[first])
            if array == "dof_armature":
                value += sum(
                    gear_of(model, k) ** 2 * float(model.actuator_armature[k]) for k in actuators_on(model, index)
                )
            if value:
                yield Feature(name, f"joint {joint_name(model, index)}", {key: value})

    return find


def _off_of_free(array: str) -> Callable[[Any], None]:
    def switch(model: Any) -> None:
        for index in range(model.njnt):
            if JOINT(int(model.jnt_type[index])) != JOINT.mjJNT_FREE:
                continue
            first = int(model.jnt_dofadr[index])
            getattr(model, array)[first : first + 6] = 0.0
            if array == "dof_armature":
                for k in actuators_on(model, index):
                    model.actuator_armature[k] = 0.0

    return switch


def _path(model: Any, index: int) -> tuple[dict[str, Parameter], tuple[str, ...]]:
    """What a tendon runs over, and the joints of a fixed one."""
    first, count = int(model.tendon_adr[index]), int(model.tendon_num[index])
    numbers: dict[str, Parameter] = {}
    joints = []
    for k in range(first, first + count):
        if mujoco.mjtWrap(int(model.wrap_type[k])) == mujoco.mjtWrap.mjWRAP_JOINT:
            name = joint_name(model, int(model.wrap_objid[k]))
            joints.append(name)
            numbers[f"of {name}"] = float(model.wrap_prm[k])
    if not joints:
        numbers["points"] = float(count)
    return numbers, tuple(joints)


def _find_tendons(
    name: str, flags: int, numbers_of: Callable[[Any, int], dict[str, Parameter]]
) -> Callable[[Any], Iterator[Feature]]:
    """What finds tendons with numbers of one kind that are not all zero."""

    def find(model: Any) -> Iterator[Feature]:
        for index in range(model.ntendon):
            numbers = numbers_of(model, index)
            if off(model, flags) or not any(np.any(value) for key, value in numbers.items() if key != "rest"):
                continue
            path, joints = _path(model, index)
            yield Feature(name, f"tendon {tendon_name(model, index)}", {**numbers, **path}, joints=joints)

    return find


def _tendon_spring(model: Any, index: int) -> dict[str, Parameter]:
    stiffness = _row([model.tendon_stiffness[index], *np.ravel(model.tendon_stiffnesspoly[index])])
    return {"stiffness": stiffness, "rest": _row(model.tendon_lengthspring[index])}


def _tendon_damper(model: Any, index: int) -> dict[str, Parameter]:
    whole = np.array([model.tendon_damping[index], *np.ravel(model.tendon_dampingpoly[index])], dtype=float)
    for k in actuators_on(model, index, ON_TENDON):
        own = [model.actuator_damping[k], *np.ravel(model.actuator_dampingpoly[k])]
        whole = whole + gear_of(model, k) ** 2 * np.array(own, dtype=float)
    return {"damping": _row(whole)}


def _tendon_armature(model: Any, index: int) -> dict[str, Parameter]:
    own = sum(gear_of(model, k) ** 2 * float(model.actuator_armature[k]) for k in actuators_on(model, index, ON_TENDON))
    return {"armature": float(model.tendon_armature[index]) + own}


def _tendon_friction(model: Any, index: int) -> dict[str, Parameter]:
    return {"frictionloss": float(model.tendon_frictionloss[index])}


def _tendon_off(*arrays: str) -> Callable[[Any], None]:
    """What sets arrays of tendons, and of actuators on tendons, to zero."""

    def switch(model: Any) -> None:
        on_tendons = [k for index in range(model.ntendon) for k in actuators_on(model, index, ON_TENDON)]
        for name in arrays:
            values = getattr(model, name)
            values[on_tendons if name.startswith("actuator") else slice(None)] = 0.0

    return switch


def _find_flex(model: Any) -> Iterator[Feature]:
    for index in range(model.nflex):
        name = name_of(model, mujoco.mjtObj.mjOBJ_FLEX, index, "flex")
        numbers: dict[str, Parameter] = {"points": float(model.flex_vertnum[index])}
        for array in FLEX:
            values = np.ravel(getattr(model, array))
            numbers[array.removeprefix("flex_")] = float(np.abs(values).sum())
        yield Feature("flex", f"body that bends {name}", numbers)


def _find_plugins(model: Any) -> Iterator[Feature]:
    for array, count in (("body_plugin", model.nbody), ("geom_plugin", model.ngeom)):
        for index in range(count):
            if int(getattr(model, array)[index]) >= 0:
                place = body_name(model, index) if array == "body_plugin" else f"shape {index}"
                yield Feature("plugin", f"link {place}", {"instance": float(getattr(model, array)[index])})


def _find_coupling_laws(model: Any) -> Iterator[Feature]:
    for k in range(model.neq):
        kind = EQUALITY(int(model.eq_type[k]))
        law = model.eq_obj2id[k] >= 0 and np.any(model.eq_data[k][2:5])
        if kind != EQUALITY.mjEQ_JOINT or not active(model, k) or not law:
            continue
        joints = tuple(joint_name(model, int(index)) for index in (model.eq_obj1id[k], model.eq_obj2id[k]))
        numbers: dict[str, Parameter] = {"polycoef": _row(model.eq_data[k][:5])}
        yield Feature("coupling-law", f"joints {', '.join(joints)}", numbers, felt=False, joints=joints)


def _find_tendon_equalities(model: Any) -> Iterator[Feature]:
    for k in range(model.neq):
        kind = EQUALITY(int(model.eq_type[k]))
        if kind != EQUALITY.mjEQ_TENDON or not active(model, k) or linear_law(model, k) is not None:
            continue
        numbers: dict[str, Parameter] = {"polycoef": _row(model.eq_data[k][:5])}
        names = []
        for index in (int(model.eq_obj1id[k]), int(model.eq_obj2id[k])):
            if index >= 0:
                names.append(tendon_name(model, index))
                path, _ = _path(model, index)
                numbers |= {f"{names[-1]} {key}": value for key, value in path.items()}
        yield Feature("tendon-equality", f"tendons {', '.join(names)}", numbers, felt=False)


def _find_other_equalities(model: Any) -> Iterator[Feature]:
    for k in range(model.neq):
        kind = EQUALITY(int(model.eq_type[k]))
        if kind in OTHERS and active(model, k):
            word = kind.name.removeprefix("mjEQ_").lower()
            name = name_of(model, mujoco.mjtObj.mjOBJ_EQUALITY, k, "equality")
            yield Feature("equality", f"equality {name}", {"kind": word}, felt=False)


def _find_actuation(model: Any) -> Iterator[Feature]:
    if not model.nactuator:
        return
    if off(model, ACTUATION_OFF):
        yield Feature("actuation", "the world", {"actuators": "switched off"}, felt=False)
    groups = [k for k in range(model.nactuator) if model.opt.disableactuator >> int(model.actuator_group[k]) & 1]
    if groups:
        names = [name_of(model, mujoco.mjtObj.mjOBJ_ACTUATOR, k, "actuator") for k in groups]
        yield Feature("actuation", f"actuators {', '.join(names)}", {"actuators": "switched off"}, felt=False)


def active(model: Any, k: int) -> bool:
    """Return True if an equality acts from the beginning on."""
    return bool(model.eq_active0[k]) and not off(model, EQUALITY_OFF)


def linear_law(model: Any, k: int) -> tuple[dict[str, float], float] | None:
    """Return factors by joint [-] and offset of an equality of fixed tendons; None where it is no linear law of joints.

    L1 - L1_0 = a0 + a1 (L2 - L2_0),  L = sum coef q  of a fixed tendon
    """
    start, slope = float(model.eq_data[k][0]), float(model.eq_data[k][1])
    first, second = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
    if second >= 0 and np.any(model.eq_data[k][2:5]):
        return None
    factors: dict[str, float] = {}
    offset = start
    for index, weight in ((first, 1.0), (second, -slope)):
        if index < 0:
            continue
        path, joints = _path(model, index)
        if not joints:
            return None
        offset += weight * float(model.tendon_length0[index])
        for name in joints:
            coefficient = path[f"of {name}"]
            assert isinstance(coefficient, float)
            factors[name] = factors.get(name, 0.0) + weight * coefficient
    return factors, offset


def _linear_couplings(model: Any) -> None:
    """Leave the linear part of equalities of joints."""
    for k in range(model.neq):
        if EQUALITY(int(model.eq_type[k])) == EQUALITY.mjEQ_JOINT:
            model.eq_data[k][2:5] = 0.0


def _no_equalities(*kinds: Any, linear: bool = False) -> Callable[[Any], None]:
    """What takes equalities of some kinds out; linear : those of tendons stay that are linear laws of joints."""

    def switch(model: Any) -> None:
        for k in range(model.neq):
            law = linear and linear_law(model, k) is not None
            if EQUALITY(int(model.eq_type[k])) in kinds and not law:
                model.eq_active0[k] = 0

    return switch


def _nothing(model: Any) -> None:
    """What cannot be switched off, or what neither efforts nor equations feel."""


KINDS = (
    Kind("gravcomp", _find_gravcomp, _set(body_gravcomp=0.0)),
    Kind("fluid", _find_fluid, _fluid_off),
    Kind("spring-law", _find_springs("spring-law", SCALAR, True), _springs_off(SCALAR, True)),
    Kind("ball-spring", _find_springs("ball-spring", (JOINT.mjJNT_BALL,), False), _springs_off((JOINT.mjJNT_BALL,), False)),
    Kind("free-spring", _find_springs("free-spring", (JOINT.mjJNT_FREE,), False), _springs_off((JOINT.mjJNT_FREE,), False)),
    Kind("damper-law", _find_damper_laws, _set(dof_dampingpoly=0.0, actuator_dampingpoly=0.0)),
    Kind("plastic", _find_plastic, _set(jnt_plasticadr=-1, tendon_plasticadr=-1)),
    Kind("free-armature", _find_of_free("free-armature", "armature", "dof_armature", 0), _off_of_free("dof_armature")),
    Kind(
        "free-friction", _find_of_free("free-friction", "frictionloss", "dof_frictionloss", FRICTION_OFF),
        _off_of_free("dof_frictionloss"),
    ),
    Kind(
        "tendon-spring", _find_tendons("tendon-spring", SPRING_OFF, _tendon_spring),
        _tendon_off("tendon_stiffness", "tendon_stiffnesspoly"),
    ),
    Kind(
        "tendon-damper", _find_tendons("tendon-damper", DAMPER_OFF, _tendon_damper),
        _tendon_off("tendon_damping", "tendon_dampingpoly", "actuator_damping", "actuator_dampingpoly"),
    ),
    Kind(
        "tendon-armature", _find_tendons("tendon-armature", 0, _tendon_armature),
        _tendon_off("tendon_armature", "actuator_armature"),
    ),
    Kind(
        "tendon-friction", _find_tendons("tendon-friction", FRICTION_OFF, _tendon_friction),
        _tendon_off("tendon_frictionloss"),
    ),
    Kind("flex", _find_flex, _set(**dict.fromkeys(FLEX, 0.0))),
    Kind("plugin", _find_plugins, _nothing),
    Kind("coupling-law", _find_coupling_laws, _linear_couplings),
    Kind("tendon-equality", _find_tendon_equalities, _no_equalities(EQUALITY.mjEQ_TENDON, linear=True)),
    Kind("equality", _find_other_equalities, _no_equalities(*OTHERS)),
    Kind("actuation", _find_actuation, _nothing),
)  # fmt: skip
