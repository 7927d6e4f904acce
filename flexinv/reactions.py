"""Reactions: what closures exert on the links that they tie, from their multipliers."""

from __future__ import annotations

import numpy as np

from flexinv.closures import Rows, row_forces
from flexinv.inverse import NodalForces
from flexinv.mechanism import WORLD, Array, Attachment
from flexinv.mesh import Mesh
from flexinv.nodal import NodalMotion


def closure_reactions(mesh: Mesh, motion: NodalMotion, rows: Rows, multipliers: Array) -> dict[str, Array]:
    """Return the wrench of each closure on its second link, at its frame there and in its axes, (samples, 6) [N], [N m].

    multipliers : (samples, rows) of the closures, or of their impulses.  A coupling ties no frames: it has no wrench.
    """
    out = {}
    for index, closure in enumerate(mesh.mechanism.closures):
        if closure.kind == "coupling":
            continue
        own = np.where(rows.closure == index, multipliers, 0.0)
        end, node = (closure.second, 1) if closure.second.link != WORLD else (closure.first, -1)
        out[closure.name] = node * _at_frame(motion, row_forces(motion, rows, own), rows, index, end)
    return out


def _at_frame(motion: NodalMotion, forces: NodalForces, rows: Rows, index: int, end: Attachment) -> Array:
    first = int(np.flatnonzero(rows.closure == index)[0])
    node = int(rows.b[first] if rows.b[first] >= 0 else rows.a[first])
    turn = motion.rotation[:, node] @ end.placement.rotation
    arm = motion.rotation[:, node] @ end.placement.position
    force, moment = forces.force[:, node], forces.moment[:, node]
    at_frame = moment - np.cross(arm, force)
    return np.hstack([np.einsum("sji,sj->si", turn, force), np.einsum("sji,sj->si", turn, at_frame)])
