"""MuJoCo's own inverse dynamics of a compiled model, in the coordinates of the mechanism that was lifted from it.

    efforts       qfrc_inverse of mj_inverse on a copy of the model; contacts, limits and equality constraints are switched off,
                  and every enabling flag is (mj_inverse of discrete time is about an integrator)
    dry friction  a constraint: made as stiff as `mujoco.joints.STIFF_FRICTION`, it is sign(v) frictionloss of every moving joint
    features      each is switched off in the copy by what its name stands for (`mujoco.compiled.features`)
    ties          efc_pos and efc_J of the rows that are equalities, at rest

Source: mujoco 4.0.0, engine_inverse.c, engine_core_constraint.c.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from crosscheck.engines.mujoco.compiled.names import list_joint_names
from crosscheck.engines.mujoco.joints import (
    STIFF_FRICTION,
    BuiltModel,
    convert_effort_from_engine,
    convert_from_engine,
    convert_to_engine,
)
from flexinv.errors import InputError
from flexinv.model.mechanism import Array, Mechanism

DISABLE = mujoco.mjtDisableBit
LEFT_OUT = int(DISABLE.mjDSBL_CONTACT | DISABLE.mjDSBL_LIMIT | DISABLE.mjDSBL_EQUALITY)
SCALARS = ("revolute", "prismatic")
ONE_NUMBER = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)


def remove_nothing(model: Any, names: Collection[str]) -> None:
    """Leave a model as it is: it has no features."""


@dataclass
class OwnDynamics:
    """`crosscheck.lifting.reader_dynamics.ReaderDynamics` of a model of MuJoCo.

    model : compiled; mechanism : lifted from it; built : where its joints stand in the model
    switch_off : what takes features out of a model, by their names
    """

    model: Any
    mechanism: Mechanism
    built: BuiltModel
    switch_off: Callable[[Any, Collection[str]], None] = remove_nothing
    precision: float = 0.0
    _models: dict[frozenset[str], Any] = field(default_factory=dict)
    _tied_models: dict[frozenset[str], Any] = field(default_factory=dict)

    @property
    def reader(self) -> str:
        """Return the engine with its version [-]."""
        return f"MuJoCo {mujoco.mj_versionString()}"

    def efforts(
        self, q: Array, qd: Array, qdd: Array, gravity: Array | None = None, without: Collection[str] = ()
    ) -> Array:
        """Return efforts (samples, nv) [N m], [N] of q (samples, nq), qd, qdd (samples, nv) in the mechanism's order.

        gravity : (3,) [m/s^2] instead of the model's; without : names of features that are switched off
        """
        model = self._build_model(frozenset(without))
        stated = model.opt.gravity.copy()
        if gravity is not None:
            model.opt.gravity[:] = gravity
        built_model = BuiltModel(model, self.built.q_at, self.built.v_at, self.built.body)
        state = convert_to_engine(self.mechanism, built_model, q, qd, qdd)
        data = mujoco.MjData(model)
        force = np.empty((len(q), model.nv))
        for k in range(len(q)):
            data.qpos[:] = state.q[k]
            data.qvel[:] = state.v[k]
            data.qacc[:] = state.a[k]
            mujoco.mj_inverse(model, data)
            force[k] = data.qfrc_inverse
        model.opt.gravity[:] = stated
        return convert_effort_from_engine(self.mechanism, built_model, q, force)

    @property
    def start(self) -> Array:
        """Return qpos0 in the mechanism's coordinates (nq,) [rad], [m]."""
        place: Array = convert_from_engine(self.mechanism, self.built, self.model.qpos0[None])[0]
        return place

    def closing(self, q: Array, without: Collection[str] = ()) -> tuple[Array, Array] | None:
        """Return residual (rows,) [m], [rad] and Jacobian (rows, nv) of the equalities at q (nq,); None where there are none.

        without : names of features that are left out
        """
        if not self.model.neq:
            return None
        model = self._build_constraint_model(frozenset(without))
        none = np.zeros((1, self.mechanism.nv))
        built_model = BuiltModel(model, self.built.q_at, self.built.v_at, self.built.body)
        data = mujoco.MjData(model)
        data.qpos[:] = convert_to_engine(self.mechanism, built_model, q[None], none, none).q[0]
        for stage in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_tendon, mujoco.mj_makeConstraint):
            stage(model, data)
        rows = data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
        jacobian = data.efc_J.reshape(-1, model.nv)[rows]
        effort = convert_effort_from_engine(self.mechanism, built_model, np.tile(q, (len(jacobian), 1)), jacobian)
        return np.array(data.efc_pos[rows]), effort

    def _build_constraint_model(self, without: frozenset[str]) -> Any:
        """The model with equality constraints alone."""
        if without not in self._tied_models:
            model = copy.copy(self.model)
            self.switch_off(model, without)
            model.opt.disableflags |= int(DISABLE.mjDSBL_CONTACT | DISABLE.mjDSBL_LIMIT | DISABLE.mjDSBL_FRICTIONLOSS)
            model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
            self._tied_models[without] = model
        return self._tied_models[without]

    def _build_model(self, without: frozenset[str]) -> Any:
        """The model as it answers, with features switched off."""
        if without not in self._models:
            model = copy.copy(self.model)
            model.opt.disableflags |= LEFT_OUT
            model.opt.enableflags = 0
            model.dof_solref[:] = STIFF_FRICTION
            model.tendon_solref_fri[:] = STIFF_FRICTION
            self.switch_off(model, without)
            if "free-armature" in without:  # which MuJoCo has summed into the inertia of bodies of their own
                mujoco.mj_setConst(model, mujoco.MjData(model))
            self._models[without] = model
        return self._models[without]


def find_joint_addresses(model: Any, names: Mapping[int, str]) -> BuiltModel:
    """Return the places of the joints of a compiled model in it; names : of its joints by number."""
    q_at = {name: int(model.jnt_qposadr[index]) for index, name in names.items()}
    v_at = {name: int(model.jnt_dofadr[index]) for index, name in names.items()}
    return BuiltModel(model, q_at, v_at, {})


def dynamics(path: Path, mechanism: Mechanism) -> OwnDynamics:
    """Return MuJoCo's own model of a file in the coordinates of a mechanism that another reader made of it.

    Raises InputError where MuJoCo refuses the file, or has other joints.
    """
    from crosscheck.engines.mujoco.lift import read_model  # which needs this module

    model = read_model(path)
    names = list_joint_names(model)
    wanted = {joint.name for joint in mechanism.joints if joint.nv}
    if set(names.values()) != wanted:
        odd = sorted(set(names.values()) ^ wanted)
        raise InputError(f"{path}: MuJoCo has other joints than the mechanism: {', '.join(odd[:6])}")
    return OwnDynamics(model, mechanism, find_joint_addresses(model, names))
