"""Campaign: findings of `crosscheck lint` over many descriptions, by default all URDFs of example-robot-data, as a table.

python tests/shared/lint_campaign.py                     # a row for each file, then how often each check spoke
python tests/shared/lint_campaign.py --findings FILES    # every finding, to be judged by hand
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

from crosscheck.linting.lint import LintReport, lint
from flexinv.errors import InputError
from flexinv.files.from_urdf import find_robots_folder


def linted(files: Iterable[Path]) -> Iterator[tuple[Path, LintReport | str]]:
    """Yield findings by file, or the reason why one is not read."""
    for file in files:
        try:
            yield file, lint(file)
        except InputError as error:
            yield file, " ".join(str(error).split())


def table(files: Iterable[Path], root: Path) -> Iterator[str]:
    """Yield a Markdown table: file, errors, warnings, checks that spoke; then the checks by how often they did."""
    counted: Counter[tuple[str, str]] = Counter()
    yield "| file | errors | warnings | checks |"
    yield "|---|--:|--:|---|"
    for file, result in linted(files):
        name = file.relative_to(root)
        if isinstance(result, str):
            yield f"| {name} | | | {result[:200]} |"
            continue
        counted.update((one.check, one.level) for one in result.findings)
        errors = sum(one.level == "error" for one in result.findings)
        checks = ", ".join(sorted({one.check for one in result.findings}))
        yield f"| {name} | {errors} | {len(result.findings) - errors} | {checks} |"
    yield ""
    yield from (f"{check} ({level}): {count}" for (check, level), count in counted.most_common())


def listed(files: Iterable[Path]) -> Iterator[str]:
    """Yield every finding in a line."""
    for file, result in linted(files):
        yield f"## {file}"
        if isinstance(result, str):
            yield result
        else:
            yield from (f"{f.level} | {f.check} | {f.place} | {f.given} | {f.why} | {f.write}" for f in result.findings)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--findings", action="store_true")
    given = parser.parse_args()
    root = Path() if given.files else find_robots_folder()
    files = given.files or sorted(root.rglob("*.urdf"))
    lines = listed(files) if given.findings else table(files, root)
    sys.stdout.writelines(line + "\n" for line in lines)


if __name__ == "__main__":
    main()
