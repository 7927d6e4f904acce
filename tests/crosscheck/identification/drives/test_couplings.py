"""Coupled motors: a motor that follows a second joint is found in the log, and written as a coupling that loads."""

from __future__ import annotations

from pathlib import Path

import logged_arm
import numpy as np
import spoiled_drives

from crosscheck.identification.drives.couplings import find_couplings
from crosscheck.identification.identified_file import write_identified
from crosscheck.identification.identify import Identification, identify
from crosscheck.identification.logs.log import Log
from crosscheck.identification.machine import Machine
from crosscheck.identification.parameters import ParameterSpace
from crosscheck.identification.readings import compute_readings, make_run
from crosscheck.identification.settings import IdentifyTable, read_settings
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

FACTOR = -0.5
TRUTH = {"rotor": 0.1, "viscous": 1.0, "dry": 1.0}  # of the elbow's drive [kg m^2], [N m s/rad], [N m]
ELBOW = 'effort = { column = "t2" }'
FOLLOWS = f"{ELBOW}\nfollows = {{ shoulder = {FACTOR} }}"
FREE = '[[free]]\nparameter = "motor coupling"\nerror = 0.2\n'
EDGE = 50  # samples at the ends, where splines of angles and of their sums differ in the accelerations
MARCH = 1e-4  # of a torque's range: the solver follows the coupling by splines between samples


def couple(q: Array, qd: Array, qdd: Array, load: Array) -> Array:
    """Return what changes where the elbow's motor turns by q2 + c q1: its own law, and c times its load at the shoulder."""

    def need(rate: Array, acceleration: Array) -> Array:
        return TRUTH["rotor"] * acceleration + TRUTH["viscous"] * rate + TRUTH["dry"] * np.tanh(rate / 0.02)

    motor = need(qd[:, 1] + FACTOR * qd[:, 0], qdd[:, 1] + FACTOR * qdd[:, 0]) - need(qd[:, 1], qdd[:, 1])
    return np.column_stack([-FACTOR * load[:, 1], motor])


def make_coupled_log(folder: Path) -> Log:
    return spoiled_drives.make_log(folder, couple)


def test_a_motor_that_follows_two_joints_is_found(tmp_path: Path) -> None:
    (one,) = find_couplings(spoiled_drives.fit_log(tmp_path, make_coupled_log(tmp_path)))
    assert (one.joint, one.other) == ("elbow", "shoulder")
    assert one.low < FACTOR < one.high
    assert abs(one.factor - FACTOR) < 0.02
    assert "follows = { shoulder = -0." in one.words


def test_no_coupling_is_found_where_there_is_none(tmp_path: Path) -> None:
    assert find_couplings(spoiled_drives.fit_log(tmp_path, spoiled_drives.make_log(tmp_path))) == []


def identify_coupled(folder: Path) -> tuple[Identification, Log]:
    logged_arm.write_arm(folder)
    log = make_coupled_log(folder)
    (folder / "identify.toml").write_text(logged_arm.IDENTIFY.replace(ELBOW, FOLLOWS) + FREE)
    return identify(folder, [log]), log


def test_it_is_told_where_identify_toml_states_it_and_written_as_a_coupling(tmp_path: Path) -> None:
    """What is loaded reads at its motors, along their own angles, as the run has told; offsets are no part of a mechanism."""
    found, log = identify_coupled(tmp_path)
    (row,) = [row for row in found.parameters if row.parameter == "motor coupling"]
    assert row.low < FACTOR < row.high
    assert row.identifiable
    write_identified(found, tmp_path / "mechanism.toml", tmp_path / "identified.toml")
    loaded = load_mechanism(tmp_path / "identified.toml")
    (closure,) = loaded.closures
    assert dict(closure.factors) == {"elbow_motor": 1.0, "elbow": -1.0, "shoulder": -row.value}
    turned = log.columns["q2"] + row.value * log.columns["q1"]
    motors = Log("motors", log.time, {**log.columns, "q2": turned})
    other = Machine(loaded, read_motor_settings(tmp_path, loaded, float(log.columns["q2"][0])), ParameterSpace((), {}))
    values = found.machine.space.compute_values(found.fit.z)
    values |= {("effort offset", name): 0.0 for name in spoiled_drives.JOINTS}
    told = compute_readings(found.machine, found.task.runs[0], values)[EDGE:-EDGE]
    read = compute_readings(other, make_run(other, motors, once=True), {})[EDGE:-EDGE]
    assert np.abs(read - told).max() < MARCH * np.ptp(told)


def read_motor_settings(folder: Path, loaded: Mechanism, start: float) -> IdentifyTable:
    """Return the settings of the arm whose elbow is moved by a motor of its own; start : of the elbow [rad]."""
    text = logged_arm.IDENTIFY.replace("joints.elbow", "joints.elbow_motor").partition("[[free]]")[0]
    tables = '[[free]]\nparameter = "effort offset"\nerror = 1.0\n'
    file = folder / "motors" / "identify.toml"
    file.parent.mkdir()
    file.write_text(f"start.elbow = {{ rad = {start!r} }}\n{text}{tables}")
    return read_settings(file, loaded)
