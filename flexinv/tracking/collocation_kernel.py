"""Many instants of one motion at once: residual of the equation of motion and its derivatives at each of them (compiled)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexinv.dynamics.generalized_alpha import DYNAMIC, Scheme
from flexinv.dynamics.linearization import differentiate
from flexinv.dynamics.loads import set_loads
from flexinv.dynamics.stepper import evaluate, record
from flexinv.dynamics.system import Trajectory
from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.records import by_address
from flexinv.kernels.so3 import inverse_tangent
from flexinv.kernels.vec3 import mat, put, put_block, vec
from flexinv.typing import Array


@by_address
class Motion(NamedTuple):
    """Motion of a mechanism whose joints are all free, as `dynamics.system.State` has it, and the loads.

    x : (samples, nodes, 3), r : (samples, nodes, 3, 3), place, u, du : (samples, unknowns); table : (samples, loads, 6)
    """

    x: Array
    r: Array
    place: Array
    u: Array
    du: Array
    table: Array


@by_address
class Evaluated(NamedTuple):
    """Residuals (samples, unknowns) [N], [N m], derivatives (samples, 3, unknowns, unknowns) K, C, M, and histories.

    reach : (samples, 6, unknowns) of a frame's displacement (world), rotation (own frame)
    Derivatives and reach have no samples where they are not wanted.
    """

    residual: Array
    tangent: Array
    reach: Array
    histories: Trajectory


@jit
def evaluate_instants(system, joints, motion, frame, out):
    """Fill ``out`` (`Evaluated`) [N, m], ``frame`` the node of its reach; return -1, -1 or the instant and its bad element."""
    state, want = system.state, out.tangent.shape[0] > 0
    still = Scheme(DYNAMIC, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for k in range(motion.x.shape[0]):
        _take(state, motion, k)
        set_loads(system.loads, motion.table[k], state.d[:0])
        bad = differentiate(system, joints, out.tangent[k]) if want else evaluate(system, still, joints, False)
        if bad >= 0:
            return k, bad
        for i in range(len(state.d)):
            out.residual[k, i] = system.work.residual[0, i]
        record(k, system.frames, system.work, out.histories)
        if want:
            _reach(system.topology, system.variation, frame, out.reach[k])
    return -1, -1


@jit_inner
def _take(state, motion, k):
    for n in range(motion.x.shape[1]):
        put(state.x[n], 0, vec(motion.x[k, n]))
        put_block(state.r[n], 0, 0, mat(motion.r[k, n]))
    for i in range(len(state.d)):
        state.d[i], state.u[i], state.du[i] = 0.0, motion.u[k, i], motion.du[k, i]
        state.place[i] = motion.place[k, i]


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
