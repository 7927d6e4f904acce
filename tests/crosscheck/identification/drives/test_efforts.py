"""Efforts of drives: what a motor needs by its rate, load and temperature, and what a sensor behind the gear does not see."""

from __future__ import annotations

from pathlib import Path

import logged_arm
import numpy as np
import pytest
import spoiled_drives

from crosscheck.identification.drives.efforts import (
    compute_drive_effort,
    compute_motor_motion,
    convert_to_motor_efforts,
)
from crosscheck.identification.drives.evidence import Terms, build_terms
from crosscheck.identification.estimation.days import fit_days
from crosscheck.identification.identify import read_machine
from crosscheck.identification.logs.log import Log
from crosscheck.identification.machine import Machine, resolve_value
from crosscheck.identification.parameters import build_space
from crosscheck.identification.readings import compute_readings, make_run
from crosscheck.identification.responses.response import MeasuredMotion
from crosscheck.identification.settings import move_efforts_behind_gears, read_settings
from flexinv.errors import InputError
from flexinv.files.load_mechanism import load_mechanism

ROUNDING = 1e-12  # of numbers near one: the same products in another order
SHOULDER = 'effort = { column = "t1" }'
ELBOW = 'effort = { column = "t2" }'
RATE = np.array([-2.0, -0.5, -0.01, 0.01, 0.3, 1.5])
LOAD = np.array([3.0, -2.0, 1.0, -4.0, 0.0, 5.0])
WARMTH = np.array([0.0, 5.0, -5.0, 10.0, 20.0, 1.0])
VALUES = {
    "rotor inertia": 0.2,
    "viscous friction": 1.5,
    "coulomb friction": 2.0,
    "transition rate": 0.02,
    "stribeck share": 0.4,
    "stribeck rate": 0.3,
    "friction asymmetry": 0.1,
    "quadratic friction": -0.2,
    "load friction": 0.05,
    "viscous friction per kelvin": -0.03,
    "coulomb friction per kelvin": -0.01,
}


def read_arm(folder: Path, text: str = logged_arm.IDENTIFY) -> Machine:
    logged_arm.write_arm(folder)
    (folder / "identify.toml").write_text(text)
    return read_machine(folder)


def test_a_drive_needs_what_its_law_says(tmp_path: Path) -> None:
    machine = read_arm(tmp_path)
    values = {(kind, "elbow"): value for kind, value in VALUES.items()}
    told = compute_drive_effort(machine, "elbow", RATE, 2.0 * RATE, values, LOAD, WARMTH)
    side = np.tanh(RATE / 0.02)
    dry = side * (2.0 * (1.0 + 0.4 * np.exp(-((RATE / 0.3) ** 2))) + 0.05 * np.abs(LOAD))
    viscous = 1.5 * np.exp(-0.03 * WARMTH) * RATE - 0.2 * np.abs(RATE) * RATE
    right = 0.4 * RATE + viscous + np.exp(-0.01 * WARMTH) * dry + 0.1 * np.abs(side)
    assert np.abs(told - right).max() < ROUNDING * np.abs(right).max()


def test_coupled_motors_have_the_power_of_the_joints(tmp_path: Path) -> None:
    """Whatever the factors: efforts of motors times their rates are efforts of joints times theirs."""
    text = logged_arm.IDENTIFY.replace(ELBOW, f"{ELBOW}\nfollows = {{ shoulder = -0.6 }}")
    text = text.replace(SHOULDER, f"{SHOULDER}\nfollows = {{ elbow = 0.2 }}")
    machine = read_arm(tmp_path, text)
    qd = np.random.default_rng(0).normal(size=(5, 2))
    motion = MeasuredMotion(np.arange(5.0), spoiled_drives.JOINTS, qd, qd, qd)
    efforts = np.random.default_rng(1).normal(size=(5, 2))
    motors = np.column_stack([compute_motor_motion(machine, motion, name, {})[0] for name in spoiled_drives.JOINTS])
    power = np.sum(convert_to_motor_efforts(machine, motion, efforts, {}) * motors, axis=1)
    assert np.abs(power - np.sum(efforts * qd, axis=1)).max() < ROUNDING


