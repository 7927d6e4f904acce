"""The project's own files fit each other: dependencies, pins, commands."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

PROJECT = "flexinv"


def requirements(root: Path) -> dict[str, list[Requirement]]:
    """Requirements by extra; "" is the core."""
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    groups = {"": project["dependencies"], **project["optional-dependencies"]}
    return {extra: [Requirement(line) for line in lines] for extra, lines in groups.items()}


def pins(text: str) -> dict[str, str]:
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    return {canonicalize_name(name): version for name, version in (line.split("==") for line in lines)}


def unpinned(groups: dict[str, list[Requirement]], pinned: dict[str, str]) -> list[str]:
    """Requirements that have no pin, or one that they do not allow."""
    return [
        str(r)
        for lines in groups.values()
        for r in lines
        if r.name != PROJECT and not r.specifier.contains(pinned.get(canonicalize_name(r.name), "0"))
    ]


def test_every_dependency_is_pinned_to_a_version_that_it_allows(root: Path) -> None:
    assert unpinned(requirements(root), pins((root / "constraints.txt").read_text())) == []


def test_a_missing_or_wrong_pin_is_found() -> None:
    groups = {"": [Requirement("numpy>=2.0"), Requirement("scipy>=1.13")]}
    assert unpinned(groups, {"numpy": "1.26", "scipy": "1.17"}) == ["numpy>=2.0"]
    assert unpinned(groups, {"numpy": "2.1"}) == ["scipy>=1.13"]


def test_all_means_every_extra(root: Path) -> None:
    """But what engines of others need: neither `make report` nor `make test` asks for it."""
    groups = requirements(root)
    (everything,) = groups.pop("all")
    assert groups.pop("fmu")
    assert everything.name == PROJECT
    assert everything.extras == set(groups) - {""}


def test_continuous_integration_is_make_test(root: Path) -> None:
    run = root / ".ci" / "run"
    assert run.stat().st_mode & 0o111
    assert run.read_text().splitlines()[1:] == ['cd "$(dirname "$0")/.." && exec make test']
    assert re.search(r"^test: lint$", (root / "Makefile").read_text(), re.M)


def stated(text: str) -> list[tuple[int, int]]:
    """Versions of Python 3.x that a text states, "3.11 to 3.13" among them."""
    return [(int(first), int(last)) for first, last in re.findall(r"Python 3\.(\d+) to 3\.(\d+)", text)]


def test_pages_classifiers_and_wheels_name_the_same_pythons(root: Path) -> None:
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    named = re.findall(r"Python :: 3\.(\d+)", "\n".join(project["classifiers"]))
    minors = [int(minor) for minor in named]
    assert minors == list(range(minors[0], minors[-1] + 1))
    assert project["requires-python"] == f">=3.{minors[0]}"
    for name in ("README.md", "Makefile", "docs/start.md"):
        assert stated((root / name).read_text()) == [(minors[0], minors[-1])], name
    recipe = (root / "docs" / "release" / "wheels.yml").read_text()
    assert re.findall(r"python: (\[.*\])", recipe) == [str([f"3.{minor}" for minor in minors]).replace("'", '"')]
    assert stated("Python 3.11 to 3.14") != stated("Python 3.11 to 3.13")  # a difference is seen
