"""Newton as an engine of crosscheck: rigid trees in single precision, built from primary data by its own interface.

    coordinates   one number per revolute or prismatic joint, in the order in which joints are added; (cos, sin) is its angle
    tau           eval_inverse_dynamics_passive gives M, c and g, eval_inverse_dynamics_force M a + c + g; rotors are Newton's
                  own (armature); it stores damping and dry friction and applies neither here: they are added outside
    samples       worlds of one model, computed together
    error bars    of single precision: each sum loses LOST units in the last place of what is added up in it, and the moments
                  that are carried to the world's origin and back lose CARRIED

Source: newton 1.8.0 with warp-lang 1.19.0 on the processor; the tests compare with flexinv, and plant faults in this very module.
"""

from __future__ import annotations

import contextlib
import io
import time as clock
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crosscheck.engines.base import sample_times
from crosscheck.engines.shared.prescribed import (
    compute_spring_effort,
    convert_to_scalars,
    describe_nontree_parts,
    missing_motion,
    passive_effort,
)
from crosscheck.engines.shared.probe_states import configurations
from crosscheck.measures.certificate import Certificate
from crosscheck.measures.record import Record, torque_series, vector_series
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import WORLD, Body, Mechanism, Placement

with contextlib.redirect_stdout(io.StringIO()):  # Warp introduces itself on the standard output
    import newton
    import warp

warp.config.quiet = True
Array = NDArray[np.float64]
ADD = {
    "revolute": "add_joint_revolute",
    "continuous": "add_joint_revolute",
    "prismatic": "add_joint_prismatic",
    "fixed": "add_joint_fixed",
}
AT_ONCE = 500  # samples that are computed together, each a world of its own
UNIT = float(np.finfo(np.float32).eps)
# Units in the last place of all that is added up: on the ladder Newton's efforts are up to 31 units off.
LOST = 64.0
# It adds forces and moments about the world's origin: at the last joint of a long arm these are far larger than the effort.
# Measured at the last joints of Panda and Talos' arm: up to 10 units of weight and inertia times the distance.
CARRIED = 32.0
forkable = False  # Warp starts threads when it is imported


@dataclass(frozen=True)
class BuiltModel:
    """A finished model of so many equal worlds; links : index of each link's body in its world."""

    model: Any
    links: dict[str, int]
    worlds: int


def version() -> str:
    """Return the version of Newton."""
    return str(newton.__version__)


def abilities() -> str:
    """Return one sentence: what Newton can do here."""
    return "Rigid trees of revolute, continuous and prismatic joints, rotors, tips, all in single precision; no loops, no beams."


def unsupported(mechanism: Mechanism, case: Case, engine: str) -> str | None:
    """Return the reason why Newton cannot do this case here, or None."""
    if not mechanism.is_rigid:
        return f"Newton has rigid bodies only here; flexible: {', '.join(link.name for link in mechanism.beams)}"
    others = sorted({joint.kind for joint in mechanism.joints} - set(ADD))
    if others:
        return f"this adapter has no {', '.join(others)} joints"
    return describe_nontree_parts(mechanism, sprung=True) or missing_motion(mechanism, case)


def run(mechanism: Mechanism, case: Case, engine: str, options: Mapping[str, Any]) -> Record:
    """Return torque [N m], [N] and tip [m] on the sample times of the case, with error bars."""
    time = sample_times(case)
    q, v, a = case.motion.evaluate(mechanism, time)
    angles = convert_to_scalars(mechanism, q)
    start = clock.perf_counter()
    bodies, bars = np.empty_like(v), np.empty_like(v)
    places = {link.name: np.empty((time.size, 3)) for link in mechanism.links}
    for first in range(0, time.size, AT_ONCE):
        part = slice(first, min(first + AT_ONCE, time.size))
        built = build(mechanism, part.stop - first)
        bodies[part], bars[part], frames = inverse_dynamics(built, angles[part], v[part], a[part])
        bars[part] += UNIT * CARRIED * carried(mechanism, built, frames, time[part])
        for link in mechanism.links:
            places[link.name][part] = moved(frames[:, built.links[link.name]], np.asarray(link.tip, dtype=float))
    wall = clock.perf_counter() - start
    drives = passive_effort(mechanism, v) + compute_spring_effort(mechanism, q)
    series = torque_series(mechanism, bodies + drives, bars)
    for name, place in places.items():
        reach = UNIT * LOST * np.abs(place).max(initial=0.0)
        series |= vector_series(f"tip/{name}", "m", place, np.full_like(place, reach))
    return Record(engine, version=version(), time=time, series=series, wall_time=wall)


def certify(mechanism: Mechanism, case: Case, engine: str) -> Certificate:
    """Return what is exact in Newton's model: total mass [kg], to the digits of single precision, and joints in their order.

    Mass matrices and gravity torques come in single precision: the certificate asks for nine digits, so they are left out.
    """
    built = build(mechanism, len(configurations(mechanism, case)))
    masses = built.model.body_mass.numpy()[: len(built.links)]
    ours = {link.name: sum(part.inertia.mass for part in link.bodies) for link in mechanism.links}
    carried = [name for name in ours if name not in welded(mechanism)]
    off = max(
        (abs(float(masses[built.links[name]]) - ours[name]) / (ours[name] or 1.0) for name in carried), default=0.0
    )
    given = {
        "masses in single precision": f"largest relative difference {off:.1g}, one unit in the last place is {UNIT:.1g}"
    }
    names = [label.rsplit("/", 1)[-1] for label in built.model.joint_label[: len(mechanism.joints)]]
    moving = {joint.name for joint in mechanism.joints if joint.nv}
    return Certificate(order=tuple(name for name in names if name in moving), given=given)


