"""Files of an export: all of them or none, and the licence that they carry."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from flexinv.errors import FlexinvError

LICENCE_FILE = "LICENSE"
MAKE_ROOM = "nothing of it is left; make room, or write another folder"


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
    with remove_on_failure(folder, files):
        _write_each(folder, files)


def _write_each(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write the files, or say why one of them cannot be written."""
    for path, data in files.items():
        file = folder / path
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(data)
        except OSError as error:
            raise FlexinvError(f"export: {file} cannot be written ({error.strerror or error}); {MAKE_ROOM}") from error


@contextmanager
def remove_on_failure(folder: Path, written: Iterable[str]) -> Iterator[None]:
    """Take the paths [-] that are ``written`` in a folder away, and folders made for them, where what is done within fails."""
    files = [folder / path for path in written]
    made = {one for file in files for one in file.parents if not one.exists()}
    try:
        yield
    except BaseException:
        for file in files:
            with suppress(OSError):
                file.unlink(missing_ok=True)
        for one in sorted(made, reverse=True):  # the inner ones first
            with suppress(OSError):
                one.rmdir()
        raise
