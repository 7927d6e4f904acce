"""Instructions of the processor that Python has no words for: numbers that threads share, and hints about memory.

A cell is a number of an array of uint64 that several threads read and write.  What a thread wrote before it `put` or `swap`
a cell is seen by every thread that then finds the new value by `look` or `swap`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import binding, ir
from numba import config, types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

# Whether kernels are compiled at all: with NUMBA_DISABLE_JIT=1 they are the Python that they are written in, to look into.
COMPILED = not config.DISABLE_JIT  # type: ignore[attr-defined]
_intrinsic: Any = intrinsic  # its own type hides that the arguments are those of the call
_CELL_BYTES = 8  # bytes of a cell, on whose multiples it lies
# A thread that only looks tells the processor so, which then leaves more to the others.
_PAUSE = "llvm.x86.sse2.pause" if binding.get_process_triple().startswith(("x86_64", "i386", "i686")) else ""


def _instruction(alone: Callable[..., Any] | None = None) -> Callable[[Any], Any]:
    """An instruction; ``alone`` does it for a single thread, where nothing is compiled."""
    return lambda typed: _intrinsic(typed) if COMPILED or alone is None else alone


def _place(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """The address of a number of an array, the first two arguments."""
    array = context.make_array(signature.args[0])(context, builder, arguments[0])
    return builder.gep(array.data, [arguments[1]])


def _take_alone(cells: Any) -> Any:
    cells[0] += cells.dtype.type(1)
    return cells[0] - cells.dtype.type(1)


@_instruction(_take_alone)
def take(typing_context: Any, cells: Any) -> Any:
    """Return cells[0] and raise it by one, undivided by other threads."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        one = context.get_constant(types.uint64, 1)
        return builder.atomic_rmw("add", array.data, one, "monotonic")

    return types.uint64(cells), generate


@_instruction()
def look(typing_context: Any, cells: Any, at: Any) -> Any:
    """Return cells[at], as other threads have it now."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load_atomic(_place(context, builder, signature, arguments), "acquire", _CELL_BYTES)

    return types.uint64(cells, at), generate


@_instruction()
def put(typing_context: Any, cells: Any, at: Any, value: Any) -> Any:
    """Set cells[at], after everything that this thread wrote before."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        value = context.cast(builder, arguments[2], signature.args[2], types.uint64)
        builder.store_atomic(value, _place(context, builder, signature, arguments), "release", _CELL_BYTES)
        return context.get_dummy_value()

    return types.none(cells, at, value), generate


@_instruction()
def swap(typing_context: Any, cells: Any, at: Any, old: Any, new: Any) -> Any:
    """Set cells[at] to ``new`` if it is ``old``, undivided by other threads; return whether it was."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        before, after = (context.cast(builder, arguments[i], signature.args[i], types.uint64) for i in (2, 3))
        place = _place(context, builder, signature, arguments)
        found = builder.cmpxchg(place, before, after, "acq_rel", "acquire")
        return builder.extract_value(found, 1)

    return types.boolean(cells, at, old, new), generate


@_instruction()
def pause(typing_context: Any) -> Any:
    """Do nothing for some nanoseconds."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        if _PAUSE:
            kind = ir.FunctionType(ir.VoidType(), [])
            builder.call(cgutils.get_or_insert_function(builder.module, kind, _PAUSE), [])
        return context.get_dummy_value()

    return types.none(), generate


@_instruction(lambda x, at: None)
def fetch(typing_context: Any, x: Any, at: Any) -> Any:
    """Tell the processor that x[at] will be read soon; what is behind the end of x does no harm."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place, number = _place(context, builder, signature, arguments), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [place.type, number, number, number])
        instruction = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        builder.call(instruction, [place, number(0), number(2), number(1)])  # to read, into the second cache, data
        return context.get_dummy_value()

    return types.none(x, at), generate


@_instruction(lambda values: values.ctypes.data)
def address(typing_context: Any, values: Any) -> Any:
    """Return the address of an array in memory."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        return builder.ptrtoint(array.data, ir.IntType(64))

    return types.uint64(values), generate


def _array(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """The array that begins at an address, the first argument, with the shape that is the second."""
    kind, sizes = signature.return_type, cgutils.unpack_tuple(builder, arguments[1])
    array = context.make_array(kind)(context, builder)
    item = context.get_abi_sizeof(context.get_data_type(kind.dtype))
    strides = [context.get_constant(types.intp, item)]
    for size in sizes[:0:-1]:
        strides.insert(0, builder.mul(size, strides[0]))
    data = builder.inttoptr(arguments[0], context.get_value_type(kind.dtype).as_pointer())
    populate_array(array, data, sizes, strides, context.get_constant(types.intp, item), None)
    return array._getvalue()


@_instruction()
def reals(typing_context: Any, where: Any, shape: Any) -> Any:
    """Return the array of numbers at an address."""
    return types.Array(types.float64, len(shape), "C")(where, shape), _array


@_instruction()
def wholes(typing_context: Any, where: Any, shape: Any) -> Any:
    """Return the array of whole numbers at an address."""
    return types.Array(types.uint64, len(shape), "C")(where, shape), _array
