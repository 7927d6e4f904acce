"""``flexinv optimize-motion``: the shortest, quietest or least demanding motion between the ends of a case's."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from flexinv.cli.choose_case import choose, resolve_model_folder
from flexinv.cli.output import FILE, MODEL, OVERWRITE, check_outputs, check_plot, parse_by_joint, write, write_table
from flexinv.errors import InputError
from flexinv.files.load_cases import load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.optimal_motion.linear_step import AIMS
from flexinv.optimal_motion.motion_limits import MotionLimits, StrainLimit
from flexinv.optimal_motion.motion_problem import find_last_move
from flexinv.optimal_motion.optimize_motion import optimize_motion

JOINT_LIMIT = "a name and its limit, for example hub=2.0"
STRAIN_LIMIT = "a beam, its largest strain and two distances [m], for example forearm=2e-3,0.01,0.005"


@click.command("optimize-motion")
@MODEL
@click.option(
    "--case", "name", help="Which motion of cases.toml is to be bettered; may be left out where there is only one."
)
@click.option(
    "--aim", multiple=True, metavar="AIM[=WEIGHT]", default=("duration",), show_default=True,
    help=f"To be small: duration, {', '.join(AIMS)}; repeated with weights, each in parts of the case's.",
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
@click.option(
    "--knots", type=click.IntRange(1), default=10, show_default=True, help="Places of each joint that are chosen."
)
@click.option("--out", type=FILE, help="Write time, joint motion, torques and tips of the motion that was found.")
@click.option(
    "--plot", type=FILE, help="Draw both motions, their torques, and the tip beyond the end (.png, .svg or .pdf)."
)
@OVERWRITE
def write_best_motion(
    model: Path, name: str | None, aim: tuple[str, ...], torque: tuple[str, ...], rate: tuple[str, ...],
    acceleration: tuple[str, ...], jerk: tuple[str, ...], force: tuple[str, ...], moment: tuple[str, ...],
    strain: tuple[str, ...], path: tuple[str, ...], residual: float | None, step: float | None, knots: int,
    out: Path | None, plot: Path | None, overwrite: bool,
) -> None:  # fmt: skip
    """Find a better motion between the ends of a case's: shorter, quieter or with smaller torques, at rest in the end.

    \b
      flexinv optimize-motion models/flex_two_link --case cycloid
      flexinv optimize-motion models/flex_two_link --case cycloid --aim "peak torque"
      flexinv optimize-motion models/flex_two_link --case cycloid --aim duration=1 --aim "rms torque=0.2"

    Every limit holds at all instants, and the beams come to rest with the joints. The table says what the case's motion and the
    one that was found need, at half the step of the search.
    """
    check_plot(plot)
    check_outputs(out, overwrite, [plot])
    mechanism = load_mechanism(model)
    case = choose(load_cases(resolve_model_folder(model), mechanism), name, model)
    given = {
        "rate": rate, "acceleration": acceleration, "jerk": jerk, "torque": torque, "force": force, "moment": moment,
        "path": path,
    }  # fmt: skip
    tables: dict[str, Any] = {
        key: parse_by_joint(f"--{key}", texts, float, JOINT_LIMIT) for key, texts in given.items()
    }
    if not torque:  # the case's own torques
        del tables["torque"]
    strains = parse_by_joint("--strain", strain, _parse_strain, STRAIN_LIMIT)
    limits = MotionLimits(**tables, strain=strains, residual=residual)
    weights = _parse_aims(aim)
    found = optimize_motion(mechanism, case.motion, limits, weights, step, knots, _write_progress, case.start)
    if sys.stderr.isatty():
        click.echo(err=True)
    before = find_last_move(case.motion)
    click.echo(f"{mechanism.name}, {case.name}: {before:.4g} s -> {found.duration:.4g} s; {found.reason}")
    write_table(found.frame(), index=True)
    if out is not None:
        write(found.solutions[0].whole_frame(), out)
    if plot is not None:
        found.plot().savefig(plot)
        click.echo(f"wrote {plot}")


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
