"""Differences of features: what engines do that no mechanism can say, compared by name and by the readers' own efforts.

    added         delta = tau of the reader's own model - tau of the lifted mechanism, in A's coordinates, for A and for B
    of a name     what its features add: tau with all of them - tau without those of that name
    tables        of features that no effort feels, or where a reader cannot be asked: their numbers, with A's names of joints

Features of one name that add the same efforts and have the same numbers are no difference; with other numbers they are one that
no torque can tell.  What the readers add beyond all named features has to be the same, too.  Where other numbers of the machines
differ, what equal features add differs as well: then their tables decide.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from crosscheck.equivalence.alignment.member_alignment import MemberAlignment
from crosscheck.equivalence.beams.rigid_beams import make_rigid_mechanism
from crosscheck.equivalence.difference import Difference
from crosscheck.equivalence.efforts import States, evaluate_efforts, map_efforts_back, map_states
from crosscheck.equivalence.judge import Judgement, Share, compute_effort_share
from crosscheck.equivalence.proof import evaluate_reader_efforts, list_feature_names, remove_ties
from crosscheck.equivalence.tree import Tree
from crosscheck.lifting.description import Description
from crosscheck.lifting.reader_dynamics import Feature, Parameter
from crosscheck.lifting.rigid import apply_placement, inverse
from flexinv.errors import InputError
from flexinv.model.mechanism import Array, Placement

FAMILY = "feature"
CLOSE = 1e-9  # relative: numbers of two features that are the same
SHOWN = 4  # features of one name that a difference shows
Efforts = dict[str, Array]


@dataclass(frozen=True)
class CommonGround:
    """Common ground of two descriptions: A's reduced tree, states, alignment by joint of A.

    names : of B's joints by those of A
    starts : pose of A's floating joints at zero over that which A states, where B's stand elsewhere [m]
    common : both readers may be asked: the coordinates of both are those of their files
    """

    tree: Tree
    states: States
    alignments: Mapping[str, MemberAlignment]
    names: Mapping[str, str]
    starts: Mapping[str, Placement] = field(default_factory=dict)
    common: bool = True


@dataclass(frozen=True)
class FeatureEfforts:
    """Efforts that the features of one side add, in A's coordinates: all together, and by name [N m], [N]."""

    whole: Efforts
    by_name: Mapping[str, Efforts]
    scale: Efforts


BothEfforts = tuple[FeatureEfforts, FeatureEfforts]


def add_feature_differences(
    judgement: Judgement,
    sides: tuple[Description, Description],
    ground: CommonGround,
    ignored: Collection[str],
    tolerance: float,
) -> Judgement:
    """Return the judgement with the differences of features; ignored : names that are left out.

    tolerance : relative to the range of an effort [-]
    """
    names = sorted({name for side in sides for name in list_feature_names(side)} - set(ignored))
    exact = not (judgement.causes or judgement.rounding)
    efforts = _compute_both_efforts(sides, ground, names, ignored)
    causes: list[Difference] = []
    unseen: list[Difference] = []
    for name in names:
        difference = _FeaturePair.build(name, sides, ground.names).find_difference(efforts, tolerance, exact)
        if difference is not None:
            seen = not exact or difference.share is None or difference.share > tolerance
            (causes if seen else unseen).append(difference)
    judgement = replace(judgement, causes=(*judgement.causes, *causes), unseen=(*judgement.unseen, *unseen))
    return judgement if efforts is None or causes or not exact else _add_remainder(judgement, efforts, tolerance)


def _compute_both_efforts(
    sides: tuple[Description, Description], ground: CommonGround, names: Iterable[str], ignored: Collection[str]
) -> BothEfforts | None:
    """Efforts that the readers of both add to their mechanisms; None where not both can be asked."""
    if not ground.common or all(side.dynamics is None for side in sides):
        return None
    one, two = (_compute_added_efforts(side, ground, names, ignored, n) for n, side in enumerate(sides))
    return None if one is None or two is None else (one, two)


