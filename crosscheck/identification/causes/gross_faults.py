"""Faults that are not small: a sign, a unit, the wrong side of the gear, two columns that have changed places.

Each is a hypothesis; the one under which least remains unexplained is named, if it is better than none by far:

score = sum_c n_c log(1 - R_c) + |z - z_0|^2 (by the precision known before),   R_c the part of channel c that is explained

after the parameters have moved as far as pays; n_c samples of news.  R_c has no unit, so units and signs compare.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import combinations

import numpy as np

from crosscheck.identification.causes.cause import Undo, apply_column_swap, apply_to_column
from crosscheck.identification.logs.log import Log
from crosscheck.identification.machine import Channel, Machine
from crosscheck.identification.settings import ACCELERATIONS, ANGLES
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

ROUNDS = 3  # the weights are known when the residuals are
DEGREE = float(np.pi / 180.0)
# What a sensor's other unit is in its own: degrees in radians, g in m/s^2.
UNITS = {"gauge": DEGREE, "accelerometer": ACCELERATIONS["g"]}


@dataclass(frozen=True)
class GrossFault:
    """A fault of one size: its name, where, what it is [unit], and the log with the fault undone.

    places : of the channels that it spoils; moves : the model's side changes with it
    """

    name: str
    place: str
    unit: str
    size: float
    undone: Undo
    places: tuple[str, ...]
    moves: bool


def list_gross_faults(machine: Machine) -> Iterator[GrossFault]:
    """Yield the gross faults that are possible here [unit of each]."""
    for channel in machine.channels:
        yield from _list_channel_faults(machine, channel)
    for name, table in machine.settings.joints.items():
        column = table.angle.column
        wrong = {"rad": DEGREE, "deg": 1.0 / DEGREE, "m": 1e-3, "mm": 1e3}[table.angle.unit]
        yield GrossFault("wrong sign of the angle", name, "-", -1.0, _make_factor_undo(column, -1.0), (name,), True)
        factor = ANGLES[table.angle.unit]
        size = f"the column is not in {table.angle.unit}"
        yield GrossFault(
            f"wrong unit of the angle, {size}", name, "-", 1.0 / wrong, _make_factor_undo(column, wrong), (name,), True
        )
        drive = machine.mechanism.joint_of[name].drive
        if drive is not None and abs(drive.ratio) != 1.0 and factor:
            known = drive.ratio if table.angle.over == 1.0 else 1.0 / table.angle.over
            what = "wrong gear before the angle"
            yield GrossFault(what, name, "-", known, _make_factor_undo(column, 1.0 / known), (name,), True)
    yield from _list_swap_faults(machine)
    yield from _list_world_faults(machine)


def _list_world_faults(machine: Machine) -> Iterator[GrossFault]:
    """Yield angles that are told from the world in the place of the link before: the angle of its joint is in them, too."""
    joints = machine.settings.joints
    before = {joint.child: joint for joint in machine.mechanism.joints}
    for name, table in joints.items():
        first = before.get(machine.mechanism.joint_of[name].parent)
        if (
            first is None
            or first.name not in joints
            or "prismatic" in (first.kind, machine.mechanism.joint_of[name].kind)
        ):
            continue
        other = joints[first.name].angle
        factor = ANGLES[other.unit] / other.over / (ANGLES[table.angle.unit] / table.angle.over)
        undone = _make_difference_undo(table.angle.column, other.column, factor)
        yield GrossFault("angle from the world, not from the link before", name, "-", 1.0, undone, (name,), True)


def _list_channel_faults(machine: Machine, channel: Channel) -> Iterator[GrossFault]:
    kind = channel.sense
    place = channel.place
    column = channel.column
    yield GrossFault(f"wrong sign of the {kind}", place, "-", -1.0, _make_factor_undo(column, -1.0), (place,), False)
    factors = {1e3: "wrong unit", 1e-3: "wrong unit"}
    if kind in UNITS:
        factors = {1.0 / UNITS[kind]: "wrong unit", UNITS[kind]: "wrong unit"}
    if kind == "effort":
        drive = machine.mechanism.joint_of[place].drive
        ratio, constant = (drive.ratio, drive.torque_constant) if drive is not None else (1.0, None)
        if ratio != 1.0:
            factors |= {ratio: "wrong side of the gear", 1.0 / ratio: "wrong side of the gear"}
        if constant:
            factors |= {1.0 / constant: "current in the place of torque, or torque of current"}
    for factor, what in factors.items():
        yield GrossFault(
            f"{what} of the {kind}", place, "-", factor, _make_factor_undo(column, 1.0 / factor), (place,), False
        )


def _list_swap_faults(machine: Machine) -> Iterator[GrossFault]:
    yield from _list_joint_swaps(machine)
    alike: dict[str, list[tuple[str, str, bool]]] = {}
    for channel in machine.channels:
        alike.setdefault(f"{channel.sense}s", []).append((channel.place, channel.column, False))
    for name, table in machine.settings.joints.items():
        alike.setdefault("angles", []).append((name, table.angle.column, True))
    for kind, columns in alike.items():
        for (one, first, moves), (other, second, _) in combinations(columns, 2):
            undone = _make_swap_undo(first, second)
            name = f"swapped columns of the {kind}"
            yield GrossFault(name, f"{one} and {other}", "-", 1.0, undone, (one, other), moves)


def _list_joint_swaps(machine: Machine) -> Iterator[GrossFault]:
    """Yield joints of which angle and effort both stand in the columns of another: cables that were plugged the other way."""
    efforts = {channel.place: channel.column for channel in machine.channels if channel.sense == "effort"}
    joints = {name: table.angle.column for name, table in machine.settings.joints.items() if name in efforts}
    for one, other in combinations(joints, 2):
        undone = partial(_remove_joint_swap, ((joints[one], joints[other]), (efforts[one], efforts[other])))
        yield GrossFault("swapped columns of the joints", f"{one} and {other}", "-", 1.0, undone, (one, other), True)


def _remove_joint_swap(
    pairs: tuple[tuple[str, str], ...], log: Log, mechanism: Mechanism, phi: float
) -> tuple[Log, Mechanism]:
    """The log with both pairs of columns swapped."""
    for first, second in pairs:
        log = apply_column_swap(log, first, second)
    return log, mechanism


def _make_factor_undo(column: str, factor: float) -> Undo:
    return lambda log, m, phi: (apply_to_column(log, column, lambda v: v * factor), m)


def _make_difference_undo(column: str, other: str, factor: float) -> Undo:
    return lambda log, m, phi: (apply_to_column(log, column, lambda v: v - factor * log.columns[other]), m)


def _make_swap_undo(first: str, second: str) -> Undo:
    return lambda log, m, phi: (apply_column_swap(log, first, second), m)


@dataclass(frozen=True)
class Score:
    """A hypothesis judged: the score and what stays unexplained of each channel (channels,), both [-]."""

    value: float
    unexplained: Array


def compute_score(measured: list[Array], told: list[Array], slopes: list[Array], agree: Array, root: Array) -> Score:
    """Return the rest after the parameters have moved by the slopes as far as pays [-].

    measured, told : (counted,) per channel [units of the channels]; slopes : (counted, parameters)
    agree : (channels,) samples that agree [-]; root : square root of the precision of the parameters (parameters, parameters)
    """
    spread = np.array([float(np.sum((m - m.mean()) ** 2)) for m in measured])
    news = np.array([len(m) for m in measured]) / agree
    z = np.zeros(len(root))
    prior = root.T @ root
    left = np.array([float(np.sum((m - p) ** 2)) for m, p in zip(measured, told, strict=True)])
    for _ in range(ROUNDS):
        weight = news / left
        hessian = prior.copy()
        pull = np.zeros(len(z))
        for w, m, p, j in zip(weight, measured, told, slopes, strict=True):
            hessian += w * j.T @ j
            pull += w * j.T @ (m - p)
        z = np.asarray(np.linalg.solve(hessian, pull))
        left = np.array([float(np.sum((m - p - j @ z) ** 2)) for m, p, j in zip(measured, told, slopes, strict=True)])
    share = left / spread
    return Score(float(np.sum(news * np.log(share)) + np.sum((root @ z) ** 2)), share)
