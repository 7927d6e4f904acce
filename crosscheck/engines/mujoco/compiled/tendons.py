"""Tendons and equalities of a compiled model of MuJoCo: those that are linear laws of joints, and features of the others.

    fixed tendon      L = sum coef q;   equality of tendons   L1 - L1_0 = a0 + a1 (L2 - L2_0) + ...
    equality of joints  q1 - q1_0 = a0 + a1 (q2 - q2_0) + ...
    linear            a coupling of a mechanism; of higher order, or of tendons that run over bodies: a feature

Source: mujoco 4.0.0, mjmodel.h; engine_core_constraint.c.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import mujoco
import numpy as np

from crosscheck.engines.mujoco.compiled.names import (
    ON_TENDON,
    find_actuators,
    read_gear,
    resolve_joint_name,
    resolve_name,
    resolve_tendon_name,
)
from crosscheck.lifting.reader_dynamics import Feature, Parameter

DISABLE = mujoco.mjtDisableBit
EQUALITY = mujoco.mjtEq
OTHERS = tuple(
    kind
    for kind in EQUALITY.__members__.values()
    if kind.name not in ("mjEQ_JOINT", "mjEQ_TENDON", "mjEQ_CONNECT", "mjEQ_WELD")
)
EQUALITY_OFF = int(DISABLE.mjDSBL_EQUALITY | DISABLE.mjDSBL_CONSTRAINT)


def is_disabled(model: Any, flags: int) -> bool:
    """Return True if one of some flags of MuJoCo's disables a part of the physics."""
    return bool(model.opt.disableflags & flags)


def convert_to_tuple(values: Any) -> tuple[float, ...]:
    """Return numbers of a model as a tuple [any unit]."""
    return tuple(float(value) for value in np.ravel(values))


def _read_tendon_path(model: Any, index: int) -> tuple[dict[str, Parameter], tuple[str, ...]]:
    """The numbers of the path of a tendon, and the joints of a fixed one."""
    first = int(model.tendon_adr[index])
    count = int(model.tendon_num[index])
    numbers: dict[str, Parameter] = {}
    joints = []
    for k in range(first, first + count):
        if mujoco.mjtWrap(int(model.wrap_type[k])) == mujoco.mjtWrap.mjWRAP_JOINT:
            name = resolve_joint_name(model, int(model.wrap_objid[k]))
            joints.append(name)
            numbers[f"of {name}"] = float(model.wrap_prm[k])
    if not joints:
        numbers["points"] = float(count)
    return numbers, tuple(joints)


def make_tendon_finder(
    name: str, flags: int, numbers_of: Callable[[Any, int], dict[str, Parameter]]
) -> Callable[[Any], Iterator[Feature]]:
    """Return a function that finds tendons with numbers of one kind that are not all zero."""

    def find(model: Any) -> Iterator[Feature]:
        for index in range(model.ntendon):
            numbers = numbers_of(model, index)
            if is_disabled(model, flags) or not any(np.any(value) for key, value in numbers.items() if key != "rest"):
                continue
            path, joints = _read_tendon_path(model, index)
            yield Feature(name, f"tendon {resolve_tendon_name(model, index)}", {**numbers, **path}, joints=joints)

    return find


def read_tendon_spring(model: Any, index: int) -> dict[str, Parameter]:
    """Return stiffness and rest of a tendon [N/m], [m]."""
    stiffness = convert_to_tuple([model.tendon_stiffness[index], *np.ravel(model.tendon_stiffnesspoly[index])])
    return {"stiffness": stiffness, "rest": convert_to_tuple(model.tendon_lengthspring[index])}


def read_tendon_damper(model: Any, index: int) -> dict[str, Parameter]:
    """Return damping of a tendon with that of actuators on it [N s/m]."""
    whole = np.array([model.tendon_damping[index], *np.ravel(model.tendon_dampingpoly[index])], dtype=float)
    for k in find_actuators(model, index, ON_TENDON):
        actuator = [model.actuator_damping[k], *np.ravel(model.actuator_dampingpoly[k])]
        whole = whole + read_gear(model, k) ** 2 * np.array(actuator, dtype=float)
    return {"damping": convert_to_tuple(whole)}


def read_tendon_armature(model: Any, index: int) -> dict[str, Parameter]:
    """Return armature of a tendon with that of actuators on it [kg]."""
    actuators = sum(
        read_gear(model, k) ** 2 * float(model.actuator_armature[k]) for k in find_actuators(model, index, ON_TENDON)
    )
    return {"armature": float(model.tendon_armature[index]) + actuators}


def read_tendon_friction(model: Any, index: int) -> dict[str, Parameter]:
    """Return dry friction of a tendon [N]."""
    return {"frictionloss": float(model.tendon_frictionloss[index])}


