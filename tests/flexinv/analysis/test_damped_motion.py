"""Damped beams in motion: decay against theory, objectivity, order, balances, and ratios of modes."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from flexible_examples import STRIP, arm, observed_order, torque_range
from planar_examples import damped, quick, two_links
from scipy.optimize import least_squares

import flexinv
from flexinv.errors import InputError
from flexinv.linearized.modal_damping import apply_damping_ratio
from flexinv.linearized.natural_modes import natural_modes
from flexinv.model.mechanism import Beam, Inertia, Joint, Link, Mechanism, with_retardation
from flexinv.typing import Array

EPS = np.finfo(float).eps
ETA = 2e-3  # s: a ratio of 0.063 in the first mode of the paper's link, 63 rad/s
STROKE = 1e-3  # rad: small, as the theory's motions are; what is not linear is its square


def decay(mechanism: Mechanism, step: float) -> tuple[float, float]:
    """Rates a, b of exp(-a t) (c cos bt + s sin bt) [1/s], [rad/s], fitted to the tip when the hub has come to rest.

    0.15 s later: the second mode, 394 rad/s, has then decayed by exp(-0.39 * 394 * 0.15) = 1e-10.
    """
    motion = flexinv.Motion.point_to_point([0.0], [STROKE], 0.05, hold=0.55)
    solution = flexinv.solve(mechanism, motion, step, spectral_radius=1.0)
    late = solution.time > 0.2
    time, tip = solution.time[late] - 0.2, solution.deflection["link"][late, 1] / STROKE

    def missed(p: Array) -> Array:
        wave = p[2] * np.cos(p[1] * time) + p[3] * np.sin(p[1] * time)
        return np.asarray(np.exp(-p[0] * time) * wave - tip)

    p = least_squares(missed, [2.0, 60.0, tip[0], 0.0], x_scale=[1.0, 60.0, 0.01, 0.01], xtol=1e-14, ftol=1e-14).x
    return float(p[0]), float(p[1])


def test_free_decay_is_that_of_theory() -> None:
    """a = eta omega^2 / 2, b = omega sqrt(1 - (eta omega / 2)^2): two steps and their extrapolation."""
    mechanism = with_retardation(arm(), ETA)
    omega = float(np.sqrt(natural_modes(mechanism).squared[0]))
    exact = np.array([ETA * omega**2 / 2, omega * np.sqrt(1 - (ETA * omega / 2) ** 2)])
    errors = [np.array(decay(mechanism, h)) / exact - 1 for h in (1e-3, 5e-4)]
    assert np.abs(errors[0]).max() < (omega * 1e-3) ** 2  # second order: the part of a radian that a step is, squared
    # extrapolated: the fourth power of it, 1e-6, and the stroke's square
    assert np.abs((4 * errors[1] - errors[0]) / 3).max() < (omega * 5e-4) ** 4 + STROKE**2
    decrement = 2 * np.pi * exact[0] / exact[1]
    assert decrement == pytest.approx(np.pi * ETA * omega, rel=(ETA * omega) ** 2)  # its form for light damping
    assert abs(decay(with_retardation(arm(), 1.01 * ETA), 1e-3)[0] / exact[0] - 1) > (omega * 1e-3) ** 2


def test_a_beam_bent_by_its_rotation_dissipates_nothing() -> None:
    """A curved beam that turns at 20 rad/s: while it yields it dissipates, and no more once it turns as one piece.

    What is left is the step's: on a circle the scheme's velocities are off by a part (w h)^2, and power is their square.
    """
    mechanism = with_retardation(arm(), 5e-3)
    link = mechanism.links[0]
    assert link.beam is not None
    curved = replace(mechanism, links=(replace(link, beam=replace(link.beam, curvature=np.array([0.0, 0.0, 2.0]))),))
    turning = flexinv.Motion.from_samples(*_spun_up(20.0))
    result = [flexinv.solve(curved, turning, h, end=1.5) for h in (1e-3, 5e-4)]
    left = [s.balance.dissipated[-1] for s in result]
    assert left[0] / left[1] == pytest.approx(16.0, rel=0.05)  # the fourth power; the sixth is (w h)^2 = 4e-4 of it
    assert left[1] < 2e-3 * result[1].balance.dissipated.max()
    elastic = result[1].balance.elastic
    assert elastic[-1] > 0.02 * elastic.max()  # it is bent all the time


def _spun_up(rate: float) -> tuple[Array, Array]:
    """Angle of a hub that goes from rest to ``rate`` within 0.2 s, by a sine, and keeps it."""
    time = np.arange(0.0, 1.5005, 1e-3)
    s = np.minimum(time / 0.2, 1.0)
    angle = rate * 0.2 * (s**2 / 2 + (np.cos(2 * np.pi * s) - 1) / (4 * np.pi**2)) + rate * np.maximum(time - 0.2, 0.0)
    return time, angle[:, None]


def test_rest_positions_know_no_damping() -> None:
    mechanism = arm(gravity=(0.0, -9.81, 0.0))
    hold = flexinv.Motion.point_to_point([0.0], [0.0], 0.01)
    bare, wet = (flexinv.solve(m, hold, 1e-3, initial="static") for m in (mechanism, with_retardation(mechanism, 1.0)))
    np.testing.assert_array_equal(wet.nodes.x[0], bare.nodes.x[0])
    np.testing.assert_array_equal(wet.torque[0], bare.torque[0])
    # it stays: Newton leaves increments of 1e-15 of the length, over a step, times the damping of unit time
    assert np.abs(wet.balance.dissipated).max() < 1e-15


@pytest.mark.parametrize("name", ["plane", "space"])
def test_second_order_and_balanced_work(name: str) -> None:
    """Torques converge with the square of the step; work given is energy stored and energy dissipated."""
    flat, motion = damped(two_links(1, 3), 3.0), quick(1.0, -0.5, 0.8)
    hub, elbow, two = flat.joints
    mechanism = (
        flat if name == "plane" else replace(flat, joints=(hub, replace(elbow, axis=np.array([0.6, 0.0, 0.8])), two))
    )
    steps = [2e-3, 1e-3, 5e-4, 2.5e-4]
    result = [flexinv.solve(mechanism, motion, h) for h in steps]
    every = [s.torque_all[:: 2**k] for k, s in enumerate(result)]
    errors = [float(np.abs(a - b).max()) for a, b in itertools.pairwise(every)]
    assert observed_order(errors) == pytest.approx(2.0, abs=0.2)  # the next term is the step's square, 5 % here
    for s in result:  # at every instant, to rounding: forces are 1e3 of what rounding of unit strains leaves
        assert np.abs(s.power_residual).max() < 1e-9 * np.abs(s.torque_all * s.qd).max()
        assert np.abs(s.torque_all - s.reaction).max() < 1e-9 * torque_range(s.torque_all)
    left = [float(np.abs(s.balance.work).max()) for s in result]
    assert observed_order(left) == pytest.approx(2.0, abs=0.2)
    lost = float(np.trapezoid(result[-1].balance.dissipated, result[-1].time))
    assert lost > 100 * left[-1]  # it would be seen if it were forgotten
    assert np.all(result[-1].balance.dissipated >= 0.0)


def test_one_ratio_gives_those_of_all_modes() -> None:
    mechanism, seconds, modes = apply_damping_ratio(arm(), 0.01, mode=2)
    result = natural_modes(mechanism)
    omega = np.sqrt(result.squared)
    assert result.ratio[1] == pytest.approx(0.01, rel=1e-12)
    # D is seen as a difference by velocities beside which the stiffness is 1e-8: 1e-13 of the largest one
    np.testing.assert_allclose(result.ratio, seconds * omega / 2, rtol=1e-7)
    np.testing.assert_allclose(modes.ratio, result.ratio, rtol=1e-7)
    assert natural_modes(arm()).ratio.max() == 0.0


def test_a_damper_in_a_free_joint_damps_its_mode() -> None:
    """A rod that swings about its end: ratio c / (2 omega J)."""
    inertia = Inertia(1.2, np.array([0.25, 0.0, 0.0]), np.diag([0.0, 0.025, 0.025]))
    rod = Link("rod", (flexinv.model.links.Body("rod", inertia),))
    joint = Joint("q", "revolute", "world", "rod", damping=0.03, friction=0.5)
    modes = natural_modes(Mechanism("rod", (rod,), (joint,), gravity=np.array([9.81, 0.0, 0.0])), free=["q"])
    about_end = 0.025 + 1.2 * 0.25**2
    omega = np.sqrt(1.2 * 9.81 * 0.25 / about_end)
    np.testing.assert_allclose(modes.ratio, 0.03 / (2 * omega * about_end), rtol=1e-12)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: with_retardation(arm(), -1.0), "expected one number >= 0 or six"),
        (lambda: with_retardation(arm(), [1.0, 2.0]), "expected one number >= 0 or six"),
        (lambda: apply_damping_ratio(arm(), 2.0), "expected 0 to 1"),
        (lambda: apply_damping_ratio(arm(), 0.01, mode=99), "mode 99, expected 1 to"),
        (lambda: apply_damping_ratio(Mechanism("none", (), ()), 0.01), "has no beam"),
    ],
)
def test_what_cannot_be_is_refused(make: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        make()  # type: ignore[operator]


def test_six_times_damp_six_strains() -> None:
    times = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]) * 1e-4
    beam = with_retardation(arm(), times).links[0].beam
    assert isinstance(beam, Beam)
    np.testing.assert_array_equal(beam.section.damping, times * STRIP.stiffness)
