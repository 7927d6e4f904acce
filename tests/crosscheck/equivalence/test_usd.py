"""USD by usd-core: a stage in centimetres and degrees is the URDF of the same machine; what it leaves open is said."""

from __future__ import annotations

from pathlib import Path

import pytest

import crosscheck
from crosscheck.equivalence import sources
from crosscheck.equivalence.sources import describe
from flexinv.errors import InputError

URDF = """<robot name="crane"><link name="base"/>
  <link name="boom"><inertial><origin xyz="0.02 0.01 0.3"/><mass value="3.25"/>
    <inertia ixx="0.05" ixy="0" ixz="0" iyy="0.06" iyz="0" izz="0.02"/></inertial></link>
  <link name="stick"><inertial><mass value="1.5"/>
    <inertia ixx="0.004" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.019"/></inertial></link>
  <joint name="swing" type="revolute"><origin xyz="0.125 0 0.5"/><parent link="base"/><child link="boom"/>
    <axis xyz="0 1 0"/><limit lower="-1.5707963267948966" upper="0.7853981633974483" effort="0" velocity="0"/></joint>
  <joint name="slide" type="prismatic"><origin xyz="0.25 0 0.75"/><parent link="boom"/><child link="stick"/>
    <axis xyz="1 0 0"/><limit lower="-0.5" upper="0.25" effort="0" velocity="0"/></joint></robot>"""
# The stick hangs in the boom's frame; the joint is stated from the stick to the boom, whose frame is 1 cm beside the hinge.
STAGE = """#usda 1.0
(
    kilogramsPerUnit = 1
    metersPerUnit = 0.01
    upAxis = "Z"
)
def PhysicsScene "scene"
{
    vector3f physics:gravityDirection = (0, 0, -1)
    float physics:gravityMagnitude = 981
}
def Xform "crane" (
    prepend apiSchemas = ["PhysicsArticulationRootAPI"]
)
{
    def Xform "boom" (
        prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]
    )
    {
        double3 xformOp:translate = (11.5, 0, 50)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        float physics:mass = 3.25
        point3f physics:centerOfMass = (3, 1, 30)
        float3 physics:diagonalInertia = (500, 600, 200)
    }
    def Xform "stick" (
        prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]
    )
    {
        double3 xformOp:translate = (37.5, 0, 125)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        float physics:mass = 1.5
        point3f physics:centerOfMass = (0, 0, 0)
        float3 physics:diagonalInertia = (40, 200, 190)
    }
    def PhysicsRevoluteJoint "swing"
    {
        rel physics:body1 = </crane/boom>
        point3f physics:localPos0 = (12.5, 0, 50)
        point3f physics:localPos1 = (1, 0, 0)
        uniform token physics:axis = "Y"
        float physics:lowerLimit = -90
        float physics:upperLimit = 45
    }
    def PhysicsPrismaticJoint "slide"
    {
        rel physics:body0 = </crane/stick>
        rel physics:body1 = </crane/boom>
        point3f physics:localPos1 = (26, 0, 75)
        uniform token physics:axis = "X"
        float physics:lowerLimit = -25
        float physics:upperLimit = 50
    }
}
"""
STATED = """        float physics:mass = 1.5
        point3f physics:centerOfMass = (0, 0, 0)
        float3 physics:diagonalInertia = (40, 200, 190)
"""
BOX = """        float physics:density = 0.0005
        def Cube "box" (
            prepend apiSchemas = ["PhysicsCollisionAPI"]
        )
        {
            double size = 10
            double3 xformOp:scale = (2, 4, 1)
            uniform token[] xformOpOrder = ["xformOp:scale"]
        }
"""


SWING = """def PhysicsRevoluteJoint "swing"
    {
        rel physics:body1 = </crane/boom>
        point3f physics:localPos0 = (12.5, 0, 50)
        point3f physics:localPos1 = (1, 0, 0)
        uniform token physics:axis = "Y"
        float physics:lowerLimit = -90
        float physics:upperLimit = 45
    }"""
