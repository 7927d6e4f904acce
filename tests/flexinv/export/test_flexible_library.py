"""The C library of a mechanism with beams makes the steps of `Controller`, in the plane and in space."""

from __future__ import annotations

import platform
import subprocess
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from c_library import Block, assert_needs_nothing, needs_compiler
from hub_arm import hub_arm
from marched_library import STEP, controlled, stepped, swing
from reader_pages import ROOT, blocks

import flexinv
from flexinv.errors import InputError
from flexinv.export.export_c import ExportedLibrary, export_c
from flexinv.model.mechanism import Mechanism

pytestmark = needs_compiler
# Two ways to one equilibrium, to the last digits of positions: 1e-15 of them times the axial stiffness over the bending one, 1e6.
REST = 1e-9


@pytest.fixture(scope="module")
def in_plane() -> Mechanism:
    """Two beams that hang in their plane, so that a start in equilibrium is a bent one."""
    return replace(flexinv.load_mechanism("models/flex_two_link"), gravity=np.array([0.0, -9.81, 0.0]))


@pytest.fixture(scope="module")
def made_in_plane(in_plane: Mechanism, tmp_path_factory: pytest.TempPathFactory) -> ExportedLibrary:
    return export_c(in_plane, tmp_path_factory.mktemp("plane") / "library", step=STEP)


def test_steps_in_a_plane_have_the_digits_of_a_controller(in_plane: Mechanism, made_in_plane: ExportedLibrary) -> None:
    """The same machine code on the same numbers: not one bit differs."""
    rows = swing(in_plane, in_plane.neutral)
    assert np.array_equal(stepped(Block(made_in_plane), rows), controlled(in_plane, in_plane.neutral, rows))


def test_steps_in_space_have_the_digits_of_a_controller(tmp_path: Path) -> None:
    """From another place than the neutral one; and from a place that the library was not made for, in equilibrium."""
    arm = flexinv.load_mechanism("models/spatial_arm")
    start = np.full(arm.nq, 0.2)
    made = export_c(arm, tmp_path / "library", step=STEP, start=start)
    block = Block(made)
    begins = np.zeros(arm.nq)
    assert block.call_alone("start_position", begins) == "OK"
    assert np.array_equal(begins, start)
    rows = swing(arm, start)
    assert np.array_equal(stepped(block, rows), controlled(arm, start, rows))
    other = np.linspace(-0.5, 0.7, arm.nq)
    assert block.start_at(other) == "OK"
    rows = swing(arm, other)
    expected = controlled(arm, other, rows)
    np.testing.assert_allclose(stepped(block, rows), expected, rtol=0, atol=REST * np.ptp(expected))
    assert_needs_nothing(made)


@pytest.mark.skipif(platform.machine() != "x86_64", reason="this is another processor than x86-64")
def test_steps_have_the_same_digits_without_fused_products(in_plane: Mechanism, tmp_path: Path) -> None:
    """x86-64-v2 has none; sines whose last digits differed once changed the torques of stiff loops by 5e-9 of the largest."""
    made = export_c(in_plane, tmp_path / "library", ("native", "x86-64-v2"), step=STEP)
    rows = swing(in_plane, in_plane.neutral)
    native, plain = (stepped(Block(made, target=target), rows) for target in ("native", "x86-64-v2"))
    assert np.array_equal(native, plain)


def test_a_joint_that_could_sink_comes_along_to_where_it_rests(tmp_path: Path) -> None:
    """A drive turns a beam through a spring: one long step might pass its rest position by."""
    hub = hub_arm(2)
    block = Block(export_c(hub, tmp_path / "library", step=STEP))
    other = hub.neutral + 0.5 * hub.actuated
    assert block.start_at(other) == "OK"
    rows = swing(hub, other)
    expected = controlled(hub, other, rows)
    np.testing.assert_allclose(stepped(block, rows), expected, rtol=0, atol=REST * np.ptp(expected))


def test_a_block_begins_in_equilibrium_anywhere(in_plane: Mechanism, made_in_plane: ExportedLibrary) -> None:
    """Far from where the library was made for: the steps of a controller that starts there."""
    block = Block(made_in_plane, begin=False)
    start = np.array([0.7, -0.4])
    assert block.start_at(np.array([np.inf, 0.0])) == "NOT_FINITE"
    assert block.start_at(start) == "OK"
    rows = swing(in_plane, start)
    expected = controlled(in_plane, start, rows)
    np.testing.assert_allclose(stepped(block, rows), expected, rtol=0, atol=REST * np.ptp(expected))


