"""Proof of a description: the lifted mechanism against the reader's own compiled model, on random states, joint by joint.

    efforts       of the mechanism by `flexinv.rigid.joint_torques`, of the model by `ReaderDynamics.efforts`, with contacts,
                  limits and equality constraints switched off; springs, dampers, armature and dry friction are in both
    closures      `equivalence/proving/ties`
    features      what no mechanism can say is switched off in the model by its name: what is named may differ, and nothing else
    bound         HELD times the range of the joint's effort, SINGLE for models in single precision, and ROUNDING of the largest

A description without such a model is not proven, unless its mechanism is the source itself.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from crosscheck.equivalence.efforts import States, evaluate_efforts, sample_states
from crosscheck.equivalence.proving.ties import LOST as TIES_LOST
from crosscheck.equivalence.proving.ties import UNJUDGED, check_ties
from crosscheck.equivalence.tree import build_tree
from crosscheck.lifting.description import Description
from flexinv.errors import InputError
from flexinv.model.mechanism import Array, Mechanism

SAMPLES = 16
SEED = 34
HELD = 1e-9  # of the range of a joint's effort
SINGLE = 1e-5  # the same, of models in single precision
# Rounding of a sum over the whole tree, relative to the largest effort: some hundred operations of 1e-16 each.
ROUNDING = 1e-13
PROVEN = "proven"
SOURCE = "the source itself"
UNPROVEN = "not proven"
LOST = "not reproduced"


@dataclass(frozen=True)
class EffortGap:
    """A joint whose effort the mechanism does not reproduce.

    joint : its name; gap : largest difference of its effort [N m], [N]; share : of the range of that effort [-]
    """

    joint: str
    gap: float
    share: float

    @property
    def words(self) -> str:
        """Return the joint and by how much its effort is off [N m], [N]."""
        return f"joint {self.joint}: the reader's own effort differs by {self.gap:.4g} N m or N, {self.share:.2g} of its range"


@dataclass(frozen=True)
class Proof:
    """The result of holding a description against its reader's own model.

    state : ``PROVEN``, ``SOURCE``, ``UNPROVEN`` or ``LOST``; reader : what answered
    lost : joints that the mechanism does not reproduce; worst : largest difference over the range [-], tiny ones left out
    reason : why there is no proof
    """

    state: str
    reader: str = ""
    lost: tuple[EffortGap, ...] = ()
    worst: float = 0.0
    reason: str = ""

    @property
    def words(self) -> str:
        """Return the proof in a sentence."""
        if self.state == PROVEN:
            but = f"; {self.reason}" if self.reason else ""
            return f"held against {self.reader}: efforts agree to {self.worst:.1g} of their ranges{but}"
        if self.state == SOURCE:
            return "the mechanism is the source itself"
        if self.state == UNPROVEN:
            return f"not proven: {self.reason}"
        parts = [one.words for one in self.lost]
        return f"not reproduced, held against {self.reader}: " + "; ".join(
            [*parts, *([self.reason] if self.reason else [])]
        )


def prove(description: Description) -> Proof:
    """Hold a description's mechanism against its reader's own model [N m], [N]."""
    if description.unproven:
        return Proof(UNPROVEN, description.reader, reason=description.unproven)
    if description.dynamics is None:
        return Proof(SOURCE, description.reader)
    reader = description.dynamics.reader
    tree = build_tree(description.mechanism, {})
    if not tree.moving:
        return Proof(PROVEN, reader)
    off = list_feature_names(description)
    states = sample_states(tree, SEED, (SAMPLES, 0))
    efforts = evaluate_efforts(remove_ties(description.mechanism), states)
    try:
        reader_efforts = evaluate_reader_efforts(description, states, without=off)
        ties = check_ties(description.mechanism, description.dynamics, off)
    except InputError as error:
        return Proof(UNPROVEN, reader, reason=f"{reader}: {error}")
    held = SINGLE if max(description.precision, description.dynamics.precision) > 0.0 else HELD
    found = _judge_efforts(reader, efforts, reader_efforts, held)
    if ties.state == UNJUDGED:
        return replace(found, reason=ties.reason)
    return replace(found, state=LOST, reason=ties.reason) if ties.state == TIES_LOST else found


def list_feature_names(description: Description) -> frozenset[str]:
    """Return the names of the features of a description [-]."""
    return frozenset(feature.name for feature in description.features)


def evaluate_reader_efforts(
    description: Description,
    states: States,
    joints: Mapping[str, str] | None = None,
    without: Collection[str] = (),
) -> dict[str, Array]:
    """Return by joint of the states the efforts (samples, nv) [N m], [N] of the reader's own model.

    joints : names of the states' joints in the mechanism; without : names of features that are switched off
    Raises InputError where the model refuses.
    """
    dynamics = description.dynamics
    assert dynamics is not None
    gravity = None if description.gravity_stated else np.asarray(description.mechanism.gravity)

    def evaluate_law(mechanism: Mechanism, q: Array, qd: Array, qdd: Array) -> Array:
        return dynamics.efforts(q, qd, qdd, gravity, without)

    return evaluate_efforts(description.mechanism, states, joints, evaluate_law)


def remove_ties(mechanism: Mechanism) -> Mechanism:
    """Return the cut tree of a mechanism [m, kg]: nothing closes loops, pulls between points or pushes."""
    return replace(mechanism, closures=(), springs=(), forces=())


def _judge_efforts(reader: str, ours: Mapping[str, Array], theirs: Mapping[str, Array], held: float) -> Proof:
    sizes = {name: np.maximum(np.abs(ours[name]), np.abs(theirs[name])).max(axis=0) for name in ours}
    largest = max(float(np.nan_to_num(size).max(initial=0.0)) for size in sizes.values())
    lost: list[EffortGap] = []
    worst = 0.0
    for name, size in sizes.items():
        gap = np.abs(ours[name] - theirs[name]).max(axis=0)
        share = gap / np.where(size > 0.0, size, 1.0)
        wrong = ~(gap <= np.maximum(held * size, ROUNDING * largest))  # what is no number is wrong, too
        if wrong.any():
            k = int(np.argmax(np.where(wrong, np.nan_to_num(share, nan=np.inf), -1.0)))
            lost.append(EffortGap(name, float(gap[k]), float(share[k])))
        worst = max(worst, float(share[size > HELD * largest].max(initial=0.0)))
    if lost:
        lost.sort(key=lambda one: -np.nan_to_num(one.share, nan=np.inf))
        return Proof(LOST, reader, tuple(lost), worst)
    return Proof(PROVEN, reader, worst=worst)