def _add_remainder(judgement: Judgement, efforts: BothEfforts, tolerance: float) -> Judgement:
    """The judgement with what the readers add beyond all named features, where that differs the most."""
    share, effort, joint = _compute_feature_share(efforts[0].whole, efforts[1].whole, efforts)
    if share <= tolerance or share <= judgement.after:
        return judgement
    return replace(
        judgement,
        after=share,
        before=max(judgement.before, share),
        before_effort=max(judgement.before_effort, effort),
        worst_joint=joint,
    )


def _compute_added_efforts(
    side: Description, ground: CommonGround, names: Iterable[str], ignored: Collection[str], number: int
) -> FeatureEfforts | None:
    """Efforts that a side's reader adds to its mechanism; zero where that is the source, None where it cannot be asked."""
    states = ground.states if number else _apply_start_poses(ground.states, ground.starts)
    if number:
        states = map_states(states, ground.tree, ground.alignments)
    joints = dict(ground.names) if number else {name: name for name in ground.states.qd}
    bare = evaluate_efforts(remove_ties(make_rigid_mechanism(side.mechanism)), states, joints)
    if side.dynamics is None:
        if side.unproven:
            return None
        return _map_to_first(FeatureEfforts({k: np.zeros_like(v) for k, v in bare.items()}, {}, bare), ground, number)
    try:
        whole = evaluate_reader_efforts(side, states, joints, ignored)
        without = {
            name: evaluate_reader_efforts(side, states, joints, {*ignored, name})
            for name in names
            if name in list_feature_names(side)
        }
    except InputError:
        return None
    by_name = {name: _compute_effort_difference(whole, less) for name, less in without.items()}
    return _map_to_first(FeatureEfforts(_compute_effort_difference(whole, bare), by_name, whole), ground, number)


def _map_to_first(added: FeatureEfforts, ground: CommonGround, number: int) -> FeatureEfforts:
    """Efforts of B as efforts of A's coordinates."""
    if not number:
        return added

    def map_back(found: Efforts) -> Efforts:
        return map_efforts_back(found, ground.tree, ground.alignments)

    return FeatureEfforts(
        map_back(added.whole), {name: map_back(value) for name, value in added.by_name.items()}, map_back(added.scale)
    )


def _apply_start_poses(states: States, starts: Mapping[str, Placement]) -> States:
    """States whose floating joints count from another pose."""
    poses = {
        joint: [apply_placement(starts[joint], one) for one in joint_poses] if joint in starts else joint_poses
        for joint, joint_poses in states.poses.items()
    }
    return replace(states, poses=poses)


def find_start_poses(tree: Tree, changed: Tree) -> dict[str, Placement]:
    """Return by floating joint how its pose at zero in a changed tree stands in that of the tree [m]."""
    return {
        joint: apply_placement(inverse(tree.members[k].placement), changed.members[k].placement)
        for joint, k in tree.moving.items()
        if tree.members[k].kind == "free"
    }


def _compute_effort_difference(one: Efforts, other: Efforts) -> Efforts:
    return {name: one[name] - other[name] for name in one}


def _compute_feature_share(one: Efforts, two: Efforts, added: BothEfforts) -> Share:
    first, second = added
    scale = {k: np.maximum(np.abs(first.scale[k]), np.abs(second.scale[k])) for k in first.scale}
    return compute_effort_share(one, two, scale)


