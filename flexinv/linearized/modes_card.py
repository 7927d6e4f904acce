"""The cards of modes: frequencies, damping and stability in a table, and the slowest shapes.

Error bars are not asked for: they solve a finer mesh.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexinv.display.card import Card, Picture, make_rows
from flexinv.display.drawing import Stroke, draw_svg
from flexinv.display.words import format_count, format_number
from flexinv.kinematics.strokes import collect_strokes
from flexinv.linearized.modes import Modes, Shapes
from flexinv.linearized.steady_modes import SteadyModes
from flexinv.typing import Array

DRAWN = 3  # shapes
SWING = 0.2  # of the mechanism's size: the amplitude of a shape that is drawn
COMMON = ("mode", "frequency [Hz]", "damping ratio [-]")


def make_modes_card(modes: Modes) -> Card:
    """Return the card of modes about a rest position: frequencies [Hz], damping ratios [-], stability."""
    columns = zip(modes.frequency, modes.ratio, modes.stability, modes.link, strict=True)
    rows = (
        (str(k), format_number(frequency), format_number(ratio), stability, link)
        for k, (frequency, ratio, stability, link) in enumerate(columns, 1)
    )
    facts = (_describe_free_joints(modes), "about a rest position; error bars: modes.frequency_error [Hz]")
    title = f"Modes of '{modes.mesh.mechanism.name}': {format_count(len(modes.squared), 'mode')}"
    head = (*COMMON, "stability", "moves most")
    return Card(title, facts, head, make_rows(rows), len(modes.squared), lambda: _draw_shapes(modes, modes.frequency))


def make_steady_modes_card(modes: SteadyModes) -> Card:
    """Return the card of modes about a steady motion: frequencies [Hz], damping ratios [-], and rates of growth [1/s]."""
    columns = zip(modes.frequency, modes.damping_ratio, modes.root, modes.link, strict=True)
    rows = (
        (str(k), format_number(frequency), format_number(ratio), format_number(root.real), link)
        for k, (frequency, ratio, root, link) in enumerate(columns, 1)
    )
    turning = ", ".join(f"{name} at {format_number(rate)} rad/s" for name, rate in modes.rates.items())
    facts = (_describe_free_joints(modes), f"turning: {turning or 'nothing'}; error bars: modes.frequency_error [Hz]")
    title = f"SteadyModes of '{modes.mesh.mechanism.name}': {format_count(len(modes.root), 'mode')}"
    head = (*COMMON, "growth [1/s]", "moves most")
    return Card(title, facts, head, make_rows(rows), len(modes.root), lambda: _draw_shapes(modes, modes.frequency))


def _describe_free_joints(modes: Shapes) -> str:
    return f"free joints: {', '.join(modes.free)}" if modes.free else "all joints held"


def _draw_shapes(modes: Shapes, frequencies: Array) -> tuple[Picture, ...]:
    """The slowest shapes: the mechanism as it stands faint, and displaced."""
    pictures = []
    for k in range(min(DRAWN, len(modes.displacement))):
        strokes = list_shape_strokes(modes, k)
        if strokes:
            words = f"mode {k + 1}, {format_number(frequencies[k])} Hz"
            pictures.append(Picture(draw_svg(strokes, words), words, 200))
    return tuple(pictures)


def list_shape_strokes(modes: Shapes, number: int) -> Sequence[Sequence[Stroke]]:
    """Return the lines (2, 3) [m] of the mechanism as it stands, and displaced by a shape, enlarged to `SWING` of its size."""
    shape = modes.displacement[number]
    phase = shape.flat[np.abs(shape).argmax()]
    turned = np.conj(phase) / (np.abs(phase) or 1.0)  # to the instant at which what moves most is farthest away
    move = np.real(turned * shape)
    turn = np.real(turned * modes.rotation[number])
    largest = np.linalg.norm(move, axis=1).max()
    size = np.linalg.norm(np.ptp(np.vstack([modes.position, np.zeros(3)]), axis=0))
    scale = SWING * size / largest if largest > 0.0 else 0.0
    x = np.stack([modes.position, modes.position + scale * move])
    tips = {}
    for joint in modes.mesh.mechanism.joints:
        node = modes.mesh.joint_node[joint.name]
        arm = modes.orientation[node] @ modes.mesh.mechanism.link_of[joint.child].tip
        swept = np.cross(modes.orientation[node] @ turn[node], arm)  # a small rotation, in the world
        tips[joint.child] = np.stack([x[0, node] + arm, x[1, node] + arm + scale * swept])
    strokes = collect_strokes(modes.mesh, x, tips)
    return [[(line[k], bends) for line, bends in strokes] for k in range(2)] if strokes else []
