"""Arrays at an address, for kernels that threads hand one another: laid out by Numba's private `populate_array`, not counted."""

from __future__ import annotations

from typing import Any

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

_instruction: Any = intrinsic  # its own type hides that the arguments are those of the call


def make_array_kernel(number: Any) -> Any:
    """Return the kernel [-] that makes the array of numbers of a type at an address, the first argument, with a shape."""

    @_instruction
    def make_array(typing_context: Any, where: Any, shape: Any) -> Any:
        return types.Array(number, len(shape), "C")(where, shape), _write_array

    return make_array


def _write_array(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    kind = signature.return_type
    sizes = cgutils.unpack_tuple(builder, arguments[1])
    array = context.make_array(kind)(context, builder)
    item = context.get_abi_sizeof(context.get_data_type(kind.dtype))
    strides = [context.get_constant(types.intp, item)]
    for size in sizes[:0:-1]:
        strides.insert(0, builder.mul(size, strides[0]))
    data = builder.inttoptr(arguments[0], context.get_value_type(kind.dtype).as_pointer())
    populate_array(array, data, sizes, strides, context.get_constant(types.intp, item), None)
    return array._getvalue()
