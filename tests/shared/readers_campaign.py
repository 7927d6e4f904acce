"""Campaign: every URDF of example-robot-data through every reader that is installed, each against the reader of this project.

python tests/shared/readers_campaign.py                 # a row for each file, then what the readers made of them
python tests/shared/readers_campaign.py --every 10      # one file of ten
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from crosscheck.equivalence.readers import ReaderRow, compare_readers
from crosscheck.equivalence.result import REPAIRED
from flexinv.errors import InputError
from flexinv.files.from_urdf import find_robots_folder


@dataclass(frozen=True)
class ReaderTrial:
    """A file with the rows of its table, or the words of why there is none."""

    file: Path
    rows: list[ReaderRow]
    words: str
    seconds: float

    @property
    def unexplained(self) -> list[str]:
        """Readers that differ by more than what is named: repaired, more than `REPAIRED` of an effort's range is left."""
        return [
            row.reader for row in self.rows if row.comparison is not None and row.comparison.judged.after > REPAIRED
        ]


def tables(files: Iterable[Path]) -> Iterator[ReaderTrial]:
    """Yield the table of every file."""
    for file in files:
        begun, rows, words = time.perf_counter(), list[ReaderRow](), ""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                rows = compare_readers(str(file))
        except InputError as error:
            words = " ".join(str(error).split())[:200]
        yield ReaderTrial(file, rows, words, time.perf_counter() - begun)


def cell(row: ReaderRow) -> str:
    """A reader's result in few words: equal, the causes that are named, or why it refuses."""
    if row.comparison is None:
        return f"{row.reader}: cannot ({row.refusal[:160]})"
    causes = Counter(d.cause for d in row.comparison.differences)
    named = ", ".join(f"{count} x {cause}" for cause, count in causes.items())
    return f"{row.reader}: {row.result}" + (
        f" ({named}; repaired to {row.comparison.judged.after:.1e})" if named else ""
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--every", type=int, default=1)
    given = parser.parse_args()
    files = given.files or sorted(find_robots_folder().rglob("*.urdf"))[:: given.every]
    counted, left = Counter[tuple[str, str]](), []
    for one in tables(files):
        sys.stdout.write(
            f"{one.file.name} | {one.seconds:.1f} s | {one.words or ' | '.join(map(cell, one.rows[1:]))}\n"
        )
        sys.stdout.flush()
        counted.update((row.reader, row.result) for row in one.rows)
        left += [f"{one.file.name} by {reader}" for reader in one.unexplained]
    sys.stdout.write(
        "\n" + "\n".join(f"{reader}: {count} {result}" for (reader, result), count in sorted(counted.items())) + "\n"
    )
    sys.stdout.write(f"different by more than what is named: {', '.join(left) or 'none'}\n")


if __name__ == "__main__":
    main()
