"""The memory that kernels work on, as one block of bytes that may stand at any address.

A kernel gets arrays and records of arrays.  `MemoryImage` lays out the arguments of several kernels in one block: first all
numbers of the arrays as they are now, then the descriptions of arrays as Numba has them, which hold addresses.  An address is
written as its distance from the beginning of the block; ``relocations`` lists where one stands, so that whoever puts the block
at an address adds that.  Arrays that share memory in Python share it there.
"""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import types
from numba.core.registry import cpu_target
from numpy.typing import NDArray

from flexinv.errors import FlexinvError
from flexinv.kernels.compiler.record_types import RecordType, compute_size, list_field_places, list_member_types
from flexinv.kernels.memory import LINE
from flexinv.typing import Array

WORD = 8  # [bytes]
ALIGNMENT = LINE * WORD  # of the block [bytes]: arrays lie on lines of the cache as they do in Python


@dataclass(frozen=True)
class Operand:
    """One machine argument of a kernel: the word at an offset [bytes] of the block, or the address of that place itself."""

    offset: int
    is_address: bool = False


@dataclass(frozen=True)
class _Segment:
    """Memory that arrays share: its address in this process, its bytes, and where it stands in the block [bytes]."""

    address: int
    data: bytes
    offset: int


class MemoryImage:
    """Arguments of kernels in one block of bytes.

    content : what is not zero, from the beginning on; size : of the whole block [bytes]
    relocations : offsets of all words that hold addresses [bytes]
    zeros : the stretch of arrays that are zero [bytes]: from where, to before where
    """

    def __init__(self, header: int, arrays: Sequence[Array]) -> None:
        """Lay out the numbers of arrays behind a header of so many bytes; what is zero now stands at the end."""
        self.relocations: list[int] = []
        self._arrays = list(arrays)  # as long as they are there, no other array has their addresses
        self._words: list[tuple[int, bytes]] = []
        self._segments = list[_Segment]()
        end = header
        filled = header
        for address, data in sorted(_join_intervals(arrays), key=lambda piece: not any(piece[1])):
            end = -(-end // ALIGNMENT) * ALIGNMENT
            self._segments.append(_Segment(address, data, end))
            end += len(data)
            filled = end if any(data) else filled
        self.size = -(-end // ALIGNMENT) * ALIGNMENT
        self.zeros = filled, self.size

    def find_place(self, array: NDArray[Any]) -> int:
        """Return the offset [bytes], [-] of the first number of an array; FlexinvError where it was not laid out."""
        if array.size == 0:
            return 0
        address = array.ctypes.data
        for one in self._segments:
            if one.address <= address < one.address + len(one.data):
                return one.offset + address - one.address
        raise FlexinvError("an array of a kernel was not laid out: name it among the arrays of the memory image")

    def add_room(self, count: int) -> int:
        """Return the offset [bytes] of so many more bytes at the end, which are zero."""
        offset = self.size
        self.size += -(-count // ALIGNMENT) * ALIGNMENT
        return offset

    def add_argument(self, kind: Any, value: Any) -> list[Operand]:
        """Write an argument of Numba's type ``kind``; return the machine arguments [-] that a kernel gets for it."""
        if isinstance(kind, RecordType):
            offset = self.add_room(compute_size(cpu_target.target_context, kind.value))
            self._write_record(kind.value, value, offset)
            return [Operand(offset, is_address=True)]
        if isinstance(kind, types.BaseTuple):
            parts = zip(list_member_types(kind), value, strict=True)
            return [one for part in parts for one in self.add_argument(*part)]
        offset = self.add_room(WORD * count_words(kind))
        self._write_value(kind, value, offset)
        return [Operand(offset + WORD * k) for k in range(count_words(kind))]

    def write_content(self) -> bytes:
        """Return the bytes [-] of the block up to the last that is not zero."""
        block = bytearray(self.size)
        for one in self._segments:
            block[one.offset : one.offset + len(one.data)] = one.data
        for offset, word in self._words:
            block[offset : offset + len(word)] = word
        return bytes(block).rstrip(b"\0")

    def split_content(self) -> tuple[bytes, bytes]:
        """Return the bytes [-] of the block before and behind the arrays that are zero, up to the last that is not."""
        content = self.write_content()
        start, end = self.zeros
        return content[:start], content[end:]

    def _write_record(self, kind: Any, value: Any, offset: int) -> None:
        """Write a record and those in it, as `record_types` lays them out."""
        places = list_field_places(cpu_target.target_context, kind, offset)
        for (one, place), part in zip(places, value, strict=True):
            if isinstance(one, types.BaseTuple):
                self._write_record(one, part, place)
            else:
                self._write_value(one, part, place)

    def _write_value(self, kind: Any, value: Any, offset: int) -> None:
        """Write a number, or the description of an array: two owners that kernels never ask for, counts, address, strides."""
        if isinstance(kind, types.Array):
            self.relocations.append(offset + 4 * WORD)
            words = (0, 0, value.size, value.itemsize, self.find_place(value), *value.shape, *value.strides)
            self._words.append((offset, struct.pack(f"<{len(words)}q", *words)))
        else:
            form = "<d" if isinstance(kind, types.Float) else "<q"
            self._words.append((offset, struct.pack(form, value)))


def count_words(kind: Any) -> int:
    """Return the words [-] of a number or of the description of an array; FlexinvError for any other type."""
    if isinstance(kind, types.Array):
        return 5 + 2 * kind.ndim
    if isinstance(kind, (types.Integer, types.Float, types.Boolean)):
        return 1
    raise FlexinvError(
        f"an argument of type {kind} cannot be laid out: kernels get arrays, numbers and records of them"
    )


def list_arrays(part: Any) -> Iterator[Array]:
    """Yield the arrays [any unit] of tuples and records, in their order."""
    if isinstance(part, np.ndarray):
        yield part
    elif isinstance(part, tuple):
        for one in part:
            yield from list_arrays(one)


def _join_intervals(arrays: Sequence[Array]) -> list[tuple[int, bytes]]:
    """Address and bytes of every stretch of memory that arrays cover, overlapping ones as one, in the order of the arrays.

    So the block does not depend on where Python happened to put them.
    """
    bounds = [np.lib.array_utils.byte_bounds(one) for one in arrays if one.size]
    joined = list[list[int]]()
    for start, end in sorted(bounds):
        if joined and start < joined[-1][1]:
            joined[-1][1] = max(joined[-1][1], end)
        else:
            joined.append([start, end])
    first = [min(k for k, bound in enumerate(bounds) if start <= bound[0] < end) for start, end in joined]
    ordered = [joined[k] for k in np.argsort(first)]
    return [(start, _read_memory(start, end - start)) for start, end in ordered]


def _read_memory(address: int, size: int) -> bytes:

    return ctypes.string_at(address, size)
