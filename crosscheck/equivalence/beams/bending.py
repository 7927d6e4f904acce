"""Torques of machines that bend, and what each difference of their beams does to them.

B with A's beams has to have B's torques once every difference is given its value of B.  Both run the same motion on the same
mesh: from the stress-free shape, within the limits of the joints, springs, forces and loops cut, so that their ringing is felt.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from crosscheck.equivalence.beams.sections import BeamDifference, MatchedBeams
from crosscheck.equivalence.difference import Difference
from crosscheck.equivalence.judge import Share, compute_effort_share
from flexinv.analysis.solve import solve
from flexinv.errors import FlexinvError
from flexinv.linearized.modal_damping import apply_stated_ratio
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Array, Joint, Mechanism
from flexinv.model.motion import Motion

# [s], [-]
DURATION = 1.0
STEPS = 100
SEED = 17
REACH = {"prismatic": 0.2}  # [m]; others turn:
TURN = 0.7  # [rad]


@dataclass(frozen=True)
class BeamEffects:
    """Differences of beams with their effects; the largest difference of a torque before and after all are put right.

    notes : what has to be said of them: why torques could not be computed, which beams the certificate has
    """

    differences: tuple[Difference, ...] = ()
    before: Share = (0.0, 0.0, "")
    after: Share = (0.0, 0.0, "")
    notes: tuple[str, ...] = ()


def compute_beam_effects(beams: MatchedBeams) -> BeamEffects:
    """Return the differences of two machines' beams, each with what it alone does to a torque [N m], [N]."""
    alone = tuple(beams.list_lone_beams())
    bent = list(beams.list_differences())
    if not any(True for _ in beams.both):
        return BeamEffects(alone)
    mixed = beams.first.modal_damping is None or beams.second.modal_damping is None
    if mixed and (beams.first.modal_damping or beams.second.modal_damping):
        beams = replace(beams, first=apply_stated_ratio(beams.first), second=apply_stated_ratio(beams.second))
        beams = replace(beams, first=_drop_modal_damping(beams.first), second=_drop_modal_damping(beams.second))
        bent = list(beams.list_differences())
    try:
        base = beams.build_base_mechanism()
        flexible_torques = compute_flexible_torques(beams.second)
        before, whole = (compute_flexible_torques(_apply_edits(base, some)) for some in ([], bent))
        found = [_compute_beam_effect(base, bent, one, whole, flexible_torques) for one in bent]
    except FlexinvError as error:
        words = f"torques of links that bend are not compared: {' '.join(str(error).split())[:300]}"
        return BeamEffects((*alone, *(one.difference for one in bent)), notes=(words,))
    notes = ("the certificate has A's beams on both sides: what beams differ by is in the table",) if found else ()
    return BeamEffects(
        (*alone, *found),
        compute_effort_share(before, flexible_torques, flexible_torques),
        compute_effort_share(whole, flexible_torques, flexible_torques),
        notes,
    )


def _drop_modal_damping(mechanism: Mechanism) -> Mechanism:
    """A mechanism whose damping its sections state."""
    return replace(mechanism, modal_damping=None)


def _apply_edits(base: Mechanism, bent: Iterable[BeamDifference]) -> Mechanism:
    for one in bent:
        base = one.edit(base)
    return base


def _compute_beam_effect(
    base: Mechanism, bent: list[BeamDifference], one: BeamDifference, whole: dict[str, Array], wanted: dict[str, Array]
) -> Difference:
    """The difference with what leaving it out, alone, changes."""
    without = compute_flexible_torques(_apply_edits(base, (other for other in bent if other is not one)))
    share, effort, _ = compute_effort_share(without, whole, wanted)
    return replace(one.difference, effect=effort, share=share)


def compute_flexible_torques(mechanism: Mechanism) -> dict[str, Array]:
    """Return the efforts by joint (samples, nv) [N m], [N] of a mechanism that bends, loops cut, along the motion of all joints.

    Raises ConvergenceError, InputError.
    """
    joints = tuple(replace(joint, actuated=True) for joint in mechanism.joints)
    tree = replace(apply_stated_ratio(mechanism), joints=joints, closures=(), springs=(), forces=())
    found = solve(tree, make_exciting_motion(tree), step=DURATION / STEPS).torque_all
    return {joint.name: found[:, tree.v_slices[joint.name]] for joint in tree.joints if joint.nv}


def make_exciting_motion(mechanism: Mechanism) -> Motion:
    """Return a motion from near zero, within limits, that every joint of one coordinate takes part in [rad], [m]."""
    rng = np.random.default_rng(SEED)
    start = {}
    end = {}
    for joint in mechanism.joints:
        if joint.nv:
            start[joint.name], end[joint.name] = _sample_motion_ends(joint, rng)
    return Motion.point_to_point(start, end, DURATION, law="septic")


def _sample_motion_ends(joint: Joint, rng: np.random.Generator) -> tuple[Array, Array]:
    size = rng.uniform(0.5, 1.0, joint.nv) * rng.choice([-1.0, 1.0], joint.nv)
    kind = KINDS[joint.kind]
    if kind.has_quaternion:
        still = np.zeros(joint.nq)
        still[-1] = 1.0
        return still, still
    low = joint.limits.lower
    high = joint.limits.upper
    first = np.clip(np.zeros(joint.nv), low, high)
    last = np.clip(first + size * REACH.get(joint.kind, TURN), low, high)
    return first, np.where(
        np.abs(last - first) > 0, last, np.clip(first - size * REACH.get(joint.kind, TURN), low, high)
    )
