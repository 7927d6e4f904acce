"""Files of meshes: their points, or what is wrong with them; a header is held against the size of its file before it is believed.

Looked into are STL, OBJ, PLY and OFF, by trimesh where it is installed, and of COLLADA the counts that it states.
"""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError

import numpy as np
from defusedxml.common import DefusedXmlException

from crosscheck.findings.finding import Finding, make_error, make_warning
from flexinv.files.bounded_xml import XmlBoundExceeded, parse_bounded
from flexinv.files.regular_files import MISSING, describe_kind, read_regular
from flexinv.typing import Array, Indices

LARGEST = 64 << 20  # [byte] of a mesh file that is read
READ = (".stl", ".obj", ".ply", ".off")
# [byte]
STL_HEAD = 84
STL_TRIANGLE = 50
WRITE = "the mesh exported again; a tool such as meshlab or trimesh shows where it breaks"
REFUSED = "readers that load meshes refuse the file, or crash"
COUNTED = re.compile(rb"^element +\w+ +(\d+)", re.MULTILINE)  # of PLY


@dataclass(frozen=True)
class MeshFile:
    """A mesh file as it is.

    points : (n, 3) in the unit of the file, None where it was not read; faces : (m, 3) numbers of points, the triangles
    problem : what is wrong with it, "" where nothing is; doubt : what some readers refuse, "" where nothing is
    unread : why it was not looked into, "" where it was
    """

    points: Array | None = None
    problem: str = ""
    doubt: str = ""
    unread: str = ""
    faces: Indices | None = None


def find_mesh_file(name: str, path: Path) -> Path | None:
    """Return the place of a mesh: beside the URDF, or in the package whose folder is above it; None where nothing is there."""
    plain = name.removeprefix("file://")
    if "://" not in plain:
        result = path.parent / plain
        return result if _is_there(result) else None
    inside = plain.partition("://")[2].lstrip("/")
    package, _, rest = inside.partition("/")
    for above in path.resolve().parents:
        for result in (above / inside, *([above / rest] if above.name == package else [])):
            if _is_there(result):
                return result
    return None


def _is_there(path: Path) -> bool:
    """Return True where a name stands for something, be it a pipe, or a link to itself."""
    words = describe_kind(path)
    return words != MISSING and not words.startswith("a name that the system refuses")


def read_meshes(robot: Element, path: Path) -> dict[str, MeshFile]:
    """Return the mesh files of a URDF by their names there, those that are there [-]."""
    names = dict.fromkeys(mesh.get("filename", "") for mesh in robot.iter("mesh"))
    found = {name: find_mesh_file(name, path) for name in names if name}
    return {name: read_mesh(file) for name, file in found.items() if file is not None}


def list_mesh_findings(meshes: Mapping[str, MeshFile]) -> Iterator[Finding]:
    """Yield what is wrong with files of meshes [-]."""
    for name, file in meshes.items():
        place = f"mesh {name[:100]}"
        if file.problem:
            yield make_error("mesh", place, file.problem, REFUSED, WRITE)
        elif file.doubt:
            yield make_warning("mesh", place, file.doubt, "MuJoCo and trimesh refuse the file, others take it", WRITE)
        elif file.unread:
            yield make_warning("mesh", place, file.unread, "it is not looked into", "a mesh with fewer triangles")


def can_read_meshes() -> bool:
    """Return True if trimesh is installed."""
    return importlib.util.find_spec("trimesh") is not None


def read_mesh(file: Path) -> MeshFile:
    """Return a mesh file: its points [unit of the file], or what is wrong with it."""
    if words := describe_kind(file):
        return MeshFile(problem=words)
    size = file.stat().st_size
    if size > LARGEST:
        return MeshFile(unread=f"{size} bytes, more than {LARGEST}")
    if size == 0:
        return MeshFile(problem="an empty file")
    suffix = file.suffix.lower()
    mesh = CHECKS[suffix](file, size) if suffix in CHECKS else MeshFile()
    if mesh != MeshFile() or suffix not in READ or not can_read_meshes():
        return mesh
    return _read_mesh(file)


