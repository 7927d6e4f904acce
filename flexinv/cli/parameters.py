"""The command `flexinv parameters`: the inertial parameters of a rigid mechanism that torques determine."""

from __future__ import annotations

from pathlib import Path

import click

from flexinv.files.from_urdf import from_urdf
from flexinv.files.load_mechanism import load_mechanism
from flexinv.rigid.torque_regressor import base_parameters, random_states, torque_regressor


@click.command(short_help="Show the base parameters of a rigid mechanism.")
@click.argument("model", type=click.Path(path_type=Path))
@click.option("--drives", is_flag=True, help="With rotor inertia, damping, dry friction and springs of the joints.")
@click.option("--samples", type=click.IntRange(min=1), default=200, show_default=True, help="Random states to look at.")
def parameters(model: Path, drives: bool, samples: int) -> None:
    """Show the base parameters of a rigid mechanism: the combinations of masses that its torques can tell, by QR.

    tau = Y pi, ten parameters for each link about the origin of its frame: m, h = m c, I.
    """
    mechanism = from_urdf(model) if model.suffix in (".urdf", ".xml") else load_mechanism(model)
    full = torque_regressor(mechanism, *random_states(mechanism, samples), drives=drives)
    base = base_parameters(full)
    click.echo(
        f"{mechanism.name}: {len(base.columns)} base parameters of {len(full.names)}, {len(base.unseen)} without effect"
    )
    for column, value, expression in zip(base.columns, base.values, base.expressions, strict=True):
        click.echo(f"{value:12.6g} {full.units[column]:<10} {expression}")
