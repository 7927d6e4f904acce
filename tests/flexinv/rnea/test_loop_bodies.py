"""Closed loops in lanes: the same efforts as rows G, one sample after the other, and singular values give."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from lane_examples import MODELS, ROUNDING, closed_tree, doubts, largest, reference, solved
from loop_examples import Example, X, case_of, four_bar, platform, rack_and_pinion, rod, slider_crank, spatial
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import flexinv
from flexinv.constraints.allocation import PrescribedLoops
from flexinv.files.load_cases import load_cases
from flexinv.kernels.simd import BLOCK
from flexinv.model.mechanism import WORLD, Attachment, Closure, Joint, Mechanism, Placement
from flexinv.rigid.prepare import _build_torque_function, prepare
from flexinv.rnea import loop_plan
from flexinv.rnea.loop_allocation import LEAST_PIVOT
from flexinv.rnea.loop_layout import PLANE
from flexinv.typing import Array

KINDS = ("fixed", "revolute", "prismatic", "cylindrical", "universal", "spherical", "point-on-line")


EXAMPLES: dict[str, Callable[[], Example]] = {
    "revolute": four_bar,
    "spherical": lambda: four_bar("spherical"),
    "universal": lambda: four_bar("universal"),
    "cylindrical": lambda: four_bar("cylindrical"),
    "slide": lambda: slider_crank("prismatic"),
    "line": lambda: slider_crank("point-on-line"),
    "pin": lambda: slider_crank("pin"),
    "spatial": spatial,
    "platform": platform,
    "rack": rack_and_pinion,
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_efforts_are_those_of_one_sample_after_the_other(name: str) -> None:
    mechanism, state = solved(EXAMPLES[name](), 200)
    mechanism = replace(mechanism, springs=(), forces=())
    f = prepare(mechanism, threads=1)
    tau = f.torques(*state)
    assert doubts(f, 200) == []
    assert f.plan.sizes
    assert not f._own.counter[3]
    assert np.abs(tau - reference(f, state)).max() < ROUNDING * largest(f, state)


@pytest.mark.parametrize(
    "name", ["andrews_squeezer", "bricard", "five_bar_redundant", "geared_four_bar", "stewart_platform"]
)
def test_models(name: str) -> None:
    mechanism = flexinv.load_mechanism(MODELS / name)
    case = next(iter(load_cases(MODELS / name, mechanism).values()))
    bare, state = solved((mechanism, case), 150)
    f = prepare(replace(bare, springs=(), forces=()), threads=1)
    tau = f.torques(*state)
    assert doubts(f, 150) == []
    assert not f._own.counter[3]
    assert np.abs(tau - reference(f, state)).max() < ROUNDING * largest(f, state)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_every_kind_between_any_bodies(kind: str, seed: int) -> None:
    """In space, drives more than freedoms where joints of several coordinates cannot be divided."""
    mechanism, state = closed_tree(kind, seed, 0)
    f = prepare(mechanism, threads=1)
    tau = f.torques(*state)
    assert f.plan.sizes
    assert doubts(f, 150) == []
    assert not f._own.counter[3]
    assert np.abs(tau - reference(f, state)).max() < 10 * ROUNDING * largest(f, state)  # pivots of 1e-2 are let through


def test_what_moves_in_a_plane_is_found_wherever_it_lies() -> None:
    """Spatial loops are not taken for plane ones; a plane one is, however it hangs in space."""
    mechanism, state = solved(four_bar(), 200)
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    joints = tuple(
        replace(j, placement=Placement(turn @ j.placement.position, turn @ j.placement.rotation))
        if j.parent == WORLD
        else j
        for j in mechanism.joints
    )
    for plane in (mechanism, replace(mechanism, joints=joints, gravity=turn @ mechanism.gravity)):
        f = prepare(plane, threads=1)
        assert f.plan.plan[PLANE]
        assert np.abs(f.torques(*state) - reference(f, state)).max() < ROUNDING * largest(f, state)
        assert doubts(f, 200) == []
    assert not prepare(spatial()[0]).plan.plan[PLANE]


def turned_about_z(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def with_slides(case: str, lean: float = 0.0) -> Example:
    """Slides in the plane, tilted and beside their joints: on an arm that turns, or before a rod; ``lean`` [rad] out of it."""
    lens = Placement(np.array([0.05, 0.03, 0.02]), turned_about_z(0.7) @ Rotation.from_euler("y", lean).as_matrix())
    links = (rod("crank", 0.2, 0.3), rod("arm", 0.6, 0.5), rod("block", 0.1, 0.2))
    crank = Joint("A", "revolute", WORLD, "crank", Placement(np.zeros(3), turned_about_z(0.4)), damping=0.1)
    tip = Attachment("crank", Placement(np.array([0.2, 0.0, 0.1])))
    if case == "on an arm":
        along = np.array([0.96, 0.28, 0.0])
        joints: tuple[Joint, ...] = (
            crank,
            Joint("D", "revolute", WORLD, "arm", Placement(np.array([0.0, -0.5, 0.0])), actuated=False),
            Joint(
                "S", "prismatic", "arm", "block", lens, axis=turned_about_z(-0.7) @ along, actuated=False, friction=0.2
            ),
        )
        end, start = Attachment("block", Placement(np.array([0.02, -0.04, 0.08]))), {"D": 1.2, "S": 0.4}
    else:
        joints = (
            crank,
            Joint(
                "S",
                "prismatic",
                WORLD,
                "block",
                replace(lens, position=np.array([0.1, 0.2, 0.02])),
                axis=X,
                actuated=False,
            ),
            Joint("B", "revolute", "block", "arm", Placement(np.array([0.03, 0.01, 0.04])), actuated=False),
        )
        end, start = Attachment("arm", Placement(np.array([0.6, 0.05, 0.04]))), {"S": 0.4, "B": 2.5}
    mechanism = Mechanism(case, links, joints, np.array([0.3, -9.81, 0.0]), (Closure("C", "revolute", tip, end),))
    motion = flexinv.Motion.point_to_point({"A": 0.3}, {"A": 0.3 + 2 * np.pi}, 1.0)
    return mechanism, case_of(mechanism, motion, start)


@pytest.mark.parametrize("case", ["on an arm", "before a rod"])
def test_slides_in_the_plane_are_those_of_space(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same efforts and limits by the formulas of the plane, by those of space, and one sample after the other."""
    mechanism, state = solved(with_slides(case), 200)
    f = prepare(mechanism, threads=1)
    assert f.plan.plan[PLANE]
    tau, size = f.torques(*state), largest(f, state)
    assert np.abs(tau - reference(f, state)).max() < ROUNDING * size
    assert doubts(f, 200) == []
    monkeypatch.setattr(loop_plan, "_is_plane", lambda plan, most: False)
    g = _build_torque_function.__wrapped__(mechanism, True, 1)
    assert not g.plan.plan[PLANE]
    assert np.abs(g.torques(*state) - tau).max() < ROUNDING * size
    assert not f._own.counter[3]
    q, qd, qdd = state
    slide = mechanism.velocity_names.index("S")
    for k, label in enumerate(("q", "qd", "qdd")):  # what the squares of the plane leave out would be let through
        wrong = [q.copy(), qd.copy(), qdd.copy()]
        wrong[k][100, slide] += 0.02 * np.abs(wrong[k][:, slide]).max()
        with pytest.raises(flexinv.InputError, match=f": {label} violates closure 'C' at sample 100"):
            f.torques(*wrong)
    moved = [a + 1e-4 * np.abs(a).max() * np.eye(a.shape[1])[slide] for a in state]
    for h in (f, g):
        with pytest.raises(flexinv.InputError, match=r": q.* violates closure"):
            h.torques(*moved)


