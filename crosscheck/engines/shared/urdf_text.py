"""A mechanism as URDF, for engines and viewers that read nothing else; no engine is used here.

bodies        a link with one body carries it; further bodies, payloads of a URDF among them, are links of their own on fixed
              joints, so that no inertia is composed on the way
joints        a universal joint is two revolute ones with a link without mass between; spherical and helical ones have no name
              in URDF.  A free joint that alone hangs on the world is left to the reader (Pinocchio adds its own), any other
              one of the world is a floating joint
drives        damping and dry friction as ``dynamics``; the reflected rotor as ``drake:rotor_inertia`` of a transmission
limits        those that are not stated are written as UNBOUND, since revolute and sliding joints have to have some
couplings     of two joints: ``mimic``
left out      gravity, other closures, springs, forces (`list_unwritten_parts`); the file says so at its head
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
from defusedxml.ElementTree import fromstring

from crosscheck.engines.shared.export_files import NotExported, check_rigid
from crosscheck.engines.shared.urdf_source import read_source
from flexinv.model.mechanism import GEARED, WORLD, Body, Closure, Joint, Limits, Mechanism, Placement

KINDS = {
    "revolute": "revolute", "continuous": "continuous", "prismatic": "prismatic", "fixed": "fixed", "free": "floating",
}  # fmt: skip
UNBOUND = 1e9  # [rad], [m], [N m], [N], [rad/s], [m/s]: what binds no machine
DRAKE = "{http://drake.mit.edu}"
ET.register_namespace("drake", DRAKE[1:-1])


def write_urdf(mechanism: Mechanism) -> str:
    """Return the URDF of a rigid tree; of one that came from a URDF that text, with what was laid over it.

    Raises NotExported where the format has no word for something that moves.
    """
    check_rigid(mechanism, "URDF")
    root = _update_source_urdf(mechanism) if mechanism.urdf else _build_urdf(mechanism)
    for joint in mechanism.joints:
        _add_transmission(root, joint)
    for element in root.findall("joint"):
        for closure in _find_mimic_coupling(mechanism, element.get("name", "")):
            _add_mimic(element, closure)
    for words in reversed(list_unwritten_parts(mechanism)):
        root.insert(0, ET.Comment(f" not said here: {words.replace('--', '- -')} "))
    ET.indent(root)
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def list_unwritten_parts(mechanism: Mechanism) -> list[str]:
    """List the parts of a mechanism that a URDF has no words for, a line each [any unit]."""
    lost = [f"gravity {_format_numbers(mechanism.gravity)} m/s^2"]
    lost += [f"spring of joint {j.name}" for j in mechanism.joints if j.stiffness]
    lost += [
        f"damping, friction or rotor of joint {j.name} (free)"
        for j in mechanism.joints
        if j.kind == "free" and _has_passive_values(j)
    ]
    mimicked = {c.name for j in mechanism.joints for c in _find_mimic_coupling(mechanism, j.name)}
    lost += [f"closure {c.name} ({c.kind})" for c in mechanism.closures if c.name not in mimicked]
    lost += [f"spring {spring.name}" for spring in mechanism.springs]
    return lost + [f"force {force.name}" for force in mechanism.forces]


def has_implicit_root(mechanism: Mechanism) -> bool:
    """Return True if the root's free joint is not in the text: it alone hangs on the world, at its frame."""
    first = mechanism.joints[0]
    if first.kind != "free" or first.parent != WORLD:
        return False
    here = not np.any(first.placement.position) and not np.any(first.placement.rotation != np.eye(3))
    return mechanism.urdf is not None or (here and sum(j.parent == WORLD for j in mechanism.joints) == 1)


def _has_passive_values(joint: Joint) -> bool:
    return bool(joint.damping or joint.friction or joint.rotor_inertia)


