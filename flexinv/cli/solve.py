"""``flexinv solve``: torques for the motion of a case, with limits, motors, a table and a drawing."""

from __future__ import annotations

import sys
from pathlib import Path

import click
import numpy as np

from flexinv.analysis.find_limits import LimitUse, find_limits
from flexinv.analysis.motor_side import motor_side
from flexinv.analysis.solution import Solution
from flexinv.analysis.solve import solve as solve_motion
from flexinv.analysis.views.solution_figures import draw_solution
from flexinv.cli.choose_case import choose, resolve_model_folder
from flexinv.cli.output import ACCURACY, FILE, MODEL, OVERWRITE, check_outputs, check_plot, write, write_table
from flexinv.display.words import join_lines
from flexinv.errors import InputError
from flexinv.files.load_cases import Case, load_cases
from flexinv.files.load_mechanism import load_mechanism


@click.command("solve")
@MODEL
@click.option("--case", "name", help="Which motion of cases.toml; may be left out where there is only one.")
@click.option(
    "--out", type=FILE, help="Write time, joint motion, torques, tips, deflections and error bars, units in the header, at the "
    "case's sample_s: .csv, .parquet, .json or .npz.",
)  # fmt: skip
@click.option(
    "--plot",
    type=FILE,
    help="Draw the torques, and the deflections where links bend (.png, .svg or .pdf); their numbers go into FILE.csv.",
)
@OVERWRITE
@click.option(
    "--step", type=float,
    help="Time step [s] in place of the case's. The error falls with its square; --error says how large it is.",
)  # fmt: skip
@ACCURACY
@click.option(
    "--error", is_flag=True, help="Solve again on a finer mesh and step, and give error bars. Four times the steps."
)
def solve(
    model: Path, name: str | None, out: Path | None, plot: Path | None, overwrite: bool, step: float | None,
    accuracy: float | None, error: bool,
) -> None:  # fmt: skip
    """Compute the torque that every actuator must give so that the joints make the motion of a case.

    Rigid links follow exact kinematics; flexible links deform freely while the joints are driven as prescribed. The
    table shows each joint's peak and RMS torque, speed and power, and how much of its stated limits that takes, at the samples.
    Below it stands each limit that is reached or passed, and when: between samples, too, where the motion says what is there.
    """
    check_plot(plot)
    check_outputs(out, overwrite, _list_plot_files(plot))
    mechanism = load_mechanism(model)
    case = choose(load_cases(resolve_model_folder(model), mechanism), name, model)
    size, asked = _resolve_step(case, step, accuracy)
    written = compute_sample_stride(case.sample, case.step, size) if out is not None and size and size > 0.0 else 1
    # with error bars: once more at half the step, once more on a finer mesh
    samples = round(case.end / size) * (4 if error else 1) if size else 0
    shown = size is not None and not mechanism.is_rigid and sys.stderr.isatty()
    with click.progressbar(length=samples, label="marching", file=sys.stderr, hidden=not shown) as bar:
        solution = solve_motion(
            case.meshed(mechanism), case.motion, size, error=error, end=case.end, spectral_radius=case.spectral_radius,
            initial=case.initial, start=case.start, progress=bar.update, accuracy=asked,
        )  # fmt: skip
    click.echo(f"{mechanism.name}, case {case.name}: {case.title}" if case.title else f"{mechanism.name}, {case.name}")
    _write_summary(solution)
    _write_limits(find_limits(solution, case.motion))
    if any(joint.drive for joint in mechanism.joints):
        _write_motors(solution)
    if out is not None:
        write(solution.whole_frame().iloc[::written], out)
    if plot is not None:
        draw_solution(solution, f"{mechanism.name}, {case.name}").savefig(plot, dpi=150)
        click.echo(f"drew {plot}")
        write(solution.whole_frame(), _list_plot_files(plot)[1])


def _list_plot_files(plot: Path | None) -> list[Path]:
    """The picture, and the file of its numbers beside it."""
    return [] if plot is None else [plot, plot.with_name(f"{plot.name}.csv")]


def _resolve_step(case: Case, step: float | None, accuracy: float | None) -> tuple[float | None, float | None]:
    """The step [s] or the accuracy to solve with: those that are given, else the case's."""
    if step is None and accuracy is None:
        accuracy = case.accuracy
    return (case.step if step is None and accuracy is None else step), accuracy


def _write_summary(solution: Solution) -> None:
    """Print peak values of every joint, with error bars where there are some."""
    table = solution.summary()
    if solution.torque_error is not None:
        table.loc[list(solution.torque_names), "error of effort"] = solution.torque_error.max(axis=0)
    write_table(table, digits=5, index=True, missing="-")


def _write_limits(uses: tuple[LimitUse, ...]) -> None:
    """Print the limits that are reached, and how many were looked at."""
    for one in uses:
        if one.reached is not None:
            click.echo(f"limit: {one}")
    if uses:
        click.echo(f"{len(uses)} limits looked at, {sum(one.passed for one in uses)} passed")


def _write_motors(solution: Solution) -> None:
    """Print peak values of every motor, or why its motion does not follow."""
    import pandas as pd

    try:
        found = motor_side(solution)
        columns = ["motor", "peak speed [rad/s]", "peak torque [N m]", "peak current [A]"]
        rows = [(name, *(np.abs(a).max() for a in (m.rate, m.torque, m.current))) for name, m in found.items()]
        write_table(pd.DataFrame(rows, columns=columns), digits=5, missing="-")
    except InputError as reason:
        click.echo(f"motors: {join_lines(reason)}")


def compute_sample_stride(sample: float, step: float, size: float) -> int:
    """Return of how many steps [-] of ``size`` [s] one is written: a case's ``sample`` [s], where it is not its ``step`` [s].

    Raises InputError where steps of that size do not come to the samples.
    """
    if sample == step:
        return 1
    count = max(round(sample / size), 1)
    if abs(count * size - sample) > 1e-9 * sample:  # what decimals of a step leave
        no_multiple = f"sample_s = {sample:g} s of the case is no multiple of it"
        raise InputError(f"--step {size:g}: {no_multiple}; write {sample / count:g}")
    return count
