"""The maps of the packages, `flexinv/README.md` and `crosscheck/README.md`, held against the folders that they describe.

    python tests/shared/module_map.py        # writes the rows of both maps anew, from the docstrings

A module stays in its place; a new one comes last in the table of its folder.  Which folder may import which is said by the
contracts of pyproject.toml.

`test_map.py` runs this over both, and over small maps that are wrong.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Mapping
from pathlib import Path

import house_rules

PACKAGES = ("flexinv", "crosscheck")

_ROW = re.compile(r"^\| \[([\w/]+)\]\(([\w/]+)\.py\) \| (.*) \|$", re.MULTILINE)
_CALL = re.compile(r"`(\w+(?:/\w+)*)\.(\w+)`")


def faults(page: str, package: str, sources: Mapping[str, str]) -> list[str]:
    """What is wrong with the map of a package: page, name, and sources by dotted name (a package's own under its name).

    Every module stands there once, with its docstring's first line.
    """
    rows = [(_dotted(package, name), _dotted(package, target), text) for name, target, text in _ROW.findall(page)]
    place = {module: k for k, (module, _, _) in reversed(list(enumerate(rows)))}
    broken = [
        f"{module} is missing: write {_line(package, module, sources)}" for module in sources.keys() - place.keys()
    ]
    for k, (module, target, text) in enumerate(rows):
        if module not in sources:
            broken.append(f"{module} is on the map, and no module")
        elif place[module] != k:
            broken.append(f"{module} is on the map twice")
        elif target != module or text != first_line(sources[module]):
            broken.append(f"{module} has another line: write {_line(package, module, sources)}")
    return sorted([*broken, *_headings(page)])


def _headings(page: str) -> list[str]:
    """Headings that stand more than once, and tables without a row."""
    headings = re.findall(r"^## (.*)$", page, re.MULTILINE)
    twice = [
        f"the heading {one} stands {headings.count(one)} times"
        for one in sorted(set(headings))
        if headings.count(one) > 1
    ]
    return [*twice, *(["a table has no row"] if re.search(r"^\|---.*\n(?!\|)", page + "\n", re.MULTILINE) else [])]


def unknown(page: str, package: str, sources: Mapping[str, str]) -> list[str]:
    """What a page calls `module.name` beside its rows, and what is neither defined there nor a module."""
    return [
        f"{module}.{name}"
        for module, name in _CALL.findall(_ROW.sub("", page))
        if f"{module}.{name}" not in sources
        and not re.search(
            rf"^(?:def|class) {name}\b|^{name}\b.* = ", sources.get(_dotted(package, module), ""), re.MULTILINE
        )
    ]


def first_line(source: str) -> str:
    """The first line of a module's docstring."""
    return (ast.get_docstring(house_rules.parsed(source)) or "").partition("\n")[0]


def _dotted(package: str, name: str) -> str:
    """files/schema -> flexinv.files.schema, files/__init__ -> flexinv.files, __init__ -> flexinv."""
    return f"{package}.{name.replace('/', '.')}".removesuffix(".__init__")


def _line(package: str, module: str, sources: Mapping[str, str]) -> str:
    inside = any(other.startswith(f"{module}.") for other in sources) or module == package
    name = "/".join([*module.split(".")[1:], *(["__init__"] if inside else [])])
    return f"| [{name}]({name}.py) | {first_line(sources[module])} |"


def read_sources(root: Path, package: str) -> dict[str, str]:
    """Modules of a package by dotted name; files that hold nothing are none."""
    texts = {path: path.read_text() for path in sorted((root / package).rglob("*.py"))}
    names = {path: ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__") for path in texts}
    return {names[path]: text for path, text in texts.items() if text.strip()}


def write_rows(page: str, package: str, sources: Mapping[str, str]) -> str:
    """The page with the row of each module as its docstring has it: those that are gone are left out, new ones added."""

    def write_row(found: re.Match[str]) -> str:
        module = _dotted(package, found[1])
        return f"{_line(package, module, sources)}\n" if module in sources else ""

    known = {_dotted(package, name) for name, _, _ in _ROW.findall(page)}
    page = re.sub(_ROW.pattern + r"\n", write_row, page, flags=re.MULTILINE)
    for module in sorted(sources.keys() - known):
        page = _add_row(page, _line(package, module, sources))
    return page


def _add_row(page: str, row: str) -> str:
    """The page with a row at the end of the table of its folder, or unchanged where no heading names that."""
    folder = row[len("| [") : row.index("]")].rpartition("/")[0]
    heading = f"## `{folder}/`\n" if folder else "## The package\n"
    before, found, after = page.partition(heading)
    if not found:
        return page
    table, gap, rest = after.partition("\n\n## ")
    return f"{before}{heading}{table.rstrip()}\n{row}\n{gap[1:]}{rest}"


def main() -> None:
    """Write both maps anew and print what is left to be done by hand: the heading of a new folder."""
    root = Path(__file__).resolve().parents[2]
    for package in PACKAGES:
        file = root / package / "README.md"
        sources = read_sources(root, package)
        page = write_rows(file.read_text(), package, sources)
        file.write_text(page)
        sys.stdout.writelines(f"{line}\n" for line in faults(page, package, sources))


if __name__ == "__main__":
    main()
