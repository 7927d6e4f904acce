"""Closed loops whose motion is given, one sample a lane: how the bodies of a loop move, whether it is closed, its rows G.

A loop's *root* is the last body that is on both ways from its closure to the ground: what lies before it moves all of the loop
alike.  In axes fixed in the root, from it to both ends of the closure, with the arm r from the parent's place to the joint's:

    x = x_parent + r     v = v_parent + w_parent x r     a = a_parent + al_parent x r + w_parent x (w_parent x r)
    turn about z         w = w_parent + qd z             al = al_parent + qdd z + qd w_parent x z
    slide along z        r + q z  for r                  v + qd z,  a + qdd z + 2 qd w_parent x z

Rows are those of `closures`: position u . d, direction u . w.  Three positions fix a point: then they may be taken along any
axes, here the root's.  A row's entries in G are e . (z x (x_B - x)) or e . z of the joints between the ends, with e = u or w x u;
the end A is taken at the point of B, too, where it is as long as the loop is closed.

Limits: of all rows of a closure together, over their scales, phi^2, phi'^2 and phi''^2.  The sums |G| |qd| and |G| |qdd| +
|phi'' - G qdd| that they are held against are taken of some samples of a block; where that leaves a doubt, `given` looks at all.
"""

from __future__ import annotations

import numpy as np

from flexinv.compiled import jit_lane, jit_lanes
from flexinv.lanes import LANES, into, plus, plus_cross, put_vec, row, times, vec_of
from flexinv.recursion import (
    COS,
    PLACE,
    RATE,
    RATES,
    RATES_TURNING,
    SHIFT,
    SIN,
    TURN_OF,
    TURN_Y,
    TURN_Z,
)

# Rows of a body of a loop: its axes and its place in those of the root, their motion; its joint's accelerations.
AXES, AXIS_Y, AXIS_Z, AT = row(0), row(3), row(6), row(9)
SPEED, SPIN, SPIN_RATE, ACCELERATION, KEPT = row(12), row(15), row(18), row(21), row(24)
KEPT_TURNING = row(27)
DIRECTION = row(27)  # of one that slides
BODY_ROWS = 30
# Rows of a closure: the point of B; the gap and its two rates; squares of phi, phi', phi''; vectors e of rows.
POINT, GAP, GAP_RATE, GAP_RATE_TOO, SQUARES, VECTORS = row(0), row(3), row(6), row(9), row(12), row(15)
CLOSURE_ROWS = 15
_SQUARES_TOO, _SQUARES_LAST = row(13), row(14)
_BODY, VECTOR = row(BODY_ROWS), row(3)
# Of a whole call: the largest squares of every lane; the largest sums, two numbers.
WORST, LARGEST, LIMIT_ROWS = row(0), row(3), 4
# Where a block works: a factor and whether two rows change places; a multiplier; a column's motion of the point.
FACTOR, CHANGED, LAMBDA, MOVED, SCRATCH_ROWS = row(0), row(1), row(2), row(3), 7
# The plan: a header of where its tables begin and how long they are, then the tables.
LIMITS, SCRATCH, KEEPS, ROOTS, BODIES, CLOSURES, COLUMNS, STEPS, FILLS, PLANE, HEADER = (
    0,
    1,
    2,
    4,
    6,
    8,
    10,
    12,
    14,
    16,
    17,
)
BODY_CELLS, CLOSURE_CELLS, COLUMN_CELLS = np.uint64(5), np.uint64(9), np.uint64(10)
ROOT_TURN, TURN, SLIDE, FLOAT = range(4)  # bodies
WHOLE, PARTIAL, COUPLED = range(3)  # closures
TURNING, SLIDING, GEARED = range(3)  # columns
_NONE, _ONE, _TWO = (0.0, 0.0, 0.0), np.uint64(1), np.uint64(2)
_CONSTANTS = np.uint64(12)


@jit_lanes
def cross(a, b):
    """Return a x b [any unit]."""
    return plus_cross(_NONE, a, b)


@jit_lanes
def minus(a, b):
    """Return a - b [any unit]."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@jit_lanes
def dot(a, b):
    """Return a . b [any unit]."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jit_lanes
