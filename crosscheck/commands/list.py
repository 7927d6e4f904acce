"""``crosscheck list``: mechanisms, their cases and compared quantities."""

from __future__ import annotations

import sys
from pathlib import Path

import click
from rich.markup import escape
from rich.table import Table

from crosscheck.commands.shared.terminal import MODELS, Console, plan_of


@click.command("list", short_help="List mechanisms, their cases, what is compared and the limits.")
@click.argument("names", nargs=-1)
@MODELS
def command(names: tuple[str, ...], models: Path) -> None:
    """List mechanisms, their cases, what is compared and the limits."""
    plan = plan_of(models, names)
    table = Table("mechanism", "case", "what", "compared", box=None, header_style="dim")
    for task in plan.tasks:
        what = task.case.title or task.mechanism.title
        table.add_row(*map(escape, (task.folder.name, task.case.name, what, ", ".join(task.case.quantities))))
    for name, message in plan.broken:
        table.add_row(escape(name), "", f"[red]cannot be read: {escape(message)}[/red]", "")
    Console().print(table)
    if plan.broken:
        sys.exit(2)
