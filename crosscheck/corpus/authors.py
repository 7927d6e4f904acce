"""Authors of engines: engines that drive one package, or that corpus.toml gives to one author, do not confirm each other.

Neither do engines whose closed loops follow from one text of ours, `crosscheck.engines.shared.loop_closure`: the equations of
closures, Newton's method for their positions, and how efforts are split between drives.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from crosscheck.corpus.notes import EngineNote
from crosscheck.engines import ENGINES, Engine

SHARED_CLOSURES = ("pinocchio", "mujoco", "exudyn")  # packages of which an adapter of ours closes loops by that text
CLOSURES = "the closures of crosscheck"
MACHINE = "measured"  # our own row for measurements: it imports numpy, which is not what measured


@dataclass(frozen=True)
class Author:
    """Author of an engine; closed_form : its series are formulas, which need no second author."""

    name: str
    closed_form: bool = False


def find_author(engine: Engine, notes: Mapping[str, EngineNote], loops: bool = False) -> Author:
    """Return the author of an engine: what corpus.toml states, else the package that it drives, else the engine itself.

    loops : whether the mechanism has closures: of those the shared text is the author
    """
    if (note := notes.get(engine.name)) is not None:
        return Author(note.author, note.closed_form)
    if engine.name == MACHINE and engine.name in ENGINES:
        return Author(MACHINE)
    if loops and engine.requires in SHARED_CLOSURES and engine.name in ENGINES:
        return Author(CLOSURES)
    return Author(engine.requires or engine.name)
