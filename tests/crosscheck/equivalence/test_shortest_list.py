"""Of two lists of differences that explain every torque the shorter is told: zeros of fingers, centres of mass, tilted joints."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from crosscheck.equivalence.compare import compare
from crosscheck.equivalence.result import REPAIRED
from crosscheck.equivalence.sources import describe
from crosscheck.lifting.rigid import join_bodies, move_inertia
from flexinv.model.mechanism import Inertia, Placement

# A finger at the end of two links; its tensor is round about its joint's axis, and nothing hangs on it.
LINK = """<link name="{0}"><inertial><origin xyz="0.02 0.03 0.1"/><mass value="{1}"/>
  <inertia ixx="0.02" ixy="0.001" ixz="0" iyy="0.03" iyz="0.002" izz="0.025"/></inertial></link>"""
JOINT = """<joint name="to_{0}" type="revolute"><origin xyz="{2}" rpy="{3}"/><parent link="{1}"/><child link="{0}"/>
  <axis xyz="{4}"/><limit lower="{5!r}" upper="{6!r}" effort="9" velocity="2"/></joint>"""
FINGER = """<link name="finger"><inertial><origin xyz="{0}"/><mass value="0.2"/>
  <inertia ixx="2e-5" ixy="0" ixz="0" iyy="2e-5" iyz="0" izz="1e-5"/></inertial></link>"""
LOWER, UPPER = -0.2, 1.4


def hand(
    folder: Path,
    name: str,
    com: str = "0.03 0 0.01",
    rpy: str = "0 0 0",
    moved: float = 0.0,
    elbow: tuple[str, float] = ("0.3 0 0", 0.0),
) -> Path:
    """A URDF of two links and a finger; moved : of the finger's limits [rad]; elbow : rpy and how far its limits moved [rad]."""
    turn, way = elbow
    parts = [
        '<robot name="hand"><link name="base"/>',
        LINK.format("upper", 3.0), JOINT.format("upper", "base", "0 0 0.2", "0 0 0", "0 0 1", -2.0, 2.0),
        LINK.format("lower", 2.0), JOINT.format("lower", "upper", "0 0.1 0.4", turn, "1 0 0", -1.0 + way, 1.5 + way),
        FINGER.format(com), JOINT.format("finger", "lower", "0 0.05 0.3", rpy, "0 0 1", LOWER + moved, UPPER + moved),
        "</robot>",
    ]  # fmt: skip
    (folder / name).write_text("".join(parts))
    return folder / name


@pytest.mark.parametrize("angle", [-math.pi / 4, math.pi / 2, 0.1])
def test_a_finger_whose_zero_moved_did_not_move_its_centre_of_mass(angle: float, tmp_path: Path) -> None:
    """The joint's frame is turned about its axis, and the limits keep their numbers: one edit, and one thing that is told."""
    comparison = compare(hand(tmp_path, "a.urdf"), hand(tmp_path, "b.urdf", rpy=f"0 0 {angle!r}"))
    ((cause, place, size),) = ((d.cause, d.place, d.size) for d in comparison.differences)
    assert (cause, place) == ("zero of coordinate", "joint to_finger")
    assert size == pytest.approx(abs(angle), rel=1e-9)
    assert comparison.judged.after <= REPAIRED


@pytest.mark.parametrize("angle", [-math.pi / 4, math.pi / 2, 0.1])
def test_limits_that_move_with_a_zero_are_no_other_difference(angle: float, tmp_path: Path) -> None:
    comparison = compare(hand(tmp_path, "a.urdf"), hand(tmp_path, "b.urdf", rpy=f"0 0 {angle!r}", moved=-angle))
    assert [(d.cause, d.place) for d in comparison.differences] == [("zero of coordinate", "joint to_finger")]


def test_a_centre_of_mass_on_the_other_side_of_its_joint_turned_no_zero(tmp_path: Path) -> None:
    """Half a turn of the joint would bring it there, too; but its frame is the same in both files."""
    comparison = compare(hand(tmp_path, "a.urdf"), hand(tmp_path, "b.urdf", com="-0.03 0 0.01"))
    assert [(d.cause, d.place, d.size) for d in comparison.differences] == [
        ("centre of mass", "link finger", pytest.approx(0.06, rel=1e-9))
    ]


