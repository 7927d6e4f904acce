"""Faults planted in the text of a URDF or an MJCF, as somebody would have made them; neither package is imported here.

`plant` edits the XML and says what it did: quantity, element, size [unit].  Run as a program it writes the faulty file.
"""

from __future__ import annotations

import argparse
import json
import math
import random
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from xml.etree import ElementTree as ET

Vector = list[float]
MOVING = ("revolute", "continuous", "prismatic")


@dataclass
class Fault:
    """One planted fault: what it changed, of which element, by how much [unit]; also : further elements that it names."""

    kind: str
    quantity: str
    element: str
    size: float
    unit: str
    also: list[str] = field(default_factory=list)


class Unfit(Exception):
    """The file has nothing in which this fault could be planted."""


def numbers(text: str | None, default: str = "0 0 0") -> Vector:
    return [float(x) for x in (text or default).split()]


def shown(values: Vector) -> str:
    return " ".join(repr(float(x)) for x in values)


def norm(values: Vector) -> float:
    return math.sqrt(sum(x * x for x in values))


def times(a: list[Vector], b: list[Vector]) -> list[Vector]:
    return [[sum(a[i][k] * b[k][j] for k in range(3)) for j in range(3)] for i in range(3)]


def about(axis: Vector, angle: float) -> list[Vector]:
    c, s, (x, y, z) = math.cos(angle), math.sin(angle), [v / norm(axis) for v in axis]
    return [
        [c + x * x * (1 - c), x * y * (1 - c) - z * s, x * z * (1 - c) + y * s],
        [y * x * (1 - c) + z * s, c + y * y * (1 - c), y * z * (1 - c) - x * s],
        [z * x * (1 - c) - y * s, z * y * (1 - c) + x * s, c + z * z * (1 - c)],
    ]


def of_rpy(rpy: Vector) -> list[Vector]:
    return times(times(about([0, 0, 1], rpy[2]), about([0, 1, 0], rpy[1])), about([1, 0, 0], rpy[0]))


def to_rpy(r: list[Vector]) -> Vector:
    pitch = math.atan2(-r[2][0], math.hypot(r[0][0], r[1][0]))
    if math.hypot(r[0][0], r[1][0]) < 1e-9:
        return [math.atan2(-r[1][2], r[1][1]), pitch, 0.0]
    return [math.atan2(r[2][1], r[2][2]), pitch, math.atan2(r[1][0], r[0][0])]


def of_quaternion(q: Vector) -> list[Vector]:
    w, x, y, z = (c / norm(q) for c in q)
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]


def turn_between(a: list[Vector], b: list[Vector]) -> float:
    """The angle between two rotations [rad]."""
    r = times([[a[j][i] for j in range(3)] for i in range(3)], b)
    skew = [r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]]
    return math.atan2(norm(skew) / 2, (r[0][0] + r[1][1] + r[2][2] - 1) / 2)


