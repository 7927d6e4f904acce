"""Links and joints of the fuzz's mechanisms: what they weigh, how they bend, and how slowly what they carry swings."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field
from typing import Any

MATERIALS = {
    "steel": (210e9, 7850.0),
    "aluminium": (70e9, 2700.0),
    "graphite": (120e9, 1600.0),
    "nylon": (2.5e9, 1150.0),
}


@dataclass
class Draft:
    """What is being made: tables of the two files, and sizes [m, s, kg] for what follows."""

    chance: random.Random
    size: float
    gravity: list[float]
    plane: bool
    links: dict[str, dict[str, Any]] = field(default_factory=dict)
    sections: dict[str, dict[str, Any]] = field(default_factory=dict)
    joints: dict[str, dict[str, Any]] = field(default_factory=dict)
    closures: dict[str, dict[str, Any]] = field(default_factory=dict)
    springs: dict[str, dict[str, Any]] = field(default_factory=dict)
    forces: dict[str, dict[str, Any]] = field(default_factory=dict)
    start: dict[str, dict[str, Any]] = field(default_factory=dict)
    moved: dict[str, dict[str, Any]] = field(default_factory=dict)
    mass: dict[str, float] = field(default_factory=dict)
    length: dict[str, float] = field(default_factory=dict)
    stiff: dict[str, float] = field(default_factory=dict)
    slowest: float = math.inf
    parts: set[str] = field(default_factory=set)
    duration: float = 1.0
    hold: float = 0.0
    step: float = 1e-3
    law: str = "quintic"
    valid: bool = True

    def slow(self, frequency: float) -> None:
        """Note a frequency [Hz] that the steps have to see."""
        self.slowest = min(self.slowest, frequency)


def spread(chance: random.Random, low: float, high: float) -> float:
    """A number between two, evenly in its logarithm, with three digits."""
    return float(f"{math.exp(chance.uniform(math.log(low), math.log(high))):.3g}")


def pick(chance: random.Random, **weights: float) -> str:
    """One of the names by their weights."""
    return chance.choices(list(weights), list(weights.values()))[0].replace("_", "-")


def rigid_link(d: Draft, name: str, along: str = "x") -> None:
    """Add a rod, a box or a body with numbers of its own [kg, m]."""
    c, length, mass = d.chance, d.size * d.chance.uniform(0.5, 1.5), spread(d.chance, 0.05, 5.0) * d.size
    d.length[name], d.mass[name] = length, mass
    thick = length * c.uniform(0.02, 0.2)
    shapes: dict[str, dict[str, Any]] = {
        "rod": {"rod": {"length_m": length, "axial_inertia_kgm2": mass * thick**2 / 8}},
        "box": {"box": {"size_m": [length, thick, thick * c.uniform(0.5, 1)]}, "com_m": [length / 2, 0, 0]},
        "cylinder": {"cylinder": {"length_m": length, "radius_m": thick, "along": along}},
    }
    shape = shapes[c.choice(["rod", "box", "cylinder"])]
    d.links[name] = {"kind": "rigid", "mass_kg": mass, **shape, "tip_m": [length, 0, 0]}


def beam_link(d: Draft, name: str, carried: float) -> None:
    """Add a beam with a mass [kg] beyond it, as thick as makes it swing at some frequency."""
    c, length = d.chance, d.size * d.chance.uniform(0.5, 1.5)
    material = c.choice(list(MATERIALS))
    modulus, density = MATERIALS[material]
    frequency, ratio = spread(c, 3.0, 60.0) / math.sqrt(length), c.uniform(1.0, 4.0)
    shape = c.choice(["rectangle", "rectangle", "circle", "tube"])
    thick = 0.02 * length
    for _ in range(20):
        area = {"rectangle": ratio * thick**2, "circle": math.pi * thick**2 / 4, "tube": 0.36 * math.pi * thick**2 / 4}[
            shape
        ]
        wanted = (2 * math.pi * frequency) ** 2 * (carried + 0.24 * density * area * length) * length**3 / 3
        per = {"rectangle": ratio / 12, "circle": math.pi / 64, "tube": 0.59 * math.pi / 64}[shape]
        thick = min(max((wanted / modulus / per) ** 0.25, 0.004 * length), 0.12 * length)
    d.stiff[name] = bending = modulus * per * thick**4
    d.mass[name], d.length[name] = density * area * length, length
    d.slow(math.sqrt(3 * bending / (carried + 0.24 * d.mass[name]) / length**3) / 2 / math.pi)
    d.sections[name] = {
        **{"rectangle": {"size_y_m": thick, "size_z_m": ratio * thick}, "circle": {"diameter_m": thick}, "tube":
           {"outer_diameter_m": thick, "wall_m": 0.1 * thick}}[shape],
        "shape": shape, "E_Pa": modulus, "nu": 0.33, "rho_kg_per_m3": density,
    }  # fmt: skip
    if c.random() < 0.5:
        d.sections[name]["retardation_s"] = spread(c, 0.002, 0.05) / (math.pi * frequency)
    d.links[name] = {"kind": "beam", "length_m": length, "section": name}
    if c.random() < 0.5:
        d.links[name] |= {"elements": c.choice([1, 2, 4]), "order": c.choice([1, 2, 3, 4])}
    if not d.plane and c.random() < 0.15:
        d.links[name]["curvature_per_m"] = {"twist": 0.0, "y": 0.0, "z": c.uniform(-0.5, 0.5) / length}


def payload(d: Draft, name: str, mass: float) -> None:
    """Add a body [kg] at the end of a link."""
    at: dict[str, Any] = {"station": 1.0} if d.links[name]["kind"] == "beam" else {}
    body = {"com_m": [0, 0, 0] if at else [d.length[name], 0, 0], "inertia_kgm2": 0}
    d.links[name]["payload"] = [{"name": "load", **at, "mass_kg": mass, **body}]
    d.mass[name] += mass


def chain(d: Draft, flexible: list[bool], kinds: list[str], parents: list[int]) -> None:
    """Add links from the last to the first (each knows what it carries), then their joints, each at its parent's end."""
    carried = [0.0] * len(flexible)
    for k in reversed(range(len(flexible))):
        name, load = f"l{k + 1}", spread(d.chance, 0.1, 3.0) * d.size * (d.chance.random() < 0.4)
        if flexible[k]:
            beam_link(d, name, carried[k] + load + 1e-3)
        else:
            rigid_link(d, name)
        if load:
            payload(d, name, load)
        if parents[k] >= 0:
            carried[parents[k]] += carried[k] + d.mass[name]
    for k, (kind, parent) in enumerate(zip(kinds, parents, strict=True)):
        joint(d, f"j{k + 1}", kind, f"l{parent + 1}" if parent >= 0 else "world", f"l{k + 1}")
    d.links = dict(sorted(d.links.items()))


