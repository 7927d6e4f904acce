"""Singular positions of closures in a march: named within a step, at a sample and between two, touched and passed."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import scipy
from four_bar_example import START, TURN, four_bar
from planar_examples import SOFT

import flexinv
from flexinv.constraints.closures import build_constraint_rows, compute_constraint_jacobian, list_velocity_scales
from flexinv.constraints.free_jacobian import build_free_jacobians
from flexinv.kinematics.mesh import build
from flexinv.kinematics.nodal_motion import compute_rigid_motion, integrate_configuration
from flexinv.model.mechanism import Attachment, Beam, Closure, Joint, Link, Mechanism, Placement

MODELS = "bricard", "stewart_platform", "geared_four_bar", "andrews_squeezer", "slider_crank", "five_bar"
FLAT = {"B": -1.0, "D": 1.0}  # the parallelogram, not the crossed one
STEPS = [2e-2, 1e-2, 1e-3]


def place(x: float) -> Placement:
    return Placement(np.array([x, 0.0, 0.0]))


def with_whip(mechanism: Mechanism, parent: str = "coupler") -> Mechanism:
    """A beam on a link, so that the rigid loop is marched."""
    whip = Link("whip", (), Beam(0.2, SOFT, 1, 3))
    joint = Joint("W", "fixed", parent, "whip", place(0.1))
    return replace(mechanism, links=(*mechanism.links, whip), joints=(*mechanism.joints, joint))


def parallelogram(kind: str = "revolute") -> Mechanism:
    return four_bar(0.2, 0.45, 0.2, 0.45, kind)


def free(mechanism: Mechanism) -> Mechanism:
    """The same without drives and gravity."""
    joints = tuple(replace(joint, actuated=False) for joint in mechanism.joints)
    return replace(mechanism, joints=joints, gravity=np.zeros(3))


def find_instant(caught: pytest.ExceptionInfo[flexinv.ConvergenceError]) -> float:
    assert "singular configuration" in str(caught.value)
    assert "'C'" in str(caught.value)
    match = re.search(r"t = (\S+) s", str(caught.value))
    assert match is not None
    return float(match[1])


def solve_singular(mechanism: Mechanism, motion: flexinv.Motion, step: float, start: dict[str, float]) -> float:
    with pytest.raises(flexinv.ConvergenceError) as caught:
        flexinv.solve(mechanism, motion, step=step, start=start)
    return find_instant(caught)


def find_zero(motion: flexinv.Motion, mechanism: Mechanism, angle: float) -> float:
    def miss(time: float) -> float:
        return float(motion.evaluate(mechanism, [time])[0][0, 0]) - angle

    return float(scipy.optimize.brentq(miss, 0.1, 0.9, xtol=1e-14))


@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("kind", ["revolute", "spherical"])
def test_a_change_point_is_named(step: float, kind: str) -> None:
    """A rigid parallelogram with a beam on it passes its flat position, with and without redundant constraints.

    Without the search the closure's force was 316 N at steps of 1e-2 s, 3486 N at 1e-3 s.
    """
    mechanism = with_whip(parallelogram(kind))
    motion = flexinv.Motion.point_to_point({"A": 1.0}, {"A": -0.7}, 1.0)
    assert solve_singular(mechanism, motion, step, FLAT) == pytest.approx(find_zero(motion, mechanism, 0.0), abs=step)


def test_a_change_point_at_a_sample_is_named() -> None:
    """Without the search this was 5463 N m at the drive."""
    motion = flexinv.Motion.point_to_point({"A": 0.5}, {"A": -0.5}, 1.0)
    instant = solve_singular(with_whip(parallelogram()), motion, 1e-2, {"B": -0.5, "D": 0.5})
    assert instant == pytest.approx(0.5, abs=1e-2)


TURNS = 0.5173  # [s]


@pytest.mark.parametrize("step", [2e-2, 1e-2])
@pytest.mark.parametrize("beyond", [0.0, 1e-8, 1e-5, 1e-3])
def test_a_change_point_that_is_touched_is_named(step: float, beyond: float) -> None:
    """Forth and back, by as good as nothing or by little; what passes by is solved."""
    mechanism = with_whip(parallelogram())
    time = np.linspace(0.0, 1.0, 41)
    start = {"B": -0.26, "D": 0.26}
    motion = flexinv.Motion.from_samples(time, {"A": (time - TURNS) ** 2 - beyond})
    expected = TURNS - np.sqrt(beyond)
    assert solve_singular(mechanism, motion, step, start) == pytest.approx(expected, abs=step)
    missing = flexinv.Motion.from_samples(time, {"A": (time - TURNS) ** 2 + 1e-4})
    flexinv.solve(mechanism, missing, step=step, start=start)


@pytest.mark.parametrize("step", STEPS)
def test_the_end_of_a_branch_is_named_instead_of_newton(step: float) -> None:
    """A crank that is too long rocks: coupler and rocker are one straight line where it must turn back."""
    crank, coupler, rocker, base = 0.4, 0.3, 0.4, 0.45
    mechanism = with_whip(four_bar(crank, coupler, rocker, base))
    motion = flexinv.Motion.point_to_point({"A": 1.2}, {"A": np.pi}, 1.0)
    most = np.arccos((crank**2 + base**2 - (coupler + rocker) ** 2) / (2 * crank * base))
    expected = find_zero(motion, mechanism, most)
    assert solve_singular(mechanism, motion, step, {"B": -1.0, "D": 1.5}) == pytest.approx(expected, abs=step)


def test_the_end_of_a_branch_that_is_just_not_reached_is_left_alone() -> None:
    """The loop turns back within a step; what goes on before it as it came would be singular."""
    crank, coupler, rocker, base = 0.4, 0.3, 0.4, 0.45
    most = np.arccos((crank**2 + base**2 - (coupler + rocker) ** 2) / (2 * crank * base))
    mechanism = with_whip(four_bar(crank, coupler, rocker, base), "crank")
    time = np.linspace(0.0, 0.4, 41)
    motion = flexinv.Motion.from_samples(time, {"A": most - 1e-4 - 8.0 * (time - 0.2173) ** 2})
    flexinv.solve(mechanism, motion, step=1e-2, start={"B": -1.0, "D": 1.5})


@pytest.mark.parametrize("step", [1e-2, 1e-3])
def test_a_free_parallelogram_is_named(step: float) -> None:
    """It turns on by itself; its inertia is the same at every angle, so that the flat position comes after half a second."""
    with pytest.raises(flexinv.ConvergenceError) as caught:
        flexinv.simulate(
            free(parallelogram()), [0.0, 1.0], step=step, start={"A": 1.0, **FLAT}, start_rate={"A": -2.0, "B": 2.0, "D": -2.0}
        )  # fmt: skip
    assert find_instant(caught) == pytest.approx(0.5, abs=step)


def test_what_is_not_singular_is_left_alone() -> None:
    """A crank that turns, a free slider-crank through its dead points, and a coupler that bends where a rigid one is singular."""
    flexinv.solve(with_whip(four_bar()), TURN, step=1e-2, start=START)
    flat = np.array([0.3, 0.2])
    across = -np.arcsin(flat[1] / flat[0] * np.sin(0.5))
    start = {"A": 0.5, "B": float(across - 0.5), "S": float(0.2 * np.cos(0.5) + 0.3 * np.cos(across))}
    flexinv.simulate(slider(), [0.0, 1.0], step=2e-3, start=start, start_rate={"A": 4.0})
    bends = parallelogram()
    links = tuple(
        Link("coupler", (), Beam(0.45, SOFT, 1, 3)) if link.name == "coupler" else link for link in bends.links
    )
    ends = Attachment("coupler", station=1.0), Attachment("rocker", place(0.2))
    bends = replace(bends, links=links, closures=(Closure("C", "revolute", *ends),), gravity=np.zeros(3))
    flexinv.solve(
        bends, flexinv.Motion.point_to_point({"A": 0.3}, {"A": -0.3}, 1.0), step=1e-2, start={"B": -0.3, "D": 0.3}
    )


def slider() -> Mechanism:
    """A slider-crank without drives."""
    four = four_bar(0.2, 0.3, 0.1)
    joints = (
        *four.joints[:2],
        Joint("S", "prismatic", "world", "rocker", axis=np.array([1.0, 0.0, 0.0])),
    )
    ends = Attachment("coupler", place(0.3)), Attachment("rocker")
    return free(replace(four, joints=joints, closures=(Closure("C", "revolute", *ends),)))


def test_a_closure_that_does_not_act_is_not_asked() -> None:
    """The parallelogram is let go before its flat position, and the rocker swings by itself."""
    mechanism = with_whip(parallelogram())
    motion = flexinv.Motion.point_to_point({"A": 1.0}, {"A": -0.7}, 1.0)
    (closure,) = mechanism.closures
    flexinv.solve(replace(mechanism, closures=(replace(closure, active=((0.0, 0.5),)),)), motion, step=1e-2, start=FLAT)
    longer = replace(mechanism, closures=(replace(closure, active=((0.0, 0.6),)),))
    expected = find_zero(motion, mechanism, 0.0)
    assert solve_singular(longer, motion, 1e-2, FLAT) == pytest.approx(expected, abs=1e-2)


def test_a_loop_that_rides_on_a_beam_is_named() -> None:
    """Both ends of the closure hang on the tip of one beam, whose own freedoms have no part in it."""
    four = parallelogram()
    arm = Link("arm", (), Beam(0.3, SOFT, 1, 3))
    joints = (
        Joint("root", "revolute", "world", "arm"),
        *(replace(joint, parent="arm", station=1.0) if joint.parent == "world" else joint for joint in four.joints),
    )
    riding = replace(four, links=(arm, *four.links), joints=joints, gravity=np.zeros(3))
    motion = flexinv.Motion.point_to_point({"A": 0.4}, {"A": -0.3}, 1.0)
    both = flexinv.Motion.merge(motion, flexinv.Motion.point_to_point({"root": 0.0}, {"root": 0.1}, 1.0))
    instant = solve_singular(riding, both, 5e-3, {"B": -0.4, "D": 0.4})
    assert instant == pytest.approx(find_zero(motion, four, 0.0), abs=5e-3)


@pytest.mark.parametrize("name", MODELS)
def test_the_free_jacobian_is_a_part_of_g(name: str, root: object) -> None:
    """By wrenches on the ends of a closure, and by the efforts of the cut tree: rounding of lengths of a metre."""
    mechanism = flexinv.load_mechanism(f"{root}/models/{name}")
    mesh = build(mechanism)
    rows = build_constraint_rows(mesh)
    random = np.random.default_rng(1)
    q = np.stack(
        [integrate_configuration(mechanism, mechanism.neutral, random.normal(size=mechanism.nv)) for _ in range(3)]
    )
    rest = np.zeros((3, mechanism.nv))
    motion = compute_rigid_motion(mesh, q, rest, rest)
    g = compute_constraint_jacobian(mesh, motion, rows) * list_velocity_scales(mesh) / rows.scale[:, None]
    left = np.zeros_like(g)
    for one in build_free_jacobians(
        mesh, frozenset(j.name for j in mechanism.joints), np.ones(len(mechanism.closures), bool)
    ):
        entries = one.compute_entries(motion)
        np.testing.assert_allclose(entries, one.evaluate_entries(mesh, motion), rtol=0.0, atol=1e-14)
        left[np.ix_(np.arange(3), np.flatnonzero(one.which), one.coordinate)] = one.assemble(entries)
    np.testing.assert_allclose(left, g, rtol=0.0, atol=1e-14)


def test_a_beam_between_the_ends_keeps_a_closure_regular() -> None:
    """One that has a section for itself is left out; two on one section are looked at, by its six freedoms as well."""
    mechanism = flexinv.load_mechanism("models/four_bar_flexible")
    mesh = build(mechanism)
    passive = frozenset(joint.name for joint in mechanism.joints if not joint.actuated)
    assert build_free_jacobians(mesh, passive, np.ones(1, bool)) == ()
    twice = replace(mechanism, closures=(*mechanism.closures, replace(mechanism.closures[0], name="again")))
    mesh = build(twice)
    (both,) = build_free_jacobians(mesh, passive, np.ones(2, bool))
    assert (both.coordinate < 0).sum() == 6
