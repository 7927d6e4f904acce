"""Sampled motions as CSV: a column ``time_s``, then one column per coordinate, named ``<coordinate>_<unit>``.

A revolute joint ``elbow`` has the column ``elbow_rad`` or ``elbow_deg``, a prismatic one ``slide_m`` or ``slide_mm``,
a continuous one its angle; other coordinates are named as in ``mechanism.coordinate_names``: ``ball.qx``,
``base.x_m``, ``cross.1_deg``.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from flexinv.files.toml_tables import complaint, read_bytes
from flexinv.files.values import UNITS
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array
from flexinv.validation import nearest

LARGEST_FILE = 64 << 20  # [byte]: a million samples of a robot
GAP = 3.0  # an interval this many times the median one is samples lost, not a change of pace
ANGLES, LENGTHS = ("rad", "deg", "mrad"), ("m", "mm", "cm")
Column = tuple[str, int, float]  # joint, which of its numbers, factor to SI


def read_samples(path: Path, mechanism: Mechanism, largest_gap: float | None) -> tuple[Array, dict[str, Array], float]:
    """Read time (samples,) [s], joint -> (samples, numbers) [rad, m, -], and the longest interval allowed [s].

    InputError names the line: a column that is no coordinate, a missing or odd number, times that do not increase,
    a gap longer than ``largest_gap`` [s] (three times the median interval when None).
    """
    rows = list(_rows(path))
    header = [name.strip() for name in rows[0][1]] if rows else []
    columns = _columns(header, mechanism, path)
    samples: list[list[float]] = []
    for line, row in rows[1:]:
        if len(row) != len(header):
            given, expected = f"{len(row)} cells", f"{len(header)}, as in the first line"
            raise complaint(f"{path}: line {line}", given, expected, "a number in each column")
        samples.append([])
        for name, cell in zip(header, row, strict=True):
            try:
                value = float(cell)
            except ValueError:
                value = math.nan
            if not math.isfinite(value):
                where = f"{path}: line {line}, column {name}"
                raise complaint(where, repr(cell[:40]), "a finite number", "the number, or leave the line out")
            samples[-1].append(value)
    table = np.array(samples)
    if len(table) < 2:
        raise complaint(str(path), f"{len(table)} rows of numbers", "two or more samples", "one row per time")
    lines = [line for line, _ in rows[1:]]
    time, gap = table[:, 0], largest_gap
    if gap is None:
        gap = GAP * float(np.median(np.diff(time)))
    _check_times(time, gap, lines, path)
    joints = {}
    for joint in mechanism.joints:
        own = sorted((k, column) for column, (name, k, _) in enumerate(columns) if name == joint.name)
        if own:
            joints[joint.name] = np.stack([table[:, 1 + c] * columns[c][2] for _, c in own], axis=1)  # (sample, number)
    return time, joints, gap


def _rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Lines that are not empty, with their numbers."""
    near = nearest(path.name, sorted(p.name for p in path.parent.glob("*.csv"))) if path.parent.is_dir() else None
    data = read_bytes(path, LARGEST_FILE, "a CSV file", near or "the name of a file that exists", "fewer samples")
    try:
        reader = csv.reader(io.StringIO(data.decode("utf-8-sig"), newline=""), strict=True)
        for row in reader:
            if any(cell.strip() for cell in row):
                yield reader.line_num, row
    except (UnicodeDecodeError, csv.Error) as error:
        raise complaint(str(path), f"no CSV: {error}", "UTF-8 text, commas between numbers", "the file again") from None


def _columns(header: list[str], mechanism: Mechanism, path: Path) -> list[Column]:
    known: dict[str, Column] = {}
    for joint in mechanism.joints:
        kind = KINDS[joint.kind]
        units = LENGTHS if any(kind.translations) else ANGLES
        for k, suffix in enumerate(("",) if kind.circle else kind.q):
            if suffix.startswith(".q"):
                known[joint.name + suffix] = (joint.name, k, 1.0)
            else:
                known |= {f"{joint.name}{suffix}_{unit}": (joint.name, k, UNITS[unit][unit]) for unit in units}
    where = f"{path}: line 1"
    if not header or header[0] != "time_s":
        given = f"first column {header[0]!r}" if header else "an empty file"
        raise complaint(where, given, "time_s, the time [s]", "time_s," + ",".join(list(known)[:3]))
    for k, name in enumerate(header[1:], 2):
        if name not in known:
            near = nearest(name, known)
            expected = "a coordinate with its unit: " + ", ".join(list(known)[:12])
            raise complaint(f"{where}, column {k}", name, expected, near or "one of these")
    columns = [known[name] for name in header[1:]]
    places = [(joint, k) for joint, k, _ in columns]
    for k, found in enumerate(places):
        if found in places[:k]:
            given = f"{header[k + 1]}: joint {found[0]} twice"
            raise complaint(f"{where}, column {k + 2}", given, "each coordinate once", "one of the two")
    for name, (owner, k, _) in known.items():
        if (owner, k) not in places and owner in {other for other, _ in places}:
            given = f"some coordinates of joint {owner}"
            raise complaint(where, given, "all its coordinates", f"a column {name}")
    return columns


def _check_times(time: Array, gap: float, lines: list[int], path: Path) -> None:
    steps = np.diff(time)
    k = int(np.argmax(steps <= 0))
    if steps[k] <= 0:
        given = f"{time[k + 1]:g} after {time[k]:g}"
        where = f"{path}: line {lines[k + 1]}, column time_s"
        raise complaint(where, given, "times that increase [s]", "the rows sorted by time, each time once")
    if time[0] != 0.0:
        where = f"{path}: line {lines[0]}, column time_s"
        raise complaint(where, f"{time[0]:g}", "a first time of 0 [s]", f"all times less {time[0]:g}")
    k = int(np.argmax(steps))
    if steps[k] > gap:
        where = f"{path}: line {lines[k + 1]}, column time_s"
        given = f"a gap of {steps[k]:g} s, from {time[k]:g} to {time[k + 1]:g}"
        write = f"the samples between, or largest_gap_s = {steps[k] * 1.001:.4g} if the spline may cross it"
        raise complaint(where, given, f"at most {gap:g} s between samples", write)
