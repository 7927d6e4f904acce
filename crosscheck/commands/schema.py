"""``crosscheck schema``: JSON Schemas of the files, for editors and for programs in any language."""

from __future__ import annotations

from pathlib import Path

import click

from crosscheck.commands.shared.terminal import Failure
from crosscheck.kit.schemas import NAMES, read_schema


@click.command("schema", short_help="Print the JSON Schema of a file format.")
@click.argument("name", type=click.Choice(NAMES), required=False)
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), help="Write all of them into this folder.")
def command(name: str | None, out: Path | None) -> None:
    """Print the JSON Schema of mechanism.toml, cases.toml, or of a file of a case kit or its answer.

    An editor with TOML support then completes keys and shows their units: begin the file with a line such as

    \b
      #:schema ./mechanism.schema.json
    """
    if (name is None) == (out is None):
        raise Failure(f"write one of {', '.join(NAMES)}, or --out with a folder for all of them")
    if name is not None:
        click.echo(read_schema(name), nl=False)
    if out is not None:
        try:
            out.mkdir(parents=True, exist_ok=True)
            for one in NAMES:
                (out / f"{one}.schema.json").write_text(read_schema(one), encoding="utf-8")
        except OSError as error:
            raise Failure(f"{out} cannot be written: {error}; write --out with another folder") from error
        click.echo(f"wrote {', '.join(f'{one}.schema.json' for one in NAMES)} to {out}")
