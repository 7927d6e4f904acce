"""A robot file is written back with what was identified, and is otherwise the user's own file, byte by byte."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import logged_arm
import mujoco
import numpy as np
import pytest
from click.testing import CliRunner

import crosscheck
from crosscheck.cli import Main
from crosscheck.identification.identify import Identification
from crosscheck.identification.maker_values import build_maker_tables
from crosscheck.identification.table import Row
from crosscheck.identification.write_back.mjcf import write_mjcf
from crosscheck.identification.write_back.urdf import write_urdf
from flexinv.errors import InputError
from flexinv.files.from_urdf import from_urdf
from flexinv.files.load_mechanism import load_mechanism
from flexinv.rigid.joint_torques import joint_torques

FORE = """'fore --> "x" &amp; &lt;y>'"""  # a name that is to stay a name
URDF = f"""<?xml version="1.0"?>
<!-- drawn -- by --- hand -->
<robot name="arm" xmlns:own="urn:own">
  <link name="ground"/>
  <link name="upper">
    <inertial><origin xyz="0.2 0 0" rpy="0 0 0.3"/><mass value="6"/>
      <inertia ixx="0.02" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual own:note="a > b"><geometry><sphere radius="0.1"/></geometry></visual>
  </link>
  <link name={FORE}><!-- as -weighed- --><inertial><origin xyz="0.15 0.02 0"/><mass value="2.4"/>
      <inertia ixx="0.01" iyy="0.04" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="ground"/><child link="upper"/><axis xyz="0 1 0"/>
    <dynamics damping="3" friction="2" own:law="damping='1' --- > b"/>
  </joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link={FORE}/><origin xyz="0.4 0 0"/>
    <axis xyz="0 1 0"/></joint>
</robot>
"""
FILE = 'source = "a test"\n[urdf]\npath = "arm.urdf"\n[overlay.joints.elbow]\n'
FREE = """[[free]]
parameter = "viscous friction"
place = ["elbow"]
value = 0.8
relative = 0.5
[[free]]
parameter = "coulomb friction"
place = ["elbow"]
value = 0.8
relative = 0.5
"""


# The same machine as somebody else may have drawn it: frames beside the joints, classes, shapes with masses, an actuator.
MJCF = f"""<mujoco><!-- drawn -- by --- hand -->
<compiler angle="degree"/><option gravity="0 0 -9.81"/>
<default><joint damping="0.25"/><default class='x damping="1" y'><joint armature="0.3" frictionloss="2"/></default></default>
<worldbody><body name="ground"><body name="upper" pos="0.1 0 0">
  <inertial pos="0.1 0 0" mass="6" quat="1 1 0 0" diaginertia="0.02 0.1 0.1"/>
  <joint name="shoulder" axis="0 1 0" pos="-0.1 0 0" class='x damping="1" y'/><geom size=".1" name="a > b"/>
  <frame pos="0.3 0 0"><body name={FORE}><geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" mass="2.4"/>
    <joint name="elbow" axis="0 1 0" damping="1 0.1" armature="0.06"/></body></frame>
</body></body></worldbody>
<actuator><motor joint="elbow" gear="2" armature="0.01"/></actuator>
</mujoco>
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    base = logged_arm.write_arm(tmp_path_factory.mktemp("models") / "arm")
    (base / "arm.urdf").write_text(URDF)
    (base / "arm.xml").write_text(MJCF)
    numbers = "rotor_inertia_kgm2 = 0.1\n[overlay.joints.shoulder]\nrotor_inertia_kgm2 = 0.3\n"
    (base / "mechanism.toml").write_text(FILE + numbers)
    text = (base / "identify.toml").read_text()
    for kind in ("viscous", "coulomb"):
        text = text.replace(f'"{kind} friction"\n', f'"{kind} friction"\nplace = ["shoulder"]\n')
    (base / "identify.toml").write_text(text + FREE)
    logged_arm.frame(base, 0).to_csv(base / "one.csv", index=False)
    return base


@pytest.fixture(scope="module")
def found(folder: Path) -> Identification:
    return crosscheck.identify(folder, [folder / "one.csv"])