def test_a_refused_step_leaves_the_arm_where_it_was(in_plane: Mechanism, made_in_plane: ExportedLibrary) -> None:
    """What is no number, a jump without a solution: the steps after them are as if they had not been."""
    rows = swing(in_plane, in_plane.neutral)
    expected = stepped(Block(made_in_plane), rows)
    block = Block(made_in_plane)
    first = stepped(block, rows[:20])
    q, qd, qdd = rows[20]
    tau = np.full(2, 7.0)
    assert block.call("step", q, np.array([np.nan, 0.0]), qdd, tau) == "NOT_FINITE"
    assert block.call("step", q, qd, None, tau) == "NULL"
    assert block.call("step", q + np.array([2.0, 0.0]), qd, qdd, tau) == "BENT_TOO_FAR"
    assert (tau == 7.0).all()
    both = np.concatenate([first, stepped(block, rows[20:])])
    # After a refusal the next step begins without the trend of those before, and converges to its tolerance from there.
    np.testing.assert_allclose(both, expected, rtol=0, atol=1e-9 * np.ptp(expected))


def test_energy_from_nowhere_ends_a_block_until_it_starts_again(made_in_plane: ExportedLibrary) -> None:
    block = Block(made_in_plane)
    still, tau = np.zeros(2), np.full(2, 7.0)
    assert block.call("step", still, still, still, tau) == "OK"
    kept = Block(made_in_plane, begin=False)
    assert block.copy(kept) == "OK"
    before = tau.copy()
    assert block.call("step", np.array([0.1, 0.0]), still, still, tau) == "ENERGY"
    assert np.array_equal(tau, before)
    assert block.call("step", still, still, still, tau) == "NOT_STARTED"
    assert kept.copy(block) == "OK"
    assert block.call("step", still, still, still, tau) == "OK"
    assert block.start() == "OK"


def test_a_copy_goes_on_by_itself(in_plane: Mechanism, made_in_plane: ExportedLibrary) -> None:
    """Restored, an arm repeats its steps; two threads with a block each give the digits of one."""
    rows = swing(in_plane, in_plane.neutral)
    block, kept = Block(made_in_plane), Block(made_in_plane, begin=False)
    stepped(block, rows[:10])
    assert block.copy(kept) == "OK"
    expected = stepped(block, rows[10:])
    assert kept.copy(block) == "OK"
    assert np.array_equal(stepped(block, rows[10:]), expected)
    fresh = [Block(made_in_plane, begin=False) for _ in range(2)]
    assert all(kept.copy(one) == "OK" for one in fresh)
    with ThreadPoolExecutor(2) as pool:
        runs = list(pool.map(stepped, fresh, [rows[10:]] * 2))
    assert all(np.array_equal(one, expected) for one in runs)


def test_the_self_test_and_the_programs_that_are_shown_run(made_in_plane: ExportedLibrary, tmp_path: Path) -> None:
    folder = made_in_plane.folder
    assert subprocess.run([folder / "lib" / "native" / "selftest"], capture_output=True).returncode == 0
    library = folder / "lib" / "native" / f"lib{made_in_plane.name}.a"
    shown = blocks((ROOT / "docs" / "howto" / "c-library.md").read_text(), "cpp")
    assert len(shown) == 3  # some cycles, a load and a copy (test_loaded_library), and a loop of 1 kHz
    del shown[1]
    pages = [tmp_path / f"page{k}.cpp" for k in range(len(shown))]
    for page, text in zip(pages, shown, strict=True):
        page.write_text(text)
    sources = [("cc", folder / "example.c"), ("c++", folder / "example.cpp"), *(("c++", page) for page in pages)]
    for compiler, source in sources:
        words = [compiler, "-Wall", "-Werror", f"-I{folder / 'include'}", source, library, "-lm"]
        subprocess.run(list(map(str, [*words, "-o", tmp_path / "example"])), check=True)
        done = subprocess.run([tmp_path / "example", "50"], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("50 cycles: done; the slowest step took ")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, r"is marched, and its motion carried on.*write step ="),
        ({"step": -1.0}, r"step = -1"),
        ({"step": STEP, "start": [0.0]}, r"start = \[0.0\]: expected finite numbers \(2,\)"),
    ],
)
def test_what_a_march_needs_is_asked_for(
    in_plane: Mechanism, options: dict[str, float], words: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=words):
        export_c(in_plane, tmp_path / "out", **options)  # type: ignore[arg-type]
    assert not (tmp_path / "out").exists()
