"""URDF import against Pinocchio's own reader on every robot of example-robot-data, and on bad files."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexinv.errors import InputError, ModelWarning
from flexinv.files.from_urdf import find_robots_folder, from_urdf
from flexinv.model.mechanism import Mechanism, Placement
from flexinv.typing import Array

pin = pytest.importorskip("pinocchio")
ROBOTS = find_robots_folder()
NAMES = sorted(str(p.relative_to(ROBOTS)) for p in ROBOTS.rglob("*.urdf"))
EMPTY = "ur_description/urdf/ur3.urdf"  # <robot> without a name or links: urdfdom refuses it too


def quiet(path: Path, **arguments: object) -> Mechanism:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        return from_urdf(path, **arguments)  # type: ignore[arg-type]


def neutral_frames(mechanism: Mechanism) -> dict[str, Placement]:
    """Where the links are with every joint at zero: products of placements."""
    frames = {"world": Placement()}
    for joint in mechanism.joints:
        parent, own = frames[joint.parent], joint.placement
        position = parent.position + parent.rotation @ own.position
        frames[joint.child] = Placement(position, parent.rotation @ own.rotation)
    return frames


def composite(mechanism: Mechanism) -> tuple[float, Array, Array]:
    """Mass, centre of mass and inertia about it, world axes, every joint at zero."""
    frames = neutral_frames(mechanism)
    bodies = [(frames[link.name], body.inertia) for link in mechanism.links for body in link.bodies]
    mass = sum(inertia.mass for _, inertia in bodies)
    places = [frame.position + frame.rotation @ inertia.com for frame, inertia in bodies]
    com = sum((i.mass * x for (_, i), x in zip(bodies, places, strict=True)), np.zeros(3)) / mass
    tensor = np.zeros((3, 3))
    for (frame, inertia), place in zip(bodies, places, strict=True):
        r = place - com
        tensor += frame.rotation @ inertia.tensor @ frame.rotation.T + inertia.mass * (
            r @ r * np.eye(3) - np.outer(r, r)
        )
    return mass, com, tensor


def test_every_robot_is_there() -> None:
    assert len(NAMES) == 69
    assert EMPTY in NAMES


@pytest.mark.parametrize("name", [name for name in NAMES if name != EMPTY])
def test_robot_equals_pinocchios(name: str) -> None:
    """Names, order and size of the coordinates; on a free base mass, centre of mass and inertia."""
    path = ROBOTS / name
    fixed, model = quiet(path), pin.buildModelFromUrdf(str(path))
    assert [joint.name for joint in fixed.joints if joint.nv] == list(model.names)[1:]
    assert (fixed.nq, fixed.nv) == (model.nq, model.nv)
    assert np.array_equal(fixed.gravity, model.gravity.linear)
    free, model = quiet(path, base="free"), pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    assert [joint.name for joint in free.joints if joint.nv] == list(model.names)[1:]
    assert np.array_equal(free.neutral, pin.neutral(model))
    data = model.createData()
    pin.ccrba(model, data, pin.neutral(model), np.zeros(model.nv))
    mass, com, tensor = composite(free)
    # sums over some hundred bodies in another order: 1e-12 is a thousand roundings
    assert mass == pytest.approx(pin.computeTotalMass(model), rel=1e-12)
    assert np.abs(com - data.com[0]).max() < 1e-12
    assert np.abs(tensor - data.Ig.inertia).max() < 1e-12 * max(1.0, np.abs(tensor).max())


@pytest.mark.parametrize("name", [name for name in NAMES if name != EMPTY])
def test_limits_and_dynamics_are_read(name: str) -> None:
    path = ROBOTS / name
    mechanism, model = quiet(path), pin.buildModelFromUrdf(str(path))
    for joint in mechanism.joints:
        if joint.kind not in ("revolute", "prismatic"):
            continue
        i = model.getJointId(joint.name)
        q, v = model.idx_qs[i], model.idx_vs[i]
        assert joint.limits.lower == model.lowerPositionLimit[q]
        assert joint.limits.upper == model.upperPositionLimit[q]
        # what the file says to be 0 is no limit: see from_urdf
        assert joint.limits.effort == (model.effortLimit[v] or np.inf)
        assert joint.limits.velocity == (model.velocityLimit[v] or np.inf)
        assert (joint.damping, joint.friction) == (model.damping[v], model.friction[v])
        assert joint.actuated


def write(tmp_path: Path, body: str, head: str = "") -> Path:
    path = tmp_path / "robot.urdf"
    path.write_text(f'<?xml version="1.0"?>{head}<robot name="robot">{body}</robot>')
    return path


MASS = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'
TWO = f'<link name="a">{MASS}</link><link name="b">{MASS}</link>'


def joint(kind: str = "revolute", inner: str = "", name: str = "j", parent: str = "a", child: str = "b") -> str:
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{inner}</joint>'


def test_inertia_is_turned_by_the_rpy_of_its_origin(tmp_path: Path) -> None:
    origin = '<origin xyz="1 2 3" rpy="0.3 -0.4 0.5"/>'
    inertia = '<inertia ixx="1" ixy="0.1" ixz="0.2" iyy="2" iyz="0.3" izz="2.5"/>'
    path = write(tmp_path, f'<link name="a"><inertial>{origin}<mass value="2"/>{inertia}</inertial></link>')
    ours = from_urdf(path, base="free").links[0].bodies[0].inertia
    theirs = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer()).inertias[1]
    assert np.array_equal(ours.com, theirs.lever)
    assert np.abs(ours.tensor - theirs.inertia).max() < 1e-15  # a few roundings of numbers of size 1


def test_axis_is_normalised_as_in_pinocchio(tmp_path: Path) -> None:
    path = write(
        tmp_path, TWO + joint(inner='<axis xyz="1 2 2"/><limit effort="1" velocity="1" lower="-1" upper="1"/>')
    )
    with pytest.warns(ModelWarning, match="length 3, normalised"):
        assert np.allclose(from_urdf(path).joints[1].axis, np.array([1, 2, 2]) / 3, rtol=1e-15, atol=0)


def test_children_come_in_alphabetical_order_of_joints(tmp_path: Path) -> None:
    links = "".join(f'<link name="{name}">{MASS}</link>' for name in "abcd")
    joints = joint("continuous", name="z", child="b") + joint("continuous", name="k", parent="b", child="c")
    path = write(tmp_path, links + joints + joint("continuous", name="A", child="d"))
    assert [j.name for j in from_urdf(path).joints] == ["root_joint", "A", "z", "k"]
    assert list(pin.buildModelFromUrdf(str(path)).names)[1:] == ["A", "z", "k"]


def test_floating_joint_is_free_and_has_no_drive(tmp_path: Path) -> None:
    mechanism = from_urdf(write(tmp_path, TWO + joint("floating")))
    assert (mechanism.joint_of["j"].kind, mechanism.joint_of["j"].actuated) == ("free", False)


@pytest.mark.parametrize(
    ("base", "first"), [("fixed", ("j", "world", "b")), ("free", ("root_joint", "world", "world_link"))]
)
def test_root_link_named_world(tmp_path: Path, base: str, first: tuple[str, ...]) -> None:
    """With a fixed base it is the world; a moving one is a link, under another name."""
    path = write(tmp_path, (TWO + joint()).replace('"a"', '"world"'))
    result = from_urdf(path, base=base).joints[0]
    assert (result.name, result.parent, result.child) == first


def test_mimic_joints_are_named(tmp_path: Path) -> None:
    links = TWO + f'<link name="c">{MASS}</link>'
    mimic = joint("continuous", '<mimic joint="j"/>', "finger", "a", "c")
    path = write(tmp_path, links + joint("continuous") + mimic)
    with pytest.warns(ModelWarning, match=r"robot.urdf: mimic joints are coordinates of their own: finger \(of j\)"):
        mechanism = from_urdf(path)
    assert mechanism.nv == 2
    assert "finger (of j)" in mechanism.notes[0]
    locked = from_urdf(path, lock=["finger"])  # no warning: nothing mimics any more
    assert (locked.nv, locked.joint_of["finger"].kind) == (1, "fixed")
    assert "locked at zero: finger" in locked.notes[-1]


def test_links_without_inertia_are_massless(tmp_path: Path) -> None:
    mechanism = from_urdf(write(tmp_path, TWO.replace(MASS, "", 1) + joint()))
    assert mechanism.link_of["a"].bodies == ()
    assert mechanism.notes == ("links without mass: a",)


def test_odd_inertia_is_kept_and_named(tmp_path: Path) -> None:
    path = write(tmp_path, TWO.replace('izz="1"', 'izz="5"', 1) + joint())
    with pytest.warns(ModelWarning, match="an inertia that no body can have, kept as it is: a"):
        mechanism = from_urdf(path)
    assert mechanism.link_of["a"].bodies[0].inertia.tensor[2, 2] == 5


BAD = {
    "no inertia": (TWO.replace(MASS, "") + joint(), "no link with a mass", "<inertial>"),
    "no link": ("", "a robot without links", "<link"),
    "negative mass": (TWO.replace('value="1"', 'value="-1"', 1) + joint(), '<link name="a">, mass', 'value="1"'),
    "NaN": (TWO.replace('value="1"', 'value="nan"', 1) + joint(), 'value="nan"', "finite number"),
    "text": (TWO + joint(inner='<origin xyz="0 0 a"/>'), 'xyz="0 0 a"', "3 finite numbers"),
    "decimal comma": (TWO.replace('value="1"', 'value="2,275"', 1) + joint(), 'value="2,275"', 'write:    value="2.275"'),
    "a unit": (TWO.replace('value="1"', 'value="2.275 kg"', 1) + joint(), 'value="2.275 kg"', 'write:    value="2.275"'),
    "one comma of three": (TWO + joint(inner='<origin xyz="0 0 -0,28"/>'), "0 0 -0,28", 'xyz="0 0 -0.28"'),
    "no number is invented": (TWO.replace('value="1"', 'value="heavy"', 1) + joint(), "heavy", 'value="..."'),
    "two numbers": (TWO + joint(inner='<axis xyz="0 1"/>'), '<joint name="j">, axis', "3 finite numbers"),
    "zero axis": (TWO + joint(inner='<axis xyz="0 0 0"/>'), '<joint name="j">, axis', "not all zero"),
    "planar": (TWO + joint("planar"), 'type="planar"', "planar joints are not supported"),
    "unknown kind": (TWO + joint("revolut"), 'type="revolut"', "revolute"),
    "no parent": (TWO + joint().replace('<parent link="a"/>', ""), '<joint name="j">, parent', "the name of a link"),
    "to nowhere": (TWO + joint(child="bb"), 'child = "bb"', 'child = "b"'),
    "duplicate link": (TWO + TWO, '<link name="a">', "this link twice"),
    "duplicate joint": (TWO + joint() + joint(), '<joint name="j">', "this joint twice"),
    "two parts": (TWO, "2 links that no joint carries: a, b", "one root link"),
    "carried twice": (TWO + joint() + joint(name="k"), "carries already", "what closes a loop is a closure"),
    "cycle": (TWO + joint() + joint(name="k", parent="b", child="a"), "a cycle", "what closes a loop is a closure"),
    "no name": (TWO + joint(name=""), "<joint>", "a name of 1 to 100"),
    "negative damping": (TWO + joint(inner='<dynamics damping="-1"/>'), 'damping="-1"', 'damping="1"'),
    "limits exchanged": (TWO + joint(inner='<limit lower="1" upper="-1"/>'), "limit", "lower <= upper"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD.values(), ids=BAD.keys())
def test_bad_urdf_is_explained(tmp_path: Path, case: tuple[str, str, str]) -> None:
    body, given, advice = case
    path = write(tmp_path, body)
    with pytest.raises(InputError) as caught:
        from_urdf(path)
    said = str(caught.value)
    assert said.startswith(str(path))
    assert given in said
    assert advice in said
    assert all(f"\n  {word}:" in said for word in ("given", "expected", "write"))


BOMB = '<!DOCTYPE robot [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
OUTSIDE = '<!DOCTYPE robot [<!ENTITY x SYSTEM "file:///etc/hostname">]>'
REMOTE = '<!DOCTYPE robot SYSTEM "http://127.0.0.1:9/x.dtd">'


@pytest.mark.parametrize("head", [BOMB, OUTSIDE, REMOTE], ids=["entity bomb", "external entity", "external DTD"])
def test_entities_are_refused(tmp_path: Path, head: str) -> None:
    path = write(tmp_path, f'<link name="a">{MASS}</link>', head)
    with pytest.raises(
        InputError, match=r"robot.urdf\n.*DOCTYPE or ENTITY\n.*could swell without end.*\n.*written out"
    ):
        from_urdf(path)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("<robot name='r'><link>", "does not parse"),
        ("<?xml version='1.0' encoding='x-none'?><robot/>", "does not parse"),
        ("<mujoco/>", r"<mujoco>\n.*<robot name=.*\n.*xacro"),
        (" " * (16 << 20) + "<robot/>", "more than 16777216 bytes"),
    ],
    ids=["unclosed", "unknown encoding", "no robot", "too large"],
)
def test_no_urdf_at_all(tmp_path: Path, text: str, match: str) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    with pytest.raises(InputError, match=match):
        from_urdf(path)


def test_file_that_is_not_there(tmp_path: Path) -> None:
    write(tmp_path, "")
    with pytest.raises(InputError, match=r"robto.urdf\n.*no such file\n.*\n.*write: .*robot.urdf"):
        from_urdf(tmp_path / "robto.urdf")


def test_the_empty_robot_of_the_package_is_explained() -> None:
    with pytest.raises(InputError, match="a robot without links"):
        from_urdf(ROBOTS / EMPTY)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"base": "floating"}, 'expected "fixed" or "free"'),
        ({"gravity": (0, 0)}, "three finite numbers"),
        ({"gravity": (0, 0, np.nan)}, "three finite numbers"),
        ({"lock": ["jj"]}, 'lock of joint "jj"(.|\n)*write: +"j"'),
    ],
)
def test_bad_arguments(tmp_path: Path, arguments: dict[str, object], match: str) -> None:
    with pytest.raises(InputError, match=match):
        from_urdf(write(tmp_path, TWO + joint()), **arguments)  # type: ignore[arg-type]


def test_the_comparison_sees_a_wrong_inertia() -> None:
    """The check of masses and inertias fails when one body is turned."""
    mechanism = quiet(ROBOTS / "panda_description/urdf/panda.urdf", base="free")
    link = mechanism.link_of["panda_link4"]
    body = link.bodies[0]
    turned = replace(body, inertia=body.inertia.replace_unchecked(com=-body.inertia.com))
    links = tuple(replace(other, bodies=(turned,)) if other is link else other for other in mechanism.links)
    assert np.abs(composite(replace(mechanism, links=links))[1] - composite(mechanism)[1]).max() > 1e-3
