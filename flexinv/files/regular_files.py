"""Regular files: what a name stands for is looked at before it is read, so that a pipe, a device or a socket holds nobody up."""

from __future__ import annotations

import os
import stat
from pathlib import Path

FILE_KINDS = (
    (stat.S_ISFIFO, "a named pipe (FIFO)"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISDIR, "a folder"),
)
MISSING = "no such file"
LOOP = "a symbolic link that leads to itself"


class NotRegularFile(OSError):
    """A name that stands for no file whose bytes can be read, and what it stands for."""


def describe_kind(path: Path) -> str:
    """Return in words the pipe, device or folder that a name stands for [-], "" for a regular file."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError, RuntimeError) as error:
        return _describe_missing_file(path, error)
    return _describe_mode(mode)


def _describe_mode(mode: int) -> str:
    if stat.S_ISREG(mode):
        return ""
    return next((words for holds, words in FILE_KINDS if holds(mode)), "no regular file")


def _describe_missing_file(path: Path, error: Exception) -> str:
    if isinstance(error, FileNotFoundError | NotADirectoryError):
        return f"a link to {os.readlink(path)!r}, which is not there" if path.is_symlink() else MISSING
    words = getattr(error, "strerror", None) or str(error)
    if "symbolic link" in words or "Symlink loop" in words:
        return LOOP
    return f"a name that the system refuses ({words})"


def read_regular(path: Path, largest: int) -> bytes:
    """Return the bytes of a regular file, at most ``largest`` + 1 [byte] of it.

    Raises NotRegular: what the name stands for.  The file is opened without waiting, and looked at once it is open: whatever
    takes its place meanwhile is looked at, too.
    """
    if words := describe_kind(path):
        raise NotRegularFile(words)
    try:
        number = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except OSError as error:
        raise NotRegularFile(f"a file that cannot be opened ({error.strerror})") from None
    with open(number, "rb") as stream:
        if words := _describe_mode(os.fstat(number).st_mode):
            raise NotRegularFile(words)
        try:
            return stream.read(largest + 1)
        except OSError as error:
            raise NotRegularFile(f"a file that cannot be read ({error.strerror})") from None