def test_slides_that_lean_are_not_in_the_plane() -> None:
    """By a thousandth of a radian out of it: nearly the same efforts, by the formulas of space."""
    assert prepare(with_slides("on an arm")[0]).plan.plan[PLANE]
    assert not prepare(with_slides("on an arm", 1e-3)[0]).plan.plan[PLANE]


@pytest.mark.parametrize(
    "second",
    [
        Placement(np.array([0.4, 0.0, 1e-3])),  # a millimetre beside the plane
        Placement(np.array([0.4, 0.0, 0.0]), np.array([[1.0, 0.0, 0.0], [0.0, 0.96, -0.28], [0.0, 0.28, 0.96]])),
    ],
)
def test_what_never_closes_is_named(second: Placement) -> None:
    """Rows that no joint changes are not in the lanes: that they are kept is found when the function is prepared."""
    mechanism, state = solved(four_bar(), 20)
    (closure,) = mechanism.closures
    broken = replace(mechanism, closures=(replace(closure, second=replace(closure.second, placement=second)),))
    with pytest.raises(flexinv.InputError, match=": q violates closure 'C'"):
        prepare(broken).torques(*state)


def test_a_closure_on_one_body() -> None:
    """It moves with its body and changes nothing, or never closes."""
    mechanism, state = solved(four_bar(), 20)
    spot = Attachment("coupler", Placement(np.array([0.3, 0.1, 0.0])))
    kept, broken = (
        replace(mechanism, closures=(*mechanism.closures, Closure("own", "fixed", spot, other)))
        for other in (spot, Attachment("coupler", Placement(np.array([0.3, 0.2, 0.0]))))
    )
    f = prepare(kept, threads=1)
    assert np.abs(f.torques(*state) - prepare(mechanism).torques(*state)).max() < ROUNDING * largest(f, state)
    assert f.plan.sizes
    with pytest.raises(flexinv.InputError, match=": q violates closure 'own'"):
        prepare(broken).torques(*state)


