"""Bodies and joints of a compiled model in the order of their elements in the MJCF, with what belongs to the joints alone.

MuJoCo numbers bodies depth-first, as they stand in the file, and joints by their bodies.  Where ``<include>``, ``<replicate>``,
``<attach>`` or ``<composite>`` make bodies, the file has other elements than the model has bodies.

Source: mujoco 4.0.0, user_model.cc.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from crosscheck.engines.mujoco.compiled.names import OBJECT, resolve_body_name, resolve_joint_name
from crosscheck.engines.mujoco.lift import lift, read_anchor
from crosscheck.lifting.description import Description
from flexinv.typing import Array


@dataclass(frozen=True)
class ModelJoint:
    """A joint of a model.

    name : as lifted; stated : in the file, "" where it has none
    numbers : by attribute, those of the joint itself and its class, without actuators [kg m^2], [N m s], [N m], [N m/rad]
    """

    name: str
    stated: str
    numbers: Mapping[str, float]


@dataclass(frozen=True)
class ModelBody:
    """A body of a model.

    name : of its link, as lifted; stated : in the file, "" where it has none; anchor : (3,) [m] of the link in the body's frame
    """

    name: str
    stated: str
    anchor: Array
    joints: tuple[ModelJoint, ...]


def lift_in_order(path: Path) -> tuple[Description, list[ModelBody]]:
    """Return the description of an MJCF, and its bodies in the order of the file [m, kg, rad].  Raises InputError."""
    description = lift(path)
    model: Any = description.dynamics.model  # type: ignore[union-attr]
    return description, [_read_body(model, k) for k in range(1, model.nbody)]


def _read_body(model: Any, body: int) -> ModelBody:
    first = int(model.body_jntadr[body])
    joints = tuple(_read_joint(model, first + k) for k in range(int(model.body_jntnum[body])))
    stated = _read_stated_name(model, OBJECT.mjOBJ_BODY, body)
    return ModelBody(resolve_body_name(model, body), stated, read_anchor(model, body), joints)


def _read_joint(model: Any, index: int) -> ModelJoint:
    dof = int(model.jnt_dofadr[index])
    numbers = {
        "damping": model.dof_damping[dof],
        "frictionloss": model.dof_frictionloss[dof],
        "armature": model.dof_armature[dof],
        "stiffness": np.ravel(model.jnt_stiffness[index])[0],
    }
    stated = _read_stated_name(model, OBJECT.mjOBJ_JOINT, index)
    return ModelJoint(resolve_joint_name(model, index), stated, {key: float(value) for key, value in numbers.items()})


def _read_stated_name(model: Any, kind: Any, index: int) -> str:
    return mujoco.mj_id2name(model, kind, index) or ""
