"""Releases are those of the index, by pip itself; ranges are read as they are written, and wrong ones have one clear message."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from local_index import write_simple_index, write_wheel
from packaging.version import Version

from crosscheck.bisect import installers, releases
from crosscheck.bisect.installers import Index, InstallerError, ProgramAnswer
from crosscheck.bisect.pythons import find_pythons
from crosscheck.bisect.releases import (
    AVAILABLE,
    OFFERED,
    YANKED,
    Release,
    ReleaseQuery,
    choose_range,
    list_releases,
    parse_versions,
)
from flexinv.errors import InputError

PYTHON = find_pythons([])[0]
SOURCE = "def height():\n    return 1.0\n"


@pytest.fixture(autouse=True)
def settings(monkeypatch: pytest.MonkeyPatch) -> None:
    """pip as it comes, without what this machine is configured for."""
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.delenv("PIP_FIND_LINKS", raising=False)


@pytest.fixture(scope="module")
def index(tmp_path_factory: pytest.TempPathFactory) -> Index:
    """An index with releases of all kinds: 1.3 was taken back, 1.4rc1 is a pre-release, 0.9 has a wheel for another Python."""
    folder = tmp_path_factory.mktemp("index")
    wheels = [write_wheel(folder / "files", "ball", version, SOURCE) for version in ("1.10", "1.2", "1.3", "1.4rc1")]
    wheels.append(write_wheel(folder / "files", "ball", "0.9", SOURCE, tag="cp27-cp27m-linux_x86_64"))
    sources = folder / "files" / "ball-1.0.tar.gz"
    sources.write_bytes(b"")
    return Index(url=write_simple_index(folder, {"ball": [*wheels, sources]}, yanked=[wheels[2].name]))


def names(index: Index, **query: bool) -> dict[str, bool]:
    """Releases and whether a Python here has a wheel of them."""
    found = list_releases("ball", [PYTHON], index, ReleaseQuery(**query))
    return {str(release): release.python is not None for release in found}


def test_releases_come_in_the_order_of_versions_with_those_that_have_no_wheel(index: Index) -> None:
    """As pip itself lists them, with pre-releases and those that were taken back."""
    found = names(index, pre=True, yanked=True)
    assert found == {"1.0": False, "1.2": True, "1.3": True, "1.4rc1": True, "1.10": True}
    assert list(found) == ["1.0", "1.2", "1.3", "1.4rc1", "1.10"]


def test_prereleases_and_yanked_ones_count_where_they_are_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    def answer(python: str, words: Sequence[str], index: Index) -> ProgramAnswer:
        if words[0] == "index":
            listed = "1.0, 1.2, 1.4rc1" if "--pre" in words else "1.0, 1.2"
            return ProgramAnswer(0, f"ball (1.2)\nAvailable versions: {listed}\n", "")
        return ProgramAnswer(
            1, "", "ERROR: no release (from versions: 1.2, 1.3, 1.4rc1)\n"
        )  # as older pips: 1.3 among them

    monkeypatch.setattr(releases, "run_pip", answer)
    assert names(Index()) == {"1.0": False, "1.2": True}
    assert names(Index(), yanked=True) == {"1.0": False, "1.2": True, "1.3": True}
    assert list(names(Index(), pre=True)) == ["1.0", "1.2", "1.4rc1"]


def test_a_package_that_the_index_does_not_have_is_named(index: Index) -> None:
    with pytest.raises(InputError, match=r"has no release of bell for Python 3\.\d+\.\d+: check the name 'bell'"):
        list_releases("bell", [PYTHON], index, ReleaseQuery())
    with pytest.raises(InputError, match=r"'\.\./x' is no name of a package"):
        list_releases("../x", [PYTHON], index, ReleaseQuery())


def test_an_index_that_cannot_be_reached_is_no_missing_package() -> None:
    """Nobody listens at port 9 of this machine; pip tries twice."""
    gone = Index(url="http://127.0.0.1:9/simple")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PIP_RETRIES", "1")
        with pytest.raises(InstallerError, match="the index cannot be reached"):
            list_releases("ball", [PYTHON], gone, ReleaseQuery(sources=True))


def test_without_pip_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installers.importlib.util, "find_spec", lambda _: None)
    with pytest.raises(InstallerError, match="write python -m ensurepip"):
        list_releases("ball", [PYTHON], Index(), ReleaseQuery())


def test_lists_of_pip_are_read() -> None:
    assert parse_versions(AVAILABLE, "ball (2)\nAvailable versions: 2, 1.0.post1, what\n") == {
        Version("2"),
        Version("1.0.post1"),
    }
    assert parse_versions(YANKED, "ERROR: Ignored the following yanked versions: 1.3\nERROR: x") == {Version("1.3")}
    assert parse_versions(OFFERED, "ERROR: Could not find it (from versions: 1.0, 2)\n") == {
        Version("1.0"),
        Version("2"),
    }
    assert parse_versions(OFFERED, "ERROR: Could not find it (from versions: none)") == set()


RELEASES = [Release(Version(version), PYTHON) for version in ("1.0", "1.2", "1.10", "2.0")]


@pytest.mark.parametrize(
    ("range_", "chosen"),
    [
        ("1.2..2.0", ["1.2", "1.10", "2.0"]),
        ("..1.2", ["1.0", "1.2"]),
        ("1.10..", ["1.10", "2.0"]),
        ("..", ["1.0", "1.2", "1.10", "2.0"]),
    ],
)
def test_ranges_hold_both_ends(range_: str, chosen: list[str]) -> None:
    assert [str(release) for release in choose_range(RELEASES, range_, "ball")] == chosen


@pytest.mark.parametrize(
    ("range_", "words"),
    [
        ("1.2", r"'1\.2' is no range of releases; write OLD\.\.NEW, such as 1\.0\.\.2\.0"),
        ("2.0..1.0", r"ends before it begins: write 1\.0\.\.2\.0, the older release first"),
        ("1.2..1.2", r"holds one release: nothing lies between"),
        ("1.2..1.9", r"no release 1\.9 of ball for this Python; it has 1\.0, 1\.2, 1\.10, 2\.0"),
        ("1.2..3.0rc1", r"pre-releases count with --pre"),
        ("old..new", r"'old' is no release of ball"),
    ],
)
def test_ranges_that_are_none_are_refused(range_: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        choose_range(RELEASES, range_, "ball")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("3.99", r"no python3\.99 is installed"),
        ("/nowhere/python", "there is no such program"),
        (str(Path(sys.executable).parent / "pip"), "does not say which Python it is"),
    ],
)
def test_a_python_that_is_not_there_is_named(name: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        find_pythons([name])
