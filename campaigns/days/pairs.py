"""Pairs of days: a machine of known truth is logged on three days; what one day tells is held against the others."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from campaigns.log_faults.answers import FRICTION, NAMES, UNKNOWN
from campaigns.log_faults.machines import WORLDS, World, add_noise, run_machine, sample_motion, write_log
from crosscheck.identification.causes.name_causes import find_causes
from crosscheck.identification.identify import Identification, identify
from crosscheck.identification.logs.log import read_log
from crosscheck.identification.table import DayRow, Row
from flexinv.typing import Array

DAYS = 3
MODELS = Path(__file__).resolve().parents[1] / "log_faults" / "models"
MACHINES = ("arm", "pendulum")  # in turn; an elastic drive takes ten times as long
DRAWN = 0.1  # relative standard deviation of masses, of one machine from the next
WIDTHS = (0.05, 0.2)  # of friction from day to day, relative: one for a machine, between these
OFFSETS = (0.02, 0.08)  # of offsets, in parts of the dry friction
ROOM = 3.0  # [K], of the room from day to day, the same for all joints
THINNER = 0.04  # [1/K]: viscosity of oil
WARMER = 0.03  # friction lost within a log, at most, as drives warm up
WARMING = "friction drift"  # which may be named: it is there
GAIN = "effort gain"
CLASSES = ("viscous friction", "coulomb friction", "effort offset", GAIN)
GAINS = (0.01, 0.03)  # of gains from day to day, relative: one for a machine, between these
MADE = 0.05  # of the gains of one machine from those of the next, relative, and what is known of them before
FREE_GAINS = f"""
[[free]]
parameter = "effort gain"
relative = {MADE}
"""


@dataclass(frozen=True)
class Check:
    """One thing that is counted: what of, where, and whether it is as it should be; part : of samples inside a band [-]."""

    what: str
    place: str
    good: bool
    part: float = np.nan


def sample_machine(name: str, random: np.random.Generator) -> World:
    """Return a machine [units of its fields] whose masses are not those of the next one."""
    world = WORLDS[name]
    factors = np.exp(DRAWN * random.normal(size=len(world.bodies)))
    bodies = tuple(
        replace(b, mass=b.mass * float(f), inertia=b.inertia * float(f))
        for b, f in zip(world.bodies, factors, strict=True)
    )
    return replace(world, bodies=bodies)


def sample_day(world: World, widths: tuple[float, float, float], random: np.random.Generator) -> World:
    """Return a machine on a day [units of its fields]; widths : of viscous and dry friction, and of offsets."""
    viscous, dry, offset = widths
    room = np.exp(-THINNER * ROOM * random.normal())
    shape = world.viscous.shape
    return replace(
        world,
        viscous=world.viscous * room * np.exp(viscous * random.normal(size=shape)),
        coulomb=world.coulomb * np.exp(dry * random.normal(size=shape)),
        offset=world.offset + offset * world.coulomb * random.normal(size=shape),
        growth=-WARMER * random.uniform(size=shape),
    )


def sample_gains(count: int, gains: bool, random: np.random.Generator) -> Array:
    """Return so many gains of efforts on each of three days, (days, joints) [-]; all 1 where none are asked for."""
    if not gains:
        return np.ones((DAYS, count))
    width = float(random.uniform(*GAINS))
    return np.asarray(np.exp(MADE * random.normal(size=count) + width * random.normal(size=(DAYS, count))))


def copy_model(name: str, gains: bool, folder: Path) -> Path:
    """Return a copy of a machine's files in a folder, with free gains of efforts where these are asked for."""
    copy = Path(shutil.copytree(MODELS / name, folder / name))
    if gains:
        file = copy / "identify.toml"
        file.write_text(file.read_text(encoding="utf-8") + FREE_GAINS, encoding="utf-8")
    return copy


