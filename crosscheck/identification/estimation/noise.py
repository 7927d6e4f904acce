"""Noise of the channels, told by residuals: its standard deviation, and how many neighbouring samples count as one.

Parameters make up for a part of the noise, of its slow part above all, and what is left is smaller and less alike.  With noise
e_c of covariance S_c (samples, samples), z^ - z = C (sum_d w_d^2 J_d^T e_d - R u), u the truth less the prior:

    E r_c r_c^T = S_c - w_c^2 (J_c C (S_c J_c)^T + its transpose) + J_c C (G + R) C J_c^T,   G = sum_d w_d^4 J_d^T S_d J_d

C : covariance of the parameters, R : precision of the priors, w_c = 1 / (s_c n_c^0.5).  The autocovariance of the noise is that
of the residuals and what the parameters take away from it, lag by lag, repeated until it stays; n_c = 1 + 2 sum rho_l up to the
first that is not positive.  (For white noise: restricted maximum likelihood, Patterson and Thompson, Biometrika 58, 1971.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded when they are asked for
from numpy.typing import NDArray

from flexinv.typing import Array

ROUNDS = 8  # at most
STEADY = 0.01  # relative change of all weights at which they end


@dataclass(frozen=True)
class Noise:
    """Of each channel: standard deviation s [unit of the channel], and samples that agree n [-], (channels,)."""

    spread: Array
    agree: Array

    @property
    def weight(self) -> Array:
        """1 / (s n^0.5), (channels,) [1 / unit of the channel]."""
        return 1.0 / (self.spread * np.sqrt(self.agree))


def compute_noise(residuals: Sequence[Array], slopes: Sequence[Array], root: Array) -> Noise:
    """Return the noise behind residuals [units of the channels].

    residuals : (counted,) per channel; slopes : (counted, parameters) by the parameters that were fitted to them
    root : square root of the precision of the priors (parameters, parameters)
    """
    seen = [compute_autocovariance(r) for r in residuals]
    behind = [_take_positive_lags(lags) for lags in seen]
    lasting = np.array([r.mean() for r in residuals])
    noise = _build_noise(behind, lasting)
    spectra = [_Slopes.build_for(j) for j in slopes]
    for _ in range(ROUNDS):
        before = noise
        absorbed = _compute_absorbed_part(behind, noise, spectra, root)
        behind = [
            _take_positive_lags(_add_absorbed_part(lags, more)) for lags, more in zip(seen, absorbed, strict=True)
        ]
        noise = _build_noise(behind, lasting)
        if np.abs(noise.weight / before.weight - 1.0).max() < STEADY:
            break
    return noise


def compute_autocovariance(residual: Array) -> Array:
    """Return ``sum_t r_t r_(t+l) / N`` of each lag l (samples,) [unit^2], r less its mean: a constant is no noise."""
    centred = (residual - residual.mean())[:, None]
    return _compute_correlation(centred, centred) / len(centred)


def count_agreeing_samples(residual: Array) -> float:
    """Return the number of neighbouring samples (samples,) that count as one [-]: 1 + 2 sum rho_l up to the first rho_l <= 0."""
    positive_lags = _take_positive_lags(compute_autocovariance(residual))
    return _count(positive_lags) if positive_lags[0] > 0.0 else 1.0


def _build_noise(behind: Sequence[Array], lasting: Array) -> Noise:
    """Return the noise of samples and of logs: one that lasts through a log tells nothing of samples that agree."""
    spread = np.sqrt(np.array([lags[0] for lags in behind]) + lasting**2)
    return Noise(spread, np.array([_count(lags) if lags[0] > 0.0 else 1.0 for lags in behind]))


def _count(alike: Array) -> float:
    return float(max(1.0, 2.0 * alike.sum() / alike[0] - 1.0))


def _add_absorbed_part(lags: Array, more: Array) -> Array:
    """The autocovariance (samples,) [unit^2] with what parameters took away, as it is where that leaves no noise at all.

    What was known before is a part of what remains, and is taken off: under weights that are far too small, more than there is.
    """
    return lags + more if lags[0] + more[0] > 0.0 else lags


def _take_positive_lags(lags: Array) -> Array:
    """Lags up to the first that is not positive (lags,) [unit^2]."""
    return lags[: max(1, int(np.argmax(lags <= 0.0)) if (lags <= 0.0).any() else len(lags))]


@dataclass(frozen=True)
class _Slopes:
    """Slopes (counted, parameters) by the parameters, and their spectrum over ``size`` samples [-], with room for all lags.

    spectrum : (2 frequencies, parameters), real parts and then imaginary ones: products with real matrices are half the work
    """

    slopes: Array
    size: int
    spectrum: Array

    @classmethod
    def build_for(cls, slopes: Array) -> _Slopes:
        size = scipy.fft.next_fast_len(2 * len(slopes), real=True)
        return cls(slopes, size, _split_spectrum(np.fft.rfft(slopes, size, axis=0)))

    def apply_noise_covariance(self, alike: Array) -> Array:
        """The covariance of the noise times slopes: its lags on both sides of each sample (counted, parameters) [unit^2]."""
        both = np.zeros(self.size)
        both[: len(alike)] = alike
        both[self.size - len(alike) + 1 :] = alike[:0:-1]
        real, imaginary = np.split(self.spectrum, 2)
        spectrum = np.fft.rfft(both).real[:, None]  # symmetric: its imaginary part is nothing
        all_of = np.fft.irfft(spectrum * real + 1j * (spectrum * imaginary), self.size, axis=0)
        return np.asarray(all_of[: len(self.slopes)])


def _compute_absorbed_part(
    behind: Sequence[Array], noise: Noise, slopes: Sequence[_Slopes], root: Array
) -> list[Array]:
    """Return the part of the autocovariance that the parameters take away, (samples,) per channel [unit^2]."""
    square = noise.weight**2
    spread = [j.apply_noise_covariance(lags) for lags, j in zip(behind, slopes, strict=True)]
    precision = root.T @ root
    hessian = sum((w * j.slopes.T @ j.slopes for w, j in zip(square, slopes, strict=True)), precision)
    covariance = np.linalg.inv(hessian)
    driven = sum((w**2 * j.slopes.T @ s for w, j, s in zip(square, slopes, spread, strict=True)), precision)
    out = []
    for w, j, s in zip(square, slopes, spread, strict=True):
        # The sums of both orders of a product are each other's complex conjugates: of their spectra only the real part is left.
        both = 2.0 * w * np.einsum("fp,fp->f", j.spectrum @ covariance, _split_spectrum(np.fft.rfft(s, j.size, axis=0)))
        lags = np.einsum("fp,fp->f", j.spectrum @ (covariance @ driven @ covariance), j.spectrum)
        out.append(np.fft.irfft(np.sum(np.split(both - lags, 2), axis=0), j.size)[: len(s)] / len(s))
    return out


def _split_spectrum(spectrum: NDArray[np.complex128]) -> Array:
    """Real parts of a spectrum (frequencies, parameters), and the imaginary ones below them."""
    return np.vstack([spectrum.real, spectrum.imag])


def _compute_correlation(a: Array, b: Array) -> Array:
    """``sum_t a_t . b_(t+l)`` of each lag l (samples,)."""
    size = scipy.fft.next_fast_len(2 * len(a), real=True)
    power = (np.fft.rfft(a, size, axis=0).conj() * np.fft.rfft(b, size, axis=0)).sum(axis=1)
    return np.asarray(np.fft.irfft(power, size)[: len(a)])
