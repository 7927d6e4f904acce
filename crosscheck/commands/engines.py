"""``crosscheck engines``: the engines, and the versions that are installed."""

from __future__ import annotations

from typing import Any

import click
from rich.markup import escape
from rich.table import Table

from crosscheck.commands.shared.terminal import Console
from crosscheck.engines import ENGINES, missing
from crosscheck.report.words import engines_alike
from crosscheck.run.isolation import Children, ask
from crosscheck.run.runner import DESCRIBE
from crosscheck.verdicts.results import EngineRow


@click.command("engines", short_help="Show which engines are installed, and what each can do.")
def command() -> None:
    """Show which engines are installed, their versions and what each can do."""
    table = Table("engine", "version", "what it can do", box=None, header_style="dim")
    known: dict[str, tuple[Any, Any]] = {}
    rows: list[EngineRow] = []
    for engine in ENGINES.values():
        if (reason := missing(engine)) is not None:
            rows.append(EngineRow(engine.name, False, "missing", message=reason))
            continue
        if engine.module not in known:
            known[engine.module] = ask({"kind": "describe", "module": engine.module}, DESCRIBE, Children())
        answer, ending = known[engine.module]
        if answer is None:
            rows.append(EngineRow(engine.name, False, "broken", message=ending.message))
        else:
            rows.append(EngineRow(engine.name, True, answer["version"], answer["abilities"]))
    for row, names in engines_alike(rows):
        version = escape(row.version) if row.present else f"[red]{row.version}[/red]"
        table.add_row("\n".join(names), version, escape(row.message or row.abilities))
    Console().print(table)
