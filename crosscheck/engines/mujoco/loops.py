"""Closed loops, springs and forces in MuJoCo: its equality constraints, and a projection on their Jacobian.

    positions     mj_kinematics of the tree, Newton on the closures' equations (`loop_closure`), mj_integratePos
    rates         mj_jac, and mj_jacDot for G' v
    torques       "mujoco": mj_inverse with equality constraints off gives the open tree; the rows of efc_J that are
                  equalities, of the same state with equality constraints on, share it out to drives and closures, of
                  least norm over the actuated joints where these are redundant.
                  "mujoco-equality": mj_inverse as it is, equality constraints on.
    wrenches      mj_rnePostConstraint with given forces and closures in xfrc_applied; the tendons' forces it adds itself

Phases        closures that act for a while: MuJoCo's own switch of an equality, ``eq_active`` of its data
Equalities    spherical: connect;  revolute: two of them, a metre apart on the axis;  fixed: weld;  coupling of two joints:
              joint.  None of MuJoCo's types makes up universal, prismatic, cylindrical, point-on-line: their rows come
              from mj_jac, and there is no "mujoco-equality".
Springs       between points: spatial tendons with stiffness, springlength and damping;  in joints: stiffness, springref.
Forces        mj_inverse leaves applied forces out: mj_applyFT gives what they take off the effort.
Native result  An equality is soft: mj_inverse asks which force -D (J a - a_ref) goes with the given acceleration.  Where
              the motion closes the loops exactly, J a = a_ref and there is none, however stiff the constraint: what is
              left is the effort of the open tree, on passive joints too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from crosscheck.engines.mujoco.joints import BuiltModel, convert_to_engine
from crosscheck.engines.mujoco.model import convert_to_quaternion
from crosscheck.engines.shared import loop_closure as assembly
from crosscheck.engines.shared.loop_closure import FrameMotion
from crosscheck.engines.shared.wrenches import (
    AppliedWrench,
    compute_applied_forces,
    compute_closure_forces,
    compute_reactions,
    evaluate_wrench,
)
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import WORLD, Attachment, Closure, Mechanism

Array = NDArray[np.float64]
Motion = Callable[[Array], tuple[Array, Array, Array]]
CONNECT = mujoco.mjtEq.mjEQ_CONNECT
WELD = mujoco.mjtEq.mjEQ_WELD
JOINT = mujoco.mjtEq.mjEQ_JOINT
EQUALITIES = {"spherical": (CONNECT, (0.0,)), "revolute": (CONNECT, (0.0, 1.0)), "fixed": (WELD, (0.0,))}
OFF = int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
# As stiff as MuJoCo takes it at its own step of 2 ms (solref[0] >= 2 steps), impedance next to 1: see "Native result".
STIFF = ((0.004, 1.0), (0.9999, 0.9999, 1e-3, 0.5, 2.0))


def make_motion(mechanism: Mechanism, case: Case, built_model: BuiltModel) -> Motion:
    """Return the motion in MuJoCo's coordinates [rad], [m], joints that it leaves out at their guess."""

    def evaluate_state(time: Array) -> tuple[Array, Array, Array]:
        q, qd, qdd = case.motion.evaluate(mechanism, time)
        state = convert_to_engine(mechanism, built_model, assembly.apply_guess(mechanism, case, q), qd, qdd)
        return state.q, state.v, state.a

    return evaluate_state


def make_loop_extender(mechanism: Mechanism) -> Callable[[Any], None]:
    """Return a function that adds closures and springs to an MjSpec."""

    def add_loops(spec: Any) -> None:
        spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        for closure in mechanism.closures:
            _add_equality(spec, closure)
        for spring in mechanism.springs:
            tendon = spec.add_tendon(name=spring.name, springlength=[spring.rest, spring.rest])
            tendon.stiffness[0] = spring.stiffness
            tendon.damping[0] = spring.damping
            for at, end in ((spring.first, "first"), (spring.second, "second")):
                tendon.wrap_site(add_site(spec, at, f"{spring.name}/{end}", np.zeros(3)))

    return add_loops


def add_site(spec: Any, at: Attachment, name: str, offset: Array) -> str:
    """Add a site at an attachment, moved by an offset (3,) [m] along its axes; return its name."""
    body = spec.worldbody if at.link == WORLD else spec.body(at.link)
    place = at.placement.position + at.placement.rotation @ offset
    body.add_site(name=name, pos=place, quat=convert_to_quaternion(at.placement.rotation))
    return name