def _find_mimic_coupling(mechanism: Mechanism, name: str) -> Iterator[Closure]:
    """Yield the coupling that a joint mimics another one by: the first that names it first, of two joints, always active."""
    kinds = {joint.name: joint.kind for joint in mechanism.joints}
    for closure in mechanism.closures:
        if closure.kind != "coupling" or len(closure.factors) != 2 or closure.active:
            continue
        if closure.factors[0][0] == name and {kinds[n] for n, _ in closure.factors} <= {*GEARED} - {"helical"}:
            yield closure
            return


def _add_mimic(element: ET.Element, closure: Closure) -> None:
    """f1 q1 + f2 q2 = offset  as  q1 = multiplier q2 + offset / f1."""
    (_, factor_here), (other, factor) = closure.factors
    told = {"multiplier": repr(float(-factor / factor_here)), "offset": repr(float(closure.offset / factor_here))}
    ET.SubElement(element, "mimic", {"joint": other} | told)


def _update_source_urdf(mechanism: Mechanism) -> ET.Element:
    source = read_source(mechanism)
    robot: ET.Element = fromstring(source.whole)
    for part in list(robot):
        if part.tag not in ("link", "joint"):
            robot.remove(part)
        for shape in [d for d in part if d.tag in ("visual", "collision")]:  # they name files that are not here
            part.remove(shape)
    for element in robot.findall("joint"):
        if (joint := mechanism.joint_of.get(element.get("name", ""))) is not None:
            _update_joint(element, joint)
    for link, body in source.overlays:
        _add_fixed_body(robot, source.named[link], body, f"{link}.{body.name}")
    return robot


def _update_joint(element: ET.Element, joint: Joint) -> None:
    """Give a joint of a URDF the kind, limits and drive that the mechanism has, which may lock it or state others."""
    if joint.kind not in KINDS:
        raise NotExported(f"joint {joint.name!r}: URDF has no {joint.kind} joint")
    element.set("type", KINDS[joint.kind])
    kept = ("origin", "parent", "child") if joint.kind in ("fixed", "free") else ("origin", "parent", "child", "axis")
    for part in [d for d in element if d.tag not in kept]:
        element.remove(part)
    _add_limits(element, joint.kind, joint.limits)
    _add_dynamics(element, joint)


def _build_urdf(mechanism: Mechanism) -> ET.Element:
    robot = ET.Element("robot", name=mechanism.name)
    skipped = mechanism.joints[0] if has_implicit_root(mechanism) else None
    if skipped is None:
        ET.SubElement(robot, "link", name=WORLD)
    for joint in mechanism.joints:
        link = mechanism.link_of[joint.child]
        if joint is not skipped:
            _add_joint(robot, joint)
        sub_element = ET.SubElement(robot, "link", name=joint.child)
        for k, body in enumerate(link.bodies):
            if k == 0:
                _add_inertial(sub_element, body)
            else:
                _add_fixed_body(robot, joint.child, body, f"{joint.child}.{body.name}")
    return robot


def _add_joint(robot: ET.Element, joint: Joint) -> None:
    if joint.kind == "universal":
        between = f"{joint.name}.between"
        ET.SubElement(robot, "link", name=between)
        first = _write(robot, f"{joint.name}.1", "revolute", (joint.parent, between), joint.placement, joint.axis)
        second = _write(robot, f"{joint.name}.2", "revolute", (between, joint.child), Placement(), joint.second_axis)
        for made in (first, second):
            _add_dynamics(made, joint)
        return
    if joint.kind not in KINDS or (joint.kind == "free" and joint.parent != WORLD):
        raise NotExported(
            f"joint {joint.name!r}: URDF has no {joint.kind} joint (but a free one of the world); see mujoco"
        )
    ends = joint.parent, joint.child
    made = _write(robot, joint.name, KINDS[joint.kind], ends, joint.placement, joint.axis, joint.limits)
    _add_dynamics(made, joint)


