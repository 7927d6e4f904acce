"""Faults planted in measured logs: is each named first, with its size?  python tests/shared/planted_faults.py kuka_kr300

One log identifies as it is, and the same log with a fault in it is judged: what is named beside what the untouched log shows.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import click
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

import crosscheck
from crosscheck.identification.causes.cause import NamedCause
from crosscheck.identification.causes.dictionary import list_possible_causes
from crosscheck.identification.causes.name_causes import find_causes
from crosscheck.identification.causes.rounds import update_space
from crosscheck.identification.identify import Identification, read_of
from crosscheck.identification.logs.log import Log
from crosscheck.identification.machine import Machine
from crosscheck.identification.readings import (
    apply_delay,
    apply_first_order_lag,
    compute_raw_signals,
    make_run,
)

MODELS = Path(__file__).parents[2] / "models"
LOGS = {
    "kuka_kr300": "run_A.csv.gz",
    "quanser_2dsfl": "record.csv",
    "quanser_2dsfl_rigid": "../quanser_2dsfl/record.csv",
}
# Payload: of the mass of all rigid links.
SAMPLES, LAG, CONSTANT, TILT, PAYLOAD = 2, 0.005, 0.3, np.radians(3.0), 0.01


@dataclass(frozen=True)
class PlantedFault:
    """A fault in a log: the cause that has to be named, its place, its size [unit of the cause], and the log that has it."""

    name: str
    place: str
    size: float
    log: Log


def planted(identification: Identification, log: Log) -> Iterator[PlantedFault]:
    """Yield logs with one fault each: delays, lags, constants and signs of every effort, tilts of gravity, a payload."""
    for channel in identification.machine.channels:
        values, kind = log.columns[channel.column], channel.sense
        delay = SAMPLES * log.spacing
        spoiled = {
            (f"delay of the {kind}", delay): apply_delay(values, log.spacing, delay),
            (f"first-order lag of the {kind}", LAG): apply_first_order_lag(values, log.spacing, LAG),
            (f"wrong sign of the {kind}", -1.0): -values,
        }
        if kind == "effort":
            spoiled["torque constant, relative error", CONSTANT] = (1.0 + CONSTANT) * values
        for (name, size), column in spoiled.items():
            yield PlantedFault(name, channel.place, size, replace(log, columns={**log.columns, channel.column: column}))
    found = identification.machine.space.compute_values(identification.fit.z)
    for cause in list_possible_causes(identification.machine, found):  # no tilt where the mechanism states no gravity
        mass = sum(
            b.inertia.mass for link in identification.machine.mechanism.links for b in link.bodies if link.beam is None
        )
        sizes = {"tilt of gravity": TILT, "payload beside what is known": float(f"{PAYLOAD * mass:.1g}")}
        size = sizes.get(cause.name, 0.0)
        if size:
            mechanism = cause.undone(log, identification.machine.mechanism, size)[1]
            other = replace(
                identification.machine, mechanism=mechanism, space=update_space(identification.machine, mechanism)
            )
            yield PlantedFault(cause.name, cause.place, size, _of_another(identification, other, log))


def _of_another(identification: Identification, other: Machine, log: Log) -> Log:
    """Return the log with efforts of another mechanism: what it would have needed more is added [N m], [N]."""
    values, columns = identification.machine.space.compute_values(identification.fit.z), dict(log.columns)
    run = make_run(identification.machine, log, efforts=False)
    changed = make_run(other, log, efforts=False)
    more = compute_raw_signals(other, run.motion, changed.response, values) - compute_raw_signals(
        identification.machine, run.motion, run.response, values
    )
    for channel, change in zip(identification.machine.channels, more.T, strict=True):
        columns[channel.column] = columns[channel.column] + change / channel.factor
    return replace(log, columns=columns)


def verdict(one: PlantedFault, named: list[NamedCause], known: set[tuple[str, str]]) -> tuple[bool, str]:
    """Return whether the fault is the first that the untouched log does not show, and all that is named in words."""
    news = [n for n in named if (n.name, n.place) not in known]
    first = bool(news) and (news[0].name, news[0].place) == (one.name, one.place)
    close = first and (not news[0].error or abs(news[0].size - one.size) < 3.0 * news[0].error + 0.05 * abs(one.size))
    return close, "; ".join(n.words for n in news)


@click.command()
@click.argument("name", type=click.Choice(list(LOGS)))
@click.option("--only", default="", help="Faults whose name and place contain this.")
@click.option("--itself", is_flag=True, help="The log with the fault identifies, too, instead of the one as it is.")
def main(name: str, only: str, itself: bool) -> None:
    """Plant faults in the log of NAME, one after the other, and print what is named."""
    path = MODELS / name / LOGS[name]
    identification = crosscheck.identify(MODELS / name, [path])
    log = read_of(identification.machine, path)
    untouched = find_causes(identification, log, itself)
    click.echo("untouched: " + "; ".join(one.words for one in untouched))
    known = {(one.name, one.place) for one in untouched}
    counts = []
    for one in planted(identification, log):
        if only in f"{one.name} of {one.place}":
            told = crosscheck.identify(MODELS / name, [one.log]) if itself else identification
            good, words = verdict(one, find_causes(told, one.log, itself), known)
            counts.append(good)
            click.echo(f"{'ok  ' if good else 'MISS'} {one.name} of {one.place}, {one.size:.4g}: {words}")
    click.echo(f"{sum(counts)} of {len(counts)} named first with their size")


if __name__ == "__main__":
    main()
