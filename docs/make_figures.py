"""Draw the README's picture from real runs: ``python docs/make_figures.py`` writes docs/arms.png."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

import flexinv
from flexinv import Mechanism, Motion, Solution

ROOT = Path(__file__).resolve().parent.parent
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
            axes.plot(line[:, 0], line[:, 1], color=f"C{k}", alpha=0.25 + 0.75 * time / until, linewidth=1.4)
    for link in solution.mechanism.beams:
        tip = solution.tip[link.name][: round(until / STEP) + 1]
        axes.plot(tip[:, 0], tip[:, 1], color="0.6", linewidth=0.7, linestyle=":")
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


if __name__ == "__main__":
    draw().savefig(Path(__file__).with_name("arms.png"), dpi=110)
