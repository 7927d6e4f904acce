"""Answer a case kit with one planted fault, or none: the engine behind every door of ``door_faults.py``.

    python door_program.py KIT OUT FAULT BARS

It lies in a folder with ``faults.csv`` (a line per fault), ``rigid.py`` (an honest program for rigid links) and, for beams,
``sources/MACHINE/CHANGE-LEVEL.csv`` (answers of flexinv to the mechanism with one change, at 1, 2 and 4 times as fine steps).
Bars: none; honest (last digits); wide (a part ``bar`` of the range); narrow (1e-9 of it); zero.  The others are for doors that
ask for refinements: refined (the same whatever is asked, or the finer source), settling (an error of its own that falls with
the square of the refinement, on top of the fault; coarse: a large one; slow: one of first order), restless (an error that is
another one each time).
"""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

import numpy as np
from rigid_faults import MODELS
from signal_faults import SIGNALS

HERE = Path(__file__).resolve().parent
sys.path.append(
    str(HERE.parent / "tests" / "shared" / "kit_programs")
)  # of a checkout; a project has its copy beside this file
ROUNDING, NARROW = 1e-12, 1e-9  # parts of the largest value, of the range
SCATTER = 3e-3  # part of the range
FALLS = {
    "settling": (3e-3, 2),
    "coarse": (8e-2, 2),
    "slow": (3e-2, 1),
}  # error of the coarsest run [of the range], its order


def planted(name):
    """Return the line of ``faults.csv`` with its numbers."""
    with (HERE / "faults.csv").open(newline="") as stream:
        (row,) = [row for row in csv.DictReader(stream) if row["id"] == name]
    return row | {"size": float(row["size"]), "which": int(row["which"]), "bar": float(row["bar"])}


def read_series(file):
    """Return names of the columns with units, times (samples,) [s], and values (samples, columns)."""
    with file.open() as stream:
        header, *rows = list(csv.reader(stream))
    table = np.array(rows, dtype=float)
    return header[1:], table[:, 0], table[:, 1:]


def answer_rigid(kit, out, row):
    """Let the honest program answer, with a robot that has the fault."""
    import rigid

    change = MODELS.get(row["fault"])
    honest = rigid.Robot
    share = rigid.shared

    class FaultyRobot(honest):
        def __init__(self, folder):
            super().__init__(folder)
            if change:
                change(self, row["size"], row["which"])
            if getattr(self, "cut", False):
                rigid.shared = lambda g, driven, weights, tau: tau[driven]

    rigid.Robot = FaultyRobot
    try:
        rigid.answer(kit, out)
    finally:
        rigid.Robot = honest
        rigid.shared = share
    (out / "certificate.json").unlink(missing_ok=True)


def answer_from_source(kit, out, row):
    """Copy the answer to a mechanism with a change."""
    refinement = json.loads((kit / "case.json").read_text())["case"].get("refinement", 1)
    change = row["fault"] if row["fault"] not in SIGNALS else "right"
    source = HERE / "sources" / row["machine"] / f"{change}-{refinement}.csv"
    (out / "series.csv").write_text(source.read_text())
    (out / "meta.json").write_text("{}")


def barred(time, values, row, bars):
    """Return the half-widths that are stated, None without any."""
    spans = np.ptp(values, axis=0)
    sizes = {
        "honest": ROUNDING * abs(values).max(),
        "wide": row["bar"] * spans,
        "narrow": NARROW * spans,
        "zero": 0.0 * spans,
    }
    return None if bars not in sizes else np.broadcast_to(sizes[bars], values.shape)


def unsettled(kit, time, values, bars):
    """Return the values with an error of the program's own, as a refinement shows it."""
    level = json.loads((kit / "case.json").read_text())["case"].get("refinement", 1)
    spans = np.ptp(values, axis=0)
    if bars in FALLS:
        size, order = FALLS[bars]
        return values + size * spans / level**order * np.sin(9.0 * time / time[-1])[:, None]
    if bars == "restless":
        return values + SCATTER * spans * np.random.default_rng(level).standard_normal(values.shape)
    return values


def answer(kit, out, row, bars):
    """Write ``series.csv`` and ``meta.json`` of a faulty answer."""
    out.mkdir(parents=True, exist_ok=True)
    beams = (HERE / "sources" / row["machine"]).is_dir()
    (answer_from_source if beams else answer_rigid)(kit, out, row)
    if not (out / "series.csv").exists():
        return
    names, time, values = read_series(out / "series.csv")
    torques = [k for k, name in enumerate(names) if name.startswith("torque/") and np.ptp(values[:, k]) > 0.0]
    values[:, torques] = SIGNALS.get(row["fault"], SIGNALS["none"])(time, values[:, torques], row["size"], row["which"])
    values[:, torques] = unsettled(kit, time, values[:, torques], bars)
    half = barred(time, values, row, bars)
    header = ["time [s]", *names]
    table = [time[:, None], values]
    if half is not None:
        header += [name.replace(" [", " error [") for name in names]
        table.append(half)
    lines = [",".join(format(x, ".17g") for x in line) for line in np.hstack(table)]
    (out / "series.csv").write_text("\n".join([",".join(header), *lines]) + "\n")


if __name__ == "__main__":
    answer(Path(sys.argv[1]), Path(sys.argv[2]), planted(sys.argv[3]), sys.argv[4])
