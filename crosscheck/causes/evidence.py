"""The certificate as evidence: a cause has to explain what the engine's own model says of itself as well.

The certificate asks what no motion of a case shows: mass, first moment and inertia of all that every joint carries, mass
matrix and gravity torque at other configurations, axes, stiffness of beams.  A cause that the motion names is out where it
would change what is right there, or would leave what is wrong; and where it leaves another quantity than the efforts
unexplained (`quantities`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from crosscheck.causes.fit import IMPOSSIBLE, SMALL, Candidate, Fit, compute_effect, fit_from
from crosscheck.causes.model import Model
from crosscheck.causes.quantities import Quantities
from crosscheck.engines.flexinv.certificate import build_certificate, collect_attachment_data
from crosscheck.measures.certificate import EACH, EXACT, MESHED, PROBED, Certificate, checks
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

AGREES = 0.1  # of what the certificates differ by, or of what the cause would change: no size is less sure than that
SURE_PART = 1e-5  # of the same: what a step of differences leaves of a size, however small the bars
LIMITS = 3.0  # times what is allowed in a line of the certificate where nothing is wrong
PROBE = 1e-4  # of a size that matters: differences of certificates for their derivatives
# Of the size of a line of the certificate: what a size that matters changes at least, in any direction, where it shows.
SHOWN = 1e-5
ROUNDS = 4  # of Gauss-Newton: tensors, masses and mass matrices are of second order in any size
LINES = {
    "mass": ("total mass", EXACT),
    "masses": ("masses by joint", EXACT),
    "moments": ("first moments by joint", EXACT),
    "inertias": ("inertias by joint", EXACT),
    "beam_masses": ("masses of beams", PROBED),
    "beam_moments": ("first moments of beams", PROBED),
    "com": ("centre of mass", EXACT),
    "mass_matrix": ("joint-space mass matrix", EXACT),
    "gravity": ("gravity torque", EXACT),
    "axes": ("joint axes", EXACT),
    "stiffness": ("section stiffness", PROBED),
    "part_stiffness": ("stiffness of meshes at interfaces", MESHED),
    "part_frequencies": ("frequencies of meshes", MESHED),
    "damping": ("joint damping", EXACT),
    "friction": ("joint friction", EXACT),
    "springs": ("springs", EXACT),
    "closure_points": ("closure points", EXACT),
    "closure_axes": ("closure axes", EXACT),
}
# Of closures: no cause of the dictionary changes them, and where they fail none is enough.
LISTED = tuple(what for what, _ in LINES.values())
UNTOUCHED = ("order of the joints", "closure residual", "rank of the closures")

EFFORTS = "torque"  # the quantity that the residual is of: it knows no more of a size than the fits do
NOT_RUNNING = "a mechanism with it, which does not run"


@dataclass(frozen=True)
class CauseAssessment:
    """One cause beside all else that is known: the fit as it agrees best, and what contradicts it."""

    fit: Fit
    against: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()


@dataclass(frozen=True)
class Evidence:
    """Evidence on an engine: the certificates of its model and of the reference, the differences of efforts and the rest.

    residual : of the efforts (samples nv,) over the range [-]; quantities : all else that both gave, or None
    """

    model: Model
    residual: Array
    engine_certificate: Certificate
    reference_certificate: Certificate
    quantities: Quantities | None = None

    @cached_property
    def failing(self) -> tuple[str, ...]:
        """Names of the lines of the engine's certificate that do not hold."""
        return tuple(
            line.what
            for line in checks("", "", "", self.engine_certificate, self.reference_certificate)
            if not line.holds
        )

    @cached_property
    def shows_elsewhere(self) -> bool:
        """True if the certificate fails, or the engines differ in another quantity than the efforts."""
        others = {} if self.quantities is None else self.quantities.list_deviating_quantities()
        return bool(self.failing) or bool(set(others) - {EFFORTS})

    def judge_fit(self, fit: Fit, explains: Callable[[Fit], bool], sure: float) -> CauseAssessment:
        """Return the fit with every line of the certificate, and every quantity, that contradicts it.

        Sizes of several numbers, of which the motion may not show all, are fitted to the certificates before they are
        given up.  explains : whether a fit explains the efforts; sure : part [-] to which they know its size
        """
        asked = (*fit.key, fit.size.tobytes())
        if asked not in self._answers:
            self._answers[asked] = self._judge_fit(fit, explains, sure)
        return self._answers[asked]

    @cached_property
    def _answers(self) -> dict[tuple[str, str, bytes], CauseAssessment]:
        """Answers of ``hear`` by cause, target and size: every deeper look asks for most of them again."""
        return {}

    def _judge_fit(self, fit: Fit, explains: Callable[[Fit], bool], sure: float) -> CauseAssessment:
        try:
            fit, told = self._judge_by_certificate(fit, explains, sure)
            said = tuple(x for x in told if x not in fit.cause.unsaid)
            beside = tuple(x for x in told if x in fit.cause.unsaid)
            if not said and self.quantities is not None:
                fit, said = self._judge_by_quantities(self.quantities, fit, explains, sure)
        except (*IMPOSSIBLE, RuntimeError, KeyError):
            return CauseAssessment(fit, (NOT_RUNNING,))
        return CauseAssessment(fit, said, beside)

    def _judge_by_certificate(
        self, fit: Fit, explains: Callable[[Fit], bool], sure: float
    ) -> tuple[Fit, tuple[str, ...]]:
        """Return the fit, or that of the certificate's size where nothing contradicts it, and the lines that contradict it."""
        told = self._list_contradicting_lines(fit, sure)
        if told and fit.cause.parameters > 1 and not self._has_zero_size(fit):
            again = self._fit_size(fit)
            if explains(again) and not (other := self._list_contradicting_lines(again, sure)):
                return again, other
        return fit, told

    def _judge_by_quantities(
        self, quantities: Quantities, fit: Fit, explains: Callable[[Fit], bool], sure: float
    ) -> tuple[Fit, tuple[str, ...]]:
        """Return the fit, or that of the quantities' size where nothing contradicts it, and the quantities that contradict it."""
        said = quantities.list_contradictions(fit)
        if said and fit.cause.parameters > 1:
            again = self._update_column(quantities.fit_size(fit))
            agrees = explains(again) and not self._list_contradicting_lines(again, sure)
            if agrees and not quantities.list_contradictions(again):
                return again, ()
        return fit, said

    def list_contradictions(self, fit: Fit, sure: float) -> tuple[str, ...]:
        """Return the lines of the certificate, else the quantities, that contradict a fit as it is; raises like a run.

        sure : part [-] to which its size is known
        """
        said = tuple(x for x in self._list_contradicting_lines(fit, sure) if x not in fit.cause.unsaid)
        return said or (self.quantities.list_contradictions(fit) if self.quantities is not None else ())

    def fit_to_certificate(self, candidate: Candidate, rounds: int, noise: float) -> Fit | None:
        """Return the fit of a cause that starts from the size that explains the certificate, None where none does.

        Where sizes are large the motion leads astray; what a model weighs, and how stiff it is, knows them at once.
        """
        cause = candidate.cause
        target = candidate.target
        nothing = Fit(cause, target, np.zeros(cause.parameters), 1.0, 0.0 * self.residual)
        try:
            size = self._find_size(nothing)
            one = replace(nothing, size=size)
            if not size.any() or any(x in LISTED for x in self._list_contradicting_lines(one, AGREES)):
                return None
            return fit_from(self.model, self.residual, candidate, size, rounds, noise)
        except IMPOSSIBLE:
            return None

    def _list_contradicting_lines(self, fit: Fit, sure: float) -> tuple[str, ...]:
        """Return the lines of the certificate in which a cause would not change just what is wrong.

        An engine that misreads the motion may have been asked along the right one or along its own.
        """
        lines = self._compare_lines(fit, self._compute_harmed_certificate(fit, fit.size), sure)
        harmed = fit.cause.change(self.model.base, fit.target, fit.size)
        if lines and harmed.case.motion is not self.model.base.case.motion:
            lines = min(
                lines,
                self._compare_lines(fit, self._compute_tree_certificate(harmed.mechanism, harmed.case), sure),
                key=len,
            )
        return (*lines, *(x for x in self.failing if x in UNTOUCHED))

    def _compare_lines(self, fit: Fit, certificate: Certificate, sure: float) -> tuple[str, ...]:
        part = min(AGREES, SURE_PART + max(sure, fit.residual))
        kept = (
            (
                name,
                what,
                _is_line_explained(name, limit, self.engine_certificate, self.reference_certificate, certificate, part),
            )
            for name, (what, limit) in LINES.items()
        )
        return tuple(
            what for name, what, holds in kept
            if not holds
            or (what in self.failing and _is_left(name, self.engine_certificate, self.reference_certificate, certificate))
        )  # fmt: skip

    def _compute_harmed_certificate(self, fit: Fit, size: Array) -> Certificate:
        """Return the reference's certificate of a harmed mechanism, of its tree: closures have lines of their own."""
        base = self.model.base
        harmed = fit.cause.change(base, fit.target, size).mechanism
        if harmed is base.mechanism:
            return self.reference_certificate
        return self._compute_tree_certificate(harmed, base.case)

    def _compute_tree_certificate(self, harmed: Mechanism, case: Case) -> Certificate:
        """Return the reference's certificate of a mechanism's tree, whichever joints have drives, and of its closures."""
        given = case.motion.joints(self.model.base.mechanism)  # a tree's drives are where its motion is
        joints = tuple(replace(j, actuated=j.actuated and j.name in given, weight=1.0) for j in harmed.joints)
        slopes = self.engine_certificate.torque_by_place is not None
        return replace(
            build_certificate(replace(harmed, closures=(), joints=joints), case, slopes),
            **collect_attachment_data(harmed),
        )

    def _assemble_column(self, certificate: Certificate) -> Array:
        """Return a certificate's numbers that both engines have, over the size of their line, as one column [-]."""
        found = [np.zeros(0)]
        for name in LINES:
            a, b, c = (
                _split_line(getattr(one, name))
                for one in (self.engine_certificate, self.reference_certificate, certificate)
            )
            size = max((float(np.abs(one).max(initial=0.0)) for one in b.values()), default=0.0) or 1.0
            known = [key for key in sorted(b) if key in a and a[key].shape == b[key].shape]
            found += [c.get(key, b[key]).ravel() / size for key in known]  # a bent beam is not probed: it says nothing
        return np.concatenate(found)

    def _fit_size(self, fit: Fit) -> Fit:
        """Return the fit with the size that explains the certificates best."""
        return self._update_column(replace(fit, size=self._find_size(fit)))

    def _find_size(self, fit: Fit) -> Array:
        """Return the size that explains the certificates best; every look at the causes asks for most of them again."""
        asked = (*fit.key, fit.size.tobytes())
        if asked not in self._sizes:
            self._sizes[asked] = self._solve_size(fit)
        return self._sizes[asked]

    @cached_property
    def _sizes(self) -> dict[tuple[str, str, bytes], Array]:
        """Sizes [unit] of ``_sized`` by cause, target and the size that the motion says."""
        return {}

    def _solve_size(self, fit: Fit) -> Array:
        """Gauss-Newton from the motion's size to that which explains the certificates best."""
        zero = self._assemble_column(self.reference_certificate)
        size = fit.size
        measured = self._assemble_column(self.engine_certificate) - zero
        for _ in range(ROUNDS):
            here = self._assemble_column(self._compute_harmed_certificate(fit, size))
            slope = self._compute_derivatives(fit, size)
            step_of = np.linalg.lstsq(slope, measured - (here - zero), rcond=SMALL)[0]
            size = size + step_of
            if np.abs(step_of).max() <= SURE_PART * np.abs(size).max():
                break
        return np.asarray(size)

    def _compute_derivatives(self, fit: Fit, size: Array) -> Array:
        """Return the derivatives of the certificate's column by a size, (lines, parameters) [1 over its unit].

        They are central differences: a turn about an axis of symmetry changes nothing to the accuracy of ``SMALL``.
        """
        step = PROBE * fit.cause.scale(self.model, fit.target)
        ends = [
            [self._assemble_column(self._compute_harmed_certificate(fit, size + sign * unit)) for sign in (step, -step)]
            for unit in np.eye(len(size))
        ]
        return np.stack([(up - down) / (2 * step) for up, down in ends], axis=1)

    def _has_zero_size(self, fit: Fit) -> bool:
        """Return True if the certificate alone says that a cause has the size zero.

        Nothing fails in it, and every number of the size shows there: whatever the motion says, no other size agrees.
        """
        if self.failing:
            return False
        if fit.key not in self._seen_whole:
            slope = self._compute_derivatives(fit, 0.0 * fit.size) * fit.cause.scale(self.model, fit.target)
            least = float(np.linalg.svd(slope, compute_uv=False)[-1]) if len(slope) >= len(fit.size) else 0.0
            self._seen_whole[fit.key] = least > SHOWN
        return self._seen_whole[fit.key]

    @cached_property
    def _seen_whole(self) -> dict[tuple[str, str], bool]:
        """Answers of ``_leaves_no_size`` by cause and target: True where every number of a size shows in the certificate."""
        return {}

    def _update_column(self, fit: Fit) -> Fit:
        """Return a fit whose size was changed with what it explains then."""
        column = compute_effect(self.model, fit.cause, fit.target, fit.size)
        left = float(np.linalg.norm(self.residual - column) / np.linalg.norm(self.residual))
        return replace(fit, residual=left, column=column)


