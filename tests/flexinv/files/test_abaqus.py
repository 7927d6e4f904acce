"""Abaqus's and CalculiX's input files as both read them: cards in any order and case, sets of sets, surfaces, includes."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest

from flexinv.errors import InputError
from flexinv.files.meshes.mesh_files import FileMesh, read_mesh_file

NODES = """*NODE, NSET=LOW
1, 0, 0, 0
2, 1.0D+0, , 0.
4, 0, 1
*Node, nset=high
10, 0, 0, 1,
20, 1, 0, 1
40, 0, 1, 1
3, 1, 1, 0
30, 1, 1, 1
"""
BRICK = """*ELEMENT, TYPE=C3D8
7, 1, 2, 3, 4,
10, 20, 30, 40
"""
TETS = """*ELEMENT, TYPE=C3D4, ELSET=Soft
8, 1, 2, 4, 10
"""


def read(folder: Path, text: str) -> FileMesh:
    file = folder / "part.inp"
    file.write_text(text)
    return read_mesh_file(file)


def list_nodes(mesh: FileMesh, name: str) -> list[tuple[float, ...]]:
    """Places of the nodes of a set, in order."""
    return sorted(map(tuple, mesh.points[mesh.sets[name]].tolist()))


def test_nodes_stand_in_several_cards(tmp_path: Path) -> None:
    """meshio 5.3 keeps the last card alone.  A coordinate left out is zero, an exponent may be a D, a comma may end a row."""
    mesh = read(tmp_path, NODES + BRICK)
    assert mesh.points.shape == (8, 3)
    assert list_nodes(mesh, "LOW") == [(0, 0, 0), (0, 1, 0), (1, 0, 0)]
    ((kind, cells, _),) = mesh.cells
    assert kind == "hexahedron"
    corners = mesh.points[cells[0]]
    assert np.abs(corners[4:] - corners[:4] - [0, 0, 1]).max() == 0.0


def test_a_set_of_an_element_card_is_that_cards(tmp_path: Path) -> None:
    """meshio 5.3 puts it on the first card, whose elements have no set: another material without a word."""
    mesh = read(tmp_path, NODES + BRICK + TETS)
    assert {kind: names for kind, _, names in mesh.cells} == {"hexahedron": (), "tetra": ("Soft",)}


def test_sets_are_numbers_names_and_what_is_generated(tmp_path: Path) -> None:
    sets = """*NSET, NSET=UP, GENERATE
