"""The C library of a rigid tree of all kinds of joints gives the digits of Python, and its parts are parts of the torque."""

from __future__ import annotations

import os
import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from c_library import Block, assert_needs_nothing, needs_compiler
from rigid_trees import tree

import flexinv
from flexinv.errors import InputError
from flexinv.export.export_c import ExportedLibrary, export_c
from flexinv.export.rigid.rigid_plan import plan_rigid_library
from flexinv.model.links import Body
from flexinv.model.mechanism import Inertia, Mechanism
from flexinv.rnea.loop_plan import sample_configurations
from flexinv.typing import Array

pytestmark = needs_compiler
SAMPLES = 131  # one block and a part of another
# Sums of the same terms in another order: rounding of some hundred operations, relative to the largest effort.
ROUNDING = 1e-13
HOSTILE = 'arm */ #include "x" %d ??/\n\\ é ${name}'


@pytest.fixture(scope="module")
def mechanism() -> Mechanism:
    """Every kind of joint, with springs, friction, dampers and rotors, and names that nobody should give."""
    made = tree()
    joints = tuple(replace(j, stiffness=3.0) if j.kind in ("revolute", "prismatic") else j for j in made.joints)
    return replace(made, name=HOSTILE, joints=(replace(joints[0], name='int */ "'), *joints[1:]))


@pytest.fixture(scope="module")
def made(mechanism: Mechanism, tmp_path_factory: pytest.TempPathFactory) -> ExportedLibrary:
    return export_c(mechanism, tmp_path_factory.mktemp("rigid") / "library")


@pytest.fixture(scope="module")
def motion(mechanism: Mechanism) -> tuple[Array, Array, Array]:
    qd, qdd = np.random.default_rng(0).normal(size=(2, SAMPLES, mechanism.nv))
    return sample_configurations(mechanism, SAMPLES), qd, qdd


def torques(block: Block, motion: tuple[Array, Array, Array]) -> Array:
    tau = np.zeros_like(motion[1])
    assert block.call("torques", len(tau), *motion, tau) == "OK"
    return tau


def test_torques_have_the_digits_of_python(
    mechanism: Mechanism, made: ExportedLibrary, motion: tuple[Array, Array, Array]
) -> None:
    """The same machine code, in blocks that begin at the same samples: not one bit differs; one sample alone, neither."""
    block = Block(made)
    expected = flexinv.joint_torques(mechanism, *motion, threads=1)
    assert np.array_equal(torques(block, motion), expected)
    one = np.zeros(mechanism.nv)
    assert block.call("torque", *(part[7] for part in motion), one) == "OK"
    assert np.array_equal(one, flexinv.joint_torques(mechanism, *(part[7] for part in motion)))


def test_the_torque_is_the_sum_of_its_terms(
    mechanism: Mechanism, made: ExportedLibrary, motion: tuple[Array, Array, Array]
) -> None:
    """tau = M qdd + coriolis + gravity + friction + springs, and M is symmetric and positive."""
    block = Block(made)
    q, qd, qdd = (part[3].copy() for part in motion)
    matrix = np.zeros((mechanism.nv, mechanism.nv))
    terms = [np.zeros(mechanism.nv) for _ in range(4)]
    assert block.call("mass_matrix", q, matrix) == "OK"
    given = {"gravity": (q,), "coriolis": (q, qd), "friction": (qd,), "springs": (q,)}
    for (name, arguments), term in zip(given.items(), terms, strict=True):
        assert block.call(name, *arguments, term) == "OK"
        assert abs(term).max() > 0.0
    tau = flexinv.joint_torques(mechanism, q, qd, qdd)
    assert abs(matrix @ qdd + sum(terms) - tau).max() <= ROUNDING * abs(tau).max()
    assert abs(matrix - matrix.T).max() <= ROUNDING * abs(matrix).max()
    assert np.linalg.eigvalsh(matrix).min() > 0.0


