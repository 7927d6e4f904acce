"""The certificate as evidence: a cause has to explain what the engine's own model says of itself as well.

The certificate asks what no motion of a case shows: mass, first moment and inertia of all that every joint carries, mass
matrix and gravity torque at other configurations, axes, stiffness of beams.  A cause that the motion names is out where it
would change what is right there, or would leave what is wrong.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from crosscheck.causes.fit import IMPOSSIBLE, SMALL, Fit, effect
from crosscheck.causes.model import Model
from crosscheck.causes.subject import Array
from crosscheck.certificate import EXACT, PROBED, Certificate
from crosscheck.engines.flexinv_certificate import certify

AGREES = 0.1  # of what the certificates differ by, or of what the cause would change: sizes of fits are as sure as that
PROBE = 1e-4  # of a size that matters: differences of certificates for their derivatives
ROUNDS = 4  # of Gauss-Newton: tensors, masses and mass matrices are of second order in any size
LINES = {
    "mass": EXACT,
    "masses": EXACT,
    "moments": EXACT,
    "inertias": EXACT,
    "beam_masses": PROBED,
    "beam_moments": PROBED,
    "com": EXACT,
    "mass_matrix": EXACT,
    "gravity": EXACT,
    "axes": EXACT,
    "stiffness": PROBED,
}


@dataclass(frozen=True)
class Evidence:
    """What an engine's own model says of itself, what the reference says of the mechanism, and the difference in motion.

    residual : of the motion (samples nv,) over the range [-]
    """

    model: Model
    residual: Array
    theirs: Certificate
    ours: Certificate

    def hear(self, fit: Fit, enough: float) -> Fit | None:
        """Return the fit if what it would change in the model is what is wrong in the engine's, else None.

        Sizes of several numbers, of which the motion may not show all, are fitted to the certificates before they are
        given up.  enough : what an explanation may leave of the motion's difference [-]
        """
        try:
            if self._agrees(fit):
                return fit if fit.left <= enough else None
            again = self._fitted(fit) if fit.cause.parameters > 1 else fit
            return again if again is not fit and again.left <= enough and self._agrees(again) else None
        except IMPOSSIBLE:
            return fit if fit.left <= enough else None

    def _agrees(self, fit: Fit) -> bool:
        said, part = self._predicted(fit, fit.size), AGREES + min(fit.left, AGREES)
        return all(_line(name, limit, self.theirs, self.ours, said, part) for name, limit in LINES.items())

    def _predicted(self, fit: Fit, size: Array) -> Certificate:
        """Return what the reference would say of a harmed mechanism, of its tree: closures have lines of their own."""
        base = self.model.base
        harmed = fit.cause.change(base, fit.target, size).mechanism
        return self.ours if harmed is base.mechanism else certify(replace(harmed, closures=()), base.case, "flexinv")

    def _column(self, said: Certificate) -> Array:
        """Return a certificate's numbers that both engines have, over the size of their line, as one column [-]."""
        found = [np.zeros(0)]
        for name in LINES:
            a, b, c = (_parts(getattr(one, name)) for one in (self.theirs, self.ours, said))
            size = max((float(np.abs(one).max(initial=0.0)) for one in b.values()), default=0.0) or 1.0
            found += [c[key].ravel() / size for key in sorted(b) if key in a and a[key].shape == b[key].shape]
        return np.concatenate(found)

    def _fitted(self, fit: Fit) -> Fit:
        """Return the fit with the size that explains the certificates best (Gauss-Newton from the motion's)."""
        zero, size = self._column(self.ours), fit.size
        measured = self._column(self.theirs) - zero
        units, step = np.eye(len(size)), PROBE * fit.cause.scale(self.model, fit.target)
        for _ in range(ROUNDS):
            here = self._column(self._predicted(fit, size))
            # Central differences: a turn about an axis of symmetry changes nothing to the accuracy of ``SMALL``.
            ends = [[self._column(self._predicted(fit, size + s * unit)) for s in (step, -step)] for unit in units]
            slope = np.stack([(up - down) / (2 * step) for up, down in ends], axis=1)
            size = size + np.linalg.lstsq(slope, measured - (here - zero), rcond=SMALL)[0]
        column = effect(self.model, fit.cause, fit.target, size)
        left = float(np.linalg.norm(self.residual - column) / np.linalg.norm(self.residual))
        return replace(fit, size=size, left=left, column=column)


def _line(name: str, limit: float, theirs: Certificate, ours: Certificate, said: Certificate, part: float) -> bool:
    """Whether what a cause would change in one line of the certificate is what is wrong there, to a part of it [-]."""
    a, b, c = (_parts(getattr(one, name)) for one in (theirs, ours, said))
    size = max((float(np.abs(b[key]).max(initial=0.0)) for key in b), default=0.0)
    for key in b:
        if key not in a or key not in c or not a[key].shape == b[key].shape == c[key].shape:
            continue
        measured, predicted = a[key] - b[key], c[key] - b[key]
        scale = max(float(np.linalg.norm(measured)), float(np.linalg.norm(predicted)))
        own = float(np.abs(b[key]).max(initial=0.0)) if limit == PROBED else size
        if scale > limit * own and float(np.linalg.norm(measured - predicted)) > part * scale:
            return False
    return True


def _parts(value: Any) -> dict[str, Array]:
    """Return the numbers of one line by name; a line that is not there has none."""
    if value is None:
        return {}
    named = value if isinstance(value, Mapping) else {"": value}
    return {key: np.asarray(one, dtype=np.float64) for key, one in named.items()}
