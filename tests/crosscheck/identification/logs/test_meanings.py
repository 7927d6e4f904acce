"""What a column is, by its name as makers write it, else by its numbers; and what is doubtful about it."""

from __future__ import annotations

import tomllib
from pathlib import Path

import logged_arm
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from crosscheck.cli import Main
from crosscheck.identification.logs.log import Log, read_columns, read_log
from crosscheck.identification.logs.meanings import choose_time_column, find_meanings
from crosscheck.identification.propose import format_identify_toml
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Joint, Limits, Mechanism

# Maker: joints; header with {} for the number or the letter; which of it are time, angle and effort.
HEADERS = {
    "Universal Robots": (
        "j1 j2",
        "timestamp; target_q_0; target_q_1; actual_q_0; actual_q_1; actual_qd_0; actual_qd_1; actual_current_0; "
        "actual_current_1; target_moment_0; target_moment_1; joint_temperatures_0; joint_temperatures_1",
        "timestamp; actual_q_0; actual_q_1; actual_current_0; actual_current_1",
    ),
    "Franka": (
        "j1 j2",
        "time; q[0]; q[1]; q_d[0]; q_d[1]; dq[0]; dq[1]; tau_J[0]; tau_J[1]; tau_ext_hat_filtered[0]; tau_ext_hat_filtered[1]",
        "time; q[0]; q[1]; tau_J[0]; tau_J[1]",
    ),
    "KUKA": (
        "A1 A2",
        "Tick; $AXIS_ACT.A1; $AXIS_ACT.A2; $VEL_AXIS_ACT[1]; $VEL_AXIS_ACT[2]; $TORQUE_AXIS_ACT[1]; $TORQUE_AXIS_ACT[2]",
        "Tick; $AXIS_ACT.A1; $AXIS_ACT.A2; $TORQUE_AXIS_ACT[1]; $TORQUE_AXIS_ACT[2]",
    ),
    "ROS": (
        "shoulder elbow",
        "header.stamp; position[0]; position[1]; velocity[0]; velocity[1]; effort[0]; effort[1]",
        "header.stamp; position[0]; position[1]; effort[0]; effort[1]",
    ),
    "German": (
        "axis1 axis2",
        "Zeit [ms]; Achse1_Soll [°]; Achse1_Ist [°]; Achse1_Geschw [°/s]; Achse1_Strom [A]; Achse1_Temp [°C]; Achse2_Soll [°]; "
        "Achse2_Ist [°]; Achse2_Geschw [°/s]; Achse2_Strom [A]; Achse2_Temp [°C]",
        "Zeit [ms]; Achse1_Ist [°]; Achse2_Ist [°]; Achse1_Strom [A]; Achse2_Strom [A]",
    ),
    "Japanese": (
        "axis1 axis2",
        "時間[s]; 軸1角度[deg]; 軸2角度[deg]; 軸1速度[deg/s]; 軸1トルク[Nm]; 軸2トルク[Nm]; 軸1温度[℃]; 軸2温度[℃]",
        "時間[s]; 軸1角度[deg]; 軸2角度[deg]; 軸1トルク[Nm]; 軸2トルク[Nm]",
    ),
    "Chinese": (
        "axis1 axis2",
        "时间; 关节1位置; 关节2位置; 关节1速度; 关节2速度; 关节1力矩; 关节2力矩; 关节1目标; 关节2目标",
        "时间; 关节1位置; 关节2位置; 关节1力矩; 关节2力矩",
    ),
    "French": (
        "a b",
        "temps_s; angle_axe1_deg; angle_axe2_deg; vitesse_axe1_deg_per_s; vitesse_axe2_deg_per_s; couple_axe1_Nm; couple_axe2_Nm",
        "temps_s; angle_axe1_deg; angle_axe2_deg; couple_axe1_Nm; couple_axe2_Nm",
    ),
    "ABB": (
        "j1 j2",
        "Time; J1 Position (deg); J1 Speed (deg/s); J1 Torque (Nm); J2 Position (deg); J2 Speed (deg/s); J2 Torque (Nm)",
        "Time; J1 Position (deg); J2 Position (deg); J1 Torque (Nm); J2 Torque (Nm)",
    ),
    "Beckhoff": (
        "a b",
        "Time (ms); Axis[1].ActPos; Axis[2].ActPos; Axis[1].SetPos; Axis[2].SetPos; Axis[1].ActVelo; Axis[2].ActVelo; "
        "Axis[1].ActTorque; Axis[2].ActTorque",
        "Time (ms); Axis[1].ActPos; Axis[2].ActPos; Axis[1].ActTorque; Axis[2].ActTorque",
    ),
    "Dynamixel": (
        "a b",
        "clock; present_position_1; present_position_2; present_velocity_1; present_velocity_2; present_current_1; "
        "present_current_2; goal_position_1; goal_position_2; present_temperature_1; present_temperature_2",
        "clock; present_position_1; present_position_2; present_current_1; present_current_2",
    ),
    "Fanuc": (
        "a b",
        "Tick; J1 ang; J2 ang; J1 curr; J2 curr; J1 temp; J2 temp",
        "Tick; J1 ang; J2 ang; J1 curr; J2 curr",
    ),
}