def _write(
    robot: ET.Element,
    name: str,
    kind: str,
    ends: tuple[str, str],
    at: Placement,
    axis: Any,
    limits: Limits | None = None,
) -> ET.Element:
    sub_element = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(
        sub_element,
        "origin",
        xyz=_format_numbers(at.position),
        rpy=_format_numbers(compute_roll_pitch_yaw(at.rotation)),
    )
    ET.SubElement(sub_element, "parent", link=ends[0])
    ET.SubElement(sub_element, "child", link=ends[1])
    if kind not in ("fixed", "floating"):
        ET.SubElement(sub_element, "axis", xyz=_format_numbers(axis))
    _add_limits(sub_element, kind, limits or Limits())
    return sub_element


def _add_limits(element: ET.Element, kind: str, limits: Limits) -> None:
    """Write limits: all of a revolute or sliding joint, of a continuous one effort and speed where one is stated."""
    bounds = {"effort": limits.effort, "velocity": limits.velocity}
    if kind in ("revolute", "prismatic"):
        bounds = {"lower": limits.lower, "upper": limits.upper, **bounds}
    elif kind != "continuous" or not np.isfinite([*bounds.values()]).any():
        return
    ET.SubElement(element, "limit", {key: repr(float(np.clip(x, -UNBOUND, UNBOUND))) for key, x in bounds.items()})


def _add_dynamics(element: ET.Element, joint: Joint) -> None:
    if joint.kind in ("free", "fixed"):
        return
    stated = {"damping": joint.damping, "friction": joint.friction}
    if any(stated.values()):
        ET.SubElement(element, "dynamics", {key: repr(float(value)) for key, value in stated.items()})


def _add_transmission(robot: ET.Element, joint: Joint) -> None:
    """Add a transmission with the gear of a drive and the rotor: rotor_inertia gear_ratio^2 = that of the joint."""
    if not (joint.rotor_inertia or joint.drive) or joint.kind in ("free", "fixed"):
        return
    ratio = joint.drive.ratio if joint.drive is not None else 1.0
    for name in (f"{joint.name}.1", f"{joint.name}.2") if joint.kind == "universal" else (joint.name,):
        sub_element = ET.SubElement(robot, "transmission", name=f"{name}.transmission")
        ET.SubElement(sub_element, "type").text = "transmission_interface/SimpleTransmission"
        ET.SubElement(sub_element, "joint", name=name)
        actuator = ET.SubElement(sub_element, "actuator", name=f"{name}.actuator")
        ET.SubElement(actuator, "mechanicalReduction").text = repr(float(ratio))
        ET.SubElement(actuator, DRAKE + "rotor_inertia", value=repr(float(joint.rotor_inertia / ratio**2)))
        ET.SubElement(actuator, DRAKE + "gear_ratio", value=repr(float(ratio)))


def _add_fixed_body(robot: ET.Element, parent: str, body: Body, name: str) -> None:
    link = ET.SubElement(robot, "link", name=name)
    _add_inertial(link, body)
    _write(robot, f"{name}.fixed", "fixed", (parent, name), Placement(), None)


def _add_inertial(link: ET.Element, body: Body) -> None:
    inertial = ET.SubElement(link, "inertial")
    t = body.inertia.tensor
    ET.SubElement(inertial, "origin", xyz=_format_numbers(body.inertia.com), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=repr(float(body.inertia.mass)))
    entries = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    ET.SubElement(inertial, "inertia", {key: repr(float(t[at])) for key, at in entries.items()})


def compute_roll_pitch_yaw(r: Any) -> tuple[float, float, float]:
    """Return roll, pitch, yaw [rad] of R = Rz(yaw) Ry(pitch) Rx(roll), with full digits also near pitch = 90 degrees."""
    yaw = float(np.arctan2(r[1, 0], r[0, 0])) if np.hypot(r[0, 0], r[1, 0]) > 0 else 0.0
    c = np.cos(yaw)
    s = np.sin(yaw)
    pitch = float(np.arctan2(-r[2, 0], c * r[0, 0] + s * r[1, 0]))
    roll = float(np.arctan2(s * r[0, 2] - c * r[1, 2], c * r[1, 1] - s * r[0, 1]))
    return roll, pitch, yaw


def _format_numbers(numbers: Any) -> str:
    return " ".join(repr(float(x)) for x in numbers)
