"""Masses of the projection to accelerations of index 1, as one dense matrix of the marched unknowns (compiled)."""

from __future__ import annotations

from flexinv.dynamics.index1 import add_mass_to_block
from flexinv.kernels.jit import jit_inner


@jit_inner
def assemble_masses(topology, task, scratch, marched):
    """Put M into the linear system [kg], and where a motion has no inertia what holds it at its acceleration in the march.

    That is the mass of `dynamics.index1.add_mass_to_block`; in a plane such a section's acceleration is the march's itself.
    marched : (unknowns, parameters) derivatives of the march's accelerations
    """
    freedoms = task.freedoms
    size = len(freedoms.marched)
    system = scratch.system
    last = size + marched.shape[1]
    largest = 0.0
    for e in range(scratch.massive.shape[1]):
        r = freedoms.order[scratch.massive_at[0, e]]
        c = freedoms.order[scratch.massive_at[1, e]]
        if r >= 0 and c >= 0:
            system[r, c] += scratch.massive[2, e]
    left = scratch.border.left
    before = left[size]
    scale = left[size + 1]
    for r in range(size):
        before[r] = system[r, r]
        scale[r] = topology.scale[freedoms.marched[r]]
    for r in range(size):
        for c in range(size):
            largest = max(largest, abs(system[r, c]) * scale[r] * scale[c])
    add_mass_to_block(system, size, scale, largest, left)
    for r in range(size):
        added = system[r, r] - before[r]
        if added == 0.0:
            continue
        i = freedoms.marched[r]
        if task.flat:
            system[r, :size] = 0.0
            for c in range(size, system.shape[1]):
                system[r, c] = 0.0
            system[r, r] = 1.0
            added = 1.0
        for c in range(size, last):
            system[r, c] += added * marched[i, c - size]
