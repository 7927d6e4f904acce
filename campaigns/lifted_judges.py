"""Judges of lifted mechanisms: a reader's own inverse dynamics, by code that shares nothing with the project's own proof.

    mujoco        mj_inverse of the model that MuJoCo compiles; contacts, limits, equality constraints and dry friction are off
    newton        mj_inverse of the model that Newton's importer of USD writes for MuJoCo, in single precision

Pinocchio and Drake judge in `lifted_judges_of_trees`.  A judge gives the efforts of every joint of a mechanism at random states,
dry friction apart, and which parts of the model a mechanism has no word for: each part is taken out of the model, and what
changes by that is its share.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from flexinv.model.mechanism import Array, Joint, Mechanism

SAMPLES, SEED = 6, 7
SLIDE = 0.5  # [m], the largest displacement of a random state
# Springs, dampers and the rest, by the names that a description gives them, and the arrays of MuJoCo's model that are they.
PARTS: Mapping[str, tuple[str, ...]] = {
    "gravcomp": ("body_gravcomp",),
    "fluid": ("opt.density", "opt.viscosity"),
    "spring-law": ("jnt_stiffnesspoly",),
    "damper-law": ("dof_dampingpoly", "actuator_dampingpoly"),
    "tendon-spring": ("tendon_stiffness", "tendon_stiffnesspoly"),
    "tendon-damper": ("tendon_damping", "tendon_dampingpoly"),
    "tendon-armature": ("tendon_armature",),
    "flex": ("flex_stiffness", "flex_bending", "flex_damping", "flex_edgestiffness", "flex_edgedamping"),
}


class NoJudge(Exception):
    """A reader cannot judge a file; the words say why."""


@dataclass(frozen=True)
class States:
    """Random states (samples, nq), (samples, nv) of a mechanism in its own coordinates [rad], [m], [1/s]."""

    q: Array
    qd: Array
    qdd: Array


@dataclass(frozen=True)
class Judgement:
    """Efforts (samples, nv) [N m], [N] of a reader's own model.

    efforts : all but dry friction; friction : by joint, the dry friction that it states [N m], [N]
    parts : efforts that are left when some named parts are taken out, by their names; single : of single precision
    """

    efforts: Array
    friction: Mapping[str, float]
    parts: tuple[str, ...] = ()
    without: Array | None = None
    single: bool = False


def draw_states(mechanism: Mechanism, seed: int = SEED, count: int = SAMPLES) -> States:
    """Return random states of a mechanism [rad], [m]: turns all round, slides up to ``SLIDE``, rates and accelerations."""
    rng = np.random.default_rng(seed)
    q = np.zeros((count, mechanism.nq))
    for joint in mechanism.joints:
        if not joint.nv:
            continue
        own = mechanism.q_slices[joint.name]
        q[:, own] = _draw_place(joint, rng, count)
    rates = rng.standard_normal((2, count, mechanism.nv))
    return States(q, rates[0], rates[1])


def _draw_place(joint: Joint, rng: np.random.Generator, count: int) -> Array:
    if joint.kind == "continuous":
        angle = rng.uniform(-np.pi, np.pi, count)
        return np.stack([np.cos(angle), np.sin(angle)], axis=1)
    if joint.kind in ("spherical", "free"):
        turn = rng.standard_normal((count, 4))
        turn /= np.linalg.norm(turn, axis=1, keepdims=True)
        return turn if joint.kind == "spherical" else np.hstack([rng.uniform(-1, 1, (count, 3)), turn])
    reach = SLIDE if joint.kind == "prismatic" else np.pi
    return rng.uniform(-reach, reach, (count, joint.nq))


# MuJoCo


def judge_by_mujoco(path: Path, mechanism: Mechanism, states: States) -> Judgement:
    """Return MuJoCo's own efforts of a file [N m], [N].  Raises NoJudge."""
    model = _compile(path)
    return judge_compiled(model, mechanism, states, _seats(model, mechanism))


