"""Own values of meshed blocks against CalculiX's from the same input file: ``python campaigns/calculix_values.py``.

Needs CalculiX's command ``ccx`` (Debian: calculix-ccx).  Blocks of 4 x 1 x 1 m of steel, one for each kind of element, are
written as .inp, read by flexinv and computed by both programs: frequencies of the free part and with one end held, and the way
of the other end under a force.  Exit 1 where elements of the same formulation differ by more than `LIMIT`.

CalculiX 2.20 integrates the mass of C3D4 at one point and of C3D10 at four, as their stiffness, which is not exact: frequencies
then differ by up to 7 and 0.8 %.  flexinv's masses are exact (and Abaqus's: ``campaigns/part_values.py``); with CalculiX's rule
in their place both programs agree, which this campaign shows.  C3D6 has two points there: another formulation.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
import scipy

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "shared"))

from part_examples import make_block

from flexinv.files.meshes.mesh_files import FileMesh, read_mesh_file
from flexinv.model.part import Cells, Material, MeshedPart, PartInterface
from flexinv.parts.part_matrices import build_part_matrices
from flexinv.parts.solid_elements import build_rules
from flexinv.typing import Array

STEEL = {"young": 2.1e11, "poisson": 0.3, "density": 7850.0}
SIZE = (4.0, 1.0, 1.0)  # [m]
FORCE = 1e6  # [N] along z, spread evenly over the nodes of the far end
COUNTED = 6  # frequencies that are compared, beside six that are zero
# Elements, CalculiX's name, cells along, across, up.
KINDS = {
    "tetra": ("C3D4", (8, 2, 2)),
    "tetra10": ("C3D10", (4, 1, 1)),
    "hexahedron": ("C3D8", (8, 2, 2)),
    "hexahedron20": ("C3D20", (6, 2, 2)),
    "wedge": ("C3D6", (8, 2, 2)),
}
FEWER_POINTS = ("tetra", "tetra10")  # whose mass CalculiX integrates by the rule for stiffness
OTHER = ("wedge",)  # of another formulation
# CalculiX prints seven digits of frequencies and six of displacements, and iterates to 1e-6 or so.
LIMIT = 1e-4
SHIFT = 1e6  # [1/s^2] of the size of the slowest omega^2


@dataclass(frozen=True)
class Values:
    """Frequencies of the free part and of the held one [Hz], mean way of the far end along the force [m]."""

    free: Array
    held: Array
    way: float


@click.command()
def main() -> None:
    """Print frequencies and deflections of both programs, and how far they are apart."""
    if shutil.which("ccx") is None:
        raise click.ClickException("there is no command ccx; on Debian: apt install calculix-ccx")
    missed = 0
    for kind, (name, count) in KINDS.items():
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "part.inp"
            write_block(file, kind, name, count)
            theirs = run_calculix(file)
            exact = list_gaps(compute_values(file), theirs)
            alike = list_gaps(compute_values(file, fewer=True), theirs) if kind in FEWER_POINTS else exact
        for (what, off), (_, known) in zip(exact, alike, strict=True):
            missed += kind not in OTHER and not known <= LIMIT
            word = "other " if kind in OTHER else "ok    " if known <= LIMIT else "MISSED"
            rule = f", {known:.1e} with its rule for mass" if kind in FEWER_POINTS else ""
            click.echo(f"{word} {name:6} {what:28} apart by {off:.1e}{rule}")
    raise SystemExit(1 if missed else 0)


def list_gaps(one: Values, other: Values) -> list[tuple[str, float]]:
    """Return by how much values are apart, over their size [-]."""
    return [
        ("free frequencies", float(np.abs(one.free / other.free - 1.0).max())),
        ("frequencies held at one end", float(np.abs(one.held / other.held - 1.0).max())),
        ("way under a force", abs(one.way / other.way - 1.0)),
    ]


def write_block(file: Path, kind: str, name: str, count: tuple[int, int, int]) -> None:
    """Write nodes, elements and both ends as sets [m]."""
    points, cells = make_block(kind, SIZE, count)
    lines = ["*NODE, NSET=ALL", *(f"{k + 1}, " + ", ".join(f"{x:.17g}" for x in p) for k, p in enumerate(points))]
    lines.append(f"*ELEMENT, TYPE={name}, ELSET=BODY")
    for k, cell in enumerate(cells):
        numbers = [k + 1, *(cell + 1).tolist()]
        rows = [numbers[first : first + 16] for first in range(0, len(numbers), 16)]
        lines += [", ".join(map(str, row)) + ("," if row is not rows[-1] else "") for row in rows]
    for end, x in (("HUB", 0.0), ("TIP", SIZE[0])):
        nodes = np.flatnonzero(np.abs(points[:, 0] - x) < 1e-9) + 1
        lines += [f"*NSET, NSET={end}", *(f"{node}," for node in nodes)]
    file.write_text("\n".join(lines) + "\n")


def compute_values(file: Path, fewer: bool = False) -> Values:
    """Return flexinv's values [Hz], [m] of the mesh in a file; ``fewer`` : with mass by the rule for stiffness."""
    mesh = read_mesh_file(file)
    steel = Material.build_isotropic(*STEEL.values())
    cells = tuple(Cells(kind, nodes, steel) for kind, nodes, _ in mesh.cells)
    ends = [mesh.sets[name] for name in ("HUB", "TIP")]
    both = tuple(
        PartInterface(name, nodes, mesh.points[nodes].mean(axis=0))
        for name, nodes in zip(("hub", "tip"), ends, strict=True)
    )
    found = build_part_matrices(MeshedPart(mesh.points, cells, both, "hub", "tip"))
    stiffness = found.stiffness.toarray()
    alone = compute_mass_by_few(mesh) if fewer else found.mass.toarray()
    mass = np.kron(alone, np.eye(3))
    whole = find_slowest(stiffness, mass, 6 + COUNTED)[6:]
    rows = np.setdiff1d(np.arange(len(mass)), (3 * ends[0][:, None] + np.arange(3)).ravel())
    inner = np.ix_(rows, rows)
    held = find_slowest(stiffness[inner], mass[inner], COUNTED)
    force = np.zeros(len(mass))
    force[3 * ends[1] + 2] = FORCE / len(ends[1])
    way = np.zeros(len(mass))
    way[rows] = np.linalg.solve(stiffness[inner], force[rows])
    return Values(whole, held, float(way[3 * ends[1] + 2].mean()))


