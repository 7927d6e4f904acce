"""Meshed links in mechanism files: four formats, selections of nodes, units, matrices, and what is wrong with them."""

from __future__ import annotations

import re
from pathlib import Path

import meshio
import numpy as np
import pytest
import scipy
from part_examples import make_block, make_part

from flexinv.errors import InputError, ModelWarning
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Mechanism
from flexinv.model.part import CELL_KINDS, MeshedPart
from flexinv.parts.craig_bampton import compute_reduction
from flexinv.parts.part_matrices import build_part_matrices

SIZE = (0.4, 0.1, 0.05)
COUNT = (2, 1, 1)
GOOD = """
source = "test"
gravity_m_per_s2 = [0, 0, -9.81]

[links.arm]
kind = "mesh"
file = "arm.inp"
unit_m = 0.001
material = { E_Pa = 70e9, nu = 0.3, rho_kg_per_m3 = 2700 }
root = "hub"
modes = 3

[links.arm.interfaces.hub]
set = "HUB"

[links.arm.interfaces.tip]
plane = { point_m = [0.4, 0, 0], normal = [1, 0, 0] }

[[links.arm.payload]]
name = "tool"
interface = "tip"
mass_kg = 0.1
com_m = [0, 0, 0]
inertia_kgm2 = 0

[links.hand]
kind = "rigid"
mass_kg = 0.2
com_m = [0, 0, 0]
inertia_kgm2 = 0

[joints.hub]
kind = "revolute"
parent = "world"
child = "arm"
axis = [0, 1, 0]

[joints.wrist]
kind = "revolute"
parent = "arm"
child = "hand"
interface = "tip"
axis = [0, 1, 0]
"""
ABAQUS = {"tetra": "C3D4", "tetra10": "C3D10", "hexahedron": "C3D8", "hexahedron20": "C3D20", "wedge": "C3D6"}


def write_mesh(folder: Path, kind: str = "tetra", name: str = "arm.inp", unit: float = 1000.0, **more: object) -> None:
    """A block in millimetres with a set of nodes."""
    points, cells = make_block(kind, SIZE, COUNT)
    hub = np.flatnonzero(points[:, 0] < 1e-9)
    mesh = meshio.Mesh(unit * points, [(kind, cells)], **more)
    if name.endswith(".inp"):
        mesh.point_sets = {"HUB": hub}
        mesh.cell_sets = {"ALL": [np.arange(len(cells))], "FIRST": [np.arange(1)]}
    options = {"file_format": "gmsh22", "binary": False} if name.endswith(".msh") else {}
    mesh.write(folder / name, **options)
    if name.endswith(".inp"):  # meshio writes the hybrid kinds, of which a warning would be said
        text = (folder / name).read_text(encoding="utf-8")
        (folder / name).write_text(re.sub(r"(TYPE=C3D\d+)[RMH]+", r"\1", text), encoding="utf-8")


def load(folder: Path, text: str = GOOD) -> Mechanism:
    (folder / "mechanism.toml").write_text(text, encoding="utf-8")
    return load_mechanism(folder)


def take_part(mechanism: Mechanism) -> MeshedPart:
    part = mechanism.link_of["arm"].part
    assert part is not None
    return part


def use_plane(text: str) -> str:
    """The file with a hub that is a plane, for formats without sets of nodes."""
    return text.replace('set = "HUB"', "plane = { point_m = [0, 0, 0], normal = [1, 0, 0] }")


@pytest.mark.parametrize(
    ("kind", "name"),
    [(kind, "arm.inp") for kind in ABAQUS]
    + [(kind, "arm.vtu") for kind in CELL_KINDS]
    + [(kind, "arm.msh") for kind in CELL_KINDS]
    + [(kind, "arm.bdf") for kind in ("tetra", "tetra10", "hexahedron", "hexahedron20", "wedge")],
)
def test_every_format_gives_the_same_part(tmp_path: Path, kind: str, name: str) -> None:
    """Nodes in metres, cells in VTK's order, mass of the block: whatever the file's own order is."""
    write_mesh(tmp_path, kind, name)
    part = take_part(load(tmp_path, use_plane(GOOD).replace("arm.inp", name)))
    found = build_part_matrices(part)
    assert found.mass.sum() == pytest.approx(2700 * np.prod(SIZE), rel=1e-5)  # Nastran's eight columns hold five digits
    exact = build_part_matrices(make_part(*make_block(kind, SIZE, COUNT), kind))
    assert np.trace(found.stiffness.toarray()) == pytest.approx(np.trace(exact.stiffness.toarray()), rel=1e-5)
    assert [one.name for one in part.interfaces] == ["hub", "tip"]
    assert part.interface_of["tip"].origin == pytest.approx([0.4, 0, 0], abs=1e-6)
    assert part.tip == "tip"


