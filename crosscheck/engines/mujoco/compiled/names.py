"""Names of the parts of a compiled model of MuJoCo, and which of its actuators drive which joint or tendon."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco

OBJECT = mujoco.mjtObj
ON_JOINT = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
ON_TENDON = (mujoco.mjtTrn.mjTRN_TENDON,)


def resolve_name(model: Any, kind: Any, index: int, default: str) -> str:
    """Return the name of a part of a model, its kind and number where it has none."""
    return mujoco.mj_id2name(model, kind, index) or make_free_name(model, kind, f"{default}{index}")


def make_free_name(model: Any, kind: Any, name: str) -> str:
    """Return a name, with underlines behind it where a part of this kind [-] bears it in the file."""
    while mujoco.mj_name2id(model, kind, name) >= 0:
        name += "_"
    return name


def resolve_joint_name(model: Any, index: int) -> str:
    """Return the name of a joint, by its body where it has none: "arm (unnamed)" is no joint of a name in another file."""
    if name := mujoco.mj_id2name(model, OBJECT.mjOBJ_JOINT, index):
        return str(name)
    body = int(model.jnt_bodyid[index])
    number = f" {index - int(model.body_jntadr[body]) + 1}" if model.body_jntnum[body] > 1 else ""
    return make_free_name(model, OBJECT.mjOBJ_JOINT, f"{resolve_body_name(model, body)} (unnamed{number})")


def resolve_body_name(model: Any, index: int) -> str:
    """Return the name of a body."""
    return resolve_name(model, OBJECT.mjOBJ_BODY, index, "body")


def resolve_tendon_name(model: Any, index: int) -> str:
    """Return the name of a tendon."""
    return resolve_name(model, OBJECT.mjOBJ_TENDON, index, "tendon")


def list_joint_names(model: Any) -> dict[int, str]:
    """Return the names of all joints by number."""
    return {index: resolve_joint_name(model, index) for index in range(model.njnt)}


def find_actuators(model: Any, index: int, transmissions: tuple[Any, ...] = ON_JOINT) -> Iterator[int]:
    """Yield the numbers of the actuators that drive one joint, or one tendon, alone."""
    for k in range(model.nactuator):
        if mujoco.mjtTrn(int(model.actuator_trntype[k])) in transmissions and int(model.actuator_trnid[k][0]) == index:
            yield k


def read_gear(model: Any, actuator: int) -> float:
    """Return the gear of an actuator [-], [m]: the first number of its first output."""
    return float(model.actuator_gear[int(model.actuator_outadr[actuator])][0])
