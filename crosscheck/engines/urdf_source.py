"""A URDF as engines with a parser of their own need it: its text without what is not dynamics, and what is laid over it.

No engine and none of flexinv's reading of URDF is used here: a shared mistake would agree with itself.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from xml.etree.ElementTree import Element, tostring

from defusedxml.ElementTree import parse

from flexinv.mechanism import Body, Mechanism

KEPT = ("link", "joint")
DROPPED = ("visual", "collision", "mimic", "dynamics", "limit", "safety_controller", "calibration")


def plain_urdf(path: Path | str) -> str:
    """Return the URDF text with links, inertials and joints only: no geometry, limits, mimic, joint dynamics."""
    robot = parse(str(path)).getroot()
    for part in list(robot):
        if part.tag not in KEPT:
            robot.remove(part)
            continue
        for detail in [d for d in part if d.tag in DROPPED]:
            part.remove(detail)
    return tostring(robot, encoding="unicode")


def inertial_links(path: Path | str) -> frozenset[str]:
    """Return the names of the links that state an ``<inertial>``."""
    links: Iterable[Element] = parse(str(path)).getroot().iter("link")
    return frozenset(link.get("name", "") for link in links if link.find("inertial") is not None)


def overlays(mechanism: Mechanism) -> tuple[tuple[str, Body], ...]:
    """Return (link, body) of every body that the mechanism adds to its URDF.

    A link's first body is the URDF's own where the URDF states an inertial; all others were laid over it.
    """
    if mechanism.urdf is None:
        return ()
    own = inertial_links(mechanism.urdf)
    return tuple(
        (link.name, body)
        for link in mechanism.links
        for body in link.bodies[1 if link.name in own else 0 :]
    )


def check_joints(mechanism: Mechanism, engine: str, found: Iterable[str]) -> None:
    """Raise ValueError unless the engine's parser found the moving joints of the mechanism, the free base excepted."""
    expected = {j.name for j in mechanism.joints if j.nv and not (j is mechanism.joints[0] and j.kind == "free")}
    if (other := set(found)) != expected:
        raise ValueError(
            f"{engine} reads other joints from {mechanism.urdf} than the mechanism has: "
            f"only {engine}: {sorted(other - expected)}; only the mechanism: {sorted(expected - other)}"
        )
