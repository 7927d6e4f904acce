"""The card of an identification: parameters with intervals, how well logs are explained, and one reading, measured and told."""

from __future__ import annotations

from collections.abc import Iterator

from crosscheck.identification.bands import ChannelJudgement
from crosscheck.identification.identify import Identification
from crosscheck.identification.table import Row
from flexinv.display.card import Card, Picture, make_rows
from flexinv.display.curves import draw_curves
from flexinv.display.words import format_count, format_number

PARAMETER_COLUMNS = ("parameter", "place", "value", "90 % interval", "told by the logs")


def make_identification_card(found: Identification) -> Card:
    """Return the card of an identification: parameters with 90 % intervals [unit of each], parts explained [%]."""
    told = sum(row.identifiable for row in found.parameters)
    count = len(found.parameters)
    title = f"Identification of '{found.machine.mechanism.name}': {told} of {format_count(count, 'parameter')} told by the logs"
    rows = make_rows(map(_list_parameter_row, sorted(found.parameters, key=lambda row: not row.identifiable)))
    facts = tuple(_describe_logs(found))
    return Card(title, facts, PARAMETER_COLUMNS, rows, count, lambda: _draw_reading(found))


def _list_parameter_row(row: Row) -> tuple[str, ...]:
    unit = "" if row.unit == "-" else f" {row.unit}"
    interval = f"{format_number(row.low)} to {format_number(row.high)}{unit}"
    return row.parameter, row.place, f"{format_number(row.value)}{unit}", interval, "yes" if row.identifiable else "no"


def _describe_logs(found: Identification) -> Iterator[str]:
    """Yield how much of the readings is explained, of logs that identified and of those held out, and doubts."""
    yield from _describe_shares(found)
    yield from found.words


def _describe_shares(found: Identification) -> Iterator[str]:
    for words, judged in (("identified from", found.seen), ("held out", found.judged)):
        if judged:
            yield f"{words}: {_describe_share(judged)}"


def describe_gist(found: Identification) -> str:
    """Return in one sentence how many parameters are told, and what is explained and covered [%] of the logs that judge."""
    told = sum(row.identifiable for row in found.parameters)
    *_, last = _describe_shares(found)
    return f"{told} of {format_count(len(found.parameters), 'parameter')} told by the logs; {last}."


def _describe_share(judged: list[ChannelJudgement]) -> str:
    worst = min(judged, key=lambda one: one.explained)
    share = format_number(100.0 * worst.explained)
    inside = format_number(100.0 * min(one.coverage for one in judged))
    channels = format_count(len({one.channel for one in judged}), "channel")
    return (
        f"{channels}, {share} % explained at least ({worst.channel}), {inside} % of samples inside 90 % bands at least"
    )


def _draw_reading(found: Identification) -> tuple[Picture, ...]:
    """The first channel of each log that was held out, or else of the first log: measured and told."""
    runs, what = (found.held, "held out") if found.held else (found.shown[:1], "identified from")
    pictures = []
    for run, prediction in runs if found.machine.channels else ():
        if run.measured is not None:
            channel = found.machine.channels[0]
            curves = [
                ("measured", run.time, run.measured[:, 0]),
                ("told", prediction.time, prediction.value[:, 0]),
            ]
            words = f"{channel.name} [{channel.unit}], {run.name}, {what}"
            pictures.append(Picture(draw_curves(curves, channel.unit, words), words, 420))
    return tuple(pictures)
