"""What an installation is asked for: the requirements of an extra on this Python."""

from __future__ import annotations

import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest
from packaging.markers import Marker
from packaging.requirements import Requirement

from crosscheck.start import list_requirements


def write_metadata(root: Path) -> list[str]:
    """The lines that an installation has of pyproject.toml: the marker of an extra is joined to the others by "and"."""
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    lines = [str(Requirement(line)) for line in project["dependencies"]]
    for extra, needs in project["optional-dependencies"].items():
        for one in map(Requirement, needs):
            condition = f'extra == "{extra}"'
            one.marker = Marker(f"{one.marker} and {condition}" if one.marker else condition)
            lines.append(str(one))
    return lines


@pytest.mark.parametrize("version", [(3, 11), (3, 12), (3, 13), (3, 14)])
@pytest.mark.parametrize("extra", ["", "history", "usd", "dev", "engines"])
def test_requirements_are_those_that_pip_would_take(
    root: Path, version: tuple[int, int], extra: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Judged by packaging, which a command that lacks a package may not have."""
    lines = write_metadata(root)
    monkeypatch.setattr(metadata, "requires", lambda name: lines)
    monkeypatch.setattr(sys, "version_info", (*version, 0))
    asked = {"python_version": "{}.{}".format(*version), "extra": extra}
    own = [one for one in map(Requirement, lines) if ("extra" in str(one.marker)) == bool(extra)]
    expected = [one for one in own if one.marker is None or one.marker.evaluate(asked)]
    assert sorted(list_requirements(extra)) == sorted(f"{one.name}{one.specifier}" for one in expected)
    assert expected


def test_a_condition_that_nobody_knows_is_never_taken_for_met(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(metadata, "requires", lambda name: ['numpy>=2.0; sys_platform == "win32"', "scipy>=1.13"])
    assert list_requirements() == ["scipy>=1.13"]
