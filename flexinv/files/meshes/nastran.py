"""Look at the GRID cards of Nastran's bulk data for what meshio passes over: other axes, and numbers that are there twice."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

from flexinv.files.toml_tables import make_input_error

FIELD_WIDTH = 8  # characters of a field in rows without commas; of cards with a star 16


def check_grids(path: Path, text: str) -> None:
    """Raise InputError for a GRID in another coordinate system (GRDSET: all of them), and for a number that was there before."""
    known: dict[str, int] = {}
    for count, line in enumerate(text.splitlines(), start=1):
        name, number, axes = _split_fields(line)
        if name not in ("GRID", "GRID*", "GRDSET"):
            continue
        place = f"{path}, line {count}, {name} {number}".rstrip()
        if axes not in ("", "0"):
            expected = "coordinates in the basic system: field 3 (CP) empty or 0"
            raise make_input_error(place, f"CP = {axes}", expected, "the export of nodes in the basic system")
        if name == "GRDSET":
            continue
        if number in known:
            given = f"number {number}, which line {known[number]} has already"
            raise make_input_error(place, given, "each node once", "another number, or one of both")
        known[number] = count


def _split_fields(line: str) -> tuple[str, str, str]:
    """Name, number and third field of a card, in free or fixed form."""
    if "," in line:
        fields = [part.strip() for part in line.split(",")]
    else:
        wide = 2 * FIELD_WIDTH if line[:FIELD_WIDTH].strip().endswith("*") else FIELD_WIDTH
        ends = [0, FIELD_WIDTH, FIELD_WIDTH + wide, FIELD_WIDTH + 2 * wide]
        fields = [line[a:b].strip() for a, b in pairwise(ends)]
    name, number, axes = (*fields[:3], "", "", "")[:3]
    return name.upper(), number, axes
