"""Draw the README's pictures from real runs.

``python docs/figures/make_figures.py`` writes arms.png, feed_forward.png (torques replayed in Exudyn) and optimal_motion.png
beside itself.
With the results of ``crosscheck bench`` it writes time_error.png and latency.png instead:
``python docs/figures/make_figures.py reports/bench/results.json`` (several files: all of them).  With the word ``library`` it
measures exported libraries beside controllers, and writes latency_c.png.
Beside each picture lies a CSV with the numbers of its curves, units in the names of the columns.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

import flexinv
from crosscheck.studies import feedforward
from flexinv import Following, Mechanism, Motion, Solution
from flexinv.display.curve_table import render_curves
from flexinv.display.figures import list_curves
from flexinv.tracking.follow import INVERSION, JOINT_SPACE, RIGID_BODY
from flexinv.tracking.task_file import load_tasks

ROOT = Path(__file__).resolve().parents[2]
STEP = 5e-4  # [s], at which the paper's one-link case is converged to a thousandth
# The paper's examples 3 and 4: half a turn in 0.2 s, and 0.5 and 1 rad in 0.2 s, then rest.
ONE = Motion.point_to_point({"hub": 0.0}, {"hub": np.pi}, 0.2, hold=0.3)
TWO = Motion.point_to_point({"joint1": 0.0, "joint2": 0.0}, {"joint1": 0.5, "joint2": 1.0}, 0.2, hold=0.3)


def shape(solution: Solution, link: str, sample: int) -> NDArray[np.float64]:
    """Points (50, 3) [m] on the axis of a beam, a cubic spline through its nodes."""
    x = solution.nodes.x[sample, solution.mesh.section_nodes[link]]  # (node, xyz)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(x, axis=0), axis=1))])
    return CubicSpline(along, x)(np.linspace(0.0, along[-1], 50))


def stroboscope(axes: Axes, solution: Solution, until: float, every: float) -> None:
    """The arm in the plane, a picture every ``every`` [s] until ``until`` [s]; the first faint, the last dark."""
    times = np.arange(0.0, until + every / 2, every)
    for time in times:
        sample = round(time / STEP)
        for k, link in enumerate(solution.mechanism.beams):
            line = shape(solution, link.name, sample)
            axes.plot(
                line[:, 0], line[:, 1], color=f"C{k}", alpha=0.25 + 0.75 * time / until, linewidth=1.4,
                gid=f"{link.name} at {time:.3g} s,",
            )  # fmt: skip
    for link in solution.mechanism.beams:
        tip = solution.tip[link.name][: round(until / STEP) + 1]
        axes.plot(tip[:, 0], tip[:, 1], color="0.6", linewidth=0.7, linestyle=":", gid=f"tip of {link.name},")
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    axes.set_title(f"every {every * 1e3:.0f} ms until {until:g} s", fontsize="medium")


def torques(axes: Axes, flexible: Solution, rigid: Solution | None) -> None:
    """Joint torques over time, dashed those of the same arm with rigid links."""
    for k, name in enumerate(flexible.torque_names):
        axes.plot(flexible.time, flexible.torque[:, k], color=f"C{k}", linewidth=1.2, label=name)
        if rigid is not None:
            axes.plot(
                rigid.time, rigid.torque[:, k], color=f"C{k}", linewidth=1.0, linestyle="--", label=f"{name}, rigid"
            )
    axes.set(xlabel="time [s]", ylabel="torque [N m]")
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small")


def solved(name: str, motion: Motion) -> Solution:
    """Solve a model of this project on one element of order 8 per link (smooth shapes to draw)."""
    mechanism: Mechanism = flexinv.load_mechanism(ROOT / "models" / name)
    return flexinv.solve(mechanism.with_mesh(1, 8), motion, STEP)


def draw() -> Figure:
    """One row per arm: its shapes, its torques."""
    one, two = solved("flex_one_link", ONE), solved("flex_two_link", TWO)
    rigid = flexinv.solve(flexinv.load_mechanism(ROOT / "models" / "rigid_one_link"), ONE, STEP)
    figure = Figure(figsize=(9, 6.4), layout="constrained")
    rows = figure.subplots(2, 2, width_ratios=(1.1, 1.6))
    stroboscope(rows[0, 0], one, until=0.2, every=0.02)
    torques(rows[0, 1], one, rigid)
    stroboscope(rows[1, 0], two, until=0.2, every=0.04)
    torques(rows[1, 1], two, None)
    return figure


# -------------------------------------------------------------------------------------------------------- feed-forward

WAYS = {JOINT_SPACE: "C1", RIGID_BODY: "C2", INVERSION: "C0"}


def feed_forward() -> Figure:
    """The paper's example 4 with its tip on an arc: the tip in Exudyn under three feed-forwards, and what the joints do."""
    folder = ROOT / "models" / "flex_two_link"
    arm = flexinv.load_mechanism(folder)
    task = load_tasks(folder, arm)["arc"]
    arm = task.meshed(arm)
    found = feedforward.solve_path_following(arm, task)
    replayed = feedforward.collect_replays(True)["exudyn-ge"]
    tips = {way: replayed(arm, found, way)[found.frame.name] for way in WAYS}
    figure = Figure(figsize=(9, 3.3), layout="constrained")
    plane, off, joints = figure.subplots(1, 3, width_ratios=(1.2, 1.2, 1))
    in_the_plane(plane, found, tips)
    for way, tip in tips.items():
        distance = np.linalg.norm(tip - found.wanted, axis=1) / task.path.length
        off.semilogy(1e3 * found.time, np.maximum(distance, 1e-9), color=WAYS[way], linewidth=1.2, label=way)
    off.set(xlabel="time [ms]", ylabel="tip off / path length", ylim=(1e-7, 1))
    for k, name in enumerate(arm.velocity_names):
        ahead = np.degrees(found.solution.q[:, k] - found.rigid.q[:, k])
        joints.plot(1e3 * found.time, ahead, color=f"C{k + 3}", linewidth=1.2, label=name)
    joints.set(xlabel="time [ms]", ylabel="joint less rigid arm's [deg]")
    joints.legend(fontsize="small")
    for axes in (off, joints):
        axes.axvspan(0.0, 1e3 * task.path.duration, color="0.93", zorder=0)
        axes.grid(alpha=0.3)
    figure.legend(*plane.get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize="small")
    return figure


