"""Wrong arguments: one InputError that names the argument, what was given, what was expected, and what to write instead."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexinv
from flexinv.analysis.motor_side import motor_side
from flexinv.errors import InputError
from flexinv.files.load_cases import load_cases
from flexinv.model.motion import Motion
from flexinv.rigid.torque_regressor import sample_states
from flexinv.tracking.frame_path import Path as Line
from flexinv.tracking.task_file import load_tasks
from flexinv.validation import check_number, check_whole_number, convert_to_floats

MODELS = Path(__file__).resolve().parents[2] / "models"
BENT: Any
ROBOT: Any
TWO: Any
LOOP: Any
BENT, ROBOT, TWO, LOOP = (
    flexinv.load_mechanism(MODELS / name) for name in ("flex_one_link", "ur5", "flex_two_link", "four_bar")
)
TURN = flexinv.Motion.point_to_point({"hub": 0.0}, {"hub": 1.0}, duration=0.2)
CRANK = next(iter(load_cases(MODELS / "four_bar", LOOP).values())).motion
STEP, REST = 1e-2, np.zeros((2, 6))
ANY: Any = object()  # whatever it is
ZERO = np.zeros(6)


def solve(**given: Any) -> object:
    return flexinv.solve(**{"mechanism": BENT, "motion": TURN, "step": STEP, **given})


def many(**given: Any) -> object:
    return flexinv.solve_many(**{"mechanisms": BENT, "motions": [TURN], "step": STEP, **given})


def parts(**given: Any) -> object:
    return flexinv.solve_in_parts(**{"mechanism": BENT, "motion": TURN, "step": STEP, **given})


def torques(q: Any = REST, qd: Any = REST, qdd: Any = REST, **given: Any) -> object:
    return flexinv.joint_torques(ROBOT, q, qd, qdd, **given)


Case = tuple[Callable[[], object], str]
MARCHES: list[Case] = [
    (lambda: solve(mechanism=1), "mechanism = 1: expected a Mechanism; write flexinv.load_mechanism('models/ur5')"),
    (lambda: solve(mechanism="a/b"), "mechanism = 'a/b': expected a Mechanism; write flexinv.load_mechanism('a/b')"),
    (lambda: solve(mechanism=Path("a")), "mechanism = 'a': expected a Mechanism; write flexinv.load_mechanism('a')"),
    (lambda: solve(motion=2), "motion = 2: expected a Motion; write flexinv.Motion.point_to_point("),
    (lambda: solve(motion=flexinv.Motion), "motion = the class Motion: expected a Motion"),
    (lambda: solve(step="1e-2"), "step = '1e-2': expected a positive number of seconds, for example step=1e-3; write 0.01"),
    (lambda: solve(step=True), "step = True: expected a positive number"),
    (lambda: solve(step=np.array([1e-2, 1])), "step = an array of shape (2,): expected a positive number"),
    (lambda: solve(end="x"), "end = 'x': expected a positive time, or None for the motion's duration"),
    (lambda: solve(error="no"), "error = 'no': expected True or False"),
    (lambda: solve(incremental=2), "incremental = 2: expected True or False"),
    (lambda: solve(spectral_radius="x"), "spectral_radius = 'x': expected 0 (strong) to 1"),
    (lambda: solve(spectral_radius=0.8j), "spectral_radius = 0.8j: expected 0 (strong) to 1"),
    (lambda: solve(tolerance=None), "tolerance = None: expected a part of the mechanism's length, for example 1e-9"),
    (lambda: solve(initial=None), "initial = None: expected 'consistent' (starts undeformed) or 'static'"),
    (lambda: solve(initial=["static"]), "initial = ['static']: expected 'consistent'"),
    (lambda: solve(start=3), 'start = 3: expected a table of joints and their coordinates; write start={"joint": 0.1}'),
    (lambda: solve(start=0), "start = 0: expected a table of joints"),
    (lambda: solve(start_rate=[1.0]), "start_rate = [1.0]: expected a table of joints and their rates"),
    (lambda: solve(progress=3), "progress = 3: expected a function of the number of steps done since its last call, or None"),
    (lambda: solve(every=2.5), "every = 2.5: expected a whole number: 1 to keep all steps, or more to keep one of so many"),
    (lambda: solve(every=2.0), "one of so many; write 2"),
    (lambda: solve(every="2"), "every = '2': expected a whole number"),
    (lambda: solve(every=True), "every = True: expected a whole number"),
    (lambda: many(threads=1.5), "threads = 1.5: expected a whole number: 1 or more, or None for one per processor"),
    (lambda: many(progress=[]), "progress = []: expected a function that is called with 1 after every scenario, or None"),
    (lambda: many(stp=1), "solve_many: 'stp' is no option of solve: expected some of step, error, end"),
    (lambda: many(mechanisms="ab"), "solve_many: mechanisms is a str: expected one Mechanism or a list"),
    (lambda: many(each=[{3: 2}]), "solve_many: each[0]: 3 is no option of solve"),
    (lambda: many(each=[{"evry": 2}]), "solve_many: each[0]: 'evry' is no option of solve"),
    (lambda: parts(part=2.5), "part = 2.5: expected a whole number: the number of samples of a part, 1 or more"),
    (lambda: parts(mechanism=LOOP, motion=CRANK), "solve_in_parts: mechanism 'four_bar' has closures"),
    (lambda: parts(motion=None), "motion = None: expected a Motion"),
    (lambda: parts(every="x"), "every = 'x': expected a whole number"),
    (lambda: parts(start=3), "start = 3: expected a table"),
    (lambda: parts(tolerance=-1), "tolerance = -1.0: expected a part of the mechanism's length above 0"),
]  # fmt: skip
SAMPLES: list[Case] = [
    (lambda: flexinv.prepare(ANY), "mechanism = an object: expected a Mechanism"),
    (lambda: flexinv.prepare([ROBOT]), "mechanism = [a Mechanism]: expected a Mechanism"),
    (lambda: flexinv.prepare(ROBOT, threads=1.5), "threads = 1.5: expected a whole number: 1 or more"),
    (lambda: flexinv.prepare(ROBOT, threads="2"), "one per processor; write 2"),
    (lambda: flexinv.prepare(ROBOT, threads=[2]), "threads = [2]: expected a whole number"),
    (lambda: flexinv.prepare(ROBOT, passive="no"), "passive = 'no': expected True or False"),
    (lambda: torques(q="a"), "joint_torques: q: expected numbers, got 'a'"),
    (lambda: torques(q=None), "joint_torques: q: expected numbers, got None"),
    (lambda: torques(qd=REST.astype(str)), "joint_torques: qd: expected numbers, got an array of shape (2, 6)"),
    (lambda: torques(qdd=REST * 1j), "joint_torques: qdd: expected numbers, got complex ones; write their .real"),
    (lambda: torques(q=REST > 0), "joint_torques: q: expected numbers, got True and False; write 1.0 and 0.0"),
    (lambda: torques(q=[[0.0], [0.0, 1.0]]), "write lists of equal length"),
    (
        lambda: torques(order=np.array(["samples", "x"])),
        "joint_torques: order = an array of shape (2,), expected 'samples'",
    ),
    (lambda: torques(threads=0.5), "threads = 0.5: expected a whole number"),
]
MESHES: list[Case] = [
    (lambda: BENT.with_mesh(2.5, 1), "elements = 2.5: expected a whole number: 1 or more"),
    (lambda: BENT.with_mesh("a", 1), "elements = 'a': expected a whole number: 1 or more"),
    (lambda: BENT.with_mesh(0, 1), "elements = 0: expected 1 or more"),
    (lambda: BENT.with_mesh(1, 0), "order = 0: expected 1 or more"),
    (lambda: BENT.refined(elements=1.5), "elements = 1.5: expected a whole number"),
    (lambda: BENT.refined(order=-1), "order = -1: expected 0 or more"),
]
FREE: Any = flexinv  # what is called with arguments that no type allows
FILES: list[Case] = [
    (lambda: FREE.load_mechanism(3), "path = 3: expected the path of a folder that has a mechanism.toml"),
    (lambda: FREE.load_mechanism(None), "path = None: expected the path"),
    (lambda: load_cases(ANY, BENT), "path = an object: expected the path of a folder that has a cases.toml"),
    (lambda: load_cases(MODELS / "ur5", ANY), "mechanism = an object: expected a Mechanism"),
    (lambda: load_tasks(MODELS / "flex_two_link", ANY), "mechanism = an object: expected a Mechanism"),
    (lambda: FREE.from_urdf(3), "path = 3: expected the path of a URDF file"),
    (lambda: FREE.from_urdf("x", packages="a"), "packages = 'a': expected a list of folders; write ['a']"),
    (lambda: FREE.from_urdf("x", packages=3), "packages = 3: expected a list of folders"),
    (lambda: FREE.from_urdf("x", packages=[3]), "packages[0] = 3: expected the path of a folder"),
    (lambda: FREE.from_urdf("x", lock="elbow"), "lock = 'elbow': expected a list of names of joints; write ['elbow']"),
    (lambda: FREE.from_urdf("x", base=["free"]), 'expected "fixed" or "free"'),
    (lambda: FREE.from_urdf("x", gravity="down"), "gravity: expected numbers, got 'down'"),
]
TIME = np.arange(6.0)
M: Any = Motion
P: Any = Line
TASKS: list[Case] = [
    (lambda: M.point_to_point({"a": 0}, {"a": 1}, "1"), "duration = '1': expected a positive time [s]; write 1"),
    (lambda: M.point_to_point({"a": 0}, {"a": 1}, 1, hold=None), "hold = None: expected a time, 0 or more [s]"),
    (lambda: M.point_to_point({"a": 0}, {"a": 1}, 1, delay=1j), "delay = 1j: expected a time, 0 or more [s]"),
    (lambda: M.point_to_point({"a": 0}, {"a": 1}, 1, law=3), "law = 3: expected one of cycloid"),
    (lambda: M.point_to_point({"a": 0}, {"a": 1}, 1, law=["x"]), "law = ['x']: expected one of cycloid"),
    (lambda: M.point_to_point({"a": "1"}, {"a": 1}, 1), "start, joint 'a': expected numbers, got '1'"),
    (lambda: M.point_to_point({"a": 0}, None, 1), "end: expected numbers, got None"),
    (lambda: M.point_to_point({"a": 0, 3: 1}, {"a": 1, 4: 1}, 1), "expected the same joints in both"),
    (lambda: M.from_samples(TIME, TIME, "hub"), "names = 'hub': expected a list of names of joints; write ['hub']"),
    (lambda: M.from_samples(TIME, TIME, 3), "names = 3: expected a list of names of joints"),
    (lambda: M.from_samples(TIME, {"a": TIME}, ["b"]), "names = ['b']: expected None where q is a table of joints"),
    (lambda: M.from_samples(TIME, TIME, degree=5.0), "degree = 5.0: expected a whole number: 5 (smooth jerk) or 3"),
    (lambda: M.from_samples(TIME, TIME, rest="no"), "rest = 'no': expected True or False"),
    (lambda: M.from_samples(TIME, TIME, max_gap="x"), "max_gap = 'x': expected the longest interval [s], or None"),
    (lambda: M.from_samples(TIME, TIME, max_gap=np.nan), "max_gap = nan: expected the longest interval [s], above 0"),
    (lambda: M.point_to_point({"a": [[0]]}, {"a": 1}, 1), "start, joint 'a': expected a number or a list of them, got shape"),
    (lambda: M.from_samples(TIME, TIME * 1j), "q: expected numbers, got complex ones"),
    (lambda: M.merge([TURN, TURN]), "merge: motion = [a Motion, a Motion]: expected a Motion"),
    (lambda: TURN.evaluate(ANY, [0.0]), "mechanism = an object: expected a Mechanism"),
    (lambda: TURN.evaluate(BENT, [0.0], side=ANY), "side = an object: expected 'left' (before a jump) or 'right'"),
    (lambda: TURN.joints(ANY), "mechanism = an object: expected a Mechanism"),
    (lambda: P.line("a", [0, 1, 0], 1), "start: expected numbers, got 'a'"),
    (lambda: P.line([0, 0], [0, 1, 0], 1), "start = [0, 0]: expected three finite numbers [m]"),
    (lambda: P.line([0, 0, 0], [0, 1, 0], "1"), "duration = '1': expected a positive time [s]; write 1"),
    (lambda: P.line([0, 0, 0], [0, 1, 0], 1, law=3), "law = 3: expected one of cycloid"),
    (lambda: P.arc([1, 0, 0], [0, 0, 0], "x", 1), "angle = 'x': expected a finite number of radians"),
    (lambda: P.points([[0, 0, 0], [1, 0]], 1), "points: expected numbers, got [[0, 0, 0], [1, 0]]; write lists of equal length"),
    (lambda: UP.turning(np.eye(3), "x"), "end: expected numbers, got 'x'"),
    (lambda: UP.turning(3, np.eye(3)), "turning: expected two rotation matrices (3, 3) [-]"),
    (lambda: UP.evaluate(0.1), "time: expected shape (samples,), got ()"),
    (lambda: FREE.follow(ANY, UP, "link2", STEP), "mechanism = an object: expected a Mechanism"),
    (lambda: FREE.follow(TWO, TURN, "link2", STEP), "path = a Motion: expected a Path; write flexinv.Path.line("),
    (lambda: FREE.follow(TWO, UP, 2, STEP), "frame = 2: expected the name of a link, whose tip follows, or an Attachment"),
    (lambda: FREE.follow(TWO, UP, "link2", "x"), "step = 'x': expected a positive number of seconds"),
    (lambda: FREE.follow(TWO, UP, "link2", STEP, before="x"), "before = 'x': expected a time, 0 or more [s], or None"),
    (lambda: FREE.follow(TWO, UP, "link2", STEP, start=3), "start = 3: expected a table of joints"),
    (lambda: FREE.follow(TWO, UP, "link2", STEP, error="x"), "error = 'x': expected True or False"),
]  # fmt: skip
UP: Any = Line.line([0.3, 0.1, 0], [0.3, 0.15, 0], 0.2)
ENDS, NONE = [0.0, 0.1], [[0.0], [0.0]]
LOAD: Any = flexinv.Load
MODELLED: list[Case] = [
    (lambda: FREE.simulate(ANY, ENDS, NONE, STEP), "mechanism = an object: expected a Mechanism"),
    (lambda: FREE.simulate(BENT, "x", NONE, STEP), "simulate: time: expected numbers, got 'x'"),
    (lambda: FREE.simulate(BENT, ENDS, None, STEP), "simulate: torque has shape (2, 0), expected finite numbers (2, 1)"),
    (lambda: FREE.simulate(BENT, ENDS, NONE, "x"), "step = 'x': expected a positive number of seconds"),
    (lambda: FREE.simulate(BENT, ENDS, NONE, 1e-12), "more than 5000000: write a larger step"),
    (lambda: FREE.simulate(BENT, ENDS, NONE, STEP, "x"), "spectral_radius = 'x': expected 0 (strong) to 1"),
    (lambda: FREE.simulate(BENT, ENDS, NONE, STEP, initial=3), "simulate: initial = 3, expected 'consistent'"),
    (lambda: FREE.simulate(BENT, ENDS, NONE, STEP, start=3), "start = 3: expected a table of joints"),
    (lambda: FREE.simulate(BENT, ENDS, NONE, STEP, progress=3), "progress = 3: expected a function of the number of samples"),
    (lambda: FREE.statics(ANY), "mechanism = an object: expected a Mechanism"),
    (lambda: FREE.statics(BENT, q="x"), "statics: q: expected numbers, got 'x'"),
    (lambda: FREE.statics(BENT, LOAD("link")), "loads = a Load: expected a list, each a Load; write [loads]"),
    (lambda: FREE.statics(BENT, "link"), "loads = 'link': expected a list, each a Load; write [flexinv.Load("),
    (lambda: FREE.statics(BENT, [3]), "loads[0] = 3: expected a Load; write flexinv.Load("),
    (lambda: FREE.statics(BENT, [LOAD(["x"])]), "load on ['x']: link = ['x']: expected a text"),
    (lambda: FREE.statics(BENT, [LOAD("x")]), "load: no link 'x' in 'flex_one_link'"),
    (lambda: FREE.statics(BENT, [LOAD("link", force="x")]), "load on 'link': force: expected numbers, got 'x'"),
    (lambda: FREE.statics(BENT, [LOAD("link", station="x")]), "load on 'link': station = 'x': expected a finite number"),
    (lambda: FREE.statics(BENT, [LOAD("link", follower="x")]), "load on 'link': follower = 'x': expected True or False"),
    (lambda: FREE.natural_modes(ANY), "mechanism = an object: expected a Mechanism"),
    (lambda: FREE.natural_modes(BENT, "x"), "modes: q: expected numbers, got 'x'"),
    (lambda: FREE.natural_modes(BENT, free="hub"), "free = 'hub': expected a list of names of joints; write ['hub']"),
    (lambda: FREE.natural_modes(BENT, free=[3]), "free = [3]: expected a list of names of joints"),
    (lambda: FREE.natural_modes(BENT, count=2.5), "count = 2.5: expected a whole number: 1 or more, or None for all"),
    (lambda: FREE.natural_modes(BENT, count=-1), "count = -1: expected 1 or more, or None for all"),
    (lambda: FREE.steady_modes(BENT, rates=3), "rates = 3: expected a table of joints and their rates"),
    (lambda: FREE.steady_modes(BENT, rates={"hub": "x"}), "rate of joint 'hub' = 'x': expected a finite number [rad/s]"),
    (lambda: FREE.steady_modes(BENT, count="2"), "count = '2': expected a whole number: 1 or more, or None for all; write 2"),
    (lambda: FREE.linear_model(ANY), "mechanism = an object: expected a Mechanism"),
    (lambda: FREE.linear_model(BENT, modes=-1), "modes = -1: expected 0 or more, or None for all"),
    (lambda: FREE.linear_model(BENT, accelerated="hub"), "accelerated = 'hub': expected a list of names of joints"),
    (lambda: FREE.linear_model(BENT, free=3), "free = 3: expected a list of names of joints"),
    (lambda: FREE.torque_derivatives(ANY, ZERO, ZERO, ZERO), "mechanism = an object: expected a Mechanism"),
    (lambda: FREE.torque_derivatives(ROBOT, ZERO, ZERO, None), "joint_torques: qdd: expected numbers, got None"),
    (lambda: FREE.torque_derivatives(ROBOT, ZERO, ZERO, ZERO, "x"), "passive = 'x': expected True or False"),
    (lambda: FREE.torque_regressor(ANY, ZERO, ZERO, ZERO), "mechanism = an object: expected a Mechanism"),
    (lambda: FREE.torque_regressor(ROBOT, ZERO, ZERO, ZERO, "x"), "drives = 'x': expected True or False"),
    (lambda: FREE.base_parameters(ROBOT), "regressor = a Mechanism: expected a Regressor; write flexinv.torque_regressor("),
    (lambda: sample_states(ROBOT, ANY), "samples = an object: expected a whole number: 0 or more"),
    (lambda: sample_states(ROBOT, -1), "samples = -1: expected 0 or more"),
    (lambda: motor_side(ANY), "solution = an object: expected a Solution; write flexinv.solve("),
    (lambda: RIGID.factors(2.5), "sample = 2.5: expected a whole number: a number from 0 to 2, or from -3 to -1"),
    (lambda: RIGID.factors(3), "sample = 3: expected a number from 0 to 2, or from -3 to -1 counted from the end"),
]  # fmt: skip
RIGID: Any = flexinv.solve(ROBOT, Motion.point_to_point(ZERO, ZERO + 1, 0.2), 0.1)
CONTROL: Any = flexinv.Controller
CYCLES: list[Case] = [
    (lambda: CONTROL.of(3), "mechanism = 3: expected a Mechanism"),
    (lambda: CONTROL.of(BENT, "x"), "step = 'x': expected the time between two calls in seconds"),
    (lambda: CONTROL.of(ROBOT, "x"), "step = 'x': expected the time between two calls in seconds"),
    (lambda: CONTROL.of(BENT, STEP, "x"), "spectral_radius = 'x': expected 0 (strong) to 1"),
    (lambda: CONTROL.of(ROBOT).step(3, 4, 5), "joint_torques: q has shape ()"),
    (lambda: CONTROL.of(ROBOT).step("abcdef", ZERO, ZERO), "joint_torques: q: expected numbers, got 'abcdef'"),
    (lambda: FREE.prepare(ROBOT).sample(3, ZERO, ZERO, ZERO), "joint_torques: q has shape ()"),
    (lambda: FREE.prepare(ROBOT).sample(ZERO, ZERO, ZERO, 3), "joint_torques: out is 3, expected an array of float64"),
    (lambda: FREE.prepare(ROBOT).sample(ZERO[:2], ZERO, ZERO, ZERO.copy()), "joint_torques: q has shape (2,)"),
]
CASES = [*MARCHES, *SAMPLES, *MESHES, *FILES, *TASKS, *MODELLED, *CYCLES]


@pytest.mark.parametrize(("call", "said"), CASES, ids=[f"{k}: {said[:40]}" for k, (_, said) in enumerate(CASES)])
def test_wrong_argument(call: Callable[[], object], said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)):
        call()


def test_what_numpy_counts_and_measures_is_taken() -> None:
    two = np.int32(2)
    assert BENT.with_mesh(np.int64(3), np.uint8(1)).beams[0].beam == BENT.with_mesh(3, 1).beams[0].beam
    plain = flexinv.solve(BENT, TURN, STEP, end=0.1, every=2)
    same = flexinv.solve(BENT, TURN, np.float64(STEP), end=np.array(0.1), every=two, error=np.False_)
    np.testing.assert_array_equal(same.torque, plain.torque)
    assert flexinv.prepare(ROBOT, threads=two) is not None
    assert len(list(flexinv.solve_in_parts(BENT, TURN, STEP, part=np.int64(10)))) == 2


def test_numbers_are_read_as_they_are() -> None:
    q = np.zeros(3)
    assert convert_to_floats("q", q) is q
    for given in ([1, 2], (1.0, 2.0), np.array([1, 2], dtype=np.int8), np.array([1.0, 2], dtype=object)):
        np.testing.assert_array_equal(convert_to_floats("q", given), [1.0, 2.0])
    assert check_whole_number("n", np.uint16(3), 1) == 3
    assert check_number("x", np.float32(0.5), "") == check_number("x", np.array(0.5), "") == 0.5
    for wrong in ("1", None, 1j, [1], np.zeros(2), np.True_, object()):
        with pytest.raises(InputError, match=r"x = .*: expected a length"):
            check_number("x", wrong, "a length")
        with pytest.raises(InputError, match=r"n = .*: expected a whole number"):
            check_whole_number("n", wrong, 0)


def test_numbers_of_other_types_are_not_looked_at_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only objects are: a million samples as ``float32`` would take a second."""

    class Never(type):
        def __instancecheck__(cls, value: object) -> bool:
            raise AssertionError(f"{value!r} was looked at")

    monkeypatch.setattr("flexinv.validation.Real", Never("Real", (), {}))
    for given in (np.ones((2, 3), dtype=np.float32), np.ones(4, dtype=int), [1.0, 2.0]):
        assert convert_to_floats("q", given).dtype == float
    with pytest.raises(AssertionError, match="was looked at"):
        convert_to_floats("q", np.array([1.0], dtype=object))


