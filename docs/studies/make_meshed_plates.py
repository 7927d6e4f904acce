"""Make the meshes of models/slider_crank_meshed and models/four_bar_bracket: python docs/studies/make_meshed_plates.py.

Plates of 20-node hexahedra over cells of a grid, one cell through the thickness, in millimetres, as Abaqus or CalculiX inputs.
The nodes of their ends are sets.  One is a connecting rod with two windows that narrows, one a bracket like a T with three ends.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

MODELS = Path(__file__).parents[2] / "models"
# Corners, then midpoints of edges, of a cell in the order of Abaqus, in half steps along, across and through the plate.
ORDER = "000 200 220 020 002 202 222 022 100 210 120 010 102 212 122 012 001 201 221 021"
Key = tuple[int, int, int]  # of a node, in half steps of the grid

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
    write_plate(MODELS / "slider_crank_meshed" / "rod.inp", "Connecting rod", rod, ends, compute_rod_place)

    first, last, up = STEM_CELLS
    bracket = [(i, j) for i in range(BAR_CELLS[0]) for j in range(BAR_CELLS[1])]
    bracket += [(i, j) for i in range(first, last) for j in range(BAR_CELLS[1], BAR_CELLS[1] + up)]
    ends = {
        "LEFT": lambda key: key[0] == 0,
        "RIGHT": lambda key: key[0] == 2 * BAR_CELLS[0],
        "TOP": lambda key: key[1] == 2 * (BAR_CELLS[1] + up),
    }
    write_plate(MODELS / "four_bar_bracket" / "bracket.inp", "Bracket", bracket, ends, compute_bracket_place)


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


def write_plate(
    file: Path,
    title: str,
    cells: list[tuple[int, int]],
    sets: dict[str, Callable[[Key], bool]],
    compute_place: Callable[[int, int, int], tuple[float, float, float]],
) -> None:
    """Write the cells [mm] with sets of the nodes for which a condition holds."""
    number: dict[Key, int] = {}
    elements = []
    for i, j in cells:
        keys = [(2 * i + int(word[0]), 2 * j + int(word[1]), int(word[2])) for word in ORDER.split()]
        elements.append([number.setdefault(key, len(number) + 1) for key in keys])
    lines = ["*HEADING", f"{title}, millimetres; docs/studies/{Path(__file__).name}", "*NODE, NSET=ALL_NODES"]
    lines += [f"{n}, " + ", ".join(f"{x:.6f}" for x in compute_place(*key)) for key, n in number.items()]
    lines.append("*ELEMENT, TYPE=C3D20, ELSET=PLATE")
    for k, nodes in enumerate(elements):
        lines += [f"{k + 1}, " + ", ".join(map(str, nodes[:15])) + ",", ", ".join(map(str, nodes[15:]))]
    for name, catches in sets.items():
        lines.append(f"*NSET, NSET={name}")
        caught = [n for key, n in number.items() if catches(key)]
        rows = [caught[k : k + 16] for k in range(0, len(caught), 16)]
        lines += [", ".join(map(str, row)) + ("," if row is not rows[-1] else "") for row in rows]
    file.parent.mkdir(exist_ok=True)
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
