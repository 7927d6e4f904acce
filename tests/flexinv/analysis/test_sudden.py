"""What sets in or lets go at once: couples on a section, torques, springs, closures; by every entrance that marches.

A section has a rotary inertia of 1e-10 kg m^2, and what acts on it suddenly accelerates it by 1e6 rad/s^2 and more, for a
microsecond: no step resolves that.  A march that carried it on turned sections by whole turns, in silence.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flexible_examples import arm
from sudden_sweep import COUPLES, RIGHT, damped, outcome, pushed, quantities, silent, sweep

import flexinv
from flexinv.analysis import trajectory
from flexinv.dynamics.initial_state import begin_from_state
from flexinv.dynamics.solver import Solver
from flexinv.inverse.balance import add_step, compute_instant_energies
from flexinv.model.mechanism import Attachment, Beam, Closure, Joint, Link, Mechanism, Placement, Section, Spring

HELD = flexinv.Motion.point_to_point([0.0], [0.0], 0.02)
TIP = Attachment("link", Placement(np.zeros(3)), 1.0)


def held_energy(s: flexinv.Solution) -> float:
    """Largest kinetic and elastic energy [J]."""
    return float((s.balance.kinetic + s.balance.elastic).max())


def furthest_off(coarse: flexinv.Solution, fine: flexinv.Solution, but: str = "") -> float:
    """Largest difference of two runs at the samples of the first, over the range of the second [-]."""
    stride, off = round((len(fine.time) - 1) / (len(coarse.time) - 1)), 0.0
    for name, values in quantities(coarse).items():
        exact = quantities(fine)[name]
        if name != but:
            off = max(off, float(np.abs(values - exact[::stride]).max() / np.ptp(exact, axis=0).max()))
    return off


@pytest.mark.parametrize("axis", [2, 1])
@pytest.mark.parametrize(("couple", "step"), [(1e-3, 5e-4), (0.017, 5e-4), (0.017, 1e-4), (1.0, 5e-4)])
def test_couples_on_a_section(couple: float, step: float, axis: int) -> None:
    """Torque, places and rates from the first sample on, in the plane of the joint and across it."""
    result = outcome(couple, step, axis)
    assert result.right, result


@pytest.mark.slow
@pytest.mark.parametrize("axis", [2, 1])
def test_the_sweep(axis: int) -> None:
    """75 pairs of couple and step: at least 60 right, and what is not right is an error."""
    result = sweep(axis)
    assert len(result) == 75
    assert sum(one.right for one in result) >= 60
    assert not silent(result), silent(result)


@pytest.mark.parametrize("couple", COUPLES[4:10:5])
def test_without_damping_a_step_that_loses_what_rings_is_an_error(couple: float) -> None:
    """The step damps what it cannot resolve: more than a hundredth of the energy is gone, and a finer one keeps it."""
    with pytest.raises(flexinv.ConvergenceError, match=r"the steps lose or make .* J that are exchanged, more than 1%"):
        flexinv.solve(pushed(couple, 2, arm()), HELD, step=5e-4, end=0.02)


@pytest.mark.parametrize("step", [1e-3, 1e-4])
def test_torques_of_simulate(step: float) -> None:
    """A torque from the start, and one that sets in later: 0.01 N m on the hub, which has next to no inertia."""
    for time, torque in (([0.0, 0.02], [0.01, 0.01]), ([0.0, 0.01, 0.01, 0.02], [0.0, 0.0, 0.01, 0.01])):
        coarse, fine = (flexinv.simulate(damped(), time, np.array(torque)[:, None], h) for h in (step, step / 20))
        assert furthest_off(coarse, fine, but="moment") < 1.5 * RIGHT  # at 1e-3 s the third mode is at 0.01
        assert held_energy(coarse) == pytest.approx(held_energy(fine), rel=0.01)


def gripped(base: Mechanism) -> Mechanism:
    """The arm, held at its tip too until 0.02 s."""
    world = Attachment("world", Placement(np.array([0.4, 0.0, 0.0])))
    return replace(base, closures=(Closure("grip", "fixed", world, TIP, active=((0.0, 0.02),)),))


@pytest.mark.parametrize("in_plane", [True, False])
def test_a_fixed_closure_that_lets_go(in_plane: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its hub bends the arm by 0.02 rad; then the tip is free."""
    if not in_plane:
        monkeypatch.setattr("flexinv.analysis.trajectory.build_planar_march", lambda *_: None)
    motion = flexinv.Motion.point_to_point([0.0], [0.02], 0.01, hold=0.02)
    coarse, fine = (flexinv.solve(gripped(damped()), motion, step=step) for step in (5e-4, 2.5e-5))
    assert furthest_off(coarse, fine) < RIGHT
    assert held_energy(coarse) == pytest.approx(held_energy(fine), rel=0.01)


