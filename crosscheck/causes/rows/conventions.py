"""Causes in conventions: order, signs, offsets in time, meaning of a coordinate or its acceleration; and loops."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np

from crosscheck.causes.cause import Cause, Change, list_closed_target, list_driven_joints, list_moving_tree_target
from crosscheck.causes.model import Model, drop_closures, is_tree, open_tree
from crosscheck.causes.subject import EffortChange, States, Subject
from crosscheck.measures.record import list_effort_units
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.model.track import LAWS
from flexinv.typing import Array

ALONE = "one joint moved at a time"
MANY = 8  # coordinates up to which every pair is tried; beyond, neighbours only
ARROW = " <-> "
ALPHABET = "alphabetical order"


def _list_exchangeable_pairs(model: Model) -> list[str]:
    """Return the pairs of like coordinates that could be exchanged, and the alphabet where it is another order."""
    mechanism = model.base.mechanism
    units = dict(zip(mechanism.velocity_names, list_effort_units(mechanism), strict=True))
    names = [j.name for j in mechanism.joints if j.nv == j.nq == 1 and j.actuated]
    pairs = list(combinations(names, 2)) if len(names) <= MANY else list(pairwise(names))
    found = [f"{a}{ARROW}{b}" for a, b in pairs if units[a] == units[b]]
    return found + ([ALPHABET] if sorted(names) != names and len(names) > 2 else [])


def _resolve_order(mechanism: Mechanism, target: str) -> tuple[list[str], list[str]]:
    """Return joints and the joints whose place they take."""
    if target != ALPHABET:
        a, b = target.split(ARROW)
        return [a, b], [b, a]
    names = [j.name for j in mechanism.joints if j.nv == j.nq == 1 and j.actuated]
    return names, sorted(names)


def _make_effort_exchange(target: str) -> EffortChange:
    def update_effort(mechanism: Mechanism, states: States, effort: Array) -> Array:
        out = effort.copy()
        for here, there in zip(*_resolve_order(mechanism, target), strict=True):
            out[:, mechanism.v_slices[here]] = effort[:, mechanism.v_slices[there]]
        return out

    return update_effort


def _replace_effort_order(subject: Subject, target: str, size: Array) -> Subject:
    return subject.add_effort_change(_make_effort_exchange(target))


def _replace_coordinate_order(subject: Subject, target: str, size: Array) -> Subject:
    """Exchange motion and efforts: the engine has another order in and out."""
    return _replace_motion_order(subject, target, size).add_effort_change(_make_effort_exchange(target))


def _make_effort_change(change: Callable[[Mechanism, States, Array, str], Array]) -> Change:
    def apply_change(subject: Subject, target: str, size: Array) -> Subject:
        return subject.add_effort_change(lambda mechanism, states, effort: change(mechanism, states, effort, target))

    return apply_change


def _turn_effort_sign(mechanism: Mechanism, states: States, effort: Array, target: str) -> Array:
    out = effort.copy()
    columns = mechanism.v_slices[target] if target else slice(None)
    out[:, columns] = -out[:, columns]
    return out


def _scale_effort(subject: Subject, target: str, size: Array) -> Subject:
    def update_effort(mechanism: Mechanism, states: States, effort: Array) -> Array:
        out = effort.copy()
        out[:, mechanism.v_slices[target]] *= 1.0 + float(size[0])
        return out

    return subject.add_effort_change(update_effort)


def _move_motion_in_time(subject: Subject, target: str, size: Array) -> Subject:
    inner = subject.case.motion

    def update_states(mechanism: Mechanism, states: States) -> States:
        return replace(
            states, **dict(zip(("q", "qd", "qdd"), inner.evaluate(mechanism, states.time - size[0]), strict=True))
        )

    return subject.add_state_change(update_states)


def _compute_delay_scale(model: Model, target: str) -> float:
    return model.base.case.end / 10.0


def _replace_motion_order(subject: Subject, target: str, size: Array) -> Subject:
    """Exchange the motion alone: what is given to one joint was meant for the other."""

    def update_states(mechanism: Mechanism, states: States) -> States:
        q = states.q.copy()
        qd = states.qd.copy()
        qdd = states.qdd.copy()
        for here, there in zip(*_resolve_order(mechanism, target), strict=True):
            q[:, mechanism.q_slices[there]] = states.q[:, mechanism.q_slices[here]]
            for new, old in ((qd, states.qd), (qdd, states.qdd)):
                new[:, mechanism.v_slices[there]] = old[:, mechanism.v_slices[here]]
        return replace(states, q=q, qd=qd, qdd=qdd)

    return subject.add_state_change(update_states)


def _list_other_laws(model: Model) -> list[str]:
    """Return the laws that a motion from point to point does not follow."""
    tracks = model.base.case.motion.tracks
    if not tracks or any(track.sampling is not None for track in tracks):
        return []
    return [law for law in LAWS if any(track.law != law for track in tracks)]


def _replace_motion_law(subject: Subject, target: str, size: Array) -> Subject:
    motion = subject.case.motion
    other = Motion(tuple(replace(track, law=target) for track in motion.tracks), motion.duration)
    return replace(subject, case=replace(subject.case, motion=other))


def _list_smooth_target(model: Model) -> list[str]:
    """Return the one target of motions without jumps: what is late across a jump is not a small difference."""
    return [] if model.base.case.motion.jumps else [""]


def _drop_speeds(subject: Subject, target: str, size: Array) -> Subject:
    return subject.add_state_change(lambda mechanism, states: replace(states, qd=states.qd * 0.0))


def _list_free_joints(model: Model) -> list[str]:
    return [j.name for j in model.base.mechanism.joints if j.kind == "free"] if is_tree(model.base) else []


def _make_classical_acceleration(sign: float) -> Change:
    """Return the change of a free joint's linear acceleration from components' rates to classical, or back."""

    def apply_change(subject: Subject, target: str, size: Array) -> Subject:
        def update_states(mechanism: Mechanism, states: States) -> States:
            v = mechanism.v_slices[target]
            qdd = states.qdd.copy()
            rate = states.qd[:, v]
            qdd[:, v.start : v.start + 3] += sign * np.cross(rate[:, 3:], rate[:, :3])
            return replace(states, qdd=qdd)

        return subject.add_state_change(update_states)

    return apply_change


def _apply_soft_closures(subject: Subject, target: str, size: Array) -> Subject:
    """Give part of the closures' share back to the joints: at 1 these are the open tree's efforts."""
    whole = drop_closures(subject).mechanism

    def update_effort(mechanism: Mechanism, states: States, effort: Array) -> Array:
        return np.asarray(effort + float(size[0]) * (open_tree(whole, states) - effort))

    return subject.add_effort_change(update_effort)


ROWS = (
    Cause(
        "order of efforts",
        "efforts come in another order: {target}",
        _replace_effort_order,
        _list_exchangeable_pairs,
        0,
        shows=ALONE,
    ),
    Cause(
        "order of coordinates",
        "the engine's coordinates are in another order: {target}",
        _replace_coordinate_order,
        lambda model: [] if model.base.mechanism.closures else _list_exchangeable_pairs(model),
        0,
        shows=ALONE,
    ),
    Cause(
        "motions exchanged",
        "two joints are given each other's motion: {target}",
        _replace_motion_order,
        lambda model: [] if model.base.mechanism.closures else _list_exchangeable_pairs(model),
        0,
        shows=ALONE,
    ),
    Cause(
        "motion law",
        "the motion follows another law, {target}",
        _replace_motion_law,
        _list_other_laws,
        0,
        shows="any motion, and the places of its links",
    ),
    Cause(
        "effort sign",
        "all efforts have the other sign",
        _make_effort_change(_turn_effort_sign),
        parameters=0,
        shows=ALONE,
    ),
    Cause(
        "effort sign of a joint",
        "the effort of {target} has the other sign",
        _make_effort_change(_turn_effort_sign),
        list_driven_joints,
        0,
        shows=ALONE,
    ),
    Cause(
        "effort scale",
        "the effort of {target} is larger by the fraction {size} (a gear ratio, a unit)",
        _scale_effort,
        list_driven_joints,
        covers=("effort sign of a joint", "effort sign"),
        fraction=True,
        shows=ALONE,
    ),
    Cause(
        "time offset",
        "the motion comes {size} late",
        _move_motion_in_time,
        _list_smooth_target,
        scale=_compute_delay_scale,
        unit="s",
        shows="the same path at another speed: the lag in time stays",
    ),
    Cause(
        "velocity terms dropped",
        "terms that go with velocities (centrifugal, Coriolis, damping) are missing",
        _drop_speeds,
        list_moving_tree_target,
        0,
        shows="the same path at twice the speed",
    ),
    Cause(
        "base acceleration convention",
        "the linear acceleration of {target} is taken as classical: omega x v is counted twice",
        _make_classical_acceleration(1.0),
        _list_free_joints,
        0,
        shows="the base turning while it moves across its axis",
    ),
    Cause(
        "base acceleration convention (spatial)",
        "the linear acceleration of {target} is taken as classical: omega x v is missing",
        _make_classical_acceleration(-1.0),
        _list_free_joints,
        0,
        shows="the base turning while it moves across its axis",
    ),
    Cause(
        "soft constraint",
        "closures are soft: the fraction {size} of their share stays with the joints (1: the open tree's efforts)",
        _apply_soft_closures,
        list_closed_target,
        shows="any motion: efforts at joints without a drive",
    ),
)
