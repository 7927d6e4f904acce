"""Records of many arrays, which kernels hand to one another as one address.

Numba hands a named tuple over by value: a record of fifty arrays is 400 numbers in every call, in the text that is compiled and
on the stack of the machine.  A kind of record that is declared with `by_address` is laid out in memory once, where Python calls a
kernel or where a kernel makes one, and every kernel below gets its address.  Nobody writes there, so that the machine's compiler
may keep what it has read (`noalias`).
"""

from __future__ import annotations

import operator
from collections.abc import Iterator, Sequence
from functools import cached_property
from hashlib import sha256
from typing import Any, TypeVar

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typeconv.castgraph import Conversion
from numba.core.typing.templates import AttributeTemplate, infer_getattr, signature
from numba.core.typing.typeof import Purpose, typeof_impl
from numba.extending import NativeValue, intrinsic, lower_cast, lower_getattr_generic, models, register_model, unbox

_Kind = TypeVar("_Kind", bound=type)
Record = TypeVar("Record", bound=tuple[Any, ...])
_instruction: Any = intrinsic  # its own type hides that the arguments are those of the call

_WORD = 8  # [bytes]
_KINDS: set[type] = set()
_SIZES: dict[Any, int] = {}  # what `_size` has found; it asks LLVM, which takes a while


class RecordType(types.Type):
    """Numba's type of the address of a record; value : the type of the named tuple that lies there."""

    def __init__(self, value: Any) -> None:
        self.value = value
        digest = sha256(f"{value.instance_class.__module__}.{value.name}".encode()).hexdigest()[:12]
        super().__init__(f"{value.instance_class.__name__}_{digest}")

    @cached_property
    def kinds(self) -> list[Any]:
        """Types [-] of the fields, as kernels get them."""
        return [argument_type(one) for one in self.value.types]

    def unify(self, typing_context: Any, other: Any) -> Any:
        """Return the address [-] where a variable is now a record that a kernel has made, and now one at an address."""
        return self if argument_type(other) == self else None

    def can_convert_from(self, typing_context: Any, other: Any) -> Any:
        """Return the grade of a conversion [-] that loses nothing: a record that a kernel has made may be laid out in memory."""
        return Conversion.safe if argument_type(other) == self else None


def by_address(kind: _Kind) -> _Kind:
    """Declare a kind of named tuple [-] that kernels get by address; return it as it is."""
    _KINDS.add(kind)
    typeof_impl.register(kind)(_type_of_record)
    return kind


def argument_type(kind: Any) -> Any:
    """Return the type [-] by which a kernel gets an argument: an address, where it is a record of a declared kind."""
    is_record = isinstance(kind, types.BaseNamedTuple) and getattr(kind, "instance_class", None) in _KINDS
    return RecordType(_by_value(kind)) if is_record else kind


def members(kind: Any) -> list[Any]:
    """Return the types [-] of the fields of a record, whether at an address or not, as `field` returns them."""
    return kind.kinds if isinstance(kind, RecordType) else [argument_type(one) for one in kind.types]


def field(context: Any, builder: Any, kind: Any, given: Any, number: int) -> Any:
    """Return one of the fields of a record at an address [any unit]; of a record within it the address."""
    for one, offset in _placed(context, kind.value, 0):
        if number == 0:
            place = _at(builder, given, offset)
            nested = isinstance(argument_type(one), RecordType)
            return place if nested else builder.load(_as(context, builder, one, place))
        number -= 1
    raise IndexError(number)


def _type_of_record(value: Any, context: Any) -> Any:
    """Numba's type of a record that Python hands over."""
    kinds = [typeof_impl(one, context) for one in value]
    if any(kind is None for kind in kinds):
        return None
    made = _by_value(types.BaseTuple.from_types(kinds, type(value)))
    return RecordType(made) if context.purpose is Purpose.argument else made


def _by_value(kind: Any) -> Any:
    """The type of a named tuple, and of all records within it, by value."""
    if isinstance(kind, RecordType):
        return kind.value
    maker: Any = getattr(kind, "instance_class", None)
    return kind if maker is None else types.BaseTuple.from_types([_by_value(one) for one in kind.types], maker)


def _placed(context: Any, kind: Any, start: int) -> Iterator[tuple[Any, int]]:
    """Types of the fields of a named tuple, each with its place [bytes] behind the record's."""
    for one in kind.types:
        yield one, start
        start += _size(context, one)


