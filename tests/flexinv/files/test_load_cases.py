"""Case files: motions by joint and by CSV, steps that fit, limits with reasons; every mistake is explained."""

from __future__ import annotations

import datetime
from pathlib import Path

import numpy as np
import pytest
from complaints import Planted, check_complaint, planted
from scipy.spatial.transform import Rotation

from flexinv.errors import InputError
from flexinv.files.load_cases import Case, Limit, load_cases
from flexinv.model.mechanism import Joint, Link, Mechanism

KINDS = {
    "turn": "revolute",
    "wheel": "continuous",
    "slide": "prismatic",
    "cross": "universal",
    "ball": "spherical",
    "base": "free",
}


def chain(*names: str) -> Mechanism:
    """A chain of massless links, one joint of each kind asked for."""
    parents = ["world", *names]
    joints = tuple(
        Joint(name, KINDS[name], parent, name, actuated=name != "base")
        for name, parent in zip(names, parents, strict=False)
    )
    return Mechanism("chain", tuple(Link(name) for name in names), joints)


ARM = chain("turn", "slide")
GOOD = """
source = "test"

[cases.reach]
title = "reach"
step_s = 1e-3
sample_s = 0.01
quantities = ["torque", "tip"]

[cases.reach.motion]
law = "quintic"
duration_s = 1.0
hold_s = 0.5
joints.turn = { from_deg = -90, to_deg = 90 }
joints.slide = { from_m = 0, to_m = 0.2, duration_s = 0.5, delay_s = 0.25, law = "cycloid" }

[[cases.reach.limits]]
quantity = "torque"
engines = ["exudyn*"]
maximum = 1e-3
reason = "first"
versions = ">=1.13, <1.14"
expires = 2030-01-31

[[limits]]
quantity = "torque"
engines = ["*"]
maximum = 1e-12
reason = "second"
source = "measured"

[[limits]]
quantity = "tip"
engines = ["pinocchio", "mujoco"]
reference = "exudyn"
maximum = 1e-11
reason = "third"

[[limits]]
quantity = "wrench"
engines = ["*"]
maximum = 1e-9
reason = "of no quantity of the case"
"""


def load(tmp_path: Path, text: str, mechanism: Mechanism = ARM) -> dict[str, Case]:
    file = tmp_path / "arm" / "cases.toml"
    file.parent.mkdir(exist_ok=True)
    file.write_text(text, encoding="utf-8")
    return load_cases(file.parent, mechanism)


def moving(tmp_path: Path, joints: str, mechanism: Mechanism) -> Case:
    """A case of one second whose motion has these joints."""
    head = GOOD.split("joints.turn")[0].replace("hold_s = 0.5\n", "")
    return load(tmp_path, head + joints + "\n" + GOOD[GOOD.index("[[limits]]") :], mechanism)["reach"]


def test_what_is_read(tmp_path: Path) -> None:
    case = load(tmp_path, GOOD)["reach"]
    assert (case.name, case.title, case.step, case.sample, case.end) == ("reach", "reach", 1e-3, 0.01, 1.5)
    assert (case.quantities, case.spectral_radius, case.initial) == (("torque", "tip"), 0.8, "consistent")
    assert case.source == "test"
    assert case.limits == (
        Limit("torque", ("exudyn*",), 1e-3, "first", expires=datetime.date(2030, 1, 31), versions=">=1.13, <1.14"),
        Limit("torque", ("*",), 1e-12, "second", source="measured"),
        Limit("tip", ("pinocchio", "mujoco"), 1e-11, "third", reference="exudyn"),
    )


def test_each_joint_has_its_own_times_and_law(tmp_path: Path) -> None:
    motion = load(tmp_path, GOOD)["reach"].motion
    assert motion.duration == 1.5
    q, qd, _ = motion.evaluate(ARM, np.array([0.0, 0.2, 0.5, 0.8, 1.0, 1.5]))
    # a symmetric law; rounding of a sum of terms up to 15, times pi: 15 pi 1e-16 < 1e-14
    assert np.abs(q[:, 0] - [-np.pi / 2, q[1, 0], 0, -q[1, 0], np.pi / 2, np.pi / 2]).max() < 1e-14
    assert np.abs(q[:, 1] - [0, 0, 0.1, 0.2, 0.2, 0.2]).max() < 1e-15
    assert qd[2, 1] == pytest.approx(2 * 0.2 / 0.5, rel=1e-14)  # a cycloid's peak speed
    assert qd[2, 0] == pytest.approx(15 / 8 * np.pi, rel=1e-14)  # a quintic's