def test_a_spring_that_is_let_go() -> None:
    """Stretched to three times its length, on a lever at the tip."""
    world = Attachment("world", Placement(np.array([0.4, 0.3, 0.0])))
    spring = Spring("spring", world, replace(TIP, placement=Placement(np.array([0.02, 0.03, 0.0]))), 5.0, 0.1)
    coarse, fine = (flexinv.solve(replace(damped(), springs=(spring,)), HELD, step=h) for h in (5e-4, 2.5e-5))
    assert furthest_off(coarse, fine) < RIGHT


FALLING = replace(damped(), gravity=np.array([0.0, -9.81, 0.0]))
TURNING = flexinv.Motion.point_to_point([0.0], [1.0], 0.02, law="bang-bang")


@pytest.mark.parametrize("motion", [HELD, TURNING])
@pytest.mark.parametrize("mechanism", [pushed(0.017, 2), pushed(0.017, 1), FALLING])
def test_controllers_step_as_solve_does(mechanism: Mechanism, motion: flexinv.Motion) -> None:
    """The first steps are made in parts there too, between the motions of two calls."""
    s = flexinv.solve(mechanism, motion, step=5e-4)
    controller = flexinv.Controller.of(mechanism, step=5e-4)
    last = len(s.time) // 2  # where the acceleration jumps a controller goes on
    torque = [controller.start(s.q[0], s.qd[0], s.qdd[0]).copy()]
    torque += [
        controller.step(*(np.ascontiguousarray(part[k]) for part in (s.q, s.qd, s.qdd))).copy() for k in range(1, last)
    ]
    # two beginnings of one march: rounding, and Newton's 1e-8 squared
    np.testing.assert_allclose(torque, s.torque_all[:last], rtol=0, atol=1e-9 * np.ptp(s.torque_all))


def test_parts_and_batches_begin_as_solve_does() -> None:
    for mechanism in (pushed(0.017, 2), FALLING):
        whole = flexinv.solve(mechanism, HELD, step=5e-4)
        parts = list(flexinv.solve_in_parts(mechanism, HELD, step=5e-4, part=2))
        joined = np.concatenate([parts[0].torque, *(part.torque[1:] for part in parts[1:])])
        np.testing.assert_allclose(joined, whole.torque, rtol=0, atol=1e-9 * np.ptp(whole.torque))
        many = flexinv.solve_many([mechanism] * 2, HELD, step=5e-4).all()
        np.testing.assert_array_equal(many[1].torque, whole.torque)


def test_the_robot_arm_of_simo_and_vu_quoc_at_its_own_step() -> None:
    """J. C. Simo, L. Vu-Quoc, J. Appl. Mech. 53, 1986, part II: 80 N m for 2.5 s, steps of 0.5 s; no number of it is compared."""
    section = Section(
        np.zeros(1), np.array([[1e4, 1e4, 1e4, 1e3, 1e3, 1e3]]), np.ones(1), np.array([[20.0, 10.0, 10.0]])
    )
    hub = Joint("hub", "revolute", "world", "link")
    robot = Mechanism("robot arm", (Link("link", (), Beam(10.0, section, 2, 3)),), (hub,), gravity=np.zeros(3))
    pulse = [0.0, 2.5, 2.5, 10.0], [[80.0], [80.0], [0.0], [0.0]]
    coarse, fine = (flexinv.simulate(robot, *pulse, step) for step in (0.5, 0.02))
    assert held_energy(coarse) == pytest.approx(
        held_energy(fine), rel=0.2
    )  # rings on: four samples a period of the first mode
    assert abs(coarse.nodes.x - fine.nodes.x[::25]).max() < 0.05 * np.ptp(fine.nodes.x, axis=0).max()


