"""Runs of ``crosscheck run``: one mechanism and all of them, with nothing kept, and again when nothing has changed."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from time import perf_counter
from typing import Any

from benchmarks.targets import add_verdict, make_metric

ONE = "four_bar"
TEXT = """A run in processes of its own: nothing is kept the first time; the second time nothing has changed, so that every result
is taken from the first. Processor time is that of all its processes; machine code of kernels is there before."""
COLUMNS = (
    ("what", "what", ""),
    ("when", "when", ""),
    ("processor", "processor time", "s"),
    ("wall", "time", "s"),
    ("message", "words", ""),
)


def run_study(
    models: str, whole: bool = True, names: tuple[str, ...] = (ONE,), engines: tuple[str, ...] = ()
) -> dict[str, Any]:
    """Return the table of runs of ``names``, and with ``whole`` of everything in ``models``: processor time and time [s].

    engines : those that run; none: all of them
    """
    rows = []
    for what, chosen in ((" ".join(names), tuple(names)), *((("everything", ()),) if whole else ())):
        with tempfile.TemporaryDirectory(prefix="crosscheck-bench-") as folder:
            for when in ("nothing kept", "unchanged"):
                rows.append(_make_row(what, when, run_timed_command(chosen, Path(models), Path(folder), engines)))
    return {"text": TEXT, "columns": COLUMNS, "rows": rows}


def run_timed_command(
    names: tuple[str, ...], models: Path, folder: Path, engines: tuple[str, ...] = ()
) -> tuple[float, float, str]:
    """Run ``crosscheck run`` and return processor time and time [s], and its last words where it failed.

    folder : of its report and of what it keeps; engines : those that run, none: all of them
    """
    command = [sys.executable, "-m", "crosscheck", "run", *names, "--models", str(models), "--out", str(folder / "out")]
    command += ["--engines", ",".join(engines)] if engines else []
    before = _read_children_time()
    start = perf_counter()
    done = subprocess.run(
        command, env=make_environment(folder / "kept"), cwd=models.parent, capture_output=True, text=True, check=False
    )
    wall = perf_counter() - start
    words = done.stderr.strip().rsplit("\n", 1)[-1] if done.returncode > 1 else ""
    return _read_children_time() - before, wall, words


def make_environment(kept: Path) -> dict[str, str]:
    """Return the environment of a run whose answers are kept in a folder of its own."""
    return {name: value for name, value in os.environ.items() if name != "CI"} | {"CROSSCHECK_KEPT": str(kept)}


def _read_children_time() -> float:
    """Return the processor time of all processes that were started here and have ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _make_row(what: str, when: str, measured: tuple[float, float, str]) -> Mapping[str, Any]:
    processor, wall, words = measured
    row = {"what": what, "when": when, "processor": processor, "wall": wall, "message": words}
    if words:
        return {**row, "verdict": "error"}
    return add_verdict(
        {**row, "metric": make_metric(f"crosscheck run, {what}, {when}: processor time", processor, "s")}
    )
