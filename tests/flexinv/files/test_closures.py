"""Closures, springs, forces and starts in files: what is read, and what is said about every mistake."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from complaints import Planted, check_complaint, planted

from flexinv.errors import InputError, ModelWarning
from flexinv.files.load_cases import load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Attachment, Mechanism

GOOD = """
source = "test"
gravity_m_per_s2 = [0, -9.81, 0]

[links]
crank = { kind = "rigid", mass_kg = 0.3, rod = { length_m = 0.2 } }
coupler = { kind = "rigid", mass_kg = 0.5, rod = { length_m = 0.5 } }
rocker = { kind = "rigid", mass_kg = 0.4, rod = { length_m = 0.4 } }

[joints.A]
kind = "revolute"
parent = "world"
child = "crank"
axis = [0, 0, 1]

[joints.B]
kind = "revolute"
parent = "crank"
child = "coupler"
placement = { xyz_m = [0.2, 0, 0] }
axis = [0, 0, 1]
actuated = false
weight = 4
stiffness_Nm_per_rad = 2
rest_deg = 30

[joints.D]
kind = "revolute"
parent = "world"
child = "rocker"
placement = { xyz_m = [0.45, 0, 0] }
axis = [0, 0, 1]
actuated = false

[closures.C]
kind = "revolute"
first = { link = "coupler", xyz_m = [0.5, 0, 0], rpy_deg = [0, 0, 90] }
second = { link = "rocker", xyz_m = [0.4, 0, 0] }
axis = [0, 0, 1]
active_s = [[0.0, 0.5], [1.0, 2.0]]
capture = true
impact = "plastic"

[springs.S]
first = { link = "rocker", xyz_m = [0.1, 0, 0] }
second = { link = "world", xyz_m = [0, 0.5, 0] }
stiffness_N_per_m = 4530
rest_m = 0.08

