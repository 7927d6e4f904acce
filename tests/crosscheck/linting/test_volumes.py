"""Volumes of shapes: closed forms, MuJoCo's own masses, and densities that no material has."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import fromstring

import numpy as np
import pytest

from crosscheck.findings.finding import Finding
from crosscheck.linting.lint import lint
from crosscheck.linting.mesh_files import MeshFile
from crosscheck.linting.volumes import compute_volume

SOLIDS = {
    '<box size="0.1 0.2 0.3"/>': 0.006,
    '<sphere radius="0.1"/>': 4 / 3 * np.pi * 1e-3,
    '<cylinder radius="0.1" length="0.3"/>': np.pi * 3e-3,
    '<capsule radius="0.1" length="0.3"/>': np.pi * 3e-3 + 4 / 3 * np.pi * 1e-3,
}
ROBOT = (
    '<robot name="s"><link name="w"/><link name="thigh"><inertial><mass value="1.1"/>'
    '<inertia ixx="0.006" iyy="0.006" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="pad">{body}</link>'
    '<joint name="hip" type="revolute"><parent link="w"/><child link="thigh"/><axis xyz="0 1 0"/><origin xyz="0 0 0.5"/>'
    '<limit lower="-1" upper="1" effort="20" velocity="8"/></joint>'
    '<joint name="fix" type="fixed"><parent link="thigh"/><child link="pad"/></joint></robot>'
)
SHAPE = "<{kind}><geometry>{shape}</geometry></{kind}>"


@pytest.mark.parametrize("shape", SOLIDS)
def test_solids_have_the_volumes_of_their_closed_forms(shape: str) -> None:
    part = fromstring(SHAPE.format(kind="visual", shape=shape))
    assert compute_volume(part, {}) == pytest.approx(SOLIDS[shape], rel=1e-14)  # rounding of a product


def test_what_is_no_number_has_no_volume() -> None:
    for shape in (
        '<box size="0.1 0.2"/>',
        '<sphere radius="x"/>',
        '<cone radius="1" length="1"/>',
        '<mesh filename="a.stl"/>',
    ):
        assert compute_volume(fromstring(SHAPE.format(kind="visual", shape=shape)), {}) is None


def test_a_mesh_has_its_volume_wherever_it_is_and_however_it_is_scaled() -> None:
    """A tetrahedron with edges 1, 2, 3 m along the axes: 1 m^3."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]]) + 5.0
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    part = fromstring(SHAPE.format(kind="visual", shape='<mesh filename="a.stl" scale="2 -1 1"/>'))
    for order in (faces, faces[:, ::-1]):
        for mujoco in (False, True):  # of a convex mesh they are one number
            volume = compute_volume(part, {"a.stl": MeshFile(corners, faces=order)}, mujoco)
            assert volume == pytest.approx(2.0, rel=1e-12)  # rounding of coordinates of 10 m


def write_meshes(folder: Path) -> None:
    trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed (python -m pip install trimesh)")
    box = trimesh.creation.box((0.1, 0.2, 0.3))
    box.export(folder / "box.stl")
    trimesh.Trimesh(box.vertices, box.faces[:-2], process=False).export(folder / "open.stl")
    other = trimesh.creation.box((0.4, 0.1, 0.1))
    other.apply_translation((0.25, 0.0, 0.1))
    trimesh.util.concatenate([trimesh.creation.box((0.1, 0.1, 0.3)), other]).export(folder / "angle.stl")


@pytest.mark.parametrize(
    "shape",
    [
        *SOLIDS,
        '<mesh filename="box.stl"/>',
        '<mesh filename="box.stl" scale="0.5 -2 0.7"/>',
        '<mesh filename="open.stl"/>',
        '<mesh filename="angle.stl"/>',
        '<mesh filename="angle.stl" scale="0.5 2 0.7"/>',
    ],
)
def test_lint_says_the_mass_that_mujoco_makes_of_what_collides(shape: str, tmp_path: Path) -> None:
    """MuJoCo itself is asked; Pinocchio takes nothing.  Rounding: STL holds single precision, words three digits."""
    mujoco = pytest.importorskip("mujoco")
    pinocchio = pytest.importorskip("pinocchio")
    write_meshes(tmp_path)
    file = tmp_path / "s.urdf"
    file.write_text(ROBOT.format(body=SHAPE.format(kind="collision", shape=shape)))
    added = float(mujoco.MjModel.from_xml_path(str(file)).body_mass.sum()) - 1.1
    (found,) = (one for one in lint(file).findings if one.check == "shape without inertia")
    assert found.why.startswith(f"MuJoCo takes {added:.3g} kg, 1000 kg/m^3 of its shape, "), (found.why, added)
    masses = sum(body.mass for body in pinocchio.buildModelFromUrdf(str(file)).inertias)
    assert masses == pytest.approx(1.1, rel=1e-12)  # rounding


def find_density(folder: Path, mass: str, shape: str) -> list[Finding]:
    inertial = f'<inertial><mass value="{mass}"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>'
    (folder / "s.urdf").write_text(ROBOT.format(body=inertial + SHAPE.format(kind="visual", shape=shape)))
    return [one for one in lint(folder / "s.urdf").findings if one.check == "density"]


@pytest.mark.parametrize(
    ("mass", "words"),
    [
        ("180", ["180 kg in a box of 0.006 m^3", "3e+04 kg/m^3", "23000 kg/m^3 (osmium has 22587)"]),
        ("135", []),  # 22 500 kg/m^3: osmium
        ("0.012", []),  # 2 kg/m^3: more than the air
        ("0.006", ["0.006 kg, a shape of 0.006 m^3: 1 kg/m^3", "1.2 kg/m^3"]),
    ],
)
def test_no_material_is_denser_than_osmium_and_no_link_lighter_than_air(
    mass: str, words: list[str], tmp_path: Path
) -> None:
    write_meshes(tmp_path)
    for shape in ('<box size="0.1 0.2 0.3"/>', '<mesh filename="box.stl"/>'):
        found = find_density(tmp_path, mass, shape)
        assert len(found) == bool(words), found
        assert all(word in f"{one.given} {one.why}" for one in found for word in words), found


def test_marks_are_not_judged(tmp_path: Path) -> None:
    """A cube of 1 mm, the sign of a frame, has the mass of what it stands for."""
    assert find_density(tmp_path, "1.5", '<box size="0.001 0.001 0.001"/>') == []