def test_the_file_has_the_torques_that_were_identified(folder: Path, found: Identification, tmp_path: Path) -> None:
    """Those of identified.toml less the rotors, which a URDF does not have, to the rounding of sums in another order."""
    left = write_urdf(found, tmp_path / "new.urdf")
    done = CliRunner().invoke(
        Main(),
        ["identify", "arm", "--models", str(folder.parent), "--log", "one.csv", "--out", str(tmp_path / "out"),
         "--write-urdf", str(tmp_path / "same.urdf"), "--write-mjcf", str(folder / "arm.xml"), str(tmp_path / "same.xml")],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert re.search(r"same\.xml \S+identified\.toml: .*efforts of the mechanisms agree to", done.output)
    assert (
        "engines' own features different" in done.output
    )  # of higher order, which the file had and the mechanism cannot say
    summary = (tmp_path / "out" / "summary.md").read_text()
    assert re.findall("## Against the maker's values: (.*)", summary) == ["arm.urdf", "arm.xml"]
    assert (tmp_path / "same.urdf").read_bytes() == (tmp_path / "new.urdf").read_bytes()
    loaded = load_mechanism(tmp_path / "out" / "identified.toml")
    own = from_urdf(tmp_path / "new.urdf")
    random = np.random.default_rng(1)
    q, qd, qdd = random.uniform(-1.0, 1.0, (3, 20, 2))
    expected = joint_torques(loaded, q, qd, qdd) - qdd * [0.3, 0.1]
    assert np.allclose(joint_torques(own, q, qd, qdd), expected, atol=1e-12 * np.abs(expected).max())
    assert {words.split(" of ")[0] for words in left} == {"effort offset"}


def test_all_else_stays_byte_by_byte(found: Identification, tmp_path: Path) -> None:
    write_urdf(found, tmp_path / "new.urdf")
    text = (tmp_path / "new.urdf").read_text()
    kept = (
        "<!-- drawn -- by --- hand -->",
        "<!-- as -weighed- -->",
        'own:note="a > b"',
        """own:law="damping='1' --- > b\"""",
        '<link name="ground"/>',
    )
    assert [part for part in kept if part not in text] == []
    for part in ("mass value=6", "damping=3 friction=2"):
        assert part in text  # what stood there before, as a comment
    lines = URDF.splitlines()
    same = [line for line in lines if line in text.splitlines()]
    changed = {line for line in lines if "inert" in line or "dynamics" in line}
    assert set(lines) - set(same) == changed | {'    <axis xyz="0 1 0"/></joint>'}


def test_no_file_is_written_over_and_no_urdf_is_invented(folder: Path, found: Identification, tmp_path: Path) -> None:
    (tmp_path / "new.urdf").write_text("mine")
    with pytest.raises(InputError, match="there is such a file, and none is written over"):
        write_urdf(found, tmp_path / "new.urdf")
    assert (tmp_path / "new.urdf").read_text() == "mine"
    bare = replace(found.machine, mechanism=replace(found.machine.mechanism, urdf=None))
    with pytest.raises(InputError, match=r"expected a mechanism with \[urdf\]"):
        write_urdf(replace(found, machine=bare), tmp_path / "other.urdf")


# ------------------------------------------------------------------------------------------------------------------ MJCF


def test_files_of_the_robot_are_asked_for_before_anything_is_fitted(folder: Path, tmp_path: Path) -> None:
    """A misspelt name costs no fit: nothing that a fit leaves is there."""
    (tmp_path / "there.xml").write_text("mine")
    words = ["identify", "arm", "--models", str(folder.parent), "--log", "one.csv", "--out", str(tmp_path / "out")]
    for more, said in (
        (["--write-mjcf", str(tmp_path / "none.xml"), str(tmp_path / "new.xml")], "expected: an MJCF"),
        (["--write-mjcf", str(tmp_path / "there.xml"), str(tmp_path / "there.xml")], "none is written over"),
        (["--write-urdf", str(tmp_path / "there.xml")], "none is written over"),
    ):
        done = CliRunner().invoke(Main(), [*words, *more])
        assert done.exit_code != 0
        assert said in done.output
        assert not (tmp_path / "out" / "parameters.csv").exists()


def test_mujoco_computes_from_the_file_what_was_identified(folder: Path, found: Identification, tmp_path: Path) -> None:
    """Inverse dynamics of MuJoCo are those of the URDF that was written, less rotors and damping of higher order, to rounding."""
    left = write_mjcf(found, folder / "arm.xml", tmp_path / "new.xml")
    write_urdf(found, tmp_path / "new.urdf")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "new.xml"))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS | mujoco.mjtDisableBit.mjDSBL_CONTACT
    model.dof_dampingpoly[:] = 0.0
    data = mujoco.MjData(model)
    own = from_urdf(tmp_path / "new.urdf")
    for q, qd, qdd in np.random.default_rng(2).uniform(-1.0, 1.0, (5, 3, 2)):
        data.qpos, data.qvel, data.qacc = q, qd, qdd
        mujoco.mj_inverse(model, data)
        dry = np.sign(qd) * [joint.friction for joint in own.joints if joint.nv]
        expected = joint_torques(own, q, qd, qdd) - dry + qdd * [0.3, 0.1]
        assert np.allclose(data.qfrc_inverse, expected, atol=1e-12 * np.abs(expected).max())
    assert {words.split(" of ")[0] for words in left} == {"effort offset"}


