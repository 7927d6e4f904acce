"""Closed loops in one plane: the formulas of `loop_bodies` and `loop_allocation` restricted to what is not zero there.

All joints turn about z, the root's axis, or slide across it.  A body's axes are its heading (c, s); with r the arm from the
parent's place:

    v = v_parent + w_parent (-r_y, r_x)      a = a_parent + al_parent (-r_y, r_x) - w_parent^2 r
    turn              w = w_parent + qd      al = al_parent + qdd
    slide along d     v + qd d               a + qdd d + 2 w_parent qd (-d_y, d_x),     r + q d  for r

and a joint moves the point of B by (-(y_B - y), x_B - x), or d.  Rows stand where those of space do.
"""

from __future__ import annotations

from flexinv.kernels.jit import jit_lane, jit_lanes
from flexinv.kernels.simd import LANES, put_vec, row
from flexinv.rnea import loop_layout as layout
from flexinv.rnea.loop_allocation import fill_coupling_columns, update_largest_squares
from flexinv.rnea.recursion import COS, PLACE, RATE, SIN

_PAIR = row(0)


@jit_lane
def _read_pair(rows, first, k):
    """Lane k of two rows."""
    return rows[first + k], rows[first + LANES + k]


@jit_lane
def _write_body_motion(body, k, heading, at, v, w, al, a):
    body[layout.AXES + k], body[layout.AXES + LANES + k] = heading
    body[layout.AT + k], body[layout.AT + LANES + k] = at
    body[layout.PLANE_SPEED + k], body[layout.PLANE_SPEED + LANES + k] = v
    body[layout.PLANE_SPIN + k] = w
    body[layout.PLANE_SPIN_RATE + k] = al
    body[layout.PLANE_ACCELERATION + k], body[layout.PLANE_ACCELERATION + LANES + k] = a


@jit_lane
def _apply_rotation(c, s, v):
    """A vector turned by an angle of cosine c and sine s."""
    return c * v[0] - s * v[1], s * v[0] + c * v[1]


@jit_lane
def _compute_point_motion(body, k, arm):
    """Place, velocity and acceleration of a point of a body, its arm in the axes of the body."""
    c, s = _read_pair(body, layout.AXES, k)
    x, y = _apply_rotation(c, s, arm)
    w = body[layout.PLANE_SPIN + k]
    al = body[layout.PLANE_SPIN_RATE + k]
    at = _read_pair(body, layout.AT, k)
    v = _read_pair(body, layout.PLANE_SPEED, k)
    a = _read_pair(body, layout.PLANE_ACCELERATION, k)
    at = (at[0] + x, at[1] + y)
    v = (v[0] - w * y, v[1] + w * x)
    return at, v, (a[0] - al * y - w * w * x, a[1] + al * x - w * w * y)


@jit_lanes
def _fill_root_revolute(body, rows, lanes, c):
    """A body that turns, fixed in the root."""
    zero = (c[0], c[1])
    at = (c[9], c[10])
    for k in range(lanes):
        heading = _apply_rotation(rows[COS + k], rows[SIN + k], zero)
        _write_body_motion(
            body, k, heading, at, (0.0, 0.0), rows[RATE + k], body[layout.KEPT_ACCELERATION + k], (0.0, 0.0)
        )


@jit_lanes
def _turn(body, parent, rows, lanes, c):
    """A body that turns."""
    zero = (c[0], c[1])
    arm = (c[9], c[10])
    for k in range(lanes):
        at, v, a = _compute_point_motion(parent, k, arm)
        cosine, sine = _read_pair(parent, layout.AXES, k)
        heading = _apply_rotation(rows[COS + k], rows[SIN + k], _apply_rotation(cosine, sine, zero))
        w = parent[layout.PLANE_SPIN + k] + rows[RATE + k]
        al = parent[layout.PLANE_SPIN_RATE + k] + body[layout.KEPT_ACCELERATION + k]
        _write_body_motion(body, k, heading, at, v, w, al, a)


