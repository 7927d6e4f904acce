"""Drawing of a mechanism in motion, small, as SVG: a few instants over each other, the last one dark, links that bend in blue.

Mechanisms and solutions show it in notebooks, a report on its first page, the documentation in its list of mechanisms.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from flexinv.display.words import convert_to_xml
from flexinv.typing import Array

PixelMap = Callable[[Array], Array]  # of points (points, 2) [m] into the drawing [px]
Stroke = tuple[Array, bool]  # points (points, 3) [m] of a link, and whether it bends
FRAMES = 6  # instants in a drawing
FLAT_SPREAD = 1e-6  # of the size: a mechanism that leaves its plane by less is drawn as a plane one
# [px] of the drawing
WIDTH = 160.0
HEIGHT = 120.0
DRAWING_MARGIN = 8.0
FAINTEST = 0.15  # of the first instant; 1 is the last one's
# from where a mechanism in space is seen
AZIMUTH = np.radians(-60.0)
ELEVATION = np.radians(25.0)
# 3 : 1 at least on white and on the dark page, as graphics need it (WCAG 1.4.11)
RIGID_COLOUR = "#646c76"
BENDS_COLOUR = "#2a78d0"


def list_drawn_samples(count: int) -> list[int]:
    """Return the numbers of the samples that are drawn out of ``count``: the first, the last, and some between them."""
    return [int(k) for k in np.unique(np.linspace(0, count - 1, FRAMES).round())]


def draw_svg(instants: Sequence[Sequence[Stroke]], what: str) -> str:
    """Return the drawing as an SVG element; ``what`` is read out where it is not seen.

    instants : what stands where, in the order of time
    """
    everything = np.concatenate([np.reshape(line, (-1, 3)) for strokes in instants for line, _ in strokes])
    axes = find_motion_plane(everything)
    place = make_drawing_map(convert_to_view(everything, axes))
    head = open_svg(WIDTH, HEIGHT, what)
    pen = 'fill="none" stroke-width="1.6" stroke-linecap="round" stroke-linejoin="round"'
    return f"{head} {pen}>{draw_lines(instants, axes, place)}</svg>"


def draw_lines(instants: Sequence[Sequence[Stroke]], axes: tuple[int, int] | None, place: PixelMap) -> str:
    """Return the lines of some instants over each other, the last one darkest [px], as elements of SVG."""
    parts = []
    for k, strokes in enumerate(instants):
        shade = FAINTEST + (1 - FAINTEST) * (k / (len(instants) - 1)) ** 2 if len(instants) > 1 else 1.0
        lines = "".join(_draw_line(place(convert_to_view(line, axes)), bends) for line, bends in strokes)
        parts.append(f'<g opacity="{shade:.2g}">{lines}</g>')
    return "".join(parts)


def open_svg(width: float, height: float, what: str) -> str:
    """Return the begin of an SVG element of that size, pixels [-], still without its closing bracket; ``what`` is read out."""
    size = f'viewBox="0 0 {width:g} {height:g}" role="img"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size} aria-label="{convert_to_xml(what)}"'


def convert_to_file(svg: str) -> str:
    """Return a drawing of `draw_svg` as a file of its own: with the size that it has, [-] pixels, where nothing gives it one."""
    return svg.replace("<svg ", f'<svg width="{WIDTH:g}" height="{HEIGHT:g}" ', 1)


def find_motion_plane(x: Array) -> tuple[int, int] | None:
    """Return the two world axes in which all points (..., 3) [m] move, or None in space."""
    spread = np.ptp(x.reshape(-1, 3), axis=0)
    thin = int(np.argmin(spread))
    if spread[thin] > FLAT_SPREAD * spread.max():
        return None
    return tuple(k for k in range(3) if k != thin)  # type: ignore[return-value]


def convert_to_view(x: Array, axes: tuple[int, int] | None) -> Array:
    """Return points (points, 3) [m] as a viewer sees them: (points, 2) [m] to the right and up."""
    if axes is not None:
        return x[:, list(axes)]
    right = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
    away = np.array([np.cos(AZIMUTH) * np.cos(ELEVATION), np.sin(AZIMUTH) * np.cos(ELEVATION), np.sin(ELEVATION)])
    up: Array = np.cross(away, right)
    return np.asarray(x @ np.stack([right, up], axis=1))


def make_drawing_map(x: Array) -> PixelMap:
    """Return the map of points (points, 2) [m] into the drawing [px], by one scale in both directions."""
    low = x.min(axis=0)
    high = x.max(axis=0)
    room = np.array([WIDTH, HEIGHT]) - 2 * DRAWING_MARGIN
    size = high - low
    scale = float((room[size > 0.0] / size[size > 0.0]).min()) if size.any() else 1.0
    middle = (low + high) / 2

    def map_points(points: Array) -> Array:
        return np.asarray(np.array([WIDTH, HEIGHT]) / 2 + scale * (points - middle) * [1.0, -1.0])

    return map_points


def _draw_line(points: Array, bends: bool) -> str:
    path = "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
    return f'<path d="M{path}" stroke="{BENDS_COLOUR if bends else RIGID_COLOUR}"/>'
