"""Findings about meshes: faults that are planted are found, and a mesh without one is silent."""

from __future__ import annotations

import random
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from part_examples import make_bar

from campaigns.part_faults.draft import make_draft
from crosscheck.linting.lint import lint
from crosscheck.linting.parts import check_parts
from flexinv.model.mechanism import Joint, Link, Mechanism
from flexinv.model.part import MeshedPart

GOOD = make_bar("tetra10", length=0.3, side=0.05, count=(2, 1, 1), modes=1)


def list_checks(part: MeshedPart) -> list[tuple[str, str]]:
    arm = Mechanism("arm", (Link("bar", part=part),), (Joint("hub", "revolute", "world", "bar"),))
    return [(one.check, one.level) for one in check_parts(arm)]


def scale(part: MeshedPart, factor: float) -> MeshedPart:
    ends = tuple(replace(one, origin=factor * one.origin) for one in part.interfaces)
    return replace(part, points=factor * part.points, interfaces=ends)


def test_a_good_mesh_is_silent() -> None:
    assert list_checks(GOOD) == []


@pytest.mark.parametrize(
    ("part", "found"),
    [
        (scale(GOOD, 1000.0), ("mesh size", "warning")),
        (scale(GOOD, 1e-3), ("mesh size", "warning")),
        (make_bar("tetra", length=0.3, side=0.05, count=(2, 1, 1)), ("mesh locks", "warning")),
        (replace(GOOD, points=np.vstack([GOOD.points, np.zeros((1, 3))])), ("mesh nodes", "warning")),
        (replace(GOOD, points=GOOD.points * np.array([1.0, -1.0, 1.0])), ("mesh", "error")),
    ],
    ids=["metres for millimetres", "millimetres twice", "linear tetrahedra", "loose node", "mirrored"],
)
def test_planted_faults_are_found(part: MeshedPart, found: tuple[str, str]) -> None:
    assert list_checks(part) == [found]


def test_what_the_reader_of_a_mesh_says_is_a_finding(tmp_path: Path) -> None:
    draft = make_draft(random.Random(1), "hexahedron")
    draft.element = "C3D8I"
    draft.write(tmp_path / "arm")
    said = [one for one in lint(tmp_path / "arm").findings if one.check == "mesh file"]
    assert [one.place for one in said] == ["link arm"]
    assert "C3D8I has incompatible modes" in said[0].given
