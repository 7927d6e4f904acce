"""Closed loops in space, in lanes: limits of a motion, and universal joints taken from their closures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from kernels import six, solved_by
from lane_examples import MODELS, ROUNDING, closed_tree, doubts, largest, reference, solved
from loop_examples import Example, at, loaded, platform, spatial

import flexinv
from flexinv.files.load_cases import load_cases
from flexinv.kernels.simd import BLOCK
from flexinv.model.mechanism import WORLD, Attachment, Spring
from flexinv.rigid.prepare import _build_torque_function, prepare
from flexinv.rnea import loop_plan, loop_tables
from flexinv.rnea.loop_layout import A_STANDS, B_STANDS, LIMITS, NO_GROUND, SIX_ROWS


@pytest.mark.parametrize("name", ["bricard", "stewart_platform"])
def test_limits_in_space(name: str) -> None:
    """A motion at rest, whose accelerations are gravity's alone, is closed; one that opens in any coordinate is named."""
    mechanism = flexinv.load_mechanism(MODELS / name)
    _, state = solved((mechanism, next(iter(load_cases(MODELS / name, mechanism).values()))), 150)
    f = prepare(mechanism, threads=1)
    still = (state[0], 0 * state[1], 0 * state[2])
    assert np.abs(f.torques(*still) - reference(f, still)).max() < ROUNDING * largest(f, still)
    assert not f._own.counter[3]
    for k, label in enumerate(("q", "qd", "qdd")):
        for column in range(state[k].shape[1]):
            wrong = [a.copy() for a in state]
            wrong[k][100, column] += 0.02 * np.abs(wrong[k]).max()
            with pytest.raises(flexinv.InputError, match=f": {label} violates closure .* sample 100"):
                f.torques(*wrong)


@pytest.mark.parametrize("example", [platform, spatial])
def test_universal_joints_taken_from_a_closure(example: Callable[[], Example], monkeypatch: pytest.MonkeyPatch) -> None:
    """The same efforts with the force that leaves them without effort, and with all rows combined."""
    mechanism, state = solved(example(), 200)
    f = prepare(mechanism, threads=1)
    monkeypatch.setattr(loop_plan, "_find_universal_pairs", lambda *_: {})
    g = _build_torque_function.__wrapped__(mechanism, True, 1)
    assert all(closure.reduced for closure in f.plan.closures)
    assert not any(closure.reduced for closure in g.plan.closures)
    assert np.abs(f.torques(*state) - g.torques(*state)).max() < ROUNDING * largest(f, state)


