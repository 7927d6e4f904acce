"""Cache of attempts: an engine's results for a case, reused while nothing that matters has changed.

An attempt is known by a key: the mechanism, the case, the engine, its options, the versions of all packages that results
depend on, and the sources of this project.  Only answers are kept; what failed is tried again.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from hashlib import sha256
from pathlib import Path

from crosscheck import output_folder as owned
from crosscheck.doors.registry import compute_answer_digest
from crosscheck.engines import Engine
from crosscheck.engines.base import Options as EngineOptions
from crosscheck.measures.record import RecordError, check, compute_fingerprint, read_record, save
from crosscheck.run.isolation import Attempt
from crosscheck.verdicts.plan import Task
from crosscheck.verdicts.results import list_versions

KEPT = ("ok", "skipped")


@dataclass(frozen=True)
class AttemptFolder:
    """A folder of attempts; several processes may use it at once.

    engines : those whose answers depend on more than a case and our sources: programs and records (`crosscheck.doors`)
    """

    folder: Path
    engines: Mapping[str, Engine] = field(default_factory=dict)

    def find(self, task: Task, engine: str, options: EngineOptions | None = None) -> Attempt | None:
        """Return the attempt that ``engine`` made at the task before, or None."""
        stem = self.make_record_path(task, engine, options)
        try:
            words = json.loads(stem.with_name(stem.name + ".attempt").read_text(encoding="utf-8"))
            record = read_record(stem)
            check(record, task.time)
            return Attempt(record, words["printed"], words["elapsed"])
        except (OSError, ValueError, LookupError, RecordError):
            return None

    def add_answer(self, task: Task, engine: str, attempt: Attempt, options: EngineOptions | None = None) -> None:
        """Write an attempt that came to an answer: the words last, so that who finds them finds everything."""
        if attempt.record.status not in KEPT:
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        stem = self.make_record_path(task, engine, options)
        save(attempt.record, owned.add_record_to_list(stem))
        words = json.dumps({"printed": attempt.printed, "elapsed": attempt.elapsed})
        owned.write(stem.with_name(stem.name + ".attempt"), words)

    def make_record_path(self, task: Task, engine: str, options: EngineOptions | None = None) -> Path:
        """Return the path of an attempt's files without their endings (`crosscheck.measures.record.save`)."""
        known = self.engines.get(engine)
        return self.folder / compute_attempt_key(task, engine, add_door_digest(known, task.folder, options or {}))

    @contextlib.contextmanager
    def take_lock(self, task: Task, engine: str) -> Iterator[None]:
        """Let one process at a time look for an attempt and make it (where the system has file locks)."""
        self.folder.mkdir(parents=True, exist_ok=True)
        with (self.folder / f"{compute_attempt_key(task, engine, {})}.lock").open("w") as file:
            with contextlib.suppress(ImportError):
                import fcntl

                fcntl.flock(file, fcntl.LOCK_EX)
            yield


def add_door_digest(engine: Engine | None, folder: Path, options: EngineOptions) -> EngineOptions:
    """Return the options with a digest of what is behind the door of an engine, where it has one."""
    behind = "" if engine is None else compute_answer_digest(engine, folder)
    return {**options, **({"door": behind} if behind else {})}


def compute_attempt_key(task: Task, engine: str, options: EngineOptions) -> str:
    """Return a name that changes with everything that the attempt depends on."""
    case = replace(task.case, limits=())  # they judge; nothing that an engine gives depends on them
    files = (file.read_bytes() if file else b"" for file in (task.mechanism.urdf, case.measured))
    given = task.folder.name, task.mechanism, *(sha256(data).hexdigest() for data in files), case, dict(options)
    return compute_fingerprint(*given, engine, compute_surroundings_digest())


@cache
def compute_surroundings_digest() -> str:
    """Return a digest of the versions of packages and of the sources of flexinv and crosscheck."""
    root = Path(__file__).resolve().parents[2]
    digest = sha256(json.dumps(list_versions(), sort_keys=True).encode())
    sources = (f for package in ("flexinv", "crosscheck") for f in (root / package).rglob("*"))
    for file in sorted(
        f for f in sources if f.suffix in (".py", ".in")
    ):  # .in: programs in C that are filled and compiled
        digest.update(str(file.relative_to(root)).encode() + file.read_bytes())
    return digest.hexdigest()
