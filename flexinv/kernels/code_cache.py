"""Machine code on disk: kept where that is possible, read where it can be, and never a reason to stop.

Numba ends the program where no folder can be written to, where the disk is full, and where a file holds what older sources or a
machine that lost its power have left.  All of that only costs the time of compiling once more.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from pickle import UnpicklingError
from typing import Any

from numba import njit
from numba.core.registry import CPUDispatcher

from flexinv.kernels.code_stamp import source_stamp

# What reading a file raises that names a class that has moved, or that ends in the middle.
UNREADABLE = AttributeError, ImportError, EOFError, UnpicklingError
FOLDER = Path(__file__).resolve().parents[1]  # of the package


def compiler(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return Numba's decorator with these options [-]; machine code is kept until a source of its family changes."""

    def decorate(function: Callable[..., Any]) -> Any:
        try:
            kernel = njit(error_model="numpy", **options)(function)
        except RuntimeError as error:
            if "cannot cache" not in str(error):
                raise
            _tell()
            return njit(error_model="numpy", **{**options, "cache": False})(function)
        if options.get("no_cpython_wrapper") and isinstance(kernel, CPUDispatcher):
            kernel.__class__ = InnerKernel
        if options.get("cache") and hasattr(kernel, "_cache"):  # with NUMBA_DISABLE_JIT it is the function itself
            _forgive(kernel._cache, source_stamp(FOLDER, function.__module__.removeprefix("flexinv.")))
        return kernel

    return decorate


class InnerKernel(CPUDispatcher):
    """A kernel without a wrapper for Python: other kernels call it; a call from Python is an error, not the process's end."""

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        """Refuse the call of Python and say how to call the kernel [-]."""
        raise TypeError(
            f"{self.py_func.__module__}.{self.py_func.__name__} is compiled for other kernels only, and Python cannot call it; "
            "call it from a function that is compiled with flexinv.kernels.jit.jit"
        )


def _tell() -> None:
    warnings.warn(
        f"flexinv's machine code cannot be kept: neither {FOLDER} nor a folder of the user can be written to, and every process "
        "compiles for half a minute; set NUMBA_CACHE_DIR to a folder that can",
        RuntimeWarning,
        stacklevel=2,  # the same place for all kernels: it is told once
    )


def _forgive(cache: Any, stamp: str) -> None:
    """Let a kernel's cache hold the stamp of its sources, and go without what can be neither read nor written."""
    file, save = cache._cache_file, cache.save_overload
    file._source_stamp = (file._source_stamp, stamp)
    file._load_index = forgiving(file._load_index, {})
    file.load = forgiving(file.load, None)

    def saved(*result: Any) -> None:
        with suppress(OSError):  # a disk that is full: the next process compiles again
            save(*result)

    cache.save_overload = saved


def forgiving(load: Callable[..., Any], nothing: Any) -> Callable[..., Any]:
    """Return ``load`` of kept machine code [-], which returns ``nothing`` where that cannot be read."""

    def loaded(*key: Any) -> Any:
        try:
            return load(*key)
        except UNREADABLE:
            return nothing

    return loaded
