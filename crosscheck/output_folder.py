"""Folders that crosscheck writes into: a list there says which files are ours, and no other file is overwritten or removed.

The list is a file ``.crosscheck`` with one relative name per line.  A name is added before its file is written, so that a
run that is killed leaves nothing that the next one does not know.
"""

from __future__ import annotations

import datetime
import json
import os
import shutil
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import NamedTemporaryFile

import filelock

from flexinv.errors import InputError

LIST = ".crosscheck"
LOCK = ".crosscheck.lock"
HOLDER = ".crosscheck.running"
OWN = (LIST, LOCK, HOLDER)


class FolderBusy(InputError):
    """Somebody else writes into the same folder."""


def begin(folder: Path, keep: str = "") -> None:
    """Make the folder of a report, and remove what an older one wrote there; keep: a folder in it that stays.

    Raises InputError where it cannot be made, or holds files and no list: they are not ours.
    """
    check(folder)
    with convert_os_errors(folder):
        make_listed_folder(folder)
        remove(folder, keep=keep)


def check(folder: Path) -> None:
    """Raise InputError where a folder cannot be a report's: it holds files and no list of ours, or is no folder."""
    with convert_os_errors(folder):
        others = [] if (folder / LIST).is_file() or not folder.exists() else list_foreign_files(folder)
    if others:
        raise InputError(
            f"{folder} holds {others[0]}, which crosscheck did not write: write --out with a new or an empty folder "
            "(or, if this is the report of an older version, remove it)"
        )


def make_listed_folder(folder: Path) -> None:
    """Make the folder and its list, unless they are there.  Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / LIST).touch()


@contextmanager
def convert_os_errors(folder: Path) -> Iterator[None]:
    """Turn what the system says about a folder into an InputError that names it."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"{folder} cannot be written to: {reason}; write another folder") from error


def add_to_folder_list(file: Path) -> Path:
    """Note in the list of its folder that a file is ours, and return it; where no folder above has a list, nothing is noted.

    Raises FileExistsError where somebody else's file has that name.
    """
    root = next((above for above in file.absolute().parents if (above / LIST).is_file()), None)
    if root is None:
        return file
    name = file.absolute().relative_to(root).as_posix()
    if not os.path.lexists(file):
        with (root / LIST).open("a", encoding="utf-8") as text:
            text.write(name + "\n")
    elif name not in list_our_files(root):
        raise FileExistsError(f"{file} is there already, and crosscheck did not write it: move it away")
    return file


def add_record_to_list(stem: Path) -> Path:
    """Note both files of a record (`crosscheck.measures.record.save`) as ours and return their stem.  Raises FileExistsError."""
    for ending in (".npz", ".json"):
        add_to_folder_list(stem.with_name(stem.name + ending))
    return stem


def write(file: Path, data: str | bytes) -> None:
    """Write a file as ours: whole or not at all, whatever happens meanwhile.  Raises OSError."""
    replace(add_to_folder_list(file), data)


