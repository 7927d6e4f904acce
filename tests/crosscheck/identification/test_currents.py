"""Currents without a torque constant that somebody knows: compared in ampere, whatever constant was written."""

from __future__ import annotations

from pathlib import Path

import logged_arm
import numpy as np
import pytest

from crosscheck.identification.bands import Margins, Prediction, Scatter, predict
from crosscheck.identification.estimation.fit import Fit
from crosscheck.identification.files import write_prediction
from crosscheck.identification.identify import read_machine
from crosscheck.identification.logs.log import Log
from crosscheck.identification.machine import Machine
from crosscheck.identification.readings import Run, compute_readings, make_run

ROUNDING = 1e-12  # of a reading's range: the same products in another order
CONSTANT = 9.0  # [N m/A]
IN_NM = np.array([1.0, CONSTANT])  # of shoulder and elbow [N m per unit of the channel]
WIDE = 2.5  # of the gain's prior, as a proposed identify.toml has it
GAIN = f'[[free]]\nparameter = "effort gain"\nplace = ["elbow"]\nrelative = {WIDE}\n'
SETTINGS = logged_arm.IDENTIFY.replace(
    'effort = { column = "t2" }', 'effort = { column = "t2", unit = "A", constant_Nm_per_A = 9.0 }'
)


def read(folder: Path, text: str) -> Machine:
    logged_arm.write_arm(folder)
    (folder / "identify.toml").write_text(text)
    return read_machine(folder)


@pytest.fixture
def log() -> Log:
    time = 0.004 * np.arange(250)
    swing = (1.0 - np.cos(4.0 * time)) * np.array([[0.5], [0.4]])
    return Log("log", time, {"q1": swing[0], "q2": swing[1], "t1": np.sin(time), "t2": np.cos(time)})


def prior(machine: Machine) -> dict[tuple[str, str], float]:
    return machine.space.compute_values(np.zeros(len(machine.space.parameters)))


def predict_halved(machine: Machine, run: Run) -> Prediction:
    """Return the prediction of a run with gains of half their prior, where all that remains is what friction scatters."""
    halved = [np.log(0.5) / WIDE if one.kind == "effort gain" else 0.0 for one in machine.space.parameters]
    none = np.zeros(0)
    found = Fit(np.array(halved), np.eye(len(halved)), none, none, 1.0, none, (), ())
    return predict(machine, found, Margins(np.ones(2), (Scatter(0.0), Scatter(0.0))), run)


def test_a_current_whose_gain_is_free_is_in_ampere(tmp_path: Path, log: Log) -> None:
    """And its readings are those in N m, over the constant that was written; a joint beside it stays in N m."""
    known = read(tmp_path / "known", SETTINGS)
    free = read(tmp_path / "free", SETTINGS + GAIN)
    assert [channel.unit for channel in known.channels] == ["N m", "N m"]
    assert [channel.unit for channel in free.channels] == ["N m", "A"]
    runs = [make_run(machine, log) for machine in (known, free)]
    one, other = (run.measured for run in runs)
    assert one is not None
    assert other is not None
    assert np.abs(other * IN_NM - one).max() <= ROUNDING * np.ptp(one)
    moved = {("effort offset", "elbow"): 0.3, ("coulomb friction", "elbow"): 0.7}
    one, other = (
        compute_readings(machine, run, prior(machine) | moved) for machine, run in zip((known, free), runs, strict=True)
    )
    assert np.abs(other * IN_NM - one).max() <= ROUNDING * np.ptp(one)


def test_friction_between_runs_scatters_by_as_many_ampere(tmp_path: Path, log: Log) -> None:
    """A constant of 9 N m/A makes a ninth of it, and a gain of half its prior the half of that."""
    known, free = read(tmp_path / "known", SETTINGS), read(tmp_path / "free", SETTINGS + GAIN)
    one, other = (predict_halved(machine, make_run(machine, log)) for machine in (known, free))
    assert np.abs(other.residual * IN_NM * [1.0, 2.0] - one.residual).max() <= ROUNDING * np.ptp(one.residual)
    write_prediction(free, other, tmp_path / "prediction.csv")
    head = (tmp_path / "prediction.csv").read_text().splitlines()[0]
    assert head.endswith("torque/shoulder high [N m],torque/elbow [A],torque/elbow low [A],torque/elbow high [A]")