@pytest.mark.parametrize(
    ("name", "joint", "start", "end"),
    [
        ("turn", "{ from_rad = 0.1, to_rad = 0.5 }", [0.1], [0.5]),
        ("turn", "{ from_deg = 0, to_rad = 0.5 }", [0], [0.5]),
        ("turn", "{ at_deg = 180 }", [np.pi], [np.pi]),
        ("wheel", "{ from_deg = 0, to_deg = 450 }", [1, 0], [0, 1]),
        ("slide", "{ at_m = 0.3 }", [0.3], [0.3]),
        ("cross", "{ from_deg = [0, 0], to_deg = [90, -90] }", [0, 0], [np.pi / 2, -np.pi / 2]),
        (
            "ball",
            "{ from_quaternion = [0, 0, 0, 1], to_quaternion = [0, 0, 0.6, 0.8] }",
            [0, 0, 0, 1],
            [0, 0, 0.6, 0.8],
        ),
        ("ball", "{ from_rpy_deg = [0, 0, 0], to_rpy_deg = [90, 0, 0] }", [0, 0, 0, 1], [0.5**0.5, 0, 0, 0.5**0.5]),
        (
            "base",
            "{ from_xyz_m = [0, 0, 1], to_xyz_m = [0, 1, 1], at_rpy_deg = [0, 0, 90] }",
            [0, 0, 1, 0, 0, 0.5**0.5, 0.5**0.5],
            [0, 1, 1, 0, 0, 0.5**0.5, 0.5**0.5],
        ),
    ],
)
def test_every_kind_of_joint_moves(tmp_path: Path, name: str, joint: str, start: list[float], end: list[float]) -> None:
    mechanism = chain(name)
    case = moving(tmp_path, f"joints.{name} = {joint}", mechanism)
    q, _, _ = case.motion.evaluate(mechanism, np.array([0.0, 1.0]))
    assert np.abs(q - [start, end]).max() < 1e-15 * 4  # sines and cosines of rounded angles


def test_roll_pitch_yaw_turn_about_fixed_axes(tmp_path: Path) -> None:
    mechanism = chain("ball")
    case = moving(tmp_path, "joints.ball = { at_rpy_deg = [20, 30, 40] }", mechanism)
    q = case.motion.evaluate(mechanism, np.zeros(1))[0][0]
    turn = Rotation.from_quat(q).as_matrix()
    x, y, z = (
        Rotation.from_rotvec(np.radians(a) * e).as_matrix() for a, e in zip((20, 30, 40), np.eye(3), strict=True)
    )
    assert np.abs(turn - z @ y @ x).max() < 1e-15


def test_others_at_zero(tmp_path: Path) -> None:
    mechanism = chain("turn", "wheel", "base")
    case = moving(tmp_path, 'others = "at_zero"\njoints.turn = { from_deg = 0, to_deg = 10 }', mechanism)
    q, _, _ = case.motion.evaluate(mechanism, np.array([1.0]))
    assert np.array_equal(q[0, 1:], mechanism.neutral[1:])
    assert set(case.motion.joints(mechanism)) == {"turn", "wheel", "base"}


@pytest.mark.parametrize("case", planted("bad_cases.toml").values(), ids=planted("bad_cases.toml").keys())
def test_bad_case_is_explained(tmp_path: Path, case: Planted) -> None:
    old, new, *_ = case
    assert old in GOOD, "the case edits a text that is not there"
    with pytest.raises(InputError) as caught:
        load(tmp_path, GOOD.replace(old, new, 1))
    check_complaint(str(caught.value), tmp_path / "arm" / "cases.toml", case)


