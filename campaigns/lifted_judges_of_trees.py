"""Judges of lifted mechanisms whose readers know trees alone: Pinocchio of URDF, Drake of SDF.

pinocchio     rnea of the model that Pinocchio's parser makes, and its damping; rotors of Drake's tags are added
drake         CalcInverseDynamics of the plant that Drake's parser makes, with its springs and dampers
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from campaigns.lifted_judges import Judgement, NoJudge, States, find_pose, find_quaternion
from flexinv.files.from_urdf import read_xml
from flexinv.model.mechanism import Array, Joint, Mechanism

# Pinocchio


def judge_by_pinocchio(path: Path, mechanism: Mechanism, states: States) -> Judgement:
    """Return Pinocchio's own efforts of a URDF [N m], [N]; rotors, which its parser does not read, are those of the file's tags.

    Raises NoJudge.
    """
    import pinocchio as pin

    try:
        model = pin.buildModelFromUrdf(str(path))
    except (ValueError, RuntimeError, IndexError, TypeError) as error:
        raise NoJudge(f"Pinocchio refuses it: {' '.join(str(error).split())[:160]}") from None
    moving = [joint for joint in mechanism.joints if joint.nv]
    seats = {
        joint.name: model.joints[model.getJointId(joint.name)] for joint in moving if model.existJointName(joint.name)
    }
    wrong = [j.name for j in moving if j.name not in seats or seats[j.name].nv != j.nv]
    if wrong or model.njoints != len(moving) + 1:
        raise NoJudge(f"Pinocchio has other joints than the mechanism: {', '.join(wrong[:5])}")
    model.gravity = pin.Motion(np.array(mechanism.gravity), np.zeros(3))
    data = model.createData()
    rotors = _rotors(path)
    result = np.empty_like(states.qd)
    for k in range(len(states.qd)):
        q, v, a = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
        for joint in moving:
            seat = seats[joint.name]
            q[seat.idx_q : seat.idx_q + seat.nq] = states.q[k, mechanism.q_slices[joint.name]]
            v[seat.idx_v : seat.idx_v + seat.nv] = states.qd[k, mechanism.v_slices[joint.name]]
            a[seat.idx_v : seat.idx_v + seat.nv] = states.qdd[k, mechanism.v_slices[joint.name]]
        efforts = pin.rnea(model, data, q, v, a) + model.damping * v
        for joint in moving:
            seat = seats[joint.name]
            own = efforts[seat.idx_v : seat.idx_v + seat.nv]
            rotor = rotors.get(joint.name, 0.0) * states.qdd[k, mechanism.v_slices[joint.name]]
            result[k, mechanism.v_slices[joint.name]] = own + rotor
    friction = {name: float(model.upperDryFrictionLimit[seat.idx_v]) for name, seat in seats.items()}
    return Judgement(result, friction)


def _rotors(path: Path) -> dict[str, float]:
    """Inertias of rotors, reflected by their gears, as Drake's tags state them, by joint [kg m^2]."""
    result: dict[str, float] = {}
    for transmission in read_xml(path).iter("transmission"):
        joint = transmission.find("joint")
        for actuator in transmission.iter("actuator"):
            numbers = {"rotor_inertia": 0.0, "gear_ratio": 1.0}
            for part in actuator:
                key = part.tag.rpartition("}")[2].rpartition(":")[2]
                if key in numbers:
                    numbers[key] = float(part.get("value", "nan"))
            if joint is not None and numbers["rotor_inertia"]:
                name = joint.get("name", "")
                result[name] = result.get(name, 0.0) + numbers["rotor_inertia"] * numbers["gear_ratio"] ** 2
    return result


# Drake


