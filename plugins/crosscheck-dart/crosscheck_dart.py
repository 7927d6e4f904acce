"""DART as an engine of crosscheck: rigid trees, built from primary data by its own interface.

    coordinates   one number per revolute or prismatic joint, by name; a continuous joint (cos, sin) is its angle
    tau           computeInverseDynamics(False, False, False) = M(q) a + C(q, v) v + g(q), without rotors, damping and springs:
                  DART either does not know or takes at the end of a time step; they are added here
    frames        T_ParentBodyToJoint is the joint's placement; the child's frame is the joint's, moved
    fixed joints  weld joints; a link without mass has 1e-300 kg (DART's default is 1 kg)

Source: dartpy 6.20.0; the tests compare with flexinv and with faults planted in this very module.
"""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import dartpy as dart
import numpy as np
from numpy.typing import NDArray

from crosscheck.engines.base import beside, sample_times
from crosscheck.engines.shared.prescribed import (
    compute_spring_effort,
    convert_to_scalars,
    describe_nontree_parts,
    missing_motion,
    passive_effort,
    rotor_effort,
)
from crosscheck.engines.shared.probe_states import configurations
from crosscheck.measures.certificate import Certificate
from crosscheck.measures.record import Record, torque_series, vector_series
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import WORLD, Body, Joint, Mechanism, Placement

Array = NDArray[np.float64]
NOTHING = 1e-300  # [kg], [kg m^2]: of a link without mass; DART refuses 0
KINDS = {
    "revolute": "createRevoluteJointAndBodyNodePair",
    "continuous": "createRevoluteJointAndBodyNodePair",
    "prismatic": "createPrismaticJointAndBodyNodePair",
    "fixed": "createWeldJointAndBodyNodePair",
}

READS = ("urdf", "sdf")  # formats of files that `lift` takes
lift, lifts = beside("crosscheck_dart_lift", "lift"), beside("crosscheck_dart_lift", "lifts")
dynamics = beside("crosscheck_dart_dynamics", "dynamics")


@dataclass(frozen=True)
class BuiltSkeleton:
    """A skeleton and its bodies by link; order: the index of every velocity of the mechanism among DART's."""

    skeleton: Any
    bodies: dict[str, Any]
    order: list[int]


def version() -> str:
    """Return the version of DART."""
    return str(dart.__version__)


def abilities() -> str:
    """Return one sentence: what DART can do here."""
    return (
        "Rigid trees of revolute, continuous and prismatic joints by recursive Newton-Euler, tips; no loops, no beams."
    )


def unsupported(mechanism: Mechanism, case: Case, engine: str) -> str | None:
    """Return the reason why DART cannot do this case here, or None."""
    if not mechanism.is_rigid:
        return f"DART has rigid bodies only; flexible here: {', '.join(link.name for link in mechanism.beams)}"
    others = sorted({joint.kind for joint in mechanism.joints} - set(KINDS))
    if others:
        return f"this adapter has no {', '.join(others)} joints"
    return describe_nontree_parts(mechanism, sprung=True) or missing_motion(mechanism, case)


def run(mechanism: Mechanism, case: Case, engine: str, options: Mapping[str, Any]) -> Record:
    """Return torque [N m], [N] and tip [m] on the sample times of the case."""
    time = sample_times(case)
    start = clock.perf_counter()
    built = build(mechanism)
    q, v, a = case.motion.evaluate(mechanism, time)
    angles = convert_to_scalars(mechanism, q)
    bodies, tips = (
        np.empty((time.size, mechanism.nv)),
        {link.name: np.empty((time.size, 3)) for link in mechanism.links},
    )
    for k in range(time.size):
        bodies[k] = inverse_dynamics(built, angles[k], v[k], a[k])
        for link in mechanism.links:
            tips[link.name][k] = (built.bodies[link.name].getWorldTransform().matrix() @ [*link.tip, 1.0])[:3]
    wall = clock.perf_counter() - start
    drives = passive_effort(mechanism, v) + rotor_effort(mechanism, a) + compute_spring_effort(mechanism, q)
    series = torque_series(mechanism, bodies + drives)
    for name, place in tips.items():
        series |= vector_series(f"tip/{name}", "m", place)
    return Record(engine, version=version(), time=time, series=series, wall_time=wall)


