"""A small folder of models for the tests of crosscheck: real mechanisms, short cases."""

from __future__ import annotations

import shutil
from pathlib import Path

from crosscheck.engines import ENGINES, Engine
from crosscheck.plan import Plan, discover
from crosscheck.results import Results
from crosscheck.runner import Options, run
from crosscheck.studies import Study

QUICK = Options(timeout=60.0)
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


def write_models(models: Path, root: Path, name: str = "double_pendulum") -> Path:
    """Write the double pendulum with one short case below ``models`` and return its folder."""
    folder = models / name
    folder.mkdir(parents=True)
    shutil.copy(root / "models" / "double_pendulum" / "mechanism.toml", folder)
    (folder / "cases.toml").write_text(CASES)
    return folder


def example_run(
    models: Path,
    out: Path,
    engines: dict[str, Engine] | tuple[str, ...] = ("flexinv", "pinocchio"),
    studies: tuple[Study, ...] = (),
    options: Options = QUICK,
) -> Results:
    """Run everything in ``models`` for real and return the results."""
    plan: Plan = discover(models)
    chosen = engines if isinstance(engines, dict) else {name: ENGINES[name] for name in engines}
    return run(plan, chosen, studies, options, out)
