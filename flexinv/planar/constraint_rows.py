"""Constraints in a plane: the rows of `dynamics.constraint_rows` that say something there, a border beside the tree (compiled).

With S(theta) a turn in the plane, J (a, b) = (-b, a), arms r = S p and d = x_B + r_B - x_A - r_A, all in the plane's axes:

    position   phi = S_A u . d          direction   phi = S_A u . S_B w

and g the gradient of phi by x, y, theta of both nodes.  With K = the tree's linearisation, G the gradients by the unknowns,

    K y - G^T dlambda = -r,  G y = -phi:      y = y_0 + W dlambda,  W = K^-1 G^T,      (G W) dlambda = -phi - G y_0

W and the factors of G W last as long as the linearisation.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.dynamics.constraint_rows import REDUNDANT_PIVOT, Layout
from flexinv.kernels.block_elimination import Pivots, factorise_blocks, solve_blocks
from flexinv.kernels.jit import jit_inner
from flexinv.kernels.records import by_address
from flexinv.kernels.simd import cos_sin
from flexinv.planar.tree_solver import solve_part
from flexinv.typing import Array


@by_address
class PlanarTies(NamedTuple):
    """Rows of the border of a mechanism in a plane.

    row : (rows,) among those of `dynamics.constraint_rows.Ties`; direction, acting : (rows,); a, b : (rows,) nodes, -1 the world
    place_a, place_b [m], u, w : (rows, 2) in the nodes' frames, seen in the plane where the nodes stand at zero
    multiplier : (rows,) [N], [N m]; value : (rows,) phi or phi''; gradient : (rows, 6) by the poses of a and b
    sides, moved : (rows, unknowns) G and W; layout : parts of the mechanism that rows have to do with
    border : (rows, rows) G W, pivots : its factors; open : (rows,) -phi - G y; step : (rows,) dlambda
    line : (unknowns,) scratch; single : nodes alone in their block; over : (single, 3) 1/m, 1/m, 1/J, zero where that is infinite
    block : (blocks,) the other blocks of unknowns
    member : (blocks, most) nodes of each, -1 behind the last; mass, weight, left, change (nodes, 3) : scratch
    kept : (rows,) multipliers set aside
    """

    row: NDArray[np.int64]
    direction: NDArray[np.bool_]
    acting: NDArray[np.bool_]
    a: NDArray[np.int64]
    b: NDArray[np.int64]
    place_a: Array
    place_b: Array
    u: Array
    w: Array
    multiplier: Array
    value: Array
    gradient: Array
    sides: Array
    moved: Array
    border: Array
    pivots: Pivots
    layout: Layout
    open: Array
    step: Array
    line: Array
    single: NDArray[np.int64]
    over: Array
    block: NDArray[np.int64]
    member: NDArray[np.int64]
    mass: Array
    weight: Array
    left: NDArray[np.bool_]
    change: Array
    kept: Array


@jit_inner
def any_acts(constraints):
    """Return True if a closure acts [-]."""
    acts = False
    for r in range(len(constraints.a)):
        acts = acts or constraints.acting[r]
    return acts


@jit_inner
def _angle(frames, n):
    """Cosine and sine of how far node n has turned."""
    return cos_sin(frames.pose[n, 2]) if n >= 0 else (1.0, 0.0)


@jit_inner
def _turned(angle, v):
    """A vector that is fixed in a node, in the plane's axes."""
    c, s = angle
    return c * v[0] - s * v[1], s * v[0] + c * v[1]


@jit_inner
def _motion(frames, n):
    """Pose, rates and accelerations of a node, of the world zeros."""
    if n < 0:
        zero = (0.0, 0.0, 0.0)
        return zero, zero, zero
    x, v, a = frames.pose[n], frames.rate[n], frames.acceleration[n]
    return (x[0], x[1], x[2]), (v[0], v[1], v[2]), (a[0], a[1], a[2])


@jit_inner
def _rates(r, spin, change):
    """A vector that turns, with its two rates: r, w J r, al J r - w^2 r."""
    square = spin * spin
    return r, (-spin * r[1], spin * r[0]), (-change * r[1] - square * r[0], change * r[0] - square * r[1])


@jit_inner
def _gap(x, y, arm_a, arm_b, order):
    """d or one of its rates."""
    p, q = x[order], y[order]
    return q[0] + arm_b[order][0] - p[0] - arm_a[order][0], q[1] + arm_b[order][1] - p[1] - arm_a[order][1]


@jit_inner
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1]


@jit_inner
def tie_rows(constraints, frames, rated):
    """Set value and gradient of every constraint [m], [-]: phi, or where ``rated`` phi'' = u''.w + 2 u'.w' + u.w''."""
    on_a, on_b = (1.0, 0.0), (1.0, 0.0)
    for r in range(len(constraints.a)):
        if r == 0 or constraints.a[r] != constraints.a[r - 1] or constraints.b[r] != constraints.b[r - 1]:
            on_a, on_b = _angle(frames, constraints.a[r]), _angle(frames, constraints.b[r])
        if not constraints.acting[r]:
            constraints.value[r] = 0.0
            for i in range(6):
                constraints.gradient[r, i] = 0.0
            continue
        a, b = constraints.a[r], constraints.b[r]
        x, y = _motion(frames, a), _motion(frames, b)
        u = _rates(_turned(on_a, constraints.u[r]), x[1][2], x[2][2])
        if constraints.direction[r]:
            w = _rates(_turned(on_b, constraints.w[r]), y[1][2], y[2][2])
            across = u[0][0] * w[0][1] - u[0][1] * w[0][0]  # J u . w
            _put(constraints.gradient[r], (0.0, 0.0, across), (0.0, 0.0, -across))
        else:
            arm_a = _rates(_turned(on_a, constraints.place_a[r]), x[1][2], x[2][2])
            arm_b = _rates(_turned(on_b, constraints.place_b[r]), y[1][2], y[2][2])
            w = _gap(x, y, arm_a, arm_b, 0), _gap(x, y, arm_a, arm_b, 1), _gap(x, y, arm_a, arm_b, 2)
            (u1, u2), (p1, p2), (q1, q2) = u[0], arm_a[0], arm_b[0]
            across = u1 * w[0][1] - u2 * w[0][0]
            _put(constraints.gradient[r], (-u1, -u2, across - (u2 * p1 - u1 * p2)), (u1, u2, u2 * q1 - u1 * q2))
        constraints.value[r] = _dot(u[2], w[0]) + 2 * _dot(u[1], w[1]) + _dot(u[0], w[2]) if rated else _dot(u[0], w[0])