def test_a_centre_of_mass_that_went_round_the_axis_turned_no_zero(tmp_path: Path) -> None:
    """By an angle that no limit moved by, in a frame that stayed."""
    com = f"{0.03 * math.cos(0.3)!r} {0.03 * math.sin(0.3)!r} 0.01"
    comparison = compare(hand(tmp_path, "a.urdf"), hand(tmp_path, "b.urdf", com=com))
    assert [(d.cause, d.place) for d in comparison.differences] == [("centre of mass", "link finger")]


def test_a_tilt_beside_a_small_zero_is_told_apart_where_limits_say_so(tmp_path: Path) -> None:
    """The elbow is tilted by a degree and its zero moved by five: limits moved by just those five."""
    zero, tilt = math.radians(5.0), math.radians(1.0)
    # turned about y in the frame of the joint, whose axis is x:  Rx(0.3) Ry(tilt) Rx(zero)
    turn = Rotation.from_euler("x", 0.3) * Rotation.from_euler("y", tilt) * Rotation.from_euler("x", zero)
    roll, pitch, yaw = turn.as_euler("xyz").tolist()
    b = hand(tmp_path, "b.urdf", elbow=(f"{roll!r} {pitch!r} {yaw!r}", -zero))
    comparison = compare(hand(tmp_path, "a.urdf"), b)
    assert {d.cause: d.size for d in comparison.differences} == {
        "orientation of joint": pytest.approx(tilt, rel=1e-6), "zero of coordinate": pytest.approx(zero, rel=1e-6),
    }  # fmt: skip
    assert comparison.judged.after <= REPAIRED


def test_a_turn_about_another_axis_is_one_difference(tmp_path: Path) -> None:
    """Degrees for radians turn a joint anyhow: no part of that is a zero."""
    comparison = compare(hand(tmp_path, "a.urdf"), hand(tmp_path, "b.urdf", elbow=("0.3 0.5 0.4", 0.0)))
    assert [(d.cause, d.place) for d in comparison.differences] == [("orientation of joint", "joint to_lower")]


CAP = Inertia(0.5, np.array([0.0, 0.02, 0.05]), np.diag([4e-4, 3e-4, 2e-4]))
PLACE = "0.05 0 0.2"


def text_of(link: str, body: Inertia) -> str:
    """A link of a URDF."""
    com = " ".join(map(repr, body.com.tolist()))
    rows = zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), body.tensor[np.triu_indices(3)].tolist(), strict=True)
    tensor = " ".join(f'{name}="{value!r}"' for name, value in rows)
    place = f'<origin xyz="{com}"/><mass value="{body.mass!r}"/>'
    return f'<link name="{link}"><inertial>{place}<inertia {tensor}/></inertial></link>'


def capped(folder: Path, name: str, com: tuple[float, float, float], merged: bool, cap: Inertia = CAP) -> Path:
    """The hand with a cap fixed to its lower link, or one body of both; com : of the lower link without it [m]."""
    tensor = np.array([[0.02, 0.001, 0.0], [0.001, 0.03, 0.002], [0.0, 0.002, 0.025]])
    lower = Inertia(2.0, np.array(com), tensor)
    placement = Placement(np.array([float(x) for x in PLACE.split()]))
    parts = [text_of("lower", join_bodies([lower, move_inertia(placement, cap)]) if merged else lower)]
    if not merged:
        parts += [text_of("cap", cap), '<joint name="weld" type="fixed"><parent link="lower"/><child link="cap"/>']
        parts += [f'<origin xyz="{PLACE}"/></joint>']
    text = hand(folder, name).read_text()
    assert LINK.format("lower", 2.0) in text
    (folder / name).write_text(text.replace(LINK.format("lower", 2.0), "".join(parts)))
    return folder / name


def test_a_body_that_the_other_file_merged_is_named_alone(tmp_path: Path) -> None:
    """The centre of mass of one of two bodies has another sign; of both together, centre and tensor differ."""
    a = capped(tmp_path, "a.urdf", (0.02, 0.03, 0.1), merged=False)
    b = capped(tmp_path, "b.urdf", (0.02, -0.03, 0.1), merged=True)
    for result in (compare(a, b), compare(b, a)):
        assert [(d.cause, d.place, d.size) for d in result.differences] == [
            ("centre of mass", "body lower (on link lower)", pytest.approx(0.06, rel=1e-9))
        ]
        assert result.judged.after <= REPAIRED
    c = capped(tmp_path, "c.urdf", (0.02, 0.03, 0.1), merged=True)
    assert not compare(a, c).differences
    # What to write in B is the whole as A has it, which is C.
    ((_, (in_a, in_b)),) = compare(a, b).advice
    assert "in body lower, in the frame of link lower: centre of mass 0.02 -0.03 0.1" in in_a
    whole = describe(c).mechanism.link_of["lower"].bodies[0].inertia
    assert f"mass {whole.mass:.9g}, centre of mass {' '.join(f'{x:.9g}' for x in whole.com)}" in in_b