def replace(file: Path, data: str | bytes) -> None:
    """Write a file whole or not at all, beside it first and under a name that nobody has.  Raises OSError."""
    raw = data.encode("utf-8") if isinstance(data, str) else data
    with NamedTemporaryFile(dir=file.parent, prefix=f".{file.name[:100]}.", suffix=".part", delete=False) as part:
        try:
            part.write(raw)
            part.flush()
            os.chmod(part.name, _find_file_mode(file))
            os.replace(part.name, file)
        except BaseException:
            os.unlink(part.name)
            raise


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Hold back Ctrl-C and a polite kill while files are written that belong together: they are all old, or all new.

    What comes meanwhile is heard at the end.  Other threads than the main one hear no signals, and hold none back.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    # Not by the mask of this thread: a signal for the process is heard by any other thread, and handled here at once.
    heard: list[int] = []
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP) if hasattr(signal, "SIGHUP") else (signal.SIGINT,)
    before = {number: signal.signal(number, lambda number, _: heard.append(number)) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
    if heard:
        signal.raise_signal(signal.Signals(heard[0]))


def _find_file_mode(file: Path) -> int:
    """The mode of a file; of one that is not there, or has just been removed, what a new one gets."""
    try:
        return file.stat().st_mode
    except FileNotFoundError:
        return 0o666 & ~_read_umask()


def _read_umask() -> int:
    """Return the permissions that new files do not get (a temporary file has fewer)."""
    mask = os.umask(0)
    os.umask(mask)
    return mask


def list_our_files(folder: Path) -> set[str]:
    """Return the names of our files in a folder, relative to it."""
    try:
        return set((folder / LIST).read_text(encoding="utf-8").splitlines())
    except FileNotFoundError:
        return set()


def list_foreign_files(folder: Path) -> list[str]:
    """Return the names of files in a folder, relative to it, that are not ours."""
    known = list_our_files(folder)
    inside = (Path(top) / name for top, _, names in os.walk(folder) for name in names)
    return sorted(
        name for file in inside if (name := file.relative_to(folder).as_posix()) not in known and name not in OWN
    )


def remove(folder: Path, below: str = "", keep: str = "") -> None:
    """Remove our files from a folder, and folders that are empty then; below, keep: only those in it, none of those in it."""
    kept = []
    for name in sorted(list_our_files(folder)):
        if (below and not name.startswith(f"{below}/")) or (keep and name.startswith(f"{keep}/")):
            kept.append(name)
        elif _is_inside(folder, folder / name):
            (folder / name).unlink(missing_ok=True)
            for above in (folder / name).parents:
                if above == folder or not above.is_dir() or any(above.iterdir()):
                    break
                above.rmdir()
    replace(folder / LIST, "".join(f"{name}\n" for name in kept))


def _is_inside(folder: Path, file: Path) -> bool:
    """Return True if a file is one in the folder itself (no link leads out of it, and a list may say anything)."""
    return file.parent.resolve().is_relative_to(folder.resolve()) and not file.is_dir()


def move(source: Path, target: Path, name: str) -> None:
    """Move our files in the folder ``name`` of a report into another report's.  Raises OSError."""
    make_listed_folder(target)
    for one in sorted(list_our_files(source)):
        if one.startswith(f"{name}/") and (source / one).is_file():
            (target / one).parent.mkdir(parents=True, exist_ok=True)
            (source / one).rename(add_to_folder_list(target / one))
    remove(source, below=name)


@contextmanager
def open_report_folder(folder: Path) -> Iterator[None]:
    """Be the only one who writes a report into a folder.  Raises InputError where it is not ours, Busy where it is in use."""
    check(folder)
    with take_folder_lock(folder):
        yield


@contextmanager
def take_folder_lock(
    folder: Path, lock: str = LOCK, holder: str = HOLDER, what: str = "another run writes into"
) -> Iterator[None]:
    """Hold the lock of a folder (the system drops it when its holder dies).  Raises Busy with what is known of the other.

    Who holds it may take it again.  A folder that does not exist is made.
    """
    with convert_os_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        one = filelock.FileLock(folder.resolve() / lock, is_singleton=True)
        busy = not _can_acquire(one)
    if busy:
        raise FolderBusy(f"{what} {folder}{_describe_holder(folder / holder)}: wait until it has ended")
    first = one.lock_counter == 1
    try:
        if first:
            words = {
                "process": os.getpid(),
                "started": datetime.datetime.now().astimezone().isoformat(timespec="seconds"),
            }
            with suppress(OSError):
                (folder / holder).write_text(json.dumps(words), encoding="utf-8")
        yield
    finally:
        if first:
            with suppress(OSError):
                (folder / holder).unlink(missing_ok=True)
        one.release()


def _can_acquire(lock: filelock.BaseFileLock) -> bool:
    try:
        lock.acquire(blocking=False)
    except filelock.Timeout:
        return False
    return True


def remove_empty_folder(folder: Path) -> None:
    """Remove a folder that holds nothing but a list of nothing; another one stays as it is."""
    if list_our_files(folder) or {file.name for file in folder.glob("*")} - set(OWN):
        return
    for name in OWN:
        (folder / name).unlink(missing_ok=True)
    with suppress(OSError):
        folder.rmdir()


def _describe_holder(file: Path) -> str:
    try:
        holder = json.loads(file.read_text(encoding="utf-8"))
        return f" since {holder['started']} (process {holder['process']})"
    except (OSError, ValueError, LookupError, TypeError):
        return ""


def remove_tree(folder: Path) -> None:
    """Remove a folder with all that is in it, however deep that is; what cannot be removed stays."""
    for _ in range(2):
        try:
            shutil.rmtree(folder, ignore_errors=True)
        except RecursionError:
            _move_folders_up(folder)


def _move_folders_up(folder: Path) -> None:
    """Move every folder below another one up into it."""
    ahead = [str(folder)]
    count = 0
    while ahead:
        with suppress(OSError), os.scandir(ahead.pop()) as entries:
            for one in entries:
                if one.is_dir(follow_symlinks=False):
                    count += 1
                    moved = str(folder / f"flat-{count}")
                    os.rename(one.path, moved)
                    ahead.append(moved)
