"""Meshed links in a case kit: points, matrices, cells and interfaces as a NumPy archive, its nodes as a table.

A program needs the matrices alone: mass and stiffness of the free mesh, by the three coordinates of all points in turn, and
which points each interface ties to its frame.  Cells and materials are for those that stiffen, or assemble for themselves.
"""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np
import scipy  # its parts are loaded when they are asked for

from crosscheck.kit.tables import CellsData, InterfaceData, PartData, Tie
from flexinv.errors import InputError
from flexinv.model.mechanism import Mechanism
from flexinv.model.part import Cells, Material, MeshedPart, PartInterface, SparseMatrix
from flexinv.parts.part_matrices import build_part_matrices

FOLDER = "parts"
LARGEST = 1 << 30  # [byte] of an archive that is read
MATRICES = ("mass", "stiffness")
ENTRIES = ("row", "column", "value")
Arrays = dict[str, np.ndarray[Any, Any]]


def make_archive_name(number: int) -> str:
    """Return the place of the archive [-] of the link with this number, from the folder of ``case.json``."""
    return f"{FOLDER}/part_{number + 1}.npz"


def collect_arrays(part: MeshedPart) -> Arrays:
    """Return points (n, 3) [m], both matrices by entries [kg], [N/m], cells and interfaces by numbers of points [-]."""
    found = build_part_matrices(part)
    spread = (3 * found.used[:, None] + np.arange(3)).ravel()
    whole = {"mass": scipy.sparse.kron(found.mass, scipy.sparse.eye_array(3)), "stiffness": found.stiffness}
    arrays: Arrays = {"points": np.asarray(part.points)}
    for name, matrix in whole.items():
        entries = scipy.sparse.coo_array(matrix)
        arrays[f"{name}_row"] = spread[entries.row]
        arrays[f"{name}_column"] = spread[entries.col]
        arrays[f"{name}_value"] = entries.data
    arrays |= {f"cells_{k + 1}": cells.nodes for k, cells in enumerate(part.cells)}
    return arrays | {f"interface_{k + 1}": one.nodes for k, one in enumerate(part.interfaces)}


