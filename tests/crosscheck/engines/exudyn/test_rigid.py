"""Exudyn with rigid bodies, by its kinematic tree and in time, against first principles; its traps and its refusals."""

from __future__ import annotations

from dataclasses import replace

import kane
import numpy as np
import pytest
import rigid_trees as trees
from exudyn.kinematicTree import TranslationZ2T66Inverse
from exudyn.rigidBodyUtilities import Translation2T66
from numpy.typing import NDArray

from crosscheck.engines.base import sample_times
from crosscheck.engines.exudyn import adapter as exudyn
from crosscheck.engines.exudyn import rigid as exudyn_rigid
from crosscheck.engines.exudyn.models import planar as exudyn_planar
from crosscheck.engines.exudyn.models import spatial as exudyn_spatial
from crosscheck.measures.record import Record, check
from crosscheck.studies.robot_sweep import sample_states
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import WORLD, Beam, Body, Inertia, Joint, Link, Mechanism, Section
from flexinv.model.motion import Motion

Array = NDArray[np.float64]
# Some thousand double-precision operations per effort: a few hundred roundings of the largest term.
ROUNDING = 1e-13
# Of the time integration at h = 1 ms: (w h)^2 with w = 20 rad/s, twice the fastest of these motions.  Wrong signs, axes or
# frames are of order 1, and the order of convergence is tested beside it.
SECOND_ORDER = 4e-4


def moved(mechanism: Mechanism, samples: int = 11) -> Case:
    """A quintic in 0.5 s from one random configuration to another."""
    q = sample_states(mechanism, 2, np.random.default_rng(2))[0]
    case = trees.case_of(Motion.point_to_point(q[0], q[1], 0.5, law="quintic"), 0.5, 0.5 / (samples - 1))
    return replace(case, quantities=("torque", "wrench", "tip"))


def judge(mechanism: Mechanism, case: Case) -> dict[str, Array]:
    """Every series of a rigid mechanism from first principles."""
    states = list(zip(*case.motion.evaluate(mechanism, sample_times(case)), strict=True))
    torque = np.array([kane.torque(mechanism, *s) for s in states])
    out = {f"torque/{name}": torque[:, k] for k, name in enumerate(mechanism.velocity_names)}
    for joint in mechanism.joints:
        wrench = np.array([kane.wrench(mechanism, joint, *s) for s in states])
        out |= {f"wrench/{joint.name}/{c}": wrench[:, k] for k, c in enumerate(("fx", "fy", "fz", "mx", "my", "mz"))}
    for link in mechanism.links:
        tip = np.array([kane.tip(mechanism, link, s[0]) for s in states])
        out |= {f"tip/{link.name}/{c}": tip[:, k] for k, c in enumerate("xyz")}
    return out


def error(record: Record, expected: dict[str, Array], quantity: str = "") -> float:
    """Largest error of the series of a quantity over the largest value of that quantity."""
    names = [n for n in record.series if n.startswith(quantity)]
    assert names
    size = {
        n.split("/")[0]: max(np.abs(v).max() for k, v in expected.items() if k.startswith(n.split("/")[0]))
        for n in names
    }
    return max(float(np.abs(record.series[n].values - expected[n]).max() / size[n.split("/")[0]]) for n in names)


# ------------------------------------------------------------------------------------------------ kinematic tree


@pytest.mark.parametrize("kind", [None, *trees.KINDS])
def test_the_tree_gives_torque_wrench_and_tip_of_first_principles(kind: str | None) -> None:
    mechanism = trees.tree() if kind is None else trees.chain(kind)
    case = moved(mechanism)
    record = exudyn.run(mechanism, case, "exudyn", {})
    check(record, sample_times(case))
    expected = judge(mechanism, case)
    assert {n for n in expected if "flange_joint" not in n} == set(record.series)  # a fixed joint has no wrench here
    assert error(record, expected) < ROUNDING