def test_a_slider_crank_whose_crank_is_pushed(root: Path) -> None:
    """A torque on the crank that sets in and lets go at once, a soft rod: places within 1 % of their range, or a clear error.

    After N. Stander, E. Stein, Eng. Comput. 13, 1996; their numbers are not at hand, and none is compared.
    """
    model = flexinv.load_mechanism(root / "models" / "slider_crank_flexible")

    def softer(link: Link) -> Link:
        if link.beam is None:
            return link
        return replace(
            link,
            beam=replace(link.beam, section=replace(link.beam.section, stiffness=link.beam.section.stiffness / 100)),
        )

    soft = replace(model, links=tuple(map(softer, model.links)))
    pulse = [0.0, 0.2, 0.2, 0.5], np.array([[0.5], [0.5], [0.0], [0.0]])
    fine = flexinv.simulate(soft, *pulse, 5e-4, start={"main": 0.3})
    assert held_energy(fine) == pytest.approx(
        0.771, rel=1e-3
    )  # what the torque brought over 1.54 rad, with nothing that takes it
    with pytest.raises(flexinv.ConvergenceError, match=r"at t = 0.32 s \(step 0.02 s\): .* write step = 0.005"):
        flexinv.simulate(soft, *pulse, 0.02, start={"main": 0.3})
    for step in (0.01, 5e-3, 2e-3):
        coarse = flexinv.simulate(soft, *pulse, step, start={"main": 0.3})
        off = np.abs(coarse.q - fine.q[:: round(step / 5e-4)]).max(axis=0)
        assert (off < RIGHT * np.ptp(fine.q, axis=0)).all()
        assert held_energy(coarse) == pytest.approx(held_energy(fine), rel=RIGHT)


def test_what_a_step_resolves_starts_with_the_accelerations_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """A motion from rest to rest, and a jump that goes through rigid parts only, are marched whole, a couple in parts."""
    begun: list[object] = []
    in_parts = trajectory.list_early_times
    monkeypatch.setattr(trajectory, "list_early_times", lambda *given: begun.append(given) or in_parts(*given))
    flexinv.solve(arm(), flexinv.Motion.point_to_point([0.0], [1.0], 0.02, law="bang-bang", delay=1e-3), step=1e-4)
    flexinv.solve(damped(), flexinv.Motion.point_to_point([0.0], [1.0], 0.02), step=1e-4)
    assert not begun
    flexinv.solve(pushed(0.017, 2), HELD, step=5e-4)
    assert len(begun) == 1


def test_rounding_is_no_sudden_start(monkeypatch: pytest.MonkeyPatch) -> None:
    """At an angle that is no round number rounding accelerates sections, by 1e-3 rad/s^2: steps of 1 ms are whole all the same.

    In space they were made in parts, and torques were 9e-5 of the range beside those in the plane, which feels nothing at first.
    """
    motion = flexinv.Motion.point_to_point([2.5], [4.5], 0.2)
    flat = flexinv.solve(arm(), motion, step=1e-3).torque
    monkeypatch.setattr(trajectory, "build_planar_march", lambda *_: None)
    space = flexinv.solve(arm(), motion, step=1e-3).torque
    # two forms of the same equations: rounding of strains, 1e-16, times axial stiffness over torque, 1e6, and some steps of it
    np.testing.assert_allclose(space, flat, rtol=0, atol=1e-10 * np.ptp(flat))


# ------------------------------------------------------------------------------------------------- guards


def unfiltered(solver: Solver, *_: object) -> bool:
    """What the march started with: all of the accelerations found."""
    begin_from_state(solver.state)
    return False