class Urdf:
    """A URDF that faults are planted in."""

    def __init__(self, root: ET.Element, dice: random.Random) -> None:
        self.root, self.dice = root, dice
        self.joints = [j for j in root.findall("joint") if j.get("type") in MOVING and j.find("mimic") is None]
        moving = {j.find("child").get("link") for j in self.joints}  # type: ignore[union-attr]
        self.links = [
            k for k in root.findall("link")
            if k.get("name") in moving and self.mass(k) > 1e-3
        ]  # fmt: skip
        if len(self.joints) < 2 or len(self.links) < 2:
            raise Unfit

    @staticmethod
    def mass(link: ET.Element) -> float:
        entry = link.find("inertial/mass")
        return 0.0 if entry is None else float(entry.get("value", "0"))

    @staticmethod
    def origin(element: ET.Element, key: str) -> Vector:
        result = element.find("origin")
        return numbers(None if result is None else result.get(key))

    def link(self) -> ET.Element:
        return self.dice.choice(self.links)

    def joint(self) -> ET.Element:
        return self.dice.choice(self.joints)

    def part(self, element: ET.Element, tag: str) -> ET.Element:
        result = element.find(tag)
        return ET.SubElement(element, tag) if result is None else result

    def factor(self) -> float:
        return self.dice.choice([0.5, 0.8, 1.1, 1.25, 2.0, 10.0])

    def plant_mass(self) -> Fault:
        link = self.link()
        before, factor = self.mass(link), self.factor()
        link.find("inertial/mass").set("value", repr(before * factor))  # type: ignore[union-attr]
        return Fault("mass", "mass", link.get("name", ""), abs(before * (factor - 1)), "kg")

    def plant_com(self) -> Fault:
        link = self.link()
        origin = self.part(link.find("inertial"), "origin")  # type: ignore[arg-type]
        shift = [self.dice.uniform(-0.05, 0.05) for _ in range(3)]
        origin.set("xyz", shown([a + b for a, b in zip(numbers(origin.get("xyz")), shift, strict=True)]))
        return Fault("com", "centre of mass", link.get("name", ""), norm(shift), "m")

    def plant_tensor(self) -> Fault:
        link = self.dice.choice([k for k in self.links if k.find("inertial/inertia") is not None])
        entry, factor = link.find("inertial/inertia"), self.dice.choice([0.3, 1.5, 3.0])
        names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        before = {name: float(entry.get(name, "0")) for name in names}  # type: ignore[union-attr]
        if not any(before.values()):
            raise Unfit
        for name, value in before.items():
            entry.set(name, repr(value * factor))  # type: ignore[union-attr]
        origin = link.find("inertial/origin")
        r = of_rpy(numbers(None if origin is None else origin.get("rpy")))
        b = before
        t = [[b["ixx"], b["ixy"], b["ixz"]], [b["ixy"], b["iyy"], b["iyz"]], [b["ixz"], b["iyz"], b["izz"]]]
        turned = times(times(r, t), [[r[j][i] for j in range(3)] for i in range(3)])
        size = abs(factor - 1) * max(abs(x) for row in turned for x in row)
        return Fault("tensor", "inertia tensor", link.get("name", ""), size, "kg m^2")

    def plant_axis(self) -> Fault:
        joint = self.joint()
        axis = numbers(self.part(joint, "axis").get("xyz"), "1 0 0")
        other = self.dice.choice([[axis[1], axis[2], axis[0]], [axis[0] + 0.1, axis[1] - 0.2, axis[2] + 0.15]])
        self.part(joint, "axis").set("xyz", shown(other))
        dot = sum(a * b for a, b in zip(axis, other, strict=True)) / norm(axis) / norm(other)
        return Fault("axis", "joint axis", joint.get("name", ""), math.acos(max(-1.0, min(1.0, dot))), "rad")

    def plant_sign(self) -> Fault:
        joint = self.joint()
        axis = numbers(self.part(joint, "axis").get("xyz") or "1 0 0")
        self.part(joint, "axis").set("xyz", shown([-x for x in axis]))
        return Fault("sign", "sign of coordinate", joint.get("name", ""), 2.0, "-")

    def plant_offset(self) -> Fault:
        joint = self.dice.choice([j for j in self.joints if j.get("type") != "prismatic"])
        axis = numbers((joint.find("axis").attrib if joint.find("axis") is not None else {}).get("xyz") or "1 0 0")  # type: ignore[union-attr]
        origin, angle = self.part(joint, "origin"), self.dice.choice([math.pi / 2, -math.pi / 4, 0.1, 0.5])
        origin.set("rpy", shown(to_rpy(times(of_rpy(numbers(origin.get("rpy"))), about(axis, angle)))))
        return Fault("offset", "zero of coordinate", joint.get("name", ""), abs(angle), "rad")

    def plant_damping(self) -> Fault:
        return self.dynamics("damping", self.dice.choice([0.1, 1.0, 5.0]), "N m s/rad")

    def plant_friction(self) -> Fault:
        return self.dynamics("friction", self.dice.choice([0.1, 0.5, 2.0]), "N m")

    def dynamics(self, key: str, value: float, unit: str) -> Fault:
        joint = self.joint()
        entry = self.part(joint, "dynamics")
        before = float(entry.get(key, "0"))
        entry.set(key, repr(before + value))
        return Fault(key, {"friction": "dry friction"}.get(key, key), joint.get("name", ""), value, unit)

    def plant_moved(self) -> Fault:
        joint = self.joint()
        origin, shift = self.part(joint, "origin"), [self.dice.uniform(-0.1, 0.1) for _ in range(3)]
        origin.set("xyz", shown([a + b for a, b in zip(numbers(origin.get("xyz")), shift, strict=True)]))
        return Fault("moved frame", "position of joint", joint.get("name", ""), norm(shift), "m")

    def plant_millimetres(self) -> Fault:
        joints = [j for j in self.joints if norm(self.origin(j, "xyz")) > 0.01]
        if not joints:
            raise Unfit
        origin = (joint := self.dice.choice(joints)).find("origin")
        before = numbers(origin.get("xyz"))  # type: ignore[union-attr]
        origin.set("xyz", shown([1000 * x for x in before]))  # type: ignore[union-attr]
        return Fault("mm for m", "position of joint", joint.get("name", ""), 999 * norm(before), "m")

    def plant_degrees(self) -> Fault:
        joints = [j for j in self.joints if norm(self.origin(j, "rpy")) > 0.01]
        if not joints:
            raise Unfit
        origin = (joint := self.dice.choice(joints)).find("origin")
        before = numbers(origin.get("rpy"))  # type: ignore[union-attr]
        after = [x * 180 / math.pi for x in before]
        origin.set("rpy", shown(after))  # type: ignore[union-attr]
        size = turn_between(of_rpy(before), of_rpy(after))
        return Fault(
            "deg for rad", "orientation of joint", joint.get("name", ""), size, "rad", also=["zero of coordinate"]
        )

    def plant_swapped(self) -> Fault:
        one, two = self.dice.sample(self.links, 2)
        first, second = one.find("inertial"), two.find("inertial")
        if ET.tostring(first) == ET.tostring(second):  # type: ignore[arg-type]
            raise Unfit
        size = abs(self.mass(one) - self.mass(two))
        one.remove(first), two.remove(second)  # type: ignore[arg-type, func-returns-value]
        one.append(second), two.append(first)  # type: ignore[arg-type, func-returns-value]
        return Fault("swapped links", "bodies exchanged", one.get("name", ""), size, "kg", also=[two.get("name", "")])

    def plant_missing(self) -> Fault:
        link = self.link()
        mass = self.mass(link)
        link.remove(link.find("inertial"))  # type: ignore[arg-type]
        return Fault("missing body", "body that only A has", link.get("name", ""), mass, "kg")

    def plant_merged(self) -> Fault:
        joint = self.joint()
        others = [m.get("joint") for m in self.root.iter("mimic")]
        if joint.get("name") in others:
            raise Unfit
        joint.set("type", "fixed")
        return Fault("merged joint", "joint that moves in A only", joint.get("name", ""), 1.0, "-")

    def plant_gear(self) -> Fault:
        """The reduction of a simple transmission, where one is stated."""
        names = {j.get("name") for j in self.joints}
        simple = [
            t
            for t in self.root.findall("transmission")
            if len(t.findall("joint")) == 1 and "Simple" in (t.findtext("type") or "")
        ]
        places = [(t.find("joint").get("name", ""), entry) for t in simple for entry in t.iter("mechanicalReduction")]  # type: ignore[union-attr]
        places = [(name, entry) for name, entry in places if name in names]
        if not places:
            raise Unfit
        name, entry = self.dice.choice(places)
        before, factor = float(entry.text or "1"), self.dice.choice([-1.0, 0.5, 10.0])
        entry.text = repr(before * factor)
        return Fault("gear", "gear", name, abs(before * (factor - 1)), "-")

    def plant_mimic(self) -> Fault:
        joints = [j for j in self.root.findall("joint") if j.find("mimic") is not None and j.get("type") in MOVING]
        if not joints:
            raise Unfit
        joint = self.dice.choice(joints)
        joint.remove(joint.find("mimic"))  # type: ignore[arg-type]
        return Fault("mimic dropped", "coupling that only A has", joint.get("name", ""), 1.0, "-")


