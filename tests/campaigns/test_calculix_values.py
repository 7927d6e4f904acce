"""Blocks in CalculiX from the same input file: where its command is installed."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from campaigns.calculix_values import KINDS, LIMIT, compute_values, list_gaps, run_calculix, write_block

needs_ccx = pytest.mark.skipif(shutil.which("ccx") is None, reason="there is no command ccx (Debian: calculix-ccx)")


@needs_ccx
@pytest.mark.parametrize("kind", ["hexahedron", "hexahedron20"])
def test_bricks_are_calculixs(tmp_path: Path, kind: str) -> None:
    file = tmp_path / "part.inp"
    write_block(file, kind, KINDS[kind][0], (4, 1, 1))
    for what, off in list_gaps(compute_values(file), run_calculix(file)):
        assert off < LIMIT, what


@needs_ccx
def test_calculix_has_fewer_points_for_the_mass_of_tetrahedra(tmp_path: Path) -> None:
    """Stiffness is the same, frequencies are not, and are with its rule."""
    file = tmp_path / "part.inp"
    write_block(file, "tetra10", "C3D10", (3, 1, 1))
    theirs = run_calculix(file)
    (_, free), _, (_, way) = list_gaps(compute_values(file), theirs)
    assert way < LIMIT < free
    assert all(off < LIMIT for _, off in list_gaps(compute_values(file, fewer=True), theirs))


def test_the_written_block_is_read_back(tmp_path: Path) -> None:
    """Frequencies do not depend on the number of nodes in a row of the file, and a held end is slower than a free part."""
    file = tmp_path / "part.inp"
    write_block(file, "hexahedron20", "C3D20", (2, 1, 1))
    found = compute_values(file)
    assert found.held[0] < 0.5 * found.free[0]
    assert (np.diff(found.free) >= -1e-6 * found.free[1:]).all()
    assert found.way > 0.0
