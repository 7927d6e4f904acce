"""The project's own files fit each other: dependencies, pins, commands."""

from __future__ import annotations

import re
import shutil
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

PROJECT = "flexinv"
PYTHONS = ("3.11", "3.12", "3.13")


def holds(requirement: Requirement, python: str) -> bool:
    """Whether a requirement is one of this Python."""
    return requirement.marker is None or requirement.marker.evaluate({"python_version": python})


def requirements(root: Path, python: str) -> dict[str, list[Requirement]]:
    """Requirements of a Python by extra; "" is the core."""
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    groups = {"": project["dependencies"], **project["optional-dependencies"]}
    return {extra: [one for one in map(Requirement, lines) if holds(one, python)] for extra, lines in groups.items()}


def pins(text: str, python: str) -> dict[str, str]:
    """Versions by name for a Python: one each."""
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    asked = [one for one in map(Requirement, lines) if holds(one, python)]
    assert len(asked) == len({canonicalize_name(one.name) for one in asked})
    return {canonicalize_name(one.name): str(one.specifier).removeprefix("==") for one in asked}


def unpinned(groups: dict[str, list[Requirement]], pinned: dict[str, str]) -> list[str]:
    """Requirements that have no pin, or one that they do not allow."""
    return [
        str(r)
        for lines in groups.values()
        for r in lines
        if r.name != PROJECT and not r.specifier.contains(pinned.get(canonicalize_name(r.name), "0"))
    ]


@pytest.mark.parametrize("python", PYTHONS)
def test_every_dependency_is_pinned_to_a_version_that_it_allows(root: Path, python: str) -> None:
    assert unpinned(requirements(root, python), pins((root / "constraints.txt").read_text(), python)) == []


def test_a_missing_or_wrong_pin_is_found() -> None:
    groups = {"": [Requirement("numpy>=2.0"), Requirement("scipy>=1.13")]}
    assert unpinned(groups, {"numpy": "1.26", "scipy": "1.17"}) == ["numpy>=2.0"]
    assert unpinned(groups, {"numpy": "2.1"}) == ["scipy>=1.13"]


def not_lowest(groups: dict[str, list[Requirement]], lowest: dict[str, str]) -> list[str]:
    """Requirements whose lower bound is not the version of the list of lower bounds, and names that nothing asks for."""
    bounds: dict[str, list[Version]] = {}
    for one in (r for lines in groups.values() for r in lines if r.name != PROJECT):
        stated = [Version(part.version) for part in one.specifier if part.operator in (">=", "==")]
        bounds.setdefault(canonicalize_name(one.name), []).extend(stated)
    result = []
    for name, versions in bounds.items():
        own = lowest.get(name)
        if own is None or not versions or max(versions) != Version(own):
            result.append(f"{name}>={max(versions, default='')}: {own}")
    return result + sorted(set(lowest) - set(bounds))


@pytest.mark.parametrize("python", PYTHONS)
def test_lower_bounds_are_the_versions_that_were_tried(root: Path, python: str) -> None:
    lowest = pins((root / "docs" / "release" / "lower-bounds.txt").read_text(), python)
    assert not_lowest(requirements(root, python), lowest) == []


def test_a_lower_bound_that_was_not_tried_is_found() -> None:
    groups = {"": [Requirement("numpy>=2.0"), Requirement("scipy>=1.13"), Requirement("numba")]}
    tried = {"numpy": "2.0.0", "scipy": "1.14.0", "click": "8.2.0"}
    assert not_lowest(groups, tried) == ["scipy>=1.13: 1.14.0", "numba>=: None", "click"]


def test_a_lower_bound_of_a_later_python_is_its_own() -> None:
    lines = "numpy>=2.0", "numpy>=2.1; python_version >= '3.13'"
    tried = "numpy==2.0.0; python_version < '3.13'\nnumpy==2.1.0; python_version >= '3.13'"
    for python, version in (("3.12", "2.0.0"), ("3.13", "2.1.0")):
        asked = {"": [one for one in map(Requirement, lines) if holds(one, python)]}
        assert pins(tried, python) == {"numpy": version}
        assert not_lowest(asked, pins(tried, python)) == []
        assert not_lowest(asked, {"numpy": "2.0.1"}) != []


def test_all_means_every_extra(root: Path) -> None:
    """But what engines of others need: neither `make report` nor `make test` asks for it."""
    groups = requirements(root, PYTHONS[-1])
    (everything,) = groups.pop("all")
    assert groups.pop("fmu")
    assert everything.name == PROJECT
    assert everything.extras == set(groups) - {""}


