"""Printed digits of a file's numbers: half of a last digit is what rounding of a number can have done to it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from xml.etree.ElementTree import Element

import numpy as np

NUMBER = re.compile(r"^[+-]?(\d*)(?:\.(\d*))?(?:[eE]([+-]?\d+))?$")
TURNS = ("quat", "euler", "axisangle", "xyaxes", "zaxis")
INERTIAS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def half_digit(text: str | None) -> float:
    """Return half a unit of the last printed digit of the most coarsely printed number in a text, in its own unit [any unit].

    Whole numbers are exact: ``0 0 1`` is an axis, not a rounded one.
    """
    return max((_half(word) for word in (text or "").split()), default=0.0)


def _half(word: str) -> float:
    found = NUMBER.match(word)
    if found is None or not (found[2] or found[3]):
        return 0.0
    return 0.5 * 10.0 ** (int(found[3] or 0) - len(found[2] or ""))


def printed_of_urdf(robot: Element) -> dict[tuple[str, str], float]:
    """Return by (element, quantity) the half digits of a URDF: [kg], [m], [kg m^2], [rad]."""
    found: dict[tuple[str, str], float] = {}
    for link in robot.findall("link"):
        found.update(_inertial(link))
    for joint in robot.findall("joint"):
        name = joint.get("name", "")
        origin = joint.find("origin")
        axis = joint.find("axis")
        found[name, "position"] = half_digit(_get(origin, "xyz"))
        found[name, "rotation"] = half_digit(_get(origin, "rpy"))
        found[name, "axis"] = half_digit(_get(axis, "xyz"))
        for key in ("damping", "friction"):
            found[name, key] = half_digit(_get(joint.find("dynamics"), key))
        mimic = joint.find("mimic")
        found[f"mimic {name}", "factor"] = half_digit(_get(mimic, "multiplier"))
    return found


def _inertial(link: Element) -> Iterator[tuple[tuple[str, str], float]]:
    name = link.get("name", "")
    inertial = link.find("inertial")
    if inertial is None:
        return
    origin = inertial.find("origin")
    entries = inertial.find("inertia")
    turn = half_digit(_get(origin, "rpy"))
    texts = [_get(entries, key) for key in INERTIAS]
    yield (name, "mass"), half_digit(_get(inertial.find("mass"), "value"))
    yield (name, "com"), half_digit(_get(origin, "xyz"))
    yield (name, "tensor"), max(map(half_digit, texts)) + turn * _largest(texts)


def _get(element: Element | None, key: str) -> str | None:
    return None if element is None else element.get(key)


def _largest(texts: Iterable[str | None]) -> float:
    sizes = [0.0]
    for word in texts:
        try:
            sizes.append(abs(float(word or 0.0)))
        except ValueError:
            continue
    return float(np.nanmax(sizes))


def printed_of_sdf(root: Element) -> dict[tuple[str, str], float]:
    """Return the half digits of an SDF: [kg], [m], [kg m^2], [rad]; a joint's come from the poses of both of its links."""
    found: dict[tuple[str, str], float] = {}
    poses: dict[str, tuple[float, float]] = {}
    for link in root.iter("link"):
        name = link.get("name", "")
        inertial = link.find("inertial")
        poses[name] = _pose_digits(link)
        if inertial is not None:
            way, turn = _pose_digits(inertial)
            texts = [inertial.findtext(f"inertia/{key}") for key in INERTIAS]
            found[name, "mass"] = half_digit(inertial.findtext("mass"))
            found[name, "com"] = way
            found[name, "tensor"] = max(map(half_digit, texts)) + turn * _largest(texts)
    for joint in root.iter("joint"):
        name = joint.get("name", "")
        none = (0.0, 0.0)
        ends = [poses.get((joint.findtext(end) or "").strip(), none) for end in ("parent", "child")]
        way, turn = (sum(digits[k] for digits in (*ends, _pose_digits(joint))) for k in (0, 1))
        found[name, "rotation"] = turn
        found[name, "position"] = way + turn  # a link a metre away turns with its pose
        found[name, "axis"] = half_digit(joint.findtext("axis/xyz")) + turn
    return found


def _pose_digits(element: Element) -> tuple[float, float]:
    words = (element.findtext("pose") or "").split()
    return half_digit(" ".join(words[:3])), half_digit(" ".join(words[3:]))


def printed_of_mjcf(root: Element) -> dict[tuple[str, str], float]:
    """Return the half digits that an MJCF's bodies and joints state themselves: [kg], [m], [kg m^2], [-]."""
    found: dict[tuple[str, str], float] = {}
    for body, way, turn in _bodies(root, 0.0, 0.0):
        name = body.get("name", "")
        inertial = body.find("inertial")
        found[name, "position"] = way
        found[name, "rotation"] = turn
        if inertial is not None:
            texts = (inertial.get("diaginertia"), inertial.get("fullinertia"))
            words = [word for text in texts for word in (text or "").split()]
            found[name, "mass"] = half_digit(inertial.get("mass"))
            found[name, "com"] = half_digit(inertial.get("pos"))
            found[name, "tensor"] = half_digit(" ".join(words)) + 2 * half_digit(inertial.get("quat")) * _largest(words)
        for joint in body.iter("joint"):
            own = joint.get("name", "")
            found[own, "position"] = way + half_digit(joint.get("pos"))
            found[own, "rotation"] = turn
            found[own, "axis"] = half_digit(joint.get("axis"))
            for key, ours in (("armature", "rotor_inertia"), ("damping", "damping"), ("frictionloss", "friction")):
                found[own, ours] = half_digit(joint.get(key))
    return found


def _bodies(element: Element, way: float, turn: float) -> Iterator[tuple[Element, float, float]]:
    """Bodies with the half digits of their frames on the body before [m], [rad]; a <frame> around one adds its own.

    Bodies are told before those that they carry, whose joints then take the place of what was told of them.
    """
    for part in element:
        own = half_digit(_get(part, "pos")), 2 * max(half_digit(_get(part, key)) for key in TURNS)
        if part.tag == "body":
            yield part, way + own[0], turn + own[1]
            yield from _bodies(part, 0.0, 0.0)
        elif part.tag == "frame":
            yield from _bodies(part, way + own[0], turn + own[1])
        else:
            yield from _bodies(part, way, turn)
