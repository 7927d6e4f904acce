"""Efforts of motions in files: those of Pinocchio and of `solve`, and what is said of rates, digits and columns."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

import flexinv
from flexinv.errors import InputError, ModelWarning
from flexinv.files.csv_dialect import make_exact_options
from flexinv.files.from_urdf import find_robots_folder
from flexinv.files.motion_columns import list_coordinates
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Joint, Link, Mechanism
from flexinv.model.track import LAWS, evaluate_progress, find_law
from flexinv.sampled.motion_checks import compute_slope_factors
from flexinv.sampled.sampled_motion import convert_to_coordinates
from flexinv.typing import Array, Triple

# Arms, a hand, legs, joints without end, prismatic ones: names below example-robot-data's folder of robots.
ROBOTS = (
    "ur_description/urdf/ur5_robot.urdf",
    "panda_description/urdf/panda.urdf",
    "kinova_description/robots/kinova.urdf",
    "tiago_description/robots/tiago.urdf",
    "allegro_hand_description/urdf/allegro_left_hand.urdf",
    "anymal_b_simple_description/robots/anymal.urdf",
)

LIMITS_PASSED = (
    ".*pass the limits of the robot"  # the motion is quicker than the arm, which is not what these tests are about
)


@pytest.fixture(scope="module")
def ur5(root: Path) -> Mechanism:
    return flexinv.load_mechanism(root / "models" / "ur5")


def sines(mechanism: Mechanism, time: Array) -> Triple:
    """Angles, rates and accelerations (samples, nv) of joints with one coordinate, each at a pace of its own."""
    random = np.random.default_rng(1)
    size = random.uniform(0.1, 0.6, mechanism.nv)
    pace = random.uniform(1.0, 4.0, mechanism.nv)
    angle = pace * time[:, None] + random.uniform(0.0, 6.0, mechanism.nv)
    return size * np.sin(angle), size * pace * np.cos(angle), -size * pace**2 * np.sin(angle)


def table(mechanism: Mechanism, time: Array, series: int = 3) -> pd.DataFrame:
    """A motion as flexinv itself names its columns."""
    units = [unit for joint in mechanism.joints for unit in KINDS[joint.kind].units]
    names = list(zip(mechanism.velocity_names, units, strict=True))
    words = (("position", ""), ("rate", "/s"), ("acceleration", "/s^2"))[:series]
    columns = [f"{word} {name} [{unit}{per}]" for word, per in words for name, unit in names]
    values = np.hstack(sines(mechanism, time)[:series])
    return pd.DataFrame(values, index=pd.Index(time, name="time [s]"), columns=columns)


def relative(found: Array, expected: Array) -> float:
    """The largest difference over the largest effort."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())


# ------------------------------------------------------------------------------------------------- the efforts


@pytest.mark.parametrize("name", ROBOTS)
def test_efforts_of_a_urdf_and_a_file_are_those_of_pinocchio(name: str, tmp_path: Path) -> None:
    pin = pytest.importorskip("pinocchio")
    file = find_robots_folder() / name
    model = pin.buildModelFromUrdf(str(file))
    data = model.createData()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)  # mimic joints and odd inertias of real files
        mechanism = flexinv.from_urdf(file)
        motion = table(mechanism, np.linspace(0.0, 1.0, 40)).sample(frac=1.0, axis=1, random_state=2)
        motion.to_csv(tmp_path / "motion.csv")
        found = flexinv.torques(file, tmp_path / "motion.csv", friction=False)
    angles, qd, qdd = sines(mechanism, np.linspace(0.0, 1.0, 40))
    q = convert_to_coordinates(mechanism, angles)
    expected = np.array([pin.rnea(model, data, *one) for one in zip(q, qd, qdd, strict=True)])
    assert relative(found.to_numpy(), expected) < 1e-12  # the same sums in another order


def test_what_flexinv_solve_writes_is_a_motion_with_the_same_efforts(
    root: Path, tmp_path: Path, ur5: Mechanism
) -> None:
    case = next(iter(flexinv.load_cases(root / "models" / "ur5", ur5).values()))
    solution = flexinv.solve(ur5, case.motion, case.step)
    solution.whole_frame().to_csv(tmp_path / "solved.csv")
    found = flexinv.torques(ur5, tmp_path / "solved.csv")
    assert list(found) == [name for name in solution.frame() if name.startswith("torque")]
    assert relative(found.to_numpy(), solution.torque_all) < 1e-12  # two forms of one scheme, rounded apart