def _constant(c, first):
    return c[first], c[first + 1], c[first + 2]


@jit_lane
def _axes(body, k):
    """The axes of a body, so that `into` gives a vector of its frame in those of the root."""
    return vec_of(body, AXES, k), vec_of(body, AXIS_Y, k), vec_of(body, AXIS_Z, k)


@jit_lane
def _put(own, k, axes, x, v, w, al, a):
    put_vec(own, AXES, k, axes[0])
    put_vec(own, AXIS_Y, k, axes[1])
    put_vec(own, AXIS_Z, k, axes[2])
    put_vec(own, AT, k, x)
    put_vec(own, SPEED, k, v)
    put_vec(own, SPIN, k, w)
    put_vec(own, SPIN_RATE, k, al)
    put_vec(own, ACCELERATION, k, a)


@jit_lane
def _moved(body, k, arm):
    """Place, velocity and acceleration of a point of a body, its arm in the axes of the root."""
    w, al = vec_of(body, SPIN, k), vec_of(body, SPIN_RATE, k)
    around = cross(w, arm)
    return (
        plus(vec_of(body, AT, k), arm),
        plus(vec_of(body, SPEED, k), around),
        plus_cross(plus_cross(vec_of(body, ACCELERATION, k), al, arm), w, around),
    )


@jit_lane
def _seat(axes, c):
    """The axes at a joint's zero, c : R_parent,body by columns, p."""
    return into(axes, _constant(c, 0)), into(axes, _constant(c, 3)), into(axes, _constant(c, 6))


@jit_lanes
def _turn_from_root(own, rows, lanes, c):
    """A body that turns about z, fixed in the root."""
    x, y, z, at = _constant(c, 0), _constant(c, 3), _constant(c, 6), _constant(c, 9)
    for k in range(lanes):
        cosine, sine = rows[COS + k], rows[SIN + k]
        axes = plus(times(cosine, x), times(sine, y)), plus(times(cosine, y), times(-sine, x)), z
        _put(own, k, axes, at, _NONE, times(rows[RATE + k], z), times(own[KEPT + k], z), _NONE)


@jit_lanes
def _turn(own, parent, rows, lanes, c):
    """A body that turns about z."""
    for k in range(lanes):
        cosine, sine, rate = rows[COS + k], rows[SIN + k], rows[RATE + k]
        above = _axes(parent, k)
        x, y, z = _seat(above, c)
        at, v, a = _moved(parent, k, into(above, _constant(c, 9)))
        w, al = vec_of(parent, SPIN, k), vec_of(parent, SPIN_RATE, k)
        al = plus_cross(plus(al, times(own[KEPT + k], z)), w, times(rate, z))
        axes = plus(times(cosine, x), times(sine, y)), plus(times(cosine, y), times(-sine, x)), z
        _put(own, k, axes, at, v, plus(w, times(rate, z)), al, a)


@jit_lanes
def _slide(own, parent, rows, lanes, c):
    """A body that slides along a direction z of its parent, whose axes it has."""
    for k in range(lanes):
        rate, axes = rows[RATE + k], _axes(parent, k)
        z = into(axes, _constant(c, 6))
        at, v, a = _moved(parent, k, plus(into(axes, _constant(c, 9)), times(rows[PLACE + k], z)))
        w, al = vec_of(parent, SPIN, k), vec_of(parent, SPIN_RATE, k)
        a = plus_cross(plus(a, times(own[KEPT + k], z)), w, times(2.0 * rate, z))
        put_vec(own, DIRECTION, k, z)
        _put(own, k, axes, at, plus(v, times(rate, z)), w, al, a)


