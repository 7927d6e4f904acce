"""The loops over lanes are SIMD code: what a change of a line, or of the compiler, can silently undo (five times slower)."""

from __future__ import annotations

import platform
import re
from typing import Any

import pytest
from numba import types

from flexinv.rnea import loop_allocation, loop_bodies, loop_space, recursion

ROWS = types.Array(types.float64, 1, "C")
LANES = types.uint64
SIGNS = types.UniTuple(types.float64, 4)
# kernel -> its arguments
LOOPS: dict[str, tuple[Any, ...]] = {
    "_compute_angles": (ROWS, types.uint64),
    "_turn_outboard": (ROWS, ROWS, types.uint64, ROWS),
    "_turn_inboard": (ROWS, types.uint64, ROWS),
    "_turn_on_inboard": (ROWS, ROWS, types.uint64, ROWS),
    "_compute_slide_outboard": (ROWS, ROWS, types.uint64, ROWS),
    "_compute_float_outboard": (ROWS, ROWS, types.uint64, ROWS),
    "_compute_float_inboard": (ROWS, types.uint64),
    "_add_wrench_to_parent": (ROWS, ROWS, types.uint64, ROWS),
}
CLOSED: dict[Any, tuple[Any, ...]] = {
    loop_bodies._turn: (ROWS, ROWS, ROWS, ROWS, LANES, ROWS),
    loop_bodies._fill_revolute: (ROWS, ROWS, ROWS, ROWS, LANES, ROWS),
    loop_bodies._fill_chain_revolute: (ROWS, ROWS, LANES, ROWS),
    loop_bodies._fill_universal: (ROWS, ROWS, ROWS, LANES, ROWS),
    loop_space.make_column_kernel(0): (ROWS, ROWS, ROWS, ROWS, ROWS, LANES, SIGNS),
    loop_space.make_column_kernel(3): (ROWS, ROWS, ROWS, ROWS, ROWS, LANES, SIGNS),
    loop_space._write_column_size: (ROWS, ROWS, ROWS, ROWS, ROWS, LANES, SIGNS, types.float64),
    loop_space.make_ground_kernel(0): (ROWS, ROWS, ROWS, ROWS, LANES, ROWS),
    loop_space.make_ground_kernel(2): (ROWS, ROWS, ROWS, ROWS, LANES, ROWS),
    loop_allocation.solve_six_forces: (ROWS, ROWS, ROWS, LANES, types.UniTuple(types.float64, 6)),
    loop_allocation.solve_row: (ROWS, ROWS, ROWS, ROWS, LANES, types.float64, types.float64),
}


def packed(assembly: str) -> float:
    """Part of the multiplications and additions of doubles that work on several lanes at once."""
    result = re.findall(r"^\s+v?f?n?m?(?:add|sub|mul)\w*?([ps])d\s", assembly, re.MULTILINE)
    return result.count("p") / max(1, len(result))


def across(assembly: str) -> list[str]:
    """Loads of whole vectors that do not begin with a multiple of their lanes, in rows that do."""
    result = re.findall(r"vmov[ua]pd\s+(-?\d*)\(%\w+,%\w+,8\), %([yz])mm", assembly)
    return [offset for offset, width in result if int(offset or 0) % (64 if width == "z" else 32)]


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="reads the assembly of x86")
@pytest.mark.parametrize("name", LOOPS)
def test_loops_over_lanes_are_vectorised(name: str) -> None:
    """Each loop stands there twice, for whole vectors and for the rest of the lanes: half of it, or more, is packed."""
    kernel = getattr(recursion, name)
    kernel.compile(LOOPS[name])
    # of these arguments: whoever compiled the whole pass in this process may have left a copy of the loop for others
    assert packed(kernel.inspect_asm(LOOPS[name])) > 0.45


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="reads the assembly of x86")
@pytest.mark.parametrize("kernel", CLOSED, ids=lambda kernel: f"{kernel.py_func.__module__}.{kernel.py_func.__name__}")
def test_loops_of_closures_are_vectorised(kernel: Any) -> None:
    """So are these; none begins with a single lane, after which all vectors would lie across lines of the cache."""
    kernel.compile(CLOSED[kernel])
    assembly = kernel.inspect_asm(CLOSED[kernel])
    assert packed(assembly) > 0.2  # the rest of the lanes stands there up to four times
    assert not across(assembly)
    assert not re.search(r"vmovup[ds]\s+%[xyz]mm\d+, .*\{%k\d\}", assembly)  # stores of some lanes of a vector


def test_vectors_across_lines_are_told_apart() -> None:
    assert across("\tvmovupd\t8(%rsi,%r14,8), %zmm5\n")
    assert not across("\tvmovupd\t1024(%rsi,%r14,8), %zmm5\n\tvmovsd\t8(%rsi,%r14,8), %xmm5\n")


def test_scalar_code_is_told_apart() -> None:
    assert packed("\tvfmadd231sd %xmm0, %xmm1, %xmm2\n\tvmulsd %xmm0, %xmm1, %xmm2\n") == 0.0
    assert packed("\tvfmadd231pd %zmm0, %zmm1, %zmm2\n\tvaddsd %xmm0, %xmm1, %xmm2\n") == 0.5
    assert packed("\tmulpd %xmm0, %xmm1\n") == 1.0
