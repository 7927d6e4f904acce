"""Input shapers: what they leave of a vibration is their closed form, and a shaped motion is the sum of its parts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import scipy

from flexinv.errors import InputError
from flexinv.model.input_shaper import InputShaper
from flexinv.model.make_shaper import make_shaper
from flexinv.model.mechanism import WORLD, Joint, Link, Mechanism
from flexinv.model.motion import Motion
from flexinv.typing import Array

FREQUENCY = 2.0  # [Hz]
HINGE = Mechanism("hinge", (Link("arm"),), (Joint("hinge", "revolute", WORLD, "arm"),))
BAND = np.linspace(0.1, 1.9, 181)


def test_zv_and_zvd_leave_what_their_closed_forms_say() -> None:
    """Without damping |cos(pi r / 2)| and its square, of modes at r times the frequency; 1e-14 is rounding of four sums."""
    cosine = np.abs(np.cos(np.pi * BAND / 2))
    assert np.abs(make_shaper("ZV", FREQUENCY).compute_vibration(BAND * FREQUENCY) - cosine).max() < 1e-14
    assert np.abs(make_shaper("ZVD", FREQUENCY).compute_vibration(BAND * FREQUENCY) - cosine**2).max() < 1e-14


@pytest.mark.parametrize("ratio", [0.0, 0.02, 0.1, 0.25])
def test_zvd_leaves_nothing_and_has_no_slope_at_a_damped_mode(ratio: float) -> None:
    shaper = make_shaper("ZVD", FREQUENCY, ratio)
    beside = shaper.compute_vibration(FREQUENCY * np.array([1.0 - 1e-4, 1.0, 1.0 + 1e-4]), ratio)
    assert beside[1] < 1e-14
    # V of ZV grows by pi/2 of the change of r, 1.6e-4, a double zero by its square; damping changes neither by a factor of two.
    assert beside.max() < 5e-8
    assert make_shaper("ZV", FREQUENCY, ratio).compute_vibration(FREQUENCY * 1.0001, ratio) > 5e-5


def test_ei_without_damping_is_its_closed_form() -> None:
    shaper = make_shaper("EI", FREQUENCY, vibration=0.05)
    assert shaper.parts == pytest.approx([0.2625, 0.475, 0.2625], abs=1e-14)
    assert shaper.times == pytest.approx([0.0, 0.25, 0.5], abs=1e-14)


@pytest.mark.parametrize("ratio", [0.01, 0.1, 0.3])
@pytest.mark.parametrize("vibration", [0.02, 0.05, 0.2])
def test_ei_leaves_what_is_allowed_in_a_wider_band_than_zvd(ratio: float, vibration: float) -> None:
    shaper = make_shaper("EI", FREQUENCY, ratio, vibration)
    left = shaper.compute_vibration(BAND * FREQUENCY, ratio)
    assert float(shaper.compute_vibration(FREQUENCY, ratio)) == pytest.approx(
        vibration, abs=1e-9
    )  # the solver's own bound
    allowed = BAND[left <= vibration * (1.0 + 1e-9)]
    narrower = make_shaper("ZVD", FREQUENCY, ratio).compute_vibration(BAND * FREQUENCY, ratio)
    assert len(allowed) > np.count_nonzero(narrower <= vibration)
    assert np.ptp(allowed) == pytest.approx(0.01 * (len(allowed) - 1))  # one band, without a hole at the mode
    zeros = left[1:-1][(left[1:-1] < left[:-2]) & (left[1:-1] < left[2:])]
    assert len(zeros) == 2  # one on each side


@pytest.mark.parametrize("kind", ["ZV", "ZVD", "EI"])
def test_an_oscillator_keeps_the_stated_part(kind: str) -> None:
    """A damped oscillator on a moving base 10 % off the frequency, marched by SciPy to 1e-9: 1e-5 is left of the ratio."""
    ratio = 0.03
    shaper = make_shaper(kind, FREQUENCY, ratio)
    plain = Motion.point_to_point({"hinge": 0.0}, {"hinge": 1.0}, 0.3, law="septic")
    w = 2 * np.pi * FREQUENCY * 1.1
    kept = _compute_amplitude(plain.shaped(shaper), w, ratio) / _compute_amplitude(plain, w, ratio)
    assert kept == pytest.approx(float(shaper.compute_vibration(FREQUENCY * 1.1, ratio)), rel=1e-5)


def _compute_amplitude(motion: Motion, w: float, ratio: float) -> float:
    """Amplitude [rad] of x'' + 2 z w x' + w^2 x = -q'' at the end of a motion."""

    def move(t: float, state: Array) -> Array:
        push = motion.evaluate(HINGE, [t])[2][0, 0]
        return np.array([state[1], -push - 2 * ratio * w * state[1] - w**2 * state[0]])

    march = scipy.integrate.solve_ivp(move, (0.0, motion.duration), np.zeros(2), rtol=1e-9, atol=1e-12, max_step=0.01)
    x, v = march.y[:, -1]
    return float(np.hypot(x, (v + ratio * w * x) / (w * np.sqrt(1.0 - ratio**2))))


