"""A grammar of mechanisms, cases and calls: every number gives one text of mechanism.toml, one of cases.toml and one call.

What the grammar calls valid closes where it begins, has steps that see its slowest motions at twenty instants or more, and asks
of a function what its documentation offers.  About one case in ten is made rough on purpose (steps that see nothing, couples of
a hundred times the size, closures that miss): of these an error is as good as an answer.
"""

from __future__ import annotations

import json
import math
import random
from dataclasses import dataclass
from typing import Any

from fuzz_draft import Draft, axis, end_of, pick, spread
from fuzz_families import geared, grasp, loop, pinned, tree

LAWS = ("cycloid", "quintic", "nonic", "bang-bang", "trapezoid")
SMOOTH = ("cycloid", "quintic", "nonic")
ROUGH = 0.1  # of all cases


@dataclass
class Example:
    """A case of the fuzz: two texts, what is called, and what the grammar knows of it.

    call : name of the entrance, its arguments by name; valid : whether an answer is expected; parts : what it is made of
    """

    number: int
    seed: int
    mechanism: str
    cases: str
    call: dict[str, Any]
    valid: bool
    parts: list[str]

    def text(self) -> str:
        """Everything that is needed to repeat it, as JSON."""
        return json.dumps(self.__dict__, indent=1)


def example(number: int, seed: int) -> Example:
    """Return the case of a number [-], the same one every time."""
    chance = random.Random(f"{seed}/{number}")
    size = spread(chance, 0.05, 2.0)
    gravity = chance.choice([[0.0, 0.0, 0.0], [0.0, -9.81, 0.0], [0.0, 0.0, -9.81], [0.0, -9.81, 0.0]])
    family = pick(chance, tree=55, loop=22, geared=6, grasp=9, pinned=8)
    d = Draft(chance, size, gravity, plane=family != "tree" or chance.random() < 0.5)
    d.parts.add(family)
    {"tree": tree, "loop": loop, "geared": geared, "grasp": grasp, "pinned": pinned}[family](d)
    besides(d)
    times(d)
    call = calls(d, family)
    if chance.random() < ROUGH:
        roughen(d, call)
    beams = any(link["kind"] == "beam" for link in d.links.values())
    d.parts.add("beams" if beams else "rigid")
    return Example(number, seed, mechanism_text(d), cases_text(d, family), call, d.valid, sorted(d.parts))


def besides(d: Draft) -> None:
    """Payloads, rotors, friction, drives, springs and forces."""
    c = d.chance
    for name, table in d.joints.items():
        if table["kind"] in ("fixed", "free"):
            continue
        slides, own = table["kind"] == "prismatic", d.size**2 * max(sum(d.mass.values()), 1e-6)
        single = table["kind"] in ("revolute", "continuous", "prismatic")
        if c.random() < 0.08 and single and name in d.moved and not slides:
            drive(d, table, own)
            continue
        if c.random() < 0.25 and single and name in d.moved:
            table["rotor_inertia_kg" if slides else "rotor_inertia_kgm2"] = 0.1 * own / (d.size**2 if slides else 1)
        if c.random() < 0.2:
            unit = "damping_Ns_per_m" if slides else "damping_Nms_per_rad"
            table.setdefault(unit, spread(c, 0.01, 0.3) * own / (d.size**2 if slides else 1))
        if c.random() < 0.12 and single and name in d.moved:
            table["friction_N" if slides else "friction_Nm"] = spread(c, 0.1, 2.0) * own / (d.size if slides else 1)
            d.parts.add("friction")
        if c.random() < 0.1 and single:
            unit, rest = ("stiffness_N_per_m", "rest_m") if slides else ("stiffness_Nm_per_rad", "rest_rad")
            table |= {unit: spread(c, 1.0, 30.0) * own / (d.size**2 if slides else 1), rest: 0.0}
            d.slow(math.sqrt(30 / 0.1) / 2 / math.pi)
            d.parts.add("joint spring")
    links = [k for k in d.links if k in d.length]
    if c.random() < 0.15:
        spring(d, c.choice(links))
    if c.random() < 0.3:
        force(d, c.choice(links))


def drive(d: Draft, table: dict[str, Any], own: float) -> None:
    """A motor, a gear and an elastic joint; own : a moment of inertia [kg m^2]."""
    table["drive"] = {
        "gear_ratio": 50, "motor_inertia_kgm2": 0.05 * own / 2500, "stiffness_Nm_per_rad": 2e3 * own,
        "torque_constant_Nm_per_A": 0.1, "moves": d.chance.choice(["link", "link", "motor"]),
    }  # fmt: skip
    table.pop("damping_Nms_per_rad", None)
    d.parts.add(f"drive moves {table['drive']['moves']}")
    if table["drive"]["moves"] == "motor":
        d.slow(math.sqrt(2e3 / 0.03) / 2 / math.pi)


