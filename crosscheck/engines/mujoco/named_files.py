"""Files that an MJCF or a URDF names, before MuJoCo opens them: none is a pipe or a device, and includes come to an end."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

from flexinv.errors import InputError
from flexinv.files.from_urdf import describe_location, read_xml
from flexinv.files.regular_files import MISSING, describe_kind
from flexinv.files.toml_tables import make_input_error

MOST_INCLUDES = 1000  # the scenes of mujoco_menagerie have up to six
FOLDERS = ("meshdir", "texturedir", "assetdir")  # of <compiler>
NAMES = ("file", "filename")


def check_named_files(path: Path, root: Element) -> None:
    """Raise InputError where a file names what is no regular file, or includes without end [-]."""
    _Walk(path).check(path, root)


@dataclass
class _Walk:
    """A way through a file and all that it includes.

    start : the file, in whose folder MuJoCo looks for the others; included : how many there were
    """

    start: Path
    included: int = 0

    def check(self, file: Path, root: Element) -> None:
        folders = ["", *(one.get(name, "") for one in root.iter("compiler") for name in FOLDERS)]
        for element in root.iter():
            for name in filter(None, map(element.get, NAMES)):
                for place in self.list_candidate_paths(name, folders):
                    self.check_kind(place, file, element)
            if element.tag == "include":
                self.check_include(self.start.parent / element.get("file", ""), file, element)

    def list_candidate_paths(self, name: str, folders: list[str]) -> Iterator[Path]:
        """The places where MuJoCo may look for a name: of a URDF's meshes it takes the last part alone, unless told otherwise."""
        plain = name.partition("://")[2] or name
        for part in dict.fromkeys((plain, Path(plain).name)):
            yield from (self.start.parent / folder / part for folder in folders)

    def check_kind(self, place: Path, file: Path, element: Element) -> None:
        words = describe_kind(place)
        if words and words != MISSING and not words.startswith(("a name that", "a folder", "a link to")):
            raise make_input_error(
                describe_location(file, element), f"{place}, {words}", "a regular file", "the name of a file"
            )

    def check_include(self, included: Path, file: Path, element: Element) -> None:
        self.included += 1
        if self.included > MOST_INCLUDES:
            given = f"more than {MOST_INCLUDES} files that are included"
            raise make_input_error(
                describe_location(file, element), given, f"at most {MOST_INCLUDES}", "each file included once"
            )
        if describe_kind(included):
            return  # MuJoCo says what is missing
        try:
            root = read_xml(included)
        except InputError as error:
            raise InputError(f"{file}: <include>: {error}") from None
        if included.resolve() == self.start.resolve():
            raise make_input_error(
                describe_location(file, element), "an include of the file itself", "another file", "no <include> of it"
            )
        self.check(included, root)
