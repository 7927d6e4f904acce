"""A mechanism as URDF, for engines and viewers that read nothing else; no engine is used here.

A link with one body carries it; further bodies, payloads of a URDF among them, are links of their own on fixed joints,
so that no inertia is composed on the way.  A universal joint is two revolute ones with a link without mass between.
A free joint of the root is left to the reader (Pinocchio adds its own); spherical joints have no name in URDF.
"""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
from defusedxml.ElementTree import parse

from crosscheck.engines.shared.export_files import NotExported
from crosscheck.engines.shared.urdf_source import read_source
from flexinv.model.mechanism import WORLD, Body, Joint, Limits, Mechanism, Placement

KINDS = {"revolute": "revolute", "continuous": "continuous", "prismatic": "prismatic", "fixed": "fixed"}


def urdf(mechanism: Mechanism) -> str:
    """Return the URDF of a rigid tree; of one that came from a URDF that text, with what was laid over it.

    Raises NotExported where the format has no word for something.
    """
    root = _laid_over(mechanism) if mechanism.urdf else _from_data(mechanism)
    ET.indent(root)
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _laid_over(mechanism: Mechanism) -> ET.Element:
    source = read_source(mechanism)
    robot: ET.Element = parse(str(mechanism.urdf)).getroot()
    for part in list(robot):
        if part.tag not in ("link", "joint"):
            robot.remove(part)
        for shape in [d for d in part if d.tag in ("visual", "collision")]:  # they name files that are not here
            part.remove(shape)
    for link, body in source.overlays:
        _hang(robot, source.named[link], body, f"{link}.{body.name}")
    return robot


def _from_data(mechanism: Mechanism) -> ET.Element:
    robot = ET.Element("robot", name=mechanism.name)
    first = mechanism.joints[0]
    floating = first.kind == "free" and first.parent == WORLD
    if not floating:
        ET.SubElement(robot, "link", name=WORLD)
    elif np.any(first.placement.position) or np.any(first.placement.rotation != np.eye(3)):
        raise NotExported(
            f"joint {first.name!r}: a free base of a URDF begins at the world's frame; its placement is not"
        )
    for joint in mechanism.joints:
        link = mechanism.link_of[joint.child]
        if not (floating and joint is first):
            _joint(robot, joint)
        own = ET.SubElement(robot, "link", name=joint.child)
        for k, body in enumerate(link.bodies):
            if k == 0:
                _inertial(own, body)
            else:
                _hang(robot, joint.child, body, f"{joint.child}.{body.name}")
    return robot


def _joint(robot: ET.Element, joint: Joint) -> None:
    if joint.kind == "universal":
        between = f"{joint.name}.between"
        ET.SubElement(robot, "link", name=between)
        _write(robot, f"{joint.name}.1", "revolute", (joint.parent, between), joint.placement, joint.axis)
        _write(robot, f"{joint.name}.2", "revolute", (between, joint.child), Placement(), joint.second_axis)
        return
    if joint.kind not in KINDS:
        raise NotExported(
            f"joint {joint.name!r}: URDF has no {joint.kind} joint (but a free one at the root); see mujoco"
        )
    ends = joint.parent, joint.child
    _write(robot, joint.name, KINDS[joint.kind], ends, joint.placement, joint.axis, joint.limits)


def _write(
    robot: ET.Element,
    name: str,
    kind: str,
    ends: tuple[str, str],
    at: Placement,
    axis: Any,
    limits: Limits | None = None,
) -> None:
    made = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(made, "origin", xyz=_text(at.position), rpy=_text(roll_pitch_yaw(at.rotation)))
    ET.SubElement(made, "parent", link=ends[0])
    ET.SubElement(made, "child", link=ends[1])
    if kind != "fixed":
        ET.SubElement(made, "axis", xyz=_text(axis))
    if kind in ("revolute", "prismatic"):  # required; what is not stated does not bind
        stated = limits or Limits()
        bounds = {"lower": stated.lower, "upper": stated.upper, "effort": stated.effort, "velocity": stated.velocity}
        ET.SubElement(made, "limit", {key: repr(float(np.clip(x, -1e9, 1e9))) for key, x in bounds.items()})


def _hang(robot: ET.Element, parent: str, body: Body, name: str) -> None:
    link = ET.SubElement(robot, "link", name=name)
    _inertial(link, body)
    _write(robot, f"{name}.fixed", "fixed", (parent, name), Placement(), None)


def _inertial(link: ET.Element, body: Body) -> None:
    inertial, t = ET.SubElement(link, "inertial"), body.inertia.tensor
    ET.SubElement(inertial, "origin", xyz=_text(body.inertia.com), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=repr(float(body.inertia.mass)))
    entries = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    ET.SubElement(inertial, "inertia", {key: repr(float(t[at])) for key, at in entries.items()})


def roll_pitch_yaw(r: Any) -> tuple[float, float, float]:
    """Return roll, pitch, yaw [rad] of R = Rz(yaw) Ry(pitch) Rx(roll), with full digits also near pitch = 90 degrees."""
    yaw = float(np.arctan2(r[1, 0], r[0, 0])) if np.hypot(r[0, 0], r[1, 0]) > 0 else 0.0
    c, s = np.cos(yaw), np.sin(yaw)
    pitch = float(np.arctan2(-r[2, 0], c * r[0, 0] + s * r[1, 0]))
    roll = float(np.arctan2(s * r[0, 2] - c * r[1, 2], c * r[1, 1] - s * r[0, 1]))
    return roll, pitch, yaw


def _text(numbers: Any) -> str:
    return " ".join(repr(float(x)) for x in numbers)
