"""Records of the tangents of a march: states, effects of parameters, scratch and histories."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexinv.dynamics.system import Trajectory
from flexinv.kernels.records import send_by_address
from flexinv.kinematics.tree import Joints
from flexinv.sensitivity.border_tangents import BorderScratch
from flexinv.typing import Array, Indices


@send_by_address
class MarchStates(NamedTuple):
    """States along a march, with all joints as unknowns.

    x, r : (samples, nodes, 3), (samples, nodes, 3, 3) as `dynamics.system.State`; u, du, place : (samples, unknowns) [m, rad, s]
    joints : relative motion of all nodes; table : (samples, loads, 6) given wrenches [N], [N m]
    multiplier : (samples, rows) of closures and forces of springs [N], [N m]; coupling : (samples, rows of closures, 3)
        constants of couplings
    """

    x: Array
    r: Array
    u: Array
    du: Array
    place: Array
    joints: Joints
    table: Array
    multiplier: Array
    coupling: Array


@send_by_address
class StepTurns(NamedTuple):
    """Rotations among the unknowns over each step.

    at : (unknowns,) row of a rotation's first entry in the unknowns, -1 of no rotation; number : (unknowns,) of the rotation
    first : (rotations,) first unknown of each; vector : (samples, rotations, 3) d [rad]
    inverse : (rotations, 3, 3) H(d)^-1 of the present step
    """

    at: Indices
    number: Indices
    first: Indices
    vector: Array
    inverse: Array


@send_by_address
class ParameterInputs(NamedTuple):
    """Effects of parameters from outside.

    given : (3, samples, joints, parameters) derivatives of prescribed unknowns, their rates and accelerations
    pushed : (2, samples, unknowns, columns) dr/dp of the parameters ``column`` (columns,) at the march's accelerations and at
        those that are shown, and shifted : (samples, tips, 3, columns) by how much they move tips, at given unknowns [any unit]
    opened : (2, samples, rows, columns) by how much they open closures, and change the second rate of that
    """

    given: Array
    pushed: Array
    shifted: Array
    opened: Array
    column: Indices


@send_by_address
class TipNodes(NamedTuple):
    """Tips of links: node (tips,), and place (tips, 3) in its frame [m]."""

    node: Indices
    place: Array


@send_by_address
class MarchedFreedoms(NamedTuple):
    """Prescribed unknowns (joints,), those that are marched (marched,), and the place of each among the latter, -1 without.

    role : (unknowns,) GIVEN, MARCHED, or OUT_OF_PLANE of a motion
    """

    prescribed: Indices
    marched: Indices
    order: Indices
    role: Indices


OUT_OF_PLANE = 0
GIVEN = 1
MARCHED = 2


def make_marched_freedoms(size: int, prescribed: Indices, marched: Indices) -> MarchedFreedoms:
    """Return the freedoms of so many unknowns, some of them prescribed and some marched [-]."""
    order = np.full(size, -1, dtype=np.int64)
    order[marched] = np.arange(len(marched))
    role = np.full(size, OUT_OF_PLANE, dtype=np.int64)
    role[prescribed] = GIVEN
    role[marched] = MARCHED
    return MarchedFreedoms(prescribed, marched, order, role)


@send_by_address
class TangentTask(NamedTuple):
    """A march to be differentiated: its states, turns of its steps, effects of parameters, unknowns and tips.

    shown : the states with the accelerations and multipliers of index 1; flat : whether the march was in a plane
    """

    states: MarchStates
    shown: MarchStates
    turns: StepTurns
    inputs: ParameterInputs
    freedoms: MarchedFreedoms
    tips: TipNodes
    flat: bool


@send_by_address
class StepTangents(NamedTuple):
    """Derivatives (unknowns, parameters) of pose, rate, acceleration and the integrator's own acceleration [any unit].

    shown : of the accelerations of index 1, where closures act
    """

    pose: Array
    rate: Array
    acceleration: Array
    pseudo: Array
    shown: Array


@send_by_address
class TangentScratch(NamedTuple):
    """Entries of the linearisation, and the linear system of a step [any unit].

    at : (2, entries) places of the entries of K, stiffness : (entries,) of K
    massive_at : (2, massive entries) places of those of C and M, massive : (4, massive entries), the first row a reference, the
        last what K differs by at accelerations of index 1
    system : (marched, marched + parameters + rows); forces : (unknowns, parameters) of the residual
    """

    at: Indices
    stiffness: Array
    massive_at: Indices
    massive: Array
    system: Array
    forces: Array
    border: BorderScratch


@send_by_address
class TangentHistories(NamedTuple):
    """Derivatives over the samples [any unit].

    effort : (samples, joints, parameters) of those with a motion; tip : (samples, tips, 3, parameters)
    pose : (samples, unknowns, parameters)
    rate, acceleration : (samples or 0, unknowns, parameters), of index 1 where closures act
    multiplier : (samples or 0, rows, parameters) of the closures' forces
    """

    effort: Array
    tip: Array
    pose: Array
    rate: Array
    acceleration: Array
    multiplier: Array


@send_by_address
class ForceRecord(NamedTuple):
    """Forces and places at every sample: residual (samples, unknowns) [N], [N m], and tips (samples, tips, 3) [m].

    pulls : (samples, rows) multipliers, with forces of springs [N]; gradient : (samples, rows, unknowns) G of the closures
    closing : (3, samples, rows) phi and its two rates [m], [-]
    slopes : (2, samples or 0, rows, unknowns) of phi'' by poses and by rates
    trajectory : of nodes, wrenches and resultants, samples or 0
    """

    residual: Array
    tip: Array
    pulls: Array
    gradient: Array
    closing: Array
    slopes: Array
    trajectory: Trajectory
