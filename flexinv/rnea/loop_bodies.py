"""Closed loops whose motion is given, one sample a lane: the poses of a loop's bodies.

A loop's *root* is the last body that is on both ways from its closure to the ground: what lies before it moves all of the loop
alike.  In axes fixed in the root, from it to both ends of the closure, with p the joint's place in its parent's frame:

    x = x_parent + R_parent p            turn about z: R = R_parent R_0 R_z(q)
    slide along d: x = x_parent + R_parent (p + d q), R = R_parent
    screw about z: both, with d = h z of R R_0, h = pitch / (2 pi)

Rates and accelerations of the ends need no second recursion: see `loop_space`.
"""

from __future__ import annotations

import numpy as np

from flexinv.kernels.jit import jit_lane, jit_lanes
from flexinv.kernels.simd import LANES, dot, into, plus, put_vec, row, times, vec_of
from flexinv.kernels.vec3 import mat_at, vec_at
from flexinv.rnea import loop_layout as layout
from flexinv.rnea.recursion import COS, FREE_ROWS, PLACE, SHIFT, SIN, read_orientation

_ONE = np.uint64(1)
_TWO = np.uint64(2)
_THREE = np.uint64(3)
_BODY = row(layout.BODY_ROWS)
_JOINT = row(FREE_ROWS)
_VEC = np.uint64(0)


@jit_lane
def compute_components(axes, v):
    """Return the components of a vector along three axes [any unit]."""
    return dot(axes[0], v), dot(axes[1], v), dot(axes[2], v)


@jit_lane
def read_body_axes(body, k):
    """Return the axes of a body [-], so that `into` gives a vector of its frame in those of the root."""
    return vec_of(body, layout.AXES, k), vec_of(body, layout.AXIS_Y, k), vec_of(body, layout.AXIS_Z, k)


@jit_lane
def add_squares(closing, k, phi, rate, second):
    """Add to the squares of a closure [any unit]."""
    closing[layout.SQUARES + k] += phi * phi
    closing[layout.SQUARES_TOO + k] += rate * rate
    closing[layout.SQUARES_LAST + k] += second * second


@jit_lane
def _write_turned_axes(body, first, k, rows, axes, place):
    """The place, and the axes of a body that turns about the third one, from those where its coordinate is zero."""
    cosine = rows[COS + k]
    sine = rows[SIN + k]
    x, y, z = axes
    put_vec(body, first + layout.AXIS_Z, k, z)
    put_vec(body, first + layout.AT, k, place)
    put_vec(body, first + layout.AXES, k, plus(times(cosine, x), times(sine, y)))
    put_vec(body, first + layout.AXIS_Y, k, plus(times(cosine, y), times(-sine, x)))


@jit_lane
def _compute_zero_axes(axes, c):
    """The axes at a joint's zero, c : R_parent,body by columns."""
    x, y, z = mat_at(c, 0)
    return into(axes, x), into(axes, y), into(axes, z)


@jit_lanes
def _fill_root_revolute(body, rows, lanes, c):
    """A body that turns, fixed in the root."""
    axes = mat_at(c, 0)
    place = vec_at(c, 9)
    for k in range(lanes):
        _write_turned_axes(body, _VEC, k, rows, axes, place)


@jit_lanes
def _turn(body, above, parent, rows, lanes, c):
    """A body that turns about z."""
    p = vec_at(c, 9)
    for k in range(lanes):
        axes = read_body_axes(parent, k)
        _write_turned_axes(
            body, _VEC, k, rows, _compute_zero_axes(axes, c), plus(vec_of(above, _VEC, k), into(axes, p))
        )


@jit_lane
def _compute_tilted_axes(axes, cosine, sine):
    """The axes after a turn about x."""
    x, y, z = axes
    return x, plus(times(cosine, y), times(sine, z)), plus(times(cosine, z), times(-sine, y))


@jit_lanes
def _fill_revolute(body, above, parent, rows, lanes, c):
    """A body that turns about an axis at right angles to x of its parent, R_0 = R_x(tilt)."""
    cosine = c[4]
    sine = c[5]
    p = vec_at(c, 9)
    for k in range(lanes):
        axes = read_body_axes(parent, k)
        _write_turned_axes(
            body, _VEC, k, rows, _compute_tilted_axes(axes, cosine, sine), plus(vec_of(above, _VEC, k), into(axes, p))
        )


@jit_lanes
def _fill_chain_revolute(both, rows, lanes, c):
    """The same where nobody else asks for x and y of the parent, in whose place the rows begin: fewer are in the cache."""
    cosine = c[4]
    sine = c[5]
    p = vec_at(c, 9)
    for k in range(lanes):
        axes = read_body_axes(both, k)
        above = vec_of(both, layout.AT, k)
        _write_turned_axes(
            both, layout.CHAINED, k, rows, _compute_tilted_axes(axes, cosine, sine), plus(above, into(axes, p))
        )


