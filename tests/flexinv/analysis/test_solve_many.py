"""solve_many: the same numbers as one after the other, in order, whatever fails on the way."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np
import pytest
from flexible_examples import HALF_TURN, STRIP, arm
from numpy.typing import ArrayLike
from planar_examples import CLOSED_CASES, PAPER_CASES

import flexinv
from flexinv.kernels.memory import begin_shared_memory, make_adjacent_arrays
from flexinv.model.mechanism import Body, Inertia, Joint, Link, Mechanism
from flexinv.model.motion import evaluate_motion
from flexinv.planar.solver import PlanarMarch, _list_reusable
from flexinv.typing import Array

STEP = 2e-3


def _loaded(mass: float) -> Mechanism:
    """The paper's link with a point mass at its tip [kg]."""
    plain = arm()
    load = Body("load", Inertia(mass, np.zeros(3), np.zeros((3, 3))), 1.0)
    return replace(plain, links=(replace(plain.links[0], bodies=(load,)),))


def _flexible(stiffness: float) -> Mechanism:
    return arm(section=replace(STRIP, stiffness=stiffness * STRIP.stiffness))


def test_payloads_and_stiffnesses_give_what_each_gives_alone_bit_for_bit() -> None:
    mechanisms = [_loaded(mass) for mass in (0.0, 0.001, 0.002, 0.005)] + [_flexible(k) for k in (0.5, 2.0)]
    batch = flexinv.solve_many(mechanisms, HALF_TURN, STEP, threads=3)
    assert not batch.errors
    for mechanism, solution in zip(mechanisms, batch.all(), strict=True):
        alone = flexinv.solve(mechanism, HALF_TURN, STEP)
        assert solution.mechanism is mechanism
        np.testing.assert_array_equal(solution.torque, alone.torque)
        np.testing.assert_array_equal(solution.nodes.x, alone.nodes.x)
        np.testing.assert_array_equal(solution.balance.power, alone.balance.power)


def test_motions_and_options_of_each_scenario() -> None:
    motions = [flexinv.Motion.point_to_point([0.0], [angle], 0.2) for angle in (0.5, 1.0)]
    each = [{"step": 1e-3}, {"spectral_radius": 0.5}]
    first, second = flexinv.solve_many(arm(), motions, STEP, each=each, threads=2).all()
    assert len(first.time) == 201
    assert second.settings["spectral_radius"] == 0.5
    np.testing.assert_array_equal(second.torque, flexinv.solve(arm(), motions[1], STEP, spectral_radius=0.5).torque)


def test_one_failure_does_not_lose_the_others() -> None:
    soft = arm(1, 1, section=replace(STRIP, stiffness=STRIP.stiffness * np.array([1, 1, 1, 1, 1, 1e-3])))
    done: list[int] = []
    batch = flexinv.solve_many([arm(), soft, arm()], HALF_TURN, STEP, threads=2, progress=done.append)
    assert list(batch.errors) == [1]
    assert isinstance(batch.errors[1], flexinv.ConvergenceError)
    assert [solution is None for solution in batch.solutions] == [False, True, False]
    assert done == [1, 1, 1]
    with pytest.raises(flexinv.ConvergenceError):
        batch.all()


def test_unequal_lists_are_refused() -> None:
    with pytest.raises(flexinv.InputError, match="motions has 2, mechanisms has 3: expected lists of equal length"):
        flexinv.solve_many([arm()] * 3, [HALF_TURN] * 2, STEP)
    with pytest.raises(flexinv.InputError, match="threads = 0: expected 1 or more"):
        flexinv.solve_many(arm(), HALF_TURN, STEP, threads=0)


@pytest.mark.parametrize("threads", [1, 2])
def test_ctrl_c_ends_the_batch_soon(threads: int) -> None:
    """The others finish what they are at, and begin nothing more."""
    done: list[int] = []

    def interrupted(count: int) -> None:
        done.append(count)
        if len(done) == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        flexinv.solve_many(arm(), [HALF_TURN] * 50, STEP, threads=threads, progress=interrupted)
    assert len(done) <= 2 * threads


