"""Numba's types of records: how a record of many arrays lies at one address, and how kernels read and write it there.

Numba hands a named tuple over by value: a record of fifty arrays is 400 numbers in every call, in the text that is compiled and
on the stack of the machine.  A kind of record that `prepare_record_class` knows is laid out in memory once, where Python calls a
kernel or where a kernel makes one, and every kernel below gets its address.  Nobody writes there, so that the machine's
compiler may keep what it has read (`noalias`).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from hashlib import sha256
from typing import Any, TypeVar

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typeconv.castgraph import Conversion
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.core.typing.typeof import Purpose, typeof_impl
from numba.extending import NativeValue, lower_cast, lower_getattr_generic, models, register_model, unbox

_Kind = TypeVar("_Kind", bound=type)

_WORD = 8  # [bytes]
_KINDS: set[type] = set()
_SIZES: dict[Any, int] = {}  # what `compute_size` has found; it asks LLVM, which takes a while


class RecordType(types.Type):
    """Numba's type of the address of a record; value : the type of the named tuple that lies there."""

    def __init__(self, value: Any) -> None:
        self.value = value
        digest = sha256(f"{value.instance_class.__module__}.{value.name}".encode()).hexdigest()[:12]
        super().__init__(f"{value.instance_class.__name__}_{digest}")

    @cached_property
    def kinds(self) -> list[Any]:
        """Types [-] of the fields, as kernels get them."""
        return [resolve_argument_type(one) for one in self.value.types]

    def unify(self, typing_context: Any, other: Any) -> Any:
        """Return the address [-] where a variable is now a record that a kernel has made, and now one at an address."""
        return self if resolve_argument_type(other) == self else None

    def can_convert_from(self, typing_context: Any, other: Any) -> Any:
        """Return the grade of a conversion [-] that loses nothing: a record that a kernel has made may be laid out in memory."""
        return Conversion.safe if resolve_argument_type(other) == self else None


def prepare_record_class(kind: _Kind) -> _Kind:
    """Declare a kind of named tuple [-] that kernels get by address; return it as it is."""
    _KINDS.add(kind)
    typeof_impl.register(kind)(_resolve_record_type)
    return kind


def resolve_argument_type(kind: Any) -> Any:
    """Return the type [-] by which a kernel gets an argument: an address, where it is a record of a declared kind."""
    is_record = isinstance(kind, types.BaseNamedTuple) and getattr(kind, "instance_class", None) in _KINDS
    return RecordType(_resolve_value_type(kind)) if is_record else kind


def list_member_types(kind: Any) -> list[Any]:
    """Return the types [-] of the fields of a record, whether at an address or not, as `read_field` returns them."""
    return kind.kinds if isinstance(kind, RecordType) else [resolve_argument_type(one) for one in kind.types]


def find_record_class(kind: Any) -> Any:
    """Return the named tuple [-] that a record is, whether at an address or not."""
    return (kind.value if isinstance(kind, RecordType) else kind).instance_class


def read_field(context: Any, builder: Any, kind: Any, given: Any, number: int) -> Any:
    """Return one of the fields of a record [any unit]; of a record within one at an address its address."""
    if not isinstance(kind, RecordType):
        return builder.extract_value(given, number)
    for one, offset in list_field_places(context, kind.value, 0):
        if number == 0:
            place = _move_address(builder, given, offset)
            nested = isinstance(resolve_argument_type(one), RecordType)
            return place if nested else builder.load(_convert_address(context, builder, one, place))
        number -= 1
    raise IndexError(number)


def _resolve_record_type(value: Any, context: Any) -> Any:
    """Numba's type of a record that Python hands over."""
    kinds = [typeof_impl(one, context) for one in value]
    if any(kind is None for kind in kinds):
        return None
    value_type = _resolve_value_type(types.BaseTuple.from_types(kinds, type(value)))
    return RecordType(value_type) if context.purpose is Purpose.argument else value_type


def _resolve_value_type(kind: Any) -> Any:
    """The type of a named tuple, and of all records within it, by value."""
    if isinstance(kind, RecordType):
        return kind.value
    maker: Any = getattr(kind, "instance_class", None)
    return (
        kind if maker is None else types.BaseTuple.from_types([_resolve_value_type(one) for one in kind.types], maker)
    )


