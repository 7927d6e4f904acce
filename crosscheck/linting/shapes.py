"""Shapes without inertia: links of a URDF that have something to see or to touch and weigh what each reader makes up.

    MuJoCo 4.0.0                     1000 kg/m^3 of what collides; of what is only seen nothing
    PyBullet 3.2.7, DART 6.20.0      1 kg each
    Pinocchio 4.1.0, Drake 1.51.1    nothing

Measured with each on a link that is fixed to a moving one: a cylinder of 3 cm length and 5 cm radius, that collides, that is
seen, both; boxes, spheres, capsules and meshes, too.  An <inertial> with a mass of zero and a tensor of zeros is nothing in all.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from xml.etree.ElementTree import Element

from crosscheck.findings.finding import Finding, make_warning
from crosscheck.linting.mesh_files import MeshFile
from crosscheck.linting.volumes import compute_volume

WATER = 1000.0  # [kg/m^3]: what MuJoCo takes for a shape without mass
MADE_UP = "PyBullet and DART take 1 kg"


def check_shapes(robot: Element, meshes: Mapping[str, MeshFile]) -> Iterator[Finding]:
    """Yield links that move, have shapes, and no <inertial> [kg]; meshes : those that are read, by name."""
    carried = {_end(joint, "child"): joint for joint in robot.findall("joint")}
    for link in robot.findall("link"):
        name = link.get("name", "")
        touched = link.findall("collision")
        seen = link.findall("visual")
        if link.find("inertial") is not None or not (touched or seen) or not _can_move(name, carried):
            continue
        if touched:
            given = "collides, and has no <inertial>"
            why = f"MuJoCo takes {_describe_shape_mass(touched, meshes)}, {MADE_UP}, Pinocchio and Drake nothing"
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


def _describe_shape_mass(collisions: list[Element], meshes: Mapping[str, MeshFile]) -> str:
    """MuJoCo's mass of shapes in words [kg]."""
    volumes = [compute_volume(collision, meshes, mujoco=True) for collision in collisions]
    known = [volume for volume in volumes if volume is not None]
    if len(known) < len(volumes):
        return f"{WATER:g} kg/m^3 of its shape"
    return f"{WATER * sum(known):.3g} kg, {WATER:g} kg/m^3 of its shape"