def test_an_arm_that_bends_has_the_efforts_of_solve_with_the_same_samples(root: Path, tmp_path: Path) -> None:
    arm = flexinv.load_mechanism(root / "models" / "flex_one_link")
    time = 1e-3 * np.arange(201)
    angle = 0.4 * (1.0 - np.cos(8.0 * time))
    pd.DataFrame({"hub_rad": angle}, index=pd.Index(time, name="time_s")).to_csv(tmp_path / "motion.csv")
    expected = flexinv.solve(arm, flexinv.Motion.from_samples(time, {"hub": angle}), 1e-3)
    found = flexinv.torques(arm, tmp_path / "motion.csv")
    np.testing.assert_array_equal(found.index, time)
    # Times made even differ from those written by rounding, 1e-17 s, which the march's accelerations see.
    assert relative(found.to_numpy(), expected.torque_all) < 1e-9
    halved = flexinv.torques(arm, tmp_path / "motion.csv", step=5e-4)
    finer = flexinv.solve(arm, flexinv.Motion.from_samples(time, {"hub": angle}), 5e-4, every=2)
    assert relative(halved.to_numpy(), finer.torque_all) < 1e-9
    summary = flexinv.write_torques(arm, tmp_path / "motion.csv", tmp_path / "out.csv")
    assert summary.samples == 201
    np.testing.assert_array_equal(pd.read_csv(tmp_path / "out.csv", index_col=0, **make_exact_options()), found)


def test_given_rates_and_accelerations_drive_an_arm_that_bends(root: Path) -> None:
    """At few samples a spline through positions is off; the given accelerations are not."""
    arm = flexinv.load_mechanism(root / "models" / "flex_one_link")
    fine = 2e-3 * np.arange(101)
    exact = flexinv.torques(arm, flexed(fine, 1), step=2e-3)
    coarse = flexed(2e-2 * np.arange(11), 3)
    given = flexinv.torques(arm, coarse, step=2e-3)
    assert relative(given.to_numpy(), exact.to_numpy()[::10]) < 1e-4
    assert relative(flexinv.torques(arm, coarse.iloc[:, :1], step=2e-3).to_numpy(), exact.to_numpy()[::10]) > 1e-3


def flexed(time: Array, series: int) -> pd.DataFrame:
    """A motion of the hub from rest, ten samples for a period where they are 2e-2 s apart."""
    angle = 30.0 * time
    values = (0.05 * (1.0 - np.cos(angle)), 1.5 * np.sin(angle), 45.0 * np.cos(angle))
    names = ("hub", "hub_rad_per_s", "hub_rad_per_s2")
    columns = dict(zip(names[:series], values, strict=False))
    return pd.DataFrame(columns, index=pd.Index(time, name="time_s"))


def test_a_loop_whose_passive_joints_have_no_column_is_solved(root: Path) -> None:
    folder = root / "models" / "four_bar"
    loop = flexinv.load_mechanism(folder)
    case = next(iter(flexinv.load_cases(folder, loop).values()))
    solution = flexinv.solve(loop, case.motion, case.step)
    drives = [joint.name for joint in loop.joints if joint.actuated]
    frame = solution.frame()
    given = frame[[name for name in frame if any(name.split(" ")[1] == drive for drive in drives)]]
    found = flexinv.torques(loop, given.drop(columns=[name for name in given if name.startswith("torque")]))
    peak = np.abs(solution.torque).max()
    assert (
        np.abs(found.to_numpy()[:, loop.actuated] - solution.torque).max() < 1e-6 * peak
    )  # between samples: Hermite's polynomial


# ------------------------------------------------------------------------------------ splines, and memory of a part


@pytest.mark.parametrize("series", [1, 2, 3])
def test_parts_give_what_the_whole_gives(series: int, ur5: Mechanism, tmp_path: Path) -> None:
    time = 1e-2 * np.arange(3_333)
    motion = table(ur5, time, series)
    whole = flexinv.torques(ur5, motion)
    summary = flexinv.write_torques(ur5, motion, tmp_path / "parts.csv", rows=1000)
    parts = pd.read_csv(tmp_path / "parts.csv", index_col=0)
    assert list(parts) == list(summary.labels) == list(whole)
    # Second differences of rounded positions: 1e-16 rad / (1e-2 s)^2, times 10 for the spline, over accelerations of 1 rad/s^2.
    assert relative(parts.to_numpy(), whole.to_numpy()) < (1e-10 if series < 3 else 1e-15)
    np.testing.assert_allclose(summary.peak, np.abs(whole).max(), rtol=1e-9)
    np.testing.assert_allclose(summary.rms, np.sqrt((whole**2).mean()), rtol=1e-9)