@dataclass(frozen=True)
class _FeaturePair:
    """The features of one name of A and of B; alike : with the same numbers, those of B with A's names of joints."""

    name: str
    first: list[Feature]
    second: list[Feature]
    alike: bool

    @classmethod
    def build(cls, name: str, sides: tuple[Description, Description], joints: Mapping[str, str]) -> _FeaturePair:
        """Build the pair of a name; joints : of B by those of A."""
        first, second = ([feature for feature in side.features if feature.name == name] for side in sides)
        return cls(name, first, second, _has_equal_tables(first, second, joints))

    def find_difference(self, efforts: BothEfforts | None, tolerance: float, exact: bool) -> Difference | None:
        """Return the difference, None where there is none; tolerance : relative to the range of an effort [-]."""
        felt = any(feature.felt for feature in [*self.first, *self.second])
        if self.alike and not (felt and exact and efforts is not None):
            return None
        if not felt or efforts is None:
            return self._make_difference(None, None)
        share, effort, _ = self._compute_share(efforts)
        return None if share <= tolerance and self.alike else self._make_difference(effort, share)

    def _compute_share(self, efforts: BothEfforts) -> Share:
        none = {key: np.zeros_like(rows) for key, rows in efforts[0].scale.items()}
        one, two = (added.by_name.get(self.name, none) for added in efforts)
        return _compute_feature_share(one, two, efforts)

    def _make_difference(self, effort: float | None, share: float | None) -> Difference:
        cause = self.name
        if not (self.first and self.second):
            cause += f" that only {'A' if self.first else 'B'} has"
        places = list(dict.fromkeys(feature.place for feature in self.first or self.second))
        one, two = (_describe_features(some) for some in (self.first, self.second))
        return Difference(
            FAMILY, cause, "; ".join(places[:SHOWN]), 1.0, "-", one, two, effect=effort, share=share
        )  # fmt: skip


def _describe_features(features: list[Feature]) -> str:
    words = list(dict.fromkeys(feature.words for feature in features))
    more = f" and {len(words) - SHOWN} more" if len(words) > SHOWN else ""
    return "; ".join(words[:SHOWN]) + more if features else "none"


def _has_equal_tables(ours: list[Feature], features: list[Feature], names: Mapping[str, str]) -> bool:
    """Compare the numbers of features, those of B with A's names of joints, in any order."""
    back = {b: a for a, b in names.items()}
    waiting = [_make_feature_row(feature, back) for feature in features]
    for feature in ours:
        row = _make_feature_row(feature, {})
        like = next((other for other in waiting if _close(row, other)), None)
        if like is None:
            return False
        waiting.remove(like)
    return not waiting


Row = tuple[tuple[str, ...], dict[str, Parameter]]


def _make_feature_row(feature: Feature, names: Mapping[str, str]) -> Row:
    joints = tuple(names.get(name, name) for name in feature.joints)
    numbers = {_replace_joint_name(key, feature.joints, names): value for key, value in feature.parameters.items()}
    return joints, numbers


def _replace_joint_name(key: str, joints: Iterable[str], names: Mapping[str, str]) -> str:
    for name in joints:
        if key.endswith(f"of {name}"):
            return key.removesuffix(name) + names.get(name, name)
    return key


def _close(one: Row, other: Row) -> bool:
    if one[0] != other[0] or set(one[1]) != set(other[1]):
        return False
    return all(_is_equal_value(value, other[1][key]) for key, value in one[1].items())


def _is_equal_value(one: Parameter, other: Parameter) -> bool:
    if isinstance(one, str) or isinstance(other, str):
        return one == other
    a = np.atleast_1d(np.asarray(one))
    b = np.atleast_1d(np.asarray(other))
    return a.shape == b.shape and bool(np.all(np.abs(a - b) <= CLOSE * np.maximum(np.abs(a), np.abs(b))))


def describe_ignored(sides: tuple[Description, Description], ignored: Iterable[str]) -> Iterator[str]:
    """Yield in words what is left out of a comparison, and names that neither description has."""
    for name in ignored:
        having = [label for label, side in zip("AB", sides, strict=True) if name in list_feature_names(side)]
        known = sorted(list_feature_names(sides[0]) | list_feature_names(sides[1]))
        if having:
            yield f"left out: {name}, of {' and '.join(having)}"
        else:
            yield f"left out: {name}, which neither has; what they have is {', '.join(known) or 'nothing of the kind'}"
