"""Identification: planted parameters come back within their stated uncertainties, noise that lasts included."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from crosscheck.measured.fit import Fit, Parameter, bar_of_parameters, deviation_of_explained, explained, identify
from flexinv.errors import InputError

Array = NDArray[np.float64]
TIME = np.arange(0.0, 40.0, 0.01)
RATE = np.sin(1.3 * TIME) + 0.6 * np.sin(2.9 * TIME)
LASTS = 0.9  # of an error is left in the next sample: it lasts 10 samples
PLANTED = {"viscous": 2.5, "coulomb": 1.5, "lag": 0.2}
OPEN = (
    Parameter("viscous", "N m s/rad", 1.0, 1.0, 0.0),
    Parameter("coulomb", "N m", 1.0, 1.0, 0.0),
    Parameter("lag", "s", 0.1, 0.1, 0.0),
)
EVERYTHING = np.ones((TIME.size, 2), dtype=bool)


def drive(value: Mapping[str, float]) -> Array:
    """A drive with friction, and a sensor of the first order that lags: nonlinear in its last parameter."""
    torque = value["viscous"] * RATE + value["coulomb"] * np.tanh(RATE / 0.05)
    decay = np.exp(-0.01 / value["lag"])
    return np.column_stack([torque, lfilter([1.0 - decay], [1.0, -decay], RATE)])


def noise(seed: int) -> Array:
    white = np.random.default_rng(seed).normal(size=(TIME.size, 2)) * [0.1, 0.02]
    return np.asarray(lfilter([1.0], [1.0, -LASTS], white, axis=0))


def errors(lags: int, seeds: int = 30) -> Array:
    """Identified less planted over the stated uncertainty, (seeds, parameters)."""
    fits = [identify(drive, drive(PLANTED) + noise(s), EVERYTHING, OPEN, lags) for s in range(seeds)]
    return np.array([[(f.value[n] - PLANTED[n]) / f.uncertainty[n] for n in PLANTED] for f in fits])


def test_planted_parameters_come_back_within_their_uncertainties() -> None:
    """The errors of 30 records have the stated deviation: their mean square is 1, to the spread of 90 numbers of which
    those of one record hang together, and what the estimate misses of errors that last longer than its lags."""
    scaled = errors(lags=60)
    assert 0.6 < np.mean(scaled**2) < 1.8
    assert np.abs(scaled).max() < 4.5  # 90 normal numbers stay below 3; the uncertainty is itself uncertain by a third
    assert np.all(np.abs(np.mean(scaled, axis=0)) < 3 / np.sqrt(30))  # no bias


def test_uncertainties_that_take_every_sample_as_news_are_too_small() -> None:
    """What the test above would say of the textbook's formula: errors that last count once, not 20 times."""
    assert np.mean(errors(lags=1) ** 2) > 5.0


def test_without_noise_the_parameters_are_exact() -> None:
    found = identify(drive, drive(PLANTED) + 1e-9 * noise(0), EVERYTHING, OPEN, 60)
    # 1e-4: where least squares stop, relative to the last step, which converges quadratically
    assert found.value == pytest.approx(PLANTED, rel=1e-6)


def test_samples_that_do_not_count_change_nothing() -> None:
    used = EVERYTHING.copy()
    used[300:500, 0] = False
    spoilt = drive(PLANTED) + noise(1)
    clean = identify(drive, spoilt, used, OPEN, 60)
    spoilt[300:500, 0] += 1e3
    again = identify(drive, spoilt, used, OPEN, 60)
    assert again.value == clean.value
    assert again.uncertainty == clean.uncertainty


def test_a_shuffled_record_explains_nothing() -> None:
    """Identified from torques in another order: of the unseen half nothing is left to explain but chance."""
    measured = (drive(PLANTED) + noise(2))[:, :1]
    half = TIME.size // 2
    shuffled = np.random.default_rng(3).permutation(measured[:half])

    def torque(value: Mapping[str, float]) -> Array:
        return drive({**PLANTED, **value})[:, :1]

    def of_unseen(seen: Array) -> float:
        found = identify(lambda v: torque(v)[:half], seen, EVERYTHING[:half, :1], OPEN[:2], 60)
        return explained(measured[half:], torque(found.value)[half:])

    assert of_unseen(measured[:half]) > 0.95
    assert of_unseen(shuffled) < 0.2


def test_parameters_that_the_record_cannot_tell_are_named() -> None:
    """A joint that only ever stands says nothing about its friction."""
    with pytest.raises(InputError, match="the record says nothing about viscous, coulomb"):
        identify(lambda v: 0.0 * drive(v), noise(0), EVERYTHING, (*OPEN[:2], Parameter("lag", "s", 0.1, 0.1, 1e-3)), 60)


def test_explained_and_its_deviation() -> None:
    measured = np.sin(TIME)
    used = np.ones(TIME.size, dtype=bool)
    assert explained(measured, measured + 1.0) == pytest.approx(1.0)  # a constant is no variance
    assert explained(measured, np.zeros(TIME.size)) == pytest.approx(0.0, abs=1e-12)
    assert explained(measured, -measured) == pytest.approx(-3.0)
    assert deviation_of_explained(measured, measured, used, 50) == 0.0
    # White signals, n samples, residual r and signal y: var(r^2 / y^2) = 4 / n of its square; from 80 blocks to a tenth.
    signal, residual = np.random.default_rng(4).normal(size=(2, TIME.size)) * [[1.0], [0.3]]
    share = 0.09 / 1.09
    found = deviation_of_explained(signal + residual, signal, used, 50)
    assert found == pytest.approx(share * np.sqrt(4 / TIME.size), rel=0.3)


def test_bars_of_parameters_are_those_of_a_linear_model() -> None:
    fit = Fit({"a": 2.0, "b": 1.0}, {"a": 0.1, "b": 0.2}, np.ones(1), np.array([[0.01, 0.01], [0.01, 0.04]]))
    bars = bar_of_parameters(
        lambda v: v["a"] * np.array([[1.0], [0.0], [1.0]]) + v["b"] * np.array([[0.0], [1.0], [1.0]]), fit
    )
    assert bars[:, 0] == pytest.approx(np.sqrt([0.01, 0.04, 0.07]))