def test_parameters_are_those_of_a_mechanism_that_has_them(
    mechanism: Mechanism, made: ExportedLibrary, motion: tuple[Array, Array, Array]
) -> None:
    """Payload, gravity and friction of the block give the torques of a mechanism with that body, gravity and joint."""
    block = Block(made)
    load = Inertia(2.5, np.array([0.1, -0.2, 0.3]), np.diag([0.02, 0.03, 0.04]) + 0.001 * (1 - np.eye(3)))
    rate = mechanism.v_slices["shoulder_joint"].start
    link = [one.name for one in mechanism.links].index("flange")  # fixed on another link's body
    tensor = load.tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    gravity = np.array([0.5, -1.0, -1.62])
    assert block.call("set_payload", link, 9.0, np.zeros(3), np.zeros(6)) == "OK"  # replaced by what comes
    assert block.call("set_payload", link, load.mass, load.com, tensor) == "OK"
    assert block.call("set_gravity", gravity) == "OK"
    assert block.call("set_friction", rate, 0.25, 1.5) == "OK"
    joints = (replace(j, friction=0.25, damping=1.5) if j.name == "shoulder_joint" else j for j in mechanism.joints)
    other = replace(mechanism.with_body("flange", Body("load", load)), gravity=gravity, joints=tuple(joints))
    expected = flexinv.joint_torques(other, *motion)
    assert abs(torques(block, motion) - expected).max() <= ROUNDING * abs(expected).max()
    assert abs(torques(Block(made), motion) - expected).max() > 0.1 * abs(expected).max()


def test_poses_and_wrenches_are_those_of_all_nodes(
    mechanism: Mechanism, made: ExportedLibrary, motion: tuple[Array, Array, Array]
) -> None:
    """Of a sample that was placed, with a payload and another gravity that the block was given."""
    block = Block(made)
    load = Inertia(2.5, np.array([0.1, -0.2, 0.3]), np.diag([0.02, 0.03, 0.04]))
    link = [one.name for one in mechanism.links].index("flange")
    gravity = np.array([0.5, -1.0, -1.62])
    assert block.call("set_payload", link, load.mass, load.com, np.array([0.02, 0.03, 0.04, 0.0, 0.0, 0.0])) == "OK"
    assert block.call("set_gravity", gravity) == "OK"
    q, qd, qdd = (part[5].copy() for part in motion)
    assert block.call("place", q, qd, qdd) == "OK"
    other = replace(mechanism.with_body("flange", Body("load", load)), gravity=gravity)
    expected = flexinv.prepare(other).nodal(q[None], qd[None], qdd[None])
    place, turn, wrench = np.zeros(3), np.zeros((3, 3)), np.zeros(6)
    largest = max(np.abs(one).max() for one in expected.wrench.values())
    for k, one in enumerate(mechanism.links):
        node = expected.node[one.name]
        assert block.call("pose", k, place, turn) == "OK"
        assert np.abs(place - expected.motion.x[0, node]).max() <= ROUNDING * np.abs(expected.motion.x).max()
        assert np.abs(turn - expected.motion.rotation[0, node]).max() <= ROUNDING
        tip = place + turn @ one.tip
        assert block.call("tip", k, place) == "OK"
        assert np.abs(place - tip).max() <= ROUNDING * np.abs(expected.motion.x).max()
    for k, joint in enumerate(mechanism.joints):
        assert block.call("joint_wrench", k, wrench) == "OK"
        assert np.abs(wrench - expected.wrench[joint.name][0]).max() <= ROUNDING * largest
    assert block.call("joint_wrench", len(mechanism.joints), wrench) == "BAD_VALUE"
    assert block.call("place", q, np.full(mechanism.nv, np.inf), qdd) == "NOT_FINITE"
    assert block.call("place", q, None, qdd) == "NULL"


def test_what_cannot_be_is_a_status_and_the_next_call_works(
    mechanism: Mechanism, made: ExportedLibrary, motion: tuple[Array, Array, Array]
) -> None:
    """Every refused call leaves torques and parameters as they were."""
    block = Block(made)
    q, qd, qdd = (part[0].copy() for part in motion)
    tau = np.full(mechanism.nv, 7.0)
    wild = qd.copy()
    wild[2] = np.nan
    huge = np.full(mechanism.nv, 1e200)
    no_turn = np.zeros(mechanism.nq)
    refused = {
        "NULL": [("torque", q, None, qdd, tau), ("gravity", None, tau), ("set_gravity", None)],
        "NOT_FINITE": [("torque", q, wild, qdd, tau), ("set_payload", 0, np.inf, np.zeros(3), np.zeros(6))],
        "OUT_OF_RANGE": [("torque", q, huge, qdd, tau), ("torque", no_turn, qd, qdd, tau)],
        "BAD_VALUE": [
            ("set_payload", 0, -1.0, np.zeros(3), np.zeros(6)),
            ("set_payload", 0, 1.0, np.zeros(3), np.array([1.0, 1.0, 3.0, 0.0, 0.0, 0.0])),
            ("set_payload", len(mechanism.links), 1.0, np.zeros(3), np.zeros(6)),
            ("set_friction", mechanism.nv, 0.0, 0.0),
            ("set_friction", 0, -0.1, 0.0),
        ],
    }
    for status, calls in refused.items():
        for name, *arguments in calls:
            assert block.call(name, *arguments) == status
    assert (tau == 7.0).all()
    assert block.call("torque", q, qd, qdd, tau) == "OK"
    assert np.array_equal(tau, flexinv.joint_torques(mechanism, q, qd, qdd))


