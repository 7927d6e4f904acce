"""Read matrices of meshed parts: Matrix Market, Abaqus's coordinate format, NumPy's archives."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.files.meshes.mesh_files import read_data
from flexinv.files.toml_tables import make_input_error
from flexinv.model.part import SparseMatrix

MATRIX_FORMATS = (".mtx", ".npz")


def read_matrix_file(path: Path, name: str) -> SparseMatrix:
    """Return a square matrix [unit of the file]: Matrix Market, Abaqus's *MATRIX GENERATE, or an .npz.

    name : of the array in an .npz that holds several
    """
    expected = (
        f"a square matrix as {' or '.join(MATRIX_FORMATS)}: Matrix Market, rows of Abaqus's coordinate format, NumPy's"
    )
    if path.suffix.lower() not in MATRIX_FORMATS:
        raise make_input_error(str(path), f"a file that ends in {path.suffix!r}", expected, f'{name} = "{name}.mtx"')
    data = read_data(path, expected)
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
    if not data.strip():
        raise ValueError("it is empty")
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
