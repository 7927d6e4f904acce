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

from campaigns.thresholds import trials
from campaigns.thresholds.constants import Threshold
from crosscheck.causes import evidence, fit, model, selftest, separate, single_samples
from crosscheck.causes.cause import Cause
from crosscheck.causes.evidence import Evidence
from crosscheck.causes.fault_benches import Bench
from crosscheck.causes.fit import Fit
from crosscheck.causes.model import Model
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
    """Let benches, effects and certificates be made once for a while."""
    kept = KeptEffects()
    prepare = trials.prepare
    compute = fit.compute_effect
    certify = Evidence._compute_harmed_certificate
    ask = selftest.ask
    certify_engine = selftest._compute_certificate

    def find_setting(bench: Bench, models: Path) -> Any:
        return kept.find(("setting", id(bench)), bench, lambda: prepare(bench, models))

    def find_effect(of: Model, cause: Cause, target: str, size: Array) -> Any:
        key = ("effect", id(of), cause.name, target, size.tobytes())
        return kept.find(key, of, lambda: compute(of, cause, target, size))

    def find_certificate(here: Evidence, one: Fit, size: Array) -> Any:
        key = ("certificate", id(here.model), *one.key, size.tobytes())
        return kept.find(key, here.model, lambda: certify(here, one, size))

    with ExitStack() as stack:
        for module in (fit, evidence, separate, single_samples):
            stack.enter_context(patch.object(module, "compute_effect", find_effect))
        stack.enter_context(patch.object(trials, "prepare", find_setting))
        stack.enter_context(patch.object(Evidence, "_compute_harmed_certificate", find_certificate))
        stack.enter_context(patch.object(selftest, "ask", partial(kept.find_by_text, "ask", ask)))
        engine = partial(kept.find_by_text, "engine", certify_engine)
        stack.enter_context(patch.object(selftest, "_compute_certificate", engine))
        yield kept
