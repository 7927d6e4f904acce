"""Records of many arrays, stacked: one record whose arrays have a leading axis, and each of them again in compiled code."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from numba import types
from numba.core.typing.templates import signature
from numba.extending import intrinsic

from flexinv.kernels.records import field, members

Record = TypeVar("Record", bound=tuple[Any, ...])
_instruction: Any = intrinsic  # its own type hides that the arguments are those of the call


def stacked(records: Sequence[Record]) -> Record:
    """Return the record of the stacked parts [any unit] of records of one kind and shape; numbers become arrays."""
    kind: Any = type(records[0])
    return kind(*(np.stack(parts) for parts in zip(*records, strict=True)))  # type: ignore[no-any-return]


@_instruction
def at(typing_context: Any, records: Any, number: Any) -> Any:
    """Return one of the records that `stacked` has joined, not copied."""
    wholes = members(records)
    kinds = [whole.copy(ndim=whole.ndim - 1) if whole.ndim > 1 else whole.dtype for whole in wholes]
    made = types.BaseTuple.from_types(kinds, records.value.instance_class)

    def generate(context: Any, builder: Any, own: Any, arguments: Any) -> Any:
        parts = []
        for k, (whole, kind) in enumerate(zip(wholes, kinds, strict=True)):
            item = context.get_function(operator.getitem, signature(kind, whole, number))
            parts.append(item(builder, (field(context, builder, records, arguments[0], k), arguments[1])))
        return context.make_tuple(builder, made, parts)

    return made(records, number), generate