def test_a_shaper_of_two_modes_is_both_in_any_order() -> None:
    """Times add to rounding; at each mode nothing is left, and elsewhere the product of both."""
    one = make_shaper("ZVD", 2.0, 0.02)
    other = make_shaper("ZV", 5.3, 0.01)
    both = make_shaper("ZVD", [2.0, 5.3])
    assert both.compute_vibration([2.0, 5.3]).max() < 1e-14
    there = one.join(other)
    back = other.join(one)
    assert np.abs(there.times - back.times).max() < 1e-15
    assert np.abs(there.parts - back.parts).max() < 1e-15
    frequencies = np.linspace(1.0, 7.0, 40)
    product = one.compute_vibration(frequencies, 0.02) * other.compute_vibration(frequencies, 0.02)
    assert np.abs(there.compute_vibration(frequencies, 0.02) - product).max() < 1e-14


def test_parts_at_one_time_are_one() -> None:
    """Two ZV of one frequency are its ZVD: the two middle parts meet."""
    twice = make_shaper("ZV", 2.0, 0.1).join(make_shaper("ZV", 2.0, 0.1))
    assert twice.parts == pytest.approx(make_shaper("ZVD", 2.0, 0.1).parts, abs=1e-15)


def test_a_shaped_motion_is_the_sum_of_its_parts() -> None:
    """Of a law and of samples: places, rates and accelerations."""
    shaper = InputShaper([0.0, 0.11, 0.3], [0.5, 0.3, 0.2])
    time = np.linspace(0.0, 1.5, 301)
    samples = np.linspace(0.0, 1.0, 30)
    plain = {
        "law": Motion.point_to_point({"hinge": -0.3}, {"hinge": 2.0}, 0.7, hold=0.1, law="quintic", delay=0.1),
        "samples": Motion.from_samples(samples, {"hinge": np.sin(2.0 * samples) ** 3}, rest=True),
    }
    for motion in plain.values():
        shaped = motion.shaped(shaper)
        assert shaped.duration == pytest.approx(motion.duration + 0.3, abs=1e-15)
        for k, whole in enumerate(shaped.evaluate(HINGE, time)):
            parts = [motion.evaluate(HINGE, time - begin)[k] for begin in shaper.times]
            off = np.abs(whole - np.tensordot(shaper.parts, np.array(parts), 1)).max()
            assert off < 1e-13 * max(
                1.0, np.abs(whole).max()
            )  # t - (delay + begin) rounds by 1e-16 s, at slopes of 1e3


def test_accelerations_jump_at_every_part() -> None:
    motion = Motion.point_to_point({"hinge": 0.0}, {"hinge": 1.0}, 0.4, law="bang-bang")
    shaped = motion.shaped(InputShaper([0.0, 0.15], [0.6, 0.4]))
    assert shaped.jumps == pytest.approx([0.0, 0.15, 0.2, 0.35, 0.4, 0.55])
    before = shaped.evaluate(HINGE, [0.15, 0.2], side="left")[2][:, 0]
    after = shaped.evaluate(HINGE, [0.15, 0.2], side="right")[2][:, 0]
    peak = 4.0 / 0.4**2
    assert after - before == pytest.approx([0.4 * peak, -2 * 0.6 * peak])