def _is_line_explained(
    name: str, limit: float, engine: Certificate, reference: Certificate, certificate: Certificate, part: float
) -> bool:
    """Return True if a cause would change in one line of the certificate what is wrong there, to a part of it [-]."""
    a, b, c = (_split_line(getattr(one, name)) for one in (engine, reference, certificate))
    size = max((float(np.abs(b[key]).max(initial=0.0)) for key in b), default=0.0)
    for key in b:
        if key not in a or key not in c or not a[key].shape == b[key].shape == c[key].shape:
            continue
        measured = a[key] - b[key]
        predicted = c[key] - b[key]
        scale = max(float(np.linalg.norm(measured)), float(np.linalg.norm(predicted)))
        line_size = float(np.abs(b[key]).max(initial=0.0)) if name in EACH else size
        if float(np.abs(measured - predicted).max(initial=0.0)) > LIMITS * limit * (line_size or 1.0) + part * scale:
            return False
    return True


def _is_left(name: str, engine: Certificate, reference: Certificate, certificate: Certificate) -> bool:
    """Return True if a cause leaves a line of the certificate as it is, to AGREES of what is wrong there [-]."""
    a, b, c = (_split_line(getattr(one, name)) for one in (engine, reference, certificate))
    known = [key for key in b if key in a and key in c and a[key].shape == b[key].shape == c[key].shape]
    return bool(known) and all(
        np.abs(c[key] - b[key]).max(initial=0.0) <= AGREES * np.abs(a[key] - b[key]).max(initial=0.0) for key in known
    )


def _split_line(value: Any) -> dict[str, Array]:
    """Return the numbers of one line by name; a line that is not there has none."""
    if value is None:
        return {}
    named = value if isinstance(value, Mapping) else {"": value}
    return {key: np.asarray(one, dtype=np.float64) for key, one in named.items()}
