"""How kernels are compiled: the decorators, so that every kernel of the project is compiled alike.

Kernels work on scalars, tuples of three floats (`vectors`) and arrays that Python allocated and keeps; they allocate
nothing themselves.  So arrays need no reference counting in there (`_nrt`): that alone makes the march twice as fast.
Division by zero gives infinity, which Newton's loop finds.  Wrappers for Python are compiled only for `jit`, a third of
the time of compiling otherwise; a kernel of `jit_inner` called from Python ends the process: call it from a kernel.

Machine code is kept on disk.  Numba asks only whether the file of the function itself is the same, but the code holds
that of all functions it calls: here it is thrown away when any of `SOURCES` changes.
"""

from __future__ import annotations

from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any

from numba import njit

# The modules whose text or constants are in the machine code.
SOURCES = (
    "assemble", "beam", "compiled", "eliminate", "integrate", "march", "rotations", "system", "ties", "tree",
    "vectors",
)  # fmt: skip


def source_stamp(folder: Path) -> str:
    """Return a digest [-] of the sources of all kernels in ``folder``."""
    digest = sha256()
    for name in SOURCES:
        digest.update((folder / f"{name}.py").read_bytes())
    return digest.hexdigest()


_STAMP = source_stamp(Path(__file__).parent)


def _compiler(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    def decorate(function: Callable[..., Any]) -> Any:
        kernel = njit(error_model="numpy", **options)(function)
        if options.get("cache") and hasattr(kernel, "_cache"):  # with NUMBA_DISABLE_JIT it is the function itself
            file = kernel._cache._cache_file
            file._source_stamp = (file._source_stamp, _STAMP)
        return kernel

    return decorate


# For kernels that Python calls: other threads of Python run beside them.
jit = _compiler(cache=True, nogil=True, _nrt=False, no_cfunc_wrapper=True)
# For kernels that only other kernels call.
jit_inner = _compiler(cache=True, _nrt=False, no_cfunc_wrapper=True, no_cpython_wrapper=True)
# For kernels with a single caller, which takes in their text: no second copy of all that they call is compiled.
jit_inline = _compiler(_nrt=False, inline="always")
