"""``flexinv simulate``: torques over time, as ``flexinv solve --out`` writes them, become a motion."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click
import numpy as np
import pandas as pd

from flexinv.analysis.simulate import simulate
from flexinv.analysis.solution import effort_labels
from flexinv.cli.follow import ACCURACY, OVERWRITE, check_outputs
from flexinv.cli.output import check_out, write
from flexinv.errors import InputError
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

TIME = "time [s]"


@click.command("simulate", short_help="Compute the motion that torques give.")
@click.argument("model", type=click.Path(path_type=Path))
@click.option(
    "--torque",
    type=click.Path(path_type=Path, dir_okay=False),
    help="CSV file with the column 'time [s]' and one for every drive, such as 'torque hub [N m]' or 'force slide [N]': what "
    "flexinv solve --out writes. Between its rows torques are linear.",
)
@click.option("--duration", type=float, help="How long it moves [s] where no joint has a drive.")
@click.option("--step", type=float, help="Time step [s].")
@ACCURACY
@click.option(
    "--start", multiple=True, metavar="JOINT=NUMBERS", help="Where a joint starts [rad], [m] (may be repeated)."
)
@click.option("--rate", multiple=True, metavar="JOINT=NUMBERS", help="How fast a joint starts [rad/s], [m/s].")
@click.option("--static", is_flag=True, help="Start in equilibrium, the joints with a drive held; else undeformed.")
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), help="Write joint motion and tips over time.")
@OVERWRITE
def simulate_file(
    model: Path,
    torque: Path | None,
    duration: float | None,
    step: float | None,
    accuracy: float | None,
    start: tuple[str, ...],
    rate: tuple[str, ...],
    static: bool,
    out: Path | None,
    overwrite: bool,
) -> None:
    """Compute how a mechanism moves when its drives give the torques of a file, all joints free.

    The table shows where every joint ends, its largest speed, and how much energy the steps lose or make.
    """
    check_outputs((out,), overwrite)
    check_out(out)
    mechanism = load_mechanism(model)
    time, efforts = _efforts(mechanism, torque, duration)
    solution = simulate(
        mechanism,
        time,
        efforts,
        step,
        initial="static" if static else "consistent",
        start=_values("--start", start),
        start_rate=_values("--rate", rate),
        accuracy=accuracy,
    )
    frame = solution.frame()
    places = [name for name in frame if name.startswith("position")]
    rates = [name for name in frame if name.startswith("rate")]
    click.echo(f"{mechanism.name}, {len(time)} rows of torques, {time[-1] - time[0]:g} s")
    click.echo(frame.iloc[-1][places].to_string(float_format=lambda x: f"{x:.6g}"))
    click.echo(frame[rates].abs().max().to_string(float_format=lambda x: f"{x:.6g}"))
    click.echo(f"energy lost or made by the steps: {solution.energy_error:.3g} J of {solution.energy_exchanged:.3g} J")
    if out is not None:
        write(solution.whole_frame(), out)
        click.echo(f"wrote {out}")


def _efforts(mechanism: Mechanism, file: Path | None, duration: float | None) -> tuple[Array, Array | None]:
    """Times [s] and efforts (samples, drives) [N m], [N] of a file, or no efforts over a time."""
    drives = [label for label, driven in zip(effort_labels(mechanism), mechanism.actuated, strict=True) if driven]
    if file is None and not drives and duration is not None:
        return np.array([0.0, duration]), None
    if file is None or not drives:
        wanted = (
            f"a file with the columns {', '.join((TIME, *drives))}" if drives else "--duration, as no joint has a drive"
        )
        raise InputError(
            f"simulate: '{mechanism.name}' needs {wanted}; write --{'torque FILE' if drives else 'duration 2.0'}"
        )
    if not file.is_file():
        raise InputError(f"--torque {file}: no such file; write what flexinv solve --out FILE has written")
    table = pd.read_csv(file)
    for name in (TIME, *drives):
        if name not in table:
            raise InputError(f"--torque {file}: no column '{name}'; its columns: {', '.join(table)}")
    return table[TIME].to_numpy(float), table[drives].to_numpy(float)


def _values(option: str, texts: Sequence[str]) -> dict[str, list[float]]:
    """Joint -> numbers of what stands behind --start and --rate."""
    out = {}
    for text in texts:
        joint, _, numbers = text.partition("=")
        try:
            out[joint] = [float(one) for one in numbers.split(",")]
        except ValueError:
            raise InputError(
                f"{option} {text}: expected a joint and its numbers, for example {option} hub=0.5"
            ) from None
    return out
