"""Make the mesh of models/ur5_meshed_forearm: python docs/studies/make_meshed_forearm.py.

A forearm for UR5 as a hollow, tapered round tube with three rows of holes: 20-node hexahedra, one through the wall, in
millimetres, along z of the robot's forearm_link from the elbow to the wrist.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from write_hexahedra import Key, write_hexahedra

FILE = Path(__file__).parents[2] / "models" / "ur5_meshed_forearm" / "forearm.inp"
LENGTH = 392.25  # of the URDF's forearm_link, elbow to wrist_1_joint
RADII = (38.0, 27.0)  # outer, at the elbow and at the wrist
WALL = 3.0
ALONG = 14
AROUND = 16
HOLES = ((2, 4), (6, 8), (10, 12))  # elements along, of each row
OPEN = (1, 2, 9, 10)  # elements around that the holes leave out


def main() -> None:
    """Write the file [mm]."""
    cells = [(i, j) for i in range(ALONG) for j in range(AROUND) if not is_hole(i, j)]
    sets: dict[str, Callable[[Key], bool]] = {
        "ELBOW": lambda key: key[0] == 0,
        "WRIST": lambda key: key[0] == 2 * ALONG,
    }
    heading = "Forearm for UR5, millimetres; docs/studies/make_meshed_forearm.py"
    FILE.parent.mkdir(exist_ok=True)
    write_hexahedra(FILE, heading, "SHELL", cells, sets, compute_place, 2 * AROUND)


def is_hole(i: int, j: int) -> bool:
    """Return True where the wall is open [-]."""
    return j in OPEN and any(first <= i < last for first, last in HOLES)


def compute_place(a: int, b: int, c: int) -> tuple[float, float, float]:
    """Return the place [mm] of a node: half steps along, around from x towards y, and through the wall from outside."""
    along = a / (2 * ALONG)
    radius = RADII[0] + along * (RADII[1] - RADII[0]) - c * WALL / 2
    angle = np.pi * b / AROUND
    return radius * float(np.cos(angle)), radius * float(np.sin(angle)), along * LENGTH


if __name__ == "__main__":
    main()
