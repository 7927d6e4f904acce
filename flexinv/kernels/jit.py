"""Compilation of kernels: the decorators, so that every kernel of the project is compiled alike.

Kernels work on scalars, tuples of three floats (`vec3`) and arrays that Python allocated and keeps; they allocate
nothing themselves.  So arrays need no reference counting in there (`_nrt`): that alone makes the march twice as fast.
Division by zero gives infinity, which Newton's loop finds.  Machine code is made only of kernels of `jit`, with all that they
call linked in once (`compiler.kernel_compiler`); a kernel of `jit_inner` called from Python raises a TypeError: call it from a
kernel.

Machine code is kept on disk until a source of its family changes (`compiler.code_cache`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from numba.extending import register_jitable

from flexinv.kernels.compiler.choice import NUMBA

_Function = TypeVar("_Function", bound=Callable[..., object])

# For kernels that Python calls: other threads of Python run beside them.
jit = NUMBA.make_jit_decorator(cache=True, nogil=True, _nrt=False, no_cfunc_wrapper=True)
# For kernels that only other kernels call.  The machine's compiler decides whether it takes one into its callers.
jit_inner = NUMBA.make_jit_decorator(_nrt=False, no_cfunc_wrapper=True, no_cpython_wrapper=True)
# The same for vectors and matrices in registers, which every caller takes in: handing them over in memory would cost more.
jit_vector = NUMBA.make_jit_decorator(forceinline=True, _nrt=False, no_cfunc_wrapper=True, no_cpython_wrapper=True)
# The same as `jit` for loops over lanes, whose products and sums may fuse.
jit_blocks = NUMBA.make_jit_decorator(cache=True, nogil=True, _nrt=False, no_cfunc_wrapper=True, fastmath={"contract"})
jit_lanes = NUMBA.make_jit_decorator(_nrt=False, no_cfunc_wrapper=True, no_cpython_wrapper=True, fastmath={"contract"})

# The same for sums over many numbers side by side, whose order is free: vector instructions take several parts of a sum at once.
jit_sums = NUMBA.make_jit_decorator(
    _nrt=False, no_cfunc_wrapper=True, no_cpython_wrapper=True, fastmath={"contract", "reassoc"}
)


def jit_pass(function: _Function) -> _Function:
    """Return a kernel of `jit_lanes` [-] that is not taken into its callers because it has only one.

    With the passes over the bodies taken into one another one sample of a tree of forty bodies takes a fifth longer (Zen 5).
    """
    function.stays_apart = True  # type: ignore[attr-defined]
    kernel: _Function = jit_lanes(function)
    return kernel


# What every lane does, where it is too long for the machine's compiler to take it into the loop by itself.
jit_lane = NUMBA.make_jit_decorator(
    forceinline=True, _nrt=False, no_cfunc_wrapper=True, no_cpython_wrapper=True, fastmath={"contract"}
)


def jit_formula(function: _Function) -> _Function:
    """Return a formula [any unit] as it is, for Python and arrays; kernels that call it take in its text, with their options."""
    formula: _Function = register_jitable(inline="always")(function)
    return formula