def run_pair(seed: int, gains: bool = False) -> list[Check]:
    """Return all checks of a machine on three days [-]: one identifies and two do, and another judges.

    gains : of efforts are drawn anew each day, too, and are free
    """
    random = np.random.default_rng([seed, 38])
    name = MACHINES[seed % len(MACHINES)]
    world = sample_machine(name, random)
    widths = (float(random.uniform(*WIDTHS)), float(random.uniform(*WIDTHS)), float(random.uniform(*OFFSETS)))
    own = sample_gains(world.joints, gains, np.random.default_rng([seed, 39]))
    with tempfile.TemporaryDirectory() as folder:
        logs = []
        for k in range(DAYS):
            day = sample_day(world, widths, random)
            motion = sample_motion(day, random, moves=bool((seed // 2 + k) % 2))
            record = run_machine(day, motion)
            record = add_noise(replace(record, effort=record.effort * own[k]), day, random)
            logs.append(write_log(name, record, Path(folder) / f"day{k}.csv"))
        model = copy_model(name, gains, Path(folder))
        one = identify(model, logs[:1], logs[2:])
        other = identify(model, logs[1:2])
        two = identify(model, logs[:2], logs[2:])
        checks = [*_list_bands("one day", one), *_list_bands("two days", two), *_list_differences(one, other)]
        checks += _list_gains(two, own) if gains else []
        there = (*FRICTION, WARMING, UNKNOWN, *((GAIN,) if gains else ()))
        return [*checks, *_list_causes("one day", one, logs[2], there), *_list_causes("two days", two, logs[2], there)]


def _list_gains(found: Identification, gains: Array) -> Iterator[Check]:
    """Yield whether the gains of each day that identified lie in their intervals; gains : (days, joints) true ones [-]."""
    rows = [row for row in found.of_days if row.parameter == GAIN and row.day]
    days = list(dict.fromkeys(row.day for row in rows))
    joints = list(dict.fromkeys(row.place for row in rows))
    for row in rows:
        true = gains[days.index(row.day), joints.index(row.place)]
        yield Check("effort gain of its day by two days", f"{row.place} on {row.day}", row.low <= true <= row.high)


def _list_bands(known: str, found: Identification) -> Iterator[Check]:
    for row in found.judged:
        yield Check(f"bands by {known}, of 80 % or more", row.channel, row.coverage >= 0.8, row.coverage)


def _list_differences(one: Identification, other: Identification) -> Iterator[Check]:
    """Yield whether parameters of two days differ inside their intervals, of what both tell."""
    rows = [{(r.parameter, r.place): r for r in _list_rows(found)} for found in (one, other)]
    for key in rows[0].keys() & rows[1].keys():
        low, high = sorted((rows[0][key], rows[1][key]), key=lambda row: row.value)
        reach = np.hypot(high.value - high.low, low.high - low.value)
        kind = key[0] if key[0] in CLASSES else "all else"
        yield Check(f"difference of {kind}", " of ".join(key), high.value - low.value <= reach)


def _list_rows(found: Identification) -> list[Row | DayRow]:
    """Intervals of the machine, of what the log tells."""
    told = {(row.parameter, row.place): row for row in found.parameters if row.identifiable}
    machine = [row for row in found.of_days if not row.day and (row.parameter, row.place) in told]
    stays = [row for key, row in told.items() if key[0] not in CLASSES]
    return [*machine, *stays]


def _list_causes(known: str, found: Identification, log: Path, there: Sequence[str]) -> Iterator[Check]:
    """Yield whether an untouched day has no cause but those that are ``there``, and nothing unknown is said."""
    names = [(NAMES.get(one.name, one.name), one.place) for one in find_causes(found, read_log(log))]
    wrong = [f"{name} of {place}" for name, place in names if name not in there]
    yield Check(f"no false cause by {known}", "; ".join(wrong), not wrong)
    unknown = [place for name, place in names if name == UNKNOWN]
    yield Check(f"nothing unknown by {known}", "; ".join(unknown), not unknown)
