"""Samples of the march in a plane, written in space: the histories of a trajectory (compiled)."""

from __future__ import annotations

from typing import NamedTuple

from flexinv.elements.planar_beam import N1, N2, M, dissipated, energy, point
from flexinv.kernels.jit import jit_inner
from flexinv.kernels.records import by_address
from flexinv.kernels.simd import cos_sin
from flexinv.kernels.vec3 import dot, put, vec
from flexinv.typing import Array


@by_address
class Embedding(NamedTuple):
    """Embedding of the plane in space.

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


@jit_inner
def record(sample, system, out):
    """Write one instant of a `stepper.PlanarSystem` into the histories, in space [m, rad, s, N, J]."""
    tree, elements, constraints, space = system.tree, system.elements, system.constraints, system.space
    frames, work = system.frames, system.work
    for n in range(len(tree.parent)):
        _embed(space.axes, frames.pose[n], space.height, out.x[sample, n])
        _embed(space.axes, frames.rate[n], 0.0, out.v[sample, n])
        _embed(space.axes, frames.acceleration[n], 0.0, out.a[sample, n])
        _embed(space.axes, frames.wrench[n], 0.0, out.wrench[sample, n])
        c, s = cos_sin(frames.pose[n, 2])
        for i in range(3):
            out.w[sample, n, i] = frames.rate[n, 2] * space.axle[n, i]
            out.al[sample, n, i] = frames.acceleration[n, 2] * space.axle[n, i]
            out.wrench[sample, n, 3 + i] = frames.wrench[n, 2] * space.axle[n, i]
            for j in range(3):
                turned = c * space.across[n, i, j] + s * space.along[n, i, j]
                out.r[sample, n, i, j] = turned + space.normal[n, i, j]
    for r in range(len(constraints.a)):
        out.multipliers[sample, constraints.row[r]] = constraints.multiplier[r]
    power = 0.0
    for n in range(len(elements.order)):
        for i in range(elements.order[n] + 1):
            power += dot(vec(work.felt[n, i]), vec(frames.rate[elements.nodes[n, i]]))
        _resultants(n, elements, space, work.points, out.internal[sample, n])
    stored, lost = energy(elements, work.points), dissipated(elements, work.rates)
    put(out.energy[sample], 0, (stored, power, lost))


@jit_inner
def _embed(axes, vector, height, out):
    """A vector of the plane, and a height above it, in the world."""
    for i in range(3):
        out[i] = axes[i, 0] * vector[0] + axes[i, 1] * vector[1] + axes[i, 2] * height


@jit_inner
def _resultants(element, elements, space, points, internal):
    """Stress resultants of one element in its section frame: n_1 e_1 + n_2 side, m normal."""
    side, axle = space.side[element], space.axle[elements.nodes[element, 0]]
    for g in range(elements.order[element]):
        at = point(element, g, elements.shape.shape[1])
        n1, n2, m = points[at + N1], points[at + N2], points[at + M]
        for i in range(3):
            internal[g, i], internal[g, 3 + i] = n2 * side[i], m * axle[i]
        internal[g, 0] = n1
