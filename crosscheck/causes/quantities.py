"""All that an engine gave as evidence: a cause has to explain joint forces, tips, deflections and axial forces, too.

Of every quantity that both engines give, what a cause does to flexinv's own is taken off the difference.  What is left has to
be as small as the two engines agree where nothing is wrong: their error bars, the limit that is stated, or rounding.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from crosscheck.causes.cause import Cause
from crosscheck.causes.fit import IMPOSSIBLE, PROBE, SMALL, Fit
from crosscheck.causes.model import Model
from crosscheck.measures.limits import find
from crosscheck.measures.record import Record, Series
from crosscheck.verdicts.bars import find_checked_bar
from crosscheck.verdicts.compare import COMPARED, compute_signal_range, scale_of, split_by_unit
from flexinv.typing import Array

# Exact engines: rounding of some thousand operations, times the condition of loops, of the range.
ROUNDING = 1e-9
# Times the level at which engines agree: bars are estimates, of the unharmed mechanism, and sizes are as sure as they are.
SURE_TIMES = 3.0
# Of the largest difference of a quantity, of marches: what the long step of the columns leaves (`model.STEPS`).
MARCHED = 0.05
ROUNDS = {True: 3, False: 1}  # of Gauss-Newton on all quantities, by whether the mechanism is rigid


@dataclass(frozen=True)
class Quantities:
    """Series of an engine beside those of a reference, of one case.

    agreed : by series [unit]: how far the engines are apart where nothing is wrong; series without one say nothing
    """

    model: Model
    engine: Mapping[str, Series]
    reference: Mapping[str, Series]
    agreed: Mapping[str, float]

    def list_contradictions(self, fit: Fit) -> tuple[str, ...]:
        """Return the quantities that a cause leaves unexplained, or would change where they are right; raises like a run."""
        if fit.cause.linear:
            return ()  # only the amplitude of its effect on the efforts is known
        harmed = self.model.collect_series(fit.cause.change(self.model.base, fit.target, fit.size))
        found = dict.fromkeys(
            name.split("/", 1)[0]
            for name in self._list_common_names(harmed)
            if not self._is_explained(name, harmed[name].values, fit)
        )
        return tuple(q for q in found if q not in fit.cause.unsaid)

    def fit_size(self, fit: Fit) -> Fit:
        """Return the fit with the size that explains all quantities best (Gauss-Newton from that of the efforts)."""
        cause = fit.cause
        size = fit.size
        base = self.model.base
        step = PROBE[base.mechanism.is_rigid] * cause.scale(self.model, fit.target)
        for _ in range(ROUNDS[base.mechanism.is_rigid]):
            here = self.model.collect_series(cause.change(base, fit.target, size))
            names = self._list_common_names(here)
            left = self._assemble_column(names, self.engine, self.reference) - self._assemble_column(
                names, here, self.model.unharmed
            )
            moved = [self._compute_series_or_none(fit, size + step * u) or here for u in np.eye(len(size))]
            slope = np.stack([self._assemble_column(names, one, here) / step for one in moved], axis=1)
            size = size + np.linalg.lstsq(slope, left, rcond=SMALL)[0]
        return replace(fit, size=size)

    def list_deviating_quantities(self) -> dict[str, float]:
        """Return the quantities in which the engines are farther apart than they agree, each over its range [-]."""
        deviating_quantities: dict[str, float] = {}
        for name in self._list_common_names(self.model.unharmed):
            size = float(np.abs(self.engine[name].values - self.reference[name].values).max())
            if size > self.agreed[name]:
                whole = scale_of_one(self.reference, name)
                deviating_quantities[name.split("/", 1)[0]] = max(
                    deviating_quantities.get(name.split("/", 1)[0], 0.0), size / whole
                )
        return deviating_quantities

    def compute_difference(self) -> Array:
        """Return the difference of the engines in all quantities, over how far they may be apart, as one column [-]."""
        return self._assemble_column(self._list_common_names(self.model.unharmed), self.engine, self.reference)

    def fit_linearly(self, cause: Cause, target: str) -> Fit:
        """Return the linear fit of a cause to all quantities; raises like a run."""
        rigid = self.model.base.mechanism.is_rigid
        base = self.model.base
        if not cause.sized:
            return self.evaluate_fit(Fit(cause, target, np.ones(1), 1.0, np.zeros(0)))
        step = PROBE[rigid] * cause.scale(self.model, target)
        moved = [self.model.collect_series(cause.change(base, target, step * u)) for u in np.eye(cause.parameters)]
        names = [
            n for n in self._list_common_names(self.model.unharmed) if all(n in one for one in moved)
        ]  # not all reactions stay unique
        difference = self._assemble_column(names, self.engine, self.reference)
        slope = np.stack([self._assemble_column(names, one, self.model.unharmed) / step for one in moved], axis=1)
        size = np.linalg.lstsq(slope, difference, rcond=SMALL)[0]
        left = float(np.linalg.norm(difference - slope @ size) / np.linalg.norm(difference))
        return Fit(cause, target, np.asarray(size), left, np.asarray(slope @ size))

    def evaluate_fit(self, fit: Fit) -> Fit:
        """Return a fit with what it explains of all quantities at its size, and what it leaves [-]; raises like a run."""
        harmed = self.model.collect_series(fit.cause.change(self.model.base, fit.target, fit.size))
        names = self._list_common_names(harmed)
        difference = self._assemble_column(names, self.engine, self.reference)
        column = self._assemble_column(names, harmed, self.model.unharmed)
        return replace(
            fit, column=column, residual=float(np.linalg.norm(difference - column) / np.linalg.norm(difference))
        )

    def _compute_series_or_none(self, fit: Fit, size: Array) -> Mapping[str, Series] | None:
        """Return all that flexinv gives with another size, None where it leaves no mechanism that runs."""
        try:
            return self.model.collect_series(fit.cause.change(self.model.base, fit.target, size))
        except IMPOSSIBLE:
            return None

    def _assemble_column(self, names: list[str], a: Mapping[str, Series], b: Mapping[str, Series]) -> Array:
        """Return the differences of series, over how far the engines may be apart, as one column [-]."""
        parts = [(a[n].values - b[n].values) / self.agreed[n] for n in names if self.agreed[n]]
        return np.concatenate(parts) if parts else np.zeros(0)

    def _list_common_names(self, harmed: Mapping[str, Series]) -> list[str]:
        names = (n for n, s in self.engine.items() if s.quantity in COMPARED and n in self.agreed)
        return [n for n in names if n in harmed and n in self.model.unharmed]

    def _is_explained(self, name: str, harmed: Array, fit: Fit) -> bool:
        seen = self.engine[name].values - self.reference[name].values
        told = harmed - self.model.unharmed[name].values
        allowed = SURE_TIMES * self.agreed[name] + self._compute_uncertainty(name, told, fit)
        return bool(np.abs(seen - told).max() <= allowed)

    def _compute_uncertainty(self, name: str, told: Array, fit: Fit) -> float:
        """Return the uncertainty of a quantity by the size of a fit and the long step of columns [unit]."""
        part = min(MARCHED, fit.residual) if self.model.base.mechanism.is_rigid else MARCHED
        return part * float(np.abs(told).max())


def scale_of_one(reference: Mapping[str, Series], name: str) -> float:
    """Return the range by which the error of a series is divided, that of all of its quantity and unit [its unit]."""
    one = reference[name]
    alike = [s.values for s in reference.values() if (s.quantity, s.unit) == (one.quantity, one.unit)]
    return compute_signal_range(alike) or 1.0


def collect_quantities(model: Model, engine: Record, reference: Record) -> Quantities:
    """Return all that two records have in common, with the bars, limits [of the range] and rounding that they agree to."""
    agreed: dict[str, float] = {}
    limits = model.base.case.limits
    rigid = model.base.mechanism.is_rigid
    for quantity in COMPARED:
        limit = find(limits, quantity, engine.engine, reference.engine, engine.version)
        for names in split_by_unit(reference.series, quantity).values():
            scale = scale_of(reference, quantity, [reference.series[n].values for n in names])
            stated = 0.0 if limit is None else limit.maximum * scale
            for name in (n for n in names if n in engine.series):
                bar = sum(find_checked_bar(one, name) or 0.0 for one in (engine, reference))
                known = max(bar, stated, ROUNDING * scale if rigid else 0.0)
                if known or scale == 0.0:
                    agreed[name] = known
    return Quantities(model, engine.series, reference.series, agreed)
