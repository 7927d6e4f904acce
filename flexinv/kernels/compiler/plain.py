"""Kernels by what Numba promises to everybody: its decorator and its cache, records by value.

Compilation takes several times as long as with `kernel_compiler`, as every function is optimised with all that it calls, and
kernels run slower; the numbers are the same.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from numba import carray, config, njit, types  # type: ignore[attr-defined]  # carray is documented
from numba.extending import intrinsic, register_jitable

from flexinv.kernels.compiler.source_stamps import PACKAGE, compute_source_stamp

_Kind = TypeVar("_Kind", bound=type)
_instruction: Any = intrinsic  # its own type hides that the arguments are those of the call
KNOWN = ("nogil", "forceinline", "fastmath")  # options that everybody may give


def make_jit_decorator(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return Numba's decorator with these options [-], as far as they are no private ones.

    Machine code is kept in a folder for each state of the sources: Numba itself asks only for the file of the function.
    """
    public = {name: options[name] for name in KNOWN if name in options}

    def make_kernel(function: Callable[..., Any]) -> Any:
        keeps = bool(options.get("cache"))
        folder = find_folder() if keeps else None
        with _apply_cache_folder(folder):
            return njit(error_model="numpy", cache=folder is not None, **public)(function)

    return make_kernel


def find_folder() -> Path | None:
    """Return the folder for machine code of these sources, beside them or where NUMBA_CACHE_DIR says; None where none can be."""
    stamp = compute_source_stamp(PACKAGE, "")
    asked = os.environ.get("NUMBA_CACHE_DIR")
    folder = (Path(asked) if asked else PACKAGE / "kernels" / "__pycache__") / f"plain-{stamp[:16]}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None


@contextmanager
def _apply_cache_folder(folder: Path | None) -> Iterator[None]:
    """Have Numba keep machine code in a folder [-]."""
    settings: Any = config
    before = settings.CACHE_DIR
    settings.CACHE_DIR = str(folder or before)
    try:
        yield
    finally:
        settings.CACHE_DIR = before


def resolve_compiled(kernel: Any, *arguments: Any) -> Callable[..., Any]:
    """Return the kernel [-] as it is: it looks at the types of its arguments in every call."""
    return kernel  # type: ignore[no-any-return]


def begin_runtime() -> None:
    """Do nothing: the first kernel starts what it needs."""


def prepare_record_class(kind: _Kind) -> _Kind:
    """Return a kind of named tuple [-] as it is: it goes by value."""
    return kind


def list_member_types(kind: Any) -> list[Any]:
    """Return the types [-] of the fields of a record."""
    return list(kind.types)


def find_record_class(kind: Any) -> Any:
    """Return the named tuple [-] that a record is."""
    return kind.instance_class


def read_field(context: Any, builder: Any, kind: Any, given: Any, number: int) -> Any:
    """Return one of the fields of a record [any unit]."""
    return builder.extract_value(given, number)


def make_array_kernel(number: Any) -> Any:
    """Return the kernel [-] that makes the array of numbers of a type at an address, the first argument, with a shape."""

    @_instruction
    def make_pointer(typing_context: Any, where: Any) -> Any:
        return types.CPointer(number)(where), _write_pointer

    @register_jitable
    def make_array(where: Any, shape: Any) -> Any:
        return carray(make_pointer(where), shape)

    return make_array


def _write_pointer(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))
