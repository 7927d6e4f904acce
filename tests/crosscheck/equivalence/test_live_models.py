"""Kinematic trees of Exudyn in memory are descriptions: of three kinds, each the mechanism that it was made from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from arm_texts import arm

import crosscheck
from crosscheck.equivalence.result import REPAIRED
from flexinv.errors import InputError

exu: Any = pytest.importorskip("exudyn")
from exudyn.itemInterface import NodeGenericODE2, ObjectKinematicTree  # noqa: E402
from exudyn.kinematicTree import (  # noqa: E402
    KinematicTree66,
    MassCOMinertia2T66,
    dictOfJointTransformMotionSubspace66,
)
from exudyn.rigidBodyUtilities import HT2T66Inverse  # noqa: E402
from exudyn.robotics import Robot, RobotLink  # noqa: E402

SKEW = np.array([[0.05, 0.002, 0.001], [0.002, 0.06, 0.003], [0.001, 0.003, 0.02]])
BOOM = {"mass": 3.25, "com": [0.02, 0.01, 0.3], "inertia": SKEW}
STICK = {"mass": 1.5, "com": [0.2, 0.0, 0.05], "inertia": np.diag([0.004, 0.02, 0.019])}
TEXT = """<robot name="crane"><link name="base"/>
  <link name="boom"><inertial><origin xyz="0.02 0.01 0.3"/><mass value="3.25"/>
    <inertia ixx="0.05" ixy="0.002" ixz="0.001" iyy="0.06" iyz="0.003" izz="0.02"/></inertial></link>
  <link name="stick"><inertial><origin xyz="0.2 0 0.05"/><mass value="1.5"/>
    <inertia ixx="0.004" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.019"/></inertial></link>
  <joint name="swing" type="continuous"><origin xyz="0.125 0 0.5" rpy="0.5 0 0"/><parent link="base"/><child link="boom"/>
    <axis xyz="0 1 0"/></joint>
  <joint name="slide" type="prismatic"><origin xyz="0.25 0 0.75" rpy="0 0 0.25"/><parent link="boom"/><child link="stick"/>
    <axis xyz="1 0 0"/><limit lower="-1e9" upper="1e9" effort="0" velocity="0"/></joint></robot>"""


def pose(xyz: list[float], rotation: Any) -> Any:
    made = np.eye(4)
    made[:3, 3], made[:3, :3] = xyz, rotation
    return made


def turn(angle: float, axis: int) -> Any:
    c, s = np.cos(angle), np.sin(angle)
    plane = [[c, -s], [s, c]]
    rows = [k for k in range(3) if k != axis]
    made = np.eye(3)
    made[np.ix_(rows, rows)] = plane
    return made


PLACES = [pose([0.125, 0, 0.5], turn(0.5, 0)), pose([0.25, 0, 0.75], turn(0.25, 2))]


def tree66(heavier: float = 0.0) -> Any:
    inertias = [MassCOMinertia2T66(p["mass"] + heavier, np.array(p["com"]), p["inertia"]) for p in (BOOM, STICK)]
    return KinematicTree66(["Ry", "Px"], [HT2T66Inverse(place) for place in PLACES], inertias, [-1, 0])


def robot() -> Any:
    made = Robot(gravity=[0, 0, -9.81])
    for part, kind, place, parent in zip((BOOM, STICK), ("Ry", "Px"), PLACES, (-1, 0), strict=True):
        made.AddLink(
            RobotLink(part["mass"], part["com"], part["inertia"], jointType=kind, parent=parent, preHT=exu.HT(place))
        )
    return made


def system() -> Any:
    mbs = exu.SystemContainer().AddSystem()
    none = [0, 0]
    node = NodeGenericODE2(
        referenceCoordinates=none, initialCoordinates=none, initialCoordinates_t=none, numberOfODE2Coordinates=2
    )
    kinds = [exu.JointType.RevoluteY, exu.JointType.PrismaticX]
    parts = (BOOM, STICK)
    mbs.AddObject(ObjectKinematicTree(
        nodeNumber=mbs.AddNode(node), jointTypes=kinds, linkParents=[-1, 0], gravity=[0, 0, -9.81],
        jointTransformations=exu.Matrix3DList([p[:3, :3] for p in PLACES]),
        jointOffsets=exu.Vector3DList([p[:3, 3] for p in PLACES]),
        linkInertiasCOM=exu.Matrix3DList([p["inertia"] for p in parts]), linkCOMs=exu.Vector3DList([p["com"] for p in parts]),
        linkMasses=[p["mass"] for p in parts],
    ))  # fmt: skip
    return mbs


@pytest.mark.parametrize("made", [robot, system])
def test_a_tree_in_memory_is_what_it_was_made_from(made: Any, tmp_path: Path) -> None:
    (tmp_path / "crane.urdf").write_text(TEXT)
    comparison = crosscheck.compare(tmp_path / "crane.urdf", made())
    assert [d.words for d in comparison.differences] == []
    assert comparison.equal
    assert comparison.judged.before <= REPAIRED


def test_exudyns_tree_of_6_x_6_matrices_slides_against_its_own_axis(tmp_path: Path) -> None:
    """Its Plücker transform of Px goes along -x, its motion subspace along +x: no mechanism does that, and it is said.

    The transform of a slide by q is that of the frame at q x; Exudyn's own `HT2T66Inverse` gives the one of the opposite sign.
    """
    place = np.eye(4)
    place[0, 3] = 0.2
    transform, subspace = dictOfJointTransformMotionSubspace66["Px"]
    assert subspace[3] == 1.0
    assert np.array_equal(transform(-0.2), HT2T66Inverse(place))
    (tmp_path / "crane.urdf").write_text(TEXT)
    comparison = crosscheck.compare(tmp_path / "crane.urdf", tree66())
    assert (comparison.state, comparison.code, comparison.differences) == ("not comparable", 2, ())
    assert "KinematicTree66: not reproduced, held against Exudyn" in comparison.sentence
    assert crosscheck.compare(tree66(), tree66()).state == "not comparable"


def test_exudyns_tree_of_6_x_6_matrices_with_hinges_is_proven() -> None:
    inertias = [MassCOMinertia2T66(part["mass"], np.array(part["com"]), part["inertia"]) for part in (BOOM, STICK)]
    made = [KinematicTree66(["Ry", "Rx"], [HT2T66Inverse(one) for one in PLACES], inertias, [-1, 0]) for _ in range(2)]
    assert crosscheck.compare(*made).equal


def test_another_mass_in_memory_is_named(tmp_path: Path) -> None:
    (tmp_path / "crane.urdf").write_text(TEXT)
    comparison = crosscheck.compare(tmp_path / "crane.urdf", tree66(heavier=0.25))
    assert {(d.cause, d.place) for d in comparison.differences} == {("mass", "link boom"), ("mass", "link stick")}


def test_what_is_no_tree_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="0 kinematic trees: expected one"):
        crosscheck.compare(exu.SystemContainer().AddSystem(), arm(tmp_path))
    with pytest.raises(InputError, match="Exudyn reads no files of robots"):
        crosscheck.compare(f"{arm(tmp_path)}@exudyn", arm(tmp_path))
