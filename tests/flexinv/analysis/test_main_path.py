"""The main path is the one on the map: calls of `solve` are followed while it runs, and counted.

A profile of what runs is followed, with kernels as Python, because names in the sources do not tell which method or which
kernel is called, and a compiled kernel shows none of its calls.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from once import made_once

pytestmark = pytest.mark.slow  # what they share is computed once, and takes seconds

Paths = dict[str, list[list[str]]]

SOLVE = "analysis/solve.solve"
ELEMENT = "elements/beam_element.fill_element_gradient", "elements/planar_beam.fill_point_gradients"
_CALL = re.compile(r"`(\w+(?:/\w+)+)\.(\w+)`")


@pytest.fixture(scope="module")
def followed(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Paths:
    """Paths of calls from `solve` on, by case."""
    folders = os.pathsep.join((str(root), str(root / "tests" / "shared")))
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": folders}
    script = root / "tests" / "shared" / "followed_calls.py"

    def follow(home: Path) -> None:
        done = subprocess.run([sys.executable, script], env=environment, capture_output=True, text=True, check=True)
        (home / "paths.json").write_text(done.stdout)

    return json.loads((made_once(tmp_path_factory, "followed", follow) / "paths.json").read_text())  # type: ignore[no-any-return]


@pytest.fixture(scope="module")
def page(root: Path) -> str:
    """The section of the map that says where to begin."""
    whole = (root / "flexinv" / "README.md").read_text()
    return whole.partition("## Where to begin reading")[2].partition("\n## ")[0]


def stated(page: str, sentence: str) -> int:
    """The number that stands in a sentence of the page."""
    match = re.search(sentence, " ".join(page.split()))
    assert match is not None, sentence
    return int(match.group(1))


def to_element(paths: list[list[str]]) -> list[list[str]]:
    return [path for path in paths if path[-1] in ELEMENT]


def test_a_time_step_is_few_calls_from_the_element(followed: Paths, page: str) -> None:
    most = stated(page, r"longest path from `solve` to the element has (\d+) calls")
    start = stated(page, r"the start is solved for before the first step: (\d+) calls")
    assert most <= 6
    longest = {}
    for case, paths in followed.items():
        result = to_element(paths)
        longest[case] = max(len(path) - 1 for path in result if "analysis/trajectory.begin" not in path)
        assert max(len(path) - 1 for path in result) == (start if case == "space" else longest[case]), case
    in_plane = stated(page, r"in the plane it has (\d+)")
    assert longest == {"space": most, "plane": in_plane, "loop": in_plane}
    assert start > most  # a path that is longer is found: the start in space goes through more calls than a step


def test_who_follows_solve_reads_about_a_dozen_modules(followed: Paths, page: str) -> None:
    paths = followed["space"]
    ends = {ELEMENT[0], "inverse/nodal_sums.compute_nodal_force", "kinematics/mesh.build"}
    on_the_way = [path for path in paths if path[-1] in ends and "analysis/trajectory.begin" not in path]
    called = [path for path in paths if len(path) == 2 and not path[1].startswith("validation.")]
    modules = {call.rpartition(".")[0] for path in (*on_the_way, *called) for call in path}
    assert len(modules) == stated(page, r"to P reads (\d+) modules"), sorted(modules)


def test_what_the_map_says_runs(followed: Paths, page: str) -> None:
    """Both tables name calls: all of them run, those of the second in this order."""
    called = {path[-1] for paths in followed.values() for path in paths}
    steps, _, way = page.partition("The way of a time step")
    said = [
        ".".join(call) for row in re.findall(r"^\|[^|]*\|([^|]*)\|", steps, re.MULTILINE) for call in _CALL.findall(row)
    ]
    assert len(said) >= 5
    assert [call for call in said if call not in called] == []
    rows = re.findall(r"^\| \d \|([^|]*)\|([^|]*)\|$", way, re.MULTILINE)
    for case, column in (("space", 0), ("plane", 1)):
        calls = [".".join(call) for row in rows for call in _CALL.findall(row[column])[:1]]
        assert [SOLVE, *calls] in followed[case]
