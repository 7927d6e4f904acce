"""Known faults that thresholds are held against: planted in engines, and in logs of machines of known truth."""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice

from campaigns.log_faults.answers import judge_causes
from campaigns.log_faults.trial import read_rows, run_row
from campaigns.thresholds.beyond_faults import MODELS, list_beyond_verdicts
from campaigns.thresholds.constants import LOGS, TORQUES
from campaigns.thresholds.verdict import Verdict
from crosscheck.causes.fault_benches import BENCHES
from crosscheck.causes.selftest import FOUND, list_faults, list_sample_faults, prepare, run_fault, run_without_fault

# Benches by mechanism and case, and each so-manieth of their faults: trees, loops and a march.
SHARES = {
    ("double_pendulum", "swing"): 7,
    ("rigid_3r", "quintic"): 9,
    ("five_bar", "reach"): 5,
    ("flex_one_link", "cycloid"): 11,
}
SIZES = (0.01,)  # of the size that matters
EVERY = 3  # rows of the faults of logs
RIGHT = ("right", "in set", "in part")


def list_torque_verdicts() -> list[Verdict]:
    """Plant a share of the faults of some benches, nothing, and users' mistakes: return the verdicts [-]."""
    verdicts = []
    for bench in BENCHES:
        every = SHARES.get((bench.mechanism, bench.case))
        if every is None or bench.causes:  # causes of its own need a machine of a shape of its own
            continue
        setting = prepare(bench, MODELS)
        planted = islice(list_faults(setting, SIZES, (), 1), 0, None, every)
        results = [run_without_fault(setting), *(run_fault(setting, one, size) for one, size in planted)]
        if bench.mechanism == "double_pendulum":
            results += list(islice(list_sample_faults(setting), 3))
        verdicts += [Verdict(_find_word(one.outcome), one.named) for one in results if one is not None]
    return [*verdicts, *list_beyond_verdicts()]


def _find_word(outcome: str) -> str:
    """Return what an outcome of the selftest counts as."""
    if outcome in FOUND:
        return "right"
    return "wrong" if outcome == "another" else "not named"


def list_log_verdicts() -> list[Verdict]:
    """Name the causes of each `EVERY`-th log of `campaigns.log_faults`: return the verdicts [-]."""
    verdicts = []
    for row in read_rows()[::EVERY]:
        trial = run_row(row)
        word = judge_causes(row.right, trial.named, trial.refused, row.day == "other").word
        counted = "right" if word in RIGHT else "wrong" if word.startswith("wrong") else "not named"
        verdicts.append(Verdict(counted, tuple(f"{one.name} of {one.place}" for one in trial.named)))
    return verdicts


LISTS: dict[str, Callable[[], list[Verdict]]] = {TORQUES: list_torque_verdicts, LOGS: list_log_verdicts}
