"""The parts of ``crosscheck bench`` as studies, full and quick, and how they are run: one after the other, never side by side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from crosscheck.bench.targets import summary
from crosscheck.plan import Plan
from crosscheck.results import Results
from crosscheck.runner import Notify, Options, run
from crosscheck.studies import Study

# Part: title, module, function, options of the quick mode; every one takes the folder of models except chains.
_QUICK_RIGID = {"samples": [1_000, 4_096, 32_768], "seconds": 0.3}
PARTS: Mapping[str, tuple[str, str, str, Mapping[str, Any]]] = {
    "rigid": ("Torques of many samples", "rigid", "study", _QUICK_RIGID),
    "single": ("One sample, and the first call", "single", "study", {"seconds": 0.2}),
    "chains": ("Longer chains", "single", "chains", {"joints": [1, 8, 64], "seconds": 0.2}),
    "flexible": (
        "Arms that bend: time and error",
        "flexible",
        "study",
        {"arms": ["flex_one_link"], "quick": True, "seconds": 2.0},
    ),
    "elements": (
        "More elements",
        "marches",
        "elements",
        {"orders": {"1": [4, 16, 64, 128], "4": [1, 4, 16]}, "seconds": 1.0},
    ),
    "others": ("Closed loops and threads", "marches", "others", {"seconds": 1.0}),
}


def studies(models: Path, names: tuple[str, ...] = (), quick: bool = False) -> tuple[Study, ...]:
    """Return the studies of the named parts, of all where none is named."""
    chosen = {name: part for name, part in PARTS.items() if not names or name in names}
    return tuple(
        Study(
            f"bench {name}",
            f"Speed: {title[0].lower()}{title[1:]}",
            f"crosscheck.bench.{module}",
            function,
            ({} if name == "chains" else {"models": str(models.resolve())}) | (dict(own) if quick else {}),
        )
        for name, (title, module, function, own) in chosen.items()
    )


def measure(parts: tuple[Study, ...], timeout: float, out: Path, notify: Notify, command: str = "") -> Results:
    """Run the parts and return their results with the table of targets on top; timeout [s] of each part.

    They run one at a time: what runs beside it would be measured, too.
    """
    results = run(Plan(()), {}, parts, Options(timeout, 1), out, notify, command)
    return replace(results, studies=(summary(results.studies), *results.studies))
