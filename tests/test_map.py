"""The maps of the packages say what is there, and imports point down the layers; a map or an import that is wrong is refused."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import module_map
import pytest
from module_map import PACKAGES, read_sources


@pytest.mark.parametrize("package", PACKAGES)
def test_the_map_is_complete(package: str, root: Path) -> None:
    broken = module_map.faults((root / package / "README.md").read_text(), package, read_sources(root, package))
    assert not broken, "\n" + "\n".join(broken)


@pytest.mark.parametrize("package", PACKAGES)
def test_what_the_map_calls_is_there(package: str, root: Path) -> None:
    known = {name: text for each in PACKAGES for name, text in read_sources(root, each).items()}
    assert module_map.unknown((root / package / "README.md").read_text(), package, known) == []


@pytest.fixture(scope="module")
def lint_imports() -> str:
    return str(Path(sys.executable).with_name("lint-imports"))


def test_imports_point_down_the_layers(root: Path, lint_imports: str) -> None:
    told = subprocess.run([lint_imports, "--no-cache"], cwd=root, capture_output=True, text=True)
    assert told.returncode == 0, told.stdout
    assert "0 broken" in told.stdout


LAYERS = """[tool.importlinter]
root_package = "p"
[[tool.importlinter.contracts]]
name = "Layers"
type = "layers"
containers = ["p"]
exhaustive = true
layers = ["high", "low"]
"""


@pytest.mark.parametrize(
    ("low", "beside", "complaint"),
    [
        ("X = 1\n", None, ""),
        ("def f():\n    from p import high\n", None, "p.low is not allowed to import p.high"),
        ("X = 1\n", "", "p.beside"),
    ],
)
def test_a_late_import_that_points_up_and_a_folder_without_a_layer_are_found(
    low: str, beside: str | None, complaint: str, tmp_path: Path, lint_imports: str
) -> None:
    package = tmp_path / "p"
    package.mkdir()
    sources = {"__init__": "", "high": "from p import low\n", "low": low, "beside": beside}
    for name, text in sources.items():
        if text is not None:
            (package / f"{name}.py").write_text(text)
    (tmp_path / "pyproject.toml").write_text(LAYERS)
    told = subprocess.run([lint_imports, "--no-cache"], cwd=tmp_path, capture_output=True, text=True)
    assert (told.returncode == 0) == (not complaint), told.stdout
    assert complaint in told.stdout


# --- the map's own rules --------------------------------------------------------------------------------------------

TREE = {
    "p": '"P."',
    "p.low": '"Low."',
    "p.high": '"""High.\n\nMore."""\nfrom p.low import f',
    "p.sub": '"Sub."',
    "p.sub.x": '"X."',
}
LOW, HIGH, OWN = "| [low](low.py) | Low. |", "| [high](high.py) | High. |", "| [__init__](__init__.py) | P. |"
SUB = "| [sub/__init__](sub/__init__.py) | Sub. |\n| [sub/x](sub/x.py) | X. |"
WRONG = {
    f"p.low is missing: write {LOW}": (HIGH, SUB, OWN),
    "p.sub.x is missing: write | [sub/x](sub/x.py) | X. |": (LOW, HIGH, SUB.splitlines()[0], OWN),
    f"p is missing: write {OWN}": (LOW, HIGH, SUB),
    "p.gone is on the map, and no module": (LOW, HIGH, SUB, OWN, "| [gone](gone.py) | Gone. |"),
    "p.low is on the map twice": (LOW, HIGH, SUB, OWN, LOW),
    f"p.low has another line: write {LOW}": (LOW.replace("Low.", "It was low."), HIGH, SUB, OWN),
    f"p.high has another line: write {HIGH}": (LOW, "| [high](low.py) | High. |", SUB, OWN),
    "the heading `sub/` stands 2 times": ("## `sub/`", LOW, HIGH, "## `sub/`", SUB, OWN),
    "a table has no row": ("| module | what |", "|---|---|", "", LOW, HIGH, SUB, OWN),
}


def test_a_true_map_is_silent() -> None:
    assert module_map.faults("\n".join((LOW, HIGH, SUB, OWN)), "p", TREE) == []


@pytest.mark.parametrize("complaint", WRONG)
def test_a_wrong_map_is_found(complaint: str) -> None:
    assert module_map.faults("\n".join(WRONG[complaint]), "p", TREE) == [complaint]


def test_rows_are_written_from_docstrings_in_their_places() -> None:
    old = "\n".join(("# P", HIGH.replace("High.", "It was high."), LOW, "| [gone](gone.py) | Gone. |", "## End", ""))
    assert module_map.write_rows(old, "p", TREE) == "\n".join(("# P", HIGH, LOW, "## End", ""))


def test_a_new_module_comes_last_in_the_table_of_its_folder() -> None:
    whole = (
        "# P",
        "",
        "## `sub/`",
        "",
        "|---|---|",
        *SUB.splitlines(),
        "",
        "## The package",
        "",
        "|---|---|",
        LOW,
        HIGH,
        OWN,
        "",
    )
    rows = {SUB.splitlines()[1], OWN}
    old = "\n".join(line for line in whole if line not in rows)
    assert module_map.write_rows(old, "p", TREE) == "\n".join(whole)


def test_a_call_of_nothing_is_found() -> None:
    page = "`low.f` and `sub/x.G`, low.h, `p.low`, `low.g`, `sub/x.H`, `gone.f`, `p.gone`"
    known = {**TREE, "p.low": "def f():\n    g = 1", "p.sub.x": "G: int = 1\nclass Hat:\n    pass"}
    assert module_map.unknown(page, "p", known) == ["low.g", "sub/x.H", "gone.f", "p.gone"]
