"""One robot told twice is the same machine, and a fault beside is named alone: a share of `campaigns/same_robot.py`."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("pinocchio")
pytest.importorskip("mujoco")
import same_robot
from machines import machine
from retelling import base_moved, move_frames, recounted, split_links, told_first
from same_robot import faults, outcomes

from crosscheck.engines.mujoco.export import build_mjcf
from crosscheck.engines.shared.urdf_text import write_urdf
from crosscheck.equivalence.compare import compare
from crosscheck.equivalence.result import REPAIRED
from flexinv.model.mechanism import Placement

# Every kind of change is in one of them, held and floating robots, and trees of all kinds of joint in all formats.
PAIRS = (0, 2, 5, 9, 14, 33, 35, 37, 43, 47, 51, 53, 55, 57)


@pytest.mark.parametrize("number", PAIRS)
def test_one_robot_told_twice_is_the_same_machine(number: int) -> None:
    for one in outcomes([number]):
        assert one.comparison is not None, one.words
        assert one.named == []
        assert one.same


def test_a_fault_on_top_is_named_alone() -> None:
    for one in islice(faults(6), 6):
        assert one.told, one.pair.fault
        assert one.false == []


@pytest.mark.parametrize(("seed", "number"), [(4711, 75), (90210, 74)])
def test_pairs_of_other_seeds_are_the_same_machine(seed: int, number: int) -> None:
    """Pairs that once were refused, or had limits named: a body that is none is not split, a base turned against a zero on it."""
    (one,) = outcomes([number], seed=seed)
    assert one.same, one.named


@pytest.mark.parametrize(("seed", "number"), [(4711, 50), (90210, 16), (90210, 93)])
def test_faults_of_other_seeds_are_named_alone(seed: int, number: int) -> None:
    """Bodies that are split otherwise, bodies of the same names in turned frames, the zero of a screw: each once named more."""
    (one,) = outcomes([number], True, seed)
    assert one.told, one.words
    assert one.false == []


def test_what_the_judge_refuses_is_counted_and_stops_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> float:
        raise RuntimeError("The 3d inertia should be positive.")

    monkeypatch.setattr(same_robot, "disagreement", refuse)
    (one,) = outcomes([0])
    assert one.refused
    assert not one.same
    assert one.words.endswith("should be positive.")


def test_a_body_that_no_body_can_be_is_not_split() -> None:
    """A part of it could be one as little; the antennas of this robot are such bodies, its arms are none."""
    told = told_first(machine("tiago_description/robots/tiago_no_hand.urdf"))
    tried = [split_links(told, np.random.default_rng(seed)) for seed in range(8)]
    names = {link.name for one in tried for link in one.mechanism.links}
    assert {"base_antenna_left_link", "arm_1_link_part"} <= names
    assert not {"base_antenna_left_link_part", "base_antenna_right_link_part"} & names


@pytest.mark.parametrize("offset", [np.pi, -np.pi, 1.0, 3 * np.pi, -4.0, 2 * np.pi])
def test_the_zero_of_a_screw_is_told_with_its_turns(offset: float) -> None:
    """Half a turn to either side is one frame's turn, but the nut stands half a pitch up or down."""
    first = machine("tree 1")
    screw = next(joint for joint in first.joints if joint.kind == "helical")
    second = recounted(told_first(first), {screw.name: (1.0, offset)}).mechanism
    comparison = compare(first, second)
    assert {(d.cause, d.place): d.size for d in comparison.differences} == {
        ("zero of coordinate", f"joint {screw.name}"): pytest.approx(abs(offset), rel=1e-9)
    }
    assert comparison.judged.after <= REPAIRED


def test_a_screw_that_stands_elsewhere_has_no_other_zero() -> None:
    first = machine("tree 1")
    screw = next(joint for joint in first.joints if joint.kind == "helical")
    for way in (0.05, 0.45):
        at = screw.placement.position + way * screw.pitch * screw.placement.rotation @ np.cross(
            screw.axis, [0.6, 0, 0.8]
        )
        moved = replace(screw, placement=replace(screw.placement, position=at))
        joints = tuple(moved if joint is screw else joint for joint in first.joints)
        ((cause, place),) = ((d.cause, d.place) for d in compare(first, replace(first, joints=joints)).differences)
        assert (cause, place) == ("position of joint", f"joint {screw.name}")


def ur5(folder: Path, quarters: int, digits: int | None = None) -> tuple[Path, Path]:
    """A UR5 as a URDF, and as an MJCF with its base turned by quarters about the vertical and other frames of links.

    digits : of the numbers of the MJCF, as in files that were written by hand
    """
    first = told_first(machine("ur_description/urdf/ur5_robot.urdf"))
    turn = Rotation.from_rotvec([0.0, 0.0, np.pi / 2 * quarters]).as_matrix()
    second = move_frames(base_moved(first, Placement(rotation=turn)), np.random.default_rng(5))
    (folder / "a.urdf").write_text(write_urdf(first.mechanism))
    text = build_mjcf(second.mechanism)[1]
    if digits is not None:
        text = re.sub(r"-?\d+\.\d+(?:e-?\d+)?", lambda found: f"{float(found[0]):.{digits}f}", text)
    (folder / "b.xml").write_text(text)
    return folder / "a.urdf", folder / "b.xml"


@pytest.mark.reported("F11")
@pytest.mark.parametrize("quarters", range(4))
def test_a_turned_base_and_other_frames_are_the_same_machine(quarters: int, tmp_path: Path) -> None:
    """A link of a UR5 that is round about its joint decides nothing: nothing differs but where the base is turned to."""
    comparison = compare(*ur5(tmp_path, quarters))
    assert [(d.family, d.cause) for d in comparison.differences] == [("convention", "pose of base")] * bool(quarters)
    assert comparison.judged.before <= REPAIRED
    assert compare(tmp_path / "a.urdf", tmp_path / "b.xml", judge=["rigid", "drive", "limits"]).judged.causes == ()


def test_rounded_numbers_turn_no_sign_and_no_zero(tmp_path: Path) -> None:
    """Numbers of four digits: nowhere is it shorter to tell a turned joint than to tell what was rounded."""
    comparison = compare(*ur5(tmp_path, 0, digits=4))
    told = [*comparison.judged.causes, *comparison.judged.conventions]
    assert not [d.words for d in told if d.cause in ("sign of coordinate", "zero of coordinate") and d.size > 1e-3]
    assert not [d.words for d in told if d.unit in ("rad", "m") and d.size > 1e-3]
