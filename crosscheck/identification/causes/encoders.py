"""Two encoders of one joint, at the motor and behind the gear: how they disagree, and by what.

q_link - q_motor = c - T qd - tau / k - (b / 2) sign(tau) - (h / 2) sign(qd) + e q

T how much later the link angle is [s], k stiffness of the drive, b backlash, h hysteresis, e relative error of the gear ratio or
of a scale.  Terms enter one after the other, the one with the most evidence first, as long as there is any.

A standard error is the larger of what the scatter of the rest says and of how much a size differs where one block of time after
the other is left out (jackknife, B. Efron, C. Stein, Annals of Statistics 9, 1981): what the terms lack lasts longer than noise.
A stiffness cannot be told where no twist enters, or 1 / k is within `SURE` errors of nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from crosscheck.identification.causes.cause import NamedCause
from crosscheck.identification.estimation.fit import Fit
from crosscheck.identification.estimation.noise import count_agreeing_samples
from crosscheck.identification.filters import low_pass
from crosscheck.identification.logs.log import Log
from crosscheck.identification.machine import Machine
from crosscheck.identification.readings import Run, make_run
from crosscheck.identification.settings import ANGLES
from flexinv.typing import Array

EVIDENCE = 12.0  # drop of the cost, as of any other cause
SURE = 3.0  # standard errors that a size has to be from 0, as of any other cause; a stiffness is as sure as 1 / k is
DELAY = "link angle later than the motor's"
TWIST = "twist of the drive, stiffness"
BACKLASH = "backlash"
HYSTERESIS = "hysteresis between motor and link angle"
SCALE = "scale of link over motor angle (gear), relative error"


@dataclass(frozen=True)
class EncoderComparison:
    """By what motor and link angles disagree, the most evident first, and joints whose stiffness cannot be told, in words."""

    named: list[NamedCause]
    untold: list[str]


def compare_encoders(machine: Machine, fit: Fit, log: Log) -> EncoderComparison:
    """Return by what motor and link angles disagree [unit of each], joint by joint, and what they cannot tell."""
    tables = {n: t.link_angle for n, t in machine.settings.joints.items() if t.link_angle is not None}
    tables = {n: t for n, t in tables.items() if t.column in log.columns}
    if not tables:
        return EncoderComparison([], [])
    run = make_run(machine, log, efforts=False, once=True)
    effort = run.response(machine.space.compute_values(fit.z))[0]
    out: list[NamedCause] = []
    untold: list[str] = []
    for name, table in tables.items():
        link = log.read_column(table.column) * (ANGLES[table.unit] / table.over)
        found = list(_compare_joint_encoders(machine, run, name, link, effort[:, run.motion.names.index(name)]))
        twist = next((one for one in found if one.name == TWIST), None)
        if twist is None or twist.size < SURE * twist.error:
            untold.append(_describe_untold_stiffness(name, twist))
        out += [one for one in found if abs(one.size) >= SURE * one.error]
    return EncoderComparison(sorted(out, key=lambda one: -one.drop), untold)


def _describe_untold_stiffness(name: str, twist: NamedCause | None) -> str:
    """That a log cannot tell the stiffness of a drive [-], and why."""
    why = "motor and link angle show no twist that follows the load"
    if twist is not None:
        why = f"{twist.size:.2g} +- {twist.error:.2g} {twist.unit} would fit"
    return (
        f"{TWIST} of {name}: it cannot be told from this log ({why}); a log with larger loads at slow rates tells more"
    )


def _compare_joint_encoders(machine: Machine, run: Run, name: str, link: Array, effort: Array) -> Iterator[NamedCause]:
    at = run.motion.names.index(name)
    spacing = float(run.time[1] - run.time[0])
    q = run.motion.q[:, at]
    qd = run.motion.qd[:, at]
    slides = machine.mechanism.joint_of[name].kind == "prismatic"
    difference = low_pass(link, spacing, machine.settings.bandwidth_Hz) - low_pass(
        q, spacing, machine.settings.bandwidth_Hz
    )
    wide = np.sqrt(np.mean(effort**2)) / 10.0 + 1e-12
    terms = {
        DELAY: ("s", -qd),
        TWIST: ("", -effort),
        BACKLASH: ("m" if slides else "rad", -0.5 * np.tanh(effort / wide)),
        HYSTERESIS: ("m" if slides else "rad", -0.5 * np.tanh(qd / machine.settings.still_rad_per_s)),
        SCALE: ("-", q - q.mean()),
    }
    columns = [c for c, channel in enumerate(machine.channels) if channel.place == name and channel.sense == "effort"]
    counted = run.counted[:, columns[0]] if columns else run.counted.any(axis=1)
    block = np.floor((run.time - run.time[0]) / machine.settings.block_s)[counted]
    for kind, size, error, drop, left in _find_entering_terms(
        difference[counted], {k: v[1][counted] for k, v in terms.items()}, block
    ):
        unit = terms[kind][0]
        if kind == TWIST:
            unit, size, error = ("N/m" if slides else "N m/rad"), 1.0 / size, error / size**2
        words = f"their difference scatters by {left:.2g} of what it does without; the cost falls by {drop:.0f}"
        yield NamedCause(kind, name, unit, size, error, drop, words)


def _find_entering_terms(
    difference: Array, terms: dict[str, Array], block: Array
) -> Iterator[tuple[str, float, float, float, float]]:
    """Kind, size, its error, drop, and the part of the scatter that is left, of each term that enters."""
    chosen: list[str] = []
    drops: list[tuple[float, float]] = []
    left = _solve_regression(difference, [])[0]
    while len(chosen) < len(terms):
        tried = {
            k: _solve_regression(difference, [*(terms[c] for c in chosen), terms[k]]) for k in terms if k not in chosen
        }
        kind = min(tried, key=lambda k: float(np.sum(tried[k][0] ** 2)))
        rest, size, _ = tried[kind]
        drop = len(difference) / count_agreeing_samples(rest) * np.log(np.sum(left**2) / np.sum(rest**2))
        if drop < EVIDENCE or (kind in (TWIST, BACKLASH, HYSTERESIS) and size[-1] <= 0.0):
            break
        drops.append((float(drop), float(np.sqrt(np.sum(rest**2) / np.sum(left**2)))))
        chosen.append(kind)
        left = rest
    if chosen:
        columns = [terms[c] for c in chosen]
        _, size, error = _solve_regression(difference, columns)
        error = np.maximum(error, _compute_block_errors(difference, columns, block))
        yield from zip(chosen, size.tolist(), error.tolist(), *zip(*drops, strict=True), strict=True)


def _compute_block_errors(values: Array, columns: list[Array], block: Array) -> Array:
    """Standard errors (columns,) of a regression's sizes, where one block after the other is left out; block : (samples,)."""
    numbers = np.unique(block)
    if len(numbers) < 2:
        return np.zeros(len(columns))
    left_out = [_solve_regression(values[block != n], [c[block != n] for c in columns])[1] for n in numbers]
    return np.asarray(np.sqrt((len(numbers) - 1) * np.var(left_out, axis=0)))


def _solve_regression(values: Array, columns: list[Array]) -> tuple[Array, Array, Array]:
    """Rest of a regression on a constant and columns, their sizes and standard errors."""
    matrix = np.column_stack([*columns, np.ones(len(values))])
    scale = np.sqrt(np.mean(matrix**2, axis=0)) + 1e-300
    size = np.linalg.lstsq(matrix / scale, values, rcond=None)[0] / scale
    rest = values - matrix @ size
    base = np.linalg.pinv((matrix / scale).T @ (matrix / scale))
    error = np.sqrt(np.diag(base) * np.mean(rest**2) * count_agreeing_samples(rest)) / scale
    return rest, size[:-1], error[:-1]