@jit_lanes
def _fill_prismatic(body, parent, rows, lanes, c):
    """A body that slides along a direction d of its parent, whose heading it has."""
    along = (c[6], c[7])
    px = c[9]
    py = c[10]
    for k in range(lanes):
        q = rows[PLACE + k]
        rate = rows[RATE + k]
        second = body[layout.KEPT_ACCELERATION + k]
        at, v, a = _compute_point_motion(parent, k, (px + q * along[0], py + q * along[1]))
        heading = _read_pair(parent, layout.AXES, k)
        w = parent[layout.PLANE_SPIN + k]
        dx, dy = _apply_rotation(heading[0], heading[1], along)
        v = v[0] + rate * dx, v[1] + rate * dy
        a = a[0] + second * dx - 2.0 * w * rate * dy, a[1] + second * dy + 2.0 * w * rate * dx
        _write_body_motion(body, k, heading, at, v, w, parent[layout.PLANE_SPIN_RATE + k], a)
        body[layout.SLIDING_AXIS + k] = dx
        body[layout.SLIDING_AXIS + LANES + k] = dy


@jit_lanes
def _close(a, b, closing, lanes, c):
    """The point of B, and the squares of the gap and of its rates."""
    at_a = (c[0], c[1])
    at_b = (c[3], c[4])
    scale = c[6]
    for k in range(lanes):
        xa, va, aa = _compute_point_motion(a, k, at_a)
        xb, vb, ab = _compute_point_motion(b, k, at_b)
        closing[layout.POINT + k], closing[layout.POINT + LANES + k] = xb
        gap = scale * ((xb[0] - xa[0]) ** 2 + (xb[1] - xa[1]) ** 2)
        rate = (vb[0] - va[0]) ** 2 + (vb[1] - va[1]) ** 2
        put_vec(closing, layout.SQUARES, k, (gap, rate, (ab[0] - aa[0]) ** 2 + (ab[1] - aa[1]) ** 2))


@jit_lanes
def _write_column(to, axis, at, closing, lanes, along, about):
    """Write the velocity of the point of B per unit rate of a joint, along a direction or about its place, and its square.

    What turns has no direction: rows of zeros.
    """
    for k in range(lanes):
        point = _read_pair(closing, layout.POINT, k)
        place = _read_pair(at, _PAIR, k)
        d = _read_pair(axis, _PAIR, k)
        x = along * d[0] + about * (place[1] - point[1])
        y = along * d[1] + about * (point[0] - place[0])
        to[layout.ENTRIES + k] = x
        to[layout.ENTRIES + LANES + k] = y
        to[k] = x * x + y * y


@jit_lanes
def fill_planar_closures(plan, fixed, work, lanes, sums):
    """Set points [m] and G, and hold the squares of the closures."""
    for i in range(plan[layout.BODIES + 1]):
        kind, closing, above, rows, numbers, _ = layout.body_at(plan, i)
        closing = work[closing:]
        parent = work[above:]
        rows = work[rows:]
        c = fixed[numbers:]
        if kind == layout.ROOT_TURN:
            _fill_root_revolute(closing, rows, lanes, c)
        elif kind == layout.SLIDE:
            _fill_prismatic(closing, parent, rows, lanes, c)
        else:
            _turn(closing, parent, rows, lanes, c)
    for i in range(plan[layout.CLOSURE_RECORDS + 1]):
        closure = layout.closure_at(plan, i)
        closing = work[closure.offset :]
        c = fixed[closure.numbers :]
        if closure.kind == layout.COUPLED:
            fill_coupling_columns(plan, fixed, work, closing, lanes, closure, c[0])
        else:
            _close(work[closure.axes_a :], work[closure.axes_b :], closing, lanes, c)
            for j in range(closure.columns):
                column = layout.column_at(plan, closure.first + j)
                to = work[column.to :]
                signs = fixed[column.signs :]
                _write_column(to, work[column.axis :], work[column.joint :], closing, lanes, signs[0], signs[1])
        update_largest_squares(plan, fixed, work, lanes, closure, sums, False)
