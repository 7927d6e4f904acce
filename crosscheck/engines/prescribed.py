"""What engines with prescribed joints share: whose motion is missing, and what a drive adds to the effort."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexinv.files.case import Case
from flexinv.mechanism import Mechanism

Array = NDArray[np.float64]


def beyond_a_tree(mechanism: Mechanism) -> str | None:
    """Return what of a mechanism is neither link nor joint of a tree, for engines that would overlook it, or None."""
    kinds = {
        "closed loops": [c.name for c in mechanism.closures],
        "springs": [s.name for s in mechanism.springs],
        "applied forces": [f.name for f in mechanism.forces],
        "springs in joints": [j.name for j in mechanism.joints if j.stiffness],
    }
    found = [f"{kind} ({', '.join(names)})" for kind, names in kinds.items() if names]
    return f"this formulation has open trees and their drives only; here: {'; '.join(found)}" if found else None


def missing_motion(mechanism: Mechanism, case: Case) -> str | None:
    """Return why joints cannot all be prescribed, or None when the case gives every joint a motion."""
    given = case.motion.joints(mechanism)
    free = [j.name for j in mechanism.joints if j.nv and j.name not in given]
    return f"every joint must be given a motion here; left to the dynamics: {', '.join(free)}" if free else None


def passive_effort(mechanism: Mechanism, qd: Array) -> Array:
    """Return d v + f sign(v), (samples, nv) [N m] or [N]: what damping and dry friction take from the actuator."""
    return _per_coordinate(mechanism, "damping") * qd + _per_coordinate(mechanism, "friction") * np.sign(qd)


def rotor_effort(mechanism: Mechanism, qdd: Array) -> Array:
    """Return I_rotor a, (samples, nv) [N m] or [N]."""
    return _per_coordinate(mechanism, "rotor_inertia") * qdd


def spring_effort(mechanism: Mechanism, q: Array) -> Array:
    """Return k (q - rest), (samples, nv) [N m] or [N]: what springs in joints take from the actuator.  q : (samples, nq).

    The angle of a continuous joint is followed over the samples, from the one within half a turn at the first.
    """
    out = np.zeros((len(q), mechanism.nv))
    for joint in mechanism.joints:
        if joint.stiffness:
            own = q[:, mechanism.q_slices[joint.name]]
            place = np.unwrap(np.arctan2(own[:, 1], own[:, 0])) if joint.kind == "continuous" else own[:, 0]
            out[:, mechanism.v_slices[joint.name].start] = joint.stiffness * (place - joint.rest)
    return out


def _per_coordinate(mechanism: Mechanism, name: str) -> Array:
    return np.array([getattr(j, name) for j in mechanism.joints for _ in range(j.nv)], dtype=np.float64)