class Mjcf:
    """An MJCF with explicit inertials that faults are planted in."""

    def __init__(self, root: ET.Element, dice: random.Random) -> None:
        self.root, self.dice = root, dice
        self.joints = [j for j in root.iter("joint") if j.get("name") and j.get("type", "hinge") in ("hinge", "slide")]
        self.bodies = [b for b in root.iter("body") if b.find("joint") is not None and b.find("inertial") is not None]
        self.bodies = [b for b in self.bodies if float(b.find("inertial").get("mass", "0")) > 1e-3]  # type: ignore[union-attr]
        if len(self.joints) < 2 or len(self.bodies) < 2:
            raise Unfit

    def plant_mass(self) -> Fault:
        body, factor = self.dice.choice(self.bodies), self.dice.choice([0.5, 0.8, 1.25, 2.0, 10.0])
        inertial = body.find("inertial")
        before = float(inertial.get("mass", "0"))  # type: ignore[union-attr]
        inertial.set("mass", repr(before * factor))  # type: ignore[union-attr]
        return Fault("mass", "mass", body.get("name", ""), abs(before * (factor - 1)), "kg")

    def plant_com(self) -> Fault:
        body, shift = self.dice.choice(self.bodies), [self.dice.uniform(-0.05, 0.05) for _ in range(3)]
        inertial = body.find("inertial")
        before = numbers(inertial.get("pos"))  # type: ignore[union-attr]
        inertial.set("pos", shown([a + b for a, b in zip(before, shift, strict=True)]))  # type: ignore[union-attr]
        return Fault("com", "centre of mass", body.get("name", ""), norm(shift), "m")

    def plant_tensor(self) -> Fault:
        body, factor = self.dice.choice(self.bodies), self.dice.choice([0.5, 1.5, 3.0])
        inertial = body.find("inertial")
        assert inertial is not None
        key = "diaginertia" if inertial.get("diaginertia") else "fullinertia"
        before = numbers(inertial.get(key), "")
        if not any(before):
            raise Unfit
        inertial.set(key, shown([factor * x for x in before]))
        if key == "fullinertia":
            tensor = [
                [before[0], before[3], before[4]],
                [before[3], before[1], before[5]],
                [before[4], before[5], before[2]],
            ]
        else:
            tensor = [[before[i] if i == j else 0.0 for j in range(3)] for i in range(3)]
        r = of_quaternion(numbers(inertial.get("quat"), "1 0 0 0"))
        turned = times(times(r, tensor), [[r[j][i] for j in range(3)] for i in range(3)])
        size = abs(factor - 1) * max(abs(x) for row in turned for x in row)
        return Fault("tensor", "inertia tensor", body.get("name", ""), size, "kg m^2")

    def plant_gear(self) -> Fault:
        motors = [m for m in self.root.iter("motor") if m.get("joint") and m.get("gear")]
        if not motors:
            raise Unfit
        motor, factor = self.dice.choice(motors), self.dice.choice([-1.0, 0.5, 10.0])
        before = numbers(motor.get("gear"))
        motor.set("gear", shown([before[0] * factor, *before[1:]]))
        return Fault("gear", "gear", motor.get("joint", ""), abs(before[0] * (factor - 1)), "-")

    def scalar(self, key: str, quantity: str, unit: str) -> Fault:
        joint, value = self.dice.choice(self.joints), self.dice.choice([0.05, 0.5, 2.0])
        joint.set(key, repr(float(joint.get(key, "0")) + value))
        return Fault(key, quantity, joint.get("name", ""), value, unit)

    def plant_armature(self) -> Fault:
        return self.scalar("armature", "rotor inertia", "kg m^2")

    def plant_damping(self) -> Fault:
        return self.scalar("damping", "damping", "N m s/rad")

    def plant_frictionloss(self) -> Fault:
        return self.scalar("frictionloss", "dry friction", "N m")

    def plant_axis(self) -> Fault:
        joint = self.dice.choice(self.joints)
        axis = numbers(joint.get("axis"), "0 0 1")
        other = [axis[0] + 0.1, axis[1] - 0.2, axis[2] + 0.15]
        joint.set("axis", shown(other))
        dot = sum(a * b for a, b in zip(axis, other, strict=True)) / norm(axis) / norm(other)
        return Fault("axis", "joint axis", joint.get("name", ""), math.acos(max(-1.0, min(1.0, dot))), "rad")

    def plant_sign(self) -> Fault:
        joint = self.dice.choice(self.joints)
        joint.set("axis", shown([-x for x in numbers(joint.get("axis"), "0 0 1")]))
        return Fault("sign", "sign of coordinate", joint.get("name", ""), 2.0, "-")

    def plant_moved(self) -> Fault:
        body, shift = self.dice.choice(self.bodies), [self.dice.uniform(-0.1, 0.1) for _ in range(3)]
        body.set("pos", shown([a + b for a, b in zip(numbers(body.get("pos")), shift, strict=True)]))
        name = body.find("joint").get("name", "")  # type: ignore[union-attr]
        return Fault("moved frame", "position of joint", name, norm(shift), "m")


