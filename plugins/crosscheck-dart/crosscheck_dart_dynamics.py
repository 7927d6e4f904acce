"""DART's own inverse dynamics of a skeleton, in the coordinates of the mechanism that was lifted from it.

    efforts       computeInverseDynamics with damping and springs; DART takes both at the end of its time step,
                  k (q + h v - rest),  d (v + h a),  so h is next to nothing here; Coulomb friction, which it solves for with
                  contacts, is friction sign(v) of its own numbers
    scalar        one number each, the same; universal: two
    BallJoint     q = log R; FreeJoint: q = (log R, p)
    rates         of both along axes that DART chooses: by its own Jacobian J of the twist (w, v) of the child's body,
                  v_M = X J v,  dv_M/dt = X (J dv/dt + dJ/dt v),  tau_M = (X J)^-T tau,  with X into the mechanism's frame M

Source: dartpy 6.20.0, dart/dynamics/GenericJoint.hpp.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import dartpy as dart
import numpy as np
from scipy.spatial.transform import Rotation

from flexinv.errors import InputError
from flexinv.model.mechanism import Array, Joint, Mechanism

TWISTS = ("BallJoint", "FreeJoint")
STEP = 1e-300  # [s]: DART refuses 0
KINDS = {
    "RevoluteJoint": ("revolute", "continuous"), "PrismaticJoint": ("prismatic",), "ScrewJoint": ("helical",),
    "UniversalJoint": ("universal",), "BallJoint": ("spherical",), "FreeJoint": ("free",),
}  # fmt: skip


@dataclass(frozen=True)
class OwnDynamics:
    """`crosscheck.lifting.reader_dynamics.ReaderDynamics` of a skeleton.

    joints : DART's by names of the mechanism's
    """

    skeleton: Any
    mechanism: Mechanism
    joints: Mapping[str, Any]
    precision: float = 0.0
    start: Array | None = None

    @property
    def reader(self) -> str:
        """Return what answers, with its version [-]."""
        return f"DART {dart.__version__}"

    def efforts(
        self, q: Array, qd: Array, qdd: Array, gravity: Array | None = None, without: Collection[str] = ()
    ) -> Array:
        """Return efforts (samples, nv) [N m], [N] of q (samples, nq), qd, qdd (samples, nv) in the mechanism's order.

        gravity : (3,) [m/s^2] instead of the skeleton's; without : names of features, none of which a skeleton feels
        """
        skeleton = self.skeleton
        stated, step = np.array(skeleton.getGravity()), skeleton.getTimeStep()
        if gravity is not None:
            skeleton.setGravity(np.asarray(gravity, dtype=float))
        skeleton.setTimeStep(STEP)
        out = np.array([self._at(*one) for one in zip(q, qd, qdd, strict=True)]).reshape(qd.shape)
        skeleton.setTimeStep(step)
        skeleton.setGravity(stated)
        return out

    def closing(self, q: Array, without: Collection[str] = ()) -> tuple[Array, Array] | None:
        """Return None: a skeleton has no equations between its coordinates that its Python interface tells."""
        return None

    def _at(self, q: Array, qd: Array, qdd: Array) -> Array:
        skeleton, mechanism = self.skeleton, self.mechanism
        place, rate, push = (np.zeros(skeleton.getNumDofs()) for _ in range(3))
        for name, there in self._places.items():
            place[there] = _position(mechanism.joint_of[name], q[mechanism.q_slices[name]])
        skeleton.setPositions(place)
        maps = {name: _map(joint) for name, joint in self.joints.items()}
        for name, there in self._places.items():
            rate[there] = np.linalg.solve(maps[name], qd[mechanism.v_slices[name]])
        skeleton.setVelocities(rate)
        for name, there in self._places.items():
            bent = _drift(self.joints[name], rate[there])
            push[there] = np.linalg.solve(maps[name], qdd[mechanism.v_slices[name]] - bent)
        skeleton.setAccelerations(push)
        skeleton.computeInverseDynamics(False, True, True)
        tau = np.array(skeleton.getForces())
        found = np.zeros(mechanism.nv)
        for name, there in self._places.items():
            found[mechanism.v_slices[name]] = np.linalg.solve(maps[name].T, tau[there])
        return found + self._friction * np.sign(qd)

    @property
    def _places(self) -> dict[str, list[int]]:
        """Numbers of each joint's coordinates among the skeleton's."""
        return {
            name: [joint.getIndexInSkeleton(k) for k in range(joint.getNumDofs())]
            for name, joint in self.joints.items()
        }

    @property
    def _friction(self) -> Array:
        result = np.zeros(self.mechanism.nv)
        for name, joint in self.joints.items():
            own = self.mechanism.v_slices[name]
            result[own] = [joint.getCoulombFriction(k) for k in range(joint.getNumDofs())]
        return result


def _position(joint: Joint, q: Array) -> Array:
    """DART's position of a joint's [rad], [m]."""
    if joint.kind == "continuous":
        return np.array([np.arctan2(q[1], q[0])])
    if joint.kind == "spherical":
        return np.asarray(Rotation.from_quat(q).as_rotvec())
    if joint.kind == "free":
        return np.concatenate([Rotation.from_quat(q[3:]).as_rotvec(), q[:3]])
    return q


def _map(joint: Any) -> Array:
    """The matrix X J (nv, nv) [-], [m] from DART's rates to the mechanism's; the identity for joints of scalar coordinates."""
    if joint.getType() not in TWISTS:
        return np.eye(joint.getNumDofs())
    return _into_frame(joint) @ np.array(joint.getRelativeJacobian())


def _drift(joint: Any, rate: Array) -> Array:
    """X dJ/dt v (nv,) [rad/s^2], [m/s^2]."""
    if joint.getType() not in TWISTS:
        return np.zeros(joint.getNumDofs())
    result: Array = _into_frame(joint) @ np.array(joint.getRelativeJacobianTimeDeriv()) @ rate
    return result


def _into_frame(joint: Any) -> Array:
    """The matrix X (nv, 6) from a twist (w, v) of the child's body to that of M: w_M = R^T w, v_M = R^T (v + w x p), v first."""
    pose = joint.getTransformFromChildBodyNode()
    turn, (x, y, z) = np.array(pose.rotation()).T, np.ravel(pose.translation())
    cross = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])  # w x p
    angular = np.hstack([turn, np.zeros((3, 3))])
    linear = np.hstack([turn @ cross, turn])
    return angular if joint.getType() == "BallJoint" else np.vstack([linear, angular])


