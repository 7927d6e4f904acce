"""Bars beside names, small, as SVG: how large each of some numbers is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexinv.display.curves import COLOURS
from flexinv.display.drawing import open_svg
from flexinv.display.words import convert_to_xml, format_number, take_start

# [px] of the drawing
BARS_WIDTH = 420.0
BAR_HEIGHT = 16.0
NAMES_WIDTH = 190.0
NUMBERS_WIDTH = 80.0
MOST_BARS = 8
BAR_NAME_LENGTH = 34  # characters


def draw_bars(bars: Sequence[tuple[str, float]], unit: str, what: str) -> str:
    """Return the first bars [unit], none below zero, as an SVG element; ``what`` is read out where it is not seen."""
    drawn = [(name, size if np.isfinite(size) else 0.0) for name, size in bars[:MOST_BARS]]
    longest = max((size for _, size in drawn), default=0.0) or 1.0
    room = BARS_WIDTH - NAMES_WIDTH - NUMBERS_WIDTH
    parts = []
    for k, (name, size) in enumerate(drawn):
        y = k * BAR_HEIGHT
        width = room * max(size, 0.0) / longest
        words = convert_to_xml(take_start(name, BAR_NAME_LENGTH))
        number = convert_to_xml(f"{format_number(size)} {unit}".removesuffix(" -"))
        parts.append(f'<text x="0" y="{y + 11:g}">{words}</text>')
        parts.append(f'<rect x="{NAMES_WIDTH:g}" y="{y + 3:g}" width="{width:.1f}" height="10" fill="{COLOURS[0]}"/>')
        parts.append(f'<text x="{NAMES_WIDTH + width + 4:.1f}" y="{y + 11:g}">{number}</text>')
    high = max(1, len(drawn)) * BAR_HEIGHT
    return f'{open_svg(BARS_WIDTH, high, what)} font-size="10" fill="currentColor">{"".join(parts)}</svg>'
