"""Numbers as they are written: what each reader makes of them is asked of the readers, and lint says it."""

from __future__ import annotations

from pathlib import Path

import pytest

from crosscheck.findings.finding import Finding
from crosscheck.linting.lint import lint

ROBOT = """<robot name="s"><link name="w"/>
<link name="a"><inertial><origin xyz="{com}"/><mass value="{mass}"/>
<inertia ixx="{ixx}" iyy="0.006" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size="{size}"/></geometry></collision></link>
<!-- <mass value="1.
5"/> -->
<joint name="hip" type="revolute"><parent link="w"/><child link="a"/><origin xyz="{xyz}"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="20" velocity="8"/></joint></robot>"""
GOOD = {"com": "0 0 0.1", "mass": "1.25", "ixx": "0.006", "size": "0.1 0.2 0.3", "xyz": "0 0 0.5"}
# What is written, by the key that it replaces; the level, a word of why, and what to write.
WRONG = [
    ("mass", "1.\n25", "error", "broken in two", 'value="1.25"'),
    ("mass", "1,25", "error", "decimal comma", 'value="1.25"'),
    ("mass", "1.25kg", "error", "a unit", 'value="1.25"'),
    ("mass", " 1.25 ", "warning", "spaces beside it", 'value="1.25"'),
    ("mass", "1_000", "error", "no one finite number", 'value="1.0"'),
    ("mass", "inf", "error", "no one finite number", 'value="1.0"'),
    ("ixx", "0,006", "error", "decimal comma", 'ixx="0.006"'),
    ("com", "0,0,0.1", "error", "between numbers", 'xyz="0 0 0.1"'),
    ("com", "0; 0; 0.1", "error", "between numbers", 'xyz="0 0 0.1"'),
    ("com", "0 0 0,1", "error", "decimal comma", 'xyz="0 0 0.1"'),
    ("com", "0 0", "error", "3 finite numbers", 'xyz="0.1 0.1 0.1"'),
    ("com", "0\n0\n0.1", "warning", "Pinocchio's parser takes no number there", 'xyz="0 0 0.1"'),
    ("com", "0\t0 0.1", "warning", "Pinocchio's parser takes no number there", 'xyz="0 0 0.1"'),
    ("xyz", "0 0\n0.5", "warning", "Pinocchio's parser takes no number there", 'xyz="0 0 0.5"'),
    ("size", "0.1,0.2,0.3", "error", "leave out the shape", 'size="0.1 0.2 0.3"'),
]


def find_numbers(file: Path, **written: str) -> list[Finding]:
    file.write_text(ROBOT.format(**GOOD | written))
    return [one for one in lint(file).findings if one.check == "number"]


@pytest.mark.parametrize(("key", "text", "level", "words", "write"), WRONG)
def test_each_is_found_with_what_to_write(
    key: str, text: str, level: str, words: str, write: str, tmp_path: Path
) -> None:
    found = find_numbers(tmp_path / "s.urdf", **{key: text})
    assert [one for one in found if one.level == level and words in one.why and one.write == write], found


def test_good_numbers_are_clean_also_with_more_spaces_and_in_comments(tmp_path: Path) -> None:
    assert find_numbers(tmp_path / "s.urdf") == []
    assert find_numbers(tmp_path / "s.urdf", com=" 0  -1.5e-3 +.1 ", mass="1.") == []


def test_the_line_is_said(tmp_path: Path) -> None:
    (found,) = find_numbers(tmp_path / "s.urdf", com="0\n0 0.1")
    assert (found.place, found.given) == ("line 2", 'xyz="0\\n0 0.1"')


@pytest.mark.parametrize(("key", "text"), [(key, text) for key, text, *_ in WRONG if key in ("mass", "com")])
def test_pinocchio_takes_a_link_without_mass_where_lint_says_so(key: str, text: str, tmp_path: Path) -> None:
    pinocchio = pytest.importorskip("pinocchio")
    file = tmp_path / "s.urdf"
    file.write_text(ROBOT.format(**GOOD | {key: text}))
    if text in ("inf",):
        return  # a number for urdfdom
    assert sum(body.mass for body in pinocchio.buildModelFromUrdf(str(file)).inertias) == 0.0
    file.write_text(ROBOT.format(**GOOD))
    assert sum(body.mass for body in pinocchio.buildModelFromUrdf(str(file)).inertias) == 1.25


@pytest.mark.parametrize(
    ("key", "text", "level"), [(key, text, level) for key, text, level, *_ in WRONG if text != "inf"]
)
def test_mujoco_refuses_what_is_an_error_and_reads_what_is_a_warning(
    key: str, text: str, level: str, tmp_path: Path
) -> None:
    mujoco = pytest.importorskip("mujoco")
    file = tmp_path / "s.urdf"
    file.write_text(ROBOT.format(**GOOD | {key: text}))
    if level == "error":
        with pytest.raises(ValueError, match="XML Error"):
            mujoco.MjModel.from_xml_path(str(file))
    else:
        assert mujoco.MjModel.from_xml_path(str(file)).body_mass.sum() == 1.25
