"""Pinocchio's own inverse dynamics of a model, in the coordinates of the mechanism that was lifted from it.

    efforts       rnea, whose armature is the model's, and beside it damping v + friction sign(v) of the model's own numbers,
                  which rnea leaves out
    joints        by name; each kind has the mechanism's coordinates in the same order

Source: pinocchio 4.1, algorithm/rnea.hxx.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from flexinv.errors import InputError
from flexinv.model.mechanism import Array, Mechanism


@dataclass(frozen=True)
class OwnDynamics:
    """`crosscheck.lifting.reader_dynamics.ReaderDynamics` of a model of Pinocchio.

    mechanism : lifted from it; rotor : (nv,) [kg m^2] in the mechanism's order, of rotors that only the mechanism knows
    """

    model: Any
    mechanism: Mechanism
    rotor: Array
    precision: float = 0.0

    @property
    def reader(self) -> str:
        """Return the engine with its version [-]."""
        return f"Pinocchio {pin.__version__}"

    def efforts(
        self, q: Array, qd: Array, qdd: Array, gravity: Array | None = None, without: Collection[str] = ()
    ) -> Array:
        """Return efforts (samples, nv) [N m], [N] of q (samples, nq), qd, qdd (samples, nv) in the mechanism's order.

        gravity : (3,) [m/s^2] instead of the model's; without : names of features, of which a model of Pinocchio has none
        """
        model = self.model
        stated = model.gravity.copy()
        if gravity is not None:
            model.gravity = pin.Motion(np.asarray(gravity, dtype=float), np.zeros(3))
        data = model.createData()
        place, rate, push = self._convert_state(q, qd, qdd)
        try:
            force = np.array([pin.rnea(model, data, *one) for one in zip(place, rate, push, strict=True)])
        finally:
            model.gravity = stated  # a model in memory stays what it was
        force += model.damping * rate + model.upperDryFrictionLimit * np.sign(rate)
        out = np.empty_like(qd)
        for name, columns in self.mechanism.v_slices.items():
            if columns.stop > columns.start:
                first = self._find_joint(name).idx_v
                out[:, columns] = force[:, first : first + columns.stop - columns.start]
        return out + self.rotor * qdd

    @property
    def start(self) -> None:
        """Return None: the neutral configuration is all joints at zero [rad], [m]."""

    def closing(self, q: Array, without: Collection[str] = ()) -> tuple[Array, Array] | None:
        """Return None: what ties joints of a model of Pinocchio is in its coordinates, or in lists beside it."""
        return None

    def _find_joint(self, name: str) -> Any:
        return self.model.joints[self.model.getJointId(name)]

    def _convert_state(self, q: Array, qd: Array, qdd: Array) -> tuple[Array, Array, Array]:
        """The model's q, v and a of the mechanism's [rad or m, s]."""
        model = self.model
        mechanism = self.mechanism
        place = np.tile(pin.neutral(model), (len(q), 1))
        rate = np.zeros((len(q), model.nv))
        push = np.zeros((len(q), model.nv))
        for joint in mechanism.joints:
            if not joint.nv:
                continue
            theirs = self._find_joint(joint.name)
            mine = q[:, mechanism.q_slices[joint.name]]
            columns = mechanism.v_slices[joint.name]
            if joint.kind == "continuous" and theirs.nq == 1:
                mine = np.arctan2(mine[:, 1], mine[:, 0])[:, None]
            elif joint.kind == "revolute" and theirs.nq == 2:
                mine = np.hstack([np.cos(mine), np.sin(mine)])
            place[:, theirs.idx_q : theirs.idx_q + theirs.nq] = mine
            rate[:, theirs.idx_v : theirs.idx_v + joint.nv] = qd[:, columns]
            push[:, theirs.idx_v : theirs.idx_v + joint.nv] = qdd[:, columns]
        return place, rate, push


def build_dynamics(model: Any, mechanism: Mechanism, stated: str) -> OwnDynamics:
    """Return the dynamics of a model in the coordinates of a mechanism; stated : what it is called in messages.

    Raises InputError where the model has other joints, or fewer coordinates, as one with mimic joints in it.
    """
    moving = {joint.name: joint.nv for joint in mechanism.joints if joint.nv}
    engine_joints = {model.names[k]: int(model.joints[k].nv) for k in range(1, model.njoints)}
    if moving != engine_joints:
        odd = sorted({f"{name} with {count}" for name, count in moving.items() ^ engine_joints.items()})
        raise InputError(f"{stated}: Pinocchio has other joints, or other coordinates: {', '.join(odd[:6])}")
    return OwnDynamics(model, mechanism, np.zeros(mechanism.nv))


def dynamics(path: Path, mechanism: Mechanism) -> OwnDynamics:
    """Return Pinocchio's own model of a URDF in the coordinates of a mechanism that another reader made of it.

    Rotors that only Drake's tags state are none of Pinocchio's: they are taken as the mechanism has them.
    Raises InputError where Pinocchio refuses the file, or has other joints.
    """
    try:
        model = pin.buildModelFromUrdf(str(path))
        free = bool(mechanism.joints) and mechanism.joints[0].kind == "free"
        held = free and not model.existJointName(mechanism.joints[0].name)  # the file leaves open how its root is held
        if held:
            model = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    except (ValueError, RuntimeError, IndexError, TypeError) as error:
        raise InputError(f"{path}: Pinocchio refuses it: {' '.join(str(error).split())}") from None
    if held:
        model.names[1] = mechanism.joints[0].name
    made = build_dynamics(model, mechanism, str(path))
    rotors = [joint.rotor_inertia for joint in mechanism.joints for _ in range(joint.nv)]
    return OwnDynamics(made.model, mechanism, np.array(rotors))
