"""Drake as an engine of crosscheck: rigid trees as a MultibodyPlant, built from primary data.

    coordinates   one number per revolute or prismatic joint, by name; a continuous joint (cos, sin) is its angle
    tau           CalcInverseDynamics = M(q) a + C(q, v) v - forces handed in, here those of gravity; rotors, damping,
                  dry friction and springs are added outside
    frames        a joint ties a frame fixed on the parent (the joint's placement) to the frame of the child's body
    inertia       SpatialInertia about the body's origin: made from mass, centre and tensor about the centre; of a link without
                  mass zero

Source: drake 1.51.1; the tests compare with flexinv.
"""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody import plant as multibody
from pydrake.multibody import tree

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
from flexinv.model.mechanism import WORLD, Body, Joint, Mechanism

Array = NDArray[np.float64]
KINDS = ("revolute", "continuous", "prismatic", "fixed")

READS = ("urdf", "sdf", "mjcf")  # formats of files that `lift` takes
lift, lifts = beside("crosscheck_drake_lift", "lift"), beside("crosscheck_drake_lift", "lifts")
dynamics = beside("crosscheck_drake_dynamics", "dynamics")


@dataclass(frozen=True)
class BuiltPlant:
    """A plant with its context, its bodies by link, and the index of every velocity of the mechanism among Drake's."""

    plant: Any
    context: Any
    bodies: dict[str, Any]
    order: list[int]


def version() -> str:
    """Return the version of Drake."""
    return metadata.version("drake")


def abilities() -> str:
    """Return one sentence: what Drake can do here."""
    return (
        "Rigid trees of revolute, continuous and prismatic joints by recursive Newton-Euler, tips; no loops, no beams."
    )


def unsupported(mechanism: Mechanism, case: Case, engine: str) -> str | None:
    """Return the reason why Drake cannot do this case here, or None."""
    if not mechanism.is_rigid:
        return f"Drake has rigid bodies only here; flexible: {', '.join(link.name for link in mechanism.beams)}"
    if others := sorted({joint.kind for joint in mechanism.joints} - set(KINDS)):
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
            pose = built.plant.EvalBodyPoseInWorld(built.context, built.bodies[link.name])
            tips[link.name][k] = pose.multiply(link.tip)
    wall = clock.perf_counter() - start
    drives = passive_effort(mechanism, v) + rotor_effort(mechanism, a) + compute_spring_effort(mechanism, q)
    series = torque_series(mechanism, bodies + drives)
    for name, place in tips.items():
        series |= vector_series(f"tip/{name}", "m", place)
    return Record(engine, version=version(), time=time, series=series, wall_time=wall)


def certify(mechanism: Mechanism, case: Case, engine: str) -> Certificate:
    """Return mass [kg], mass matrix [kg m^2], [kg], gravity torque [N m], [N] and axes of Drake's model."""
    built = build(mechanism)
    rotors = np.diag([j.rotor_inertia for j in mechanism.joints if j.nv])
    matrices, gravity = [], []
    axes: dict[str, list[Array]] = {j.name: [] for j in mechanism.joints if j.nv}
    for angles in convert_to_scalars(mechanism, configurations(mechanism, case)):
        put(built, angles, 0.0 * angles)
        matrices.append(built.plant.CalcMassMatrix(built.context)[np.ix_(built.order, built.order)] + rotors)
        gravity.append(-built.plant.CalcGravityGeneralizedForces(built.context)[built.order])
        for joint in mechanism.joints:
            if joint.nv:
                pose = built.plant.EvalBodyPoseInWorld(built.context, built.bodies[joint.child])
                axes[joint.name].append(pose.rotation().matrix() @ joint.axis)
    still = [name for name in built.bodies if name not in moved(mechanism)]
    mass = sum(body.default_mass() for name, body in built.bodies.items() if name not in still)
    return Certificate(
        mass=float(mass),
        mass_matrix=np.array(matrices),
        gravity=np.array(gravity),
        axes={name: np.array(rows) for name, rows in axes.items()},
        order=tuple(n for _, n in sorted((k, j.name) for k, j in zip(built.order, _moving(mechanism), strict=True))),
    )


