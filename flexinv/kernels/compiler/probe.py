"""A small kernel with all that private parts of Numba serve, and its number: a record at an address, and an inner kernel."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flexinv.kernels.compiler.code_cache import make_jit_decorator
from flexinv.kernels.compiler.record_types import prepare_record_class
from flexinv.kernels.compiler.shipped_code import collect_compiler_versions
from flexinv.kernels.compiler.source_stamps import PACKAGE, compute_source_stamp
from flexinv.typing import Array

PASSED = ".passed"  # ending of the file that says with which versions and sources the number was right


@prepare_record_class
class Rod(NamedTuple):
    """A rod: mass [kg] and places [m]."""

    mass: float
    place: Array


@prepare_record_class
class RodPair(NamedTuple):
    """Two rods and their distance [m]."""

    first: Rod
    second: Rod
    gap: float


TWO_RODS = RodPair(Rod(2.0, np.array([1.0, 2.0, 4.0])), Rod(3.0, np.array([0.5, 0.25, 8.0])), 0.125)
NUMBER = 2.0 * 7.0 + 0.125 * 3.0 * 8.75  # sum of the places times the masses: exact in binary


@make_jit_decorator(_nrt=False, no_cfunc_wrapper=True, no_cpython_wrapper=True)
def compute_moment(rod: Any) -> Any:
    """Return the moment of a rod [kg m]: its mass times the sum of its places."""
    total = 0.0
    for i in range(rod.place.shape[0]):
        total += rod.place[i]
    return rod.mass * total


@make_jit_decorator(cache=True, nogil=True, _nrt=False, no_cfunc_wrapper=True)
def compute_pair_moment(pair: Any) -> Any:
    """Return the moment of two rods [kg m], of the second times the gap."""
    return compute_moment(pair.first) + pair.gap * compute_moment(pair.second)


def find_wrong_number() -> str:
    """Return in words how the kernel's number is wrong, "" where it is right.

    That it was right is written beside its machine code, and is not tried again with the same versions and sources.
    """
    file = _find_passed_file()
    words = f"{collect_compiler_versions()} {compute_source_stamp(PACKAGE, 'kernels.compiler.probe')}"
    if file is not None and _read(file) == words:
        return ""
    number = compute_pair_moment(TWO_RODS)
    if number != NUMBER:
        return f"a kernel gives {number!r} in place of {NUMBER!r}"
    if file is not None:
        _write(file, words)
    return ""


def _find_passed_file() -> Path | None:
    """The file that says so, None where no machine code is kept."""
    kept = getattr(compute_pair_moment, "_cache", None)
    file = getattr(kept, "_cache_file", None)
    return None if file is None else Path(file._index_path).with_suffix(PASSED)


def _read(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8")
    except OSError:
        return ""


def _write(file: Path, words: str) -> None:
    """Write a file where that can be: without it the kernel is tried again."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(words, encoding="utf-8")
    except OSError:
        return
