"""Drake's own inverse dynamics of a plant, in the coordinates of the mechanism that was lifted from it.

    efforts       CalcInverseDynamics = M(q) a + C(q, v) v - forces, with the forces of all force elements: gravity, springs,
                  damping of joints; rotors are in M; dry friction, which no plant has, is friction sign(v) of the mechanism
    scalar        one number each, the same
    ball_rpy      R of roll, pitch, yaw; v is the angular velocity along the axes of F, the mechanism's along those of M:
                  v_F = R w_M,  a_F = R alpha_M,  tau_M = R^T tau_F
    floating      quaternion w x y z and position in the world; v = (w, v) along axes of F, the mechanism's (v, w) along
                  those of M:  dv_F/dt = R (dv_M/dt + w_M x v_M),  f_M = R^T f_F

Source: drake 1.51.1, pydrake.multibody; flexinv/NOTATION for the mechanism's coordinates.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RollPitchYaw, RotationMatrix
from pydrake.multibody import tree

from flexinv.errors import InputError
from flexinv.model.mechanism import WORLD, Array, Joint, Mechanism

KINDS = {
    "revolute": ("revolute", "continuous"), "prismatic": ("prismatic",), "screw": ("helical",), "universal": ("universal",),
    "ball_rpy": ("spherical",), "quaternion_floating": ("free",), "rpy_floating": ("free",),
}  # fmt: skip


@dataclass(frozen=True)
class OwnDynamics:
    """`crosscheck.lifting.reader_dynamics.ReaderDynamics` of a plant.

    joints : Drake's by names of the mechanism's; friction : (nv,) dry friction of the mechanism's joints [N m], [N]
    """

    plant: Any
    mechanism: Mechanism
    joints: Mapping[str, Any]
    friction: Array
    precision: float = 0.0
    start: Array | None = None

    @property
    def reader(self) -> str:
        """Return what answers, with its version [-]."""
        return f"Drake {metadata.version('drake')}"

    def efforts(
        self, q: Array, qd: Array, qdd: Array, gravity: Array | None = None, without: Collection[str] = ()
    ) -> Array:
        """Return efforts (samples, nv) [N m], [N] of q (samples, nq), qd, qdd (samples, nv) in the mechanism's order.

        gravity : (3,) [m/s^2] instead of the plant's; without : names of features, none of which a plant feels
        """
        plant, field = self.plant, self.plant.mutable_gravity_field()
        stated = np.array(field.gravity_vector())
        if gravity is not None:
            field.set_gravity_vector(np.asarray(gravity, dtype=float))
        context = plant.CreateDefaultContext()
        out = np.empty((len(q), self.mechanism.nv))
        for k in range(len(q)):
            out[k] = self._at(context, q[k], qd[k], qdd[k])
        field.set_gravity_vector(stated)
        return out

    def closing(self, q: Array, without: Collection[str] = ()) -> tuple[Array, Array] | None:
        """Return None: Drake's Python interface does not tell the constraints of a plant."""
        return None

    def _at(self, context: Any, q: Array, qd: Array, qdd: Array) -> Array:
        plant, mechanism = self.plant, self.mechanism
        place = plant.GetPositions(context)
        rate, push = np.zeros(plant.num_velocities()), np.zeros(plant.num_velocities())
        duals: dict[str, Callable[[Array], Array]] = {}
        for name, theirs in self.joints.items():
            joint = mechanism.joint_of[name]
            own = mechanism.v_slices[name]
            there = slice(theirs.velocity_start(), theirs.velocity_start() + theirs.num_velocities())
            at = slice(theirs.position_start(), theirs.position_start() + theirs.num_positions())
            mapped = _mapped(joint, theirs.type_name(), q[mechanism.q_slices[name]], qd[own], qdd[own])
            place[at], rate[there], push[there], duals[name] = mapped
        plant.SetPositions(context, place)
        plant.SetVelocities(context, rate)
        forces = tree.MultibodyForces(plant)
        plant.CalcForceElementsContribution(context, forces)
        tau = plant.CalcInverseDynamics(context, push, forces)
        found = np.zeros(mechanism.nv)
        for name, theirs in self.joints.items():
            there = slice(theirs.velocity_start(), theirs.velocity_start() + theirs.num_velocities())
            found[mechanism.v_slices[name]] = duals[name](tau[there])
        return found + self.friction * np.sign(qd)


