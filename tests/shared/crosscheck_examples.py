"""A small folder of models for the tests of crosscheck: real mechanisms, short cases."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest
import rogue_engines as rogue

from crosscheck.engines import ENGINES, Engine
from crosscheck.report.write_report import render
from crosscheck.run.runner import run
from crosscheck.run.work import Event, Options, Work
from crosscheck.studies import Study
from crosscheck.verdicts.plan import discover
from crosscheck.verdicts.results import Results

WICKED = "<img src=x onerror=alert(1)>"
CASES = """
source = "an example of the tests"

[cases.swing]
title = "Both rods swing half a turn, then rest"
step_s = 5e-3
quantities = ["torque", "tip", "wrench"]

[cases.swing.motion]
duration_s = 0.5
hold_s = 0.25
joints.pivot = { from_deg = 0, to_deg = 90 }
joints.knee = { from_deg = 0, to_deg = -45 }

[[limits]]
quantity = "torque"
engines = ["*"]
maximum = 1e-12
reason = "closed formulas on both sides: rounding of two links stays below 1e-14"

[[limits]]
quantity = "tip"
engines = ["*"]
maximum = 1e-12
reason = "as for the torque"

[[limits]]
quantity = "wrench"
engines = ["*"]
maximum = 1e-12
reason = "as for the torque"
"""


def stopping(at: int) -> Callable[[Event], None]:
    """Return a notification that is Ctrl-C once so many jobs are done."""

    def notify(event: Event) -> None:
        if event.done == at:
            raise KeyboardInterrupt

    return notify


def write_models(models: Path, root: Path, name: str = "double_pendulum") -> Path:
    """Write the double pendulum with one short case below ``models`` and return its folder."""
    folder = models / name
    folder.mkdir(parents=True)
    shutil.copy(root / "models" / "double_pendulum" / "mechanism.toml", folder)
    (folder / "cases.toml").write_text(CASES)
    return folder


def example_run(
    models: Path, out: Path, engines: dict[str, Engine], studies: tuple[Study, ...] = (), timeout: float = 60.0
) -> Results:
    """Run everything in ``models`` for real, render the report and return the results."""
    results = run(Work(discover(models), engines, studies, Options(timeout=timeout)), out)
    render(results, out)
    return results


@dataclass(frozen=True)
class Night:
    """A run in which much went wrong: its results and its folder."""

    results: Results
    out: Path


@cache
def night_run(root: Path, base: Path) -> Night:
    """A real run, made once: two sound engines, three rogues, a missing one; a wicked name, a broken model, two studies.

    base : a temporary folder for the whole session
    """
    folder = base / "night"
    write_models(folder / "models", root, WICKED)
    (folder / "models" / "broken").mkdir()
    (folder / "models" / "broken" / "mechanism.toml").write_text("links = [")
    engines = {name: ENGINES[name] for name in ("flexinv", "pinocchio")}
    engines |= {kind: rogue.engine(kind) for kind in ("fine", "killed", "nan")}
    engines["absent"] = Engine("absent", "rogue_engines", "no_such_package", "python -m pip install no-such-package")
    studies = tuple(
        Study(name, f"The {name} study", "rogue_engines", function, {"models": ""})
        for name, function in (("rogue", "study"), ("sad", "no_study"))
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(Path(rogue.__file__).parent))
        results = example_run(folder / "models", folder / "out", engines, studies)
    return Night(results, folder / "out")
