"""How kernels are compiled: the decorators, so that every kernel of the project is compiled alike.

Kernels work on scalars, tuples of three floats (`vectors`) and arrays that Python allocated and keeps; they allocate
nothing themselves.  So arrays need no reference counting in there (`_nrt`): that alone makes the march twice as fast.
Division by zero gives infinity, which Newton's loop finds.  Wrappers are compiled only where somebody calls them.
"""

from __future__ import annotations

from typing import Any

from numba import njit

_SHORT: dict[str, Any] = {"error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True}
_NO_WRAPPER: dict[str, Any] = {"no_cpython_wrapper": True}

# For kernels that Python calls.
jit: Any = njit(cache=True, **_SHORT)
# For kernels that only other kernels call.
jit_inner: Any = njit(cache=True, **_SHORT, **_NO_WRAPPER)
# For kernels with a single caller, which takes in their text: no second copy of all that they call is compiled.
jit_inline: Any = njit(inline="always", **_SHORT)