def _size(context: Any, kind: Any) -> int:
    """Size of a field [bytes], in whole words."""
    if kind not in _SIZES:
        if isinstance(argument_type(kind), RecordType):
            _SIZES[kind] = sum(_size(context, one) for one in kind.types)
        else:
            _SIZES[kind] = -(-context.get_abi_sizeof(context.get_value_type(kind)) // _WORD) * _WORD
    return _SIZES[kind]


def _room(context: Any, builder: Any, kind: Any) -> Any:
    """Memory for a record in the frame of the function that is written."""
    words = max(_size(context, kind.value) // _WORD, 1)
    return builder.bitcast(cgutils.alloca_once(builder, ir.ArrayType(ir.IntType(64), words)), cgutils.voidptr_t)


def _at(builder: Any, address: Any, offset: int) -> Any:
    return builder.gep(address, [ir.IntType(64)(offset)], inbounds=True) if offset else address


def _as(context: Any, builder: Any, kind: Any, place: Any) -> Any:
    return builder.bitcast(place, context.get_value_type(kind).as_pointer())


@register_model(RecordType)
class _Model(models.OpaqueModel):
    """An address."""


@infer_getattr
class _Fields(AttributeTemplate):
    key = RecordType

    def generic_resolve(self, kind: Any, name: str) -> Any:  # type: ignore[override]  # Numba returns what is none
        """Return the type [-] of a field."""
        fields = kind.value.fields
        return members(kind)[fields.index(name)] if name in fields else None


@lower_getattr_generic(RecordType)
def _read(context: Any, builder: Any, kind: Any, given: Any, name: str) -> Any:
    return field(context, builder, kind, given, kind.value.fields.index(name))


@lower_cast(types.BaseNamedTuple, RecordType)
def _lay_out(context: Any, builder: Any, have: Any, wanted: Any, given: Any) -> Any:
    """Write a record that a kernel has made into memory."""
    room = _room(context, builder, wanted)
    _write(context, builder, have, given, wanted.value, room)
    return room


def _write(context: Any, builder: Any, have: Any, given: Any, wanted: Any, room: Any) -> None:
    for k, (one, (kind, offset)) in enumerate(zip(have.types, _placed(context, wanted, 0), strict=True)):
        part = builder.extract_value(given, k)
        place = _at(builder, room, offset)
        if isinstance(one, RecordType):
            cgutils.raw_memcpy(builder, place, part, ir.IntType(64)(_size(context, kind)), 1, align=_WORD)
        elif isinstance(argument_type(one), RecordType):
            _write(context, builder, one, part, kind, place)
        else:
            builder.store(context.cast(builder, part, one, kind), _as(context, builder, kind, place))


@lower_cast(RecordType, types.BaseNamedTuple)
def _read_whole(context: Any, builder: Any, have: Any, wanted: Any, given: Any) -> Any:
    parts = []
    for k, kind in enumerate(members(have)):
        part = field(context, builder, have, given, k)
        parts.append(context.cast(builder, part, kind, wanted.types[k]))
    return context.make_tuple(builder, wanted, parts)


@unbox(RecordType)
def _from_python(kind: Any, given: Any, native: Any) -> Any:
    """Lay a record of Python's out in memory."""
    room = _room(native.context, native.builder, kind)
    wrong = [cgutils.false_bit, *_put(kind.value, given, room, native)]
    is_error = wrong[0]
    for one in wrong[1:]:
        is_error = native.builder.or_(is_error, one)
    return NativeValue(room, is_error=is_error)


def _put(kind: Any, given: Any, room: Any, native: Any) -> Iterator[Any]:
    for k, (one, offset) in enumerate(_placed(native.context, kind, 0)):
        item = native.pyapi.tuple_getitem(given, k)
        place = _at(native.builder, room, offset)
        if isinstance(argument_type(one), RecordType):
            yield from _put(one, item, place, native)
        else:
            yield native.builder.call(_reader(one, native), [item, place])


def _reader(kind: Any, native: Any) -> Any:
    """The function that lays one array or number of Python's out in memory, of which a module has one: records have ninety."""
    module = native.builder.module
    signature = ir.FunctionType(ir.IntType(1), [cgutils.voidptr_t, cgutils.voidptr_t])
    function = cgutils.get_or_insert_function(module, signature, f"flexinv.read.{kind}")
    if function.is_declaration:
        function.linkage = "internal"
        function.attributes.add("noinline")
        builder = ir.IRBuilder(function.append_basic_block())
        part = native.context.get_python_api(builder).to_native_value(kind, function.args[0])
        assert part.cleanup is None  # kernels get arrays and numbers only
        builder.store(part.value, _as(native.context, builder, kind, function.args[1]))
        builder.ret(part.is_error)
    return function


# ----------------------------------------------------------------- stacked: one record whose arrays have a leading axis


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
