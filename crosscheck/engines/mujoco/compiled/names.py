"""Names of the parts of a compiled model of MuJoCo, and which of its actuators drive which joint or tendon."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco

OBJECT = mujoco.mjtObj
ON_JOINT = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
ON_TENDON = (mujoco.mjtTrn.mjTRN_TENDON,)


def name_of(model: Any, kind: Any, index: int, default: str) -> str:
    """Return the name of a part of a model, its kind and number where it has none."""
    return mujoco.mj_id2name(model, kind, index) or f"{default}{index}"


def joint_name(model: Any, index: int) -> str:
    """Return the name of a joint."""
    return name_of(model, OBJECT.mjOBJ_JOINT, index, "joint")


def body_name(model: Any, index: int) -> str:
    """Return the name of a body."""
    return name_of(model, OBJECT.mjOBJ_BODY, index, "body")


def tendon_name(model: Any, index: int) -> str:
    """Return the name of a tendon."""
    return name_of(model, OBJECT.mjOBJ_TENDON, index, "tendon")


def joint_names(model: Any) -> dict[int, str]:
    """Return the names of all joints by number."""
    return {index: joint_name(model, index) for index in range(model.njnt)}


def actuators_on(model: Any, index: int, transmissions: tuple[Any, ...] = ON_JOINT) -> Iterator[int]:
    """Yield the numbers of the actuators that drive one joint, or one tendon, alone."""
    for k in range(model.nactuator):
        if mujoco.mjtTrn(int(model.actuator_trntype[k])) in transmissions and int(model.actuator_trnid[k][0]) == index:
            yield k


def gear_of(model: Any, actuator: int) -> float:
    """Return the gear of an actuator [-], [m]: the first number of its first output."""
    return float(model.actuator_gear[int(model.actuator_outadr[actuator])][0])
