"""Many instants of one motion at once: residual of the equation of motion and its derivatives at each of them (compiled).

At a given pose, velocity u and acceleration u' of the march's unknowns (`assembly`)

    r(y, u, u') = inertia + elastic forces - loads,       K = dr/dy,   C = dr/du,   M = dr/du'

with y increments of the pose, a rotation's in the node's own frame.  The march's own evaluation gives them: it is affine in
the factors cv = du/dy and ca = du'/dy of its linearisation, so that (0, 0), (1, 0) and (0, 1) give K, K + C and K + M.
"""

from __future__ import annotations

import numpy as np

from flexinv.dynamics.assembly import by_root
from flexinv.dynamics.generalized_alpha import DYNAMIC, Scheme
from flexinv.dynamics.loads import set_loads
from flexinv.dynamics.stepper import evaluate, record
from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.so3 import inverse_tangent
from flexinv.kernels.vec3 import add_scaled, mat, put, put_block, vec, vec_at
from flexinv.typing import Array

# C [1/s] and M [1/s^2] are read off the tangent with a factor so large that K beside it is no more than rounding of nothing: with
# one of 1 it drowned them where motions are fast, in small mechanisms.
LARGE = 1e30


@jit
def evaluate_instants(
    topology, elements, border, state, joints, frames, variation, loads, work,
    given, table, want, residual, tangent, frame, reach, out, wrench, internal, energy,
):  # fmt: skip
    """Fill residuals [N], [N m], derivatives if ``want``, and histories; return -1, -1 or the instant and its bad element.

    given : x (samples, nodes, 3), r (samples, nodes, 3, 3), place, u, du (samples, unknowns) as `assembly.State` has them
    table : (samples, loads, 6); residual : (samples, unknowns); tangent : (3, samples, unknowns, unknowns) K, C, M
    frame : node whose motion is wanted; reach : (samples, 6, unknowns) of its displacement (world), rotation (own frame)
    """
    x, r, place, u, du = given
    for k in range(x.shape[0]):
        _take(state, x[k], r[k], place[k], u[k], du[k])
        set_loads(loads, table[k], state.d[:0])
        for which in range(3 if want else 1):
            c = Scheme(
                DYNAMIC, 0.0, LARGE if which == 1 else 0.0, LARGE if which == 2 else 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            )
            bad = evaluate(topology, elements, border, c, state, joints, frames, variation, loads, work, want)
            if bad >= 0:
                return k, bad
            if want:
                dense_tangent(topology, elements, variation, work, tangent[which, k])
        for i in range(len(state.d)):
            residual[k, i] = work.residual[0, i]
        record(k, frames, work, out, wrench, internal, energy)
        if want:
            _less(tangent, k)
            _reach(topology, variation, frame, reach[k])
    return -1, -1


@jit_inner
def _take(state, x, r, place, u, du):
    for n in range(x.shape[0]):
        put(state.x[n], 0, vec(x[n]))
        put_block(state.r[n], 0, 0, mat(r[n]))
    for i in range(len(state.d)):
        state.d[i], state.u[i], state.du[i], state.place[i] = 0.0, u[i], du[i], place[i]


@jit_inner
def _less(tangent, k):
    """K + LARGE C and K + LARGE M become C and M."""
    for r in range(tangent.shape[2]):
        for c in range(tangent.shape[3]):
            tangent[1, k, r, c] = (tangent[1, k, r, c] - tangent[0, k, r, c]) / LARGE
            tangent[2, k, r, c] = (tangent[2, k, r, c] - tangent[0, k, r, c]) / LARGE


@jit_inner
def _reach(topology, variation, frame, out):
    """Write the Jacobian (6, unknowns) of a node by the unknowns of its block."""
    for r in range(6):
        for c in range(out.shape[1]):
            out[r, c] = 0.0
    o = topology.offset[topology.block[frame]]
    for k in range(topology.size[topology.block[frame]]):
        for i in range(3):
            out[i, o + k] = variation.x[frame, k, i]
            out[3 + i, o + k] = variation.t[frame, k, i]


@jit_inner
def dense_tangent(topology, elements, variation, work, out):
    """Fill the linearisation that was evaluated last as one matrix [N/m], [N], [N m], as `natural_modes.tangent_matrix` does."""
    for r in range(out.shape[0]):
        for c in range(out.shape[1]):
            out[r, c] = 0.0
    for b in range(len(topology.size)):
        o = topology.offset[b]
        for r in range(topology.size[b]):
            for c in range(topology.size[b]):
                out[o + r, o + c] = work.diagonal[b, r, c]
    for k in range(len(elements.order)):
        count = elements.order[k] + 1
        for i in range(count):
            for q in range(count):
                if i != q:
                    _add_coupling(topology, variation, elements.nodes[k], i, q, work.tangent[k], out)


@jit_inner
def _add_coupling(topology, variation, nodes, i, q, tangent, out):
    """Add B_i^T K_iq B_q; the first node moves with all unknowns of its block, every other with its own six."""
    root = nodes[0]
    rows, columns = topology.offset[topology.block[nodes[i]]], topology.offset[topology.block[nodes[q]]]
    for r in range(topology.size[topology.block[root]] if i == 0 else 6):
        by_x, by_t = vec_at(tangent[6 * i + r % 6], 6 * q), vec_at(tangent[6 * i + r % 6], 6 * q + 3)
        if i == 0:
            by_x, by_t = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
            for a in range(3):
                by_x = add_scaled(by_x, variation.x[root, r, a], vec_at(tangent[a], 6 * q))
                by_t = add_scaled(by_t, variation.x[root, r, a], vec_at(tangent[a], 6 * q + 3))
                by_x = add_scaled(by_x, variation.t[root, r, a], vec_at(tangent[3 + a], 6 * q))
                by_t = add_scaled(by_t, variation.t[root, r, a], vec_at(tangent[3 + a], 6 * q + 3))
        if q > 0:
            for a in range(3):
                out[rows + r, columns + a] += by_x[a]
                out[rows + r, columns + 3 + a] += by_t[a]
        else:
            for c in range(topology.size[topology.block[root]]):
                out[rows + r, columns + c] += by_root(tangent, 6 * i + r, root, c, variation)


@jit
def _inverse_many(psi, out):
    for i in range(psi.shape[0]):
        put_block(out[i], 0, 0, inverse_tangent(vec(psi[i])))


def inverse_tangents(psi: Array) -> Array:
    """Return H(psi)^-1, (..., 3, 3) [-], of rotation vectors (..., 3) [rad]: d log(R) = H^-1 times the body increment of R."""
    psi = np.array(psi, dtype=float, order="C")
    out = np.empty((*psi.shape, 3))
    _inverse_many(psi.reshape(-1, 3), out.reshape(-1, 3, 3))
    return out
