"""Nodal forces and their sums along the tree, sample by sample: each number is read once, at the speed of the memory."""

from __future__ import annotations

from flexinv.compiled import jit
from flexinv.vectors import add, apply, cross, mat, put, scale, sub, vec


@jit
def nodal_samples(mass, inertia, g, rotation, omega, a, alpha, force, moment):
    """Set P = M (a - g) [N] and Q = R (J al + w x J w) [N m] of every node, (samples, nodes, 3)."""
    gravity = vec(g)
    for s in range(a.shape[0]):
        for n in range(mass.shape[0]):
            w, tensor = vec(omega[s, n]), mat(inertia[n])
            body = add(apply(tensor, vec(alpha[s, n])), cross(w, apply(tensor, w)))
            put(force[s, n], 0, scale(mass[n], sub(vec(a[s, n]), gravity)))
            put(moment[s, n], 0, apply(mat(rotation[s, n]), body))


@jit
def sum_samples(parent, x, force, moment):
    """Add to every node's force [N] and moment [N m] those beyond it, the moments about the node, in place."""
    for s in range(x.shape[0]):
        for n in range(parent.shape[0] - 1, -1, -1):
            m = parent[n]
            if m >= 0:
                push = vec(force[s, n])
                arm = sub(vec(x[s, n]), vec(x[s, m]))
                put(force[s, m], 0, add(vec(force[s, m]), push))
                put(moment[s, m], 0, add(vec(moment[s, m]), add(vec(moment[s, n]), cross(arm, push))))
