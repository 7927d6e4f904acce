"""The parts of ``crosscheck bench`` as studies, full and quick, and how they are run: one after the other, never side by side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from benchmarks.targets import make_target_table
from crosscheck.checkout import ROOT
from crosscheck.run.runner import run
from crosscheck.run.work import Notify, Options, Work
from crosscheck.studies import Study
from crosscheck.verdicts.plan import Plan
from crosscheck.verdicts.results import Results

_QUICK_ARM = {"quick": True, "seconds": 1.0}
_ARMS = {"one-link": "flex_one_link", "two-link": "flex_two_link", "spatial": "spatial_arm"}


@dataclass(frozen=True)
class Part:
    """A title, the function of a module here, and what it is called with: always, and in the quick mode."""

    title: str
    module: str
    function: str = "run_study"
    options: Mapping[str, Any] = field(default_factory=dict)
    quick: Mapping[str, Any] = field(default_factory=dict)


PARTS: Mapping[str, Part] = {
    "rigid": Part("Torques of many samples", "rigid", quick={"samples": [1_000, 4_096, 32_768], "seconds": 0.3}),
    "single": Part("One sample, and the first call", "single", quick={"seconds": 0.2}),
    "first": Part("The first torque of a process", "first", quick={"names": ["rigid_3r"]}),
    "latency": Part("Cycles of a controller", "latency", quick={"steps": 5_000}),
    "chains": Part("Longer chains", "single", "run_chain_study", quick={"joints": [1, 8, 64], "seconds": 0.2}),
    "loops": Part("Chains of closed loops", "loop_chains", quick={"loops": [5, 20], "seconds": 0.2}),
    **{
        name: Part(
            f"Time and error of an arm that bends, {name}", "flexible", "run_study", {"arms": [model]}, _QUICK_ARM
        )
        for name, model in _ARMS.items()
    },
    "accuracy": Part(
        "Time to a torque error", "accuracy", quick={"arms": ["flex_one_link"], "errors": [1e-3, 1e-6], "seconds": 0.5}
    ),
    "torque-errors": Part(
        "Time to a torque error beside Exudyn",
        "torque_errors",
        quick={"arms": ["flex_one_link"], "errors": [1e-4], "seconds": 0.5, "longest": 2.0},
    ),
    "elements": Part(
        "More elements", "marches", "run_element_study", quick={"orders": {"1": [16, 64, 128]}, "seconds": 0.5}
    ),
    "others": Part("Closed loops and threads", "marches", "run_loop_study", quick={"seconds": 0.5}),
    "runs": Part("Whole runs", "runs", quick={"whole": False}),
}


def list_studies(models: Path, names: tuple[str, ...] = (), quick: bool = False) -> tuple[Study, ...]:
    """Return the studies of the named parts, of all where none is named."""
    return tuple(
        Study(
            f"bench {name}",
            f"Speed: {part.title[0].lower()}{part.title[1:]}",
            f"benchmarks.{part.module}",
            part.function,
            {"models": str(models.resolve()), **part.options, **(part.quick if quick else {})},
            path=str(ROOT),
        )
        for name, part in PARTS.items()
        if not names or name in names
    )


def list_night_studies(models: Path) -> tuple[Study, ...]:
    """Return the studies that a night may make: all parts but whole runs, for it is one itself."""
    return list_studies(models, tuple(name for name in PARTS if name != "runs"))


def run_parts(parts: tuple[Study, ...], timeout: float, out: Path, notify: Notify, command: str = "") -> Results:
    """Run the parts and return their results with the table of targets on top; timeout [s] of each part.

    They run one at a time: what runs beside it would be measured, too.
    """
    results = run(Work(Plan(()), {}, parts, Options(timeout, 1)), out, notify, command)
    return replace(results, studies=(make_target_table(results.studies), *results.studies))
