"""Results show themselves: ten lines of text, well-formed pages with nothing foreign, pictures that are true."""

from __future__ import annotations

import copy
import pickle
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from shown_rules import SVG, check_shown

import flexinv
from flexinv.display import card as cards
from flexinv.display.card import Card, Picture, Shown
from flexinv.kinematics.mesh import build
from flexinv.kinematics.nodal_motion import compute_rigid_motion
from flexinv.kinematics.strokes import collect_strokes
from flexinv.model.mechanism import Mechanism
from flexinv.model.mechanism_card import list_outline

MODELS = sorted(path.parent.name for path in (Path(__file__).resolve().parents[3] / "models").glob("*/mechanism.toml"))
HOSTILE = "<script>alert('1')</script> & \"\x00\n\ud800\u2028" + 300 * "x"


def load(root: Path, name: str) -> Mechanism:
    """Return a mechanism of models/, or skip where its robot's package is missing."""
    try:
        return flexinv.load_mechanism(root / "models" / name)
    except flexinv.InputError as error:
        if "example_robot_data" in str(error) or "example-robot-data" in str(error):
            pytest.skip(str(error))
        raise


@pytest.mark.parametrize("name", MODELS)
def test_mechanisms_and_their_motions_show_ten_lines_and_a_picture(name: str, root: Path) -> None:
    mechanism = load(root, name)
    tree = check_shown(mechanism)
    assert tree.findall(f".//{SVG}path")
    for case in flexinv.load_cases(root / "models" / name, mechanism).values():
        check_shown(case.motion)


@pytest.mark.parametrize("name", MODELS)
def test_the_outline_is_where_the_nodes_are_with_all_joints_at_zero(name: str, root: Path) -> None:
    mechanism = replace(load(root, name), modal_damping=None)
    mesh = build(mechanism)
    zero = np.zeros((1, mechanism.nv))
    x = compute_rigid_motion(mesh, mechanism.neutral[None], zero, zero)
    tips = {
        joint.child: x.x[:, at] + x.rotation[:, at] @ mechanism.link_of[joint.child].tip
        for joint in mechanism.joints
        for at in [mesh.joint_node[joint.name]]
    }
    drawn = [line[0] for line, bends in collect_strokes(mesh, x.x, tips) if not bends]
    own = list_outline(mechanism)
    nodes = np.concatenate([np.reshape(line, (-1, 3)) for line in drawn]) if drawn else np.zeros((0, 3))
    # sums along a tree of at most some ten links, in another order: 1e-12 of the mechanism's length
    allowed = 1e-12 * mesh.length
    rigid = [line for line, bends in own if not bends]
    assert len(rigid) == len(drawn)
    for line in rigid:
        assert np.abs(nodes[:, None] - line).max(axis=2).min(axis=0).max() <= allowed
    for link in mechanism.beams:
        ends = x.x[0, mesh.section_nodes[link.name][[0, -1]]]
        lines = [line[[0, -1]] for line, bends in own if bends]
        assert min(np.abs(line - ends).max() for line in lines) <= allowed


def read_points(tree: ET.Element) -> np.ndarray:
    """Return the points of all lines of a picture, (points, 2) [px]."""
    paths = [one.get("d", "") for one in tree.iter(f"{SVG}path")]
    return np.array(re.findall(r"-?[0-9.]+", " ".join(paths)), dtype=float).reshape(-1, 2)


def test_the_picture_is_the_mechanism_to_scale(root: Path) -> None:
    """One scale and one shift take positions [m] into the picture [px], up is up, for all points alike."""
    mechanism = load(root, "rigid_3r")
    places = np.concatenate([line for line, _ in list_outline(mechanism)])
    points = read_points(ET.fromstring(mechanism._repr_html_()))
    assert len(points) == len(places)
    moved = places[:, np.ptp(places, axis=0) > 0.0]
    if moved.shape[1] == 1:  # stretched along one axis
        moved = np.column_stack([moved[:, 0], np.zeros(len(moved))])
    scale = np.ptp(points[:, 0]) / np.ptp(moved[:, 0])
    assert (
        np.abs(points - points[0] - scale * (moved - moved[0]) * [1.0, -1.0]).max() <= 0.2
    )  # printed to 0.1 px, twice


@pytest.fixture(scope="module")
def bent(root: Path) -> flexinv.Solution:
    arm = flexinv.load_mechanism(root / "models" / "flex_two_link")
    motion = flexinv.Motion.point_to_point({"joint1": 0.0, "joint2": 0.0}, {"joint1": 0.5, "joint2": 1.0}, duration=0.2)
    return flexinv.solve(arm, motion, step=2e-3, error=True)


def test_solutions_show_peaks_with_units_and_how_far_links_bend(bent: flexinv.Solution) -> None:
    tree = check_shown(bent)
    peak = abs(bent.torque[:, 0]).max()
    assert f"{peak:.4g} N m" in repr(bent)
    assert f"link2 bends by {np.linalg.norm(bent.deflection['link2'], axis=1).max():.4g} m" in repr(bent)
    assert "error bar of an effort" in repr(bent)
    assert len(tree.findall(f".//{SVG}svg")) == 2  # in motion, and torques