def _fit_machine(machine: Machine, log: Log) -> Terms:
    return build_terms(*fit_days(machine, [make_run(machine, log)], ["today"], "files"))


def test_a_sensor_behind_the_gear_sees_neither_rotor_nor_friction(tmp_path: Path) -> None:
    """And tells the masses of a log that holds none of them, which a model with known rotors and friction cannot."""
    logged_arm.write_arm(tmp_path)
    log = spoiled_drives.make_log(
        tmp_path,
        lambda q, qd, qdd, load: (
            -np.array([0.3, 0.1]) * qdd - np.array([4.0, 1.0]) * qd - np.array([2.0, 1.0]) * np.tanh(qd / 0.02)
        ),
    )
    mechanism = load_mechanism(tmp_path)
    settings = move_efforts_behind_gears(read_settings(tmp_path, mechanism))
    known = _fit_machine(Machine(mechanism, settings, build_space(mechanism, settings)), log)
    machine = known.machine
    assert {one.kind for one in machine.space.parameters} & set(VALUES) == set()
    assert known.task.runs[0].sliding.all()  # a joint that stands tells its load, too
    spread = 1.0 / known.weights  # of the noise of 0.05 N m the low-pass leaves a sixth, and neighbours agree
    assert max(spread) < 0.05
    motor = 1.0 / _fit_machine(read_machine(tmp_path), log).weights
    assert max(spread) < 0.1 * max(motor)
    assert resolve_value(machine, {}, "rotor inertia", "elbow") == 0.0


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ('effort = { column = "t2", side = "link", unit = "A" }', "a current is the motor's"),
        (f"{ELBOW}\nfollows = {{ sholder = 1 }}", r"follows = \{ shoulder = 1.0 \}"),
        ('effort = { column = "t2", side = "link" }\nfollows = { shoulder = 1 }', "sees one joint"),
    ],
)
def test_what_no_drive_has_is_refused(tmp_path: Path, line: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        read_arm(tmp_path, logged_arm.IDENTIFY.replace(ELBOW, line))


def test_a_rotor_that_the_sensor_does_not_see_is_not_free(tmp_path: Path) -> None:
    text = logged_arm.IDENTIFY.replace(ELBOW, 'effort = { column = "t2", side = "link" }')
    table = '[[free]]\nparameter = "rotor inertia"\nplace = ["elbow"]\nrelative = 0.1\n'
    with pytest.raises(InputError, match='behind the gear, side = "link"'):
        read_arm(tmp_path, text + table)


def test_viscous_friction_is_counted_once(tmp_path: Path) -> None:
    """Free as the damping of its joint it is no friction of the drive, too; free under both names it is refused."""
    damping = '[[free]]\nparameter = "joint damping"\nplace = ["elbow"]\nrelative = 0.5\n'
    both = logged_arm.IDENTIFY + damping
    with pytest.raises(InputError, match="the same friction"):
        read_arm(tmp_path / "both", both)
    without = logged_arm.IDENTIFY.replace('"viscous friction"', '"viscous friction"\nplace = ["shoulder"]')
    log = spoiled_drives.make_log(tmp_path, seconds=1.0)
    readings = []
    for name, text in (("drive", without), ("joint", without + damping)):
        machine = read_arm(tmp_path / name, text)
        run = make_run(machine, log, once=True)
        readings.append(
            compute_readings(machine, run, machine.space.compute_values(np.zeros(len(machine.space.parameters))))
        )
    # The solver follows splines of its own, whose accelerations differ at the ends of the log alone.
    one, other = (told[50:-50] for told in readings)
    assert np.abs(one - other).max() < 1e-3 * np.ptp(one)