def test_fixed_joint_cannot_move(tmp_path: Path) -> None:
    fixed = Mechanism(
        "arm", (Link("a"), Link("b")), (Joint("turn", "revolute", "world", "a"), Joint("weld", "fixed", "a", "b"))
    )
    with pytest.raises(InputError, match=r"key weld\n.*joint weld, which is fixed\n.*turn\n"):
        load(tmp_path, GOOD.replace("joints.slide", "joints.weld"), fixed)


def test_file_without_cases(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"key cases\n.*nothing\n(.|\n)*write: +\[cases.NAME\]"):
        load(tmp_path, 'source = "test"')
    with pytest.raises(InputError, match=r"\[cases\]\n.*no case\n"):
        load(tmp_path, 'source = "test"\n[cases]')


def test_limit_that_is_no_date(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"key expires\n(.|\n)*write: +expires = 2027-01-31"):
        load(tmp_path, GOOD.replace("2030-01-31", '"2030-01-31"'))


# ---- sampled motions

SAMPLED = GOOD.replace(GOOD[GOOD.index("law =") : GOOD.index("[[cases")], 'law = "sampled"\ncsv = "a.csv"\n').replace(
    "sample_s = 0.01\n", ""
)
TIMES = np.arange(21) * 0.05
ROWS = [f"{t:.2f},{90 * t**2:.12g},{100 * t:.12g}" for t in TIMES]


