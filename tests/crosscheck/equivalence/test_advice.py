"""Advice: the file whose numbers look wrong by themselves is to be mended; what is written is in its own frames and names."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from arm_texts import arm

import crosscheck
from crosscheck.equivalence.compare import compare
from crosscheck.equivalence.hints import describe_vector_change
from crosscheck.equivalence.output.advice import describe_quantity
from crosscheck.equivalence.output.text import render_markdown
from crosscheck.linting.lint import lint

UPPER = 'ixx="0.031" ixy="0.001" ixz="0.002" iyy="0.029" iyz="0.0005" izz="0.008"'
LOWER = '<origin xyz="0.11 0.01 0.02"/><mass value="2.375"/>'


def lines(a: Path, b: Path) -> list[str]:
    return [line for _, written in compare(a, b).advice for line in written]


@pytest.mark.parametrize(
    ("value", "before", "said"),
    [
        ((0.1, 0.2140001, 0.3), (0.1, -0.214, 0.3), "the opposite sign of y"),
        ((0.1, 0.3, 0.2), (0.1, 0.2, 0.3), "y and z are exchanged"),
        ((0.076, 0.079, 0.0), (0.076, 0.097, 0.0), "its y: the same digits in another order"),
        ((0.0, 0.0, 2.5), (0.0, 0.0, 0.25), "its z: times ten: looks like a decimal point that moved"),
        ((0.1, 0.2, 0.31), (0.1, 0.2, 0.3), ""),
        ((0.0, 0.0, 0.5), (0.0, 0.0, 0.0), ""),
    ],
)
def test_what_a_slip_of_the_hand_looks_like(value: tuple[float, ...], before: tuple[float, ...], said: str) -> None:
    assert "; ".join(describe_vector_change(np.array(value), np.array(before))) == said


def test_digits_of_a_mass_that_were_exchanged(tmp_path: Path) -> None:
    comparison = compare(arm(tmp_path), arm(tmp_path, (LOWER, LOWER.replace("2.375", "2.735")), name="b.urdf"))
    assert comparison.differences[0].hints == ("the same digits in another order",)


def test_a_placeholder_is_what_to_mend(tmp_path: Path) -> None:
    placeholder = arm(tmp_path, (UPPER, 'ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"'), name="b.urdf")
    comparison = compare(arm(tmp_path), placeholder)
    assert comparison.suspects == "Of the numbers that differ 1 of B's look wrong by themselves: see what to write."
    said = [line for _, written in comparison.advice for line in written]
    assert said[0] == "mend B: upper, 0.1 kg m^2 about every axis: looks like a placeholder"
    assert "mend B" in render_markdown(comparison)
    assert compare(placeholder, arm(tmp_path)).suspects.startswith("Of the numbers that differ 1 of A's")
    ordinary = arm(tmp_path, (LOWER, LOWER.replace("2.375", "2.5")), name="c.urdf")
    assert not any(line.startswith("mend") for line in lines(arm(tmp_path), ordinary))


def test_what_to_write_gives_the_other_file(tmp_path: Path) -> None:
    """In B the lower link has another name, another frame and another centre: written as advised, B is A."""
    frame = ('xyz="0.05 0 0.3" rpy="0 0.3 0.1"', 'xyz="0.05 0 0.3" rpy="0 0.3 0.1"')
    turned = (
        '<axis xyz="0 0 1"/><limit lower="-2.5" upper="2.0"',
        '<axis xyz="0 0 -1"/><limit lower="-1.75" upper="2.5"',
    )
    b = arm(tmp_path, frame, turned, name="b.urdf")
    said = lines(arm(tmp_path), b)
    assert 'to make B (b.urdf) like A, in joint elbow: <limit lower="-2" .../>' in said
    renamed = b.read_text().replace('"lower"', '"forearm"').replace(LOWER, LOWER.replace("0.11", "0.21"))
    b.write_text(renamed)
    wanted = 'to make B (b.urdf) like A, in link forearm: <inertial> <origin xyz="0.11 0.01 0.02" .../>'
    assert wanted in lines(arm(tmp_path), b)


@pytest.mark.parametrize(
    ("kind", "cause", "value", "expected"),
    [
        ("sdf", "mass", "2.5", "<inertial> <mass>2.5</mass>"),
        ("sdf", "damping", "0.1", "<axis> <dynamics> <damping>0.1</damping>"),
        (
            "sdf",
            "inertia tensor",
            "1 2 3 4 5 6",
            "<inertial> <inertia> <ixx>1</ixx> <ixy>2</ixy> <ixz>3</ixz> <iyy>4</iyy> <iyz>5</iyz> <izz>6</izz>, "
            "along the axes of the link (no rotation in the inertial's <pose>)",
        ),
        ("usd", "centre of mass", "0.1 0 0.2", "point3f physics:centerOfMass = (0.1, 0, 0.2) (of a stage in metres)"),
        ("usd", "inertia tensor", "1 2 3 4 5 6", ""),  # a diagonal and its axes: not one number to write
        ("mjcf", "effort limit", "none", ""),
        ("kit", "mass", "2.5", ""),
    ],
)
def test_every_format_has_its_own_words(kind: str, cause: str, value: str, expected: str) -> None:
    assert describe_quantity(kind, cause, value) == expected


def test_what_is_written_into_a_toml_file_gives_the_other(tmp_path: Path) -> None:
    """Each line of advice replaces the line of the file that says so; then both are the same machine."""
    for name, numbers in (("a", ("2", "[0.1, 0, 0.02]", "xy = 0.001, ")), ("b", ("2.5", "[0.12, 0.01, 0.02]", ""))):
        folder = tmp_path / name
        folder.mkdir()
        mass, com, product = numbers
        (folder / "mechanism.toml").write_text(
            f"""source = "test"
