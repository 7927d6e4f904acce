"""Placing of a rigid mechanism at one sample, for poses of its links and wrenches at its joints: kernels over all nodes.

Each link has the node of a payload, so that what the library puts there is felt in the wrenches, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexinv.constraints.allocation_kernel import split_samples
from flexinv.constraints.closures import build_constraint_rows
from flexinv.dynamics.applied_wrenches import build_applied_loads, fill_link_wrenches, make_scratch
from flexinv.dynamics.loop_wrenches import LoopSample, add_loop_wrenches, build_loop_sample, fill_loop_equations
from flexinv.export.machine_code import KernelCall
from flexinv.export.memory_image import MemoryImage
from flexinv.export.payload_nodes import add_payload_bodies
from flexinv.export.readings import format_poses, format_wrenches
from flexinv.inverse.nodal_sums import Masses
from flexinv.kernels.simd import BLOCK
from flexinv.kinematics.configuration import build_nodes
from flexinv.kinematics.mesh import Mesh, build
from flexinv.kinematics.tree import Frames
from flexinv.model.mechanism import Mechanism
from flexinv.model.owned_cache import make_owner_cache
from flexinv.typing import Mask


class LoopCalls(NamedTuple):
    """Calls that add to wrenches at joints what a set of closures does, in their order, and the sample that they work on."""

    equations: KernelCall
    shares: KernelCall
    wrenches: KernelCall
    sample: LoopSample


@make_owner_cache()
def build_loaded_mesh(mechanism: Mechanism) -> Mesh:
    """Return the nodes [m], [kg] of a mechanism with a payload without mass on each link."""
    return build(add_payload_bodies(mechanism, [link.name for link in mechanism.links]))


def make_placing_call(mechanism: Mechanism, torques: KernelCall, name: str) -> KernelCall:
    """Return the call that places all links [m, rad, s, N] where the first sample stands that ``torques`` is given."""
    mesh = build_loaded_mesh(mechanism)
    widths = mechanism.nq, mechanism.nv, mechanism.nv
    motion = tuple(one.reshape(BLOCK, width) for one, width in zip(torques.arguments[5:8], widths, strict=True))
    masses = Masses(mesh.mass, mesh.inertia, np.array(mechanism.gravity, dtype=float))
    system = build_nodes(mesh), masses, build_applied_loads(mesh)
    return KernelCall(name, fill_link_wrenches, (*system, motion, make_scratch(mesh)))


def make_loop_calls(mechanism: Mechanism, placed: KernelCall, acting: Mask, name: str) -> LoopCalls:
    """Return the calls that add what the closures ``acting`` (closures,) do to wrenches at joints [N], [N m]."""
    mesh = build_loaded_mesh(mechanism)
    nodes, _, _, motion, scratch = placed.arguments
    sample = build_loop_sample(mesh, build_constraint_rows(mesh).take_active(acting))
    shares = sample.place, sample.g, sample.tree, sample.out, sample.width
    return LoopCalls(
        KernelCall(f"{name}_equations", fill_loop_equations, (nodes, sample, motion, scratch)),
        KernelCall(f"{name}_shares", split_samples, shares),
        KernelCall(f"{name}_wrenches", add_loop_wrenches, (nodes, sample, scratch)),
        sample,
    )


def format_loops(image: MemoryImage, mesh: Mesh, calls: Sequence[LoopCalls]) -> dict[str, str]:
    """Return places of the laws of drives, and nodes of rates, as the template `rigid` names them [-]."""
    moving = np.flatnonzero(mesh.v_index >= 0)
    nodes = np.empty(mesh.mechanism.nv, dtype=np.int64)
    for node in moving:
        nodes[mesh.v_index[node] : mesh.v_index[node] + mesh.freedoms[node]] = node
    laws = [str(image.find_place(call.sample.drives.law)) for call in calls]
    return {
        "laws": ", ".join(laws) or "0", "law_count": str(len(laws)), "node_count": str(mesh.size),
        "nodes_of_rates": ", ".join(map(str, nodes.tolist())),
    }  # fmt: skip


def format_placing(image: MemoryImage, mechanism: Mechanism, call: KernelCall, prefix: str) -> dict[str, str]:
    """Return places in the block of what is read and of what payloads change, for the templates of readings [-]."""
    mesh = build_loaded_mesh(mechanism)
    nodes, masses, _, _, (_, frames, line) = call.arguments
    one = Frames(*(part[0] for part in frames))
    values = {
        "at_nodal_mass": masses.mass, "at_nodal_inertia": masses.inertia, "at_nodal_offset": nodes.offset,
        "at_nodal_gravity": masses.gravity,
    }  # fmt: skip
    places = {name: str(image.find_place(part)) for name, part in values.items()}
    return places | format_poses(image, mesh, one, "Of the last `place`.") | format_wrenches(image, mesh, line, prefix)
