"""Marches of scenarios that are alike, one after the other without the interpreter between them (compiled).

Every thread has a work space and takes the next scenario that nobody has taken.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.atomics import take
from flexinv.compiled import jit
from flexinv.march import CONVERGED
from flexinv.mechanism import Array
from flexinv.planar_beam import PlanarElements
from flexinv.planar_march import planar_march
from flexinv.planar_record import Embedding
from flexinv.planar_tree import PlanarTree
from flexinv.second_step import Given, Moving, Skeleton, second_step_samples
from flexinv.stacks import at


class Designs(NamedTuple):
    """Mechanisms of one structure, stacked; over : (designs, single, 3) of `planar_ties.PlanarTies`."""

    tree: PlanarTree
    elements: PlanarElements
    space: Embedding
    skeleton: Skeleton
    over: Array


class Tasks(NamedTuple):
    """What the scenarios do.

    design, motion : (scenarios,) which design does which motion
    joint : (motions, nodes, 3) q, q', q'' of all joints where they begin [m, rad, s]
    given : (motions, instants, joints, 3) the same of the prescribed ones at all instants, qd : (motions, instants, nv)
    row : (instants,) of `planar_march.planar_march`; time : (instants,) [s]
    none, never : (0, 0, 0), (0,) nothing is applied, nothing brought
    """

    design: NDArray[np.int64]
    motion: NDArray[np.int64]
    joint: Array
    given: Array
    qd: Array
    row: NDArray[np.int64]
    time: Array
    none: Array
    never: Array


@jit
def march_alike(ahead, mine, designs, tasks, scheme, s, f, q, w, k, line, out, found, ended, left):
    """March scenarios that nobody has taken yet, and do the second step of each; return how many have come to the end [-].

    ahead : (1,) number of the next; mine : (most,) at most so many, gets their numbers, that of one that failed behind the others
    s, f, q, w, k, line : work space of a `planar.PlanarMarch` and (nodes, 6)
    out : Histories, found : Found of all scenarios, stacked; ended, left : (scenarios, 3), (scenarios,) what the march returns
    """
    for done in range(len(mine)):
        n = np.int64(take(ahead))
        mine[done] = n
        if n >= len(tasks.design):
            return done
        d, m, h = tasks.design[n], tasks.motion[n], at(out, n)
        for i in range(k.over.shape[0]):
            for j in range(3):
                k.over[i, j] = designs.over[d, i, j]
        ended[n, 0], ended[n, 1], ended[n, 2], left[n] = planar_march(
            at(designs.tree, d), at(designs.elements, d), k, at(designs.space, d), scheme, s, f, q, w,
            tasks.joint[m], True, tasks.given[m], tasks.row, h,
        )  # fmt: skip
        if ended[n, 0] != CONVERGED:
            return done
        moving = Moving(h.x, h.r, h.v, h.w, h.a, h.al)
        given = Given(h.wrench, h.energy, tasks.none, tasks.none, tasks.never, tasks.qd[m], tasks.time)
        second_step_samples(at(designs.skeleton, d), moving, given, line, at(found, n))
    return len(mine)
