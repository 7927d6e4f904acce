"""A C library that `export_c` has written, called from Python by ctypes, as the tests of the exported code need it."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flexinv.export.c_files import LAYOUT, STATUSES
from flexinv.export.export_c import ExportedLibrary
from flexinv.export.machine_code import NATIVE, NEEDED
from flexinv.typing import Array

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler (cc) to link with")


class Block:
    """A block of memory of an exported library, begun; ``block.call("torque", q, ...)`` returns the status by its name."""

    def __init__(self, made: ExportedLibrary, begin: bool = True, target: str = NATIVE) -> None:
        self.name = made.name
        self.made = made
        self.library = ctypes.CDLL(str(made.folder / "lib" / target / f"lib{made.name}.so"))
        self.size = self._function("size", ctypes.c_size_t)()
        self.alignment = self._function("alignment", ctypes.c_size_t)()
        self.room = np.zeros(self.size + 2 * self.alignment, dtype=np.uint8)
        self.address = self.room.ctypes.data + -self.room.ctypes.data % self.alignment
        if begin:
            assert self.start() == "OK"

    def _function(self, name: str, result: type[ctypes._SimpleCData]) -> Callable[..., int]:  # type: ignore[type-arg]
        function = getattr(self.library, f"{self.name}_{name}")
        function.restype = result
        return function  # type: ignore[no-any-return]

    def start(self, size: int | None = None, layout: int = LAYOUT, address: int | None = None) -> str:
        where = self.address if address is None else address
        status = self._function("start", ctypes.c_int)(
            ctypes.c_void_p(where), ctypes.c_size_t(self.size if size is None else size), layout
        )
        return list(STATUSES)[status]

    def start_at(self, q: Array) -> str:
        size = ctypes.c_size_t(self.size)
        return self.call_alone("start_at", ctypes.c_void_p(self.address), size, LAYOUT, q)

    def copy(self, to: Block) -> str:
        places = ctypes.c_void_p(self.address), ctypes.c_void_p(to.address), ctypes.c_size_t(to.size)
        return list(STATUSES)[self._function("copy", ctypes.c_int)(*places)]

    def call(self, name: str, *arguments: Array | int | float | None) -> str:
        """Call a function of the block with arrays, numbers of samples or links, and numbers."""
        return self.call_alone(name, ctypes.c_void_p(self.address), *map(convert, arguments))

    def number(self, name: str, *arguments: int) -> int:
        """Call a function that returns a number and needs no block."""
        return self._function(name, ctypes.c_size_t)(*map(ctypes.c_size_t, arguments))

    def call_alone(self, name: str, *arguments: object) -> str:
        """Call a function that needs no block."""
        given = [convert(one) if isinstance(one, np.ndarray) else one for one in arguments]
        return list(STATUSES)[self._function(name, ctypes.c_int)(*given)]


def convert(argument: Array | int | float | None) -> object:
    if argument is None or isinstance(argument, np.ndarray):
        return ctypes.c_void_p(None if argument is None else argument.ctypes.data)
    return ctypes.c_double(argument) if isinstance(argument, float) else ctypes.c_size_t(argument)


def undefined_symbols(file: Path) -> set[str]:
    """Return what an object needs of others."""
    lines = subprocess.run(["nm", "-u", str(file)], capture_output=True, text=True, check=True).stdout.splitlines()
    return {line.split()[-1].partition("@")[0] for line in lines if line.strip()}


def assert_needs_nothing(made: ExportedLibrary) -> None:
    """Every object of a library needs mathematics and moves of bytes, and what stands in the others: no Python, no memory."""
    objects = sorted((made.folder / "lib").rglob("*.o"))
    assert len(objects) == 3
    own = set[str]()
    for one in objects:
        lines = subprocess.run(["nm", "--defined-only", str(one)], capture_output=True, text=True, check=True).stdout
        own |= {line.split()[-1] for line in lines.splitlines() if line.strip()}
    for one in objects:
        assert undefined_symbols(one) - own <= NEEDED | {"_GLOBAL_OFFSET_TABLE_"}
