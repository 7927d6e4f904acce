"""Robots from files of any format: by what stands in them, by readers of installed packages, or in words what to install."""

from __future__ import annotations

import tomllib
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

import flexinv
from flexinv.errors import InputError, ModelWarning
from flexinv.files import robot_file
from flexinv.files.robot_file import READER_GROUP, read_robot_file
from flexinv.model.mechanism import Mechanism

MJCF = """<mujoco model="arm">
  <option gravity="0 0 -9.81"/>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" type="hinge" axis="0 1 0" damping="0.3" frictionloss="0.2"/>
      <inertial pos="0.2 0 0" mass="2" diaginertia="0.01 0.02 0.02"/>
      <body name="fore" pos="0.4 0 0">
        <joint name="elbow" type="hinge" axis="0 1 0"/>
        <inertial pos="0.1 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def readers(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The readers that pyproject.toml states, whatever was installed when."""
    stated = tomllib.loads((root / "pyproject.toml").read_text())["project"]["entry-points"][READER_GROUP]
    points = [metadata.EntryPoint(name, value, READER_GROUP) for name, value in stated.items()]

    installed = metadata.entry_points

    def chosen(group: str, **given: str) -> object:
        if group != READER_GROUP:
            return installed(group=group, **given)
        return [one for one in points if one.name == given["name"]]

    monkeypatch.setattr(robot_file.metadata, "entry_points", chosen)


def test_a_urdf_and_a_mechanism_are_read_by_flexinv_itself(root: Path) -> None:
    urdf = root / "campaigns" / "data" / "two_links.urdf"
    assert read_robot_file(urdf) == flexinv.from_urdf(urdf)
    folder = root / "models" / "rigid_3r"
    assert read_robot_file(folder) == read_robot_file(folder / "mechanism.toml") == flexinv.load_mechanism(folder)


@pytest.mark.usefixtures("readers")
def test_efforts_of_an_mjcf_are_those_of_mujoco(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    file = tmp_path / "arm.xml"
    file.write_text(MJCF)
    model = mujoco.MjModel.from_xml_string(MJCF)
    data = mujoco.MjData(model)
    random = np.random.default_rng(3)
    states = random.uniform(-1.0, 1.0, (3, 20, 2))
    tau = flexinv.joint_torques(read_robot_file(file), *states, passive=False)
    expected = []
    for q, qd, qdd in zip(*states, strict=True):
        data.qpos[:] = q
        data.qvel[:] = qd
        data.qacc[:] = qdd
        mujoco.mj_inverse(model, data)
        expected.append(data.qfrc_inverse + data.qfrc_passive + data.qfrc_constraint)
    np.testing.assert_allclose(tau, expected, atol=1e-12)  # of some 10 N m


@pytest.mark.usefixtures("readers")
def test_what_a_mechanism_cannot_say_is_warned_of(tmp_path: Path) -> None:
    file = tmp_path / "arm.xml"
    file.write_text(MJCF.replace('<body name="fore"', '<body name="fore" gravcomp="0.5"'))
    with pytest.warns(ModelWarning, match=r"gravcomp of link fore .*: efforts feel it, and no mechanism can say it"):
        read_robot_file(file)


@pytest.mark.parametrize(
    ("name", "text", "install"),
    [
        ("arm.sdf", '<sdf version="1.7"/>', "crosscheck-drake"),
        ("arm.xml", MJCF, r"flexinv\[engines\]"),
        ("arm.usda", "#usda 1.0", r"flexinv\[usd\]"),
    ],
)
def test_without_a_reader_the_error_says_what_to_install(
    name: str, text: str, install: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robot_file.metadata, "entry_points", lambda group, name: [])
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=f"no reader of it is installed\n.*\n.*{install}"):
        read_robot_file(tmp_path / name)


def test_a_reader_of_another_package_is_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, root: Path) -> None:
    robot = flexinv.load_mechanism(root / "models" / "rigid_3r")

    class Point:
        value = "theirs"

        def load(self) -> object:
            return lambda path: (robot, (f"{path.name}: it has a colour",))

    monkeypatch.setattr(robot_file.metadata, "entry_points", lambda group, name: [Point()] if name == "sdf" else [])
    (tmp_path / "arm.sdf").write_text("<sdf/>")
    with pytest.warns(ModelWarning, match="it has a colour"):
        found: Mechanism = read_robot_file(tmp_path / "arm.sdf")
    assert found is robot