LOWER_LINK = Inertia(
    2.0, np.array([0.02, 0.03, 0.1]), np.array([[0.02, 0.001, 0.0], [0.001, 0.03, 0.002], [0.0, 0.002, 0.025]])
)


def welded(folder: Path, name: str, bodies: dict[str, Inertia]) -> Path:
    """The hand with bodies fixed to its lower link, each in the frame of that link; "lower" is the link's own."""
    parts = [text_of("lower", bodies["lower"])]
    for own, body in bodies.items():
        if own != "lower":
            parts.append(text_of(own, body))
            parts.append(f'<joint name="to_{own}" type="fixed"><parent link="lower"/><child link="{own}"/></joint>')
    text = hand(folder, name).read_text()
    assert LINK.format("lower", 2.0) in text
    (folder / name).write_text(text.replace(LINK.format("lower", 2.0), "".join(parts)))
    return folder / name


def halves(body: Inertia) -> tuple[Inertia, Inertia]:
    """A body as two, each with a share of its mass and tensor in the same place."""
    one, other = (Inertia(share * body.mass, body.com, share * body.tensor) for share in (0.3, 0.7))
    return one, other


def test_a_body_is_named_alone_however_the_other_file_splits_what_is_fixed(tmp_path: Path) -> None:
    """A has two bodies, B four: each of A's is two of B's, of which one has A's name.  One centre of mass has another sign."""
    wrong = LOWER_LINK.replace_unchecked(com=np.array([0.02, -0.03, 0.1]))
    for body, count in ((LOWER_LINK, 0), (wrong, 1)):
        lower, lower_part = halves(body)
        cap, cap_part = halves(CAP)
        a = welded(tmp_path, "a.urdf", {"lower": LOWER_LINK, "cap": CAP})
        b = welded(tmp_path, "b.urdf", {"lower": lower, "lower_part": lower_part, "cap": cap, "cap_part": cap_part})
        for result in (compare(a, b), compare(b, a)):
            assert [(d.cause, d.place, d.size) for d in result.differences] == [
                ("centre of mass", "body lower (on link lower)", pytest.approx(0.06, rel=1e-9))
            ] * count
            assert result.judged.after <= REPAIRED
    # B's own "lower" is a part of A's: what to write in B is said of the whole.
    ((_, (in_a, in_b)),) = compare(a, b).advice
    assert "in body lower, in the frame of link lower: centre of mass 0.02 -0.03 0.1" in in_a
    assert "in link lower, of which A states lower, cap apart: mass 2.5" in in_b


def test_a_body_is_named_alone_whatever_names_and_order_the_bodies_have(tmp_path: Path) -> None:
    """Two bodies are fixed to a link, in the other file in another order and under other names; one has another mass."""
    plate = Inertia(0.4, np.array([0.1, 0.0, 0.3]), np.diag([3e-4, 4e-4, 2e-4]))
    a = welded(tmp_path, "a.urdf", {"lower": LOWER_LINK, "cap": CAP, "plate": plate})
    heavy = plate.replace_unchecked(mass=0.5)
    for name, bodies in (
        ("order", {"lower": LOWER_LINK, "plate": heavy, "cap": CAP}),
        ("names", {"lower": LOWER_LINK, "x": CAP, "y": heavy}),
        ("exchanged", {"lower": LOWER_LINK, "plate": CAP, "x": heavy}),
        ("merged", {"lower": join_bodies([LOWER_LINK, CAP]), "x": heavy}),
    ):
        b = welded(tmp_path, f"{name}.urdf", bodies)
        ((cause, place, size),) = ((d.cause, d.place, d.size) for d in compare(a, b).differences)
        # Where all links have counterparts by name they are compared one by one.
        assert (cause, place) == ("mass", "link plate" if name == "order" else "body plate (on link lower)")
        assert size == pytest.approx(0.1, rel=1e-9)


