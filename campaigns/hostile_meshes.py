"""Hostile meshes: headers that promise more than follows, corners that are not there, archives and links that lead elsewhere."""

from __future__ import annotations

import os
import random
import struct
import zipfile
from pathlib import Path

from hostile_files import HUGE, maker, put, robot

MOST = 4_000_000_000  # triangles that a header promises
TRIANGLE = struct.pack("<12fH", 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0)
CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"


def shaped(folder: Path, name: str, scale: str = "") -> Path:
    """Write the URDF whose link has a mesh of this name, and return it."""
    words = f' scale="{scale}"' if scale else ""
    shape = f'<collision><geometry><mesh filename="{name}"{words}/></geometry></collision>'
    return put(folder, "arm.urdf", robot(shape=shape))


def with_mesh(folder: Path, name: str, content: str | bytes) -> Path:
    """Write a mesh and the URDF that names it, and return the URDF."""
    put(folder, name, content)
    return shaped(folder, name)


def _stl(count: int, triangles: bytes) -> bytes:
    return b"binary".ljust(80) + struct.pack("<I", count) + triangles


@maker
def stl_promise(folder: Path, draw: random.Random) -> Path:
    """STL that promises four thousand million triangles and has one."""
    return with_mesh(folder, "m.stl", _stl(MOST, TRIANGLE))


@maker
def stl_torn(folder: Path, draw: random.Random) -> Path:
    """STL that ends within a triangle."""
    whole = _stl(100, TRIANGLE * 100)
    return with_mesh(folder, "m.stl", whole[: draw.randint(100, len(whole) - 10)])


@maker
def stl_solid(folder: Path, draw: random.Random) -> Path:
    """Binary STL that begins as text does."""
    return with_mesh(folder, "m.stl", b"solid of text".ljust(80) + struct.pack("<I", 50) + draw.randbytes(120))


@maker
def stl_nan(folder: Path, draw: random.Random) -> Path:
    """STL whose corners are no numbers."""
    bad = struct.pack("<12fH", 0, 0, 1, float("nan"), 0, 0, 1, float("inf"), 0, 0, 1, 0, 0)
    return with_mesh(folder, "m.stl", _stl(2, TRIANGLE + bad))


@maker
def stl_none(folder: Path, draw: random.Random) -> Path:
    """STL without a triangle."""
    return with_mesh(folder, "m.stl", _stl(0, b""))


@maker
def stl_empty(folder: Path, draw: random.Random) -> Path:
    """No byte at all."""
    return with_mesh(folder, "m.stl", b"")


@maker
def stl_noise(folder: Path, draw: random.Random) -> Path:
    """Noise."""
    return with_mesh(folder, "m.stl", draw.randbytes(5000))


