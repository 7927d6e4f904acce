"""Records as an engine: answer folders in ``models/NAME/records/ENGINE/``, of a program that cannot be run here, or of a paper.

The answer to a case is the folder ``CASE`` in there; one in ``ENGINE`` itself answers the case that its ``meta.json`` names, or
every one that it fits.  A record is compared, judged and diagnosed as every engine; a cause is repaired in the reference alone.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from crosscheck.doors.packages import NAME
from crosscheck.engines.base import Options
from crosscheck.kit.answer import LARGEST_JSON, read_answer, resolve_file
from crosscheck.measures.record import Record
from flexinv.errors import InputError
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism

FOLDER = "records"


def list_engine_names(models: Path) -> tuple[str, ...]:
    """Return the names of all engines that there are records of in a folder of models.  Raises InputError for a bad name."""
    found = sorted({f.name for f in models.glob(f"*/{FOLDER}/*") if f.is_dir()})
    for name in found:
        if not NAME.fullmatch(name):
            raise InputError(
                f"{models}/*/{FOLDER}/{name}: an engine called {name!r}; expected letters, digits, ., _ and -"
            )
    return tuple(found)


def open_adapter(name: str, mechanism: str, settings: Mapping[str, Any]) -> RecordedAdapter:
    """Return the adapter of the records of an engine; mechanism : the folder that has them."""
    return RecordedAdapter(Path(mechanism) / FOLDER / name, bool(mechanism))


class RecordedAdapter:
    """The adapter of one folder of answers; it gives the same whatever mechanism it is asked for."""

    MESHES = True  # kits hold them
    repeatable = False

    def __init__(self, folder: Path, there: bool) -> None:
        """Keep the folder; there : False where no mechanism was named, as when engines are listed."""
        self._folder = folder
        self._there = there

    def version(self) -> str:
        """Return nothing: an answer states its own."""
        return ""

    def abilities(self) -> str:
        """Return one sentence: what records can do here."""
        return f"answers that were recorded elsewhere, in {FOLDER}/{self._folder.name}/ of a mechanism"

    def unsupported(self, mechanism: Mechanism, case: Case, engine: str) -> str | None:
        """Return the reason why there is nothing to compare, or None where there is."""
        return None if self._find_answer(case) is not None else "nobody recorded this case"

    def run(self, mechanism: Mechanism, case: Case, engine: str, options: Options) -> Record:
        """Return the record [units of the file].  Raises InputError where it is none."""
        folder = self._find_answer(case)
        if folder is None:
            raise InputError(f"{self._folder} has no answer to {case.name}")
        return read_answer(folder, mechanism, case, engine)

    def _find_answer(self, case: Case) -> Path | None:
        """Return the folder with the answer to a case."""
        answer = self._folder / case.name
        if answer.is_dir():
            if not answer.resolve().is_relative_to(self._folder.resolve()):
                raise InputError(f"{answer} leads out of its folder; expected an answer")
            return answer
        if not (self._folder / "series.csv").exists() and not (self._folder / "meta.json").exists():
            return None
        return self._folder if self._is_for_case(case) else None

    def _is_for_case(self, case: Case) -> bool:
        """Return True if the answer beside the folders of cases is for this one: it says so, or says nothing."""
        file = resolve_file(self._folder, "meta.json")
        try:
            if not file.is_file() or file.stat().st_size > LARGEST_JSON:
                return True
            plain = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            return True  # what is wrong with it is said when it is read
        said = plain.get("name", "") if isinstance(plain, dict) else ""
        return said in ("", case.name)
