"""Wrenches at the joints of rigid closed loops at one sample, from sums of forces on the cut tree (compiled).

    S tau + G^T lambda = tau_tree          lambda: the multipliers of `allocation_kernel`, least ones where redundant

and what closures do to their nodes goes off the sums on and beyond these.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexinv.constraints.allocation_kernel import AllocatedEfforts, AllocationWork, make_places
from flexinv.constraints.closures import compute_gradient_rounding
from flexinv.constraints.equations import Rows, fill_closure_rows
from flexinv.dynamics.loaded_torques import take_closure_wrenches
from flexinv.inverse.nodal_sums import Drives, add_outboard_forces, fill_projected_efforts
from flexinv.kernels.jit import jit
from flexinv.kernels.records import send_by_address
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.tree import take_sample
from flexinv.typing import Array, Indices


@send_by_address
class LoopSample(NamedTuple):
    """Data and room for the multipliers of one sample.

    rows : constraints that act; drives : joints by node, those without a drive, too; place : of the allocation
    least : (rows, nv) entries of G that are rounding; phi : (rows, 3), g : (1, rows, nv), tree : (1, nv) [N m], [N]
    out : the shares; width : (1,) of the preload, -1 where a rank is in doubt; line : (nodes, 6) [N], [N m]
    """

    rows: Rows
    drives: Drives
    place: AllocationWork
    least: Array
    phi: Array
    g: Array
    tree: Array
    out: AllocatedEfforts
    width: Indices
    line: Array


def build_loop_sample(mesh: Mesh, rows: Rows) -> LoopSample:
    """Return data and room for the constraints ``rows`` of a rigid mechanism [m], [N], [N m]."""
    m = mesh.mechanism
    count = len(rows.closure)
    drives = np.flatnonzero(m.actuated)
    place = make_places(rows.build_fronts(last=m.actuated), count, drives, np.sqrt(m.weights[m.actuated]))
    most = max(len(drives) - max(m.nv - count, 1), 0)
    out = AllocatedEfforts(
        np.zeros((1, m.nv)), np.zeros((1, count)), np.zeros((1, m.nv)), np.zeros((1, m.nv, most)), np.zeros(1)
    )
    law = Drives(mesh.freedoms, mesh.slide, mesh.turn, mesh.build_drive_table())
    least = compute_gradient_rounding(mesh, rows.direction)
    g = np.zeros((1, count, m.nv))
    width = np.zeros(1, dtype=np.int64)
    return LoopSample(
        rows, law, place, least, np.zeros((count, 3)), g, np.zeros((1, m.nv)), out, width, np.zeros((mesh.size, 6))
    )


@jit
def fill_loop_equations(nodes, sample, motion, scratch):
    """Set G and the efforts of the cut tree of one sample [N m], [N], of which `split_samples` finds multipliers.

    motion, scratch : as of `fill_link_wrenches`, which has made the sums
    """
    q, qd, qdd = motion
    _, frames, line = scratch
    now = take_sample(frames, 0)
    sample.out.tau[:] = 0.0
    sample.g[:] = 0.0
    fill_projected_efforts(nodes, sample.drives, now, line, (q[0], qd[0], qdd[0]), sample.tree[0])
    fill_closure_rows(nodes, sample.rows, now, sample.phi, sample.g[0])
    ties = False
    for k in range(sample.g.shape[1]):
        for i in range(sample.g.shape[2]):
            ties = ties or abs(sample.g[0, k, i]) > sample.least[k, i]
    for k in range(sample.g.shape[1]):
        for i in range(sample.g.shape[2]):
            sample.g[0, k, i] = sample.g[0, k, i] / sample.rows.scale[k] if ties else 0.0


@jit
def add_loop_wrenches(nodes, sample, scratch):
    """Take what closures do off the sums on and beyond nodes of `fill_link_wrenches` [N], [N m], once multipliers are found.

    scratch : as there
    """
    _, frames, line = scratch
    now = take_sample(frames, 0)
    for k in range(sample.g.shape[1]):
        sample.out.multipliers[0, k] /= sample.rows.scale[k]
    sample.line[:] = 0.0
    take_closure_wrenches(sample.rows, sample.out.multipliers[0], now, sample.line)
    add_outboard_forces(nodes.parent, now.x, sample.line)
    for n in range(line.shape[0]):
        for i in range(6):
            line[n, i] += sample.line[n, i]