def test_a_flexible_controller_says_what_it_cannot_take() -> None:
    """Also in a cycle, where arrays that are too short would be read beyond their end."""
    one: Any = np.zeros(1)
    controller: Any = flexinv.Controller.of(BENT, step=1e-3)
    with pytest.raises(InputError, match="controller: qdd: expected numbers, got complex ones"):
        controller.start(one, one, 1j * one)
    controller.start(one, one, one)
    for wrong, said in (
        ("a", "q: expected numbers, got 'a'"), (0.0, "q has shape ()"), (np.zeros(0), "q has shape (0,)"),
        (np.zeros((1, 1)), "q has shape (1, 1)"), (1j * one, "q: expected numbers, got complex ones"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=re.escape(f"controller: {said}")):
            controller.step(wrong, one, one)
    assert np.isfinite(controller.step(one, one, one)).all()


def test_what_does_all_that_is_asked_of_a_motion_is_one() -> None:
    class Seen:
        def __getattr__(self, name: str) -> Any:
            return getattr(TURN, name)

    stand_in: Any = Seen()
    np.testing.assert_array_equal(flexinv.solve(BENT, stand_in, STEP).torque, flexinv.solve(BENT, TURN, STEP).torque)


def test_a_replay_and_a_distance_are_of_their_path() -> None:
    following: Any = flexinv.follow(TWO, UP, "link2", 1e-2, start={"joint1": -0.5, "joint2": 1.0})
    with pytest.raises(InputError, match=r"name = 'elastic': expected 'rigid' .*'joint space' .*'stable inversion'"):
        following.replay("elastic")
    with pytest.raises(InputError, match="solution = 3: expected a Solution"):
        following.distance(3)
    with pytest.raises(InputError, match=r"solution has 3 samples, expected the \d+ of this path"):
        following.distance(RIGID)
