"""A part as somebody would write it, a block in millimetres with a hub and a tip, of which a fault changes one thing."""

from __future__ import annotations

import random
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "shared"))

from part_examples import make_block

from flexinv.typing import Array, Indices

ELEMENTS = {"tetra": "C3D4", "tetra10": "C3D10", "hexahedron": "C3D8", "hexahedron20": "C3D20", "wedge": "C3D6"}
MATERIAL = "material = { E_Pa = 70e9, nu = 0.3, rho_kg_per_m3 = 2700 }"
TOML = f"""
source = "planted"
gravity_m_per_s2 = [0, 0, -9.81]

[links.arm]
kind = "mesh"
file = "arm.inp"
unit_m = 0.001
{MATERIAL}
root = "hub"
modes = 3

[links.arm.interfaces.hub]
set = "HUB"

[links.arm.interfaces.tip]
plane = {{ point_m = [LENGTH, 0, 0], normal = [1, 0, 0] }}

[links.hand]
kind = "rigid"
mass_kg = 0.2
com_m = [0, 0, 0]
inertia_kgm2 = {{ xx = 1e-4, yy = 1e-4, zz = 1e-4 }}

[joints.hub]
kind = "revolute"
parent = "world"
child = "arm"
axis = [0, 1, 0]

[joints.wrist]
kind = "revolute"
parent = "arm"
child = "hand"
interface = "tip"
axis = [0, 1, 0]
"""


@dataclass
class Draft:
    """What is written into a folder.

    points : (n, 3) [mm]; numbers : (n,) of the nodes in the file; cells : places among the points
    sets : numbers of nodes by name; text : edits of the mesh file before it is written; files : others, written beside
    size : length, width, height [mm]; whole : writes of files that are too long to be held
    """

    kind: str
    size: tuple[float, float, float]
    points: Array
    cells: Indices
    numbers: Indices
    sets: dict[str, list[int]]
    toml: str
    element: str = ""
    edits: list[Callable[[str], str]] = field(default_factory=list)
    files: dict[str, bytes] = field(default_factory=dict)
    written: list[Callable[[Path], None]] = field(default_factory=list)

    def swap(self, old: str, new: str) -> None:
        """Replace a text of mechanism.toml that must be there."""
        if old not in self.toml:
            raise ValueError(f"{old!r} is not in the mechanism's file")
        self.toml = self.toml.replace(old, new)

    def edit(self, old: str, new: str) -> None:
        """Replace a text of the mesh file that must be there, where it stands first."""

        def replace_first(text: str) -> str:
            if old not in text:
                raise ValueError(f"{old!r} is not in the mesh file")
            return text.replace(old, new, 1)

        self.edits.append(replace_first)

    def write(self, folder: Path) -> None:
        """Write the mechanism and its files into an empty folder."""
        text = self._render_mesh()
        for edit in self.edits:
            text = edit(text)
        folder.mkdir(parents=True)
        (folder / "arm.inp").write_bytes(text.encode())
        (folder / "mechanism.toml").write_text(self.toml, encoding="utf-8")
        for name, content in self.files.items():
            (folder / name).write_bytes(content)
        for write in self.written:
            write(folder)

    def _render_mesh(self) -> str:
        lines = ["*NODE"]
        lines += [
            f"{number}, " + ", ".join(f"{x:.12g}" for x in point)
            for number, point in zip(self.numbers, self.points, strict=True)
        ]
        lines.append(f"*ELEMENT, TYPE={self.element or ELEMENTS[self.kind]}, ELSET=BODY")
        for k, cell in enumerate(self.cells):
            row = [k + 1, *self.numbers[cell].tolist()]
            rows = [row[first : first + 16] for first in range(0, len(row), 16)]
            lines += [", ".join(map(str, part)) + ("," if part is not rows[-1] else "") for part in rows]
        for name, members in self.sets.items():
            lines += [f"*NSET, NSET={name}", *(f"{node}," for node in members)]
        return "\n".join(lines) + "\n"


def make_draft(draw: random.Random, kind: str = "tetra10", count: tuple[int, int, int] = (4, 1, 1)) -> Draft:
    """Return a good block, of a size by lot [mm]."""
    size = (draw.uniform(300, 500), draw.uniform(60, 90), draw.uniform(60, 90))
    points, cells = make_block(kind, size, count)
    numbers = np.arange(1, len(points) + 1)
    hub = numbers[points[:, 0] < 1e-9].tolist()
    return Draft(
        kind, size, points, np.array(cells), numbers, {"HUB": hub}, TOML.replace("LENGTH", f"{size[0] / 1000:.9g}")
    )