@jit_lanes
def _float(own, parent, rows, lanes, c):
    """A body that turns about its origin, which moves too; rates and accelerations are in its own frame."""
    for k in range(lanes):
        above = _axes(parent, k)
        seat = _seat(above, c)
        r = vec_of(rows, TURN_OF, k), vec_of(rows, TURN_Y, k), vec_of(rows, TURN_Z, k)
        axes = (
            into(seat, (r[0][0], r[1][0], r[2][0])),
            into(seat, (r[0][1], r[1][1], r[2][1])),
            into(seat, (r[0][2], r[1][2], r[2][2])),
        )
        at, v, a = _moved(parent, k, plus(into(above, _constant(c, 9)), into(seat, vec_of(rows, SHIFT, k))))
        w, al = vec_of(parent, SPIN, k), vec_of(parent, SPIN_RATE, k)
        vj, wj = vec_of(rows, RATES, k), vec_of(rows, RATES_TURNING, k)
        along, about = into(axes, vj), into(axes, wj)
        a = plus_cross(plus(a, into(axes, plus_cross(vec_of(own, KEPT, k), wj, vj))), w, times(2.0, along))
        al = plus_cross(plus(al, into(axes, vec_of(own, KEPT_TURNING, k))), w, about)
        _put(own, k, axes, at, plus(v, along), plus(w, about), al, a)


@jit_lanes
def keep(plan, work, lanes):
    """Copy the accelerations of the joints of loops, whose rows become efforts [any unit]."""
    first = plan[KEEPS]
    for i in range(plan[KEEPS + 1]):
        source, to = plan[first + _TWO * i], plan[first + _TWO * i + _ONE]
        for k in range(lanes):
            work[to + k] = work[source + k]


@jit_lanes
def begin(plan, fixed, work):
    """Set the rows of the roots [-], and no limits."""
    first = plan[ROOTS]
    for i in range(plan[ROOTS + 1]):
        at, c = plan[first + _TWO * i], fixed[plan[first + _TWO * i + _ONE] :]
        own = work[at : at + _BODY]
        for k in range(LANES):
            axes = _constant(c, 0), _constant(c, 3), _constant(c, 6)
            _put(own, k, axes, _NONE, _NONE, _NONE, _NONE, _NONE)
    limits = work[plan[LIMITS] :]
    for k in range(LARGEST + _TWO):
        limits[k] = 0.0


@jit_lanes
def move(plan, fixed, work, lanes):
    """Carry the motion from the roots to the ends [m, rad, s]."""
    for i in range(plan[BODIES + 1]):
        at = plan[BODIES] + i * BODY_CELLS
        kind, first, above, rows = plan[at], plan[at + _ONE], plan[at + _TWO], plan[at + np.uint64(3)]
        own, parent, rows = work[first : first + _BODY], work[above : above + _BODY], work[rows : rows + _BODY]
        c = fixed[plan[at + np.uint64(4)] : plan[at + np.uint64(4)] + _CONSTANTS]
        if kind == ROOT_TURN:
            _turn_from_root(own, rows, lanes, c)
        elif kind == TURN:
            _turn(own, parent, rows, lanes, c)
        elif kind == SLIDE:
            _slide(own, parent, rows, lanes, c)
        else:
            _float(own, parent, rows, lanes, c)


@jit_lane
def _gap(a, b, k, at_a, at_b):
    """The point of B, d = x_B - x_A and its two rates."""
    xa, va, aa = _moved(a, k, into(_axes(a, k), at_a))
    xb, vb, ab = _moved(b, k, into(_axes(b, k), at_b))
    return xb, minus(xb, xa), minus(vb, va), minus(ab, aa)


@jit_lane
def _square(own, k, phi, rate, second):
    """Add to the squares of a closure."""
    own[SQUARES + k] += phi * phi
    own[_SQUARES_TOO + k] += rate * rate
    own[_SQUARES_LAST + k] += second * second


@jit_lanes
def _whole(a, b, own, lanes, c):
    """Three positions: the point of B, and the squares."""
    at_a, at_b, scale = _constant(c, 0), _constant(c, 3), c[6]
    for k in range(lanes):
        point, d, d1, d2 = _gap(a, b, k, at_a, at_b)
        put_vec(own, POINT, k, point)
        put_vec(own, SQUARES, k, (scale * dot(d, d), dot(d1, d1), dot(d2, d2)))


@jit_lanes
def _partial(a, b, own, lanes, c):
    """Fewer positions, or none: the gap itself."""
    at_a, at_b = _constant(c, 0), _constant(c, 3)
    for k in range(lanes):
        point, d, d1, d2 = _gap(a, b, k, at_a, at_b)
        put_vec(own, POINT, k, point)
        put_vec(own, GAP, k, d)
        put_vec(own, GAP_RATE, k, d1)
        put_vec(own, GAP_RATE_TOO, k, d2)
        put_vec(own, SQUARES, k, _NONE)


