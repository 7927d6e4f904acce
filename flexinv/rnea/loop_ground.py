"""Closed loops in space: closures of which one end stands in the world.

The other end, E, turns at w and al and accelerates by a, which the recursion has found in E's axes; gravity makes the world's end
accelerate by -g there.  With m fixed in E and f in the world, which in E's axes turns backwards, f' = -w x f:

    phi = m . f      phi' = w . n      phi'' = al . n + (w . f) (m . w) - w^2 phi            n = m x f
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flexinv.kernels.jit import jit_lane, jit_lanes
from flexinv.kernels.simd import into, plus, put_vec, times, vec_of
from flexinv.rnea import loop_layout as layout
from flexinv.rnea.loop_bodies import acceleration, axes_of, constant, cross, dot, minus
from flexinv.rnea.recursion import SPIN, SPIN_RATE

_VEC, _THREE, _SIX, _NONE = np.uint64(0), np.uint64(3), np.uint64(6), (0.0, 0.0, 0.0)
# Its constants: the point of E, and of the end that stands; the scale; -g; whether E is B; m and f of the directions.
_AT, _THERE, _SCALE, _REST, _IS_B, _PAIRS = (np.uint64(i) for i in (0, 3, 6, 7, 10, 11))


def _standing(count: int) -> Any:
    """Three positions and so many directions: the point of B, e = w x u, the squares of phi, phi' and phi''.

    e is n where E is B, whose vector is w; else it is -n, and what is given is -m.
    """

    @jit_lane
    def lane(own, axes, place, state, k, c):
        frame, at, there, is_b = axes_of(axes, k), constant(c, _AT), constant(c, _THERE), c[_IS_B]
        (x, y, z), w, al = frame, vec_of(state, SPIN, k), vec_of(state, SPIN_RATE, k)
        d = minus(plus(vec_of(place, _VEC, k), into(frame, at)), there)
        second = minus(into(frame, acceleration(state, k, at)), constant(c, _REST))
        put_vec(own, layout.POINT, k, plus(there, times(is_b, d)))
        put_vec(own, layout.GAP_RATE, k, _NONE)
        squares = c[_SCALE] * dot(d, d), 0.0, dot(second, second)
        for j in range(count):
            m, f = constant(c, _PAIRS + _SIX * np.uint64(j)), constant(c, _PAIRS + _SIX * np.uint64(j) + _THREE)
            f = dot(x, f), dot(y, f), dot(z, f)
            n, phi = cross(m, f), dot(m, f)
            phi1, phi2 = dot(w, n), dot(al, n) + dot(w, f) * dot(m, w) - dot(w, w) * phi
            squares = plus(squares, (phi * phi, phi1 * phi1, phi2 * phi2))
            put_vec(own, layout.VECTORS + np.uint64(j) * layout.VECTOR, k, into(frame, n))
        put_vec(own, layout.SQUARES, k, squares)

    @jit_lanes
    def standing(own, axes, place, state, lanes, c):
        for k in range(lanes):
            lane(own, axes, place, state, k, c)

    return standing


_STANDING_0, _STANDING_1, _STANDING_2, _STANDING_3 = (_standing(count) for count in range(4))


@jit_lanes
def from_ground(own, axes, place, state, lanes, c, directions):
    """Set the point of B [m], vectors e and squares of such a closure, but for what takes d'."""
    if directions == 0:
        _STANDING_0(own, axes, place, state, lanes, c)
    elif directions == 1:
        _STANDING_1(own, axes, place, state, lanes, c)
    elif directions == 2:
        _STANDING_2(own, axes, place, state, lanes, c)
    else:
        _STANDING_3(own, axes, place, state, lanes, c)