def test_positions_alone_are_differentiated_by_the_spline_of_sampled_motions(ur5: Mechanism) -> None:
    time = 1e-2 * np.arange(300)
    motion = flexinv.Motion.from_samples(time, sines(ur5, time)[0])
    expected = flexinv.joint_torques(ur5, *motion.evaluate(ur5, time))
    assert relative(flexinv.torques(ur5, table(ur5, time, 1)).to_numpy(), expected) < 1e-10


def test_times_with_few_digits_are_taken_as_the_even_ones_that_they_were(ur5: Mechanism, tmp_path: Path) -> None:
    """240 samples a second with three decimals: as written, the steps of 4 and 5 ms would shake the accelerations."""
    time = np.arange(400) / 240.0
    motion = table(ur5, time, 1)
    expected = flexinv.torques(ur5, motion)
    motion.index = pd.Index(np.round(time, 3), name="time [s]")
    motion.to_csv(tmp_path / "motion.csv")
    found = flexinv.torques(ur5, tmp_path / "motion.csv")
    # The spacing follows from 400 times, each known to 0.3 ms, to 1e-6 or so of itself.
    assert relative(found.to_numpy(), expected.to_numpy()) < 1e-4


# ------------------------------------------------------------------------------------------ what is wrong is said


def test_rates_that_are_wrong_by_a_factor_are_an_error_with_its_size(ur5: Mechanism) -> None:
    motion = table(ur5, 1e-2 * np.arange(200))
    wrong = motion.copy()
    wrong.iloc[:, 8] *= 180.0 / np.pi
    wrong.iloc[:, 10] *= -1.0
    with pytest.raises(InputError) as error:
        flexinv.torques(ur5, wrong)
    words = str(error.value)
    assert "'rate elbow_joint [rad/s]' is 57.29 times the slope of the positions of elbow_joint" in words
    assert re.search(r"'rate wrist_2_joint \[rad/s\]' is -(1|0\.999\d*|1\.000\d*) times", words)
    assert "write [deg/s]" in words
    assert "shoulder" not in words
    wrong = motion.copy()
    wrong.iloc[:, 12] *= 1.05
    with pytest.raises(InputError, match=r"acceleration shoulder_pan_joint.*is 1\.05 times the slope of the rates"):
        flexinv.torques(ur5, wrong)


@pytest.mark.parametrize("swapped", [(6, 7), (12, 17)])
def test_columns_that_are_exchanged_are_no_slopes(swapped: tuple[int, int], ur5: Mechanism) -> None:
    motion = table(ur5, 1e-2 * np.arange(400))
    values = motion.to_numpy(copy=True)
    values[:, list(swapped)] = values[:, list(swapped[::-1])]
    with pytest.raises(InputError, match="slope of the"):
        flexinv.torques(ur5, pd.DataFrame(values, columns=list(motion), index=motion.index))


def test_a_wrong_part_late_in_a_file_is_found_and_leaves_no_file(ur5: Mechanism, tmp_path: Path) -> None:
    motion = table(ur5, 1e-2 * np.arange(6_000))
    motion.iloc[5_000:, 6] *= 2.0
    with pytest.raises(InputError, match="rows 5000 to 6000"):
        flexinv.write_torques(ur5, motion, tmp_path / "out.csv", rows=1000)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("spacing", "digits"), [(0.2, 12), (1e-3, 3), (0.05, 3)])
def test_true_rates_pass_whatever_spacing_and_digits(
    spacing: float, digits: int, ur5: Mechanism, tmp_path: Path
) -> None:
    """Five to eight samples for the fastest turn, or three decimals: what the factor is off by is allowed for.

    Efforts are those of the exact motion, to what half of a last digit in every number does to them at most.
    """
    time = spacing * np.arange(100)
    table(ur5, time).round(digits).to_csv(tmp_path / "motion.csv")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        found = flexinv.torques(ur5, tmp_path / "motion.csv")
    states = sines(ur5, time)
    exact = flexinv.joint_torques(ur5, *states)
    slopes = flexinv.torque_derivatives(ur5, *states)
    half = 0.5 * 10.0**-digits
    most = half * sum(np.abs(one).sum(axis=2) for one in (slopes.q, slopes.qd, slopes.qdd))
    rounding = 1e-12 * np.abs(exact).max()  # a thousand operations
    assert (
        np.abs(found.to_numpy() - exact) <= 1.01 * most + rounding
    ).all()  # squares of the digits are below a hundredth


