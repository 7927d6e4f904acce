"""``flexinv simulate`` and ``flexinv follow``: torques over time become a motion, and the path of a frame becomes torques."""

from __future__ import annotations

from itertools import compress
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from flexinv.analysis.simulate import simulate
from flexinv.analysis.solution import list_effort_labels, list_effort_units
from flexinv.cli.output import (
    ACCURACY,
    FILE,
    MODEL,
    OVERWRITE,
    check_outputs,
    parse_by_joint,
    parse_numbers,
    write,
    write_table,
)
from flexinv.errors import InputError
from flexinv.files.csv_dialect import make_exact_options
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

if TYPE_CHECKING:
    from flexinv.tracking.task_file import PathTask

TIME = "time [s]"


@click.command("simulate")
@MODEL
@click.option(
    "--torque", type=FILE, help="CSV file with the column 'time [s]' and one for every drive, such as 'torque hub [N m]' or "
    "'force slide [N]': what flexinv solve --out writes. Between its rows torques are linear.",
)  # fmt: skip
@click.option("--duration", type=float, help="How long it moves [s] where no joint has a drive.")
@click.option("--step", type=float, help="Time step [s].")
@ACCURACY
@click.option(
    "--start", multiple=True, metavar="JOINT=NUMBERS", help="Where a joint starts [rad], [m] (may be repeated)."
)
@click.option("--rate", multiple=True, metavar="JOINT=NUMBERS", help="How fast a joint starts [rad/s], [m/s].")
@click.option("--static", is_flag=True, help="Start in equilibrium, the joints with a drive held; else undeformed.")
@click.option("--out", type=FILE, help="Write joint motion and tips over time.")
@OVERWRITE
def simulate_file(
    model: Path, torque: Path | None, duration: float | None, step: float | None, accuracy: float | None,
    start: tuple[str, ...], rate: tuple[str, ...], static: bool, out: Path | None, overwrite: bool,
) -> None:  # fmt: skip
    """Compute how a mechanism moves when its drives give the torques of a file, all joints free.

    The table shows where every joint ends, its largest speed, and how much energy the steps lose or make.
    """
    check_outputs(out, overwrite)
    mechanism = load_mechanism(model)
    time, efforts = _read_efforts(mechanism, torque, duration)
    initial = "static" if static else "consistent"
    at = parse_by_joint("--start", start, parse_numbers, "a joint and its numbers, for example --start hub=0.5")
    moving = parse_by_joint("--rate", rate, parse_numbers, "a joint and its numbers, for example --rate hub=0.5")
    solution = simulate(mechanism, time, efforts, step, initial=initial, start=at, start_rate=moving, accuracy=accuracy)
    frame = solution.frame()
    click.echo(f"{mechanism.name}, {len(time)} rows of torques, {time[-1] - time[0]:g} s")
    write_table(frame.iloc[-1][[name for name in frame if name.startswith("position")]])
    write_table(frame[[name for name in frame if name.startswith("rate")]].abs().max())
    click.echo(f"energy lost or made by the steps: {solution.energy_error:.3g} J of {solution.energy_exchanged:.3g} J")
    if out is not None:
        write(solution.whole_frame(), out)


def _read_efforts(mechanism: Mechanism, file: Path | None, duration: float | None) -> tuple[Array, Array | None]:
    """Times [s] and efforts (samples, drives) [N m], [N] of a file, or no efforts over a time."""
    import pandas as pd

    drives = list(compress(list_effort_labels(mechanism), mechanism.actuated))
    if file is None and not drives and duration is not None:
        return np.array([0.0, duration]), None
    if file is None or not drives:
        wanted = "--duration, as no joint has a drive; write --duration 2.0"
        if drives:
            wanted = f"a file with the columns {', '.join((TIME, *drives))}; write --torque FILE"
        raise InputError(f"simulate: '{mechanism.name}' needs {wanted}")
    if not file.is_file():
        raise InputError(f"--torque {file}: no such file; write what flexinv solve --out FILE has written")
    table = pd.read_csv(file, **make_exact_options())
    for name in (TIME, *drives):
        if name not in table:
            raise InputError(f"--torque {file}: no column '{name}'; its columns: {', '.join(table)}")
    return table[TIME].to_numpy(float), table[drives].to_numpy(float)


def _choose_task(tasks: dict[str, PathTask], name: str | None, model: Path) -> PathTask:
    """The task of that name, or the only one there is."""
    if name is None and len(tasks) == 1:
        return next(iter(tasks.values()))
    if name is not None and name in tasks:
        return tasks[name]
    known = ", ".join(tasks) or "none: write a table [tasks.NAME] in its cases.toml"
    raise InputError(f"{model}: {'give --task' if name is None else f'no task {name!r}'}; tasks there: {known}")


@click.command("follow")
@MODEL
@click.option("--task", "name", help="Which task of cases.toml; may be left out where there is only one.")
@click.option(
    "--out", type=FILE, help="Write time, joint motion, torques, tips and deflections of stable inversion, units in the header: "
    ".csv, .parquet, .json or .npz.",
)  # fmt: skip
@OVERWRITE
@click.option("--step", type=float, help="Spacing of the instants [s] in place of the task's.")
@ACCURACY
def follow_task(
    model: Path, name: str | None, out: Path | None, overwrite: bool, step: float | None, accuracy: float | None
) -> None:
    """Compute the torques with which the tip of a mechanism follows a path, although its links bend.

    The table shows how far the tip of the flexible mechanism is from the path with torques of the rigid mechanism, with
    joints that move as the rigid mechanism's, and with stable inversion, whose joints move before the path begins.
    """
    import pandas as pd

    from flexinv.tracking.follow import follow  # with it comes SciPy's interpolation, which no other command needs
    from flexinv.tracking.task_file import load_tasks

    check_outputs(out, overwrite)
    mechanism = load_mechanism(model)
    tasks = load_tasks(model, mechanism)
    task = _choose_task(tasks, name, model)
    size = task.step if step is None and accuracy is None else step
    subject = task.meshed(mechanism), task.path, task.frame
    following = follow(*subject, size, task.before, task.after, task.start, accuracy=accuracy)
    click.echo(f"{mechanism.name}, task {task.name}: {task.title}" if task.title else f"{mechanism.name}, {task.name}")
    way = following.path
    click.echo(f"{way.text} of {way.length:.4g} m in {way.duration:g} s, from {following.time[0]:.4g} s on")
    rows = {}
    units = dict(zip(mechanism.velocity_names, list_effort_units(mechanism), strict=True))
    for kind, solution in following.feed_forwards.items():
        off = following.distance(following.replay(kind))
        peaks = zip(solution.torque_names, np.abs(solution.torque).max(axis=0), strict=True)
        rows[kind] = {"tip off by [m]": off.max(), "over the length [-]": off.max() / way.length}
        rows[kind] |= {f"peak {joint} [{units[joint]}]": peak for joint, peak in peaks}
    write_table(pd.DataFrame(rows).T, digits=4, index=True)
    if out is not None:
        write(following.solution.whole_frame(), out)
