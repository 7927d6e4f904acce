"""Table of readers: what each engine's own reader makes of one file, against the reader of this project."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crosscheck.equivalence.compare import compared
from crosscheck.equivalence.result import Comparison
from crosscheck.equivalence.sources import describe, describe_pair, kind_of, readers
from flexinv.errors import InputError

REFERENCE = {"urdf": "flexinv"}  # by format the reader that the others are compared with; else the first that reads it


@dataclass(frozen=True)
class Loaded:
    """One row: a reader, its moving joints, their mass [kg], and what differs from the first reader; words where it refuses."""

    reader: str
    joints: str
    mass: str
    result: str
    words: str
    found: Comparison | None = None

    @property
    def plain(self) -> dict[str, Any]:
        """Return the row as JSON values."""
        own = {
            "reader": self.reader,
            "joints": self.joints,
            "mass": self.mass,
            "result": self.result,
            "words": self.words,
        }
        return own | ({"comparison": self.found.plain} if self.found is not None else {})


def by_readers(file: str, wanted: str, tolerance: float) -> list[Loaded]:
    """Return a row for every reader of a file; tolerance : of efforts relative to their range [-].  Raises InputError."""
    path = Path(file)
    if not path.is_file():
        describe(file)  # says what is wrong
    kind = kind_of(path)
    known = readers(kind)
    names = known if wanted == "all" else [name.strip() for name in wanted.split(",") if name.strip()]
    first = REFERENCE.get(kind) or known[0]
    return [_row(file, first, name, tolerance) for name in (first, *(n for n in names if n != first))]


def _row(file: str, first: str, name: str, tolerance: float) -> Loaded:
    try:
        one, two = describe_pair(f"{file}@{first}", f"{file}@{name}")
        found = compared(one, two, tolerance, {})
    except InputError as error:
        return Loaded(name, "", "", "cannot", " ".join(str(error).split()))
    moving = [joint for joint in two.mechanism.joints if joint.nv]
    mass = sum(body.inertia.mass for link in two.mechanism.links for body in link.bodies)
    words = "; ".join(d.words for d in found.differences[:6]) or "; ".join(found.notes[:2])
    return Loaded(name, str(len(moving)), f"{mass:.6g}", "equal" if found.equal else "different", words, found)
