"""The folder of a corpus: a kit for every case, its consensus, ``manifest.json`` with the hash of every file, and pages.

What depends on the machine and the day (versions, processor, times) stands in ``machine.json``, which no hash covers; all
else is the same bytes for the same records.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from crosscheck import output_folder as owned
from crosscheck.corpus.consensus import REACHED, CaseConsensus
from crosscheck.corpus.entry import (
    FLOOR_REASON,
    FORMAT,
    CaseEntry,
    list_single_author_series,
    make_entry,
    make_expected_record,
)
from crosscheck.corpus.notes import CorpusTable, MechanismNote
from crosscheck.corpus.published import compare_published
from crosscheck.kit.write import write as write_kit
from crosscheck.measures.limits import REFERENCE
from crosscheck.measures.series_csv import write as write_series
from crosscheck.run.isolation import open_scratch_folder
from crosscheck.verdicts.plan import Task
from crosscheck.verdicts.results import Results
from flexinv.errors import InputError

MANIFEST = "manifest.json"
MACHINE = "machine.json"
KITS = "kits"
OURS = (
    "expected",
    "schema",
    "consensus.json",
    "LICENCE.md",
    "RECIPE.md",
)  # what a recipe keeps of a kit: none of it is the mechanism's data
LICENCE = """# {mechanism}/{case}: source and licence

* Mechanism: {source}
* Case: {case_source}
* Licence of the data: {licence}
{attribution}
{files}
The values below `expected/` are computed; who agrees on them is said in `consensus.json`.
"""
RECIPE = """# {mechanism}/{case}: a recipe

The data of this mechanism may not be passed on with this corpus: {licence}. So its kit is not here. These steps write it:

{steps}

`case.json` of that kit says `"digest": "{digest}"`: then it is the case to which the values in `expected/` belong.
"""


@dataclass(frozen=True)
class Corpus:
    """A corpus as it was written: what is said of every case, and the folder."""

    folder: Path
    entries: tuple[CaseEntry, ...]

    @property
    def reached(self) -> int:
        """Return the number of cases that have a consensus, or a closed form, in every torque [-]."""
        return sum(one["status"] in REACHED for one in self.entries)


def write_corpus(cases: Iterable[CaseConsensus], notes: CorpusTable, results: Results, out: Path) -> Corpus:
    """Write kits, consensus and manifest below a folder that is ours.  Raises InputError where two cases have one id."""
    entries: dict[str, CaseEntry] = {}
    for case in cases:
        note = notes.find_licence(case.task)
        one = make_entry(case, note, list(compare_published(case, notes.published)))
        if (other := entries.get(one["id"])) is not None:
            names = " and ".join(f"{x['mechanism']}/{x['case']}" for x in (other, one))
            raise InputError(f"{names} would have the same id {one['id']}: give one of them another name")
        entries[one["id"]] = one
        _write_case_kit(case, note, one, out / KITS / one["id"])
    return _write_manifest(tuple(entries.values()), results, out)


def _write_manifest(entries: tuple[CaseEntry, ...], results: Results, out: Path) -> Corpus:
    short = [{key: value for key, value in one.items() if key not in ("series", "floor", "format")} for one in entries]
    files = [
        [file.relative_to(out).as_posix(), compute_digest(file)]
        for file in sorted((out / KITS).rglob("*"))
        if file.is_file()
    ]
    hashes = {one["id"]: {n: h for n, h in files if n.startswith(f"{KITS}/{one['id']}/")} for one in entries}
    plain = {
        "format": FORMAT,
        "reached": sum(one["status"] in REACHED for one in entries),
        "floor": FLOOR_REASON,
        "cases": [{**rest, "files": hashes[one["id"]]} for one, rest in zip(entries, short, strict=True)],
    }
    owned.write(out / MANIFEST, format_json(plain))
    facts = {"started": results.started, "machine": dict(results.machine), "versions": dict(results.versions)}
    owned.write(out / MACHINE, format_json({**facts, "elapsed": results.elapsed}))
    return Corpus(out, entries)


def _write_case_kit(case: CaseConsensus, note: MechanismNote, one: CaseEntry, folder: Path) -> None:
    """Write the kit of a case, or where its data may not be passed on a recipe."""
    task = case.task
    with open_scratch_folder() as place:
        kit = place / "kit"
        file = write_kit(task.mechanism, task.case, kit, make_expected_record(case, case.records.get(REFERENCE)))
        if single := list_single_author_series(case):
            write_series(kit / "expected" / "single.csv", task.time, single)
        (kit / "consensus.json").write_text(format_json(one), encoding="utf-8")
        (kit / "LICENCE.md").write_text(render_licence(task, note), encoding="utf-8")
        if not note.redistribute:
            words = {"mechanism": task.folder.name, "case": task.case.name, "digest": file.digest}
            lines = "\n".join(f"{k}. {step}" for k, step in enumerate(one["recipe"], 1))
            recipe = RECIPE.format(**words, licence=note.licence, steps=lines)
            (kit / "RECIPE.md").write_text(recipe, encoding="utf-8")
        texts = [_find_licence_text(task.folder.parent, name) for name in note.licence_files]
        for text in texts:
            (kit / text.name).write_bytes(text.read_bytes())
        kept = (*OURS, *(text.name for text in texts))
        for source in sorted(f for f in kit.rglob("*") if f.is_file()):
            inner = source.relative_to(kit)
            if note.redistribute or inner.parts[0] in kept:
                target = folder / inner
                target.parent.mkdir(parents=True, exist_ok=True)
                owned.write(target, source.read_bytes())


def render_licence(task: Task, note: MechanismNote) -> str:
    """Return the page of source and licence of a case [-]."""
    return LICENCE.format(
        mechanism=task.folder.name,
        case=task.case.name,
        source=task.mechanism.source,
        case_source=task.case.source or "not stated",
        licence=note.licence,
        attribution=f"* To be named: {note.attribution}" if note.attribution else "",
        files="".join(f"* Licence text: `{Path(name).name}`\n" for name in note.licence_files),
    )


def _find_licence_text(models: Path, name: str) -> Path:
    """Return a licence text of a folder of models.  Raises InputError where it is not there, or leads out."""
    file = models / name
    if not file.resolve().is_relative_to(models.resolve()) or not file.is_file():
        raise InputError(
            f"{models / 'corpus.toml'}: licence_files: {name!r} is no file of {models}; write its path in there, such as "
            "'licences/MIT.txt'"
        )
    return file


def compute_digest(file: Path) -> str:
    """Return the SHA-256 of a file."""
    return sha256(file.read_bytes()).hexdigest()


def format_json(plain: Mapping[str, object]) -> str:
    """Return values as JSON text, the same for the same values."""
    return json.dumps(plain, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
