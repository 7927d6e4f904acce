"""lint says what weighs something only because a reader makes it up, and what some readers refuse to parse."""

from __future__ import annotations

from pathlib import Path

import pytest

import crosscheck
from crosscheck.equivalence.sources import describe
from crosscheck.findings.finding import Finding
from crosscheck.linting.lint import lint
from flexinv.errors import InputError

CASES = Path(__file__).parents[2] / "data" / "cases"
SHAPE = '<collision><origin xyz="0 0.08 0"/><geometry><cylinder length="0.03" radius="0.05"/></geometry></collision>'


def pad(folder: Path, *edits: tuple[str, str]) -> list[Finding]:
    text = (CASES / "c33_pad.urdf").read_text()
    for before, after in edits:
        assert before in text
        text = text.replace(before, after)
    (folder / "pad.urdf").write_text(text)
    return [one for one in lint(folder / "pad.urdf").findings if one.check == "shape without inertia"]


def test_a_pad_that_collides_weighs_what_each_reader_makes_of_it(tmp_path: Path) -> None:
    """By hand pi 0.05^2 0.03 m^3 of 1000 kg/m^3: 0.2356 kg, which is what MuJoCo's reader adds."""
    (result,) = pad(tmp_path)
    assert (result.place, result.given, result.level) == ("link pad", "collides, and has no <inertial>", "warning")
    assert result.why == (
        "MuJoCo takes 0.236 kg, 1000 kg/m^3 of its shape, PyBullet and DART take 1 kg, Pinocchio and Drake nothing"
    )
    links = describe(f"{CASES / 'c33_pad.urdf'}@mujoco").mechanism.links
    assert sum(body.inertia.mass for link in links for body in link.bodies) == pytest.approx(
        1.1 + 0.2356, abs=1e-4
    )  # digits


def test_a_pad_that_is_only_seen(tmp_path: Path) -> None:
    (result,) = pad(tmp_path, ("collision>", "visual>"))
    assert result.why == "PyBullet and DART take 1 kg, MuJoCo, Pinocchio and Drake nothing"
    links = describe(f"{tmp_path / 'pad.urdf'}@mujoco").mechanism.links
    assert sum(body.inertia.mass for link in links for body in link.bodies) == pytest.approx(1.1, rel=1e-12)  # rounding


@pytest.mark.parametrize(
    ("shape", "words"),
    [
        ('<box size="0.1 0.2 0.3"/>', "MuJoCo takes 6 kg"),
        ('<sphere radius="0.1"/>', "MuJoCo takes 4.19 kg"),
        ('<mesh filename="pad.stl"/>', "MuJoCo takes 1000 kg/m^3 of its shape"),
    ],
)
def test_every_shape_has_its_words(shape: str, words: str, tmp_path: Path) -> None:
    (result,) = pad(tmp_path, ('<cylinder length="0.03" radius="0.05"/>', shape))
    assert result.why.startswith(words)


@pytest.mark.parametrize(
    "edit",
    [
        (SHAPE, ""),  # a frame without shape
        (SHAPE, SHAPE + '<inertial><mass value="0.2"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4"/></inertial>'),
        ('name="hip" type="revolute"', 'name="hip" type="fixed"'),  # nothing moves it
    ],
)
def test_nothing_is_said_where_nothing_is_made_up(edit: tuple[str, str], tmp_path: Path) -> None:
    assert not pad(tmp_path, edit)


def test_two_hyphens_in_a_comment_are_read_and_found() -> None:
    file = CASES / "c46_comment.xml"
    assert crosscheck.compare(file, f"{file}@pinocchio").equal
    assert [(one.check, one.given) for one in lint(file).findings] == [("xml", "line 2: -- within a comment")]


def test_a_primitive_fitted_to_a_mesh_that_is_missing_is_read_and_found() -> None:
    file = CASES / "c36_fitmesh.xml"
    assert crosscheck.compare(file, file).equal
    (result,) = lint(file).findings
    assert (result.check, result.level) == ("file", "warning")
    assert "not_here.obj" in result.given


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ('<inertial pos="0 0 0.1" mass="1" diaginertia="0.01 0.01 0.002"/>', ""),
        ('angle="radian"', 'angle="radian" inertiafromgeom="true"'),
    ],
)
def test_a_mass_that_comes_from_the_missing_mesh_is_refused(before: str, after: str, tmp_path: Path) -> None:
    text = (CASES / "c36_fitmesh.xml").read_text()
    assert before in text
    (tmp_path / "fit.xml").write_text(text.replace(before, after))
    with pytest.raises(InputError, match="gets its mass from a mesh that is not there"):
        describe(tmp_path / "fit.xml")
