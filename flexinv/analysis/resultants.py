"""Stress resultants at the root of a beam, from the equilibrium of all that the beam carries."""

from __future__ import annotations

import numpy as np

from flexinv.inverse.inverse_dynamics import NodalForces
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.model.mechanism import Link
from flexinv.typing import Array


def at_roots(mesh: Mesh, motion: NodalMotion, forces: NodalForces) -> dict[str, Array]:
    """Return beam -> (samples, 6) axial, shear_y, shear_z [N], twist, bending_y, bending_z [N m] at the root section.

    Minus the sum of P over all nodes beyond the root, and of the beam's own share of mass there; what else hangs on the root's
    node is not the beam's.
    """
    return {link.name: _at_root(mesh, link, motion, forces) for link in mesh.mechanism.beams}


def _at_root(mesh: Mesh, link: Link, motion: NodalMotion, forces: NodalForces) -> Array:
    root, first = mesh.root_node[link.name], int(mesh.section_nodes[link.name][1])
    beyond = np.arange(mesh.size) == first
    for n in range(first + 1, mesh.size):
        beyond[n] = mesh.parent[n] >= 0 and beyond[mesh.parent[n]]
    arm = motion.x[:, beyond] - motion.x[:, [root]]
    mass, inertia = mesh.mass[root], mesh.inertia[root].copy()
    for body in (one for one in link.bodies if mesh.body_node[(link.name, one.name)] == root):
        mass, inertia = mass - body.inertia.mass, inertia - body.inertia.tensor
    w, al = motion.omega[:, root], motion.alpha[:, root]
    force = forces.force[:, beyond].sum(axis=1) + mass * (motion.a[:, root] - mesh.mechanism.gravity)
    moment = (forces.moment[:, beyond] + np.cross(arm, forces.force[:, beyond])).sum(axis=1)
    r = motion.rotation[:, root]
    own = [np.einsum("sji,sj->si", r, part) for part in (force, moment)]
    return -np.hstack([own[0], own[1] + al @ inertia.T + np.cross(w, w @ inertia.T)])
