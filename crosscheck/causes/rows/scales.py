"""Causes in units and scales: factors on all efforts, coordinates, times, lengths, masses, inertias, rotors and friction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from crosscheck.causes.cause import (
    Cause,
    Change,
    Targets,
    check_fraction,
    list_bodies,
    list_global_target,
    list_moving_tree_target,
    list_scalar_joints,
)
from crosscheck.causes.model import Model
from crosscheck.causes.subject import StateChange, States, Subject
from crosscheck.measures.record import list_effort_units
from flexinv.model.mechanism import Attachment, Closure, Inertia, Joint, Link, Mechanism, Placement
from flexinv.typing import Array

QUICK = "all joints moved quickly, each at a rhythm of its own"
HOLD = "holding still at several places (gravity alone)"
STEADY = "the same path at half the speed"


def _scale_efforts(subject: Subject, target: str, size: Array) -> Subject:
    factor = 1.0 + check_fraction(size)

    def update_effort(mechanism: Mechanism, states: States, effort: Array) -> Array:
        concerned = np.array([not target or unit == target for unit in list_effort_units(mechanism)])
        return effort * np.where(concerned, factor, 1.0)

    return subject.add_effort_change(update_effort)


def _list_effort_units(model: Model) -> list[str]:
    """Return "" for all efforts and, where there are two units, each of them; of one coordinate it is no cause of its own."""
    units = [
        u
        for u, driven in zip(list_effort_units(model.base.mechanism), model.base.mechanism.actuated, strict=True)
        if driven
    ]
    found = [""] if len(units) > 1 else []
    return found + ([u for u in dict.fromkeys(units) if units.count(u) > 1] if len(set(units)) > 1 else [])


def _make_motion_change(change: Callable[[Mechanism, States, str, float], States]) -> Change:
    """Return the change of the joint motion that the engine is given, by a fraction."""

    def apply_change(subject: Subject, target: str, size: Array) -> Subject:
        def update_states(mechanism: Mechanism, states: States) -> States:
            return change(mechanism, states, target, float(size[0]))

        return subject.add_state_change(update_states)

    return apply_change


def _scale_coordinate(mechanism: Mechanism, states: States, target: str, size: float) -> States:
    q = states.q.copy()
    qd = states.qd.copy()
    qdd = states.qdd.copy()
    q[:, mechanism.q_slices[target]] *= 1.0 + size
    for rate in (qd, qdd):
        rate[:, mechanism.v_slices[target]] *= 1.0 + size
    return replace(states, q=q, qd=qd, qdd=qdd)


def _scale_speeds(mechanism: Mechanism, states: States, target: str, size: float) -> States:
    return replace(states, qd=states.qd * (1.0 + size))


def _scale_accelerations(mechanism: Mechanism, states: States, target: str, size: float) -> States:
    return replace(states, qdd=states.qdd * (1.0 + size))


def _scale_pace(subject: Subject, target: str, size: Array) -> Subject:
    inner = subject.case.motion
    pace = 1.0 + check_fraction(size)

    def update_states(mechanism: Mechanism, states: States) -> States:
        q, qd, qdd = inner.evaluate(mechanism, states.time * pace)
        return replace(states, q=q, qd=qd * pace, qdd=qdd * pace**2)

    return subject.add_state_change(update_states)


def _make_acceleration_change(change: float) -> StateChange:
    return lambda mechanism, states: replace(states, qdd=states.qdd * change)


def _list_prescribed_joints(model: Model) -> list[str]:
    """Return the joints with one coordinate, an angle or a travel, that the motion gives and that move."""
    mechanism = model.base.mechanism
    given = model.base.case.motion.joints(model.base.mechanism)
    names = [n for n in list_scalar_joints(model) if n in given and mechanism.joint_of[n].nq == 1]
    return [
        n
        for n in names
        if model.states.qd[:, mechanism.v_slices[n]].any() or model.states.q[:, mechanism.q_slices[n]].any()
    ]


def _list_smooth_target(model: Model) -> list[str]:
    return [] if model.base.case.motion.jumps or not model.states.qd.any() else [""]


def _make_inertia_change(change: Callable[[Inertia, float], Inertia]) -> Change:
    """Return the change of the inertia of one body, or with target "" of all."""

    def apply_change(subject: Subject, target: str, size: Array) -> Subject:
        factor = 1.0 + check_fraction(size)
        if target:
            return subject.replace_body(target, lambda b: replace(b, inertia=change(b.inertia, factor)))

        def update_link(one: Link) -> Link:
            return replace(one, bodies=tuple(replace(b, inertia=change(b.inertia, factor)) for b in one.bodies))

        return subject.replace_links(update_link)

    return apply_change


def _make_body_targets(test: Callable[[Inertia], bool], single: bool = True) -> Targets:
    """Return the bodies whose inertia passes a test, and "" for all where there are two or more."""

    def list_targets(model: Model) -> list[str]:
        names = [n for n in list_bodies(model) if test(model.base.bodies[n][1].inertia)]
        return [*(names if single else []), *([""] if len(names) > 1 else [])]

    return list_targets


def _make_joint_scale(field: str) -> Change:
    def apply_change(subject: Subject, target: str, size: Array) -> Subject:
        factor = 1.0 + float(size[0])
        return subject.replace_joints(lambda j: replace(j, **{field: getattr(j, field) * factor}))

    return apply_change


def _make_several_joints_target(field: str) -> Targets:
    """Return the one target where two joints or more have a number: of one it is a cause of that joint."""
    return lambda model: [""] if sum(bool(getattr(j, field)) for j in model.base.mechanism.joints if j.nv) > 1 else []


def _scale_placement(place: Placement, factor: float) -> Placement:
    return replace(place, position=place.position * factor)


def _scale_lengths(subject: Subject, target: str, size: Array) -> Subject:
    """Scale every length that the mechanism has: placements, centres of mass, tips, beams, closures, springs, forces."""
    factor = 1.0 + check_fraction(size)

    def update_joint(one: Joint) -> Joint:
        return replace(one, placement=_scale_placement(one.placement, factor))

    def update_link(one: Link) -> Link:
        made = tuple(replace(b, inertia=b.inertia.replace_unchecked(com=b.inertia.com * factor)) for b in one.bodies)
        beam = one.beam and replace(
            one.beam, length=one.beam.length * factor, placement=_scale_placement(one.beam.placement, factor)
        )
        return replace(one, bodies=made, tip=one.tip * factor, beam=beam)

    def update_attachment(one: Attachment) -> Attachment:
        return replace(one, placement=_scale_placement(one.placement, factor))

    def update_closure(one: Closure) -> Closure:
        return replace(one, first=update_attachment(one.first), second=update_attachment(one.second))

    mechanism = subject.mechanism
    springs = tuple(
        replace(s, first=update_attachment(s.first), second=update_attachment(s.second), rest=s.rest * factor)
        for s in mechanism.springs
    )
    forces = tuple(replace(f, at=update_attachment(f.at)) for f in mechanism.forces)
    return (
        subject.replace_links(update_link)
        .replace_joints(update_joint)
        .replace_closures(update_closure)
        .replace_mechanism(springs=springs, forces=forces)
    )


def _drop_accelerations(subject: Subject, target: str, size: Array) -> Subject:
    return subject.add_state_change(_make_acceleration_change(0.0))


ROWS = (
    Cause(
        "effort scale of all",
        "all efforts {target} are larger by the fraction {size} (a unit: ft lb, kgf m, N mm)",
        _scale_efforts,
        _list_effort_units,
        covers=("effort sign",),
        shows=QUICK,
        fraction=True,
    ),
    Cause(
        "coordinate scale",
        "the motion of {target} is larger by the fraction {size} (degrees, a transmission)",
        _make_motion_change(_scale_coordinate),
        _list_prescribed_joints,
        shows="this joint moved alone to several places",
        fraction=True,
    ),
    Cause(
        "speed scale",
        "all speeds are larger by the fraction {size} where the engine gets them",
        _make_motion_change(_scale_speeds),
        list_moving_tree_target,
        covers=("velocity terms dropped",),
        shows=STEADY,
        fraction=True,
    ),
    Cause(
        "acceleration terms dropped",
        "the accelerations of the joints are missing: the mechanism is held still along its path",
        _drop_accelerations,
        list_moving_tree_target,
        0,
        shows=QUICK,
    ),
    Cause(
        "acceleration scale",
        "all accelerations are larger by the fraction {size} where the engine gets them",
        _make_motion_change(_scale_accelerations),
        list_moving_tree_target,
        covers=("acceleration terms dropped",),
        shows=QUICK,
        fraction=True,
    ),
    Cause(
        "time scale",
        "the motion is faster by the fraction {size} (another clock)",
        _scale_pace,
        _list_smooth_target,
        shows="a long motion: what another clock shifts grows with time",
        fraction=True,
    ),
    Cause(
        "length scale",
        "all lengths differ by the fraction {size} (a unit)",
        _scale_lengths,
        list_global_target,
        shows=HOLD,
        fraction=True,
    ),
    Cause(
        "centres of mass scaled",
        "the centre of mass of {target} is farther out by the fraction {size}",
        _make_inertia_change(lambda inertia, factor: inertia.replace_unchecked(com=inertia.com * factor)),
        _make_body_targets(lambda inertia: bool(inertia.com.any())),
        shows=HOLD,
        fraction=True,
    ),
    Cause(
        "inertia scale",
        "all inertia tensors differ by the fraction {size} (a unit)",
        _make_inertia_change(lambda inertia, factor: inertia.replace_unchecked(tensor=inertia.tensor * factor)),
        _make_body_targets(lambda inertia: bool(inertia.tensor.any()), single=False),
        shows=QUICK,
        fraction=True,
    ),
    Cause(
        "mass without inertia",
        "the mass of {target} differs by the fraction {size}, its inertia about the centre of mass does not",
        _make_inertia_change(lambda inertia, factor: inertia.replace_unchecked(mass=inertia.mass * factor)),
        _make_body_targets(lambda inertia: bool(inertia.tensor.any())),
        shows=HOLD,
        fraction=True,
    ),
    Cause(
        "rotor inertia scale",
        "the rotor inertia (armature) of all joints differs by the fraction {size} (a gear ratio squared)",
        _make_joint_scale("rotor_inertia"),
        _make_several_joints_target("rotor_inertia"),
        covers=("rotor inertia dropped",),
        shows="a quick motion of the joints with large rotors",
        fraction=True,
    ),
    Cause(
        "damping scale",
        "the viscous damping of all joints differs by the fraction {size} (degrees, a unit)",
        _make_joint_scale("damping"),
        _make_several_joints_target("damping"),
        covers=("damping dropped",),
        shows=STEADY,
        fraction=True,
    ),
    Cause(
        "friction scale",
        "the dry friction of all joints differs by the fraction {size} (a unit)",
        _make_joint_scale("friction"),
        _make_several_joints_target("friction"),
        covers=("friction dropped",),
        shows=STEADY,
        fraction=True,
    ),
)
