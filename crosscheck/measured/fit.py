"""Identification: parameters by least squares, with uncertainties that know that residuals of neighbouring samples agree.

    y = f(p) + r,   p^ = argmin sum (r / sigma)^2,   cov p = H^-1 S H^-1,   H = J^T J
    S = sum_l (1 - |l| / L) sum_t s_t s_(t+l)^T

with the scores s_t = sum over channels of J_t^T r_t.  A residual that is model error and not noise has the same sign over
many samples: with the usual H^-1 sigma^2 each of them would count as news.  From records that are only some ten times as
long as their residuals last, the uncertainties come out too small, by a third or so.  S is the estimate of W. Newey and K. West,
"A simple, positive semi-definite, heteroskedasticity and autocorrelation consistent covariance matrix", Econometrica 55 (1987).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from flexinv.errors import InputError

Array = NDArray[np.float64]
Predict = Callable[[Mapping[str, float]], Array]
# Steps of the difference quotients, in scales of the parameters: above what a march's tolerance of 1e-10 makes of them.
STEP = 1e-4
# Relative, of parameters that are known to a hundredth at best.
CLOSE = 1e-4
# Residuals weigh by their channel's spread, which is only known when they are: the second round changes it by little.
ROUNDS = 2


@dataclass(frozen=True)
class Parameter:
    """Parameter to identify: start value, typical size and lower bound by its nature [unit of the parameter]."""

    name: str
    unit: str
    start: float
    scale: float
    lower: float = -np.inf


@dataclass(frozen=True)
class Fit:
    """Parameters with their standard uncertainties.

    value, uncertainty : name -> [unit of the parameter]; spread : (channels,) RMS residual [units of the channels]
    covariance : (parameters, parameters) [products of their units]
    """

    value: dict[str, float]
    uncertainty: dict[str, float]
    spread: Array
    covariance: Array


def identify(
    predict: Predict, measured: Array, used: NDArray[np.bool_], parameters: tuple[Parameter, ...], lags: int
) -> Fit:
    """Return the parameters [units of theirs] under which the prediction comes closest to what was measured.

    predict : values by name -> (samples, channels) as measured; used : (samples, channels) what counts
    measured : (samples, channels) [units of the channels]; lags : samples over which residuals may agree [-]
    Raises InputError: parameters that the prediction does not depend on.
    """
    names = [p.name for p in parameters]
    scale = np.array([p.scale for p in parameters])
    at = np.array([p.start for p in parameters]) / scale
    bounds = (np.array([p.lower for p in parameters]) / scale, np.inf)

    def residual(x: Array) -> Array:
        return np.where(used, measured - predict(dict(zip(names, x * scale, strict=True))), 0.0)

    def slopes_at(x: Array, weight: Array) -> Array:
        still = residual(x)
        moved = [residual(x + STEP * unit) for unit in np.eye(len(x))]
        return (
            np.stack([((m - still) / weight).ravel() for m in moved], axis=1) / STEP
        )  # (sample and channel, parameter)

    spread = rms(residual(at), used)
    for _ in range(ROUNDS):
        found = least_squares(
            lambda x, weight: (residual(x) / weight).ravel(),
            at,
            slopes_at,
            bounds,
            xtol=CLOSE,
            ftol=CLOSE / 10,
            args=(spread,),
        )
        at, weight, spread = found.x, spread, rms(residual(found.x), used)
    slopes = -found.jac.reshape(*measured.shape, len(names))  # (sample, channel, parameter), of the weighed prediction
    if silent := [n for n, slope in zip(names, np.abs(slopes).max(axis=(0, 1)), strict=True) if slope == 0.0]:
        raise InputError(f"the record says nothing about {', '.join(silent)}; write fewer parameters")
    both = covariance(slopes, residual(at) / weight, lags) * np.outer(scale, scale)
    value = dict(zip(names, (at * scale).tolist(), strict=True))
    return Fit(value, dict(zip(names, np.sqrt(np.diag(both)).tolist(), strict=True)), spread, both)


def rms(residual: Array, used: NDArray[np.bool_]) -> Array:
    """Return the root mean square of each channel over what counts, (channels,) [units of the channels]."""
    return np.asarray(np.sqrt(np.sum(np.where(used, residual, 0.0) ** 2, axis=0) / np.sum(used, axis=0)))


def covariance(slopes: Array, residual: Array, lags: int) -> Array:
    """Return the covariance (parameters, parameters) [product of units] of a least-squares fit.

    slopes : (samples, channels, parameters) of the prediction; residual : (samples, channels); lags : [-] samples
    """
    scores = np.einsum("scp,sc->sp", slopes, residual)  # (sample, parameter)
    total = scores.T @ scores
    for lag in range(1, min(lags, len(scores))):
        product = scores[lag:].T @ scores[:-lag]
        total += (1.0 - lag / lags) * (product + product.T)
    bread = np.linalg.inv(np.einsum("scp,scq->pq", slopes, slopes))
    return np.asarray(bread @ total @ bread)


def explained(measured: Array, predicted: Array, used: NDArray[np.bool_] | None = None) -> float:
    """Return the part of the variance that a prediction explains, ``1 - var(measured - predicted) / var(measured)`` [-]."""
    chosen = slice(None) if used is None else used
    return float(1.0 - np.var(measured[chosen] - predicted[chosen]) / np.var(measured[chosen]))


def deviation_of_explained(measured: Array, predicted: Array, used: NDArray[np.bool_], block: int) -> float:
    """Return the standard deviation of `explained` [-] by the jackknife: how much it hangs on single blocks of samples.

    measured, predicted : (samples,) [any unit]; block : samples that belong together [-]
    """
    groups = [k for k in np.array_split(np.arange(len(measured)), max(2, len(measured) // block)) if used[k].any()]
    without = []
    for group in groups:
        kept = used.copy()
        kept[group] = False
        without.append(explained(measured, predicted, kept))
    return float(np.sqrt((len(groups) - 1) * np.var(without)))


def bar_of_parameters(predict: Predict, fit: Fit) -> Array:
    """Return the standard deviation of a prediction (samples, channels) [units of the channels] that parameters cause."""
    at = predict(fit.value)
    moved = [predict({**fit.value, name: value + fit.uncertainty[name]}) for name, value in fit.value.items()]
    slopes = np.stack([(m - at) / u for m, u in zip(moved, fit.uncertainty.values(), strict=True)])  # (parameter, ...)
    return np.asarray(np.sqrt(np.einsum("psc,pq,qsc->sc", slopes, fit.covariance, slopes)))
