"""Headers of motions: columns by names, numbers and units, in any order; one error for all that does not fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flexinv.errors import InputError
from flexinv.files.motion_columns import MotionColumns, match_motion_columns, parse_motion_unit
from flexinv.files.motion_table import open_motion
from flexinv.model.links import Body, Inertia
from flexinv.model.mechanism import Joint, Link, Mechanism

DEG = np.pi / 180.0
ARM = ("shoulder_joint", "elbow_joint")


def crane() -> Mechanism:
    """Two joints that turn, one that slides, one that turns without end."""
    kinds = {
        "shoulder_joint": "revolute",
        "elbow_joint": "revolute",
        "slide_joint": "prismatic",
        "wrist_joint": "continuous",
    }
    body = Body("b", Inertia(1.0, np.array([0.1, 0.0, 0.0])))
    joints, links, parent = [], [], "world"
    for name, kind in kinds.items():
        joints.append(Joint(name, kind, parent, f"{name}_link"))
        links.append(Link(f"{name}_link", (body,)))
        parent = f"{name}_link"
    return Mechanism("crane", tuple(links), tuple(joints), np.array([0.0, 0.0, -9.81]))


def matched(header: str, held: tuple[str, ...] = ()) -> MotionColumns:
    return match_motion_columns(header.split(","), crane(), held, "motion.csv: line 1")


SLIDE, WRIST = "slide_joint", "wrist_joint"
HEADERS = {
    "as cases.toml": "time_s,shoulder_joint_rad,elbow_joint_rad,slide_joint_m,wrist_joint_rad",
    "bare names": "time,shoulder_joint,elbow_joint,slide_joint,wrist_joint",
    "without the word that all share": "t,wrist,elbow,slide,shoulder",
    "other orders, brackets": "q_elbow_joint [rad],pos slide_joint (m),Time [s],wrist_joint angle,shoulder_joint",
    "states of joints": "stamp,/joint_states/elbow/position,joint_states.slide_joint.position,wrist/pos,shoulder",
    "numbers": "time_s,q1,q2,q3,q4",
    "numbers from nought": "time_s,q[0],q[1],q[2],q[3]",
    "numbers with units": "time_s,q_4 [rad],q_3 [m],q_2 [rad],q_1 [rad]",
}


@pytest.mark.parametrize("header", HEADERS.values(), ids=HEADERS)
def test_columns_are_found_by_name_or_number_in_any_order(header: str) -> None:
    found = matched(header)
    assert [column.coordinate for column in found.positions] == [*ARM, SLIDE, WRIST]
    assert [column.factor for column in found.positions] == [1.0] * 4
    assert found.time is not None
    names = header.split(",")
    assert all(names[column.place] == column.name for column in found.positions)


def test_rates_and_accelerations_are_told_by_word_or_unit() -> None:
    header = "time_s,wrist,elbow,slide,shoulder,qd_wrist,velocity elbow,slide_m_per_s,shoulder [deg/s],"
    header += "wrist acc [deg/s²],qdd_elbow,slide_mm_per_s2,shoulder [rad/s^2],torque wrist [N m],elbow/effort"
    found = matched(header)
    assert [column.factor for column in found.rates] == [DEG, 1.0, 1.0, 1.0]
    assert [column.coordinate for column in found.accelerations] == [*ARM, SLIDE, WRIST]
    assert [column.factor for column in found.accelerations] == [1.0, 1.0, 1e-3, DEG]
    assert found.left_out == ("torque wrist [N m]", "elbow/effort")


MOVES = "time_s,shoulder,elbow,slide,wrist"
NO_MOTIONS = (
    "elbow_A", "elbow_joint [A]", "current_wrist", "elbow [N m]", "slide_N", "wrist_Nm", "elbow_V", "i1_A", "m2 [mA]",
    "elbow_temperature", "elbow_ref_rad", "temp [degC]", "status",
)  # fmt: skip


@pytest.mark.parametrize("name", NO_MOTIONS)
def test_efforts_and_other_words_are_left_out(name: str) -> None:
    """``elbow_A`` was an acceleration, for ``a`` is a word for one; ``elbow_V`` a rate, for ``v`` is one."""
    found = matched(f"{MOVES},{name}")
    assert found.left_out == (name,)
    assert (len(found.positions), found.rates, found.accelerations) == (4, (), ())


def test_words_of_accelerations_and_rates_stay_what_they_are() -> None:
    found = matched(f"{MOVES}," + ",".join(f"{joint}_{word}" for joint in (*ARM, SLIDE, WRIST) for word in "va"))
    assert [len(columns) for columns in (found.rates, found.accelerations)] == [4, 4]
    assert found.left_out == ()


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("rad", ("position", "rad", 1.0)),
        ("°", ("position", "rad", DEG)),
        ("Degrees", ("position", "rad", DEG)),
        ("mm", ("position", "m", 1e-3)),
        ("deg/s", ("rate", "rad", DEG)),
        ("deg_per_s", ("rate", "rad", DEG)),
        ("rpm", ("rate", "rad", np.pi / 30.0)),
        ("m s^-2", ("acceleration", "m", 1.0)),
        ("rad/s²", ("acceleration", "rad", 1.0)),
        ("N m", None),
        ("s", None),
    ],
)
def test_units_say_what_is_measured_and_how_large_it_is(text: str, unit: tuple[str, str, float] | None) -> None:
    found = parse_motion_unit(text)
    assert (found is None) == (unit is None)
    if unit is not None and found is not None:
        assert found[:2] == unit[:2]
        assert found[2] == pytest.approx(unit[2], rel=1e-15)


WRONG = {
    "time_s,shoulder,elbow,slide": "no position of wrist_joint",
    "time_s,shoulder,elbow,slide,hand_deg": "no position of wrist_joint; left out: 'hand_deg'",
    "time_s,shoulder,elbow,slide,wrist_A": "no position of wrist_joint; left out: 'wrist_A'",
    "time_s,shoulder,elbow,slide,wrist,rate sholder": "no coordinate of crane: 'rate sholder'",
    "time_s,shoulder,elbow,slide,wrist,elbw": "no coordinate of crane: 'elbw' (is it elbow_joint?)",
    "time_s,shoulder,elbow,slide,wrist,elbow_deg": "'elbow' and 'elbow_deg' are both the position of elbow_joint",
    "time_s,shoulder,elbow,slide_deg,wrist": "no coordinate of crane: 'slide_deg'",
    "time_s,shoulder,elbow_m,slide,wrist": "no coordinate of crane: 'elbow_m'",
    "time_s,shoulder,elbow,slide,wrist,rate elbow [rad]": "no coordinate of crane: 'rate elbow [rad]'",
    "time_s,shoulder,elbow,slide,wrist,rate elbow": "no rate of shoulder_joint, slide_joint, wrist_joint",
    "time_s,shoulder,elbow,slide,wrist,qdd_elbow": "no rate of shoulder_joint, elbow_joint, slide_joint, wrist_joint; no acc",
    "time_s,shoulder,elbow2,slide,wrist": "'elbow2'",
    "time_s,q1,q2,q3": "no position of wrist_joint",
    "time_s,q1,q2,q3,q4,q5": "no coordinate of crane: 'q5'",
    "time_s,q1 [rad],q2 [rad],q3 [rad],q4 [rad]": "no coordinate of crane: 'q3 [rad]'",
}


@pytest.mark.parametrize("header", WRONG)
def test_what_does_not_fit_is_one_error_that_shows_a_header(header: str) -> None:
    with pytest.raises(InputError) as error:
        matched(header)
    assert WRONG[header] in str(error.value)
    write = "time_s,shoulder_joint_rad,elbow_joint_rad,slide_joint_m,wrist_joint_rad"
    assert f"write:    {write}" in str(error.value)
    matched(write)


def test_a_joint_that_is_held_has_no_column() -> None:
    assert len(matched("time_s,shoulder,elbow,slide", ("wrist_joint",)).positions) == 3
    with pytest.raises(InputError, match="'wrist' moves joint wrist_joint, which is held"):
        matched("time_s,shoulder,elbow,slide,wrist", ("wrist_joint",))


# ------------------------------------------------------------------------------------------------ files of numbers

ROWS = "0,0.5,0.25,0.125,3\n0.01,0.75,0.5,0.25,3.5\n"


def read(tmp_path: Path, text: str) -> tuple[np.ndarray, np.ndarray]:
    file = tmp_path / "motion.csv"
    file.write_text(text, encoding="utf-8")
    (part,) = open_motion(file, crane()).read_parts(1000)
    assert part.time is not None
    return part.time, part.positions


@pytest.mark.parametrize(
    "text",
    [
        "time_s,shoulder,elbow,slide,wrist\n" + ROWS,
        "\ufefftime_s;shoulder;elbow;slide;wrist\n" + ROWS.replace(",", ";").replace(".", ","),
        "# time_s, shoulder, elbow, slide, wrist\n" + ROWS.replace(",", ", "),
        "time_s\tshoulder\telbow\tslide\twrist\r\n" + ROWS.replace(",", "\t").replace("\n", "\r\n"),
        "time [ms],shoulder,elbow,slide [mm],wrist\n0,0.5,0.25,125,3\n10,0.75,0.5,250,3.5\n",
        "time_s,shoulder_deg,elbow,slide,wrist,\n"
        + "".join(
            f"{t},{np.degrees(q)!r},{rest},\n"
            for t, q, rest in ((0, 0.5, "0.25,0.125,3"), (0.01, 0.75, "0.5,0.25,3.5"))
        ),
    ],
)
def test_semicolons_commas_tabs_marks_and_units_are_read(text: str, tmp_path: Path) -> None:
    time, positions = read(tmp_path, text.replace("np.float64(", "").replace(")", ""))
    np.testing.assert_allclose(time, [0.0, 0.01], rtol=1e-15)
    np.testing.assert_allclose(positions, [[0.5, 0.25, 0.125, 3.0], [0.75, 0.5, 0.25, 3.5]], rtol=1e-15)


BROKEN = {
    "0,1,2,3,4\n0.1,1,2\n": "row 2 of numbers, column slide",
    "0,1,2,3,4\n0.1,1,2,x,4\n": "row 2 of numbers, column slide\n  given:    'x'",
    "0,1,2,3,4\n0.1,1,2,nan,4\n": "row 2 of numbers, column slide",
    "0,1,2,3,4\n0.1,1,2,3,4,5\n": "5 cells in each line",
    "0,1,2,3,4,5\n0.1,1,2,3,4,5\n": "5 cells in each line",
    "0,90,2,3,4\n0.1,91,2,3,4\n": "91 without a unit",
    "0,1,2,3,4\n100,1,2,3,4\n": "steps of 100, and no unit in the header",
    "": "no rows of numbers",
}


@pytest.mark.parametrize("rows", BROKEN)
def test_rows_that_are_no_samples_are_named(rows: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        read(tmp_path, "time,shoulder,elbow,slide,wrist\n" + rows)
    assert BROKEN[rows] in str(error.value)


def test_a_file_that_begins_with_numbers_is_told_its_header(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="write:    time_s,shoulder_joint_rad"):
        read(tmp_path, ROWS)
    with pytest.raises(InputError, match="no such file"):
        open_motion(tmp_path / "none.csv", crane())


def test_digits_of_a_file_are_those_that_it_shows(tmp_path: Path) -> None:
    file = tmp_path / "motion.csv"
    file.write_text("time_s,shoulder_deg,elbow,slide,wrist\n0.000,10.5,1.0000001,1.5e-02,0\n0.125,11,1,2.5e-02,1\n")
    source = open_motion(file, crane())
    np.testing.assert_allclose(source.digits["position"], [0.1 * DEG, 1e-7, 1e-3, 1.0], rtol=1e-12)
    assert source.time_digit == pytest.approx(1e-3)


def test_a_packed_file_is_read_like_one_that_is_not(tmp_path: Path) -> None:
    import gzip

    file = tmp_path / "motion.csv.gz"
    with gzip.open(file, "wt") as stream:
        stream.write("time_s,shoulder,elbow,slide,wrist\n" + ROWS)
    found = next(open_motion(file, crane()).read_parts(1000))
    np.testing.assert_array_equal(found.positions[:, 0], [0.5, 0.75])
