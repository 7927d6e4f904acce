"""Many mechanisms at once: one for each URDF below a folder, with a name of its own and a first case.

A file that cannot be read keeps no other back: it is a line of the answer.  What stands already and is another robot stays.
"""

from __future__ import annotations

import os
import re
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from crosscheck.run.reading_limits import ReadingLimits
from crosscheck.workflows.scaffold import ROBOT, format_title, write_robot
from flexinv.errors import InputError

LONGEST = 64  # letters of a name, as `crosscheck new NAME` takes it
URDF = ".urdf"
KINDS = ("written", "there", "kept", "unread")


@dataclass(frozen=True)
class NewRobot:
    """One URDF and what became of it.

    file : below the folder; name : of the mechanism; kind : one of KINDS; words : why it is kept or unread, "" else
    """

    file: str
    name: str
    kind: str
    words: str = ""


def list_urdfs(folder: Path) -> tuple[str, ...]:
    """Return the URDFs below a folder, sorted, by their paths from there [-].

    Raises InputError where there are none.  Links to folders are not followed.
    """
    found = []
    for place, _, names in os.walk(folder):
        found += [str((Path(place) / name).relative_to(folder)) for name in names if name.lower().endswith(URDF)]
    if not found:
        raise InputError(
            f"{folder}: no file *.urdf is below it; write a folder of URDFs (xacro files have to be expanded first)"
        )
    return tuple(sorted(found))


def choose_names(files: Iterable[str]) -> dict[str, str]:
    """Return a valid name for each file, which no other has, in whatever case [-].

    It is the file's own name; where several files share it, as many folders above stand before it as tell them apart.
    """
    known = tuple(files)
    names = {file: _make_name(Path(file).parts[-1:]) for file in known}
    for depth in range(2, max((len(Path(file).parts) for file in known), default=1) + 1):
        counted = Counter(name.lower() for name in names.values())
        for file in known:
            if counted[names[file].lower()] > 1:
                names[file] = _make_name(Path(file).parts[-depth:])
    return _add_numbers(names)


def _make_name(parts: tuple[str, ...]) -> str:
    """Join parts of a path to a name that a mechanism may have; the last part ends in .urdf."""
    text = "_".join((*parts[:-1], parts[-1][: -len(URDF)]))
    plain = re.sub(r"[^A-Za-z0-9_-]+", "_", text).strip("_-")
    return plain[-LONGEST:].lstrip("_-") or "robot"


def _add_numbers(names: Mapping[str, str]) -> dict[str, str]:
    """Put a number behind what is still the same."""
    result: dict[str, str] = {}
    taken: set[str] = set()
    single = {name for name, times in Counter(name.lower() for name in names.values()).items() if times == 1}
    for file, name in names.items():
        chosen = name
        number = 1
        while chosen.lower() in taken or (number > 1 and chosen.lower() in single):
            number += 1
            chosen = f"{name[: LONGEST - len(str(number)) - 1]}_{number}"
        taken.add(chosen.lower())
        result[file] = chosen
    return result


def write_from_folder(
    folder: Path,
    models: Path,
    base: str = "fixed",
    ask: Callable[[Sequence[str]], bool] = lambda names: False,
    limits: ReadingLimits | None = None,
    notify: Callable[[int, int, str], None] = lambda done, total, name: None,
) -> tuple[NewRobot, ...]:
    """Write a mechanism for each URDF below a folder; return what became of each.

    base : "fixed" or "free"; ask : called once, with the names that stand already and hold something else: True writes them anew
    limits : of reading one file; notify : called with the number that is done, of how many, and the name

    Raises InputError where no URDF is below the folder.
    """
    names = choose_names(list_urdfs(folder))
    stands = {file: models / name for file, name in names.items() if (models / name).exists()}
    same = {file for file, target in stands.items() if _is_same(target, folder / file, base)}
    others = [target.name for file, target in stands.items() if file not in same]
    replaced = bool(others) and ask(others)
    result: list[NewRobot] = []
    for file, name in names.items():
        notify(len(result), len(names), name)
        target = models / name
        if file in same:
            result.append(NewRobot(file, name, "there"))
        elif file in stands and not replaced:
            result.append(NewRobot(file, name, "kept", f"{target} exists already, and is not this robot as it is now"))
        else:
            result.append(_write_one(folder / file, file, target, base, limits or ReadingLimits()))
    notify(len(result), len(names), "")
    return tuple(result)


def _write_one(path: Path, file: str, target: Path, base: str, limits: ReadingLimits) -> NewRobot:
    name = target.name
    try:
        limits.run_function(write_robot, str(path), target, format_title(name), f"URDF file {file}", base)
    except (InputError, OSError) as problem:
        return NewRobot(file, name, "unread", " ".join(str(problem).removeprefix(str(path)).split()))
    return NewRobot(file, name, "written")


def _is_same(target: Path, file: Path, base: str) -> bool:
    """Return True if a mechanism is written around a file as it is now, on that base [-]."""
    copy = target / ROBOT
    if not copy.is_file() or not file.is_file() or copy.stat().st_size != file.stat().st_size:
        return False
    try:
        table = tomllib.loads((target / "mechanism.toml").read_text(encoding="utf-8")).get("urdf", {})
    except (OSError, ValueError):
        return False
    return table.get("base", "fixed") == base and copy.read_bytes() == file.read_bytes()


def list_lines(robots: Iterable[NewRobot]) -> Iterator[str]:
    """Yield a line for each URDF that became no mechanism, then how many became one [-]."""
    known = tuple(robots)
    counted = Counter(robot.kind for robot in known)
    for robot in known:
        if robot.words:
            yield f"{robot.file}: {robot.words}"
    words = [f"{counted['written']} of {len(known)} written"]
    if counted["there"]:
        words.append(f"{counted['there']} there already")
    if counted["kept"]:
        words.append(f"{counted['kept']} kept as they were (--replace writes them anew)")
    if counted["unread"]:
        words.append(f"{counted['unread']} cannot be used")
    yield ", ".join(words)