def judge_by_drake(path: Path, mechanism: Mechanism, states: States) -> Judgement:
    """Return Drake's own efforts of a file [N m], [N]: inverse dynamics less the forces of its elements.  Raises NoJudge."""
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import JointIndex, MultibodyForces

    plant: Any = MultibodyPlant(0.0)
    parser: Any = Parser(plant)
    try:
        parser.AddModels(str(path.resolve()))
        plant.mutable_gravity_field().set_gravity_vector(np.array(mechanism.gravity))
        plant.Finalize()
    except (RuntimeError, ValueError) as error:
        raise NoJudge(f"Drake refuses it: {' '.join(str(error).split())[:160]}") from None
    joints = [plant.get_joint(JointIndex(k)) for k in range(plant.num_joints())]
    names = [joint.name() for joint in joints]
    seats = {}
    for joint in mechanism.joints:
        if joint.nv:
            own = [one for one, name in zip(joints, names, strict=True) if name == joint.name]
            if len(own) != 1 or own[0].num_velocities() != joint.nv:
                raise NoJudge(f"Drake has no joint, or several, like {joint.name}")
            seats[joint.name] = own[0]
    if plant.num_velocities() != mechanism.nv:
        raise NoJudge(f"Drake has {plant.num_velocities()} rates, the mechanism {mechanism.nv}")
    context = plant.CreateDefaultContext()
    result = np.empty_like(states.qd)
    for k in range(len(states.qd)):
        push = np.zeros(plant.num_velocities())
        turns: dict[str, Array] = {}
        for name, seat in seats.items():
            joint = mechanism.joint_of[name]
            turns[name] = _place_in_drake(plant, context, seat, joint, mechanism, states, k, push)
        forces = MultibodyForces(plant)
        plant.CalcForceElementsContribution(context, forces)
        efforts = plant.CalcInverseDynamics(context, push, forces)
        for name, seat in seats.items():
            first = seat.velocity_start()
            theirs = np.array(efforts[first : first + seat.num_velocities()])
            result[k, mechanism.v_slices[name]] = turns[name].T @ theirs
    return Judgement(result, {})


def _place_in_drake(
    plant: Any, context: Any, seat: Any, joint: Joint, mechanism: Mechanism, states: States, k: int, push: Array
) -> Array:
    """Write one joint's state into Drake's context; the matrix (nv, nv) from the mechanism's rates to Drake's."""
    from pydrake.common import eigen_geometry
    from pydrake.math import RigidTransform

    place = states.q[k, mechanism.q_slices[joint.name]]
    rate = states.qd[k, mechanism.v_slices[joint.name]]
    acceleration = states.qdd[k, mechanism.v_slices[joint.name]]
    first = seat.velocity_start()
    if joint.kind == "free":
        position, turn = find_pose(joint, place)
        body = seat.child_body()
        quaternion: Any = find_quaternion(turn)
        pose = RigidTransform(eigen_geometry.Quaternion(quaternion), position)  # type: ignore[arg-type]
        plant.SetFreeBodyPose(context, body, pose)
        to_drake = np.zeros((6, 6))  # Drake has the turn first, both in the world
        to_drake[:3, 3:] = turn
        to_drake[3:, :3] = turn
        spin = np.concatenate([acceleration[:3] + np.cross(rate[3:], rate[:3]), acceleration[3:]])
        velocities = plant.GetVelocities(context)
        velocities[first : first + 6] = to_drake @ rate
        plant.SetVelocities(context, velocities)
        push[first : first + 6] = to_drake @ spin
        return to_drake
    if joint.nv != 1:
        raise NoJudge(f"joint {joint.name}: a {joint.kind} joint of Drake has other coordinates")
    if joint.kind == "continuous":
        place = np.array([np.arctan2(place[1], place[0])])
    positions, velocities = plant.GetPositions(context), plant.GetVelocities(context)
    positions[seat.position_start()] = place[0]
    velocities[first] = rate[0]
    plant.SetPositions(context, positions)
    plant.SetVelocities(context, velocities)
    push[first] = acceleration[0]
    return np.eye(1)
