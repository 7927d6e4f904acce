"""The card of a solution: what its actuators give, how its energy balance closes, the mechanism in motion, efforts over time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from flexinv.analysis.solution import Solution, list_effort_units
from flexinv.display.card import Card, Picture, make_rows
from flexinv.display.curves import draw_curves
from flexinv.display.drawing import Stroke, draw_svg, list_drawn_samples
from flexinv.display.words import format_count, format_number
from flexinv.kinematics.strokes import collect_strokes
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Mask

EFFORT_COLUMNS = ("coordinate", "peak effort", "rms effort", "peak rate")


def make_solution_card(solution: Solution) -> Card:
    """Return the card of a solution: peak and rms efforts [N m], [N], rates, tips [m], and its energy balance [J]."""
    m = solution.mechanism
    count = len(solution.time)
    span = f"t = {format_number(solution.time[0])} to {format_number(solution.time[-1])} s"
    title = f"Solution of '{m.name}': {format_count(count, 'sample')}, {span}"
    rows = make_rows(_list_effort_rows(solution))
    driven = int(list_shown_coordinates(m).sum())
    return Card(
        title, tuple(_describe_result(solution)), EFFORT_COLUMNS, rows, driven, lambda: _draw_solution(solution)
    )


def list_shown_coordinates(mechanism: Mechanism) -> Mask:
    """Return the coordinates that are shown (nv,) [-]: those with an actuator, all where none has one."""
    return mechanism.actuated if mechanism.actuated.any() else ~mechanism.actuated


def _list_effort_rows(solution: Solution) -> Iterator[tuple[str, ...]]:
    """Yield the coordinates that are shown with their largest efforts, effective values and rates."""
    m = solution.mechanism
    units = list_effort_units(m)
    shown = list_shown_coordinates(m)
    for k, name in enumerate(m.velocity_names):
        if shown[k]:
            effort = solution.torque_all[:, k]
            rate = "m/s" if units[k] == "N" else "rad/s"
            peak = f"{format_number(np.abs(effort).max())} {units[k]}"
            rms = f"{format_number(np.sqrt((effort**2).mean()))} {units[k]}"
            yield name, peak, rms, f"{format_number(np.abs(solution.qd[:, k]).max())} {rate}"


def _describe_result(solution: Solution) -> Iterator[str]:
    """Yield how it was found, its balance of energy, how far beams bend, error bars and notes."""
    made = "marched in time" if solution.marched else "the motion is given as a whole"
    steps = solution.settings.get("step")
    yield f"{made}, step {format_number(float(steps))} s" if isinstance(steps, float) else made
    if len(solution.time) > 1:
        exchanged = format_number(solution.energy_exchanged)
        yield f"energy: {format_number(solution.energy_error)} J not balanced, of {exchanged} J exchanged"
    for name, values in solution.deflection.items():
        yield f"{name} bends by {format_number(np.linalg.norm(values, axis=1).max())} m at its tip"
    if solution.torque_error is not None and solution.torque_error.size:
        worst = int(solution.torque_error.max(axis=0).argmax())
        driven = solution.mechanism.actuated.tolist()
        units = [
            unit for unit, is_driven in zip(list_effort_units(solution.mechanism), driven, strict=True) if is_driven
        ]
        largest = format_number(solution.torque_error.max())
        yield f"error bar of an effort: {largest} {units[worst]} at most ({solution.torque_names[worst]})"
    if solution.stable is not None:
        yield f"the equilibrium is {'stable' if solution.stable else 'one that a structure leaves'}"
    yield from (f"note: {note}" for note in solution.notes)


def list_instants(solution: Solution, samples: Sequence[int]) -> list[list[Stroke]]:
    """Return the lines (2, 3) [m] of the mechanism at some samples, as many at each of them."""
    chosen = list(samples)
    tips = {name: place[chosen] for name, place in solution.tip.items()}
    strokes = collect_strokes(solution.mesh, solution.nodes.x[chosen], tips)
    return [[(line[k], bends) for line, bends in strokes] for k in range(len(chosen))]


def _draw_solution(solution: Solution) -> tuple[Picture, ...]:
    """The mechanism in motion, and efforts by their unit."""
    m = solution.mechanism
    instants = list_instants(solution, list_drawn_samples(len(solution.time)))
    pictures = []
    if any(instants):
        later = ", stronger is later" if len(instants) > 1 else ""
        pictures.append(Picture(draw_svg(instants, f"{m.name} in motion"), f"the mechanism{later}"))
    if len(solution.time) < 2:
        return tuple(pictures)
    shown = list_shown_coordinates(m)
    for unit in ("N m", "N"):
        mine = [k for k, effort_unit in enumerate(list_effort_units(m)) if effort_unit == unit and shown[k]]
        curves = [(m.velocity_names[k], solution.time, solution.torque_all[:, k]) for k in mine]
        if curves:
            first = "" if len(curves) < 7 else f", the first 6 of {len(curves)}"
            words = f"{'torque' if unit == 'N m' else 'force'} [{unit}] over time{first}"
            pictures.append(Picture(draw_curves(curves, unit, words), words, 420))
    return tuple(pictures)
