"""``flexinv torques``: the efforts of a robot's joints for a motion in a CSV file of any length."""

from __future__ import annotations

import sys
from pathlib import Path

import click
import numpy as np

from flexinv.cli.output import FILE, OVERWRITE, parse_by_joint, parse_numbers, write_table
from flexinv.errors import InputError
from flexinv.model.links import Inertia
from flexinv.sampled.torque_run import ROWS, Friction
from flexinv.sampled.write_torques import write_torques
from flexinv.typing import Array

TICKS = 1000  # of the progress bar


@click.command("torques")
@click.argument("robot", type=click.Path(path_type=Path))
@click.argument("motion", type=FILE)
@click.option("--out", type=FILE, required=True, help="CSV file for times and efforts, a column for every joint.")
@OVERWRITE
@click.option(
    "--payload", multiple=True, metavar="LINK=KG[@X,Y,Z]",
    help="A mass on a link, its centre [m] in the link's frame (may be repeated): --payload tool0=2.5@0,0,0.1. "
    "One with inertia: flexinv.torques in Python.",
)  # fmt: skip
@click.option("--gravity", metavar="X,Y,Z", help="Gravity [m/s^2] in place of the robot's own: --gravity 0,0,-1.62.")
@click.option("--no-friction", is_flag=True, help="Without damping and dry friction of the joints.")
@click.option(
    "--friction", multiple=True, metavar="JOINT=DRY,VISCOUS",
    help="Dry friction [N m], [N] and damping [N m s/rad], [N s/m] in place of the file's (may be repeated).",
)  # fmt: skip
@click.option(
    "--hold", multiple=True, metavar="JOINT=NUMBERS", help="A joint that stands still and has no column [rad], [m]."
)
@click.option("--spacing", type=float, help="Time between rows [s] where the motion has no column of times.")
@click.option("--step", type=float, help="Links that bend: time step [s]; the spacing of the rows without it.")
@click.option("--static", is_flag=True, help="Links that bend: begin in equilibrium under gravity; else undeformed.")
@click.option("--rows", type=int, default=ROWS, show_default=True, help="Rows in memory at once.")
def write_torque_file(
    robot: Path, motion: Path, out: Path, overwrite: bool, payload: tuple[str, ...], gravity: str | None, no_friction: bool,
    friction: tuple[str, ...], hold: tuple[str, ...], spacing: float | None, step: float | None, static: bool, rows: int,
) -> None:  # fmt: skip
    """Compute the torque of every joint of a ROBOT for a MOTION, row by row, in a file of any length.

    ROBOT is a URDF, or a mechanism file or its folder; MJCF, SDF and USD where a reader is installed. Links that bend go the
    way of flexinv solve.

    MOTION is a CSV file with a header. It has a column of positions for each joint, and of rates, and of accelerations if you
    have them; what is missing is the derivative of a spline. Columns are found by the names of the joints, in any order:

    \b
      time_s,shoulder_deg,elbow_deg                             rad and m without a unit
      time [s];position elbow [rad];rate elbow [rad/s]          what flexinv writes, too
      t,q1,q2,qd1,qd2,qdd1,qdd2                                 numbers in the joints' order

    Semicolons and decimal commas are read as they are. Rates that are no slopes of the positions are refused, with the factor.

    \b
      flexinv torques models/ur5 motion.csv --out torques.csv --payload ee_link=3@0.05,0,0
    """
    import pandas as pd

    loads = parse_by_joint(
        "--payload", payload, _parse_load, "a link and a mass in kg, for example --payload tool0=2.5"
    )
    other = parse_by_joint("--friction", friction, parse_numbers, "a joint and two numbers: --friction elbow=0.5,0.1")
    still = parse_by_joint("--hold", hold, parse_numbers, "a joint and its numbers, for example --hold finger=0.02")
    if no_friction and other:
        raise InputError("--no-friction beside --friction: write one of the two")
    losses: Friction = other if other else not no_friction
    shown = sys.stderr.isatty()
    with click.progressbar(length=TICKS, label="computing", file=sys.stderr, hidden=not shown) as bar:
        found = write_torques(
            robot, motion, out, payload=loads, gravity=_parse_gravity(gravity), friction=losses, hold=still,
            spacing=spacing, step=step, initial="static" if static else "consistent", rows=rows, overwrite=overwrite,
            progress=lambda done: bar.update(int(TICKS * done) - bar.pos),
        )  # fmt: skip
    click.echo(f"{found.samples} rows, {found.source}")
    others = [f"{name!r} as {coordinate}" for coordinate, name in found.columns.items() if coordinate not in name]
    if others:
        click.echo(f"positions: {', '.join(others)}")
    if found.left_out:
        click.echo(f"left out: {', '.join(found.left_out)}")
    table = pd.DataFrame({"effort": found.labels, "peak": found.peak, "rms": found.rms, "peak over limit": found.used})
    write_table(
        table if np.isfinite(found.used).any() else table.drop(columns="peak over limit"), digits=5, missing="-"
    )
    click.echo(f"wrote {found.file}")


def _parse_load(text: str) -> Inertia:
    mass, _, centre = text.partition("@")
    place = parse_numbers(centre) if centre else [0.0, 0.0, 0.0]
    if len(place) != 3:
        raise ValueError
    return Inertia(float(mass), np.array(place))


def _parse_gravity(text: str | None) -> Array | None:
    if text is None:
        return None
    try:
        return np.array(parse_numbers(text))
    except ValueError:
        raise InputError(f"--gravity {text}: expected three numbers [m/s^2]; write --gravity 0,0,-9.81") from None