@pytest.mark.parametrize("name", ["bricard", "fixed"])
def test_closures_to_the_ground(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same efforts and squares whichever end stands, and by the formulas of two ends that move."""
    if name == "bricard":
        mechanism = flexinv.load_mechanism(MODELS / name)
        mechanism, state = solved((mechanism, next(iter(load_cases(MODELS / name, mechanism).values()))), 150)
    else:
        mechanism, state = closed_tree(name, 1, 0)
    (closure,) = mechanism.closures
    swapped = replace(mechanism, closures=(replace(closure, first=closure.second, second=closure.first),))
    functions = [prepare(m, threads=1) for m in (mechanism, swapped)]
    assert {f.plan.closures[0].ground for f in functions} == {A_STANDS, B_STANDS}
    monkeypatch.setattr(loop_tables, "_resolve_ground_end", lambda *given: (NO_GROUND, given[-1]))
    functions += [_build_torque_function.__wrapped__(m, True, 1) for m in (mechanism, swapped)]
    assert not any(f.plan.closures[0].ground for f in functions[2:])
    moved = [state[0] + 1e-8, state[1] * (1.0 + 1e-6 * np.arange(mechanism.nv)), state[2] * (1.0 + 1e-5)]
    squares = []
    for f in functions:
        assert np.abs(f.torques(*state) - reference(f, state)).max() < 10 * ROUNDING * largest(f, state)
        assert doubts(f, 150) == []
        f.torques(*moved)
        at = int(f.plan.plan[LIMITS])
        squares.append([f._own.work[0][at + BLOCK * k : at + BLOCK * (k + 1)].max() for k in range(3)])
    # roundings of some 1e-16 over a gap of 1e-8, and twice that for its square
    for result, other in zip(squares[:2], squares[2:], strict=True):
        assert np.abs(np.array(result) / other - 1.0).max() < 1e-7


def test_what_slides_is_turned_as_two_ends_that_move() -> None:
    """The axes of a body that slides are its parent's, in which the recursion has nothing."""
    f = prepare(closed_tree("spherical", 2, 0)[0], threads=1)
    assert f.plan.closures[0].ground == NO_GROUND


def test_a_universal_joint_in_line_is_left_to_singular_values() -> None:
    """Where the arm to the ball lies along one of its axes, that axis does not move it: the block is in doubt."""
    mechanism, (q, qd, _) = solved(spatial(), 200)
    (closure,) = mechanism.closures
    ends = {"first": closure.second, "second": closure.first}  # the point is the coupler's
    f = prepare(replace(mechanism, closures=(replace(closure, **ends),)), threads=1)
    column = mechanism.q_slices["B"].start + 1
    assert mechanism.joint_of["B"].kind == "universal"
    q = q.copy()
    q[BLOCK + 2, column] = np.pi / 2  # the second axis carries the coupler, 0.55 m along x, into the first one, z
    with pytest.raises(flexinv.InputError, match=": q violates closure"):
        f.torques(q, 0 * qd, 0 * qd)
    assert doubts(f, 200) == [1]


def test_six_forces_are_those_of_linear_equations() -> None:
    """Rows in any order, zeros where a pivot would be among them; a sample whose rows depend on each other is in doubt, alone."""
    random = np.random.default_rng(5)
    g, tau = random.normal(size=(BLOCK, 6, 6)), random.normal(size=(BLOCK, 6))
    g[1, :, 5], g[1, 3, 5] = 0.0, 1.0  # one entry in the first column that is taken
    g[2] = np.eye(6)[random.permutation(6)]
    entries, efforts, result = g.transpose(1, 2, 0).ravel().copy(), tau.T.ravel().copy(), np.zeros(SIX_ROWS * BLOCK)
    assert six(result, efforts, entries, 1e-9) == 0
    exact = np.linalg.solve(g.transpose(0, 2, 1), tau[:, :, None])[:, :, 0]
    error = np.abs(result[: 6 * BLOCK].reshape(6, BLOCK).T - exact).max(axis=1) / np.abs(exact).max(axis=1)
    assert (error < 1e-14 * np.linalg.cond(g)).all()  # some tens of roundings, times the condition
    assert not efforts.any()
    g[7, 2] = g[7, 0] - 2.0 * g[7, 5]
    entries, efforts = g.transpose(1, 2, 0).ravel().copy(), tau.T.ravel().copy()
    assert six(result, efforts, entries, 1e-9) == 1


def test_pivots_that_are_too_small_are_counted() -> None:
    """Next to their column, next to nothing, none, or no number."""
    pivot, size, effort, result = np.ones(BLOCK), np.full(BLOCK, 4.0), np.full(BLOCK, 3.0), np.zeros(BLOCK)
    pivot[:6] = 1.9e-4, -2.1e-4, 1.1e-6, 0.9e-6, 0.0, np.nan
    size[2:4] = 0.0
    assert solved_by(result, pivot, effort, size, 1e-8, 1e-12) == 4
    assert np.abs(result[6:] - 3.0).max() == 0.0
    assert result[1] == pytest.approx(-3.0 / 2.1e-4, rel=1e-15)
    assert not effort.any()


@pytest.mark.parametrize("name", ["stewart_platform", "platform"])
def test_six_legs_are_solved_at_once(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same efforts as with rows combined two and two."""
    if name == "platform":
        mechanism, state = solved(platform(), 200)
    else:
        mechanism = flexinv.load_mechanism(MODELS / name)
        mechanism, state = solved((mechanism, next(iter(load_cases(MODELS / name, mechanism).values()))), 200)
    f = prepare(mechanism, threads=1)
    asked: list[bool] = []
    monkeypatch.setattr(loop_plan, "_is_six_by_six", lambda *_: asked.append(True))
    g = _build_torque_function.__wrapped__(mechanism, True, 1)
    assert asked
    assert len(g.plan.plan) > len(f.plan.plan)
    assert np.abs(f.torques(*state) - g.torques(*state)).max() < ROUNDING * largest(f, state)
    assert doubts(f, 200) == doubts(g, 200) == []


@pytest.mark.parametrize("name", ["loaded", "spatial", "andrews_squeezer"])
def test_springs_and_forces_are_shared_out_in_lanes(name: str) -> None:
    """The same efforts as those of the tree with its springs and forces, shared out one sample after the other."""
    if name == "andrews_squeezer":
        mechanism = flexinv.load_mechanism(MODELS / name)
        example = mechanism, next(iter(load_cases(MODELS / name, mechanism).values()))
    elif name == "loaded":
        mechanism, case = loaded()
        constant = tuple(replace(f, wrench=f.wrench[:1], time=f.time[:1]) for f in mechanism.forces)
        example = replace(mechanism, forces=constant), case
    else:
        mechanism, case = spatial()
        pull = Spring("s", Attachment(WORLD, at(0.1, -0.3)), Attachment("coupler", at(0.3, 0.05)), 400.0, 0.2, 1.5)
        example = replace(mechanism, springs=(pull,)), case
    mechanism, state = solved(example, 300)
    f = prepare(mechanism, threads=1)
    bare = prepare(replace(mechanism, springs=(), forces=()), threads=1)
    assert f.loaded
    assert not bare.loaded
    tau, size = f.torques(*state), largest(f, state)
    assert np.abs(tau - reference(f, state)).max() < ROUNDING * size
    assert np.abs(tau - bare.torques(*state)).max() > 1e-3 * size  # springs and forces matter
    assert doubts(f, 300) == []
    columns = [np.ascontiguousarray(a.T) for a in state]
    assert np.abs(f.torques(*columns, order="coordinates").T - tau).max() < ROUNDING * size
    assert np.abs(f.sample(*(a[7].copy() for a in state), np.empty(mechanism.nv)) - tau[7]).max() < ROUNDING * size
    same = state[2].copy()
    assert np.array_equal(
        f.torques(state[0], state[1], same, out=same), tau
    )  # the efforts go where the accelerations were
    wrong = [a.copy() for a in state]
    wrong[1][3, 0] = np.nan
    with pytest.raises(flexinv.InputError, match=r"qd\[3, 0\] is nan"):
        f.torques(*wrong)
    wrong[1][3, 0] = state[1][3, 0] + 0.1 * np.abs(state[1]).max()
    with pytest.raises(flexinv.InputError, match=": qd violates closure"):
        f.torques(*wrong)
