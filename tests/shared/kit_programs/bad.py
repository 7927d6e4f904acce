"""Programs that answer a kit well, and then spoil the answer, each in one way: ``python bad.py KIND KIT OUT [ANSWER]``.

ANSWER is a folder with a good answer to this kit, which is then taken instead of computed.
"""

from __future__ import annotations

import csv
import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

HUGE = 100_000_000  # [bytes]
Rows = list[list[str]]

# What is done to the table of the answer, by the name of the mistake.
TABLES: dict[str, Callable[[Rows], Rows]] = {
    "units": lambda t: [[cell.replace("N m]", "Nmm]") for cell in t[0]], *t[1:]],
    "missing": lambda t: [[*row[:1], *row[2:]] for row in t],
    "doubled": lambda t: [[*row, row[1]] for row in t],
    "times": lambda t: [t[0], *([repr(1.5 * float(row[0])), *row[1:]] for row in t[1:])],
    "names": lambda t: [[t[0][0], *(cell.replace("torque/", "torque/robot_") for cell in t[0][1:])], *t[1:]],
    "nan": lambda t: [*t[:-1], [t[-1][0], *["nan"] * (len(t[0]) - 1)]],
    "infinite": lambda t: [*t[:-1], [t[-1][0], *["-inf"] * (len(t[0]) - 1)]],
    "words": lambda t: [*t[:-1], [t[-1][0], *["n/a"] * (len(t[0]) - 1)]],
    "semicolons": lambda t: [[";".join(row)] for row in t],
    "nothing": lambda t: [],
}
# What lies beside the table, by the name of the mistake.
FILES = {
    "other-case": {"meta.json": '{"mechanism": "crane", "name": "lift"}'},
    "other-digest": {"meta.json": '{"case": "0123456789abcdef"}'},
    "huge-json": {"meta.json": '{"notes": "' + "x" * HUGE + '"}'},
    "deep-json": {"meta.json": "[" * 1_000_000},
    "other-order": {"certificate.json": '{"order": ["shoulder", "elbow", "wrist"]}'},
    "other-joints": {"certificate.json": '{"masses": {"shoulder": 3.0, "elbow": 2.0}}'},
    "other-size": {"certificate.json": '{"gravity": [[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]]}'},
    "huge-certificate": {"certificate.json": '{"mass": ' + "0" * HUGE + "}"},
}


def main(kind: str, kit: str, out: str, known: str = "") -> None:
    """Answer, and spoil it."""
    if kind == "crashing":
        os.abort()
    if kind == "printing":
        for _ in range(200):
            os.write(1, b"iteration 17 residual 1e-3\n" * 4000)
    folder = Path(out)
    if known:
        shutil.copytree(known, folder, dirs_exist_ok=True)
    else:
        from rigid import answer

        folder.mkdir(exist_ok=True)
        answer(Path(kit), folder)
    file = folder / "series.csv"
    with file.open(encoding="utf-8", newline="") as stream:
        table = list(csv.reader(stream))
    file.write_text("\n".join(",".join(row) for row in TABLES.get(kind, list)(table)) + "\n", encoding="utf-8")
    for name, content in FILES.get(kind, {}).items():
        (folder / name).write_text(content, encoding="utf-8")
    if kind == "climbing":
        file.rename(folder.parent.parent / "elsewhere.csv")
        file.symlink_to("../../elsewhere.csv")


if __name__ == "__main__":
    main(*sys.argv[1:])
