"""Closed loops in one plane: the formulas of `loop_bodies` and `loop_allocation` restricted to what is not zero there.

All joints turn about z, the root's axis, or slide across it.  A body's axes are its heading (c, s); with r the arm from the
parent's place:

    v = v_parent + w_parent (-r_y, r_x)      a = a_parent + al_parent (-r_y, r_x) - w_parent^2 r
    turn              w = w_parent + qd      al = al_parent + qdd
    slide along d     v + qd d               a + qdd d + 2 w_parent qd (-d_y, d_x),     r + q d  for r

and a joint moves the point of B by (-(y_B - y), x_B - x), or d.  Rows stand where those of space do.
"""

from __future__ import annotations

import numpy as np

from flexinv.kernels.jit import jit_lane, jit_lanes
from flexinv.kernels.simd import LANES, put_vec, row
from flexinv.rnea.loop_allocation import clear, coupled, geared, hold
from flexinv.rnea.loop_layout import (
    ABOVE,
    AT,
    AXES,
    AXES_A,
    AXES_B,
    AXIS,
    BODIES,
    BODY_CELLS,
    CLOSURE_CELLS,
    CLOSURES,
    COLUMN_CELLS,
    CONSTANTS,
    COUNT,
    COUPLED,
    DIRECTION,
    ENTRIES,
    FIRST,
    GEARED,
    JOINT,
    KEPT,
    NUMBERS,
    OWN,
    PLANE_ACCELERATION,
    PLANE_ROWS,
    POINT,
    ROOT_TURN,
    ROWS,
    SIGNS,
    SLIDE,
    SLIDING,
    SPEED,
    SPIN,
    SPIN_RATE,
    SQUARES,
    TO,
    VECTOR,
    VECTORS,
)
from flexinv.rnea.recursion import COS, PLACE, RATE, SIN

_BODY, _COLUMN = row(PLANE_ROWS), row(4)


@jit_lane
def _pair(rows, first, k):
    """Lane k of two rows."""
    return rows[first + k], rows[first + LANES + k]


@jit_lane
def _put(own, k, heading, at, v, w, al, a):
    own[AXES + k], own[AXES + LANES + k] = heading
    own[AT + k], own[AT + LANES + k] = at
    own[SPEED + k], own[SPEED + LANES + k] = v
    own[SPIN + k], own[SPIN_RATE + k] = w, al
    own[PLANE_ACCELERATION + k], own[PLANE_ACCELERATION + LANES + k] = a


@jit_lane
def _turned(c, s, v):
    """A vector turned by an angle of cosine c and sine s."""
    return c * v[0] - s * v[1], s * v[0] + c * v[1]


@jit_lane
def _moved(body, k, arm):
    """Place, velocity and acceleration of a point of a body, its arm in the axes of the body."""
    c, s = _pair(body, AXES, k)
    (x, y), w, al = _turned(c, s, arm), body[SPIN + k], body[SPIN_RATE + k]
    at, v, a = _pair(body, AT, k), _pair(body, SPEED, k), _pair(body, PLANE_ACCELERATION, k)
    return (
        (at[0] + x, at[1] + y),
        (v[0] - w * y, v[1] + w * x),
        (a[0] - al * y - w * w * x, a[1] + al * x - w * w * y),
    )


@jit_lanes
def _from_root(own, rows, lanes, c):
    """A body that turns, fixed in the root."""
    zero, at = (c[0], c[1]), (c[9], c[10])
    for k in range(lanes):
        heading = _turned(rows[COS + k], rows[SIN + k], zero)
        _put(own, k, heading, at, (0.0, 0.0), rows[RATE + k], own[KEPT + k], (0.0, 0.0))


@jit_lanes
def _turn(own, parent, rows, lanes, c):
    """A body that turns."""
    zero, arm = (c[0], c[1]), (c[9], c[10])
    for k in range(lanes):
        at, v, a = _moved(parent, k, arm)
        cosine, sine = _pair(parent, AXES, k)
        heading = _turned(rows[COS + k], rows[SIN + k], _turned(cosine, sine, zero))
        _put(own, k, heading, at, v, parent[SPIN + k] + rows[RATE + k], parent[SPIN_RATE + k] + own[KEPT + k], a)


