"""Forces of closures from their multipliers: on the nodes that they join, and as a wrench on the second link of each."""

from __future__ import annotations

import numpy as np

from flexinv.constraints.closures import Rows, row_arrays
from flexinv.constraints.equations import Ends, closing_samples
from flexinv.constraints.phases import Stretch
from flexinv.inverse.inverse_dynamics import NodalForces
from flexinv.kernels.memory import plain
from flexinv.kinematics.mesh import Mesh, attachment_node
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.model.mechanism import WORLD
from flexinv.model.owned_cache import kept_with_owner
from flexinv.typing import Array


def closing(mesh: Mesh, motion: NodalMotion, rows: Rows, multipliers: Array) -> tuple[NodalForces, dict[str, Array]]:
    """Return the nodal forces [N], [N m] of multipliers, and by closures what each exerts on its second link.

    That is a wrench at its frame there and in its axes, (samples, 6) [N], [N m]; a coupling ties no frames: it has none.
    multipliers : (samples, rows) of the closures, or of their impulses
    """
    closures, (force, moment) = mesh.mechanism.closures, np.zeros((2, *motion.x.shape))
    wrench = np.zeros((len(closures), len(motion.x), 6))
    closing_samples(
        row_arrays(rows), rows.closure, _ends(mesh), motion.frames, plain(multipliers), force, moment, wrench
    )
    shown = {c.name: own for c, own in zip(closures, wrench, strict=True) if c.kind != "coupling"}
    return NodalForces(force, moment), shown


def phased_closing(
    mesh: Mesh, motion: NodalMotion, stretches: list[Stretch], multipliers: Array
) -> tuple[NodalForces, dict[str, Array]]:
    """Return the nodal forces and wrenches of `closing` [N], [N m], with the frames of each phase."""
    if len(stretches) == 1:
        return closing(mesh, motion, stretches[0].rows, multipliers)
    parts = [closing(mesh, motion.samples(s.span), s.rows, multipliers[s.span]) for s in stretches]
    force, moment = (np.concatenate([getattr(own, name) for own, _ in parts]) for name in ("force", "moment"))
    return NodalForces(force, moment), {
        name: np.concatenate([shown[name] for _, shown in parts]) for name in parts[0][1]
    }


@kept_with_owner()
def _ends(mesh: Mesh) -> Ends:
    """Return the frames in which the closures report their wrenches; couplings have none, node -1."""
    closures = mesh.mechanism.closures
    second = np.array([c.second.link != WORLD for c in closures], dtype=bool)
    ends = [c.second if of_second else c.first for c, of_second in zip(closures, second, strict=True)]
    node = [-1 if c.kind == "coupling" else attachment_node(mesh, at) for c, at in zip(closures, ends, strict=True)]
    place, turn = (np.array([getattr(at.placement, name) for at in ends]) for name in ("position", "rotation"))
    return Ends(np.array(node, dtype=np.int64), second, place.reshape(-1, 3), turn.reshape(-1, 3, 3))
