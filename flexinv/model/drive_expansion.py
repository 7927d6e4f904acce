"""Expansion of drives into mechanisms: rotors and friction in joints, springs where motors are prescribed (`motor_side`)."""

from __future__ import annotations

from dataclasses import replace

from flexinv.errors import InputError
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Joint, Limits, Link, Mechanism, Placement

# Names of what an elastic drive adds to a mechanism: the gear's output and the spring to the link.
GEAR, SPRING = ".gear", ".spring"
# Kinds of joint that a drive may move, and of the spring between motor and link there.
SPRINGS = {name: "revolute" if k.circle else name for name, k in KINDS.items() if len(k.v) == 1}


def expanded(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism that the drives make [kg m^2], [N m/rad]: rotors in joints, springs where the motor is moved.

    rotor N^2 J, damping N^2 v, dry friction N c at the joint; the Stribeck part above c is the motor's alone (`motor_side`)

    Raises InputError for a drive on a joint without just one coordinate, or beside rotor, damping, friction or spring.
    """
    joints: list[Joint] = []
    links = [mechanism.link_of[joint.child] for joint in mechanism.joints]
    gears: list[Link] = []
    for joint in mechanism.joints:
        drive = joint.drive
        if drive is None or (drive.stiffness and drive.moves == "link"):
            joints.append(joint)
            continue
        _check(joint)
        turned = drive.ratio**2
        own = replace(
            joint,
            rotor_inertia=turned * drive.rotor_inertia,
            damping=turned * drive.viscous,
            friction=drive.ratio * drive.coulomb,
        )
        if not drive.stiffness:
            joints.append(own)
            continue
        gear = Link(joint.name + GEAR)
        spring = replace(
            joint, name=joint.name + SPRING, kind=SPRINGS[joint.kind], parent=gear.name, station=None, placement=Placement(),
            stiffness=drive.stiffness, rest=0.0, damping=drive.damping, actuated=False, weight=1.0, limits=Limits(), drive=None,
        )  # fmt: skip
        gears.append(gear)
        joints += [replace(own, child=gear.name), spring]
    by_name = {link.name: link for link in (*links, *gears)}
    return replace(mechanism, joints=tuple(joints), links=tuple(by_name[joint.child] for joint in joints))


def check_expanded(joint: Joint) -> None:
    """Raise InputError where a joint has a drive that its mechanism does not have: rotor, friction, spring [kg m^2], [N m]."""
    drive = joint.drive
    if drive is None or (drive.stiffness and drive.moves == "link"):
        return
    elastic = drive.stiffness and not joint.child.endswith(GEAR)
    own = drive.rotor_inertia or drive.viscous or drive.coulomb
    if elastic or (own and not (joint.rotor_inertia or joint.damping or joint.friction)):
        raise InputError(
            f"joint {joint.name!r}: its drive is not part of the mechanism yet; "
            "write flexinv.model.drive_expansion.expanded(mechanism), "
            "which puts rotors into joints and springs between motors and links"
        )


def _check(joint: Joint) -> None:
    if joint.kind not in SPRINGS:
        raise InputError(
            f"joint {joint.name!r}: a drive moves one coordinate ({', '.join(SPRINGS)}), the joint is {joint.kind}"
        )
    if joint.rotor_inertia or joint.damping or joint.friction or joint.stiffness:
        raise InputError(
            f"joint {joint.name!r}: rotor, damping, friction or spring beside a drive; state them in the drive"
        )
