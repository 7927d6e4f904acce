"""What differentiate gives beside torques equals differences of solve: wrenches, resultants, strains, energies, closures."""

from __future__ import annotations

import numpy as np
import pytest

import flexinv
from flexinv.errors import InputError
from flexinv.sensitivity.parameters import resolve_parameters

STEP = 2e-3
OF = ("wrench", "internal", "root", "strain", "deflection", "energy")
LOOPED = (*OF, "reaction")
LOOP_START = {"B": 0.8, "D": 1.8}


def _make_move(mechanism):
    joints = [joint.name for joint in mechanism.joints if joint.nv and joint.actuated]
    ends = {name: 0.5 + 0.1 * k for k, name in enumerate(joints)}
    return flexinv.Motion.point_to_point(dict.fromkeys(joints, 0.0), ends, duration=0.2, hold=0.05, law="nonic")


def _collect_results(solution):
    """The results of a solution by name, and by joint, beam, closure or kind of energy."""
    balance = solution.balance
    return {
        "wrench": solution.wrench,
        "internal": solution.internal,
        "root": solution.root,
        "strain": solution.strain,
        "deflection": solution.deflection,
        "energy": {"kinetic": balance.kinetic, "potential": balance.potential, "elastic": balance.elastic},
        "reaction": {} if solution.loops is None else solution.loops.reaction,
    }


def _compute_differences(run, value, change):
    """Differences of fourth order of all results."""
    beside = {k: _collect_results(run(value + k * change)) for k in (-2, -1, 1, 2)}
    return {
        name: {
            key: (8 * (beside[1][name][key] - beside[-1][name][key]) - (beside[2][name][key] - beside[-2][name][key]))
            / (12 * change)
            for key in beside[1][name]
        }
        for name in beside[1]
    }


# Change of the differences, of the number, as in `test_differentiate`.
CASES = {
    "row of a motion": ("flex_two_link", "motion.joint2[1]", 2e-2, "consistent"),
    "duration": ("flex_one_link_damped", "motion.duration", 1e-3, "consistent"),
    "length of a beam": ("flex_one_link_damped", "links.link.beam.length", 2e-4, "consistent"),
    "stiffness": ("flex_one_link_damped", "links.link.beam.section.stiffness[0,5]", 2e-3, "consistent"),
    "damping": ("flex_one_link_damped", "modal_damping.ratio", 5e-3, "consistent"),
    "gravity and a sudden start": ("spatial_arm", "gravity[2]", 2e-3, "consistent"),
    "gravity and a static start": ("spatial_arm", "gravity[0]", 2e-2, "static"),
    "payload": ("spatial_arm", "links.forearm.bodies.tool.inertia.mass", 1e-3, "consistent"),
    "spring of a passive joint": ("quanser_2dsfl", "joints.1.stiffness", 2e-3, "consistent"),
    "rigid arm": ("ur5", "motion.elbow_joint[1]", 2e-2, "consistent"),
    "crank of a flexible loop": ("four_bar_flexible", "motion.A[1]", 1e-2, "consistent"),
    "beam of a loop": ("four_bar_flexible", "links.coupler.beam.length", 2e-4, "consistent"),
    "crank of a rigid loop": ("four_bar", "motion.A[1]", 1e-2, "consistent"),
    "mass in a rigid loop": ("four_bar", "links.coupler.bodies.0.inertia.mass", 1e-2, "consistent"),
    "pivot of a rigid loop": ("four_bar", "closures.C.second.placement.position[0]", 1e-3, "consistent"),
}


KNOWN = 3e-7  # of the largest: resultants are stiffness times small strains, which are differences of places