def dynamics_of(skeleton: Any, mechanism: Mechanism, stated: str) -> OwnDynamics:
    """Return the dynamics of a skeleton in the coordinates of a mechanism; joints are found by name.

    Raises InputError where the skeleton has other joints.
    """
    moving = {joint.name: joint.kind for joint in mechanism.joints if joint.nv}
    theirs = {}
    for k in range(skeleton.getNumJoints()):
        joint = skeleton.getJoint(k)
        if joint.getNumDofs():
            theirs[joint.getName()] = joint
    if set(moving) != set(theirs):
        odd = ", ".join(sorted(set(moving) ^ set(theirs))[:6])
        raise InputError(f"{stated}: DART has other joints than the mechanism: {odd}")
    for name, joint in theirs.items():
        if moving[name] not in KINDS.get(joint.getType(), ()):
            raise InputError(f"{stated}: DART's joint {name} is a {joint.getType()}, the mechanism's {moving[name]}")
    return OwnDynamics(skeleton, mechanism, theirs)


def dynamics(path: Path, mechanism: Mechanism) -> OwnDynamics:
    """Return DART's own model of a file in the coordinates of a mechanism that another reader made of it.

    Raises InputError where DART refuses the file, or has other joints.
    """
    from crosscheck_dart_lift import read_skeleton  # which needs this module

    skeleton, _ = read_skeleton(path)
    return dynamics_of(skeleton, mechanism, str(path))
