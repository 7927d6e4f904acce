"""Latency of a controller's torques: 100,000 cycles of a rigid and of flexible arms, one call each, as a histogram."""

from __future__ import annotations

import gc
import time as clock
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.targets import add_verdict, make_metric
from crosscheck.studies.robot_sweep import remove_damping
from flexinv.analysis.controller import Controller
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.typing import Array

MotionRow = tuple[Array, Array, Array]  # q, qd, qdd

STEPS = 100_000
CYCLE = 1e-3  # [s], of a controller at 1 kHz; the paper's takes 10 ms
# Model, what its median is asked to be [us] at most, stroke of its joints [rad].
ARMS = {
    "panda": (5.0, 0.5),
    "flex_one_link": (None, 0.5),
    "flex_two_link": (200.0, 0.5),
    "spatial_arm": (None, 0.2),
}
PERIOD = 2.0  # [s] of the motion to and fro
BINS = 10  # of the histogram, in a decade

TEXT = f"""Every step gives a controller the motion of its next instant, {1e3 * CYCLE:g} ms on, and waits for the torques; arms
that bend carry their deformation on. The time of every call counts, of those that the system interrupted, too; what its median
is asked to be is on the top. Rows are the bins of the histogram."""
COLUMNS = (
    ("what", "mechanism", ""),
    ("latency", "latency up to", "µs"),
    ("steps", "steps", ""),
    ("slower", "steps that take longer", "%"),
    ("note", "over all steps", ""),
)
PLOT = {"x": "latency", "y": "steps", "group": "what", "log": True}


def run_study(models: str, arms: list[str] | None = None, steps: int = STEPS) -> dict[str, Any]:
    """Return the histogram of the latencies of so many steps [us], arm by arm."""
    rows = []
    for name in arms or ARMS:
        asked, stroke = ARMS[name]
        latencies = sample_latencies(remove_damping(load_mechanism(Path(models) / name)), stroke, steps)
        rows += _list_histogram_rows(name, asked, 1e6 * latencies)
    return {"text": TEXT, "columns": COLUMNS, "rows": rows, "plot": PLOT}


def sample_latencies(mechanism: Mechanism, stroke: float, steps: int) -> Array:
    """Return the time of every step of a motion to and fro, (steps,) [s]."""
    names = [j.name for j in mechanism.joints if j.nv]
    there = Motion.point_to_point(
        dict.fromkeys(names, 0.0),
        dict.fromkeys(names, stroke),
        PERIOD / 2,
        law="quintic",
    )
    half = np.arange(round(PERIOD / 2 / CYCLE)) * CYCLE
    q, qd, qdd = there.evaluate(mechanism, half)
    back = there.evaluate(mechanism, PERIOD / 2 - half)
    states = [np.ascontiguousarray(np.vstack(pair)) for pair in ((q, back[0]), (qd, -back[1]), (qdd, back[2]))]
    rows = list(zip(*states, strict=True))
    controller = Controller.of(mechanism, step=CYCLE)
    controller.start(*rows[0])
    return sample_step_times(controller, rows[1:], rows, steps)


def sample_step_times(
    controller: Controller, before: Sequence[MotionRow], rows: Sequence[MotionRow], steps: int
) -> Array:
    """Return the time of every step of a controller, (steps,) [s], that is given rows of q, qd, qdd again and again.

    before : rows that it is given first, which do not count
    """
    for row in before:
        controller.step(*row)
    latencies = np.empty(steps)
    was = gc.isenabled()
    gc.disable()
    try:
        for k in range(steps):
            row = rows[k % len(rows)]
            start = clock.perf_counter()
            controller.step(*row)
            latencies[k] = clock.perf_counter() - start
    finally:
        if was:
            gc.enable()
    return latencies


def _list_histogram_rows(name: str, asked: float | None, taken: Array) -> list[dict[str, Any]]:
    """A row for every bin with steps in it; the first carries the median, what was asked and the rest of the numbers."""
    edges = 10.0 ** (
        np.arange(
            np.floor(BINS * np.log10(taken.min())),
            np.ceil(BINS * np.log10(taken.max())) + 1,
        )
        / BINS
    )
    counts, _ = np.histogram(taken, edges)
    rows: list[dict[str, Any]] = [
        {
            "what": name,
            "latency": float(edge),
            "steps": int(count),
            "slower": 100.0 * float(np.mean(taken > edge)),
            "note": "",
        }
        for edge, count in zip(edges[1:], counts, strict=True)
        if count
    ]
    median, most, rare = np.percentile(taken, (50, 99, 99.9))
    late = [f"{int((taken > limit).sum())} beyond {words}" for limit, words in ((1e3, "1 ms"), (1e4, "10 ms"))]
    rows[0]["note"] = (
        f"median {median:.3g} us, 99 % {most:.3g}, 99.9 % {rare:.3g}, largest {taken.max():.3g}; {', '.join(late)} "
        f"of {len(taken)} steps"
    )
    rows[0]["metric"] = make_metric(
        f"{name}: a step of the controller",
        float(median),
        "us",
        upper=asked,
        spread=rows[0]["note"],
    )
    return [add_verdict(row) for row in rows]