AT = """ (
        prepend apiSchemas = [APIS]
    )
    {
        rel physics:body1 = </crane/boom>
        point3f physics:localPos0 = (12.5, 0, 50)
        point3f physics:localPos1 = (1, 0, 0)
"""
AT = AT.replace("APIS", ", ".join(f'"PhysicsLimitAPI:{way}{axis}"' for way in ("trans", "rot") for axis in "XYZ"))


def limits(axis: str, low: float, high: float) -> str:
    """The range of one of a joint's six axes; low above high locks it."""
    return f"        float limit:{axis}:physics:low = {low}\n        float limit:{axis}:physics:high = {high}\n"


def universal(order: list[tuple[str, str]]) -> str:
    """The URDF with two joints, one after the other, in place of the swing; the limits are those about Y."""
    start, end = URDF.index('<joint name="swing"'), URDF.index("</joint>") + len("</joint>")
    one, two = (
        f'<joint name="{name}" type="{"revolute" if "rotY" in name else "continuous"}"><axis xyz="{axis}"/>'
        + '<limit lower="-1.5707963267948966" upper="0.7853981633974483" effort="0" velocity="0"/>'
        for name, axis in order
    )
    first = f'{one}<origin xyz="0.125 0 0.5"/><parent link="base"/><child link="cross"/></joint><link name="cross"/>'
    second = f'{two}<parent link="cross"/><child link="boom"/></joint>'
    return URDF[:start] + first + second + URDF[end:]


def both(folder: Path, before: str = "", after: str = "") -> tuple[Path, Path]:
    """The URDF, and the stage with a part of its text exchanged."""
    assert before in STAGE
    (folder / "crane.urdf").write_text(URDF)
    (folder / "crane.usda").write_text(STAGE.replace(before, after, 1) if before else STAGE)
    return folder / "crane.urdf", folder / "crane.usda"


def test_without_a_reader_it_is_said_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sources, "can_read_usd", lambda: False)
    with pytest.raises(InputError, match="python -m pip install usd-core"):
        describe(both(tmp_path)[1])
    (tmp_path / "arm.sdf").write_text("<sdf version='1.9'/>")
    monkeypatch.setattr(sources, "_collect_engines", dict)
    with pytest.raises(InputError, match=r"pip install --no-deps drake"):
        describe(tmp_path / "arm.sdf")