10, 40, 10
** a comment between
*NSET, NSET=BOTH
UP, 1, low
*NSET, NSET=ROW, GENERATE
1, 2
4, 4
*ELSET, ELSET=E1
7
*ELSET, ELSET=E2
E1, 8
*NSET, NSET=OF_ELEMENTS, ELSET=Soft
*NSET,
NSET=LATE
1
*NSET, NSET=LATE
2
"""
    mesh = read(tmp_path, NODES + BRICK + TETS + sets)
    assert len(mesh.sets["UP"]) == 4
    assert len(mesh.sets["BOTH"]) == 7
    assert list_nodes(mesh, "ROW") == [(0, 0, 0), (0, 1, 0), (1, 0, 0)]
    assert list_nodes(mesh, "LATE") == [(0, 0, 0), (1, 0, 0)]
    assert len(mesh.sets["OF_ELEMENTS"]) == 4
    assert {kind: set(names) for kind, _, names in mesh.cells} == {"hexahedron": {"E1", "E2"}, "tetra": {"Soft", "E2"}}


def test_surfaces_are_the_nodes_of_their_faces(tmp_path: Path) -> None:
    """Of a brick of 20 nodes a face has eight."""
    surfaces = "*SURFACE, NAME=TOP, TYPE=ELEMENT\nE1, S2\n*SURFACE, NAME=SIDE\n7, S6\n*SURFACE, TYPE=NODE, NAME=SOME\nLOW\n3,\n"
    mesh = read(tmp_path, f"{NODES}{BRICK}*ELSET, ELSET=E1\n7\n{surfaces}")
    assert {z for *_, z in list_nodes(mesh, "TOP")} == {1.0}
    assert {x for x, *_ in list_nodes(mesh, "SIDE")} == {0.0}
    assert len(mesh.sets["SOME"]) == 4
    places = [f"{k + 1}, " + ", ".join(map(str, place)) for k, place in enumerate(make_quadratic_brick())]
    rows = ["*NODE", *places, "*ELEMENT, TYPE=C3D20", "1, " + ", ".join(map(str, range(1, 16))) + ",", "16,17,18,19,20"]
    for face in range(1, 7):
        (tmp_path / "part.inp").write_text("\n".join([*rows, "*SURFACE, NAME=F", f"1, S{face}", ""]))
        points = np.array(list_nodes(read_mesh_file(tmp_path / "part.inp"), "F"))
        assert len(points) == 8
        assert (np.ptp(points, axis=0) == 0.0).sum() == 1  # they lie in one wall


def make_quadratic_brick() -> list[list[float]]:
    corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
    edges = ["01", "12", "23", "30", "45", "56", "67", "74", "04", "15", "26", "37"]
    middles = [((np.array(corners[int(a)]) + corners[int(b)]) / 2).tolist() for a, b in edges]
    return [*corners, *middles]


def test_other_files_are_read_where_they_are_included(tmp_path: Path) -> None:
    (tmp_path / "below").mkdir()
    (tmp_path / "below" / "nodes.inp").write_text(NODES)
    assert len(read(tmp_path, f"*INCLUDE, INPUT=below/nodes.inp\n{BRICK}").points) == 8
    (tmp_path.parent / "outside.inp").write_text(NODES)
    for name in ("../outside.inp", "/etc/hostname", ""):
        with pytest.raises(InputError, match="expected: the name of a file in the folder of the mesh"):
            read(tmp_path, f"*INCLUDE, INPUT={name}\n{BRICK}")
    with pytest.raises(InputError, match="files that include one another"):
        read(tmp_path, "*INCLUDE, INPUT=part.inp\n")


def test_a_set_may_name_nodes_that_are_not_there(tmp_path: Path) -> None:
    """Ranges often do; both programs pass them over, and here a note says it."""
    mesh = read(tmp_path, f"{NODES}{BRICK}*NSET, NSET=ALL, GENERATE\n1, 50\n")
    assert len(mesh.sets["ALL"]) == 8
    assert mesh.notes == ("part.inp: set ALL names node 5, which is not there: left out",)


def test_a_file_that_ends_within_a_line_is_said(tmp_path: Path) -> None:
    """Torn there, it may lack nodes of its last set without any other sign."""
    mesh = read(tmp_path, f"{NODES}{BRICK}*NSET, NSET=A\n1, 2, 4, 1")
    assert mesh.notes == ("part.inp: the last line has no end: see whether the file is whole",)


def test_surfaces_that_gmsh_writes_are_sets(tmp_path: Path) -> None:
    """Beside the solid gmsh writes CPS and T3D elements for its groups; in other files they carry, and are refused."""
    faces = "*ELEMENT, type=CPS4, ELSET=Surface1\n1, 1, 2, 3, 4\n"
    comment = "******* E L E M E N T S *************\n"
    mesh = read(tmp_path, f"{NODES}{comment}{faces}{BRICK}*ELSET,ELSET=HUB\n1,\n")
    assert {z for *_, z in list_nodes(mesh, "HUB")} == {0.0}
    assert [kind for kind, *_ in mesh.cells] == ["hexahedron"]
    with pytest.raises(InputError, match="TYPE=CPS4"):
        read(tmp_path, f"{NODES}{faces}{BRICK}")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            f"{NODES}*NODE\n1, 5, 5, 5\n{BRICK}",
            r"line 12, \*NODE\n.*node 1 at \(5, 5, 5\), which stands at \(0.0, 0.0, 0.0\)",
        ),
        (f"{NODES}{BRICK}*ELEMENT, TYPE=C3D8\n7, 1, 2, 3, 4, 40, 30, 20, 10\n", "element 7 twice"),
        (f"{NODES}{BRICK.replace('40', '41')}", "element 7 with node 41, which is not there"),
        (f"{NODES}{BRICK.replace(', 40', '')}", "8 numbers\n.*9 for each element"),
        (f"{NODES}{BRICK}*NSET, NSET=A\nLOWER\n", "LOWER\n.*name of a set that stands before: LOW, HIGH\n.*LOW"),
        (f"{NODES}{BRICK}*NSET, NSET=A, GENERATE\n5, 1\n", "5, 1\n.*first and last number"),
        (f"{NODES}{BRICK}*NSET\n1\n", "no name"),
        (f"*NODE, SYSTEM=C\n1, 0, 0, 0\n{BRICK}", "SYSTEM=C\n.*in the part's own axes"),
        (f"*INSTANCE, NAME=A, PART=B\n1., 0., 0.\n{NODES}{BRICK}", "a part that is moved or turned"),
        (f"*NODE\n1, a, 0, 0\n{BRICK}", "line 2.*\n.*a\n.*a coordinate"),
        (f"*NODE\nx, 0, 0, 0\n{BRICK}", "line 2.*\n.*x\n.*the number of a node"),
        (f"*NODE\n1, 1e999, 0, 0\n{BRICK}", "coordinates that are no numbers"),
        (NODES, "no solid elements"),
        ("", "no nodes"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        read(tmp_path, text)


def test_nastran_bulk_data_need_no_case_control(tmp_path: Path) -> None:
    """gmsh writes them so, as does whoever includes them; meshio asks for BEGIN BULK."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    file = tmp_path / "part.bdf"
    meshio.Mesh(points, [("tetra", np.array([[0, 1, 2, 3]]))]).write(file, file_format="nastran")
    text = file.read_text()
    assert "BEGIN BULK" in text
    file.write_text(text.split("BEGIN BULK\n")[1])
    mesh = read_mesh_file(file)
    assert np.abs(mesh.points - points).max() < 1e-6


def test_groups_of_gmsh_2_are_sets(tmp_path: Path) -> None:
    """Its cells have numbers of physical groups, and names stand beside them."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    cells = [("triangle", np.array([[0, 1, 2]])), ("tetra", np.array([[0, 1, 2, 3]]))]
    numbers = {"gmsh:physical": [np.array([5]), np.array([6])], "gmsh:geometrical": [np.array([1]), np.array([1])]}
    groups = {"HUB": np.array([5, 2]), "BODY": np.array([6, 3])}
    file = tmp_path / "part.msh"
    meshio.Mesh(points, cells, cell_data=numbers, field_data=groups).write(file, file_format="gmsh22", binary=False)
    mesh = read_mesh_file(file)
    assert sorted(mesh.sets["HUB"].tolist()) == [0, 1, 2]
    assert mesh.cells[0][2] == ("BODY",)
