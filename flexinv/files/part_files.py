"""Read meshes of parts by meshio, and their matrices: Matrix Market, Abaqus's coordinate format, NumPy's archives.

meshio is imported here alone, and late: who has no meshed link never waits for it.
"""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.files.regular_files import NotRegularFile, read_regular
from flexinv.files.toml_tables import make_input_error
from flexinv.model.part import CELL_KINDS, SparseMatrix
from flexinv.typing import Array, Indices

LARGEST_MESH = 1 << 29  # bytes: some 5e6 nodes as text, far beyond what is factored here
FORMATS = {
    ".inp": "abaqus", ".msh": "gmsh", ".vtu": "vtu", ".vtk": "vtk", ".bdf": "nastran", ".nas": "nastran", ".fem": "nastran",
}  # fmt: skip
MATRIX_FORMATS = (".mtx", ".npz")
# Cells of surfaces, lines and points: of them sets are taken, they carry nothing.
BOUNDARIES = ("triangle", "quad", "line", "vertex")
# Letters at the end of Abaqus's solid elements that are read as another formulation, and what differs.
READ_AS = {
    "R": "reduced integration, linear ones with hourglass control: here all points",
    "I": "incompatible modes: here none, so that it is stiffer in bending",
    "M": "a modified formulation: here the plain quadratic one",
    "H": "pressure as an unknown: here displacements alone",
}
ABAQUS_SOLIDS = ("C3D4", "C3D6", "C3D8", "C3D10", "C3D20")


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
    expected = f"a mesh of a kind that meshio reads here: {', '.join(FORMATS)}"
    if path.suffix.lower() not in FORMATS:
        write = "the export of your program as one of these"
        raise make_input_error(str(path), f"a file that ends in {path.suffix!r}", expected, write)
    data = _read_data(path, expected)
    notes = _check_abaqus(path, data) if path.suffix.lower() == ".inp" else ()
    mesh = _parse_mesh(path, expected)
    by_cell = {name: [np.asarray(part, dtype=np.int64) for part in parts] for name, parts in mesh.cell_sets.items()}
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


def _read_data(path: Path, expected: str) -> bytes:
    try:
        data = read_regular(path, LARGEST_MESH)
    except NotRegularFile as error:
        raise make_input_error(str(path), str(error), expected, "the path of a file that is there") from None
    if len(data) > LARGEST_MESH:
        write = "a coarser mesh: modes of a link need no fine one"
        raise make_input_error(str(path), f"more than {LARGEST_MESH} bytes", f"at most {LARGEST_MESH} bytes", write)
    return data


def _parse_mesh(path: Path, expected: str) -> Any:
    """The mesh as meshio has it; what it prints is kept back, and what it raises becomes one error."""
    import meshio

    printed = io.StringIO()
    try:
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
            return meshio.read(path, file_format=FORMATS[path.suffix.lower()])
    except (Exception, SystemExit) as error:  # meshio raises what its parsers meet: of a file nothing else is known
        said = str(error) or printed.getvalue().strip() or type(error).__name__
        given = f"a file that meshio does not understand ({said[:200]})"
        raise make_input_error(
            str(path), given, expected, "a whole file of that kind, as your program exports it"
        ) from None


def _check_abaqus(path: Path, data: bytes) -> tuple[str, ...]:
    """Refuse elements and cards of Abaqus that would be read as something else, and say which are read otherwise."""
    text = data.decode("utf-8", errors="replace").upper()
    notes = []
    for kind in dict.fromkeys(re.findall(r"^\*ELEMENT\b[^\n]*\bTYPE\s*=\s*([A-Z0-9]+)", text, re.MULTILINE)):
        plain = kind.rstrip("".join(READ_AS))
        if plain not in ABAQUS_SOLIDS:
            expected = f"solid elements: {', '.join(ABAQUS_SOLIDS)}"
            raise make_input_error(str(path), f"*ELEMENT, TYPE={kind}", expected, "a mesh of these")
        notes += [f"{path.name}: {kind} has {READ_AS[letter]}" for letter in kind.removeprefix(plain)]
    for card in ("PART", "INSTANCE"):
        if (count := len(re.findall(rf"^\*{card}\b", text, re.MULTILINE))) > 1:
            given = f"{count} cards *{card}"
            write = "one file for each part: a link is one"
            raise make_input_error(str(path), given, "one part, nodes in its own axes", write)
    for card in ("NGEN", "ELGEN", "NFILL", "SYSTEM", "NCOPY"):
        if re.search(rf"^\*{card}\b", text, re.MULTILINE):
            write = "the flat export of nodes and elements"
            raise make_input_error(str(path), f"a card *{card}", "nodes and elements as lists", write)
    return tuple(notes)


