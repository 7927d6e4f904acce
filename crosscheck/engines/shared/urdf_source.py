"""A URDF for engines with a parser of their own: its text reduced to dynamics, and the bodies laid over it.

No engine and none of flexinv's reading of URDF is used here: a shared mistake would agree with itself.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, tostring

from defusedxml.ElementTree import fromstring

from flexinv.files.lenient_xml import replace_invalid_xml
from flexinv.model.links import REPLACED
from flexinv.model.mechanism import WORLD, Body, Mechanism

KEPT = ("link", "joint")
DROPPED = ("visual", "collision", "mimic", "dynamics", "limit", "safety_controller", "calibration")


@dataclass(frozen=True)
class UrdfSource:
    """Contents of a mechanism's URDF.

    text : links, inertials and joints only: no geometry, limits, mimic, joint dynamics; link names are the mechanism's
    whole : all of the URDF but the inertials that the mechanism replaces
    named : what the URDF calls each link of the mechanism
    overlays : (link, body) of every body that the mechanism adds to the URDF, or has in place of its own
    """

    text: str
    whole: str
    named: dict[str, str]
    overlays: tuple[tuple[str, Body], ...]


def read_source(mechanism: Mechanism) -> UrdfSource:
    """Read the URDF behind a mechanism.

    A moving root that the URDF calls "world" has another name in the mechanism.  A link's first body is the URDF's own
    where the URDF states a mass or an inertia for it that is not replaced; all others were laid over it.
    """
    robot = _read_root(mechanism.urdf)
    theirs = {link.get("name", "") for link in robot.iter("link")}
    named = {link.name: link.name if link.name in theirs else WORLD for link in mechanism.links}
    _drop_inertials(robot, {named[k.name] for k in mechanism.links if k.bodies and k.bodies[0].name == REPLACED})
    whole = tostring(robot, encoding="unicode")
    stated = {link.get("name", ""): _has_inertia(link) for link in robot.iter("link")}
    overlays = [(k.name, body) for k in mechanism.links for body in k.bodies[1 if stated[named[k.name]] else 0 :]]
    other = {their: our for our, their in named.items() if our != their}
    return UrdfSource(_write_plain_urdf(robot, other), whole, named, tuple(overlays))


def _read_root(path: Path | None) -> Element:
    """The root of a file, hyphens in comments and undeclared prefixes put right as other readers take them."""
    assert path is not None
    data = path.read_bytes()
    try:
        element: Element = fromstring(data)
    except ParseError:
        element = fromstring(replace_invalid_xml(data)[0])
    return element


def _drop_inertials(robot: Element, links: set[str]) -> None:
    """Leave links without the inertia that the URDF states for them: the mechanism has another one."""
    for link in robot.iter("link"):
        for inertial in link.findall("inertial") if link.get("name") in links else ():
            link.remove(inertial)


def _has_inertia(link: Element) -> bool:
    entries = [link.find("inertial/mass"), link.find("inertial/inertia")]
    return any(float(text) for entry in entries if entry is not None for text in entry.attrib.values())


def _write_plain_urdf(robot: Element, other: dict[str, str]) -> str:
    for part in list(robot):
        if part.tag not in KEPT:
            robot.remove(part)
            continue
        for detail in [d for d in part if d.tag in DROPPED]:
            part.remove(detail)
        for element, key in ((part if part.tag == "link" else None, "name"), (part.find("parent"), "link")):
            if element is not None and (name := element.get(key)) in other:
                element.set(key, other[name])
    return tostring(robot, encoding="unicode")


def check_joints(mechanism: Mechanism, engine: str, found: Iterable[str]) -> None:
    """Raise ValueError unless the engine's parser found the moving joints of the mechanism, the free base excepted."""
    expected = {j.name for j in mechanism.joints if j.nv and not (j is mechanism.joints[0] and j.kind == "free")}
    if (other := set(found)) != expected:
        raise ValueError(
            f"{engine} reads other joints from {mechanism.urdf} than the mechanism has: "
            f"only {engine}: {sorted(other - expected)}; only the mechanism: {sorted(expected - other)}"
        )