def test_memory_that_does_not_suit_is_refused(made: ExportedLibrary, motion: tuple[Array, Array, Array]) -> None:
    block = Block(made, begin=False)
    one = [part[0].copy() for part in motion]
    assert block.call("torque", *one, one[1]) == "NOT_STARTED"
    assert block.start(address=0) == "NULL"
    assert block.start(address=block.address + 8) == "NOT_ALIGNED"
    assert block.start(size=block.size - 1) == "TOO_SMALL"
    assert block.start(layout=99) == "WRONG_LAYOUT"
    assert block.start() == "OK"
    moved = Block(made, begin=False)
    where, to = (one.address - one.room.ctypes.data for one in (block, moved))
    moved.room[to : to + block.size] = block.room[where : where + block.size]
    assert moved.call("torque", *one, one[1]) == "MOVED"
    assert block.copy(moved) == "OK"
    assert np.array_equal(torques(moved, motion), torques(block, motion))


def test_a_block_does_not_depend_on_where_python_has_its_arrays(mechanism: Mechanism) -> None:
    """What is exported again is the same, byte by byte: nothing of this process is in it."""
    one, other = (plan_rigid_library(mechanism, "any").image for _ in range(2))
    assert one.write_content() == other.write_content()
    assert one.relocations == other.relocations


def test_threads_with_blocks_of_their_own_do_not_disturb_each_other(
    made: ExportedLibrary, motion: tuple[Array, Array, Array]
) -> None:
    expected = torques(Block(made), motion)
    with ThreadPoolExecutor(2) as pool:
        runs = [pool.submit(lambda block: [torques(block, motion) for _ in range(50)], Block(made)) for _ in range(2)]
        assert all(np.array_equal(one, expected) for run in runs for one in run.result())


def test_the_objects_need_mathematics_and_moves_of_bytes_only(made: ExportedLibrary) -> None:
    """No Python, no memory, no file, no thread."""
    assert_needs_nothing(made)


def test_no_call_takes_memory(made: ExportedLibrary, tmp_path: Path) -> None:
    """A program whose malloc, calloc and realloc end it runs the example's calls; one that does take memory is found."""
    program = (
        (made.folder / "example.c").read_text().replace("int main(void)", "int run(void)").replace("printf", "say")
    )
    head = "#include <stdarg.h>\n#include <stdlib.h>\nstatic int say(const char *form, ...) { (void)form; return 0; }\n"
    head += "void *__wrap_malloc(size_t n) { (void)n; abort(); }\nvoid *__wrap_calloc(size_t n, size_t k)"
    head += " { (void)n; (void)k; abort(); }\nvoid *__wrap_realloc(void *p, size_t n) { (void)p; (void)n; abort(); }\n"
    program = program.replace("#include <stdio.h>", f"#include <stdio.h>\n{head}").replace("fsay", "fprintf")
    for takes, code in ((0, 0), (1, -6)):
        source = tmp_path / f"counting{takes}.c"
        source.write_text(program + f"int main(void) {{ return {takes} ? malloc(9) == NULL : run(); }}\n")
        wraps = [f"-Wl,--wrap={name}" for name in ("malloc", "calloc", "realloc")]
        library = made.folder / "lib" / "native" / f"lib{made.name}.a"
        words = ["cc", "-O0", f"-I{made.folder / 'include'}", source, library, "-lm", *wraps, "-o", tmp_path / "run"]
        subprocess.run(list(map(str, words)), check=True)
        assert subprocess.run([tmp_path / "run"]).returncode == code