def list_field_places(context: Any, kind: Any, start: int) -> Iterator[tuple[Any, int]]:
    """Yield the types of the fields of a named tuple, each with its place [bytes] behind the record's, [-]."""
    for one in kind.types:
        yield one, start
        start += compute_size(context, one)


def compute_size(context: Any, kind: Any) -> int:
    """Return the size of a field or of a record by value [bytes], in whole words, [-]."""
    if kind not in _SIZES:
        if isinstance(resolve_argument_type(kind), RecordType):
            _SIZES[kind] = sum(compute_size(context, one) for one in kind.types)
        else:
            _SIZES[kind] = -(-context.get_abi_sizeof(context.get_value_type(kind)) // _WORD) * _WORD
    return _SIZES[kind]


def _make_room(context: Any, builder: Any, kind: Any) -> Any:
    """Memory for a record in the frame of the function that is written."""
    words = max(compute_size(context, kind.value) // _WORD, 1)
    return builder.bitcast(cgutils.alloca_once(builder, ir.ArrayType(ir.IntType(64), words)), cgutils.voidptr_t)


def _move_address(builder: Any, address: Any, offset: int) -> Any:
    return builder.gep(address, [ir.IntType(64)(offset)], inbounds=True) if offset else address


def _convert_address(context: Any, builder: Any, kind: Any, place: Any) -> Any:
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
        return list_member_types(kind)[fields.index(name)] if name in fields else None


@lower_getattr_generic(RecordType)
def _read(context: Any, builder: Any, kind: Any, given: Any, name: str) -> Any:
    return read_field(context, builder, kind, given, kind.value.fields.index(name))


@lower_cast(types.BaseNamedTuple, RecordType)
def _write_record(context: Any, builder: Any, have: Any, wanted: Any, given: Any) -> Any:
    """Write a record that a kernel has made into memory."""
    room = _make_room(context, builder, wanted)
    _write(context, builder, have, given, wanted.value, room)
    return room


def _write(context: Any, builder: Any, have: Any, given: Any, wanted: Any, room: Any) -> None:
    for k, (one, (kind, offset)) in enumerate(zip(have.types, list_field_places(context, wanted, 0), strict=True)):
        part = builder.extract_value(given, k)
        place = _move_address(builder, room, offset)
        if isinstance(one, RecordType):
            cgutils.raw_memcpy(builder, place, part, ir.IntType(64)(compute_size(context, kind)), 1, align=_WORD)
        elif isinstance(resolve_argument_type(one), RecordType):
            _write(context, builder, one, part, kind, place)
        else:
            builder.store(context.cast(builder, part, one, kind), _convert_address(context, builder, kind, place))


@lower_cast(RecordType, types.BaseNamedTuple)
def _read_whole(context: Any, builder: Any, have: Any, wanted: Any, given: Any) -> Any:
    parts = []
    for k, kind in enumerate(list_member_types(have)):
        part = read_field(context, builder, have, given, k)
        parts.append(context.cast(builder, part, kind, wanted.types[k]))
    return context.make_tuple(builder, wanted, parts)


@unbox(RecordType)
def _convert_from_python(kind: Any, given: Any, native: Any) -> Any:
    """Lay a record of Python's out in memory."""
    room = _make_room(native.context, native.builder, kind)
    wrong = [cgutils.false_bit, *_write_fields(kind.value, given, room, native)]
    is_error = wrong[0]
    for one in wrong[1:]:
        is_error = native.builder.or_(is_error, one)
    return NativeValue(room, is_error=is_error)


def _write_fields(kind: Any, given: Any, room: Any, native: Any) -> Iterator[Any]:
    for k, (one, offset) in enumerate(list_field_places(native.context, kind, 0)):
        item = native.pyapi.tuple_getitem(given, k)
        place = _move_address(native.builder, room, offset)
        if isinstance(resolve_argument_type(one), RecordType):
            yield from _write_fields(one, item, place, native)
        else:
            yield native.builder.call(_make_field_reader(one, native), [item, place])


def _make_field_reader(kind: Any, native: Any) -> Any:
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
        builder.store(part.value, _convert_address(native.context, builder, kind, function.args[1]))
        builder.ret(part.is_error)
    return function