@jit_inner
def _put(gradient, of_a, of_b):
    for i in range(3):
        gradient[i], gradient[3 + i] = of_a[i], of_b[i]


@jit_inner
def add_ties(constraints, multiplier, wrench):
    """Take the forces of multipliers (rows,), or of their changes, off the wrenches (nodes, 3) of their nodes [N], [N m]."""
    for r in range(len(constraints.a)):
        for i in range(3):
            if constraints.a[r] >= 0:
                wrench[constraints.a[r], i] -= multiplier[r] * constraints.gradient[r, i]
            if constraints.b[r] >= 0:
                wrench[constraints.b[r], i] -= multiplier[r] * constraints.gradient[r, 3 + i]


@jit_inner
def tie_sides(tree, constraints, frames):
    """Set G, the gradients by the unknowns [-], [m], from the variations of the nodes."""
    plan = constraints.layout
    for r in range(len(constraints.a)):
        for n in range(plan.first_part[r], plan.first_part[r + 1]):
            for i in range(plan.span[plan.part[n]], plan.span[plan.part[n] + 1]):
                constraints.sides[r, i] = 0.0
        _add_side(tree, constraints.a[r], frames, constraints.gradient[r], 0, constraints.sides[r])
        _add_side(tree, constraints.b[r], frames, constraints.gradient[r], 3, constraints.sides[r])


@jit_inner
def _add_side(tree, n, frames, gradient, first, side):
    if n < 0:
        return
    block = tree.block[n]
    for c in range(tree.size[block]):
        x = frames.by_pose[n, c]
        along = gradient[first] * x[0] + gradient[first + 1] * x[1] + gradient[first + 2] * x[2]
        side[tree.offset[block] + c] += along


@jit_inner
def factorise_ties(tree, elements, constraints, frames, factors):
    """Find W and the factors of G W with a new linearisation [m/N], [rad/N]."""
    tie_sides(tree, constraints, frames)
    plan = constraints.layout
    for r in range(len(constraints.a)):
        for n in range(plan.first_part[r], plan.first_part[r + 1]):
            part = plan.part[n]
            for i in range(plan.span[part], plan.span[part + 1]):
                constraints.line[i] = -constraints.sides[r, i]
            solve_part(tree, elements, factors, part, constraints.line, constraints.moved[r], True)
    factorise_border(tree, constraints)


@jit_inner
def _along(tree, constraints, r, y):
    """G y of one row: only the blocks of its two nodes have a part in it."""
    total, a, b = 0.0, constraints.a[r], constraints.b[r]
    first = tree.block[a] if a >= 0 else -1
    second = tree.block[b] if b >= 0 else -1
    if first >= 0:
        for i in range(tree.offset[first], tree.offset[first] + tree.size[first]):
            total += constraints.sides[r, i] * y[i]
    if second >= 0 and second != first:
        for i in range(tree.offset[second], tree.offset[second] + tree.size[second]):
            total += constraints.sides[r, i] * y[i]
    return total


@jit_inner
def factorise_border(tree, constraints):
    """Factor G W [m/N], [rad/N]."""
    blocks, m = constraints.layout.blocks, constraints.border
    for e in range(blocks.entry.shape[0]):
        i, j = blocks.entry[e, 0], blocks.entry[e, 1]
        m[i, j] = _along(tree, constraints, i, constraints.moved[j])
    factorise_blocks(m, blocks, REDUNDANT_PIVOT, constraints.pivots)


@jit_inner
def solve_ties(tree, constraints, y):
    """Find dlambda [N], [N m], which `step` takes, and add W dlambda to the increments y (unknowns,) of the tree [m], [rad]."""
    plan = constraints.layout
    for r in range(len(constraints.a)):
        constraints.open[r] = -constraints.value[r] - _along(tree, constraints, r, y)
    solve_blocks(constraints.border, plan.blocks, constraints.pivots, constraints.open, constraints.step)
    for r in range(len(constraints.a)):
        for n in range(plan.first_part[r], plan.first_part[r + 1]):
            for i in range(plan.span[plan.part[n]], plan.span[plan.part[n] + 1]):
                y[i] += constraints.step[r] * constraints.moved[r, i]


@jit_inner
def add_step(constraints):
    """Add dlambda to the multipliers [N], [N m]."""
    for r in range(len(constraints.a)):
        constraints.multiplier[r] += constraints.step[r]


@jit_inner
def keep(constraints):
    """Set the multipliers aside [N], [N m]."""
    for r in range(len(constraints.a)):
        constraints.kept[r] = constraints.multiplier[r]


@jit_inner
def return_to(constraints):
    """Take the multipliers back that `keep` has set aside [N], [N m]."""
    for r in range(len(constraints.a)):
        constraints.multiplier[r] = constraints.kept[r]
