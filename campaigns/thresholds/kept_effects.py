"""Effects of causes on efforts and certificates that do not depend on a threshold: made once, and kept while each changes.

They follow from the model of a bench, the cause, its target and its size.  Thresholds decide only which are asked for, but for
those of `crosscheck.causes.model`, which say how finely a model is marched.
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
from crosscheck.causes.fit import Columns, Fit
from crosscheck.causes.model import Model
from crosscheck.causes.subject import Subject
from crosscheck.measures.record import Record, compute_fingerprint
from flexinv.typing import Array


@dataclass
class KeptEffects:
    """What was computed, or raised, by all that it depends on, and what the keys speak of; used : it is looked at."""

    results: dict[Any, tuple[Any, Any, Exception | None]] = field(default_factory=dict)
    used: bool = True

    @contextmanager
    def use_for(self, threshold: Threshold) -> Iterator[None]:
        """Take what is kept while a threshold changes, unless it depends on it."""
        self.used = threshold.module != model.__name__
        yield
        self.used = True

    def find(self, key: Any, owner: Any, compute: Callable[[], Any]) -> Any:
        """Return the result of a key [any unit], or raise what it raised; owner : whose number is in the key."""
        if not self.used:
            return compute()
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

    for module in (fit, evidence, separate, single_samples):
        yield module, "compute_effect", find_effect
    yield Evidence, "_compute_harmed_certificate", find_certificate


def _list_runs(kept: KeptEffects) -> Replacements:
    """The same of runs of engines: those of a harmed one by the fault that is asked about."""
    ask = beyond_faults.ask_about
    about: list[int] = [0]

    def ask_about(known: KnownFault, columns: Columns) -> Verdict:
        about[0] = known.number
        return ask(known, columns if kept.used else Columns())

    def find_repair(*given: Any) -> Any:
        return kept.find_by_text("repair", lambda _, *rest: run_repair(*rest), about[0], *given)

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
        return kept.find(("setting", id(bench)), bench, lambda: prepare(bench, models))

    def find_model(subject: Subject, reference: Record) -> Any:
        key = ("model", compute_fingerprint(subject.mechanism, subject.case))
        return kept.find(key, None, lambda: make(subject, reference))

    def find_columns(model: Model, dictionary: dict[str, Cause]) -> Any:
        return kept.find(("columns", id(model), *dictionary), model, lambda: list_columns(model, dictionary))

    def find_series(model: Model, subject: Subject) -> Any:
        return kept.find_by_text("series", lambda one: collect(model, one), subject)

    def find_columns_beside(model: Model, dictionary: dict[str, Cause]) -> Any:
        """Those of a model that has a cause already: it is made anew each time."""
        given = (model.base, model.torque, model.scale, model.seen, tuple(dictionary))
        return kept.find_by_text("columns", lambda *_: list_columns(model, dictionary), *given)

    yield trials, "prepare", find_setting
    yield diagnosis, "make_model", find_model
    yield fit, "list_candidates", find_columns
    yield pairs, "list_candidates", find_columns_beside
    yield Model, "collect_series", find_series
