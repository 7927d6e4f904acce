"""Where Numba is not as our compiler expects it, kernels are plain Numba: said once, slower, with the same numbers."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from flexinv.kernels.compiler import choice, plain, probe

# Kernels with all that kernels of the package use: records from Python and from a stack, inner kernels, an array at an address.
MODULE = """
from typing import NamedTuple
from numpy import ndarray
from flexinv.kernels.jit import jit, jit_blocks, jit_inner, jit_vector
from flexinv.kernels.records import send_by_address, take_record
from flexinv.kernels.threads.atomics import make_float_array, read_address, take

@send_by_address
class Rod(NamedTuple):
    mass: float
    place: ndarray

@jit_vector
def scale(factor, x):
    return factor * x

@jit_inner
def weigh(rod):
    return scale(rod.mass, rod.place[0] + rod.place[1])

@jit
def weigh_of_stack(stack, number, counter):
    return weigh(take_record(stack, number)) + take(counter)

@jit_blocks
def add_at_address(x):
    total = 0.0
    for value in make_float_array(read_address(x), (3,)):
        total += value
    return total
"""
# Prints the numbers of these kernels, the module that compiles, and the warnings of flexinv.
PROGRAM = """
import json, sys, warnings
{before}
with warnings.catch_warnings(record=True) as said:
    warnings.simplefilter("always")
    import numpy as np
    import small_kernels as small
    from flexinv.kernels.compiler import choice
    from flexinv.kernels.records import join_records
stack = join_records([small.Rod(2.0, np.array([1.0, 0.5])), small.Rod(4.0, np.array([0.25, 8.0]))])
counter = np.array([7], dtype=np.uint64)
numbers = [small.weigh_of_stack(stack, k, counter) for k in range(2)] + [small.add_at_address(np.arange(1.0, 4.0))]
words = [str(one.message) for one in said if "compiler of kernels" in str(one.message)]
print(json.dumps([choice.NUMBA.__name__, numbers, words]))
"""
NUMBERS = [2.0 * 1.5 + 7.0, 4.0 * 8.25 + 8.0, 6.0]  # exact in binary
# As a Numba would be that calls its code library otherwise.
RENAMED = "import numba.core.codegen as private; del private.JITCodeLibrary"


def compute_numbers(root: Path, folder: Path, before: str, plain_numba: str) -> tuple[str, list[float], list[str]]:
    module_file = folder / "small_kernels.py"
    if not module_file.is_file():  # by whose time an older Numba judges what it has kept
        module_file.write_text(MODULE)
    search = os.pathsep.join([str(folder), str(root)])
    asked = {**os.environ, "NUMBA_CACHE_DIR": str(folder), "PYTHONPATH": search, choice.VARIABLE: plain_numba}
    command = [sys.executable, "-c", PROGRAM.format(before=before)]
    done = subprocess.run(command, env=asked, capture_output=True, text=True, timeout=600, cwd=folder)
    assert done.returncode == 0, done.stderr
    module, numbers, words = json.loads(done.stdout.splitlines()[-1])
    return module, numbers, words


def test_without_a_private_name_kernels_are_plain_and_give_the_same_numbers(root: Path, tmp_path: Path) -> None:
    """It is said once; what is kept serves the next process, which asks for plain kernels."""
    module, numbers, words = compute_numbers(root, tmp_path, RENAMED, "")
    assert (module, numbers) == ("flexinv.kernels.compiler.plain", NUMBERS)
    (line,) = words
    assert "JITCodeLibrary" in line
    assert line.endswith("; the numbers are the same")
    kept = {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*.nbc")}
    assert kept
    module, numbers, words = compute_numbers(root, tmp_path, "", "1")
    assert (module, numbers) == ("flexinv.kernels.compiler.plain", NUMBERS)
    assert words == []  # who asks for it need not be told
    assert {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*.nbc")} == kept


def test_with_the_names_the_same_kernels_are_compiled_by_our_own(root: Path, tmp_path: Path) -> None:
    assert compute_numbers(root, tmp_path, "", "0") == ("flexinv.kernels.compiler.own", NUMBERS, [])


def test_here_the_compiler_is_our_own() -> None:
    assert choice.find_trouble() == ""
    assert not choice.is_plain()


def test_a_wrong_number_of_the_probe_is_trouble(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(probe, "_find_passed_file", lambda: None)
    assert choice.find_trouble() == ""
    monkeypatch.setattr(probe, "NUMBER", 17.5)
    assert choice.find_trouble() == "a kernel gives 17.28125 in place of 17.5"
    with pytest.warns(RuntimeWarning, match="does not fit Numba .* in place of 17.5"):
        assert choice.choose_compiler() is plain


def test_the_probe_is_tried_once_for_each_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    passed = tmp_path / "probe.passed"
    calls: list[object] = []
    monkeypatch.setattr(probe, "_find_passed_file", lambda: passed)
    monkeypatch.setattr(probe, "compute_pair_moment", lambda pair: calls.append(pair) or probe.NUMBER)
    assert [probe.find_wrong_number() for _ in range(3)] == ["", "", ""]
    assert len(calls) == 1
    monkeypatch.setattr(probe, "collect_compiler_versions", lambda: {"numba": "another"})
    assert probe.find_wrong_number() == ""
    assert len(calls) == 2


def test_machine_code_of_plain_kernels_lies_apart_for_each_state_of_the_sources(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    first = plain.find_folder()
    monkeypatch.setattr(plain, "compute_source_stamp", lambda folder, module: "f" * 64)
    second = plain.find_folder()
    assert first is not None
    assert second == tmp_path / f"plain-{'f' * 16}"
    assert first != second
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file"))
    assert plain.find_folder() is None  # then nothing is kept
