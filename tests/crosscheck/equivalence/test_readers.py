"""The table of readers: the format's own compiler is the reference, and what a reader refuses or loses is in its row alone."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

import crosscheck
from crosscheck.equivalence import readers
from crosscheck.equivalence.output.readers import describe_agreement
from crosscheck.equivalence.readers import compare_readers
from crosscheck.equivalence.sources import describe

CASES = Path(__file__).parents[2] / "data" / "cases"
LOOP = "c35_tree_loop.xml"


@pytest.mark.parametrize(
    ("name", "joints", "result"),
    [("c40_include.xml", "1", "cannot"), ("c41_replicate.xml", "4", "different"), (LOOP, "3", "equal")],
)
def test_an_mjcf_is_what_its_own_compiler_makes_of_it(name: str, joints: str, result: str) -> None:
    """What Pinocchio refuses (include), loses (replicate) or reads itself (the loop) is said in its own row."""
    rows = compare_readers(str(CASES / name), "mujoco,pinocchio")
    assert (rows[0].reader, rows[0].joints, rows[0].result) == ("mujoco", joints, "equal")
    assert [(row.reader, row.result) for row in rows][1:] == [("pinocchio", result)]


def test_a_reader_that_breaks_is_its_row_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(source: Any, base: str = "fixed") -> Any:
        if str(source).endswith("@pinocchio"):
            raise KeyError(3)
        return describe(source, base)

    monkeypatch.setattr(readers, "describe", broken)
    rows = compare_readers(str(CASES / LOOP), "mujoco,pinocchio")
    assert [row.result for row in rows] == ["equal", "cannot"]
    assert rows[1].refusal.endswith("the reader pinocchio fails: KeyError: 3")


def test_where_the_reference_refuses_the_next_reader_takes_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(source: Any, base: str = "fixed") -> Any:
        if str(source).endswith("@mujoco"):
            raise RuntimeError("no")
        return describe(source, base)

    monkeypatch.setattr(readers, "describe", broken)
    rows = compare_readers(str(CASES / LOOP))
    assert [(row.reader, row.result) for row in rows if row.reader in ("mujoco", "pinocchio")] == [
        ("pinocchio", "equal"), ("mujoco", "cannot"),
    ]  # fmt: skip


def test_where_nobody_reads_it_every_row_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(source: Any, base: str = "fixed") -> Any:
        raise RuntimeError("no")

    monkeypatch.setattr(readers, "describe", broken)
    rows = compare_readers(str(CASES / LOOP), "mujoco,pinocchio")
    assert [row.result for row in rows] == ["cannot", "cannot"]
    assert describe_agreement(rows) == "No reader reads it: mujoco, pinocchio."


CONNECT = '<connect name="loop" body1="coupler" body2="rocker" anchor="0.2 0 0"/>'


def loop(folder: Path, name: str, *ties: str) -> Path:
    text = (CASES / LOOP).read_text()
    assert CONNECT in text
    (folder / name).write_text(text.replace(CONNECT, "".join(ties)))
    return folder / name


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ((CONNECT,), ('<connect body1="rocker" body2="coupler" anchor="0 0 0.1"/>',)),
        ((CONNECT,), ('<connect site1="top" site2="tip"/>',)),
        (('<weld body1="coupler" body2="rocker"/>',), ('<weld body1="rocker" body2="coupler"/>',)),
        (  # a hinge by two points, one of them said from the other body
            (CONNECT, '<connect name="two" body1="coupler" body2="rocker" anchor="0.2 0.1 0"/>'),
            (CONNECT, '<connect name="two" body1="rocker" body2="coupler" anchor="0 0.1 0.1"/>'),
        ),
    ],
)
def test_which_body_a_tie_names_first_is_no_difference(
    first: tuple[str, ...], second: tuple[str, ...], tmp_path: Path
) -> None:
    one, two = loop(tmp_path, "a.xml", *first), loop(tmp_path, "b.xml", *second)
    assert crosscheck.compare(one, two).equal
    assert crosscheck.compare(one, f"{two}@pinocchio").equal


def test_a_loop_in_another_place_is_a_difference(tmp_path: Path) -> None:
    """The check can fail: the tie 1 mm farther out on the coupler."""
    other = loop(tmp_path, "b.xml", CONNECT.replace("0.2 0 0", "0.201 0 0"))
    comparison = crosscheck.compare(CASES / LOOP, other)
    assert [d.cause for d in comparison.differences] == ["point of closure"]


STAGE_HEAD = """#usda 1.0
(
    metersPerUnit = 1
    kilogramsPerUnit = 1
    upAxis = "Z"
)
"""
STAGE_BODY = """def Xform "{name}" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"])
{{
    double3 xformOp:translate = {at}
    uniform token[] xformOpOrder = ["xformOp:translate"]
    float physics:mass = {mass}
    point3f physics:centerOfMass = {com}
    float3 physics:diagonalInertia = {moments}
}}
"""
STAGE_JOINT = """def Physics{kind}Joint "{name}"
{{
    rel physics:body0 = {first}
    rel physics:body1 = </{second}>
    point3f physics:localPos0 = {at}
    point3f physics:localPos1 = {on}
    uniform token physics:axis = "Y"
    uniform bool physics:excludeFromArticulation = {closes}
}}
"""


def stage(folder: Path, point: str = "(0.2, 0, 0)") -> Path:
    """The loop as a stage, whose numbers are single precision; point : of the closure on the coupler."""
    here = "(0, 0, 0)"
    bodies = (
        ("crank", here, 0.2, "(0, 0, 0.05)", "(2e-4, 2e-4, 1e-5)"),
        ("coupler", "(0, 0, 0.1)", 0.4, "(0.1, 0, 0)", "(1e-5, 1e-3, 1e-3)"),
        ("rocker", "(0.2, 0, 0)", 0.25, "(0, 0, 0.05)", "(2e-4, 2e-4, 1e-5)"),
    )
    joints = (
        ("Revolute", "a", "[]", "crank", here, here, 0),
        ("Revolute", "b", "</crank>", "coupler", "(0, 0, 0.1)", here, 0),
        ("Revolute", "c", "[]", "rocker", "(0.2, 0, 0)", here, 0),
        ("Spherical", "loop", "</coupler>", "rocker", point, "(0, 0, 0.1)", 1),
    )
    names = ("name", "at", "mass", "com", "moments"), ("kind", "name", "first", "second", "at", "on", "closes")
    text = STAGE_HEAD + "".join(STAGE_BODY.format(**dict(zip(names[0], row, strict=True))) for row in bodies)
    text += "".join(STAGE_JOINT.format(**dict(zip(names[1], row, strict=True))) for row in joints)
    (folder / "loop.usda").write_text(text)
    return folder / "loop.usda"


def test_a_loop_of_a_stage_in_single_precision_is_the_loop(tmp_path: Path) -> None:
    pytest.importorskip("pxr", reason="USD is not installed (python -m pip install usd-core)")
    assert crosscheck.compare(CASES / LOOP, stage(tmp_path), unproven=True).equal
    other = crosscheck.compare(CASES / LOOP, stage(tmp_path, "(0.20001, 0, 0)"), unproven=True)
    assert [d.cause for d in other.differences] == ["point of closure"]  # 0.01 mm are no rounding


def test_a_mimic_of_a_stage_in_single_precision_is_the_coupling(tmp_path: Path) -> None:
    pytest.importorskip("pxr", reason="USD is not installed (python -m pip install usd-core)")
    text = (CASES / "c14_damp.xml").read_text()
    plain = re.sub(r' damping="0.2" armature="0.01" frictionloss="0.3"', "", text)
    law = '<equality><joint joint1="j2" joint2="j1" polycoef="0.1 2 0 0 0"/></equality></mujoco>'
    (tmp_path / "grip.xml").write_text(plain.replace("</mujoco>", law))
    assert crosscheck.compare(tmp_path / "grip.xml", CASES / "c12_newton_mimic.usda", unproven=True).equal
