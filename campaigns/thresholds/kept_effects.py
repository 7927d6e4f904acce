"""Effects of causes on efforts and certificates that do not depend on a threshold: made once, and kept while each changes.

They follow from the model of a bench, the cause, its target and its size.  Thresholds decide only which are asked for, but for
those of `crosscheck.causes.model`, which say how finely a model is marched: they stand in the key of what is made with it.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

from campaigns.thresholds import beyond_faults, trials
from campaigns.thresholds.beyond_faults import KnownFault
from campaigns.thresholds.constants import Threshold
from campaigns.thresholds.verdict import Verdict
from crosscheck.causes import diagnosis, evidence, fit, model, pairs, repair, selftest, separate, single_samples
from crosscheck.causes.cause import Cause
from crosscheck.causes.evidence import Evidence
from crosscheck.causes.fault_benches import Bench
from crosscheck.causes.fit import Candidate, Columns, Fit
from crosscheck.causes.model import Model
from crosscheck.causes.subject import Subject
from crosscheck.measures.record import Record, compute_fingerprint
from flexinv.typing import Array


@dataclass
class KeptEffects:
    """What was computed, or raised, by all that it depends on, and what the keys speak of.

    about : number of the user's mistake that is asked about, 0 for none
    """

    results: dict[Any, tuple[Any, Any, Exception | None]] = field(default_factory=dict)
    about: int = 0

    @contextmanager
    def use_for(self, threshold: Threshold) -> Iterator[None]:
        """Take what is kept while a threshold changes."""
        yield

    def find(self, key: Any, owner: Any, compute: Callable[[], Any]) -> Any:
        """Return the result of a key [any unit], or raise what it raised; owner : whose number is in the key."""
        if key not in self.results:
            try:
                self.results[key] = owner, compute(), None
            except Exception as error:
                self.results[key] = owner, None, error
        _, result, error = self.results[key]
        if error is not None:
            raise error
        return result

    def find_by_text(self, name: str, compute: Callable[..., Any], *given: Any) -> Any:
        """Return a function of ``given`` [any unit], kept where they can be written down."""
        try:
            text = pickle.dumps(given)
        except (AttributeError, TypeError, pickle.PicklingError):
            return compute(*given)
        return self.find((name, text), None, partial(compute, *given))


@contextmanager
def keep_effects() -> Iterator[KeptEffects]:
    """Let benches, effects, certificates and runs of engines be made once for a while."""
    kept = KeptEffects()
    with ExitStack() as stack:
        for module, name, find in (*_list_effects(kept), *_list_runs(kept), *_list_models(kept)):
            stack.enter_context(patch.object(module, name, find))
        yield kept


Replacements = Iterator[tuple[Any, str, Callable[..., Any]]]


def _list_effects(kept: KeptEffects) -> Replacements:
    """Places at which effects and certificates are asked for, and what finds them among those that are kept."""
    compute = fit.compute_effect
    certify = Evidence._compute_harmed_certificate

    def find_effect(of: Model, cause: Cause, target: str, size: Array) -> Any:
        seen = None if of.seen is None else of.seen.tobytes()
        key = ("effect", id(of.base), id(of.torque), id(of.scale), seen, cause.name, target, size.tobytes())
        return kept.find(key, of, lambda: compute(of, cause, target, size))

    def find_certificate(here: Evidence, one: Fit, size: Array) -> Any:
        slopes = here.engine_certificate.torque_by_place is not None
        key = ("certificate", id(here.model.base), slopes, *one.key, size.tobytes())
        return kept.find(key, here.model, lambda: certify(here, one, size))

    def find_size(here: Evidence, one: Fit) -> Any:
        """The size that certificates say; of the engine's they are those of a user's mistake, or not known by a number."""
        if not kept.about:
            return solve(here, one)
        chosen = (evidence.SMALL, evidence.SURE_PART, evidence.ROUNDS)
        key = ("size", kept.about, id(here.model.base), *one.key, one.size.tobytes(), chosen)
        return kept.find(key, here.model, lambda: solve(here, one))

    solve = Evidence._solve_size
    yield Evidence, "_solve_size", find_size
    for module in (fit, evidence, separate, single_samples):
        yield module, "compute_effect", find_effect
    yield Evidence, "_compute_harmed_certificate", find_certificate


def _list_runs(kept: KeptEffects) -> Replacements:
    """The same of runs of engines: those of a harmed one by the fault that is asked about."""
    ask = beyond_faults.ask_about

    def ask_about(known: KnownFault, columns: Columns) -> Verdict:
        kept.about = known.number
        try:
            return ask(known, columns)
        finally:
            kept.about = 0

    def find_repair(*given: Any) -> Any:
        return kept.find_by_text("repair", lambda _, *rest: run_repair(*rest), kept.about, *given)

    run_repair = repair._run
    yield beyond_faults, "ask_about", ask_about
    yield repair, "_run", find_repair
    yield selftest, "ask", partial(kept.find_by_text, "ask", selftest.ask)
    yield selftest, "_compute_certificate", partial(kept.find_by_text, "engine", selftest._compute_certificate)
    yield diagnosis, "find_separating_motion", lambda *_: ""  # a motion that would tell names apart is no verdict


def _list_models(kept: KeptEffects) -> Replacements:
    """The same of models of benches and mechanisms, their columns, and all that flexinv gives of changed ones."""
    prepare = trials.prepare
    make = diagnosis.make_model
    list_columns = fit.list_candidates
    collect = Model.collect_series

    def find_setting(bench: Bench, models: Path) -> Any:
        fineness = (*list_fineness(True), *list_fineness(False))
        return kept.find(("setting", id(bench), *fineness), bench, lambda: prepare(bench, models))

    def find_model(subject: Subject, reference: Record) -> Any:
        fineness = list_fineness(subject.mechanism.is_rigid)
        key = ("model", compute_fingerprint(subject.mechanism, subject.case), *fineness)
        return kept.find(key, None, lambda: make(subject, reference))

    def find_columns(model: Model, dictionary: dict[str, Cause]) -> Any:
        return kept.find(("columns", id(model), *dictionary), model, lambda: list_columns(model, dictionary))

    def find_series(model: Model, subject: Subject) -> Any:
        fineness = list_fineness(subject.mechanism.is_rigid)
        return kept.find_by_text("series", lambda one, _: collect(model, one), subject, fineness)

    def find_columns_beside(model: Model, dictionary: dict[str, Cause]) -> Any:
        """Those of a model that has a cause already: it is made anew each time."""
        given = (model.base, model.torque, model.scale, model.seen, tuple(dictionary))
        return kept.find_by_text("columns", lambda *_: list_columns(model, dictionary), *given)

    def find_likely_pairs(usable: list[Candidate], residual: Array, most: float) -> Any:
        chosen = (most, pairs.NUMBERS, pairs.DEPENDENT, pairs.SMALL)
        key = ("pairs", *map(id, usable), residual.tobytes(), chosen)
        return kept.find(key, usable, lambda: list_likely(usable, residual, most))

    list_likely = pairs._list_likely_pairs
    yield pairs, "_list_likely_pairs", find_likely_pairs
    yield trials, "prepare", find_setting
    yield diagnosis, "make_model", find_model
    yield fit, "list_candidates", find_columns
    yield pairs, "list_candidates", find_columns_beside
    yield Model, "collect_series", find_series


def list_fineness(rigid: bool) -> tuple[int, ...]:
    """Return the thresholds [-] that say how finely a mechanism is computed, of samples or of steps of its march."""
    return (model.FEWEST,) if rigid else (model.STEPS, model.ROUGH_STEPS)
