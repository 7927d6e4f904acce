"""Chains of closed loops: how the time of a sample or a step grows with their number."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks.targets import add_verdict, make_metric
from benchmarks.timing import Call, run_calls_in_turns
from flexinv.analysis.simulate import simulate
from flexinv.analysis.solve import solve
from flexinv.model.attachments import Closure
from flexinv.model.links import Attachment, Beam, Section
from flexinv.model.mechanism import Body, Inertia, Joint, Link, Mechanism, Placement
from flexinv.model.motion import Motion

LOOPS = (2, 5, 10, 20, 40)
# Sparse loops: work proportional to their number; the rest is what larger arrays cost.
GROWTH = 1.3
SAMPLES = 100
STEPS = 50
SECONDS = 0.5
LEANING = 1e-5  # [m/s^2] of gravity out of the plane: enough to solve a mechanism in space
# A strip of steel, 2 mm in the plane by 10 mm.
STRIP = Section(
    np.zeros(1),
    np.array([[4.2e6, 1.35e6, 1.35e6, 1.88, 35.0, 1.4]]),
    np.array([0.157]),
    np.array([[1.36e-6, 1.31e-6, 5.2e-8]]),
)
TEXT = f"""N four-bars in a row, as in the IFToMM benchmark A02: N + 1 cranks of 1 m and 1 kg on the ground, and rods that join
their tips, the first crank driven. Rigid: torques of a motion that is given for the first crank alone ({SAMPLES} samples), and
the motion under a torque ({STEPS} steps). With beams: every rod is two finite elements; in the plane, and with gravity leaning
out of it by a millionth, which makes the mechanism spatial. The growth is that between the longest chain and one a quarter as
long."""
COLUMNS = (
    ("loops", "loops", ""),
    ("method", "method", ""),
    ("time", "a sample or step", "µs"),
    ("per_loop", "and a loop", "µs"),
    ("growth", "growth: time ~ loops to the power of", "-"),
    ("asked", "asked", "-"),
)
PLOT = {"x": "loops", "y": "time", "group": "method", "log": True}


def run_study(models: str = "", loops: list[int] | None = None, seconds: float = SECONDS) -> dict[str, Any]:
    """Return the table over the number of loops; times [us].  The chains are made here: no models are read."""
    counts = loops or list(LOOPS)
    rows: list[dict[str, Any]] = []
    times: dict[str, dict[int, float]] = {}
    for count in counts:
        work = _prepare_calls(count)
        for method, own in run_calls_in_turns({name: Call(call) for name, (call, _) in work.items()}, seconds).items():
            time = 1e6 * own.compute_quartiles().median / work[method][1]
            times.setdefault(method, {})[count] = time
            rows.append({"loops": count, "method": method, "time": time, "per_loop": time / count})
    last = max(counts)
    first = min(counts, key=lambda count: abs(count - last / 4))
    for row in rows if first < last else ():
        if row["loops"] == last:
            power = float(np.log(times[row["method"]][last] / times[row["method"]][first]) / np.log(last / first))
            name = f"chain of closed loops, {row['method']}: time grows with their number to the power of"
            row |= {
                "growth": power,
                "asked": f"at most {GROWTH:g}",
                "metric": make_metric(name, power, "-", upper=GROWTH),
            }
    return {"text": TEXT, "columns": COLUMNS, "rows": [add_verdict(row) for row in rows], "plot": PLOT}


def _prepare_calls(count: int) -> dict[str, tuple[Callable[[], object], int]]:
    """Calls to be timed, and of how many samples or steps."""
    rigid = build_four_bar_chain(count)
    bending = build_four_bar_chain(count, beams=True)
    motion = make_crank_motion(0.6)
    leaning = replace(bending, gravity=bending.gravity + np.array([0.0, 0.0, LEANING]))
    time = np.linspace(0.0, STEPS * 1e-3, 3)
    pushed = np.full((3, 1), -20.0 * count)
    ends: dict[str, Any] = {"step": 2e-3, "end": STEPS * 2e-3}
    return {
        "rigid, solved": (partial(solve, rigid, motion, 0.5 / SAMPLES), SAMPLES),
        "rigid, simulated": (partial(simulate, rigid, time, pushed, 1e-3), STEPS),
        "with beams, in the plane": (partial(solve, bending, make_crank_motion(0.3), **ends), STEPS),
        "with beams, in space": (partial(solve, leaning, make_crank_motion(0.3), **ends), STEPS),
    }


def make_crank_motion(angle: float) -> Motion:
    """Return the motion of the first crank by an angle [rad] in 0.5 s."""
    return Motion.point_to_point({"crank0": 0.0}, {"crank0": angle}, 0.5)


def build_four_bar_chain(count: int, beams: bool = False) -> Mechanism:
    """Return ``count`` four-bars in a row [m], [kg]: cranks on the ground, and rods between their tips, which may be beams."""
    bar = Body("bar", Inertia(1.0, np.array([0.5, 0.0, 0.0]), np.diag([1e-3, 1.0 / 12.0, 1.0 / 12.0])))
    upright = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    tip = Placement(np.array([1.0, 0.0, 0.0]))
    cranks = [Link(f"crank{k}", (bar,)) for k in range(count + 1)]
    strip = Beam(1.0, STRIP, elements=2, order=4)
    rods = [Link(f"rod{k}", (), beam=strip) if beams else Link(f"rod{k}", (bar,)) for k in range(count)]
    joints = [
        Joint(
            f"crank{k}",
            "revolute",
            "world",
            f"crank{k}",
            Placement(np.array([float(k), 0.0, 0.0]), upright),
            actuated=k == 0,
        )
        for k in range(count + 1)
    ]
    joints += [
        Joint(f"rod{k}", "revolute", f"crank{k}", f"rod{k}", Placement(tip.position, upright.T), actuated=False)
        for k in range(count)
    ]
    end = Placement() if beams else tip
    closures = tuple(
        Closure(f"pin{k}", "revolute", Attachment(f"rod{k}", end), Attachment(f"crank{k + 1}", tip))
        for k in range(count)
    )
    gravity = np.array([0.0, -9.81, 0.0])
    return Mechanism(f"{count} four-bars", (*cranks, *rods), tuple(joints), gravity=gravity, closures=closures)
