"""differentiate with closed loops and springs between points equals differences of solve with a vanishing change."""

from __future__ import annotations

from dataclasses import replace

import loop_examples
import numpy as np
import pytest
from derivative_examples import EXAMPLES, SOFT, shorten, soften

import flexinv
from flexinv.errors import InputError
from flexinv.sensitivity.parameters import resolve_parameters

ROUNDED = (
    1e-7  # of the largest entry, beside the bar of the differences: Newton's last increment and rounding of K, C and M
)


def _load(root, name, start, turn, initial="consistent"):
    mechanism = flexinv.load_mechanism(root / "models" / name)
    motion = flexinv.Motion.point_to_point(*({"A": np.radians(angle)} for angle in turn), duration=0.3, law="nonic")
    guess = {joint: np.atleast_1d(np.radians(angle)) for joint, angle in start.items()}
    return mechanism, motion, guess, 3e-3, initial


def _compute_differences(task, parameter, size):
    """Differences of sixth order of all torques and tips, and of the same with half the change."""
    mechanism, motion, start, step, *initial = task

    def run(value):
        changed, moved = parameter.build_setup(mechanism, motion, value)
        found = flexinv.solve(changed, moved, step=step, start=start, initial=(initial or ["consistent"])[0])
        return np.hstack([found.torque, *found.tip.values()])

    def difference(change):
        beside = {k: run(parameter.value + k * change) for k in (-3, -2, -1, 1, 2, 3)}
        first, second, third = (beside[k] - beside[-k] for k in (1, 2, 3))
        return (45 * first - 9 * second + third) / (60 * change)

    return difference(size), difference(size / 2)


def _differentiate(task, by):
    mechanism, motion, start, step, *initial = task
    found = flexinv.differentiate(mechanism, motion, by, step=step, start=start, initial=(initial or ["consistent"])[0])
    return np.hstack([found.torque[:, :, 0], *(tip[:, :, 0] for tip in found.tip.values())]), found.torque.shape[1]


def _compare(task, by, size):
    """By how much derivatives are off, and the scatter of the differences, of torques and of tips [of the largest entry]."""
    (parameter,) = resolve_parameters(by, *task[:2])
    coarse, fine = _compute_differences(task, parameter, size)
    together, torques = _differentiate(task, by)
    for columns in (slice(torques), slice(torques, None)):
        scale = np.abs(fine[:, columns]).max()
        if scale < 1e-9:  # nothing depends on it
            assert np.abs(together[:, columns]).max() < 1e-9
            continue
        yield np.abs(together - fine)[:, columns].max() / scale, np.abs(coarse - fine)[:, columns].max() / scale


START = {"B": 46.0, "D": 103.0}
FOUR_BAR = ("four_bar", START, (20.0, 120.0))
BENDING = ("four_bar_flexible", START, (20.0, 120.0))
# Task, number, and the change of the differences in its own unit.
MODELS = {
    "rigid: end of the move": (FOUR_BAR, "motion.A[1]", 2e-2),
    "rigid: mass": (FOUR_BAR, "links.rocker.bodies.0.inertia.mass", 2e-2),
    "rigid: place of a closure": (FOUR_BAR, "closures.C.second.placement.position[0]", 1e-3),
    "rigid: place of a joint": (FOUR_BAR, "joints.B.placement.position[0]", 1e-3),
    "beam: end of the move": (BENDING, "motion.A[1]", 2e-2),
    "beam: mass of another link": (BENDING, "links.rocker.bodies.0.inertia.mass", 2e-2),
    "beam: stiffness": (BENDING, "links.coupler.beam.section.stiffness[0,5]", 1e-2),
    "beam: length": (BENDING, "links.coupler.beam.length", 1e-3),
    "beam: place of a closure": (BENDING, "closures.C.second.placement.position[0]", 1e-3),
    "beam: static start": ((*BENDING, "static"), "motion.A[1]", 2e-2),
    "beam: gravity and a static start": ((*BENDING, "static"), "gravity[1]", 1.0),
}


@pytest.mark.parametrize("case", MODELS)
def test_derivatives_of_models_equal_differences(root, case):
    arguments, by, size = MODELS[case]
    for off, scatter in _compare(_load(root, *arguments), by, size):
        assert off < ROUNDED + scatter
        assert scatter < 1e-4  # the differences can tell


@pytest.mark.parametrize("case", EXAMPLES)
def test_derivatives_of_rigid_loops_and_springs_equal_differences(case):
    make, by, size = EXAMPLES[case]
    for off, scatter in _compare(shorten(make(), 20), by, size):
        assert off < 1e-9 + scatter  # nothing is marched, no step's Newton leaves anything
        assert scatter < 1e-6


@pytest.mark.parametrize("case", SOFT)
def test_derivatives_of_beams_in_loops_equal_differences(root, case):
    make, names, by, size = SOFT[case]
    for off, scatter in _compare(shorten(soften(root, make(), names), 100), by, size):
        assert off < ROUNDED + scatter
        assert scatter < 1e-4


def test_drives_that_are_more_than_the_freedoms_of_rigid_links_bend_the_beams(root):
    """Three drives on a five-bar: rigid links could not follow, beams can."""
    rigid, motion, start, step = shorten(loop_examples.five_bar(3), 100)
    q = flexinv.solve(rigid, motion, step=step, start=start).q[[0, -1]]
    mechanism, _ = soften(root, (rigid, None), ("far left", "far right"))
    ends = [dict(zip("ABE", row[:3], strict=True)) for row in q]
    every = flexinv.Motion.point_to_point(*ends, duration=motion.duration, law="nonic")
    task = mechanism, every, {"D": q[0, 3:]}, step
    for by, size in (("motion.B[1]", 1e-3), ("links.far left.beam.section.stiffness[0,5]", 1e-2)):
        for off, scatter in _compare(task, by, size):
            assert off < ROUNDED + scatter
            assert scatter < 1e-4