def test_a_system_that_does_not_let_threads_move_is_no_hindrance(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(process: int, to: object) -> None:
        raise PermissionError("not in this sandbox")

    monkeypatch.setattr("os.sched_setaffinity", refused, raising=False)
    assert not flexinv.solve_many(arm(), [HALF_TURN] * 3, STEP, threads=2).errors


@pytest.mark.parametrize("alike", [False, True])
def test_what_is_kept_of_a_solution_does_not_keep_all_of_it(alike: bool) -> None:
    """Of a thousand payloads the tips alone: their memory is not a part of that of all nodes, but of all tips at most."""
    solutions = (
        flexinv.solve_many(arm(), [HALF_TURN] * 4, STEP).all() if alike else [flexinv.solve(arm(), HALF_TURN, STEP)]
    )
    for solution in solutions:
        most = 4 if alike else 1
        series = [part for parts in (solution.tip, solution.deflection, solution.wrench) for part in parts.values()]
        balance = solution.balance
        for part in (*series, solution.torque_all, solution.reaction, balance.power, balance.momentum):
            assert _whole(part).nbytes <= most * part.nbytes
        assert _whole(solution.nodes.x).nbytes > most * solution.nodes.x.nbytes


def _whole(part: np.ndarray) -> np.ndarray:
    """The memory that an array is a part of."""
    while isinstance(part.base, np.ndarray):
        part = part.base
    return part


@dataclass(frozen=True, eq=False)
class ScaledMotion(flexinv.Motion):
    """A motion that looks at the mechanism."""

    def evaluate(
        self, mechanism: Mechanism, time: ArrayLike, side: Literal["left", "right"] = "right"
    ) -> tuple[Array, Array, Array]:
        """Half of it for the mechanism of that name."""
        q, qd, qdd = super().evaluate(mechanism, time, side)
        size = 0.5 if mechanism.name == "half" else 1.0
        return size * q, size * qd, size * qdd


def test_a_motion_that_looks_at_the_mechanism_is_asked_for_each() -> None:
    mechanisms, motion = [arm(), replace(arm(), name="half")], ScaledMotion(HALF_TURN.tracks, HALF_TURN.duration)
    result = flexinv.solve_many(mechanisms, motion, STEP).all()
    for mechanism, solution in zip(mechanisms, result, strict=True):
        np.testing.assert_array_equal(solution.torque, flexinv.solve(mechanism, motion, STEP).torque)
    assert np.abs(result[0].torque).max() > 1.5 * np.abs(result[1].torque).max()


def test_a_scenario_that_is_none_keeps_its_error() -> None:
    batch = flexinv.solve_many([arm(), "an arm", arm()], HALF_TURN, STEP)  # type: ignore[list-item]
    assert list(batch.errors) == [1]
    assert [solution is None for solution in batch.solutions] == [False, True, False]


def test_what_is_no_list_is_explained() -> None:
    """A generator has no length, and is empty after its first use."""
    with pytest.raises(flexinv.InputError, match=r"mechanisms is a generator: expected one Mechanism or a list"):
        flexinv.solve_many((arm() for _ in range(2)), HALF_TURN, STEP)  # type: ignore[arg-type]
    with pytest.raises(flexinv.InputError, match=r"motions is a ndarray: expected one Motion or a list"):
        flexinv.solve_many(arm(), np.array([HALF_TURN, HALF_TURN]), STEP)  # type: ignore[arg-type]
    for each in ({"step": 1e-3}, [None], "step"):
        with pytest.raises(flexinv.InputError, match=r"each is a .*: expected a list with a table of options"):
            flexinv.solve_many(arm(), HALF_TURN, STEP, each=each)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["four-bar", "tilted rail", "one link, 1 x order 4", "two links", "one link, damped"])
def test_what_a_march_leaves_to_the_next_changes_nothing(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Arrays that hold the end of another motion give, bit for bit, what new ones give."""
    mechanism, motion, options = (CLOSED_CASES | PAPER_CASES)[name]()
    with monkeypatch.context() as new:
        new.setattr(PlanarMarch, "take_reusable", PlanarMarch.build_for)
        fresh = flexinv.solve(mechanism, motion, STEP, **options)
    flexinv.solve(mechanism, motion, STEP / 3, end=motion.duration / 2, **options)
    passive = {joint.name for joint in mechanism.joints if joint.nv} - set(motion.joints(mechanism))
    (left,) = _list_reusable(fresh.mesh, frozenset(passive))
    assert np.abs(left.system.state.u).max() > 0
    again = flexinv.solve(mechanism, motion, STEP, **options)
    for one, two in ((fresh.nodes, again.nodes), (fresh.balance, again.balance)):
        for field in fields(one):
            np.testing.assert_array_equal(getattr(one, field.name), getattr(two, field.name))
    np.testing.assert_array_equal(fresh.torque_all, again.torque_all)
    np.testing.assert_array_equal(fresh.reaction, again.reaction)


def test_arrays_of_one_piece_do_not_overlap_and_pieces_are_shared_only_within() -> None:
    """What is written into one array stays out of the others; alone, every call has a piece of its own."""
    shapes = (3, 5), (0, 4), (7,), (2, 3, 3)
    with begin_shared_memory():
        first, second = make_adjacent_arrays(*shapes), make_adjacent_arrays(*shapes)
    alone = make_adjacent_arrays(*shapes)
    assert [part.shape for part in first] == list(shapes)
    for k, part in enumerate((*first, *second, *alone)):
        part[...] = k
    assert all((part == k).all() for k, part in enumerate((*first, *second, *alone)))
    assert _whole(first[0]) is _whole(second[0]) is not _whole(alone[0])


def test_a_table_that_is_kept_is_that_of_the_joints() -> None:
    """Mechanisms of the same joints share it, others do not; nobody can write into it."""
    motion = flexinv.Motion.point_to_point({"turn": 0.0}, {"turn": 1.0}, 0.5)
    angle, endless = (
        Mechanism(kind, (Link("link"),), (Joint("turn", kind, "world", "link"),)) for kind in ("revolute", "continuous")
    )
    time = 0.01 * np.arange(51)
    table = evaluate_motion(motion, angle, time)
    assert evaluate_motion(motion, replace(angle, name="another"), time)[0] is table[0]
    for mechanism in (angle, endless):
        for kept, result in zip(
            evaluate_motion(motion, mechanism, time), motion.evaluate(mechanism, time), strict=True
        ):
            np.testing.assert_array_equal(kept, result)
    with pytest.raises(ValueError, match="read-only"):
        table[0][0] = 1.0