def build(mechanism: Mechanism) -> BuiltPlant:
    """Return Drake's model of a rigid tree [m, kg, kg m^2]."""
    plant = multibody.MultibodyPlant(0.0)
    plant.mutable_gravity_field().set_gravity_vector(np.asarray(mechanism.gravity))
    bodies: dict[str, Any] = {}
    made = []
    for joint in mechanism.joints:
        link = mechanism.link_of[joint.child]
        bodies[joint.child] = plant.AddRigidBody(f"link {joint.child}", inertia(link.bodies))
        parent = plant.world_body() if joint.parent == WORLD else bodies[joint.parent]
        made.append(hung(plant, parent, bodies[joint.child], joint))
    plant.Finalize()
    order = [one.velocity_start() for one, joint in zip(made, mechanism.joints, strict=True) if joint.nv]
    return BuiltPlant(plant, plant.CreateDefaultContext(), bodies, order)


def hung(plant: Any, parent: Any, child: Any, joint: Joint) -> Any:
    """Return the joint that hangs a body on its parent."""
    at = RigidTransform(RotationMatrix(np.asarray(joint.placement.rotation)), np.asarray(joint.placement.position))
    frame = plant.AddFrame(tree.FixedOffsetFrame(f"frame {joint.name}", parent.body_frame(), at))
    name, ends = f"joint {joint.name}", (frame, child.body_frame())
    if not joint.nv:
        return plant.AddJoint(tree.WeldJoint(name, *ends, RigidTransform()))
    make = tree.PrismaticJoint if joint.kind == "prismatic" else tree.RevoluteJoint
    return plant.AddJoint(make(name, *ends, np.asarray(joint.axis)))


def inertia(parts: tuple[Body, ...]) -> Any:
    """Return the spatial inertia of all bodies of a link about its origin: masses [kg], centres [m], tensors [kg m^2]."""
    total = tree.SpatialInertia(0.0, np.zeros(3), tree.UnitInertia(0.0, 0.0, 0.0))
    for part in parts:
        m, t = float(part.inertia.mass), np.asarray(part.inertia.tensor)
        about = tree.RotationalInertia(t[0, 0], t[1, 1], t[2, 2], t[0, 1], t[0, 2], t[1, 2])
        total += tree.SpatialInertia.MakeFromCentralInertia(m, np.asarray(part.inertia.com), about)
    return total


def _moving(mechanism: Mechanism) -> list[Joint]:
    return [joint for joint in mechanism.joints if joint.nv]


def put(built_plant: BuiltPlant, q: Array, v: Array) -> None:
    """Put the plant where its coordinates are q [rad], [m] and their rates v, in the mechanism's order."""
    for send, values in ((built_plant.plant.SetPositions, q), (built_plant.plant.SetVelocities, v)):
        ordered = np.empty(len(built_plant.order))
        ordered[built_plant.order] = values
        send(built_plant.context, ordered)


def inverse_dynamics(built_plant: BuiltPlant, q: Array, v: Array, a: Array) -> Array:
    """Return M a + bias of one state (nv,) [N m], [N]."""
    put(built_plant, q, v)
    ordered = np.empty(len(built_plant.order))
    ordered[built_plant.order] = a
    forces = tree.MultibodyForces(built_plant.plant)
    forces.mutable_generalized_forces()[:] = built_plant.plant.CalcGravityGeneralizedForces(built_plant.context)
    return np.asarray(built_plant.plant.CalcInverseDynamics(built_plant.context, ordered, forces))[built_plant.order]


def moved(mechanism: Mechanism) -> set[str]:
    """Return the links that are not welded to the world."""
    still = {WORLD}
    for joint in mechanism.joints:
        if not joint.nv and joint.parent in still:
            still.add(joint.child)
    return {link.name for link in mechanism.links} - still
