"""Entry point of ``crosscheck``: a package that is missing is named with its remedy; exit code 2, for 1 means deviations."""

from __future__ import annotations

import gc
import importlib
import os
import re
import shlex
import signal
import sys
from importlib import metadata
from types import FrameType
from typing import NoReturn

# Every other package that the commands import is in the extra "report".
EXTRAS = {
    "sqlalchemy": "history",
    "matplotlib": "plot",
    "distributed": "cluster",
    "dask": "cluster",
}
# New objects after which Python looks for garbage.  What is imported stays: with the usual 700 a seventh of a start goes to that.
GARBAGE = 50_000
# Libraries that take matrices apart in threads of their own.  Matrices here are small: a second thread waits by spinning, which
# takes as much of a processor as the first and gives nothing.  Whoever has set a number keeps it.
LIBRARIES = ("OPENBLAS", "MKL", "VECLIB_MAXIMUM")
FROM_PYTHON = re.compile(r'python_version >= "(\d+)\.(\d+)"')


def main() -> None:
    """Run the command line, or say what it needs; Ctrl-C and a polite kill (SIGTERM) are words at any moment."""
    gc.set_threshold(GARBAGE)
    for library in LIBRARIES:  # NumPy reads it when it is imported, which is later
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    signal.signal(signal.SIGTERM, convert_to_interrupt)
    try:
        run_commands()
    except KeyboardInterrupt:  # before the commands are there to hear it
        write_message("Error: interrupted")
        os._exit(2)
    finally:  # what comes now comes too late: everything is done, and Python leaves
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)


def write_message(words: str) -> None:
    """Write a line for whoever sits at the terminal."""
    import click  # when it is needed: until then an interrupt is heard

    click.echo(words, err=True)


def convert_to_interrupt(number: int, frame: FrameType | None) -> NoReturn:
    """Treat a signal like Ctrl-C."""
    raise KeyboardInterrupt


def run_commands() -> None:
    """Run the command line, or say what it needs."""
    try:
        from flexinv.kernels.compiler.compile_lock import (
            NOTE,
            add_compile_listener,
        )  # first of all that takes its time: an interrupt is heard here

        command = importlib.import_module("crosscheck.cli").main
    except ModuleNotFoundError as error:
        write_message(f"Error: {describe_missing_package(error)}")
        sys.exit(2)
    try:
        with add_compile_listener(lambda: write_message(f"crosscheck: {NOTE}")):
            command()
    except OSError as error:  # of the terminal itself: what it was sent to is full
        write_message(f"Error: what crosscheck says cannot be written: {error}")
        os._exit(2)  # nothing that is left in a buffer could be written either


def describe_missing_package(error: ModuleNotFoundError) -> str:
    """Return the message with the packages to install for a missing module; raise the error for a module of our own."""
    name = (error.name or "").partition(".")[0]
    if name in ("", "crosscheck", "flexinv"):
        raise error
    extra = EXTRAS.get(name, "report")
    return (
        f"crosscheck needs {name}, which is not installed; to install what it needs (flexinv[{extra}]): "
        f"python -m pip install {shlex.join(list_requirements(extra)) or name}"
    )


def list_requirements(extra: str = "") -> list[str]:
    """Return the requirements for pip of an extra of this project, of its core without one, on this Python.

    Nothing where the project itself is not installed.
    """
    try:
        lines = metadata.requires("flexinv") or []
    except metadata.PackageNotFoundError:
        return []
    parts = [[part.strip() for part in line.partition(";")] for line in lines]
    return [need for need, _, marker in parts if _is_marker_met(marker, extra)]


def _is_marker_met(marker: str, extra: str) -> bool:
    """Return True if a requirement with this marker [-] is one of the extra, on this Python.

    The markers of pyproject.toml say "from this Python on", and the installation joins them to the extra's by "and".
    """
    conditions = {part.strip(" ()") for part in marker.replace("'", '"').split(" and ") if part.strip()}
    froms = {one: match for one in conditions if (match := FROM_PYTHON.fullmatch(one))}
    is_met = all(sys.version_info >= (int(match[1]), int(match[2])) for match in froms.values())
    return is_met and conditions - froms.keys() == ({f'extra == "{extra}"'} if extra else set())
