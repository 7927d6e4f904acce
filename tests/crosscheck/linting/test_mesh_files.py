"""Corrupt meshes are findings with the file's name; what is no regular file, and a header that lies, hold nobody up."""

from __future__ import annotations

import os
import struct
from pathlib import Path

import pytest

from crosscheck.findings.finding import Finding
from crosscheck.linting.lint import lint
from crosscheck.linting.mesh_files import LARGEST

ROBOT = """<robot name="r"><link name="base"/>
  <link name="arm"><collision><geometry><mesh filename="{name}"{scale}/></geometry></collision><inertial>
    <origin xyz="0.1 0 0"/><mass value="1"/><inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="j" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint></robot>"""
TRIANGLE = struct.pack("<12fH", 0, 0, 1, 0, 0, 0, 0.1, 0, 0, 0, 0.1, 0, 0)
NAN = struct.pack("<12fH", 0, 0, 1, float("nan"), 0, 0, 0.1, 0, 0, 0, 0.1, 0, 0)
CORNERS = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\n"
XYZ = "property float x\nproperty float y\nproperty float z\n"
PLY = f"ply\nformat ascii 1.0\nelement vertex 3\n{XYZ}element face {{}}\n{{}}end_header\n"
FACET = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex .1 0 0\nvertex 0 .1 0\nendloop\nendfacet\n"
DAE = '<COLLADA><library_geometries><float_array count="{}">0 0 0</float_array></library_geometries></COLLADA>'


def stl(count: int, triangles: bytes) -> bytes:
    return b"".ljust(80) + struct.pack("<I", count) + triangles


CORRUPT = {
    "a header of many triangles": ("m.stl", stl(4_000_000_000, TRIANGLE), "1 triangles, where the header says 40"),
    "cut off": ("m.stl", stl(3, TRIANGLE * 2), "2 triangles, where the header says 3: it is cut off"),
    "text that says binary": ("m.stl", b"solid m".ljust(80) + struct.pack("<I", 9) + TRIANGLE, "1 triangles, where"),
    "corners that are no numbers": ("m.stl", stl(2, TRIANGLE + NAN), "1 of 6 corners are no finite numbers"),
    "no triangles": ("m.stl", stl(0, b""), "no triangles"),
    "no bytes": ("m.stl", b"", "an empty file"),
    "a corner that is not there": ("m.obj", f"{CORNERS}f 1 2 9\n".encode(), "names a corner that is not there"),
    "no faces": ("m.obj", CORNERS.encode(), "no triangles"),
    "a header of corners": ("m.ply", PLY.format(4_000_000_000, "").encode(), "header says 4000000003 corners and faces"),
    "a count of corners": ("m.off", b"OFF\n4000000000 1 0\n0 0 0\n", "header says 4000000001 corners and faces"),
    "a count of numbers": ("m.dae", DAE.format(4_000_000_000).encode(), "3 numbers, where count says 4000000000"),
    "entities": ("m.dae", b"<!DOCTYPE C [<!ENTITY a 'x'>]><COLLADA>&a;</COLLADA>", "a DOCTYPE or ENTITY"),
    "XML that ends": ("m.dae", b"<COLLADA><library", "XML that does not parse"),
}  # fmt: skip


def findings(folder: Path, name: str, scale: str = "") -> list[Finding]:
    (folder / "arm.urdf").write_text(ROBOT.format(name=name, scale=scale))
    return [one for one in lint(folder / "arm.urdf").findings if one.place == f"mesh {name}"]


@pytest.mark.parametrize("kind", CORRUPT)
def test_a_corrupt_mesh_is_a_finding(kind: str, tmp_path: Path) -> None:
    name, content, words = CORRUPT[kind]
    if name.endswith((".stl", ".obj")) and ("there" in words or "finite" in words or "no tri" in words):
        pytest.importorskip("trimesh", reason="trimesh is not installed (python -m pip install trimesh)")
    (tmp_path / name).write_bytes(content)
    (result,) = findings(tmp_path, name)
    assert (result.check, result.level) == ("mesh", "error")
    assert words in result.given
    assert len(result.given) <= 200


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("pipe", "a named pipe (FIFO)"),
        ("device", "a device"),
        ("folder", "a folder"),
        ("circle", "a symbolic link that leads to itself"),
    ],
)
def test_what_is_no_regular_file_is_not_opened(kind: str, words: str, tmp_path: Path) -> None:
    mesh = tmp_path / "m.stl"
    make = {"pipe": os.mkfifo, "device": lambda m: m.symlink_to("/dev/zero"), "folder": os.mkdir}
    make.get(kind, lambda m: m.symlink_to(m.name))(mesh)
    (result,) = findings(tmp_path, "m.stl")
    assert (result.level, result.given) == ("error", words)


def test_a_mesh_of_gigabytes_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "m.stl").write_bytes(stl(9, TRIANGLE))
    os.truncate(tmp_path / "m.stl", 8 << 30)
    (result,) = findings(tmp_path, "m.stl")
    assert result.level == "warning"
    assert result.given == f"{8 << 30} bytes, more than {LARGEST}"


def test_bytes_behind_the_triangles_are_a_warning(tmp_path: Path) -> None:
    (tmp_path / "m.stl").write_bytes(stl(1, TRIANGLE) + b"more")
    (result,) = findings(tmp_path, "m.stl")
    assert (result.level, result.given) == ("warning", "4 bytes after the 1 triangles of the header")


def test_materials_of_a_mesh_are_left_alone(tmp_path: Path) -> None:
    """They are a pipe here: whoever opens it waits without end."""
    os.mkfifo(tmp_path / "m.mtl")
    (tmp_path / "m.obj").write_text(f"mtllib m.mtl\nusemtl a\n{CORNERS}f 1 2 3\n")
    assert findings(tmp_path, "m.obj") == []


def test_a_scale_that_is_no_number(tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text(f"{CORNERS}f 1 2 3\n")
    (result,) = findings(tmp_path, "m.obj", ' scale="nan 1 1"')
    assert (result.check, result.given) == ("number", 'scale="nan 1 1"')


def test_a_sound_mesh_is_no_finding(tmp_path: Path) -> None:
    (tmp_path / "m.stl").write_bytes(stl(1, TRIANGLE))
    (tmp_path / "text.stl").write_text(f"solid t\n{FACET}endsolid t\n")
    lists = "property list uchar int vertex_indices\n"
    (tmp_path / "m.ply").write_text(f"{PLY.format(1, lists)}0 0 0\n0.1 0 0\n0 0.1 0\n3 0 1 2\n")
    (tmp_path / "m.dae").write_text(DAE.format(3))
    for name in ("m.stl", "text.stl", "m.ply", "m.dae"):
        assert findings(tmp_path, name) == []
