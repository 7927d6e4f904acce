"""Springs and dampers between two points in the march: three rows of the border each (compiled).

The unknown of a row is a component of the force f on the second point (world axes), its equation the law of the spring:

    F - f = 0,    F = -(k (l - l0) + c l') n,   n = d / l,   l' = n . d',   d the vector between the points

so that springs between any two nodes, however stiff, leave the tree's elimination as it is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.closures import attachment_node
from flexinv.compiled import jit_inner
from flexinv.mechanism import Array
from flexinv.mesh import Mesh
from flexinv.rows import gap
from flexinv.ties import UNIT, Ties
from flexinv.vectors import (
    add,
    add_scaled,
    add_to,
    cross,
    dot,
    madd,
    mat,
    mscale,
    msub,
    outer,
    put,
    put_block,
    scale,
    tapply,
    vec,
    vec_at,
)

TINY = float(np.finfo(float).tiny)


class Pulls(NamedTuple):
    """Springs, one row each.

    row : (springs,) first of its three rows in `ties.Ties`, which hold its nodes and lever arms
    stiffness [N/m], rest [m], damping [N s/m] : (springs,)
    slope : (springs, 3, 6) dF/dd and dF/dd' side by side [N/m], [N s/m]
    """

    row: NDArray[np.int64]
    stiffness: Array
    rest: Array
    damping: Array
    slope: Array


def pulls(mesh: Mesh, c: Ties) -> Pulls:
    """Return the springs of a mechanism [N/m], [m], [N s/m] and write their nodes into the last rows of ``c``."""
    springs = mesh.mechanism.springs
    first = len(c.a) - 3 * len(springs)
    for k, spring in enumerate(springs):
        for row in range(first + 3 * k, first + 3 * k + 3):
            c.a[row], c.b[row] = attachment_node(mesh, spring.first), attachment_node(mesh, spring.second)
            c.place_a[row], c.place_b[row] = spring.first.placement.position, spring.second.placement.position
    values = np.array([(s.stiffness, s.rest, s.damping) for s in springs], dtype=float).reshape(-1, 3)
    rows = first + 3 * np.arange(len(springs), dtype=np.int64)
    stiffness, rest, damping = (np.ascontiguousarray(column) for column in values.T)
    return Pulls(rows, stiffness, rest, damping, np.zeros((len(springs), 3, 6)))


@jit_inner
def pull_rows(p, c, f, level):
    """Set value and gradient of the rows of all springs, and the slope of their law; ``level`` of it acts [N], [m]."""
    for k in range(len(p.row)):
        row = p.row[k]
        a, b, place_a, place_b = c.a[row], c.b[row], vec(c.place_a[row]), vec(c.place_b[row])
        d, rate, _ = gap(f, a, b, place_a, place_b)
        length = max(np.sqrt(dot(d, d)), TINY)
        n = scale(1.0 / length, d)
        lengthening = dot(n, rate)
        stiffness, damping = level * p.stiffness[k], level * p.damping[k]
        # pull / l, finite for a spring of no rest length at l = 0
        ratio = stiffness - stiffness * p.rest[k] / length + damping * lengthening / length
        law = scale(-ratio, d)
        # d pull = (k n + c (d' - l' n) / l) . dd + c n . dd'
        by_gap = add_scaled(scale(stiffness - damping * lengthening / length, n), damping / length, rate)
        across = msub(mscale(ratio, UNIT), mscale(ratio, outer(n, n)))
        put_block(p.slope[k], 0, 0, mscale(-1.0, madd(outer(n, by_gap), across)))
        put_block(p.slope[k], 0, 3, mscale(-damping, outer(n, n)))
        ra = mat(f.r[a]) if a >= 0 else UNIT
        rb = mat(f.r[b]) if b >= 0 else UNIT
        for i in range(3):
            c.value[row + i] = law[i] - c.multiplier[row + i]
            put(c.gradient[row + i], 0, scale(-1.0, UNIT[i]))
            put(c.gradient[row + i], 3, scale(-1.0, cross(place_a, tapply(ra, UNIT[i]))))
            put(c.gradient[row + i], 6, UNIT[i])
            put(c.gradient[row + i], 9, cross(place_b, tapply(rb, UNIT[i])))


@jit_inner
def pull_sides(t, p, c, f, d):
    """Set the equations of all springs by the unknowns [N] per unit, with the rates that go with them."""
    for k in range(len(p.row)):
        for i in range(3):
            row = p.row[k] + i
            for j in range(c.across.shape[1]):
                c.across[row, j] = 0.0
            by_gap, by_rate = vec(p.slope[k, i]), vec_at(p.slope[k, i], 3)
            _add_end(t, c.a[row], -1.0, vec(c.place_a[row]), by_gap, by_rate, f, d, c.across[row])
            _add_end(t, c.b[row], 1.0, vec(c.place_b[row]), by_gap, by_rate, f, d, c.across[row])


@jit_inner
def _add_end(t, n, sign, place, by_gap, by_rate, f, d, across):
    """Subtract sign (by_gap . d(x + R p) + by_rate . d(v + R (w x p))) from the row of one end."""
    if n < 0:
        return
    r, o = mat(f.r[n]), t.offset[t.block[n]]
    along, rate = tapply(r, by_gap), tapply(r, by_rate)
    by_turn = add(cross(place, along), cross(cross(vec(f.w[n]), place), rate))
    by_spin = cross(place, rate)
    for k in range(t.size[t.block[n]]):
        moved = dot(by_gap, vec(d.x[n, k])) + dot(by_turn, vec(d.t[n, k]))
        across[o + k] -= sign * (moved + dot(by_rate, vec(d.v[n, k])) + dot(by_spin, vec(d.w[n, k])))


@jit_inner
def turn_arms(t, p, c, f, d, dwrench):
    """Take off dwrench how the moments p x R^T f of the springs' forces turn with their nodes [N m]."""
    for k in range(len(p.row)):
        row = p.row[k]
        force = (c.multiplier[row], c.multiplier[row + 1], c.multiplier[row + 2])
        _turn_arm(t, c.a[row], vec(c.place_a[row]), scale(-1.0, force), f, d, dwrench)
        _turn_arm(t, c.b[row], vec(c.place_b[row]), force, f, d, dwrench)


@jit_inner
def _turn_arm(t, n, place, force, f, d, dwrench):
    if n < 0:
        return
    own = tapply(mat(f.r[n]), force)
    for k in range(t.size[t.block[n]]):
        add_to(dwrench[n, k], 3, cross(place, cross(vec(d.t[n, k]), own)))
