"""Printed digits of a file's numbers: half of a last digit is what rounding of a number can have done to it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from xml.etree.ElementTree import Element

import numpy as np

NUMBER = re.compile(r"^[+-]?(\d*)(?:\.(\d*))?(?:[eE]([+-]?\d+))?$")
TURNS = ("quat", "euler", "axisangle", "xyaxes", "zaxis")
INERTIAS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def compute_half_digit(text: str | None) -> float:
    """Return half a unit of the last printed digit of the most coarsely printed number in a text, in its own unit [any unit].

    Whole numbers are exact: ``0 0 1`` is an axis, not a rounded one.
    """
    return max((_compute_word_half(word) for word in (text or "").split()), default=0.0)


def _compute_word_half(word: str) -> float:
    match = NUMBER.match(word)
    if match is None or not (match[2] or match[3]):
        return 0.0
    return 0.5 * 10.0 ** (int(match[3] or 0) - len(match[2] or ""))


def read_urdf_digits(robot: Element) -> dict[tuple[str, str], float]:
    """Return by (element, quantity) the half digits of a URDF: [kg], [m], [kg m^2], [rad]."""
    urdf_digits: dict[tuple[str, str], float] = {}
    for link in robot.findall("link"):
        urdf_digits.update(_read_inertial_digits(link))
    for joint in robot.findall("joint"):
        name = joint.get("name", "")
        origin = joint.find("origin")
        axis = joint.find("axis")
        urdf_digits[name, "position"] = compute_half_digit(_read_attribute(origin, "xyz"))
        urdf_digits[name, "rotation"] = compute_half_digit(_read_attribute(origin, "rpy"))
        urdf_digits[name, "axis"] = compute_half_digit(_read_attribute(axis, "xyz"))
        for key in ("damping", "friction"):
            urdf_digits[name, key] = compute_half_digit(_read_attribute(joint.find("dynamics"), key))
        mimic = joint.find("mimic")
        urdf_digits[f"mimic {name}", "factor"] = compute_half_digit(_read_attribute(mimic, "multiplier"))
    return urdf_digits


def _read_inertial_digits(link: Element) -> Iterator[tuple[tuple[str, str], float]]:
    name = link.get("name", "")
    inertial = link.find("inertial")
    if inertial is None:
        return
    origin = inertial.find("origin")
    entries = inertial.find("inertia")
    turn = compute_half_digit(_read_attribute(origin, "rpy"))
    texts = [_read_attribute(entries, key) for key in INERTIAS]
    yield (name, "mass"), compute_half_digit(_read_attribute(inertial.find("mass"), "value"))
    yield (name, "com"), compute_half_digit(_read_attribute(origin, "xyz"))
    yield (name, "tensor"), max(map(compute_half_digit, texts)) + turn * _find_largest(texts)


def _read_attribute(element: Element | None, key: str) -> str | None:
    return None if element is None else element.get(key)


def _find_largest(texts: Iterable[str | None]) -> float:
    sizes = [0.0]
    for word in texts:
        try:
            sizes.append(abs(float(word or 0.0)))
        except ValueError:
            continue
    return float(np.nanmax(sizes))


def printed_of_sdf(root: Element) -> dict[tuple[str, str], float]:
    """Return the half digits of an SDF: [kg], [m], [kg m^2], [rad]; a joint's come from the poses of both of its links."""
    result: dict[tuple[str, str], float] = {}
    poses: dict[str, tuple[float, float]] = {}
    for link in root.iter("link"):
        name = link.get("name", "")
        inertial = link.find("inertial")
        poses[name] = _read_pose_digits(link)
        if inertial is not None:
            way, turn = _read_pose_digits(inertial)
            texts = [inertial.findtext(f"inertia/{key}") for key in INERTIAS]
            result[name, "mass"] = compute_half_digit(inertial.findtext("mass"))
            result[name, "com"] = way
            result[name, "tensor"] = max(map(compute_half_digit, texts)) + turn * _find_largest(texts)
    for joint in root.iter("joint"):
        name = joint.get("name", "")
        none = (0.0, 0.0)
        ends = [poses.get((joint.findtext(end) or "").strip(), none) for end in ("parent", "child")]
        way, turn = (sum(digits[k] for digits in (*ends, _read_pose_digits(joint))) for k in (0, 1))
        result[name, "rotation"] = turn
        result[name, "position"] = way + turn  # a link a metre away turns with its pose
        result[name, "axis"] = compute_half_digit(joint.findtext("axis/xyz")) + turn
    return result


def _read_pose_digits(element: Element) -> tuple[float, float]:
    words = (element.findtext("pose") or "").split()
    return compute_half_digit(" ".join(words[:3])), compute_half_digit(" ".join(words[3:]))


def read_mjcf_digits(root: Element) -> dict[tuple[str, str], float]:
    """Return the half digits that an MJCF's bodies and joints state themselves: [kg], [m], [kg m^2], [-]."""
    mjcf_digits: dict[tuple[str, str], float] = {}
    for body, way, turn in _list_bodies(root, 0.0, 0.0):
        name = body.get("name", "")
        inertial = body.find("inertial")
        mjcf_digits[name, "position"] = way
        mjcf_digits[name, "rotation"] = turn
        if inertial is not None:
            texts = (inertial.get("diaginertia"), inertial.get("fullinertia"))
            words = [word for text in texts for word in (text or "").split()]
            mjcf_digits[name, "mass"] = compute_half_digit(inertial.get("mass"))
            mjcf_digits[name, "com"] = compute_half_digit(inertial.get("pos"))
            mjcf_digits[name, "tensor"] = compute_half_digit(" ".join(words)) + 2 * compute_half_digit(
                inertial.get("quat")
            ) * _find_largest(words)
        for joint in body.iter("joint"):
            joint_name = joint.get("name", "")
            mjcf_digits[joint_name, "position"] = way + compute_half_digit(joint.get("pos"))
            mjcf_digits[joint_name, "rotation"] = turn
            mjcf_digits[joint_name, "axis"] = compute_half_digit(joint.get("axis"))
            for key, ours in (("armature", "rotor_inertia"), ("damping", "damping"), ("frictionloss", "friction")):
                mjcf_digits[joint_name, ours] = compute_half_digit(joint.get(key))
    return mjcf_digits


def _list_bodies(element: Element, way: float, turn: float) -> Iterator[tuple[Element, float, float]]:
    """Bodies with the half digits of their frames on the body before [m], [rad]; a <frame> around one adds its own.

    Bodies are told before those that they carry, whose joints then take the place of what was told of them.
    """
    for part in element:
        digits = (
            compute_half_digit(_read_attribute(part, "pos")),
            2 * max(compute_half_digit(_read_attribute(part, key)) for key in TURNS),
        )
        if part.tag == "body":
            yield part, way + digits[0], turn + digits[1]
            yield from _list_bodies(part, 0.0, 0.0)
        elif part.tag == "frame":
            yield from _list_bodies(part, way + digits[0], turn + digits[1])
        else:
            yield from _list_bodies(part, way, turn)
