"""Make the mesh of models/meshed_arm: python docs/studies/make_meshed_arm.py.

A forearm as a hollow, tapered square tube, 400 mm long, with two windows in each of its two side walls: 20-node hexahedra, one
through the wall, in millimetres, as an Abaqus or CalculiX input with the nodes of its ends as sets.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from write_hexahedra import Key, write_hexahedra

FILE = Path(__file__).parents[2] / "models" / "meshed_arm" / "forearm.inp"
LENGTH = 400.0
SIDES = (60.0, 40.0)  # outer, at the elbow and at the flange
WALL = 4.0
ALONG = 12
ACROSS = 4  # elements of a side
WINDOWS = ((2, 4), (7, 9))  # elements along, of the two in the middle of the side walls


def main() -> None:
    """Write the file [mm]."""
    cells = [(i, j) for i in range(ALONG) for j in range(4 * ACROSS) if not is_window(i, j)]
    sets: dict[str, Callable[[Key], bool]] = {
        "ELBOW": lambda key: key[0] == 0,
        "FLANGE": lambda key: key[0] == 2 * ALONG,
    }
    heading = "Forearm, millimetres; docs/studies/make_meshed_arm.py"
    write_hexahedra(FILE, heading, "TUBE", cells, sets, compute_place, 8 * ACROSS)


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