def test_a_mechanism_holds_its_mesh(tmp_path: Path) -> None:
    write_mesh(tmp_path)
    mechanism = load(tmp_path)
    assert mechanism.joint_of["wrist"].interface == "tip"
    assert mechanism.link_of["arm"].bodies[0].interface == "tip"
    assert not mechanism.is_rigid
    again = load(tmp_path)
    assert again == mechanism
    assert hash(again) == hash(mechanism)


SELECTIONS = {
    "cylinder = { point_m = [0.4, 0, 0], axis = [1, 0, 0], radius_m = 0.0559017, length_m = 0.01 }": 4,
    "box = { from_m = [0.39, -1, -1], to_m = [0.41, 1, 0] }\ntolerance_m = 1e-6": 2,
    "box = { from_m = [0.39, -1, -1], to_m = [0.41, 1, 1] }": 4,
    'plane = { point_m = [0.4, 0, 0], normal = [2, 0, 0] }\norigin_m = [0.45, 0, 0]\ntie = "average"': 4,
}


@pytest.mark.parametrize("keys", SELECTIONS)
def test_interfaces_are_selected_by_place(tmp_path: Path, keys: str) -> None:
    write_mesh(tmp_path)
    text = GOOD.replace("plane = { point_m = [0.4, 0, 0], normal = [1, 0, 0] }", keys)
    if SELECTIONS[keys] < 3:
        with pytest.raises(InputError, match=r"2 nodes are caught[\s\S]*the part reaches from"):
            load(tmp_path, text)
        return
    tip = take_part(load(tmp_path, text)).interface_of["tip"]
    assert len(tip.nodes) == SELECTIONS[keys]
    assert tip.origin[0] == pytest.approx(0.45 if "origin_m" in keys else 0.4)
    assert tip.tie == ("average" if "average" in keys else "rigid")


def test_sets_have_materials_of_their_own(tmp_path: Path) -> None:
    write_mesh(tmp_path)
    heavy = "[links.arm.materials.FIRST]\nE_Pa = 2.1e11\nnu = 0.3\nrho_kg_per_m3 = 7850\n\n[links.arm.interfaces.hub]"
    part = take_part(load(tmp_path, GOOD.replace("[links.arm.interfaces.hub]", heavy)))
    volume = np.prod(SIZE) / 12
    mass = build_part_matrices(part).mass.sum()
    assert mass == pytest.approx((11 * 2700 + 7850) * volume, rel=1e-6)
    weave = "E_Pa = [9e10, 9e9, 9e9], nu = [0.3, 0.3, 0.4], G_Pa = [5e9, 5e9, 3e9], rho_kg_per_m3 = 1600"
    weave += ", axes = { rpy_deg = [0, 0, 90] }"
    turned = take_part(load(tmp_path, GOOD.replace("E_Pa = 70e9, nu = 0.3, rho_kg_per_m3 = 2700", weave)))
    law = turned.cells[0].material.stiffness
    assert law[1, 1] > 5 * law[0, 0]  # the fibres lie along y


