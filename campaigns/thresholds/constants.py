"""Thresholds that decide which cause is named, and how one of them is changed for a while."""

from __future__ import annotations

import ast
import importlib
import inspect
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from campaigns.thresholds.absences import find_absent_value

TORQUES = "torques"
LOGS = "logs"
# Modules and the constants in them that a verdict may depend on.  Grids of starts and words are no thresholds.
OF_TORQUES = {
    "crosscheck.causes.naming": (
        "UNEXPLAINED SIMILAR ROUNDED NOISE HALF MARCHED NOTHING MOST SHORTLIST SCANNED DEEPER ROUNDS TOLD"
    ),
    "crosscheck.causes.model": "FEWEST STEPS ROUGH_STEPS ROUGH_ERROR",
    "crosscheck.causes.fit": "LARGEST PROPORTIONAL HALVINGS SMALL TINY HOPELESS HALF_GAIN",
    "crosscheck.causes.evidence": "AGREES SURE_PART LIMITS ROUNDS",
    "crosscheck.causes.pairs": "NUMBERS TRIED ROUNDS FIRST NEXT LINEAR DEPENDENT",
    "crosscheck.causes.quantities": "SURE_TIMES MARCHED ROUNDS",
    "crosscheck.causes.quantity_causes": "DISTANT REFINED",
    "crosscheck.causes.single_samples": "FEWEST FEW GAP",
    "crosscheck.causes.repair": "ROUNDS",
}
OF_LOGS = {
    "crosscheck.identification.causes.name_causes": (
        "EVIDENCE CHANCE LITTLE FOLLOWED ASKED NEAREST ALIKE QUIET LARGEST TOGETHER REACH PART REMAINDER SURE"
    ),
    "crosscheck.identification.causes.rounds": "NOISE SEEN MOST ROUNDS",
    "crosscheck.identification.causes.signals": "REACH HELD QUIET BESIDE EXACT LEAP AMONG_SMALLEST HALF",
    "crosscheck.identification.causes.dictionary": (
        "LATEST LARGEST_SCALE LARGEST_GAIN LARGEST_ANGLE STIFFER HEAVIER LITTLE"
    ),
    "crosscheck.identification.causes.gear_faults": "LARGEST_PLAY LARGEST_PART PASSED FEWEST",
}
ABSENCE = "absent"  # in the place of a factor: the check is off
CHANGES: tuple[float | str, ...] = (0.5, 2.0, ABSENCE)
# The campaigns in which each kind was chosen, and tests of tests/crosscheck/identification that fail without one of which
# verdicts of campaigns say nothing, by the last name of its module.
SET_BY = {TORQUES: "`crosscheck selftest`, `beyond`", LOGS: "`log_faults`"}
SET_OTHERWISE = {
    ("name_causes", "ASKED"): "`log_faults`, by a tenth of its time",
    ("name_causes", "SURE"): "`test_causes.test_what_changes_within_a_log_is_named_with_its_size`",
    ("signals", "EXACT"): "`test_gear_causes.test_a_step_is_found_among_many_levels_and_noise_has_none`",
    ("signals", "LEAP"): "`test_causes.test_a_joint_that_stands_still_has_no_dropouts`",
}


@dataclass(frozen=True)
class Threshold:
    """A module constant that decides about names.

    kind : of the faults that it is held against, `TORQUES` or `LOGS`
    """

    kind: str
    module: str
    name: str

    @property
    def value(self) -> Any:
        """The number [its own unit], or the numbers by a key, as the package has them."""
        return getattr(importlib.import_module(self.module), self.name)


def list_thresholds(kind: str) -> list[Threshold]:
    """Return the thresholds of a kind, in the order of the modules."""
    table = OF_TORQUES if kind == TORQUES else OF_LOGS
    return [Threshold(kind, module, name) for module, names in table.items() for name in names.split()]


def find_setter(threshold: Threshold) -> str:
    """Return the campaign, or the test, that set a threshold, in Markdown [-]."""
    test = SET_OTHERWISE.get((threshold.module.rpartition(".")[2], threshold.name))
    return SET_BY[threshold.kind] if test is None else test


def scale_value(value: Any, factor: float) -> Any:
    """Return a threshold times a factor [-]: whole numbers stay whole and at least 1, numbers by a key are all scaled."""
    if isinstance(value, dict):
        return {key: scale_value(one, factor) for key, one in value.items()}
    if isinstance(value, int):
        return max(1, round(factor * value))
    return factor * value


def list_changes(threshold: Threshold) -> list[float | str]:
    """Return the factors [-] by which a threshold is tried, and `ABSENCE` where its check can be off."""
    can_be_absent = find_absent_value(threshold.module, threshold.name) is not None
    return [change for change in CHANGES if change != ABSENCE or can_be_absent]


@contextmanager
def replace_threshold(threshold: Threshold, change: float | str) -> Iterator[Any]:
    """Let all modules of crosscheck that hold this constant have it times a factor [-], or absent; yield the new value."""
    old = threshold.value
    new = scale_value(old, change) if isinstance(change, float) else find_absent_value(threshold.module, threshold.name)
    holders = [
        module
        for name, module in list(sys.modules.items())
        if name == threshold.module or (name.startswith("crosscheck.") and _imports_threshold(module, threshold))
    ]
    for module in holders:
        setattr(module, threshold.name, new)
    try:
        yield new
    finally:
        for module in holders:
            setattr(module, threshold.name, old)


def _imports_threshold(module: ModuleType, threshold: Threshold) -> bool:
    """Return true for a module whose text imports a threshold: equal small numbers are one object, and say nothing."""
    tree = (
        ast.parse(inspect.getsource(module))
        if getattr(module, threshold.name, None) is threshold.value
        else ast.Module([])
    )
    froms = (node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module == threshold.module)
    return any(alias.name == threshold.name for node in froms for alias in node.names)