def test_modes_show_frequencies_and_shapes_and_solve_nothing(
    bent: flexinv.Solution, monkeypatch: pytest.MonkeyPatch
) -> None:
    modes = flexinv.natural_modes(bent.mechanism, count=4)
    steady = flexinv.steady_modes(bent.mechanism, rates={"joint1": 10.0}, count=4)

    def refuse(*_: Any) -> None:
        raise AssertionError("an error bar is solved")

    monkeypatch.setattr("flexinv.linearized.modes.compute_refined_modes", refuse)
    monkeypatch.setattr("flexinv.linearized.steady_modes.compute_refined_steady_modes", refuse)
    for found in (modes, steady):
        assert len(check_shown(found).findall(f".//{SVG}svg")) == 3
        assert all(f"{frequency:.4g}" in repr(found) for frequency in found.frequency)
        assert "[Hz]" in repr(found)
    assert "joint1 at 10 rad/s" in repr(steady)


def test_a_shape_is_drawn_at_the_instant_at_which_it_is_farthest_away(bent: flexinv.Solution) -> None:
    from flexinv.linearized.modes_card import SWING, list_shape_strokes

    steady = flexinv.steady_modes(bent.mechanism, rates={"joint1": 10.0}, count=2)
    for number in range(2):
        still, moved = (np.stack([line for line, _ in instant]) for instant in list_shape_strokes(steady, number))
        size = np.linalg.norm(np.ptp(np.vstack([steady.position, np.zeros(3)]), axis=0))
        # tips of a beam's nodes are nodes; the farthest one moves by just so much
        assert np.linalg.norm(moved - still, axis=2).max() == pytest.approx(SWING * size, rel=1e-12)


def test_hostile_names_are_only_text(root: Path) -> None:
    arm = load(root, "rigid_3r")
    links = tuple(replace(link, name=link.name + HOSTILE) for link in arm.links)
    joints = tuple(
        replace(j, name=j.name + HOSTILE, child=j.child + HOSTILE, parent=j.parent + HOSTILE * (j.parent != "world"))
        for j in arm.joints
    )
    arm = replace(arm, name=HOSTILE, title=HOSTILE, notes=(HOSTILE,), links=links, joints=joints)
    start = {joint.name: 0.0 for joint in joints}
    motion = flexinv.Motion.point_to_point(start, dict.fromkeys(start, 0.4), duration=0.2)
    solution = flexinv.solve(arm, motion, step=2e-2)
    for result in (arm, motion, solution, solution.animate()):
        assert "<script" not in result._repr_html_()
        assert "&lt;script&gt;" in result._repr_html_() or result is motion
        ET.fromstring(result._repr_html_())
    for result in (arm, motion, solution):
        check_shown(result)


def test_what_is_large_stays_short(root: Path) -> None:
    arm = load(root, "rigid_3r")
    time = np.linspace(0.0, 1.0, 20_001)
    names = tuple(joint.name for joint in arm.joints)
    motion = flexinv.Motion.from_samples(time, np.sin(7 * time)[:, None] * [0.1, 0.2, 0.3], names)
    check_shown(motion)
    check_shown(flexinv.solve(arm, motion, step=1e-4))


@pytest.mark.parametrize("name", ["Mechanism", "Motion", "Solution", "Modes", "SteadyModes"])
def test_half_made_records_say_so_and_do_not_raise(name: str) -> None:
    """A traceback or a debugger shows a record whose fields are not there yet."""
    made = object.__new__(getattr(flexinv, name))
    assert repr(made).startswith(f"<{name} that cannot be described")
    assert len(repr(made)) <= cards.TEXT_COLUMNS
    ET.fromstring(made._repr_html_())


def test_a_card_that_fails_is_seen_by_these_rules() -> None:
    class Broken(Shown):
        def _make_card(self) -> Card:
            return Card("x", draw=lambda: (Picture("<script>1</script>", "a script"),))

    with pytest.raises(AssertionError):
        check_shown(Broken())


def test_copies_and_pickles_are_equal_and_show_the_same(bent: flexinv.Solution) -> None:
    for one in (bent.mechanism, bent, flexinv.Motion.point_to_point({"a": 0.0}, {"a": 1.0}, duration=1.0)):
        for other in (copy.copy(one), copy.deepcopy(one), pickle.loads(pickle.dumps(one))):
            assert one == other
            assert repr(one) == repr(other)


def test_showing_a_mechanism_and_a_motion_loads_no_compiler_and_no_graphics(root: Path) -> None:
    program = (
        f"import sys, flexinv\narm = flexinv.load_mechanism({str(root / 'models' / 'flex_two_link')!r})\n"
        "motion = flexinv.Motion.point_to_point({'a': 0.0}, {'a': 1.0}, duration=1.0)\n"
        "for one in (arm, motion):\n    repr(one), one._repr_html_()\n"
        "assert not {'numba', 'matplotlib', 'plotly', 'IPython'} & set(sys.modules), set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True, cwd=root)


def test_a_motion_shows_its_law_exactly() -> None:
    motion = flexinv.Motion.point_to_point({"a": 1.0}, {"a": 3.0}, duration=1.0, hold=1.0)
    tree = ET.fromstring(motion._repr_html_())
    curve = next(one for one in tree.iter(f"{SVG}path") if one.get("stroke", "").startswith("#2a78"))
    points = np.array(re.findall(r"-?[0-9.]+", curve.get("d", "")), dtype=float).reshape(-1, 2)
    assert (np.diff(points[:, 1]) <= 0.0).all()  # pixels count downwards
    half = len(points) // 2  # at rest from there on
    assert np.ptp(points[half:, 1]) == 0.0
    middle = points[np.abs(points[:, 0] - (points[0, 0] + np.ptp(points[:, 0]) / 4)).argmin(), 1]
    assert middle == pytest.approx((points[0, 1] + points[-1, 1]) / 2, abs=0.2)  # half of the way in half of the time
