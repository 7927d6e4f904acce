"""compare names what differs between two descriptions, proves it by repair, and knows conventions for what they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from arm_texts import ARM, arm

import crosscheck
from crosscheck.equivalence.compare import compare
from crosscheck.equivalence.result import REPAIRED
from crosscheck.equivalence.sources import describe
from flexinv.errors import InputError

LOWER = '<inertial><origin xyz="0.11 0.01 0.02"/><mass value="2.375"/>'
UPPER = '<inertial><origin xyz="0.01 0.02 0.153" rpy="0.1 0.2 0.3"/><mass value="3.25"/>'


def named(a: Path, b: Path, **options: object) -> list[tuple[str, str]]:
    comparison = compare(a, b, **options)  # type: ignore[arg-type]
    assert comparison.judged.after <= REPAIRED  # the causes put into A give B
    return [(d.cause, d.place) for d in comparison.differences]


# What is edited, what is named, and its size.  Sizes are those of the edit to the digits of the numbers written.
EDITS = {
    "mass": ([(LOWER, LOWER.replace("2.375", "2.625"))], "mass", "link lower", 0.25),
    "com": ([(LOWER, LOWER.replace("0.11 0.01", "0.14 0.05"))], "centre of mass", "link lower", 0.05),
    "tensor": ([('ixx="0.004"', 'ixx="0.006"')], "inertia tensor", "link lower", 0.002),
    "fixed": ([('rpy="0 1.2 0"', 'rpy="0 1.3 0"')], "orientation of joint", "joint to_flange", 0.1),
    "moved": ([('xyz="0.05 0 0.3"', 'xyz="0.05 0.02 0.3"')], "position of joint", "joint elbow", 0.02),
    "moved slide": ([('xyz="0.02 0 0.05"', 'xyz="0.05 0.04 0.05"')], "position of joint", "joint grip", 0.05),
    "axis": ([('<axis xyz="0 0 1"/>', '<axis xyz="0 0.6 0.8"/>')], "joint axis", "joint elbow", np.arcsin(0.6)),
    "damping": ([('damping="0.3"', 'damping="0.5"')], "damping", "joint shoulder", 0.2),
    "friction": ([('friction="0.1"', 'friction="0.4"')], "dry friction", "joint shoulder", 0.3),
    "limit": ([('upper="2.0" effort="50"', 'upper="1.0" effort="50"')], "upper limit", "joint shoulder", 1.0),
    "missing": ([('<mass value="0.8125"/>', '<mass value="0"/>'),
                 ('ixx="0.0005" ixy="0" ixz="0" iyy="0.0006" iyz="0" izz="0.0007"', 'ixx="0" iyy="0" izz="0"')],
                "body that only A has", "link flange", 0.8125),
    "merged": ([('name="elbow" type="revolute"', 'name="elbow" type="fixed"')],
               "joint that moves in A only", "joint elbow", 1.0),
    "mimic": ([('<mimic joint="grip"/>', "")], "coupling that only A has", "joints grip, grip_mirror", 1.0),
}  # fmt: skip


@pytest.mark.parametrize("edit", EDITS)
def test_an_edit_is_named_alone_with_its_size(edit: str, tmp_path: Path) -> None:
    edits, cause, place, size = EDITS[edit]
    comparison = compare(arm(tmp_path), arm(tmp_path, *edits, name="b.urdf"))
    assert [(d.cause, d.place) for d in comparison.differences] == [(cause, place)]
    assert comparison.differences[0].size == pytest.approx(size, rel=1e-9)
    assert not comparison.equal
    assert comparison.judged.after <= REPAIRED


def test_a_file_is_itself_in_every_reader(tmp_path: Path) -> None:
    file = arm(tmp_path, ('<mimic joint="grip"/>', ""))  # a reader that drops it would differ, rightly
    pytest.importorskip("pinocchio")
    pytest.importorskip("mujoco")
    for reader in ("", "@pinocchio", "@mujoco"):
        assert compare(file, f"{file}{reader}").equal


def test_conventions_are_no_other_physics(tmp_path: Path) -> None:
    turned = (
        '<axis xyz="0 0 1"/><limit lower="-2.5" upper="2.0"',
        '<axis xyz="0 0 -1"/><limit lower="-2.0" upper="2.5"',
    )
    assert named(arm(tmp_path), arm(tmp_path, turned, name="b.urdf")) == [("sign of coordinate", "joint elbow")]
    comparison = compare(arm(tmp_path), arm(tmp_path, turned, name="b.urdf"), judge=["rigid", "drive"])
    assert comparison.equal


def test_a_zero_offset_is_a_convention_of_its_size(tmp_path: Path) -> None:
    moved = ('xyz="0 0 0.1" rpy="0.2 0 0"', 'xyz="0 0 0.1" rpy="0.2 0 0"'), ('rpy="0 0.3 0.1"', 'rpy="0 0.3 0.1"')
    straight = arm(tmp_path, *moved, ('rpy="0 0.3 0.1"', 'rpy="0 0 0.1"'))
    comparison = compare(straight, arm(tmp_path, ('rpy="0 0.3 0.1"', 'rpy="0 0 0.6"'), name="b.urdf"))
    causes = {(d.cause, d.place): d.size for d in comparison.differences if d.family == "convention"}
    assert causes == {("zero of coordinate", "joint elbow"): pytest.approx(0.5, rel=1e-9)}


def test_exchanged_bodies_are_one_cause(tmp_path: Path) -> None:
    edits = [(LOWER, "<LOWER>"), (UPPER, LOWER), ("<LOWER>", UPPER)]
    inertias = ['ixx="0.031" ixy="0.001" ixz="0.002" iyy="0.029" iyz="0.0005" izz="0.008"',
                'ixx="0.004" ixy="0.0002" ixz="0" iyy="0.016" iyz="0" izz="0.017"']  # fmt: skip
    edits += [(inertias[0], "<I>"), (inertias[1], inertias[0]), ("<I>", inertias[1])]
    assert named(arm(tmp_path), arm(tmp_path, *edits, name="b.urdf")) == [
        ("bodies exchanged", "link lower and link upper")
    ]


def test_nothing_feels_the_base_and_that_is_said(tmp_path: Path) -> None:
    comparison = compare(arm(tmp_path), arm(tmp_path, ('value="4.125"', 'value="9.5"'), name="b.urdf"))
    assert comparison.equal
    assert [(d.cause, d.place) for d in comparison.judged.unseen] == [("mass", "link base")]
    assert not compare(arm(tmp_path), tmp_path / "b.urdf", strict=True).equal


def test_printed_digits_are_rounding(tmp_path: Path) -> None:
    comparison = compare(arm(tmp_path, (LOWER, LOWER.replace("2.375", "2.37512"))), arm(tmp_path, name="b.urdf"))
    assert comparison.equal
    assert [d.cause for d in comparison.judged.rounding] == ["mass"]
    assert comparison.judged.rounding_effort > 0.0


def test_two_causes_are_both_needed(tmp_path: Path) -> None:
    edits = (LOWER, LOWER.replace("2.375", "2.625")), ('damping="0.3"', 'damping="0.5"')
    comparison = compare(arm(tmp_path), arm(tmp_path, *edits, name="b.urdf"))
    assert {(d.cause, d.place) for d in comparison.differences} == {
        ("mass", "link lower"),
        ("damping", "joint shoulder"),
    }
    assert all((d.share or 0.0) > comparison.tolerance for d in comparison.differences)


@pytest.mark.parametrize("turn", [-0.4, 0.3, 1.1, 2.0])
def test_an_axis_across_the_other_one_is_not_turned_round(turn: float, tmp_path: Path) -> None:
    """The product of both is rounding, of either sign."""
    c, s = np.cos(turn), np.sin(turn)
    axis, across = (f'<axis xyz="{x:.17g} {y:.17g} 0"/>' for x, y in ((c, s), (-s, c)))
    files = [arm(tmp_path, ('<axis xyz="0 0 1"/>', text), name=f"{k}.urdf") for k, text in enumerate((axis, across))]
    assert named(*files) == named(*files[::-1]) == [("joint axis", "joint elbow")]


SIGN_LINE = '<axis xyz="..."/> with the opposite sign, and the limits exchanged with it'
LEADS = '<axis xyz="1 0 0"/><limit lower="0" upper="0.04" effort="20" velocity="0.2"/></joint>'
FOLLOWS = '<axis xyz="-1 0 0"/><limit lower="0" upper="0.04" effort="20" velocity="0.2"/><mimic'


@pytest.mark.parametrize("joint", ["grip", "grip_mirror"])
def test_a_turned_axis_of_coupled_joints_is_one_cause(joint: str, tmp_path: Path) -> None:
    """The law of the coupling stays as it is written: what follows goes the other way, which torques feel."""
    text, other = (LEADS, "-1 0 0") if joint == "grip" else (FOLLOWS, "1 0 0")
    xyz = "1 0 0" if joint == "grip" else "-1 0 0"
    turned = text, text.replace(f'"{xyz}"', f'"{other}"').replace('lower="0" upper="0.04"', 'lower="-0.04" upper="0"')
    file = arm(tmp_path, turned, name="b.urdf")
    assert named(arm(tmp_path), file) == [("sign of coordinate", f"joint {joint}")]
    comparison = compare(arm(tmp_path), file, judge=["rigid", "drive"])
    assert not comparison.equal
    coupled = "grip_mirror" if joint == "grip" else "grip"
    (_, lines), *_ = comparison.advice
    assert [line.partition(": ")[2] for line in lines] == [SIGN_LINE, SIGN_LINE]
    assert f"coupled to it by the same law in both: {coupled}" in comparison.differences[0].hints
    factor = (
        '<mimic joint="grip"/>',
        '<mimic joint="grip" multiplier="-1"/>',
    )  # and the law with it: a convention again
    assert compare(arm(tmp_path), arm(tmp_path, turned, factor, name="b.urdf"), judge=["rigid", "drive"]).equal


def test_limits_that_were_left_as_they_were_stay(tmp_path: Path) -> None:
    """Where only the axis was turned, only the axis is to be turned back."""
    file = arm(tmp_path, (LEADS, LEADS.replace("1 0 0", "-1 0 0")), name="b.urdf")
    (_, lines), *_ = compare(arm(tmp_path), file).advice
    assert all(line.endswith("with the opposite sign; the limits stay as they are") for line in lines)


def test_a_law_that_differs_beside_a_turned_axis_is_named(tmp_path: Path) -> None:
    turned = LEADS, LEADS.replace("1 0 0", "-1 0 0").replace('lower="0" upper="0.04"', 'lower="-0.04" upper="0"')
    factor = ('<mimic joint="grip"/>', '<mimic joint="grip" multiplier="2"/>')
    result = named(arm(tmp_path), arm(tmp_path, turned, factor, name="b.urdf"))
    assert result == [("factor of coupling", "joints grip, grip_mirror"), ("sign of coordinate", "joint grip")]


def test_renamed_joints_are_found_by_structure(tmp_path: Path) -> None:
    text = ARM.replace('"shoulder"', '"q_a"').replace('"elbow"', '"q_b"')
    (tmp_path / "b.urdf").write_text(text)
    comparison = compare(arm(tmp_path), tmp_path / "b.urdf")
    assert comparison.equal
    assert "by structure" in comparison.matched


def test_symmetric_fingers_are_asked_for(tmp_path: Path) -> None:
    same = ('xyz="-0.02 0 0.05"', 'xyz="0.02 0 0.05"'), ('xyz="-1 0 0"', 'xyz="1 0 0"'), ('<mimic joint="grip"/>', "")
    a = arm(tmp_path, *same)
    (tmp_path / "b.urdf").write_text(a.read_text().replace('"grip"', '"p"').replace('"grip_mirror"', '"r"'))
    with pytest.raises(InputError, match="--match grip=p"):
        compare(a, tmp_path / "b.urdf")
    assert compare(a, tmp_path / "b.urdf", match={"grip": "p", "grip_mirror": "r"}, judge=["rigid"]).matched.startswith(
        "2 by name"
    )


def test_assert_same_says_what_differs(tmp_path: Path) -> None:
    other = arm(tmp_path, (LOWER, LOWER.replace("2.375", "2.625")), name="b.urdf")
    crosscheck.assert_same(arm(tmp_path), tmp_path / "arm.urdf")
    with pytest.raises(AssertionError, match=r"mass of link lower by 0\.25 kg: 2\.375 in A, 2\.625 in B"):
        crosscheck.assert_same(tmp_path / "arm.urdf", other)
    frame = crosscheck.compare(tmp_path / "arm.urdf", other).frame()
    assert list(frame["cause"]) == ["mass"]


def test_live_models_are_descriptions(tmp_path: Path) -> None:
    mujoco, pin = pytest.importorskip("mujoco"), pytest.importorskip("pinocchio")
    file = arm(tmp_path, ('<mimic joint="grip"/>', ""))
    model = pin.buildModelFromUrdf(str(file))
    assert crosscheck.compare(model, mujoco.MjModel.from_xml_path(str(file))).equal
    body = model.inertias[2]
    model.inertias[2] = pin.Inertia(1.5 * body.mass, body.lever, 1.5 * body.inertia)
    causes = {d.cause for d in crosscheck.compare(file, model).differences}
    assert causes == {"mass", "inertia tensor"}


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("empty.urdf", "", "an empty file"),
        ("arm.xacro", "<robot/>", "xacro"),
        ("arm.urdf", '<!DOCTYPE r [<!ENTITY a "b">]><robot name="a"/>', "DOCTYPE or ENTITY"),
        ("arm.urdf", "<model/>", "<model>"),
        ("arm.urdf", ARM.replace('value="2.375"', 'value="nan"'), "lower.*mass"),
        ("arm.urdf", ARM.replace('value="2.375"', 'value="-2.375"'), "a mass >= 0"),
        ("arm.urdf", ARM.replace('link name="lower"', 'link name="upper"'), "twice"),
        ("arm.urdf", "<robot>" * 50, "does not parse"),
    ],
)
def test_bad_files_are_one_clear_error(name: str, text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=words):
        describe(tmp_path / name)


def test_unknown_engines_and_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no engine is called 'gazebo'"):
        describe(f"{arm(tmp_path)}@gazebo")
    with pytest.raises(InputError, match="no such file"):
        describe(tmp_path / "none.urdf")


def test_a_file_under_a_wrong_suffix_is_read_as_what_it_is(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    (tmp_path / "arm.urdf").write_text("<mujoco><worldbody><body><joint/><geom size='1'/></body></worldbody></mujoco>")
    assert "MJCF" in describe(tmp_path / "arm.urdf").dropped[0]


def test_other_frames_and_tilted_axes_together_are_repaired(tmp_path: Path) -> None:
    """Frames, axes and zeros are all other ones: how they are named may be argued about, but together they give B."""
    edits = ('xyz="0.05 0 0.3" rpy="0 0.3 0.1"', 'xyz="0.06 0.01 0.3" rpy="0.5 0.3 0.9"'), ("0 0 1", "0.1 0.5 0.8")
    odd = arm(tmp_path, *edits, (LOWER, LOWER.replace("2.375", "2.5")), name="b.urdf")
    assert compare(arm(tmp_path), odd).judged.after <= REPAIRED


def test_a_joint_on_another_link_is_named(tmp_path: Path) -> None:
    moved = arm(
        tmp_path,
        ('<parent link="flange"/><child link="finger"/>', '<parent link="upper"/><child link="finger"/>'),
        name="b.urdf",
    )
    comparison = compare(arm(tmp_path), moved)
    assert ("parent of joint", "joint grip") in {(d.cause, d.place) for d in comparison.differences}
    assert comparison.judged.after <= REPAIRED


def test_a_hinge_and_a_ball_of_one_name_are_of_another_kind(tmp_path: Path) -> None:
    """No coordinate of one is one of the other: both are held at zero, and the rest is compared."""
    pytest.importorskip("mujoco")
    text = """<mujoco><worldbody><body name="b"><joint name="j" {}/><geom size="0.1"/>
      <body name="c" pos="0 0 1"><joint name="k"/><geom size="0.1"/></body></body></worldbody></mujoco>"""
    (tmp_path / "a.xml").write_text(text.format("axis='0 1 0'"))
    (tmp_path / "b.xml").write_text(text.format("type='ball'"))
    for a, b in (("a.xml", "b.xml"), ("b.xml", "a.xml")):
        assert named(tmp_path / a, tmp_path / b) == [("kind of joint", "joint j")]


def test_a_body_without_joints_is_compared_by_its_numbers(tmp_path: Path) -> None:
    base = ARM[: ARM.index('<link name="upper">')] + "</robot>"
    for name, mass in (("a.urdf", "4.125"), ("b.urdf", "4.5")):
        (tmp_path / name).write_text(base.replace("4.125", mass))
    assert compare(tmp_path / "a.urdf", tmp_path / "a.urdf").equal
    assert [d.cause for d in compare(tmp_path / "a.urdf", tmp_path / "b.urdf").judged.unseen] == ["mass"]


def test_the_same_number_in_several_joints_is_one_difference(tmp_path: Path) -> None:
    """Damping of 0.5 in four joints that have none: one line, and what to write in each; in two of them: two lines."""
    plain = ARM.replace('<dynamics damping="0.3" friction="0.1"/>', "").replace('type="prismatic"', 'type="revolute"')
    (tmp_path / "a.urdf").write_text(plain)
    for count, name in ((2, "two.urdf"), (4, "four.urdf")):
        (tmp_path / name).write_text(plain.replace("<limit", '<dynamics damping="0.5"/><limit', count))
    two, four = (compare(tmp_path / "a.urdf", tmp_path / name) for name in ("two.urdf", "four.urdf"))
    assert sorted(d.place for d in two.differences) == ["joint elbow", "joint shoulder"]
    assert [sorted(d.place.replace(",", "").split()) for d in four.differences] == [
        ["elbow", "grip", "grip_mirror", "joints", "shoulder"]
    ]
    assert four.judged.after <= REPAIRED
    assert any("in each of the joints" in line for _, lines in four.advice for line in lines)


LEG = """<link name="{side}_hip"><inertial><origin xyz="0.05 {y} 0"/><mass value="0.25"/>
    <inertia ixx="0.001" iyy="0.002" izz="0.003" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="{side}_knee"><inertial><origin xyz="0.02 0.03 -0.125"/><mass value="0.5"/>
    <inertia ixx="0.004" iyy="0.005" izz="0.006" ixy="0.0001" ixz="0" iyz="0.0002"/></inertial></link>
  <joint name="{side}_hip" type="continuous"><origin xyz="0 {y}1 0"/><parent link="trunk"/><child link="{side}_hip"/>
    <axis xyz="1 0 0"/></joint>
  <joint name="{side}_knee" type="continuous"><origin xyz="0.125 0 0"/><parent link="{side}_hip"/><child link="{side}_knee"/>
    <axis xyz="1 0 0"/></joint>"""


def legs(left: str, right: str) -> str:
    """Two legs whose hips are mirror images, which half a turn of the joint makes of one another."""
    parts = [LEG.format(side=side, y=y) for side, y in (("left", "0.0625"), ("right", "-0.0625"))]
    parts[0] = parts[0].replace('"0.05 0.0625 0"', f'"0.05 {left} 0"')
    parts[1] = parts[1].replace('"0.05 -0.0625 0"', f'"0.05 {right} 0"')
    return f'<robot name="legs"><link name="trunk"/>{"".join(parts)}</robot>'


def test_exchanged_mirror_images_are_no_turned_frames(tmp_path: Path) -> None:
    """One exchange says as much as two turned zeros and two moved knees; one mirrored centre alone is a centre."""
    (tmp_path / "a.urdf").write_text(legs("0.01", "-0.01"))
    (tmp_path / "b.urdf").write_text(legs("-0.01", "0.01"))
    (tmp_path / "c.urdf").write_text(legs("0.01", "0.01"))
    exchanged = [("bodies exchanged", "link left_hip and link right_hip")]
    assert named(tmp_path / "a.urdf", tmp_path / "b.urdf") == exchanged
    assert named(tmp_path / "a.urdf", tmp_path / "c.urdf") == [("centre of mass", "link right_hip")]


def test_efforts_are_compared_where_a_coordinate_counts_the_other_way(tmp_path: Path) -> None:
    """The range was left as it was, which the convention says; the effort limit is another thing."""
    turned, weaker = ('<axis xyz="0 1 0"/>', '<axis xyz="0 -1 0"/>'), ('effort="50"', 'effort="40"')
    result = named(arm(tmp_path), arm(tmp_path, turned, weaker, name="b.urdf"))
    assert result == [("sign of coordinate", "joint shoulder"), ("effort limit", "joint shoulder")]
    assert named(arm(tmp_path), arm(tmp_path, turned, name="c.urdf")) == result[:1]


def test_two_bodies_that_are_alike_are_not_exchanged_by_rounding(tmp_path: Path) -> None:
    """A frame turned by the ninth digit of pi / 2 turns a tensor by as little: rounding, whatever else has that tensor."""
    (tmp_path / "a.urdf").write_text(legs("0.01", "0.01").replace('"0.125 0 0"', '"0.125 0 0" rpy="0 1.57079632679 0"'))
    (tmp_path / "b.urdf").write_text(legs("0.01", "0.01").replace('"0.125 0 0"', '"0.125 0 0" rpy="0 1.57079632 0"'))
    comparison = compare(tmp_path / "a.urdf", tmp_path / "b.urdf")
    assert comparison.equal
    assert "bodies exchanged" not in {d.cause for d in comparison.judged.unseen}
    assert comparison.judged.rounding
