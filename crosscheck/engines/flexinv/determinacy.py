"""Determinate reactions: components of closures' and joints' wrenches that are unique although constraints are redundant.

Multipliers lambda carry the efforts up to the null space of G^T: forces that closures put on each other through the
mechanism without moving it or straining a beam (a planar loop of joints in space presses its closures out of the plane as
it likes).  A component of a closure's wrench is determinate if no such null vector contributes to it, in every phase in which
it acts; so is one of a joint's wrench, which carries the closures' forces to the base.
Components that a closure cannot exert (the moment of a hinge about its axis) are zero up to rounding and not counted.
Redundant *drives* leave nothing open in this sense: their allocation of least norm is unique, and the reactions belong to it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from flexinv.constraints.allocation import count_ranks
from flexinv.constraints.closures import Phase, Rows, build_constraint_rows, list_phases, list_velocity_scales
from flexinv.constraints.reactions import compute_closure_wrenches
from flexinv.inverse.inverse_dynamics import (
    NodalForces,
    compute_joint_wrenches,
    compute_local_wrenches,
    compute_projected_efforts,
)
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.typing import Array

# Null vectors have unit length in [N m], forces times the mechanism's length; what rounding, enlarged by the condition of G,
# leaves of a component is below.
NO_COMPONENT = 1e-9
# Of every phase: what is redundant is so all along, but for singular positions.
SAMPLES = 5


@dataclass(frozen=True)
class DeterminateWrenches:
    """Components of wrenches [N], [N m] that the motion and the drives determine: name -> (6,).

    reaction : of closures, those among them that the closure can exert; wrench : of the joints of the tree
    """

    reaction: dict[str, NDArray[np.bool_]]
    wrench: dict[str, NDArray[np.bool_]]


@dataclass(frozen=True)
class LargestComponents:
    """Largest components [N m] so far, name -> (6,), forces times the mechanism's length.

    firm : what each closure can exert; loose : what null vectors put into closures; carried : and into joints
    """

    firm: dict[str, Array]
    loose: dict[str, Array]
    carried: dict[str, Array]


def find_determinate_parts(mesh: Mesh, motion: NodalMotion, time: Array) -> DeterminateWrenches:
    """Return the determinate components of the wrenches of closures and joints.

    time : (samples,) [s] of a uniform grid.  A beam gives way in all six directions: what it would transmit strains it.
    """
    m = mesh.mechanism
    rows = build_constraint_rows(mesh)
    largest = LargestComponents(
        firm={c.name: np.zeros(6) for c in m.closures},
        loose={c.name: np.zeros(6) for c in m.closures},
        carried={joint: np.zeros(6) for joint in mesh.joint_node},
    )
    for phase in list_phases(m, time):
        acting = np.flatnonzero(phase.active[rows.closure])
        _update_by_phase(largest, mesh, _sample_motion(motion, phase), rows, acting)
    loose = largest.loose
    reaction = {name: (loose[name] < NO_COMPONENT) & (firm > NO_COMPONENT) for name, firm in largest.firm.items()}
    return DeterminateWrenches(reaction, {joint: size < NO_COMPONENT for joint, size in largest.carried.items()})


def _update_by_phase(
    largest: LargestComponents, mesh: Mesh, some: NodalMotion, rows: Rows, acting: NDArray[np.intp]
) -> None:
    """Raise the largest components to those of a phase; some : of its samples; acting : rows of closures that act."""
    scale = rows.scale
    arms = np.array(3 * [mesh.length] + 3 * [1.0])
    columns = []
    for row in acting:
        unit = _make_unit_multipliers(some, rows, int(row)) / scale
        forces, wrenches = compute_closure_wrenches(mesh, some, rows, unit)
        _update_maxima(largest.firm, wrenches, arms)
        columns.append(_compute_generalized_forces(mesh, some, forces))
    felt = np.stack(columns, axis=1) if columns else np.zeros((1, 0, 1))
    for k in range(len(acting)):
        null = np.zeros((len(felt), len(rows.closure)))
        null[:, acting] = _compute_null_vector(felt, k)
        if not null.any():
            continue
        forces, wrenches = compute_closure_wrenches(mesh, some, rows, null / scale)
        local_wrenches = compute_local_wrenches(mesh, some, forces)
        _update_maxima(largest.loose, wrenches, arms)
        joints = {joint: local_wrenches[node] for joint, node in mesh.joint_node.items()}
        _update_maxima(largest.carried, joints, arms)


def _make_unit_multipliers(motion: NodalMotion, rows: Rows, row: int) -> Array:
    """Return multipliers (samples, rows) of which one is 1 [its unit]."""
    out = np.zeros((len(motion.x), len(rows.closure)))
    out[:, row] = 1.0
    return out


def _compute_generalized_forces(mesh: Mesh, motion: NodalMotion, forces: NodalForces) -> Array:
    """Return all that moves the mechanism of nodal forces, (samples, n) [N m]: efforts of joints, wrenches within beams."""
    wrenches = compute_joint_wrenches(mesh, motion, forces)
    within = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *(n[1:] for n in mesh.section_nodes.values())]))
    parts = [
        compute_projected_efforts(mesh, motion, forces) * list_velocity_scales(mesh),
        mesh.length * wrenches.force[:, within].reshape(len(motion.x), -1),
        wrenches.moment[:, within].reshape(len(motion.x), -1),
    ]
    return np.concatenate(parts, axis=1)


def _update_maxima(sizes: dict[str, Array], wrenches: dict[str, Array], arms: Array) -> None:
    """Raise the largest components so far, (6,) [N m], to those of wrenches (samples, 6) [N], [N m]."""
    for name, wrench in wrenches.items():
        sizes[name] = np.maximum(sizes[name], arms * np.abs(wrench).max(axis=0))


def _sample_motion(motion: NodalMotion, phase: Phase) -> NodalMotion:
    """The motion at a few samples of a phase."""
    picked = np.unique(np.linspace(phase.first, phase.last - 1, SAMPLES).round().astype(int))
    return NodalMotion(*(getattr(motion, f.name)[picked] for f in fields(motion)))


def _compute_null_vector(g: Array, k: int) -> Array:
    """The k-th vector from the end of a basis of the null space of G^T, zero where it has fewer: (samples, rows)."""
    u, values, _ = np.linalg.svd(g)
    return np.asarray(np.where((g.shape[1] - 1 - k >= count_ranks(values))[:, None], u[:, :, -1 - k], 0.0))
