"""Hinges of closures: two points that tie the same two bodies are a hinge about the line through them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from flexinv.model.mechanism import Array, Attachment, Closure, Placement

SAME = 1e-9  # relative: how much the distance of two points may differ between the bodies that they tie


def replace_points_by_hinges(closures: Iterable[Closure]) -> list[Closure]:
    """Return closures with one revolute one for two points [m] that tie the same two bodies, whichever is stated first."""
    made: list[Closure] = []
    for closure in closures:
        same = next((k for k, one in enumerate(made) if _has_same_bodies(one, closure)), None)
        hinge = None if same is None else _build_hinge(made[same], _match_ends(made[same], closure))
        if same is None or hinge is None:
            made.append(closure)
        else:
            made[same] = hinge
    return made


def _has_same_bodies(one: Closure, two: Closure) -> bool:
    if not one.kind == two.kind == "spherical":
        return False
    return {one.first.link, one.second.link} == {two.first.link, two.second.link}


def _match_ends(one: Closure, two: Closure) -> Closure:
    """The second closure with its ends in the order of the first's."""
    if one.first.link == two.first.link:
        return two
    return replace(two, first=two.second, second=two.first)


def _build_hinge(one: Closure, two: Closure) -> Closure | None:
    """The hinge through two points; None where they are one, or farther apart on one body than on the other."""
    lines = [b.placement.position - a.placement.position for a, b in ((one.first, two.first), (one.second, two.second))]
    length, other = (float(np.linalg.norm(line)) for line in lines)
    if length == 0.0 or abs(length - other) > SAME * length:
        return None
    ends = [
        Attachment(at.link, Placement(at.placement.position, _build_frame_along(line)))
        for at, line in zip((one.first, one.second), lines, strict=True)
    ]
    return Closure(one.name, "revolute", ends[0], ends[1])


def _build_frame_along(line: Array) -> Array:
    """The rotation (3, 3) [-] whose third column is the direction of a line."""
    z = line / np.linalg.norm(line)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
