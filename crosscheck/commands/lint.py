"""``crosscheck lint``: one description alone, and what in it is suspicious."""

from __future__ import annotations

import json
import sys
from xml.etree import ElementTree as ET

import click
from rich.markup import escape
from rich.table import Table

from crosscheck.commands.shared.terminal import Console, Failure
from crosscheck.linting.lint import Linted, lint
from crosscheck.report.junit import FORBIDDEN
from flexinv.errors import InputError


@click.command("lint", short_help="Say what is suspicious in one description.")
@click.argument("files", nargs=-1, required=True)
@click.option("--strict", is_flag=True, help="Warnings count for the exit code, too: for CI.")
@click.option("--json", "as_json", is_flag=True, help="Print the findings as JSON.")
@click.option("--junit", type=click.Path(dir_okay=False), help="Write the findings as JUnit XML.")
def command(files: tuple[str, ...], strict: bool, as_json: bool, junit: str | None) -> None:
    """Say what in a description no machine can have, or what its readers make different things of.

    \b
      crosscheck lint arm.urdf
      crosscheck lint robots/*.urdf --strict --junit lint.xml

    \b
    Exit codes: 0 nothing found (without --strict: no error), 1 findings, 2 a file cannot be read
    """
    try:
        found = [lint(file, strict) for file in files]
        if junit is not None:
            with open(junit, "wb") as stream:
                stream.write(_junit(found))
    except InputError as problem:
        raise Failure(str(problem)) from problem
    except OSError as problem:
        raise Failure(f"{junit or files[0]}: {problem}") from problem
    if as_json:
        click.echo(json.dumps([one.plain for one in found], indent=1))
    else:
        for one in found:
            _show(Console(), one)
    sys.exit(0 if all(one.clean for one in found) else 1)


def _show(console: Console, found: Linted) -> None:
    if found.findings:
        table = Table(title=found.label, title_justify="left")
        for name in ("level", "check", "where", "given", "why", "write"):
            table.add_column(name, overflow="fold")
        for one in found.findings:
            colour = "red" if one.level == "error" else "yellow"
            cells = map(escape, (one.check, one.place, one.given, one.why, one.write))
            table.add_row(f"[{colour}]{one.level}[/]", *cells)
        console.print(table)
    errors = sum(one.level == "error" for one in found.findings)
    words = f"{errors} errors, {len(found.findings) - errors} warnings" if found.findings else "nothing found"
    console.print(f"{escape(found.label)}: {words}", highlight=False, soft_wrap=True)


def _junit(found: list[Linted]) -> bytes:
    root = ET.Element("testsuites", name="crosscheck lint")
    for one in found:
        suite = ET.SubElement(root, "testsuite", name=_clean(one.label), tests=str(len(one.findings) or 1))
        counted = [f for f in one.findings if f.level == "error" or one.strict]
        suite.set("failures", str(len(counted)))
        for finding in one.findings:
            case = ET.SubElement(suite, "testcase", classname=finding.check, name=_clean(finding.place))
            if finding in counted:
                message = _clean(f"{finding.given}: {finding.why}; write {finding.write}")
                ET.SubElement(case, "failure", message=message)
        if not one.findings:
            ET.SubElement(suite, "testcase", classname="lint", name="nothing found")
    ET.indent(root)
    text: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return text


def _clean(words: str) -> str:
    return FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", words)