def in_the_plane(axes: Axes, found: Following, tips: dict[str, NDArray[np.float64]]) -> None:
    """The bent arm on its way, the arc, and where three tips go."""
    for time in np.linspace(0.0, found.path.duration, 6):
        sample = int(np.argmin(np.abs(found.time - time)))
        for link in found.solution.mechanism.beams:
            line = shape(found.solution, link.name, sample)
            axes.plot(line[:, 0], line[:, 1], color="0.7", linewidth=1.2, gid=f"{link.name} at {time:.3g} s,")
    axes.plot(found.wanted[:, 0], found.wanted[:, 1], color="k", linewidth=3, alpha=0.25, label="path")
    for way, tip in tips.items():
        axes.plot(tip[:, 0], tip[:, 1], color=WAYS[way], linewidth=1.1, label=way)
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")


# ------------------------------------------------------------------------------------------------------ time and error

ARMS = {
    "flex_one_link": "one link, in the plane",
    "flex_two_link": "two links, in the plane",
    "spatial_arm": "in space",
}
STYLE = {"flexinv, order 1": ("C0", "o"), "flexinv, order 4": ("C2", "s"), "Exudyn": ("C1", "^")}


def time_error(results: dict[str, Any]) -> Figure:
    """Time against error of every run, one panel for each arm; lines join runs of one mesh, their steps halved."""
    rows = [row for study in results["studies"] for row in study["rows"] if row.get("arm") in ARMS and "error" in row]
    arms = [arm for arm in ARMS if any(row["arm"] == arm for row in rows)]
    figure = Figure(figsize=(3.1 * len(arms) + 0.6, 3.9), layout="constrained")
    panels = figure.subplots(1, len(arms), squeeze=False)[0]
    for axes, arm in zip(panels, arms, strict=True):
        panel(axes, [row for row in rows if row["arm"] == arm and row.get("time")])
        axes.set_title(ARMS[arm], fontsize="medium")
    panels[0].set_ylabel("largest error of a tip over the length")
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=len(handles), fontsize="small")
    return figure


def panel(axes: Axes, rows: list[dict[str, Any]]) -> None:
    """Every mesh a line over its steps, its number of elements at the finest."""
    named = set()
    for method, elements in dict.fromkeys((row["method"], row["elements"]) for row in rows):
        kind = next(kind for kind in STYLE if method.startswith(kind))
        own = sorted((r for r in rows if (r["method"], r["elements"]) == (method, elements)), key=lambda r: -r["step"])
        time, error = [row["time"] for row in own], [row["error"] for row in own]
        colour, marker = STYLE[kind]
        axes.loglog(
            time, error, color=colour, marker=marker, markersize=4, linewidth=1, label=None if kind in named else kind,
            gid=f"{method}, {elements} elements,",
        )  # fmt: skip
        axes.annotate(
            str(elements), (time[-1], error[-1]), xytext=(4, -3), textcoords="offset points", fontsize=7, color=colour
        )
        named.add(kind)
    axes.margins(x=0.12)
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("time of the run [s]")
    axes.grid(alpha=0.3)


# ------------------------------------------------------------------------------------------------------------ latency

