"""Summary of a mechanism in words and a picture: freedoms, redundancy, mass, reach, first frequencies, rest and motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from crosscheck.verdicts.plan import Task
from flexinv.analysis.overview import compute_whole_mass, describe_mobility, resolve_start_configuration
from flexinv.analysis.solution import Solution
from flexinv.analysis.solve import solve
from flexinv.analysis.views.solution_card import list_instants
from flexinv.display import drawing
from flexinv.errors import FlexinvError
from flexinv.linearized.natural_modes import natural_modes
from flexinv.model.mechanism_card import describe_links
from flexinv.typing import Array

SHOWN = 4  # frequencies
NARROWEST = 0.3  # of the longest side: there four numbers along an axis of the picture stand apart


@dataclass(frozen=True)
class ModelSummary:
    """First part of the output of `crosscheck verify`: lines (what, words), and flexinv's solution of the case."""

    lines: tuple[tuple[str, str], ...]
    solution: Solution


def portrait(task: Task) -> ModelSummary:
    """Return flexinv's view of a mechanism and its case.  Raises FlexinvError where the case cannot be solved."""
    case = task.case
    mechanism = task.case.meshed(task.mechanism)
    solution = solve(
        mechanism, case.motion, case.step, end=case.end, spectral_radius=case.spectral_radius, initial=case.initial,
        start=case.start,
    )  # fmt: skip
    total = sum(compute_whole_mass(link) for link in mechanism.links)
    tips = np.stack(list(solution.tip.values()))  # (link, sample, xyz)
    reach = np.linalg.norm(tips - solution.nodes.x[:, 0], axis=2)
    lines = [
        ("what", describe_links(mechanism)),
        ("freedoms", _describe_freedoms(task)),
        ("mass", f"{total:.5g} kg"),
        ("reach", f"{reach.max():.4g} m from the first joint during the motion"),
        ("frequencies", _describe_frequencies(task)),
        ("largest effort", _describe_efforts(solution)),
    ]
    if mechanism.notes:
        lines.append(("note", "; ".join(mechanism.notes)))
    return ModelSummary(tuple(lines), solution)


def _describe_freedoms(task: Task) -> str:
    mechanism = task.mechanism
    if mechanism.closures:
        return describe_mobility(mechanism, task.case).partition(": ")[2]
    drives = int(mechanism.actuated.sum())
    free = f", {mechanism.nv - drives} without a drive" if drives < mechanism.nv else ""
    return f"{mechanism.nv} joint coordinates, {drives} drives{free}; an open tree: no constraint, none redundant"


def _describe_frequencies(task: Task) -> str:
    """Words about the first natural frequencies where the case starts, joints held (in a loop: the drives)."""
    mechanism = task.case.meshed(task.mechanism)
    if mechanism.is_rigid:
        return "none: no link bends, and the drives hold every joint"
    try:
        modes = natural_modes(mechanism, resolve_start_configuration(mechanism, task.case), count=SHOWN)
    except FlexinvError as error:
        return f"not computed: {error}"
    named = [f"{f:.4g} Hz ({link})" for f, link in zip(modes.frequency, modes.link, strict=True)]
    return ", ".join(named) + " where the case starts, drives held"


def _describe_efforts(solution: Solution) -> str:
    table = solution.summary()
    rows = table.loc[list(solution.torque_names)].nlargest(3, "peak effort")
    return ", ".join(f"{name} {row['peak effort']:.4g} {row['unit']}" for name, row in rows.iterrows())


def picture(one: ModelSummary, file: Path) -> None:
    """Draw the mechanism at rest and in motion (.svg, .png)."""
    from matplotlib.figure import Figure

    solution = one.solution
    flat = drawing.find_motion_plane(solution.nodes.x)
    figure = Figure(figsize=(10, 4.6))
    figure.subplots_adjust(left=0.06, right=0.98, bottom=0.1, top=0.93, wspace=0.2)
    views: list[Any] = []
    for title, samples in (
        ("at rest, where the case starts", [0]),
        (
            f"in motion, 0 to {solution.time[-1]:g} s (stronger is later)",
            drawing.list_drawn_samples(len(solution.time)),
        ),
    ):
        shared = {"sharex": views[0], "sharey": views[0]} if views and flat else {}
        axes: Any = figure.add_subplot(1, 2, len(views) + 1, projection=None if flat else "3d", **shared)
        views.append(axes)
        _draw_samples(axes, solution, samples, flat or (0, 1, 2))
        axes.set_title(title, fontsize=10)
    if not flat:
        apply_common_limits(views)
    for axes in views:
        axes.set_aspect("equal")
        axes.locator_params(nbins=8 if flat else 4)
    figure.savefig(file, bbox_inches="tight")


def _draw_samples(axes: Any, solution: Solution, samples: Sequence[int], shown: tuple[int, ...]) -> None:
    """Draw a mechanism at some samples, later ones darker; shown : axes of the world along those of the picture."""
    last = len(solution.time) - 1
    for k in samples:
        shade = 0.2 + 0.8 * k / max(last, 1) if len(samples) > 1 else 1.0
        line = _join_lines(list_instants(solution, [k])[0])
        axes.plot(*line.T[list(shown)], color="#1f5fa8", alpha=shade, linewidth=1.6, marker=".", markersize=3)
    for name, axis in zip("xyz", shown, strict=False):
        getattr(axes, f"set_{name}label")(f"{'xyz'[axis]} [m]")


def apply_common_limits(views: list[Any]) -> None:
    """Give views in space the same limits [m], none so narrow that the numbers along it lie on each other."""
    limits = np.array([[getattr(axes, f"get_{name}lim")() for name in "xyz"] for axes in views])
    middle = (limits[..., 0].min(axis=0) + limits[..., 1].max(axis=0)) / 2
    half = np.abs(limits - middle[:, None]).max(axis=(0, 2))
    half = np.maximum(half, NARROWEST * half.max())
    for axes in views:
        for name, centre, room in zip("xyz", middle, half, strict=True):
            getattr(axes, f"set_{name}lim")(centre - room, centre + room)


def small(one: ModelSummary) -> str:
    """Return the small drawing (`flexinv.display.drawing`) of the motion, as a file of SVG."""
    solution = one.solution
    instants = list_instants(solution, drawing.list_drawn_samples(len(solution.time)))
    return drawing.convert_to_file(drawing.draw_svg(instants, f"{solution.mesh.mechanism.name} in motion"))


def _join_lines(lines: list[drawing.Stroke]) -> Array:
    """Return lines as one, (points, 3) [m] with a gap of NaN after each: one line is drawn many times as fast as many."""
    return np.concatenate([np.vstack([points, np.full(3, np.nan)]) for points, _ in lines])
