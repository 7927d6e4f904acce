"""``flexinv export-c``: inverse dynamics of a mechanism as a C library for programs without Python."""

from __future__ import annotations

from pathlib import Path

import click

from flexinv.cli.output import MODEL, OVERWRITE_FOLDER, PAYLOADS, UNDEFORMED, parse_start
from flexinv.export.export_c import export_c
from flexinv.export.machine_code import NATIVE, TARGETS
from flexinv.files.robot_file import read_robot_file


@click.command("export-c")
@MODEL
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True, help="Folder for the library.")
@click.option(
    "--target", "targets", multiple=True, default=(NATIVE,), show_default=True, type=click.Choice(list(TARGETS)),
    help="Processor (may be repeated): this machine's, or any of a kind.",
)  # fmt: skip
@click.option("--step", type=float, help="Links that bend: time between two calls [s].")
@click.option(
    "--start",
    metavar="NUMBERS",
    help="Links that bend: q where they begin at rest [rad], [m]: --start 0.5,-1; loops: near it.",
)
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
    click.echo(f"wrote {made.name}, {len(made.files)} files, into {made.folder}")
    if made.to_link:
        click.echo(f"no C compiler was found for all targets; run in {made.folder}:")
        for line in made.to_link:
            click.echo(f"  {line}")