CONTROLLED = {
    "panda": ("seven joints and a gripper, rigid", "C0"),
    "flex_one_link": ("one flexible link", "C2"),
    "flex_two_link": ("two flexible links", "C1"),
    "spatial_arm": ("flexible, in space", "C3"),
}
BINS = 10  # in a decade, as `crosscheck bench latency` has them


def latency(rows: list[dict[str, Any]]) -> Figure:
    """Histogram of the time of every step of the controllers, beside the cycles that they are for."""
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    axes = figure.add_subplot()
    for name, (label, colour) in CONTROLLED.items():
        own = {round(BINS * np.log10(row["latency"])): row["steps"] for row in rows if row["what"] == name}
        if own:
            last = np.arange(min(own), max(own) + 1)  # upper edges of the bins, in tenths of a decade
            counts = [own.get(int(k), 0) for k in last]
            axes.stairs(counts, 10.0 ** (np.append(last[0] - 1, last) / BINS), baseline=None, color=colour, label=label)
    for cycle, words in ((1e3, "1 kHz"), (1e4, "the paper's 10 ms")):
        axes.axvline(cycle, color="0.4", linestyle="--", linewidth=1)
        axes.annotate(
            words, (cycle, 0.95), xycoords=("data", "axes fraction"), ha="right", va="top", rotation=90, fontsize=8
        )
    axes.set(xscale="log", yscale="log", ylim=(0.7, None), xlabel="time of a step [µs]", ylabel="steps")
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small", loc="upper center", bbox_to_anchor=(0.55, 1.0))
    return figure


def library_latency(steps: int = 100_000) -> Figure:
    """Histogram of the time of every step of exported libraries and of controllers, of the same motions, in turn."""
    from campaigns.hardness.libraries import MACHINES, open_library
    from campaigns.hardness.speed import sample_both

    figure = Figure(figsize=(9, 3.6), layout="constrained")
    axes = figure.add_subplot()
    for number, machine in enumerate(one for one in MACHINES if one.step):
        with open_library(replace(machine, jumps=False)) as library:
            for taken, words, line in zip(sample_both(library, steps), ("library", "Controller"), "-:", strict=True):
                first, last = np.floor(BINS * np.log10(taken.min())), np.ceil(BINS * np.log10(taken.max()))
                edges = 10.0 ** (np.arange(first, last + 1) / BINS)
                counts, _ = np.histogram(taken, edges)
                label = f"{machine.title}, {words}: median {np.median(taken):.3g} µs"
                axes.stairs(counts, edges, baseline=None, color=f"C{number}", linestyle=line, label=label)
    axes.axvline(1e3, color="0.4", linestyle="--", linewidth=1)
    axes.annotate(
        "1 kHz", (1e3, 0.95), xycoords=("data", "axes fraction"), ha="right", va="top", rotation=90, fontsize=8
    )
    axes.set(xscale="log", yscale="log", ylim=(0.7, None), xlabel="time of a step [µs]", ylabel="steps")
    axes.grid(alpha=0.3)
    axes.legend(fontsize="x-small", loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def shortest() -> Figure:
    """The paper's example 4 and the shortest motion with its torques, both beyond their ends."""
    arm = flexinv.load_mechanism(ROOT / "models" / "flex_two_link")
    figure = flexinv.optimize_motion(arm, replace(TWO, duration=0.2), knots=10).plot()
    figure.set_size_inches(7.0, 11.0)
    return figure


def save(figure: Figure, name: str) -> None:
    """Write a picture, and the numbers of its curves with seven digits beside it."""
    file = Path(__file__).with_name(name)
    figure.savefig(file.with_suffix(".png"), dpi=110)
    short = (replace(one, places=shorten(one.places), values=shorten(one.values)) for one in list_curves(figure))
    file.with_suffix(".csv").write_text(render_curves(short), encoding="utf-8")


def shorten(values: Iterable[object]) -> list[float]:
    """Numbers with the seven digits that a picture can show."""
    return [float(f"{value:.7g}") for value in values]


if __name__ == "__main__":
    if sys.argv[1:] == ["library"]:
        sys.path.insert(0, str(ROOT))
        save(library_latency(), "latency_c")
    elif len(sys.argv) > 1:
        runs = [json.loads(Path(name).read_text(encoding="utf-8")) for name in sys.argv[1:]]
        merged = {"studies": [study for run in runs for study in run["studies"]]}
        rows = [row for study in merged["studies"] for row in study["rows"]]
        if any(row.get("arm") in ARMS for row in rows):
            save(time_error(merged), "time_error")
        if cycles := [row for row in rows if "latency" in row]:
            save(latency(cycles), "latency")
    else:
        save(draw(), "arms")
        save(feed_forward(), "feed_forward")
        save(shortest(), "optimal_motion")
