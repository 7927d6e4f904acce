"""Engines with prescribed joints: joints whose motion is missing, and the efforts that drives take themselves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crosscheck.measures.certificate import PassiveElements
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism

Array = NDArray[np.float64]
SPRING = ("stiffness", "rest", "damping")  # of a spring between points; one in a joint has the first two


def describe_nontree_parts(mechanism: Mechanism, sprung: bool = False) -> str | None:
    """Return the parts that are neither link nor joint of a tree, in words, for engines that overlook them, or None.

    sprung : springs in joints are taken care of (`compute_spring_effort`)
    """
    kinds = {
        "closed loops": [c.name for c in mechanism.closures],
        "springs": [s.name for s in mechanism.springs],
        "applied forces": [f.name for f in mechanism.forces],
        "springs in joints": [j.name for j in mechanism.joints if j.stiffness and not sprung],
    }
    found = [f"{kind} ({', '.join(names)})" for kind, names in kinds.items() if names]
    return f"this formulation has open trees and their drives only; here: {'; '.join(found)}" if found else None


def describe_coupled_sections(mechanism: Mechanism, what: str) -> str | None:
    """Return the beams whose sections are coupled, in words, for engines that have no such thing, or None."""
    names = [link.name for link in mechanism.beams if link.beam is not None and link.beam.section.is_coupled]
    if not names:
        return None
    parts = "no stiffness beside EA, GA, GJ and EI, no mass centre off the axis, no products of inertia"
    return f"{what} cannot do coupled sections ({parts}); here: {', '.join(names)}"


def missing_motion(mechanism: Mechanism, case: Case) -> str | None:
    """Return the reason why joints cannot all be prescribed, or None when the case gives every joint a motion."""
    given = case.motion.joints(mechanism)
    free = [j.name for j in mechanism.joints if j.nv and j.name not in given]
    return f"every joint must be given a motion here; left to the dynamics: {', '.join(free)}" if free else None


def convert_to_scalars(mechanism: Mechanism, q: Array) -> Array:
    """Return one number per velocity (samples, nv) [rad], [m], of a continuous joint its angle in -pi .. pi.

    q : (samples, nq)
    """
    columns = []
    for joint in mechanism.joints:
        coordinates = q[:, mechanism.q_slices[joint.name]]
        if joint.nv:
            columns.append(
                np.arctan2(coordinates[:, 1], coordinates[:, 0]) if joint.kind == "continuous" else coordinates[:, 0]
            )
    return np.stack(columns, axis=1)


def passive_effort(mechanism: Mechanism, qd: Array) -> Array:
    """Return d v + f sign(v), (samples, nv) [N m] or [N]: what damping and dry friction take from the actuator."""
    return _list_per_coordinate(mechanism, "damping") * qd + _list_per_coordinate(mechanism, "friction") * np.sign(qd)


def rotor_effort(mechanism: Mechanism, qdd: Array) -> Array:
    """Return I_rotor a, (samples, nv) [N m] or [N]."""
    return _list_per_coordinate(mechanism, "rotor_inertia") * qdd


def collect_passive_elements(mechanism: Mechanism) -> PassiveElements:
    """Return damping, friction and springs for the certificates of engines without passive elements of their own.

    Damping [N m s/rad], [N s/m] and friction [N m], [N] are read off `passive_effort` at two speeds, springs in joints
    [N m/rad], [N/m] off `compute_spring_effort`, springs between points are what `wrenches.pushes` is given.
    """
    units = np.ones((1, mechanism.nv))
    once = passive_effort(mechanism, units)[0]
    twice = passive_effort(mechanism, 2.0 * units)[0]
    first = {j.name: mechanism.v_slices[j.name].start for j in mechanism.joints if j.nv}
    springs = [(f"{s.name}: {key}", float(getattr(s, key))) for s in mechanism.springs for key in SPRING]
    springs += [
        (f"{j.name}: {key}", float(getattr(j, key))) for j in mechanism.joints if j.stiffness for key in SPRING[:2]
    ]
    return {
        "damping": {name: float(twice[k] - once[k]) for name, k in first.items()},
        "friction": {name: float(2.0 * once[k] - twice[k]) for name, k in first.items()},
        "springs": dict(springs),
    }


def compute_spring_effort(mechanism: Mechanism, q: Array) -> Array:
    """Return k (q - rest), (samples, nv) [N m] or [N]: what springs in joints take from the actuator.  q : (samples, nq).

    The angle of a continuous joint is followed over the samples, from the one within half a turn at the first.
    """
    out = np.zeros((len(q), mechanism.nv))
    for joint in mechanism.joints:
        if joint.stiffness:
            coordinates = q[:, mechanism.q_slices[joint.name]]
            place = (
                np.unwrap(np.arctan2(coordinates[:, 1], coordinates[:, 0]))
                if joint.kind == "continuous"
                else coordinates[:, 0]
            )
            out[:, mechanism.v_slices[joint.name].start] = joint.stiffness * (place - joint.rest)
    return out


def _list_per_coordinate(mechanism: Mechanism, name: str) -> Array:
    return np.array([getattr(j, name) for j in mechanism.joints for _ in range(j.nv)], dtype=np.float64)