def test_limits_that_stayed_say_no_whole_turn(tmp_path: Path) -> None:
    """An axis is reversed; that a whole turn on the limits were the same is no other zero, and no other places."""
    a, b = hand(tmp_path, "a.urdf"), tmp_path / "b.urdf"
    wide = a.read_text().replace(f'lower="{LOWER!r}" upper="{UPPER!r}"', 'lower="0.5" upper="5.783185"')
    a.write_text(wide)
    start = wide.index('name="to_finger"')
    b.write_text(wide[:start] + wide[start:].replace('xyz="0 0 1"', 'xyz="0 0 -1"'))
    ((cause, hints),) = ((d.cause, d.hints) for d in compare(a, b).differences)
    assert cause == "sign of coordinate"
    assert hints == ()


def standing(folder: Path, name: str, base: float, zero: float, way: float) -> Path:
    """The hand on a plinth; base and zero of the first joint turned about the vertical, its limits moved [rad]."""
    text = hand(folder, name).read_text().replace('"base"', '"plinth"')
    first = JOINT.format("upper", "plinth", "0 0 0.2", "0 0 0", "0 0 1", -2.0, 2.0)
    assert first in text
    turned = JOINT.format("upper", "plinth", "0 0 0.2", f"0 0 {zero!r}", "0 0 1", -2.0 + way, 2.0 + way)
    stand = '<link name="stand"/><joint name="foot" type="fixed"><parent link="stand"/><child link="plinth"/>'
    stand += f'<origin rpy="0 0 {base!r}"/></joint>'
    (folder / name).write_text(text.replace(first, stand + turned))
    return folder / name


@pytest.mark.parametrize("angle", [-math.pi, math.pi / 2, 0.3])
def test_a_base_that_turned_against_the_zero_on_it_moved_no_limits(angle: float, tmp_path: Path) -> None:
    """The first joint stands where it stood; that base and zero moved, and not its limits, shows the link that carries it."""
    a, b = hand(tmp_path, "a.urdf"), standing(tmp_path, "b.urdf", -angle, angle, -angle)
    for result in (compare(a, b), compare(b, a)):
        assert {(d.cause, d.place): d.size for d in result.differences} == {
            ("pose of base", "the machine"): pytest.approx(abs(angle), rel=1e-9),
            ("zero of coordinate", "joint to_upper"): pytest.approx(abs(angle), rel=1e-9),
        }
        assert result.judged.after <= REPAIRED


@pytest.mark.parametrize("way", [-math.pi, 0.3])
def test_limits_of_a_first_joint_that_moved_turned_no_base(way: float, tmp_path: Path) -> None:
    a, b = hand(tmp_path, "a.urdf"), standing(tmp_path, "b.urdf", 0.0, 0.0, way)
    for result in (compare(a, b), compare(b, a)):
        assert [(d.cause, d.place) for d in result.differences] == [
            ("lower limit", "joint to_upper"), ("upper limit", "joint to_upper"),
        ]  # fmt: skip


@pytest.mark.parametrize("turn", [math.pi, 0.3])
def test_a_plinth_with_another_frame_is_no_difference(turn: float, tmp_path: Path) -> None:
    """Its frame alone is turned, and the joint on it back: nothing that moves stands elsewhere or counts otherwise."""
    a, b = hand(tmp_path, "a.urdf"), standing(tmp_path, "b.urdf", -turn, turn, 0.0)
    for result in (compare(a, b), compare(b, a)):
        assert not result.differences


def test_one_of_two_bodies_may_have_a_tensor_that_no_body_has(tmp_path: Path) -> None:
    """Files of others hold such placeholders; what differs beside them is named."""
    placeholder = CAP.replace_unchecked(tensor=np.diag([4e-3, 3e-4, 2e-4]))
    moved_on = placeholder.replace_unchecked(com=np.array([0.0, 0.02, 0.06]))
    com = (0.02, 0.03, 0.1)
    a = capped(tmp_path, "a.urdf", com, merged=False, cap=placeholder)
    b = capped(tmp_path, "b.urdf", com, merged=True, cap=moved_on)
    assert [(d.cause, d.place) for d in compare(a, b).differences] == [("centre of mass", "body cap (on link lower)")]
