"""Provenance of a run's values: the model's files, the engine's version and settings, packages, and our own code, by digest.

Where a value has moved, what has changed of these is the first thing to know.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from crosscheck import output_folder as owned
from crosscheck.verdicts.results import CaseRow, Results, RunRow

FILE = "provenance.json"
ROOT = Path(__file__).resolve().parents[2]
OURS = ("flexinv", "crosscheck")
# Folders of crosscheck in which values of engines are made; the others judge, store and show.
MAKES_VALUES = ("engines", "measures", "doors", "kit", "run")


@dataclass(frozen=True)
class Provenance:
    """Sources of values, by digest.

    files : by mechanism, the digest of each file of its model; engines : by "mechanism/case engine", the digest of
        the model as it was given to the engine, version and settings
    packages : versions; code : digests of our own packages, as far as they make values
    """

    files: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    engines: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    packages: Mapping[str, str] = field(default_factory=dict)
    code: Mapping[str, str] = field(default_factory=dict)

    def describe_source_changes(self, before: Provenance, mechanism: str, case: str, engine: str) -> str:
        """Return in words what has changed since, of all that values of an engine in a case depend on; "" where nothing has."""
        run = f"{mechanism}/{case} {engine}"
        old = before.engines.get(run, {})
        new = self.engines.get(run, {})
        words = []
        has_new_model = old.get("model") != new.get("model")
        if has_new_model:
            files = _list_changed(before.files.get(mechanism), self.files.get(mechanism))
            words.append(f"the model {mechanism} ({', '.join(files) or 'data that its files name'})")
        if old.get("version") != new.get("version"):
            words.append(f"the version of {engine} ({old.get('version') or 'none'} -> {new.get('version') or 'none'})")
        elif old.get("settings") != new.get("settings") and not has_new_model:
            words.append(f"the settings of {engine}")
        packages = _list_changed(before.packages, self.packages)
        words += [f"versions of packages ({', '.join(packages)})"] if packages else []
        code = _list_changed(before.code, self.code)
        words += [f"our own code ({', '.join(code)})"] if code else []
        return " and ".join(words)


def _list_changed(before: Mapping[str, str] | None, after: Mapping[str, str] | None) -> list[str]:
    """Return the names whose digests differ; where one side knows nothing, nothing can be said."""
    if before is None or after is None:
        return []
    return sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))


def collect_provenance(results: Results) -> Provenance:
    """Return the sources of the values of a run."""
    return Provenance(
        files=dict(_list_files(results.cases)),
        engines={f"{run.mechanism}/{run.case} {run.engine}": _collect_engine_sources(run) for run in results.runs},
        packages={name: version for name, version in results.versions.items() if name not in OURS},
        code={name: compute_code_digest(ROOT / name) for name in OURS},
    )


def _list_files(cases: Iterable[CaseRow]) -> Iterable[tuple[str, dict[str, str]]]:
    for case in cases:
        if case.files:
            yield case.mechanism, {name: _compute_digest(text) for name, text in case.files.items()}


def _collect_engine_sources(run: RunRow) -> dict[str, str]:
    settings = json.dumps(run.settings, sort_keys=True, default=str)
    return {"model": run.model_hash, "version": run.version, "settings": _compute_digest(settings)}


def _compute_digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@cache
def compute_code_digest(package: Path) -> str:
    """Return a digest of the Python files of a package of ours, of crosscheck those that make values."""
    folders = [package / name for name in MAKES_VALUES] if package.name == "crosscheck" else [package]
    digest = hashlib.sha256()
    for folder in folders:
        for file in sorted(folder.rglob("*.py")):
            digest.update(file.relative_to(package).as_posix().encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def join_provenance(before: Provenance, after: Provenance) -> Provenance:
    """Return the sources after a run over a part: mechanisms and runs that were not part of it keep theirs."""
    return Provenance({**before.files, **after.files}, {**before.engines, **after.engines}, after.packages, after.code)


def read_provenance(folder: Path) -> Provenance:
    """Return the sources of blessed values; empty where they are not known.  Raises ValueError, OSError."""
    try:
        plain: Any = json.loads((folder / FILE).read_text(encoding="utf-8"))
    except FileNotFoundError:
        return Provenance()
    if not isinstance(plain, dict) or not set(plain) <= {"files", "engines", "packages", "code"}:
        raise ValueError(f"{folder / FILE} is no list of what values depend on; bless a run again")
    return Provenance(**plain)


def write_provenance(folder: Path, provenance: Provenance) -> None:
    """Write the sources of blessed values.  Raises OSError."""
    plain = {name: dict(getattr(provenance, name)) for name in ("files", "engines", "packages", "code")}
    owned.replace(folder / FILE, json.dumps(plain, indent=1, sort_keys=True) + "\n")
