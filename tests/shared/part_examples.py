"""Meshes for tests: blocks of every kind of cell, bars with two interfaces, and the beams that they are in the slender limit."""

from __future__ import annotations

from itertools import permutations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexinv.model.mechanism import Beam, Section
from flexinv.model.part import Cells, Material, MeshedPart, PartInterface
from flexinv.parts.solid_elements import NODE_PLACES
from flexinv.typing import Array

ALUMINIUM = Material.build_isotropic(70e9, 0.3, 2700.0)
Nodes = NDArray[np.int64]


def make_block(kind: str, size: tuple[float, float, float], count: tuple[int, int, int]) -> tuple[Array, Nodes]:
    """Points (n, 3) [m] and cells of a block from the origin along x, its axis in the middle of y and z."""
    number: dict[tuple[int, ...], int] = {}
    points: list[Array] = []
    cells = []
    reference = np.array([[{"0": 0, "1": 2, "h": 1}[digit] for digit in word] for word in NODE_PLACES[kind].split()])
    for corner in np.ndindex(*count):
        for frame in _list_frames(kind):
            cell = []
            for place in reference:
                key = tuple((2 * np.array(corner) + frame[0] + frame[1] @ place).tolist())
                if key not in number:
                    number[key] = len(points)
                    points.append(np.array(key) / (2.0 * np.array(count)) * size - [0, size[1] / 2, size[2] / 2])
                cell.append(number[key])
            cells.append(cell)
    return np.array(points), np.array(cells)


def _list_frames(kind: str) -> list[tuple[Nodes, Nodes]]:
    """Origins and axes of the cells of one cube, in half edges: itself, two wedges, or Kuhn's six tetrahedra."""
    zero = np.zeros(3, dtype=np.int64)
    eye = np.eye(3, dtype=np.int64)
    if kind.startswith("hexahedron"):
        return [(zero, eye)]
    if kind == "wedge":
        return [(zero, eye), (np.array([2, 2, 0]), np.diag([-1, -1, 1]))]
    frames = []
    for order in permutations(range(3)):
        corners = np.cumsum(eye[list(order)], axis=0)  # 0, first, first and second, all
        axes = corners.T if np.linalg.det(corners.T) > 0 else corners[[1, 0, 2]].T
        frames.append((zero, axes))
    return frames


def make_part(
    points: Array, cells: Nodes, kind: str, material: Material = ALUMINIUM, tie: str = "rigid", **data: Any
) -> MeshedPart:
    """The part of a block, clamped at its first face, with its last face as tip."""
    faces = [np.flatnonzero(np.abs(points[:, 0] - x) < 1e-9) for x in (points[:, 0].min(), points[:, 0].max())]
    ends = [np.array([points[nodes[0], 0], 0.0, 0.0]) for nodes in faces]
    both = tuple(
        PartInterface(name, nodes, end, tie) for name, nodes, end in zip(("hub", "tip"), faces, ends, strict=True)
    )
    return MeshedPart(points, (Cells(kind, cells, material),), both, "hub", "tip", **data)


def make_bar(
    kind: str = "hexahedron20", length: float = 0.8, side: float = 0.02, count: tuple[int, int, int] = (10, 1, 1),
    material: Material = ALUMINIUM, tie: str = "rigid", **data: Any,
) -> MeshedPart:  # fmt: skip
    """A square bar along x."""
    return make_part(*make_block(kind, (length, side, side), count), kind, material, tie, **data)


def make_same_beam(length: float = 0.8, side: float = 0.02, young: float = 70e9, poisson: float = 0.0) -> Beam:
    """The beam of a square bar without Poisson's effect, of density 2,700 kg/m^3."""
    area = side**2
    second = side**4 / 12.0
    shear = young / (2.0 * (1.0 + poisson))
    stiffness = [young * area, *2 * [5 / 6 * shear * area], shear * 0.140577 * side**4, *2 * [young * second]]
    inertia = 2700.0 * second
    section = Section(
        np.zeros(1), np.array([stiffness]), np.array([2700.0 * area]), np.array([[2 * inertia, *2 * [inertia]]])
    )
    return Beam(length, section, elements=2, order=6)
