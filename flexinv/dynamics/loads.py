"""Forces on points of nodes in the march: given ones, and springs and dampers as rows of the border (compiled).

A dead load keeps its direction in the world, a follower in the node's frame; at a lever arm p (node's frame) it is

    dead      force F, moment about the node (own frame)  R^T M + p x R^T F
    follower  force R F, moment  M + p x F

A spring between two points is three rows of the border.  The unknown of a row is a component of the force f on the second point
(world axes), its equation the law of the spring:

    F - f = 0,    F = -(p + c l') n,   p = k (l - l0),   n = d / l,   l' = n . d',   d the vector between the points

with p by `model.attachments` where the spring has a law: springs between any two nodes, however stiff, leave the tree as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexinv.constraints.equations import compute_gap
from flexinv.dynamics.constraint_rows import Ties, fill_gradient
from flexinv.kernels import vec3
from flexinv.kernels.jit import jit_inner
from flexinv.kernels.records import send_by_address
from flexinv.kernels.vec3 import (
    add,
    add_at,
    add_pair,
    add_scaled,
    add_to,
    apply,
    cross,
    dot,
    mat,
    pair,
    put_block,
    put_mat,
    scale,
    tapply,
    vec,
    vec_at,
)
from flexinv.kinematics.mesh import Mesh, find_attachment_node
from flexinv.model.attachments import GasLaw, Spring, TableLaw
from flexinv.typing import Array, Indices, Mask

TINY = float(np.finfo(float).tiny)
LINEAR = 0
GAS = 1
TABLE = 2


@send_by_address
class Loads(NamedTuple):
    """Loads on points of nodes, one row each.

    node : (loads,); place : (loads, 3) [m] lever arm in the node's frame; follower : (loads,)
    wrench : (loads, 6) force [N] then moment [N m] now, in world axes or a follower's node axes
    effort : (unknowns,) of the drives of torque-driven joints now [N m], [N]
    level : (1,) part of all loads, springs and gravity that acts [-]: 1, less while an equilibrium is approached
    """

    node: Indices
    place: Array
    follower: Mask
    wrench: Array
    effort: Array
    level: Array


def build_loads(mesh: Mesh, unknowns: int) -> Loads:
    """Return the given forces of a mechanism on its links, wrenches [N], [N m] and efforts still zero."""
    forces = [f for f in mesh.mechanism.forces if find_attachment_node(mesh, f.at) >= 0]
    nodes = np.array([find_attachment_node(mesh, f.at) for f in forces], dtype=np.int64)
    place = np.array([f.at.placement.position for f in forces], dtype=float).reshape(-1, 3)
    follower = np.array([f.follower for f in forces], dtype=bool)
    return Loads(nodes, place, follower, np.zeros((len(forces), 6)), np.zeros(unknowns), np.ones(1))


def build_load_table(mesh: Mesh, time: Array) -> Array:
    """Return the wrenches of `build_loads` over ``time`` (samples,) [s], (samples, loads, 6) [N], [N m]."""
    forces = [f for f in mesh.mechanism.forces if find_attachment_node(mesh, f.at) >= 0]
    out = np.zeros((len(time), len(forces), 6))
    for k, force in enumerate(forces):
        out[:, k] = np.stack([np.interp(time, force.time, column) for column in force.wrench.T], axis=1)
        if force.follower:  # from the attachment's axes to the node's
            turn = force.at.placement.rotation
            out[:, k] = np.hstack([out[:, k, :3] @ turn.T, out[:, k, 3:] @ turn.T])
    return out


@jit_inner
def update_loads(loads, wrenches, efforts):
    """Set the wrenches (loads, 6) [N], [N m] and, where there are any, the drives' efforts (unknowns,) [N m], [N]."""
    for k in range(len(loads.node)):
        for i in range(6):
            loads.wrench[k, i] = wrenches[k, i]
    for i in range(len(efforts)):
        loads.effort[i] = efforts[i]


