"""Bad mechanism files: every message names file, table and key, says what was given and expected, and what to write."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from complaints import Planted, check_complaint, planted

from flexinv.errors import InputError, ModelWarning
from flexinv.files.load_mechanism import load_mechanism

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


CASES: dict[str, Planted] = {
    **planted("bad_mechanisms.toml"),
    "integer beyond numbers": (
        *("length_m = 0.4", "length_m = 1" + "0" * 400),
        *("links.forearm", "length_m"),
        *("very large integer", "a number > 0 [m]", "length_m = 0.4"),
    ),
    "name too long": (
        *("[links.hand]", f'[links.{"a" * 101}]\nkind = "rigid"\n[links.hand]'),
        *("links.NAME", ""),
        *("aaa", "1 to 100 printable", "[links.arm_1]"),
    ),
    "text too long": (
        *('source = "test"', f'source = "{"a" * 4001}"'),
        *("", "source"),
        *("aaa", "where the data come from", 'source = "'),
    ),
}


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_message(tmp_path: Path, case: Planted) -> None:
    old, new, *_ = case
    check_complaint(message(tmp_path, old, new), tmp_path / "models" / "arm" / "mechanism.toml", case)


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
    assert re.findall(r", key (\w+)", said) == ["mass_kg", "com_m", "colour"]


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
