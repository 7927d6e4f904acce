"""Kinds of joint in one table; and the helical joint, against a revolute and a prismatic joint that a coupling ties."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import rigid_trees as trees
from flexible_examples import STRIP
from lane_examples import closed_tree, doubts, largest, reference

import flexinv
from flexinv.errors import InputError
from flexinv.kinematics.mesh import build
from flexinv.kinematics.nodal_motion import (
    compute_difference,
    compute_nearest_difference,
    compute_rigid_motion,
    integrate_configuration,
)
from flexinv.model.joint_kinds import CONFIGURATIONS, KINDS, VELOCITIES, compute_motion_subspace
from flexinv.model.mechanism import WORLD, Attachment, Beam, Body, Closure, Inertia, Joint, Link, Mechanism, Placement
from flexinv.planar.detection import NotPlanar, find_plane
from flexinv.rigid.torque_regressor import sample_states
from flexinv.rnea.loop_layout import BodyKind
from flexinv.typing import Array

ROUNDING = 1e-13  # a few hundred roundings of the largest effort
PITCH = 0.4  # [m]
LEAD = PITCH / (2 * np.pi)  # [m/rad]
# A screw beside every other kind: on the world, on a free base, before and behind screws, with branches.
SCREWS = (
    ("base", "free", WORLD), ("nut", "helical", "base"), ("arm", "revolute", "nut"), ("bolt", "helical", "arm"),
    ("hip", "spherical", "nut"), ("foot", "helical", "hip"), ("slide", "prismatic", "foot"), ("wheel", "continuous", "slide"),
    ("second", "helical", "wheel"), ("third", "helical", "second"),
)  # fmt: skip
# A rod on a nut, its universal joint without a drive, that a ball ties to a bolt on an arm.
CRANE = (("nut", "helical", WORLD), ("rod", "universal", "nut"), ("arm", "revolute", WORLD), ("bolt", "helical", "arm"))


def taken_apart(mechanism: Mechanism) -> Mechanism:
    """Every screw as a revolute joint with its drive, a link without mass, a prismatic joint without one, and a coupling."""
    joints: list[Joint] = []
    links = {link.name: link for link in mechanism.links}
    couplings, world = list(mechanism.closures), Attachment(WORLD)
    for joint in mechanism.joints:
        if joint.kind != "helical":
            joints.append(joint)
            continue
        turned, advance = f"{joint.name}/turned", f"{joint.name}/advance"
        links[turned] = Link(turned)
        joints.append(replace(joint, kind="revolute", child=turned, pitch=0.0))
        joints.append(Joint(advance, "prismatic", turned, joint.child, axis=joint.axis, actuated=False))
        factors = ((joint.name, -joint.pitch / (2 * np.pi)), (advance, 1.0))
        couplings.append(Closure(f"{joint.name}/thread", "coupling", world, world, factors=factors))
    ordered = tuple(links[joint.child] for joint in joints)
    return replace(mechanism, joints=tuple(joints), links=ordered, closures=tuple(couplings))


def apart(mechanism: Mechanism, parts: Mechanism, *state: Array) -> list[Array]:
    """Coordinates, rates and accelerations (samples, ...) of the mechanism taken apart."""
    out = []
    for k, values in enumerate(state):
        ours, theirs = (m.v_slices if k else m.q_slices for m in (mechanism, parts))
        new = np.empty((len(values), parts.nv if k else parts.nq))
        for joint in mechanism.joints:
            new[:, theirs[joint.name]] = values[:, ours[joint.name]]
            if joint.kind == "helical":
                new[:, theirs[f"{joint.name}/advance"]] = joint.pitch / (2 * np.pi) * values[:, ours[joint.name]]
        out.append(new)
    return out


def names_in(mechanism: Mechanism, parts: Mechanism) -> list[int]:
    """Columns of the parts' efforts that are the mechanism's."""
    return [parts.velocity_names.index(name) for name in mechanism.velocity_names]


def screws() -> Mechanism:
    m = trees.tree(SCREWS)
    joints = [
        replace(j, pitch=0.3 - 0.2 * k, stiffness=1.5, rest=0.2) if j.kind == "helical" else j
        for k, j in enumerate(m.joints)
    ]
    return replace(m, joints=tuple(joints))


def jack(load: float = 3.0, closed: bool = False) -> Mechanism:
    """A nut of 2 kg on an upright screw; closed: it lifts a carriage that slides upright, by a bearing on their common axis."""
    links = [Link("nut", (Body("nut", Inertia(2.0, np.zeros(3), np.diag([0.02, 0.02, 0.03]))),))]
    joints = [Joint("screw", "helical", WORLD, "nut", rotor_inertia=0.01, damping=0.05, friction=0.2, pitch=PITCH)]
    if not closed:
        return Mechanism("jack", tuple(links), tuple(joints))
    links.append(Link("carriage", (Body("carriage", Inertia(load, np.array([0.1, 0.0, 0.0]), 0.1 * np.eye(3))),)))
    joints.append(Joint("guide", "prismatic", WORLD, "carriage", actuated=False))
    bearing = Closure("bearing", "revolute", Attachment("nut"), Attachment("carriage"))
    return Mechanism("jack", tuple(links), tuple(joints), closures=(bearing,))


# --------------------------------------------------------------------------------------------------------- the table


@pytest.mark.parametrize("name", KINDS)
def test_the_table_is_consistent(name: str) -> None:
    kind, axis = KINDS[name], np.array([0.6, 0.0, 0.8])
    slide, turn = compute_motion_subspace(kind.number, axis, 0.5)
    assert len(kind.units) == len(kind.v)
    assert len(slide) == len(turn) == VELOCITIES[kind.number]
    nodes = 2 if name == "universal" else 1
    assert (nodes * CONFIGURATIONS[kind.number], nodes * VELOCITIES[kind.number]) == (len(kind.q), len(kind.v))
    if name != "universal":
        assert [bool(t.any()) for t in turn] == [unit == "rad" for unit in kind.units]


# ------------------------------------------------------------------------------------------------------- kinematics


def test_a_turn_of_a_screw_is_not_taken_for_none() -> None:
    m = jack()
    q = integrate_configuration(m, np.array([0.3]), np.array([2 * np.pi]))
    assert compute_difference(m, np.array([0.3]), q) == pytest.approx(2 * np.pi)
    assert compute_nearest_difference(m, np.array([0.3]), q) == pytest.approx(
        2 * np.pi
    )  # of a revolute joint it is none
    x = compute_rigid_motion(build(m), np.array([[0.3], q]), np.zeros((2, 1)), np.zeros((2, 1))).x[:, 0, 2]
    assert np.diff(x) == pytest.approx(PITCH)


# ---------------------------------------------------------------------------------------------------- rigid dynamics


def test_a_jack_in_closed_form() -> None:
    """tau = (J + rotor + m h^2) q'' + m g h + damping q' + friction."""
    state = (np.array([[0.4], [9.0]]), np.array([[1.5], [-2.0]]), np.array([[0.7], [3.0]]))
    tau = flexinv.joint_torques(jack(), *state)
    expected = (0.04 + 2.0 * LEAD**2) * state[2] + 2.0 * 9.81 * LEAD + 0.05 * state[1] + 0.2 * np.sign(state[1])
    np.testing.assert_allclose(tau, expected, rtol=1e-14)