def test_a_loop_that_is_off_by_a_thousandth_would_be_seen(root):
    """The tests above fail where the rocker is heavier by 1e-3: differences tell more than that."""
    mechanism, motion, start, step, _ = _load(root, *BENDING)
    by = "links.rocker.bodies.0.inertia.mass"
    (parameter,) = resolve_parameters(by, mechanism, motion)
    coarse, fine = _compute_differences((mechanism, motion, start, step), parameter, 1e-2)
    other, _ = resolve_parameters("links.crank.bodies.0.inertia.mass", mechanism, motion)[0].build_setup(
        mechanism, motion, 0.3
    )
    heavier, _ = parameter.build_setup(other, motion, 1.001 * parameter.value)
    found = flexinv.differentiate(heavier, motion, "motion.A[1]", step=step, start=start).torque[:, :, 0]
    present = flexinv.differentiate(mechanism, motion, "motion.A[1]", step=step, start=start).torque[:, :, 0]
    scale = np.abs(present).max()
    scatter = np.abs(coarse - fine)[:, :1].max() / np.abs(fine[:, :1]).max()
    assert np.abs(found - present).max() / scale > ROUNDED + scatter


def test_the_vibration_that_a_loop_is_left_with_has_exact_slopes(root):
    mechanism, _, start, _, _ = _load(root, *BENDING)
    time = np.linspace(0.0, 0.3, 8)
    part = time / 0.3
    way = part**3 * (10.0 - 15.0 * part + 6.0 * part**2)
    motion = flexinv.Motion.from_samples(time, {"A": 0.35 + 1.7 * way}, rest=True)
    end = {"step": 1.5e-3, "end": 0.303, "initial": "static", "start": start}
    found = flexinv.differentiate(mechanism, motion, "motion.A[3]", **end).differentiate_residual_vibration()
    (parameter,) = resolve_parameters("motion.A[3]", mechanism, motion)

    def leave(change):
        moved = parameter.build_setup(mechanism, motion, parameter.value + change)[1]
        return flexinv.solve(mechanism, moved, **end).find_residual_vibration().energy

    change = 1e-3
    difference = (8 * (leave(change) - leave(-change)) - (leave(2 * change) - leave(-2 * change))) / (12 * change)
    assert found.energy[0] == pytest.approx(
        difference, rel=1e-6
    )  # of fourth order in 1e-3; END_CHANGE leaves as much out


def test_what_goes_on_swinging_in_a_loop_is_its_beam(root):
    """The pins of the coupler are held by the crank: its middle is what swings."""
    mechanism, motion, start, step, _ = _load(root, *BENDING)
    left = flexinv.solve(mechanism, motion, step=step, end=0.303, start=start).find_residual_vibration()
    middle = mechanism.link_of["coupler"].beam.length
    shape = np.linalg.norm(left.modes.displacement[0].real, axis=1).max()
    swing = shape * np.hypot(left.cosine[0], left.sine[0])
    assert left.reach["coupler"] == pytest.approx(swing, rel=0.2)  # the first mode has most of it
    assert 10.0 * left.reach["rocker"] < left.reach["coupler"] < middle


def test_coordinates_of_joints_without_a_drive_follow_the_loop(root):
    mechanism, motion, start, step, _ = _load(root, *FOUR_BAR)
    found = flexinv.differentiate(mechanism, motion, "motion.A[1]", step=step, start=start)
    beside = []
    for angle in (1e-4, -1e-4):
        moved = resolve_parameters("motion.A[1]", mechanism, motion)[0].build_setup(
            mechanism, motion, np.radians(120) + angle
        )
        beside.append(flexinv.solve(*moved, step=step, start=start).q)
    # differences of second order in 1e-4
    assert np.allclose(found.q[:, :, 0], (beside[0] - beside[1]) / 2e-4, atol=1e-6)
    assert np.abs(found.q[-1, 1:, 0]).min() > 0.1


def test_loops_that_have_no_derivative_say_so(root):
    mechanism, motion, start, step, _ = _load(root, *FOUR_BAR)
    closure = replace(mechanism.closures[0], active=((0.0, 0.2),))
    switched = replace(mechanism, closures=(closure,))
    with pytest.raises(InputError, match="closure 'C' of 'four_bar' acts for a while"):
        flexinv.differentiate(switched, motion, "gravity[1]", step=step, start=start)
    q = flexinv.solve(mechanism, motion, step=step, start=start).q
    time = np.linspace(0.0, 0.3, len(q))
    whole = flexinv.Motion.from_samples(time, dict(zip("ABD", q.T, strict=True)), rest=True)
    with pytest.raises(InputError, match="loops of 'four_bar' do not stay closed where 'motion"):
        flexinv.differentiate(mechanism, whole, "motion.B[50]", step=step)


def test_a_parameter_may_not_change_the_number_of_constraints(root):
    mechanism, motion, start, step, _ = _load(root, *BENDING)
    ball = replace(mechanism, closures=(replace(mechanism.closures[0], kind="spherical"),))
    loose = flexinv.Parameter("kind", 0.0, lambda value: mechanism if value == 0.0 else ball)
    with pytest.raises(InputError, match="changes the number of unknowns or constraints"):
        flexinv.differentiate(mechanism, motion, loose, step=step, start=start)