def joint(d: Draft, name: str, kind: str, parent: str, child: str) -> None:
    """Add a joint at the end of its parent."""
    c = d.chance
    table: dict[str, Any] = {"kind": kind, "parent": parent, "child": child}
    turned: dict[str, Any] = {}
    if not d.plane and c.random() < 0.4:
        turned = {"rpy_deg": [c.choice([0, 90, c.uniform(-60, 60)]) for _ in range(3)]}
    if parent == "world":
        where: dict[str, Any] = {"placement": {"xyz_m": [c.uniform(-1, 1) * d.size, 0, 0], **turned}}
    elif d.links[parent]["kind"] == "beam":
        where = {"station": 1.0 if d.plane or c.random() < 0.8 else 0.5} | ({"placement": turned} if turned else {})
    else:
        where = {"placement": {"xyz_m": [d.length[parent], 0, 0], **turned}}
    table |= where
    if kind in ("revolute", "continuous", "prismatic"):
        table["axis"] = ([1, 0, 0] if kind == "prismatic" else [0, 0, 1]) if d.plane else axis(c)
    elif kind == "universal":
        table |= {"axis": [0, 0, 1], "second_axis": [0, 1, 0]}
    d.joints[name] = table


def axis(c: random.Random) -> list[float]:
    """Return a direction, mostly along an axis [-]."""
    if c.random() < 0.8:
        return c.choice([[0, 0, 1], [0, 1, 0], [0, 0, -1], [1, 0, 0]])
    values = [c.gauss(0, 1) for _ in range(3)]
    size = math.hypot(*values)
    return [v / size for v in values]


def end_of(d: Draft, link: str) -> dict[str, Any]:
    """Return where a link ends, as an attachment [m]."""
    if d.links[link]["kind"] == "beam":
        return {"link": link, "station": 1.0}
    return {"link": link, "xyz_m": [d.length[link], 0, 0]}
