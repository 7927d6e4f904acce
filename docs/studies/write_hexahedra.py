"""Write a mesh of 20-node hexahedra over cells of a grid, one through the thickness, as an Abaqus or CalculiX input."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

# Corners, then midpoints of edges, of a cell in the order of Abaqus, in half steps along, across and through the thickness.
ORDER = "000 200 220 020 002 202 222 022 100 210 120 010 102 212 122 012 001 201 221 021"
Key = tuple[int, int, int]  # of a node, in half steps of the grid
Place = tuple[float, float, float]


def write_hexahedra(
    file: Path,
    heading: str,
    name: str,
    cells: Iterable[tuple[int, int]],
    sets: Mapping[str, Callable[[Key], bool]],
    compute_place: Callable[[int, int, int], Place],
    around: int = 0,
) -> None:
    """Write the cells [mm], a set ``name`` of them all, and sets of the nodes for which a condition holds.

    around : half steps after which the second direction meets its beginning [-], 0 for never
    """
    number: dict[Key, int] = {}
    elements = []
    for i, j in cells:
        corners = [(2 * i + int(word[0]), 2 * j + int(word[1]), int(word[2])) for word in ORDER.split()]
        keys = [(a, b % around if around else b, c) for a, b, c in corners]
        elements.append([number.setdefault(key, len(number) + 1) for key in keys])
    lines = ["*HEADING", heading, "*NODE, NSET=ALL_NODES"]
    lines += [f"{n}, " + ", ".join(f"{x:.6f}" for x in compute_place(*key)) for key, n in number.items()]
    lines.append(f"*ELEMENT, TYPE=C3D20, ELSET={name}")
    for k, cell in enumerate(elements):
        lines += [f"{k + 1}, " + ", ".join(map(str, cell[:15])) + ",", ", ".join(map(str, cell[15:]))]
    for set_name, holds in sets.items():
        lines.append(f"*NSET, NSET={set_name}")
        at = [n for key, n in number.items() if holds(key)]
        rows = [at[k : k + 16] for k in range(0, len(at), 16)]
        lines += [", ".join(map(str, row)) + ("," if row is not rows[-1] else "") for row in rows]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
