"""Causes in meshed links: what each does to a part, and that no size is no change."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from crosscheck.causes.dictionary import DICTIONARY
from crosscheck.causes.rows import meshes
from crosscheck.causes.subject import Subject
from crosscheck.measures.mechanisms import read_mechanism
from flexinv.errors import InputError
from flexinv.files.load_cases import load_cases
from flexinv.model.by_value import is_same
from flexinv.model.part import MeshedPart
from flexinv.parts.reductions import find_reduction

ARM = Path(__file__).resolve().parents[3] / "models" / "meshed_arm"
MECHANISM = read_mechanism(ARM)
SUBJECT = Subject(MECHANISM, load_cases(ARM, MECHANISM)["reach"])
PART = MECHANISM.link_of["forearm"].part
assert PART is not None


def change(name: str, *size: float) -> MeshedPart:
    part = DICTIONARY[name].change(SUBJECT, "forearm", np.array(size)).mechanism.link_of["forearm"].part
    assert part is not None
    return part


@pytest.mark.parametrize("row", [row for row in meshes.ROWS if row.sized], ids=lambda row: row.name)
def test_no_size_is_no_change(row: object) -> None:
    name = str(getattr(row, "name", ""))
    assert is_same(change(name, *[0.0] * DICTIONARY[name].parameters), PART)


def test_frequencies_follow_from_the_modulus() -> None:
    """f ~ sqrt(E), to rounding of an eigenvalue of a sparse matrix."""
    before = find_reduction(PART).frequency[0]
    assert find_reduction(change("modulus of a mesh", 0.21)).frequency[0] == pytest.approx(1.1 * before, rel=1e-8)


def test_averaged_interfaces_are_softer_and_come_back() -> None:
    averaged = change("tie of interfaces", 1.0)
    assert {one.tie for one in averaged.interfaces} == {"average"}
    assert find_reduction(averaged).frequency[0] < find_reduction(PART).frequency[0]


def test_a_mesh_keeps_some_of_its_stiffness() -> None:
    with pytest.raises(InputError, match="leaves next to nothing"):
        change("modulus of a mesh", -1.0)
