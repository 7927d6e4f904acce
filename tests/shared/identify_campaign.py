"""Synthetic truth: do the intervals of `crosscheck identify` hold it?  python tests/shared/identify_campaign.py --count 30

Random mechanisms (rigid chains, elastic drives, beams, a five-bar loop) are identified from logs that were made of a truth drawn
from the priors: noise on efforts and encoders, friction, delays.  Counted per class of parameter, of those that the log tells.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # matrices are small: a second thread of BLAS waits by spinning

import click
import numpy as np
from logged_arm import jitter
from scipy.interpolate import CubicSpline
from scipy.stats import beta

sys.path.insert(0, str(Path(__file__).parents[2]))

from crosscheck.identification.bands import compute_margins, judge, predict
from crosscheck.identification.estimation.fit import Fit, Problem, build_problem, fit
from crosscheck.identification.estimation.march_steps import build_finer_run, choose_steps, replace_steps
from crosscheck.identification.identify import read_machine
from crosscheck.identification.logs.log import Log, take_even_steps
from crosscheck.identification.machine import Machine
from crosscheck.identification.parameters import KINDS, MASS, Key
from crosscheck.identification.pseudo_inertia import NAMES, QUANTITIES, convert_to_com, move_mass_properties
from crosscheck.identification.readings import Run, compute_raw_signals, make_run
from crosscheck.identification.responses.response import MeasuredMotion, build_response
from crosscheck.identification.table import CONFLICT, list_parameter_rows
from flexinv.typing import Array

CLASSES = ("rigid", "rigid", "drives", "beams", "loop")
NOISE, LASTING, MEMORY = 0.01, 0.01, 0.05  # of an effort's spread: white, and lasting so long [s]
ENCODER = 1e-5  # [rad]
WIDE = 0.35  # interval over prior width beyond which the data's own error is more than a third of that
RATE, SECONDS = 125.0, 6.0
TRUE_STEPS = 16  # a sample, of the march that makes a log: identify chooses its own


@dataclass(frozen=True)
class ParameterOutcome:
    """A parameter: its class, whether its interval holds the truth, and interval over prior width [-].

    said : that data and prior contradict each other; off : its truth was put off by so many widths of its prior
    told : by the logs, else it is said to be held by its prior
    """

    mechanism: str
    class_: str
    parameter: str
    place: str
    holds: bool
    ratio: float
    said: bool = False
    off: bool = False
    told: bool = True


def text_of(kind: str, random: np.random.Generator) -> tuple[str, str]:
    """Return mechanism.toml and identify.toml of a random mechanism [kg, m, N m]."""
    if kind == "loop":
        return _loop(random)
    count = 1 if kind in ("beams", "drives") else int(random.integers(2, 5))
    lines = ['title = "random"', 'source = "campaign"', "gravity_m_per_s2 = [0, 0, -9.81]"]
    free = [_free(MASS, 0.3), _free("effort offset", error=0.5), _free("effort delay", error=0.002)]
    settings = [
        "bandwidth_Hz = 10",
        "block_s = 1.0",
        "still_rad_per_s = 0.02",
        "between_runs = 0",
        "least_radius_m = 0.02",
    ]
    parent = "world"
    for k in range(count):
        length = float(random.uniform(0.2, 0.5))
        axis = [0, 1, 0] if kind in ("beams", "drives") else np.eye(3)[random.integers(0, 3)].tolist()
        lines += _joint(f"j{k}", parent, f"l{k}", [0.0 if k == 0 else 0.3, 0, 0], axis, random)
        settings += [f"[joints.j{k}]", f'angle = {{ column = "q{k}" }}', f'effort = {{ column = "t{k}" }}']
        lines += _body(f"l{k}", float(random.uniform(2.0, 8.0)), length)
        parent = f"l{k}"
    if kind == "drives":
        lines += ["[joints.spring]", 'kind = "revolute"', 'parent = "l0"', 'child = "arm"', "axis = [0, 1, 0]",
                  "placement = { xyz_m = [0.1, 0, 0] }", "actuated = false",
                  f"stiffness_Nm_per_rad = {random.uniform(150, 400)}",
                  f"damping_Nms_per_rad = {random.uniform(0.4, 1.0)}"]  # fmt: skip
        lines += _body("arm", float(random.uniform(1.0, 3.0)), float(random.uniform(0.2, 0.4)))
        free += [_free("joint stiffness", 0.3, place="spring"), _free("joint damping", 0.5, place="spring")]
        settings.insert(0, 'initial = "static"')
    if kind == "beams":
        lines += ["[sections.strip]", 'shape = "rectangle"', "size_y_m = 0.03", f"size_z_m = {random.uniform(0.004, 0.006)}",
                  "E_Pa = 70e9", "nu = 0.3", "rho_kg_per_m3 = 2700", "retardation_s = 2e-3", "[links.strip]",
                  'kind = "beam"', f"length_m = {random.uniform(0.4, 0.6)}", 'section = "strip"', "order = 3",
                  "[[links.strip.payload]]", 'name = "end"', "station = 1.0", "mass_kg = 0.5", "com_m = [0, 0, 0]",
                  "inertia_kgm2 = 0", "[joints.root]", 'kind = "fixed"', 'parent = "l0"', 'child = "strip"',
                  "placement = { xyz_m = [0.1, 0, 0] }"]  # fmt: skip
        free += [_free("beam stiffness", 0.3), _free("beam damping", 0.5)]
        settings.insert(0, 'initial = "static"')
    free += [_free("rotor inertia", 0.2), _free("viscous friction", 0.5), _free("coulomb friction", 0.5)]
    return "\n".join(lines), "\n".join([*settings, *free])


def _free(kind: str, relative: float = 0.0, error: float = 0.0, place: str = "*") -> str:
    size = f"relative = {relative}" if relative else f"error = {error}"
    return f'[[free]]\nparameter = "{kind}"\nplace = ["{place}"]\n{size}'


def _joint(
    name: str, parent: str, child: str, at: list[float], axis: list[float], random: np.random.Generator
) -> list[str]:
    numbers = random.uniform([0.1, 1.0, 1.0], [0.4, 4.0, 4.0])
    return [
        f"[joints.{name}]", 'kind = "revolute"', f'parent = "{parent}"', f'child = "{child}"',
        f"placement = {{ xyz_m = {at} }}", f"axis = {axis}", f"rotor_inertia_kgm2 = {numbers[0]}",
        f"damping_Nms_per_rad = {numbers[1]}", f"friction_Nm = {numbers[2]}",
    ]  # fmt: skip


def _body(name: str, mass: float, length: float) -> list[str]:
    inertia = mass * length**2 / 12.0
    return [
        f"[links.{name}]", 'kind = "rigid"', f"mass_kg = {mass}", f"com_m = [{length / 2}, {0.05 * length}, 0.02]",
        f"inertia_kgm2 = {{ xx = {0.2 * inertia}, yy = {inertia}, zz = {inertia} }}",
    ]  # fmt: skip


def _loop(random: np.random.Generator) -> tuple[str, str]:
    """A five-bar in a vertical plane; its cranks stay apart from where the forearms are in line."""
    lines = ['title = "five-bar"', 'source = "campaign"', "gravity_m_per_s2 = [0, -9.81, 0]"]
    for side, x in (("left", 0.0), ("right", 0.3)):
        lines += _joint(side, "world", f"{side}_crank", [x, 0, 0], [0, 0, 1], random)
        lines += _body(f"{side}_crank", float(random.uniform(1.0, 4.0)), 0.25)
        lines += [f"[joints.{side}_elbow]", 'kind = "revolute"', f'parent = "{side}_crank"', f'child = "{side}_forearm"',
                  "placement = { xyz_m = [0.25, 0, 0] }", "axis = [0, 0, 1]", "actuated = false"]  # fmt: skip
        lines += _body(f"{side}_forearm", float(random.uniform(0.5, 2.0)), 0.4)
    ends = (
        f'{end} = {{ link = "{side}_forearm", xyz_m = [0.4, 0, 0] }}'
        for end, side in (("first", "left"), ("second", "right"))
    )
    lines += ["[closures.tool]", 'kind = "revolute"', *ends, "axis = [0, 0, 1]"]
    settings = ["bandwidth_Hz = 10", "block_s = 1.0", "still_rad_per_s = 0.02", "between_runs = 0", "least_radius_m = 0.02",
                "start.left_elbow = { deg = -80 }", "start.right_elbow = { deg = 80 }"]  # fmt: skip
    for side in ("left", "right"):
        settings += [f"[joints.{side}]", f'angle = {{ column = "q_{side}" }}', f'effort = {{ column = "t_{side}" }}']
    free = [_free(MASS, 0.3), _free("effort offset", error=0.5), _free("rotor inertia", 0.2)]
    return "\n".join(lines), "\n".join(
        [*settings, *free, _free("viscous friction", 0.5), _free("coulomb friction", 0.5)]
    )


def moving(machine: Machine, random: np.random.Generator, kind: str) -> MeasuredMotion:
    """Return a motion of five harmonics from rest to rest [s, rad]: what bends rings on from anything else."""
    names = tuple(machine.settings.joints)
    time = np.arange(0.0, SECONDS, 1.0 / RATE)
    ramp = np.clip(np.minimum(time, SECONDS - time) / 0.6, 0.0, 1.0)
    window = ramp**4 * (35.0 - 84.0 * ramp + 70.0 * ramp**2 - 20.0 * ramp**3)
    q = np.zeros((len(time), len(names)))
    middle = {"left": np.radians(110.0), "right": np.radians(55.0)}
    for k, name in enumerate(names):
        for n in range(1, 6):
            w, size, phase = 2 * np.pi * n / SECONDS, random.uniform(0.05, 0.3), random.uniform(0, 2 * np.pi)
            q[:, k] += window * size * (0.3 if kind == "loop" else 1.0) * np.sin(w * time + phase)
        q[:, k] += middle.get(name, 0.0)
    spline = CubicSpline(time, q)
    return MeasuredMotion(time, names, q, spline(time, 1), spline(time, 2))


def logged(
    machine: Machine,
    motion: MeasuredMotion,
    z: Array,
    random: np.random.Generator,
    sizes: dict[str, float] | None = None,
) -> Log:
    """Return what a true machine at z (parameters,) [-] would have logged, with noise [s, rad, N m].

    sizes : spread of each effort that the noise is a part of; written where it is empty, so that the next log has the same noise
    """
    sizes = {} if sizes is None else sizes
    settings = replace_steps(machine, TRUE_STEPS).settings
    tell = build_response(machine.mechanism, machine.space, settings, motion, once=True)
    raw_signals = compute_raw_signals(machine, motion, tell, machine.space.compute_values(z))
    columns = {
        t.angle.column: motion.q[:, k] + ENCODER * random.normal(size=len(motion.time))
        for k, t in enumerate(machine.settings.joints.values())
    }
    for channel, values in zip(machine.channels, raw_signals.T, strict=True):
        white, lasts = random.normal(size=(2, len(values)))
        keep = float(np.exp(-1.0 / (RATE * MEMORY)))
        for k in range(1, len(lasts)):
            lasts[k] = keep * lasts[k - 1] + np.sqrt(1.0 - keep**2) * lasts[k]
        size = sizes.setdefault(channel.column, float(np.std(values)))
        columns[channel.column] = values + size * (NOISE * white + LASTING * lasts)
    return Log("made", motion.time, columns)


def trial(kind: str, seed: int, off: float = 0.0) -> tuple[list[ParameterOutcome], list[float], str]:
    """Identify a random mechanism; return what it tells, coverage on another motion [-], and words.

    off : so many widths of its prior one parameter of the truth is off [-], which is no mass property
    """
    random = np.random.default_rng([seed, CLASSES.index(kind)])
    machine = read_random_machine(kind, seed, random)
    z = np.clip(random.normal(size=len(machine.space.parameters)), -2.5, 2.5)
    moved: Key | None = None
    if off:
        alone = [k for k, one in enumerate(machine.space.parameters) if one.kind != MASS]
        chosen = alone[random.integers(len(alone))]
        z[chosen] = off * random.choice([-1.0, 1.0])
        moved = machine.space.parameters[chosen].key
    sizes: dict[str, float] = {}
    logs = [logged(machine, moving(machine, random, kind), z, random, sizes) for _ in range(2)]
    runs = [make_run(machine, log) for log in logs]
    task, result = fit_with_steps(machine, runs[0])
    other = build_finer_run(task.machine, runs[1])
    told = predict(task.machine, result, compute_margins(task, result), other)
    return (
        list(_list_outcomes(task.machine, result, z, f"{kind}{seed}", moved)),
        [r.coverage for r in judge(task.machine, other, told)],
        "",
    )


def fit_with_steps(machine: Machine, run: Run) -> tuple[Problem, Fit]:
    """Return the problem of a run with as many steps as it needs, and its parameters [-]."""
    task = build_problem(machine, (run,))
    found = fit(task)
    while (finer := choose_steps(task, found, machine.settings.every)) is not None:
        task = finer
        found = fit(task, found.z)
    return task, found


def read_random_machine(kind: str, seed: int, random: np.random.Generator) -> Machine:
    """Return a random machine of a class [-], read from its two files."""
    with TemporaryDirectory() as folder:
        base = Path(folder) / f"{kind}{seed}"
        base.mkdir()
        for name, text in zip(("mechanism.toml", "identify.toml"), text_of(kind, random), strict=True):
            (base / name).write_text(text, encoding="utf-8")
        return read_machine(base)


def moved_by_jitter(kind: str, seed: int) -> tuple[list[str], int]:
    """Identify a random mechanism from a log, and from the same one at uneven times (`logged_arm.jitter`).

    Return which parameters leave the interval of the even log by that [unit of each], and how many there are.
    """
    random = np.random.default_rng([seed, CLASSES.index(kind)])
    machine = read_random_machine(kind, seed, random)
    z = np.clip(random.normal(size=len(machine.space.parameters)), -2.5, 2.5)
    log = logged(machine, moving(machine, random, kind), z, random)
    at = jitter(log.time, seed)
    curves = {name: CubicSpline(log.time, values)(at) for name, values in log.columns.items()}
    uneven = take_even_steps(Log("uneven", at, curves))
    tables = [
        list_parameter_rows(machine.space, fit_with_steps(machine, make_run(machine, one))[1]) for one in (log, uneven)
    ]
    outside = [
        f"{row.parameter} of {row.place}: {other.value:.4g}, {row.low:.4g} to {row.high:.4g} {row.unit} by the even log"
        for row, other in zip(*tables, strict=True)
        if not row.low <= other.value <= row.high
    ]
    return outside, len(tables[0])


def _list_outcomes(machine: Machine, found: Fit, z: Array, name: str, moved: Key | None) -> Iterator[ParameterOutcome]:
    truth = machine.space.compute_values(z)
    table = {(r.parameter, r.place): r for r in list_parameter_rows(machine.space, found)}
    for link, factor in machine.space.factors.items():
        com = convert_to_com(move_mass_properties(factor, np.array([truth[MASS, f"{link}.{n}"] for n in NAMES])))
        truth |= {(q, link): float(v) for q, v in zip(QUANTITIES, com, strict=True)}
    for (kind, place), row in table.items():
        class_ = KINDS[kind].class_ if kind in KINDS else "mass properties"
        ratio = (row.high - row.low) / (row.before_high - row.before_low)
        holds = row.low <= truth[kind, place] <= row.high
        said = abs(row.conflict) > CONFLICT
        off = (kind, place) == moved
        yield ParameterOutcome(name, class_, kind, place, holds, ratio, said, off, row.identifiable)


def count_range(number: int, holds: int) -> tuple[float, float]:
    """Return the ends of the exact 95 % interval [-] of a part of which so many of a number hold (Clopper and Pearson 1934)."""
    low = float(beta.ppf(0.025, holds, number - holds + 1)) if holds else 0.0
    high = float(beta.ppf(0.975, holds + 1, number - holds)) if holds < number else 1.0
    return low, high


def summary(outcomes: list[ParameterOutcome]) -> dict[str, tuple[int, float, float]]:
    """Return number, part that holds [-] and median of interval over prior width [-], by class."""
    classes = dict.fromkeys(one.class_ for one in outcomes)
    some = {c: [one for one in outcomes if one.class_ == c] for c in classes} | {"all": outcomes}
    return {
        c: (len(own), float(np.mean([o.holds for o in own])), float(np.median([o.ratio for o in own])))
        for c, own in some.items()
        if own
    }


@click.command()
@click.option("--count", default=30, show_default=True, help="Random mechanisms, of all classes in turn.")
@click.option("--first", default=0, show_default=True, help="Seed of the first one.")
@click.option(
    "--off", default=0.0, show_default=True, help="Widths of its prior by which one parameter of each truth is off."
)
@click.option(
    "--only", "kinds", multiple=True, type=click.Choice(sorted(set(CLASSES))), help="Mechanisms of this class."
)
@click.option(
    "--jitter", "uneven", is_flag=True, help="Hold logs at uneven times against the same at even ones instead."
)
def main(count: int, first: int, off: float, kinds: tuple[str, ...], uneven: bool) -> None:
    """Identify random mechanisms of known truth, and count how often 90 % intervals hold it."""
    chosen = kinds or CLASSES
    if uneven:
        _write_jitter(chosen, count, first)
        return
    outcomes: list[ParameterOutcome] = []
    covered: list[float] = []
    for k in range(count):
        kind = chosen[k % len(chosen)]
        more, coverage, _ = trial(kind, first + k, off)
        outcomes += more
        covered += coverage
        told = [one for one in more if one.told]
        held = np.mean([one.holds for one in told])
        lost = ", ".join(f"{one.parameter} of {one.place}" for one in told if one.off and not one.holds)
        click.echo(
            f"{kind}{first + k}: {len(told)} told, {held:.1%} held; bands on another motion {np.mean(coverage):.1%}"
            + (f"; what is off is missed: {lost}" if lost else "")
        )
    _write_summary(outcomes, covered)


def _write_jitter(kinds: tuple[str, ...], count: int, first: int) -> None:
    """Print which parameters leave the intervals of the even log, mechanism by mechanism."""
    for k in range(count):
        kind = kinds[k % len(kinds)]
        outside, number = moved_by_jitter(kind, first + k)
        click.echo(f"{kind}{first + k}: {number - len(outside)} of {number} within the intervals of the even log")
        for words in outside:
            click.echo(f"  {words}")


def _write_summary(outcomes: list[ParameterOutcome], covered: list[float]) -> None:
    """Print by class how often intervals hold, of what is off apart; conflicts; what is held by the prior."""
    told = [one for one in outcomes if one.told]
    for class_, (number, part, ratio) in summary(told).items():
        low, high = count_range(number, round(part * number))
        click.echo(
            f"{class_:16s} {number:5d} intervals, {part:.1%} hold ({low:.1%} to {high:.1%}); "
            f"interval over prior width {ratio:.2f} (median)"
        )
    for words, some in (("is off", [o for o in told if o.off]), ("is not", [o for o in told if not o.off])):
        if some:
            held = sum(o.holds for o in some)
            click.echo(
                f"where the truth {words}: {held} of {len(some)} intervals hold, conflicts said "
                f"{np.mean([o.said for o in some]):.1%}"
            )
    off = [o for o in told if o.off]
    for class_, (number, part, _) in summary(off).items():
        click.echo(f"  off, {class_}: {round(part * number)} of {number} hold")
    wide = [o for o in outcomes if o.ratio > WIDE]
    if wide:
        click.echo(
            f"wider than a third of the prior: {len(wide)}, said to be held by it {np.mean([not o.told for o in wide]):.1%}"
        )
    click.echo(f"bands on other motions hold {np.mean(covered):.1%}")


if __name__ == "__main__":
    main()
