"""The command line: ``crosscheck COMMAND``; every command is a file of ``crosscheck/commands``, or of a folder in it."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import pkgutil
import traceback
from pathlib import Path
from typing import Any, cast

import click

from crosscheck import commands
from crosscheck.commands import releases
from crosscheck.commands.shared.terminal import Console, Failure
from crosscheck.secrets import remove_passwords
from crosscheck.start import describe_missing_package

FOLDERS = (commands, releases)  # of commands


class Main(click.Group):
    """Commands by file, imported when asked for; every failure has exit code 2: 1 means that engines deviate."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands: those of the files."""
        return sorted(_collect_modules())

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """Import the file of a command and return what it calls ``command``; None where there is no such file."""
        modules = _collect_modules()
        if name not in modules:
            return None
        try:
            module = importlib.import_module(modules[name])
        except ModuleNotFoundError as error:
            return _make_refusing_command(name, describe_missing_package(error))
        return cast(click.Command, module.command)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of all commands, of which none is imported for it."""
        with formatter.section("Commands"):
            modules = _collect_modules()
            formatter.write_dl([(name, _read_short_help(modules[name])) for name in sorted(modules)])

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command; what it did not foresee is a failure of the harness."""
        try:
            return super().invoke(ctx)
        except (KeyboardInterrupt, click.Abort):
            raise Failure("interrupted") from None
        except (click.ClickException, click.exceptions.Exit):
            raise
        except BrokenPipeError:  # the reader has seen enough
            Console().on_broken_pipe()
        except ModuleNotFoundError as error:
            raise Failure(describe_missing_package(error)) from error
        except Exception as error:
            click.echo(remove_passwords(traceback.format_exc()), err=True)
            raise Failure(f"the harness failed: {type(error).__name__}: {error}") from error


def _collect_modules() -> dict[str, str]:
    """Return the module of each command, by the command's name."""
    modules = {}
    for folder in FOLDERS:
        for module in pkgutil.iter_modules(folder.__path__):
            if not module.ispkg:
                modules[module.name.replace("_", "-")] = f"{folder.__name__}.{module.name}"
    return modules


def _read_short_help(module: str) -> str:
    """The line of a command in the list of all, from the source of its file: its short help, else its first line."""
    found = importlib.util.find_spec(module)
    assert found is not None
    assert found.origin is not None
    tree = ast.parse(Path(found.origin).read_text(encoding="utf-8"))
    command = next(node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == "command")
    for decorator in command.decorator_list:
        for keyword in decorator.keywords if isinstance(decorator, ast.Call) else []:
            if keyword.arg == "short_help":
                return str(ast.literal_eval(keyword.value))
    return (ast.get_docstring(command) or "").partition("\n")[0]


def _make_refusing_command(name: str, words: str) -> click.Command:
    """Return a command that says what it needs; the others work."""

    def refuse_command(**_: object) -> None:
        raise Failure(words)

    anything = click.Argument(["words"], nargs=-1, type=click.UNPROCESSED)
    loose = {"ignore_unknown_options": True, "allow_extra_args": True}
    return click.Command(name, loose, refuse_command, [anything], help=words)


@click.group(cls=Main, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
def main() -> None:
    """Compute the same mechanism in several engines and say where they differ.

    \b
    First steps:
      crosscheck engines                        what is installed, and what each engine can do
      crosscheck list                           mechanisms, their cases and what is compared
      crosscheck run rigid_3r                   run one mechanism; open reports/latest/index.html
      crosscheck run --engines flexinv,exudyn*  some engines only
      crosscheck new my_arm --template arm      a mechanism of your own ...
      crosscheck verify my_arm --write          ... explained, compared, with limits from its error bars

    \b
    Exit codes: 0  everything compared is within its limits (skipped is neither passed nor failed)
                1  a deviation, or a comparison without a limit
                2  an engine, a model or the harness failed
    """
