"""Blocks of samples through the recursion: from the caller's arrays into lanes, and the efforts back.

A block stays in the cache from its coordinates to its efforts.  Threads share a counter and take the next block from it,
so that one that is held up leaves its work to the others.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexinv.kernels.jit import jit_blocks, jit_lanes
from flexinv.kernels.simd import LANES
from flexinv.kernels.threads import worker_pool
from flexinv.kernels.threads.atomics import fetch, make_float_array, make_integer_array, read_address, take, write_cell
from flexinv.kernels.threads.worker_pool import (
    Helpers,
    collect_answers,
    read_array_word,
    take_mailbox,
    wait_for_offer,
    write_array,
)
from flexinv.rnea import loop_layout as layout
from flexinv.rnea.loop_allocation import convert_efforts, is_unclear
from flexinv.rnea.loop_bodies import begin, copy_accelerations
from flexinv.rnea.loop_plane import fill_planar_closures
from flexinv.rnea.loop_space import fill_spatial_closures
from flexinv.rnea.recursion import NUMBERS, TREE, run_inboard_pass, run_outboard_pass
from flexinv.typing import Array, Unsigned

LINE = np.uint64(8)  # numbers in a line of the cache
# Cells that threads share: the next block; how many samples are not finite; how many blocks of loops are in doubt, whether their
# motion is; whether nothing was done (efforts would be written over what is read); and of every block of loops whether it is.
OVERLAP = 4
CALL_CELLS = 5
_BYTES = np.uint64(8)
# Every which block the sums are taken that the motion of loops is held against: enough to have nearly the largest.
SUMS_EVERY = np.uint64(8)
# Words of an offer: arrays, and the cell of the number of samples.
(
    MAIL_TREE, MAIL_NUMBERS, MAIL_COLUMNS, MAIL_PLAN, MAIL_FIXED, MAIL_Q, MAIL_QD, MAIL_QDD, MAIL_TAU, MAIL_STRIDES, MAIL_WORK,
    MAIL_COUNTER,
) = range(12)  # fmt: skip
MAIL_SAMPLES = worker_pool.WORDS + 24


class TorqueSystem(NamedTuple):
    """A mechanism for the recursion: tree, numbers, columns of `body_table.Bodies`; plan, fixed of `loop_plan.LoopPlan`."""

    tree: Unsigned
    numbers: Array
    columns: Unsigned
    plan: Unsigned
    fixed: Array


class Series(NamedTuple):
    """Motion and efforts of so many samples [rad or m, s], [N m], [N], as of `compute_torque_blocks`."""

    q: Array
    qd: Array
    qdd: Array
    tau: Array
    strides: Unsigned
    samples: np.uint64


@jit_lanes
def _copy_to_rows(work, columns, lanes, x, start, by_sample, by_column):
    """Copy the columns of a block into rows, and fetch those of the next block, where there are more samples than one."""
    if lanes == 1:
        at = start * by_sample
        for j in range(columns.shape[0]):
            work[columns[j]] = x[at + np.uint64(j) * by_column]
        return
    if by_sample == 1:
        for j in range(columns.shape[0]):
            first = columns[j]
            at = start + np.uint64(j) * by_column
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
            first = columns[j] + tile
            of = at + np.uint64(j)
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
        first = columns[j]
        at = start * by_sample + np.uint64(j) * by_column
        for k in range(lanes):
            work[first + k] += x[at + k * by_sample]


@jit_lanes
def _copy_to_columns(work, columns, lanes, x, start, by_sample, by_column):
    """Copy rows to the columns of a block."""
    if by_sample == 1:
        for j in range(columns.shape[0]):
            first = columns[j]
            at = start + np.uint64(j) * by_column
            for k in range(lanes):
                x[at + k] = work[first + k]
        return
    for k in range(lanes):
        at = (start + k) * by_sample
        for j in range(columns.shape[0]):
            x[at + np.uint64(j)] = work[columns[j] + k]


@jit_lanes
def _compute_blocks(system, series, work, counter):
    """Write the efforts of all blocks that are left to take; return how many samples are not finite, or a number above 0
    where cosines and sines are those of no angle."""
    tree, numbers, columns, plan, fixed = system
    q, qd, qdd, tau, strides, samples = series
    nv = tree[0, 0]
    wrong = 0
    nq = columns.shape[0] - 2 * nv
    for_q = columns[:nq]
    for_qd = columns[nq : nq + nv]
    for_qdd = columns[nq + nv :]
    loops = plan[layout.LIMITS] > 0
    block = take(counter)
    again = False
    while True:
        start = block * LANES
        if start >= samples:
            return wrong
        lanes = min(LANES, samples - start)
        _copy_to_rows(work, for_q, lanes, q, start, strides[0, 0], strides[0, 1])
        _copy_to_rows(work, for_qd, lanes, qd, start, strides[1, 0], strides[1, 1])
        _copy_to_rows(work, for_qdd, lanes, qdd, start, strides[2, 0], strides[2, 1])
        if loops and not again:
            copy_accelerations(plan, work, lanes, layout.KEEPS)
            if block % SUMS_EVERY == 0:
                copy_accelerations(plan, work, lanes, layout.SUMMED)
        lost = run_outboard_pass(tree, numbers, work, lanes)
        spoilt = max(run_inboard_pass(tree, numbers, work, lanes), min(lost, 1))
        if loops:
            if plan[layout.APPLIED] > 0:  # efforts of springs and given forces stand where the efforts go
                _add(work, for_qdd, lanes, tau, start, strides[3, 0], strides[3, 1])
            doubts = 0
            if not again:  # the efforts of the cut tree become those of the drives
                if plan[layout.PLANE] > 0:
                    fill_planar_closures(plan, fixed, work, lanes, block % SUMS_EVERY == 0)
                else:
                    doubts += fill_spatial_closures(plan, fixed, work, lanes, block % SUMS_EVERY == 0)
                doubts += convert_efforts(plan, fixed, work, lanes)
            counter[CALL_CELLS + block] = 1 if doubts > 0 or again else 0
            again = doubts > 0
            if again:  # once more, without its loops
                continue
        _copy_to_columns(work, for_qdd, lanes, tau, start, strides[3, 0], strides[3, 1])
        wrong += spoilt
        block = take(counter)


@jit_lanes
def _send_offer(mail, system, series, work, counter):
    """Offer a helper to take blocks, too."""
    if not take_mailbox(mail, read_address(counter)):
        return
    write_array(mail, MAIL_TREE, system.tree)
    write_array(mail, MAIL_NUMBERS, system.numbers)
    write_array(mail, MAIL_COLUMNS, system.columns)
    write_array(mail, MAIL_Q, series.q)
    write_array(mail, MAIL_QD, series.qd)
    write_array(mail, MAIL_QDD, series.qdd)
    write_array(mail, MAIL_TAU, series.tau)
    write_array(mail, MAIL_STRIDES, series.strides)
    write_array(mail, MAIL_WORK, work)
    write_array(mail, MAIL_COUNTER, counter)
    write_array(mail, MAIL_PLAN, system.plan)
    write_array(mail, MAIL_FIXED, system.fixed)
    mail[MAIL_SAMPLES] = series.samples
    write_cell(mail, worker_pool.STATE, worker_pool.OFFERED)


@jit_blocks
def run_helper(mail, patience):
    """Take blocks for whoever offers, until no offer comes for so many looks [-]; the mail then says that its helper sleeps."""
    while wait_for_offer(mail, patience):
        at, (size,) = read_array_word(mail, MAIL_TREE)
        tree = make_integer_array(at, (size // TREE, TREE))
        at, (size,) = read_array_word(mail, MAIL_NUMBERS)
        numbers = make_float_array(at, (size // NUMBERS, NUMBERS))
        strides = make_integer_array(read_array_word(mail, MAIL_STRIDES)[0], (4, 2))
        columns = make_integer_array(*read_array_word(mail, MAIL_COLUMNS))
        plan = make_integer_array(*read_array_word(mail, MAIL_PLAN))
        fixed = make_float_array(*read_array_word(mail, MAIL_FIXED))
        tau = make_float_array(*read_array_word(mail, MAIL_TAU))
        q = make_float_array(*read_array_word(mail, MAIL_Q))
        qd = make_float_array(*read_array_word(mail, MAIL_QD))
        qdd = make_float_array(*read_array_word(mail, MAIL_QDD))
        samples = mail[MAIL_SAMPLES]
        system = TorqueSystem(tree, numbers, columns, plan, fixed)
        series = Series(q, qd, qdd, tau, strides, samples)
        work = make_float_array(*read_array_word(mail, MAIL_WORK))
        counter = make_integer_array(*read_array_word(mail, MAIL_COUNTER))
        mail[worker_pool.ANSWER] = _compute_blocks(system, series, work, counter)
        write_cell(mail, worker_pool.STATE, worker_pool.DONE)
    write_cell(mail, worker_pool.SLEEPS, 1)


@jit_lanes
def _has_overlap(a, b):
    """Return True if two arrays overlap in memory."""
    at = read_address(a)
    to = read_address(b)
    return at < to + _BYTES * np.uint64(b.size) and to < at + _BYTES * np.uint64(a.size)


@jit_blocks
def compute_torque_blocks(tree, numbers, columns, plan, fixed, q, qd, qdd, tau, strides, samples, work, counter, mails):
    """Write the efforts [N m], [N] of all samples; return whether every helper that began has ended.

    tree, numbers, columns : of `body_table.Bodies`; plan, fixed : of `loop_plan.LoopPlan`
    q, qd, qdd, tau : (samples * width,) [rad or m, s], whose ``strides`` (4, 2) of a sample and of a column are (width, 1) or
    (1, samples); where tau has memory in common with what is read nothing is done, and the counter says so
    work : (1 + helpers, size); counter : (CALL_CELLS + blocks of loops,); mails : (helpers, cells)
    """
    counter[:CALL_CELLS] = 0
    if _has_overlap(tau, q) or _has_overlap(tau, qd) or _has_overlap(tau, qdd):
        counter[1] = counter[OVERLAP] = 1
        return True
    if plan[layout.LIMITS] > 0:
        for i in range(1 + mails.shape[0]):
            begin(plan, fixed, work[i], min(samples, LANES))
    system = TorqueSystem(tree, numbers, columns, plan, fixed)
    series = Series(q, qd, qdd, tau, strides, samples)
    for i in range(mails.shape[0]):
        _send_offer(mails[i], system, series, work[i + 1], counter)
    counter[1] += _compute_blocks(system, series, work[0], counter)
    return collect(plan, fixed, samples, work[: 1 + mails.shape[0]], counter, mails)


@jit_blocks
def collect(plan, fixed, samples, work, counter, mails):
    """Collect the answers of helpers that `compute_torque_blocks` left at work; return True if all have ended [-].

    Then blocks in doubt are counted, and it is said whether the motion is.
    """
    if not collect_answers(mails, read_address(counter), counter[1:]):
        return False
    if plan[layout.LIMITS] > 0:
        for i in range((samples + LANES - np.uint64(1)) // LANES):
            counter[2] += counter[CALL_CELLS + i]
        counter[3] = 1 if is_unclear(plan, fixed, work, min(samples, LANES)) else 0
    return True


HELPERS = Helpers(run_helper)