@jit_inner
def add_loads(topology, frames, variation, loads, work, want_tangent):
    """Take the loads off the wrenches of their nodes, and their variation off that of the wrenches [N], [N m]."""
    for k in range(len(loads.node)):
        n = loads.node[k]
        p = vec(loads.place[k])
        r = mat(frames.r[n])
        force, moment = pair(loads.wrench[k])
        force = scale(loads.level[0], force)
        moment = scale(loads.level[0], moment)
        local = force if loads.follower[k] else tapply(r, force)
        turn = moment if loads.follower[k] else tapply(r, moment)
        add_pair(work.wrench[n], scale(-1.0, apply(r, local)), scale(-1.0, add(turn, cross(p, local))))
        for c in range(topology.width[n] if want_tangent else 0):
            theta = vec(variation.t[n, c])
            if loads.follower[k]:
                add_to(work.dwrench[n, c], apply(r, cross(local, theta)))
            else:  # d(R^T F) = R^T F x theta
                add_at(work.dwrench[n, c], 3, add(cross(theta, turn), cross(p, cross(theta, local))))


# -------------------------------------------------------------------------------------- springs


@send_by_address
class SpringLaws(NamedTuple):
    """Laws of springs between points.

    stiffness [N/m], rest [m], damping [N s/m] : (springs,)
    law : (springs,) `LINEAR`, `GAS` or `TABLE` [-]; gas : (springs, 3) force [N], travel [m], exponent [-]
    first, last : (springs,) rows of ``pieces`` [-]; pieces : (rows, 5) as `attachments.TableLaw.list_pieces` [m], [N/m^3] ... [N]
    """

    stiffness: Array
    rest: Array
    damping: Array
    law: Indices
    gas: Array
    first: Indices
    last: Indices
    pieces: Array


def build_spring_laws(springs: Sequence[Spring]) -> SpringLaws:
    """Return the laws of springs [N/m], [m], [N s/m]."""
    values = [(s.stiffness, s.rest, s.damping) for s in springs]
    stiffness, rest, damping = np.array(values, dtype=float).reshape(-1, 3).T.copy()
    laws = [spring.law for spring in springs]
    kind = np.array([LINEAR if x is None else GAS if isinstance(x, GasLaw) else TABLE for x in laws], dtype=np.int64)
    gas = [(x.force, x.travel, x.exponent) if isinstance(x, GasLaw) else (0.0, 1.0, 1.0) for x in laws]
    tables = [x.list_pieces() if isinstance(x, TableLaw) else np.zeros((0, 5)) for x in laws]
    ends = np.cumsum([0, *(len(table) for table in tables)]).astype(np.int64)
    pieces = np.vstack([np.zeros((0, 5)), *tables])
    gases = np.array(gas).reshape(-1, 3)
    return SpringLaws(stiffness, rest, damping, kind, gases, ends[:-1].copy(), ends[1:].copy(), pieces)


@send_by_address
class SpringRows(NamedTuple):
    """Springs, one row each.

    row : (springs,) first of its three rows in `dynamics.constraint_rows.Ties`, which hold its nodes and lever arms
    slope : (springs, 3, 6) dF/dd and dF/dd' side by side [N/m], [N s/m]
    """

    row: Indices
    laws: SpringLaws
    slope: Array


def build_pulls(mesh: Mesh, constraints: Ties) -> SpringRows:
    """Return the springs of a mechanism [N/m], [m], [N s/m], whose rows are the last of ``constraints``."""
    springs = mesh.mechanism.springs
    rows = np.arange(len(constraints.a) - 3 * len(springs), len(constraints.a), 3, dtype=np.int64)
    return SpringRows(rows, build_spring_laws(springs), np.zeros((len(springs), 3, 6)))


@jit_inner
def evaluate_pull(laws, k, length):
    """Return the pull [N] of a spring at a length [m], and its slope [N/m]."""
    if laws.law[k] == GAS:
        force = laws.gas[k, 0]
        travel = laws.gas[k, 1]
        exponent = laws.gas[k, 2]
        left = 1.0 - (length - laws.rest[k]) / travel
        pull = force * left**-exponent
        return pull, pull * exponent / (travel * left)
    if laws.law[k] == TABLE:
        n = laws.first[k]
        while n + 1 < laws.last[k] and laws.pieces[n + 1, 0] <= length:
            n += 1
        c = laws.pieces[n]
        x = length - (laws.pieces[n + 1, 0] if n == laws.first[k] else c[0])
        return ((c[1] * x + c[2]) * x + c[3]) * x + c[4], (3.0 * c[1] * x + 2.0 * c[2]) * x + c[3]
    return laws.stiffness[k] * (length - laws.rest[k]), laws.stiffness[k]


