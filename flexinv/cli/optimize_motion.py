"""``flexinv optimize-motion``: the shortest, quietest or least demanding motion between the ends of a case's."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from flexinv.cli.choose_case import choose, resolve_model_folder
from flexinv.cli.output import FILE, MODEL, OVERWRITE, check_outputs, check_plot, parse_by_joint, write, write_table
from flexinv.errors import InputError
from flexinv.files.load_cases import load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Mechanism
from flexinv.optimal_motion.linear_step import AIMS
from flexinv.optimal_motion.motion_limits import LIMITED_BY_JOINT, MotionLimits, StrainLimit
from flexinv.optimal_motion.motion_problem import find_last_move
from flexinv.optimal_motion.optimize_motion import USUAL_KNOTS, optimize_motion
from flexinv.optimal_motion.optimum_file import OptimumTask, read_optima, write_rows

JOINT_LIMIT = "a name and its limit, for example hub=2.0"
STRAIN_LIMIT = "a beam, its largest strain and two distances [m], for example forearm=2e-3,0.01,0.005"


@click.command("optimize-motion")
@MODEL
@click.option(
    "--case", "name", help="Which motion of cases.toml is to be bettered; may be left out where there is only one."
)
@click.option("--optimum", help="A table [optima.NAME] of cases.toml, in place of all options that state the problem.")
@click.option(
    "--aim", multiple=True, metavar="AIM[=WEIGHT]",
    help=f"To be small: duration (by default), {', '.join(AIMS)}; repeated with weights, in parts of the case's.",
)  # fmt: skip
@click.option(
    "--torque", multiple=True, metavar="JOINT=LIMIT", help="Largest torque [N m], [N]; by default the case's own."
)
@click.option("--rate", multiple=True, metavar="JOINT=LIMIT", help="Largest rate [rad/s], [m/s].")
@click.option("--acceleration", multiple=True, metavar="JOINT=LIMIT", help="Largest acceleration [rad/s^2], [m/s^2].")
@click.option("--jerk", multiple=True, metavar="JOINT=LIMIT", help="Largest jerk [rad/s^3], [m/s^3].")
@click.option("--force", multiple=True, metavar="JOINT=LIMIT", help="Largest force that a joint carries [N].")
@click.option("--moment", multiple=True, metavar="JOINT=LIMIT", help="Largest moment that a joint carries [N m].")
@click.option(
    "--strain", multiple=True, metavar="BEAM=LIMIT,Y,Z",
    help="Largest strain [-] of fibres at distances Y, Z [m] from the axis of a beam.",
)  # fmt: skip
@click.option(
    "--path", multiple=True, metavar="LINK=LIMIT", help="Largest distance of a tip from its path in the case [m]."
)
@click.option("--residual", type=float, help="Largest distance of a tip from its rest place after the end [m]; by default a "
              "hundredth of what the case leaves.")  # fmt: skip
@click.option("--step", type=float, help="Time step of the search [s]; by default a two hundredth of the motion.")
@click.option("--knots", type=click.IntRange(1), help="Places of each joint that are chosen, 10 by default.")
@click.option(
    "--rows", type=FILE, help="Write the rows of the motion that was found (.csv), as a sampled case reads them."
)
@click.option("--out", type=FILE, help="Write time, joint motion, torques and tips of the motion that was found.")
@click.option(
    "--plot", type=FILE, help="Draw both motions, their torques, and the tip beyond the end (.png, .svg or .pdf)."
)
@OVERWRITE
def write_best_motion(
    model: Path, optimum: str | None, out: Path | None, rows: Path | None, plot: Path | None, overwrite: bool,
    **problem: Any,
) -> None:  # fmt: skip
    """Find a better motion between the ends of a case's: shorter, quieter or with smaller torques, at rest in the end.

    \b
      flexinv optimize-motion models/flex_two_link --case cycloid
      flexinv optimize-motion models/flex_two_link --case cycloid --aim "peak torque"
      flexinv optimize-motion models/flex_two_link --case cycloid --aim duration=1 --aim "rms torque=0.2"
      flexinv optimize-motion models/flex_two_link --optimum shortest --rows shortest.csv

    Every limit holds at all instants, and the beams come to rest with the joints. The table says what the case's motion and the
    one that was found need, at half the step of the search.
    """
    check_plot(plot)
    check_outputs(out, overwrite, [rows, plot])
    mechanism = load_mechanism(model)
    task = _build_problem(model, mechanism, problem) if optimum is None else _read_problem(model, optimum, problem)
    case = task.case
    meshed = case.meshed(mechanism)
    found = optimize_motion(
        meshed, case.motion, task.limits, task.aim, task.step, task.knots, _write_progress, case.start
    )
    if sys.stderr.isatty():
        click.echo(err=True)
    before = find_last_move(case.motion)
    click.echo(f"{mechanism.name}, {case.name}: {before:.4g} s -> {found.duration:.4g} s; {found.reason}")
    write_table(found.frame(), index=True)
    if out is not None:
        write(found.solutions[0].whole_frame(), out)
    if rows is not None:
        write_rows(found.motion, mechanism, rows)
        click.echo(f"wrote {rows}")
    if plot is not None:
        found.plot().savefig(plot)
        click.echo(f"wrote {plot}")


def _build_problem(model: Path, mechanism: Mechanism, given: Mapping[str, Any]) -> OptimumTask:
    """The motion to be chosen that options state."""
    case = choose(load_cases(resolve_model_folder(model), mechanism), given["name"], model)
    tables: dict[str, Any] = {
        key: parse_by_joint(f"--{key}", given[key], float, JOINT_LIMIT) for key in (*LIMITED_BY_JOINT, "path")
    }
    if not given["torque"]:  # the case's own torques
        del tables["torque"]
    strains = parse_by_joint("--strain", given["strain"], _parse_strain, STRAIN_LIMIT)
    limits = MotionLimits(**tables, strain=strains, residual=given["residual"])
    weights = _parse_aims(given["aim"] or ("duration",))
    return OptimumTask("", "", case, weights, given["knots"] or USUAL_KNOTS, given["step"], limits)


def _read_problem(model: Path, name: str, given: Mapping[str, Any]) -> OptimumTask:
    """The motion to be chosen of that name in cases.toml; InputError for a name that is none, and options beside it."""
    for key, value in given.items():
        if value not in (None, ()):
            option = "--case" if key == "name" else f"--{key}"
            raise InputError(f"--optimum {name}: its table states the problem; leave out {option}")
    optima = read_optima(resolve_model_folder(model), load_mechanism(model))
    if name not in optima:
        known = ", ".join(optima) or "none: write a table [optima.NAME] in its cases.toml"
        raise InputError(f"--optimum {name}: {model} has {known}")
    return optima[name]


def _write_progress(duration: float, use: float) -> None:
    """Write what was found last over the line before, where somebody looks."""
    if sys.stderr.isatty():
        click.echo(f"\r{duration:.4g} s: limits are used to {use:.1%}   ", nl=False, err=True)


def _parse_strain(text: str) -> StrainLimit:
    """The limit of three numbers; ValueError for what is none."""
    largest, y, z = (float(part) for part in text.split(","))
    return StrainLimit(largest, y, z)


def _parse_aims(texts: tuple[str, ...]) -> dict[str, float]:
    """Weights by aims."""
    weights = {}
    for text in texts:
        name, _, weight = text.partition("=")
        try:
            weights[name] = float(weight) if weight else 1.0
        except ValueError:
            raise InputError(
                f"--aim {text}: expected an aim, or an aim and its weight, for example duration=1"
            ) from None
    return weights
