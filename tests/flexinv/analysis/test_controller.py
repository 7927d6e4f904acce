"""The controller's calls are the steps of `solve`, and cost no memory once they run."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rigid_trees as trees
from bending_four_bar import bending
from flexible_examples import spatial_tree
from four_bar_example import START, four_bar
from hub_arm import hub_arm

import flexinv
from flexinv.analysis.controller import Controller
from flexinv.errors import ConvergenceError, InputError
from flexinv.files.load_cases import load_cases
from flexinv.model.mechanism import WORLD, Attachment, Closure, Force, Mechanism, Placement, Spring
from flexinv.rigid.torque_regressor import sample_states
from flexinv.typing import Array

# The same march; what follows it is summed in another order: a few hundred roundings of the largest effort.
ROUNDING = 1e-12
STEP = 1e-3


def solved(mechanism: Mechanism, initial: str = "consistent") -> flexinv.Solution:
    ends = {j.name: (np.zeros(j.nv), np.full(j.nv, 0.3)) for j in mechanism.joints if j.nv}
    first, last = ({name: part[k] for name, part in ends.items()} for k in range(2))
    motion = flexinv.Motion.point_to_point(first, last, duration=0.05, law="quintic")
    return flexinv.solve(mechanism, motion, step=STEP, initial=initial)


def stepped(solution: flexinv.Solution, initial: str = "consistent") -> Array:
    controller = Controller.of(solution.mechanism, step=STEP)
    rows = list(zip(solution.q, solution.qd, solution.qdd, strict=True))
    first = controller.start(*rows[0], initial=initial).copy()
    return np.array([first, *(controller.step(*row).copy() for row in rows[1:])])


def geared(mechanism: Mechanism, stiffness: float = 0.0) -> Mechanism:
    """With everything that a drive takes; a spring in a joint is marched in space."""
    joints = (
        replace(j, rotor_inertia=0.01, damping=0.2, friction=0.1, stiffness=stiffness, rest=0.1)
        for j in mechanism.joints
    )
    return replace(mechanism, joints=tuple(joints))


@pytest.mark.parametrize("model", ["flex_one_link", "flex_two_link"])
def test_steps_in_a_plane_are_those_of_solve(root: Path, model: str) -> None:
    arm = geared(flexinv.load_mechanism(root / "models" / model))
    solution = solved(arm)
    assert Controller.of(arm, step=STEP).flexible.flat is not None  # type: ignore[union-attr]
    np.testing.assert_allclose(
        stepped(solution),
        solution.torque_all,
        rtol=0,
        atol=ROUNDING * np.abs(solution.torque_all).max(),
    )


@pytest.mark.parametrize("initial", ["consistent", "static"])
def test_steps_in_space_are_those_of_solve(root: Path, initial: str) -> None:
    arm = geared(flexinv.load_mechanism(root / "models" / "spatial_arm"), stiffness=0.3)
    solution = solved(arm, initial)
    assert Controller.of(arm, step=STEP).flexible.flat is None  # type: ignore[union-attr]
    np.testing.assert_allclose(
        stepped(solution, initial),
        solution.torque_all,
        rtol=0,
        atol=ROUNDING * np.abs(solution.torque_all).max(),
    )


def test_a_controller_starts_again(root: Path) -> None:
    """What a run has left in it does not matter to the next."""
    arm = flexinv.load_mechanism(root / "models" / "flex_one_link")
    controller = Controller.of(arm, step=STEP)
    runs = []
    for _ in range(2):
        controller.start(np.zeros(1), np.zeros(1), np.full(1, 50.0))
        runs.append([controller.step(np.full(1, 0.01 * k), np.full(1, 10.0), np.zeros(1))[0] for k in range(5)])
    np.testing.assert_array_equal(*runs)
    assert len(set(runs[0])) == 5  # the arm swings


def test_another_step_is_seen(root: Path) -> None:
    arm = flexinv.load_mechanism(root / "models" / "flex_one_link")
    solution = solved(arm)
    other = Controller.of(arm, step=2 * STEP)
    other.start(solution.q[0], solution.qd[0], solution.qdd[0])
    last = [other.step(*row)[0] for row in zip(solution.q[1:], solution.qd[1:], solution.qdd[1:], strict=True)]
    assert np.abs(np.array(last) - solution.torque_all[1:, 0]).max() > 0.01 * np.abs(solution.torque_all).max()


def test_a_rigid_step_is_joint_torques() -> None:
    mechanism = trees.tree()
    state = sample_states(mechanism, 20)
    controller = Controller.of(mechanism)
    result = np.array([controller.step(*row).copy() for row in zip(*state, strict=True)])
    expected = flexinv.joint_torques(mechanism, *state)
    np.testing.assert_allclose(result, expected, rtol=0, atol=ROUNDING * np.abs(expected).max())


@pytest.mark.slow
@pytest.mark.parametrize("model", ["panda", "flex_two_link", "spatial_arm"])
def test_nothing_is_allocated(root: Path, model: str) -> None:
    """Steps leave nothing behind, and none holds an array for a while."""
    mechanism = flexinv.load_mechanism(root / "models" / model)
    controller = Controller.of(mechanism, step=STEP)
    still = mechanism.neutral, np.zeros(mechanism.nv), np.zeros(mechanism.nv)
    controller.start(*still)
    left, held = grown(lambda: controller.step(*still))
    assert left < SMALLEST * OFTEN
    assert held < TRANSIENT


def test_an_allocation_is_seen(root: Path) -> None:
    kept: list[Array] = []
    assert grown(lambda: kept.append(np.zeros(1)))[0] > SMALLEST * OFTEN
    assert grown(lambda: np.zeros(1000).sum())[1] > TRANSIENT


OFTEN, SMALLEST = 500, 32  # steps; the size of a number of Python's, of which not one a step may stay [bytes]
# Python's own numbers and tuples and the headers of views: nothing that grows with the mechanism [bytes].
TRANSIENT = 2048
TIMES = 32


def grown(step: Callable[[], object]) -> tuple[int, int]:
    """What ``OFTEN`` steps leave behind, and the most that they held meanwhile [bytes], the least of ``TIMES``.

    Python's lists of free tuples, which ``gc.collect`` empties, fill up again now and then, and in two of three times the
    interpreter holds some 2.5 kB of small numbers for a moment; what a step itself leaves behind or holds is there every time.
    """
    gc.collect()
    gc.disable()
    tracemalloc.start()
    result = []
    try:
        for _ in range(TIMES):
            before, _ = tracemalloc.get_traced_memory()
            tracemalloc.reset_peak()
            for _ in range(OFTEN):
                step()
            after, peak = tracemalloc.get_traced_memory()
            result.append((after - before, peak - before))
    finally:
        tracemalloc.stop()
        gc.enable()
    return min(left for left, _ in result), min(held for _, held in result)


def test_what_cannot_be_is_said(root: Path) -> None:
    arm = flexinv.load_mechanism(root / "models" / "flex_one_link")
    with pytest.raises(InputError, match=r"write step = the time between two calls"):
        Controller.of(arm)
    controller, one = Controller.of(arm, step=STEP), np.zeros(1)
    with pytest.raises(InputError, match=r"write controller.start\(q, qd, qdd\) once"):
        controller.step(one, one, one)
    with pytest.raises(InputError, match=r"q has shape \(2,\), expected \(1,\) numbers"):
        controller.start(np.zeros(2), one, one)
    with pytest.raises(InputError, match=r"initial = 'rest': expected 'consistent'"):
        controller.start(one, one, one, initial="rest")
    tree = spatial_tree()
    tie = Closure("c", "spherical", Attachment(WORLD), Attachment(tree.links[-1].name))
    held = replace(tie, active=((0.0, 0.5),))
    with pytest.raises(InputError, match=r"has beams and a closure that acts for a while \('c'\).*write flexinv.solve"):
        Controller.of(replace(tree, closures=(held,)), step=STEP)
    gust = Force("gust", Attachment(tree.links[-1].name), np.zeros((2, 6)), np.array([0.0, 1.0]))
    with pytest.raises(InputError, match=r"force 'gust' depends on time"):
        Controller.of(replace(tree, forces=(gust,)), step=STEP)


def test_a_refused_step_leaves_the_torques_of_the_call_before(root: Path) -> None:
    """A loop that catches the error and sends the array again sends nothing that was refused."""
    arm = flexinv.load_mechanism(root / "models" / "flex_two_link")
    controller, still = Controller.of(arm, step=2e-3), np.zeros(2)
    controller.start(still, still, still)
    for _ in range(3):
        tau = controller.step(still, still, still)
    before = tau.copy()
    with pytest.raises(InputError, match=r"qd = \[nan, 0.0\]: expected finite numbers"):
        controller.step(still, np.array([np.nan, 0.0]), still)
    with pytest.raises(ConvergenceError, match=r"turns by more than 2.5 rad"):
        controller.step(np.array([2.0, 0.0]), still, still)
    # No solution was found: the state is what it was, and an arm at rest needs nothing but rounding.
    assert np.allclose(controller.step(still, still, still), before, atol=1e-12)
    with pytest.raises(ConvergenceError, match=r"controller.start.* begins again"):
        controller.step(np.array([0.1, 0.0]), still, still)
    assert np.allclose(tau, before, atol=1e-12)
    with pytest.raises(InputError, match=r"write controller.start\(q, qd, qdd\) once"):
        controller.step(still, still, still)
    controller.start(still, still, still)
    assert np.allclose(controller.step(still, still, still), before, atol=1e-12)


@pytest.mark.parametrize("initial", ["consistent", "static"])
def test_springs_and_given_forces_are_those_of_solve(root: Path, initial: str) -> None:
    """A spring from the world to the tip and a constant force on it, in the march as in what the drives must give."""
    arm = flexinv.load_mechanism(root / "models" / "spatial_arm")
    tip = Attachment(arm.links[-1].name, station=1.0)
    spring = Spring("s", Attachment(WORLD, Placement(np.array([1.0, 0.5, 0.3]))), tip, 5.0, damping=0.2)
    wind = Force("wind", tip, np.array([[0.3, -0.2, 0.4, 0.0, 0.0, 0.01]]))
    loaded = replace(arm, springs=(spring,), forces=(wind,))
    solution = solved(loaded, initial)
    result, scale = stepped(solution, initial), np.abs(solution.torque_all).max()
    np.testing.assert_allclose(result, solution.torque_all, rtol=0, atol=10 * ROUNDING * scale)
    assert np.abs(result - stepped(solved(arm, initial), initial)).max() > 1e-2 * scale  # they are felt


def test_joints_without_drives_move_as_in_solve() -> None:
    """A motor that is moved turns a damped beam through a spring: the controller is told of the motor alone."""
    arm = hub_arm(6)
    motion = flexinv.Motion.point_to_point({"drive": 0.0}, {"drive": 0.3}, duration=0.05, law="quintic")
    solution = flexinv.solve(arm, motion, step=STEP)
    told = replace(solution, q=np.where(arm.actuated, solution.q, 0.0), qd=np.where(arm.actuated, solution.qd, 0.0))
    # forces along a beam of 1e9 N: 1e-16 of that; the march in a plane and the one in space
    atol = 1e-6 * np.abs(solution.torque_all).max()
    np.testing.assert_allclose(stepped(told)[:, 0], solution.torque_all[:, 0], rtol=0, atol=atol)
    stiff = flexinv.solve(hub_arm(6, elastic=False), motion, step=STEP)
    assert np.abs(stiff.torque_all[:, 0] - solution.torque_all[:, 0]).max() > 0.1  # N m: the spring is felt


@pytest.mark.parametrize("model", ["four_bar", "stewart_platform"])
def test_rigid_loops_are_those_of_solve(root: Path, model: str) -> None:
    folder = root / "models" / model
    m = flexinv.load_mechanism(folder)
    case = next(iter(load_cases(folder, m).values()))
    solution = flexinv.solve(m, case.motion, case.step, start=case.start)
    controller = Controller.of(m)
    rows = zip(solution.q, solution.qd, solution.qdd, strict=True)
    result = np.array([controller.step(*row).copy() for row in rows])
    # two solvers of the shares, condition of the closures times rounding
    np.testing.assert_allclose(result, solution.torque_all, rtol=0, atol=1e-9 * np.abs(solution.torque_all).max())


@pytest.mark.parametrize("initial", ["consistent", "static"])
def test_loops_that_bend_are_those_of_solve(initial: str) -> None:
    """A four-bar with a strip as its coupler; joints without drives are guessed at the start, and not looked at after."""
    bar = bending()
    motion = flexinv.Motion.point_to_point({"A": 0.3}, {"A": 0.6}, duration=0.1, law="quintic")
    solution = flexinv.solve(bar, motion, step=STEP, initial=initial, start=START)
    told = replace(solution, q=np.where(bar.actuated, solution.q, [0.0, START["B"], START["D"]]))
    # Forces of the closure, some hundred times those of the drive, are summed in another order.
    np.testing.assert_allclose(
        stepped(told, initial), solution.torque_all, rtol=0, atol=1e-9 * np.abs(solution.torque_all).max()
    )
    assert np.abs(solution.torque_all[:, 1:]).max() < 1e-6 * np.abs(solution.torque_all).max()


@pytest.mark.parametrize(("jump", "rate"), [(2.5, 0.0), (0.0, 1e300)])
def test_a_refused_step_leaves_the_forces_of_loops_as_they_were(jump: float, rate: float) -> None:
    """What has no solution, or overflows, spoils no multiplier: the next step's torque is as if nothing had been asked."""
    bar = bending()
    still = np.zeros(3)
    guess = np.array([0.3, START["B"], START["D"]])
    controllers = [Controller.of(bar, step=STEP) for _ in range(2)]
    for one in controllers:
        one.start(guess, still, still, initial="static")
        one.step(guess, still, still)
    crank = np.array([1.0, 0.0, 0.0])
    with pytest.raises(ConvergenceError), np.errstate(over="ignore"):
        controllers[0].step(guess + jump * crank, rate * crank, still)
    both = [one.step(guess, still, still).copy() for one in controllers]
    np.testing.assert_allclose(*both, rtol=0, atol=1e-9 * np.abs(both[1]).max())


