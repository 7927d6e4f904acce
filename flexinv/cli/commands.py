"""The command line: ``flexinv COMMAND``, imported when it is asked for.  Every text of --help is meant to be learned from."""

from __future__ import annotations

import difflib
import importlib
import sys
import warnings
from typing import cast

import click

from flexinv.display.words import join_lines
from flexinv.errors import FlexinvError, ModelWarning
from flexinv.kernels.compiler.compile_lock import NOTE, add_compile_listener

# Command -> module below `flexinv.cli`, its name there, and its line in the list of all.
COMMANDS = {
    "export-c": ("export_c", "write_c_library", "Write the inverse dynamics of a mechanism as a C library."),
    "export-fmu": ("export_fmu", "write_fmu", "Write the dynamics of a mechanism as an FMU (Simulink, Modelica)."),
    "export-ros": ("export_ros", "write_ros_package", "Write the torques of a mechanism as a package of ROS 2."),
    "follow": ("simulate", "follow_task", "Compute the torques with which a tip follows a path."),
    "info": ("show", "info", "Show what a mechanism file (or a URDF) is."),
    "modes": ("show", "modes", "Show natural frequencies, at rest or in steady rotation."),
    "optimize-motion": ("optimize_motion", "write_best_motion", "Find a shorter or quieter motion within limits."),
    "parameters": ("show", "parameters", "Show the base parameters of a rigid mechanism."),
    "simulate": ("simulate", "simulate_file", "Compute the motion that torques give."),
    "solve": ("solve", "solve", "Compute the torques for the motion of a case."),
    "torques": ("torques", "write_torque_file", "Compute the torques of a robot for a motion in a CSV file."),
    "warm": ("warm", "warm", "Compile the kernels now, not with the first torque."),
}


class Commands(click.Group):
    """The group of all commands, each imported when it is asked for: who asks for one does not wait for the others."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """Import a command and return it; None where there is none of that name."""
        if name not in COMMANDS:
            return None
        module, attribute, line = COMMANDS[name]
        command = cast(click.Command, getattr(importlib.import_module(f"flexinv.cli.{module}"), attribute))
        command.short_help = line
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command that the first word names and the words behind it; one that is not known is told the nearest."""
        if args and args[0] not in COMMANDS and not args[0].startswith("-"):
            near = difflib.get_close_matches(args[0], COMMANDS, 1)
            write = f"flexinv {near[0]}" if near else f"one of {', '.join(COMMANDS)}"
            ctx.fail(f"No such command '{args[0]}'; write {write}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of all commands, of which none is imported for it."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, line) for name, (_, _, line) in COMMANDS.items()])


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(package_name="flexinv")
def app() -> None:
    """Joint torques of rigid, flexible and mixed mechanisms from the motion that their joints shall make.

    A mechanism is a folder such as models/flex_one_link with mechanism.toml (links, joints, sections) and cases.toml
    (motions). Start with:

    \b
      flexinv torques robot.urdf motion.csv --out torques.csv
      flexinv info models/flex_one_link
      flexinv solve models/flex_one_link --case cycloid --plot torque.png
    """


def main(arguments: list[str] | None = None) -> None:
    """Run the command line: exit code 0, or 2 with one line that says what was wrong and what to write."""
    with warnings.catch_warnings():
        warnings.simplefilter("always", ModelWarning)
        others = warnings.showwarning
        warnings.showwarning = lambda message, category, *place: (
            click.echo(f"flexinv: warning: {join_lines(message)}", err=True)
            if issubclass(category, ModelWarning)
            else others(message, category, *place)
        )
        with add_compile_listener(lambda: click.echo(f"flexinv: {NOTE}", err=True)):
            complaint = _run(arguments)
    if complaint:
        click.echo(f"flexinv: {complaint}", err=True)
        sys.exit(2)


def _run(arguments: list[str] | None) -> str:
    """Run, and return what was wrong in one line."""
    try:
        app.main(args=arguments, prog_name="flexinv", standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as help_text:
        click.echo(help_text.format_message())
    except click.ClickException as error:
        return f"{join_lines(error.format_message())} (flexinv --help)"
    except click.Abort:
        return "interrupted"
    except FlexinvError as error:
        return join_lines(error)
    except OSError as error:
        return f"{error.filename}: {error.strerror}" if error.filename else join_lines(error)
    return ""