def read_matrix_file(path: Path, name: str) -> SparseMatrix:
    """Return a square matrix [unit of the file]: Matrix Market, Abaqus's *MATRIX GENERATE, or an .npz.

    name : of the array in an .npz that holds several
    """
    expected = (
        f"a square matrix as {' or '.join(MATRIX_FORMATS)}: Matrix Market, rows of Abaqus's coordinate format, NumPy's"
    )
    if path.suffix.lower() not in MATRIX_FORMATS:
        raise make_input_error(str(path), f"a file that ends in {path.suffix!r}", expected, f'{name} = "{name}.mtx"')
    data = _read_data(path, expected)
    try:
        found = _parse_archive(data, name) if path.suffix.lower() == ".npz" else _parse_entries(data)
    except (ValueError, KeyError, OSError, IndexError) as error:
        said = f"a file that holds none ({str(error)[:200]})"
        raise make_input_error(str(path), said, expected, "the whole export of the matrix") from None
    matrix = scipy.sparse.coo_array(found)
    if matrix.shape[0] != matrix.shape[1] or not np.isfinite(matrix.data).all():
        raise make_input_error(str(path), f"a matrix {matrix.shape}", expected, "a square matrix of finite numbers")
    return SparseMatrix(matrix.shape[0], matrix.row, matrix.col, matrix.data)


def _parse_archive(data: bytes, name: str) -> Any:
    """A sparse matrix of `scipy.sparse.save_npz`, or the dense or sparse array of a name in an archive of several."""
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        if "format" in archive.files:
            return scipy.sparse.load_npz(io.BytesIO(data))
        return archive[name if name in archive.files else archive.files[0]]


def _parse_entries(data: bytes) -> Any:
    """Matrix Market, or rows of Abaqus: row, column, value, or node, freedom, node, freedom, value; half of it or all."""
    if data.lstrip().startswith(b"%%MatrixMarket"):
        return scipy.io.mmread(io.BytesIO(data), spmatrix=False)
    rows = np.loadtxt(io.StringIO(data.decode("utf-8").replace(",", " ")), ndmin=2)
    if rows.shape[1] not in (3, 5):
        raise ValueError(f"{rows.shape[1]} numbers in a row, expected 3 or 5")
    whole = rows[:, :-1].astype(np.int64)
    if (whole != rows[:, :-1]).any() or whole.min() < 1:
        raise ValueError("numbers of rows and columns that are not 1, 2, ...")
    if whole.shape[1] == 4:
        if whole[:, [1, 3]].max() > 3:
            raise ValueError("freedoms beyond 3: shells and beams have rotations, which solids have not")
        whole = 3 * (whole[:, [0, 2]] - 1) + whole[:, [1, 3]]
    size = int(whole.max())
    places = whole[:, 0] - 1, whole[:, 1] - 1
    matrix = scipy.sparse.coo_array((rows[:, -1], places), shape=(size, size)).tocsr()
    lower, upper = (part(matrix, k).nnz for part, k in ((scipy.sparse.tril, -1), (scipy.sparse.triu, 1)))
    if (lower == 0) != (upper == 0):  # one half stands for both
        matrix = matrix + matrix.T - scipy.sparse.diags_array(matrix.diagonal())
    return matrix
