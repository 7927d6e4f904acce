"""What an exported library refuses, and an export: steps that cannot be, a disk that is full, blocks that are none, names."""

from __future__ import annotations

import resource
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from c_library import Block, needs_compiler
from marched_library import STEP, stepped, swing

import flexinv
from flexinv.errors import InputError, ModelWarning
from flexinv.export.export_c import ExportedLibrary, export_c
from flexinv.model.mechanism import Mechanism

pytestmark = needs_compiler
SMALL = 60_000  # bytes: sources and the header have room, machine code has none
HOSTILE = 'a") \n]] */ ${ENV{HOME}} #'


@pytest.fixture(scope="module")
def bending() -> Mechanism:
    return flexinv.load_mechanism("models/flex_two_link")


@pytest.fixture(scope="module")
def made(bending: Mechanism, tmp_path_factory: pytest.TempPathFactory) -> ExportedLibrary:
    return export_c(bending, tmp_path_factory.mktemp("bending") / "library", step=STEP)


@pytest.mark.parametrize("step", [0.0, -1e-3, np.nan, np.inf, "fast"])
@pytest.mark.parametrize("kind", ["inverse", "forward", "library"])
def test_steps_that_cannot_be_are_refused(bending: Mechanism, step: object, kind: str, tmp_path: Path) -> None:
    export = export_c if kind == "library" else partial(flexinv.export_fmu, kind=kind)
    with pytest.raises(InputError, match=r"^step = "):
        export(bending, tmp_path / "out.fmu", step=step)
    assert not any(tmp_path.iterdir())


@pytest.mark.filterwarnings("ignore::flexinv.errors.ModelWarning")
def test_a_step_far_too_long_is_refused_with_one_that_serves(bending: Mechanism, tmp_path: Path) -> None:
    """A tenth of a period is warned of, with the same step; that step is taken without a word."""
    said = r"does not even stand still at this position for 20 steps of 1e\+06 s; write step = 0.006"
    with pytest.raises(InputError, match=said):
        export_c(bending, tmp_path / "out", step=1e6)
    assert not any(tmp_path.iterdir())
    with pytest.warns(ModelWarning, match=r"step = 0.05 s is too long for its links that bend, .*write step = 0.006"):
        export_c(bending, tmp_path / "long", step=0.05)


@pytest.mark.filterwarnings("error")
def test_the_step_that_is_advised_is_taken_without_a_word(bending: Mechanism, tmp_path: Path) -> None:
    assert export_c(bending, tmp_path / "short", step=0.006).files


@pytest.mark.parametrize(
    "words", [["export-c", "--out", "x"], ["export-ros", "--out", "x"], ["export-fmu", "--out", "x.fmu"]]
)
def test_a_disk_without_room_is_said_and_nothing_is_left(words: list[str], tmp_path: Path, root: Path) -> None:
    """No file may grow beyond some bytes, which the system says at the file as a full disk does."""

    def leave_no_room() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (SMALL, SMALL))

    code = "import sys; from flexinv.cli.commands import main; main(sys.argv[1:])"
    given = [sys.executable, "-c", code, words[0], str(root / "models" / "rigid_3r"), *words[1:]]
    done = subprocess.run(given, cwd=tmp_path, capture_output=True, text=True, check=False, preexec_fn=leave_no_room)
    assert done.returncode != 0
    assert "nothing of" in done.stderr, done.stderr
    assert "make room" in done.stderr
    assert "Traceback" not in done.stderr
    assert not any(tmp_path.iterdir())


def test_memory_that_is_no_block_of_an_arm_is_refused(bending: Mechanism, made: ExportedLibrary) -> None:
    """Steps before the start, too; and a block that starts twice begins anew, without what it was given."""
    row = swing(bending, bending.neutral)[0]
    tau = np.zeros(2)
    block = Block(made, begin=False)
    for name, arguments in (("step", (*row, tau)), ("last_torque", (tau,)), ("set_gravity", (np.zeros(3),))):
        assert block.call(name, *arguments) == "NOT_STARTED"
    assert block.start(address=0) == "NULL"
    assert block.start(address=block.address + 8) == "NOT_ALIGNED"
    assert block.start(size=block.size - 1) == "TOO_SMALL"
    assert block.start(layout=99) == "WRONG_LAYOUT"
    assert block.call("step", *row, tau) == "NOT_STARTED"
    assert block.start() == "OK"
    rows = swing(bending, bending.neutral)
    first = stepped(block, rows)
    assert block.call("set_friction", 0, 3.0, 2.0) == "OK"
    assert block.start() == "OK"
    assert np.array_equal(stepped(block, rows), first)
    moved = Block(made, begin=False)
    where, to = (one.address - one.room.ctypes.data for one in (block, moved))
    moved.room[to : to + block.size] = block.room[where : where + block.size]
    assert moved.call("step", *row, tau) == "MOVED"


@pytest.mark.parametrize("part", ["links", "joints"])
def test_names_that_are_one_in_c_are_refused(part: str, tmp_path: Path) -> None:
    arm = flexinv.load_mechanism("models/rigid_3r")
    first, second = arm.links[0].name, arm.links[1].name
    names = {first: "a b", second: "a-b"}
    if part == "links":
        links = tuple(replace(one, name=names.get(one.name, one.name)) for one in arm.links)
        ends = [(names.get(j.parent, j.parent), names.get(j.child, j.child)) for j in arm.joints]
        joints = tuple(replace(j, parent=p, child=c) for j, (p, c) in zip(arm.joints, ends, strict=True))
        twice = replace(arm, links=links, joints=joints)
    else:
        two = replace(arm.joints[0], name="a b"), replace(arm.joints[1], name="a-b")
        twice = replace(arm, joints=(*two, *arm.joints[2:]))
    for export, out in ((export_c, "c"), (flexinv.export_fmu, "x.fmu"), (flexinv.export_ros, "ros")):
        with pytest.raises(InputError, match=r"'a b' and 'a-b' both become A_B in C; rename"):
            export(twice, tmp_path / out)
    assert not any(tmp_path.iterdir())


@pytest.mark.skipif(shutil.which("cmake") is None, reason="there is no cmake")
def test_cmake_builds_with_the_package_of_a_mechanism_of_any_name(tmp_path: Path) -> None:
    """Names that end strings, comments, brackets and lists of CMake stay names."""
    arm = flexinv.load_mechanism("models/rigid_3r")
    joints = (replace(arm.joints[0], name=HOSTILE), *arm.joints[1:])
    library = export_c(replace(arm, name=HOSTILE, joints=joints), tmp_path / "library")
    name = library.name
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.13)\nproject(user C)\n"
        f"find_package({name} CONFIG REQUIRED PATHS library/lib/cmake)\n"
        f"add_executable(user library/example.c)\ntarget_link_libraries(user {name}::{name})\n"
    )
    for words in (["cmake", "-S", ".", "-B", "built"], ["cmake", "--build", "built"], ["built/user"]):
        done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