@pytest.mark.filterwarnings(f"ignore:{LIMITS_PASSED}")
def test_noise_of_short_digits_is_said_in_newton_metres(ur5: Mechanism, tmp_path: Path) -> None:
    time = 1e-3 * np.arange(2_000)
    motion = table(ur5, time, 1)
    exact = flexinv.torques(ur5, motion)
    motion.round(5).to_csv(tmp_path / "short.csv")
    with pytest.warns(ModelWarning, match="the last digit of positions makes noise in the efforts") as said:
        found = flexinv.torques(ur5, tmp_path / "short.csv")
    noise = (found - exact).iloc[100:-100].std().to_numpy()
    words = next(str(one.message) for one in said if "last digit" in str(one.message))
    for name, size in zip(ur5.velocity_names, noise, strict=True):
        told = float(words.split(f" N m in {name}")[0].split(" ")[-1])
        assert 0.7 < told / size < 1.4  # it differs from pose to pose
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", LIMITS_PASSED)
        flexinv.torques(ur5, table(ur5, time, 1))


def test_floats_of_32_bits_are_short_digits(ur5: Mechanism) -> None:
    motion = table(ur5, 1e-3 * np.arange(500), 1)
    with pytest.warns(ModelWarning, match="makes noise in the efforts"):
        flexinv.torques(ur5, motion.astype(np.float32).astype(np.float64))


def test_times_are_asked_for_where_they_are_needed(ur5: Mechanism) -> None:
    time = 1e-2 * np.arange(50)
    bare = table(ur5, time, 1).reset_index(drop=True)
    with pytest.raises(InputError, match="no times"):
        flexinv.torques(ur5, bare)
    timed = flexinv.torques(ur5, table(ur5, time, 1))
    assert relative(flexinv.torques(ur5, bare, spacing=1e-2).to_numpy(), timed.to_numpy()) < 1e-9
    whole = table(ur5, time).reset_index(drop=True)
    with pytest.warns(ModelWarning, match="without times nothing can be compared"):
        assert flexinv.torques(ur5, whole).index.name == "row"
    with pytest.raises(InputError, match=r"spacing = 0\.01 s beside the column"):
        flexinv.torques(ur5, table(ur5, time), spacing=1e-2)


def broken_times() -> Iterator[tuple[Array, str]]:
    good = 1e-2 * np.arange(50)
    yield np.where(good == good[20], good[19], good), "times that increase"
    yield np.where(np.arange(50) > 30, good + 5.0, good), r"a hole of 5\.01 s after row 31"


@pytest.mark.parametrize(("time", "words"), list(broken_times()))
def test_times_that_stand_still_or_jump_are_refused(time: Array, words: str, ur5: Mechanism) -> None:
    with pytest.raises(InputError, match=words):
        flexinv.torques(ur5, table(ur5, time, 1))


def test_an_angle_that_jumps_by_a_turn_is_refused(ur5: Mechanism) -> None:
    motion = table(ur5, 1e-2 * np.arange(50))
    motion.iloc[25:, 2] += 2.0 * np.pi
    with pytest.raises(InputError, match=r"elbow_joint\n.*a jump of 6\.2.* rad after row 25"):
        flexinv.torques(ur5, motion)


# ------------------------------------------------------------------------------- payload, gravity, friction, holding


def test_payload_gravity_and_friction_are_those_of_the_mechanism_that_has_them(ur5: Mechanism) -> None:
    motion = table(ur5, 1e-2 * np.arange(30))
    inertia = flexinv.Inertia(2.0, [0.0, 0.1, 0.0], np.diag([0.01, 0.01, 0.01]))
    tool = flexinv.Body("tool", inertia)
    link = ur5.links[-1].name
    states = sines(ur5, np.asarray(motion.index))
    q = convert_to_coordinates(ur5, states[0])
    expected = flexinv.joint_torques(ur5.with_body(link, tool), q, *states[1:])
    for load in (tool, inertia):
        assert relative(flexinv.torques(ur5, motion, payload={link: load}).to_numpy(), expected) < 1e-14
    weightless = flexinv.torques(ur5, motion * 0.0, gravity=[0.0, 0.0, 0.0], friction=False)
    assert not weightless.to_numpy().any()
    moving = motion.copy()
    dry = flexinv.torques(ur5, moving, friction={"elbow_joint": (3.0, 0.5)}) - flexinv.torques(
        ur5, moving, friction=False
    )
    own = states[1][:, 2]
    np.testing.assert_allclose(dry.iloc[:, 2], 3.0 * np.sign(own) + 0.5 * own, atol=1e-9)
    with pytest.raises(InputError, match="friction: joint"):
        flexinv.torques(ur5, motion, friction={"elbow": (1.0, 0.0)})


