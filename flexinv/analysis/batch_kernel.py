"""Marches of scenarios that are alike, one after the other without the interpreter between them (compiled)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexinv.dynamics.generalized_alpha import SUBSTEPS, Scheme
from flexinv.dynamics.stepper import CONVERGED, SUDDEN_START
from flexinv.dynamics.system import Trajectory
from flexinv.elements.planar_beam import PlanarElements
from flexinv.inverse.nodal_sums import SecondStepArrays, SecondStepInputs, Skeleton, fill_second_step
from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.records import send_by_address, take_record
from flexinv.kernels.threads.atomics import take
from flexinv.kinematics.tree import Frames
from flexinv.planar.stepper import Embedding, PlanarSystem, integrate_planar_motion
from flexinv.planar.tree import PlanarTree, begin_from_state
from flexinv.typing import Array, Indices


@send_by_address
class Designs(NamedTuple):
    """Mechanisms of one structure, stacked; over : (designs, single, 3) of `planar.index1.BlockMasses`."""

    tree: PlanarTree
    elements: PlanarElements
    space: Embedding
    skeleton: Skeleton
    over: Array


@send_by_address
class Tasks(NamedTuple):
    """Scenarios as the kernel reads them: designs, motions and the time grid.

    design, motion : (scenarios,) which design does which motion
    joint : (motions, nodes, 3) q, q', q'' of all joints where they begin [m, rad, s]
    prescribed_motion : (motions, instants, joints, 3) the same of the prescribed ones at all instants, qd : (motions,
        instants, nv)
    early : (motions, parts, joints, 3) the same where parts of the first steps end, none where no start is sudden
    early_row : (parts,), row : (instants,) of `planar.stepper.planar_march`; time : (instants,) [s]
    none, never : (0, 0, 0), (0,) nothing is applied, nothing brought
    scheme, first_scheme : of the steps, and of the parts of the first ones after a sudden start
    """

    design: Indices
    motion: Indices
    joint: Array
    prescribed_motion: Array
    qd: Array
    early: Array
    early_row: Indices
    row: Indices
    time: Array
    none: Array
    never: Array
    scheme: Scheme
    first_scheme: Scheme


@send_by_address
class Results(NamedTuple):
    """Results of all scenarios, stacked: histories, second steps, and what the march returns, (scenarios, 3) and (scenarios,)."""

    histories: Trajectory
    second_step: SecondStepArrays
    ended: Indices
    left: Array


@jit
def integrate_scenarios(ahead, mine, designs, tasks, room, line, results):
    """March scenarios that nobody has taken yet, and do the second step of each; return how many have come to the end [-].

    ahead : (1,) number of the next; mine : (most,) at most so many, gets their numbers, that of one that failed behind the others
    room, line : the work space of a thread, `planar.solver.PlanarMarch.system` and (nodes, 6)
    """
    for done in range(len(mine)):
        n = np.int64(take(ahead))
        mine[done] = n
        if n >= len(tasks.design):
            return done
        d = tasks.design[n]
        m = tasks.motion[n]
        h = take_record(results.histories, n)
        for i in range(room.masses.over.shape[0]):
            for j in range(3):
                room.masses.over[i, j] = designs.over[d, i, j]
        system = PlanarSystem(
            take_record(designs.tree, d), take_record(designs.elements, d), room.ties, room.masses, take_record(designs.space, d),
            room.state, room.frames, room.factors, room.work,
        )  # fmt: skip
        ended = results.ended[n]
        ended[0], ended[1], ended[2], results.left[n] = _integrate_scenario(system, tasks, m, h)
        if ended[0] != CONVERGED:
            return done
        moving = Frames(h.x, h.r, h.v, h.w, h.a, h.al)
        second_step_inputs = SecondStepInputs(
            h.wrench, h.energy, tasks.none, tasks.none, tasks.never, tasks.qd[m], tasks.time
        )
        fill_second_step(
            take_record(designs.skeleton, d), moving, second_step_inputs, line, take_record(results.second_step, n)
        )
    return len(mine)


@jit_inner
def _integrate_scenario(system, tasks, motion, out):
    """March one scenario, the first steps in parts where its start is sudden; return what `planar.stepper.planar_march` returns.

    An instant that is not reached among the parts is counted down from -1.
    """
    joint = tasks.joint[motion]
    given = tasks.prescribed_motion[motion]
    early = tasks.early[motion]
    status, instant, count, size = integrate_planar_motion(system, tasks.scheme, joint, True, given, tasks.row, out)
    if status != SUDDEN_START:
        return status, instant, count, size
    nowhere = joint[:0]
    first = 1 + early.shape[0] // SUBSTEPS
    status, instant, count, size = integrate_planar_motion(
        system, tasks.first_scheme, nowhere, False, early, tasks.early_row, out
    )
    if status != CONVERGED:
        return status, -1 - instant, count, size
    begin_from_state(system.state)
    return integrate_planar_motion(system, tasks.scheme, nowhere, False, given[first:], tasks.row[first:], out)
