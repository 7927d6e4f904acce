"""Blocks of samples through the recursion: from the caller's arrays into lanes, and the efforts back.

A block stays in the cache from its coordinates to its efforts.  Threads share a counter and take the next block from it,
so that one that is held up leaves its work to the others.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.kernels.jit import jit_blocks, jit_lanes
from flexinv.kernels.simd import LANES
from flexinv.kernels.threads import worker_pool
from flexinv.kernels.threads.atomics import address, fetch, put, reals, take, wholes
from flexinv.kernels.threads.worker_pool import DONE, OFFERED, STATE, WORDS, Helpers, awaited, claimed, settled, write
from flexinv.rnea import loop_layout as layout
from flexinv.rnea.loop_allocation import allocate, unclear
from flexinv.rnea.loop_bodies import begin, set_aside
from flexinv.rnea.loop_plane import in_plane
from flexinv.rnea.loop_space import in_space
from flexinv.rnea.recursion import NUMBERS, TREE, inboard, outboard
from flexinv.typing import Array

LINE = np.uint64(8)  # numbers in a line of the cache
# Cells that threads share: the next block; how many samples are not finite; how many blocks of loops are in doubt, whether their
# motion is; whether nothing was done (efforts would be written over what is read); and of every block of loops whether it is.
OVERLAP, CALL_CELLS = 4, 5
_BYTES = np.uint64(8)
# Every which block the sums are taken that the motion of loops is held against: enough to have nearly the largest.
SUMS = np.uint64(8)


class System(NamedTuple):
    """A mechanism for the recursion: tree, numbers, columns of `body_table.Bodies`; plan, fixed of `loop_plan.LoopPlan`."""

    tree: NDArray[np.uint64]
    numbers: Array
    columns: NDArray[np.uint64]
    plan: NDArray[np.uint64]
    fixed: Array


class Series(NamedTuple):
    """Motion and efforts of so many samples [rad or m, s], [N m], [N], as of `torque_blocks`."""

    q: Array
    qd: Array
    qdd: Array
    tau: Array
    strides: NDArray[np.uint64]
    samples: np.uint64


@jit_lanes
def _load(work, columns, lanes, x, start, by_sample, by_column):
    """Copy the columns of a block into rows, and fetch those of the next block."""
    if by_sample == 1:
        for j in range(columns.shape[0]):
            first, at = columns[j], start + np.uint64(j) * by_column
            for k in range(lanes):
                work[first + k] = x[at + k]
            for k in range(LANES, LANES + LANES, LINE):
                fetch(x, at + k)
        return
    for tile in range(np.uint64(0), lanes, LINE):  # as many samples as make a cache line of every row
        at = (start + tile) * by_sample
        for k in range(np.uint64(0), LINE * by_sample, LINE):
            fetch(x, at + LANES * by_sample + k)
        for j in range(columns.shape[0]):
            first, of = columns[j] + tile, at + np.uint64(j)
            if lanes - tile >= LINE:
                for k in range(LINE):
                    work[first + k] = x[of + k * by_sample]
            else:
                for k in range(lanes - tile):
                    work[first + k] = x[of + k * by_sample]


@jit_lanes
def _add(work, columns, lanes, x, start, by_sample, by_column):
    """Add the columns of a block to rows."""
    for j in range(columns.shape[0]):
        first, at = columns[j], start * by_sample + np.uint64(j) * by_column
        for k in range(lanes):
            work[first + k] += x[at + k * by_sample]


@jit_lanes
def _store(work, columns, lanes, x, start, by_sample, by_column):
    """Copy rows to the columns of a block."""
    if by_sample == 1:
        for j in range(columns.shape[0]):
            first, at = columns[j], start + np.uint64(j) * by_column
            for k in range(lanes):
                x[at + k] = work[first + k]
        return
    for k in range(lanes):
        at = (start + k) * by_sample
        for j in range(columns.shape[0]):
            x[at + np.uint64(j)] = work[columns[j] + k]


@jit_lanes
def _blocks(system, series, work, counter):
    """Write the efforts of all blocks that are left to take; return how many samples are not finite, or a number above 0
    where cosines and sines are those of no angle."""
    tree, numbers, columns, plan, fixed = system
    q, qd, qdd, tau, strides, samples = series
    nv, wrong = tree[0, 0], 0
    nq = columns.shape[0] - 2 * nv
    for_q, for_qd, for_qdd = columns[:nq], columns[nq : nq + nv], columns[nq + nv :]
    loops = plan[layout.LIMITS] > 0
    block, again = take(counter), False
    while True:
        start = block * LANES
        if start >= samples:
            return wrong
        lanes = min(LANES, samples - start)
        _load(work, for_q, lanes, q, start, strides[0, 0], strides[0, 1])
        _load(work, for_qd, lanes, qd, start, strides[1, 0], strides[1, 1])
        _load(work, for_qdd, lanes, qdd, start, strides[2, 0], strides[2, 1])
        if loops and not again:
            set_aside(plan, work, lanes, layout.KEEPS)
            if block % SUMS == 0:
                set_aside(plan, work, lanes, layout.SUMMED)
        lost = outboard(tree, numbers, work, lanes)
        spoilt = max(inboard(tree, numbers, work, lanes), min(lost, 1))
        if loops:
            if plan[layout.APPLIED] > 0:  # efforts of springs and given forces stand where the efforts go
                _add(work, for_qdd, lanes, tau, start, strides[3, 0], strides[3, 1])
            doubts = 0
            if not again:  # the efforts of the cut tree become those of the drives
                if plan[layout.PLANE] > 0:
                    in_plane(plan, fixed, work, lanes, block % SUMS == 0)
                else:
                    doubts += in_space(plan, fixed, work, lanes, block % SUMS == 0)
                doubts += allocate(plan, fixed, work, lanes)
            counter[CALL_CELLS + block] = 1 if doubts > 0 or again else 0
            again = doubts > 0
            if again:  # once more, without its loops
                continue
        _store(work, for_qdd, lanes, tau, start, strides[3, 0], strides[3, 1])
        wrong += spoilt
        block = take(counter)


@jit_lanes
def _offer(mail, system, series, work, counter):
    """Offer a helper to take blocks, too."""
    if not claimed(mail, address(counter)):
        return
    write(mail, 0, system.tree)
    write(mail, 1, system.numbers)
    write(mail, 2, system.columns)
    write(mail, 3, series.q)
    write(mail, 4, series.qd)
    write(mail, 5, series.qdd)
    write(mail, 6, series.tau)
    write(mail, 7, series.strides)
    write(mail, 8, work)
    write(mail, 9, counter)
    mail[WORDS + 20] = series.samples
    write(mail, 11, system.plan)
    write(mail, 12, system.fixed)
    put(mail, STATE, OFFERED)


@jit_blocks
def attend(mail, patience):
    """Take blocks for whoever offers, until no offer comes for so many looks [-]; the mail then says that its helper sleeps."""
    while awaited(mail, patience):
        word = mail[WORDS:]
        tree = wholes(word[0], (word[1] // TREE, TREE))
        numbers = reals(word[2], (word[3] // NUMBERS, NUMBERS))
        columns = wholes(word[4], (word[5],))
        q, qd, qdd = reals(word[6], (word[7],)), reals(word[8], (word[9],)), reals(word[10], (word[11],))
        tau, strides = reals(word[12], (word[13],)), wholes(word[14], (4, 2))
        work, counter, samples = reals(word[16], (word[17],)), wholes(word[18], (word[19],)), word[20]
        plan, fixed = wholes(word[22], (word[23],)), reals(word[24], (word[25],))
        system, series = System(tree, numbers, columns, plan, fixed), Series(q, qd, qdd, tau, strides, samples)
        mail[worker_pool.ANSWER] = _blocks(system, series, work, counter)
        put(mail, STATE, DONE)
    put(mail, worker_pool.SLEEPS, 1)


@jit_lanes
def _meet(a, b):
    """Return True if two arrays overlap in memory."""
    at, to = address(a), address(b)
    return at < to + _BYTES * np.uint64(b.size) and to < at + _BYTES * np.uint64(a.size)


@jit_blocks
def torque_blocks(tree, numbers, columns, plan, fixed, q, qd, qdd, tau, strides, samples, work, counter, mails):
    """Write the efforts [N m], [N] of all samples; return whether every helper that began has ended.

    tree, numbers, columns : of `body_table.Bodies`; plan, fixed : of `loop_plan.LoopPlan`
    q, qd, qdd, tau : (samples * width,) [rad or m, s], whose ``strides`` (4, 2) of a sample and of a column are (width, 1) or
    (1, samples); where tau has memory in common with what is read nothing is done, and the counter says so
    work : (1 + helpers, size); counter : (CALL_CELLS + blocks of loops,); mails : (helpers, cells)
    """
    counter[:CALL_CELLS] = 0
    if _meet(tau, q) or _meet(tau, qd) or _meet(tau, qdd):
        counter[1] = counter[OVERLAP] = 1
        return True
    if plan[layout.LIMITS] > 0:
        for i in range(1 + mails.shape[0]):
            begin(plan, fixed, work[i], min(samples, LANES))
    system, series = System(tree, numbers, columns, plan, fixed), Series(q, qd, qdd, tau, strides, samples)
    for i in range(mails.shape[0]):
        _offer(mails[i], system, series, work[i + 1], counter)
    counter[1] += _blocks(system, series, work[0], counter)
    return collect(plan, fixed, samples, work[: 1 + mails.shape[0]], counter, mails)


@jit_blocks
def collect(plan, fixed, samples, work, counter, mails):
    """Collect the answers of helpers that `torque_blocks` left at work; return True if all have ended [-].

    Then blocks in doubt are counted, and it is said whether the motion is.
    """
    if not settled(mails, address(counter), counter[1:]):
        return False
    if plan[layout.LIMITS] > 0:
        for i in range((samples + LANES - np.uint64(1)) // LANES):
            counter[2] += counter[CALL_CELLS + i]
        counter[3] = 1 if unclear(plan, fixed, work, min(samples, LANES)) else 0
    return True


HELPERS = Helpers(attend)
