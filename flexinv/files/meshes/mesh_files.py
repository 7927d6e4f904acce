"""Read meshes of parts: Abaqus's and CalculiX's by `abaqus`, others by meshio, which is imported late.

meshio 5.3 reads .inp, too, but keeps the last of several *NODE cards, takes sets of names for empty ones, and puts the set of an
*ELEMENT card on another card's elements where one before has none.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from flexinv.files.meshes.abaqus import read_abaqus
from flexinv.files.meshes.nastran import check_grids
from flexinv.files.regular_files import NotRegularFile, read_regular
from flexinv.files.toml_tables import make_input_error
from flexinv.model.part import CELL_KINDS
from flexinv.typing import Array, Indices

LARGEST_MESH = 1 << 29  # bytes: some 5e6 nodes as text, far beyond what is factored here
FORMATS = {
    ".inp": "abaqus", ".msh": "gmsh", ".vtu": "vtu", ".vtk": "vtk", ".bdf": "nastran", ".nas": "nastran", ".fem": "nastran",
}  # fmt: skip
# Cells of surfaces, lines and points: of them sets are taken, they carry nothing.
BOUNDARIES = ("triangle", "quad", "line", "vertex")
BULK = b"BEGIN BULK"


@dataclass(frozen=True, eq=False)
class FileMesh:
    """Content of a mesh file.

    points : (n, 3) in the file's unit of length; cells : (kind, nodes, names of the sets that hold all of them)
    sets : name -> numbers of nodes; notes : for the reader of results
    """

    points: Array
    cells: tuple[tuple[str, Indices, tuple[str, ...]], ...]
    sets: Mapping[str, Indices]
    notes: tuple[str, ...]


def read_mesh_file(path: Path) -> FileMesh:
    """Return the mesh of a file [unit of the file].  Raises InputError for a file that is none, or of other cells."""
    expected = f"a mesh of a kind that is read here: {', '.join(FORMATS)}"
    if path.suffix.lower() not in FORMATS:
        write = "the export of your program as one of these"
        raise make_input_error(str(path), f"a file that ends in {path.suffix!r}", expected, write)
    notes: tuple[str, ...] = ()
    if path.suffix.lower() == ".inp":
        mesh, notes = read_abaqus(path, partial(read_data, expected=expected))
    else:
        mesh = _parse_mesh(path, read_data(path, expected), expected)
    by_cell = _collect_cell_sets(mesh)
    cells = tuple(group for k in _list_solids(path, mesh) for group in _split_block(mesh.cells[k], k, by_cell))
    return FileMesh(np.asarray(mesh.points, dtype=float), cells, _collect_sets(mesh, by_cell), notes)


def _list_solids(path: Path, mesh: Any) -> list[int]:
    """Numbers of the blocks of solid cells.  Raises InputError where there are none, or cells that carry in another way."""
    solid = [k for k, block in enumerate(mesh.cells) if block.type in CELL_KINDS]
    others = sorted({b.type for b in mesh.cells if b.type not in CELL_KINDS and not b.type.startswith(BOUNDARIES)})
    if others or not solid:
        given = f"cells of kind {', '.join(others)}" if others else "no solid cells"
        write = "a mesh of these; shells and beams of a part are no solid: mesh its volume"
        raise make_input_error(str(path), given, f"solid cells: {', '.join(CELL_KINDS)}", write)
    return solid


def _collect_cell_sets(mesh: Any) -> dict[str, list[Indices]]:
    """Sets of cells by name, for each block: those of the file, and physical groups that meshio leaves as numbers."""
    sets = {
        name: [np.asarray(part, dtype=np.int64) for part in parts]
        for name, parts in mesh.cell_sets.items()
        if not name.startswith("gmsh:")
    }
    groups = mesh.cell_data.get("gmsh:physical", [])
    for name, (number, _) in mesh.field_data.items():
        if name not in sets and groups:
            sets[name] = [np.flatnonzero(np.asarray(part) == number) for part in groups]
    return sets


def _collect_sets(mesh: Any, by_cell: Mapping[str, list[Indices]]) -> dict[str, Indices]:
    """Sets of nodes by name: those of the file, and the nodes of its sets of cells."""
    sets = {name: np.unique(nodes).astype(np.int64) for name, nodes in mesh.point_sets.items()}
    for name, parts in by_cell.items():
        touched = [mesh.cells[k].data[part].ravel() for k, part in enumerate(parts) if len(part)]
        if name not in sets and touched:
            sets[name] = np.unique(np.concatenate(touched)).astype(np.int64)
    return sets


def _split_block(
    block: Any, number: int, by_cell: Mapping[str, list[Indices]]
) -> list[tuple[str, Indices, tuple[str, ...]]]:
    """The cells of a block in groups that are in the same sets."""
    member = np.zeros((len(block.data), len(by_cell)), dtype=bool)
    for column, parts in enumerate(by_cell.values()):
        member[parts[number], column] = True
    patterns, group = np.unique(member, axis=0, return_inverse=True)
    names = list(by_cell)
    return [
        (
            block.type,
            np.asarray(block.data[group.ravel() == k], dtype=np.int64),
            tuple(names[j] for j in np.flatnonzero(pattern)),
        )
        for k, pattern in enumerate(patterns)
    ]


def read_data(path: Path, expected: str) -> bytes:
    """Return the bytes of a file.  Raises InputError for what is no regular file, and for more than `LARGEST_MESH`."""
    try:
        data = read_regular(path, LARGEST_MESH)
    except NotRegularFile as error:
        raise make_input_error(str(path), str(error), expected, "the path of a file that is there") from None
    if len(data) > LARGEST_MESH:
        write = "a coarser mesh: modes of a link need no fine one"
        raise make_input_error(str(path), f"more than {LARGEST_MESH} bytes", f"at most {LARGEST_MESH} bytes", write)
    return data


def _parse_mesh(path: Path, data: bytes, expected: str) -> Any:
    """The mesh as meshio has it; what it prints is kept back, and what it raises becomes one error."""
    import meshio

    kind = FORMATS[path.suffix.lower()]
    source: Path | io.StringIO = path
    if kind == "nastran":
        check_grids(path, data.decode("utf-8", errors="replace"))
    if kind == "nastran" and BULK not in data.upper():  # bulk data alone, as gmsh writes and other files include
        source = io.StringIO(f"{BULK.decode()}\n{data.decode('utf-8', errors='replace')}")
    printed = io.StringIO()
    try:
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
            return meshio.read(source, file_format=kind)
    except (Exception, SystemExit) as error:  # meshio raises what its parsers meet: of a file nothing else is known
        said = str(error) or printed.getvalue().strip() or type(error).__name__
        given = f"a file that meshio does not understand ({said[:200]})"
        raise make_input_error(
            str(path), given, expected, "a whole file of that kind, as your program exports it"
        ) from None
