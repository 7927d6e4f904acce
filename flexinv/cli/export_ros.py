"""``flexinv export-ros``: torques of a mechanism as a package of ROS 2."""

from __future__ import annotations

from pathlib import Path

import click

from flexinv.cli.output import MODEL, OVERWRITE_FOLDER, PAYLOADS, parse_start
from flexinv.export.export_ros import LIBRARY_FOLDER, export_ros
from flexinv.export.machine_code import NATIVE, TARGETS
from flexinv.files.robot_file import read_robot_file


@click.command("export-ros")
@MODEL
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True, help="Folder for the package.")
@click.option(
    "--target", "targets", multiple=True, default=(NATIVE,), show_default=True, type=click.Choice(list(TARGETS)),
    help="Processor (may be repeated); the package links the first.",
)  # fmt: skip
@click.option("--step", type=float, help="Links that bend: time of a cycle of the controller [s].")
@click.option(
    "--start", metavar="NUMBERS", help="Links that bend: q where they begin at rest [rad], [m]: --start 0.5,-1."
)
@PAYLOADS
@OVERWRITE_FOLDER
def write_ros_package(
    model: Path, out: Path, targets: tuple[str, ...], step: float | None, start: str | None, payloads: tuple[str, ...],
    overwrite: bool,
) -> None:  # fmt: skip
    """Write the torques of a MODEL (mechanism file, its folder, or URDF) as a package of ROS 2.

    A rigid tree gets a plugin of inverse_dynamics_solver; every arm gets feed-forward torques once a cycle, and an example of a
    controller for ros2_control that uses them.

    \b
      flexinv export-ros models/ur5 --out ur5_ros
      flexinv export-ros models/flex_two_link --step 2e-3 --out arm_ros
    """
    made = export_ros(
        read_robot_file(model),
        out,
        targets=targets,
        overwrite=overwrite,
        step=step,
        start=parse_start(start),
        payloads=payloads,
    )
    click.echo(f"wrote {made.name}, {len(made.files)} files, into {made.folder}")
    if made.to_link:
        click.echo(f"no C compiler was found for all targets; run in {made.folder / LIBRARY_FOLDER}:")
        for line in made.to_link:
            click.echo(f"  {line}")
