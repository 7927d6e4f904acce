"""differentiate equals differences of solve with a vanishing change, for every kind of parameter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import flexinv
from flexinv.errors import InputError
from flexinv.sensitivity.parameters import evaluate_stretch, resolve_parameters, scale_duration

STEP = 2e-3


def _load(root, name):
    return flexinv.load_mechanism(root / "models" / name)


def _move(mechanism, law="nonic", duration=0.2):
    joints = [joint.name for joint in mechanism.joints if joint.nv and joint.actuated]
    ends = {name: 0.5 + 0.1 * k for k, name in enumerate(joints)}
    return flexinv.Motion.point_to_point(dict.fromkeys(joints, 0.0), ends, duration=duration, hold=0.05, law=law)


def _compute_differences(mechanism, motion, parameter, size, initial):
    """Differences of fourth order of all torques and tips, and of the same with half the change."""

    def run(value):
        changed, moved = parameter.build_setup(mechanism, motion, value)
        found = flexinv.solve(changed, moved, step=STEP, end=motion.duration, initial=initial)
        return np.hstack([found.torque, *found.tip.values()])

    def difference(change):
        beside = {k: run(parameter.value + k * change) for k in (-2, -1, 1, 2)}
        return (8 * (beside[1] - beside[-1]) - (beside[2] - beside[-2])) / (12 * change)

    return difference(size), difference(size / 2)


# Change of the differences, of the number: their error falls with its fourth power, rounding rises with its inverse.
CASES = {
    "end of a move": ("flex_two_link", "motion.joint2[1]", 2e-2, "consistent"),
    "duration": ("flex_one_link_damped", "motion.duration", 1e-3, "consistent"),
    "length of a beam": ("flex_one_link_damped", "links.link.beam.length", 2e-4, "consistent"),
    "stiffness": ("flex_one_link_damped", "links.link.beam.section.stiffness[0,5]", 2e-3, "consistent"),
    "damping": ("flex_one_link_damped", "modal_damping.ratio", 5e-3, "consistent"),
    "mass per length": ("flex_two_link", "links.link2.beam.section.mass_per_length[0]", 2e-3, "consistent"),
    "gravity and a sudden start": ("spatial_arm", "gravity[2]", 2e-3, "consistent"),
    "gravity and a static start": ("spatial_arm", "gravity[0]", 2e-2, "static"),
    "payload": ("spatial_arm", "links.forearm.bodies.tool.inertia.mass", 1e-3, "consistent"),
    "place of a joint": ("spatial_arm", "joints.pitch.placement.position[0]", 2e-3, "consistent"),
    "spring of a passive joint": ("quanser_2dsfl", "joints.1.stiffness", 2e-3, "consistent"),
}


@pytest.mark.parametrize("case", CASES)
def test_derivatives_equal_differences_of_solve(root, case):
    name, by, part, initial = CASES[case]
    mechanism = _load(root, name)
    motion = _move(mechanism)
    (parameter,) = resolve_parameters(by, mechanism, motion)
    size = part * (abs(parameter.value) or 1.0)
    coarse, fine = _compute_differences(mechanism, motion, parameter, size, initial)
    found = flexinv.differentiate(mechanism, motion, by, step=STEP, initial=initial)
    together = np.hstack([found.torque[:, :, 0], *(tip[:, :, 0] for tip in found.tip.values())])
    torques = found.torque.shape[1]
    for columns in (slice(torques), slice(torques, None)):
        scale = np.abs(fine[:, columns]).max()
        if scale < 1e-9:  # nothing depends on it
            assert np.abs(together[:, columns]).max() < 1e-9
            continue
        scatter = (
            np.abs(coarse - fine)[:, columns].max() / scale
        )  # 15 times the error of the finer one, beside rounding
        off = np.abs(together - fine)[:, columns].max() / scale
        assert off < 1e-7 + scatter
        assert scatter < 1e-3  # the differences can tell


def test_a_derivative_that_is_off_by_a_thousandth_would_be_seen(root):
    """The test above fails where the damping of the beam is off by 1e-3: its differences tell more than that."""
    mechanism = _load(root, "flex_one_link_damped")
    motion = _move(mechanism)
    by = "modal_damping.ratio"
    (parameter,) = resolve_parameters(by, mechanism, motion)
    coarse, fine = _compute_differences(mechanism, motion, parameter, 5e-3 * parameter.value, "consistent")
    other, _ = parameter.build_setup(mechanism, motion, 1.001 * parameter.value)
    found = flexinv.differentiate(other, motion, by, step=STEP).torque[:, :, 0]
    scale = np.abs(fine[:, :1]).max()
    assert np.abs(found - fine[:, :1]).max() / scale > 1e-7 + np.abs(coarse - fine)[:, :1].max() / scale


def test_rigid_arms_follow_the_derivatives_of_recursive_newton_euler(root):
    mechanism = _load(root, "ur5")
    motion = _move(mechanism)
    names = [joint.name for joint in mechanism.joints if joint.nv]
    found = flexinv.differentiate(mechanism, motion, [f"motion.{name}[1]" for name in names], step=1e-2)
    solution = found.solution
    slopes = flexinv.torque_derivatives(mechanism, solution.q, solution.qd, solution.qdd)
    unit = flexinv.Motion.point_to_point(
        dict.fromkeys(names, 0.0), dict.fromkeys(names, 1.0), duration=0.2, hold=0.05, law="nonic"
    )
    paths = unit.evaluate(mechanism, solution.time)
    chain = sum(slope * path[:, None, :] for slope, path in zip((slopes.q, slopes.qd, slopes.qdd), paths, strict=True))
    # both are analytic: what is left is the rounding of M = (T - K) / 2^100 (`dynamics.linearization`)
    assert np.abs(found.torque - chain).max() < 1e-10 * np.abs(chain).max()


def test_samples_of_a_spline_are_parameters(root):
    mechanism = _load(root, "flex_one_link_damped")
    time = np.linspace(0.0, 0.2, 9)
    angle = 0.5 * (time / 0.2) ** 2 * (3 - 2 * time / 0.2)
    motion = flexinv.Motion.from_samples(time, {"hub": angle}, rest=True)
    found = flexinv.differentiate(mechanism, motion, ["motion.hub[3]", "motion.hub[4]"], step=STEP)
    shift = 1e-3
    beside = []
    for sign in (1, -1):
        moved = angle.copy()
        moved[3:5] += sign * shift * np.array([1.0, -2.0])
        beside.append(
            flexinv.solve(mechanism, flexinv.Motion.from_samples(time, {"hub": moved}, rest=True), step=STEP).torque
        )
    along = found.torque @ np.array([1.0, -2.0])
    # differences of second order, of a torque that is nearly linear in the samples
    assert np.abs(along - (beside[0] - beside[1]) / (2 * shift)).max() < 1e-5 * np.abs(along).max()


def test_a_parameter_may_be_any_function(root):
    mechanism = _load(root, "flex_one_link_damped")
    motion = _move(mechanism)

    def load(mass):
        return mechanism.with_body("link", flexinv.Body("payload", flexinv.Inertia(mass), station=1.0))

    payload = flexinv.Parameter("payload", 0.02, load)
    loaded = load(0.02)
    by_name = flexinv.differentiate(loaded, motion, "links.link.bodies.payload.inertia.mass", step=STEP)
    by_function = flexinv.differentiate(loaded, motion, payload, step=STEP)
    # both are differences of the same forces, by other ways of writing the mechanism
    assert np.abs(by_name.torque - by_function.torque).max() < 1e-9 * np.abs(by_name.torque).max()


def test_a_parameter_on_which_nothing_depends_is_said(root):
    mechanism = _load(root, "flex_one_link_damped")
    idle = flexinv.Parameter("idle", 1.0, lambda value: mechanism)
    with pytest.warns(flexinv.ModelWarning, match="nothing depends on parameter 'idle'"):
        found = flexinv.differentiate(mechanism, _move(mechanism), idle, step=STEP)
    assert not found.torque.any()


def test_stretching_a_motion_is_its_derivative_by_the_duration(root):
    mechanism = _load(root, "flex_one_link_damped")
    motion = _move(mechanism, law="quintic")
    time = np.linspace(0.0, motion.duration, 41)
    exact = evaluate_stretch(motion, mechanism, time)
    size = 1e-4
    beside = [scale_duration(motion, 1 + k * size).evaluate(mechanism, time) for k in (1, -1)]
    inside = (np.abs(time - 0.2) > 1e-3) & (time > 1e-3)  # where no kink lies between
    for one, plus, minus in zip(exact, *beside, strict=True):
        change = (plus - minus) / (2 * size * motion.duration)
        assert np.abs(one - change)[inside].max() < 1e-5 * np.abs(change).max()  # of second order in 1e-4


def test_results_show_themselves_and_become_tables(root):
    mechanism = _load(root, "flex_two_link")
    found = flexinv.differentiate(mechanism, _move(mechanism), ["motion.joint1[1]", "motion.duration"], step=STEP)
    table = found.frame()
    assert table.columns.names == ["torque", "by"]
    assert np.array_equal(table["joint2"]["motion.duration"], found.torque[:, 1, 1])
    assert "joint1" in repr(found)
    assert "motion.duration" in repr(found)


BAD = {
    "motion.elbow[1]": "joint1, joint2",
    "motion.joint1[7]": "expected a row from 0 to 1",
    "links.link3.beam.length": "link1, link2",
    "links.link1.beam.lenght": "write 'length'",
    "links.link1.beam.section.damping[0,5]": "there is no damping",
    "gravity": "write an index",
    "gravity[3]": "shape (3,)",
    "links.link1": "go on with one of",
    "links.link1.beam.length.unit": "has no parts",
    "": "a name of nothing",
    "..": "expected parts",
}


@pytest.mark.parametrize("by", BAD)
def test_names_that_stand_for_nothing(root, by):
    mechanism = _load(root, "flex_two_link")
    with pytest.raises(InputError) as error:
        flexinv.differentiate(mechanism, _move(mechanism), [by], step=STEP)
    assert BAD[by] in str(error.value)


def test_what_has_no_derivative_says_so(root):
    arm = _load(root, "flex_one_link_damped")
    motion = _move(arm)
    with pytest.raises(InputError, match="accelerations jump"):
        flexinv.differentiate(arm, _move(arm, law="trapezoid"), "motion.hub[1]", step=STEP)
    with pytest.raises(InputError, match="there twice"):
        flexinv.differentiate(arm, motion, ["gravity[2]", "gravity[2]"], step=STEP)
    for nothing in (None, 5):
        with pytest.raises(InputError, match="expected a name"):
            flexinv.differentiate(arm, motion, nothing, step=STEP)
    with pytest.raises(InputError, match="at least one"):
        flexinv.differentiate(arm, motion, [], step=STEP)
    with pytest.raises(InputError, match="returns str"):
        flexinv.differentiate(arm, motion, flexinv.Parameter("odd", 1.0, lambda value: "arm"), step=STEP)
    shaped = motion.shaped(flexinv.make_shaper("ZV", 4.0))
    with pytest.raises(InputError, match="input shaper"):
        flexinv.differentiate(arm, shaped, "motion.duration", step=STEP)
    free = replace(arm, joints=tuple(replace(joint, kind="spherical") for joint in arm.joints))
    with pytest.raises(InputError, match="spherical"):
        flexinv.differentiate(free, motion, "gravity[2]", step=STEP)


@pytest.mark.parametrize("by", ["motion.joint1[3]", "motion.joint2[4]", "motion.duration"])
def test_derivatives_of_the_vibration_that_is_left_equal_differences(root, by):
    mechanism = _load(root, "flex_two_link")
    time = np.linspace(0.0, 0.2, 8)
    way = (time / 0.2) ** 3 * (10.0 - 15.0 * time / 0.2 + 6.0 * (time / 0.2) ** 2)
    motion = flexinv.Motion.from_samples(time, {"joint1": 0.5 * way, "joint2": way}, rest=True)
    found = flexinv.differentiate(mechanism, motion, by, step=STEP, end=0.21).differentiate_residual_vibration()
    (parameter,) = resolve_parameters(by, mechanism, motion)

    def leave(change):
        moved = parameter.build_setup(mechanism, motion, parameter.value + change)[1]
        left = flexinv.solve(mechanism, moved, step=STEP, end=0.21).find_residual_vibration()
        return np.concatenate([left.cosine, left.sine, [left.energy]])

    change = 1e-4 * parameter.value
    beside = {k: leave(k * change) for k in (-2, -1, 1, 2)}
    differences = (8 * (beside[1] - beside[-1]) - (beside[2] - beside[-2])) / (12 * change)
    slopes = np.concatenate([found.cosine[:, 0], found.sine[:, 0], found.energy])
    for part in (slice(0, -1), slice(-1, None)):  # amplitudes, energy
        # Differences of fourth order lose four digits to their change; END_CHANGE leaves as much out.
        assert np.abs(slopes[part] - differences[part]).max() <= 1e-6 * np.abs(differences[part]).max()


def test_vibration_has_no_derivative_by_what_changes_its_modes(root):
    mechanism = _load(root, "flex_one_link_damped")
    motion = _move(mechanism)
    for by in ("links.link.beam.length", "motion.hub[1]"):
        with pytest.raises(InputError, match="and with that the modes"):
            flexinv.differentiate(mechanism, motion, by, step=STEP).differentiate_residual_vibration()
