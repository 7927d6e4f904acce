"""The moving picture of a case: the places of all links, from the engines' records, in a small script of its own.

The deformed shape is that of flexinv's nodes; of the other engines the tips are known, which the page draws over it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypedDict

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from crosscheck import output_folder as owned
from crosscheck.measures.record import XYZ, Record
from crosscheck.report.encoding import convert_to_base64
from crosscheck.verdicts.results import CaseRow, SkeletonLink
from flexinv.display import drawing
from flexinv.typing import Array

FRAMES = 150  # some five seconds of 30 frames; the page draws positions between them
MOST = 2_000_000  # [bytes] of numbers: a mechanism with more points gets fewer frames, but 20 at least


class DrawnLink(TypedDict):
    """A link that is drawn; parent : its number, -1 for none; points : how many it has."""

    name: str
    bends: bool
    points: int
    parent: int


class Animation(TypedDict):
    """Frames of a motion (arrays as base64): time [s], positions [m] of all points of ``links``, one link after another.

    tips : (frames, links, 3) [m] of the other engines, known : which links these give
    apart : the largest distance along an axis of their tips from those that are drawn [m]
    """

    time: str
    engine: str
    links: list[DrawnLink]
    base: str
    tips: dict[str, str]
    known: dict[str, list[bool]]
    apart: dict[str, float]


def write(case: CaseRow, records: Mapping[str, Record], folder: Path) -> bool:
    """Write ``animation.js`` into a case's data folder; return whether there is anything to draw."""
    data = build_animation(case.skeleton, records)
    if data is None:
        return False
    text = f"crosscheckData({json.dumps(case.slug + '/animation')}, {json.dumps(data, allow_nan=False)});\n"
    owned.write(folder / "animation.js", text)
    return True


def build_animation(skeleton: Sequence[SkeletonLink], records: Mapping[str, Record]) -> Animation | None:
    """Return times [s] and positions [m] of the frames, the last point of each link its tip; None where no record has tips."""
    drawn = ((record, collect_link_points(record, skeleton)) for record in records.values())
    main, points = next(((record, points) for record, points in drawn if points), (None, None))
    if main is None:
        return None
    assert points is not None
    rows = _choose_frames(main, sum(map(len, points)) + len(records) * len(points))
    names = [part["link"] for part in skeleton]
    base = np.stack([point[rows] for link in points for point in link], axis=1)  # (frame, point, xyz)
    ends = base[:, np.cumsum([len(p) for p in points]) - 1]  # (frame, link, xyz)
    others = {name: read_tips(record, names, rows) for name, record in records.items() if record is not main}
    known = {name: tip for name, tip in others.items() if tip is not None}
    return {
        "time": convert_to_base64(main.time[rows]),
        "engine": main.engine,
        "links": _describe_links(skeleton, points),
        "base": convert_to_base64(base),
        "tips": {name: convert_to_base64(np.nan_to_num(tip)) for name, tip in known.items()},
        "known": {name: (~np.isnan(tip[0, :, 0])).tolist() for name, tip in known.items()},
        "apart": {name: float(np.nanmax(np.abs(tip - ends))) for name, tip in known.items()},
    }


def _choose_frames(record: Record, points: int) -> NDArray[np.intp]:
    """Return the samples that are drawn: fewer where each has many points."""
    frames = int(np.clip(MOST / (12 * max(1, points)), 20, FRAMES))
    return np.unique(np.linspace(0, record.time.size - 1, frames).round().astype(int))


def _describe_links(skeleton: Sequence[SkeletonLink], points: Sequence[Sequence[Array]]) -> list[DrawnLink]:
    names = [part["link"] for part in skeleton]
    return [
        {
            "name": part["link"],
            "bends": part["bends"],
            "points": len(p),
            "parent": names.index(part["parent"]) if part["parent"] in names else -1,
        }
        for part, p in zip(skeleton, points, strict=True)
    ]


def draw_still(skeleton: Sequence[SkeletonLink], records: Mapping[str, Record]) -> Markup | None:
    """Return a small drawing of the motion, or None where no record has tips."""
    points = next(
        (link_points for record in records.values() if (link_points := collect_link_points(record, skeleton))), None
    )
    if points is None:
        return None
    lines = [np.stack(link, axis=1) for link in points]  # (sample, point, xyz) of every link
    parts = list(zip(lines, (bool(part["bends"]) for part in skeleton), strict=True))
    instants = [[(line[k], bends) for line, bends in parts] for k in drawing.list_drawn_samples(len(lines[0]))]
    return Markup(drawing.draw_svg(instants, "the mechanism in motion"))  # numbers, and words of ours


def read_tips(record: Record, names: Sequence[str], rows: NDArray[np.intp]) -> Array | None:
    """Return the tips of the links (frames, links, 3) [m], NaN where a link has none; None where none has one."""
    found = [_read_vector(record, f"tip/{name}") for name in names]
    if all(one is None for one in found):
        return None
    missing = np.full((record.time.size, 3), np.nan)
    return np.stack([(missing if one is None else one)[rows] for one in found], axis=1)  # (frame, link, xyz)


def collect_link_points(record: Record, skeleton: Sequence[SkeletonLink]) -> list[list[Array]] | None:
    """Return the points (samples, 3) [m] of every link from its joint to its tip, or None where they are not known.

    A link whose tip is at its joint, as files of robots have them, has no length: the next one begins there.
    """
    shapes = _map_to_shapes(record)
    ends: dict[str, Array] = {}
    without_length: set[str] = set()
    found = []
    for part in skeleton:
        stems = shapes.get(part["link"], [])
        tip = _read_vector(record, f"tip/{part['link']}")
        if tip is None and not stems:
            return None
        nodes = [v for stem in stems if (v := _read_vector(record, stem)) is not None]
        if not nodes:  # another engine's record: the joint is where the parent ends
            nodes = _list_start(record, part, ends)
        points = nodes if tip is None else [*nodes, tip]
        has_length = any(not np.array_equal(one, points[-1]) for one in points)
        if part["parent"] in without_length:
            points = [ends[part["parent"]], *points]
        if not has_length:
            without_length.add(part["link"])
        ends[part["link"]] = points[-1]
        found.append(points)
    return found or None


def _map_to_shapes(record: Record) -> dict[str, list[str]]:
    """Return by link the series of its nodes, without their axes, in the order of the record."""
    shapes: dict[str, list[str]] = {}
    for name in record.series:
        if name.startswith("shape/") and name.endswith("/x"):
            shapes.setdefault(name.split("/")[1], []).append(name[:-2])
    return shapes


def _list_start(record: Record, part: SkeletonLink, ends: Mapping[str, Array]) -> list[Array]:
    """Return the point (samples, 3) [m] at which a link starts, where it is known."""
    if part["at"] is not None:
        return [np.asarray(np.broadcast_to(part["at"], (record.time.size, 3)))]
    return [np.asarray(ends[part["parent"]])] if part["parent"] in ends else []


def _read_vector(record: Record, stem: str) -> Array | None:
    names = [f"{stem}/{axis}" for axis in XYZ]
    if not all(name in record.series for name in names):
        return None
    return np.stack([record.series[name].values for name in names], axis=1)
