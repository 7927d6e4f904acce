"""The C library of beams with more about them: loops, springs and forces, loads that change, and what is read after a step."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bending_four_bar import bending
from c_library import Block, assert_needs_nothing, needs_compiler
from four_bar_example import START
from marched_library import STEP, controlled, stepped, swing
from reader_pages import ROOT, blocks

import flexinv
from flexinv.errors import InputError, ModelWarning
from flexinv.export.export_c import ExportedLibrary, export_c
from flexinv.model.links import Body
from flexinv.model.mechanism import Attachment, Force, Inertia, Mechanism, Placement, Spring, with_retardation
from flexinv.typing import Array

pytestmark = needs_compiler
# Two equilibria found in other ways, as in test_flexible_library; a payload of its own node beside one that is merged.
REST = 1e-9
MARCH = 1e-9
SETTLED = 1e-6  # of a torque: what is left of a vibration after some steps of which each takes most of it
WAY = 0.1  # [rad]: a loop's beam bends by less
STEPS = 30


@pytest.fixture(scope="module")
def in_plane() -> Mechanism:
    return replace(flexinv.load_mechanism("models/flex_two_link"), gravity=np.array([0.0, -9.81, 0.0]))


@pytest.fixture(scope="module")
def loaded(in_plane: Mechanism, tmp_path_factory: pytest.TempPathFactory) -> ExportedLibrary:
    """A library whose long steps damp all vibrations, so that it comes to rest with whatever it is given."""
    folder = tmp_path_factory.mktemp("loaded") / "library"
    with pytest.warns(ModelWarning, match=r"step = 0.05 s is too long for its links that bend, .*; write step = 0.006"):
        made = export_c(in_plane, folder, step=0.05, spectral_radius=0.0, payloads=("link2",))
    assert_needs_nothing(made)
    return made


def rested(block: Block, steps: int = 600) -> Array:
    still = np.zeros(2)
    tau = np.zeros(2)
    for _ in range(steps):
        assert block.call("step", still, still, still, tau) == "OK"
    return tau


def static_torques(mechanism: Mechanism) -> Array:
    controller = flexinv.Controller.of(mechanism, step=STEP)
    return controller.start(mechanism.neutral, *np.zeros((2, mechanism.nv)), initial="static").copy()


def test_steps_of_a_loop_have_the_digits_of_a_controller(tmp_path: Path) -> None:
    """A four-bar whose coupler bends, from where its loop closes."""
    bar = bending()
    guess = np.array([0.3, START["B"], START["D"]])
    made = export_c(bar, tmp_path / "library", step=STEP, start=guess)
    block = Block(made)
    begins = np.zeros(3)
    assert block.call_alone("start_position", begins) == "OK"
    rows = swing(bar, begins, WAY, STEPS)
    result = stepped(block, rows)
    assert np.array_equal(result, controlled(bar, guess, rows))
    assert (result[:, 1:] == 0.0).all()
    other = begins + np.array([0.4, 7.0, 7.0])  # joints without drives come along, whatever is given of them
    assert block.start_at(other) == "OK"
    rows = swing(bar, other, WAY, STEPS)
    expected = controlled(bar, begins + np.array([0.4, 0.0, 0.0]), rows)
    np.testing.assert_allclose(stepped(block, rows), expected, rtol=0, atol=REST * np.ptp(expected))
    assert block.start_at(other + 500.0) == "NO_SOLUTION"
    assert block.call("step", *rows[0], np.zeros(3)) == "NOT_STARTED"
    assert_needs_nothing(made)


def test_springs_and_forces_are_those_of_a_controller(tmp_path: Path) -> None:
    """A spring to the world, a dead load and one that follows; and a start elsewhere, in equilibrium with them."""
    arm = flexinv.load_mechanism("models/spatial_arm")
    tip = Attachment(arm.links[-1].name, station=1.0)
    spring = Spring("s", Attachment("world", Placement(np.array([1.0, 0.5, 0.3]))), tip, 5.0, damping=0.2)
    pushes = tuple(
        Force(f"f{k}", tip, np.array([[0.3, -0.2, 0.4, 0.0, 0.0, 0.01]]), follower=bool(k)) for k in range(2)
    )
    arm = replace(arm, springs=(spring,), forces=pushes)
    made = export_c(arm, tmp_path / "library", step=STEP)
    block = Block(made)
    rows = swing(arm, arm.neutral, WAY, STEPS)
    assert np.array_equal(stepped(block, rows), controlled(arm, arm.neutral, rows))
    other = np.full(arm.nq, 0.3)
    assert block.start_at(other) == "OK"
    rows = swing(arm, other, WAY, STEPS)
    expected = controlled(arm, other, rows)
    np.testing.assert_allclose(stepped(block, rows), expected, rtol=0, atol=REST * np.ptp(expected))
    assert_needs_nothing(made)


def test_a_payload_and_gravity_come_to_rest_as_in_a_mechanism_that_has_them(
    in_plane: Mechanism, loaded: ExportedLibrary
) -> None:
    """Put on suddenly, the arm swings, and settles where a mechanism with that load is at rest; taken off, where it was."""
    block = Block(loaded)
    bare = rested(block)
    load = Inertia(0.02, np.array([0.01, 0.02, 0.0]), np.diag([1e-5, 1e-5, 2e-5]))
    assert block.call("set_payload", 0, load.mass, load.com, np.array([1e-5, 1e-5, 2e-5, 0.0, 0.0, 0.0])) == "OK"
    heavy = static_torques(in_plane.with_body("link2", Body("load", load, 1.0)))
    assert np.abs(rested(block) - heavy).max() < SETTLED * np.abs(heavy).max()
    assert np.abs(heavy - bare).max() > 0.1 * np.abs(heavy).max()
    assert block.call("set_payload", 0, 0.0, np.zeros(3), np.zeros(6)) == "OK"
    assert np.abs(rested(block) - bare).max() < SETTLED * np.abs(bare).max()
    gravity = np.array([2.0, -5.0, 0.0])
    assert block.call("set_gravity", gravity) == "OK"
    tilted = static_torques(replace(in_plane, gravity=gravity))
    assert np.abs(rested(block) - tilted).max() < SETTLED * np.abs(tilted).max()


def test_friction_of_a_drive_is_in_its_torque(loaded: ExportedLibrary) -> None:
    """Of one drive alone, by its own rate; damping is felt as much as it says."""
    one = Block(loaded)
    other = Block(loaded)
    assert other.call("set_friction", 1, 0.3, 2.0) == "OK"
    tau = np.zeros((2, 2))
    moving = np.array([0.0, 0.01])
    for block, out in zip((one, other), tau, strict=True):
        assert block.call("step", 0.2 * moving, moving, np.zeros(2), out) == "OK"
    np.testing.assert_allclose(tau[1] - tau[0], [0.0, 0.3 + 2.0 * 0.01], rtol=0, atol=1e-12)


def test_parameters_that_cannot_be_leave_the_arm_as_it_was(in_plane: Mechanism, loaded: ExportedLibrary) -> None:
    block = Block(loaded)
    bare = rested(block)
    centre, inertia = np.zeros(3), np.zeros(6)
    off_axis = np.array([1e-3, 1e-3, 1e-3, 0.0, 0.0, 1e-4])
    refused = {
        "BAD_VALUE": [
            ("set_payload", 0, -1.0, centre, inertia), ("set_payload", 1, 1.0, centre, inertia),
            ("set_payload", 0, 0.0, centre, np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])),
            ("set_friction", 2, 0.0, 0.0), ("set_friction", 0, -1.0, 0.0),
        ],
        "OUT_OF_PLANE": [
            ("set_payload", 0, 1.0, np.array([0.0, 0.0, 0.1]), inertia), ("set_payload", 0, 1.0, centre, off_axis),
            ("set_gravity", np.array([0.0, -9.0, 1.0])),
        ],
        "NOT_FINITE": [("set_payload", 0, np.nan, centre, inertia), ("set_gravity", np.array([np.inf, 0.0, 0.0]))],
        "NULL": [("set_payload", 0, 1.0, None, inertia), ("set_gravity", None)],
    }  # fmt: skip
    for status, calls in refused.items():
        for name, *arguments in calls:
            assert block.call(name, *arguments) == status, (name, arguments)
    assert np.abs(rested(block, 1) - bare).max() < SETTLED * np.abs(bare).max()


def test_what_is_read_after_a_step_is_what_solve_finds(tmp_path: Path) -> None:
    """Poses, tips, wrenches of joints, deflection and resultants of a beam, at the end of a march in space."""
    arm = flexinv.load_mechanism("models/spatial_arm")
    motion = flexinv.Motion.point_to_point(arm.neutral, np.full(arm.nq, 0.3), 0.05, law="quintic")
    solution = flexinv.solve(arm, motion, step=STEP, initial="static")
    block = Block(export_c(arm, tmp_path / "library", step=STEP))
    for row in zip(solution.q[1:], solution.qd[1:], solution.qdd[1:], strict=True):
        assert block.call("step", *row, np.zeros(arm.nv)) == "OK"
    six, three, nine = np.zeros(6), np.zeros(3), np.zeros((3, 3))
    for k, joint in enumerate(arm.joints):
        assert block.call("joint_wrench", k, six) == "OK"
        expected = solution.wrench[joint.name]
        assert np.abs(six - expected[-1]).max() <= MARCH * np.abs(expected).max()
    for k, link in enumerate(arm.links):
        assert block.call("tip", k, three) == "OK"
        assert np.abs(three - solution.tip[link.name][-1]).max() <= MARCH
        assert block.call("pose", k, three, nine) == "OK"
        node = next(solution.mesh.joint_node[j.name] for j in arm.joints if j.child == link.name)
        assert np.abs(three - solution.nodes.x[-1, node]).max() <= MARCH
        assert np.abs(nine - solution.nodes.rotation[-1, node]).max() <= MARCH
    for k, link in enumerate(arm.beams):
        assert block.call("deflection", k, three) == "OK"
        assert np.abs(three - solution.deflection[link.name][-1]).max() <= MARCH
        expected = solution.internal[link.name]
        for section in range(expected.shape[1]):
            assert block.call("section_forces", k, section, six) == "OK"
            assert np.abs(six - expected[-1, section]).max() <= MARCH * np.abs(expected).max()
            strains = np.zeros(6)
            assert block.call("section_strains", k, section, strains) == "OK"
            law = solution.mesh.elements.stiffness.reshape(-1, 6)[section]
            assert np.abs(law * strains - six).max() <= MARCH * np.abs(expected).max()
        assert block.call("section_forces", k, expected.shape[1], six) == "BAD_VALUE"
    assert block.call("pose", len(arm.links), three, nine) == "BAD_VALUE"
    assert block.call("tip", 0, None) == "NULL"


def test_payloads_are_asked_for_by_names_of_links(in_plane: Mechanism, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"payloads: there is no link 'link3'; write payloads=\('link\d',\)"):
        export_c(in_plane, tmp_path / "out", step=STEP, payloads=("link3",))
    with pytest.raises(InputError, match=r"is rigid: any link takes a payload; leave out payloads"):
        export_c(flexinv.load_mechanism("models/rigid_3r"), tmp_path / "out", payloads=("link1",))
    assert not (tmp_path / "out").exists()


def test_a_force_that_depends_on_time_is_given_before_each_step(tmp_path: Path) -> None:
    """Steps are those of `solve`, in which the load grows; one that follows its link is given in the axes where it attacks."""
    arm = flexinv.load_mechanism("models/spatial_arm")
    turned = Placement(np.array([0.0, 0.1, 0.0]), np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    tip = Attachment(arm.links[-1].name, turned, station=1.0)
    time = np.array([0.0, 0.03, 0.06])
    grows = np.outer([0.0, 1.0, 3.0], [0.4, -0.3, 0.2, 0.01, 0.0, 0.02])
    arm = replace(arm, forces=tuple(Force(f"f{k}", tip, grows, time, follower=bool(k)) for k in range(2)))
    motion = flexinv.Motion.point_to_point(arm.neutral, np.full(arm.nq, 0.3), 0.06, law="quintic")
    solution = flexinv.solve(arm, motion, step=STEP, initial="static")
    block = Block(export_c(arm, tmp_path / "library", step=STEP))
    tau = np.zeros_like(solution.qd[1:])
    rows = zip(solution.time[1:], solution.q[1:], solution.qd[1:], solution.qdd[1:], tau, strict=True)
    for now, q, qd, qdd, out in rows:
        wrench = np.array([np.interp(now, time, column) for column in grows.T])
        assert all(block.call("set_force", k, wrench) == "OK" for k in range(2))
        assert block.call("step", q, qd, qdd, out) == "OK"
    expected = solution.torque_all[1:]
    assert np.abs(tau - expected).max() <= MARCH * np.abs(expected).max()
    assert block.call("set_force", 2, np.zeros(6)) == "BAD_VALUE"
    assert block.call("set_force", 0, np.full(6, np.nan)) == "NOT_FINITE"
    assert block.call("set_force", 0, None) == "NULL"


@pytest.mark.parametrize("model", ["flex_two_link", "spatial_arm"])
def test_damping_changes_while_it_marches(model: str, tmp_path: Path) -> None:
    """In the plane and in space: of all beams as a mechanism that is damped so, and of none as before."""
    bare = flexinv.load_mechanism(f"models/{model}")
    times = 3.0
    damped = [with_retardation(bare, factor * 1e-3) for factor in (1.0, times)]
    block = Block(export_c(damped[0], tmp_path / "library", step=STEP))
    rows = swing(damped[0], bare.neutral, 0.2 * WAY, 2 * STEPS)
    expected = [controlled(one, bare.neutral, rows) for one in damped]
    for factor, wanted in ((times, expected[1]), (1.0, expected[0])):
        assert block.start() == "OK"
        for beam in range(len(bare.beams)):
            assert block.call("set_damping", beam, factor) == "OK"
        result = stepped(block, rows)
        np.testing.assert_allclose(result, wanted, rtol=0, atol=MARCH * np.ptp(wanted))
    if model == "flex_two_link":  # what damping adds to stresses is no strain
        assert_strains_turn(block, damped[0], rows[-1][0])
    assert np.abs(expected[0] - expected[1]).max() > 1e-3 * np.ptp(expected[0])
    assert block.call("set_damping", len(bare.beams), 1.0) == "BAD_VALUE"
    assert block.call("set_damping", 0, -1.0) == "BAD_VALUE"
    assert block.call("set_damping", 0, np.nan) == "NOT_FINITE"


def test_strains_turn_a_beam_from_its_root_to_its_end(in_plane: Mechanism, loaded: ExportedLibrary) -> None:
    block = Block(loaded)
    rows = swing(in_plane, in_plane.neutral, 0.2 * WAY, STEPS)
    for now in rows:
        assert block.call("step", *now, np.zeros(2)) == "OK"
    assert_strains_turn(block, in_plane, rows[-1][0])
    count = block.number("section_count", 0)
    assert block.call("section_strains", 0, count, np.zeros(6)) == "BAD_VALUE"
    assert block.call("section_strains", 0, 0, None) == "NULL"


def assert_strains_turn(block: Block, arm: Mechanism, q: Array) -> None:
    """The sum of curvatures over the first beam is the turn between two joints, by Gauss's rule at its sections."""
    count = block.number("section_count", 0)
    curvature = np.zeros(count)
    for section in range(count):
        strains = np.zeros(6)
        assert block.call("section_strains", 0, section, strains) == "OK"
        curvature[section] = strains[np.abs(strains[4:]).argmax() + 4]
        out_of_plane = np.delete(strains, [0, 1, 5] if abs(strains[5]) > abs(strains[4]) else [0, 2, 4])
        assert np.abs(out_of_plane).max() < 1e-12
    link = arm.links[0]
    assert link.beam is not None
    weights = np.polynomial.legendre.leggauss(count // link.beam.elements)[1]
    turn = link.beam.length / link.beam.elements / 2 * float(np.tile(weights, link.beam.elements) @ curvature)
    rotations = np.zeros((2, 3, 3))
    for number, rotation in enumerate(rotations):
        assert block.call("pose", number, np.zeros(3), rotation) == "OK"
    angles = np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0])
    bent = angles[1] - angles[0] - q[1]
    assert abs(abs(turn) - abs(bent)) < 1e-9
    assert abs(turn) > 1e-3


