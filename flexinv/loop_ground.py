"""Closed loops in space: closures of which one end stands in the world.

The other end, E, turns at w and al and accelerates by a, which the recursion has found in E's axes; gravity makes the world's end
accelerate by -g there.  With m fixed in E and f in the world, which in E's axes turns backwards, f' = -w x f:

    phi = m . f      phi' = w . n      phi'' = al . n + (w . f) (m . w) - w^2 phi            n = m x f
"""

from __future__ import annotations

import numpy as np

from flexinv.compiled import jit_lanes
from flexinv.lanes import into, plus, put_vec, times, vec_of
from flexinv.loop_lanes import acceleration, axes_of, constant, cross, dot, minus, square
from flexinv.loop_layout import GAP_RATE, POINT, SQUARES, VECTOR
from flexinv.recursion import SPIN, SPIN_RATE

_VEC, _NONE, _SIX = np.uint64(0), (0.0, 0.0, 0.0), np.uint64(6)
# Its constants: the point of E, and of the end that stands; the scale; -g; whether E is B; m and f of the directions.
_AT, _THERE, _SCALE, _REST, _IS_B, _PAIRS = (np.uint64(i) for i in (0, 3, 6, 7, 10, 11))


@jit_lanes
def _positions(axes, place, state, own, lanes, c):
    """Three positions: the point of B, the squares of phi and phi''."""
    at, there, scale, rest, is_b = constant(c, _AT), constant(c, _THERE), c[_SCALE], constant(c, _REST), c[_IS_B]
    for k in range(lanes):
        frame = axes_of(axes, k)
        d = minus(plus(vec_of(place, _VEC, k), into(frame, at)), there)
        second = minus(into(frame, acceleration(state, k, at)), rest)
        put_vec(own, POINT, k, plus(there, times(is_b, d)))
        put_vec(own, GAP_RATE, k, _NONE)
        put_vec(own, SQUARES, k, (scale * dot(d, d), 0.0, dot(second, second)))


@jit_lanes
def _direction(e, axes, state, own, lanes, m, f, sign):
    """The squares of one direction, and e = w x u: n where E is B, whose vector is w, else -n."""
    for k in range(lanes):
        x, y, z = axes_of(axes, k)
        w, turned = vec_of(state, SPIN, k), (dot(x, f), dot(y, f), dot(z, f))
        n, phi = cross(m, turned), dot(m, turned)
        second = dot(vec_of(state, SPIN_RATE, k), n) + dot(w, turned) * dot(m, w) - dot(w, w) * phi
        square(own, k, phi, dot(w, n), second)
        put_vec(e, _VEC, k, times(sign, into((x, y, z), n)))


@jit_lanes
def from_ground(axes, place, state, own, vectors, lanes, c, directions):
    """Set the point of B [m], vectors e and squares of such a closure, but for what takes d'."""
    _positions(axes, place, state, own, lanes, c)
    for j in range(directions):
        pair = c[_PAIRS + _SIX * j :]
        m, f, sign = constant(pair, 0), constant(pair, 3), 2.0 * c[_IS_B] - 1.0
        _direction(vectors[j * VECTOR :], axes, state, own, lanes, m, f, sign)