def has_equality(closure: Closure) -> bool:
    """Return True if MuJoCo's equalities make up a closure."""
    return closure.kind in EQUALITIES or (closure.kind == "coupling" and len(closure.factors) == 2)


def _add_equality(spec: Any, closure: Closure) -> None:
    if closure.kind == "coupling" and has_equality(closure):
        (first, f), (second, g) = closure.factors
        made = spec.add_equality(name=f"{closure.name}/0", type=JOINT, name1=first, name2=second)
        made.data[:2] = closure.offset / f, -g / f
        made.solref, made.solimp = STIFF
        return
    kind, offsets = EQUALITIES.get(closure.kind, (CONNECT, ()))
    for k, offset in enumerate(offsets):
        ends = ((closure.first, "first"), (closure.second, "second"))
        names = [add_site(spec, at, f"{closure.name}/{end}{k}", offset * closure.axis) for at, end in ends]
        made = spec.add_equality(
            name=f"{closure.name}/{k}", type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, name1=names[0], name2=names[1]
        )
        made.solref, made.solimp = STIFF


def list_missing_equalities(mechanism: Mechanism) -> list[str]:
    """Return the closures that none of MuJoCo's equalities makes up."""
    return [c.name for c in mechanism.closures if not has_equality(c)]


def build_data(built_model: BuiltModel, mechanism: Mechanism) -> Any:
    """Return an MjData in which the equalities of the mechanism's closures are active and no others (``eq_active``)."""
    data = mujoco.MjData(built_model.model)
    acting = {c.name for c in mechanism.closures}
    for k in range(built_model.model.neq):
        data.eq_active[k] = built_model.model.equality(k).name.rsplit("/", 1)[0] in acting
    return data


@dataclass(frozen=True)
class Tree:
    """The cut tree as `loop_closure` wants it; motion: q, v, a in MuJoCo's coordinates at times (samples,) [s]."""

    mechanism: Mechanism
    built: BuiltModel
    data: Any
    motion: Motion

    def evaluate_motion(self, time: Array) -> tuple[Array, Array, Array]:
        """Return q, v, a of the motion at times [s], joints that it leaves out at their guess."""
        return self.motion(time)

    def integrate_step(self, q: Array, step: Array) -> Array:
        """Return q after a step (nv,) [rad], [m]."""
        out = q.copy()
        mujoco.mj_integratePos(self.built.model, out, step, 1.0)
        return out

    def compute_frame_pairs(self, q: Array, v: Array) -> list[tuple[FrameMotion, FrameMotion]]:
        """Return the two frames of every closure."""
        model = self.built.model
        data = self.data
        data.qpos[:] = q
        data.qvel[:] = v
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        return self.collect_frame_pairs()

    def collect_frame_pairs(self) -> list[tuple[FrameMotion, FrameMotion]]:
        """Return the two frames of every closure where the data stands."""
        return [
            assembly.build_coupling_frames(c, self.find_joint_indices, self.data.qpos, self.data.qvel)
            if c.kind == "coupling"
            else (self.compute_frame(c.first), self.compute_frame(c.second))
            for c in self.mechanism.closures
        ]

    def find_joint_indices(self, joint: str) -> tuple[int, int]:
        """Return the indices of a joint's one number in qpos and in qvel [-]."""
        return self.built.q_at[joint], self.built.v_at[joint]

    def compute_frame(self, at: Attachment) -> FrameMotion:
        """Return a frame where the data stands."""
        model = self.built.model
        data = self.data
        body = 0 if at.link == WORLD else self.built.body[at.link]
        turn = data.xmat[body].reshape(3, 3)
        x = data.xpos[body] + turn @ at.placement.position
        linear, angular, linear_rate, angular_rate = (np.zeros((3, model.nv)) for _ in range(4))
        mujoco.mj_jac(model, data, linear, angular, x, body)
        mujoco.mj_jacDot(model, data, linear_rate, angular_rate, x, body)
        v = data.qvel
        rates = (linear @ v, angular @ v, linear_rate @ v, angular_rate @ v)
        return FrameMotion(x, turn @ at.placement.rotation, linear, angular, *rates)