@jit_inner
def evaluate_spring_rows(springs, constraints, frames, level):
    """Set value and gradient of the rows of all springs, and the slope of their law; ``level`` of it acts [N], [m]."""
    laws = springs.laws
    for k in range(len(springs.row)):
        row = springs.row[k]
        places = vec(constraints.place_a[row]), vec(constraints.place_b[row])
        d, rate, _ = compute_gap(frames, constraints.a[row], constraints.b[row], places[0], places[1])
        length = max(np.sqrt(dot(d, d)), TINY)
        n = scale(1.0 / length, d)
        lengthening = dot(n, rate)
        pull, stiffness = evaluate_pull(laws, k, length)
        pull = level * pull
        stiffness = level * stiffness
        damping = level * laws.damping[k]
        # pull / l, finite for a linear spring of no rest length at l = 0
        ratio = pull / length + damping * lengthening / length
        if laws.law[k] == LINEAR:
            ratio = stiffness - stiffness * laws.rest[k] / length + damping * lengthening / length
        law = scale(-ratio, d)
        # d pull = (k n + c (d' - l' n) / l) . dd + c n . dd'
        by_gap = add_scaled(scale(stiffness - damping * lengthening / length, n), damping / length, rate)
        across = vec3.msub(vec3.mscale(ratio, vec3.EYE), vec3.mscale(ratio, vec3.outer(n, n)))
        put_mat(springs.slope[k], vec3.mscale(-1.0, vec3.madd(vec3.outer(n, by_gap), across)))
        put_block(springs.slope[k], 0, 3, vec3.mscale(-damping, vec3.outer(n, n)))
        for i in range(3):
            constraints.value[row + i] = law[i] - constraints.multiplier[row + i]
            fill_gradient(row + i, constraints, frames, vec3.EYE[i], d)


@jit_inner
def fill_spring_sides(topology, springs, constraints, frames, variation):
    """Set the equations of all springs by the unknowns [N] per unit, with the rates that go with them."""
    plan = constraints.layout
    for k in range(len(springs.row)):
        for i in range(3):
            row = springs.row[k] + i
            for n in range(plan.first_part[row], plan.first_part[row + 1]):
                for j in range(plan.begin[n], plan.end[n]):
                    constraints.across[row, j] = 0.0
            a = constraints.a[row]
            b = constraints.b[row]
            for n, place, sign in ((a, constraints.place_a[row], -1.0), (b, constraints.place_b[row], 1.0)):
                _add_end(topology, n, sign, vec(place), springs.slope[k, i], frames, variation, constraints.across[row])


@jit_inner
def _add_end(topology, n, sign, place, slope, frames, variation, across):
    """Subtract sign (by_gap . d(x + R p) + by_rate . d(v + R (w x p))) from the row of one end, slope = (by_gap, by_rate)."""
    if n < 0:
        return
    by_gap, by_rate = pair(slope)
    r = mat(frames.r[n])
    o = topology.first[n]
    along = tapply(r, by_gap)
    rate = tapply(r, by_rate)
    by_turn = add(cross(place, along), cross(cross(vec(frames.w[n]), place), rate))
    by_spin = cross(place, rate)
    for k in range(topology.width[n]):
        moved = dot(by_gap, vec(variation.x[n, k])) + dot(by_turn, vec(variation.t[n, k]))
        across[o + k] -= sign * (moved + dot(by_rate, vec(variation.v[n, k])) + dot(by_spin, vec(variation.w[n, k])))


@jit_inner
def turn_arms(topology, springs, constraints, frames, variation, dwrench):
    """Take off dwrench how the moments p x R^T f of the springs' forces turn with their nodes [N m]."""
    for k in range(len(springs.row)):
        row = springs.row[k]
        a = constraints.a[row]
        b = constraints.b[row]
        for n, place, sign in ((a, constraints.place_a[row], -1.0), (b, constraints.place_b[row], 1.0)):
            if n >= 0:
                local = tapply(mat(frames.r[n]), scale(sign, vec_at(constraints.multiplier, row)))
                for c in range(topology.width[n]):
                    add_at(dwrench[n, c], 3, cross(vec(place), cross(vec(variation.t[n, c]), local)))