def test_a_spring_goes_on_over_half_a_turn(root: Path) -> None:
    """At pi its torque would jump by the stiffness times a whole turn."""
    arm = flexinv.load_mechanism(root / "models" / "flex_one_link")
    (hub,) = arm.joints
    endless = replace(arm, joints=(replace(hub, kind="continuous", stiffness=0.5),))
    motion = flexinv.Motion.point_to_point({"hub": 2.5}, {"hub": 4.5}, 0.2, law="quintic")
    s = flexinv.solve(endless, motion, 1e-3)
    controller = Controller.of(endless, step=1e-3)
    now = [controller.start(s.q[0], s.qd[0], s.qdd[0]).copy()]
    now += [controller.step(*state).copy() for state in zip(s.q[1:], s.qd[1:], s.qdd[1:], strict=True)]
    np.testing.assert_allclose(now, s.torque_all, rtol=0, atol=1e-9)


def test_what_lies_between_two_calls_is_for_solve() -> None:
    """A parallelogram goes over its flat position: a controller sees the instants before and after, `solve` the one between."""
    flat = four_bar(0.2, 0.45, 0.2, 0.45)
    time = np.linspace(0.0, 1.0, 12)
    angle = 0.5 - time
    motion = flexinv.Motion.from_samples(time, {"A": angle, "B": -angle, "D": angle})
    controller = Controller.of(flat)
    q, qd, qdd = motion.evaluate(flat, time)
    for now in zip(q, qd, qdd, strict=True):
        assert np.isfinite(controller.step(*now)).all()
    with pytest.raises(flexinv.ConvergenceError, match=r"t = 0\.5 s"):
        flexinv.solve(flat, motion, step=1.0 / 11.0)
