"""Bad mechanism files: every message names file, table and key, says what was given and expected, and what to write."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from flexinv.errors import InputError, ModelWarning
from flexinv.mechanism_file import load_mechanism

GOOD = """
source = "test"
gravity_m_per_s2 = [0, 0, -9.81]

[sections.strip]
EA_N = 1.452e6
GA_N = 4.65e5
GJ_Nm2 = 0.626
EI_Nm2 = { y = 13.7, z = 0.46 }
mass_per_length_kg_per_m = 0.056
rho_I_kgm = { y = 5.28e-7, z = 1.77e-8 }

[sections.pipe]
shape = "tube"
outer_diameter_m = 0.02
wall_m = 0.002
E_Pa = 70e9
nu = 0.33
rho_kg_per_m3 = 2700

[links.upper]
kind = "rigid"
mass_kg = 0.215
com_m = [0.2, 0, 0]
inertia_kgm2 = { xx = 1e-5, yy = 2.9e-3, zz = 2.9e-3 }

[links.forearm]
kind = "beam"
length_m = 0.4
section = "strip"

[[links.forearm.payload]]
name = "tool"
station = 1.0
mass_kg = 0.1
com_m = [0, 0, 0]
inertia_kgm2 = 0

[joints.shoulder]
kind = "revolute"
parent = "world"
child = "upper"
axis = [0, 0, 1]

