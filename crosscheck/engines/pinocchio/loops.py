"""Closed loops, springs and forces in Pinocchio: the cut tree, and our own projection on its frames' Jacobians.

    positions     forwardKinematics of the tree, Newton on the closures' equations (`loop_closure`), pin.integrate
    rates         getFrameJacobian, and getFrameClassicalAcceleration at zero joint accelerations for G' v
    torques       rnea with external forces (springs, given forces), damping, friction and joint springs added;
                  S tau + G^T lambda = tau_tree, of least norm over the actuated joints where these are redundant
    wrenches      rnea again with the closures' multipliers among the external forces

No RigidConstraintModel takes part: its two types (CONTACT_3D and CONTACT_6D, spherical and fixed here) do not make up
the kinds of closures; the tests show that where they do, its getConstraintsJacobian spans the same rows.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from crosscheck.engines.pinocchio.model import BuiltModel, Dynamics, compute_inverse_dynamics, convert_to_engine
from crosscheck.engines.shared import loop_closure as assembly
from crosscheck.engines.shared.loop_closure import ClosureTask, FrameMotion
from crosscheck.engines.shared.prescribed import compute_spring_effort, passive_effort
from crosscheck.engines.shared.wrenches import (
    AppliedWrench,
    compute_applied_forces,
    compute_closure_forces,
    compute_reactions,
)
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Attachment, Mechanism

Array = NDArray[np.float64]
WORLD_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


@dataclass(frozen=True)
class Tree:
    """The cut tree as `loop_closure` wants it; coordinates in the model's order."""

    mechanism: Mechanism
    built: BuiltModel
    data: Any
    case: Case | None = None

    def evaluate_motion(self, time: Array) -> tuple[Array, Array, Array]:
        """Return q, v, a of the motion at times [s], joints that it leaves out at their guess."""
        assert self.case is not None
        q, qd, qdd = self.case.motion.evaluate(self.mechanism, time)
        return convert_to_engine(self.built, assembly.apply_guess(self.mechanism, self.case, q), qd, qdd)

    def integrate_step(self, q: Array, step: Array) -> Array:
        """Return q after a step (nv,) [rad], [m]."""
        return np.asarray(pin.integrate(self.built.model, q, step))

    def compute_frame_pairs(self, q: Array, v: Array) -> list[tuple[FrameMotion, FrameMotion]]:
        """Return the two frames of every closure."""
        self.update_kinematics(q, v)
        return [
            assembly.build_coupling_frames(c, self.find_joint_indices, q, v)
            if c.kind == "coupling"
            else (self.compute_frame(c.first), self.compute_frame(c.second))
            for c in self.mechanism.closures
        ]

    def find_joint_indices(self, joint: str) -> tuple[int, int]:
        """Return the indices of a joint's one number in q and in v [-]."""
        m = self.mechanism
        built = self.built
        return int(built.q_order[m.q_slices[joint]][0]), int(built.v_order[m.v_slices[joint]][0])

    def update_kinematics(self, q: Array, v: Array) -> None:
        """Put the tree where it is, joint accelerations zero [rad], [m], [s]."""
        model = self.built.model
        pin.forwardKinematics(model, self.data, q, v, np.zeros(model.nv))
        pin.computeJointJacobians(model, self.data, q)

    def compute_frame(self, at: Attachment) -> FrameMotion:
        """Return a frame where the tree has been put."""
        model = self.built.model
        data = self.data
        joint, frame = self.built.link[at.link]
        place = frame * pin.SE3(at.placement.rotation, at.placement.position)
        if joint == 0:
            none = np.zeros((3, model.nv))
            still = np.zeros(3)
            return FrameMotion(place.translation, place.rotation, none, none, still, still, still, still)
        pose = data.oMi[joint] * place
        jacobian = pin.getFrameJacobian(model, data, joint, place, WORLD_AXES)
        jacobian = jacobian.reshape(6, model.nv)  # a single column comes as a vector
        speed = pin.getFrameVelocity(model, data, joint, place, WORLD_AXES)
        rate = pin.getFrameClassicalAcceleration(model, data, joint, place, WORLD_AXES)
        return FrameMotion(
            pose.translation, pose.rotation, jacobian[:3], jacobian[3:],
            speed.linear, speed.angular, rate.linear, rate.angular,
        )  # fmt: skip