def test_drives_are_part_of_the_effort_and_each_is_seen() -> None:
    """Rotor inertia, damping and friction, left away one at a time, are differences of their own size."""
    mechanism = trees.chain("prismatic")
    case = moved(mechanism)
    full = exudyn.run(mechanism, case, "exudyn", {})
    _, qd, qdd = case.motion.evaluate(mechanism, sample_times(case))
    joint = mechanism.joint_of["body_joint"]
    parts = {
        "rotor_inertia": joint.rotor_inertia * qdd[:, 1],
        "damping": joint.damping * qd[:, 1],
        "friction": joint.friction * np.sign(qd[:, 1]),
    }
    for name, part in parts.items():
        joints = tuple(replace(j, **{name: 0.0}) if j is joint else j for j in mechanism.joints)
        less = exudyn.run(replace(mechanism, joints=joints), case, "exudyn", {})
        difference = full.series["torque/body_joint"].values - less.series["torque/body_joint"].values
        assert np.abs(part).max() > 0.1
        np.testing.assert_allclose(difference, part, rtol=0, atol=ROUNDING * 100)


FAULTS = {
    "a payload of 1 % of a body": lambda b: replace(b, inertia=b.inertia.replace_unchecked(mass=1.01 * b.inertia.mass)),
    "a centre of mass 1 mm off": lambda b: replace(b, inertia=b.inertia.replace_unchecked(com=b.inertia.com + 1e-3)),
    "an inertia about the wrong point": lambda b: replace(
        b, inertia=b.inertia.replace_unchecked(tensor=b.inertia.tensor + 0.01 * np.eye(3))
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_planted_fault_is_out_of_all_proportion_to_rounding(fault: str) -> None:
    mechanism = trees.tree()
    case = moved(mechanism)
    first = mechanism.links[1]
    wrong = replace(first, bodies=(FAULTS[fault](first.bodies[0]), *first.bodies[1:]))
    links = (mechanism.links[0], wrong, *mechanism.links[2:])
    record = exudyn.run(replace(mechanism, links=links), case, "exudyn", {})
    # The smallest fault, 1 mm on one of fourteen bodies, shows as some 1e-4 of the largest effort.
    assert error(record, judge(mechanism, case), "torque") > 1e-5


def test_why_prismatic_joints_stand_on_frames_that_move() -> None:
    """The engine's own Pz moves the child to -q: its transformation is the inverse of what the name says."""
    np.testing.assert_array_equal(TranslationZ2T66Inverse(2.0), Translation2T66([0.0, 0.0, -2.0]))
    mechanism = trees.chain("prismatic")
    q, qd, qdd = sample_states(mechanism, 3, np.random.default_rng(5))
    expected = np.array([kane.torque(mechanism, *row) for row in zip(q, qd, qdd, strict=True)])
    right = exudyn_rigid.compute_inverse_dynamics(mechanism, q, qd, qdd).torque
    wrong = exudyn_rigid.compute_inverse_dynamics(mechanism, q * (1, -1), qd, qdd).torque
    bodies = trees.without_drives(mechanism)
    expected = np.array([kane.torque(bodies, *row) for row in zip(q, qd, qdd, strict=True)])
    assert np.abs(right - expected).max() < ROUNDING * np.abs(expected).max()
    assert np.abs(wrong - expected).max() > 0.1 * np.abs(expected).max()


# -------------------------------------------------------------------------------------------------------- in time


@pytest.mark.parametrize("kind", [k for k in trees.KINDS if k != "free"])
def test_prescribed_constraints_in_space_converge_to_first_principles(kind: str) -> None:
    """Every joint kind in redundant coordinates: force, moment, torque and tip with the order of the step."""
    mechanism = trees.chain(kind)
    case = moved(mechanism, 6)
    expected = judge(mechanism, case)
    errors = [error(exudyn.run(mechanism, case, "exudyn-dae", {"step": h}), expected) for h in (2e-3, 1e-3)]
    # generalized-alpha is of order 2; the step of the jerk at the start, of order h, has left by the second sample
    assert errors[1] < 0.3 * errors[0]
    assert errors[1] < SECOND_ORDER


def test_a_free_base_in_time() -> None:
    mechanism = trees.chain("free")
    case = moved(mechanism, 6)
    record = exudyn.run(mechanism, case, "exudyn-dae", {"step": 5e-4})
    check(record, sample_times(case))
    assert error(record, judge(mechanism, case)) < SECOND_ORDER


def planar() -> Mechanism:
    """The double pendulum, its first rod with a branch, in a plane of its own: y is the normal."""
    mechanism, p = trees.double_pendulum()
    fork = Joint("fork", "continuous", "link1", "branch", axis=np.array([0.0, 1.0, 0.0]))
    link = Link("branch", mechanism.links[1].bodies, tip=np.array([p["c2"], 0.0, 0.1]))
    return replace(mechanism, links=(*mechanism.links, link), joints=(*mechanism.joints, fork))


def test_a_planar_mechanism_runs_in_the_plane_with_index_2() -> None:
    mechanism = planar()
    motion = Motion.point_to_point([0.3, -0.4, 0.5], [1.8, 0.9, -1.0], 0.5)  # a cycloid: its jerk jumps at both ends
    case = replace(trees.case_of(motion, 0.5, 0.05), quantities=("torque", "wrench", "tip"))
    record = exudyn.run(mechanism, case, "exudyn-dae", {"step": 1e-3})
    assert record.settings["model"] == "planar bodies"
    assert record.settings["integrator"] == "TrapezoidalIndex2"
    expected = judge(mechanism, case)
    assert error(record, expected) < 1e-4  # order 2, and no transient at either end
    half = exudyn.run(mechanism, case, "exudyn-dae", {"step": 5e-4})
    assert error(half, expected) < 0.3 * error(record, expected)


def test_a_start_in_motion() -> None:
    """Samples that begin and end in motion: initial velocities of every body, reactions at 0 extrapolated."""
    for mechanism in (planar(), trees.chain("revolute")):
        time = np.linspace(0.0, 0.5, 26)
        q = np.stack([0.3 * k + np.sin(2.0 * time + k) for k in range(mechanism.nv)], axis=1)
        case = replace(trees.case_of(Motion.from_samples(time, q), 0.5, 0.1), quantities=("torque", "wrench", "tip"))
        record = exudyn.run(mechanism, case, "exudyn-dae", {"step": 2e-4})
        assert record.settings["reactions_at_0"] == "2 R(h) - R(2 h)"
        expected = judge(mechanism, case)
        # The engine starts with accelerations that leave out the prescribed ones: this decays as 0.5 per step in
        # space (index 3) and is not there in the plane (index 2) but at t = 0, where two steps are extrapolated.
        for name in (n for n in record.series if n.startswith("torque")):
            late = np.abs(record.series[name].values - expected[name])[1:]
            assert late.max() < 1e-4 * np.abs(expected[name]).max()


def test_bang_bang_settles_between_its_jumps() -> None:
    """After a jump of the acceleration index 3 at rho = 0.5 settles; index 2 would ring for ever."""
    mechanism = planar()
    motion = Motion.point_to_point([0.3, -0.4, 0.5], [1.8, 0.9, -1.0], 0.4, hold=0.2, law="bang-bang")
    case = replace(trees.case_of(motion, 0.6, 0.05), quantities=("torque", "wrench", "tip"))
    record = exudyn.run(mechanism, case, "exudyn-dae", {"step": 1e-3})
    assert record.settings["integrator"] == "generalized-alpha, index 3, rho = 0.5"
    expected = judge(mechanism, case)
    away = [k for k, t in enumerate(record.time) if min(abs(t - j) for j in motion.jumps) > 0.04]  # 40 steps
    assert len(away) >= 6
    for name in (n for n in record.series if n.startswith("torque")):
        off = np.abs(record.series[name].values - expected[name])[away].max()
        assert off < 1e-4 * np.abs(expected[name]).max()


# ------------------------------------------------------------------------------------- the plane, and what is refused


def test_what_is_planar_and_what_is_not() -> None:
    mechanism = planar()
    case = trees.case_of(Motion.point_to_point([0.0, 0.0, 0.0], [1.0, 1.0, 1.0], 0.5), 0.5, 0.1)

    def verdict(changed: Mechanism) -> str | Array:
        return exudyn_planar.find_plane(changed, exudyn.build_start_layout(changed, case))

    plane = verdict(mechanism)
    assert not isinstance(plane, str)
    np.testing.assert_allclose(np.abs(plane[:, 2]), [0, 1, 0], atol=1e-15)
    tilted = replace(mechanism.joints[2], axis=np.array([0.0, 0.6, 0.8]))
    assert "axis of joint fork" in verdict(replace(mechanism, joints=(*mechanism.joints[:2], tilted)))
    assert "gravity" in verdict(replace(mechanism, gravity=np.array([0.0, 1.0, -9.0])))
    raised = replace(mechanism.links[1], bodies=(Body("b", Inertia(1.0, np.array([0.0, 0.01, 0.0]))),))
    assert "heights" in verdict(replace(mechanism, links=(mechanism.links[0], raised, mechanism.links[2])))
    skewed = Inertia(1.0, tensor=np.array([[2.0, 0.1, 0.0], [0.1, 2.0, 0.0], [0.0, 0.0, 2.0]]))
    leaning = replace(mechanism.links[1], bodies=(Body("b", skewed),))
    assert "leans" in verdict(replace(mechanism, links=(mechanism.links[0], leaning, mechanism.links[2])))


def test_refusals_name_what_they_refuse() -> None:
    mechanism = planar()
    case = trees.case_of(Motion.point_to_point([0.0, 0.0, 0.0], [1.0, 1.0, 1.0], 0.5), 0.5, 0.1)
    section = Section(np.zeros(1), np.ones((1, 6)), np.ones(1), np.ones((1, 3)))
    bent = replace(mechanism.links[1], bodies=(), beam=Beam(0.4, section))
    flexible = replace(mechanism, links=(mechanism.links[0], bent, mechanism.links[2]))
    assert exudyn.unsupported(mechanism, case, "exudyn") is None
    assert exudyn.unsupported(mechanism, case, "exudyn-dae") is None
    assert exudyn.unsupported(mechanism, case, "exudyn-ge") == "no link bends: see exudyn and exudyn-dae"
    assert exudyn.unsupported(flexible, case, "exudyn") == "exudyn has rigid bodies only; flexible here: link2"
    assert exudyn.unsupported(flexible, case, "exudyn-ancf") is None
    loose = tuple(replace(j, actuated=False) if j.name == "fork" else j for j in mechanism.joints)
    part = trees.case_of(Motion.point_to_point({"j1": 0.0, "j2": 0.0}, {"j1": 1.0, "j2": 1.0}, 0.5), 0.5, 0.1)
    assert "fork" in str(exudyn.unsupported(replace(mechanism, joints=loose), part, "exudyn-dae"))
    curved = replace(bent, beam=Beam(0.4, section, curvature=np.array([0.1, 0.0, 0.0])))
    twisted = replace(mechanism, links=(mechanism.links[0], curved, mechanism.links[2]))
    assert "link2 is curved" in str(exudyn.unsupported(twisted, case, "exudyn-ge"))


def test_a_floating_link_on_a_moving_one_is_refused_in_time() -> None:
    mechanism = trees.tree((("arm", "revolute", WORLD), ("drone", "free", "arm")))
    assert "joint drone_joint" in str(exudyn_spatial.describe_refusal(mechanism))
    assert exudyn.unsupported(mechanism, moved(mechanism), "exudyn") is None
