"""Wrong arguments: one InputError that names the argument, what was given, what was expected, and what to write instead."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexinv
from flexinv.arguments import floats, number, whole
from flexinv.errors import InputError
from flexinv.files.case import load_cases

MODELS = Path(__file__).resolve().parent.parent / "models"
BENT, ROBOT, LOOP = (flexinv.load_mechanism(MODELS / name) for name in ("flex_one_link", "ur5", "four_bar"))
TURN = flexinv.Motion.point_to_point({"hub": 0.0}, {"hub": 1.0}, duration=0.2)
CRANK = next(iter(load_cases(MODELS / "four_bar", LOOP).values())).motion
STEP, REST = 1e-2, np.zeros((2, 6))
any_: Any = object()  # whatever it is


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
    (lambda: many(each=[{"evry": 2}]), "solve_many: each[0]: 'evry' is no option of solve"),
    (lambda: parts(part=2.5), "part = 2.5: expected a whole number: the number of samples of a part, 1 or more"),
    (lambda: parts(mechanism=LOOP, motion=CRANK), "solve_in_parts: mechanism 'four_bar' has closures"),
    (lambda: parts(motion=None), "motion = None: expected a Motion"),
    (lambda: parts(every="x"), "every = 'x': expected a whole number"),
    (lambda: parts(start=3), "start = 3: expected a table"),
    (lambda: parts(tolerance=-1), "tolerance = -1.0: expected a part of the mechanism's length above 0"),
]  # fmt: skip
SAMPLES: list[Case] = [
    (lambda: flexinv.prepare(any_), "mechanism = an object: expected a Mechanism"),
    (lambda: flexinv.prepare([ROBOT]), "mechanism = [a Mechanism]: expected a Mechanism"),  # type: ignore[arg-type]
    (lambda: flexinv.prepare(ROBOT, threads=1.5), "threads = 1.5: expected a whole number: 1 or more"),  # type: ignore[arg-type]
    (lambda: flexinv.prepare(ROBOT, threads="2"), "one per processor; write 2"),  # type: ignore[arg-type]
    (lambda: flexinv.prepare(ROBOT, threads=[2]), "threads = [2]: expected a whole number"),  # type: ignore[arg-type]
    (lambda: flexinv.prepare(ROBOT, passive="no"), "passive = 'no': expected True or False"),  # type: ignore[arg-type]
    (lambda: torques(q="a"), "joint_torques: q: expected numbers, got 'a'"),
    (lambda: torques(q=None), "joint_torques: q: expected numbers, got None"),
    (lambda: torques(qd=REST.astype(str)), "joint_torques: qd: expected numbers, got an array of shape (2, 6)"),
    (lambda: torques(qdd=REST * 1j), "joint_torques: qdd: expected numbers, got complex ones; write their .real"),
    (lambda: torques(q=REST > 0), "joint_torques: q: expected numbers, got True and False; write 1.0 and 0.0"),
    (lambda: torques(q=[[0.0], [0.0, 1.0]]), "write lists of equal length"),
    (lambda: torques(threads=0.5), "threads = 0.5: expected a whole number"),
]
MESHES: list[Case] = [
    (lambda: BENT.with_mesh(2.5, 1), "elements = 2.5: expected a whole number: 1 or more"),  # type: ignore[arg-type]
    (lambda: BENT.with_mesh("a", 1), "elements = 'a': expected a whole number: 1 or more"),  # type: ignore[arg-type]
    (lambda: BENT.with_mesh(0, 1), "elements = 0: expected 1 or more"),
    (lambda: BENT.with_mesh(1, 0), "order = 0: expected 1 or more"),
    (lambda: BENT.refined(elements=1.5), "elements = 1.5: expected a whole number"),  # type: ignore[arg-type]
    (lambda: BENT.refined(order=-1), "order = -1: expected 0 or more"),
]
CASES = [*MARCHES, *SAMPLES, *MESHES]


@pytest.mark.parametrize(("call", "said"), CASES, ids=[f"{k}: {said[:40]}" for k, (_, said) in enumerate(CASES)])
def test_wrong_argument(call: Callable[[], object], said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)):
        call()


def test_what_numpy_counts_and_measures_is_taken() -> None:
    two = np.int32(2)
    assert BENT.with_mesh(np.int64(3), np.uint8(1)).beams[0].beam == BENT.with_mesh(3, 1).beams[0].beam
    plain = flexinv.solve(BENT, TURN, STEP, end=0.1, every=2)
    same = flexinv.solve(BENT, TURN, np.float64(STEP), end=np.array(0.1), every=two, error=np.False_)  # type: ignore[arg-type]
    np.testing.assert_array_equal(same.torque, plain.torque)
    assert flexinv.prepare(ROBOT, threads=two) is not None
    assert len(list(flexinv.solve_in_parts(BENT, TURN, STEP, part=np.int64(10)))) == 2


def test_numbers_are_read_as_they_are() -> None:
    q = np.zeros(3)
    assert floats("q", q) is q
    for given in ([1, 2], (1.0, 2.0), np.array([1, 2], dtype=np.int8), np.array([1.0, 2], dtype=object)):
        np.testing.assert_array_equal(floats("q", given), [1.0, 2.0])
    assert whole("n", np.uint16(3), 1) == 3
    assert number("x", np.float32(0.5), "") == number("x", np.array(0.5), "") == 0.5
    for wrong in ("1", None, 1j, [1], np.zeros(2), np.True_, object()):
        with pytest.raises(InputError, match=r"x = .*: expected a length"):
            number("x", wrong, "a length")
        with pytest.raises(InputError, match=r"n = .*: expected a whole number"):
            whole("n", wrong, 0)