def joints(names: str) -> list[Joint]:
    links = ["world", *(f"link {name}" for name in names.split())]
    return [Joint(name, "revolute", links[k], links[k + 1]) for k, name in enumerate(names.split())]


def build_log(header: list[str], seed: int = 0) -> Log:
    """A log of noise: only names can tell what its columns are."""
    random = np.random.default_rng(seed)
    time = 0.01 * np.arange(60)
    return Log("log.csv", time, {name: random.normal(size=60) for name in header})


@pytest.mark.parametrize("maker", HEADERS)
@pytest.mark.parametrize("order", [1, -1])
def test_headers_of_makers(maker: str, order: int) -> None:
    """In whatever order the columns stand; currents are ampere, though no unit says so."""
    names, header, expected = (text.split("; ") for text in HEADERS[maker])
    time, *wanted = expected
    log = build_log(header)
    assert choose_time_column(log.columns) == (time, "")
    found, told = find_meanings(joints(names[0]), Log("", log.time, dict(list(log.columns.items())[::order])))
    assert [own[kind].name for kind in ("angle", "effort") for own in sorted(found.values(), key=str)] == wanted
    units = {own["effort"].unit for own in found.values()}
    assert units == ({"A"} if any(word in wanted[-1].lower() for word in ("curr", "strom")) else {"N m"})
    assert len(told) == len(header)


# ------------------------------------------------------------------------------------------------------ without any names


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> tuple[Mechanism, pd.DataFrame]:
    base = logged_arm.write_arm(tmp_path_factory.mktemp("models") / "arm")
    table = logged_arm.frame(base, 0)
    table["heat"] = 40.0 + 5.0 * (1.0 - np.exp(-table.time_s / 3.0))
    table["r1"] = np.gradient(table.q1, table.time_s)
    table["r2"] = np.degrees(np.gradient(table.q2, table.time_s))
    table["still"] = 3.0
    table["again"] = table.q1 + 1e-6 * np.sin(table.time_s)
    table["sample"] = np.arange(len(table))
    return load_mechanism(base), table


def propose(mechanism: Mechanism, table: pd.DataFrame, folder: Path) -> str:
    file = folder / "log.csv"
    table.to_csv(file, index=False)
    time, doubt = choose_time_column(read_columns(file))
    return format_identify_toml(mechanism, read_log(file, time), time, ("s", doubt))


@pytest.mark.parametrize("with_rates", [True, False])
def test_columns_without_names_are_told_by_their_numbers(
    arm: tuple[Mechanism, pd.DataFrame], with_rates: bool, tmp_path: Path
) -> None:
    mechanism, table = arm
    order = ["t2", "q1", *(["r2", "r1"] if with_rates else []), "heat", "time_s", "q2", "still", "t1", "again"]
    called = {name: f"c{k}" for k, name in enumerate(order)}
    text = propose(mechanism, table[order].rename(columns=called), tmp_path)
    data = tomllib.loads(text)
    assert data["time"] == called["time_s"]
    for joint, q, t in (("shoulder", "q1", "t1"), ("elbow", "q2", "t2")):
        assert data["joints"][joint]["angle"] == {"column": called[q], "unit": "rad"}
        assert data["joints"][joint]["effort"] == {"column": called[t], "unit": "N m"}
    assert "N m, or A of a current?" in text  # both readings are as good
    assert f'"{called["heat"]}": not used: it only drifts, as a temperature does' in text
    assert f'"{called["still"]}": not used: it stands still' in text
    assert f'"{called["again"]}": not used: the same as {called["q1"]}; a set point' in text
    if with_rates:
        assert f"no name says it: {called['r1']} is its rate" in text
        assert f'"{called["r2"]}": rate of elbow [deg/s], by its numbers' in text
    else:
        assert "it is smoother than the others" in text


def test_of_two_columns_that_rise_both_are_named(arm: tuple[Mechanism, pd.DataFrame], tmp_path: Path) -> None:
    """A counter rises as evenly as times do; by the right one of them more columns are rates of others."""
    mechanism, table = arm
    order = ["sample", "time_s", "q1", "q2", "r1", "t1", "t2"]
    called = dict(zip(order, "ghijkmn", strict=True))
    text = propose(mechanism, table[order].rename(columns=called), tmp_path)
    assert tomllib.loads(text)["time"] == "h"
    assert "this one rises in even steps, or is it g?" in text


