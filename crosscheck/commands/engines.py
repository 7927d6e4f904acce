"""``crosscheck engines``: the engines, and the versions that are installed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
from rich.markup import escape
from rich.table import Table

from crosscheck.commands.shared.options import CONFIG, NAMED, collect_engines
from crosscheck.commands.shared.terminal import Console
from crosscheck.engines import describe_missing_package
from crosscheck.engines.job_files import DescribeRequest
from crosscheck.report.words import join_alike_engines
from crosscheck.run.abilities import LIMIT as DESCRIBE
from crosscheck.run.forking import KEPT_SERVERS
from crosscheck.run.isolation import ChildProcesses, ask
from crosscheck.verdicts.results import EngineRow


@click.command("engines", short_help="Show which engines are installed, and what each can do.")
@click.option(
    "--models",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("models"),
    show_default=True,
    help="Folder of mechanisms: with the engines of crosscheck.toml above it, and of records in it.",
)
@CONFIG
@NAMED
def command(models: Path, config: Path | None, engine: tuple[str, ...]) -> None:
    """Show which engines are installed, their versions and what each can do; no program of crosscheck.toml is run."""
    table = Table("engine", "version", "what it can do", box=None, header_style="dim")
    known: dict[str, tuple[Any, Any]] = {}
    rows: list[EngineRow] = []
    with KEPT_SERVERS.open_servers() as servers:  # what all adapters need is imported once
        for one in collect_engines(models, config, engine).engines.values():
            if (reason := describe_missing_package(one)) is not None:
                rows.append(EngineRow(one.name, False, "missing", message=reason))
                continue
            if one.adapter_key not in known:
                job: DescribeRequest = {"kind": "describe", "engine": one.name, **one.door}
                known[one.adapter_key] = ask(job, DESCRIBE, ChildProcesses(servers=servers))
            answer, ending = known[one.adapter_key]
            if answer is None:
                rows.append(EngineRow(one.name, False, "broken", message=ending.message))
            else:
                rows.append(EngineRow(one.name, True, answer["version"], answer["abilities"]))
    for row, names in join_alike_engines(rows):
        version = escape(row.version) if row.present else f"[red]{row.version}[/red]"
        table.add_row("\n".join(names), version, escape(row.message or row.abilities))
    Console().print(table)