[forces.push]
at = { link = "rocker", xyz_m = [0.4, 0, 0] }
time_s = [0, 0.5]
force_N = [[1, 0, 0], [2, 0, 0]]
moment_Nm = [0, 0, 3]
follower = true
"""
CASES = """
source = "test"
[cases.turn]
step_s = 0.01
quantities = ["torque"]
start.B = { deg = 46 }
start.D = { rad = 1.8 }
[cases.turn.motion]
duration_s = 1.0
joints.A = { from_deg = 20, to_deg = 380 }
[[limits]]
quantity = "torque"
engines = ["*"]
maximum = 1e-9
reason = "test"
"""


def load(tmp_path: Path, text: str = GOOD) -> Mechanism:
    file = tmp_path / "loop" / "mechanism.toml"
    file.parent.mkdir(exist_ok=True)
    file.write_text(text, encoding="utf-8")
    return load_mechanism(file)


def same(a: Attachment, link: str, position: list[float], turn: list[list[float]] | None = None) -> bool:
    rotation = np.eye(3) if turn is None else turn
    placed = np.array_equal(a.placement.position, position) and np.array_equal(a.placement.rotation, rotation)
    return placed and (a.link, a.station) == (link, None)


def test_what_is_read(tmp_path: Path) -> None:
    m = load(tmp_path)
    (closure,), (spring,), (force,) = m.closures, m.springs, m.forces
    assert (closure.name, closure.kind, closure.active) == ("C", "revolute", ((0.0, 0.5), (1.0, 2.0)))
    assert same(closure.first, "coupler", [0.5, 0, 0], [[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    assert same(closure.second, "rocker", [0.4, 0, 0])
    assert np.array_equal(closure.axis, [0, 0, 1])
    assert (spring.name, spring.stiffness, spring.rest, spring.damping) == ("S", 4530, 0.08, 0)
    assert same(spring.first, "rocker", [0.1, 0, 0])
    assert same(spring.second, "world", [0, 0.5, 0])
    assert (force.name, force.follower) == ("push", True)
    assert np.array_equal(force.wrench, [[1, 0, 0, 0, 0, 3], [2, 0, 0, 0, 0, 3]])
    assert np.array_equal(force.time, [0, 0.5])
    assert m.joint_of["B"].stiffness == 2
    assert m.joint_of["B"].rest == np.radians(30)
    assert m.joint_of["D"].stiffness == 0
    assert (closure.capture, closure.impact) == (True, "plastic")
    assert (m.joint_of["B"].weight, m.joint_of["D"].weight) == (4, 1)


def test_a_constant_force_needs_no_times(tmp_path: Path) -> None:
    text = GOOD.replace("time_s = [0, 0.5]\n", "").replace("[[1, 0, 0], [2, 0, 0]]", "[1, 0, 0]")
    (force,) = load(tmp_path, text).forces
    assert np.array_equal(force.wrench, [[1, 0, 0, 0, 0, 3]])
    assert np.array_equal(force.time, [0])


def test_a_slide_has_a_spring_in_metres(tmp_path: Path) -> None:
    slide = 'kind = "prismatic"\nparent = "world"\nchild = "rocker"\nstiffness_N_per_m = 5\nrest_m = -0.1\n'
    text = GOOD.replace('kind = "revolute"\nparent = "world"\nchild = "rocker"\n', slide)
    joint = load(tmp_path, text).joint_of["D"]
    assert (joint.stiffness, joint.rest) == (5, -0.1)


@pytest.mark.parametrize("kind", ["spherical", "fixed"])
def test_a_closure_without_axis(tmp_path: Path, kind: str) -> None:
    text = GOOD.replace('kind = "revolute"\nfirst', f'kind = "{kind}"\nfirst').replace(
        "axis = [0, 0, 1]\nactive", "active"
    )
    assert load(tmp_path, text).closures[0].kind == kind


def test_a_universal_closure_has_an_axis_on_either_side(tmp_path: Path) -> None:
    text = GOOD.replace('kind = "revolute"\nfirst', 'kind = "universal"\nsecond_axis = [0, 2, 0]\nfirst')
    with pytest.warns(ModelWarning, match=r"closures.C\], key second_axis: .* normalised"):
        (closure,) = load(tmp_path, text).closures
    assert np.array_equal(closure.second_axis, [0, 1, 0])


def test_a_beam_is_closed_at_a_station(tmp_path: Path) -> None:
    section = (
        "[sections.s]\nEA_N = 1e6\nGA_N = 4e5\nGJ_Nm2 = 1\nEI_Nm2 = 1\nmass_per_length_kg_per_m = 1\nrho_I_kgm = 0\n"
    )
    rod = 'coupler = { kind = "rigid", mass_kg = 0.5, rod = { length_m = 0.5 } }'
    beam = 'coupler = { kind = "beam", length_m = 0.5, section = "s" }'
    text = GOOD.replace(rod, beam) + section
    with pytest.raises(InputError, match=r"closures.C.first\], key station\n.*nothing\n.*\n.*station = 1.0"):
        load(tmp_path, text)
    at_tip = text.replace("xyz_m = [0.5, 0, 0], rpy_deg = [0, 0, 90]", "station = 1.0")
    assert load(tmp_path, at_tip).closures[0].first.station == 1.0


@pytest.mark.parametrize("case", planted("bad_closures.toml").values(), ids=planted("bad_closures.toml").keys())
def test_message(tmp_path: Path, case: Planted) -> None:
    old, new, *_ = case
    assert old in GOOD, "the case edits a text that is not there"
    with pytest.raises(InputError) as caught:
        load(tmp_path, GOOD.replace(old, new, 1))
    check_complaint(str(caught.value), tmp_path / "loop" / "mechanism.toml", case)


def start(tmp_path: Path, *edit: str) -> dict[str, object]:
    mechanism = load(tmp_path)
    text = CASES.replace(*edit) if edit else CASES
    assert not edit or text != CASES
    (tmp_path / "loop" / "cases.toml").write_text(text, encoding="utf-8")
    return dict(load_cases(tmp_path / "loop", mechanism)["turn"].start)


def test_start_of_passive_joints(tmp_path: Path) -> None:
    assert start(tmp_path) == {"B": np.radians([46.0]), "D": [1.8]}


STARTS: dict[str, Planted] = {
    "unknown joint": (
        *("start.B", "start.BB", "cases.turn.start", "BB"),
        *("a start for joint BB", "leaves out: B, D", "B instead of BB"),
    ),
    "a joint that moves": (
        *("start.B", "start.A", "cases.turn.start", "A"),
        *("A, which the motion moves", "leaves out: B, D", "no start.A"),
    ),
    "no angle": (
        *("{ deg = 46 }", "{}", "cases.turn.start.B", ""),
        *("nothing", "one of deg, rad", "{ deg = 30 }"),
    ),
    "two angles": (
        *("{ deg = 46 }", "{ deg = 46, rad = 0.8 }", "cases.turn.start.B", ""),
        *("deg and rad", "one of deg, rad", "{ deg = 30 }"),
    ),
    "a length": (
        *("{ deg = 46 }", "{ m = 0.1 }", "cases.turn.start.B", "m"),
        *("0.1", "one of deg, rad", "remove it"),
    ),
    "not a number": (
        *("{ deg = 46 }", "{ deg = nan }", "cases.turn.start.B", "deg"),
        *("nan", "[deg]", "deg = 30"),
    ),
}


@pytest.mark.parametrize("case", STARTS.values(), ids=STARTS.keys())
def test_message_about_a_start(tmp_path: Path, case: Planted) -> None:
    with pytest.raises(InputError) as caught:
        start(tmp_path, *case[:2])
    check_complaint(str(caught.value), tmp_path / "loop" / "cases.toml", case)


@pytest.mark.parametrize(
    ("kind", "keys", "value"),
    [
        ("prismatic", "m = 0.2", [0.2]),
        ("continuous", "rad = 0.5", [0.5]),
        ("universal", "deg = [90, -90]", [np.pi / 2, -np.pi / 2]),
        ("spherical", "rpy_deg = [0, 0, 90]", [0, 0, 0.5**0.5, 0.5**0.5]),
        ("free", "xyz_m = [1, 2, 3], quaternion = [0, 0, 0.6, 0.8]", [1, 2, 3, 0, 0, 0.6, 0.8]),
    ],
)
def test_start_of_every_kind(tmp_path: Path, kind: str, keys: str, value: list[float]) -> None:
    axes = {"universal": "axis = [1, 0, 0]\nsecond_axis = [0, 1, 0]\n", "spherical": "", "free": ""}
    drive = "" if kind == "free" else "actuated = false\n"
    head, tail = GOOD.split("[joints.D]")
    tail = tail[tail.index("[closures.C]") :]
    axis = axes.get(kind, "axis = [0, 0, 1]\n")
    joint = f'[joints.D]\nkind = "{kind}"\nparent = "world"\nchild = "rocker"\n{axis}{drive}'
    mechanism = load(tmp_path, head + joint + tail)
    text = CASES.replace("{ rad = 1.8 }", f"{{ {keys} }}")
    (tmp_path / "loop" / "cases.toml").write_text(text, encoding="utf-8")
    result = load_cases(tmp_path / "loop", mechanism)["turn"].start["D"]
    assert np.allclose(result, value, rtol=0, atol=1e-15)  # rounding of half angles