def test_a_dead_point_is_left_to_singular_values() -> None:
    """Coupler and rocker in line: the passive joints do not follow there; only its block is left."""
    mechanism, (q, qd, qdd) = solved(four_bar(), 500)
    f = prepare(mechanism, threads=1)
    assert f.loops is not None
    g = f.loops.compute_jacobian(q, qd, qdd)[:, :, 1:]
    worst = int(np.argmin(np.linalg.svd(g, compute_uv=False)[:, 1]))
    joints = tuple(
        replace(j, actuated=j.name == "B") for j in mechanism.joints
    )  # the crank turns by the coupler's drive
    other = prepare(replace(mechanism, joints=joints), threads=1)
    tau = other.torques(q, qd, qdd)
    assert worst >= 0
    assert np.abs(tau - reference(other, (q, qd, qdd))).max() < np.abs(tau).max() * ROUNDING / LEAST_PIVOT


def test_what_the_kernel_doubts_the_other_way_finds() -> None:
    """A motion that is open by half of what is allowed, and one at rest: the same efforts, and no complaint."""
    mechanism, (q, qd, qdd) = solved(four_bar(), 300)
    f = prepare(mechanism, threads=1)
    still = (q, 0 * qd, 0 * qdd)
    assert np.abs(f.torques(*still) - reference(f, still)).max() < ROUNDING * largest(f, still)
    assert not f._own.counter[3]
    moved = (q + 0.9e-7 * np.array([0.0, 1.0, 0.0, 0.0]), qd * (1 + 3e-5 * np.array([0.0, 1.0, 0.0])), qdd)
    tau = f.torques(*moved)
    assert np.abs(tau - reference(f, moved)).max() < ROUNDING * largest(f, moved)


def test_blocks_in_doubt_are_shared_out_later(monkeypatch: pytest.MonkeyPatch) -> None:
    """One block of three at a dead point of its drive: those samples, and no others, go the other way."""
    mechanism, state = solved(four_bar(), 3 * BLOCK)
    f = prepare(mechanism, threads=1)
    asked: list[int] = []
    shared = PrescribedLoops.apply_shares

    def some(self: PrescribedLoops, which: NDArray[np.bool_], *rows: Array) -> None:
        asked.extend(np.flatnonzero(which).tolist())
        shared(self, which, *rows)

    monkeypatch.setattr(PrescribedLoops, "apply_shares", some)
    mechanism, case = four_bar()
    joints = tuple(
        replace(j, actuated=j.name == "D") for j in mechanism.joints
    )  # the rocker drives: the crank has dead points
    s = flexinv.solve(mechanism, case.motion, step=case.end / 40_000, start=case.start)
    dead = prepare(replace(mechanism, joints=joints), threads=1)
    state = (s.q, s.qd, s.qdd)
    tau = dead.torques(*state)
    blocks = doubts(dead, len(s.q))
    assert 0 < len(blocks) <= 6  # two dead points, some blocks around each
    assert asked == [k for b in blocks for k in range(BLOCK * b, min(BLOCK * (b + 1), len(s.q)))]
    assert np.isfinite(tau).all()
    alone = prepare(mechanism, threads=1)
    alone.torques(*state)
    assert doubts(alone, len(s.q)) == []
    assert np.array_equal(f.torques(*(a[: 3 * BLOCK] for a in state)), f.torques(*(a[: 3 * BLOCK] for a in state)))


def test_threads_and_orders_agree() -> None:
    mechanism, state = solved(four_bar(), 5000)
    one, two = prepare(mechanism, threads=1), prepare(mechanism, threads=2)
    tau = one.torques(*state)
    for _ in range(20):
        assert np.array_equal(two.torques(*state), tau)
    columns = [np.ascontiguousarray(a.T) for a in state]
    assert np.array_equal(two.torques(*columns, order="coordinates").T, tau)
