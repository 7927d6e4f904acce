"""Instructions of the processor that Python has no words for: numbers that threads share, and hints about memory.

A cell is a number of an array of uint64 that several threads read and write; what they see of it: `threads`, rule 5.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import binding, ir
from numba import config, types
from numba.extending import intrinsic

from flexinv.kernels.compiler.choice import NUMBA

# Whether kernels are compiled at all: with NUMBA_DISABLE_JIT=1 they are the Python that they are written in, to look into.
COMPILED = not config.DISABLE_JIT  # type: ignore[attr-defined]
_intrinsic: Any = intrinsic  # its own type hides that the arguments are those of the call
_CELL_BYTES = 8  # bytes of a cell, on whose multiples it lies
# A thread that only looks tells the processor so, which then leaves more to the others.
_PAUSE = "llvm.x86.sse2.pause" if binding.get_process_triple().startswith(("x86_64", "i386", "i686")) else ""


def _make_instruction(alone: Callable[..., Any] | None = None) -> Callable[[Any], Any]:
    """An instruction; ``alone`` does it for a single thread, where nothing is compiled."""
    return lambda typed: _intrinsic(typed) if COMPILED or alone is None else alone


def _make_writer(write: Callable[..., Any]) -> Callable[..., Any]:
    """The writer of an instruction about an array, or about one of its numbers if that is the second argument.

    write : of the builder, the address and all further arguments, which are uint64
    """

    def write_code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        place = builder.gep(data, [arguments[1]]) if len(arguments) > 1 else data
        values = zip(arguments[2:], signature.args[2:], strict=True)
        made = write(builder, place, *(context.cast(builder, one, kind, types.uint64) for one, kind in values))
        return context.get_dummy_value() if signature.return_type is types.none else made

    return write_code


def _find_function(module: Any, kind: Any, name: str) -> Any:
    """A function of the processor's by its name, which a module declares once."""
    return module.globals.get(name) or ir.Function(module, kind, name)


def _take_alone(cells: Any) -> Any:
    cells[0] += cells.dtype.type(1)
    return cells[0] - cells.dtype.type(1)


@_make_instruction(_take_alone)
def take(typing_context: Any, cells: Any) -> Any:
    """Return cells[0] and raise it by one, undivided by other threads."""
    one = ir.IntType(64)(1)
    return types.uint64(cells), _make_writer(lambda builder, place: builder.atomic_rmw("add", place, one, "monotonic"))


@_make_instruction()
def read_cell(typing_context: Any, cells: Any, at: Any) -> Any:
    """Return cells[at], as other threads have it now."""
    return types.uint64(cells, at), _make_writer(
        lambda builder, place: builder.load_atomic(place, "acquire", _CELL_BYTES)
    )


@_make_instruction()
def write_cell(typing_context: Any, cells: Any, at: Any, value: Any) -> Any:
    """Set cells[at], after everything that this thread wrote before."""
    writer = _make_writer(lambda builder, place, value: builder.store_atomic(value, place, "release", _CELL_BYTES))
    return types.none(cells, at, value), writer


@_make_instruction()
def swap(typing_context: Any, cells: Any, at: Any, old: Any, new: Any) -> Any:
    """Set cells[at] to ``new`` if it is ``old``, undivided by other threads; return whether it was."""

    def write(builder: Any, place: Any, old: Any, new: Any) -> Any:
        return builder.extract_value(builder.cmpxchg(place, old, new, "acq_rel", "acquire"), 1)

    return types.boolean(cells, at, old, new), _make_writer(write)


@_make_instruction()
def pause(typing_context: Any) -> Any:
    """Do nothing for some nanoseconds."""

    def write_code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        if _PAUSE:
            kind = ir.FunctionType(ir.VoidType(), [])
            builder.call(_find_function(builder.module, kind, _PAUSE), [])
        return context.get_dummy_value()

    return types.none(), write_code


@_make_instruction(lambda x, at: None)
def fetch(typing_context: Any, x: Any, at: Any) -> Any:
    """Tell the processor that x[at] will be read soon; what is behind the end of x does no harm."""

    def write(builder: Any, place: Any) -> None:
        number = ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [place.type, number, number, number])
        instruction = _find_function(builder.module, kind, "llvm.prefetch.p0")
        builder.call(instruction, [place, number(0), number(2), number(1)])  # to read, into the second cache, data

    return types.none(x, at), _make_writer(write)


@_make_instruction(lambda values: values.ctypes.data)
def read_address(typing_context: Any, values: Any) -> Any:
    """Return the address of an array in memory."""
    return types.uint64(values), _make_writer(lambda builder, place: builder.ptrtoint(place, ir.IntType(64)))


# Arrays at an address, the first argument, with the shape that is the second: of numbers, and of whole numbers.
make_float_array = NUMBA.make_array_kernel(types.float64)
make_integer_array = NUMBA.make_array_kernel(types.uint64)