def sampled(tmp_path: Path, rows: list[str], more: str = "", mechanism: Mechanism = ARM) -> Case:
    (tmp_path / "arm").mkdir(exist_ok=True)
    (tmp_path / "arm" / "a.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return load(tmp_path, SAMPLED.replace('csv = "a.csv"', f'csv = "a.csv"\n{more}'), mechanism)["reach"]


HEADER = "time_s,turn_deg,slide_mm"


def test_samples_are_read_in_their_units(tmp_path: Path) -> None:
    motion = sampled(tmp_path, [HEADER, *ROWS[:10], "", *ROWS[10:]]).motion  # an empty line is no sample
    q, qd, qdd = motion.evaluate(ARM, np.array([0.32, 0.5]))
    # splines of degree 5 are exact for a parabola; the ninth digit is the twelfth of the file, differentiated twice
    assert (
        np.abs(q - np.stack([np.pi / 2 * np.array([0.32, 0.5]) ** 2, 0.1 * np.array([0.32, 0.5])], axis=1)).max()
        < 1e-12
    )
    assert np.abs(qd - np.stack([np.pi * np.array([0.32, 0.5]), [0.1, 0.1]], axis=1)).max() < 1e-10
    assert np.abs(qdd - [[np.pi, 0], [np.pi, 0]]).max() < 1e-8


def test_columns_may_stand_in_any_order(tmp_path: Path) -> None:
    turned = [",".join([*row.split(",")[:1], *row.split(",")[:0:-1]]) for row in [HEADER, *ROWS]]
    first, second = sampled(tmp_path, [HEADER, *ROWS]).motion, sampled(tmp_path, turned).motion
    assert np.array_equal(first.evaluate(ARM, TIMES)[0], second.evaluate(ARM, TIMES)[0])


def test_columns_of_several_coordinates(tmp_path: Path) -> None:
    mechanism = chain("ball", "cross", "wheel")
    header = "time_s,ball.qx,ball.qy,ball.qz,ball.qw,cross.1_deg,cross.2_rad,wheel_deg"
    rows = [f"{t:.2f},0,0,{np.sin(t / 4):.15f},{np.cos(t / 4):.15f},{t},{t},{90 * t}" for t in TIMES]
    q, qd, _ = sampled(tmp_path, [header, *rows], mechanism=mechanism).motion.evaluate(mechanism, np.array([0.5]))
    assert np.abs(q - [0, 0, np.sin(1 / 8), np.cos(1 / 8), np.radians(0.5), 0.5, 0.5**0.5, 0.5**0.5]).max() < 1e-10
    # a spline through 21 samples of a slow turn: its interpolation error is of order (h / 4)^5 < 1e-9
    assert np.abs(qd - [0, 0, 0.5, np.radians(1), 1, np.pi / 2]).max() < 1e-8


LOST = [*ROWS[:8], *ROWS[13:]]
BAD_CSV = {
    "unsorted": ([HEADER, *ROWS[:5], ROWS[6], ROWS[5], *ROWS[7:]], "line 8, column time_s", "0.25 after 0.3", "sorted"),
    "repeated": ([HEADER, *ROWS[:5], ROWS[4], *ROWS[5:]], "line 7, column time_s", "0.2 after 0.2", "each time once"),
    "gap": ([HEADER, *LOST], "line 10, column time_s", "a gap of 0.3 s, from 0.35 to 0.65", "largest_gap_s = 0.3003"),
    "late start": ([HEADER, *ROWS[1:]], "line 2, column time_s", "0.05", "all times less 0.05"),
    "empty cell": ([HEADER, *ROWS[:3], "0.15,,15", *ROWS[4:]], "line 5, column turn_deg", "''", "a finite number"),
    "NaN": ([HEADER, *ROWS[:3], "0.15,nan,15", *ROWS[4:]], "line 5, column turn_deg", "'nan'", "a finite number"),
    "text": ([HEADER, *ROWS[:3], "0.15,x,15", *ROWS[4:]], "line 5, column turn_deg", "'x'", "a finite number"),
    "short row": ([HEADER, *ROWS[:3], "0.15,2", *ROWS[4:]], "line 5", "2 cells", "3, as in the first line"),
    "no header": (ROWS, "line 1", "first column '0.00'", "time_s,turn_rad,slide_m"),
    "unit": ([HEADER.replace("turn_deg", "turn_grad"), *ROWS], "line 1, column 2", "turn_grad", "turn_rad"),
    "no unit": ([HEADER.replace("slide_mm", "slide"), *ROWS], "line 1, column 3", "slide", "slide_m"),
    "unknown joint": ([HEADER.replace("turn", "trun"), *ROWS], "line 1, column 2", "trun_deg", "turn_deg"),
    "twice": ([HEADER.replace("slide_mm", "turn_rad"), *ROWS], "line 1, column 3", "joint turn twice", "one of the two"),
    "one row": ([HEADER, ROWS[0]], "a.csv", "1 rows of numbers", "two or more"),
    "nothing": ([""], "line 1", "an empty file", "time_s"),
    "quotes": ([HEADER, '0,"1,2'], "a.csv", "no CSV", "commas"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_CSV.values(), ids=BAD_CSV.keys())
def test_bad_samples_are_explained(tmp_path: Path, case: tuple[list[str], str, str, str]) -> None:
    rows, place, given, advice = case
    with pytest.raises(InputError) as caught:
        sampled(tmp_path, rows)
    first, second, *rest = str(caught.value).splitlines()
    assert str(tmp_path / "arm" / "a.csv") in first
    assert place in first
    assert given in second
    assert advice in "\n".join(rest)


def test_gap_may_be_allowed(tmp_path: Path) -> None:
    assert sampled(tmp_path, [HEADER, *LOST], "largest_gap_s = 0.31").motion.duration == 1.0


def test_samples_of_some_joints_only(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"key slide\n.*nothing\n.*missing: slide"):
        sampled(tmp_path, ["time_s,turn_deg", *(row.rpartition(",")[0] for row in ROWS)])


def test_some_coordinates_of_a_joint_only(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"line 1\n.*some coordinates of joint cross\n(.|\n)*a column cross.2_rad"):
        sampled(tmp_path, ["time_s,cross.1_deg", *(row.rpartition(",")[0] for row in ROWS)], mechanism=chain("cross"))


@pytest.mark.parametrize("csv", ["../a.csv", "/tmp/a.csv"])
def test_samples_outside_the_folder_are_refused(tmp_path: Path, csv: str) -> None:
    with pytest.raises(InputError, match=r'key csv\n(.|\n)*in the folder of the cases\n.*write: +csv = "a.csv"'):
        load(tmp_path, SAMPLED.replace('csv = "a.csv"', f'csv = "{csv}"'))


def test_samples_that_are_not_there(tmp_path: Path) -> None:
    (tmp_path / "arm").mkdir()
    (tmp_path / "arm" / "b.csv").write_text("")
    with pytest.raises(InputError, match=r"a.csv\n.*no such file\n.*\n.*write: +b.csv"):
        load(tmp_path, SAMPLED)