def test_continuous_integration_is_make_test(root: Path) -> None:
    run = root / ".ci" / "run"
    assert run.stat().st_mode & 0o111
    assert run.read_text().splitlines()[1:] == ['cd "$(dirname "$0")/.." && exec make test']
    recipe = re.search(r"^test: \$\(STAMP\)\n((?:\t.+\n)+)", (root / "Makefile").read_text(), re.M)
    assert recipe is not None
    assert recipe[1].split("\n")[:-1] == [
        "\t$(BIN)/ruff check .",
        "\t$(BIN)/ruff format --check .",
        "\t$(BIN)/pytest -n $(TESTERS) --dist worksteal",  # all tests; types are checked by tests/test_types.py
    ]


def stated(text: str) -> list[tuple[int, int]]:
    """Versions of Python 3.x that a text states, "3.11 to 3.13" among them."""
    return [(int(first), int(last)) for first, last in re.findall(r"Python 3\.(\d+) to 3\.(\d+)", text)]


def test_pages_classifiers_and_wheels_name_the_same_pythons(root: Path) -> None:
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    named = re.findall(r"Python :: 3\.(\d+)", "\n".join(project["classifiers"]))
    assert [f"3.{minor}" for minor in named] == list(PYTHONS)
    minors = [int(minor) for minor in named]
    assert minors == list(range(minors[0], minors[-1] + 1))
    assert project["requires-python"] == f">=3.{minors[0]}"
    for name in ("README.md", "Makefile", "docs/start.md", "docs/release/publish.md"):
        assert stated((root / name).read_text()) == [(minors[0], minors[-1])], name
    named_alike = str([f"3.{minor}" for minor in minors]).replace("'", '"')
    for recipe, count in (("wheels.yml", 1), ("platforms.yml", 3)):  # Linux, macOS, Windows
        text = (root / ".github" / "workflows" / recipe).read_text()
        assert re.findall(r"python: (\[.*\])", text) == [named_alike] * count, recipe
    assert stated("Python 3.11 to 3.14") != stated("Python 3.11 to 3.13")  # a difference is seen


def unsafe(text: str) -> list[str]:
    """What is wrong in a workflow: actions that may change under their name, and rights that it does not need."""
    workflow = yaml.safe_load(text)
    loose = [
        line.strip() for line in text.splitlines() if "uses:" in line and not re.search(r"@[0-9a-f]{40} # v\d", line)
    ]
    rights = [] if workflow.get("permissions") == {"contents": "read"} else ["permissions"]
    unbound = [name for name, job in workflow["jobs"].items() if "timeout-minutes" not in job]
    more = [f"permissions of {name}" for name, job in workflow["jobs"].items() if not may_publish(job)]
    return [*loose, *rights, *unbound, *more]


def may_publish(job: dict[str, Any]) -> bool:
    """Whether a job has no rights of its own, or those to publish a page, and then runs no command that could use them."""
    if "permissions" not in job:
        return True
    alone = all("run" not in step for step in job["steps"]) and len(job["steps"]) == 1
    return alone and job["permissions"] == {"pages": "write", "id-token": "write"}


def test_workflows_pin_their_actions_and_may_only_read(root: Path) -> None:
    files = sorted([*(root / ".github" / "workflows").glob("*.yml"), *(root / "docs" / "workflows").glob("*.yml")])
    assert {file.stem for file in files} >= {"tests", "docs", "wheels", "platforms", "nightly", "outside-engines"}
    assert {file.name: unsafe(file.read_text()) for file in files} == {file.name: [] for file in files}


def test_a_workflow_that_takes_what_a_name_means_today_is_found() -> None:
    text = "permissions: write-all\njobs:\n  a:\n    steps:\n      - uses: actions/checkout@v4\n"
    assert unsafe(text) == ["- uses: actions/checkout@v4", "permissions", "a"]
    rights = {"pages": "write", "id-token": "write"}
    assert may_publish({"permissions": rights, "steps": [{"uses": "actions/deploy-pages"}]})
    assert not may_publish({"permissions": rights, "steps": [{"run": "make"}]})
    assert not may_publish({"permissions": {"contents": "write"}, "steps": [{"uses": "actions/deploy-pages"}]})


def list_wrong_changes(folder: Path, kinds: list[str]) -> list[str]:
    """Files of changes that towncrier would leave out, and texts that it would print wrongly."""
    names = {file.name: file.read_text() for file in sorted(folder.iterdir()) if file.name != "README.md"}
    wrong = [name for name in names if not re.fullmatch(rf"(\+[a-z0-9-]+|\d+)\.({'|'.join(kinds)})\.md", name)]
    return wrong + [
        name for name, text in names.items() if not text.strip() or text.lstrip().startswith(("-", "*", "#"))
    ]


