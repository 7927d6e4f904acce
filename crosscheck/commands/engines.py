"""``crosscheck engines``: what is installed."""

from __future__ import annotations

from typing import Any

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from crosscheck.engines import ENGINES, missing
from crosscheck.isolation import Children, ask
from crosscheck.runner import DESCRIBE


@click.command("engines", short_help="Show which engines are installed, and what each can do.")
def command() -> None:
    """Show which engines are installed, their versions and what each can do."""
    table = Table("engine", "version", "what it can do", box=None, header_style="dim")
    known: dict[str, tuple[Any, Any]] = {}
    for engine in ENGINES.values():
        if (reason := missing(engine)) is not None:
            table.add_row(engine.name, "[red]missing[/red]", escape(reason))
            continue
        if engine.module not in known:
            known[engine.module] = ask({"kind": "describe", "module": engine.module}, DESCRIBE, Children())
        answer, ending = known[engine.module]
        if answer is None:
            table.add_row(engine.name, "[red]broken[/red]", escape(ending.message))
        else:
            table.add_row(engine.name, escape(answer["version"]), escape(answer["abilities"]))
    Console().print(table)
