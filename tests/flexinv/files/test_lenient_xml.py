"""XML that the standard forbids and other readers take: read, and said; what is broken stays an error."""

from __future__ import annotations

from pathlib import Path

import pytest

import flexinv
from flexinv.errors import InputError
from flexinv.files.from_urdf import list_xml_repairs, read_xml
from flexinv.files.lenient_xml import replace_invalid_xml

ARM = """<robot name="r">{}<link name="base"/><link name="a"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="revolute"><parent link="base"/><child link="a"/><limit lower="-1" upper="1" effort="1" velocity="1"/>
</joint>
</robot>"""
DRAKE = '<transmission><actuator name="m"><drake:gear_ratio value="50"/></actuator></transmission>'


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("<!-- left --- right -->", ["line 1: -- within a comment"]),
        ("\n<!-- a -- b\n---->", ["line 2: -- within a comment"]),
        (DRAKE, ['prefix drake: without xmlns:drake="http://drake.mit.edu"']),
        ('<material name="m" rviz:own="1"/>', ['prefix rviz: without xmlns:rviz="undeclared:rviz"']),
        (
            "<!-- -- drake:x -->" + DRAKE,
            ["line 1: -- within a comment", 'prefix drake: without xmlns:drake="http://drake.mit.edu"'],
        ),
    ],
)
def test_what_others_read_is_read_and_said(more: str, words: list[str], tmp_path: Path) -> None:
    path = tmp_path / "r.urdf"
    path.write_text(ARM.format(more))
    assert [joint.name for joint in flexinv.from_urdf(path).joints if joint.nv] == ["j"]
    assert list_xml_repairs(path) == words


def test_prefixes_get_the_address_that_readers_know(tmp_path: Path) -> None:
    path = tmp_path / "r.urdf"
    path.write_text(ARM.format(DRAKE))
    assert read_xml(path).find(".//{http://drake.mit.edu}gear_ratio") is not None


@pytest.mark.parametrize(
    "more", ["", "<!-- a - b -->", '<!-- drake:x --><material name="a:b"/>', "<note><![CDATA[<!-- a -- b -->]]></note>"]
)
def test_what_is_right_stays_as_it_is(more: str, tmp_path: Path) -> None:
    data = ARM.format(more).encode()
    assert replace_invalid_xml(data) == (data, [])


@pytest.mark.parametrize("more", ["<link>", "<!-- a -- b --><link>", "<a & b/>", "<!-- never ends"])
def test_what_is_broken_stays_an_error(more: str, tmp_path: Path) -> None:
    path = tmp_path / "r.urdf"
    path.write_text(ARM.format(more))
    with pytest.raises(InputError, match="does not parse"):
        read_xml(path)