def spring(d: Draft, link: str) -> None:
    """A spring and damper from the world to the end of a link."""
    c, mass = d.chance, sum(d.mass.values())
    frequency = spread(c, 0.3, 3.0) / math.sqrt(d.size)
    at = [
        c.uniform(-1, 1) * d.size,
        (2 + c.uniform(0, 2)) * d.size * len(d.length),
        0 if d.plane else c.uniform(-1, 1) * d.size,
    ]
    d.springs["pull"] = {
        "first": {"link": "world", "xyz_m": at}, "second": end_of(d, link),
        "stiffness_N_per_m": mass * (2 * math.pi * frequency) ** 2, "rest_m": c.uniform(0.5, 2.0) * d.size,
        "damping_Ns_per_m": c.choice([0, 0.1 * mass * frequency]),
    }  # fmt: skip
    d.slow(3 * frequency)
    d.parts.add("spring")


def force(d: Draft, link: str) -> None:
    """A force or a couple on a link: at once, or growing; its size bends a beam visibly."""
    c, mass = d.chance, sum(d.mass.values())
    bending = d.stiff.get(link, mass * 10 * d.size**2 / 3)
    couple, sudden = c.random() < 0.5, c.random() < 0.5
    size = c.uniform(0.02, 0.4) * bending / d.length[link] ** (1 if couple else 2)
    size = min(size, 30 * mass * d.size) if couple else min(size, 30 * mass)
    way = [0.0, 0.0, size] if couple and d.plane else [0.0, size, 0.0] if d.plane else [size * v for v in axis(c)]
    table: dict[str, Any] = {"at": end_of(d, link), "follower": c.random() < 0.3}
    key = "moment_Nm" if couple else "force_N"
    if sudden:
        table[key] = way
    else:
        table |= {"time_s": "ramp", key: [[0.0, 0.0, 0.0], way]}
    d.forces["push"] = table
    d.parts.add(
        ("sudden " if sudden else "growing ")
        + ("couple" if couple else "force")
        + (" on a beam" if link in d.stiff else "")
    )
    d.slow(2.0 / math.sqrt(d.size))


