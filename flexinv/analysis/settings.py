"""Settings of a call: what a public verb was told beside its task, checked and gathered at once."""

from __future__ import annotations

from dataclasses import dataclass

from flexinv.dynamics.generalized_alpha import EXACT, Scheme, generalized_alpha
from flexinv.validation import number

Words = dict[str, float | int | str | bool]


@dataclass(frozen=True)
class Settings:
    """Options of a time integration and of the second step.

    step : between samples [s]; spectral_radius : numerical damping [-]; initial : "consistent" or "static"
    incremental : accelerations are differences of nodal positions
    tolerance : of Newton over the mechanism's length [-], None where a verb has its own
    every : of so many steps one is kept [-]; statics : one sample at rest, nothing is integrated
    """

    step: float = 0.0
    spectral_radius: float = 0.8
    initial: str = "consistent"
    incremental: bool = False
    tolerance: float | None = EXACT
    every: int = 1
    statics: bool = False

    @property
    def scheme(self) -> Scheme:
        """Return the scheme of the time integration [s], [-]; raises InputError for numbers that give none."""
        return generalized_alpha(self.step, self.spectral_radius, EXACT if self.tolerance is None else self.tolerance)

    def words(self) -> Words:
        """Return the settings as a Solution records them [s], [-]."""
        if self.statics:
            return {"statics": True, "incremental": False}
        out: Words = {
            "step": self.step, "spectral_radius": self.spectral_radius, "initial": self.initial,
            "incremental": self.incremental,
        }  # fmt: skip
        return out if self.tolerance is None else {**out, "tolerance": self.tolerance}


def checked(step: float, spectral_radius: float, tolerance: float, initial: str = "consistent") -> Settings:
    """Return the settings of a march at steps of ``step`` [s]; raises InputError for values that cannot be."""
    radius = number("spectral_radius", spectral_radius, "0 (strong) to 1 (no numerical damping), for example 0.8")
    left = number("tolerance", tolerance, "a part of the mechanism's length, for example 1e-9")
    generalized_alpha(float(step), radius, left)  # numbers that give no scheme are an error here
    return Settings(float(step), radius, initial, tolerance=left)
