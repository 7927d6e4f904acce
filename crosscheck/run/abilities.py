"""Abilities of engines: asked once per adapter for all cases of a run, in one process, so that none starts to say "no"."""

from __future__ import annotations

import json
import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

from crosscheck.engines import Engine
from crosscheck.engines.job_files import AbilitiesJobFile, AdapterDescription, RefusalLine
from crosscheck.measures.record import Record, compute_fingerprint
from crosscheck.run.isolation import Attempt, ChildProcesses, ProcessEnd, open_scratch_folder, run_child
from crosscheck.verdicts.plan import Task

LIMIT = 120.0  # [s] to import an engine and ask it: a cold disk takes some ten seconds
Pair = tuple[Task, Engine]


@dataclass(frozen=True)
class Abilities:
    """Answers of an adapter.

    described : version and abilities, None where it did not come to that; refused : why it cannot do a pair, by its number
    message : why it was not asked everything, ""
    """

    described: AdapterDescription | None
    refused: Mapping[int, str] = field(default_factory=dict)
    message: str = ""


def ask_abilities(engine: Engine, pairs: Sequence[Pair], children: ChildProcesses) -> Abilities:
    """Ask the adapter of ``engine`` what it is and which of the cases it can do; what it does not answer stays open.

    pairs : cases, with the engines of this adapter.  Where its process crashes or hangs, the cases that are left are asked
    one by one as they run, each in a process of its own.
    """
    cases = [(str(task.folder.resolve()), one.name) for task, one in pairs]
    with open_scratch_folder() as folder:
        out = folder / "answers"
        # as they were read here: the natural modes of a damping ratio are not computed once more for every adapter
        out.with_suffix(".asked").write_bytes(pickle.dumps([(task.mechanism, task.case) for task, _ in pairs]))
        job: AbilitiesJobFile = {
            "kind": "abilities",
            **engine.door,
            "engine": engine.name,
            "cases": cases,
            "out": str(out),
        }
        ending = run_child(job, folder, LIMIT, children)
        described, answers = read_answers(out)
    left = max(0, len(pairs) - len(answers))
    refused = {k: reason for k, line in enumerate(answers) if (reason := line["reason"])}
    return Abilities(described, refused, "" if ending.status == "ok" else describe_ending(ending, left))


def read_answers(file: Path) -> tuple[AdapterDescription | None, list[RefusalLine]]:
    """Return the lines that were written whole: what the adapter is, None without it, and an answer per case."""
    try:
        text = file.read_text(encoding="utf-8").splitlines(keepends=True)
        lines = [json.loads(line) for line in text if line.endswith("\n")]
    except (OSError, ValueError):
        return None, []
    return (cast(AdapterDescription, lines[0]) if lines else None), lines[1:]


def describe_ending(ending: ProcessEnd, left: int) -> str:
    """Return the words for a reader about a process that did not answer everything."""
    why = f"asked in one process what it can do in all cases: {ending.message}"
    return f"{why}; {left} case{'s were' if left != 1 else ' was'} asked one by one" if left else why


def make_skipped_attempt(task: Task, engine: Engine, reason: str, version: str) -> Attempt:
    """Return the attempt of an engine that cannot do a case: no process has run."""
    known = compute_fingerprint(task.mechanism, task.case.motion)
    return Attempt(Record(engine.name, "skipped", reason, version=version, model_hash=known))