def times(d: Draft) -> None:
    """Duration and step from what is slowest, and the instants of phases and ramps [s]."""
    c = d.chance
    d.law = c.choice(SMOOTH if c.random() < 0.8 else LAWS)
    slow = d.slowest if math.isfinite(d.slowest) else 3.0 / math.sqrt(d.size)
    way = max([abs(v) for t in d.moved.values() for v in [_way(t)]] + [0.5])
    d.duration = c.uniform(2.0, 5.0) / slow * max(1.0, way / 1.5)
    count = 12 * math.ceil(d.duration * slow * c.uniform(25, 50) / 12)  # laws jump at halves, thirds and quarters
    d.step = float(f"{d.duration / count:.4g}")
    d.duration = d.step * count
    extra = round(c.choice([0.0, 0.3, 0.6]) * count)
    if {"pinned", "grasp"} & d.parts:
        extra = round(0.6 * count)
    d.hold = d.step * extra
    at = {
        "first": [0.0, d.step * (count // 2)], "second": [d.step * (count // 2), d.step * (count + extra // 2)],
        "third": [d.step * (count + extra // 2), 1e6 * d.duration], "rest": [d.duration, d.step * (count + extra // 2)],
    }  # fmt: skip
    for table in d.closures.values():
        if "active_s" in table:
            table["active_s"] = [at[table["active_s"]]]
    for table in d.forces.values():
        if "time_s" in table:
            table["time_s"] = [0.0, 0.5 * d.duration]


def _way(table: dict[str, Any]) -> float:
    if "from_rad" in table:
        first, last = table["from_rad"], table["to_rad"]
        return max(
            float(abs(b - a)) for a, b in zip(*([v] if isinstance(v, float) else v for v in (first, last)), strict=True)
        )
    return 1.0


# --- calls ---------------------------------------------------------------------------------------------------------

TREES = {
    "solve": 30,
    "error": 5,
    "simulate": 20,
    "statics": 7,
    "parts": 5,
    "many": 6,
    "controller": 7,
    "natural": 5,
    "steady": 4,
    "linear": 4,
    "torques": 7,
}
OTHERS = {
    "tree": TREES,
    "loop": {"solve": 45, "simulate": 22, "statics": 10, "natural": 8, "many": 7, "error": 3, "torques": 5},
    "geared": {"solve": 50, "simulate": 35, "natural": 8, "many": 7},
    "grasp": {"solve": 70, "simulate": 30},
    "pinned": {"solve": 70, "simulate": 30},
}


def calls(d: Draft, family: str) -> dict[str, Any]:
    """Return the entrance and what it is given beside the files."""
    c = d.chance
    weights = dict(OTHERS[family])
    if not d.sections:  # rigid links: nothing swings, and nothing but closures and passive joints has to be marched
        for key in ("natural", "steady", "parts", "error"):
            weights.pop(key, None)
        weights["torques"] = weights.get("torques", 0) * 4
    else:
        weights.pop("torques", None)
    if any("time_s" in table for table in d.forces.values()):  # these know no time
        weights = {key: value for key, value in weights.items() if key not in ("torques", "controller")}
    name = pick(c, **weights)
    weight = any(d.gravity)
    call: dict[str, Any] = {"entrance": name}
    if weight and d.sections and name in ("solve", "error", "parts", "many", "controller", "simulate"):
        call["initial"] = "static" if c.random() < 0.7 else "consistent"
    if name == "simulate":
        shape = pick(c, zero=10, smooth=50, steps=40)
        call |= {"shape": shape, "effort": efforts(d), "count": c.choice([1, 2, 3])}
        for table in d.joints.values():  # Newton takes steps of some milliseconds there, as models/README.md says
            table.pop("friction_Nm", None)
            table.pop("friction_N", None)
    if name in ("solve", "simulate") and c.random() < 0.2:
        call["spectral_radius"] = c.choice([0.5, 0.7, 0.9, 1.0])
    if name == "parts":
        call["part"] = c.choice([5, 17, 100])
    if name in ("steady", "linear") and not weight and not d.springs and len(d.links) == 1 and c.random() < 0.7:
        call["rate"] = spread(c, 0.1, 3.0) * min(d.slowest, 1e3)
    return call


def efforts(d: Draft) -> dict[str, float]:
    """Return efforts that turn what a joint carries by about one radian (slide it by a length) in the time of the motion."""
    out = {}
    for name in d.moved:
        beyond, links = 0.0, [d.joints[name]["child"]]
        while links:
            link = links.pop()
            beyond += d.mass.get(link, 0.0) * d.length.get(link, 0.0) ** 2 / 3
            links += [t["child"] for t in d.joints.values() if t["parent"] == link]
        slides = d.joints[name]["kind"] == "prismatic"
        out[name] = d.chance.uniform(-2, 2) * beyond / d.duration**2 / (d.size if slides else 1.0)
    return out


def roughen(d: Draft, call: dict[str, Any]) -> None:
    """Make something extreme; an error is now as good as an answer."""
    c, d.valid = d.chance, False
    kind = pick(c, coarse=40, fast=15, loads=25, start=20)
    d.parts.add(f"rough: {kind}")
    if kind == "coarse":
        every, d.law = c.choice([5, 10, 20]), c.choice(SMOOTH)
        d.step *= every
        d.duration, d.hold = (d.step * max(round(t / d.step), 1) for t in (d.duration, d.hold or d.step))
    elif kind == "fast":
        factor = c.choice([3, 10, 30])
        d.step, d.duration, d.hold = d.step / factor, d.duration / factor, d.hold / factor
        for table in [*d.closures.values()]:
            if "active_s" in table:
                table["active_s"] = [[t / factor for t in table["active_s"][0]]]
    elif kind == "loads":
        factor = c.choice([30, 100, 1000])
        for table in d.forces.values():
            for key in ("force_N", "moment_Nm"):
                if key in table:
                    rows = table[key]
                    table[key] = [[factor * v for v in row] if isinstance(row, list) else factor * row for row in rows]
        call["effort"] = {name: factor * value for name, value in call.get("effort", {}).items()}
    else:
        for name, table in d.start.items():
            if "rad" in table and not isinstance(table["rad"], list):
                d.start[name] = {"rad": c.uniform(-3, 3)}
        for table in d.closures.values():
            if "active_s" not in table and "xyz_m" in table.get("first", {}):
                table["first"]["xyz_m"] = [v + c.uniform(-0.4, 0.4) * d.size for v in table["first"]["xyz_m"][:2]] + [0]


# --- text ----------------------------------------------------------------------------------------------------------


def toml(value: Any) -> str:
    """Return a value as TOML writes it within a line."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{k} = {toml(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, float | int) else json.dumps(value)


def mechanism_text(d: Draft) -> str:
    """Return the text of mechanism.toml."""
    lines = [
        'title = "Made by the grammar"',
        'source = "tests/fuzz_grammar.py"',
        f"gravity_m_per_s2 = {toml(d.gravity)}",
    ]
    groups = ("sections", "links", "joints", "closures", "springs", "forces")
    for group in groups:
        for name, table in getattr(d, group).items():
            lines += ["", f"[{group}.{name}]", *(f"{key} = {toml(value)}" for key, value in table.items())]
    return "\n".join(lines) + "\n"


def cases_text(d: Draft, family: str) -> str:
    """Return the text of cases.toml."""
    end = d.duration + d.hold
    lines = ['source = "tests/fuzz_grammar.py"', "", "[cases.only]", 'title = "Made by the grammar"']
    lines += [f"step_s = {d.step!r}", f"end_s = {end!r}"]
    lines += [f"start.{name} = {toml(table)}" for name, table in d.start.items()]
    lines += ["", "[cases.only.motion]", f'law = "{d.law}"', f"duration_s = {d.duration!r}", f"hold_s = {d.hold!r}"]
    lines += [f"joints.{name} = {toml(table)}" for name, table in d.moved.items()]
    return "\n".join(lines) + "\n"