def test_changes_are_files_that_towncrier_reads(root: Path) -> None:
    tool = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["towncrier"]
    kinds = [kind["directory"] for kind in tool["type"]]
    assert list_wrong_changes(root / tool["directory"], kinds) == []
    assert tool["start_string"] in (root / tool["filename"]).read_text()


@pytest.mark.parametrize(
    ("name", "text", "wrong"),
    [
        ("+new-thing.added.md", "A thing.", False),
        ("17.fixed.md", "A thing.", False),
        ("+new-thing.new.md", "A thing.", True),
        ("new-thing.added.md", "A thing.", True),
        ("+new-thing.added.md", "- A thing.", True),
        ("+new-thing.added.md", "", True),
    ],
)
def test_a_change_of_another_form_is_found(name: str, text: str, wrong: bool, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    assert list_wrong_changes(tmp_path, ["added", "fixed"]) == ([name] if wrong else [])


def test_the_version_has_one_place_and_its_copies_agree(root: Path) -> None:
    version = tomllib.loads((root / "pyproject.toml").read_text())["project"]["version"]
    assert re.findall(r"^version: (.+)$", (root / "CITATION.cff").read_text(), re.M) == [version]
    assert re.search(rf"^## {re.escape(version)}\b", (root / "CHANGELOG.md").read_text(), re.M)
    elsewhere = [
        p for p in (root / "flexinv", root / "crosscheck") if "__version__ =" in (p / "__init__.py").read_text()
    ]
    assert elsewhere == []  # the packages ask the installation


def invented(project: dict[str, object]) -> list[str]:
    """Addresses of the project that nobody can have: of example domains, with gaps to fill, without https."""
    urls = project.get("urls", {})
    assert isinstance(urls, dict)
    return [u for u in urls.values() if not re.fullmatch(r"https://[\w.-]+\.\w+(/[\w./-]*)?", u) or "example" in u]


def test_no_address_is_invented(root: Path) -> None:
    """What is not known yet is left out; docs/release/publish.md says what to write once it is."""
    assert invented(tomllib.loads((root / "pyproject.toml").read_text())["project"]) == []
    assert "[project.urls]" in (root / "docs" / "release" / "publish.md").read_text()
    for wrong in (
        "https://example.org/flexinv",
        "(address of the site)",
        "http://flexinv.dev",
        "https://OWNER/flexinv",
    ):
        assert invented({"urls": {"Homepage": wrong}}) == [wrong]


def test_the_page_on_publishing_names_the_oldest_numpy(root: Path) -> None:
    (numpy,) = [one for one in requirements(root, PYTHONS[0])[""] if one.name == "numpy"]
    assert f"NumPy from {str(numpy.specifier).removeprefix('>=')} are allowed" in (
        root / "docs" / "release" / "publish.md"
    ).read_text().replace("\n", " ")


def distributed(root: Path, files: list[str]) -> set[str]:
    """Those files of the project that the source distribution has: MANIFEST.in, and what every build takes."""
    taken = {"pyproject.toml", "setup.py", "MANIFEST.in", "README.md", "LICENSE"}
    taken |= {file for file in files if file.startswith(("flexinv/", "crosscheck/")) and not file.endswith(".md")}
    taken |= {file for file in files if file.startswith("crosscheck/skeleton/")}
    for line in (root / "MANIFEST.in").read_text().splitlines():
        what, _, rest = line.partition(" ")
        if what == "include":
            taken |= set(rest.split())
        elif what == "graft":
            taken |= {file for file in files if file.startswith(f"{rest}/")}
        elif what == "prune":
            taken -= {file for file in files if file.startswith(f"{rest}/")}
    return taken


def test_the_source_distribution_is_the_project(root: Path) -> None:
    """All that is tracked is in it, so that its tests, its site and its models are whole."""
    if not (root / ".git").exists() or shutil.which("git") is None:
        pytest.skip("this is no clone")
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=root, capture_output=True, text=True, check=True).stdout
    tracked = [file for file in listed.split("\0") if (root / file).is_file()]
    taken = distributed(root, tracked)
    assert sorted(set(tracked) - taken) == []
    assert sorted(taken - set(tracked)) == []
    assert "new/file" in {"new/file"} - distributed(root, ["new/file"])  # a folder that nobody named is missed