def _read_mesh(file: Path) -> MeshFile:
    import trimesh

    loaded: Any
    try:
        with np.errstate(all="ignore"):  # numbers that are none are looked for below
            if file.suffix.lower() == ".obj":
                loaded = trimesh.load(file, force="mesh", process=False, skip_materials=True)
            else:
                loaded = trimesh.load(file, force="mesh", process=False)
        if not hasattr(loaded, "faces"):  # points alone, as trimesh before 4.5 gives them
            return MeshFile(problem="no triangles")
        points = np.asarray(loaded.vertices, dtype=float)
        faces = np.asarray(loaded.faces, dtype=np.int64)
    except IndexError as problem:
        return MeshFile(problem=f"a face names a corner that is not there ({problem})"[:200])
    except Exception as problem:  # a parser of strangers' bytes raises whatever their damage leads to
        return MeshFile(problem=f"{type(problem).__name__}: {' '.join(str(problem).split())}"[:200])
    if not len(points) or not len(faces):
        return MeshFile(problem="no triangles")
    if faces.min() < 0 or faces.max() >= len(points):
        return MeshFile(problem=f"a face names a corner that is not there, of {len(points)}")
    if bad := int((~np.isfinite(points).all(axis=1)).sum()):
        return MeshFile(problem=f"{bad} of {len(points)} corners are no finite numbers")
    return MeshFile(points, faces=faces)


def _check_stl(file: Path, size: int) -> MeshFile:
    """Hold the number of triangles in the header of a binary STL against the size of the file; text states no numbers."""
    with file.open("rb") as stream:
        start = stream.read(1024)
    count = int.from_bytes(start[80:STL_HEAD], "little")
    whole = STL_HEAD + STL_TRIANGLE * count
    if start.lstrip().startswith(b"solid") and (b"facet" in start or b"endsolid" in start) and size != whole:
        return MeshFile()
    if size < STL_HEAD:
        return MeshFile(problem=f"{size} bytes, fewer than the {STL_HEAD} of the header of a binary STL, and no text")
    if size < whole:
        return MeshFile(
            problem=f"{(size - STL_HEAD) / STL_TRIANGLE:.6g} triangles, where the header says {count}: it is cut off"
        )
    return MeshFile(doubt=f"{size - whole} bytes after the {count} triangles of the header" if size > whole else "")


def _check_ply(file: Path, size: int) -> MeshFile:
    with file.open("rb") as stream:
        head = stream.read(1 << 16).partition(b"end_header")[0]
    return _check_declared_size(sum(map(int, COUNTED.findall(head)[:20])), size)


def _check_off(file: Path, size: int) -> MeshFile:
    with file.open("rb") as stream:
        words = stream.read(4096).split()
    numbers = [int(word) for word in words[:4] if word.isdigit() and len(word) < 20]
    return _check_declared_size(sum(numbers[:2]), size)


def _check_declared_size(count: int, size: int) -> MeshFile:
    return MeshFile(problem=f"{size} bytes, where the header says {count} corners and faces" if count > size else "")


def _check_dae(file: Path, size: int) -> MeshFile:
    try:
        root = parse_bounded(read_regular(file, LARGEST))
    except DefusedXmlException:
        return MeshFile(problem="a DOCTYPE or ENTITY")
    except XmlBoundExceeded as bound:
        return MeshFile(unread=bound.given)
    except (ParseError, ValueError, LookupError, OSError) as problem:
        return MeshFile(problem=f"XML that does not parse: {problem}"[:200])
    for numbers in root.iter():
        count = numbers.get("count", "")
        if str(numbers.tag).endswith("float_array") and count.isdigit():
            there = len((numbers.text or "").split())
            if int(count) != there:
                return MeshFile(problem=f"{there} numbers, where count says {count}")
    return MeshFile()


CHECKS: dict[str, Callable[[Path, int], MeshFile]] = {
    ".stl": _check_stl,
    ".ply": _check_ply,
    ".off": _check_off,
    ".dae": _check_dae,
}