def test_rotations_go_in_parts_along_their_way() -> None:
    """Halfway in both parts the turn is half of the whole, about the same axis."""
    ball = Mechanism("ball", (Link("tool"),), (Joint("wrist", "spherical", WORLD, "tool"),))
    turned = [0.0, 0.6, 0.0, 0.8]
    motion = Motion.point_to_point({"wrist": [0.0, 0.0, 0.0, 1.0]}, {"wrist": turned}, 0.4)
    between = motion.shaped(InputShaper([0.0, 0.5], [0.5, 0.5])).evaluate(ball, [0.45])[0][0]
    half = np.array([0.0, 0.6, 0.0, 1.8]) / np.hypot(0.6, 1.8)
    assert between == pytest.approx(half, abs=1e-15)


def test_samples_of_rotations_are_refused() -> None:
    ball = Mechanism("ball", (Link("tool"),), (Joint("wrist", "spherical", WORLD, "tool"),))
    time = np.linspace(0.0, 1.0, 20)
    angle = 0.3 * time
    quaternions = np.stack([0 * angle, 0 * angle, np.sin(angle / 2), np.cos(angle / 2)], axis=1)
    shaped = Motion.from_samples(time, {"wrist": quaternions}).shaped(make_shaper("ZV", 2.0))
    with pytest.raises(InputError, match="samples of rotations are no sum of parts"):
        shaped.evaluate(ball, time)


def test_shaping_twice_is_shaping_for_both() -> None:
    one = make_shaper("ZV", 2.0)
    other = make_shaper("ZV", 5.0)
    motion = Motion.point_to_point({"hinge": 0.0}, {"hinge": 1.0}, 0.3)
    twice = motion.shaped(one).shaped(other)
    both = motion.shaped(one.join(other))
    assert twice.duration == pytest.approx(both.duration, abs=1e-15)  # the same sum in another order
    assert [track.shaper for track in twice.tracks] == [track.shaper for track in both.tracks]
    assert twice != motion.shaped(one)


def test_a_motion_of_another_kind_is_not_shaped() -> None:
    """Its own ``evaluate`` knows nothing of parts, and would leave them out."""

    class Reversed(Motion):
        pass

    plain = Motion.point_to_point({"hinge": 0.0}, {"hinge": 1.0}, 0.3)
    with pytest.raises(InputError, match="a Reversed has no parts"):
        Reversed(plain.tracks, plain.duration).shaped(make_shaper("ZV", 2.0))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: make_shaper("ZVDD", 2.0), "kind = "),
        (lambda: make_shaper("ZV", 0.0), "natural frequencies above 0"),
        (lambda: make_shaper("ZV", [2.0, np.nan]), "natural frequencies above 0"),
        (lambda: make_shaper("ZV", 2.0, 1.0), "does not swing"),
        (lambda: make_shaper("ZV", [2.0, 3.0], [0.1, 0.1, 0.1]), "one for each of 2 modes"),
        (lambda: make_shaper("EI", 2.0, vibration=0.0), "vibration = 0"),
        (lambda: make_shaper("EI", 2.0, 0.6), "write kind = 'ZVD'"),
        (lambda: InputShaper([0.0, 0.1], [0.5, 0.6]), "their sum is 1.1"),
        (lambda: InputShaper([0.1, 0.2], [0.5, 0.5]), "expected 0 first"),
        (lambda: InputShaper([0.0, 0.2], [1.0]), "one part for each time"),
        (lambda: Motion.point_to_point({"a": 0.0}, {"a": 1.0}, 1.0).shaped("ZV"), "shaper"),  # type: ignore[arg-type]
    ],
)
def test_shapers_that_cannot_be_are_refused(make: Callable[[], object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        make()
