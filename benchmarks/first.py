"""The first torque of a fresh process: with nothing compiled, and with machine code that an earlier process has kept."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.targets import add_verdict, make_metric

# Model, and what the first torque of a cold start is asked to take at most: processor time [s] of all processes.
MECHANISMS = {
    "flex_one_link": 15.0,
    "four_bar_flexible": 30.0,
    "spatial_arm": 30.0,
    "four_bar": None,
    "rigid_3r": None,
}
IMPORT = 0.1  # [s] for `import flexinv`
WARM = 1.5  # [s] by the clock, of a process whose machine code is there
STARTS = 3  # warm processes; the fastest counts, as starting is what the system does, too

TEXT = f"""A fresh process imports flexinv, reads a mechanism and solves its first case. Cold: nothing is kept, not even by other
parts of flexinv, and the processor time of all processes counts. Warm: the same once more; the fastest of {STARTS}, and its
time by the clock. Where a wheel brought machine code along, cold is as warm."""
COLUMNS = (
    ("what", "mechanism", ""),
    ("start", "start", ""),
    ("processor", "processor time", "s"),
    ("clock", "by the clock", "s"),
    ("asked", "at most", "s"),
)
PROGRAM = """
import json, sys
from resource import RUSAGE_CHILDREN, RUSAGE_SELF, getrusage
from time import perf_counter
start = perf_counter()
import flexinv
imported = perf_counter()
robot = flexinv.load_mechanism(sys.argv[1])
case = next(iter(flexinv.load_cases(sys.argv[1], robot).values()))
flexinv.solve(robot, case.motion, step=case.step, start=case.start, initial=case.initial)
used = [getrusage(who) for who in (RUSAGE_SELF, RUSAGE_CHILDREN)]
print(json.dumps([imported - start, sum(u.ru_utime + u.ru_stime for u in used), perf_counter() - start]))
"""


def run_study(models: str, names: list[str] | None = None) -> dict[str, Any]:
    """Return the table of first torques [s]."""
    rows: list[dict[str, Any]] = []
    imports = []
    for name in names or MECHANISMS:
        cold, *warm = _run_starts(Path(models).resolve() / name)
        best = min(warm, key=lambda one: one[2])
        imports += [one[0] for one in warm]
        rows.append(_make_row(name, "cold", cold, cold[1], MECHANISMS[name]))
        rows.append(_make_row(name, "warm", best, best[2], WARM))
    seen = make_metric("import flexinv", min(imports), "s", upper=IMPORT)
    rows.append(add_verdict({"what": "import flexinv", "clock": min(imports), "asked": IMPORT, "metric": seen}))
    return {"text": TEXT, "columns": COLUMNS, "rows": rows}


def _run_starts(model: Path) -> list[list[float]]:
    """Seconds of import, processor and clock of one cold start and of some that find what it has kept."""
    command = [sys.executable, "-c", PROGRAM, str(model)]
    with TemporaryDirectory() as kept:
        asked = {**os.environ, "NUMBA_CACHE_DIR": kept}
        root = Path(__file__).parents[2]
        return [
            json.loads(subprocess.run(command, env=asked, cwd=root, capture_output=True, text=True, check=True).stdout)
            for _ in range(1 + STARTS)
        ]


def _make_row(name: str, start: str, found: list[float], value: float, asked: float | None) -> dict[str, Any]:
    """A row with its target: processor time of a cold start, the clock of a warm one."""
    row = {"what": name, "start": start, "processor": found[1], "clock": found[2]}
    own = make_metric(f"{name}: first torque, {start}", value, "s", upper=asked)
    return add_verdict(row | {"asked": asked, "metric": own})