gravity_m_per_s2 = [0, 0, -9.81]
[links.arm]
kind = "rigid"
mass_kg = {mass}
com_m = {com}
inertia_kgm2 = {{ xx = 0.02, {product}yy = 0.03, zz = 0.04 }}
[joints.hub]
kind = "revolute"
parent = "world"
child = "arm"
axis = [0, 1, 0]
"""
        )
    comparison = compare(tmp_path / "a", tmp_path / "b")
    assert not comparison.equal
    text = (tmp_path / "a" / "mechanism.toml").read_text()
    for line in (line for _, some in comparison.advice for line in some if line.startswith("to make A")):
        new = line.partition(": ")[2]
        key = new.partition(" = ")[0]
        text = "\n".join(new if own.startswith(f"{key} = ") else own for own in text.splitlines())
    (tmp_path / "a" / "mechanism.toml").write_text(text)
    assert compare(tmp_path / "a", tmp_path / "b").equal


def test_one_factor_on_everything_is_one_line(tmp_path: Path) -> None:
    text = arm(tmp_path).read_text()
    for mass in ("4.125", "3.25", "2.375", "0.8125", "0.125"):
        text = text.replace(f'mass value="{mass}"', f'mass value="{float(mass) * 1000}"')
    (tmp_path / "b.urdf").write_text(text)
    comparison = compare(arm(tmp_path), tmp_path / "b.urdf")
    said = [line for place, written in comparison.advice for line in written if "mass" in place]
    assert said == [
        "to make A like B, multiply it by 1000 everywhere",
        "to make B like A, divide it by 1000 everywhere",
    ]


def test_what_is_fixed_together_is_written_together(tmp_path: Path) -> None:
    """B has no flange of its own and other bodies there: what those have to have together is said."""
    start = arm(tmp_path).read_text()
    merged = start.replace('<mass value="0.8125"/>', '<mass value="0.9375"/>').replace('"flange"', '"tool_plate"')
    (tmp_path / "b.urdf").write_text(merged.replace('<mass value="2.375"/>', '<mass value="2.5"/>'))
    said = lines(arm(tmp_path), tmp_path / "b.urdf")
    assert any("together with what is fixed to it (lower, flange)" in line for line in said)


def test_a_body_of_another_name_is_written_alone(tmp_path: Path) -> None:
    """What is fixed to the lower link is a flange here and a tool plate there; nothing else of it differs than its mass."""
    start = arm(tmp_path).read_text()
    other = start.replace('<mass value="0.8125"/>', '<mass value="0.9375"/>').replace('"flange"', '"tool_plate"')
    (tmp_path / "b.urdf").write_text(other)
    assert lines(arm(tmp_path), tmp_path / "b.urdf") == [
        "to make A (arm.urdf) like B, in body flange, in the frame of link lower: mass 0.9375",
        "to make B (b.urdf) like A, in body tool_plate, in the frame of link lower: mass 0.8125",
    ]


def test_every_placeholder_is_what_to_mend_however_many_there_are(tmp_path: Path) -> None:
    """Eight links of one unit tensor in B: each is said to be B's to mend, and lint tells them in one line."""
    body = '<inertial><mass value="{}"/><inertia ixx="{}" ixy="0" ixz="0" iyy="{}" iyz="0" izz="{}"/></inertial>'
    joint = (
        '<joint name="j{0}" type="continuous"><origin xyz="0 0.1 0.2"/><parent link="l{1}"/><child link="l{0}"/>'
        '<axis xyz="{2}"/></joint>'
    )
    for name in "ab":
        tensors = [(1.0, 1.0, 1.0) if name == "b" else (0.02 + k / 1000, 0.03, 0.04) for k in range(9)]
        links = "".join(f'<link name="l{k}">{body.format(1 + k / 8, *tensors[k])}</link>' for k in range(9))
        joints = "".join(joint.format(k, k - 1, "1 0 0" if k % 2 else "0 1 0") for k in range(1, 9))
        (tmp_path / f"{name}.urdf").write_text(f'<robot name="snake">{links}{joints}</robot>')
    comparison = crosscheck.compare(tmp_path / "a.urdf", tmp_path / "b.urdf")
    named = [d for d in comparison.judged.causes if d.cause == "inertia tensor"]
    mended = [lines[0] for place, lines in comparison.advice if place.startswith("inertia tensor")]
    assert len(named) == 8
    assert all(line.startswith("mend B: l") and "placeholder" in line for line in mended)
    assert "8 of B's" in comparison.suspects
    told = [one.place for one in lint(tmp_path / "b.urdf").findings if one.check == "default tensor"]
    assert told == ["links l0, l1, l2, l3, l4, l5 ... (9)"]