Mapped = tuple[Array, Array, Array, Callable[[Array], Array]]


def _mapped(joint: Joint, word: str, q: Array, qd: Array, qdd: Array) -> Mapped:
    """Drake's position, velocity and acceleration of a joint's [rad], [m], and the map of efforts back."""
    if word == "ball_rpy":
        turn = _rotation(q)
        return RollPitchYaw(RotationMatrix(turn)).vector(), turn @ qd, turn @ qdd, lambda tau: turn.T @ tau
    if word in ("quaternion_floating", "rpy_floating"):
        return _floating(joint, word, q, qd, qdd)
    if joint.kind == "continuous":
        return np.array([np.arctan2(q[1], q[0])]), qd, qdd, lambda tau: tau
    return q, qd, qdd, lambda tau: tau


def _floating(joint: Joint, word: str, q: Array, qd: Array, qdd: Array) -> Mapped:
    """Drake counts from the world, the mechanism from the placement of the joint: R = R_0 R_q, p = p_0 + R_0 p_q [m]."""
    start = joint.placement
    turn = start.rotation @ _rotation(q[3:])
    at = start.position + start.rotation @ q[:3]
    linear, angular = qd[:3], qd[3:]
    whole = RotationMatrix(turn)
    way = whole.ToQuaternion().wxyz() if word == "quaternion_floating" else RollPitchYaw(whole).vector()
    place = np.concatenate([way, at])
    rate = np.concatenate([turn @ angular, turn @ linear])
    push = np.concatenate([turn @ qdd[3:], turn @ (qdd[:3] + np.cross(angular, linear))])

    def back(tau: Array) -> Array:
        return np.concatenate([turn.T @ tau[3:], turn.T @ tau[:3]])

    return place, rate, push, back


def _rotation(xyzw: Array) -> Array:
    """The rotation (3, 3) [-] of a quaternion x y z w."""
    unit = xyzw / np.linalg.norm(xyzw)
    return np.array(RotationMatrix(Quaternion(wxyz=unit[[3, 0, 1, 2]])).matrix())


def dynamics_of(plant: Any, mechanism: Mechanism, called: Mapping[str, Any], stated: str) -> OwnDynamics:
    """Return the dynamics of a plant in the coordinates of a mechanism; called : Drake's joints by the mechanism's names.

    Raises InputError where the plant has other joints, or one that the mechanism has from its other end.
    """
    moving = {joint.name: joint for joint in mechanism.joints if joint.nv}
    theirs = {name: joint for name, joint in called.items() if joint.num_velocities()}
    if set(moving) != set(theirs):
        odd = ", ".join(sorted(set(moving) ^ set(theirs))[:6])
        raise InputError(f"{stated}: Drake has other joints than the mechanism: {odd}")
    for name, joint in theirs.items():
        if moving[name].kind == "free" and moving[name].parent != WORLD:
            raise InputError(
                f"{stated}: joint {name} floats on {moving[name].parent}, which Drake has not: only on the world"
            )
        if moving[name].kind not in KINDS.get(joint.type_name(), ()):
            raise InputError(
                f"{stated}: Drake's joint {name} is {joint.type_name()}, the mechanism's {moving[name].kind}"
            )
    friction = [joint.friction for joint in mechanism.joints for _ in range(joint.nv)]
    return OwnDynamics(plant, mechanism, theirs, np.array(friction))


def dynamics(path: Path, mechanism: Mechanism) -> OwnDynamics:
    """Return Drake's own model of a file in the coordinates of a mechanism that another reader made of it.

    Raises InputError where Drake refuses the file, or has other joints.
    """
    from crosscheck_drake_lift import joint_names, read_plant  # which needs this module

    plant = read_plant(path, [])
    names = joint_names(plant, [])
    joints = {name: plant.get_joint(tree.JointIndex(k)) for k, name in enumerate(names)}
    free = [joint.name for joint in mechanism.joints if joint.kind == "free"]
    floating = [name for name, joint in joints.items() if joint.type_name().endswith("_floating")]
    if len(free) == len(floating) == 1:
        joints[free[0]] = joints.pop(floating[0])
    return dynamics_of(plant, mechanism, joints, str(path))