@pytest.mark.parametrize("load", [2.0, flexinv.Inertia(2.0), flexinv.Body("tool", flexinv.Inertia(2.0))])
def test_a_payload_on_no_link_is_called_a_payload(load: object, ur5: Mechanism) -> None:
    words = r"payload: link = 'tool': expected one that .* has: .*tool0.*; write tool0"
    with pytest.raises(InputError, match=words):
        flexinv.torques(ur5, table(ur5, 1e-2 * np.arange(30)), payload={"tool": load})  # type: ignore[dict-item]


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_what_is_no_number_is_told_as_it_is_written(wrong: float, ur5: Mechanism) -> None:
    motion = table(ur5, 1e-2 * np.arange(30))
    motion.iloc[4, 1] = wrong
    with pytest.raises(InputError, match=rf"row 5 of numbers, column .*shoulder_lift_joint.*\n +given: +{wrong}\n"):
        flexinv.torques(ur5, motion)


def test_a_joint_that_is_held_needs_no_column(ur5: Mechanism) -> None:
    motion = table(ur5, 1e-2 * np.arange(30))
    still = motion.copy()
    still.iloc[:, [5, 11, 17]] = [0.25, 0.0, 0.0]
    fewer = motion.drop(columns=[name for name in motion if "wrist_3_joint" in name])
    expected = flexinv.torques(ur5, still)
    np.testing.assert_array_equal(flexinv.torques(ur5, fewer, hold={"wrist_3_joint": 0.25}), expected)
    with pytest.raises(
        InputError, match="no position of wrist_3_joint; no rate of wrist_3_joint; no acceleration of wrist_3"
    ):
        flexinv.torques(ur5, fewer)
    with pytest.raises(InputError, match="hold: joint 'wrist' is none that moves"):
        flexinv.torques(ur5, fewer, hold={"wrist": 0.0})


def test_a_body_that_turns_and_moves_freely_is_compared_and_differentiated_like_a_joint() -> None:
    """Its rates are in its own axes, its positions in the world's: from one sample to the next they agree to the square."""
    body = flexinv.Body("body", flexinv.Inertia(2.0, [0.1, 0.0, 0.0], np.diag([0.1, 0.2, 0.25])))
    joint = Joint("base", "free", "world", "body", actuated=False)
    mechanism = Mechanism("free body", (Link("body", (body,)),), (joint,), np.array([0.0, 0.0, -9.81]))
    time = 1e-2 * np.arange(200)
    turn = Rotation.from_rotvec(np.column_stack([np.sin(2 * time), 0.5 * np.cos(time), 0.3 * time])).as_quat()
    place = np.column_stack([np.sin(time), np.cos(2 * time), time**2, turn])
    q, qd, qdd = flexinv.Motion.from_samples(time, {"base": place}).evaluate(mechanism, time)
    expected = flexinv.joint_torques(mechanism, q, qd, qdd)
    names = list_coordinates(joint, "position")
    rates = [f"rate {name}" for name in mechanism.velocity_names]
    motion = pd.DataFrame(q, columns=list(names), index=pd.Index(time, name="time_s"))
    assert relative(flexinv.torques(mechanism, motion).to_numpy(), expected) < 1e-10
    motion[rates] = qd
    # A quintic spline through rates, where they came from one through positions: both are off by the fifth power of the spacing.
    assert relative(flexinv.torques(mechanism, motion).to_numpy(), expected) < 1e-5
    motion[rates[4]] *= 1.5
    with pytest.raises(InputError, match=r"'rate base\.wy' is 1\.5 times"):
        flexinv.torques(mechanism, motion)


