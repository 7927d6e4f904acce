"""Read every mesh in folders of real files: ``python campaigns/mesh_files.py FOLDER...``.

A file is read, with its cells' volume and its sets, or refused by one error in words.  Anything else, a traceback or a volume
that is not above zero, ends the campaign with 1.  Real files: Debian's calculix-ccx-test (unpack its .inp.gz), exports of gmsh
in all of its formats, and those of meshio and scikit-fem.
"""

from __future__ import annotations

import warnings
from collections import Counter
from pathlib import Path

import click
import numpy as np

from flexinv.errors import InputError
from flexinv.files.meshes.mesh_files import FORMATS, FileMesh, read_mesh_file
from flexinv.parts.solid_elements import build_rules


@click.command()
@click.argument("folders", nargs=-1, required=True, type=click.Path(exists=True, file_okay=False, path_type=Path))
def main(folders: tuple[Path, ...]) -> None:
    """Read all files of meshes in FOLDERS and say what came of each."""
    refused: Counter[str] = Counter()
    read: Counter[str] = Counter()
    wrong = 0
    files = sorted(file for folder in folders for file in folder.iterdir() if file.suffix.lower() in FORMATS)
    for file in files:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                mesh = read_mesh_file(file)
        except InputError as error:
            refused[next(line for line in str(error).splitlines() if "given:" in line).split("given:")[1].strip()] += 1
            continue
        volume = compute_volume(mesh)
        read[file.suffix.lower()] += 1
        wrong += not volume > 0.0
        kinds = Counter({kind: 0 for kind, *_ in mesh.cells})
        for kind, cells, _ in mesh.cells:
            kinds[kind] += len(cells)
        counts = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
        click.echo(f"{file.name:28} volume {volume:12.6g}  {len(mesh.points)} points, {counts}, {len(mesh.sets)} sets")
    for given, count in refused.most_common():
        click.echo(f"{count:4} refused: {given}")
    click.echo(f"{sum(read.values())} read ({dict(read)}), {sum(refused.values())} refused, {wrong} without a volume")
    raise SystemExit(1 if wrong else 0)


def compute_volume(mesh: FileMesh) -> float:
    """Return the volume of the solid cells [unit^3]."""
    total = 0.0
    for kind, cells, _ in mesh.cells:
        rule = build_rules(kind)[0]
        for slope, weight in zip(rule.slope, rule.weight, strict=True):
            total += weight * float(np.linalg.det(slope.T @ mesh.points[cells]).sum())
    return total


if __name__ == "__main__":
    main()