@pytest.fixture(scope="module")
def carrying(in_plane: Mechanism, tmp_path_factory: pytest.TempPathFactory) -> ExportedLibrary:
    """A library with steps that resolve its vibrations."""
    return export_c(in_plane, tmp_path_factory.mktemp("carrying") / "library", step=STEP, payloads=("link2",))


LIGHT = 0.02  # [kg]
CHANGES = {
    "a load": ("set_payload", 0, LIGHT, np.zeros(3), np.zeros(6)),
    "no load": ("set_payload", 0, 0.0, np.zeros(3), np.zeros(6)),
    "gravity": ("set_gravity", np.array([0.0, -1.62, 0.0])),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
@pytest.mark.parametrize("after", [0, 3])
def test_a_jump_is_found_in_the_first_step_after_a_change_too(
    carrying: ExportedLibrary, change: tuple[str | int | float | Array, ...], after: int
) -> None:
    still, tau = np.zeros(2), np.zeros(2)
    block = Block(carrying)
    for _ in range(after):
        assert block.call("step", still, still, still, tau) == "OK"
    name, *given = change
    assert block.call(str(name), *given) == "OK"
    before = np.zeros(2)
    assert block.call("last_torque", before) == "OK"
    assert block.call("step", np.array([0.1, 0.0]), still, still, tau) == "ENERGY"
    assert np.array_equal(before, tau) or not after  # nothing is written, and the last torque was that of the last step


def test_changes_at_any_instant_of_a_motion_are_no_energy_from_nowhere(
    in_plane: Mechanism, carrying: ExportedLibrary
) -> None:
    """Loads and gravity come and go from step to step, in motion and at rest, and after a step that was refused."""
    block = Block(carrying)
    dice = np.random.default_rng(7)
    rows = swing(in_plane, in_plane.neutral, 0.4, 300)
    tau = np.zeros(2)
    for q, qd, qdd in [*rows, *[rows[-1]] * 100]:
        if dice.random() < 0.3:
            load = LIGHT * dice.random() * (dice.random() < 0.7)
            assert block.call("set_payload", 0, load, np.zeros(3), np.zeros(6)) == "OK"
        if dice.random() < 0.2:
            gravity = np.array([*dice.normal(0.0, 10.0, 2), 0.0]) * (dice.random() < 0.7)
            assert block.call("set_gravity", gravity) == "OK"
        if dice.random() < 0.2:
            assert block.call("step", q + np.array([2.0, 0.0]), qd, qdd, tau) == "BENT_TOO_FAR"
        assert block.call("step", q, qd, qdd, tau) == "OK"


def test_the_program_that_is_shown_for_loads_and_copies_runs(carrying: ExportedLibrary, tmp_path: Path) -> None:
    source, program = tmp_path / "page.cpp", tmp_path / "page"
    source.write_text(blocks((ROOT / "docs" / "howto" / "c-library.md").read_text(), "cpp")[1])
    library = carrying.folder / "lib" / "native" / f"lib{carrying.name}.a"
    words = ["c++", "-Wall", "-Werror", f"-I{carrying.folder / 'include'}", source, library, "-lm", "-o", program]
    subprocess.run(list(map(str, words)), check=True)
    done = subprocess.run([program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    refusal, torques = done.stdout.splitlines()
    assert refusal.startswith("energy comes from nowhere")
    assert torques.endswith(" N m")