def test_a_jack_that_lifts_a_carriage_in_a_loop() -> None:
    """The bearing brings the carriage's weight and inertia to the nut; it holds five ways, of which the guide holds four."""
    m = jack(3.0, closed=True)
    angle, rate, acceleration = 0.4, 1.5, 0.7
    state = (np.array([[value, LEAD * value]]) for value in (angle, rate, acceleration))
    tau = flexinv.prepare(m).torques(*state)
    expected = (0.04 + 5.0 * LEAD**2) * acceleration + 5.0 * 9.81 * LEAD + 0.05 * rate + 0.2
    np.testing.assert_allclose(tau, [[expected, 0.0]], rtol=1e-12, atol=1e-12)  # rounding of a least-squares problem
    motion = flexinv.Motion.point_to_point({"screw": [0.0]}, {"screw": [3.0]}, 0.5)
    solved = flexinv.solve(m, motion, step=0.05)
    own = solved.q[:, 1] - LEAD * solved.q[:, 0]
    assert np.abs(own).max() < 1e-12
    qd, qdd = solved.qd[:, 0], solved.qdd[:, 0]
    expected = (0.04 + 5.0 * LEAD**2) * qdd + 5.0 * 9.81 * LEAD + 0.05 * qd + 0.2 * np.sign(qd)
    np.testing.assert_allclose(solved.torque[:, 0], expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    ("kind", "seed", "bodies", "reduced"),
    [
        *((kind, seed, ("foot", "third"), 0) for kind in ("fixed", "revolute", "cylindrical") for seed in (2, 4)),
        ("spherical", 1, ("foot", "third"), 0),
        ("point-on-line", 3, ("foot", "third"), 0),
        ("spherical", 3, ("rod", "bolt"), 1),
    ],
)
def test_screws_of_a_loop_run_in_lanes(kind: str, seed: int, bodies: tuple[str, str], reduced: int) -> None:
    """Screws on the root, on screws, as ends and as drives of a loop, and the couplings of their parts in the same loop."""
    m, state = closed_tree(kind, seed, 0, CRANE if reduced else SCREWS, bodies)
    parts = taken_apart(m)
    f, g = flexinv.prepare(m, threads=1), flexinv.prepare(parts, threads=1)
    result, expected = f.torques(*state), g.torques(*apart(m, parts, *state))
    assert BodyKind.SCREW in {body.kind for body in f.plan.bodies}
    assert [closure.reduced for closure in f.plan.closures] == [reduced]
    assert (doubts(f, 150), f._own.counter[3]) == ([], 0)
    size = largest(f, state)
    assert np.abs(result - reference(f, state)).max() < 10 * ROUNDING * size  # pivots of 1e-2 are let through
    np.testing.assert_allclose(result, expected[:, names_in(m, parts)], rtol=0, atol=10 * ROUNDING * size)
    own = next(m.v_slices[j.name].start for j in m.joints if j.nv == 1 and not j.actuated)
    state[1][100, own] += 0.1 * np.abs(state[1]).max()
    with pytest.raises(InputError, match="qd violates closure 'C' at sample 100"):
        f.torques(*state)


