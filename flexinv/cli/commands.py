"""The command line: ``flexinv solve``, ``info`` and ``modes``.  Every text of --help is meant to be learned from."""

from __future__ import annotations

import sys
import warnings
from functools import partial
from pathlib import Path

import click
import numpy as np
import pandas as pd

from flexinv.analysis import overview
from flexinv.analysis.find_limits import LimitUse, find_limits
from flexinv.analysis.motor_side import motor_side
from flexinv.analysis.solution import Solution
from flexinv.analysis.solve import solve as solve_motion
from flexinv.analysis.views.solution_figures import draw_solution
from flexinv.cli.export_c import write_c_library
from flexinv.cli.output import (
    ACCURACY,
    FILE,
    MODEL,
    OVERWRITE,
    check_outputs,
    parse_by_joint,
    write,
    write_table,
)
from flexinv.cli.simulate import follow_task, simulate_file
from flexinv.cli.torques import write_torque_file
from flexinv.cli.warm import warm
from flexinv.constraints.open_loops import replace_advice
from flexinv.display.figures import check_matplotlib
from flexinv.errors import FlexinvError, InputError, ModelWarning
from flexinv.files.load_cases import Case, load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.files.robot_file import read_robot_file
from flexinv.kernels.compiler.compile_lock import NOTE, add_compile_listener
from flexinv.kinematics.mesh import build
from flexinv.linearized.modal_damping import apply_stated_ratio
from flexinv.linearized.natural_modes import natural_modes
from flexinv.linearized.steady_modes import steady_modes
from flexinv.model.link_mass import compute_link_mass
from flexinv.model.mechanism import Mechanism
from flexinv.planar.detection import NotPlanar, find_plane
from flexinv.rigid.torque_regressor import base_parameters, sample_states, torque_regressor
from flexinv.validation import find_nearest_word

PLOTS = (".png", ".svg", ".pdf")


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(package_name="flexinv")
def app() -> None:
    """Joint torques of rigid, flexible and mixed mechanisms from the motion that their joints shall make.

    A mechanism is a folder such as models/flex_one_link with mechanism.toml (links, joints, sections) and cases.toml
    (motions). Start with:

    \b
      flexinv torques robot.urdf motion.csv --out torques.csv
      flexinv info models/flex_one_link
      flexinv solve models/flex_one_link --case cycloid --plot torque.png
    """


@app.command(short_help="Compute the torques for the motion of a case.")
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
    _check_plot(plot)
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


def _check_plot(plot: Path | None) -> None:
    """Raise InputError for a drawing that could not be made."""
    if plot is None:
        return
    if plot.suffix not in PLOTS:
        raise InputError(f"--plot {plot}: expected a name that ends in {', '.join(PLOTS)}")
    check_matplotlib("--plot")


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
    try:
        found = motor_side(solution)
        columns = ["motor", "peak speed [rad/s]", "peak torque [N m]", "peak current [A]"]
        rows = [(name, *(np.abs(a).max() for a in (m.rate, m.torque, m.current))) for name, m in found.items()]
        write_table(pd.DataFrame(rows, columns=columns), digits=5, missing="-")
    except InputError as reason:
        click.echo(f"motors: {_join_lines(reason)}")


