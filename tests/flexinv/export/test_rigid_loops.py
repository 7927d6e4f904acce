"""The C library of closed loops and of springs between points gives the digits of Python, and refuses what Python judges."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from c_library import Block, assert_needs_nothing, needs_compiler
from rigid_trees import tree

import flexinv
from flexinv.errors import InputError
from flexinv.export.acting_sets import find_acting_set, list_acting_sets
from flexinv.export.export_c import ExportedLibrary, export_c
from flexinv.files.load_cases import load_cases
from flexinv.model.links import Body
from flexinv.model.mechanism import Attachment, Force, Inertia, Mechanism, Placement, Spring
from flexinv.rigid.torque_regressor import sample_states
from flexinv.typing import Array, Triple

pytestmark = needs_compiler
ROUNDING = 1e-12  # parameters: the loops' own sums, over the condition of their shares


def solved(model: str) -> tuple[Mechanism, Triple]:
    """A mechanism and some samples of its first case, all joints closed."""
    folder = Path("models") / model
    m = flexinv.load_mechanism(folder)
    case = next(iter(load_cases(folder, m).values()))
    s = flexinv.solve(m, case.motion, case.step, start=case.start)
    some = slice(3, None, max(1, len(s.time) // 7))
    return m, (s.q[some].copy(), s.qd[some].copy(), s.qdd[some].copy())


@pytest.fixture(scope="module")
def stewart() -> tuple[Mechanism, Triple]:
    return solved("stewart_platform")


@pytest.fixture(scope="module")
def made(stewart: tuple[Mechanism, Triple], tmp_path_factory: pytest.TempPathFactory) -> ExportedLibrary:
    m, motion = stewart
    return export_c(m, tmp_path_factory.mktemp("loops") / "library", start=motion[0][0])


def torques(block: Block, motion: Triple) -> Array:
    tau = np.zeros_like(motion[1])
    assert block.call("torques", len(tau), *motion, tau) == "OK"
    return tau


def test_torques_of_loops_have_the_digits_of_python(stewart: tuple[Mechanism, Triple], made: ExportedLibrary) -> None:
    """One sample alone as `sample` computes it: not one bit differs."""
    m, motion = stewart
    block = Block(made)
    function = flexinv.prepare(m, threads=1)
    for row in zip(*motion, strict=True):
        tau = np.zeros(m.nv)
        assert block.call("torque", *row, tau) == "OK"
        assert np.array_equal(tau, function.sample(*row, np.zeros(m.nv)))
    assert_needs_nothing(made)


def assert_has_wrenches(block: Block, m: Mechanism, row: Triple) -> None:
    """Wrenches at all joints, at one sample, are those of `nodal`."""
    assert block.call("place", *row) == "OK"
    wrench = np.zeros((len(m.joints), 6))
    for number, out in enumerate(wrench):
        assert block.call("joint_wrench", number, out) == "OK"
    expected = np.array(
        [one[0] for one in flexinv.prepare(m, threads=1).nodal(*(part[None] for part in row)).wrench.values()]
    )
    np.testing.assert_allclose(wrench, expected, rtol=0, atol=ROUNDING * np.abs(expected).max())


def test_parameters_of_loops_are_those_of_a_mechanism_that_has_them(
    stewart: tuple[Mechanism, Triple], made: ExportedLibrary
) -> None:
    """Payload, gravity and friction, where closures end in the world that gravity accelerates."""
    m, motion = stewart
    block = Block(made)
    load = Inertia(20.0, np.array([0.05, -0.02, 0.1]), np.diag([0.2, 0.3, 0.4]))
    link = next(k for k, one in enumerate(m.links) if one.name == m.closures[0].second.link)
    gravity = np.array([1.0, -2.0, -7.0])
    rate = int(np.flatnonzero(m.actuated)[0])
    tensor = np.array([0.2, 0.3, 0.4, 0.0, 0.0, 0.0])
    assert block.call("set_payload", link, load.mass, load.com, tensor) == "OK"
    assert block.call("set_gravity", gravity) == "OK"
    assert block.call("set_friction", rate, 3.0, 50.0) == "OK"
    driven = next(j.name for j in m.joints if m.v_slices[j.name].start == rate)
    joints = tuple(replace(j, friction=3.0, damping=50.0) if j.name == driven else j for j in m.joints)
    other = replace(m.with_body(m.links[link].name, Body("load", load)), gravity=gravity, joints=joints)
    expected = flexinv.joint_torques(other, *motion, threads=1)
    scale = np.abs(expected).max()
    assert np.abs(torques(block, motion) - expected).max() <= ROUNDING * scale
    assert_has_wrenches(block, other, tuple(part[2].copy() for part in motion))
    assert np.abs(torques(Block(made), motion) - expected).max() > 1e-2 * scale


def test_a_motion_that_opens_a_loop_is_refused(stewart: tuple[Mechanism, Triple], made: ExportedLibrary) -> None:
    """Positions, rates and accelerations; and the next call works."""
    m, motion = stewart
    block = Block(made)
    row = [part[2].copy() for part in motion]
    tau = np.full(m.nv, 7.0)
    moves = int(np.flatnonzero(~m.actuated)[0])
    place = m.q_slices[next(j.name for j in m.joints if m.v_slices[j.name].start == moves)].start
    for part, at in zip(range(3), (place, moves, moves), strict=True):
        wrong = [one.copy() for one in row]
        wrong[part][at] += 0.1
        assert block.call("torque", *wrong, tau) == "NOT_CLOSED"
    assert (tau == 7.0).all()
    assert block.call("torque", *row, tau) == "OK"


def test_parts_of_loops_are_shared_out(stewart: tuple[Mechanism, Triple], made: ExportedLibrary) -> None:
    """Gravity is the torque at rest."""
    m, motion = stewart
    q = motion[0][2].copy()
    gravity = np.zeros(m.nv)
    assert Block(made).call("gravity", q, gravity) == "OK"
    expected = flexinv.joint_torques(m, q, np.zeros(m.nv), np.zeros(m.nv))
    assert np.abs(gravity - expected).max() <= ROUNDING * np.abs(expected).max()
    assert (gravity[~m.actuated] == 0.0).all()


@pytest.mark.parametrize("model", ["four_bar", "andrews_squeezer", "five_bar_redundant"])
def test_loops_of_all_sorts_are_exported(model: str, tmp_path: Path) -> None:
    """In a plane, with a spring between points, with more drives than freedoms."""
    m, motion = solved(model)
    made = export_c(m, tmp_path / "library", start=motion[0][0])
    expected = flexinv.joint_torques(m, *motion, threads=1)
    assert np.array_equal(torques(Block(made), motion), expected)


def test_springs_and_forces_on_a_tree_have_a_part_of_their_own(tmp_path: Path) -> None:
    """tau = M qdd + coriolis + gravity + friction + springs + applied; a dead load and one that turns with its link."""
    plain = tree()
    names = [link.name for link in plain.links]
    place = Placement(np.array([0.1, -0.2, 0.3]))
    spring = Spring("s", Attachment("world", place), Attachment(names[-1], place), 40.0, rest=0.2, damping=3.0)
    between = Spring("t", Attachment(names[0]), Attachment(names[-1]), 15.0)
    pushes = [
        Force(f"f{k}", Attachment(names[k], place), np.arange(1.0, 7.0)[None], follower=bool(k)) for k in range(2)
    ]
    m = replace(plain, springs=(spring, between), forces=tuple(pushes))
    made = export_c(m, tmp_path / "library")
    block = Block(made)
    motion = sample_states(m, 9)
    expected = flexinv.joint_torques(m, *motion, threads=1)
    scale = np.abs(expected).max()
    assert np.array_equal(torques(block, motion), expected)
    q, qd, qdd = (part[4].copy() for part in motion)
    matrix = np.zeros((m.nv, m.nv))
    given = {"gravity": (q,), "coriolis": (q, qd), "friction": (qd,), "springs": (q,), "applied": (q, qd)}
    terms = {name: np.zeros(m.nv) for name in given}
    assert block.call("mass_matrix", q, matrix) == "OK"
    assert all(block.call(name, *arguments, terms[name]) == "OK" for name, arguments in given.items())
    assert np.abs(matrix @ qdd + sum(terms.values()) - expected[4]).max() <= ROUNDING * scale
    without = expected - flexinv.joint_torques(plain, *motion, threads=1)
    assert np.abs(terms["applied"] - without[4]).max() <= ROUNDING * scale
    assert_needs_nothing(made)


def test_closures_that_act_for_a_while_are_told_by_number(tmp_path: Path) -> None:
    """Each phase as the mechanism that has its closures alone: not one bit differs; parameters are of all of them."""
    folder = Path("models/two_arms")
    m = flexinv.load_mechanism(folder)
    case = next(iter(load_cases(folder, m).values()))
    s = flexinv.solve(m, case.motion, case.step, end=case.end, start=case.start)
    made = export_c(m, tmp_path / "library", start=s.q[0])
    block = Block(made)
    assert subprocess.run([made.folder / "lib" / "native" / "selftest"], check=False).returncode == 0
    sets = list_acting_sets(m)
    assert [one.name for one in sets] == ["lies", "left and right", "lies_again", "nothing"]
    tau = np.zeros(m.nv)
    for k in range(0, len(s.time), 10):
        row = s.q[k].copy(), s.qd[k].copy(), s.qdd[k].copy()
        phase = find_acting_set(m, float(s.time[k]))
        assert block.call("set_phase", phase) == "OK"
        assert block.call("torque", *row, tau) == "OK"
        assert np.array_equal(tau, flexinv.prepare(sets[phase].mechanism, threads=1).sample(*row, np.zeros(m.nv)))
        np.testing.assert_allclose(tau, s.torque_all[k], rtol=0, atol=ROUNDING * np.abs(s.torque_all).max())
        assert_has_wrenches(block, sets[phase].mechanism, row)
    held = len(s.time) // 2
    row = s.q[held].copy(), s.qd[held].copy(), s.qdd[held].copy()
    gravity = np.array([1.0, -7.0, 0.0])
    assert block.call("set_phase", 0) == "OK"
    assert block.call("torque", *row, tau) == "NOT_CLOSED"
    assert block.call("set_payload", 8, 2.0, np.zeros(3), np.zeros(6)) == "OK"
    assert block.call("set_gravity", gravity) == "OK"
    assert block.call("set_friction", 0, 3.0, 50.0) == "OK"
    assert block.call("set_phase", 1) == "OK"
    assert block.call("torque", *row, tau) == "OK"
    joints = (replace(m.joints[0], friction=3.0, damping=50.0), *m.joints[1:])
    load = Body("load", Inertia(2.0, np.zeros(3), np.zeros((3, 3))))
    other = replace(sets[1].mechanism.with_body(m.links[8].name, load), gravity=gravity, joints=joints)
    expected = flexinv.joint_torques(other, *row, threads=1)
    np.testing.assert_allclose(tau, expected, rtol=0, atol=ROUNDING * np.abs(expected).max())
    assert block.call("set_phase", len(sets)) == "BAD_VALUE"
    assert_needs_nothing(made)


def test_what_no_call_can_know_of_closures_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    """Frames that are captured as they lie, phases of beams, and phases under torques."""
    walker = flexinv.load_mechanism("models/walker")
    captures = replace(walker, closures=tuple(replace(one, capture=True) for one in walker.closures))
    with pytest.raises(InputError, match=r"'walker' has closures that capture frames as they lie .*call flexinv.solve"):
        export_c(captures, tmp_path / "out")
    said = r"has closures that act for a while .*call flexinv.solve from Python"
    with pytest.raises(InputError, match=said):
        export_c(flexinv.load_mechanism("models/two_arms_flexible"), tmp_path / "out", step=1e-3)
    with pytest.raises(InputError, match=r"has closures that act for a while .*call flexinv.simulate"):
        flexinv.export_fmu(walker, tmp_path / "walker.fmu", kind="forward", step=1e-3)
    assert not any(tmp_path.iterdir())


def test_a_motion_that_all_but_stands_still_is_closed(stewart: tuple[Mechanism, Triple], made: ExportedLibrary) -> None:
    """Rates and accelerations that are rounding of a controller at rest."""
    m, motion = stewart
    q = motion[0][2].copy()
    rounding = 1e-11 * np.random.default_rng(3).uniform(-1.0, 1.0, (2, m.nv))
    tau, still = np.zeros((2, m.nv))
    block = Block(made)
    assert block.call("torque", q, *rounding, tau) == "OK"
    assert block.call("gravity", q, still) == "OK"
    np.testing.assert_allclose(tau, still, rtol=0, atol=1e-9 * np.abs(still).max())


def test_a_force_is_changed_from_call_to_call(tmp_path: Path) -> None:
    """The torques of a mechanism that has the other force."""
    arm = flexinv.load_mechanism("models/rigid_3r")
    at = Attachment(arm.links[-1].name, Placement(np.array([0.2, 0.1, 0.0])))
    one, other = np.arange(1.0, 7.0)[None], -np.arange(2.0, 8.0)[None]
    pushed = replace(arm, forces=(Force("push", at, one, follower=True),))
    block = Block(export_c(pushed, tmp_path / "library"))
    motion = sample_states(arm, 4)
    for wrench in (one, other):
        assert block.call("set_force", 0, wrench[0].copy()) == "OK"
        expected = flexinv.joint_torques(
            replace(pushed, forces=(Force("push", at, wrench, follower=True),)), *motion, threads=1
        )
        assert np.array_equal(torques(block, motion), expected)
