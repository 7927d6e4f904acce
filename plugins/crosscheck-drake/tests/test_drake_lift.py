"""Drake's reader: an SDF is the URDF of the same arm, what it drops is said, and a plant in memory is a description."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("pydrake", reason="Drake is not installed (python -m pip install --no-deps drake)")

from arm_texts import ARM_SDF, arm
from case_files import BY_DRAKE, Case, complaints
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

import crosscheck
from crosscheck.equivalence.proof import LOST, PROVEN, prove
from crosscheck.equivalence.result import REPAIRED
from crosscheck.equivalence.sources import describe
from crosscheck.lifting.sdf import features_of, read_stated
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
    comparison = crosscheck.compare(arm(tmp_path, *PLAIN), sdf(tmp_path))
    assert comparison.equal
    assert comparison.judged.after <= REPAIRED


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
    comparison = crosscheck.compare(arm(tmp_path, *PLAIN), sdf(tmp_path, before, after))
    assert [(d.cause, d.place) for d in comparison.differences] == [(cause, place)]
    assert comparison.judged.after <= REPAIRED


def test_printed_digits_of_an_sdf_are_rounding(tmp_path: Path) -> None:
    """A quarter turn as 1.5708 in the pose of a link is that of 1.5707963267948966."""
    turned = arm(tmp_path, *PLAIN, ('rpy="0 0.3 0.1"', 'rpy="0 0 1.5707963267948966"'))
    comparison = crosscheck.compare(turned, sdf(tmp_path, "0.05 0 0.3 0 0.3 0.1", "0.05 0 0.3 0 0 1.5708"))
    assert comparison.equal
    assert comparison.judged.rounding


def test_its_reader_of_urdf_keeps_rotors_and_mimics_and_drops_dry_friction(tmp_path: Path) -> None:
    file = arm(tmp_path, (' friction="0.1"', ""), GEARED)
    assert crosscheck.compare(file, f"{file}@drake").equal
    dry = arm(tmp_path, name="dry.urdf")
    comparison = crosscheck.compare(dry, f"{dry}@drake")
    assert [(d.cause, d.place) for d in comparison.differences] == [("dry friction", "joint shoulder")]
    assert any("friction" in words for _, lines in comparison.dropped for words in lines)


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
    comparison = crosscheck.compare(CASES / "c49_duo.sdf", CASES / "c49_duo_heavy.sdf")
    assert [(d.cause, d.place, d.size) for d in comparison.differences] == [("mass", "link duo::right::rod", 2.0)]
    assert (
        "name swing of 2 joints: called by their paths, duo::left::swing, duo::right::swing" in comparison.dropped[0][1]
    )
    assert crosscheck.compare(CASES / "c49_duo_heavy.sdf", CASES / "c49_duo.xml").equal


def test_a_spring_of_an_sdf_is_read_from_the_plant(tmp_path: Path) -> None:
    joint = describe(CASES / "c15_plain.sdf").mechanism.joint_of["luff"]
    assert (joint.stiffness, joint.rest, joint.friction) == pytest.approx((3.0, 0.1, 0.2), rel=1e-12)  # rounding
    comparison = crosscheck.compare(CASES / "c15_plain.sdf", CASES / "c15_nospring.sdf")
    assert [(d.cause, d.place) for d in comparison.differences] == [("spring stiffness", "joint luff")]


def test_added_mass_that_no_reader_honours_is_named() -> None:
    comparison = crosscheck.compare(CASES / "c15_added.sdf", CASES / "c15_nospring.sdf")
    assert {(d.cause, d.place) for d in comparison.differences} == {
        ("added-mass that only A has", "link boom"),
        ("dry friction", "joint luff"),
    }


def test_a_mimic_of_an_sdf_is_its_coupling(tmp_path: Path) -> None:
    law = '<mimic joint="grip"><multiplier>1</multiplier><offset>0.01</offset><reference>0.01</reference></mimic>'
    follower = ARM_SDF.index('"grip_mirror"')
    at = ARM_SDF.index("<xyz>", follower)
    (tmp_path / "arm.sdf").write_text((ARM_SDF[:at] + law + ARM_SDF[at:]).replace('version="1.9"', 'version="1.11"'))
    assert crosscheck.compare(arm(tmp_path, (' friction="0.1"', "")), tmp_path / "arm.sdf").equal


def test_gravity_of_a_world_is_the_file_s(tmp_path: Path) -> None:
    text = ARM_SDF.replace("<model", '<world name="w"><gravity>0 0 -1.62</gravity><model', 1)
    (tmp_path / "moon.sdf").write_text(text.replace("</model>", "</model></world>"))
    found = describe(tmp_path / "moon.sdf")
    assert found.mechanism.gravity.tolist() == [0.0, 0.0, -1.62]
    assert found.gravity_stated
    assert prove(found).state == PROVEN


def test_what_an_included_file_says_is_read_too(tmp_path: Path) -> None:
    (tmp_path / "crane.sdf").write_text((CASES / "c15_plain.sdf").read_text())
    outer = '<sdf version="1.9"><model name="yard"><include><uri>{}</uri><name>left</name></include></model></sdf>'
    (tmp_path / "yard.sdf").write_text(outer.format("crane.sdf"))
    stated = read_stated(tmp_path / "yard.sdf")
    assert stated.friction == {"yard::left::luff": (0.2,)}
    (tmp_path / "yard.sdf").write_text(outer.format("model://crane"))
    assert [one.name for one in features_of(read_stated(tmp_path / "yard.sdf"), {})] == ["include"]


@pytest.mark.parametrize(
    "name", ["c16_floating.urdf@drake", "c16_floating.xml@drake", "c16_floating.urdf", "c16_floating.xml"]
)
def test_a_floating_joint_floats_whoever_reads_it(name: str) -> None:
    comparison = crosscheck.compare(CASES / name, CASES / "c16_floating.xml")
    assert comparison.equal
    assert {proof.state for _, proof in comparison.proofs} == {PROVEN}


KINDS = {  # a body on a joint of each kind, on a link that turns
    "prismatic": '<joint name="j" type="prismatic"><parent>a</parent><child>b</child><axis><xyz>1 0 1</xyz></axis></joint>',
    "screw": '<joint name="j" type="screw"><parent>a</parent><child>b</child><screw_thread_pitch>0.2</screw_thread_pitch>'
    "<axis><xyz>0 1 0</xyz></axis></joint>",
    "universal": '<joint name="j" type="universal"><parent>a</parent><child>b</child><axis><xyz>1 0 0</xyz></axis>'
    "<axis2><xyz>0 1 0</xyz></axis2></joint>",
    "ball": '<joint name="j" type="ball"><parent>a</parent><child>b</child></joint>',
    "from the child": '<joint name="j" type="revolute"><parent>b</parent><child>a</child><axis><xyz>0 1 0</xyz></axis></joint>',
}
LINK = (
    '<link name="{}"><pose>{} 0.2 0.1 0.3 0.2 0.1</pose><inertial><pose>0.1 0.02 0.03 0.1 0.2 0.3</pose><mass>2</mass><inertia>'
    "<ixx>0.02</ixx><iyy>0.03</iyy><izz>0.04</izz><ixy>0.001</ixy></inertia></inertial></link>"
)


@pytest.mark.parametrize("kind", KINDS)
def test_the_mechanism_of_a_plant_has_its_efforts_joint_by_joint(kind: str, tmp_path: Path) -> None:
    text = '<sdf version="1.9"><model name="m">' + LINK.format("a", 0.1) + LINK.format("b", 0.4)
    text += '<joint name="hinge" type="revolute"><parent>world</parent><child>a</child><axis><xyz>0 0.6 0.8</xyz></axis></joint>'
    (tmp_path / "m.sdf").write_text(text + KINDS[kind] + "</model></sdf>")
    found = prove(describe(tmp_path / "m.sdf"))
    assert found.state == PROVEN, found.words


def test_a_mechanism_that_is_not_the_plant_s_is_not_reproduced(tmp_path: Path) -> None:
    """The check can fail: 1 g more in the mechanism than in the plant."""
    found = describe(sdf(tmp_path))
    link = found.mechanism.link_of["lower"]
    body = link.bodies[0]
    heavy = replace(body, inertia=replace(body.inertia, mass=body.inertia.mass + 1e-3))
    links = [replace(link, bodies=(heavy,)) if one is link else one for one in found.mechanism.links]
    assert prove(replace(found, mechanism=replace(found.mechanism, links=tuple(links)))).state == LOST


@pytest.mark.parametrize("one", BY_DRAKE, ids=lambda one: one.name)
def test_a_case_file_is_right(one: Case) -> None:
    assert complaints(one) == []