@app.command(short_help="Show what a mechanism file (or a URDF) is.")
@MODEL
def info(model: Path) -> None:
    """Show what a mechanism file (or a URDF) is: coordinates, masses, beams and their meshes, and its cases."""
    mechanism = read_robot_file(model)
    click.echo(mechanism.name + (f": {mechanism.title}" if mechanism.title else ""))
    gravity = ", ".join(f"{g:g}" for g in mechanism.gravity)
    mass = sum(compute_link_mass(link) for link in mechanism.links)
    fixed = f"{sum(not j.nv for j in mechanism.joints)} of {len(mechanism.joints)} joints fixed"
    size = f"nq = {mechanism.nq}, nv = {mechanism.nv}"
    click.echo(f"total mass {mass:.6g} kg, gravity ({gravity}) m/s^2, {size}, {fixed}")
    cases = _read_own_cases(model, mechanism)
    if mechanism.closures:
        click.echo(overview.describe_mobility(mechanism, next(iter(cases.values()), None)))
    for title, table in overview.build_overview_tables(mechanism).items():
        if len(table):
            click.echo(f"\n{title}")
            write_table(table)
    if mechanism.beams:
        mesh = build(apply_stated_ratio(mechanism))
        # with what follows from a damping ratio
        plane = find_plane(mesh)
        mechanism = mesh.mechanism
        where = f"in space: {plane.reason}" if isinstance(plane, NotPlanar) else "in a plane, three freedoms per node"
        click.echo(f"\nbeams are solved {where}")
    for note in mechanism.notes:
        click.echo(f"\nnote: {note}")
    if cases:
        rows = [(c.name, c.motion.duration, c.end, c.step, c.title) for c in cases.values()]
        table = pd.DataFrame(rows, columns=["case", "moves [s]", "ends [s]", "step [s]", "title"])
        click.echo(f"\ncases\n{table.to_string(index=False)}")


@app.command(short_help="Show natural frequencies, at rest or in steady rotation.")
@MODEL
@click.option("--case", "name", help="Take the configuration at the start of this case; all joints at zero without it.")
@click.option("--free", multiple=True, help="A joint that moves freely (may be repeated); all others are held.")
@click.option("--count", type=click.IntRange(min=1), default=6, show_default=True, help="How many modes.")
@click.option("--rate", multiple=True, metavar="JOINT=RAD_PER_S", help="A joint that turns steadily (may be repeated).")
@click.option("--damped", is_flag=True, help="Damping counts: frequencies and damping ratios of the damped motions.")
@click.option("--accuracy", type=float, help="Refine the mesh until error bars are below this part of each frequency.")
def modes(
    model: Path,
    name: str | None,
    free: tuple[str, ...],
    count: int,
    rate: tuple[str, ...],
    damped: bool,
    accuracy: float | None,
) -> None:
    """Show natural frequencies about the rest position: links that bend, joints that are free, loops that swing.

    In a loop the joints without a drive are free, unless --free says which. With --rate the frequencies are those about a
    steady rotation, stress, centrifugal and gyroscopic terms included. At rest each frequency has an error bar, from a finer mesh
    and rounding.
    """
    mechanism = load_mechanism(model)
    at = None
    if name is not None:
        case = choose(load_cases(resolve_model_folder(model), mechanism), name, model)
        mechanism, at = case.meshed(mechanism), overview.resolve_start_configuration(mechanism, case)
    rates = parse_by_joint("--rate", rate, float, "a joint and its rate in rad/s, for example --rate hub=80")
    if rates or damped:
        if accuracy is not None:
            raise InputError("--accuracy is of frequencies at rest; leave out --rate and --damped")
        with replace_advice(partial(_describe_closing_case, model, mechanism, name)):
            steady = steady_modes(mechanism, at, rates, free or None, count)
        columns = zip(range(1, count + 1), steady.frequency, steady.damping_ratio, steady.link, strict=False)
        names = ["mode", "frequency [Hz]", "damping ratio", "moves most"]
        return write_table(pd.DataFrame(columns, columns=names), missing="-")
    with replace_advice(partial(_describe_closing_case, model, mechanism, name)):
        found = natural_modes(mechanism, at, free or None, count, accuracy)
    omega = np.sqrt(np.abs(found.squared))
    bars = [f"{bar:.1e}" for bar in found.frequency_error]
    rows = zip(range(1, count + 1), found.frequency, bars, omega, found.link, strict=False)
    table = pd.DataFrame(rows, columns=["mode", "frequency [Hz]", "error bar [Hz]", "omega [rad/s]", "moves most"])
    if found.friction.any():
        table.insert(4, "damping ratio [-]", found.ratio[: len(table)])
    if {"flutter", "divergence"} & set(found.stability):
        table["stability"] = found.stability
    return write_table(table, missing="unstable")


