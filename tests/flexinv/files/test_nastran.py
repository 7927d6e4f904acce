"""GRID cards of Nastran's bulk data, in free, fixed and wide form: other axes and numbers that are there twice."""

from __future__ import annotations

from pathlib import Path

import pytest

from flexinv.errors import InputError
from flexinv.files.meshes.nastran import check_grids

FREE = "$ GRID,1,7\nGRID,1,,0.,0.,0.\nGRID,2,0,1.,0.,0.\n"
FIXED = "GRID           1              0.      0.      0.\nGRID           2       0      1.      0.      0.\n"
WIDE = "GRID*                  1                              0.              0.\n*                     0.\n"


@pytest.mark.parametrize("text", [FREE, FIXED, WIDE, "GRDSET,,,,,,,6\n" + FREE, FREE.lower()])
def test_nodes_in_the_basic_system_pass(text: str) -> None:
    check_grids(Path("a.bdf"), text)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (FREE.replace("GRID,2,0", "GRID,2,7"), 3),
        (FIXED.replace("2       0", "2       7"), 2),
        (WIDE.replace("1                ", "1               7", 1), 1),
        ("GRDSET,,7\n" + FREE, 1),
    ],
)
def test_other_axes_are_refused(text: str, line: int) -> None:
    with pytest.raises(InputError, match=rf"a.bdf, line {line}, (?s:.*)CP = 7(?s:.*)basic system"):
        check_grids(Path("a.bdf"), text)


@pytest.mark.parametrize(
    "text", [FREE.replace("GRID,2", "GRID,1"), FIXED.replace("       2       0", "       1       0")]
)
def test_a_number_that_is_there_twice_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"GRID 1(?s:.*)has already(?s:.*)each node once"):
        check_grids(Path("a.bdf"), text)
