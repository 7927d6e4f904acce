"""Reactions: what closures exert on the links that they tie, from their multipliers."""

from __future__ import annotations

import numpy as np

from flexinv.closures import Rows, end_wrench
from flexinv.mechanism import WORLD, Array
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
        own = rows.closure == index
        second = closure.second.link != WORLD
        end = closure.second if second else closure.first
        part = rows.of(np.arange(len(mesh.mechanism.closures)) == index)
        node = int(part.b[0] if second else part.a[0])
        out[closure.name] = end_wrench(motion, part, multipliers[:, own], node, end.placement)
    return out
