"""FMUs as engines: one compiled here from C gives the torques of the double pendulum; what is no inverse dynamics is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pendulum_fmu
import pytest

import flexinv
from crosscheck.doors.fmu import open_adapter
from crosscheck.doors.registry import FMU
from crosscheck.engines import ENGINES, Engine
from crosscheck.measures.record import Record
from crosscheck.run.isolation import ChildProcesses, run_engine
from crosscheck.verdicts.plan import Task, discover
from flexinv.errors import InputError

pytestmark = [
    pytest.mark.skipif(bool(pendulum_fmu.why_not()), reason=pendulum_fmu.why_not() or "nothing is missing"),
    pytest.mark.slow,
]

MARCHED = 1e-9  # of the range: one rounding of a position, marched on


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


@pytest.mark.parametrize(
    ("case", "fmi", "words"),
    [
        ("flex_two_link/opposed", "3.0", {"step": 1e-3}),
        ("flex_two_link/opposed", "2.0", {"step": 5e-4}),
        ("rigid_3r/quintic", "3.0", {}),
        ("four_bar", "2.0", {}),
        ("two_arms", "3.0", {}),  # whose closures come and go
    ],
)
def test_what_flexinv_exports_goes_through_this_door(
    root: Path, tmp_path: Path, case: str, fmi: str, words: dict[str, Any]
) -> None:
    """An arm that bends marches by the step of its FMU, loops take the motion of all joints: the torques of our own engine.

    `flexinv.solve` and the steps of a controller have one error of the step, and differ in rounding.
    """
    exported = discover(root / "models", [case]).tasks[0]
    file = flexinv.export_fmu(exported.mechanism, tmp_path / "x.fmu", fmi=fmi, **words)
    m = exported.mechanism
    record = open_adapter("plant", str(exported.folder), {"fmu": str(file)}).run(m, exported.case, "plant", {})
    every = round(exported.case.sample / words.get("step", exported.case.step))
    time = exported.case.sample / every * np.arange(every * (len(record.time) - 1) + 1)
    expected = flexinv.solve(
        m, exported.case.motion, float(time[1]), end=exported.case.end, start=exported.case.start
    ).torque[::every]
    names = [n for n, driven in zip(m.velocity_names, m.actuated, strict=True) if driven]
    result = np.stack([record.series[f"torque/{name}"].values for name in names], axis=1)
    np.testing.assert_allclose(result, expected, rtol=0, atol=MARCHED * np.ptp(expected))


def test_a_march_of_another_step_is_refused(root: Path, tmp_path: Path) -> None:
    exported = discover(root / "models", ["flex_two_link/opposed"]).tasks[0]
    file = flexinv.export_fmu(exported.mechanism, tmp_path / "x.fmu", step=0.7 * exported.case.sample)
    plant = open_adapter("plant", str(exported.folder), {"fmu": str(file)})
    with pytest.raises(InputError, match=r"samples of the case are \S+ s apart; export it with --step"):
        plant.run(exported.mechanism, exported.case, "plant", {})


def test_what_is_no_fmu_is_refused(task: Task, tmp_path: Path) -> None:
    (tmp_path / "x.fmu").write_text("not a zip file")
    engine = Engine("plant", FMU, "fmpy", "", settings={"fmu": str(tmp_path / "x.fmu"), "cases": ["*"]})
    job = {"mechanism": str(task.folder), "case": task.case.name, "options": {}}
    record = run_engine(engine, job, task.time, 60.0, ChildProcesses()).record
    assert "x.fmu is no FMU" in record.message
