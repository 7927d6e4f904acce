"""Mechanisms that the tests of the rigid engines share: trees of every joint kind, a double pendulum, a small URDF."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from flexinv.files.from_urdf import from_urdf
from flexinv.files.load_cases import Case
from flexinv.model.links import REPLACED
from flexinv.model.mechanism import WORLD, Body, Inertia, Joint, Link, Mechanism, Placement
from flexinv.model.motion import Motion
from flexinv.typing import Array

# link, kind of its joint, parent: two branches, a fixed joint in the middle, a moving base in a turned place
TREE = (
    ("base", "free", WORLD),
    ("shoulder", "revolute", "base"),
    ("wrist", "universal", "shoulder"),
    ("slider", "prismatic", "wrist"),
    ("flange", "fixed", "shoulder"),
    ("hip", "spherical", "flange"),
    ("wheel", "continuous", "base"),
)
KINDS = ("revolute", "continuous", "prismatic", "spherical", "universal", "helical", "free")


def unit(random: np.random.Generator) -> Array:
    axis = random.normal(size=3)
    return axis / np.linalg.norm(axis)


def placement(random: np.random.Generator) -> Placement:
    return Placement(random.normal(size=3), Rotation.random(random_state=random).as_matrix())


def inertia(random: np.random.Generator) -> Inertia:
    """Three point masses somewhere: a tensor that a body can have."""
    arms = random.normal(size=(3, 3)) * 0.2
    tensor = sum((a @ a * np.eye(3) - np.outer(a, a) for a in arms), np.zeros((3, 3)))
    return Inertia(random.uniform(0.5, 2.0), random.normal(size=3) * 0.3, tensor)


def joint(kind: str, parent: str, child: str, random: np.random.Generator) -> Joint:
    drive = 0.0 if kind == "free" else 1.0  # the drives of a free joint are the business of tests of their own
    return Joint(
        f"{child}_joint",
        kind,
        parent,
        child,
        placement(random),
        axis=unit(random),
        second_axis=unit(random),
        rotor_inertia=0.3 * drive,
        damping=0.7,
        friction=0.4 * drive,
        pitch=-2.5 if kind == "helical" else 0.0,
    )


def tree(kinds: tuple[tuple[str, str, str], ...] = TREE, seed: int = 3) -> Mechanism:
    random = np.random.default_rng(seed)
    links = tuple(
        Link(name, (Body("own", inertia(random)), Body("payload", inertia(random))), tip=random.normal(size=3))
        for name, _, _ in kinds
    )
    joints = tuple(joint(kind, parent, name, random) for name, kind, parent in kinds)
    return Mechanism("tree", links, joints, gravity=np.array([1.0, 2.0, -9.0]))


def chain(kind: str) -> Mechanism:
    """A revolute joint that turns the base of a joint of one kind; a free joint hangs on the world."""
    if kind == "free":
        return tree((("body", "free", WORLD), ("arm", "revolute", "body")))
    return tree((("arm", "revolute", WORLD), ("body", kind, "arm")))


def without_drives(mechanism: Mechanism) -> Mechanism:
    joints = (replace(j, rotor_inertia=0.0, damping=0.0, friction=0.0) for j in mechanism.joints)
    return replace(mechanism, joints=tuple(joints))


def case_of(motion: Motion, end: float, sample: float) -> Case:
    return Case("case", "", motion, step=sample, end=end, sample=sample, quantities=("torque",), limits=())


def double_pendulum() -> tuple[Mechanism, dict[str, float]]:
    """Two links in the x-z plane: lengths, centres of mass and inertias with values of their own."""
    p = {"m1": 1.3, "m2": 0.8, "l1": 0.5, "c1": 0.21, "c2": 0.17, "i1": 0.031, "i2": 0.012, "g": 9.81}
    axis = np.array([0.0, -1.0, 0.0])  # turns x towards z
    links = tuple(
        Link(f"link{k}", (Body("rod", Inertia(p[f"m{k}"], np.array([p[f"c{k}"], 0, 0]), np.diag([0.0, i, i]))),))
        for k, i in ((1, p["i1"]), (2, p["i2"]))
    )
    joints = (
        Joint("j1", "revolute", WORLD, "link1", axis=axis),
        Joint("j2", "revolute", "link1", "link2", Placement(np.array([p["l1"], 0.0, 0.0])), axis=axis),
    )
    return Mechanism("double_pendulum", links, joints), p


LINK = """<link name="{name}"><inertial><origin xyz="{com}" rpy="0.3 -0.2 0.1"/><mass value="{mass}"/>
  <inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0.001" ixz="-0.002" iyz="0.003"/></inertial></link>"""
JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
  <origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/><axis xyz="0.6 0 0.8"/>
  <limit effort="9" velocity="9" lower="-9" upper="9"/><dynamics damping="0.2" friction="0.1"/></joint>"""


def urdf(folder: Path, root: str = "pelvis") -> Path:
    """A branching robot whose joints are not in alphabetical order, with an empty frame link and a continuous joint."""
    text = "".join(
        [
            LINK.format(name=root, com="0.01 0.02 0.03", mass=4.0),
            LINK.format(name="z_arm", com="0.1 0 0.05", mass=1.5),
            LINK.format(name="a_arm", com="0 0.1 0", mass=1.0),
            LINK.format(name="hand", com="0.05 0.05 0", mass=0.7),
            '<link name="tool"/>',
            JOINT.format(name="zed", kind="revolute", parent=root, child="z_arm"),
            JOINT.format(name="abe", kind="prismatic", parent=root, child="a_arm"),
            JOINT.format(name="mid", kind="continuous", parent="z_arm", child="hand"),
            JOINT.format(name="end", kind="fixed", parent="hand", child="tool"),
        ]
    )
    path = folder / "robot.urdf"
    path.write_text(f'<robot name="robot">{text}</robot>', encoding="utf-8")
    return path


def overlaid(mechanism: Mechanism) -> Mechanism:
    """A payload on a link with inertia, one on a link without, and a rotor."""
    payload = Body("payload", Inertia(0.9, np.array([0.1, 0.2, 0.3]), 0.01 * np.eye(3)))
    links = tuple(
        replace(link, bodies=(*link.bodies, payload)) if link.name in ("hand", "tool") else link
        for link in mechanism.links
    )
    joints = tuple(replace(j, rotor_inertia=0.5) if j.name == "mid" else j for j in mechanism.joints)
    return replace(mechanism, links=links, joints=joints)


def reweighed(mechanism: Mechanism) -> Mechanism:
    """Other bodies in place of the URDF's own: on a link with inertia, which has a payload too, and on one without."""
    own = Body(REPLACED, Inertia(2.5, np.array([0.1, -0.1, 0.2]), 0.02 * np.eye(3)))
    links = tuple(replace(k, bodies=(own, *k.bodies[1:])) if k.name in ("hand", "tool") else k for k in mechanism.links)
    return replace(mechanism, links=links)


def footed(folder: Path, mass: float) -> Mechanism:
    """A leg with a foot on a fixed joint: inertia, and as much mass as is given."""
    path = urdf(folder)
    tensor = '<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/>'
    foot = f'<inertial><mass value="{mass}"/>{tensor}</inertial>'
    path.write_text(path.read_text().replace('<link name="tool"/>', f'<link name="tool">{foot}</link>'))
    return from_urdf(path)
