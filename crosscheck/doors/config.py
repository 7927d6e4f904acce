"""``crosscheck.toml``: programs, FMUs and Python objects that a project has as engines.

    [engines.mine]
    command = ["./mine", "{kit}", "{out}"]
    refine = true

It is searched from the folder above the models up to the root of the repository, or up to the home folder: a folder of models is
data and names no programs.  A file of somebody else, or one that others may write, is refused.
"""

from __future__ import annotations

import os
import stat
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from crosscheck.doors.packages import NAME
from flexinv.errors import InputError
from flexinv.files.case_schema import QUANTITIES
from flexinv.files.load_cases import Limit
from flexinv.files.toml_tables import Location, Table, check_table, make_key, read_toml
from flexinv.files.values import Positive, Text

FILE = "crosscheck.toml"
PLACEHOLDERS = ("{kit}", "{out}")


class LimitRow(Table):
    """Limit of an engine's distance from the reference, where cases.toml states none."""

    quantity: Literal["torque", "wrench", "reaction", "tip", "deflection", "axial", "internal", "frequency"] = make_key(
        f"one of {', '.join(QUANTITIES)}", 'quantity = "torque"'
    )
    maximum: Annotated[Positive, Field(le=1)] = make_key("of the range, 0..1 [-]", "maximum = 1e-9")
    reason: Text = make_key("why that is right, a text", 'reason = "both are exact: rounding"')


class EngineRow(Table):
    """One engine: a command, an FMU or a Python object; or the limits of an engine that an installed package brings."""

    command: Annotated[list[Text], Field(min_length=1)] | None = make_key(
        "program and arguments, {kit} and {out} for the folders", 'command = ["./mine", "{kit}", "{out}"]', default=None
    )
    fmu: Text | None = make_key("a file .fmu beside this one", 'fmu = "arm.fmu"', default=None)
    python: Text | None = make_key("module:object that is an adapter", 'python = "my_engine:Mine"', default=None)
    refine: bool = make_key(
        "true: three runs per case, for error bars; case.json says how many times finer", "refine = true", default=False
    )
    cases: Annotated[list[Text], Field(min_length=1)] = make_key(
        "patterns of what it can do: mechanism/case", 'cases = ["double_pendulum/*"]', default=["*"]
    )
    version: Text = make_key("its version, where meta.json does not say it", 'version = "1.0"', default="")
    abilities: Text = make_key("one sentence: what it can do", 'abilities = "rigid trees"', default="")
    limits: list[LimitRow] = make_key("tables [[engines.NAME.limits]]", "[[engines.NAME.limits]]", default=[])


class ConfigTable(Table):
    """The whole file."""

    engines: dict[str, Any] = make_key("tables [engines.NAME]", "[engines.mine]", default={})


def find_config(models: Path, path: Path | None = None) -> Path | None:
    """Return the file of a folder of models: the one that is stated, or the nearest one above; None where there is none.

    Raises InputError for one that may not be used.
    """
    inside = models.resolve()
    for pattern in (FILE, f"*/{FILE}", f"*/*/{FILE}", f"*/*/*/{FILE}"):
        for file in sorted(inside.glob(pattern)):
            raise InputError(
                f"{file} is refused: a folder of models is data and names no programs; move it to {inside.parent}"
            )
    if path is not None:
        return check_file(path, inside)
    for folder in list_parent_folders(inside.parent):
        if (folder / FILE).exists():
            return check_file(folder / FILE, inside)
    return None


def list_parent_folders(folder: Path) -> list[Path]:
    """Return the folders that are searched: up to a repository's root or the home folder; outside of both the first alone."""
    home = Path.home().resolve()
    chain = [folder, *folder.parents]
    for k, one in enumerate(chain):
        if (one / ".git").exists() or one == home:
            return chain[: k + 1]
    return chain[:1]


def check_file(file: Path, models: Path) -> Path:
    """Return the file itself.  Raises InputError where it is not there, not ours, or inside the models."""
    real = file.resolve()
    if not real.is_file():
        raise InputError(f"{file} is no file; write --config with the path of a {FILE}")
    if real.is_relative_to(models):
        raise InputError(
            f"{file} is refused: a folder of models is data and names no programs; move it to {models.parent}"
        )
    about = real.stat()
    if hasattr(os, "getuid") and about.st_uid != os.getuid():
        raise InputError(f"{file} is refused: it belongs to another user (number {about.st_uid}); copy what you trust")
    if about.st_mode & stat.S_IWOTH:
        raise InputError(f"{file} is refused: everybody may write it; run chmod o-w {file}")
    return real


def read_rows(file: Path) -> dict[str, EngineRow]:
    """Return the engines of a file by name.  Raises InputError that says where, what was given and what to write."""
    table = check_table(ConfigTable, read_toml(file), Location(file))
    rows = {}
    for name, data in table.engines.items():
        where = Location(file, f"engines.{name}")
        if not NAME.fullmatch(name):
            expected = "letters, digits, ., _ and -, beginning with a letter or digit"
            raise where.make_error("", f"an engine called {name!r}", expected, "[engines.mine]")
        row = check_table(EngineRow, data, where)
        kinds = [kind for kind in ("command", "fmu", "python") if getattr(row, kind) is not None]
        if len(kinds) != 1 and (kinds or not row.limits):  # limits alone: of an engine that is installed
            given = " and ".join(kinds) or "none of them"
            raise where.make_error(
                "", given, "one of command, fmu and python", 'command = ["./mine", "{kit}", "{out}"]'
            )
        if row.command is not None and not any("{out}" in word for word in row.command):
            write = 'command = ["./mine", "{kit}", "{out}"]'
            raise where.make_error("command", "no {out}", "the folder that it writes into", write)
        rows[name] = row
    return rows


def list_limits(name: str, row: EngineRow) -> tuple[Limit, ...]:
    """Return the limits [-] that an engine's table states."""
    return tuple(Limit(one.quantity, (name,), one.maximum, one.reason) for one in row.limits)


def accepts_case(patterns: list[str], mechanism: str, case: str) -> bool:
    """Return True if one of the patterns fits a case: ``mechanism/case``, or ``mechanism`` for all of its cases."""
    return any(fnmatchcase(f"{mechanism}/{case}", p if "/" in p else f"{p}/*") for p in patterns)
