"""Curves over time, small, as SVG: one axis with its unit, the least and the largest number, and the names of the curves."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from flexinv.display.drawing import open_svg
from flexinv.display.words import convert_to_xml, format_number, take_end
from flexinv.typing import Array

NamedCurve = tuple[str, Array, Array]  # name, times (samples,) [s] and values (samples,) [any unit]
# [px] of the drawing and of what stands beside the curves
CURVES_WIDTH = 340.0
CURVES_HEIGHT = 190.0
LEFT_ROOM = 62.0
RIGHT_ROOM = 8.0
TOP_ROOM = 34.0
BOTTOM_ROOM = 18.0
IN_A_ROW = 3  # names above the curves
ROW_HEIGHT = 13.0
NAME_LENGTH = 17  # characters
POINTS = 160  # slots in each of which the least and the largest value are drawn: no peak is left out
# 3 : 1 at least on white and on dark pages, as `drawing.RIGID_COLOUR`
COLOURS = ("#2a78d0", "#c2571a", "#1f8a5b", "#b0457f", "#8a7a1a", "#7a6ad0")


def draw_curves(curves: Sequence[NamedCurve], unit: str, what: str) -> str:
    """Return the first curves [unit] over time [s] as an SVG element, as many as there are colours; ``what`` is read out."""
    drawn = curves[: len(COLOURS)]
    times = np.concatenate([time[[0, -1]] for _, time, _ in drawn])
    numbers = np.concatenate([values[np.isfinite(values)] for _, _, values in drawn])
    low, high = (float(numbers.min()), float(numbers.max())) if len(numbers) else (0.0, 0.0)
    start = float(times.min())
    end = float(times.max())
    across = (CURVES_WIDTH - LEFT_ROOM - RIGHT_ROOM) / ((end - start) or 1.0)
    room = CURVES_HEIGHT - TOP_ROOM - BOTTOM_ROOM
    half = 0.5 * high - 0.5 * low  # no difference of two numbers is larger than a number can be
    middle = 0.5 * room if half == 0.0 else 0.0  # of curves that stay where they are
    parts = []
    for colour, (_, time, values) in zip(COLOURS, drawn, strict=False):
        kept = list_drawn_points(values)
        x = LEFT_ROOM + across * (time[kept] - start)
        y = CURVES_HEIGHT - BOTTOM_ROOM - middle - room * ((0.5 * values[kept] - 0.5 * low) / (half or 1.0))
        parts.append(f'<path d="{write_path(x, y)}" stroke="{colour}"/>')
    head = f'{open_svg(CURVES_WIDTH, CURVES_HEIGHT, what)} font-size="10">'
    pen = '<g fill="none" stroke-width="1.4" stroke-linejoin="round">'
    words = _write_axes((start, end), (low, high), unit) + _write_names([name for name, _, _ in drawn])
    return f"{head}{_draw_frame()}{pen}{''.join(parts)}</g>{words}</svg>"


def list_drawn_points(values: Array) -> NDArray[np.intp]:
    """Return the numbers of the points that are drawn [-]: in each of `POINTS` slots the least and the largest value."""
    count = len(values)
    if count <= 2 * POINTS:
        return np.arange(count)
    edges = np.linspace(0, count, POINTS + 1).astype(int)
    found = {0, count - 1}
    for first, last in pairwise(edges.tolist()):
        part = np.nan_to_num(values[first:last], nan=0.0)
        found |= {int(first + part.argmin()), int(first + part.argmax())}
    return np.array(sorted(found))


def write_path(x: Array, y: Array) -> str:
    """Return the commands of a path through points, pixels [-]; where a number is missing the line is broken."""
    commands = []
    broken = True
    for here, above in zip(x.tolist(), y.tolist(), strict=True):
        if np.isfinite(above):
            commands.append(f"{'M' if broken else 'L'}{here:.1f} {above:.1f}")
        broken = not np.isfinite(above)
    return "".join(commands)


def _draw_frame() -> str:
    lower = CURVES_HEIGHT - BOTTOM_ROOM
    axes = f"M{LEFT_ROOM:g} {TOP_ROOM:g}V{lower:g}H{CURVES_WIDTH - RIGHT_ROOM:g}"
    return f'<path d="{axes}" fill="none" stroke="#808080" stroke-width="1"/>'


def _write_axes(span: tuple[float, float], reach: tuple[float, float], unit: str) -> str:
    """Numbers at the ends of both axes with their units."""
    texts = [
        (LEFT_ROOM - 4, TOP_ROOM + 8, "end", format_number(reach[1])),
        (LEFT_ROOM - 4, CURVES_HEIGHT - BOTTOM_ROOM, "end", format_number(reach[0])),
        (LEFT_ROOM - 4, 0.5 * (TOP_ROOM + CURVES_HEIGHT - BOTTOM_ROOM) + 4, "end", f"[{unit}]"),
        (LEFT_ROOM, CURVES_HEIGHT - 4, "start", f"{format_number(span[0])} s"),
        (CURVES_WIDTH - RIGHT_ROOM, CURVES_HEIGHT - 4, "end", f"{format_number(span[1])} s"),
    ]
    return "".join(
        f'<text x="{x:g}" y="{y:g}" text-anchor="{side}" fill="currentColor">{convert_to_xml(text)}</text>'
        for x, y, side, text in texts
    )


def _write_names(names: Sequence[str]) -> str:
    """Names of the curves in rows above them, each with a dash of its colour."""
    parts = []
    for k, (colour, name) in enumerate(zip(COLOURS, names, strict=False)):
        x = CURVES_WIDTH / IN_A_ROW * (k % IN_A_ROW)
        y = ROW_HEIGHT * (k // IN_A_ROW)
        text = convert_to_xml(take_end(name, NAME_LENGTH))
        parts.append(f'<path d="M{x:.1f} {y + 7:g}h8" stroke="{colour}" stroke-width="2"/>')
        parts.append(f'<text x="{x + 11:.1f}" y="{y + 11:g}" fill="currentColor">{text}</text>')
    return "".join(parts)
