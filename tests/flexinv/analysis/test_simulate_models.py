"""Forward of inverse is the identity for every model of models/: with the same step and scheme, to a millionth of the range.

Of each model a window of its motion is taken, short where it falls (arms that stand, legs, a humanoid: an error grows e-fold in
0.1 to 0.3 s), with a step small enough for the second-order error of the forward march.  Nothing is left out, but:
a free base without a drive (talos) gets the wrench that it needs as a force, dry friction is seen where joints move faster than
its slope (1e-3 rad/s), and where closures begin or cease to act torques jump, which the table says with two rows at that time.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

import flexinv
from flexinv.analysis.solution import Solution
from flexinv.errors import InputError
from flexinv.files.load_cases import Case, load_cases
from flexinv.model.mechanism import Attachment, Body, Force, Inertia, Joint, Link, Mechanism, Placement
from flexinv.typing import Array

MILLIONTH = 1e-6


@dataclass(frozen=True)
class Window:
    """Part of a case: from ``first`` on for ``length`` [s], in steps [s]."""

    step: float
    first: float
    length: float
    case: str = ""


# Where an arm begins with a window, its beams begin undeformed (or in equilibrium) with the joints' rates there.
WINDOWS = {
    "andrews_squeezer": Window(2e-6, 0.0, 0.01, "turn"),
    "bricard": Window(5e-4, 0.0, 0.5),
    "double_pendulum": Window(1e-4, 0.0, 0.5),
    "elastic_drives": Window(2e-4, 0.3, 0.2),
    "five_bar": Window(1e-4, 0.0, 0.4),
    "five_bar_redundant": Window(1e-4, 0.0, 0.4),
    "flex_one_link": Window(1e-4, 0.0, 0.3),
    "flex_one_link_damped": Window(1e-4, 0.0, 0.3),
    "flex_two_link": Window(1e-4, 0.0, 0.3),
    "four_bar": Window(2e-4, 0.0, 0.5),
    "four_bar_bracket": Window(1e-4, 0.0, 0.1),
    "four_bar_flexible": Window(1e-4, 0.0, 0.1),
    "geared_four_bar": Window(2e-4, 0.0, 0.5),
    "kuka_kr300": Window(2e-4, 0.3, 0.2),
    "meshed_arm": Window(1e-4, 0.1, 0.1),
    "panda": Window(2e-4, 0.3, 0.1),
    "quanser_2dsfl": Window(2e-4, 0.3, 0.3),
    "quanser_2dsfl_rigid": Window(2e-4, 0.3, 0.3),
    "rigid_3r": Window(1e-4, 0.0, 0.3),
    "rigid_one_link": Window(1e-4, 0.0, 0.2),
    "screw_lift": Window(1e-4, 0.2, 0.2),
    "slider_crank": Window(1e-4, 0.0, 0.4),
    "slider_crank_flexible": Window(1e-5, 0.0, 0.01),
    "slider_crank_meshed": Window(1e-4, 0.0, 0.1),
    "spatial_arm": Window(1e-4, 0.0, 0.2),
    "stewart_platform": Window(2e-4, 0.0, 0.2),
    "talos": Window(2e-4, 0.4, 0.05),
    "talos_arm": Window(2e-4, 0.65, 0.1),
    "two_arms": Window(5e-5, 0.4, 0.2),  # they grasp at 0.5 s
    # they release at 1.0 s: what a step of 1e-4 s does not resolve of that is in no torque that is given at its ends alone
    "two_arms_flexible": Window(1e-5, 0.95, 0.1),
    "ur5": Window(2e-4, 0.0, 0.3),
    "ur5_flexible_forearm": Window(2.5e-4, 0.2, 0.1),
    "ur5_meshed_forearm": Window(1e-4, 0.2, 0.1),
    "walker": Window(2e-4, 1.25, 0.1),  # a foot lands at 1.3 s
}


# Loads that creep: one joint does not move (of no way there is no part), the other is held against a dead load by its torque
# alone and falls away from any rounding, as a pendulum on its head does.
STILL = {"princeton_beam", "reissner_cantilever"}


@dataclass(frozen=True)
class ShiftedMotion:
    """A motion seen from a later time on; what `solve` asks of a motion."""

    motion: flexinv.Motion
    first: float
    duration: float

    @property
    def jumps(self) -> tuple[float, ...]:
        return tuple(t - self.first for t in self.motion.jumps if t > self.first)

    def joints(self, m: Mechanism) -> tuple[str, ...]:
        return self.motion.joints(m)

    def evaluate(self, m: Mechanism, time: Array, side: str = "right") -> tuple[Array, Array, Array]:
        return self.motion.evaluate(m, np.asarray(time) + self.first, side)  # type: ignore[arg-type]


def seen_from(m: Mechanism, first: float) -> Mechanism:
    """The mechanism whose closures act as much earlier."""
    later = (tuple((round(a - first, 9), round(b - first, 9)) for a, b in c.active if b > first) for c in m.closures)
    closures = (replace(c, active=times) for c, times in zip(m.closures, later, strict=True) if times or not c.active)
    return replace(m, closures=tuple(closures))


def places(m: Mechanism, q: Array) -> dict[str, Array]:
    return {j.name: q[m.q_slices[j.name]] for j in m.joints if j.nv}


def guess(m: Mechanism, case: Case, first: float) -> dict[str, Array]:
    """Where the joints that the motion leaves out are at a time, from the case itself."""
    start = dict(case.start)
    if first and m.closures:
        last = case.step * round(first / case.step)
        coarse = flexinv.solve(m, case.motion, case.step, end=last, start=start, initial=case.initial)
        passive = set(places(m, coarse.q[-1])) - set(case.motion.joints(m))
        start = {name: place for name, place in places(m, coarse.q[-1]).items() if name in passive}
    return start


def table(m: Mechanism, motion: ShiftedMotion, one: Solution, options: dict[str, object]) -> tuple[Array, Array]:
    """Times and torques, with both limits where closures begin or cease to act: the first from a solution that ends there."""
    time, torque = one.time, one.torque
    switches = {t for c in m.closures for span in c.active for t in span if 0.0 < t < time[-1]}
    for switch in sorted(switches, reverse=True):
        k = int(np.argmin(np.abs(one.time - switch)))
        before = flexinv.solve(m, motion, end=float(one.time[k]), **options)  # type: ignore[arg-type]
        time, torque = np.insert(time, k, one.time[k]), np.insert(torque, k, before.torque[-1], axis=0)
    return time, torque


def held(m: Mechanism, one: Solution) -> Mechanism:
    """With the wrench that a free base without a drive needs, as a force on it."""
    forces = []
    for j in m.joints:
        if j.kind == "free" and not m.closures:
            wrench = one.torque_all[:, m.v_slices[j.name]]
            forces.append(Force(j.name, Attachment(j.child, Placement()), wrench, one.time, follower=True))
    return replace(m, forces=(*m.forces, *forces))


def there_and_back(root: Path, model: str, window: Window) -> float:
    """Largest difference of joint coordinates over their largest range in the window."""
    folder = root / "models" / model
    whole = flexinv.load_mechanism(folder)
    cases = load_cases(folder, whole)
    case = cases[window.case] if window.case else next(iter(cases.values()))
    whole = case.meshed(whole)
    m, motion = seen_from(whole, window.first), ShiftedMotion(case.motion, window.first, window.length)
    start = guess(whole, case, window.first)
    options: dict[str, object] = {"step": window.step, "start": start, "initial": case.initial}
    one = flexinv.solve(m, motion, **options)  # type: ignore[arg-type]
    time, torque = table(m, motion, one, options)
    rates = {j.name: one.qd[0, m.v_slices[j.name]] for j in m.joints if j.nv}
    begin = {"start": places(m, one.q[0]), "start_rate": rates, "initial": case.initial}
    two = flexinv.simulate(held(m, one), time, torque, window.step, **begin)  # type: ignore[arg-type]
    return float(abs(two.q - one.q).max() / np.ptp(one.q, axis=0).max())


def test_torques_that_jump_are_not_a_ramp(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the limit before the grasp its torque acts too early, and the hands miss the bar."""
    monkeypatch.setattr(sys.modules[__name__], "table", lambda m, motion, one, options: (one.time, one.torque))
    with pytest.raises(InputError, match=r"closure 'left' begins to act on frames that"):
        there_and_back(root, "two_arms", WINDOWS["two_arms"])


