"""Make the meshes of models/slider_crank_meshed and models/four_bar_bracket: python docs/studies/make_meshed_plates.py.

Plates of 20-node hexahedra over cells of a grid, one cell through the thickness, in millimetres, as Abaqus or CalculiX inputs.
The nodes of their ends are sets.  One is a connecting rod with two windows that narrows, one a bracket like a T with three ends.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from write_hexahedra import Key, write_hexahedra

MODELS = Path(__file__).parents[2] / "models"
HEADING = "{}, millimetres; docs/studies/make_meshed_plates.py"

ROD_CELLS = (24, 4)
ROD_LENGTH = 300.0
ROD_WIDTHS = (32.0, 20.0)  # at the crank, at the slider
ROD_THICKNESS = 8.0
ROD_WINDOWS = ((4, 11), (13, 20))  # cells along, of the two in the middle

BAR_CELLS = (16, 2)  # of the bracket's bar, from one pin to the other
STEM_CELLS = (7, 9, 8)  # of its stem: first and last cell along, cells up
BRACKET_CELL = 15.0
BRACKET_THICKNESS = 10.0


def main() -> None:
    """Write both files [mm]."""
    rod = [(i, j) for i in range(ROD_CELLS[0]) for j in range(ROD_CELLS[1]) if not is_window(i, j)]
    ends: dict[str, Callable[[Key], bool]] = {
        "CRANK_END": lambda key: key[0] == 0,
        "SLIDER_END": lambda key: key[0] == 2 * ROD_CELLS[0],
    }
    write_hexahedra(
        MODELS / "slider_crank_meshed" / "rod.inp",
        HEADING.format("Connecting rod"),
        "PLATE",
        rod,
        ends,
        compute_rod_place,
    )

    first, last, up = STEM_CELLS
    bracket = [(i, j) for i in range(BAR_CELLS[0]) for j in range(BAR_CELLS[1])]
    bracket += [(i, j) for i in range(first, last) for j in range(BAR_CELLS[1], BAR_CELLS[1] + up)]
    ends = {
        "LEFT": lambda key: key[0] == 0,
        "RIGHT": lambda key: key[0] == 2 * BAR_CELLS[0],
        "TOP": lambda key: key[1] == 2 * (BAR_CELLS[1] + up),
    }
    write_hexahedra(
        MODELS / "four_bar_bracket" / "bracket.inp",
        HEADING.format("Bracket"),
        "PLATE",
        bracket,
        ends,
        compute_bracket_place,
    )


def is_window(i: int, j: int) -> bool:
    """Return True where the rod is open [-]: in the middle of its width."""
    return j in (1, 2) and any(first <= i < last for first, last in ROD_WINDOWS)


def compute_rod_place(a: int, b: int, c: int) -> tuple[float, float, float]:
    """Return the place [mm] of a node of the rod: along x from the crank's pin, which is in the middle of its first end."""
    along = a / (2 * ROD_CELLS[0])
    width = ROD_WIDTHS[0] + along * (ROD_WIDTHS[1] - ROD_WIDTHS[0])
    return along * ROD_LENGTH, width * (b / (2 * ROD_CELLS[1]) - 0.5), ROD_THICKNESS * (c / 2 - 0.5)


def compute_bracket_place(a: int, b: int, c: int) -> tuple[float, float, float]:
    """Return the place [mm] of a node of the bracket: along x from its left end, the stem along y."""
    return 0.5 * BRACKET_CELL * a, 0.5 * BRACKET_CELL * (b - BAR_CELLS[1]), BRACKET_THICKNESS * (c / 2 - 0.5)


if __name__ == "__main__":
    main()
