"""Samples of the march in a plane: what a step leaves is set aside, settled some steps later and written in space (compiled).

Apart from the march: what is done once in a step is small beside an iteration, but its machine code is not.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.compiled import jit_inner, jit_shared
from flexinv.damped_plane import dissipated
from flexinv.lanes import cos_sin
from flexinv.mechanism import Array
from flexinv.planar_beam import N1, N2, M, energy, point
from flexinv.planar_settle import settle
from flexinv.stacks import at

SLOTS = 16  # steps that are written at once


class Shelf(NamedTuple):
    """Where steps stand until they are written (slots, ...); `stacks.at` takes one of them.

    row : (slots,) of the histories, -1 for none; pose, rate, acceleration, wrench (slots, nodes, 3), arm (slots, nodes, 4) as in
        `planar_tree.PlanarFrames`
    residual : (slots, unknowns) what Newton has left [N], [N m]; multiplier : (slots, rows) [N], [N m]
    """

    row: NDArray[np.int64]
    pose: Array
    rate: Array
    acceleration: Array
    wrench: Array
    arm: Array
    residual: Array
    multiplier: Array


class Embedding(NamedTuple):
    """How the plane lies in space.

    axes : (3, 3) columns: the plane's x, y and its normal, in the world; height : of the plane along the normal [m]
    across, along, normal : (nodes, 3, 3) R_W,node = cos(theta) across + sin(theta) along + normal
    axle : (nodes, 3) the normal in the nodes' frames; side : (elements, 3) J e_1 in the section frames
    """

    axes: Array
    height: float
    across: Array
    along: Array
    normal: Array
    axle: Array
    side: Array


class Histories(NamedTuple):
    """Where the samples are written (`solver.Trajectory`).

    x, r, v, w, a, al, wrench, internal, energy, multipliers, iterations
    """

    x: Array
    r: Array
    v: Array
    w: Array
    a: Array
    al: Array
    wrench: Array
    internal: Array
    energy: Array
    multipliers: Array
    iterations: NDArray[np.int64]


@jit_inner
def set_aside(slot, row, e, k, space, f, w, out):
    """Leave a step in its slot, to be written into a row; write there what its elements feel [N], [N m], [J], [W]."""
    w.shelf.row[slot] = row
    for r in range(len(k.multiplier)):
        w.shelf.multiplier[slot, r] = k.multiplier[r]
    if row < 0:
        return
    power = 0.0
    for n in range(len(e.order)):
        for i in range(e.order[n] + 1):
            rate, felt = f.rate[e.nodes[n, i]], w.felt[n, i]
            power += felt[0] * rate[0] + felt[1] * rate[1] + felt[2] * rate[2]
        _resultants(n, e, space, w.points, out.internal[row, n])
    stored, lost = energy(e, w.points), dissipated(e, w.rates)
    out.energy[row, 0], out.energy[row, 1], out.energy[row, 2] = stored, power, lost


@jit_shared
def write(count, t, k, space, shelf, by_pose, settles, out):
    """Write so many steps that were set aside into their rows [m, rad, s, N], settled first where that is asked for.

    by_pose : scratch of `planar_settle.settle`
    """
    for slot in range(count):
        sample = at(shelf, slot)
        if settles:
            settle(t, k, sample, by_pose)
        if sample.row >= 0:
            _write(sample, t, k, space, out)


@jit_inner
def _write(f, t, k, space, out):
    """Write one step into its row, in space [m, rad, s, N]."""
    sample = f.row
    for n in range(len(t.parent)):
        _embed(space.axes, f.pose[n], space.height, out.x[sample, n])
        _embed(space.axes, f.rate[n], 0.0, out.v[sample, n])
        _embed(space.axes, f.acceleration[n], 0.0, out.a[sample, n])
        _embed(space.axes, f.wrench[n], 0.0, out.wrench[sample, n])
        c, s = cos_sin(f.pose[n, 2])
        for i in range(3):
            out.w[sample, n, i] = f.rate[n, 2] * space.axle[n, i]
            out.al[sample, n, i] = f.acceleration[n, 2] * space.axle[n, i]
            out.wrench[sample, n, 3 + i] = f.wrench[n, 2] * space.axle[n, i]
            for j in range(3):
                turned = c * space.across[n, i, j] + s * space.along[n, i, j]
                out.r[sample, n, i, j] = turned + space.normal[n, i, j]
    for r in range(len(k.a)):
        out.multipliers[sample, k.row[r]] = f.multiplier[r]


@jit_inner
def _embed(axes, v, height, out):
    """A vector of the plane, and a height above it, in the world."""
    for i in range(3):
        out[i] = axes[i, 0] * v[0] + axes[i, 1] * v[1] + axes[i, 2] * height


@jit_inner
def _resultants(k, e, space, p, internal):
    """Stress resultants of one element in its section frame: n_1 e_1 + n_2 side, m normal."""
    side, axle = space.side[k], space.axle[e.nodes[k, 0]]
    for g in range(e.order[k]):
        at = point(k, g, e.shape.shape[1])
        n1, n2, m = p[at + N1], p[at + N2], p[at + M]
        for i in range(3):
            internal[g, i], internal[g, 3 + i] = n2 * side[i], m * axle[i]
        internal[g, 0] = n1