@maker
def stl_huge(folder: Path, draw: random.Random) -> Path:
    """STL of eight gigabytes that takes no room."""
    os.truncate(put(folder, "m.stl", _stl(HUGE // 50, TRIANGLE)), HUGE)
    return shaped(folder, "m.stl")


@maker
def mesh_pipe(folder: Path, draw: random.Random) -> Path:
    """A mesh that is a named pipe."""
    os.mkfifo(folder / "m.stl")
    return shaped(folder, "m.stl")


@maker
def mesh_zeros(folder: Path, draw: random.Random) -> Path:
    """A mesh that is /dev/zero."""
    (folder / "m.stl").symlink_to("/dev/zero")
    return shaped(folder, "m.stl")


@maker
def mesh_device(folder: Path, draw: random.Random) -> Path:
    """A mesh whose name is that of a device."""
    return shaped(folder, "/dev/zero")


@maker
def mesh_folder(folder: Path, draw: random.Random) -> Path:
    """A mesh that is a folder."""
    (folder / "m.stl").mkdir()
    return shaped(folder, "m.stl")


@maker
def mesh_circle(folder: Path, draw: random.Random) -> Path:
    """A mesh that is a link to itself."""
    (folder / "m.stl").symlink_to("m.stl")
    return shaped(folder, "m.stl")


@maker
def mesh_outside(folder: Path, draw: random.Random) -> Path:
    """A mesh that leads to a file of the machine."""
    return shaped(folder, "../" * 20 + "etc/passwd")


@maker
def mesh_package(folder: Path, draw: random.Random) -> Path:
    """A mesh in a package that leads out of it."""
    return shaped(folder, "package://" + "../" * draw.randint(100, 2000) + "etc/passwd")


@maker
def mesh_long_name(folder: Path, draw: random.Random) -> Path:
    """A mesh whose name no file system takes."""
    return shaped(folder, "m" * 3900 + ".stl")


@maker
def mesh_null_name(folder: Path, draw: random.Random) -> Path:
    """A mesh whose name has a character that no file may have."""
    return shaped(folder, "package://%00/m.stl")


@maker
def mesh_scale(folder: Path, draw: random.Random) -> Path:
    """A good mesh with a scale that is no number."""
    put(folder, "m.obj", CORNERS + "f 1 2 3\nf 1 3 4\n")
    return shaped(folder, "m.obj", "nan inf 1e308")


@maker
def obj_outside(folder: Path, draw: random.Random) -> Path:
    """OBJ whose face names corners that are not there."""
    return with_mesh(folder, "m.obj", CORNERS + f"f 1 2 {draw.randint(5, 99)}\n")


@maker
def obj_promise(folder: Path, draw: random.Random) -> Path:
    """OBJ whose face names the corner of number four thousand million."""
    return with_mesh(folder, "m.obj", CORNERS + f"f 1 2 {MOST}\nf 1 2 -{MOST}\n")


@maker
def obj_none(folder: Path, draw: random.Random) -> Path:
    """OBJ without a face."""
    return with_mesh(folder, "m.obj", CORNERS)


@maker
def obj_nan(folder: Path, draw: random.Random) -> Path:
    """OBJ with a corner that is no number."""
    return with_mesh(folder, "m.obj", CORNERS + "v nan inf 1e999\nf 1 2 5\nf 1 3 4\n")


@maker
def obj_material_pipe(folder: Path, draw: random.Random) -> Path:
    """OBJ whose materials are a named pipe."""
    os.mkfifo(folder / "m.mtl")
    return with_mesh(folder, "m.obj", "mtllib m.mtl\nusemtl a\n" + CORNERS + "f 1 2 3\nf 1 3 4\nf 1 2 4\nf 2 3 4\n")


@maker
def obj_material_device(folder: Path, draw: random.Random) -> Path:
    """OBJ whose materials are /dev/zero."""
    return with_mesh(folder, "m.obj", "mtllib /dev/zero\nusemtl a\n" + CORNERS + "f 1 2 3\nf 1 3 4\nf 1 2 4\nf 2 3 4\n")


@maker
def obj_long_face(folder: Path, draw: random.Random) -> Path:
    """OBJ with one face of a million corners."""
    return with_mesh(folder, "m.obj", CORNERS + "f" + " 1 2 3" * 300_000 + "\n")


@maker
def obj_many(folder: Path, draw: random.Random) -> Path:
    """OBJ with a million corners on a sphere: a hull that takes its time."""
    lines = []
    for _ in range(400_000):
        x, y, z = (draw.gauss(0, 1) for _ in range(3))
        size = (x * x + y * y + z * z) ** 0.5
        lines.append(f"v {x / size:.6f} {y / size:.6f} {z / size:.6f}")
    return with_mesh(folder, "m.obj", "\n".join([*lines, *(f"f {k} {k + 1} {k + 2}" for k in range(1, 300_000))]))


@maker
def dae_laughs(folder: Path, draw: random.Random) -> Path:
    """COLLADA with entities that double."""
    lines = ['<!ENTITY a0 "ha">', *(f'<!ENTITY a{k} "&a{k - 1};&a{k - 1};">' for k in range(1, 31))]
    return with_mesh(folder, "m.dae", f"<!DOCTYPE C [{''.join(lines)}]><COLLADA>&a30;</COLLADA>")


@maker
def dae_promise(folder: Path, draw: random.Random) -> Path:
    """COLLADA that promises four thousand million numbers."""
    source = f'<source id="s"><float_array id="a" count="{MOST}">0 0 0</float_array></source>'
    mesh = f'<mesh>{source}<triangles count="{MOST}"><p>0 1 2</p></triangles></mesh>'
    inside = f'<library_geometries><geometry id="g">{mesh}</geometry></library_geometries>'
    schema = "http://www.collada.org/2005/11/COLLADASchema"
    return with_mesh(folder, "m.dae", f'<COLLADA xmlns="{schema}" version="1.4.1">{inside}</COLLADA>')


@maker
def ply_promise(folder: Path, draw: random.Random) -> Path:
    """PLY that promises four thousand million corners."""
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {MOST}\nproperty float x\nproperty float y\nproperty float z\n"
    return with_mesh(
        folder, "m.ply", f"{head}element face {MOST}\nproperty list uchar int vertex_indices\nend_header\n\0\0\0\0"
    )


@maker
def ply_list(folder: Path, draw: random.Random) -> Path:
    """PLY whose face says that it has four thousand million corners."""
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    text = (
        f"{head}element face 1\nproperty list uint int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n{MOST} 0 1 2\n"
    )
    return with_mesh(folder, "m.ply", text)


@maker
def off_promise(folder: Path, draw: random.Random) -> Path:
    """OFF that promises four thousand million corners."""
    return with_mesh(folder, "m.off", f"OFF\n{MOST} {MOST} 0\n0 0 0\n")


@maker
def gltf_elsewhere(folder: Path, draw: random.Random) -> Path:
    """GLTF whose numbers lie in a file of the machine."""
    text = '{"asset": {"version": "2.0"}, "buffers": [{"uri": "/dev/zero", "byteLength": 4000000000}]}'
    return with_mesh(folder, "m.gltf", text)


@maker
def archive_bomb(folder: Path, draw: random.Random) -> Path:
    """3MF with a gigabyte of spaces in it."""
    with (
        zipfile.ZipFile(folder / "m.3mf", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("3D/3dmodel.model", "w") as stream,
    ):
        for _ in range(1024):
            stream.write(b" " * (1 << 20))
    return shaped(folder, "m.3mf")


def _mjcf_mesh(folder: Path, name: str) -> Path:
    body = '<body><joint/><geom type="mesh" mesh="m"/></body>'
    asset = f'<asset><mesh name="m" file="{name}"/></asset>'
    return put(folder, "arm.xml", f"<mujoco>{asset}<worldbody>{body}</worldbody></mujoco>")


@maker
def mjcf_mesh_pipe(folder: Path, draw: random.Random) -> Path:
    """MJCF with a mesh that is a named pipe."""
    os.mkfifo(folder / "m.stl")
    return _mjcf_mesh(folder, "m.stl")


@maker
def mjcf_mesh_zeros(folder: Path, draw: random.Random) -> Path:
    """MJCF with a mesh that is /dev/zero."""
    (folder / "m.obj").symlink_to("/dev/zero")
    return _mjcf_mesh(folder, "m.obj")


@maker
def mjcf_mesh_promise(folder: Path, draw: random.Random) -> Path:
    """MJCF with STL that promises four thousand million triangles."""
    put(folder, "m.stl", _stl(MOST, TRIANGLE))
    return _mjcf_mesh(folder, "m.stl")


@maker
def mjcf_mesh_outside(folder: Path, draw: random.Random) -> Path:
    """MJCF with OBJ whose face names corners that are not there."""
    put(folder, "m.obj", CORNERS + "f 1 2 3\nf 1 3 4\nf 1 2 4\nf 2 3 900000\n")
    return _mjcf_mesh(folder, "m.obj")


@maker
def mjcf_mesh_nan(folder: Path, draw: random.Random) -> Path:
    """MJCF with OBJ whose corners are no numbers."""
    put(folder, "m.obj", CORNERS + "v nan nan nan\nf 1 2 3\nf 1 3 4\nf 1 2 5\nf 2 3 5\n")
    return _mjcf_mesh(folder, "m.obj")


@maker
def mjcf_own_format(folder: Path, draw: random.Random) -> Path:
    """MJCF with a mesh in MuJoCo's own format that promises two thousand million corners."""
    put(folder, "m.msh", struct.pack("<4i", 2**31 - 1, 2**31 - 1, 2**31 - 1, 2**31 - 1) + bytes(64))
    return _mjcf_mesh(folder, "m.msh")


@maker
def mjcf_own_format_negative(folder: Path, draw: random.Random) -> Path:
    """MJCF with a mesh in MuJoCo's own format that has a negative number of corners."""
    put(folder, "m.msh", struct.pack("<4i", -5, -5, -5, -5) + bytes(64))
    return _mjcf_mesh(folder, "m.msh")
