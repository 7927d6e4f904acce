"""Point masses of meshed links (`parts.point_masses`) as the march takes them: they slide with the amplitudes and do not turn.

With the amplitudes y of a part, slide U and its derivatives B of a point, against the link frame and along its axes:

    r = r_0 + (U + U(y)) y / 2        U(y) = U + B y        r' = U(y) y'        r'' = U(y) y'' + y' B y'

Numbers of all points stand side by side, so that loops over them are vector instructions.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexinv.kernels.jit import jit_sums
from flexinv.kernels.records import send_by_address
from flexinv.kernels.vec3 import add, add_scaled, apply, cross, mat, put, put_mat, sum3, vec
from flexinv.typing import Array, Indices

# Points of a part are filled up to a multiple of this many by points that have no mass: vector instructions take so many at once.
SIDE_BY_SIDE = 8


@send_by_address
class PartPoints(NamedTuple):
    """Point masses of parts, one part after the other, padded to the largest number of amplitudes.

    first : (parts + 1,) first point of each part; node : (points,) of the mechanism
    row : (parts,) first entry of a part in the tables below: coordinates x of all its points, y, z; stride : (parts,) of each
    place : (entries,) [m] of the undeformed points; slide : (amplitudes, entries) [-]
    bend : (soft, soft, entries) second derivatives of the places [1/m]
    mass : (parts,) of each point of a part [kg]
    product : (parts, amplitudes, 3, 3, amplitudes) sum m U U^T over the undeformed points of a part [kg]
    """

    first: Indices
    node: Indices
    row: Indices
    stride: Indices
    place: Array
    slide: Array
    bend: Array
    mass: Array
    product: Array


@send_by_address
class PointMotion(NamedTuple):
    """Motion of the points against their link frames, along their axes, in tables as those of `PartPoints`.

    slide : (amplitudes, entries) U(y) [-]; rate, change : (soft, entries) B y' [1/s], B y'' [1/s^2]
    place, drift, pull : (entries,) r [m], r' [m/s], r'' [m/s^2]; force : (entries,) m (a - g) [N]
    column : (columns, entries) derivative of the points' forces [N], or of their places [m], by the unknowns of their block
    """

    slide: Array
    rate: Array
    change: Array
    place: Array
    drift: Array
    pull: Array
    force: Array
    column: Array

    @classmethod
    def build_for(cls, points: PartPoints, columns: int) -> PointMotion:
        """Return room [m], [s] for the points of parts in blocks of at most so many columns [-]."""
        entries = len(points.place)
        curved = (len(points.bend), entries)
        of_columns = (columns if entries else 0, entries)
        return cls(
            slide=points.slide.copy(),
            rate=np.zeros(curved),
            change=np.zeros(curved),
            place=np.zeros(entries),
            drift=np.zeros(entries),
            pull=np.zeros(entries),
            force=np.zeros(entries),
            column=np.zeros(of_columns),
        )


@jit_sums
def fill_point_motion(part, shapes, first, state, frames, joints, motion, want_tangent):
    """Set the motion [m, rad, s] of a part's points, ``first`` : the first unknown of its amplitudes [-].

    want_tangent : set also what only the linearisation needs, B y''
    """
    points = shapes.points
    root = shapes.root[part]
    row = points.row[part]
    stride = points.stride[part]
    _fill_bent_slides(part, shapes, first, state, motion)
    if want_tangent:
        _fill_bent_change(part, shapes, first, state, motion)
    _fill_places(part, shapes, first, state, motion)
    x0 = vec(frames.x[root])
    r0 = mat(frames.r[root])
    v0 = vec(frames.v[root])
    w = vec(frames.w[root])
    a0 = vec(frames.a[root])
    al = vec(frames.al[root])
    for i in range(points.first[part + 1] - points.first[part]):
        n = points.node[points.first[part] + i]
        p = take_point(motion.place, row + i, stride)
        dp = take_point(motion.drift, row + i, stride)
        wp = cross(w, p)
        pull = sum3(cross(al, p), cross(w, add_scaled(wp, 2.0, dp)), take_point(motion.pull, row + i, stride))
        put(joints.p[n], p)
        put(frames.x[n], add(x0, apply(r0, p)))
        put_mat(frames.r[n], r0)
        put(frames.v[n], add(v0, apply(r0, add(wp, dp))))
        put(frames.w[n], w)
        put(frames.a[n], add(a0, apply(r0, pull)))
        put(frames.al[n], al)


@jit_sums
def add_scaled_row(factor, row, out):
    """Add ``factor`` times a row to another one [any unit]."""
    for i in range(len(out)):
        out[i] += factor * row[i]


@jit_sums
def find_point_entries(part, points):
    """Return first and last place, the last excluded, of the entries of a part's points in the tables [-]."""
    return points.row[part], points.row[part] + 3 * points.stride[part]


@jit_sums
def take_point(table, at, stride):
    """Return the vector of a point from one row of a table [any unit]; at : entry of its x."""
    return table[at], table[at + stride], table[at + 2 * stride]


@jit_sums
def write_point(table, at, stride, v):
    """Write the vector v of a point into one row of a table [any unit]; at : entry of its x."""
    table[at] = v[0]
    table[at + stride] = v[1]
    table[at + 2 * stride] = v[2]


@jit_sums
def _fill_bent_slides(part, shapes, first, state, motion):
    """Set U(y) and B y' of the softest shapes; U of the others stays as it is."""
    points = shapes.points
    begin, end = find_point_entries(part, points)
    soft = shapes.soft[part]
    for c in range(soft):
        straight = points.slide[c, begin:end]
        slide = motion.slide[c, begin:end]
        rate = motion.rate[c, begin:end]
        for i in range(len(slide)):
            slide[i] = straight[i]
            rate[i] = 0.0
        for j in range(soft):
            bend = points.bend[j, c, begin:end]
            add_scaled_row(state.place[first + j] + state.d[first + j], bend, slide)
            add_scaled_row(state.u[first + j], bend, rate)


@jit_sums
def _fill_bent_change(part, shapes, first, state, motion):
    """Set B y'' of the softest shapes."""
    points = shapes.points
    begin, end = find_point_entries(part, points)
    soft = shapes.soft[part]
    for c in range(soft):
        change = motion.change[c, begin:end]
        change[:] = 0.0
        for j in range(soft):
            add_scaled_row(state.du[first + j], points.bend[j, c, begin:end], change)


@jit_sums
def _fill_places(part, shapes, first, state, motion):
    """Set r, r' and r'' of all points."""
    points = shapes.points
    begin, end = find_point_entries(part, points)
    still = points.place[begin:end]
    place = motion.place[begin:end]
    drift = motion.drift[begin:end]
    pull = motion.pull[begin:end]
    for i in range(len(place)):
        place[i] = still[i]
        drift[i] = 0.0
        pull[i] = 0.0
    for c in range(shapes.size[part]):
        slide = motion.slide[c, begin:end]
        half = 0.5 * (state.place[first + c] + state.d[first + c])
        add_scaled_row(half, points.slide[c, begin:end], place)
        add_scaled_row(half, slide, place)
        add_scaled_row(state.u[first + c], slide, drift)
        add_scaled_row(state.du[first + c], slide, pull)
    for c in range(shapes.soft[part]):
        add_scaled_row(state.u[first + c], motion.rate[c, begin:end], pull)
