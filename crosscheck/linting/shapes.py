"""Shapes without inertia: links of a URDF that have something to see or to touch and weigh what each reader makes up.

    MuJoCo 4.0.0                     1000 kg/m^3 of what collides; of what is only seen nothing
    PyBullet 3.2.7, DART 6.20.0      1 kg each
    Pinocchio 4.1.0, Drake 1.51.1    nothing

Measured with each on a link that is fixed to a moving one: a cylinder of 3 cm length and 5 cm radius, that collides, that is
seen, both.  An <inertial> with a mass of zero and a tensor of zeros is nothing in all of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from xml.etree.ElementTree import Element

import numpy as np

from crosscheck.findings.finding import Finding, make_warning

WATER = 1000.0  # [kg/m^3]: what MuJoCo takes for a shape without mass
MADE_UP = "PyBullet and DART take 1 kg"


def check_shapes(robot: Element) -> Iterator[Finding]:
    """Yield links that move, have shapes, and no <inertial> [kg]."""
    carried = {_end(joint, "child"): joint for joint in robot.findall("joint")}
    for link in robot.findall("link"):
        name = link.get("name", "")
        touched = link.findall("collision")
        seen = link.findall("visual")
        if link.find("inertial") is not None or not (touched or seen) or not _can_move(name, carried):
            continue
        if touched:
            given = "collides, and has no <inertial>"
            why = f"MuJoCo takes {_describe_shape_mass(touched)}, {MADE_UP}, Pinocchio and Drake nothing"
        else:
            given = "is seen, and has no <inertial>"
            why = f"{MADE_UP}, MuJoCo, Pinocchio and Drake nothing"
        write = "<inertial> with mass and tensor; of zeros, if it weighs nothing, which all readers take alike"
        yield make_warning("shape without inertia", f"link {name}", given, why, write)


def _can_move(name: str, carried: Mapping[str, Element]) -> bool:
    """Return True if a joint that moves stands between a link and the root."""
    passed: set[str] = set()
    while name in carried and name not in passed:
        passed.add(name)
        if carried[name].get("type") != "fixed":
            return True
        name = _end(carried[name], "parent")
    return False


def _end(joint: Element, tag: str) -> str:
    end = joint.find(tag)
    return "" if end is None else end.get("link", "")


def _describe_shape_mass(collisions: list[Element]) -> str:
    """MuJoCo's mass of shapes in words [kg]."""
    volumes = [_compute_volume(collision.find("geometry")) for collision in collisions]
    if any(volume is None for volume in volumes):
        return f"{WATER:g} kg/m^3 of its shape"
    return f"{WATER * sum(volume for volume in volumes if volume is not None):.3g} kg, {WATER:g} kg/m^3 of its shape"


def _compute_volume(geometry: Element | None) -> float | None:
    """The volume [m^3] of a box, a sphere or a cylinder; None for a mesh, and for what is no number."""
    shape = None if geometry is None else next(iter(geometry), None)
    if shape is None:
        return None
    try:
        if shape.tag == "box":
            return float(np.prod([float(word) for word in shape.get("size", "").split()]))
        radius = float(shape.get("radius", ""))
        if shape.tag == "sphere":
            return 4.0 / 3.0 * np.pi * radius**3
        if shape.tag == "cylinder":
            return np.pi * radius**2 * float(shape.get("length", ""))
    except ValueError:
        return None
    return None