def test_what_was_not_identified_stays_in_an_mjcf(folder: Path, found: Identification, tmp_path: Path) -> None:
    """Without the new inertials and attributes, and the comments before them, the text is the old one."""
    write_mjcf(found, folder / "arm.xml", tmp_path / "new.xml")
    text = (tmp_path / "new.xml").read_text()
    assert "before: inertial pos=0.1 0 0 mass=6 quat=1 1 0 0 diaginertia=0.02 0.1 0.1" in text
    assert "before: damping=0.25, not stated here; frictionloss=2.0, not stated here" in text
    assert "before: of its shapes, mass=2.4 pos=0.15" in text
    assert re.search(r'damping="\S+ 0.1" armature="0.06"', text)
    plain = re.sub(r"<!-- before.*?-->", "", text)
    plain = re.sub(r'<inertial [^>]*fullinertia[^>]*/>|frictionloss="[^"]{9,}" ', "", plain)
    plain = re.sub(r'<joint damping="\S+" ', "<joint ", plain)
    plain = re.sub(r'damping="\S+ 0.1"', 'damping="1 0.1"', plain)
    assert plain == MJCF.replace('<inertial pos="0.1 0 0" mass="6" quat="1 1 0 0" diaginertia="0.02 0.1 0.1"/>', "")


def test_armature_is_written_without_what_actuators_add(folder: Path, found: Identification, tmp_path: Path) -> None:
    rotor = Row("rotor inertia", "elbow", "kg m^2", 0.15, 0.1, 0.2, 0.1, 0.0, 1.0, True, 0.0, 0.15)
    write_mjcf(replace(found, parameters=[*found.parameters, rotor]), folder / "arm.xml", tmp_path / "new.xml")
    assert f'armature="{0.15 - 2**2 * 0.01!r}"' in (tmp_path / "new.xml").read_text()
    small = replace(found, parameters=[*found.parameters, replace(rotor, value=0.01)])
    with pytest.raises(InputError, match=r"actuators give joint elbow armature 0\.04, more than the 0\.01"):
        write_mjcf(small, folder / "arm.xml", tmp_path / "other.xml")
    assert not (tmp_path / "other.xml").exists()


def test_links_that_move_as_one_are_one_body(found: Identification, tmp_path: Path) -> None:
    """A body of another name has the mass of all links that move with its joint, whose name may be another one, too."""
    text = MJCF.replace(f"<body name={FORE}>", '<body name="arm">')
    (tmp_path / "old.xml").write_text(text)
    write_mjcf(found, tmp_path / "old.xml", tmp_path / "new.xml")
    mass = mujoco.MjModel.from_xml_path(str(tmp_path / "new.xml")).body("arm").mass[0]
    assert mass == next(row.value for row in found.parameters if row.parameter == "mass" and "fore" in row.place)


