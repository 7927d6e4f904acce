"""A robot from a file of any format: TOML and URDF by flexinv, others by readers that installed packages offer.

A package offers a reader as an entry point of the group ``flexinv.readers``, named as the format (``mjcf``, ``sdf``): a function
of the path that returns a `Mechanism` and, a line each, what the file says and the mechanism cannot.
"""

from __future__ import annotations

import warnings
from importlib import metadata
from pathlib import Path

from flexinv.errors import ModelWarning
from flexinv.files.from_urdf import from_urdf, read_xml
from flexinv.files.load_mechanism import load_mechanism
from flexinv.files.regular_files import describe_kind
from flexinv.files.toml_tables import make_input_error
from flexinv.model.mechanism import Mechanism
from flexinv.validation import check_path

READER_GROUP = "flexinv.readers"
ROOT_TAGS = {"robot": "urdf", "mujoco": "mjcf", "sdf": "sdf"}
XML = (".urdf", ".xml", ".mjcf", ".sdf", ".xacro")
USD = (".usd", ".usda", ".usdc", ".usdz")
INSTALL = {
    "mjcf": "pip install 'flexinv[engines]', whose crosscheck reads it by MuJoCo",
    "sdf": "pip install drake and the package plugins/crosscheck-drake, by which crosscheck reads it",
    "usd": "pip install 'flexinv[usd]', whose crosscheck reads it by usd-core",
}


def read_robot_file(path: str | Path) -> Mechanism:
    """Read a robot [m, kg, rad]: URDF, MJCF, SDF or USD, a mechanism file or its folder, by what stands in it.

    Raises InputError: the file, what was given, what was expected, what to write.  Warns (ModelWarning) of each thing that the
    file says and a mechanism cannot, and where the model was changed.
    """
    file = Path(check_path("robot", path, "a URDF, an MJCF or a mechanism, or of its folder, or a Mechanism"))
    suffix = file.suffix.lower()
    if suffix in XML and not describe_kind(file):
        kind = ROOT_TAGS.get(read_xml(file).tag, "urdf")
    elif suffix in USD:
        kind = "usd"
    elif suffix in XML:
        kind = "urdf"
    else:
        return load_mechanism(file)
    return from_urdf(file) if kind == "urdf" else _read_by_package(file, kind)


def _read_by_package(file: Path, kind: str) -> Mechanism:
    readers = sorted(metadata.entry_points(group=READER_GROUP, name=kind), key=lambda one: one.value)
    if not readers:
        expected = "a format that flexinv reads itself (URDF, mechanism.toml), or a package that reads it"
        raise make_input_error(str(file), f"{kind.upper()}, and no reader of it is installed", expected, INSTALL[kind])
    mechanism, lost = readers[0].load()(file)
    for words in lost:
        warnings.warn(f"{file}: {words}", ModelWarning, stacklevel=4)
    assert isinstance(mechanism, Mechanism)
    return mechanism
