"""Marches of scenarios that are alike, one after the other without the interpreter between them (compiled).

Every thread has a work space and takes the next scenario that nobody has taken.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.dynamics.generalized_alpha import SUBSTEPS
from flexinv.dynamics.stepper import CONVERGED, SUDDEN_START
from flexinv.elements.planar_beam import PlanarElements
from flexinv.inverse.trajectory_pass import Given, Moving, Skeleton, second_step_samples
from flexinv.kernels.jit import jit, jit_shared
from flexinv.kernels.record_stack import at
from flexinv.kernels.threads.atomics import take
from flexinv.planar.history import Embedding
from flexinv.planar.stepper import planar_march
from flexinv.planar.tree import PlanarTree, accept
from flexinv.typing import Array


class Designs(NamedTuple):
    """Mechanisms of one structure, stacked; over : (designs, single, 3) of `planar.constraint_rows.PlanarTies`."""

    tree: PlanarTree
    elements: PlanarElements
    space: Embedding
    skeleton: Skeleton
    over: Array


class Tasks(NamedTuple):
    """Scenarios as the kernel reads them: designs, motions and the time grid.

    design, motion : (scenarios,) which design does which motion
    joint : (motions, nodes, 3) q, q', q'' of all joints where they begin [m, rad, s]
    given : (motions, instants, joints, 3) the same of the prescribed ones at all instants, qd : (motions, instants, nv)
    early : (motions, parts, joints, 3) the same where parts of the first steps end, none where no start is sudden
    early_row : (parts,), row : (instants,) of `planar.stepper.planar_march`; time : (instants,) [s]
    none, never : (0, 0, 0), (0,) nothing is applied, nothing brought
    """

    design: NDArray[np.int64]
    motion: NDArray[np.int64]
    joint: Array
    given: Array
    qd: Array
    early: Array
    early_row: NDArray[np.int64]
    row: NDArray[np.int64]
    time: Array
    none: Array
    never: Array


@jit
def march_alike(
    ahead, mine, designs, tasks, scheme, slow, state, frames, factors, work, constraints, line, out, found, ended, left
):
    """March scenarios that nobody has taken yet, and do the second step of each; return how many have come to the end [-].

    scheme, slow : of the steps, and of the parts of the first ones after a sudden start
    ahead : (1,) number of the next; mine : (most,) at most so many, gets their numbers, that of one that failed behind the others
    state, frames, factors, work, constraints, line : work space of a `planar.solver.PlanarMarch` and (nodes, 6)
    out : Histories, found : Found of all scenarios, stacked; ended, left : (scenarios, 3), (scenarios,) what the march returns
    """
    for done in range(len(mine)):
        n = np.int64(take(ahead))
        mine[done] = n
        if n >= len(tasks.design):
            return done
        d, m, h = tasks.design[n], tasks.motion[n], at(out, n)
        for i in range(constraints.over.shape[0]):
            for j in range(3):
                constraints.over[i, j] = designs.over[d, i, j]
        ended[n, 0], ended[n, 1], ended[n, 2], left[n] = _march_one(
            at(designs.tree, d), at(designs.elements, d), constraints, at(designs.space, d), scheme, slow,
            state, frames, factors, work, tasks.joint[m], tasks.given[m], tasks.early[m], tasks.row, tasks.early_row, h,
        )  # fmt: skip
        if ended[n, 0] != CONVERGED:
            return done
        moving = Moving(h.x, h.r, h.v, h.w, h.a, h.al)
        given = Given(h.wrench, h.energy, tasks.none, tasks.none, tasks.never, tasks.qd[m], tasks.time)
        second_step_samples(at(designs.skeleton, d), moving, given, line, at(found, n))
    return len(mine)


@jit_shared
def _march_one(
    tree,
    elements,
    constraints,
    space,
    scheme,
    slow,
    state,
    frames,
    factors,
    work,
    joint,
    given,
    early,
    row,
    early_row,
    out,
):
    """March one scenario, the first steps in parts where its start is sudden; return what `planar.stepper.planar_march` returns.

    An instant that is not reached among the parts is counted down from -1.
    """
    status, instant, count, size = planar_march(
        tree, elements, constraints, space, scheme, state, frames, factors, work, joint, True, given, row, out
    )
    if status != SUDDEN_START:
        return status, instant, count, size
    nowhere, first = joint[:0], 1 + early.shape[0] // SUBSTEPS
    status, instant, count, size = planar_march(
        tree, elements, constraints, space, slow, state, frames, factors, work, nowhere, False, early, early_row, out
    )
    if status != CONVERGED:
        return status, -1 - instant, count, size
    accept(state)
    return planar_march(
        tree,
        elements,
        constraints,
        space,
        scheme,
        state,
        frames,
        factors,
        work,
        nowhere,
        False,
        given[first:],
        row[first:],
        out,
    )
