"""Scope of a run: what the command line asks for; of that every blessed comparison is expected again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase


@dataclass(frozen=True)
class Scope:
    """Names of mechanisms or cases, none means all, and patterns of engines, of which every comparison takes two.

    absent : engines that need a tool which this machine has not: nothing is expected of them, and the run says why
    """

    names: tuple[str, ...] = ()
    engines: tuple[str, ...] = ("*",)
    absent: tuple[str, ...] = ()

    def has_comparison(self, key: Sequence[str]) -> bool:
        """Return True if a comparison is asked for.

        key : mechanism, case, engine, reference, and what else names it
        """
        mechanism, case, engine, reference = key[:4]
        named = not self.names or any(is_case_named(name, mechanism, case) for name in self.names)
        return named and self._has_engine(engine) and self._has_engine(reference)

    def _has_engine(self, engine: str) -> bool:
        return engine not in self.absent and any(fnmatchcase(engine, pattern) for pattern in self.engines)


def is_case_named(name: str, mechanism: str, case: str) -> bool:
    """Return True if "flex_one_link", "flex_*" or "flex_one_link/cycloid" is a name of a case."""
    folder, _, wanted = name.partition("/")
    return fnmatchcase(mechanism, folder) and fnmatchcase(case, wanted or "*")