def build(mechanism: Mechanism, worlds: int) -> BuiltModel:
    """Return Newton's model of a rigid tree [m, kg, kg m^2], so many times."""
    one = newton.ModelBuilder(gravity=tuple(float(g) for g in mechanism.gravity))
    links: dict[str, int] = {}
    joints = []
    for joint in mechanism.joints:
        mass, com, tensor = weight(mechanism.link_of[joint.child].bodies)
        links[joint.child] = one.add_link(mass=mass, com=com, inertia=tensor, label=joint.child, lock_inertia=True)
        more = {"axis": tuple(joint.axis), "armature": joint.rotor_inertia, "friction": 0.0} if joint.nv else {}
        parent = links.get(joint.parent, -1)
        place = transform(joint.placement)
        joints.append(
            getattr(one, ADD[joint.kind])(parent, links[joint.child], parent_xform=place, label=joint.name, **more)
        )
    one.add_articulation(joints, label=mechanism.name)
    all_of_them = newton.ModelBuilder(gravity=tuple(float(g) for g in mechanism.gravity))
    all_of_them.replicate(one, worlds)
    with contextlib.redirect_stdout(io.StringIO()):
        return BuiltModel(all_of_them.finalize(device="cpu", skip_validation_inertia=True), links, worlds)


def weight(parts: tuple[Body, ...]) -> tuple[float, Any, Any]:
    """Return mass [kg], centre of mass [m] and tensor about it [kg m^2] of all that a link carries."""
    mass = sum(part.inertia.mass for part in parts)
    com = sum((part.inertia.mass * part.inertia.com for part in parts), np.zeros(3)) / (mass or 1.0)
    tensor = np.zeros((3, 3))
    for part in parts:
        d = part.inertia.com - com
        tensor += part.inertia.tensor + part.inertia.mass * (d @ d * np.eye(3) - np.outer(d, d))
    return float(mass), warp.vec3(*com), warp.mat33(*tensor.ravel())


def transform(placement: Placement) -> Any:
    """Return Newton's form of a frame [m]: position and quaternion x, y, z, w."""
    matrix = warp.mat33(*np.asarray(placement.rotation, dtype=float).ravel())
    return warp.transform(warp.vec3(*placement.position), warp.quat_from_matrix(matrix))


def inverse_dynamics(built_model: BuiltModel, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
    """Return M a + c + g (samples, nv) [N m], [N], the bars of single precision, and all bodies' frames (samples, bodies, 7)."""
    model, (samples, nv) = built_model.model, v.shape
    state = model.state()
    state.joint_q.assign(q.ravel().astype(np.float32))
    state.joint_qd.assign(v.ravel().astype(np.float32))
    newton.eval_fk(model, state.joint_q, state.joint_qd, state)
    matrix = warp.zeros((samples, model.max_dofs_per_articulation, model.max_dofs_per_articulation), dtype=float)
    gravity, coriolis, force = (warp.zeros(samples * nv, dtype=float) for _ in range(3))
    newton.eval_inverse_dynamics_passive(
        model, state, mass_matrix=matrix, gravity_force=gravity, coriolis_force=coriolis
    )
    wanted = warp.array(a.ravel().astype(np.float32), dtype=float)
    newton.eval_inverse_dynamics_force(
        model,
        state,
        mass_matrix=matrix,
        joint_qdd=wanted,
        coriolis_force=coriolis,
        gravity_force=gravity,
        joint_f=force,
    )
    found, weighed, moving = (one.numpy().astype(float).reshape(samples, nv) for one in (force, gravity, coriolis))
    inertias = np.abs(matrix.numpy().astype(float)[:, :nv, :nv])
    added = np.einsum("sij,sj->si", inertias, np.abs(a)) + np.abs(weighed) + np.abs(moving)
    frames = state.body_q.numpy().astype(float).reshape(samples, -1, 7)
    return found, LOST * UNIT * np.broadcast_to(added.max(axis=0), found.shape), frames


def carried(mechanism: Mechanism, built_model: BuiltModel, frames: Array, time: Array) -> Array:
    """Return the largest moment about the world's origin [N m] of weight and inertia of what each coordinate moves, (nv,).

    For a slide it is their force [N].  frames : (samples, bodies, 7) [m], over time (samples,) [s], which gives accelerations
    """
    place = frames[:, :, :3]
    faster = np.zeros_like(place)
    if time.size > 2:
        faster = np.gradient(np.gradient(place, time, axis=0), time, axis=0)
    pull = np.linalg.norm(mechanism.gravity) + np.linalg.norm(faster, axis=2)
    weighs = {
        link.name: sum(part.inertia.mass for part in link.bodies) * pull[:, built_model.links[link.name]]
        for link in mechanism.links
    }
    for joint in reversed(mechanism.joints):  # parents stand before children
        weighs[joint.parent] = weighs.get(joint.parent, 0.0) + weighs[joint.child]
    out = []
    for joint in mechanism.joints:
        arm = 1.0 if joint.kind == "prismatic" else np.linalg.norm(place[:, built_model.links[joint.child]], axis=1)
        out += [float((weighs[joint.child] * arm).max())] * joint.nv
    return np.array(out)


def moved(frames: Array, point: Array) -> Array:
    """Return a point of a body (3,) [m] in the world, (samples, 3) [m]; frames : position and quaternion x, y, z, w."""
    axis, w = frames[:, 3:6], frames[:, 6:]
    turned = point + 2.0 * np.cross(axis, np.cross(axis, point) + w * point)
    return np.asarray(frames[:, :3] + turned)


def welded(mechanism: Mechanism) -> set[str]:
    """Return the world and the links that are welded to it."""
    still = {WORLD}
    for joint in mechanism.joints:
        if not joint.nv and joint.parent in still:
            still.add(joint.child)
    return still