def test_the_self_test_finds_a_digit_that_is_off(made: ExportedLibrary, tmp_path: Path) -> None:
    """It passes as written, and fails where one effort is another in the twelfth digit of the largest."""
    assert subprocess.run([made.folder / "lib" / "native" / "selftest"], capture_output=True).returncode == 0
    source = (made.folder / "src" / "selftest.c").read_text()
    head, _, rest = source.partition("TAU[] = {")
    numbers, _, tail = rest.partition("}")
    efforts = [float.fromhex(one) for one in numbers.split(", ")]
    efforts[4] += 1e-12 * max(map(abs, efforts))
    wrong = tmp_path / "selftest.c"
    wrong.write_text(f"{head}TAU[] = {{{', '.join(one.hex() for one in efforts)}}}{tail}")
    library = made.folder / "lib" / "native" / f"lib{made.name}.a"
    words = ["cc", f"-I{made.folder / 'include'}", wrong, library, "-lm", "-o", tmp_path / "selftest"]
    subprocess.run(list(map(str, words)), check=True)
    assert subprocess.run([tmp_path / "selftest"], capture_output=True).returncode == 1


def test_the_example_in_cpp_is_compiled_and_runs(made: ExportedLibrary, tmp_path: Path) -> None:
    library = made.folder / "lib" / "native" / f"lib{made.name}.a"
    words = [
        "c++",
        "-std=c++17",
        "-Wall",
        "-Werror",
        f"-I{made.folder / 'include'}",
        made.folder / "example.cpp",
        library,
    ]
    subprocess.run(list(map(str, [*words, "-lm", "-o", tmp_path / "example"])), check=True)
    assert subprocess.run([tmp_path / "example"], capture_output=True).returncode == 0


def test_names_that_are_one_in_c_are_refused_before_anything_is_written(tmp_path: Path) -> None:
    made = tree()
    joints = (*made.joints[:-2], replace(made.joints[-2], name="a b"), replace(made.joints[-1], name="a-b"))
    twice = replace(made, joints=tuple(replace(j, kind="revolute") if j.name[0] == "a" else j for j in joints))
    with pytest.raises(InputError, match=r"coordinates 'a b' and 'a-b' both become A_B in C; rename"):
        export_c(twice, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_without_a_compiler_objects_and_commands_are_there(
    mechanism: Mechanism, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Machine code of another processor is an object of that processor; the commands name the compiler that is needed."""
    monkeypatch.setattr("flexinv.export.export_c.find_compiler", lambda target: None)
    out = tmp_path / "out"
    made = export_c(mechanism, out, targets=("aarch64",))
    assert "LICENSE" in made.files
    assert all(line.startswith(("aarch64-linux-gnu-gcc ", "ar ")) for line in made.to_link)
    code = (out / "lib" / "aarch64" / f"{made.name}_kernels.o").read_bytes()
    assert code[:4] == b"\x7fELF"
    assert int.from_bytes(code[18:20], "little") == 183  # e_machine of the ELF format: AArch64
    with pytest.raises(InputError, match=r"has files in it already: write another folder, or overwrite=True"):
        export_c(mechanism, out)


def test_a_package_for_cmake_and_one_for_pkg_config_find_the_library(made: ExportedLibrary, tmp_path: Path) -> None:
    library = made.folder / "lib"
    assert f"lib/${{FLEXINV_TARGET}}/lib{made.name}.a" in (library / "cmake" / f"{made.name}Config.cmake").read_text()
    if shutil.which("pkg-config") is None:
        pytest.skip("there is no pkg-config")
    words = ["pkg-config", "--cflags", "--libs", made.name]
    place = {**os.environ, "PKG_CONFIG_PATH": str(library / "pkgconfig")}
    flags = subprocess.run(words, env=place, capture_output=True, text=True, check=True).stdout.split()
    subprocess.run(["cc", str(made.folder / "example.c"), *flags, "-o", str(tmp_path / "example")], check=True)


def test_targets_that_are_not_there_are_refused(mechanism: Mechanism, tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"targets = 'native': expected a list of names of processors; write \['native'\]"
    ):
        export_c(mechanism, tmp_path / "out", targets="native")
    with pytest.raises(InputError, match=r"target = 'x86-64-v5': expected one of .* write target='x86-64-v"):
        export_c(mechanism, tmp_path / "out", targets=("x86-64-v5",))
