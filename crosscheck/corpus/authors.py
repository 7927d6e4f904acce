"""Authors of engines: engines that drive one package, or that corpus.toml gives to one author, do not confirm each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from crosscheck.corpus.notes import EngineNote
from crosscheck.engines import ENGINES, Engine

MACHINE = "measured"  # our own row for measurements: it imports numpy, which is not what measured


@dataclass(frozen=True)
class Author:
    """Author of an engine; closed_form : its series are formulas, which need no second author."""

    name: str
    closed_form: bool = False


def find_author(engine: Engine, notes: Mapping[str, EngineNote]) -> Author:
    """Return the author of an engine: what corpus.toml states, else the package that it drives, else the engine itself."""
    if (note := notes.get(engine.name)) is not None:
        return Author(note.author, note.closed_form)
    if engine.name == MACHINE and engine.name in ENGINES:
        return Author(MACHINE)
    return Author(engine.requires or engine.name)
