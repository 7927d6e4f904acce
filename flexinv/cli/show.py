"""``flexinv info``, ``modes`` and ``parameters``: a mechanism, its frequencies and its base parameters, as tables."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import click
import numpy as np

from flexinv.analysis import overview
from flexinv.cli.choose_case import choose, read_own_cases, resolve_model_folder
from flexinv.cli.output import MODEL, parse_by_joint, write_table
from flexinv.constraints.open_loops import replace_advice
from flexinv.errors import InputError
from flexinv.files.load_cases import load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.files.robot_file import read_robot_file
from flexinv.kinematics.mesh import build
from flexinv.linearized.modal_damping import apply_stated_ratio
from flexinv.linearized.natural_modes import natural_modes
from flexinv.linearized.steady_modes import steady_modes
from flexinv.model.mechanism import Mechanism
from flexinv.planar.detection import NotPlanar, find_plane
from flexinv.rigid.torque_regressor import base_parameters, sample_states, torque_regressor


@click.command("info")
@MODEL
def info(model: Path) -> None:
    """Show what a mechanism file (or a URDF) is: coordinates, masses, beams and their meshes, and its cases."""
    import pandas as pd

    mechanism = read_robot_file(model)
    click.echo(mechanism.name + (f": {mechanism.title}" if mechanism.title else ""))
    gravity = ", ".join(f"{g:g}" for g in mechanism.gravity)
    mass = sum(overview.compute_whole_mass(link) for link in mechanism.links)
    fixed = f"{sum(not j.nv for j in mechanism.joints)} of {len(mechanism.joints)} joints fixed"
    size = f"nq = {mechanism.nq}, nv = {mechanism.nv}"
    click.echo(f"total mass {mass:.6g} kg, gravity ({gravity}) m/s^2, {size}, {fixed}")
    cases = read_own_cases(model, mechanism)
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


@click.command("modes")
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
    import pandas as pd

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


@click.command("parameters")
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


def _describe_closing_case(model: Path, mechanism: Mechanism, name: str | None) -> str:
    """Advice for loops that do not close in the configuration of the modes."""
    if name is not None:
        return f"write another start of the joints in case '{name}'"
    cases = read_own_cases(model, mechanism)
    known = ", ".join(cases)
    return (
        f"write --case with one of {known}"
        if known
        else "write a case in cases.toml that starts where they close, and --case"
    )
