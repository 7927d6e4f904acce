"""``flexinv export-c``: inverse dynamics of a mechanism as a C library for programs without Python."""

from __future__ import annotations

from pathlib import Path

import click

from flexinv.cli.export_options import OUT, OVERWRITE_FOLDER, PAYLOADS, PROCESSORS, START, write_made
from flexinv.cli.output import MODEL, UNDEFORMED, parse_start
from flexinv.export.export_c import export_c
from flexinv.files.robot_file import read_robot_file


@click.command("export-c")
@MODEL
@OUT
@PROCESSORS
@click.option("--step", type=float, help="Links that bend: time between two calls [s].")
@START
@UNDEFORMED
@PAYLOADS
@OVERWRITE_FOLDER
def write_c_library(
    model: Path,
    out: Path,
    targets: tuple[str, ...],
    step: float | None,
    start: str | None,
    undeformed: bool,
    payloads: tuple[str, ...],
    overwrite: bool,
) -> None:
    """Write the inverse dynamics of a MODEL (mechanism file, its folder, or URDF) as a C library: no Python, no allocation.

    The folder has header, static and shared library, examples in C and C++, packages for CMake and pkg-config, and a
    self-test that replays efforts which flexinv has computed. The functions work in memory that the caller gives.

    \b
      flexinv export-c models/ur5 --out ur5_c
      flexinv export-c models/flex_one_link --step 5e-4 --out strip_c --target x86-64-v3 --target aarch64
    """
    made = export_c(
        read_robot_file(model), out, targets=targets, overwrite=overwrite, step=step, start=parse_start(start),
        initial="consistent" if undeformed else "static", payloads=payloads,
    )  # fmt: skip
    write_made(made, made.folder)
