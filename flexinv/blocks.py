"""Blocks of samples through the recursion: from the caller's arrays into lanes, and the efforts back.

A block stays in the cache from its coordinates to its efforts.  Threads share a counter and take the next block from it,
so that one that is held up leaves its work to the others.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from flexinv.compiled import jit_blocks, jit_lanes
from flexinv.lanes import LANES
from flexinv.recursion import inboard, outboard

_instruction: Any = intrinsic  # its own type hides that the arguments are those of the call
# Numbers in a line of the cache.
_LINE = np.uint64(8)


@_instruction
def _take(typing_context: Any, counter: Any) -> Any:
    """Return counter[0] and raise it by one, undivided by other threads."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        one = context.get_constant(types.uint64, 1)
        return builder.atomic_rmw("add", array.data, one, "monotonic")

    return types.uint64(counter), generate


@_instruction
def _fetch(typing_context: Any, x: Any, at: Any) -> Any:
    """Tell the processor that x[at] will be read soon; what is behind the end of x does no harm."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        number = ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [array.data.type, number, number, number])
        fetch = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        place = builder.gep(array.data, [arguments[1]])
        builder.call(fetch, [place, number(0), number(2), number(1)])  # to read, into the second cache, data
        return context.get_dummy_value()

    return types.none(x, at), generate


@jit_lanes
def _load(work, columns, lanes, x, start, by_sample, by_column):
    """Copy the columns of a block into rows, and fetch those of the next block."""
    if by_sample == 1:
        for j in range(columns.shape[0]):
            first, at = columns[j], start + np.uint64(j) * by_column
            for k in range(lanes):
                work[first + k] = x[at + k]
            for k in range(LANES, LANES + LANES, _LINE):
                _fetch(x, at + k)
        return
    for tile in range(np.uint64(0), lanes, _LINE):  # as many samples as make a cache line of every row
        size = min(_LINE, lanes - tile)
        at = (start + tile) * by_sample
        for k in range(np.uint64(0), size * by_sample, _LINE):
            _fetch(x, at + LANES * by_sample + k)
        for j in range(columns.shape[0]):
            first = columns[j] + tile
            for k in range(size):
                work[first + k] = x[at + k * by_sample + np.uint64(j)]


@jit_lanes
def _store(work, columns, lanes, x, start, by_sample, by_column):
    """Copy rows to the columns of a block; return how many numbers are not finite."""
    wrong = 0
    for j in range(columns.shape[0]):
        first, at = columns[j], start * by_sample + np.uint64(j) * by_column
        for k in range(lanes):
            value = work[first + k]
            wrong += 0 if value - value == 0.0 else 1
        if by_sample == 1:
            for k in range(lanes):
                x[at + k] = work[first + k]
        else:
            for k in range(lanes):
                x[at + k * by_sample] = work[first + k]
    return wrong


@jit_blocks
def torque_blocks(tree, numbers, columns, q, qd, qdd, tau, strides, samples, work, counter):
    """Write the efforts [N m], [N] of all blocks that are left to take; return how many numbers are not finite.

    tree, numbers, columns : of `bodies.Bodies`; q, qd, qdd, tau : (samples * width,) [rad or m, s], whose ``strides`` (4, 2) of
    a sample and of a column are (width, 1) or (1, samples); counter : (1,) the next block
    """
    nv, wrong = tree[0, 0], 0
    nq = columns.shape[0] - 2 * nv
    for_q, for_qd, for_qdd = columns[:nq], columns[nq : nq + nv], columns[nq + nv :]
    while True:
        start = _take(counter) * LANES
        if start >= samples:
            return wrong
        lanes = min(LANES, samples - start)
        _load(work, for_q, lanes, q, start, strides[0, 0], strides[0, 1])
        _load(work, for_qd, lanes, qd, start, strides[1, 0], strides[1, 1])
        _load(work, for_qdd, lanes, qdd, start, strides[2, 0], strides[2, 1])
        outboard(tree, numbers, work, lanes)
        inboard(tree, numbers, work, lanes)
        wrong += _store(work, for_qdd, lanes, tau, start, strides[3, 0], strides[3, 1])