REFUSED = {
    "masses of shapes only": ('angle="degree"', 'inertiafromgeom="true"', "link upper is read back as"),
    "masses bounded": ('angle="degree"', 'boundmass="4"', "link fore .* is read back as"),
    "dampers disabled": ("<default>", '<option><flag damper="disable"/></option><default>', "damping of joint"),
    "another machine": ('<frame pos="0.3', '<frame pos="0.4', "the effort of .* is off by .* crosscheck compare says"),
    "another axis": ('elbow" axis="0 1 0"', 'elbow" axis="1 0 0"', "the effort of .* is off by"),
    "another joint": (
        "</body></frame>",
        '<body><joint name="wrist"/><geom size=".1"/></body></body></frame>',
        "the file lacks none, and has beside them 'wrist'",
    ),
    "another kind": ('name="elbow"', 'name="elbow" type="slide"', "joint elbow is prismatic, expected revolute"),
    "other rotors": ('armature="0.06"', 'armature="0.07"', "armature of joint elbow is .*0.11.*, expected 0.1"),
    "bodies of a copy": (
        "</worldbody>",
        '<replicate count="2"><body name="b"/></replicate></worldbody>',
        "<replicate>",
    ),
    "two bodies": (
        "</body></frame>",
        '<body name="tip"><geom size=".1"/></body></body></frame>',
        "nobody knows to which",
    ),
    "a URDF": (MJCF, URDF, "it begins with <robot>, expected an MJCF"),
    "entities": ("<mujoco>", '<!DOCTYPE x [<!ENTITY a "b">]><mujoco>', "entities written out"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_a_file_that_would_not_be_what_was_identified_is_not_written(
    what: str, found: Identification, tmp_path: Path
) -> None:
    old, new, words = REFUSED[what]
    assert old in MJCF
    (tmp_path / "old.xml").write_text(MJCF.replace(old, new))
    with pytest.raises(InputError, match=words):
        write_mjcf(found, tmp_path / "old.xml", tmp_path / "new.xml")
    assert not (tmp_path / "new.xml").exists()


def test_includes_hold_all_but_what_is_edited(folder: Path, found: Identification, tmp_path: Path) -> None:
    """Assets may be included; a file that names others is written beside them, and an included body is edited in its own file."""
    (tmp_path / "more.xml").write_text('<mujoco><asset><material name="m"/></asset></mujoco>')
    text = MJCF.replace("<default>", '<include file="more.xml"/><default>', 1)
    (tmp_path / "old.xml").write_text(text)
    write_mjcf(found, tmp_path / "old.xml", tmp_path / "new.xml")
    with pytest.raises(InputError, match="MuJoCo refuses it"):
        write_mjcf(found, tmp_path / "old.xml", tmp_path / "else" / "new.xml")
    (tmp_path / "more.xml").write_text(
        '<mujoco><worldbody><body name="b"><geom size=".1"/></body></worldbody></mujoco>'
    )
    with pytest.raises(InputError, match="<include>"):
        write_mjcf(found, tmp_path / "old.xml", tmp_path / "other.xml")
    (tmp_path / "new.xml").write_text("mine")
    with pytest.raises(InputError, match="none is written over"):
        write_mjcf(found, tmp_path / "old.xml", tmp_path / "new.xml")
    assert (tmp_path / "new.xml").read_text() == "mine"


def test_another_gravity_of_the_file_is_said(folder: Path, found: Identification, tmp_path: Path) -> None:
    (tmp_path / "old.xml").write_text(MJCF.replace("-9.81", "-9.80665"))
    left = write_mjcf(found, tmp_path / "old.xml", tmp_path / "new.xml")
    assert left[-1].startswith("gravity: the file keeps 0.0 0.0 -9.80665 m/s^2, masses were identified with")


def test_values_of_the_maker_stand_beside_what_was_found(folder: Path, found: Identification) -> None:
    """What each file says, in the frames of the mechanism: the body's frame is 0.1 m in front of the joint, the link's at it."""
    tables = build_maker_tables(found, folder / "arm.xml")
    said = [{(row["parameter"], row["place"]): row for row in table["rows"]} for table in tables]
    assert [table["mass", "upper"]["maker"] for table in said] == ["6", "6"]
    assert [table["com x", "upper"]["maker"] for table in said] == ["0.2", "0.2"]
    assert [table["viscous friction", "shoulder"]["maker"] for table in said] == ["3", "0.25"]
    assert [table["viscous friction", "shoulder"]["inside"] for table in said] == ["no", "no"]  # 4 was found
    assert [table["coulomb friction", "shoulder"]["inside"] for table in said] == ["yes", "yes"]
    for table in said:
        told = [row["told"] for row in table.values()]
        assert told == sorted(told, reverse=True)  # "yes" comes first
        assert set(table) == {
            (row.parameter, row.place) for row in found.parameters if row.parameter != "effort offset"
        }