PLACES: dict[str, Callable[[ET.Element, random.Random], Urdf | Mjcf]] = {"robot": Urdf, "mujoco": Mjcf}


def kinds(tag: str) -> list[str]:
    return [name.removeprefix("plant_") for name in vars(PLACES[tag]) if name.startswith("plant_")]


def plant(text: str, seed: int, count: int = 1, kind: str = "") -> tuple[str, list[Fault]]:
    """Return the text with ``count`` faults of different kinds, and what they are; Unfit where it has no place for them."""
    dice, root = random.Random(seed), ET.fromstring(text)
    place = PLACES[root.tag](root, dice)
    made: list[Fault] = []
    for name in [kind] if kind else dice.sample(kinds(root.tag), len(kinds(root.tag))):
        if len(made) == count:
            break
        try:
            fault = getattr(place, f"plant_{name}")()
        except (Unfit, IndexError):
            continue
        made.append(fault)
        place = PLACES[root.tag](root, dice)
    if len(made) < count:
        raise Unfit
    return ET.tostring(root, encoding="unicode"), made


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=1)
    given = parser.parse_args()
    text, made = plant(given.file.read_text(), given.seed, given.count)
    given.out.write_text(text)
    given.out.with_suffix(".json").write_text(json.dumps([asdict(fault) for fault in made], indent=1))


if __name__ == "__main__":
    main()
