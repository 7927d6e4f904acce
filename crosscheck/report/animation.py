"""The moving picture of a case: the places of all links, from the engines' records, in a small script of its own.

The deformed shape is that of flexinv's nodes; of the other engines the tips are known, which the page draws over it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from crosscheck import output_folder as owned
from crosscheck.measures.record import XYZ, Record
from crosscheck.report import drawing
from crosscheck.report.encoding import convert_to_base64
from crosscheck.verdicts.results import CaseRow

Array = NDArray[np.float64]
FRAMES = 150  # some five seconds of 30 frames; the page draws positions between them
MOST = 2_000_000  # [bytes] of numbers: a mechanism with more points gets fewer frames, but 20 at least


def write(case: CaseRow, records: Mapping[str, Record], folder: Path) -> bool:
    """Write ``animation.js`` into a case's data folder; return whether there is anything to draw."""
    data = build_animation(case.skeleton, records)
    if data is None:
        return False
    text = f"crosscheckData({json.dumps(case.slug + '/animation')}, {json.dumps(data, allow_nan=False)});\n"
    owned.write(folder / "animation.js", text)
    return True


def build_animation(skeleton: Sequence[Mapping[str, Any]], records: Mapping[str, Record]) -> dict[str, Any] | None:
    """Return times [s] and positions [m] of the frames, or None where no record has tips.

    links : {"name", "parent" (index or -1), "bends", "points": how many}; base : (frames, points, 3) of all links one
    after another, the last point of each its tip; tips : engine -> (frames, links, 3), and what is known: engine -> links
    """
    main = next((r for r in records.values() if collect_link_points(r, skeleton)), None)
    if main is None:
        return None
    points = collect_link_points(main, skeleton)
    assert points is not None
    count = sum(len(p) for p in points)
    frames = int(np.clip(MOST / (12 * max(1, count + len(records) * len(points))), 20, FRAMES))
    rows = np.unique(np.linspace(0, main.time.size - 1, frames).round().astype(int))
    names = [part["link"] for part in skeleton]
    links = [
        {"name": part["link"], "bends": part["bends"], "points": len(p)}
        | {"parent": names.index(part["parent"]) if part["parent"] in names else -1}
        for part, p in zip(skeleton, points, strict=True)
    ]
    base = np.stack([point[rows] for link in points for point in link], axis=1)  # (frame, point, xyz)
    ends = base[:, np.cumsum([len(p) for p in points]) - 1]  # (frame, link, xyz)
    others = {name: read_tips(record, names, rows) for name, record in records.items() if record is not main}
    known = {name: tip for name, tip in others.items() if tip is not None}
    return {
        "time": convert_to_base64(main.time[rows]),
        "engine": main.engine,
        "links": links,
        "base": convert_to_base64(base),
        "tips": {name: convert_to_base64(np.nan_to_num(tip)) for name, tip in known.items()},
        "known": {name: (~np.isnan(tip[0, :, 0])).tolist() for name, tip in known.items()},
        "apart": {name: float(np.nanmax(np.abs(tip - ends))) for name, tip in known.items()},
    }


def draw_still(skeleton: Sequence[Mapping[str, Any]], records: Mapping[str, Record]) -> Markup | None:
    """Return a small drawing of the motion, or None where no record has tips."""
    points = next(
        (link_points for record in records.values() if (link_points := collect_link_points(record, skeleton))), None
    )
    if points is None:
        return None
    lines = [np.stack(link, axis=1) for link in points]  # (sample, point, xyz) of every link
    parts = list(zip(lines, (bool(part["bends"]) for part in skeleton), strict=True))
    instants = [[(line[k], bends) for line, bends in parts] for k in drawing.list_drawn_samples(len(lines[0]))]
    return drawing.draw_svg(instants, "the mechanism in motion")


def read_tips(record: Record, names: Sequence[str], rows: NDArray[np.intp]) -> Array | None:
    """Return the tips of the links (frames, links, 3) [m], NaN where a link has none; None where none has one."""
    found = [_read_vector(record, f"tip/{name}") for name in names]
    if all(one is None for one in found):
        return None
    missing = np.full((record.time.size, 3), np.nan)
    return np.stack([(missing if one is None else one)[rows] for one in found], axis=1)  # (frame, link, xyz)


def collect_link_points(record: Record, skeleton: Sequence[Mapping[str, Any]]) -> list[list[Array]] | None:
    """Return the points (samples, 3) [m] of every link from its joint to its tip, or None where they are not known.

    A link whose tip is at its joint, as files of robots have them, has no length: the next one begins there.
    """
    shapes: dict[str, list[str]] = {}
    for name in record.series:
        if name.startswith("shape/") and name.endswith("/x"):
            shapes.setdefault(name.split("/")[1], []).append(name[:-2])
    ends: dict[str, Array] = {}
    without_length: set[str] = set()
    found = []
    for part in skeleton:
        tip = _read_vector(record, f"tip/{part['link']}")
        if tip is None and not shapes.get(part["link"]):
            return None
        nodes = [v for stem in shapes.get(part["link"], []) if (v := _read_vector(record, stem)) is not None]
        if not nodes:  # another engine's record: the joint is where the parent ends
            start = (
                ends.get(part["parent"]) if part["at"] is None else np.broadcast_to(part["at"], (record.time.size, 3))
            )
            nodes = [] if start is None else [np.asarray(start)]
        points = nodes if tip is None else [*nodes, tip]
        has_length = any(not np.array_equal(one, points[-1]) for one in points)
        if part["parent"] in without_length:
            points = [ends[part["parent"]], *points]
        if not has_length:
            without_length.add(part["link"])
        ends[part["link"]] = points[-1]
        found.append(points)
    return found or None


def _read_vector(record: Record, stem: str) -> Array | None:
    names = [f"{stem}/{axis}" for axis in XYZ]
    if not all(name in record.series for name in names):
        return None
    return np.stack([record.series[name].values for name in names], axis=1)
