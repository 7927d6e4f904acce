"""Determinate reactions: components of closures' and joints' wrenches that are unique although constraints are redundant.

Multipliers lambda carry the efforts up to the null space of G^T: forces that closures put on each other through the
mechanism without moving it (a planar loop of joints in space presses its closures out of the plane as it likes).  A
component of a closure's wrench is determinate if no such null vector contributes to it, in every phase in which it acts;
so is one of a joint's wrench, which carries the closures' forces to the base.
Components that a closure cannot exert (the moment of a hinge about its axis) are zero up to rounding and not counted.
Redundant *drives* leave nothing open in this sense: their allocation of least norm is unique, and the reactions belong to it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from flexinv.constraints.allocation import ranks
from flexinv.constraints.closures import constraint_jacobian, constraint_rows, measures, row_scales
from flexinv.constraints.phases import Phase, phases
from flexinv.constraints.reactions import closing
from flexinv.inverse.inverse_dynamics import own_wrenches
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.model.mechanism import WORLD, Closure
from flexinv.typing import Array

# Null vectors have unit length in [N m], forces times the mechanism's length; what rounding, enlarged by the condition of G,
# leaves of a component is below.
NO_COMPONENT = 1e-9
# Of every phase: what is redundant is so all along, but for singular positions.
SAMPLES = 5


@dataclass(frozen=True)
class Determinate:
    """Components of wrenches [N], [N m] that the motion and the drives determine: name -> (6,).

    reaction : of closures, those among them that the closure can exert; wrench : of the joints of the tree
    """

    reaction: dict[str, NDArray[np.bool_]]
    wrench: dict[str, NDArray[np.bool_]]


def determinate(mesh: Mesh, motion: NodalMotion, time: Array) -> Determinate:
    """Return the components of the wrenches of closures and joints that are determinate [-].

    time : (samples,) [s] of a uniform grid.  With beams: nodes of beams move by themselves, so that nothing is redundant at
    a closure that holds one; of the others nothing is said (False), nor of joints that may carry what they exert.
    """
    m = mesh.mechanism
    if not m.is_rigid:
        held = {c.name: _on_beam(mesh, c) for c in m.closures}
        return Determinate(_all(held), _all(dict.fromkeys(mesh.joint_node, all(held.values()))))
    rows, arms = constraint_rows(mesh), np.array(3 * [mesh.length] + 3 * [1.0])
    loose, firm = ({c.name: np.zeros(6) for c in m.closures} for _ in range(2))
    carried = {joint: np.zeros(6) for joint in mesh.joint_node}
    for phase in phases(m, time):
        some, scale = _some(motion, phase), row_scales(mesh, rows)
        g = constraint_jacobian(mesh, some, rows) * measures(mesh) / scale[:, None]
        acting = np.flatnonzero(phase.active[rows.closure])
        for k, row in enumerate(acting):
            null, unit = (np.zeros((len(g), len(rows))) for _ in range(2))
            null[:, acting] = _null(g[:, acting], k)
            unit[:, row] = 1.0
            forces, wrenches = closing(mesh, some, rows, null / scale)
            _raise(loose, wrenches, arms)
            _raise(firm, closing(mesh, some, rows, unit / scale)[1], arms)
            if null.any():
                own = own_wrenches(mesh, some, forces)
                _raise(carried, {joint: own[node] for joint, node in mesh.joint_node.items()}, arms)
    reaction = {c.name: (loose[c.name] < NO_COMPONENT) & (firm[c.name] > NO_COMPONENT) for c in m.closures}
    return Determinate(reaction, {joint: size < NO_COMPONENT for joint, size in carried.items()})


def _all(known: dict[str, bool]) -> dict[str, NDArray[np.bool_]]:
    """All six components of each, or none."""
    return {name: np.full(6, there) for name, there in known.items()}


def _raise(sizes: dict[str, Array], wrenches: dict[str, Array], arms: Array) -> None:
    """Raise the largest components so far, (6,) [N m], to those of wrenches (samples, 6) [N], [N m]."""
    for name, wrench in wrenches.items():
        sizes[name] = np.maximum(sizes[name], arms * np.abs(wrench).max(axis=0))


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
