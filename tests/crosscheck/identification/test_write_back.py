"""A URDF is written back with what was identified, and is otherwise the user's own file, byte by byte."""

from __future__ import annotations

from pathlib import Path

import logged_arm
import numpy as np
import pytest
from click.testing import CliRunner

import crosscheck
from crosscheck.cli import Main
from crosscheck.identification.identify import Identification
from crosscheck.identification.write_back import write_urdf
from flexinv.errors import InputError
from flexinv.files.from_urdf import from_urdf
from flexinv.files.load_mechanism import load_mechanism
from flexinv.rigid.joint_torques import joint_torques

URDF = """<?xml version="1.0"?>
<!-- drawn by hand -->
<robot name="arm" xmlns:own="urn:own">
  <link name="ground"/>
  <link name="upper">
    <inertial><origin xyz="0.2 0 0" rpy="0 0 0.3"/><mass value="6"/>
      <inertia ixx="0.02" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual own:note="a > b"><geometry><sphere radius="0.1"/></geometry></visual>
  </link>
  <link name="fore"><!-- as -weighed- --><inertial><origin xyz="0.15 0.02 0"/><mass value="2.4"/>
      <inertia ixx="0.01" iyy="0.04" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="ground"/><child link="upper"/><axis xyz="0 1 0"/>
    <dynamics damping="3" friction="2" own:law="a > b"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.4 0 0"/>
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


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    base = logged_arm.write_arm(tmp_path_factory.mktemp("models") / "arm")
    (base / "arm.urdf").write_text(URDF)
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
         "--write-urdf", str(tmp_path / "same.urdf")],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
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
        "<!-- drawn by hand -->",
        "<!-- as -weighed- -->",
        'own:note="a > b"',
        'own:law="a > b"',
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
    base = logged_arm.write_arm(tmp_path / "bare")
    bare = crosscheck.identify(base, [folder / "one.csv"])
    with pytest.raises(InputError, match=r"expected a mechanism with \[urdf\]"):
        write_urdf(bare, tmp_path / "other.urdf")
