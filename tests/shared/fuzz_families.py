"""Kinds of mechanisms of the fuzz: trees, loops that close where they stand, gears, arms that grasp, hands that are held."""

from __future__ import annotations

import math
from typing import Any

from fuzz_draft import Draft, chain, end_of, pick, spread


def tree(d: Draft) -> None:
    """One to four links, the joints of all kinds, some without drives."""
    c = d.chance
    count = c.choice([1, 1, 2, 2, 2, 3, 3, 4])
    weights = (
        {"revolute": 70, "continuous": 10, "prismatic": 12, "fixed": 8}
        if d.plane
        else {"revolute": 55, "continuous": 8, "prismatic": 10, "universal": 8, "spherical": 9, "fixed": 7, "free": 3}
    )
    kinds = [pick(c, **weights) for _ in range(count)]
    kinds = [k if k != "free" or n == 0 else "revolute" for n, k in enumerate(kinds)]
    if all(k in ("fixed", "free") for k in kinds):
        kinds[-1] = "revolute"
    parents = [-1, *(k - 1 if c.random() < 0.75 else c.randrange(-1, k) for k in range(1, count))]
    some = c.random() < 0.7
    flexible = [some and c.random() < 0.6 for _ in range(count)]
    if kinds[0] == "free":
        flexible[0] = False
    chain(d, flexible, kinds, parents)
    for name, table in d.joints.items():
        passive = table["kind"] == "free" or (table["kind"] != "fixed" and c.random() < 0.12)
        if passive:
            loose(d, name)
        elif table["kind"] != "fixed":
            motion(d, name)
    if not d.moved:  # a motion moves something
        first = next(
            name for name, table in d.joints.items() if table["kind"] not in ("fixed", "free") or len(d.joints) == 1
        )
        d.joints[first] |= {"kind": "revolute", "axis": [0, 0, 1]}
        for key in ("actuated", "second_axis"):
            d.joints[first].pop(key, None)
        d.start.pop(first, None)
        motion(d, first)


def loose(d: Draft, name: str) -> None:
    """Take a joint's drive; it starts somewhere, and swings no faster than a pendulum in 30 m/s^2."""
    c, table = d.chance, d.joints[name]
    if table["kind"] != "free":
        table["actuated"] = False
    d.parts.add("passive")
    d.slow(1.5 * math.sqrt(30 / (0.4 * d.size)) / 2 / math.pi)
    if c.random() < 0.6:
        turn = {"rad": c.uniform(-1, 1)}
        start: dict[str, dict[str, Any]] = {
            "prismatic": {"m": c.uniform(-0.3, 0.3) * d.size},
            "universal": {"rad": [c.uniform(-1, 1), c.uniform(-1, 1)]},
        }
        body: dict[str, Any] = {"rpy_deg": [c.uniform(-50, 50) for _ in range(3)]}
        start |= {"spherical": body, "free": body | {"xyz_m": [0, 0, d.size]}}
        d.start[name] = start.get(table["kind"], turn)


def motion(d: Draft, name: str) -> None:
    """Give a joint a motion from one place to another, or leave it where it is."""
    c, kind = d.chance, d.joints[name]["kind"]
    first, way = c.uniform(-1.5, 1.5), c.choice([0.0, c.uniform(-1.5, 1.5), c.uniform(-1.5, 1.5), c.uniform(-6, 6)])
    if kind == "prismatic":
        d.moved[name] = {"from_m": 0.2 * first * d.size, "to_m": 0.2 * (first + way) * d.size}
    elif kind == "universal":
        d.moved[name] = {"from_rad": [first, 0.3], "to_rad": [first + way / 2, 0.3 - way / 3]}
    elif kind == "spherical":
        d.moved[name] = {"from_rpy_deg": [0, 0, 30 * first], "to_rpy_deg": [10 * way, 15 * way, 20]}
    else:
        d.moved[name] = {"from_rad": first, "to_rad": first + way}


