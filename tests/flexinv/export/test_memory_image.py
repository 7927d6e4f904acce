"""Arrays become one block of bytes: views stay views, addresses are distances, and what is missing is said."""

from __future__ import annotations

import numpy as np
import pytest
from llvmlite import binding as llvm
from numba import typeof, types

from flexinv.errors import FlexinvError, InputError
from flexinv.export.machine_code import check_compiler, check_needs
from flexinv.export.memory_image import WORD, MemoryImage

HEADER = 64


def test_views_of_one_array_are_views_in_the_block() -> None:
    whole = np.arange(1.0, 13.0).reshape(3, 4)
    column = whole[1:, 2]
    image = MemoryImage(HEADER, [column, whole])
    assert image.find_place(column) - image.find_place(whole) == 6 * WORD
    assert np.frombuffer(image.write_content(), count=12, offset=image.find_place(whole)).tolist() == list(range(1, 13))


def test_an_array_is_described_as_numba_has_it() -> None:
    """Two owners, count, bytes of a number, address, shape, strides; the address alone is to be moved."""
    numbers = np.arange(1.0, 7.0).reshape(2, 3)
    image = MemoryImage(HEADER, [numbers])
    operands = image.add_argument(typeof(numbers), numbers)
    first = operands[0].offset
    block = image.write_content().ljust(image.size, b"\0")
    words = np.frombuffer(block, dtype=np.int64, count=9, offset=first).tolist()
    assert words == [0, 0, 6, 8, image.find_place(numbers), 2, 3, 24, 8]
    assert image.relocations == [first + 4 * WORD]
    assert [one.offset for one in operands] == [first + WORD * k for k in range(9)]


def test_arrays_that_are_zero_are_none_of_the_content_that_is_kept() -> None:
    """What is filled, then what is zero, then the descriptions: the middle is left out, and nothing else."""
    filled, empty = np.arange(1.0, 5.0), np.zeros(1000)
    image = MemoryImage(HEADER, [empty, filled])
    image.add_argument(typeof(empty), empty)
    head, tail = image.split_content()
    start, end = image.zeros
    assert image.find_place(filled) < start <= image.find_place(empty) < end
    assert head + bytes(end - start) + tail == image.write_content()
    assert len(head) + len(tail) < 1000


def test_what_was_not_laid_out_is_said() -> None:
    image = MemoryImage(HEADER, [np.ones(3)])
    with pytest.raises(FlexinvError, match=r"was not laid out"):
        image.find_place(np.ones(3))
    with pytest.raises(FlexinvError, match=r"argument of type unicode_type cannot be laid out"):
        image.add_argument(types.unicode_type, "text")


def test_code_that_needs_more_of_the_system_is_refused() -> None:
    head = "define void @f() { call void @NAME() ret void }\ndeclare void @NAME()"
    check_needs(llvm.parse_assembly(head.replace("NAME", "memset")))
    with pytest.raises(FlexinvError, match=r"needs malloc, which a C program does not have"):
        check_needs(llvm.parse_assembly(head.replace("NAME", "malloc")))


def test_plain_numba_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    check_compiler()
    monkeypatch.setattr("flexinv.export.machine_code.is_plain", lambda: True)
    with pytest.raises(InputError, match=r"plain Numba \(FLEXINV_PLAIN_NUMBA\).*unset that variable"):
        check_compiler()
