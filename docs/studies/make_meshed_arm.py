"""Make the mesh of models/meshed_arm: python docs/studies/make_meshed_arm.py.

A forearm as a hollow, tapered square tube, 400 mm long, with two windows in each of its two side walls: 20-node hexahedra, one
through the wall, in millimetres, as an Abaqus or CalculiX input with the nodes of its ends as sets.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

FILE = Path(__file__).parents[2] / "models" / "meshed_arm" / "forearm.inp"
LENGTH = 400.0
SIDES = (60.0, 40.0)  # outer, at the elbow and at the flange
WALL = 4.0
ALONG = 12
ACROSS = 4  # elements of a side
WINDOWS = ((2, 4), (7, 9))  # elements along, of the two in the middle of the side walls
# Corners, then midpoints of edges, of a cell in the order of Abaqus, in half steps along, around and through the wall.
ORDER = "000 200 220 020 002 202 222 022 100 210 120 010 102 212 122 012 001 201 221 021"


def main() -> None:
    """Write the file [mm]."""
    number: dict[tuple[int, int, int], int] = {}
    cells = []
    for i in range(ALONG):
        for j in range(4 * ACROSS):
            if is_window(i, j):
                continue
            cell = []
            for word in ORDER.split():
                a, b, c = map(int, word)
                key = (2 * i + a, (2 * j + b) % (8 * ACROSS), c)
                cell.append(number.setdefault(key, len(number) + 1))
            cells.append(cell)
    lines = ["*HEADING", "Forearm, millimetres; docs/studies/make_meshed_arm.py", "*NODE, NSET=ALL_NODES"]
    lines += [f"{n}, " + ", ".join(f"{x:.6f}" for x in compute_place(*key)) for key, n in number.items()]
    lines.append("*ELEMENT, TYPE=C3D20, ELSET=TUBE")
    for k, cell in enumerate(cells):
        lines += [f"{k + 1}, " + ", ".join(map(str, cell[:15])) + ",", ", ".join(map(str, cell[15:]))]
    for name, end in (("ELBOW", 0), ("FLANGE", 2 * ALONG)):
        lines.append(f"*NSET, NSET={name}")
        at = [n for key, n in number.items() if key[0] == end]
        lines += [
            ", ".join(map(str, at[k : k + 16])) + ("," if k + 16 < len(at) else "") for k in range(0, len(at), 16)
        ]
    FILE.write_text("\n".join(lines) + "\n", encoding="utf-8")


def is_window(i: int, j: int) -> bool:
    """Return True where a wall is open [-]: in the middle of the second and fourth side."""
    side = j // ACROSS
    middle = j % ACROSS in (1, 2)
    return side in (1, 3) and middle and any(first <= i < last for first, last in WINDOWS)


def compute_place(a: int, b: int, c: int) -> tuple[float, float, float]:
    """Return the place [mm] of a node: half steps along, around the square from its corner, and through the wall from outside."""
    along = a / (2 * ALONG)
    half = 0.5 * (SIDES[0] + along * (SIDES[1] - SIDES[0])) - c * WALL / 2
    side, rest = divmod(b, 2 * ACROSS)
    t = rest / ACROSS - 1.0  # -1 .. 1 along the side
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    first = corners[side]
    middle = 0.5 * (1 - t) * first + 0.5 * (1 + t) * corners[(side + 1) % 4]
    return along * LENGTH, float(half * middle[0]), float(half * middle[1])


if __name__ == "__main__":
    main()