def places(lengths: list[float], angles: list[float]) -> list[tuple[float, float]]:
    """Return the ends of the links of a planar chain whose joints turn by so much, from the origin on [m]."""
    x, y, turn, out = 0.0, 0.0, 0.0, []
    for length, angle in zip(lengths, angles, strict=True):
        turn += angle
        x, y = x + length * math.cos(turn), y + length * math.sin(turn)
        out.append((x, y))
    return out


def loop(d: Draft) -> None:
    """A planar chain that is closed where it stands: a pin, a slide or a point on a line; the last two joints follow."""
    c = d.chance
    kind = pick(c, revolute=50, spherical=8, point_on_line=20, prismatic=22)
    count = {"revolute": c.choice([3, 3, 4]), "spherical": 3, "point-on-line": 2, "prismatic": 3}[kind]
    flexible = [c.random() < 0.4 and not (kind == "prismatic" and k == 2) for k in range(count)]
    if c.random() < 0.4:
        flexible = [False] * count
    chain(d, flexible, ["revolute"] * count, list(range(-1, count - 1)))
    d.joints["j1"]["placement"] = {"xyz_m": [0, 0, 0]}
    lengths = [d.length[f"l{k + 1}"] for k in range(count)]
    follow = {"revolute": 2, "spherical": 2, "point-on-line": 1, "prismatic": 2}[kind]
    angles = [c.uniform(0.3, 1.5), *(c.choice([-1, 1]) * c.uniform(0.6, 1.9) for _ in range(count - 1))]
    tips = places(lengths, angles)
    way = [c.uniform(-0.6, 0.6) if k < count - follow else 0.0 for k in range(count)]
    line = c.uniform(-0.5, 0.5) if kind in ("point-on-line", "prismatic") else 0.0
    last = tips[-1] if kind != "prismatic" else tips[1]
    while not reaches(lengths, angles, way, last, line, kind):
        way = [0.7 * w for w in way]
        if max(map(abs, way)) < 1e-2:
            d.valid = False
            break
    closure: dict[str, Any] = {"kind": kind}
    if kind == "prismatic":
        closure |= {
            "first": {"link": "world", "xyz_m": [*last, 0], "rpy_deg": [0, 0, math.degrees(line)]},
            "second": {"link": "l3"},
        }
        closure["second"]["rpy_deg"] = [0, 0, math.degrees(line - sum(angles))]
        closure["axis"] = [1, 0, 0]
    else:
        closure |= {"first": {"link": "world", "xyz_m": [*last, 0]}, "second": end_of(d, f"l{count}")}
        if kind == "point-on-line":
            closure["axis"] = [math.cos(line), math.sin(line), 0]
        elif kind == "revolute":
            closure["axis"] = [0, 0, 1]
    d.closures["closing"] = closure
    for k in range(count):
        name = f"j{k + 1}"
        if k < count - follow:
            d.moved[name] = {"from_rad": angles[k], "to_rad": angles[k] + way[k]}
        else:
            d.joints[name]["actuated"] = False
            d.start[name] = {"rad": angles[k]}
            if c.random() < 0.2:
                d.joints[name]["damping_Nms_per_rad"] = 1e-3 * d.size**3


def reaches(
    lengths: list[float], angles: list[float], way: list[float], last: tuple[float, float], line: float, kind: str
) -> bool:
    """Whether the two links that follow reach their end with a margin of a tenth throughout the motion."""
    for k in range(21):
        now = [a + k / 20 * w for a, w in zip(angles, way, strict=True)]
        if kind in ("point-on-line", "prismatic"):
            x, y = places(lengths[:1], now[:1])[0]
            off = abs(-(x - last[0]) * math.sin(line) + (y - last[1]) * math.cos(line))
            if off > 0.9 * lengths[1]:
                return False
            continue
        x, y = places(lengths[:-2], now[:-2])[-1] if len(lengths) > 2 else (0.0, 0.0)
        far = math.hypot(x - last[0], y - last[1])
        a, b = lengths[-2:]
        if not abs(a - b) + 0.1 * min(a, b) < far < 0.95 * (a + b):
            return False
    return True