@pytest.mark.parametrize("case", CASES)
def test_results_have_the_derivatives_of_differences_of_solve(root, case):
    name, by, part, initial = CASES[case]
    mechanism = flexinv.load_mechanism(root / "models" / name)
    options = {"step": STEP, "initial": initial}
    if mechanism.closures:
        options["start"] = LOOP_START
        motion = flexinv.Motion.point_to_point({"A": 0.35}, {"A": 2.1}, duration=0.3, law="nonic")
    else:
        motion = _make_move(mechanism)
    of = LOOPED if mechanism.closures else OF
    found = flexinv.differentiate(mechanism, motion, by, of=of, **options).results
    (parameter,) = resolve_parameters(by, mechanism, motion)

    def run(value):
        changed, moved = parameter.build_setup(mechanism, motion, value)
        return flexinv.solve(changed, moved, end=motion.duration, **options)

    size = part * (abs(parameter.value) or 1.0)
    coarse, fine = (_compute_differences(run, parameter.value, change) for change in (size, size / 2))
    assert set(found) == set(of)
    for result in of:
        assert set(found[result]) == set(fine[result])
        scale = max((np.abs(values).max(initial=0.0) for values in fine[result].values()), default=0.0)
        for key, wanted in fine[result].items():
            # scatter: 15 times the error of the finer differences, beside their rounding
            scatter = np.abs(coarse[result][key] - wanted).max(initial=0.0)
            off = np.abs(found[result][key][..., 0] - wanted).max(initial=0.0)
            assert off <= KNOWN * scale + 4 * scatter
            assert scatter <= 1e-4 * scale  # the differences can tell


def test_resultants_without_the_multipliers_of_closures_would_be_seen(root, monkeypatch):
    """The test above fails where the forces of closures are left as they are: wrenches of a loop are off by more than a tenth."""
    mechanism = flexinv.load_mechanism(root / "models" / "four_bar_flexible")
    motion = flexinv.Motion.point_to_point({"A": 0.35}, {"A": 2.1}, duration=0.3, law="nonic")
    options = {"step": 3e-3, "start": LOOP_START, "of": ["wrench"]}
    right = flexinv.differentiate(mechanism, motion, "motion.A[1]", **options).results["wrench"]["B"]
    from flexinv.sensitivity import nearby_results

    begin = nearby_results.NearbyResults.__init__

    def begin_without_multipliers(self, system, solution, tangents, multiplier, of, order):
        still = np.zeros_like(tangents.multiplier)
        begin(self, system, solution, tangents._replace(multiplier=still), multiplier, of, order)

    monkeypatch.setattr(nearby_results.NearbyResults, "__init__", begin_without_multipliers)
    wrong = flexinv.differentiate(mechanism, motion, "motion.A[1]", **options).results["wrench"]["B"]
    assert np.abs(wrong - right).max() > 0.1 * np.abs(right).max()


def test_strains_times_stiffness_are_the_resultants_of_an_undamped_beam(root):
    mechanism = flexinv.load_mechanism(root / "models" / "spatial_arm")
    solution = flexinv.solve(mechanism, _make_move(mechanism), step=STEP)
    (beam,) = [link for link in mechanism.beams if link.name == "forearm"]
    stiffness = beam.beam.section.stiffness[0]
    wanted = solution.internal["forearm"]
    # strains are differences of poses: 1e-16 of a place, times an axial stiffness
    assert np.abs(solution.strain["forearm"] * stiffness - wanted).max() < 1e-9 * np.abs(stiffness).max()


def test_a_result_that_is_none_is_refused_with_the_nearest(root):
    mechanism = flexinv.load_mechanism(root / "models" / "flex_one_link")
    with pytest.raises(InputError, match=r"of: 'wrenches': expected one of wrench, internal, .*; write 'wrench'"):
        flexinv.differentiate(mechanism, _make_move(mechanism), "gravity[2]", step=STEP, of=["wrenches"])


def test_differences_of_second_order_leave_a_millionth_out(root):
    mechanism = flexinv.load_mechanism(root / "models" / "spatial_arm")
    tables = [
        flexinv.differentiate(
            mechanism, _make_move(mechanism), "motion.pitch[1]", step=STEP, of=OF, order=order
        ).results
        for order in (6, 2)
    ]
    for result in ("wrench", "strain", "deflection", "energy"):
        for key, wanted in tables[0][result].items():
            assert np.abs(tables[1][result][key] - wanted).max() < 1e-6 * np.abs(wanted).max()
    with pytest.raises(InputError, match=r"order = 4: expected one of 6, 2"):
        flexinv.differentiate(mechanism, _make_move(mechanism), "motion.pitch[1]", step=STEP, of=OF, order=4)
