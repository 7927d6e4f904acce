"""The choice how kernels are compiled: by a compiler of our own where Numba is as that expects it, else by plain Numba."""

from __future__ import annotations

import importlib
import os
import warnings
from types import ModuleType
from typing import Any

import numba

from flexinv.kernels.compiler import plain

VARIABLE = "FLEXINV_PLAIN_NUMBA"
PROBE = "flexinv.kernels.compiler.probe"
OWN = "flexinv.kernels.compiler.own"
HELP = "kernels are compiled without it, which takes some minutes once, and run slower; the numbers are the same"


def find_trouble() -> str:
    """Return in words the fault that keeps the compiler of our own from compiling kernels, "" without one."""
    try:
        importlib.import_module(OWN)  # are all names there?
        return str(importlib.import_module(PROBE).find_wrong_number())
    except Exception as error:  # whatever a Numba with other private parts raises
        return f"{type(error).__name__}: {error}"


def choose_compiler() -> ModuleType:
    """Return the module that compiles kernels [-], `own` or `plain`; say once why where it is not the first."""
    if os.environ.get(VARIABLE, "0") not in ("", "0"):
        return plain
    trouble = find_trouble()
    if not trouble:
        return importlib.import_module(OWN)
    words = f"flexinv's compiler of kernels does not fit Numba {numba.__version__} ({trouble}): {HELP}"
    warnings.warn(words, RuntimeWarning, stacklevel=2)
    return plain


NUMBA: Any = choose_compiler()


def is_plain() -> bool:
    """Return True where kernels are compiled by plain Numba."""
    return NUMBA is plain