@jit_lanes
def _slide(own, parent, rows, lanes, c):
    """A body that slides along a direction d of its parent, whose heading it has."""
    along, (px, py) = (c[6], c[7]), (c[9], c[10])
    for k in range(lanes):
        q, rate, second = rows[PLACE + k], rows[RATE + k], own[KEPT + k]
        at, v, a = _moved(parent, k, (px + q * along[0], py + q * along[1]))
        heading, w = _pair(parent, AXES, k), parent[SPIN + k]
        dx, dy = _turned(heading[0], heading[1], along)
        v = v[0] + rate * dx, v[1] + rate * dy
        a = a[0] + second * dx - 2.0 * w * rate * dy, a[1] + second * dy + 2.0 * w * rate * dx
        _put(own, k, heading, at, v, w, parent[SPIN_RATE + k], a)
        own[DIRECTION + k], own[DIRECTION + LANES + k] = dx, dy


@jit_lanes
def _close(a, b, own, lanes, c):
    """The point of B, and the squares of the gap and of its rates."""
    at_a, at_b, scale = (c[0], c[1]), (c[3], c[4]), c[6]
    for k in range(lanes):
        xa, va, aa = _moved(a, k, at_a)
        xb, vb, ab = _moved(b, k, at_b)
        own[POINT + k], own[POINT + LANES + k] = xb
        gap = scale * ((xb[0] - xa[0]) ** 2 + (xb[1] - xa[1]) ** 2)
        rate = (vb[0] - va[0]) ** 2 + (vb[1] - va[1]) ** 2
        put_vec(own, SQUARES, k, (gap, rate, (ab[0] - aa[0]) ** 2 + (ab[1] - aa[1]) ** 2))


@jit_lanes
def _column(to, at, own, lanes, sign):
    """Write the velocity of the point of B per unit rate of a joint, and its square."""
    for k in range(lanes):
        point, place = _pair(own, POINT, k), _pair(at, np.uint64(0), k)
        x, y = sign * (place[1] - point[1]), sign * (point[0] - place[0])
        to[ENTRIES + k], to[ENTRIES + LANES + k] = x, y
        to[k] = x * x + y * y


@jit_lanes
def _column_of_slide(to, direction, lanes, sign):
    """The same of a slide: its direction, whose square is 1."""
    for k in range(lanes):
        x, y = _pair(direction, np.uint64(0), k)
        to[ENTRIES + k], to[ENTRIES + LANES + k] = sign * x, sign * y
        to[k] = sign * sign


@jit_lanes
def _columns(plan, fixed, work, closure, lanes):
    """Set the columns of one closure."""
    own = closure[OWN]
    for j in range(closure[COUNT]):
        column = plan[closure[FIRST] + j * COLUMN_CELLS :]
        axis, place, to, sign = (
            column[AXIS],
            column[JOINT],
            work[column[TO] : column[TO] + _COLUMN],
            fixed[column[SIGNS]],
        )
        if column[0] == GEARED:
            geared(to, lanes, sign)
        elif column[0] == SLIDING:
            _column_of_slide(to, work[axis : axis + VECTOR], lanes, sign)
        else:
            _column(to, work[place : place + VECTOR], work[own : own + VECTOR], lanes, sign)


@jit_lanes
def in_plane(plan, fixed, work, lanes, sums):
    """Set points [m] and G, and hold the squares of the closures."""
    for i in range(plan[BODIES + 1]):
        at = plan[BODIES] + i * BODY_CELLS
        first, above, rows, c = plan[at + OWN], plan[at + ABOVE], plan[at + ROWS], fixed[plan[at + CONSTANTS] :]
        own, parent, rows = work[first : first + _BODY], work[above : above + _BODY], work[rows : rows + _BODY]
        if plan[at] == ROOT_TURN:
            _from_root(own, rows, lanes, c)
        elif plan[at] == SLIDE:
            _slide(own, parent, rows, lanes, c)
        else:
            _turn(own, parent, rows, lanes, c)
    for i in range(plan[CLOSURES + 1]):
        at = plan[CLOSURES] + i * CLOSURE_CELLS
        first, one, other, c = plan[at + OWN], plan[at + AXES_A], plan[at + AXES_B], fixed[plan[at + NUMBERS] :]
        own = work[first : first + VECTORS]
        if plan[at] == COUPLED:
            coupled(plan, fixed, work, own, lanes, plan[at : at + CLOSURE_CELLS], c[0])
        else:
            _close(work[one : one + _BODY], work[other : other + _BODY], own, lanes, c)
    for i in range(plan[CLOSURES + 1]):
        at = plan[CLOSURES] + i * CLOSURE_CELLS
        _columns(plan, fixed, work, plan[at : at + CLOSURE_CELLS], lanes)
        hold(plan, fixed, work, lanes, plan[at : at + CLOSURE_CELLS], sums, False)
    clear(plan, work, lanes)