@jit_lanes
def _position(a, own, e, lanes, u, scale):
    """phi = u . d of one row, u fixed in A, and e = u."""
    for k in range(lanes):
        w, al = vec_of(a, SPIN, k), vec_of(a, SPIN_RATE, k)
        d, d1, d2 = vec_of(own, GAP, k), vec_of(own, GAP_RATE, k), vec_of(own, GAP_RATE_TOO, k)
        v = into(_axes(a, k), u)
        v1 = cross(w, v)
        v2 = plus_cross(cross(al, v), w, v1)
        second = dot(v2, d) + 2.0 * dot(v1, d1) + dot(v, d2)
        _square(own, k, scale * dot(v, d), dot(v1, d) + dot(v, d1), second)
        put_vec(own, e, k, v)


@jit_lanes
def _direction(a, b, own, e, lanes, u, w):
    """phi = u . w of one row, u fixed in A and w in B: phi' = e . w_AB, phi'' = e . al_AB + e' . w_AB with e = w x u."""
    for k in range(lanes):
        wa, wb = vec_of(a, SPIN, k), vec_of(b, SPIN, k)
        us, ws = into(_axes(a, k), u), into(_axes(b, k), w)
        n, turning = cross(ws, us), minus(wb, wa)
        n1 = plus(cross(cross(wb, ws), us), cross(ws, cross(wa, us)))
        second = dot(n, minus(vec_of(b, SPIN_RATE, k), vec_of(a, SPIN_RATE, k))) + dot(n1, turning)
        _square(own, k, dot(us, ws), dot(n, turning), second)
        put_vec(own, e, k, n)


@jit_lanes
def coupled(plan, fixed, work, own, lanes, columns, count, offset):
    """Set the squares of a coupling, phi = sum gear q - offset [rad], [m]."""
    for k in range(lanes):
        put_vec(own, GAP, k, (-offset, 0.0, 0.0))
        put_vec(own, SQUARES, k, _NONE)
    for j in range(count):
        at = columns + j * COLUMN_CELLS
        gear, place = fixed[plan[at + np.uint64(9)]], plan[at + _ONE]
        rate, kept = plan[at + np.uint64(7)], plan[at + np.uint64(8)]
        for k in range(lanes):
            phi, phi1, phi2 = vec_of(own, GAP, k)
            phi, phi1 = phi + gear * work[place + k], phi1 + gear * work[rate + k]
            put_vec(own, GAP, k, (phi, phi1, phi2 + gear * work[kept + k]))
    for k in range(lanes):
        phi, phi1, phi2 = vec_of(own, GAP, k)
        _square(own, k, phi, phi1, phi2)


@jit_lanes
def close(plan, fixed, work, lanes):
    """Set points [m], vectors [-] and squares of the closures."""
    for i in range(plan[CLOSURES + 1]):
        at = plan[CLOSURES] + i * CLOSURE_CELLS
        kind, first, one, other = plan[at], plan[at + _ONE], plan[at + _TWO], plan[at + np.uint64(3)]
        c, positions, directions = fixed[plan[at + np.uint64(4)] :], plan[at + np.uint64(5)], plan[at + np.uint64(6)]
        own = work[first : first + VECTORS + (positions + directions) * VECTOR]
        a, b = work[one : one + _BODY], work[other : other + _BODY]
        if kind == COUPLED:
            coupled(plan, fixed, work, own, lanes, plan[at + np.uint64(7)], plan[at + np.uint64(8)], c[0])
            continue
        if kind == WHOLE:
            _whole(a, b, own, lanes, c)
        else:
            _partial(a, b, own, lanes, c)
        for j in range(positions):
            u = c[np.uint64(7) + np.uint64(3) * j :]
            _position(a, own, VECTORS + j * VECTOR, lanes, _constant(u, 0), c[6])
        for j in range(directions):
            u = c[np.uint64(7) + np.uint64(3) * positions + np.uint64(6) * j :]
            e = VECTORS + (positions + j) * VECTOR
            _direction(a, b, own, e, lanes, _constant(u, 0), _constant(u, 3))