@jit_lanes
def _fill_universal(body, first, rows, lanes, c):
    """A body on a universal joint that is fixed in the root, in one pass: nobody asks for x and y of the body between."""
    x, y, z = mat_at(c, 0)
    place = vec_at(c, 9)
    cosine = c[12]
    sine = c[13]
    for k in range(lanes):
        c1 = first[COS + k]
        s1 = first[SIN + k]
        axes = plus(times(c1, x), times(s1, y)), plus(times(c1, y), times(-s1, x)), z
        _write_turned_axes(body, _VEC, k, rows, _compute_tilted_axes(axes, cosine, sine), place)


@jit_lanes
def _fill_prismatic(body, above, parent, rows, lanes, c):
    """A body that slides along d of its parent."""
    along = vec_at(c, 6)
    p = vec_at(c, 9)
    for k in range(lanes):
        axes = read_body_axes(parent, k)
        d = into(axes, along)
        put_vec(body, layout.SLIDING_AXIS, k, d)
        put_vec(body, layout.AT, k, plus(plus(vec_of(above, _VEC, k), into(axes, p)), times(rows[PLACE + k], d)))


@jit_lanes
def _fill_screw(body, above, parent, rows, lanes, c):
    """A body that turns about z and goes c[12] along it for every radian."""
    _turn(body, above, parent, rows, lanes, c)
    for k in range(lanes):
        advance = times(c[12] * rows[PLACE + k], vec_of(body, layout.AXIS_Z, k))
        put_vec(body, layout.AT, k, plus(vec_of(body, layout.AT, k), advance))


@jit_lanes
def _fill_floating(body, above, parent, rows, lanes, c):
    """A body that turns about its origin, which moves too."""
    p = vec_at(c, 9)
    for k in range(lanes):
        axes = read_body_axes(parent, k)
        zero_axes = _compute_zero_axes(axes, c)
        x, y, z = read_orientation(rows, k)
        put_vec(body, layout.AXES, k, into(zero_axes, (x[0], y[0], z[0])))
        put_vec(body, layout.AXIS_Y, k, into(zero_axes, (x[1], y[1], z[1])))
        put_vec(body, layout.AXIS_Z, k, into(zero_axes, (x[2], y[2], z[2])))
        at = plus(vec_of(above, _VEC, k), into(axes, p))
        put_vec(body, layout.AT, k, plus(at, into(zero_axes, vec_of(rows, SHIFT, k))))


@jit_lanes
def copy_accelerations(plan, work, lanes, which):
    """Copy the accelerations of joints, whose rows become efforts [any unit]; which : cell of the header."""
    first = plan[which]
    for i in range(plan[which + 1]):
        source = plan[first + _TWO * i]
        to = plan[first + _TWO * i + _ONE]
        for k in range(lanes):
            work[to + k] = work[source + k]


@jit_lanes
def begin(plan, fixed, work, lanes):
    """Set the rows that are constant: axes [-], places [m]; and no limits."""
    for i in range(plan[layout.ROOTS + 1]):
        at = plan[layout.ROOTS] + _TWO * i
        origin = work[plan[at] : plan[at] + _BODY]
        c = fixed[plan[at + _ONE] :]
        for k in range(lanes):
            for j in range(0, 12, 3):
                put_vec(origin, np.uint64(j) * LANES, k, vec_at(c, j))
    limits = work[plan[layout.LIMITS] :]
    limits[: layout.LARGEST + _THREE] = 0.0


@jit_lanes
def move(plan, fixed, work, first_body, count, lanes):
    """Carry axes [-] and places [m] from the roots to the ends, for so many bodies of the plan."""
    for i in range(count):
        kind, first, above, rows, numbers, place = layout.body_at(plan, first_body + i)
        body = work[first : first + _BODY]
        parent = work[above : above + _BODY]
        rows = work[rows : rows + _JOINT]
        c = fixed[numbers:]
        origin = work[place : place + layout.VECTOR]
        if kind == layout.ROOT_TURN:
            _fill_root_revolute(body, rows, lanes, c)
        elif kind == layout.CHAIN:
            _fill_chain_revolute(work[above : above + layout.CHAINED + _BODY], rows, lanes, c)
        elif kind == layout.TWO_TURNS:
            _fill_universal(body, work[above : above + _JOINT], rows, lanes, c)
        elif kind == layout.TURN:
            _turn(body, origin, parent, rows, lanes, c)
        elif kind == layout.TILT:
            _fill_revolute(body, origin, parent, rows, lanes, c)
        elif kind == layout.SLIDE:
            _fill_prismatic(body, origin, parent, rows, lanes, c)
        elif kind == layout.SCREW:
            _fill_screw(body, origin, parent, rows, lanes, c)
        elif kind == layout.FLOAT:
            _fill_floating(body, origin, parent, rows, lanes, c)
