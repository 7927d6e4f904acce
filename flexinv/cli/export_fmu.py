"""``flexinv export-fmu``: dynamics of a mechanism as a Functional Mock-up Unit for Simulink, Modelica tools and others."""

from __future__ import annotations

from pathlib import Path

import click

from flexinv.cli.output import MODEL, UNDEFORMED, parse_start
from flexinv.export.export_fmu import KINDS_OF_FMU, export_fmu
from flexinv.export.fmu.description import FMI_VERSIONS
from flexinv.export.machine_code import NATIVE, TARGETS
from flexinv.files.robot_file import read_robot_file


@click.command("export-fmu")
@MODEL
@click.option("--out", type=click.Path(path_type=Path), required=True, help="File for the FMU: NAME.fmu.")
@click.option(
    "--fmi", default="3.0", show_default=True, type=click.Choice(list(FMI_VERSIONS)), help="Version of the interface."
)
@click.option(
    "--kind",
    default="inverse",
    show_default=True,
    type=click.Choice(list(KINDS_OF_FMU)),
    help="Motion in, torque out; or torque in, motion out.",
)
@click.option(
    "--step", type=float, help="Communication step [s], and no other; rigid, torques out: else the first one."
)
@click.option(
    "--start", metavar="NUMBERS", help="q where it begins at rest [rad], [m]: --start 0.5,-1; loops: near it."
)
@UNDEFORMED
@click.option(
    "--payload", "payloads", multiple=True, metavar="LINK",
    help="LINK carries something that changes: mass, centre and inertia become parameters (may be repeated).",
)  # fmt: skip
@click.option(
    "--target", default=NATIVE, show_default=True, type=click.Choice(list(TARGETS)),
    help="Processor: this machine's, or any of a kind.",
)  # fmt: skip
@click.option("--overwrite", is_flag=True, help="Write over a file that is there.")
def write_fmu(
    model: Path,
    out: Path,
    fmi: str,
    kind: str,
    step: float | None,
    start: str | None,
    undeformed: bool,
    payloads: tuple[str, ...],
    target: str,
    overwrite: bool,
) -> None:
    """Write the dynamics of a MODEL (mechanism file, its folder, or URDF) as an FMU for co-simulation.

    Inputs are the motion at the END of the communication step, outputs the torques of the drives there; of a forward FMU the
    other way round. Gravity, friction and payloads are parameters. A C compiler is needed to link it.

    \b
      flexinv export-fmu models/ur5 --out ur5.fmu
      flexinv export-fmu models/flex_two_link --step 2e-3 --payload link2 --fmi 2.0 --out arm.fmu
      flexinv export-fmu models/flex_two_link --step 2e-3 --kind forward --out plant.fmu
    """
    made = export_fmu(
        read_robot_file(model), out, fmi=fmi, kind=kind, step=step, start=parse_start(start),
        initial="consistent" if undeformed else "static", payloads=payloads, target=target, overwrite=overwrite,
    )  # fmt: skip
    click.echo(f"wrote {made}")