@app.command(short_help="Show the base parameters of a rigid mechanism.")
@MODEL
@click.option("--drives", is_flag=True, help="With rotor inertia, damping, dry friction and springs of the joints.")
@click.option("--samples", type=click.IntRange(min=1), default=200, show_default=True, help="Random states to look at.")
def parameters(model: Path, drives: bool, samples: int) -> None:
    """Show the base parameters of a rigid mechanism: the combinations of masses that its torques can tell, by QR.

    tau = Y pi, ten parameters for each link about the origin of its frame: m, h = m c, I.
    """
    mechanism = read_robot_file(model)
    full = torque_regressor(mechanism, *sample_states(mechanism, samples), drives=drives)
    base = base_parameters(full)
    count = len(base.columns)
    unseen = len(base.unseen)
    click.echo(f"{mechanism.name}: {count} base parameters of {len(full.names)}, {unseen} without effect")
    for column, value, expression in zip(base.columns, base.values, base.expressions, strict=True):
        click.echo(f"{value:12.6g} {full.units[column]:<10} {expression}")


app.add_command(follow_task)
app.add_command(warm)
app.add_command(simulate_file)
app.add_command(write_torque_file)
app.add_command(write_c_library)


def _read_own_cases(model: Path, mechanism: Mechanism) -> dict[str, Case]:
    """The cases that stand beside a mechanism, none where there is no file of them."""
    folder = resolve_model_folder(model)
    return load_cases(folder, mechanism) if (folder / "cases.toml").is_file() else {}


def _describe_closing_case(model: Path, mechanism: Mechanism, name: str | None) -> str:
    """Advice for loops that do not close in the configuration of the modes."""
    if name is not None:
        return f"write another start of the joints in case '{name}'"
    cases = _read_own_cases(model, mechanism)
    known = ", ".join(cases)
    return (
        f"write --case with one of {known}"
        if known
        else "write a case in cases.toml that starts where they close, and --case"
    )


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


def resolve_model_folder(model: Path) -> Path:
    """Return the folder of a model that is given as a folder or as its mechanism.toml."""
    return model.parent if model.suffix else model


def choose(cases: dict[str, Case], name: str | None, model: Path) -> Case:
    """Return the case of that name, or the only one there is; InputError lists the names."""
    if name is None and len(cases) == 1:
        return next(iter(cases.values()))
    if name is None:
        raise InputError(f"{model} has {len(cases)} cases: write --case with one of {', '.join(cases)}")
    if name not in cases:
        like = find_nearest_word(name, cases)
        advice = f"write --case {like}" if like else f"write one of {', '.join(cases)}"
        raise InputError(f"--case {name}: {model} has no such case; {advice}")
    return cases[name]


def main(arguments: list[str] | None = None) -> None:
    """Run the command line: exit code 0, or 2 with one line that says what was wrong and what to write."""
    with warnings.catch_warnings():
        warnings.simplefilter("always", ModelWarning)
        others = warnings.showwarning
        warnings.showwarning = lambda message, category, *place: (
            click.echo(f"flexinv: warning: {_join_lines(message)}", err=True)
            if issubclass(category, ModelWarning)
            else others(message, category, *place)
        )
        with add_compile_listener(lambda: click.echo(f"flexinv: {NOTE}", err=True)):
            complaint = _run(arguments)
    if complaint:
        click.echo(f"flexinv: {complaint}", err=True)
        sys.exit(2)


def _run(arguments: list[str] | None) -> str:
    """Run, and return what was wrong in one line."""
    try:
        app.main(args=arguments, prog_name="flexinv", standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as help_text:
        click.echo(help_text.format_message())
    except click.ClickException as error:
        return f"{_join_lines(error.format_message())} (flexinv --help)"
    except click.Abort:
        return "interrupted"
    except FlexinvError as error:
        return _join_lines(error)
    except OSError as error:
        return f"{error.filename}: {error.strerror}" if error.filename else _join_lines(error)
    return ""


def _join_lines(message: object) -> str:
    return "; ".join(" ".join(line.split()) for line in str(message).splitlines() if line.strip())