@pytest.mark.parametrize("in_plane", [True, False])
def test_a_section_that_turns_by_whole_turns_is_an_error(in_plane: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """The starts of before, which made 4,470 J of 5e-4 J and 6,990 J of 2.4e-4 J without a word."""
    monkeypatch.setattr("flexinv.analysis.trajectory.begin_step", unfiltered)
    motion = flexinv.Motion.point_to_point([0.0], [0.05], 0.01, hold=0.02)
    mechanism, motion = (gripped(arm()), motion) if in_plane else (pushed(0.017, 2, arm()), HELD)
    with pytest.raises(
        flexinv.ConvergenceError, match=r"t = .*element 0 turns .*more elements would not help: write step = "
    ):
        flexinv.solve(mechanism, motion, step=5e-4)


def test_energy_from_nowhere_is_an_error() -> None:
    s = flexinv.solve(pushed(0.017, 2), HELD, step=5e-4)
    given = (s.mesh, s.time, s.qd, set[str](), 5e-4)
    s.balance.check(*given)
    more = np.where(s.time > 0.01, 20 * held_energy(s), 0.0)
    wrong = replace(s.balance, kinetic=s.balance.kinetic + more, work=s.balance.work - more)
    with pytest.raises(flexinv.ConvergenceError, match=r"t = 0.0105 s .*J were put in.*write step = 0.000125"):
        wrong.check(*given)
    wrong.check(*given[:2], np.full_like(s.qd, 100.0), *given[3:])  # what a fast motion of the joint would carry


def test_an_accuracy_that_needs_more_elements_takes_them_and_no_shorter_steps() -> None:
    """An element that its nodes cannot follow is no matter of the step: finer meshes are tried, then they are what is advised."""
    soft = replace(arm().links[0].beam.section, stiffness=np.array([[1.452e6, 4.65e5, 4.65e5, 0.626, 13.7, 0.0005]]))
    longest = r"\(step 0.000166667 s\).*use more elements \(elements = 8 on"
    with pytest.raises(flexinv.errors.TooFewElements, match=longest):
        flexinv.solve(pushed(0.1, 2, arm(section=soft)), HELD, accuracy=1e-2)


def test_advice_follows_from_what_happened() -> None:
    """More elements where the arm had bent that far before, a smaller step where it had not."""
    soft = replace(arm().links[0].beam.section, stiffness=np.array([[1.452e6, 4.65e5, 4.65e5, 0.626, 13.7, 0.0046]]))
    with pytest.raises(
        flexinv.ConvergenceError, match=r"had bent by [12]\.\d* rad .*use more elements \(elements = 2 on"
    ):
        flexinv.solve(pushed(0.1, 2, arm(section=soft)), HELD, step=1e-4)
    with pytest.raises(
        flexinv.ConvergenceError, match=r"in 16 parts.*more elements would not help: write step = 0.00025"
    ):
        flexinv.solve(pushed(1e4, 2, arm()), HELD, step=1e-3)


def test_energy_from_nowhere_is_an_error_of_a_controller() -> None:
    """The guard sees the energies that `solve` sees, and its own sum of the work that drives and couple do."""
    mechanism = replace(pushed(0.017, 2, arm()), gravity=np.array([0.0, -9.81, 0.0]))
    s = flexinv.solve(mechanism, TURNING, step=1e-4)
    controller = flexinv.Controller.of(mechanism, step=1e-4)
    controller.start(s.q[0], s.qd[0], s.qdd[0])
    account = controller.flexible.instant.account
    for k in range(1, 40):
        controller.step(*(np.ascontiguousarray(part[k]) for part in (s.q, s.qd, s.qdd)))
    state = controller.flexible
    _, _, masses, frames = state.parts
    own = state.instant
    held, potential, _ = compute_instant_energies(masses, frames, own.stored, own.driven, state.tau, s.qd[39].copy())
    assert held == pytest.approx((s.balance.kinetic + s.balance.elastic)[39], rel=1e-6)
    assert potential == pytest.approx(s.balance.potential[39], rel=1e-6)
    # torques ring at the step's own frequency: the sum over steps knows the work to some per cent
    at_start, weight, power, work, *_ = account
    assert work == pytest.approx(held + potential - at_start - weight, rel=0.1)
    assert add_step(account, held + 1e4, potential, power)
    with pytest.raises(flexinv.ConvergenceError, match=r"at call 40 after start .* were put in.*write step = 2.5e-05"):
        controller.flexible._judge(held + 1e4, potential, s.qd[39])
