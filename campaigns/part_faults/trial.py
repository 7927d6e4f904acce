"""A planted fault, written into a folder, loaded, reduced and linted, and what came of it."""

from __future__ import annotations

import random
import re
import shutil
import tempfile
import traceback
import warnings
from dataclasses import dataclass
from pathlib import Path

from campaigns.part_faults.table import PlantedFault
from crosscheck.linting.lint import lint
from flexinv.errors import InputError, ModelWarning
from flexinv.files.load_mechanism import load_mechanism
from flexinv.parts.craig_bampton import compute_reduction

# refused : one error, with the word of the fault; found : by lint; right : nothing is said of a part that is right
# off : something is said, and it is of another thing; silent : nothing is said; false alarm : of a part that is right
# traceback : any other exception
GOOD = ("refused", "found", "right")
# What an error says, beside the fault: what was expected, and what to write.
PARTS = ("expected", "write")


@dataclass(frozen=True)
class Outcome:
    """What came of a fault; said : the words."""

    name: str
    word: str
    said: str


def try_fault(planted: PlantedFault, seed: int) -> Outcome:
    """Plant a fault, and return what came of it [-]; seed : of all that is drawn by lot."""
    folder = Path(tempfile.mkdtemp())
    try:
        planted.make(random.Random(f"{planted.name} {seed}")).write(folder / "arm")
        return _judge(planted, folder / "arm")
    finally:
        shutil.rmtree(folder)


def _judge(planted: PlantedFault, folder: Path) -> Outcome:
    try:
        refusal = _load(folder)
        findings = [
            f"{one.level}: {one.check}, {one.place}: {one.given}; {one.why}; write {one.write}"
            for one in lint(folder).findings
        ]
    except InputError as error:
        refusal = str(error)
        findings = []
    except Exception:
        return Outcome(planted.name, "traceback", traceback.format_exc())
    said = [text.replace(str(folder), "DIR") for text in (refusal, *findings) if text]
    if not planted.words:
        return Outcome(planted.name, "false alarm" if said else "right", "\n".join(said))
    if not said:
        return Outcome(planted.name, "silent", "")
    named = any(re.search(planted.words, text, re.DOTALL) for text in said)
    clear = not refusal or all(part in refusal for part in PARTS)
    word = ("refused" if refusal else "found") if named and clear else "off"
    return Outcome(planted.name, word, "\n".join(said))


def _load(folder: Path) -> str:
    """The error of a mechanism whose parts are reduced, "" where there is none."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ModelWarning)
            for link in load_mechanism(folder).links:
                if link.part is not None:
                    compute_reduction(link.part)
    except InputError as error:
        return str(error)
    return ""
