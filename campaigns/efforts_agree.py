"""The independent check of a pair: `pin.rnea` and `mj_inverse` of two files agree in the coordinates of the first.

Neither the reader nor the comparison of this project has a part in it.  Damping, springs and rotors are left out: what is one
number of a joint is no matter of frames.  A machine that floats is at rest and accelerated, and nothing holds its base: that
shows its mass matrix and its weight, from whichever body it is told.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
from retelling import RewrittenMechanism
from scipy.spatial.transform import Rotation

from crosscheck.engines.pinocchio.model import build
from crosscheck.lifting.rigid import apply_placement, inverse
from flexinv.model.mechanism import Array, Mechanism, Placement

SAMPLES = 5
SCALARS = ("revolute", "continuous", "prismatic", "helical")


@dataclass(frozen=True)
class State:
    """Coordinates, rates, accelerations by joint: scalars, or a rotation (3, 3) and vectors (3,); of a root its pose in space.

    push : acceleration (linear, angular) of the root in its own frame [m/s^2], [rad/s^2]
    """

    q: Mapping[str, Any]
    qd: Mapping[str, Any]
    qdd: Mapping[str, Any]
    pose: Placement | None = None
    push: Array | None = None


@dataclass(frozen=True)
class WrittenMachine:
    """A machine as it is written: path of a file, or a mechanism in memory; rewritten : how; form : urdf, mjcf or memory."""

    rewritten: RewrittenMechanism
    form: str
    path: Path | None = None


def disagreement(one: WrittenMachine, other: WrittenMachine, seed: int) -> float:
    """Return the largest difference of a joint's effort over the largest effort [-], on random states."""
    dice = np.random.default_rng(seed)
    first = one.rewritten.mechanism
    worst = 0.0
    for _ in range(SAMPLES):
        state = _drawn(first, dice)
        ours, theirs = _efforts(one, state), _efforts(other, _carried(first, other.rewritten, state))
        largest = max((float(np.abs(x).max()) for x in ours.values()), default=0.0) or 1.0
        for name, count in other.rewritten.joints.items():
            if name in ours:
                back = _back(first, other.rewritten, name, theirs[count.name])
                worst = max(worst, float(np.abs(ours[name] - back).max()) / largest)
    return worst


def _drawn(mechanism: Mechanism, dice: np.random.Generator) -> State:
    """Return a random state; of what floats one at rest."""
    q: dict[str, Any] = {}
    qd: dict[str, Any] = {}
    qdd: dict[str, Any] = {}
    floats = any(j.kind == "free" for j in mechanism.joints)
    for joint in mechanism.joints:
        if joint.kind in SCALARS:
            q[joint.name], qd[joint.name] = float(dice.uniform(-1, 1)), 0.0 if floats else float(dice.normal())
            qdd[joint.name] = float(dice.normal())
        elif joint.kind == "spherical":
            q[joint.name] = Rotation.random(random_state=dice).as_matrix()
            qd[joint.name] = np.zeros(3) if floats else dice.normal(size=3)
            qdd[joint.name] = dice.normal(size=3)
        elif joint.kind == "universal":
            q[joint.name] = dice.uniform(-1, 1, 2)
            qd[joint.name] = np.zeros(2) if floats else dice.normal(size=2)
            qdd[joint.name] = dice.normal(size=2)
    if not floats:
        return State(q, qd, qdd)
    pose = Placement(dice.uniform(-1, 1, 3), Rotation.random(random_state=dice).as_matrix())
    return _released(mechanism, State(q, qd, qdd, pose, np.zeros(6)))


def _released(mechanism: Mechanism, state: State) -> State:
    """The state with the acceleration of the base that leaves nothing to hold it."""
    model = build(mechanism).model
    model.armature[:] = 0.0
    data = model.createData()
    q, v, a = _of_pinocchio(model, mechanism, state)
    base = next(joint.name for joint in mechanism.joints if joint.kind == "free")
    start = model.joints[model.getJointId(_named(model, base))].idx_v
    own = slice(start, start + 6)
    held = pin.rnea(model, data, q, v, a)[own]
    inertia = pin.crba(model, data, q)[own, own]
    return replace(state, push=-np.linalg.solve(np.triu(inertia) + np.triu(inertia, 1).T, held))