def write_abaqus_matrix(path: Path, matrix: object, by_node: bool, half: bool) -> None:
    entries = scipy.sparse.coo_array(scipy.sparse.tril(matrix) if half else matrix)
    rows = []
    for i, j, value in zip(entries.row, entries.col, entries.data, strict=True):
        where = (i // 3 + 1, i % 3 + 1, j // 3 + 1, j % 3 + 1) if by_node else (i + 1, j + 1)
        rows.append(", ".join(map(str, where)) + f", {value:.16e}")
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


@pytest.mark.parametrize("style", ["abaqus", "abaqus by node", "matrix market", "npz"])
def test_matrices_of_another_program(tmp_path: Path, style: str) -> None:
    """In tonnes, millimetres and seconds: K in N/mm is t/s^2, so that one unit of mass scales both."""
    write_mesh(tmp_path)
    found = build_part_matrices(take_part(load(tmp_path)))
    both = {
        "mass": scipy.sparse.kron(found.mass, scipy.sparse.eye_array(3)) / 1000,
        "stiffness": found.stiffness / 1000,
    }
    ending = "npz" if style == "npz" else "mtx"
    for name, matrix in both.items():
        path = tmp_path / f"{name}.{ending}"
        if style == "matrix market":
            scipy.io.mmwrite(path, scipy.sparse.coo_array(matrix), precision=16)
        elif style == "npz":
            scipy.sparse.save_npz(path, scipy.sparse.csr_array(matrix))
        else:
            write_abaqus_matrix(path, matrix, style == "abaqus by node", name == "mass")
    keys = f'mass = "mass.{ending}"\nstiffness = "stiffness.{ending}"\nunit_kg = 1000'
    given = take_part(load(tmp_path, GOOD.replace("material = { E_Pa = 70e9, nu = 0.3, rho_kg_per_m3 = 2700 }", keys)))
    assert compute_reduction(given).frequency == pytest.approx(
        compute_reduction(take_part(load(tmp_path))).frequency, rel=1e-9
    )


def test_other_formulations_are_said(tmp_path: Path) -> None:
    write_mesh(tmp_path, "hexahedron")
    file = tmp_path / "arm.inp"
    text = file.read_text(encoding="utf-8")
    kind = text[text.upper().index("TYPE=") + 5 :].split("\n")[0].split(",")[0].strip()
    file.write_text(text.replace(kind, "C3D8R"), encoding="utf-8")
    with pytest.warns(ModelWarning, match="C3D8R has reduced integration"):
        load(tmp_path)


def test_a_mesh_in_another_unit_is_said(tmp_path: Path) -> None:
    """Millimetres taken for metres, where all interfaces catch their nodes."""
    write_mesh(tmp_path)
    with pytest.warns(ModelWarning, match=r"key unit_m: with 1 the mesh is 400 m long; write unit_m = 0.001"):
        load(tmp_path, GOOD.replace("unit_m = 0.001\n", "").replace("point_m = [0.4", "point_m = [400"))


FAULTS = {
    "no such file": ("arm.inp", "leg.inp", "no such file"),
    "no mesh": ('file = "arm.inp"', 'file = "mechanism.toml"', "a mesh of a kind that is read here"),
    "density in t/mm3": ("rho_kg_per_m3 = 2700", "rho_kg_per_m3 = 2.7e-9", "7.85e-9 t/mm3 is the same"),
    "modulus in MPa": ("E_Pa = 70e9", "E_Pa = 70e3", "2.1e5 MPa is the same"),
    "impossible nu": ("nu = 0.3,", "nu = 0.6,", "none that a material can have"),
    "no material": ("material = {", "#", "cells of tetra without a material"),
    "unit forgotten": ("unit_m = 0.001\n", "", "the part reaches from [0.0, -50.0, -25.0] to [400.0, 50.0, 25.0] m"),
    "unknown set": ('set = "HUB"', 'set = "HUBB"', 'set = "HUB", or plane'),
    "two selections": ('set = "HUB"', 'set = "HUB"\nbox = { from_m = [0, 0, 0], to_m = [1, 1, 1] }', "exactly one of set"),
    "no selection": ('set = "HUB"', "", "exactly one of set, plane, cylinder, box"),
    "plane beside it": ("point_m = [0.4", "point_m = [0.5", "0 nodes are caught"),
    "no normal": ("normal = [1, 0, 0]", "normal = [0, 0, 0]", "a direction other than zero"),
    "shared nodes": ('set = "HUB"', "plane = { point_m = [0.4, 0, 0], normal = [1, 0, 0] }", "share node"),
    "unknown root": ('root = "hub"', 'root = "hubb"', 'root = "hub"'),
    "one interface": ("[links.arm.interfaces.tip]\nplane = { point_m = [0.4, 0, 0], normal = [1, 0, 0] }\n", "",
                      "two interfaces or more"),
    "joint on no interface": ('child = "hand"\ninterface = "tip"', 'child = "hand"\ninterface = "top"', 'interface = "tip"'),
    "payload on no interface": ('name = "tool"\ninterface = "tip"', 'name = "tool"\ninterface = "top"', 'interface = "tip"'),
    "station on a mesh": ('child = "hand"\ninterface = "tip"', 'child = "hand"\nstation = 1.0', "no station"),
    "modes twice": ("modes = 3", "modes = 3\nmodes_up_to_Hz = 100", "one of both"),
    "one matrix": ("material = { E_Pa = 70e9, nu = 0.3, rho_kg_per_m3 = 2700 }", 'mass = "m.mtx"', "both mass and stiffness"),
    "unknown material set": ("[links.arm.interfaces.hub]",
                             "[links.arm.materials.STEEL]\nE_Pa=2e11\nnu=0.3\nrho_kg_per_m3=7850\n[links.arm.interfaces.hub]",
                             "a set of solid cells of the file: ALL, FIRST"),
    "key with a wrong unit": ("unit_m = 0.001", "unit_mm = 1", "unit_m"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_named(tmp_path: Path, fault: str) -> None:
    write_mesh(tmp_path)
    old, new, words = FAULTS[fault]
    assert old in GOOD
    with pytest.raises(InputError) as caught:
        load(tmp_path, GOOD.replace(old, new))
    assert words in str(caught.value)


BROKEN = {
    "torn": (lambda text: text[: len(text) // 3], "no solid elements"),
    "shells": (lambda text: text.replace("C3D4", "S3"), "*ELEMENT, TYPE=S3"),
    "unknown element": (lambda text: text.replace("C3D4", "C3D99"), "*ELEMENT, TYPE=C3D99"),
    "generated nodes": (lambda text: text + "*NGEN\n1, 5\n", "a card *NGEN"),
    "two parts": (lambda text: text + "*PART, NAME=A\n*END PART\n*PART, NAME=B\n*END PART\n", "2 cards *PART"),
    "inverted": (None, "is inverted"),
}


@pytest.mark.parametrize("fault", BROKEN)
def test_broken_meshes_are_named(tmp_path: Path, fault: str) -> None:
    change, words = BROKEN[fault]
    if change is None:
        points, cells = make_block("tetra", SIZE, COUNT)
        cells = np.array(cells)
        cells[3, :2] = cells[3, 1::-1]
        mesh = meshio.Mesh(1000 * points, [("tetra", cells)], point_sets={"HUB": np.flatnonzero(points[:, 0] < 1e-9)})
        mesh.write(tmp_path / "arm.inp")
        with pytest.raises(InputError, match=words):
            build_part_matrices(take_part(load(tmp_path)))
        return
    write_mesh(tmp_path)
    file = tmp_path / "arm.inp"
    file.write_text(change(file.read_text(encoding="utf-8")), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load(tmp_path)
    assert words in str(caught.value)


def test_a_finer_mesh_is_read_with_the_same_frames(tmp_path: Path) -> None:
    """Interfaces have the frames of the coarse mesh, whose nodes are others; ready matrices take no finer one."""
    write_mesh(tmp_path)
    write_mesh(tmp_path, "tetra10", "fine.inp")
    (tmp_path / "mechanism.toml").write_text(
        GOOD.replace('file = "arm.inp"', 'file = "arm.inp"\nfiner_file = "fine.inp"')
    )
    part = load_mechanism(tmp_path).links[0].part
    assert part is not None
    assert part.finer is not None
    assert len(part.finer.points) > len(part.points)
    assert [one.origin.tolist() for one in part.finer.interfaces] == [one.origin.tolist() for one in part.interfaces]
    (tmp_path / "mechanism.toml").write_text(
        GOOD.replace('file = "arm.inp"', 'file = "fine.inp"\nfiner_file = "arm.inp"')
    )
    with pytest.raises(
        InputError,
        match=r"key finer_file: .*fine.inp: the finer mesh .*arm.inp has .* expected more",
    ):
        load_mechanism(tmp_path)