def solve_motion(mechanism: Mechanism, case: Case, built_model: BuiltModel, time: Array) -> tuple[Array, Array, Array]:
    """Return q (samples, nq), qd, qdd (samples, nv) [rad or m, s] in the mechanism's order, on its closures."""
    if not mechanism.closures:
        return case.motion.evaluate(mechanism, time)
    unknown = np.zeros(mechanism.nv, dtype=bool)
    unknown_q = np.zeros(mechanism.nq, dtype=bool)
    for name in assembly.find_unprescribed_joints(mechanism, case):
        unknown[built_model.v_order[mechanism.v_slices[name]]] = True
        unknown_q[built_model.q_order[mechanism.q_slices[name]]] = True
    tree = Tree(mechanism, built_model, built_model.model.createData(), case)
    q, v, a = assembly.solve_closed_motion(ClosureTask(mechanism, tree, unknown, unknown_q), time)
    return q[:, built_model.q_order], v[:, built_model.v_order], a[:, built_model.v_order]


@dataclass(frozen=True)
class ClosedDynamics:
    """Efforts (samples, nv) [N m] or [N], what Pinocchio says with all forces on, closures' wrenches on second frames."""

    torque: Array
    dynamics: Dynamics
    closures: dict[str, Array] = field(default_factory=dict)


def solve_efforts(
    mechanism: Mechanism, built_model: BuiltModel, time: Array, state: tuple[Array, Array, Array]
) -> ClosedDynamics:
    """Return the drives' efforts [N m], [N] and all wrenches under springs, forces and closures."""
    q, qd, qdd = state
    tree = Tree(mechanism, built_model, built_model.model.createData())
    outside = _collect_external_forces(tree, time, state)
    drives = passive_effort(mechanism, qd) + compute_spring_effort(mechanism, q)
    torque = (
        compute_inverse_dynamics(
            built_model, q, qd, qdd, [_build_external_forces(tree, *one) for one in outside]
        ).torque
        + drives
    )
    wrenches: dict[str, Array] = {}
    if mechanism.closures:
        outside, torque, wrenches = _split_loop_efforts(tree, outside, torque)
    dynamics = compute_inverse_dynamics(
        built_model, q, qd, qdd, [_build_external_forces(tree, *one) for one in outside]
    )
    return ClosedDynamics(torque, dynamics, wrenches)


Outside = list[tuple[Array, Array, list[AppliedWrench]]]


def _collect_external_forces(tree: Tree, time: Array, state: tuple[Array, Array, Array]) -> Outside:
    """Return configuration, velocity and what acts from outside, by sample."""
    out = []
    for t, q, v in zip(time, *convert_to_engine(tree.built, *state)[:2], strict=True):
        tree.update_kinematics(q, v)
        out.append((q, v, compute_applied_forces(tree.mechanism, float(t), tree.compute_frame)))
    return out


def _build_external_forces(tree: Tree, q: Array, v: Array, acting: list[AppliedWrench]) -> Any:
    """Return the external forces on every joint's body, in its frame, as rnea takes them."""
    pin.forwardKinematics(tree.built.model, tree.data, q)
    total = [pin.Force.Zero() for _ in range(tree.built.model.njoints)]
    for push in acting:
        joint = tree.built.link[push.link][0]
        total[joint] += tree.data.oMi[joint].actInv(pin.Force(push.force, push.moment + np.cross(push.x, push.force)))
    vector = pin.StdVec_Force()
    vector.extend(total)
    return vector


def _split_loop_efforts(tree: Tree, outside: Outside, torque: Array) -> tuple[Outside, Array, dict[str, Array]]:
    """Share the tree's efforts (samples, nv) out to drives and closures."""
    m = tree.mechanism
    out = []
    effort = np.empty_like(torque)
    wrench = np.empty((len(torque), len(m.closures), 6))
    for k, (q, v, acting) in enumerate(outside):
        pairs = tree.compute_frame_pairs(q, v)
        rows = assembly.assemble_rows(m.closures, pairs)
        g = rows.g[:, tree.built.v_order]
        effort[k] = assembly.split_efforts(g, torque[k], m.actuated, m.weights)
        closure_forces = compute_closure_forces(m, pairs, rows, assembly.solve_multipliers(g, torque[k], effort[k]))
        wrench[k] = compute_reactions(closure_forces, pairs)
        out.append((q, v, acting + closure_forces))
    return out, effort, {c.name: wrench[:, k] for k, c in enumerate(m.closures)}