def solve_closed_state(tree: Tree, left_out: set[str], time: Array) -> tuple[Array, Array, Array]:
    """Return qpos (samples, nq), qvel, qacc (samples, nv) [rad or m, s] on the closures."""
    m = tree.mechanism
    built = tree.built
    unknown = np.zeros(built.model.nv, dtype=bool)
    unknown_q = np.zeros(built.model.nq, dtype=bool)
    for name in left_out:
        joint = m.joint_of[name]
        at = built.q_at[name]
        first = built.v_at[name]
        unknown[first : first + joint.nv] = True
        unknown_q[at : at + (1 if joint.kind == "continuous" else joint.nq)] = True
    q, v, a = assembly.solve_closed_motion(assembly.ClosureTask(m, tree, unknown, unknown_q), time)
    for joint in m.joints:
        if joint.kind == "continuous":
            q[:, built.q_at[joint.name]] = np.unwrap(q[:, built.q_at[joint.name]])
    return q, v, a


@dataclass(frozen=True)
class SampleEfforts:
    """Efforts and forces of one sample, in MuJoCo's coordinates.

    effort : (nv,) [N m] or [N] of the drives; acting : given forces and closures; closures : (closures, 6)
    """

    effort: Array
    acting: list[AppliedWrench]
    closures: Array


def split_state_efforts(tree: Tree, time: float, driven: NDArray[np.bool_], weight: Array) -> SampleEfforts:
    """Return drives' efforts and what acts on links at the state in the data, qacc included; time [s].

    driven, weight : (nv,) which coordinates have a drive, and the weight of its square [-]
    """
    m = tree.mechanism
    model = tree.built.model
    data = tree.data
    g = compute_equality_rows(tree) if m.closures else np.zeros((0, model.nv))
    model.opt.disableflags |= OFF
    mujoco.mj_inverse(model, data)
    model.opt.disableflags &= ~OFF
    # friction of a joint at rest: taken out, see the head of `mujoco`
    effort = (
        data.qfrc_inverse
        + np.where(data.qvel == 0.0, data.qfrc_constraint, 0.0)
        - compute_generalized_forces(tree, time)
    )
    acting = compute_applied_forces(replace(m, springs=()), time, tree.compute_frame)
    if not m.closures:
        return SampleEfforts(effort, acting, np.zeros((0, 6)))
    pairs = tree.collect_frame_pairs()
    rows = assembly.assemble_rows(m.closures, pairs)
    unrealised = np.isin(rows.closure, [k for k, c in enumerate(m.closures) if not has_equality(c)])
    drives = assembly.split_efforts(np.vstack([g, rows.g[unrealised]]), effort, driven, weight)
    closure_forces = compute_closure_forces(m, pairs, rows, assembly.solve_multipliers(rows.g, effort, drives))
    return SampleEfforts(drives, acting + closure_forces, compute_reactions(closure_forces, pairs))


def compute_equality_rows(tree: Tree) -> Array:
    """Return the rows of efc_J that are equality constraints, (rows, nv)."""
    mujoco.mj_fwdPosition(tree.built.model, tree.data)
    equality = tree.data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    return np.array(tree.data.efc_J.reshape(-1, tree.built.model.nv)[equality])


def compute_generalized_forces(tree: Tree, time: float) -> Array:
    """Return the generalized forces (nv,) [N m] or [N] of given forces at a time [s]."""
    out = np.zeros(tree.built.model.nv)
    for force in tree.mechanism.forces:
        at = tree.compute_frame(force.at)
        wrench = evaluate_wrench(force, time)
        axes = at.r if force.follower else np.eye(3)
        body = 0 if force.at.link == WORLD else tree.built.body[force.at.link]
        mujoco.mj_applyFT(tree.built.model, tree.data, axes @ wrench[:3], axes @ wrench[3:], at.x, body, out)
    return out


def write_applied_wrenches(tree: Tree, acting: list[AppliedWrench]) -> None:
    """Write everything that acts on links into xfrc_applied, [N] and [N m] at the bodies' centres of mass."""
    data = tree.data
    data.xfrc_applied[:] = 0.0
    for push in acting:
        if push.link != WORLD:
            body = tree.built.body[push.link]
            moment = push.moment + np.cross(push.x - data.xipos[body], push.force)
            data.xfrc_applied[body] += np.concatenate([push.force, moment])
