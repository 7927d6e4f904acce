"""Machine code on disk: kept where that is possible, read where it can be, and never a reason to stop.

Numba ends the program where no folder can be written to, where the disk is full, and where a file holds what older sources or a
machine that lost its power have left.  All of that only costs the time of compiling once more.  Code is looked for in what the
package brings along (`shipped_code`), then in what was kept on this machine; one process compiles what is in neither
(`compile_lock`), and others wait for it.

Code bears the stamp of the sources that are in it (`source_stamps`), and is discarded when any of them changes.
"""

from __future__ import annotations

import gc
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from pickle import UnpicklingError
from typing import Any

from numba import njit, types
from numba.core.registry import CPUDispatcher, cpu_target
from numba.core.runtime.nrt import rtsys

from flexinv.kernels.compiler.compile_lock import CompileLock
from flexinv.kernels.compiler.kernel_compiler import InnerCompiler, OuterCompiler
from flexinv.kernels.compiler.record_types import resolve_argument_type
from flexinv.kernels.compiler.shipped_code import find_shipped_code
from flexinv.kernels.compiler.source_stamps import PACKAGE, compute_source_stamp

# What reading a file raises that names a class that has moved, or that ends in the middle.
UNREADABLE = AttributeError, ImportError, EOFError, UnpicklingError
# The kernels that Python calls, in the order of their definition.
KERNELS: list[Any] = []


def make_jit_decorator(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return Numba's decorator with these options [-]; machine code is kept until a source of its family changes."""
    inner = bool(options.get("no_cpython_wrapper"))
    # Loops over lanes are optimised one by one before they are linked: that they become vectors is tested of each.
    text = inner and "fastmath" not in options
    options = {"error_model": "numpy", "pipeline_class": InnerCompiler if text else OuterCompiler, **options}

    def make_kernel(function: Callable[..., Any]) -> Any:
        kernel: Any
        try:
            kernel = njit(**options)(function)
        except RuntimeError as error:
            if "cannot cache" not in str(error):
                raise
            _warn_unwritable()
            kernel = njit(**{**options, "cache": False})(function)
        if not hasattr(kernel, "_cache"):  # with NUMBA_DISABLE_JIT it is the function itself
            return kernel
        kernel.__class__ = InnerKernel if inner else Kernel
        if hasattr(kernel._cache, "_cache_file"):
            _prepare_cache(kernel)
        return kernel

    return make_kernel


def resolve_compiled(kernel: Any, *arguments: Any) -> Callable[..., Any]:
    """Return the compiled function of a kernel [-] for arguments of just these types, for callers with always the same arrays.

    A kernel looks at the types of all its arguments, at those of the ninety arrays of a record for a hundredth of a millisecond;
    this looks at none of them, and arguments of other types end the interpreter: never hand it what a user gave.
    """
    if not hasattr(kernel, "overloads"):  # with NUMBA_DISABLE_JIT it is the function itself
        return kernel  # type: ignore[no-any-return]
    kinds = tuple(kernel.typeof_pyval(one) for one in arguments)
    kernel.compile(kinds)
    return kernel.overloads[kinds].entry_point  # type: ignore[no-any-return]


def begin_runtime() -> None:
    """Start what kernels take the memory of arrays from [-], which the first of them does otherwise (a twentieth of a second)."""
    rtsys.initialize(cpu_target.target_context)


class Kernel(CPUDispatcher):
    """A kernel of which one process compiles what others wait for."""

    lock: CompileLock | None = None

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return the template of a call by the types [-] of its arguments, not by the numbers in it; records by address."""
        by_name = {name: resolve_argument_type(types.unliteral(one)) for name, one in kws.items()}
        return super().get_call_template(tuple(resolve_argument_type(types.unliteral(one)) for one in args), by_name)

    def compile(self, signature: Any) -> Any:
        """Compile for arguments of these types [-], or take what is kept."""
        collects = gc.isenabled()
        gc.disable()  # a sixth of the time would go into looking at the compiler's objects, none of which is garbage yet
        try:
            return super().compile(signature)
        finally:
            if collects:
                gc.enable()
            if self.lock is not None:
                self.lock.drop_lock()


class InnerKernel(Kernel):
    """A kernel without a wrapper for Python: other kernels call it; a call from Python is an error, not the process's end."""

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        """Refuse the call of Python and say how to call the kernel [-]."""
        raise TypeError(
            f"{self.py_func.__module__}.{self.py_func.__name__} is compiled for other kernels only, and Python cannot call it; "
            "call it from a function that is compiled with flexinv.kernels.jit.jit"
        )


def _warn_unwritable() -> None:
    warnings.warn(
        f"flexinv's machine code cannot be kept: neither {PACKAGE} nor a folder of the user can be written to, and every process "
        "compiles for half a minute; set NUMBA_CACHE_DIR to a folder that can",
        RuntimeWarning,
        stacklevel=2,  # the same place for all kernels: it is told once
    )


def _prepare_cache(kernel: Any) -> None:
    """Let a kernel hold the stamp of its sources, wait for others, and go without what cannot be read or written."""
    kept = kernel._cache
    module = kernel.py_func.__module__
    file = kept._cache_file
    save = kept.save_overload
    stamp = compute_source_stamp(PACKAGE, module.removeprefix("flexinv."))
    file._source_stamp = (file._source_stamp, stamp)
    file._load_index = make_forgiving(file._load_index, {})
    file.load = make_forgiving(file.load, None)
    lock = CompileLock(Path(file._index_path).with_suffix(".lock"))
    kernel.lock = lock
    KERNELS.append(kernel)

    def read_overload(signature: Any, target: Any) -> Any:
        with kept._guard_against_spurious_io_errors():
            return kept._load_overload(signature, target)

    def read_or_take_shipped(signature: Any, target: Any) -> Any:
        # Machine code needs the memory for arrays and no more: Numba's own load reads all tables of its compiler (half a second).
        rtsys.initialize(target)
        brought = find_shipped_code(module, kernel.py_func.__qualname__, str(signature), stamp)
        if brought is not None:
            return kept._impl.rebuild(target, brought)
        overload = read_overload(signature, target)
        if overload is None:
            lock.take()
            overload = read_overload(signature, target)  # what others have compiled meanwhile
        return overload

    def write_overload(*result: Any) -> None:
        with suppress(OSError):  # a disk that is full: the next process compiles again
            save(*result)

    kept.load_overload = read_or_take_shipped
    kept.save_overload = write_overload


def make_forgiving(load: Callable[..., Any], nothing: Any) -> Callable[..., Any]:
    """Return ``load`` of kept machine code [-], which returns ``nothing`` where that cannot be read."""

    def read_or_skip(*key: Any) -> Any:
        try:
            return load(*key)
        except UNREADABLE:
            return nothing

    return read_or_skip