def certify(mechanism: Mechanism, case: Case, engine: str) -> Certificate:
    """Return mass [kg], centre of mass [m], mass matrix [kg m^2], [kg], gravity torque [N m], [N] and axes of DART's model."""
    built, rotors = build(mechanism), np.diag([j.rotor_inertia for j in mechanism.joints if j.nv])
    moving = moved(mechanism)
    weights = {name: float(built.bodies[name].getMass()) for name in moving}
    com, matrices, gravity = [], [], []
    axes: dict[str, list[Array]] = {j.name: [] for j in mechanism.joints if j.nv}
    for angles in convert_to_scalars(mechanism, configurations(mechanism, case)):
        place(built, angles, 0.0 * angles)
        total = sum(weights.values()) or 1.0
        com.append(sum(weights[n] * np.ravel(built.bodies[n].getCOM()) for n in moving) / total)
        matrices.append(np.asarray(built.skeleton.getMassMatrix())[np.ix_(built.order, built.order)] + rotors)
        gravity.append(np.asarray(built.skeleton.getGravityForces())[built.order])
        for joint in mechanism.joints:
            if joint.nv:
                axes[joint.name].append(built.bodies[joint.child].getWorldTransform().rotation() @ joint.axis)
    return Certificate(
        mass=sum(weights.values()),
        com=np.array(com),
        mass_matrix=np.array(matrices),
        gravity=np.array(gravity),
        axes={name: np.array(rows) for name, rows in axes.items()},
        order=tuple(built.skeleton.getDof(k).getName() for k in range(built.skeleton.getNumDofs())),
    )


def build(mechanism: Mechanism) -> BuiltSkeleton:
    """Return DART's model of a rigid tree [m, kg, kg m^2]."""
    skeleton = dart.dynamics.Skeleton(mechanism.name)
    skeleton.setGravity(np.asarray(mechanism.gravity))
    bodies: dict[str, Any] = {}
    for joint in mechanism.joints:
        bodies[joint.child] = hung(skeleton, bodies.get(joint.parent), joint)
        weigh(bodies[joint.child], mechanism.link_of[joint.child].bodies)
    names = [skeleton.getDof(k).getName() for k in range(skeleton.getNumDofs())]
    return BuiltSkeleton(skeleton, bodies, [names.index(joint.name) for joint in mechanism.joints if joint.nv])


def hung(skeleton: Any, parent: Any, joint: Joint) -> Any:
    """Return the new body of a joint, hung on its parent (None: the world)."""
    made, body = getattr(skeleton, KINDS[joint.kind])(parent)
    made.setName(joint.name)
    made.setTransformFromParentBodyNode(isometry(joint.placement))
    if joint.nv:
        made.setAxis(np.asarray(joint.axis))
    body.setName(joint.child)
    return body


def weigh(body: Any, parts: tuple[Body, ...]) -> None:
    """Give a body the mass [kg], centre [m] and tensor about it [kg m^2] of all that its link carries."""
    mass = sum(part.inertia.mass for part in parts)
    com = sum((part.inertia.mass * part.inertia.com for part in parts), np.zeros(3)) / (mass or 1.0)
    tensor = np.zeros((3, 3))
    for part in parts:
        d = part.inertia.com - com
        tensor += part.inertia.tensor + part.inertia.mass * (d @ d * np.eye(3) - np.outer(d, d))
    body.setInertia(dart.dynamics.Inertia(mass or NOTHING, com, tensor if mass else NOTHING * np.eye(3)))


def isometry(placement: Placement) -> Any:
    """Return DART's form of a frame [m]."""
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = placement.rotation, placement.position
    return dart.math.Isometry3(made)


def place(built_skeleton: BuiltSkeleton, q: Array, v: Array) -> None:
    """Put the skeleton where its coordinates are q [rad], [m] and their rates v, in the mechanism's order."""
    size = built_skeleton.skeleton.getNumDofs()
    for put, values in ((built_skeleton.skeleton.setPositions, q), (built_skeleton.skeleton.setVelocities, v)):
        ordered = np.empty(size)
        ordered[built_skeleton.order] = values
        put(ordered)


def inverse_dynamics(built_skeleton: BuiltSkeleton, q: Array, v: Array, a: Array) -> Array:
    """Return M a + bias of one state (nv,) [N m], [N]."""
    place(built_skeleton, q, v)
    ordered = np.empty(len(built_skeleton.order))
    ordered[built_skeleton.order] = a
    built_skeleton.skeleton.setAccelerations(ordered)
    built_skeleton.skeleton.computeInverseDynamics(False, False, False)
    return np.asarray(built_skeleton.skeleton.getForces())[built_skeleton.order]


def moved(mechanism: Mechanism) -> list[str]:
    """Return the links that are not welded to the world."""
    still = {WORLD}
    for joint in mechanism.joints:
        if not joint.nv and joint.parent in still:
            still.add(joint.child)
    return [link.name for link in mechanism.links if link.name not in still]
