"""Files of an export: all of them or none, and the licence that they carry."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from flexinv.errors import FlexinvError

LICENCE_FILE = "LICENSE"


def read_licence() -> str:
    """Return the text of the licence [-] of what an export is made of."""
    try:
        files = distribution("flexinv").files or []
        texts = [one.read_text() for one in files if one.name == "LICENSE"]
    except (PackageNotFoundError, OSError):
        texts = []
    return texts[0] if texts else "BSD 3-Clause License, https://opensource.org/license/bsd-3-clause\n"


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write path -> content [-] into a folder.

    Raises FlexinvError where one cannot be written, on a full disk as well; those before it are taken away again.
    """
    begun = list[Path]()
    try:
        for path, data in files.items():
            file = folder / path
            file.parent.mkdir(parents=True, exist_ok=True)
            begun.append(file)
            file.write_bytes(data)
    except OSError as error:
        for file in begun:
            with suppress(OSError):
                file.unlink(missing_ok=True)
        raise FlexinvError(
            f"export: {begun[-1] if begun else folder} cannot be written ({error.strerror or error}); nothing of it is left; "
            "make room, or write another folder"
        ) from error
