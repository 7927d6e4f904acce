"""Python packages as engines and causes: entry points of installed packages, and ``module:name`` without installation.

An entry point of the group ``crosscheck.engines`` is named as the engine and leads to an adapter (`crosscheck.engines.base`): a
module, an object, or a class of which one is made; one of the group ``crosscheck.causes`` leads to a `Cause`, or to several.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from crosscheck.engines import ENGINES, Engine
from flexinv.errors import InputError

ENGINE_GROUP = "crosscheck.engines"
CAUSE_GROUP = "crosscheck.causes"
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
REFERENCE = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*(:[A-Za-z_]\w*(\.[A-Za-z_]\w*)*)?")


@dataclass(frozen=True)
class EntryPoint:
    """An entry point: name, what it leads to, and the package that states it."""

    name: str
    value: str
    package: str


def list_entry_points(group: str) -> Iterator[EntryPoint]:
    """Yield the entry points of a group, of packages other than this one, by name; nothing is imported."""
    found = metadata.entry_points(group=group)
    for one in sorted(found, key=lambda e: (e.name, e.value)):
        package = one.dist.name if one.dist is not None else one.module
        if package != "flexinv":
            yield EntryPoint(one.name, one.value, package)


def list_installed_engines() -> dict[str, Engine]:
    """Return the engines of installed packages, by name.  Raises InputError where two have one name."""
    installed_engines: dict[str, Engine] = {}
    for point in list_entry_points(ENGINE_GROUP):
        if not NAME.fullmatch(point.name):
            raise InputError(
                f"package {point.package}: an engine is called {point.name!r}; expected letters, digits, ., _, -"
            )
        if point.name in ENGINES or point.name in installed_engines:
            raise InputError(
                f"package {point.package}: an engine is called {point.name!r}, which is taken; rename it there"
            )
        top = point.value.partition(":")[0].partition(".")[0]
        installed_engines[point.name] = Engine(point.name, point.value, top, f"python -m pip install {point.package}")
    return installed_engines


def resolve_reference(reference: str, folder: Path) -> Engine:
    """Return the engine of ``module``, ``module:name`` or ``NAME=module:name``; folder : where the module may be, too.

    Raises InputError.
    """
    given, equals, target = reference.partition("=")
    name, target = (given, target) if equals else ("", given)
    if not REFERENCE.fullmatch(target):
        raise InputError(
            f"--engine {reference!r}: expected a module and an object in it; write --engine my.module:name"
        )
    module, _, attribute = target.partition(":")
    name = name or attribute.rpartition(".")[2] or module.rpartition(".")[2]
    if not NAME.fullmatch(name):
        raise InputError(f"--engine {reference!r}: an engine called {name!r}; expected letters, digits, ., _ and -")
    return Engine(name, target, "", "", path=str(folder.resolve()))
