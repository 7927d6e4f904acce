"""Files that an MJCF names: pipes and devices are refused before MuJoCo opens them, and includes come to an end."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

pytest.importorskip("mujoco")
from crosscheck.engines.mujoco.lift import lift
from flexinv.errors import InputError

BODY = '<worldbody><body name="b"><joint/><geom size=".1"/></body></worldbody>'


def write(folder: Path, text: str, name: str = "arm.xml") -> Path:
    (folder / name).write_text(f"<mujoco>{text}</mujoco>")
    return folder / name


@pytest.mark.parametrize(
    "text",
    [
        '<include file="pipe"/>',
        '<asset><mesh name="m" file="pipe"/></asset>',
        '<compiler meshdir="sub"/><asset><mesh name="m" file="../pipe"/></asset>',
        '<asset><hfield name="h" file="pipe" size="1 1 1 1"/></asset>',
        '<asset><texture name="t" type="2d" file="pipe"/></asset>',
    ],
)
def test_a_pipe_is_refused_and_not_waited_for(text: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "sub").mkdir()
    with pytest.raises(InputError, match=r"arm\.xml.*\n  given:    .*pipe, a named pipe \(FIFO\)\n"):
        lift(write(tmp_path, text + BODY))


def test_a_pipe_in_an_included_file_is_found(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.stl")
    write(tmp_path, '<asset><mesh name="m" file="pipe.stl"/></asset>', "part.xml")
    with pytest.raises(InputError, match=r"part\.xml.*\n  given:    .*a named pipe"):
        lift(write(tmp_path, f'<include file="part.xml"/>{BODY}'))


def test_a_pipe_among_the_meshes_of_a_urdf_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "m.stl")
    mesh = '<collision><geometry><mesh filename="package://robot/m.stl"/></geometry></collision>'
    (tmp_path / "arm.urdf").write_text(f'<robot name="r"><link name="a">{mesh}</link></robot>')
    with pytest.raises(InputError, match="a named pipe"):
        lift(tmp_path / "arm.urdf")


def test_includes_come_to_an_end(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="an include of the file itself"):
        lift(write(tmp_path, f'<include file="arm.xml"/>{BODY}'))
    for k in range(30):
        two = f'<include file="./f{k + 1}.xml"/><include file="././f{k + 1}.xml"/>'
        write(tmp_path, f"<option/>{two}", f"f{k}.xml")
    write(tmp_path, "<option/>", "f30.xml")
    with pytest.raises(InputError, match="more than 1000 files that are included"):
        lift(write(tmp_path, f'<include file="f0.xml"/>{BODY}'))


def test_an_included_part_is_still_read(tmp_path: Path) -> None:
    write(tmp_path, BODY, "part.xml")
    assert [link.name for link in lift(write(tmp_path, '<include file="part.xml"/>')).mechanism.links] == ["b"]


def test_memory_that_is_not_there_is_a_refusal(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="MuJoCo refuses it"):
        lift(write(tmp_path, f'<size memory="1000000G"/>{BODY}'))