def judge_compiled(
    model: Any, mechanism: Mechanism, states: States, seats: Mapping[str, int], single: bool = False
) -> Judgement:
    """Return the efforts of a compiled model of MuJoCo [N m], [N]; seats : by joint its number in the model.  Raises NoJudge."""
    import mujoco

    switches = model.opt.disableflags
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    model.opt.enableflags = 0
    whole = _inverse(model, mechanism, seats, states)
    parts = []
    for name, take_out in _removals(model):
        before = _inverse(model, mechanism, seats, states)
        take_out()
        after = _inverse(model, mechanism, seats, states)
        if _differ(before, after):
            parts.append(name)
    without = _inverse(model, mechanism, seats, states) if parts else None
    off = int(mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    friction = {
        name: 0.0 if switches & off else float(model.dof_frictionloss[model.jnt_dofadr[index]])
        for name, index in seats.items()
    }
    return Judgement(whole, friction, tuple(parts), without, single)


def _compile(path: Path) -> Any:
    """The model of a file; a URDF whose shapes are not found is read without shapes, if all of its masses are stated."""
    import mujoco

    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, OSError) as error:
        words = " ".join(str(error).split())
    spec = mujoco.MjSpec.from_file(str(path))
    for body in spec.bodies:
        shapes = [g for g in body.geoms if g.type in (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_HFIELD)]
        if shapes and not body.explicitinertial and body.name != "world":
            raise NoJudge(f"MuJoCo refuses it: {words}")
        for geom in shapes:
            spec.delete(geom)
    for part in [*spec.meshes, *spec.hfields, *spec.skins, *spec.textures, *spec.materials]:
        spec.delete(part)
    for geom in [*spec.geoms, *spec.sites]:
        geom.material = ""
    try:
        return spec.compile()
    except (ValueError, OSError):
        raise NoJudge(f"MuJoCo refuses it: {words}") from None


def _seats(model: Any, mechanism: Mechanism) -> dict[str, int]:
    """By joint of the mechanism its number in the model: both come depth-first, whatever they are called."""
    moving = [joint for joint in mechanism.joints if joint.nv]
    named = {model.joint(k).name: k for k in range(model.njnt) if model.joint(k).name}
    if len(moving) != model.njnt:
        raise NoJudge(f"the model has {model.njnt} joints, the mechanism {len(moving)}")
    seats = {joint.name: named.get(joint.name, k) for k, joint in enumerate(moving)}
    _check_kinds(model, mechanism, seats)
    return seats


def _check_kinds(model: Any, mechanism: Mechanism, seats: Mapping[str, int]) -> None:
    """Raise NoJudge where a joint sits on one of another kind, or two on one."""
    import mujoco

    words = {"revolute": "HINGE", "continuous": "HINGE", "prismatic": "SLIDE", "spherical": "BALL", "free": "FREE"}
    moving = [joint for joint in mechanism.joints if joint.nv]
    kinds = [mujoco.mjtJoint(int(kind)).name.removeprefix("mjJNT_") for kind in model.jnt_type]
    wrong = [joint.name for joint in moving if words.get(joint.kind) != kinds[seats[joint.name]]]
    if wrong or len(set(seats.values())) < len(moving):
        raise NoJudge(f"the model has other joints than the mechanism: {', '.join(wrong[:5])}")


def _inverse(model: Any, mechanism: Mechanism, seats: Mapping[str, int], states: States) -> Array:
    """Efforts (samples, nv) of mj_inverse in the mechanism's coordinates."""
    import mujoco

    data = mujoco.MjData(model)
    result = np.empty_like(states.qd)
    for k in range(len(states.qd)):
        for joint in mechanism.joints:
            if joint.nv:
                _place(data, model, seats[joint.name], joint, mechanism, states, k)
        mujoco.mj_inverse(model, data)
        for joint in mechanism.joints:
            if not joint.nv:
                continue
            first = int(model.jnt_dofadr[seats[joint.name]])
            own = np.array(data.qfrc_inverse[first : first + joint.nv])
            if joint.kind == "free":
                own[:3] = find_pose(joint, states.q[k, mechanism.q_slices[joint.name]])[1].T @ own[:3]
            result[k, mechanism.v_slices[joint.name]] = own
    return result


def _place(data: Any, model: Any, index: int, joint: Joint, mechanism: Mechanism, states: States, k: int) -> None:
    """Write one joint's state of one sample into MuJoCo's; a free joint's velocity is the child's there, the world's here."""
    place = states.q[k, mechanism.q_slices[joint.name]]
    rate = states.qd[k, mechanism.v_slices[joint.name]].copy()
    push = states.qdd[k, mechanism.v_slices[joint.name]].copy()
    if joint.kind == "continuous":
        place = np.array([np.arctan2(place[1], place[0])])
    elif joint.kind == "spherical":
        place = place[[3, 0, 1, 2]]
    elif joint.kind == "free":
        position, turn = find_pose(joint, place)
        push[:3] = turn @ (push[:3] + np.cross(rate[3:], rate[:3]))
        rate[:3] = turn @ rate[:3]
        place = np.concatenate([position, find_quaternion(turn)])
    start, first = int(model.jnt_qposadr[index]), int(model.jnt_dofadr[index])
    data.qpos[start : start + len(place)] = place
    data.qvel[first : first + joint.nv] = rate
    data.qacc[first : first + joint.nv] = push


def find_pose(joint: Joint, place: Array) -> tuple[Array, Array]:
    """Return position (3,) [m] and rotation (3, 3) [-] in the world of what a free joint carries.

    The joint's coordinates begin at its placement.
    """
    seat = joint.placement
    return seat.position + seat.rotation @ place[:3], seat.rotation @ _turn(place[3:])


