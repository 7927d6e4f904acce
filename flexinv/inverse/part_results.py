"""Stress of meshed links, von Mises at the nodes of their meshes, and the wrenches at their interfaces."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from flexinv.inverse.inverse_dynamics import NodalForces, compute_wrenches_in_frames
from flexinv.inverse.part_forces import compute_part_motion
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.model.by_value import ByValue
from flexinv.parts.part_stress import compute_stress_shapes, compute_von_mises
from flexinv.typing import Array, Indices
from flexinv.validation import resolve_index

# Numbers of stress that are held at once: 100 MB.
STRESSES_AT_ONCE = 1 << 21


@dataclass(frozen=True, eq=False)
class PartStress(ByValue):
    """Von Mises's stress of a meshed link: linear in its amplitudes, without what they make of second order, nor damping.

    points : (n, 3) [m], the nodes of the undeformed mesh in the link frame; by_shape : (n, 6, shapes) stress of each shape [Pa/m]
    amplitudes : (samples, shapes) [m]
    """

    points: Array
    by_shape: Array
    amplitudes: Array

    def compute(self, samples: ArrayLike | None = None) -> Array:
        """Return the stress of all nodes at some samples, (samples, n) [Pa]; None: at all of them.

        samples : their numbers, one or more [-].  Raises InputError where there is no such sample.
        """
        count = len(self.amplitudes)
        asked = np.arange(count) if samples is None else np.atleast_1d(samples).tolist()
        chosen = [resolve_index("samples", int(sample), count) for sample in asked]
        stress = np.tensordot(self.amplitudes[chosen], self.by_shape, axes=(1, 2))  # (sample, node, 6)
        return compute_von_mises(stress[..., None])[..., 0]

    @property
    def largest(self) -> Array:
        """The largest stress of all nodes over time, (samples,) [Pa]."""
        return self._peaks[0]

    @property
    def node(self) -> Indices:
        """The node where it is, (samples,), a row of ``points`` [-]."""
        return self._peaks[1]

    @property
    def place(self) -> Array:
        """The place where it is, (samples, 3) [m], in the link frame of the undeformed part."""
        return np.asarray(self.points[self.node])

    @cached_property
    def _peaks(self) -> tuple[Array, Indices]:
        """The largest stresses and their nodes, some samples at once."""
        count = len(self.amplitudes)
        at_once = max(1, STRESSES_AT_ONCE // max(1, 6 * len(self.points)))
        largest = np.zeros(count)
        node = np.zeros(count, dtype=np.int64)
        for first in range(0, count, at_once):
            samples = np.arange(first, min(first + at_once, count))
            stress = self.compute(samples)
            node[samples] = stress.argmax(axis=1)
            largest[samples] = stress.max(axis=1)
        return largest, node


def build_part_stress(mesh: Mesh, motion: NodalMotion, link: str) -> PartStress:
    """Return the stress of a meshed link [Pa] in a motion of all nodes.

    Raises InputError for a link without a mesh, and for one of ready matrices.
    """
    moved = compute_part_motion(mesh, motion, link)
    part = mesh.mechanism.link_of[link].part
    assert part is not None
    return PartStress(moved.reduced.points, compute_stress_shapes(part, moved.reduced), moved.amplitudes)


def compute_interface_wrenches(mesh: Mesh, motion: NodalMotion, forces: NodalForces) -> dict[tuple[str, str], Array]:
    """Return the wrench of every interface but the root on all that it carries: joints, payloads, closures, springs, forces.

    (link, interface) -> (samples, 6) force [N] and moment [N m] about the origin of the interface's frame, along its axes: the
    sum of P = M (a - g) less what is applied, on and beyond it.  The root's is the wrench of the joint that carries the link.
    """
    named = {
        (link.name, one.name): mesh.interface_node[(link.name, one.name)]
        for link in mesh.mechanism.meshed
        for one in (link.part.moved if link.part is not None else ())
    }
    wrenches = compute_wrenches_in_frames(mesh, motion, forces, np.unique([*named.values()]).astype(np.int64))
    return {name: wrenches[node] for name, node in named.items()}
