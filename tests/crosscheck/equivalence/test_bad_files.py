"""Hostile, broken and misnamed files: each is one clear error, of `compare` and of `lint`, and none of them takes long."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from arm_texts import ARM, arm
from click.testing import CliRunner

from crosscheck.cli import main
from crosscheck.equivalence.sources import describe
from flexinv.errors import InputError

DEEP = 50_000
BILLION = "<!DOCTYPE r [<!ENTITY a 'x'><!ENTITY b '&a;&a;'>]><robot name='&b;'/>"
MESHED = """<mujoco><asset><mesh name="m" file="none.stl"/></asset><worldbody><body name="b">{}<joint/>
  <geom type="mesh" mesh="m"/></body></worldbody></mujoco>"""
INERTIAL = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
FILES = {
    "entities": ("arm.urdf", BILLION, "DOCTYPE or ENTITY"),
    "names of 15 MB": ("arm.urdf", ARM.replace('"lower"', f'"{"x" * 5_000_000}"'), "a word of 5000000 characters"),
    "a number of 10 MB": ("arm.urdf", ARM.replace('"2.375"', f'"2.{"3" * 10_000_000}"'), "a word of 10000002 characters"),
    "a reference of 5 MB": ("arm.urdf", ARM.replace('child link="lower"', f'child link="{"x" * 5_000_000}"'), "a word of 5"),
    "a name of 200 characters": ("arm.urdf", ARM.replace('"lower"', f'"{"x" * 200}"'), "1 to 100 printable characters"),
    "more than the largest file": ("arm.urdf", f"<robot><!--{'x' * (17 << 20)}--></robot>", "at most"),
    "depth": ("arm.urdf", "<robot>" + "<a>" * DEEP + "</a>" * DEEP + "</robot>", "more than 500 levels"),
    "an infinite number": ("arm.urdf", ARM.replace('value="2.375"', 'value="inf"'), "lower.*mass"),
    "a loop of joints": ("arm.urdf", ARM.replace('child link="finger"', 'child link="upper"'), "2 links that no joint carries"),
    "only loops": ("arm.urdf", "<robot><link name='a'><inertial><mass value='1'/></inertial></link><joint name='j' type='fixed'>"
                   "<parent link='a'/><child link='a'/></joint></robot>", "parent and child are both"),
    "a joint twice": ("arm.urdf", ARM.replace('joint name="elbow"', 'joint name="shoulder"'), "this joint twice"),
    "no masses": ("arm.urdf", "<robot><link name='a'/></robot>", "no link with a mass"),
    "a xacro": ("arm.urdf.xacro", ARM, r"xacro arm\.urdf\.xacro > arm\.urdf"),
    "a xacro under another name": ("arm.urdf", "<robot xmlns:x='http://www.ros.org/wiki/xacro'><x:include/></robot>", "xacro"),
    "a xacro that would overwrite itself": ("arm.urdf", "<robot xmlns:x='http://www.ros.org/wiki/xacro'><x:include/></robot>",
                                            r"xacro arm\.urdf > arm\.expanded\.urdf"),
    "an expression of xacro": ("arm.urdf", ARM.replace('value="2.375"', 'value="${m}"'), "what xacro makes of this expression"),
    "a table of ours": ("arm.urdf", 'source = "us"\n', "does not begin as XML"),
    "a control character": ("arm.urdf", "<robot name='\x07'/>", "text in UTF-8"),
    "a stage under another name": ("arm.urdf", "#usda 1.0\n", "what begins as USD, under the suffix .urdf"),
    "an archive": ("arm.usdz", "PK\x03\x04 no archive", "what USD refuses"),
    "blanks": ("arm.urdf", "  \n ", "an empty file"),
    "no text": ("arm.urdf", "\x00\x01\x02", "does not parse"),
    "another format": ("arm.urdf", "<COLLADA/>", "<COLLADA>"),
    "an MJCF without bodies": ("arm.xml", "<mujoco><worldbody><geom size='1'/></worldbody></mujoco>", "a model without bodies"),
    "an MJCF with NaN": ("arm.xml", MESHED.format(INERTIAL.replace('mass="1"', 'mass="nan"')), "MuJoCo refuses it"),
    "an MJCF that no body has": ("arm.xml", MESHED.format(INERTIAL.replace("1 1 1", "1 1 9")), "MuJoCo refuses it: inertia"),
    "a table": ("arm.csv", "time,q\n0,1\n", "does not parse"),
    "a JSON that is no kit": ("case.json", "{}", "case kit"),
}  # fmt: skip


@pytest.mark.parametrize("kind", FILES)
def test_a_bad_file_is_one_clear_error(kind: str, tmp_path: Path) -> None:
    for start, package in (("an MJCF", "mujoco"), ("a stage", "pxr"), ("an archive", "pxr")):
        if kind.startswith(start):
            pytest.importorskip(package)
    name, text, words = FILES[kind]
    (tmp_path / name).write_text(text)
    begun = time.perf_counter()
    with pytest.raises(InputError, match=words) as caught:
        describe(tmp_path / name)
    assert len(str(caught.value)) < 3000
    assert time.perf_counter() - begun < 60  # a guard, not a measurement
    run = CliRunner().invoke(main, ["compare", str(tmp_path / name), str(arm(tmp_path, name="good.urdf"))])
    assert run.exit_code == 2
    assert "Traceback" not in run.output


@pytest.mark.parametrize("kind", FILES)
def test_lint_finds_it_or_refuses_it(kind: str, tmp_path: Path) -> None:
    name, text, _ = FILES[kind]
    (tmp_path / name).write_text(text)
    run = CliRunner().invoke(main, ["lint", str(tmp_path / name)])
    assert run.exit_code in (1, 2)
    assert "Traceback" not in run.output
    assert len(run.output) < 20_000  # what is told is short, however long the file's words are


def test_missing_meshes_matter_where_masses_come_from_them(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    (tmp_path / "stated.xml").write_text(MESHED.format(INERTIAL))
    assert any("does not find it" in words for words in describe(tmp_path / "stated.xml").dropped)
    (tmp_path / "shaped.xml").write_text(MESHED.format(""))
    with pytest.raises(InputError, match="put the mesh where the file says"):
        describe(tmp_path / "shaped.xml")


def test_a_suffix_of_another_format_is_told(tmp_path: Path) -> None:
    for suffix in ("usda", "sdf", "mjcf", "toml", "json"):
        file = arm(tmp_path, name=f"arm.{suffix}")
        assert f"suffix .{suffix}: the file is URDF, and is read as that" in describe(file).dropped
    assert not any("suffix" in words for words in describe(arm(tmp_path, name="arm.xml")).dropped)
