"""lint finds what no machine can have and what readers take differently, each check in a text in which it has to speak."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from arm_texts import ARM, arm
from click.testing import CliRunner
from lint_campaign import table

from crosscheck.cli import main
from crosscheck.linting.lint import lint
from flexinv.errors import InputError

UPPER = 'ixx="0.031" ixy="0.001" ixz="0.002" iyy="0.029" iyz="0.0005" izz="0.008"'
ELBOW = '<axis xyz="0 0 1"/><limit lower="-2.5" upper="2.0" effort="30" velocity="2"/>'
# What is edited, the check that speaks, where, and a word of why.
WRONG = {
    "triangle": ((UPPER, 'ixx="0.031" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.008"'), "tensor", "link upper", "exceeds"),
    "negative moment": ((UPPER, UPPER.replace('izz="0.008"', 'izz="-0.008"')), "tensor", "link upper", "negative"),
    "negative mass": (('value="3.25"', 'value="-3.25"'), "mass", "link upper", "negative"),
    "massless tensor": (('value="3.25"', 'value="0"'), "tensor without mass", "link upper", "no inertia"),
    "point mass": ((UPPER, 'ixx="0" iyy="0" izz="0"'), "mass without tensor", "link upper", "point"),
    "NaN": (('value="3.25"', 'value="nan"'), "number", "link upper", "zero"),
    "grams": (('value="3.25"', 'value="3250"'), "mass", "link upper", "grams"),
    "g mm^2": ((UPPER, 'ixx="31000" iyy="29000" izz="8000"'), "tensor", "link upper", "g mm^2"),
    "com in mm": (('xyz="0.01 0.02 0.153"', 'xyz="10 20 153"'), "com", "link upper", "mm"),
    "origin in mm": (('xyz="0.05 0 0.3"', 'xyz="50 0 300"'), "units", "joint elbow", "mm"),
    "degrees": (('rpy="0 0.3 0.1"', 'rpy="0 45 30"'), "units", "joint elbow", "degrees"),
    "limits in degrees": ((ELBOW, ELBOW.replace('"-2.5" upper="2.0"', '"-150" upper="120"')), "units", "joint elbow", "degrees"),
    "crossed limits": ((ELBOW, ELBOW.replace('"-2.5" upper="2.0"', '"2.5" upper="-2.0"')), "limit", "joint elbow", "above"),
    "no range": ((ELBOW, ELBOW.replace('"-2.5" upper="2.0"', '"0" upper="0"')), "limit", "joint elbow", "cannot move"),
    "no limit": ((ELBOW, '<axis xyz="0 0 1"/>'), "limit", "joint elbow", "has to state"),
    "no effort": ((ELBOW, ELBOW.replace('effort="30"', 'effort="0"')), "limit", "joint elbow", "nothing"),
    "axis of zero": (('<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>'), "axis", "joint elbow", "direction"),
    "long axis": (('<axis xyz="0 0 1"/>', '<axis xyz="0 0 2"/>'), "axis", "joint elbow", "normalise"),
    "gear in words": (("</robot>", '<transmission name="t"><type>Simple</type><joint name="elbow"/><actuator name="a">'
        '<mechanicalReduction>reduction</mechanicalReduction></actuator></transmission></robot>'),
        "transmission", "transmission t", "refuse"),
    "twice": (('link name="lower"', 'link name="upper"'), "name", "link 'upper'", "refuse"),
    "loop": (('<child link="finger"/>', '<child link="upper"/>'), "tree", "link upper", "loops"),
    "no such link": (('<child link="finger"/>', '<child link="thumb"/>'), "tree", "joint grip", "no such link"),
    "kind": (('name="elbow" type="revolute"', 'name="elbow" type="hinge"'), "kind of joint", "joint elbow", "no reader"),
    "mimic of nothing": (('mimic joint="grip"', 'mimic joint="grap"'), "mimic", "joint grip_mirror", "no such"),
    "damping": (('damping="0.3"', 'damping="-0.3"'), "dynamics", "joint shoulder", ">= 0"),
    "mesh": (("</robot>", '<link name="m"><visual><geometry><mesh filename="package://a/b.stl"/></geometry></visual></link>'
              '<joint name="j" type="fixed"><parent link="base"/><child link="m"/></joint></robot>'),
             "mesh", "robot", "not found"),
    "transmission": (("</robot>", '<transmission name="t"><type>Differential</type><joint name="elbow"/></transmission></robot>'),
                     "transmission", "transmission t", "drop"),
    "placeholder": ((UPPER, 'ixx="1" iyy="1" izz="1"'), "default tensor", "link upper", "placeholder"),
}  # fmt: skip


@pytest.mark.parametrize("edit", WRONG)
def test_each_check_speaks_where_it_should(edit: str, tmp_path: Path) -> None:
    text, check, place, words = WRONG[edit]
    result = lint(arm(tmp_path, text)).findings
    assert [f for f in result if f.check == check and f.place == place and words in f.why], result
    assert all(f.write for f in result)


def test_a_sound_arm_has_its_mimic_only(tmp_path: Path) -> None:
    assert [f.check for f in lint(arm(tmp_path)).findings] == ["mimic"]
    assert lint(arm(tmp_path)).clean
    assert not lint(tmp_path / "arm.urdf", strict=True).clean


def test_links_without_mass_that_joints_move_are_found(tmp_path: Path) -> None:
    text = (
        ARM[: ARM.index('<link name="finger">')]
        + '<link name="finger"/>'
        + ARM[ARM.index('<link name="other_finger">') :]
    )
    (tmp_path / "arm.urdf").write_text(text)
    assert ("link without inertia", "link finger") in {(f.check, f.place) for f in lint(tmp_path / "arm.urdf").findings}


def test_sides_that_differ_are_found(tmp_path: Path) -> None:
    text = ARM.replace("other_finger", "right_finger").replace('"finger"', '"left_finger"')
    (tmp_path / "arm.urdf").write_text(text)
    assert "left and right" not in {f.check for f in lint(tmp_path / "arm.urdf").findings}
    (tmp_path / "arm.urdf").write_text(text.replace('value="0.125"', 'value="0.25"', 1))
    assert "left and right" in {f.check for f in lint(tmp_path / "arm.urdf").findings}


def test_other_formats_are_linted_by_their_mechanism(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    body = '<inertial mass="2000" pos="0 0 0.1" diaginertia="0.01 0.01 0.01"/><joint name="a" range="-150 90"/>'
    (tmp_path / "a.xml").write_text(f"<mujoco><worldbody><body name='b'>{body}</body></worldbody></mujoco>")
    assert {"mass", "default tensor"} <= {f.check for f in lint(tmp_path / "a.xml").findings}


def test_files_that_are_none_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.urdf").write_text("")
    with pytest.raises(InputError, match="an empty file"):
        lint(tmp_path / "a.urdf")


def test_the_command_says_what_it_found_and_leaves_with_its_code(tmp_path: Path) -> None:
    good, bad = arm(tmp_path), arm(tmp_path, ('value="3.25"', 'value="-3.25"'), name="bad.urdf")
    run = CliRunner().invoke(main, ["lint", str(good)])
    assert run.exit_code == 0
    assert "errors: 0, warnings: 1" in run.output
    assert CliRunner().invoke(main, ["lint", str(good), "--strict"]).exit_code == 1
    run = CliRunner().invoke(main, ["lint", str(bad), "--json", "--junit", str(tmp_path / "j.xml")])
    assert run.exit_code == 1
    assert json.loads(run.output)[0]["findings"][0]["check"] == "mass"
    assert b"<failure" in (tmp_path / "j.xml").read_bytes()
    assert CliRunner().invoke(main, ["lint", str(tmp_path / "none.urdf")]).exit_code == 2


def test_through_a_pipe_each_finding_is_one_line_that_breaks_nowhere(tmp_path: Path) -> None:
    file = arm(tmp_path, ('value="3.25"', 'value="-3.25"'), name=f"{'a_long_name_' * 12}.urdf")
    *lines, counted = CliRunner().invoke(main, ["lint", str(file)]).output.splitlines()
    found = lint(file)
    assert [line.split(": ")[:3] for line in lines] == [[file.name, f.level, f.check] for f in found.findings]
    assert all(
        f.why in line and line.endswith(f"; write {f.write}") for f, line in zip(found.findings, lines, strict=True)
    )
    assert counted == f"{file.name}: {found.words}"


def test_a_folder_of_files_says_what_to_write(tmp_path: Path) -> None:
    arm(tmp_path)
    run = CliRunner().invoke(main, ["lint", str(tmp_path)])
    assert run.exit_code == 2
    assert f"write:    {tmp_path}/*.urdf for all in crosscheck lint, or one such as {tmp_path}/arm.urdf" in run.output
    (nested := tmp_path / "robots" / "one").mkdir(parents=True)
    arm(nested)
    with pytest.raises(InputError, match=r"robots/\*/\*\.urdf for all"):
        lint(nested.parent)
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"write: *a URDF, MJCF"):
        lint(tmp_path / "empty")


def shaped(folder: Path, inertial: str, shape: str, colliding: str = "") -> list[str]:
    """The checks that speak of shapes, for the arm whose upper link is another one."""
    start, end = ARM.index('<link name="upper">'), ARM.index('<link name="lower">')
    drawn = f'<visual><origin xyz="0 0 0.15"/><geometry>{shape}</geometry></visual>'
    hit = f"<collision>{drawn.removeprefix('<visual>').split('<geometry>')[0]}<geometry>{colliding}</geometry></collision>"
    link = f'<link name="upper"><inertial>{inertial}</inertial>{drawn}{hit if colliding else ""}</link>'
    (folder / "arm.urdf").write_text(ARM[:start] + link + ARM[end:])
    return [
        f.check for f in lint(folder / "arm.urdf").findings if f.check in ("centre outside", "moments of shape", "mesh")
    ]


ROD = (
    '<origin xyz="0 0 0.15"/><mass value="3.25"/><inertia ixx="0.031" ixy="0" ixz="0" iyy="0.031" iyz="0" izz="0.004"/>'
)
OTHER_SIGN = ROD.replace("0 0 0.15", "0 0 -0.15")
ABOUT_FRAME = ROD.replace('"0.031"', '"0.154"')  # + 3.25 kg (0.195 m)^2
BOX = '<box size="0.1 0.1 0.3"/>'


def test_shapes_tell_of_centres_and_moments(tmp_path: Path) -> None:
    assert shaped(tmp_path, OTHER_SIGN, BOX) == ["centre outside"]
    for shape in (BOX, '<cylinder radius="0.05" length="0.3"/>', '<sphere radius="0.15"/>'):
        assert shaped(tmp_path, ROD, shape) == []
        assert shaped(tmp_path, ABOUT_FRAME, shape) == ["moments of shape"]


def test_marks_and_covers_are_no_bodies(tmp_path: Path) -> None:
    """A sphere of 1 mm cannot hold 3 kg: it is a mark; a box that collides does not stand for a mesh that is missing."""
    assert shaped(tmp_path, ROD, '<sphere radius="0.001"/>') == []
    assert shaped(tmp_path, ROD, '<sphere radius="0.033"/>') == [
        "moments of shape"
    ]  # it can hold them, and not their moments
    missing = '<mesh filename="gone.dae"/>'
    assert "centre outside" not in shaped(tmp_path, OTHER_SIGN, missing, BOX)
    assert shaped(tmp_path, OTHER_SIGN, BOX, BOX) == ["centre outside"]


def test_meshes_are_read_and_their_units_seen(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed (python -m pip install trimesh)")
    trimesh.creation.box((0.1, 0.1, 0.3)).export(tmp_path / "upper.stl")
    assert shaped(tmp_path, ROD, '<mesh filename="upper.stl"/>') == []
    assert shaped(tmp_path, OTHER_SIGN, '<mesh filename="upper.stl"/>') == ["centre outside"]
    assert shaped(tmp_path, ROD, '<mesh filename="upper.stl" scale="1000 1000 1000"/>') == ["mesh"]
    (tmp_path / "upper.stl").write_bytes(b"no mesh at all")
    assert shaped(tmp_path, OTHER_SIGN, '<mesh filename="upper.stl"/>') == ["mesh"]  # that it is none, and no more


def test_a_table_of_findings_over_many_files(tmp_path: Path) -> None:
    file = arm(tmp_path, ('value="3.25"', 'value="-3.25"'))
    assert "| arm.urdf | 1 | 1 | mass, mimic |" in list(table([file], tmp_path))


def test_the_page_shows_names_as_they_are(tmp_path: Path) -> None:
    odd = [(f'{tag}="upper"', f'{tag}="up&lt;b&gt;per"') for tag in ("link name", "child link", "parent link")]
    file = arm(tmp_path, *odd, ('value="3.25"', 'value="-3.25"'))
    run = CliRunner().invoke(main, ["lint", str(file), "--out", str(tmp_path / "out")])
    assert run.exit_code == 1
    page = (tmp_path / "out" / "index.html").read_text()
    assert "up&lt;b&gt;per" in page
    assert "<b>per" not in page
    assert json.loads((tmp_path / "out" / "results.json").read_text())["files"][0]["clean"] is False
    assert b"<failure" in (tmp_path / "out" / "junit.xml").read_bytes()
    assert "up&lt;b&gt;per" in (tmp_path / "out" / "summary.md").read_text()


def test_a_file_that_cannot_be_read_keeps_no_findings_back(tmp_path: Path) -> None:
    """Of three files one is empty: the findings of the others are shown and written, and the exit code is 2."""
    (tmp_path / "empty.urdf").write_text("")
    files = [
        arm(tmp_path, WRONG["grams"][0]),
        tmp_path / "empty.urdf",
        arm(tmp_path, WRONG["negative mass"][0], name="c.urdf"),
    ]
    run = CliRunner().invoke(main, ["lint", *map(str, files), "--out", str(tmp_path / "out")])
    assert run.exit_code == 2
    assert all(word in run.output for word in ("arm.urdf: errors: 0", "c.urdf: errors: 1", "an empty file"))
    written = json.loads((tmp_path / "out" / "results.json").read_text())["files"]
    assert [[f["check"] for f in one["findings"] if f["level"] == "error"] for one in written] == [
        [],
        ["file"],
        ["mass"],
    ]
