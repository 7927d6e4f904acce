"""Own values of meshed parts against Abaqus's exported matrices: python campaigns/part_values.py FOLDER.

FOLDER holds the files of ``main/pythonDev/TestModels/testData`` of github.com/jgerstmayr/EXUDYN (blocks of C3D4, C3D8, C3D10 and
C3D20 in ``abaqus``, the rotor beside), for example of commit e44aca1.  They are Exudyn's and are not copied.  Exit 1 where a
value is missed.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import click
import numpy as np
import scipy

from flexinv.files.meshes.matrix_files import read_matrix_file
from flexinv.files.meshes.mesh_files import read_mesh_file
from flexinv.model.part import Cells, Material, MeshedPart, PartInterface, SparseMatrix
from flexinv.parts.craig_bampton import compute_reduction
from flexinv.parts.part_matrices import build_part_matrices
from flexinv.parts.solid_elements import assemble_cells
from flexinv.typing import Array, Sparse

STEEL = Material.build_isotropic(2e11, 0.3, 2900.0)  # of the blocks, as their input files state it
# Largest parts by which matrices, frequencies and deflections may be off: printed digits.
LIMIT = 1e-6
# Frequencies [Hz], free and with the face x = 0 held, and the mean deflection [mm] at x = 4 m under 1 MN along z; by dense SciPy
# from the exported matrices, or from our own where Abaqus lumps the mass of linear elements.
BLOCKS: dict[str, tuple[list[float], list[float], float]] = {
    "C3D4": ([489.296, 489.855, 697.543], [], 0.0),
    "C3D8": ([438.775, 438.775, 555.888, 967.040], [81.868, 81.868, 279.749], 1.275402),
    "C3D10": ([451.333, 452.010, 607.870, 1026.459], [81.882, 81.946, 304.963], 1.295949),
    "C3D20": ([449.764, 449.764, 595.757, 1011.616], [81.767, 81.767, 300.745, 415.217], 1.300128),
}
OWN = ("C3D4", "C3D10", "C3D20")  # of the same formulation
ROTOR = [1046.370, 1046.370, 1878.241, 2123.297, 2245.521, 2386.879, 2842.047, 2842.047]
ROTOR_LOCKED = [647.51, 1016.31, 1016.31, 1768.97, 1768.97]
Row = tuple[str, float, float]  # what, how far it is off, how far it may be


@click.command()
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
def main(folder: Path) -> None:
    """Print every comparison and how far it is off [-]."""
    missed = 0
    for what, off, limit in compare_all(folder):
        missed += off > limit
        click.echo(f"{'ok    ' if off <= limit else 'MISSED'} {what:52} off by {off:.1e}, limit {limit:.0e}")
    sys.exit(1 if missed else 0)


def compare_all(folder: Path) -> Iterator[Row]:
    """Yield the rows of all blocks and of the rotor [-]."""
    for kind, (free, held, deflection) in BLOCKS.items():
        part, given = read_block(folder / "abaqus", kind)
        if kind in OWN:
            yield from compare_matrices(kind, part, given)
        yield from compare_values(kind, given if kind != "C3D4" else replace(part, lumped=True), free, held, deflection)
    yield from compare_rotor(folder)


def read_block(folder: Path, kind: str) -> tuple[MeshedPart, MeshedPart]:
    """Return a block with its cells, and with the exported matrices [kg], [N/m]."""
    mesh = read_mesh_file(folder / f"block{kind}.inp")
    cells = tuple(Cells(one, nodes, STEEL) for one, nodes, _ in mesh.cells)
    part = make_part(mesh.points, cells, 0)
    mass, stiffness = (read_matrix_file(folder / f"block{kind}_{name}1.mtx", name) for name in ("MASS", "STIF"))
    return part, replace(part, cells=(), mass=mass, stiffness=stiffness)


def make_part(points: Array, cells: tuple[Cells, ...], axis: int, **data: SparseMatrix) -> MeshedPart:
    """Return a part [m] with its two ends along an axis as interfaces."""
    along = points[:, axis]
    ends = [np.flatnonzero(np.abs(along - x) < 1e-9) for x in (along.min(), along.max())]
    names = ("first", "last")
    both = tuple(PartInterface(name, at, points[at].mean(axis=0)) for name, at in zip(names, ends, strict=True))
    return MeshedPart(points, cells, both, "first", "last", **data)


def compare_matrices(kind: str, part: MeshedPart, given: MeshedPart) -> Iterator[Row]:
    """Yield how far our matrices are off the exported ones, over their largest entries [-]."""
    own = assemble_cells(part)
    theirs = build_part_matrices(given)
    yield f"{kind}: stiffness", float(abs(own.stiffness - theirs.stiffness).max() / abs(theirs.stiffness).max()), LIMIT
    if kind != "C3D4":
        yield f"{kind}: mass", float(abs(own.mass - theirs.mass).max() / abs(theirs.mass).max()), LIMIT
        return
    lumped = assemble_cells(replace(part, lumped=True)).mass
    yield f"{kind}: mass, lumped as Abaqus does", float(abs(lumped - theirs.mass).max() / abs(theirs.mass).max()), LIMIT


def compare_values(
    kind: str, part: MeshedPart, free: list[float], held: list[float], deflection: float
) -> Iterator[Row]:
    """Yield frequencies and a deflection against their values [-]; the last digit of these is what may be off."""
    found = build_part_matrices(part)
    whole = scipy.sparse.kron(found.mass, scipy.sparse.eye_array(3)).toarray()
    stiffness = found.stiffness.toarray()
    yield f"{kind}: free", compare(find_frequencies(stiffness, whole, 6 + len(free))[6:], free), 2e-6
    if not held:
        return
    rows = (3 * part.interfaces[0].nodes[:, None] + np.arange(3)).ravel()
    moving = np.setdiff1d(np.arange(len(stiffness)), rows)
    inner = stiffness[np.ix_(moving, moving)]
    yield f"{kind}: held", compare(find_frequencies(inner, whole[np.ix_(moving, moving)], len(held)), held), 1e-5
    force = np.zeros(len(stiffness))
    end = 3 * part.interfaces[1].nodes + 2
    force[end] = 1e6 / len(end)
    moved = np.zeros(len(stiffness))
    moved[moving] = np.linalg.solve(inner, force[moving])
    yield f"{kind}: deflection", abs(1e3 * moved[end].mean() / deflection - 1.0), LIMIT


def find_frequencies(stiffness: Array, mass: Array, count: int) -> Array:
    """Return the lowest frequencies [Hz]."""
    squared = scipy.linalg.eigh(stiffness, mass, eigvals_only=True, subset_by_index=(0, count - 1))
    return np.asarray(np.sqrt(np.abs(squared)) / (2 * np.pi))


def compare(found: Array, expected: list[float]) -> float:
    """Return the largest relative difference [-]."""
    return float(np.abs(np.asarray(found) / expected - 1.0).max())


def compare_rotor(folder: Path) -> Iterator[Row]:
    """Yield the rotor's mass, free frequencies, and those of a Craig-Bampton basis with its ends locked [-]."""
    mesh = read_mesh_file(folder / "rotorDiscTest.inp")
    mass, stiffness = (read_matrix_file(folder / f"rotorDiscTest{name}1.mtx", name) for name in ("MASS", "STIF"))
    part = make_part(mesh.points, (), int(np.ptp(mesh.points, axis=0).argmax()), mass=mass, stiffness=stiffness)
    found = build_part_matrices(part)
    yield "rotor: mass", abs(float(found.mass.sum()) / 77.96605 - 1.0), LIMIT
    whole: Sparse = scipy.sparse.kron(found.mass, scipy.sparse.eye_array(3))
    free = find_frequencies(found.stiffness.toarray(), whole.toarray(), 14)[6:]
    yield "rotor: free", compare(free, ROTOR), 2e-6
    reduced = compute_reduction(part)
    yield "rotor: ends locked, in a Craig-Bampton basis", compare(reduced.fixed[:5], ROTOR_LOCKED), 1e-5


if __name__ == "__main__":
    main()
