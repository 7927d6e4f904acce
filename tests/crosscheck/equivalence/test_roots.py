"""A machine that floats is the same one from whichever of its bodies it is told, and wherever it begins."""

from __future__ import annotations

from pathlib import Path

import pytest

import crosscheck
from crosscheck.equivalence.result import REPAIRED

pytest.importorskip("mujoco")
BODIES = {
    "pelvis": '<inertial pos="0.01 0.02 0.03" mass="5" diaginertia=".05 .06 .07"/>',
    "torso": '<inertial pos=".01 0 .15" mass="8" diaginertia=".1 .12 .08"/>',
    "arm": '<inertial pos="0 .01 -.15" mass="2" diaginertia=".02 .022 .005"/>',
    "leg": '<inertial pos=".02 0 -.2" mass="4" diaginertia=".06 .065 .01"/>',
}
ARM = f'<body name="arm" pos="0 .2 .3" euler="0 20 0"><joint name="shoulder" axis="0 1 0"/>{BODIES["arm"]}</body>'
LEG = f'<body name="leg" pos="0 .1 -.1" euler="10 0 0"><joint name="hip" axis="0 1 0" range="-90 30"/>{BODIES["leg"]}</body>'
WAIST = 'range="-60 45" damping="0.5" armature="0.1"'
FROM_PELVIS = f"""<mujoco><worldbody><body name="pelvis" pos="0.1 0 0"><freejoint/>{BODIES["pelvis"]}{LEG}
  <body name="torso" pos="0 0 .2"><joint name="waist" axis="0 0 1" {WAIST}/>{BODIES["torso"]}{ARM}</body>
</body></worldbody></mujoco>"""
# The pelvis hangs on the torso: its joint stands where it stood, and its axis points the other way.
FROM_TORSO = f"""<mujoco><worldbody><body name="torso" pos="0 0 1"><freejoint/>{BODIES["torso"]}{ARM}
  <body name="pelvis" pos="0 0 -.2"><joint name="waist" pos="0 0 .2" axis="0 0 -1" {WAIST}/>{BODIES["pelvis"]}{LEG}</body>
</body></worldbody></mujoco>"""
RIGID = ["rigid", "drive", "limits"]


def both(folder: Path, *edits: tuple[str, str]) -> tuple[Path, Path]:
    text = FROM_TORSO
    for before, after in edits:
        assert before in text
        text = text.replace(before, after)
    (folder / "a.xml").write_text(FROM_PELVIS)
    (folder / "b.xml").write_text(text)
    return folder / "a.xml", folder / "b.xml"


def test_another_root_is_a_convention(tmp_path: Path) -> None:
    comparison = crosscheck.compare(*both(tmp_path))
    assert {(d.family, d.cause) for d in comparison.differences} == {
        ("convention", "root"),
        ("convention", "pose at zero"),
    }
    assert comparison.judged.before <= REPAIRED
    assert crosscheck.compare(*both(tmp_path), judge=RIGID).equal


@pytest.mark.parametrize(
    ("before", "after", "cause", "place", "size"),
    [
        ('mass="5"', 'mass="5.5"', "mass", "link pelvis", 0.5),
        ('pos=".01 0 .15"', 'pos=".01 .03 .15"', "centre of mass", "link torso", 0.03),
        ('pos="0 0 .2" axis="0 0 -1"', 'pos="0 .04 .2" axis="0 0 -1"', "position of joint", "joint waist", 0.04),
        ('damping="0.5"', 'damping="0.75"', "damping", "joint waist", 0.25),
    ],
)
def test_what_differs_is_named_from_another_root_too(
    before: str, after: str, cause: str, place: str, size: float, tmp_path: Path
) -> None:
    comparison = crosscheck.compare(*both(tmp_path, (before, after)), judge=RIGID)
    named = {(d.cause, d.place): d.size for d in comparison.differences}
    assert (cause, place) in named
    assert named[cause, place] == pytest.approx(size, rel=1e-9)
    assert comparison.judged.after <= REPAIRED
    assert (
        len(named) == 1 or cause == "position of joint"
    )  # one end of a joint moved is two distances: it and what hangs there


def test_numbers_in_frames_that_a_file_has_not_are_not_told(tmp_path: Path) -> None:
    """Told from the pelvis, the torso of B has its frame at the waist: B's file has another, so only A's number is written."""
    comparison = crosscheck.compare(*both(tmp_path, ('pos=".01 0 .15"', 'pos=".01 .03 .15"')))
    written = [line for place, lines in comparison.advice if place == "centre of mass of link torso" for line in lines]
    assert [line.partition(" (")[0] for line in written] == ["to make A"]


def test_a_ball_between_is_left_where_it_is(tmp_path: Path) -> None:
    """Three coordinates of a ball count in the frame of the link that it carries: turned about they are others."""
    ball = ('axis="0 0 -1" range="-60 45"', 'type="ball"')
    comparison = crosscheck.compare(*both(tmp_path, ball))
    assert "root" not in {d.cause for d in comparison.differences}
    assert ("kind of joint", "joint waist") in {(d.cause, d.place) for d in comparison.differences}


URDF = """<robot name="m"><link name="pelvis"><inertial><origin xyz="0.01 0.02 0.03"/><mass value="5"/>
    <inertia ixx=".05" ixy="0" ixz="0" iyy=".06" iyz="0" izz=".07"/></inertial></link></robot>"""


def test_a_urdf_does_not_say_where_it_begins(tmp_path: Path) -> None:
    (tmp_path / "a.urdf").write_text(URDF)
    for pose in ('pos="0 0 0.5"', 'pos="0 0 0.5" euler="0 0 90"'):
        text = (
            f'<mujoco><worldbody><body name="pelvis" {pose}><freejoint/>{BODIES["pelvis"]}</body></worldbody></mujoco>'
        )
        (tmp_path / "b.xml").write_text(text)
        assert crosscheck.compare(tmp_path / "a.urdf", tmp_path / "b.xml").equal
