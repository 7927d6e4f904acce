"""Headers as labs write them: which column is what of which joint, and what is doubtful about it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from crosscheck.identification.logs.header import match_joint_columns
from crosscheck.identification.logs.log import read_log
from flexinv.errors import InputError
from flexinv.files.header_words import find_time_column, find_time_unit
from flexinv.model.mechanism import Joint

FEW = np.linspace(0.0, 1.0, 5)


def joints(*names: str) -> list[Joint]:
    links = ["world", *(f"link {name}" for name in names)]
    return [Joint(name, "revolute", links[k], links[k + 1]) for k, name in enumerate(names)]


def chosen(names: list[str], header: list[str], kind: str = "angle") -> list[str]:
    joint_columns = match_joint_columns(joints(*names), dict.fromkeys(header, FEW))
    return [joint_columns[name][kind].name if kind in joint_columns.get(name, {}) else "" for name in names]


@pytest.mark.parametrize(
    ("names", "header", "angles", "efforts"),
    [
        (["a", "b"], ["q1", "tau1", "q2", "tau2"], ["q1", "q2"], ["tau1", "tau2"]),
        (["a", "b"], ["q0", "q1", "i0", "i1"], ["q0", "q1"], ["i0", "i1"]),
        (
            ["joint1", "joint2"],
            ["actual_q_0", "actual_q_1", "actual_qd_0", "target_q_0", "actual_current_0", "actual_current_1"],
            ["actual_q_0", "actual_q_1"],
            ["actual_current_0", "actual_current_1"],
        ),
        (
            ["panda_joint1", "panda_joint2"],
            ["q[0]", "q[1]", "q_d[0]", "q_d[1]", "dq[0]", "dq[1]", "tau_J[0]", "tau_J[1]", "tau_J_d[0]", "tau_J_d[1]"],
            ["q[0]", "q[1]"],
            ["tau_J[0]", "tau_J[1]"],
        ),
        (
            ["shoulder_pan_joint", "shoulder_lift_joint"],
            ["shoulder lift pos (deg)", "shoulder_pan_pos [deg]", "shoulder_pan_effort", "shoulder_lift_effort"],
            ["shoulder_pan_pos [deg]", "shoulder lift pos (deg)"],
            ["shoulder_pan_effort", "shoulder_lift_effort"],
        ),
        (
            ["pedestal", "wrist"],
            ["pedestal_pos_deg", "wrist_pos_deg", "pedestal_torque_Nm", "wrist_torque_Nm"],
            ["pedestal_pos_deg", "wrist_pos_deg"],
            ["pedestal_torque_Nm", "wrist_torque_Nm"],
        ),
        (
            [f"joint{k}" for k in (1, 10)],
            ["joint10_position", "joint1_position", "joint10_effort", "joint1_effort"],
            ["joint1_position", "joint10_position"],
            ["joint1_effort", "joint10_effort"],
        ),
    ],
)
def test_columns_of_many_labs(names: list[str], header: list[str], angles: list[str], efforts: list[str]) -> None:
    assert chosen(names, header) == angles
    assert chosen(names, header, "effort") == efforts


def test_what_a_header_leaves_open_is_said() -> None:
    wide = {"q1": np.array([0.0, 118.0]), "q2": np.array([0.0, 1.0])}
    joint_columns = match_joint_columns(joints("base", "tip"), wide | {"tau1_Nm": FEW, "i1_A": FEW})
    assert joint_columns["base"]["angle"].unit == "deg"
    assert joint_columns["base"]["angle"].why == "the header names no unit and it reaches 118: is it deg?"
    assert joint_columns["tip"]["angle"].unit == "rad"
    assert joint_columns["base"]["effort"].name == "tau1_Nm"
    assert joint_columns["base"]["effort"].why == "or is it i1_A?"
    assert match_joint_columns(joints("a"), {"pressure_bar": FEW}) == {}


def test_units_of_times() -> None:
    assert find_time_column(["q1", "t_ms"]) == "t_ms"
    assert find_time_column(["t1", "t2"]) == "time_s"  # torques
    assert find_time_unit("t_ms", 4.0) == ("ms", "")
    assert find_time_unit("Time [s]", 0.004) == ("s", "")
    unit, why = find_time_unit("Timestamp", 4.0)
    assert (unit, why) == ("ms", "the header names no unit, and steps of 4 s would be slow: is it ms?")


def test_semicolons_decimal_commas_and_milliseconds_are_read(tmp_path: Path) -> None:
    rows = "\n".join(f"{4 * k};{k / 8:.3f}".replace(".", ",") for k in range(30))
    (tmp_path / "log.csv").write_text(f'\ufeff"t [ms]";"q1, measured"\n{rows}\n', encoding="utf-8")
    log = read_log(tmp_path / "log.csv", "t [ms]", "ms")
    assert log.spacing == pytest.approx(0.004, rel=1e-9)
    assert log.read_column("q1, measured")[3] == 0.375
    (tmp_path / "latin.csv").write_bytes("t;Pos [°]\n".encode("latin-1"))
    with pytest.raises(InputError, match="save it as UTF-8"):
        read_log(tmp_path / "latin.csv", "t")