def test_screws_are_revolute_and_prismatic_joints_that_a_coupling_ties() -> None:
    m = screws()
    parts = taken_apart(m)
    state = sample_states(m, 20)
    expected = flexinv.prepare(parts).torques(*apart(m, parts, *state))
    result = flexinv.prepare(m).torques(*state)
    # the parts' efforts come out of a least-squares problem for the multipliers
    np.testing.assert_allclose(
        result, expected[:, names_in(m, parts)], rtol=0, atol=10 * ROUNDING * np.abs(result).max()
    )
    assert np.abs(expected[:, ~parts.actuated]).max() < 10 * ROUNDING * np.abs(result).max()


def test_the_regressor_knows_screws() -> None:
    m = screws()
    state = sample_states(m, 5)
    y = flexinv.torque_regressor(m, *state, drives=True)
    tau = flexinv.joint_torques(m, *state)
    np.testing.assert_allclose(y.matrix @ y.values, tau, rtol=0, atol=ROUNDING * np.abs(tau).max())


def test_derivatives_are_those_of_the_parts() -> None:
    """Central differences of the torque by q; those by qd and qdd are exact for a function of second degree."""
    m = screws()
    m = replace(m, joints=tuple(replace(j, friction=0.0) for j in m.joints))
    q, qd, qdd = (part[0] for part in sample_states(m, 1))
    derivatives = flexinv.torque_derivatives(m, q, qd, qdd)
    h = 1e-5
    for k in range(m.nv):
        step = h * np.eye(m.nv)[k]
        two = [flexinv.joint_torques(m, integrate_configuration(m, q, s), qd, qdd) for s in (step, -step)]
        size = np.abs(derivatives.q).max()
        np.testing.assert_allclose(
            derivatives.q[0, :, k], (two[0] - two[1]) / (2 * h), rtol=0, atol=1e-8 * size
        )  # h^2 + 1e-16 / h
        two = [flexinv.joint_torques(m, q, qd + s, qdd) for s in (step, -step)]
        np.testing.assert_allclose(derivatives.qd[0, :, k], (two[0] - two[1]) / (2 * h), rtol=0, atol=1e-9 * size)


