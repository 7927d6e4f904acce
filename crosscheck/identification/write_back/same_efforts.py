"""Efforts of a written file, by its reader's own model, against those of the mechanism whose numbers it should have.

Joints are the same by their names, else by the names of the links that they carry; a joint whose child goes round without end is
the same as one of one angle.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from crosscheck.lifting.description import Description
from crosscheck.lifting.rigid import apply_placement
from flexinv.errors import InputError
from flexinv.model.mechanism import WORLD, Joint, Mechanism, Placement
from flexinv.rigid.joint_torques import joint_torques
from flexinv.rigid.torque_regressor import sample_states
from flexinv.typing import Array

SAMPLES = 16
HELD = 1e-9  # of the range of a joint's effort, as `crosscheck compare` holds a file against its reader
ROUNDING = 1e-13  # of the largest effort: a sum over the whole tree, some hundred operations of 1e-16 each


def find_link_frames(mechanism: Mechanism) -> dict[str, Placement]:
    """Return the frames of all links in the world, all joints of a rigid mechanism at zero [m]."""
    frames = {WORLD: Placement()}
    for joint in mechanism.joints:
        frames[joint.child] = apply_placement(frames[joint.parent], joint.placement)
    return frames


def list_carried_links(mechanism: Mechanism) -> dict[str, list[str]]:
    """Return the links that move as one, by the joint that carries them; those that stand by "" [-]."""
    carrier = {WORLD: ""}
    out: dict[str, list[str]] = {}
    for joint in mechanism.joints:
        carrier[joint.child] = joint.name if joint.nv else carrier[joint.parent]
        out.setdefault(carrier[joint.child], []).append(joint.child)
    return out


def match_joints(file: Path, mechanism: Mechanism, lifted: Mechanism) -> dict[str, str]:
    """Return the moving joints of a file [-] by those of a mechanism.  Raises InputError where either has one more."""
    by_child = {joint.child: joint.name for joint in lifted.joints}
    moving = [joint for joint in mechanism.joints if joint.nv]
    names = {j.name: j.name if j.name in lifted.joint_of else by_child.get(j.child, "") for j in moving}
    lost = [name for name, other in names.items() if not other]
    more = [joint.name for joint in lifted.joints if joint.nv and joint.name not in names.values()]
    if lost or more:
        raise InputError(
            f"{file}: expected the joints of {mechanism.name} by their names; the file lacks {_join(lost)}, and has beside them "
            f"{_join(more)}; give the file of this machine, with the same names"
        )
    return names


def check_efforts(file: Path, expected: Mechanism, description: Description) -> None:
    """Raise InputError where the efforts of a file [N m], [N] are not those that were identified.

    Both are cut trees, in random states under the gravity of the mechanism; features that no mechanism can say are switched off.
    """
    dynamics = description.dynamics
    assert dynamics is not None
    lifted = _remove_ties(description.mechanism)
    names = match_joints(file, expected, lifted)
    state = sample_states(lifted, SAMPLES)
    features = {feature.name for feature in description.features}
    found = dynamics.efforts(*state, np.asarray(expected.gravity), features)
    columns = [k for joint in expected.joints if joint.nv for k in _list_columns(lifted, names[joint.name])]
    wanted = joint_torques(_remove_ties(expected), _convert_configuration(file, expected, lifted, names, state[0]),
                           state[1][:, columns], state[2][:, columns])  # fmt: skip
    gap = np.abs(found[:, columns] - wanted).max(axis=0)
    size = np.abs(wanted).max(axis=0)
    wrong = ~(gap <= np.maximum(HELD * size, ROUNDING * size.max(initial=0.0)))
    if wrong.any():
        k = int(np.argmax(np.where(wrong, gap / np.maximum(size, np.finfo(float).tiny), 0.0)))
        raise InputError(
            f"{file}: the effort of {expected.coordinate_names[k]} is off by {gap[k]:.3g} of {size[k]:.3g} N m or N, expected "
            "that which was identified: the file is not written; crosscheck compare says in what file and mechanism differ"
        )


def _remove_ties(mechanism: Mechanism) -> Mechanism:
    return replace(mechanism, closures=(), springs=(), forces=())


def _list_columns(mechanism: Mechanism, joint: str) -> range:
    columns = mechanism.v_slices[joint]
    return range(columns.start, columns.stop)


def _convert_configuration(
    file: Path, mechanism: Mechanism, lifted: Mechanism, names: Mapping[str, str], q: Array
) -> Array:
    """Coordinates (samples, nq) [rad], [m] of the mechanism, of those of the file's."""
    pairs = [(joint, lifted.joint_of[names[joint.name]]) for joint in mechanism.joints if joint.nv]
    return np.hstack([_convert_coordinate(file, *pair, q[:, lifted.q_slices[pair[1].name]]) for pair in pairs])


def _convert_coordinate(file: Path, joint: Joint, other: Joint, q: Array) -> Array:
    if joint.kind == "continuous" and other.kind == "revolute":
        return np.hstack([np.cos(q), np.sin(q)])
    if joint.kind != other.kind:
        raise InputError(f"{file}: joint {other.name} is {other.kind}, expected {joint.kind}, as the mechanism has it")
    return q


def _join(names: list[str]) -> str:
    return ", ".join(map(repr, names)) or "none"
