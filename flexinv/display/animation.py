"""Moving pictures of mechanisms, as SVG that moves by itself: no script, nothing from elsewhere, one file.

The lines are those of `drawing`, seen in the same way; browsers move them from one instant to the next.  A click stops them where
they are, the next one plays them from the start: SMIL knows no way on from a stop.  Whoever has asked the system for less motion
sees the drawing: the first click shows one instant, the next one moves it.
Source: SVG 1.1, section 19 (begin and end by events, fill="freeze"); WCAG 2.2.2; Media Queries 5, prefers-reduced-motion.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flexinv.display.drawing import (
    BENDS_COLOUR,
    DRAWING_MARGIN,
    HEIGHT,
    RIGID_COLOUR,
    WIDTH,
    PixelMap,
    Stroke,
    convert_to_view,
    draw_lines,
    find_motion_plane,
    list_drawn_samples,
    make_drawing_map,
    open_svg,
)
from flexinv.display.words import convert_to_xml, format_number
from flexinv.errors import InputError
from flexinv.typing import Array
from flexinv.validation import check_path

BAR = 12.0  # [px] below the picture, for the time
SHEETS = (".svg", ".html")
OVERLAY = "flexinv-still"  # classes of what stands in for the moving lines, and of these
MOVING = "flexinv-moving"
CALM = (
    f"<style>.{OVERLAY}{{display:none}}@media (prefers-reduced-motion:reduce){{"
    f".{OVERLAY}{{display:inline}}.{MOVING}{{display:none}}"
    f"svg:focus>.{OVERLAY}{{display:none}}svg:focus>.{MOVING}{{display:inline}}}}</style>"
)
PAGE = (
    '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"/><meta name="color-scheme" content="light dark"/>'
    '<meta name="viewport" content="width=device-width"/><title>{title}</title></head>'
    '<body style="font-family:sans-serif;margin:16px">{body}</body></html>\n'
)


NET_PEN = ' stroke-width="0.7"'
NOWHERE = "M0 0"  # [px] the path of no edge
# From little to much, each 3 : 1 at least on white and on the dark page.
LEVEL_COLOURS = (BENDS_COLOUR, "#6a6fd0", "#9a5cc0", "#bd4c9c", "#cf4673", "#d8452f")


class ColouredNet(NamedTuple):
    """Edges of a net in motion: lines (frames, edges, 2, 3) [m] in the world, and the level of each (frames, edges), 0 to 1."""

    lines: Array
    level: Array


@dataclass(frozen=True, repr=False)
class Animation:
    """A moving picture, which a notebook shows; ``save`` writes it.

    svg : the picture; title : of what; words : below it; seconds : that it takes [s]
    """

    svg: str
    title: str
    words: str
    seconds: float

    def __repr__(self) -> str:
        """Return a line about it."""
        return f"Animation of {self.title!r}, {self.words}: a notebook shows it, save('motion.html') writes it"

    def _repr_html_(self) -> str:
        """Return the picture with the words below it."""
        words = f'<figcaption style="font-size:90%">{convert_to_xml(self.words)}</figcaption>'
        return f'<figure style="margin:8px 0;width:560px;max-width:100%">{self.svg}{words}</figure>'

    def save(self, path: str | Path) -> Path:
        """Write it as a picture (.svg) or as a page (.html), and return the file.  Raises InputError for other names."""
        file = Path(check_path("path", path, "a file name that ends in .svg or .html"))
        if file.suffix.lower() not in SHEETS:
            raise InputError(f"animation: path {file}, expected a name that ends in {' or '.join(SHEETS)}")
        page = PAGE.format(title=convert_to_xml(self.title), body=self._repr_html_())
        file.write_text(page if file.suffix.lower() == ".html" else self.svg, encoding="utf-8")
        return file


def draw_animation(
    frames: Sequence[Sequence[Stroke]],
    span: tuple[float, float],
    seconds: float,
    title: str,
    nets: Sequence[ColouredNet] = (),
) -> Animation:
    """Return the moving picture of equally spaced frames, as many lines in each, of a ``span`` of time [s] in ``seconds`` [s].

    frames : lines (points, 3) [m] in the world, and whether they bend; nets : drawn over them, coloured by their levels
    """
    drawn = [np.reshape(line, (-1, 3)) for strokes in frames for line, _ in strokes]
    everything = np.concatenate(drawn + [net.lines.reshape(-1, 3) for net in nets])
    axes = find_motion_plane(everything)
    place = make_drawing_map(convert_to_view(everything, axes))
    lines = _write_strokes(frames, axes, place)
    coloured = [
        (colour, shapes)
        for net in nets
        for colour, shapes in zip(LEVEL_COLOURS, _write_levels(net, axes, place), strict=True)
        if any(shapes)
    ]
    key = hashlib.sha256(repr((lines, coloured, span, seconds)).encode()).hexdigest()[
        :8
    ]  # of several pictures on a page each stops alone
    moved = "".join(_draw_moving_path(colour, shapes, seconds, key) for colour, shapes in lines)
    moved += "".join(_draw_moving_path(colour, shapes, seconds, key, NET_PEN) for colour, shapes in coloured)
    still = draw_lines([frames[k] for k in list_drawn_samples(len(frames))], axes, place)
    still += "".join(
        f'<path d="{shapes[-1]}" stroke="{colour}"{NET_PEN}/>' for colour, shapes in coloured if shapes[-1]
    )
    pen = 'fill="none" stroke-width="1.2" stroke-linecap="round" stroke-linejoin="round"'
    head = f'{open_svg(WIDTH, HEIGHT + BAR, title)} tabindex="0">{CALM}'
    both = f'<g class="{OVERLAY}" {pen}>{still}</g><g class="{MOVING}" {pen}>{moved}</g>'
    svg = f"{head}{both}{_draw_time(span, seconds, key)}{_draw_switch(key)}</svg>"
    length = span[1] - span[0]
    return Animation(
        svg, title, f"{format_number(length)} s, {_describe_pace(length / seconds)}; a click stops it", seconds
    )


def _describe_pace(pace: float) -> str:
    if pace == 1.0:
        return "as fast as it happens"
    return f"{format_number(max(pace, 1 / pace))} times {'slower' if pace < 1 else 'faster'} than it happens"


def _write_strokes(
    frames: Sequence[Sequence[Stroke]], axes: tuple[int, int] | None, place: PixelMap
) -> list[tuple[str, list[str]]]:
    """Colours, and the paths of the lines that have them [px], frame by frame."""
    lines = []
    for bends, colour in ((False, RIGID_COLOUR), (True, BENDS_COLOUR)):
        shapes = [
            "".join(write_line(place(convert_to_view(line, axes))) for line, is_beam in strokes if is_beam is bends)
            for strokes in frames
        ]
        if shapes[0]:
            lines.append((colour, shapes))
    return lines


def _write_levels(net: ColouredNet, axes: tuple[int, int] | None, place: PixelMap) -> list[list[str]]:
    """Paths of the edges of each level [px], frame by frame."""
    count = len(LEVEL_COLOURS)
    level = np.clip((count * net.level).astype(np.int64), 0, count - 1)
    edges = net.lines.shape[1]
    out: list[list[str]] = [[] for _ in range(count)]
    for lines, levels in zip(net.lines, level, strict=True):
        points = place(convert_to_view(lines.reshape(-1, 3), axes)).reshape(edges, 2, 2)
        for number, shapes in enumerate(out):
            shapes.append("".join(write_line(line) for line in points[levels == number]))
    return out


def _draw_moving_path(colour: str, shapes: Sequence[str], seconds: float, key: str, pen: str = "") -> str:
    """A path that takes one shape after the other; of a net, whose edges change their level, in jumps."""
    jumps = bool(pen)
    values = ";".join(shape or NOWHERE for shape in shapes) if jumps else ";".join(shapes)
    moves = _write_animate("d", values, seconds, key, jumps)
    return f'<path d="{shapes[0] or NOWHERE}" stroke="{colour}"{pen}>{moves}</path>'


def _write_animate(attribute: str, values: str, seconds: float, key: str, jumps: bool = False) -> str:
    """The change of an attribute over and over, until the picture ``key`` is stopped; it stays where it is then.

    jumps : nothing is drawn between two values
    ``key`` has no hyphen: in the names of events it is a minus.
    """
    when = f'begin="0s;play{key}.click" end="stop{key}.click" fill="freeze" restart="whenNotActive"'
    how = ' calcMode="discrete"' if jumps else ""
    return f'<animate attributeName="{attribute}" dur="{seconds:g}s" repeatCount="indefinite"{how} {when} values="{values}"/>'


def _draw_switch(key: str) -> str:
    """The whole picture as a button that stops it, and over it, once it stands, one that plays it, with the sign for that."""
    size = f'width="{WIDTH:g}" height="{HEIGHT + BAR:g}" fill="transparent"'
    stop = f'<rect id="stop{key}" {size}><title>click: stop</title></rect>'
    shown = f'<set attributeName="display" to="inline" begin="stop{key}.click" end="play{key}.click"/>'
    sign = f'<path d="M{WIDTH - 10:g} 3v7l6 -3.5z" fill="currentColor"/>'
    play = f"<rect {size}/><title>click: play from the start</title>"
    return f'{stop}<g id="play{key}" display="none">{shown}{sign}{play}</g>'


def write_line(points: Array) -> str:
    """Return the commands of a path through points (points, 2), pixels [-]."""
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points.tolist())


def _draw_time(span: tuple[float, float], seconds: float, key: str) -> str:
    """A line with a dot that moves along it, and the times at its ends; key : of the picture that it belongs to."""
    y = HEIGHT + 2.0
    left = DRAWING_MARGIN
    right = WIDTH - DRAWING_MARGIN
    dot = _write_animate("cx", f"{left:g};{right:g}", seconds, key)
    ends = ((left, "start", span[0]), (right, "end", span[1]))
    texts = "".join(
        f'<text x="{x:g}" y="{y + 8:g}" font-size="6" text-anchor="{side}" fill="currentColor">{format_number(time)} s</text>'
        for x, side, time in ends
    )
    line = f'<path d="M{left:g} {y:g}H{right:g}" stroke="#808080" stroke-width="0.6"/>'
    return (
        f'{line}<circle class="{MOVING}" cx="{left:g}" cy="{y:g}" r="1.8" fill="{BENDS_COLOUR}">{dot}</circle>{texts}'
    )
