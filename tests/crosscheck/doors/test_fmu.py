"""FMUs as engines: one compiled here from C gives the torques of the double pendulum; what is no inverse dynamics is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pendulum_fmu
import pytest

from crosscheck.doors.registry import FMU
from crosscheck.engines import ENGINES, Engine
from crosscheck.measures.record import Record
from crosscheck.run.isolation import ChildProcesses, run_engine
from crosscheck.verdicts.plan import Task, discover

pytestmark = [
    pytest.mark.skipif(bool(pendulum_fmu.why_not()), reason=pendulum_fmu.why_not() or "nothing is missing"),
    pytest.mark.slow,
]


@pytest.fixture(scope="module")
def task(root: Path) -> Task:
    return discover(root / "models", ["double_pendulum/swing"]).tasks[0]


def answer(task: Task, folder: Path, flags: tuple[str, ...] = (), **words: Any) -> Record:
    file = pendulum_fmu.build(folder, flags, **words)
    engine = Engine("plant", FMU, "fmpy", "python -m pip install fmpy", settings={"fmu": str(file), "cases": ["*"]})
    job = {"mechanism": str(task.folder), "case": task.case.name, "options": {}}
    return run_engine(engine, job, task.time, 60.0, ChildProcesses()).record


@pytest.mark.parametrize(
    ("flags", "kinds", "steps"),
    [
        ((), ("ModelExchange", "CoSimulation"), 0),
        ((), ("CoSimulation",), 0),
        (("-DLATE",), ("CoSimulation",), 1),  # the lag is measured, not assumed
    ],
)
def test_an_fmu_gives_the_torques(
    task: Task, tmp_path: Path, flags: tuple[str, ...], kinds: tuple[str, ...], steps: int
) -> None:
    record = answer(task, tmp_path, flags, kinds=kinds)
    assert record.status == "ok", record.message
    job = {"mechanism": str(task.folder), "case": task.case.name, "options": {}}
    ours = run_engine(ENGINES["flexinv"], job, task.time, 60.0, ChildProcesses()).record
    for name in ("torque/pivot", "torque/knee"):
        np.testing.assert_allclose(record.series[name].values, ours.series[name].values, rtol=0, atol=1e-13)
    assert record.settings["steps until it answers"] == steps
    assert record.version == "1.2"


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ({"tau_unit": "N"}, "the FMU's 'pivot.tau' is in N, expected N.m"),
        ({"states": True}, "has 1 states; expected a function of its inputs"),
        ({"names": ("a", "b", "c", "d", "e", "f")}, "the FMU has no input 'pivot.q'; it has a, b, c, d, e, f"),
    ],
)
def test_what_is_no_inverse_dynamics_is_refused(
    task: Task, tmp_path: Path, words: dict[str, Any], complaint: str
) -> None:
    record = answer(task, tmp_path, **words)
    assert record.status == "error"
    assert complaint in record.message


def test_what_is_no_fmu_is_refused(task: Task, tmp_path: Path) -> None:
    (tmp_path / "x.fmu").write_text("not a zip file")
    engine = Engine("plant", FMU, "fmpy", "", settings={"fmu": str(tmp_path / "x.fmu"), "cases": ["*"]})
    job = {"mechanism": str(task.folder), "case": task.case.name, "options": {}}
    record = run_engine(engine, job, task.time, 60.0, ChildProcesses()).record
    assert "x.fmu is no FMU" in record.message