def _named(model: Any, name: str) -> str:
    """The name of a joint in a model, which calls a root as it likes."""
    return name if model.existJointName(name) else str(model.names[1])


def _carried(first: Mechanism, rewritten: RewrittenMechanism, state: State) -> State:
    """The state of the first machine in the coordinates of another that was told from it."""
    q: dict[str, Any] = {}
    qd: dict[str, Any] = {}
    qdd: dict[str, Any] = {}
    for name, count in rewritten.joints.items():
        if name not in state.q:
            continue
        joint = first.joint_of[name]
        if joint.kind in SCALARS:
            q[count.name] = count.sign * (state.q[name] - count.offset)
            qd[count.name], qdd[count.name] = count.sign * state.qd[name], count.sign * state.qdd[name]
        elif joint.kind == "spherical":
            turn = rewritten.links[joint.child].frame.rotation
            q[count.name] = turn.T @ state.q[name] @ turn
            qd[count.name], qdd[count.name] = turn.T @ state.qd[name], turn.T @ state.qdd[name]
        else:
            q[count.name], qd[count.name], qdd[count.name] = state.q[name], state.qd[name], state.qdd[name]
    if state.pose is None:
        return State(q, qd, qdd)
    root = next(j.child for j in rewritten.mechanism.joints if j.kind == "free")
    link, seat = next((name, seat) for name, seat in rewritten.links.items() if seat.name == root)
    pose, push = _of_link(first, link, state)
    push = np.concatenate(_shifted(seat.frame, push))
    return State(q, qd, qdd, apply_placement(apply_placement(rewritten.world, pose), seat.frame), push)


def _shifted(frame: Placement, push: Array) -> tuple[Array, Array]:
    """The acceleration, at rest, of a frame on a body of which that of another is known."""
    linear = push[:3] + np.cross(push[3:], frame.position)
    return frame.rotation.T @ linear, frame.rotation.T @ push[3:]


def _of_link(mechanism: Mechanism, link: str, state: State) -> tuple[Placement, Array]:
    """Pose and acceleration, at rest, of a link of a machine that floats, by Pinocchio."""
    built = build(mechanism)
    model, data = built.model, built.model.createData()
    q, v, a = _of_pinocchio(model, mechanism, state)
    pin.forwardKinematics(model, data, q, v, a)
    index, frame = built.link[link]
    pose, push = data.oMi[index] * frame, frame.actInv(data.a[index])
    return Placement(pose.translation, pose.rotation), push.vector


def _efforts(written: WrittenMachine, state: State) -> dict[str, Array]:
    if written.form == "mjcf":
        return _by_mujoco(written, state)
    mechanism = written.rewritten.mechanism
    if written.form == "memory":
        model = build(mechanism).model
    else:
        free = not _says_root(str(written.path)) and any(j.kind == "free" for j in mechanism.joints)
        model = pin.buildModelFromUrdf(str(written.path), *([pin.JointModelFreeFlyer()] if free else []))
        model.gravity = pin.Motion(mechanism.gravity, np.zeros(3))
    model.armature[:] = 0.0
    q, v, a = _of_pinocchio(model, mechanism, state)
    result = pin.rnea(model, model.createData(), q, v, a)
    out = {}
    for joint in mechanism.joints:
        if joint.kind in (*SCALARS, "spherical"):
            own = model.joints[model.getJointId(joint.name)]
            out[joint.name] = result[own.idx_v : own.idx_v + own.nv]
        elif joint.kind == "universal":
            out[joint.name] = np.concatenate([result[s] for s in _universal(model, joint.name, "v")])
    return out


def _says_root(path: str) -> bool:
    return 'type="floating"' in Path(path).read_text()


def _universal(model: Any, name: str, which: str) -> list[slice]:
    """Slices of the two coordinates, however the model tells the joint."""
    if model.existJointName(f"{name}.1"):
        joints = [model.joints[model.getJointId(f"{name}.{k}")] for k in (1, 2)]
        return [slice(getattr(j, f"idx_{which}"), getattr(j, f"idx_{which}") + 1) for j in joints]
    start = getattr(model.joints[model.getJointId(name)], f"idx_{which}")
    return [slice(start, start + 1), slice(start + 1, start + 2)]