def test_a_real_log_is_told_by_its_numbers(root: Path, tmp_path: Path) -> None:
    """Six axes of a robot whose columns have lost their names: every angle and every torque is found."""
    table = pd.read_csv(root / "models" / "kuka_kr300" / "run_A.csv.gz")
    kept = [name for name in table if not any(word in name for word in ("reference", "link", "rate"))]
    called = {name: f"x{k}" for k, name in enumerate(kept)}
    data = tomllib.loads(
        propose(load_mechanism(root / "models" / "kuka_kr300"), table[kept].rename(columns=called), tmp_path)
    )
    for k in range(1, 7):
        own = data["joints"][f"axis{k}"]
        assert own["angle"]["column"] == called[f"axis{k}_motor_angle_over_gear_rad"]
        assert own["effort"]["column"] == called[f"axis{k}_motor_torque_Nm"]


def test_a_rig_is_told_by_its_numbers(root: Path, tmp_path: Path) -> None:
    """Two angles and two currents beside two gauges, which follow the motion nearly as well and are named for that."""
    table = pd.read_csv(root / "models" / "quanser_2dsfl" / "record.csv")
    called = {name: f"u{k}" for k, name in enumerate(table)}
    text = propose(load_mechanism(root / "models" / "quanser_2dsfl"), table.rename(columns=called), tmp_path)
    data = tomllib.loads(text)["joints"]
    assert data["shoulder"]["angle"] == {"column": called["shoulder_deg"], "unit": "deg"}
    assert data["elbow"]["angle"] == {"column": called["elbow_deg"], "unit": "deg"}
    assert data["shoulder"]["effort"]["column"] == called["current1_A"]
    assert data["elbow"]["effort"]["column"] == called["current2_A"]
    assert f"or is it {called['gauge1_deg']}, of which" in text


def test_units_by_limits_and_by_rates(arm: tuple[Mechanism, pd.DataFrame]) -> None:
    """What a joint cannot reach in rad is deg; so is an angle whose rate is deg/s, and rad where its rate is 57 times that."""
    table = arm[1]
    time = table.time_s.to_numpy()
    joint = Joint("a", "revolute", "world", "b", limits=Limits(lower=-2.0, upper=2.0))
    move = 5.0 * np.sin(3.0 * time) + np.sin(5.0 * time)
    found, _ = find_meanings([joint], Log("", time, {"c": move}))
    assert (found["a"]["angle"].unit, "2 rad: it is taken as deg" in found["a"]["angle"].why) == ("deg", True)
    rate = np.gradient(move, time)
    for factor, unit in ((1.0, "deg"), (180.0 / np.pi, "rad")):
        found, _ = find_meanings(joints("a"), Log("", time, {"q1": move, "speed [deg/s]": factor * rate}))
        assert found["a"]["angle"].unit == unit


def test_what_is_no_effort_is_none(arm: tuple[Mechanism, pd.DataFrame]) -> None:
    """Neither what has another unit, though it follows the motion, nor noise."""
    table = arm[1]
    columns = {"q1": table.q1.to_numpy(), "q2": table.q2.to_numpy(), "p [bar]": table.t1.to_numpy()}
    columns["x"] = np.random.default_rng(0).normal(size=len(table))
    found, told = find_meanings(arm[0].joints, Log("", table.time_s.to_numpy(), columns))
    assert [set(own) for own in found.values()] == [{"angle"}, {"angle"}]
    assert [one.words for one in told][2:] == ["not used: neither its name nor the motion tells what it is"] * 2


def test_a_name_stays_in_its_comment(arm: tuple[Mechanism, pd.DataFrame]) -> None:
    """A name with a line's end and a table in it, as a bag or a MAT file may have one, is no line of the file."""
    evil = 'x\n[[free]]\nparameter = "viscous friction" #'
    table = arm[1][["q1", "q2", "t1", "t2"]].rename(columns={"q1": evil, "t1": f"t1 {evil}"})
    columns = {name: table[name].to_numpy() for name in table}
    text = format_identify_toml(
        arm[0], Log("log", arm[1].time_s.to_numpy(), columns), "time_s", ("s", f"or is it {evil}?")
    )
    data = tomllib.loads(text)
    assert [own["angle"]["column"] for own in data["joints"].values()] == ["q2"]
    assert not any(line.startswith("parameter") and line.endswith("#") for line in text.splitlines())


def test_the_command_asks_for_no_name_of_the_time(arm: tuple[Mechanism, pd.DataFrame], tmp_path: Path) -> None:
    folder = logged_arm.write_arm(tmp_path / "models" / "arm")
    (folder / "identify.toml").unlink()
    arm[1][["time_s", "q1", "q2", "t1", "t2"]].rename(columns={"time_s": "x"}).to_csv(folder / "log.csv", index=False)
    done = CliRunner().invoke(
        Main(), ["identify", "arm", "--models", str(tmp_path / "models"), "--log", "log.csv", "--propose"]
    )
    assert done.exit_code == 0, done.output
    assert tomllib.loads((folder / "identify.toml").read_text())["time"] == "x"
