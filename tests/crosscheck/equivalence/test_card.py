"""A comparison shows itself: the verdict, the differences that count, what each moves, and only text of others' names."""

from __future__ import annotations

from pathlib import Path

from shown_rules import SVG, check_shown

import crosscheck

ARM = """<robot name="{name}"><link name="base"/>
<link name="lower"><inertial><origin xyz="0 0 0.2"/><mass value="{mass}"/>
<inertia ixx="0.02" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{joint}" type="revolute"><parent link="base"/><child link="lower"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="10" velocity="1"/></joint></robot>"""


def write_arm(folder: Path, name: str, mass: float, joint: str = "hip") -> Path:
    """Write a pendulum as URDF and return the file."""
    file = folder / name
    file.write_text(ARM.format(name="arm", mass=mass, joint=joint))
    return file


def test_a_comparison_shows_what_differs_with_units_and_a_bar(tmp_path: Path) -> None:
    result = crosscheck.compare(write_arm(tmp_path, "a.urdf", 2.0), write_arm(tmp_path, "b.urdf", 2.5))
    tree = check_shown(result)
    assert "Comparison of A = a.urdf with B = b.urdf: different" in repr(result)
    row = next(line for line in repr(result).splitlines() if line.strip().startswith("mass [kg]"))
    assert row.split()[2:7] == ["link", "lower", "2", "2.5", "0.5"]
    (bar,) = tree.iter(f"{SVG}rect")
    assert float(bar.get("width", "")) > 0.0


def test_equal_files_show_a_sentence(tmp_path: Path) -> None:
    result = crosscheck.compare(write_arm(tmp_path, "a.urdf", 2.0), write_arm(tmp_path, "b.urdf", 2.0))
    check_shown(result)
    assert "The same machine" in repr(result)


def test_hostile_names_of_joints_are_only_text(tmp_path: Path) -> None:
    joint = "&lt;script&gt;alert(1)&lt;/script&gt;"
    result = crosscheck.compare(
        write_arm(tmp_path, "a.urdf", 2.0, joint), write_arm(tmp_path, "b.urdf", 2.5, joint + "b")
    )
    check_shown(result)
