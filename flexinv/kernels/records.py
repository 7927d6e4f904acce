"""Records of many arrays, which kernels hand to one another as one address (`compiler.record_types`).

Where kernels are plain Numba (`compiler.choice`) records are named tuples that go by value: slower, with the same numbers.
"""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from numba import types
from numba.core.typing.templates import signature
from numba.extending import intrinsic

from flexinv.kernels.compiler.choice import NUMBA

Record = TypeVar("Record", bound=tuple[Any, ...])
_instruction: Any = intrinsic  # its own type hides that the arguments are those of the call

send_by_address = NUMBA.prepare_record_class


def join_records(records: Sequence[Record]) -> Record:
    """Return the record of the stacked parts [any unit] of records of one kind and shape; numbers become arrays."""
    kind: Any = type(records[0])
    return kind(*(np.stack(parts) for parts in zip(*records, strict=True)))  # type: ignore[no-any-return]


@_instruction
def take_record(typing_context: Any, records: Any, number: Any) -> Any:
    """Return one of the records that `join_records` has joined, not copied."""
    wholes = NUMBA.list_member_types(records)
    kinds = [whole.copy(ndim=whole.ndim - 1) if whole.ndim > 1 else whole.dtype for whole in wholes]
    made = types.BaseTuple.from_types(kinds, NUMBA.find_record_class(records))

    def write_code(context: Any, builder: Any, call_signature: Any, arguments: Any) -> Any:
        parts = []
        for k, (whole, kind) in enumerate(zip(wholes, kinds, strict=True)):
            item = context.get_function(operator.getitem, signature(kind, whole, number))
            field = NUMBA.read_field(context, builder, records, arguments[0], k)
            parts.append(item(builder, (field, arguments[1])))
        return context.make_tuple(builder, made, parts)

    return made(records, number), write_code
