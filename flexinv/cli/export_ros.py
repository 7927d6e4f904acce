"""``flexinv export-ros``: torques of a mechanism as a package of ROS 2."""

from __future__ import annotations

from pathlib import Path

import click

from flexinv.cli.export_options import OUT, OVERWRITE_FOLDER, PAYLOADS, PROCESSORS, START, write_made
from flexinv.cli.output import MODEL, parse_start
from flexinv.export.export_ros import LIBRARY_FOLDER, export_ros
from flexinv.files.robot_file import read_robot_file


@click.command("export-ros")
@MODEL
@OUT
@PROCESSORS
@click.option("--step", type=float, help="Links that bend: time of a cycle of the controller [s].")
@START
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
    write_made(made, made.folder / LIBRARY_FOLDER)
