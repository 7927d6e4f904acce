"""``flexinv follow``: the path of a frame becomes torques."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np
import pandas as pd

from flexinv.analysis.solution import effort_units
from flexinv.cli.output import check_out, write
from flexinv.errors import InputError
from flexinv.files.load_mechanism import load_mechanism

if TYPE_CHECKING:
    from flexinv.tracking.task_file import Task

OVERWRITE = click.option("--overwrite", is_flag=True, help="Replace files that are there already.")

ACCURACY = click.option(
    "--accuracy",
    type=float,
    help="Largest error of every torque and tip in parts of its range, for example 1e-4, in place of a step: steps and mesh are "
    "chosen for it, and error bars say what was reached.",
)


def check_outputs(paths: Iterable[Path | None], overwrite: bool) -> None:
    """Raise InputError where a file cannot be written: its folder is not there, or it is, and nobody said --overwrite."""
    for path in paths:
        if path is not None and not path.resolve().parent.is_dir():
            raise InputError(f"{path}: the folder {path.resolve().parent} does not exist; make it first")
        if path is not None and path.is_file() and not overwrite:
            raise InputError(f"{path} is there already: write another name, or --overwrite to replace it")


@click.command("follow", short_help="Compute the torques with which a tip follows a path.")
@click.argument("model", type=click.Path(path_type=Path))
@click.option("--task", "name", help="Which task of cases.toml; may be left out where there is only one.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write time, joint motion, torques, tips and deflections of stable inversion, units in the header: .csv, .parquet, "
    ".json or .npz.",
)
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
    from flexinv.tracking.follow import follow  # with it comes SciPy's interpolation, which no other command needs
    from flexinv.tracking.task_file import load_tasks

    check_outputs((out,), overwrite)
    check_out(out)
    mechanism = load_mechanism(model)
    task = _chosen(load_tasks(model, mechanism), name, model)
    size = task.step if step is None and accuracy is None else step
    subject = task.meshed(mechanism), task.path, task.frame
    found = follow(*subject, size, task.before, task.after, task.start, accuracy=accuracy)
    click.echo(f"{mechanism.name}, task {task.name}: {task.title}" if task.title else f"{mechanism.name}, {task.name}")
    click.echo(
        f"{found.path.text} of {found.path.length:.4g} m in {found.path.duration:g} s, from {found.time[0]:.4g} s on"
    )
    rows, units = {}, dict(zip(mechanism.velocity_names, effort_units(mechanism), strict=True))
    for way, solution in found.feed_forwards.items():
        off = found.distance(found.replay(way))
        peaks = zip(solution.torque_names, np.abs(solution.torque).max(axis=0), strict=True)
        rows[way] = {"tip off by [m]": off.max(), "over the length [-]": off.max() / found.path.length} | {
            f"peak {joint} [{units[joint]}]": peak for joint, peak in peaks
        }
    click.echo(pd.DataFrame(rows).T.to_string(float_format=lambda x: f"{x:.4g}"))
    if out is not None:
        write(found.solution.whole_frame(), out)
        click.echo(f"wrote {out}")


def _chosen(tasks: dict[str, Task], name: str | None, model: Path) -> Task:
    if name is None and len(tasks) == 1:
        return next(iter(tasks.values()))
    if name is None or name not in tasks:
        known = ", ".join(tasks) or "none: write a table [tasks.NAME] in its cases.toml"
        raise InputError(f"{model}: {'give --task' if name is None else f'no task {name!r}'}; tasks there: {known}")
    return tasks[name]