def find_quaternion(turn: Array) -> Array:
    """Return the quaternion w, x, y, z [-] of a rotation."""
    quaternion: Array = Rotation.from_matrix(turn).as_quat()[[3, 0, 1, 2]]
    return quaternion


def _turn(quaternion: Array) -> Array:
    """The rotation (3, 3) [-] of a quaternion x, y, z, w."""
    vector, w = quaternion[:3], quaternion[3]
    skew = np.cross(np.eye(3), vector)
    return np.eye(3) + 2.0 * w * skew + 2.0 * skew @ skew


def _removals(model: Any) -> Iterator[tuple[str, Callable[[], None]]]:
    """Yield names of parts, and what takes each of them out of the model."""
    import mujoco

    for name, arrays in PARTS.items():
        yield name, _Zero(model, arrays)
    for name, kind in (("ball-spring", mujoco.mjtJoint.mjJNT_BALL), ("free-spring", mujoco.mjtJoint.mjJNT_FREE)):
        yield name, _Zero(model, ("jnt_stiffness", "jnt_stiffnesspoly"), model.jnt_type == int(kind))
    free = np.flatnonzero(model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE))
    dofs = [int(model.jnt_dofadr[k]) + i for k in free for i in range(6)]
    yield "free-armature", _Zero(model, ("dof_armature",), np.array(dofs, dtype=int))
    by_tendon = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_TENDON)
    yield "tendon-damper", _Zero(model, ("actuator_damping", "actuator_dampingpoly"), by_tendon)
    yield "tendon-armature", _Zero(model, ("actuator_armature",), by_tendon)


@dataclass(frozen=True)
class _Zero:
    """Set arrays of a model to zero, all of them or some rows."""

    model: Any
    arrays: tuple[str, ...]
    rows: Any = field(default_factory=lambda: slice(None))

    def __call__(self) -> None:
        import mujoco

        for name in self.arrays:
            if name.startswith("opt."):
                setattr(self.model.opt, name.removeprefix("opt."), 0.0)
            else:
                getattr(self.model, name)[self.rows] = 0.0
        if (
            "dof_armature" in self.arrays
        ):  # bodies that MuJoCo calls simple keep their diagonal of M, with it, from compilation
            mujoco.mj_setConst(self.model, mujoco.MjData(self.model))


def _differ(one: Array, two: Array) -> bool:
    size = np.maximum(np.abs(one), np.abs(two)).max(initial=0.0)
    return bool(np.abs(one - two).max(initial=0.0) > 1e-15 * size)


# Newton


def judge_by_newton(path: Path, mechanism: Mechanism, states: States) -> Judgement:
    """Return the efforts of what Newton's importer of USD makes for MuJoCo, in single precision [N m], [N].  Raises NoJudge."""
    try:
        import newton
        from newton import usd
        from newton.solvers import SolverMuJoCo
    except ImportError:
        raise NoJudge("USD is judged by Newton, which is not installed") from None
    try:
        builder = newton.ModelBuilder()
        SolverMuJoCo.register_custom_attributes(builder)
        resolvers = [usd.SchemaResolverNewton(), usd.SchemaResolverMjc(), usd.SchemaResolverPhysx()]
        builder.add_usd(str(path), schema_resolvers=resolvers)
        model = SolverMuJoCo(builder.finalize(device="cpu"), use_mujoco_cpu=True).mj_model
    except Exception as error:  # what any package of others raises is its word
        raise NoJudge(f"Newton refuses it: {type(error).__name__} {' '.join(str(error).split())[:160]}") from None
    if model is None:
        raise NoJudge("Newton makes no model of MuJoCo of it")
    if model.nv != mechanism.nv:
        raise NoJudge(f"Newton has {model.nv} rates, the mechanism {mechanism.nv}")
    model.opt.gravity[:] = mechanism.gravity
    seats = {}
    for joint in mechanism.joints:
        if joint.nv:
            ends = f"_{joint.child if joint.kind == 'free' else joint.name}"
            names = [
                model.body(b).name if joint.kind == "free" else model.joint(k).name
                for k, b in enumerate(model.jnt_bodyid)
            ]
            own = [k for k, name in enumerate(names) if f"_{name}".endswith(ends)]
            if len(own) != 1:
                raise NoJudge(f"Newton has {len(own)} joints like {joint.name}")
            seats[joint.name] = own[0]
    _check_kinds(model, mechanism, seats)
    found = judge_compiled(model, mechanism, states, seats, single=True)
    # Newton's tables of friction are of its own defaults: what the stage states is judged by nobody here.
    return Judgement(found.efforts, {}, found.parts, found.without, found.single)