def make_tendon_remover(*arrays: str) -> Callable[[Any], None]:
    """Return a function that sets arrays of tendons, and of actuators on tendons, to zero."""

    def remove_tendon_values(model: Any) -> None:
        on_tendons = [k for index in range(model.ntendon) for k in find_actuators(model, index, ON_TENDON)]
        for name in arrays:
            values = getattr(model, name)
            values[on_tendons if name.startswith("actuator") else slice(None)] = 0.0

    return remove_tendon_values


def find_coupling_laws(model: Any) -> Iterator[Feature]:
    """Yield equalities of two joints that are of higher order."""
    for k in range(model.neq):
        kind = EQUALITY(int(model.eq_type[k]))
        law = model.eq_obj2id[k] >= 0 and np.any(model.eq_data[k][2:5])
        if kind != EQUALITY.mjEQ_JOINT or not is_active(model, k) or not law:
            continue
        joints = tuple(resolve_joint_name(model, int(index)) for index in (model.eq_obj1id[k], model.eq_obj2id[k]))
        numbers: dict[str, Parameter] = {"polycoef": convert_to_tuple(model.eq_data[k][:5])}
        yield Feature("coupling-law", f"joints {', '.join(joints)}", numbers, felt=False, joints=joints)


def find_tendon_equalities(model: Any) -> Iterator[Feature]:
    """Yield equalities of tendons that are no linear law of joints."""
    for k in range(model.neq):
        kind = EQUALITY(int(model.eq_type[k]))
        if kind != EQUALITY.mjEQ_TENDON or not is_active(model, k) or read_linear_law(model, k) is not None:
            continue
        numbers: dict[str, Parameter] = {"polycoef": convert_to_tuple(model.eq_data[k][:5])}
        names = []
        for index in (int(model.eq_obj1id[k]), int(model.eq_obj2id[k])):
            if index >= 0:
                names.append(resolve_tendon_name(model, index))
                path, _ = _read_tendon_path(model, index)
                numbers |= {f"{names[-1]} {key}": value for key, value in path.items()}
        yield Feature("tendon-equality", f"tendons {', '.join(names)}", numbers, felt=False)


def find_other_equalities(model: Any) -> Iterator[Feature]:
    """Yield equalities of kinds that tie no two bodies, joints or tendons."""
    for k in range(model.neq):
        kind = EQUALITY(int(model.eq_type[k]))
        if kind in OTHERS and is_active(model, k):
            word = kind.name.removeprefix("mjEQ_").lower()
            name = resolve_name(model, mujoco.mjtObj.mjOBJ_EQUALITY, k, "equality")
            yield Feature("equality", f"equality {name}", {"kind": word}, felt=False)


def is_active(model: Any, k: int) -> bool:
    """Return True if an equality acts from the beginning on."""
    return bool(model.eq_active0[k]) and not is_disabled(model, EQUALITY_OFF)


def read_linear_law(model: Any, k: int) -> tuple[dict[str, float], float] | None:
    """Return factors by joint [-] and offset of an equality of fixed tendons; None where it is no linear law of joints.

    L1 - L1_0 = a0 + a1 (L2 - L2_0),  L = sum coef q  of a fixed tendon
    """
    start = float(model.eq_data[k][0])
    slope = float(model.eq_data[k][1])
    first = int(model.eq_obj1id[k])
    second = int(model.eq_obj2id[k])
    if second >= 0 and np.any(model.eq_data[k][2:5]):
        return None
    factors: dict[str, float] = {}
    offset = start
    for index, weight in ((first, 1.0), (second, -slope)):
        if index < 0:
            continue
        path, joints = _read_tendon_path(model, index)
        if not joints:
            return None
        offset += weight * float(model.tendon_length0[index])
        for name in joints:
            coefficient = path[f"of {name}"]
            assert isinstance(coefficient, float)
            factors[name] = factors.get(name, 0.0) + weight * coefficient
    return factors, offset


def remove_nonlinear_terms(model: Any) -> None:
    """Leave the linear part of equalities of joints."""
    for k in range(model.neq):
        if EQUALITY(int(model.eq_type[k])) == EQUALITY.mjEQ_JOINT:
            model.eq_data[k][2:5] = 0.0


def make_equality_remover(*kinds: Any, linear: bool = False) -> Callable[[Any], None]:
    """Return a function that takes equalities of some kinds out; linear : laws of fixed tendons that are linear stay."""

    def remove_equalities(model: Any) -> None:
        for k in range(model.neq):
            law = linear and read_linear_law(model, k) is not None
            if EQUALITY(int(model.eq_type[k])) in kinds and not law:
                model.eq_active0[k] = 0

    return remove_equalities