def test_a_driven_free_joint_is_refused() -> None:
    floating = Mechanism(
        "block", (Link("block", (Body("block", Inertia(1.0)),)),), (Joint("base", "free", "world", "block"),)
    )
    with pytest.raises(InputError, match=r"free joint 'base' of 'block' has a drive.*follower=True"):
        flexinv.simulate(floating, [0.0, 1.0], np.zeros((2, 6)), step=0.1)


def test_what_starts_while_it_moves_is_in_equilibrium(root: Path) -> None:
    """Equilibrium before the start does not know with what rates the joints will begin."""
    m = flexinv.load_mechanism(root / "models" / "spatial_arm")
    case = load_cases(root / "models" / "spatial_arm", m)["reach"]
    moving = flexinv.solve(m, ShiftedMotion(case.motion, 0.5, 1e-3), 1e-3, initial="static")  # type: ignore[arg-type]
    names = {j.name for j in m.joints if j.nv}
    still = flexinv.Motion.point_to_point(*2 * [{n: moving.q[0, m.q_slices[n]] for n in names}], duration=1e-3)
    rests = flexinv.solve(m, still, 1e-3, initial="static")
    for link, bend in rests.deflection.items():
        np.testing.assert_allclose(moving.deflection[link][0], bend[0], rtol=0, atol=1e-12)


def test_every_model_is_here(root: Path) -> None:
    assert {p.parent.name for p in (root / "models").glob("*/mechanism.toml")} == set(WINDOWS) | STILL


@pytest.mark.slow
@pytest.mark.parametrize("model", WINDOWS)
def test_forward_of_inverse_is_the_identity(root: Path, model: str) -> None:
    assert there_and_back(root, model, WINDOWS[model]) <= MILLIONTH
