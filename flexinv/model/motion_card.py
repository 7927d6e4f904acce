"""The card of a motion: its joints with start, end and reach, and their coordinates over time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flexinv.display.card import Card, Picture, make_rows
from flexinv.display.curves import NamedCurve, draw_curves
from flexinv.display.words import format_count, format_number
from flexinv.model.motion import Motion
from flexinv.model.track import Track, evaluate_progress, find_law
from flexinv.typing import Array

INSTANTS = 81  # of a law
SINGLE = "rad or m"
SEVERAL = "rad, m or -"  # components of quaternions, cosines and sines have no unit


def make_motion_card(motion: Motion) -> Card:
    """Return the card of a motion: start, end and reach of each coordinate [rad], [m], and how long it takes [s]."""
    unit = SINGLE if all(_has_single_coordinates(track) for track in motion.tracks) else SEVERAL
    columns = [column for track in motion.tracks for column in list_columns(track)]
    names = [name for track in motion.tracks for name in track.names or ()]
    what = format_count(len(names), "joint") if names else "all joints of a mechanism, in its order"
    title = f"{type(motion).__name__} of {what} in {format_number(motion.duration)} s"
    head = ("coordinate", f"start [{unit}]", f"end [{unit}]", f"least [{unit}]", f"largest [{unit}]")
    rows = make_rows(map(_list_row, columns))
    return Card(title, tuple(_describe_tracks(motion)), head, rows, len(columns), lambda: _draw_tracks(motion, unit))


def _has_single_coordinates(track: Track) -> bool:
    return track.widths is not None and set(track.widths) <= {1}


def list_columns(track: Track) -> list[tuple[str, Array]]:
    """Return the columns of a track by name, (rows,) [rad], [m] or [-]: start and end of a law, else all samples."""
    if track.names is None or track.widths is None:
        given = ", ".join(track.names or ())
        names = [f"{given or 'q'}[{k}]" for k in range(track.values.shape[1])]
        if track.names is not None and len(track.names) == len(names):
            names = list(track.names)
    else:
        pairs = zip(track.names, track.widths, strict=True)
        names = [f"{name}[{k}]" if width > 1 else name for name, width in pairs for k in range(width)]
    return list(zip(names, track.values.T, strict=True))


def _list_row(column: tuple[str, Array]) -> tuple[str, ...]:
    name, values = column
    return name, *map(format_number, (values[0], values[-1], values.min(), values.max()))


def _describe_tracks(motion: Motion) -> Iterator[str]:
    """Yield how its joints move: a line for every law and table of samples."""
    for track in motion.tracks:
        names = ", ".join(track.names) if track.names else "all"
        shaped = "" if track.shaper is None else f", shaped in {format_count(len(track.parts), 'part')}"
        if track.sampling is None:
            rest = f" after a rest of {format_number(track.delay)} s" if track.delay else ""
            yield f"{track.law} in {format_number(track.move)} s{rest}{shaped}: {names}"
        else:
            count = len(track.sampling.time)
            yield f"spline of degree {track.sampling.degree} through {format_count(count, 'sample')}{shaped}: {names}"


def _list_curves(track: Track, duration: float) -> Iterator[NamedCurve]:
    """Yield the coordinates over time: those of a law as it has them, samples as they are, or the sum of their parts.

    Rotations in space, of which a law knows the start and the end alone, are left out.
    """
    time = np.linspace(0.0, duration, INSTANTS)
    if track.sampling is not None and track.shaper is None:
        yield from ((name, track.sampling.time, values) for name, values in list_columns(track))
        return
    if track.sampling is not None:
        for name, values in list_columns(track):
            sampled = [share * np.interp(time - begin, track.sampling.time, values) for begin, share in track.parts]
            yield name, time, np.sum(sampled, axis=0)
        return
    law = find_law(track.law)
    before_jump = np.zeros(time.shape, bool)
    parts = [
        share * evaluate_progress(law, (time - track.delay - begin) / track.move, before_jump)[0]
        for begin, share in track.parts
    ]
    progress = np.sum(parts, axis=0)
    if not _has_single_coordinates(track):
        yield "progress", time, progress
        return
    for name, values in list_columns(track):
        yield name, time, values[0] + progress * (values[1] - values[0])


def _draw_tracks(motion: Motion, unit: str) -> tuple[Picture, ...]:
    curves = [curve for track in motion.tracks for curve in _list_curves(track, motion.duration)]
    if not curves or not motion.duration:
        return ()
    words = "coordinates over time" if len(curves) < 7 else f"the first 6 of {len(curves)} coordinates over time"
    return (Picture(draw_curves(curves, unit, words), words, 420),)
