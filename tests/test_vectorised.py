"""The loops over lanes are SIMD code: what a change of a line, or of the compiler, can silently undo (five times slower)."""

from __future__ import annotations

import platform
import re
from typing import Any

import pytest
from numba import types

from flexinv import recursion

ROWS = types.Array(types.float64, 1, "C")
# kernel -> its arguments
LOOPS: dict[str, tuple[Any, ...]] = {
    "_angles": (ROWS, types.uint64),
    "_turn_outboard": (ROWS, ROWS, types.uint64, ROWS),
    "_turn_inboard": (ROWS, types.uint64, ROWS),
    "_turn_on_inboard": (ROWS, ROWS, types.uint64, ROWS),
    "_slide_outboard": (ROWS, ROWS, types.uint64, ROWS),
    "_float_outboard": (ROWS, ROWS, types.uint64, ROWS),
    "_float_inboard": (ROWS, types.uint64),
    "_branch_inboard": (ROWS, ROWS, types.uint64, ROWS),
}


def packed(assembly: str) -> float:
    """Part of the multiplications and additions of doubles that work on several lanes at once."""
    found = re.findall(r"^\s+v?f?n?m?(?:add|sub|mul)\w*?([ps])d\s", assembly, re.MULTILINE)
    return found.count("p") / max(1, len(found))


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="reads the assembly of x86")
@pytest.mark.parametrize("name", LOOPS)
def test_loops_over_lanes_are_vectorised(name: str) -> None:
    """Each loop stands there twice, for whole vectors and for the rest of the lanes: half of it, or more, is packed."""
    kernel = getattr(recursion, name)
    kernel.compile(LOOPS[name])
    # of these arguments: whoever compiled the whole pass in this process may have left a copy of the loop for others
    assert packed(kernel.inspect_asm(LOOPS[name])) > 0.45


def test_scalar_code_is_told_apart() -> None:
    assert packed("\tvfmadd231sd %xmm0, %xmm1, %xmm2\n\tvmulsd %xmm0, %xmm1, %xmm2\n") == 0.0
    assert packed("\tvfmadd231pd %zmm0, %zmm1, %zmm2\n\tvaddsd %xmm0, %xmm1, %xmm2\n") == 0.5
    assert packed("\tmulpd %xmm0, %xmm1\n") == 1.0