# -------------------------------------------------------------------------------------------------- time integration


def test_a_nut_falls_along_its_screw() -> None:
    """Without friction q'' = -m g h / (J + rotor + m h^2), which generalized-alpha integrates exactly; energy stays."""
    m = jack()
    m = replace(m, joints=(replace(m.joints[0], damping=0.0, friction=0.0),))
    time = np.linspace(0.0, 2.0, 3)
    s = flexinv.simulate(m, time, np.zeros((3, 1)), step=0.02)
    fall = -2.0 * 9.81 * LEAD / (0.04 + 2.0 * LEAD**2)
    assert np.abs(s.q[-1, 0]) > 4 * np.pi  # whole turns are counted
    np.testing.assert_allclose(
        s.q[:, 0], 0.5 * fall * s.time**2, rtol=0, atol=1e-7
    )  # Newton's last increment, 100 times
    lost = np.ptp(s.balance.kinetic + s.balance.potential + 0.5 * 0.01 * s.qd[:, 0] ** 2)
    assert lost < 1e-7 * s.balance.kinetic.max()


def boom(actuated: bool) -> Mechanism:
    """A screw, leaning, that carries a beam with a body at its end; the second joint of it moves in space."""
    links = (
        Link("nut", (Body("nut", Inertia(0.5, np.array([0.02, 0.0, 0.01]), 1e-3 * np.eye(3))),)),
        Link("boom", (Body("end", Inertia(0.05, np.zeros(3), 1e-5 * np.eye(3)), 1.0),), Beam(0.4, STRIP, 1, 3)),
    )
    axis = np.array([0.0, 0.6, 0.8])
    joints = (
        Joint(
            "screw", "helical", WORLD, "nut", axis=axis, pitch=PITCH, actuated=actuated, rotor_inertia=0.002,
            damping=0.02, friction=0.01, stiffness=0.3, rest=0.1,
        ),
        Joint("elbow", "revolute", "nut", "boom", Placement(np.array([0.05, 0.0, 0.0])), axis=np.array([0.0, 1.0, 0.0])),
    )  # fmt: skip
    return Mechanism("boom", links, joints, gravity=np.array([0.0, 1.0, -9.81]))


@pytest.mark.parametrize("actuated", [True, False], ids=["driven", "passive"])
def test_with_a_beam_a_screw_is_the_coupling_of_its_parts(actuated: bool) -> None:
    """One unknown less, no multiplier: the same motion and torque as of the march that holds the coupling."""
    m = boom(actuated)
    assert isinstance(find_plane(build(m)), NotPlanar)
    parts = taken_apart(m)
    ends = {"elbow": 0.0}, {"elbow": 0.8}
    if actuated:
        ends[0]["screw"], ends[1]["screw"] = 0.0, 2.0
    motion = flexinv.Motion.point_to_point(*ends, 0.5)
    start = {} if actuated else {"screw": 1.5}
    one = flexinv.solve(m, motion, step=2e-3, start=start)
    both = {} if actuated else {"screw": 1.5, "screw/advance": 1.5 * LEAD}
    two = flexinv.solve(parts, motion, step=2e-3, start=both)
    assert np.ptp(one.q[:, 0]) > 0.5
    own = names_in(m, parts)
    # Newton ends at increments of 1e-8; multipliers and accelerations answer to them with inertia over the step squared
    assert np.abs(one.q - two.q[:, own]).max() < 1e-7
    assert np.abs(one.torque_all - two.torque_all[:, own]).max() < 1e-5 * np.abs(one.torque_all).max()
    assert one.energy_error < 1e-3


