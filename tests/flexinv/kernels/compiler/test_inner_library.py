"""Kernels within kernels: linked once into what Python calls, compiled once for all numbers in the call, kept with it."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from flexinv.kernels.compiler.code_cache import make_jit_decorator, resolve_compiled
from flexinv.kernels.compiler.kernel_compiler import InnerLibrary, OuterLibrary
from flexinv.kernels.dense import solve_dense
from flexinv.kernels.jit import jit_inner, jit_lanes, jit_pass

MODULE = """
import numpy as np
from flexinv.kernels.jit import jit, jit_inner

@jit_inner
def deepest(values, k):
    return np.sum(values[k:])

@jit_inner
def between(values, k):
    return deepest(values, k) + deepest(values, 0)

@jit
def called(values):
    return between(values, 1) + between(values, values.size - 1)
"""
USER = """
import json
import numpy as np
import chain
print(json.dumps([chain.called(np.arange(4.0)), sum(chain.called.stats.cache_hits.values())]))
"""


@jit_inner
def squared(x: Any, power: int) -> Any:
    return x**2 if power == 2 else x


@jit_inner
def summed(x: Any) -> Any:
    return squared(x, 2) + squared(x, 1)


@make_jit_decorator(_nrt=False, no_cfunc_wrapper=True)  # not kept on disk: what is kept asks for no inner kernel
def doubled(x: Any) -> Any:
    return summed(x) + summed(x)


def test_what_only_kernels_call_is_text_and_what_python_calls_links_all_of_it() -> None:
    assert doubled(3.0) == 24.0
    (outer,) = (one.library for one in doubled.overloads.values())
    (inner,) = (one.library for one in summed.overloads.values())
    assert isinstance(outer, OuterLibrary)
    assert isinstance(inner, InnerLibrary)
    deep = [one for one in outer._linking_libraries if isinstance(one, InnerLibrary)]
    assert [one.name for one in deep] == ["summed", "squared"]  # each once, at any depth
    assert not inner._codegen._engine.is_symbol_defined(next(iter(summed.overloads.values())).fndesc.mangled_name)


@jit_pass
def stretched(rows: Any, lanes: Any) -> None:
    """Long enough that only a function with one caller would be taken in."""
    for k in range(lanes):
        x = rows[k]
        for _ in range(3):
            x = math.sin(x) + math.cos(x) * math.exp(-x) + math.atan(x) * math.tanh(x) + math.log1p(x * x)
            x = math.sqrt(1.0 + x * x) * math.erf(x) + math.cosh(0.1 * x) * math.asinh(x) - math.expm1(-x * x)
        rows[k] = x


@jit_lanes
def both_ends(rows: Any, lanes: Any) -> None:
    stretched(rows, lanes)


@make_jit_decorator(_nrt=False, no_cfunc_wrapper=True, fastmath={"contract"})
def changed(rows: Any) -> None:
    both_ends(rows, rows.size)


def test_a_pass_stays_a_function_of_its_own_in_whatever_calls_it() -> None:
    changed(np.arange(3.0))
    (outer,) = (one.library for one in changed.overloads.values())
    left = [f.name for f in outer._final_module.functions if not f.is_declaration]
    assert any("stretched" in name for name in left)
    assert not any("both_ends" in name for name in left)  # what has one caller is taken in


def test_a_number_in_a_call_is_no_other_kernel() -> None:
    assert doubled(3.0) == 24.0
    assert len(squared.overloads) == 1  # not one for 2 and one for 1


def test_the_next_process_reads_what_was_linked(tmp_path: Path) -> None:
    (tmp_path / "chain.py").write_text(MODULE)
    told = [
        json.loads(
            subprocess.run(
                [sys.executable, "-c", USER], cwd=tmp_path, capture_output=True, text=True, check=True
            ).stdout
        )
        for _ in range(2)
    ]
    assert told == [[21.0, 0], [21.0, 1]]


@make_jit_decorator(_nrt=False, no_cfunc_wrapper=True, fastmath={"contract"})
def over_lanes(x: Any) -> Any:
    return x + 1.0


def test_loops_over_lanes_may_take_the_widest_vectors() -> None:
    assert over_lanes(1.0) == 2.0
    wide, narrow = ("\n".join(one.inspect_llvm().values()) for one in (over_lanes, doubled))
    assert '"prefer-vector-width"="512"' in wide
    assert "prefer-vector-width" not in narrow  # what is short stays as the machine's compiler has it


def test_what_is_compiled_of_a_kernel_gives_what_the_kernel_gives() -> None:
    values = np.arange(6.0).reshape(2, 3)
    direct = resolve_compiled(solve_dense, np.eye(2, 3), 2, 3)
    for kernel in (solve_dense, direct):
        room = np.array([[2.0, 1.0, 3.0], [0.0, 4.0, 8.0]])
        kernel(room, 2, 3)
        np.testing.assert_array_equal(room[:, 2], [0.5, 2.0])
    assert resolve_compiled(len, values) is len  # with NUMBA_DISABLE_JIT kernels are functions
