"""Order of elimination of a mesh's nodes: nested dissection, which leaves little fill in a solid.

The nodes are halved across their longest extent, those of one half that the other half touches come last, and what is left of
both is ordered in the same way.  Source: George, *Nested dissection of a regular finite element mesh*, SIAM J. Numer. Anal. 10,
1973.
"""

from __future__ import annotations

import numpy as np

from flexinv.typing import Array, Indices, Sparse

# Nodes that are not halved any more.
FEWEST_HALVED = 40


def list_elimination_order(points: Array, graph: Sparse) -> Indices:
    """Return the order [-] in which points (n, 3) [m] are eliminated; graph : (n, n) sparse, which of them touch [-]."""
    out: list[Indices] = []
    ahead = [np.arange(len(points))]
    while ahead:
        part = ahead.pop()
        if len(part) <= FEWEST_HALVED:
            out.append(part)
            continue
        at = points[part]
        axis = int(np.ptp(at, axis=0).argmax())
        low = at[:, axis] < np.median(at[:, axis])
        if low.sum() < FEWEST_HALVED // 4:  # nearly all in one plane
            out.append(part)
            continue
        first = part[low]
        second = part[~low]
        touched = np.diff(graph[first][:, second].tocsr().indptr) > 0
        out.append(first[touched])
        ahead += [first[~touched], second]
    return np.concatenate(out[::-1])
