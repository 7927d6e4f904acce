"""Mechanism files that start from a URDF: overlays keep the robot's geometry, paths stay where they belong."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError
from pathlib import Path

import numpy as np
import pytest

import flexinv.files.from_urdf as urdf_files
from flexinv.errors import InputError, ModelWarning
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Mechanism, Placement


def load(tmp_path: Path, text: str) -> Mechanism:
    file = tmp_path / "models" / "arm" / "mechanism.toml"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text, encoding="utf-8")
    return load_mechanism(file.parent)


UR5 = 'source = "test"\n[urdf]\npackage = "example-robot-data"\npath = "ur_description/urdf/ur5_robot.urdf"\n'
TUBE = '[sections.tube]\nshape = "tube"\nouter_diameter_m = 0.05\nwall_m = 0.003\nE_Pa = 70e9\nnu = 0.33\nrho_kg_per_m3 = 2700\n'
OVERLAY = (
    '[overlay.links.forearm_link.beam]\nsection = "tube"\nto_joint = "wrist_1_joint"\ny_axis = [1, 1, 1]\n'
    'own_inertia = "at_root"\nroot_xyz_m = [0.01, -0.02, 0.05]\n'
)


def frames(mechanism: Mechanism) -> dict[str, Placement]:
    """Frames of the links in the world with every joint at zero and every (straight) beam undeformed."""
    result = {"world": Placement()}
    for joint in mechanism.joints:
        at = result[joint.parent]
        beam = None if joint.station is None else mechanism.link_of[joint.parent].beam
        if beam is not None and joint.station is not None:
            at = after(at, beam.placement)
            at = after(at, Placement(np.array([joint.station * beam.length, 0, 0]), np.eye(3)))
        result[joint.child] = after(at, joint.placement)
    return result


def after(a: Placement, b: Placement) -> Placement:
    return Placement(a.position + a.rotation @ b.position, a.rotation @ b.rotation)


def test_a_beam_laid_over_a_robot_keeps_its_geometry(tmp_path: Path) -> None:
    rigid, flexible = frames(load(tmp_path, UR5)), frames(load(tmp_path, UR5 + TUBE + OVERLAY))
    for name, frame in rigid.items():
        # some ten products of rotations with entries rounded to 1e-16
        assert np.abs(frame.position - flexible[name].position).max() < 1e-14
        assert np.abs(frame.rotation - flexible[name].rotation).max() < 1e-14


def test_a_beam_laid_over_a_robot_keeps_its_own_inertia_at_the_root(tmp_path: Path) -> None:
    link = load(tmp_path, UR5 + TUBE + OVERLAY).link_of["forearm_link"]
    old = load(tmp_path, UR5).link_of["forearm_link"].bodies[0].inertia
    assert link.beam is not None
    root, (body,) = link.beam.placement, link.bodies
    assert body.station == 0
    assert np.abs(root.position + root.rotation @ body.inertia.com - old.com).max() < 1e-15  # rounding below 1 m
    assert np.abs(root.rotation @ body.inertia.tensor @ root.rotation.T - old.tensor).max() < 1e-16  # below 0.1 kg m^2
    assert np.abs(root.rotation @ root.rotation.T - np.eye(3)).max() < 1e-15
    assert np.linalg.det(root.rotation) > 0
    assert root.rotation[:, 1] @ np.array([1, 1, 1]) > 0


def test_other_joints_hang_on_the_nearest_cross_section(tmp_path: Path) -> None:
    """UR5's base carries only the shoulder; of the wrist's two joints one is the end, the other finds its station."""
    text = (
        UR5
        + TUBE
        + OVERLAY.replace("forearm_link", "wrist_3_link").replace("wrist_1_joint", "wrist_3_link-tool0_fixed_joint")
    )
    mechanism = load(tmp_path, text)
    stations = {j.name: j.station for j in mechanism.joints if j.parent == "wrist_3_link"}
    assert stations["wrist_3_link-tool0_fixed_joint"] == 1
    assert all(station is not None and 0 <= station <= 1 for station in stations.values())
    rigid, flexible = frames(load(tmp_path, UR5)), frames(mechanism)
    for name in ("ee_link", "tool0"):
        assert np.abs(rigid[name].position - flexible[name].position).max() < 1e-14


def test_own_inertia_replaced_is_told(tmp_path: Path) -> None:
    mechanism = load(tmp_path, UR5 + TUBE + OVERLAY.replace("at_root", "replaced"))
    assert mechanism.link_of["forearm_link"].bodies == ()
    assert "its URDF inertia (2.275 kg) is replaced" in mechanism.notes[-1]


def test_drive_payload_and_tip_laid_over_a_robot(tmp_path: Path) -> None:
    text = (
        UR5 + "[overlay.joints.elbow_joint]\nrotor_inertia_kgm2 = 0.3\nfriction_Nm = 2\n"
        "[overlay.links.wrist_3_link]\ntip_m = [0, 0.1, 0]\n"
        '[[overlay.links.wrist_3_link.payload]]\nname = "ball"\nmass_kg = 2\ncom_m = [0, 0.1, 0]\nsphere = { radius_m = 0.1 }\n'
    )
    mechanism, plain = load(tmp_path, text), load(tmp_path, UR5)
    elbow, before = mechanism.joint_of["elbow_joint"], plain.joint_of["elbow_joint"]
    assert (elbow.rotor_inertia, elbow.friction, elbow.damping) == (0.3, 2, before.damping)
    assert elbow.limits == before.limits
    assert [body.name for body in mechanism.link_of["wrist_3_link"].bodies] == ["wrist_3_link", "ball"]
    assert np.array_equal(mechanism.link_of["wrist_3_link"].tip, [0, 0.1, 0])


PANDA = UR5.replace("ur_description/urdf/ur5_robot.urdf", "panda_description/urdf/panda.urdf")


def test_mimic_joints_warn_unless_they_are_meant(tmp_path: Path) -> None:
    with pytest.warns(ModelWarning, match=r'panda_finger_joint2 .*write mimic = "independent"'):
        load(tmp_path, PANDA)
    assert load(tmp_path, PANDA + 'mimic = "independent"\n').nv == 9
    assert load(tmp_path, PANDA + 'lock = ["panda_finger_joint2"]\n').nv == 8


def test_urdf_beside_the_mechanism(tmp_path: Path) -> None:
    folder = tmp_path / "models" / "arm"
    folder.mkdir(parents=True)
    body = '<link name="a"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>'
    (folder / "arm.urdf").write_text(f'<robot name="r">{body}</robot>')
    mechanism = load(tmp_path, 'source = "test"\n[urdf]\npath = "arm.urdf"\nbase = "free"\n')
    assert mechanism.urdf == folder / "arm.urdf"
    assert mechanism.nv == 6
    assert mechanism.name == "arm"
    (folder / "sly.urdf").symlink_to(tmp_path / "outside.urdf")
    (tmp_path / "outside.urdf").write_text(f'<robot name="r">{body}</robot>')
    for path in ("../../outside.urdf", str(tmp_path / "outside.urdf"), "sly.urdf"):
        with pytest.raises(
            InputError, match=r"\[urdf\], key path\n(.|\n)*stays inside the models folder\n.*write: +path"
        ):
            load(tmp_path, f'source = "test"\n[urdf]\npath = "{path}"\n')


BAD = {
    "no such robot": (UR5.replace("ur5_robot", "ur5_robto"), "[urdf], key path", 'path = "ur_description/urdf/ur5_robot.urdf"'),
    "out of the package": (UR5.replace("ur_description", "../../ur_description"), "[urdf], key path", "stays inside the package"),
    "unknown base": (UR5 + 'base = "floating"\n', "[urdf], key base", 'base = "fixed"'),
    "unknown package": (UR5.replace("example-robot-data", "example-robots"), "[urdf], key package", '"example-robot-data"'),
    "links beside it": (UR5 + '[links.a]\nkind = "rigid"\n', "[links]", "[overlay.links.NAME]"),
    "unknown link": (UR5 + "[overlay.links.forarm_link]\n", "[overlay.links.forarm_link]", "[overlay.links.forearm_link]"),
    "unknown joint": (UR5 + "[overlay.joints.elbow]\n", "[overlay.joints.elbow]", "[overlay.joints.elbow_joint]"),
    "fixed joint": (UR5 + "[overlay.joints.ee_fixed_joint]\n", "[overlay.joints.ee_fixed_joint]", "is fixed"),
    "unit": (UR5 + "[overlay.joints.elbow_joint]\nfriction_N = 1\n", "key friction_N", "friction_Nm = 0.5"),
    "beam to nowhere": (UR5 + TUBE + OVERLAY.replace("wrist_1", "wrist_2"), "key to_joint", 'to_joint = "wrist_1_joint"'),
    "beam of no length": (
        UR5 + TUBE + OVERLAY.replace("[0.01, -0.02, 0.05]", "[0, 0, 0.39225]"), "key root_xyz_m", "a length > 0 [m]",
    ),
    "y along the beam": (
        UR5 + TUBE + OVERLAY.replace("root_xyz_m = [0.01, -0.02, 0.05]", "").replace("[1, 1, 1]", "[0, 0, 1]"),
        "key y_axis", "y_axis = [1.0, 0.0, 0.0]",
    ),
    "tip of a beam": (
        UR5 + TUBE + OVERLAY + "[overlay.links.forearm_link]\ntip_m = [0, 0, 1]\n", "key tip_m", "a beam reports its end",
    ),
    "own inertia not said": (UR5 + TUBE + OVERLAY.replace('own_inertia = "at_root"\n', ""), "key own_inertia", '"replaced"'),
    "locked joint that is none": (UR5 + 'lock = ["elbow"]\n', 'lock of joint "elbow"', '"elbow_joint"'),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD.values(), ids=BAD.keys())
def test_bad_overlay_is_explained(tmp_path: Path, case: tuple[str, str, str]) -> None:
    text, place, advice = case
    with pytest.raises(InputError) as caught:
        load(tmp_path, text)
    assert place in str(caught.value)
    assert advice in str(caught.value)


def test_missing_package_of_robots_is_explained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise PackageNotFoundError(name)

    monkeypatch.setattr(urdf_files, "distribution", missing)
    with pytest.raises(InputError, match=r"example-robot-data\n.*not installed\n.*\n.*pip install 'flexinv\[robots\]'"):
        load(tmp_path, UR5)