def find_slowest(stiffness: Array, mass: Array, count: int) -> Array:
    """Return the slowest frequencies [Hz] by 1 / (omega^2 + shift), as a mass by few points may be singular."""
    size = len(mass)
    last = scipy.linalg.eigh(
        mass, stiffness + SHIFT * mass, eigvals_only=True, subset_by_index=[size - count, size - 1]
    )
    return np.asarray(np.sqrt(np.maximum(1.0 / last[::-1] - SHIFT, 0.0)) / (2.0 * np.pi))


def compute_mass_by_few(mesh: FileMesh) -> Array:
    """Return the mass of a component [kg], (n, n), integrated by the rule for stiffness."""
    out = np.zeros((len(mesh.points), len(mesh.points)))
    for kind, cells, _ in mesh.cells:
        rule = build_rules(kind)[0]
        for shape, slope, weight in zip(*rule, strict=True):
            volume = weight * np.linalg.det(slope.T @ mesh.points[cells])
            for nodes, of_cell in zip(cells, volume, strict=True):
                out[np.ix_(nodes, nodes)] += STEEL["density"] * of_cell * np.outer(shape, shape)
    return out


def run_calculix(file: Path) -> Values:
    """Return CalculiX's values [Hz], [m] of the mesh in a file."""
    model = f"""*INCLUDE, INPUT={file.name}
*MATERIAL, NAME=STEEL
*ELASTIC
{STEEL["young"]}, {STEEL["poisson"]}
*DENSITY
{STEEL["density"]}
*SOLID SECTION, ELSET=BODY, MATERIAL=STEEL
"""
    held = "*BOUNDARY\nHUB, 1, 3\n"
    count = len(read_mesh_file(file).sets["TIP"])
    load = f"*STEP\n*STATIC\n*CLOAD\nTIP, 3, {FORCE / count:.17g}\n*NODE PRINT, NSET=TIP\nU\n*END STEP\n"
    modes = "*STEP\n*FREQUENCY\n{}\n*END STEP\n"
    free = _read_frequencies(_run(file, "free", model + modes.format(6 + COUNTED)))[6:]
    clamped = _read_frequencies(_run(file, "held", model + held + modes.format(COUNTED)))
    rows = _read_table(_run(file, "load", model + held + load), "displacements", 4)
    return Values(np.array(free), np.array(clamped), float(rows[:, 3].mean()))


def _run(file: Path, name: str, text: str) -> str:
    """Run a job beside the mesh and return what it prints into its .dat."""
    (file.parent / f"{name}.inp").write_text(text)
    done = subprocess.run(["ccx", name], cwd=file.parent, capture_output=True, text=True, check=False)
    data = file.parent / f"{name}.dat"
    if not data.is_file() or not data.read_text().strip():
        raise click.ClickException(f"ccx {name}: {done.stdout[-400:]}")
    return data.read_text()


def _read_frequencies(text: str) -> Sequence[float]:
    """Frequencies [Hz]: the fourth number of the rows of eigenvalues, of which the first is counted."""
    block = text.split("E I G E N V A L U E   O U T P U T")[1].split("P A R T I C I P A T I O N")[0]
    rows = re.findall(r"^\s*\d+\s+\S+\s+\S+\s+(\S+)\s+\S+\s*$", block, re.MULTILINE)
    return [float(row) for row in rows]


def _read_table(text: str, title: str, width: int) -> Array:
    rows = [line.split() for line in text.split(title)[1].splitlines()[1:]]
    return np.array([[float(x) for x in row] for row in rows if len(row) == width])


if __name__ == "__main__":
    main()
