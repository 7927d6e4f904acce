"""A lead-in for Exudyn: a motion that starts with speed or acceleration begins earlier, from rest.

Exudyn finds its initial accelerations without what the motion prescribes and takes none from outside; from rest they are
right.  Rigid links forget how they came to a place: where the drives stand and how they move at t = 0 is all that counts,
so the run begins at t = -T and what it sees before 0 is dropped.  Over s = 1 + t / T from 0 to 1 every driven coordinate has
the speed

    w(s) = s^3 (c_0 + c_1 (s - 1) + c_2 (s - 1)^2)

that starts with two derivatives zero and meets speed, acceleration and jerk of the motion:
c_0 = v,  c_1 = T a - 3 c_0,  2 c_2 = T^2 j - 6 c_0 - 6 c_1.  Beams do not forget: for them there is no lead-in.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import Polynomial

from crosscheck.engines.exudyn.models.frames import Array, compute_scalar_coordinate, take_joint_q
from crosscheck.engines.shared import loop_closure as assembly
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Joint, Mechanism

# A motion starts in motion when its first rate or acceleration is more than this part of its largest.  A lead-in costs little;
# refused, for beams, is more than the 1e-5 that a spline through samples leaves of an acceleration that is zero (measured).
STARTED = 1e-6
REFUSED = 1e-3
# Steps of the coarsest run in a lead-in: s^3 rises smoothly enough for errors of h^2 to be those of the motion itself.
STEPS = 100
# A start with speed v takes at least 3 v / a of the largest acceleration a, for its own to be no larger.
RISE = 3.0
SCALAR = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class ExtendedMotion:
    """A motion of the driven joints, extended to times before 0.

    lead : [s]; before : by joint, its coordinate [rad], [m] as a polynomial of s
    """

    mechanism: Mechanism
    case: Case
    lead: float = 0.0
    before: dict[str, Polynomial] | None = None

    def __call__(self, time: Array) -> tuple[Array, Array, Array]:
        """Return q (samples, nq), qd, qdd (samples, nv) [rad] or [m], [s] at times from -lead on [s]."""
        q, qd, qdd = self.case.motion.evaluate(self.mechanism, np.maximum(time, 0.0))
        early = time < 0.0
        s = 1.0 + time[early] / self.lead if self.lead else time[early]
        for name, place in (self.before or {}).items():
            joint = self.mechanism.joint_of[name]
            columns = self.mechanism.v_slices[name]
            q[early, self.mechanism.q_slices[name]] = _convert_to_coordinates(joint, place(s))
            qd[early, columns] = (place.deriv()(s) / self.lead)[:, None]
            qdd[early, columns] = (place.deriv(2)(s) / self.lead**2)[:, None]
        return q, qd, qdd


def _convert_to_coordinates(joint: Joint, value: Array) -> Array:
    if joint.kind == "continuous":
        return np.stack([np.cos(value), np.sin(value)], axis=1)  # (sample, cos or sin)
    return value[:, None]


def list_joints_in_motion(mechanism: Mechanism, case: Case) -> list[Joint]:
    """Return the driven joints that start with speed or acceleration."""
    _, qd, qdd = case.motion.evaluate(mechanism, np.linspace(0.0, case.end, 101))
    moving = np.zeros(mechanism.nv, dtype=bool)
    for rate in (qd, qdd):
        moving |= np.abs(rate[0]) > (REFUSED if mechanism.flexible else STARTED) * np.abs(rate).max(axis=0)
    free = assembly.find_unprescribed_joints(mechanism, case)
    return [j for j in mechanism.joints if j.nv and j.name not in free and moving[mechanism.v_slices[j.name]].any()]


def describe_refusal(mechanism: Mechanism, case: Case) -> str | None:
    """Return the reason why a start in motion cannot be led into, or None."""
    joints = list_joints_in_motion(mechanism, case)
    if not joints or not mechanism.closures:
        return None
    words = "starts in motion: Exudyn finds its initial accelerations without those of the motion and takes none from outside"
    if mechanism.flexible:
        return f"joint {joints[0].name} {words}, and how a link that bends came to its start is not known"
    odd = [j for j in joints if j.kind not in SCALAR]
    return f"joint {odd[0].name} {words}; a lead-in is there for joints of one coordinate" if odd else None


def build_history(mechanism: Mechanism, case: Case, step: float) -> ExtendedMotion:
    """Return the motion with a lead-in where it needs one.  step : of the coarsest run [s]"""
    joints = list_joints_in_motion(mechanism, case)
    if not joints or not mechanism.closures:
        return ExtendedMotion(mechanism, case)
    _, qd, qdd = case.motion.evaluate(mechanism, np.linspace(0.0, case.end, 101))
    largest = np.abs(qdd).max(axis=0)
    speed = np.abs(qd[0])
    acceleration = np.where(largest > 0.0, largest, np.inf)
    longest = float((RISE * speed / acceleration).max())
    lead = step * max(STEPS, int(np.ceil(min(longest, case.end) / step)))
    return ExtendedMotion(
        mechanism,
        case,
        lead,
        {joint.name: _fit_lead_polynomial(mechanism, case, joint, lead, step) for joint in joints},
    )


def _fit_lead_polynomial(mechanism: Mechanism, case: Case, joint: Joint, lead: float, step: float) -> Polynomial:
    """Return the coordinate before 0 as a polynomial of s."""
    q, qd, qdd = case.motion.evaluate(mechanism, step * np.arange(3.0))
    column = mechanism.v_slices[joint.name].start
    v = lead * qd[0, column]
    a = lead**2 * qdd[0, column]
    jerk = (
        lead**3 * (-3 * qdd[0, column] + 4 * qdd[1, column] - qdd[2, column]) / (2 * step)
    )  # of second order, at the start
    s = Polynomial([0.0, 1.0])
    first = a - 3 * v
    second = (jerk - 6 * v - 6 * first) / 2
    travelled: Polynomial = (s**3 * (v + first * (s - 1) + second * (s - 1) ** 2)).integ()
    now = compute_scalar_coordinate(joint, take_joint_q(mechanism, joint, q))[0]
    place: Polynomial = travelled - travelled(1.0) + now
    return place


def move_force_times(mechanism: Mechanism, lead: float) -> Mechanism:
    """Return a mechanism whose given forces come later by a lead-in [s], in the time that Exudyn counts from its start."""
    return replace(mechanism, forces=tuple(replace(f, time=f.time + lead) for f in mechanism.forces))