class TestWithUsd:
    @pytest.fixture(autouse=True)
    def _usd(self) -> None:
        pytest.importorskip("pxr", reason="USD is not installed (python -m pip install usd-core)")

    def test_a_joint_from_the_child_counts_the_other_way_and_nothing_else_differs(self, tmp_path: Path) -> None:
        comparison = crosscheck.compare(*both(tmp_path))
        assert [(d.cause, d.place) for d in comparison.differences] == [("sign of coordinate", "joint slide")]

    def test_a_stage_is_not_the_source_itself_and_not_proven(self, tmp_path: Path) -> None:
        """usd-core computes no dynamics: twice the same stage is not proven to be one machine, unless that is asked for."""
        stage = both(tmp_path)[1]
        comparison = crosscheck.compare(stage, stage)
        assert (comparison.state, comparison.code) == ("not proven", 2)
        assert "usd-core reads the stage and computes no dynamics" in comparison.sentence
        assert crosscheck.compare(stage, stage, unproven=True).code == 0

    @pytest.mark.parametrize(
        ("before", "after", "cause", "place"),
        [
            ("float physics:mass = 1.5", "float physics:mass = 1.75", "mass", "link stick"),
            ("(3, 1, 30)", "(3, 1, 32)", "centre of mass", "link boom"),
            ("localPos1 = (26, 0, 75)", "localPos1 = (26, 5, 75)", "position of joint", "joint slide"),
            ("upperLimit = 45", "upperLimit = 60", "upper limit", "joint swing"),
            ("gravityMagnitude = 981", "gravityMagnitude = 9.81", None, None),
        ],
    )
    def test_an_edit_is_named(self, before: str, after: str, cause: str, place: str, tmp_path: Path) -> None:
        comparison = crosscheck.compare(*both(tmp_path, before, after))
        named = {(d.cause, d.place) for d in comparison.differences} - {("sign of coordinate", "joint slide")}
        assert named == ({(cause, place)} if cause else set())
        if not cause:  # a URDF states no gravity: what the other says is taken, and told
            assert any("0.0981" in words for _, lines in comparison.dropped for words in lines)

    def test_masses_come_from_shapes_where_none_is_stated(self, tmp_path: Path) -> None:
        """A box of 20 cm x 40 cm x 10 cm of 500 kg/m^3: 4 kg, and its moments; what has no shape is an error."""
        stick = describe(both(tmp_path, STATED, BOX)[1]).mechanism.link_of["stick"].bodies[0].inertia
        assert stick.mass == pytest.approx(4.0, rel=1e-6)
        assert stick.tensor[0, 0] == pytest.approx(4.0 / 12 * (0.4**2 + 0.1**2), rel=1e-6)
        with pytest.raises(InputError, match="without colliders"):
            describe(both(tmp_path, STATED)[1])

    def test_two_free_rotations_are_one_after_the_other_and_their_order_is_told(self, tmp_path: Path) -> None:
        """About X of the first body, then about Y of the second; a URDF in the other order is another machine."""
        locked = "".join(limits(axis, 1, -1) for axis in ("transX", "transY", "transZ", "rotZ"))
        names = [("swing.rotX", "1 0 0"), ("swing.rotY", "0 1 0")]
        stage = both(tmp_path, SWING, f'def PhysicsJoint "swing"{AT}{locked}{limits("rotY", -90, 45)}    }}')[1]
        for order, same in ((names, True), (names[::-1], False)):
            (tmp_path / "crane.urdf").write_text(universal(order))
            comparison = crosscheck.compare(tmp_path / "crane.urdf", stage)
            assert (not [d.words for d in comparison.differences if d.place != "joint slide"]) is same
        assert any("no order of its two free rotations" in words for words in describe(stage).dropped)

    def test_a_slide_and_a_turn_of_one_joint_are_two_joints(self, tmp_path: Path) -> None:
        locked = "".join(limits(axis, 1, -1) for axis in ("transX", "transY", "rotX", "rotY"))
        stage = both(tmp_path, SWING, f'def PhysicsJoint "swing"{AT}{locked}{limits("transZ", -5, 20)}    }}')[1]
        joints = {joint.name: joint for joint in describe(stage).mechanism.joints}
        assert [joints[name].kind for name in ("swing.transZ", "swing.rotZ")] == ["prismatic", "revolute"]
        assert (joints["swing.transZ"].limits.lower, joints["swing.transZ"].limits.upper) == pytest.approx((-0.05, 0.2))
        assert joints["swing.rotZ"].parent == joints["swing.transZ"].child

    def test_a_joint_whose_axes_are_all_free_ties_nothing(self, tmp_path: Path) -> None:
        result = describe(both(tmp_path, "PhysicsPrismaticJoint", "PhysicsJoint")[1])
        assert {joint.kind for joint in result.mechanism.joints} == {"revolute", "free"}
        assert any("all of its axes are free" in words for words in result.dropped)

    def test_joints_without_a_word_and_stages_without_bodies_are_refused(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match="'slide' of type PhysicsDistanceJoint"):
            describe(both(tmp_path, "PhysicsPrismaticJoint", "PhysicsDistanceJoint")[1])
        (tmp_path / "none.usda").write_text("#usda 1.0\n")
        with pytest.raises(InputError, match="a stage without bodies"):
            describe(tmp_path / "none.usda")
        (tmp_path / "none.usda").write_text("#usda 1.0\nnothing {")
        with pytest.raises(InputError, match=r"what USD refuses: .*parse error"):
            describe(tmp_path / "none.usda")