def _of_pinocchio(model: Any, mechanism: Mechanism, state: State) -> tuple[Array, Array, Array]:
    q, v, a = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
    for joint in mechanism.joints:
        if joint.kind == "universal":
            for k, (at, vat) in enumerate(
                zip(_universal(model, joint.name, "q"), _universal(model, joint.name, "v"), strict=True)
            ):
                q[at], v[vat], a[vat] = state.q[joint.name][k], state.qd[joint.name][k], state.qdd[joint.name][k]
            continue
        if not joint.nv:
            continue
        number = model.getJointId(_named(model, joint.name))
        own = model.joints[number]
        at, vat = slice(own.idx_q, own.idx_q + own.nq), slice(own.idx_v, own.idx_v + own.nv)
        if joint.kind == "free":
            placed = model.jointPlacements[number]
            assert state.pose is not None
            assert state.push is not None
            pose = apply_placement(inverse(Placement(placed.translation, placed.rotation)), state.pose)
            q[at] = np.concatenate([pose.position, Rotation.from_matrix(pose.rotation).as_quat()])
            a[vat] = state.push
            continue
        if joint.kind == "spherical":
            q[at] = Rotation.from_matrix(state.q[joint.name]).as_quat()
        elif own.nq == 2:
            q[at] = np.cos(state.q[joint.name]), np.sin(state.q[joint.name])
        else:
            q[at] = state.q[joint.name]
        v[vat], a[vat] = state.qd[joint.name], state.qdd[joint.name]
    return q, v, a


def _by_mujoco(written: WrittenMachine, state: State) -> dict[str, Array]:
    model = mujoco.MjModel.from_xml_path(str(written.path))
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    model.dof_damping[:] = 0.0
    model.dof_armature[:] = 0.0
    model.jnt_stiffness[:] = 0.0
    data = mujoco.MjData(model)
    places: dict[str, slice] = {}
    for joint in written.rewritten.mechanism.joints:
        names = [f"{joint.name}.1", f"{joint.name}.2"] if joint.kind == "universal" else [joint.name]
        for k, name in enumerate(names if joint.nv else []):
            own = model.joint(name)
            at, vat = int(own.qposadr[0]), int(own.dofadr[0])
            if joint.kind == "free":
                assert state.pose is not None
                assert state.push is not None
                quat = Rotation.from_matrix(state.pose.rotation).as_quat()[[3, 0, 1, 2]]
                data.qpos[at : at + 7] = np.concatenate([state.pose.position, quat])
                data.qacc[vat : vat + 6] = np.concatenate([state.pose.rotation @ state.push[:3], state.push[3:]])
                continue
            value, rate, push = state.q[joint.name], state.qd[joint.name], state.qdd[joint.name]
            if joint.kind == "spherical":
                data.qpos[at : at + 4] = Rotation.from_matrix(value).as_quat()[[3, 0, 1, 2]]
                data.qvel[vat : vat + 3], data.qacc[vat : vat + 3] = rate, push
                places[name] = slice(vat, vat + 3)
                continue
            if joint.kind == "universal":
                value, rate, push = value[k], rate[k], push[k]
            data.qpos[at], data.qvel[vat], data.qacc[vat] = value, rate, push
            places[name] = slice(vat, vat + 1)
    mujoco.mj_inverse(model, data)
    result = {name: np.array(data.qfrc_inverse[at]) for name, at in places.items()}
    for joint in written.rewritten.mechanism.joints:
        if joint.kind == "universal":
            result[joint.name] = np.concatenate([result.pop(f"{joint.name}.{k}") for k in (1, 2)])
    return result


def _back(first: Mechanism, rewritten: RewrittenMechanism, name: str, effort: Array) -> Array:
    joint = first.joint_of[name]
    if joint.kind == "spherical":
        return np.asarray(rewritten.links[joint.child].frame.rotation @ effort)
    return np.asarray(rewritten.joints[name].sign * effort)
