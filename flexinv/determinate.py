"""Which reactions of closures the motion determines, where constraints say more than once what they say.

Multipliers lambda carry the efforts up to the null space of G^T: forces that closures put on each other through the
mechanism without moving it (a planar loop of joints in space presses its closures out of the plane as it likes).  A
component of a closure's wrench is determinate where no such null vector has a part in it, in every phase in which it acts.
What a closure cannot exert (a hinge about its axis) is no reaction: rounding of zero says nothing.
How redundant *drives* share is not free in this sense: they take the least norm, and the reactions are the ones that go with it.
"""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from flexinv.closures import constraint_jacobian, constraint_rows
from flexinv.mechanism import WORLD, Array, Closure
from flexinv.mesh import Mesh
from flexinv.nodal import NodalMotion
from flexinv.phases import Phase, phases
from flexinv.reactions import closing
from flexinv.shares import ranks

# Null vectors have unit length in [N], [N m]; what rounding, enlarged by the condition of G, leaves of a component is below.
NONE = 1e-9
# Of every phase: what is redundant is so all along, but for singular positions.
SAMPLES = 5


def determinate(mesh: Mesh, motion: NodalMotion, time: Array) -> dict[str, NDArray[np.bool_]]:
    """Return closure -> (6,) which components of its reaction [N], [N m] it can exert and the motion and the drives determine.

    time : (samples,) [s] of a uniform grid.  With beams: nodes of beams move by themselves, so that nothing is redundant at
    a closure that holds one; of the others nothing is said (False).
    """
    m = mesh.mechanism
    if not m.is_rigid:
        return {c.name: np.full(6, _on_beam(mesh, c)) for c in m.closures}
    rows = constraint_rows(mesh)
    loose, firm = ({c.name: np.zeros(6) for c in m.closures} for _ in range(2))
    for phase in phases(m, time):
        some = _some(motion, phase)
        g = constraint_jacobian(mesh, some, rows)
        acting = np.flatnonzero(phase.active[rows.closure])
        for k, row in enumerate(acting):
            null, unit = (np.zeros((len(g), len(rows))) for _ in range(2))
            null[:, acting] = _null(g[:, acting], k)
            unit[:, row] = 1.0
            for sizes, part in ((loose, null), (firm, unit)):
                for name, wrench in closing(mesh, some, rows, part)[1].items():
                    sizes[name] = np.maximum(sizes[name], np.abs(wrench).max(axis=0))
    return {c.name: (loose[c.name] < NONE) & (firm[c.name] > NONE) for c in m.closures}


def _some(motion: NodalMotion, phase: Phase) -> NodalMotion:
    """The motion at a few samples of a phase."""
    picked = np.unique(np.linspace(phase.first, phase.last - 1, SAMPLES).round().astype(int))
    return NodalMotion(*(getattr(motion, f.name)[picked] for f in fields(motion)))


def _null(g: Array, k: int) -> Array:
    """The k-th vector from the end of a basis of the null space of G^T, zero where it has fewer: (samples, rows)."""
    u, values, _ = np.linalg.svd(g)
    return np.asarray(np.where((g.shape[1] - 1 - k >= ranks(values))[:, None], u[:, :, -1 - k], 0.0))


def _on_beam(mesh: Mesh, closure: Closure) -> bool:
    links = [at.link for at in (closure.first, closure.second) if at.link != WORLD]
    return any(name in mesh.section_nodes for name in links)
