"""Carried links: rigid ones that measured joints alone carry: their masses change no motion, and efforts are linear in them.

So a mechanism that bends beyond them is marched once for all such masses:  tau = tau_0 + Y (pi - pi_0), Y by
`flexinv.torque_regressor` of the carried links alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from crosscheck.identification.parameters import Key, ParameterSpace, make_load_place
from crosscheck.identification.pseudo_inertia import NAMES
from flexinv.model.mechanism import WORLD, Mechanism
from flexinv.model.motion import Motion
from flexinv.rigid.torque_regressor import torque_regressor
from flexinv.typing import Array

State = tuple[Array, Array, Array]
TURNED = ("gravity", "place")  # kinds of parameters by which the regressor itself would change


@dataclass(frozen=True)
class CarriedLinks:
    """Links that are carried, and what their masses add to efforts.

    rows : numbers of these links in the mechanism; known : pi_0 (links, 10) [kg], [kg m], [kg m^2], with which it is marched
    matrix : Y (samples, joints, 10 links), in the order of the measured joints
    """

    rows: tuple[int, ...]
    known: Array
    matrix: Array

    def replace_by_known(self, ten: Array) -> Array:
        """Return m, h, I (all links, 10) [kg], [kg m], [kg m^2] with pi_0 in the place of what the carried links have."""
        out = ten.copy()
        out[list(self.rows)] = self.known
        return out

    def compute_added_efforts(self, ten: Array) -> Array:
        """Return Y (pi - pi_0) (samples, joints) [N m], [N] of m, h, I (all links, 10) [kg], [kg m], [kg m^2]."""
        return np.asarray(self.matrix @ (ten[list(self.rows)] - self.known).ravel())


def build_carried_links(
    mechanism: Mechanism, space: ParameterSpace, motion: Motion, time: Array, names: Sequence[str], ten: Array
) -> CarriedLinks | None:
    """Return the links with free masses that joints ``names`` carry along a motion at times (samples,) [s], None of none.

    ten : m, h, I (all links, 10) [kg], [kg m], [kg m^2] with which they are marched
    """
    carried = find_carried_links(mechanism, names)
    rows = tuple(k for k, link in enumerate(mechanism.links) if link.name in carried & {*space.changed_links})
    turns = any(one.kind.startswith(TURNED) for one in space.parameters)
    if not rows or turns or mechanism.closures or mechanism.modal_damping is not None:
        return None
    links = [k for k, link in enumerate(mechanism.links) if link.name in carried]
    whole = _compute_regressor(mechanism, links, motion.evaluate(mechanism, time), names)
    places = [links.index(k) for k in rows]
    matrix = whole.reshape(*whole.shape[:2], len(links), len(NAMES))[:, :, places]
    return CarriedLinks(rows, ten[list(rows)], matrix.reshape(*whole.shape[:2], -1))


def _compute_regressor(mechanism: Mechanism, numbers: Sequence[int], state: State, names: Sequence[str]) -> Array:
    """Y (samples, joints, 10 links) of the links with these numbers alone in a state of the whole mechanism [rad], [m], [s]."""
    links = tuple(mechanism.links[k] for k in numbers)
    carried = {link.name for link in links}
    joints = tuple(joint for joint in mechanism.joints if joint.child in carried)
    tree = replace(mechanism, links=links, joints=joints, springs=(), forces=())
    places = np.concatenate([np.arange(mechanism.nq)[mechanism.q_slices[j.name]] for j in joints])
    moves = np.concatenate([np.arange(mechanism.nv)[mechanism.v_slices[j.name]] for j in joints])
    q, qd, qdd = state
    whole = torque_regressor(tree, q[:, places], qd[:, moves], qdd[:, moves]).matrix
    out = np.zeros((len(q), len(names), whole.shape[2]))
    for k, name in enumerate(names):
        if name in tree.v_slices:
            out[:, k] = whole[:, tree.v_slices[name].start]
    return out


def find_carried_links(mechanism: Mechanism, names: Sequence[str]) -> set[str]:
    """Return the rigid links [-] that nothing but joints ``names`` and fixed ones moves, from the world on."""
    rigid = {link.name for link in mechanism.links if link.is_rigid}
    out = {WORLD}
    for joint in mechanism.joints:
        if joint.parent in out and joint.child in rigid and (joint.name in names or not joint.nv):
            out.add(joint.child)
    return out - {WORLD}


def list_marched_masses(masses: Sequence[Key], mechanism: Mechanism, carried: CarriedLinks | None) -> list[Key]:
    """Return those of the free masses [-] that are not of carried links, nor of their payloads."""
    if carried is None:
        return list(masses)
    names = [mechanism.links[k].name for k in carried.rows]
    places = {*names, *map(make_load_place, names)}
    return [key for key in masses if key[1].rpartition(".")[0] not in places]
