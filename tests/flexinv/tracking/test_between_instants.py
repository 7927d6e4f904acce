"""What happens on a path between the instants that are asked for: limits of drives and singular positions are found there."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path as Folder

import numpy as np
import pytest

import flexinv
from flexinv import Mechanism, Path, follow
from flexinv.model.joints import Limits

TIME_BAR = 1e-9


def two_rods(root: Folder) -> Mechanism:
    """Two rods of 0.2 m that move in a plane."""
    m = flexinv.load_mechanism(root / "models" / "double_pendulum")
    return replace(m, joints=tuple(replace(one, actuated=True) for one in m.joints))


def lengths(m: Mechanism) -> tuple[float, float]:
    first = next(j for j in m.joints if j.parent != "world")
    return float(np.linalg.norm(first.placement.position)), float(np.linalg.norm(m.link_of[first.child].tip))


def arc_through(m: Mechanism, closest: float, duration: float) -> tuple[Path, dict[str, float], str]:
    """A straight line that passes the origin at a distance, the start at which the elbow bends, and the elbow's name."""
    shoulder, elbow = m.joints
    one, two = lengths(m)
    axis = shoulder.axis / np.linalg.norm(shoulder.axis)
    along = m.link_of[elbow.child].tip / two
    across = np.cross(axis, along)
    half = 0.5 * (one + two)
    path = Path.line(closest * along - half * across, closest * along + 1.13 * half * across, duration)
    distance = np.hypot(closest, half)
    bend = np.pi - np.arccos((one**2 + two**2 - distance**2) / (2 * one * two))
    base = -np.arctan2(half, closest) - np.arctan2(two * np.sin(bend), one + two * np.cos(bend))
    return path, {shoulder.name: float(base), elbow.name: float(bend)}, elbow.name


def test_a_limit_that_is_passed_between_instants_is_found(root: Folder) -> None:
    """The elbow bends most where the line is nearest to the shoulder, between two knots; the limit lies just below that."""
    m = two_rods(root)
    one, two = lengths(m)
    closest = 0.45 * (one + two)
    path, start, elbow = arc_through(m, closest, 1.0)
    most = np.pi - np.arccos((one**2 + two**2 - closest**2) / (2 * one * two))
    barely = replace(
        m, joints=tuple(replace(j, limits=Limits(upper=most - 1e-7) if j.name == elbow else j.limits) for j in m.joints)
    )
    with pytest.raises(flexinv.InputError, match=f"joint '{elbow}' passes its upper limit of") as caught:
        follow(barely, path, m.joints[1].child, 0.25, start=start)
    match = re.search(r"t = (\S+) s of the path", str(caught.value))
    assert match is not None
    instant = float(match[1])
    assert instant < 0.5
    distance = np.linalg.norm(path.evaluate([instant]).x[0])
    there = np.pi - np.arccos((one**2 + two**2 - distance**2) / (2 * one * two))
    assert there == pytest.approx(most - 1e-7, abs=2e-9)  # what Newton leaves of the path
    enough = replace(
        m, joints=tuple(replace(j, limits=Limits(upper=most + 1e-7) if j.name == elbow else j.limits) for j in m.joints)
    )
    follow(enough, path, m.joints[1].child, 0.25, start=start)


def test_a_singular_position_between_instants_is_found(root: Folder) -> None:
    """Near the shoulder the elbow is nearly folded: joints move the tip by less than a thousandth in one direction."""
    m = two_rods(root)
    one, two = lengths(m)
    for share, said in (
        (0.05, None),
        (1e-3, "the joints turn over, through a singular position or near one"),
        (1e-6, "through a singular position|the joints turn over, through a singular"),
    ):
        path, start, _ = arc_through(m, one - two + share, 1.0)
        if said is None:
            follow(m, path, m.joints[1].child, 0.24, start=start)
            continue
        with pytest.raises(flexinv.InputError, match=said):
            follow(m, path, m.joints[1].child, 0.24, start=start)
