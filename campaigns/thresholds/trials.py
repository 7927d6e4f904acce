"""Known faults that thresholds are held against: planted in engines, and in logs of machines of known truth."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from itertools import islice
from pathlib import Path

from campaigns.log_faults.answers import judge_causes
from campaigns.log_faults.trial import read_rows, run_row
from campaigns.thresholds.constants import LOGS, TORQUES
from crosscheck.causes.fault_benches import BENCHES
from crosscheck.causes.selftest import FOUND, list_faults, list_sample_faults, prepare, run_fault, run_without_fault

MODELS = Path(__file__).resolve().parents[2] / "models"
# Benches by mechanism and case, and each so-manieth of their faults: trees, loops and a march, so that a verdict takes a minute.
SHARES = {("double_pendulum", "swing"): 7, ("rigid_3r", "quintic"): 9, ("five_bar", "reach"): 5}
SIZES = (0.01,)  # of the size that matters
EVERY = 12  # rows of the faults of logs
RIGHT = ("right", "in set", "in part")
COUNTED = ("right", "not named", "wrong")


def count_torque_verdicts() -> Counter[str]:
    """Plant a share of the faults of some benches, and nothing: count what is `COUNTED` [-]."""
    counts: Counter[str] = Counter()
    for bench in BENCHES:
        every = SHARES.get((bench.mechanism, bench.case))
        if every is None:
            continue
        setting = prepare(bench, MODELS)
        planted = islice(list_faults(setting, SIZES, (), 1), 0, None, every)
        results = [run_without_fault(setting), *(run_fault(setting, one, size) for one, size in planted)]
        if bench.mechanism == "double_pendulum":
            results += list(islice(list_sample_faults(setting), 3))
        for result in results:
            if result is not None:
                counts[_find_word(result.outcome)] += 1
    return counts


def _find_word(outcome: str) -> str:
    """Return what an outcome of the selftest counts as."""
    if outcome in FOUND:
        return "right"
    return "wrong" if outcome == "another" else "not named"


def count_log_verdicts() -> Counter[str]:
    """Name the causes of each `EVERY`-th log of `campaigns.log_faults`: count what is `COUNTED` [-]."""
    counts: Counter[str] = Counter()
    for row in read_rows()[::EVERY]:
        trial = run_row(row)
        word = judge_causes(row.right, trial.named, trial.refused, row.day == "other").word
        counts["right" if word in RIGHT else "wrong" if word.startswith("wrong") else "not named"] += 1
    return counts


COUNTS: dict[str, Callable[[], Counter[str]]] = {TORQUES: count_torque_verdicts, LOGS: count_log_verdicts}
