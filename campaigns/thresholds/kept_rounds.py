"""Residuals of logs that do not depend on a threshold: made once as the thresholds are, and kept while each of them changes.

Nearly all that naming causes of a log costs are residuals under sizes of causes.  They follow from the log, the machine and
the causes; thresholds decide only which of them are asked for.  Those that are used in what is kept stand in its key.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from types import FunctionType, MethodType
from typing import Any
from unittest.mock import patch

import numpy as np

from campaigns.log_faults import trial
from campaigns.log_faults.trial import Row
from campaigns.thresholds.constants import Threshold
from crosscheck.identification.causes import gear_faults, name_causes, rounds
from crosscheck.identification.causes.cause import Cause
from crosscheck.identification.causes.rounds import CauseRound, CauseSearch
from crosscheck.identification.causes.wide_rows import WideRows
from crosscheck.identification.logs.log import Log
from flexinv.errors import InputError
from flexinv.typing import Array

NUMBERS = (str, bytes, int, float, bool, type(None), np.floating, np.integer)
OWN = ("search", "causes", "at")  # of a round, not kept: they are given


@dataclass
class KeptRounds:
    """What was computed for rounds, by all that it depends on; is_full : nothing is added any more."""

    results: dict[Any, Any] = field(default_factory=dict)
    keys: dict[int, tuple[Any, Any]] = field(default_factory=dict)
    is_full: bool = False

    @contextmanager
    def use_for(self, threshold: Threshold) -> Iterator[None]:
        """Take what is kept while a threshold changes, and keep no more."""
        self.is_full = True
        yield

    def find(self, key: Any, compute: Callable[[], Any]) -> Any:
        """Return the result of a key [any unit], computed where it is not kept."""
        if key in self.results:
            return self.results[key]
        result = compute()
        if not self.is_full:
            self.results[key] = result
        return result

    def make_key(self, one: Any) -> Any:
        """Return what says all about an object: numbers and arrays by value, functions by what they close over, else itself."""
        if isinstance(one, NUMBERS):
            return one
        known = self.keys.get(id(one))
        if known is None:
            known = one, self._make_new_key(one)
            if not self.is_full or isinstance(one, Cause):
                self.keys[id(one)] = known
        return known[1]

    def _make_new_key(self, one: Any) -> Any:
        if isinstance(one, np.ndarray):
            return one.shape, hashlib.blake2b(np.ascontiguousarray(one).tobytes(), digest_size=16).digest()
        if isinstance(one, tuple | list):
            return tuple(map(self.make_key, one))
        if isinstance(one, dict):
            return tuple((self.make_key(k), self.make_key(v)) for k, v in one.items())
        if isinstance(one, FunctionType):
            cells = [cell.cell_contents for cell in one.__closure__ or ()]
            return one.__code__, self.make_key(cells), self.make_key(one.__defaults__)
        if isinstance(one, partial):
            return self.make_key([one.func, *one.args]), self.make_key(one.keywords)
        if isinstance(one, MethodType):
            return self.make_key([one.__func__, one.__self__])
        if isinstance(one, Log):
            return self.make_key([one.time, one.columns, one.pauses])
        if isinstance(one, Cause):
            return self.make_key([one.name, one.place, one.step, one.moves, one.scales, one.spot, one.undone])
        if type(one).__name__ == "_FoundShape":
            return self.make_key(list(vars(one).values()))
        return type(one), id(one)

    def make_key_of_causes(self, causes: Sequence[Cause], at: Array) -> Any:
        """Return what says all about causes at their sizes [unit of each]."""
        return tuple((self.make_key(cause), float(size)) for cause, size in zip(causes, at, strict=True) if size)


@contextmanager
def keep_rounds() -> Iterator[KeptRounds]:
    """Let rounds take what is kept for a while."""
    kept = KeptRounds()
    begin = CauseRound.__init__
    weigh = CauseRound.compute_weighed_residual
    above = CauseRound.compute_cost_above
    list_shapes = name_causes.list_shape_causes
    list_ripples = name_causes.list_ripple_causes
    find_fault = name_causes._find_gross_fault
    make = trial.make_log
    logs: dict[tuple[int, int], Log | InputError] = {}

    def find_log(row: Row, shift: int = 0) -> Log:
        key = (row.number, shift)
        if key not in logs:
            try:
                logs[key] = make(row, shift)
            except InputError as error:
                logs[key] = error
        log = logs[key]
        if isinstance(log, InputError):
            raise log
        return log

    def find_key(here: CauseRound) -> Any:
        return here.__dict__["key"]

    def find_begin(
        here: CauseRound, search: CauseSearch, log: Log, causes: Sequence[Cause], at: Array, wide: list[WideRows] | None
    ) -> None:
        known = (id(search.machine), id(search.fit), search.seen, kept.make_key(search.cut), wide is None)
        known += (rounds.ROUNDS if search.fit.scatter else 1,)
        key = ("round", known, kept.make_key(log), kept.make_key_of_causes(causes, at))

        def begin_anew() -> dict[str, Any]:
            begin(here, search, log, causes, at, wide)
            return {name: value for name, value in vars(here).items() if name not in OWN}

        vars(here).update(kept.find(key, begin_anew))
        here.search = search
        here.causes = list(causes)
        here.at = at.copy()
        here.named = np.flatnonzero(at).tolist()
        vars(here)["key"] = key

    def find_residual(here: CauseRound, at: Array, causes: Sequence[Cause] | None = None) -> Array:
        others = here.causes if causes is None else causes
        pairs = zip(others, here.causes, at, here.at, strict=True)
        moves = any(one.moves and (size != before or one is not own) for one, own, size, before in pairs)
        key = ("residual", find_key(here), kept.make_key_of_causes(others, at), moves)
        return np.asarray(kept.find(key, partial(weigh, here, at, causes)))

    def find_cost(here: CauseRound, at: Array) -> float:
        key = ("above", find_key(here), kept.make_key_of_causes(here.causes, at))
        return float(kept.find(key, partial(above, here, at)))

    def find_shapes(here: CauseRound, values: Any, noisy: Collection[int]) -> Any:
        key = ("shapes", find_key(here), kept.make_key(dict(values)), tuple(noisy))
        return kept.find(key, lambda: list(list_shapes(here, values, noisy)))

    def find_ripples(here: CauseRound, at: Array, noisy: Collection[int]) -> Any:
        key = ("ripples", find_key(here), kept.make_key_of_causes(here.causes, at), tuple(noisy), gear_faults.FEWEST)
        return kept.find(key, lambda: list(list_ripples(here, at, noisy)))

    def find_gross(search: CauseSearch, log: Log) -> Any:
        chosen = (name_causes.LITTLE, name_causes.EVIDENCE)
        own = (id(search.machine), id(search.fit), search.seen, kept.make_key(search.cut))
        return kept.find(("gross", own, kept.make_key(log), chosen), lambda: find_fault(search, log))

    with (
        patch.object(trial, "make_log", find_log),
        patch.object(CauseRound, "__init__", find_begin),
        patch.object(CauseRound, "compute_weighed_residual", find_residual),
        patch.object(CauseRound, "compute_cost_above", find_cost),
        patch.object(name_causes, "list_shape_causes", find_shapes),
        patch.object(name_causes, "list_ripple_causes", find_ripples),
        patch.object(name_causes, "_find_gross_fault", find_gross),
    ):
        yield kept
