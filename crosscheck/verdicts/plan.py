"""Plan of a run: mechanisms and their cases, found in a folder, chosen by name."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from crosscheck.engines.base import sample_times
from crosscheck.measures.mechanisms import read_mechanism
from crosscheck.verdicts.results import CaseRow, SkeletonLink
from crosscheck.verdicts.scope import is_case_named
from flexinv.errors import InputError
from flexinv.files.load_cases import Case, load_cases
from flexinv.model.mechanism import WORLD, Mechanism
from flexinv.validation import find_nearest_word

MOST_SAMPLES = 1e7  # a hundred series of them fill 8 GB: no engine is compared on more
LARGEST_TEXT = 20_000  # [characters] of a model file that a report shows


@dataclass(frozen=True)
class Task:
    """One case of one mechanism: folder of its files, the sample times, and when the motion comes to rest.

    time : (samples,) [s]; rest : [s]
    """

    folder: Path
    mechanism: Mechanism
    case: Case
    time: NDArray[np.float64]
    rest: float


@dataclass(frozen=True)
class Plan:
    """Tasks to run, and the model folders that could not be read: (name, message)."""

    tasks: tuple[Task, ...]
    broken: tuple[tuple[str, str], ...] = ()


def discover(models: Path, names: Sequence[str] = ()) -> Plan:
    """Read every mechanism in ``models`` whose folder fits one of ``names``.

    names : "flex_one_link", "flex_*" or "flex_one_link/cycloid"; none means all
    Raises InputError where a name fits nothing.
    """
    folders = {f.parent.name: f.parent for f in sorted(models.glob("*/mechanism.toml"))}
    wanted = [name.split("/", 1) for name in names] or [["*"]]
    tasks: list[Task] = []
    broken: list[tuple[str, str]] = []
    for name, folder in folders.items():
        if cases := [w[1] if len(w) > 1 else "*" for w in wanted if fnmatchcase(name, w[0])]:
            try:
                tasks += _list_tasks(folder, cases)
            except (InputError, OSError, ValueError, MemoryError, ArithmeticError, RecursionError) as error:
                broken.append((name, f"{type(error).__name__}: {error}"))
    _check_names(names, tasks, broken, folders)
    return Plan(tuple(tasks), tuple(broken))


def _list_tasks(folder: Path, patterns: Iterable[str]) -> list[Task]:
    mechanism = read_mechanism(folder)
    patterns = list(patterns)
    cases = load_cases(folder, mechanism)
    return [make_task(folder, mechanism, c) for n, c in cases.items() if any(fnmatchcase(n, p) for p in patterns)]


def make_task(folder: Path, mechanism: Mechanism, case: Case) -> Task:
    """Return the task of one case; the motion is at rest after the last sample with a velocity.

    Raises InputError where there are more samples than anybody could compare.
    """
    if not case.end <= MOST_SAMPLES * case.sample:
        raise InputError(
            f"{folder.name}/{case.name}: end_s = {case.end:g} and sample_s = {case.sample:g} make {case.end / case.sample:.3g} "
            f"samples, expected at most {MOST_SAMPLES:g}; write a shorter end_s or a longer sample_s"
        )
    time = sample_times(case)
    _, qd, _ = case.motion.evaluate(mechanism, time)
    moving = np.flatnonzero(np.any(qd != 0.0, axis=1)) if qd.size else np.zeros(0, dtype=int)
    rest = float(time[min(moving[-1] + 1, time.size - 1)]) if moving.size else 0.0
    return Task(folder, mechanism, case, time, rest)


def _check_names(
    names: Sequence[str], tasks: list[Task], broken: list[tuple[str, str]], folders: dict[str, Path]
) -> None:
    have = {(t.folder.name, t.case.name) for t in tasks} | {(name, "*") for name, _ in broken}
    for name in names:
        if not any(is_case_named(name, m, c) for m, c in have):
            mechanism, _, case = name.partition("/")
            raise InputError(f"nothing to run is called {name!r}{_describe_choice(mechanism, case, folders)}")


def _describe_choice(mechanism: str, case: str, folders: dict[str, Path]) -> str:
    """Return advice for a name that fits nothing, and all that there is."""
    folder = folders.get(mechanism)  # it was read: what cannot be is broken, which fits
    cases = sorted(load_cases(folder, read_mechanism(folder))) if folder is not None else []
    known, asked = (cases, case) if cases else (sorted(folders), mechanism)
    near = None if asked in known else find_nearest_word(asked, known)
    start = f"{mechanism}/" if cases else ""
    write = f"; write '{start}{near}'" if near else ""
    kind = f"cases of {mechanism}" if cases else "mechanisms here"
    return f"{write}; {kind}: {', '.join(known) or 'none'}"


def make_case_row(one: Task) -> CaseRow:
    """Return the row of a report about the case itself."""
    mechanism = one.mechanism
    case = one.case
    return CaseRow(
        mechanism=one.folder.name,
        case=case.name,
        mechanism_title=mechanism.title,
        title=case.title,
        source=case.source,
        mechanism_source=mechanism.source,
        notes=(*mechanism.notes, *_split_notes(case.notes)),
        quantities=tuple(case.quantities),
        end=case.end,
        step=case.step,
        sample=case.sample,
        rest=one.rest,
        skeleton=tuple(list_skeleton_links(mechanism)),
        files={f.name: _read_text(f) for f in sorted(one.folder.glob("*.toml")) if f.is_file()},
    )


def list_skeleton_links(mechanism: Mechanism) -> Iterator[SkeletonLink]:
    """Yield what a picture of the mechanism connects: links with parent and place in the world [m]."""
    for joint in mechanism.joints:
        at = joint.placement.position.tolist() if joint.parent == WORLD else None
        bends = mechanism.link_of[joint.child].beam is not None
        yield {"link": joint.child, "parent": joint.parent, "bends": bends, "at": at}


def _split_notes(notes: str | Iterable[str]) -> tuple[str, ...]:
    return ((notes,) if notes else ()) if isinstance(notes, str) else tuple(notes)


def _read_text(file: Path) -> str:
    with file.open(encoding="utf-8", errors="replace") as stream:
        text = stream.read(LARGEST_TEXT + 1)
    return text if len(text) <= LARGEST_TEXT else text[:LARGEST_TEXT] + "\n... (cut off here)\n"
