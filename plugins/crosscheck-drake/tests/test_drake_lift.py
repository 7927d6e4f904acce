"""Drake's reader: an SDF is the URDF of the same arm, what it drops is said, and a plant in memory is a description."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("pydrake", reason="Drake is not installed (python -m pip install --no-deps drake)")

from arm_texts import ARM_SDF, arm
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

import crosscheck
from crosscheck.equivalence.result import REPAIRED
from flexinv.errors import InputError

CASES = Path(__file__).parents[3] / "tests" / "data" / "cases"
PLAIN = ('<mimic joint="grip"/>', ""), (' friction="0.1"', "")
GEARED = (
    "</robot>",
    '<transmission name="t"><type>transmission_interface/SimpleTransmission</type><joint name="elbow"/><actuator name="m">'
    '<drake:rotor_inertia xmlns:drake="http://drake.mit.edu" value="0.001"/>'
    '<drake:gear_ratio xmlns:drake="http://drake.mit.edu" value="50"/></actuator></transmission></robot>',
)


def sdf(folder: Path, before: str = "", after: str = "") -> Path:
    path = folder / "arm.sdf"
    assert before in ARM_SDF
    path.write_text(ARM_SDF.replace(before, after, 1) if before else ARM_SDF)
    return path


def test_an_sdf_is_the_urdf_of_the_same_arm(tmp_path: Path) -> None:
    found = crosscheck.compare(arm(tmp_path, *PLAIN), sdf(tmp_path))
    assert found.equal
    assert found.judged.after <= REPAIRED


@pytest.mark.parametrize(
    ("before", "after", "cause", "place"),
    [
        ("<mass>2.375", "<mass>2.625", "mass", "link lower"),
        ("0.05 0 0.3 0 0.3 0.1", "0.05 0.02 0.3 0 0.3 0.1", "position of joint", "joint elbow"),
        ("<damping>0.3", "<damping>0.5", "damping", "joint shoulder"),
        ("0.01 0.02 0.153 0.1 0.2 0.3", "0.01 0.02 0.153 0 0 0", "inertia tensor", "link upper"),
    ],
)
def test_an_edit_of_the_sdf_is_named(before: str, after: str, cause: str, place: str, tmp_path: Path) -> None:
    found = crosscheck.compare(arm(tmp_path, *PLAIN), sdf(tmp_path, before, after))
    assert [(d.cause, d.place) for d in found.differences] == [(cause, place)]
    assert found.judged.after <= REPAIRED


def test_printed_digits_of_an_sdf_are_rounding(tmp_path: Path) -> None:
    """A quarter turn as 1.5708 in the pose of a link is that of 1.5707963267948966."""
    turned = arm(tmp_path, *PLAIN, ('rpy="0 0.3 0.1"', 'rpy="0 0 1.5707963267948966"'))
    found = crosscheck.compare(turned, sdf(tmp_path, "0.05 0 0.3 0 0.3 0.1", "0.05 0 0.3 0 0 1.5708"))
    assert found.equal
    assert found.judged.rounding


def test_its_reader_of_urdf_keeps_rotors_and_mimics_and_drops_dry_friction(tmp_path: Path) -> None:
    file = arm(tmp_path, (' friction="0.1"', ""), GEARED)
    assert crosscheck.compare(file, f"{file}@drake").equal
    dry = arm(tmp_path, name="dry.urdf")
    found = crosscheck.compare(dry, f"{dry}@drake")
    assert [(d.cause, d.place) for d in found.differences] == [("dry friction", "joint shoulder")]
    assert any("friction" in words for _, lines in found.dropped for words in lines)


def test_a_plant_in_memory_is_a_description(tmp_path: Path) -> None:
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(sdf(tmp_path)))
    with pytest.raises(InputError, match=r"plant\.Finalize"):
        crosscheck.compare(plant, plant)
    plant.Finalize()
    assert crosscheck.compare(arm(tmp_path, *PLAIN), plant).equal


def test_a_bad_file_is_one_clear_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="Drake refuses it"):
        crosscheck.compare(sdf(tmp_path, "<child>upper</child>", "<child>nothing</child>"), arm(tmp_path))


@pytest.mark.parametrize("name", ["c49_duo.sdf", "c49_duo_heavy.sdf"])
def test_an_sdf_with_names_in_nested_models_is_itself(name: str) -> None:
    assert crosscheck.compare(CASES / name, CASES / name).equal


def test_names_in_nested_models_are_paths_and_a_heavier_link_is_named_by_its_own() -> None:
    found = crosscheck.compare(CASES / "c49_duo.sdf", CASES / "c49_duo_heavy.sdf")
    assert [(d.cause, d.place, d.size) for d in found.differences] == [("mass", "link duo::right::rod", 2.0)]
    assert "name swing of 2 joints: called by their paths, duo::left::swing, duo::right::swing" in found.dropped[0][1]
    assert crosscheck.compare(CASES / "c49_duo_heavy.sdf", CASES / "c49_duo.xml").equal
