"""Real robot files, lifted, have their readers' own dynamics: a share of ``campaigns/lifted_files.py``, and what it must see."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("mujoco")
pytest.importorskip("pinocchio")

from campaigns import lifted_files as campaign
from campaigns.lifted_judges import draw_states, judge_by_mujoco
from crosscheck.equivalence.proof import LOST, PROVEN
from crosscheck.equivalence.sources import describe
from crosscheck.lifting.description import Description
from flexinv.files.from_urdf import find_robots_folder
from flexinv.model.mechanism import Body

DATA = Path(__file__).resolve().parents[2] / "data" / "lifting"
# Arms, hands, legs, unlimited joints, mimics: every fourth URDF by size; the smallest has no links, and is refused.
URDFS = sorted(find_robots_folder().rglob("*.urdf"), key=lambda path: (path.stat().st_size, path.name))[1::4]
NAMED = ("ball_spring", "free_spring", "spring_cubic", "fluid", "gravcomp", "tendon_stiff", "tendon_armature")
RIGHT = ("pendulum", "flag_gravity", "flag_spring", "motor", "motor_rotor", "ball", "coupling_square")


@pytest.mark.parametrize("path", URDFS, ids=lambda path: path.stem)
def test_a_urdf_has_the_torques_of_pinocchio(path: Path) -> None:
    row = campaign.judge(path)
    assert row.outcome == campaign.RIGHT, campaign.line_of(row)


@pytest.mark.parametrize("name", RIGHT)
def test_an_mjcf_has_the_torques_of_mujoco(name: str) -> None:
    row = campaign.judge(DATA / f"{name}.xml")
    assert row.outcome == campaign.RIGHT, campaign.line_of(row)


@pytest.mark.parametrize("name", NAMED)
def test_what_no_mechanism_says_is_named(name: str) -> None:
    row = campaign.judge(DATA / f"{name}.xml")
    assert row.outcome == campaign.NAMED, campaign.line_of(row)


def weighed(description: Description, proof: str = PROVEN) -> campaign.Row:
    """The row of a description of the file ``pendulum.xml``, whatever it says."""
    path = DATA / "pendulum.xml"
    mechanism = campaign.bare(description.mechanism)
    states = draw_states(mechanism)
    judgement = judge_by_mujoco(path, mechanism, states)
    return campaign.weigh(campaign.Row(str(path), "", ""), description, proof, states, judgement)


def test_a_lift_that_loses_something_is_wrong() -> None:
    result = describe(DATA / "pendulum.xml")
    link = next(link for link in result.mechanism.links if link.bodies)
    body = link.bodies[0]
    heavy = replace(body.inertia, mass=body.inertia.mass * (1.0 + 1e-6))
    heavier = replace(link, bodies=(Body(body.name, heavy), *link.bodies[1:]))
    links = tuple(heavier if one is link else one for one in result.mechanism.links)
    changed = replace(result, mechanism=replace(result.mechanism, links=links))
    assert weighed(result).outcome == campaign.RIGHT
    assert weighed(changed).outcome == campaign.WRONG  # 1e-6 of the mass is 1e-6 of the torque: above 1e-9 of its range
    assert weighed(changed, LOST).outcome == campaign.INCOMPARABLE
    assert weighed(result, LOST).outcome == campaign.DOUBTED


def test_dry_friction_is_judged_by_its_number() -> None:
    result = describe(DATA / "pendulum.xml")
    joints = tuple(replace(joint, friction=joint.friction + 0.1) for joint in result.mechanism.joints)
    row = weighed(replace(result, mechanism=replace(result.mechanism, joints=joints)))
    assert row.outcome == campaign.WRONG
    assert "dry friction" in row.joint


def test_a_file_that_ends_its_process_is_a_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(campaign, "judge", lambda path, reader="": os._exit(3))
    row = campaign.judge_apart(tmp_path / "any.xml", "")
    assert row.outcome == campaign.BROKEN
    assert row.words == "its process ended with 3"


def test_what_is_refused_is_a_row_with_words(tmp_path: Path) -> None:
    path = tmp_path / "bad.urdf"
    path.write_text(
        '<robot name="x"><link name="a"/><joint name="j" type="hinge"><parent link="a"/><child link="b"/></joint></robot>'
    )
    row = campaign.judge(path)
    assert row.outcome == campaign.REFUSED
    assert str(path) in row.words