def test_no_true_motion_is_refused_and_wrong_factors_are_found() -> None:
    """Laws of every kind, with jumps of the acceleration, at a few samples or many, in a few digits or all."""
    random = np.random.default_rng(0)
    found = 0
    compared = 0
    for _ in range(400):
        law = find_law(str(random.choice(list(LAWS))))
        count = int(random.integers(5, 400))
        time = np.linspace(0.0, 1.0, count)
        move = random.uniform(0.5, 1.0)
        delay = random.uniform(0.0, 1.0 - move)
        path = evaluate_progress(law, (time - delay) / move, np.zeros(count, dtype=bool))
        decimals = int(random.choice([3, 4, 6]))
        x, v, a = (np.round(part / move**k, decimals)[:, None] for k, part in enumerate(path))
        digit = np.array([10.0**-decimals])
        for slopes, values in ((v, x), (a, v)):
            moved = np.diff(values, axis=0)
            factor, allowed = compute_slope_factors(time, slopes, moved, digit, digit)
            assert abs(factor[0] - 1.0) <= allowed[0]
            for wrong in (-1.0, 2.0, np.pi / 180.0):
                factor, allowed = compute_slope_factors(time, wrong * slopes, moved, digit, wrong * digit)
                found += bool(abs(factor[0] - 1.0) > allowed[0])
                compared += 1
    assert found > 0.97 * compared  # the others have five samples and jumps between them


def test_a_joint_without_actuator_and_column_moves_as_forces_make_it(root: Path) -> None:
    robot = flexinv.load_mechanism(root / "models" / "rigid_3r")
    sprung = replace(robot.joints[2], actuated=False, stiffness=200.0, damping=2.0)
    loose = replace(robot, joints=(*robot.joints[:2], sprung))
    time = 2e-3 * np.arange(100)
    angles = {name: 0.2 * (1.0 - np.cos(4.0 * time)) for name in loose.velocity_names[:2]}
    expected = flexinv.solve(loose, flexinv.Motion.from_samples(time, angles), 2e-3)
    with pytest.warns(ModelWarning, match="joints without actuator and column move as forces make them: joint3"):
        found = flexinv.torques(loose, pd.DataFrame({"time_s": time, **angles}))
    assert relative(found.to_numpy(), expected.torque_all) < 1e-9  # the march sees rounding of times, as above


def test_the_motion_of_a_case_is_a_motion_file(root: Path) -> None:
    folder = root / "models" / "elastic_drives"
    drives = flexinv.load_mechanism(folder)
    case = next(c for c in flexinv.load_cases(folder, drives).values() if c.motion.tracks[0].sampling is not None)
    time = case.motion.tracks[0].sampling.time
    q, qd, qdd = case.motion.evaluate(drives, time)
    found = flexinv.torques(drives, folder / "swing.csv")
    # A case may bring its samples to rest at both ends, and within the reach of a spline's ends it then differs.
    middle = slice(len(time) // 3, 2 * len(time) // 3)
    assert relative(found.to_numpy()[middle], flexinv.joint_torques(drives, q, qd, qdd)[middle]) < 1e-6


def test_limits_that_a_motion_passes_are_said(root: Path, tmp_path: Path) -> None:
    """Elbow to 4 rad where 3.14 is its end, the pan at 4 rad/s where 3.15 is allowed; a motion inside of all says nothing."""
    arm = flexinv.from_urdf(find_robots_folder() / ROBOTS[0])
    time = np.linspace(0.0, 1.0, 101)
    q = np.zeros((101, 6))
    q[:, 0] = 2.0 * time**2
    q[:, 2] = 4.0 * time**2 * (3.0 - 2.0 * time)
    names = [column.name for column in arm.joints if column.nv]
    with pytest.warns(ModelWarning) as said:
        flexinv.torques(arm, pd.DataFrame({"time_s": time, **{f"{n}_rad": c for n, c in zip(names, q.T, strict=True)}}))
    words = " ".join(str(one.message) for one in said)
    assert "positions pass the limits of the robot: elbow_joint 4 rad (limit 3.14" in words
    assert re.search(r"rates pass the limits of the robot: shoulder_pan_joint (4|3\.99\d*) rad/s \(limit 3.15\)", words)
    assert "wrist" not in words.partition("rates pass")[0]
    with warnings.catch_warnings():
        warnings.simplefilter("error", ModelWarning)
        q[:, 2] /= 4.0
        q[:, 0] /= 4.0
        flexinv.torques(arm, pd.DataFrame({"time_s": time, **{f"{n}_rad": c for n, c in zip(names, q.T, strict=True)}}))