[joints.elbow]
kind = "revolute"
parent = "upper"
child = "forearm"
placement = { xyz_m = [0.4, 0, 0] }
axis = [0, 0, 1]
"""

HAND = """
[links.hand]
kind = "rigid"
massless = true
[joints.wrist]
kind = "fixed"
parent = "forearm"
station = 1.0
child = "hand"
"""


def write(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "models" / "arm" / "mechanism.toml"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text, encoding="utf-8")
    return file


def message(tmp_path: Path, old: str, new: str) -> str:
    """The message for the good file with one text replaced."""
    assert old in GOOD + HAND, "the case edits a text that is not there"
    file = write(tmp_path, (GOOD + HAND).replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        load_mechanism(file)
    return str(caught.value)


# replaced text, new text, then: table, key, part of what was given, part of what is expected, part of what to write
CASES = {
    "unit of a length": ("length_m = 0.4", "length_mm = 400", "links.forearm", "length_mm", "400", "length_m, the arc length", "length_m = 0.4"),
    "unit of an angle": ("placement = {", "placement = { rpy = [0, 0, 90],", "joints.elbow.placement", "rpy", "[0, 0, 90]", "[deg]", "rpy_deg = [0, 90, 0]"),
    "unit of a mass": ("mass_kg = 0.215", "mass_g = 215", "links.upper", "mass_g", "215", "mass_kg", "mass_kg = 0.215"),
    "unit of stiffness": ("EI_Nm2 = { y = 13.7, z = 0.46 }", "EI_Nmm2 = { y = 13.7e6, z = 0.46e6 }", "sections.strip", "EI_Nmm2", "13700000.0", "[N m^2]", "EI_Nm2 = { y = 13.7, z = 0.46 }"),
    "unit of inertia": ("inertia_kgm2 = { xx = 1e-5, yy = 2.9e-3, zz = 2.9e-3 }", "inertia_kgmm2 = { xx = 10, yy = 2900, zz = 2900 }", "links.upper", "inertia_kgmm2", "2900", "[kg m^2]", "inertia_kgm2 = { xx = 1e-05, yy = 0.0029, zz = 0.0029 }"),
    "unit of a modulus": ("E_Pa = 70e9", "E_GPa = 70", "sections.pipe", "E_GPa", "70", "Young's modulus", "E_Pa = 70000000000.0"),
    "no unit": ("gravity_m_per_s2", "gravity", "", "gravity", "-9.81", "[m/s^2]", "gravity_m_per_s2 = [0, 0, -9.81]"),
    "unit of another joint": ('axis = [0, 0, 1]\n\n[joints.elbow]', 'axis = [0, 0, 1]\ndamping_Ns_per_m = 1\n[joints.elbow]', "joints.shoulder", "damping_Ns_per_m", "1", "[N m s/rad]", "damping_Nms_per_rad = 0.1"),
    "unknown key": ("mass_kg = 0.215", "mass_gk = 0.215", "links.upper", "mass_gk", "0.215", "mass_kg", "mass_kg instead of mass_gk"),
    "unknown table": ("[sections.pipe]", "[section.pipe]", "", "section", "tube", "sections", "sections instead of section"),
    "key like no other": ("[links.upper]", "[links.upper]\ncolour = 'red'", "links.upper", "colour", "red", "mass_kg", "remove it"),
    "text for a number": ("length_m = 0.4", 'length_m = "0.4 m"', "links.forearm", "length_m", '"0.4 m"', "a number > 0 [m]", "length_m = 0.4"),
    "truth for a number": ("mass_kg = 0.215", "mass_kg = true", "links.upper", "mass_kg", "true", "a number > 0 [kg]", "mass_kg = 0.215"),
    "number for a text": ('section = "strip"', "section = 3", "links.forearm", "section", "3", "the name of a [sections.NAME]", "section = ["),
    "two numbers for three": ("com_m = [0.2, 0, 0]", "com_m = [0.2, 0]", "links.upper", "com_m", "[0.2, 0]", "three numbers [m]", "com_m = [0.2, 0.0, 0.0]"),
    "number for a table": ("placement = { xyz_m = [0.4, 0, 0] }", "placement = 0.4", "joints.elbow", "placement", "0.4", "xyz_m [m]", "placement = { xyz_m"),
    "fraction of an element": ('section = "strip"', 'section = "strip"\nelements = 1.5', "links.forearm", "elements", "1.5", "1..1000", "elements = 1"),
    "no element": ('section = "strip"', 'section = "strip"\nelements = 0', "links.forearm", "elements", "0", "1..1000", "elements = 1"),
    "negative mass": ("mass_kg = 0.215", "mass_kg = -0.215", "links.upper", "mass_kg", "-0.215", "> 0 [kg]", "massless = true"),
    "zero mass": ("mass_kg = 0.215", "mass_kg = 0", "links.upper", "mass_kg", "0", "> 0 [kg]", "massless = true"),
    "no mass": ("mass_kg = 0.215\n", "", "links.upper", "mass_kg", "nothing", "> 0 [kg]", "massless = true"),
    "payload without mass": ("mass_kg = 0.1\n", "", "links.forearm.payload[0]", "mass_kg", "nothing", "> 0 [kg]", "mass_kg = 0.215"),
    "mass and massless": ("massless = true", "massless = true\nmass_kg = 1", "links.hand", "massless", "massless = true and", "one or the other", "massless = false"),
    "NaN": ("length_m = 0.4", "length_m = nan", "links.forearm", "length_m", "nan", "a number > 0 [m]", "length_m = 0.4"),
    "infinity": ("EA_N = 1.452e6", "EA_N = inf", "sections.strip", "EA_N", "inf", "a number > 0 [N]", "EA_N = 1.452e6"),
    "NaN in a vector": ("com_m = [0.2, 0, 0]", "com_m = [0.2, nan, 0]", "links.upper", "com_m", "com_m[1] = nan", "three numbers [m]", "com_m = [0.2, 0.0, 0.0]"),
    "NaN in a table": ("{ y = 13.7, z = 0.46 }", "{ y = nan, z = 0.46 }", "sections.strip", "EI_Nm2", "nan", "[N m^2]", "EI_Nm2 = { y = 13.7, z = 0.46 }"),
    "integer beyond numbers": ("length_m = 0.4", "length_m = 1" + "0" * 400, "links.forearm", "length_m", "very large integer", "a number > 0 [m]", "length_m = 0.4"),
    "zero length": ("length_m = 0.4", "length_m = 0.0", "links.forearm", "length_m", "0.0", "a number > 0 [m]", "length_m = 0.4"),
    "zero stiffness": ("GA_N = 4.65e5", "GA_N = 0", "sections.strip", "GA_N", "0", "[N]", "GA_N = 4.65e5"),
    "rotary inertia not said": ("rho_I_kgm = { y = 5.28e-7, z = 1.77e-8 }\n", "", "sections.strip", "rho_I_kgm", "nothing", "or 0 if none", "rho_I_kgm = { y"),
    "rotary inertia negative": ("rho_I_kgm = { y = 5.28e-7,", "rho_I_kgm = { y = -5.28e-7,", "sections.strip", "rho_I_kgm", "negative", "[kg m]", "rho_I_kgm = { y"),
    "zero axis": ("axis = [0, 0, 1]", "axis = [0, 0, 0]", "joints.shoulder", "axis", "zero axis", "not all zero", "axis = [0, 0, 1]"),
    "no axis": ("axis = [0, 0, 1]\n", "", "joints.shoulder", "axis", "nothing", "three numbers [-]", "axis = [0, 0, 1]"),
    "inertia not symmetric": ("{ xx = 1e-5, yy = 2.9e-3, zz = 2.9e-3 }", "[[1, 0.5, 0], [0.4, 1, 0], [0, 0, 1]]", "links.upper", "inertia_kgm2", "not symmetric", "[kg m^2]", "about the centre of mass"),
    "inertia negative": ("xx = 1e-5", "xx = -1e-3", "links.upper", "inertia_kgm2", "principal moment is negative", "[kg m^2]", "check signs"),
    "inertia no triangle": ("xx = 1e-5", "xx = 7e-3", "links.upper", "inertia_kgm2", "exceeds the sum of the others", "p1 + p2 >= p3", "not about the joint"),
    "six numbers": ("{ xx = 1e-5, yy = 2.9e-3, zz = 2.9e-3 }", "[1e-5, 0, 0, 2.9e-3, 0, 2.9e-3]", "links.upper", "inertia_kgm2", "three rows", "{ xx, yy, zz }", "inertia_kgm2 = { xx"),
    "two inertias": ("com_m = [0.2, 0, 0]", "rod = { length_m = 0.4 }", "links.upper", "inertia_kgm2", "inertia_kgm2 and rod", "exactly one of", "point mass"),
    "no inertia": ("inertia_kgm2 = { xx = 1e-5, yy = 2.9e-3, zz = 2.9e-3 }", "", "links.upper", "inertia_kgm2", "nothing", "exactly one of", "inertia_kgm2 = 0 for a point mass"),
    "no centre of mass": ("com_m = [0.2, 0, 0]\n", "", "links.upper", "com_m", "nothing", "three numbers [m]", "com_m = [0, 0, 0]"),
    "unknown section": ('section = "strip"', 'section = "stripe"', "links.forearm", "section", "stripe", "strip, pipe", 'section = "strip"'),
    "unknown shape": ('shape = "tube"', 'shape = "tub"', "sections.pipe", "shape", "tub", "rectangle, circle, tube", 'shape = "tube"'),
    "wall too thick": ("wall_m = 0.002", "wall_m = 0.02", "sections.pipe", "wall_m", "0.02", "at most half", "wall_m = 0.002"),
    "two elastic constants": ("nu = 0.33", "nu = 0.33\nG_Pa = 26e9", "sections.pipe", "nu", "both", "one of nu [-] and G_Pa [Pa]", "nu = 0.33"),
    "Poisson's ratio": ("nu = 0.33", "nu = 0.6", "sections.pipe", "nu", "0.6", "-1 < nu <= 0.5", "nu = 0.33"),
    "stations out of order": ('section = "strip"', 'section = [{ at = 0.5, section = "strip" }, { at = 1, section = "pipe" }]', "links.forearm", "section", "[0.5, 1.0]", "increasing from 0 to 1", "at = 0"),
    "station outside": ("station = 1.0\nmass_kg", "station = 1.5\nmass_kg", "links.forearm.payload[0]", "station", "1.5", "0..1", "station = 1.0"),
    "payload without station": ("station = 1.0\nmass_kg", "mass_kg", "links.forearm.payload[0]", "station", "nothing", "0..1", "station = 1.0"),
    "joint without station": ("station = 1.0\nchild", "child", "joints.wrist", "station", "nothing", "0..1 of the beam forearm", "station = 1.0"),
    "station of a rigid link": ('parent = "upper"', 'parent = "upper"\nstation = 1.0', "joints.elbow", "station", "1.0", "upper is not a beam", "placement = {"),
    "unknown kind of link": ('kind = "beam"', 'kind = "bar"', "links.forearm", "kind", "bar", '"rigid" or "beam"', 'kind = "rigid"'),
    "unknown kind of joint": ('kind = "revolute"', 'kind = "hinge"', "joints.shoulder", "kind", "hinge", '"revolute", "continuous"', 'kind = "'),
    "joint to nowhere": ('child = "hand"', 'child = "hant"', "joints.wrist", "child", "hant", "upper, forearm, hand", 'child = "hand"'),
    "joint from nowhere": ('parent = "upper"', 'parent = "uper"', "joints.elbow", "parent", "uper", "world, upper", 'parent = "upper"'),
    "joint on itself": ('parent = "upper"', 'parent = "forearm"', "joints.elbow", "child", "both", "two links", "another parent"),
    "link carried twice": ('child = "hand"', 'child = "upper"', "joints.wrist", "child", "which joint shoulder carries already", "closed loops are not supported yet", "cut the loop"),
    "cycle": ('parent = "world"', 'parent = "hand"\nstation = 0', "joints.", "parent", "a cycle: ", "closed loops are not supported yet", 'parent = "world"'),
    "link that nothing carries": ("[links.hand]", '[links.lost]\nkind = "rigid"\nmassless = true\n[links.hand]', "links.lost", "", "no joint carries", "every link carried by one joint", 'child = "lost"'),
    "link named world": ("[links.hand]", '[links.world]\nkind = "rigid"\nmassless = true\n[links.hand]', "links.world", "", "named", "another name", 'parent = "world"'),
    "two rotations": ("placement = {", "placement = { rpy_deg = [0, 0, 0], rpy_rad = [0, 0, 0],", "joints.elbow.placement", "rpy_rad", "rpy_deg and rpy_rad", "one of", "rpy_deg alone"),
    "no rotation": ("placement = {", "placement = { rotation = [[1, 0, 0], [0, 2, 0], [0, 0, 1]],", "joints.elbow.placement", "rotation", "right-handed", "a rotation matrix", "[[1, 0, 0]"),
    "limits exchanged": ('parent = "upper"', 'parent = "upper"\nlimits = { lower_rad = 1, upper_rad = -1 }', "joints.elbow.limits", "upper", "lower 1, upper -1", "lower <= upper", "exchanged"),
    "no source": ('source = "test"', "", "", "source", "nothing", "where the data come from", 'source = "'),
    "overlay without URDF": ("[links.upper]", "[overlay.joints.elbow]\nfriction_Nm = 1\n[links.upper]", "overlay", "", "without [urdf]", "an overlay of a URDF", "[links.NAME]"),
    "name with a slash": ("[links.hand]", '[links."a/b"]\nkind = "rigid"\n[links.hand]', "links.NAME", "", "a/b", "no slash", "[links.arm_1]"),
    "name with control characters": ("[links.hand]", '[links."a\\u0007b"]\nkind = "rigid"\n[links.hand]', "links.NAME", "", r"a\x07b", "none of them a control character", "[links.arm_1]"),
    "text with control characters": ('source = "test"', 'source = "a\\u001bb"', "", "source", r"\x1b", "where the data come from", 'source = "'),
    "name too long": ("[links.hand]", f'[links.{"a" * 101}]\nkind = "rigid"\n[links.hand]', "links.NAME", "", "aaa", "1 to 100 printable", "[links.arm_1]"),
    "text too long": ('source = "test"', f'source = "{"a" * 4001}"', "", "source", "aaa", "where the data come from", 'source = "'),
    "same name of two payloads": ("[joints.shoulder]", '[[links.forearm.payload]]\nname = "tool"\nstation = 0\nmass_kg = 1\ncom_m = [0, 0, 0]\ninertia_kgm2 = 0\n[joints.shoulder]', "links.forearm.payload[1]", "name", "tool", "a name of its own", 'name = "tool_2"'),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_message(tmp_path: Path, case: tuple[str, ...]) -> None:
    old, new, table, key, given, expected, advice = case
    said = message(tmp_path, old, new)
    first, *rest = said.splitlines()
    assert str(tmp_path / "models" / "arm" / "mechanism.toml") in first
    assert (f"[{table}" if table else "the top of the file") in first
    assert not key or first.endswith(f"key {key}")
    lines = {line.split(":")[0].strip(): line for line in rest[:3]}
    assert given in lines["given"]
    assert expected in lines["expected"]
    assert advice in lines["write"]


def test_the_file_without_fault_is_read(tmp_path: Path) -> None:
    mechanism = load_mechanism(write(tmp_path, GOOD + HAND))
    assert [joint.name for joint in mechanism.joints] == ["shoulder", "elbow", "wrist"]


def test_duplicate_link_is_named(tmp_path: Path) -> None:
    said = message(tmp_path, "[links.hand]", '[links.upper]\nkind = "rigid"\n[links.hand]')
    assert "mechanism.toml" in said
    assert "[links.upper] twice" in said
    assert "name of its own" in said


def test_several_faults_are_told_together(tmp_path: Path) -> None:
    said = message(tmp_path, "mass_kg = 0.215\ncom_m = [0.2, 0, 0]", "mass_kg = -1\ncom_m = [0, 0]\ncolour = 1")
    assert [re.search(r"key (\w+)", line)[1] for line in said.splitlines() if "key" in line] == ["mass_kg", "com_m", "colour"]  # type: ignore[index]


def test_wrong_unit_is_one_fault_not_two(tmp_path: Path) -> None:
    """The missing length_m is what the complaint about length_mm tells to write."""
    assert message(tmp_path, "length_m = 0.4", "length_mm = 400").count("given:") == 1


def test_axis_that_is_not_unit_is_normalised_with_a_warning(tmp_path: Path) -> None:
    file = write(tmp_path, GOOD.replace("axis = [0, 0, 1]", "axis = [0, 0, -2]", 1))
    with pytest.warns(ModelWarning, match=r"table \[joints.shoulder\], key axis: .* has length 2, normalised to 1"):
        mechanism = load_mechanism(file)
    assert np.array_equal(mechanism.joint_of["shoulder"].axis, [0, 0, -1])


def test_file_that_is_not_there(tmp_path: Path) -> None:
    write(tmp_path, GOOD)
    with pytest.raises(InputError, match=r"amr/mechanism.toml\n.*no such file\n.*\n.*write: .*models/arm"):
        load_mechanism(tmp_path / "models" / "amr")


def test_file_that_is_too_large(tmp_path: Path) -> None:
    file = write(tmp_path, "#" * (1 << 20) + "\n")
    with pytest.raises(InputError, match="more than 1048576 bytes"):
        load_mechanism(file)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("x = 1 2", r"line 1.*\n.*expected: TOML.*\n.*write: "),
        ("x = " + "[" * 5000, r"nesting without end.*\n.*\n.*a few levels"),
        ("x = 1" + "0" * 5000, "digits"),
    ],
)
def test_file_that_is_no_toml(tmp_path: Path, text: str, match: str) -> None:
    file = write(tmp_path, text)
    with pytest.raises(InputError, match=match):
        load_mechanism(file)


def test_file_that_is_not_utf8(tmp_path: Path) -> None:
    file = write(tmp_path, "")
    file.write_bytes(b'source = "\xff"')
    with pytest.raises(InputError, match="byte 10 is not UTF-8"):
        load_mechanism(file)


def test_nothing_in_a_file_is_executed(tmp_path: Path) -> None:
    """Texts stay texts: no expression, no import, no path is followed from a name."""
    trap = tmp_path / "trap"
    said = message(tmp_path, 'section = "strip"', f"section = \"__import__('pathlib').Path('{trap}').touch()\"")
    assert "expected" in said
    assert not trap.exists()