def geared(d: Draft) -> None:
    """A planar chain of which a gear ties the second joint to the first."""
    c = d.chance
    count = c.choice([2, 3])
    some = c.random() < 0.5
    chain(d, [some and c.random() < 0.6 for _ in range(count)], ["revolute"] * count, list(range(-1, count - 1)))
    ratio, offset = c.choice([-1, 1]) * c.uniform(0.4, 3), c.uniform(-1, 1)
    d.closures["gear"] = {"kind": "coupling", "factors": {"j1": 1, "j2": ratio}, "offset": offset}
    for k in range(count):
        if k != 1:
            motion(d, f"j{k + 1}")
    d.joints["j2"]["actuated"] = False
    d.start["j2"] = {"rad": (offset - d.moved["j1"]["from_rad"]) / ratio}


def arm(d: Draft, count: int) -> None:
    """A planar arm of driven links."""
    some = d.chance.random() < 0.7
    chain(d, [some and d.chance.random() < 0.6 for _ in range(count)], ["revolute"] * count, list(range(-1, count - 1)))
    for k in range(count):
        motion(d, f"j{k + 1}")


def grasp(d: Draft) -> None:
    """An arm takes up a body that lies in the plane, carries it, and perhaps lays it down."""
    c = d.chance
    arm(d, c.choice([1, 2, 2]))
    hand = f"l{len(d.links)}"
    mass = spread(c, 0.2, 2.0) * d.size
    d.links |= {"xslide": {"kind": "rigid", "massless": True}, "yslide": {"kind": "rigid", "massless": True}}
    d.links["body"] = {"kind": "rigid", "mass_kg": mass, "box": {"size_m": [0.3 * d.size] * 3}, "com_m": [0, 0, 0]}
    for name, parent, child, along in (("jx", "world", "xslide", [1, 0, 0]), ("jy", "xslide", "yslide", [0, 1, 0])):
        d.joints[name] = {"kind": "prismatic", "parent": parent, "child": child, "axis": along, "actuated": False}
        d.start[name] = {"m": 0.0}
    d.joints["jt"] = {"kind": "revolute", "parent": "yslide", "child": "body", "axis": [0, 0, 1], "actuated": False}
    d.start["jt"] = {"rad": 0.0}
    for link, frequency in [(k, d.stiff[k]) for k in d.stiff]:
        d.slow(math.sqrt(3 * frequency / (sum(d.mass.values()) + mass) / d.length[link] ** 3) / 2 / math.pi)
    again = {"capture": True, "impact": "plastic"}
    d.closures["lies"] = {"kind": "fixed", "first": {"link": "world"}, "second": {"link": "body"}, "active_s": "first"}
    d.closures["held"] = {
        "kind": "fixed",
        "first": end_of(d, hand),
        "second": {"link": "body"},
        "active_s": "second",
        **again,
    }
    d.closures["laid"] = {
        "kind": "fixed",
        "first": {"link": "world"},
        "second": {"link": "body"},
        "active_s": "third",
        **again,
    }


def pinned(d: Draft) -> None:
    """An arm with beams comes to rest, and is held at its hand for a while."""
    c, count = d.chance, d.chance.choice([1, 2, 2])
    chain(d, [c.random() < 0.5 for _ in range(count - 1)] + [True], ["revolute"] * count, list(range(-1, count - 1)))
    for k in range(count):
        motion(d, f"j{k + 1}")
    kind = c.choice(["revolute", "fixed", "spherical"])
    d.closures["wall"] = {
        "kind": kind, "first": {"link": "world"}, "second": end_of(d, f"l{count}"), "active_s": "rest", "capture": True,
        "impact": "plastic",
    }  # fmt: skip
    if kind == "revolute":
        d.closures["wall"]["axis"] = [0, 0, 1]