def test_torques_of_a_driven_screw_give_its_motion_back() -> None:
    m = boom(True)
    m = replace(m, joints=(replace(m.joints[0], friction=0.0), m.joints[1]))  # smooth there, not here: of first order
    motion = flexinv.Motion.point_to_point({"screw": 0.0, "elbow": 0.0}, {"screw": 2.0, "elbow": 0.8}, 0.5)
    errors = []
    for step in (2e-3, 1e-3):
        one = flexinv.solve(m, motion, step=step)
        two = flexinv.simulate(m, one.time, one.torque, step)
        errors.append(np.abs(two.q - one.q).max())
    assert errors[1] < 1e-4
    assert np.log2(errors[0] / errors[1]) > 1.6  # of second order


# -------------------------------------------------------------------------------------------------------- in a plane


def test_a_screw_is_never_planar() -> None:
    """However small its pitch: it leaves the plane in which it turns."""
    link = Link("arm", (), Beam(0.4, STRIP, 1, 3))
    for pitch, kind in ((1e-6, "helical"), (0.0, "revolute")):
        m = Mechanism("arm", (link,), (Joint("hub", kind, WORLD, "arm", pitch=pitch),), gravity=np.zeros(3))
        assert isinstance(find_plane(build(m)), NotPlanar) == (kind == "helical")


# --------------------------------------------------------------------------------------------------------- tracking


def test_a_path_is_followed_by_turns() -> None:
    m = jack()
    path = flexinv.Path.line([0.0, 0.0, 0.0], [0.0, 0.0, 3 * PITCH], 1.0)
    following = flexinv.follow(m, path, "nut", step=0.02)
    assert following.solution.q[-1, 0] == pytest.approx(6 * np.pi, abs=1e-8)


# ------------------------------------------------------------------------------------------------------ linear models


def test_natural_frequency_of_a_sprung_screw() -> None:
    """omega^2 = k / (J + rotor + m h^2)."""
    m = jack()
    m = replace(m, joints=(replace(m.joints[0], damping=0.0, friction=0.0, stiffness=7.0, actuated=False),))
    modes = flexinv.natural_modes(m, free=["screw"])
    assert modes.frequency[0] == pytest.approx(np.sqrt(7.0 / (0.04 + 2.0 * LEAD**2)) / (2 * np.pi), rel=1e-9)


def test_a_motor_turns_a_screw() -> None:
    """Through a gear: rotor and friction at the joint, squared and times the ratio."""
    from flexinv.model.mechanism import Drive, build_drive_model

    m = jack()
    drive = Drive(ratio=5.0, rotor_inertia=1e-3, stiffness=40.0, moves="motor")
    m = replace(m, joints=(replace(m.joints[0], rotor_inertia=0.0, damping=0.0, friction=0.0, drive=drive),))
    motor, spring = build_drive_model(m).joints
    assert (motor.kind, spring.kind, motor.pitch, spring.pitch) == ("helical", "helical", PITCH, PITCH)
    assert motor.rotor_inertia == pytest.approx(0.025)


def test_couplings_take_screws() -> None:
    m = jack(3.0, closed=True)
    tie = Closure(
        "thread", "coupling", Attachment(WORLD), Attachment(WORLD), factors=(("screw", -LEAD), ("guide", 1.0))
    )
    m = replace(m, closures=(tie,))
    tau = flexinv.prepare(m).torques(np.array([[0.4, 0.4 * LEAD]]), np.zeros((1, 2)), np.zeros((1, 2)))
    np.testing.assert_allclose(tau, [[5.0 * 9.81 * LEAD, 0.0]], rtol=1e-12, atol=1e-12)
    with pytest.raises(InputError, match="closure 'thread'"):
        flexinv.prepare(m).torques(np.array([[0.4, 0.5 * LEAD]]), np.zeros((1, 2)), np.zeros((1, 2)))