def compute_digest(arrays: Mapping[str, np.ndarray[Any, Any]]) -> str:
    """Return the digest of an archive's arrays [-]: names, shapes and little-endian bytes."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        plain = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {plain.shape}".encode())
        digest.update(plain.astype(plain.dtype.newbyteorder("<")).tobytes())
    return digest.hexdigest()[:16]


def convert_part(part: MeshedPart, archive: str) -> PartData:
    """Return the table of a part in ``case.json`` [m], [Pa], [kg/m^3], [s]; archive : the place of its arrays."""
    return PartData(
        arrays=archive,
        digest=compute_digest(collect_arrays(part)),
        interfaces=[
            InterfaceData(name=one.name, origin=[float(x) for x in one.origin], tie=cast(Tie, one.tie))
            for one in part.interfaces
        ],
        root=part.root,
        tip=part.tip,
        cells=[
            CellsData(
                kind=cells.kind,
                stiffness=cells.material.stiffness.tolist(),
                density=cells.material.density,
                name=cells.name,
            )
            for cells in part.cells
        ],
        modes=part.modes,
        frequency=part.frequency,
        retardation=part.retardation,
        drag=part.drag,
        stiffening=part.stiffening and bool(part.cells),
        lumped=part.lumped,
    )


def write_parts(mechanism: Mechanism, folder: Path) -> dict[str, str]:
    """Write the archive and the table of nodes of every meshed link; return the files with their content.  Raises OSError."""
    files = {}
    for number, link in enumerate(mechanism.links):
        if link.part is None:
            continue
        archive = make_archive_name(number)
        table = archive.replace(".npz", "_nodes.csv")
        (folder / FOLDER).mkdir(exist_ok=True)
        np.savez(folder / archive, **collect_arrays(link.part))  # type: ignore[arg-type]  # stubs take keywords for options
        _write_nodes(link.part, folder / table)
        files[archive] = (
            f"the mesh of {link.name}: `points` [m] in the link frame, `mass` [kg] and `stiffness` [N/m] of the free part as "
            "`_row`, `_column`, `_value` by the three coordinates of all points in turn, `cells_K` and `interface_K` by numbers "
            "of points from 0 in the order of `case.json`"
        )
        files[table] = f"the nodes of {link.name} once more, a row each, with the interface that ties them"
    return files


def _write_nodes(part: MeshedPart, file: Path) -> None:
    owner = {int(node): one.name for one in part.interfaces for node in one.nodes}
    rows = [
        f"{k},{x!r},{y!r},{z!r},{_format_cell(owner.get(k, ''))}" for k, (x, y, z) in enumerate(part.points.tolist())
    ]
    file.write_text("\n".join(["node,x [m],y [m],z [m],interface", *rows]) + "\n", encoding="utf-8")


def _format_cell(text: str) -> str:
    return f'"{text.replace(chr(34), 2 * chr(34))}"' if set(text) & set(',"\n') else text


def read_part(data: PartData, folder: Path) -> MeshedPart:
    """Return the part [m, kg, N/m] that ``case.json`` in a folder tells of.

    Raises InputError for an archive that is not there, is none, is not the one of this case, or holds no such part.
    """
    file = folder / data.arrays
    if not file.resolve().is_relative_to(folder.resolve()):
        raise InputError(f"{file}: leads out of the folder of case.json; expected a file in it: write the kit again")
    arrays = _read_archive(file)
    if compute_digest(arrays) != data.digest:
        raise InputError(f"{file}: not the arrays of this case.json; expected its own: write the kit again")
    missing = [name for name in _list_names(data) if name not in arrays]
    if missing:
        raise InputError(
            f"{file}: no array {missing[0]!r}; expected {', '.join(_list_names(data))}; write the kit again"
        )
    cells = tuple(
        Cells(one.kind, arrays[f"cells_{k + 1}"], Material(np.array(one.stiffness), one.density), one.name)
        for k, one in enumerate(data.cells)
    )
    interfaces = tuple(
        PartInterface(one.name, arrays[f"interface_{k + 1}"], np.array(one.origin), one.tie)
        for k, one in enumerate(data.interfaces)
    )
    size = 3 * len(arrays["points"])
    matrices = {} if cells else {name: _build_matrix(size, name, arrays) for name in MATRICES}
    return MeshedPart(
        arrays["points"], cells, interfaces, data.root, data.tip,
        modes=data.modes, frequency=data.frequency, retardation=data.retardation, drag=data.drag,
        lumped=data.lumped, stiffening=data.stiffening, source=str(file),
        mass=matrices.get("mass"), stiffness=matrices.get("stiffness"),
    )  # fmt: skip


def _build_matrix(size: int, name: str, arrays: Arrays) -> SparseMatrix:
    return SparseMatrix(size, *(arrays[f"{name}_{entry}"] for entry in ENTRIES))


def _list_names(data: PartData) -> list[str]:
    matrices = [f"{name}_{entry}" for name in MATRICES for entry in ENTRIES]
    cells = [f"cells_{k + 1}" for k in range(len(data.cells))]
    return ["points", *matrices, *cells, *(f"interface_{k + 1}" for k in range(len(data.interfaces)))]


def _read_archive(file: Path) -> Arrays:
    """The arrays of an archive; nothing in it is executed."""
    try:
        with zipfile.ZipFile(file) as packed:
            size = sum(one.file_size for one in packed.infolist())
        if size > LARGEST:
            raise InputError(f"{file}: {size / 2**20:.0f} MB of arrays; expected at most {LARGEST >> 20} MB")
        with np.load(file, allow_pickle=False) as held:
            return dict(held)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        given = f"{file}: {error}"
        raise InputError(f"{given}; expected the archive that crosscheck kit writes beside case.json") from None
