"""Lines of a mechanism in motion, as they are drawn: from node to node, and on to the tips of rigid links."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flexinv.display.drawing import Stroke
from flexinv.kinematics.mesh import Mesh
from flexinv.model.joint_kinds import SECTION, SHAPED
from flexinv.typing import Array


def collect_strokes(mesh: Mesh, x: Array, tip: Mapping[str, Array]) -> list[Stroke]:
    """Return lines (samples, 2, 3) [m] from every node's parent, or the world's origin, to it, and from rigid links to tips.

    Meshed links are lines to their interfaces; point masses of theirs are no places of the mechanism.
    x : (samples, nodes, 3) [m]; tip : link -> (samples, 3) [m].  Lines that have no length at any sample are left out.
    """
    origin = np.zeros((len(x), 3))
    strokes = [
        (np.stack([x[:, p] if p >= 0 else origin, x[:, n]], axis=1), bool(mesh.kind[n] in (SECTION, SHAPED)))
        for n, p in enumerate(mesh.parent)
        if mesh.kind[n] != SHAPED or mesh.mass[n] == 0.0
    ]
    for joint in mesh.mechanism.joints:
        if mesh.mechanism.link_of[joint.child].is_rigid and joint.child in tip:
            strokes.append((np.stack([x[:, mesh.joint_node[joint.name]], tip[joint.child]], axis=1), False))
    return [(line, bends) for line, bends in strokes if np.ptp(line, axis=1).any()]
