"""Left and right limbs: mirrored where the structure is mirrored, or the same part twice; each number that differs is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rigid_trees import placement

from crosscheck.findings.finding import Finding
from crosscheck.linting.lint import lint
from flexinv.files.from_urdf import find_robots_folder
from flexinv.typing import Array

ALL = ("x", "y", "z")
UNTURNED = np.eye(3)
ACROSS_Y = np.diag([1.0, -1.0, 1.0])
THIGH = np.array([[0.031, 0.004, 0.002], [0.004, 0.029, 0.005], [0.002, 0.005, 0.012]])
FOOT = np.array([[0.004, 0.0008, 0.0004], [0.0008, 0.003, 0.0006], [0.0004, 0.0006, 0.002]])


def write_numbers(vector: Array) -> str:
    return " ".join(f"{x:.12g}" for x in vector)


def write_link(name: str, mass: float, com: Array, tensor: Array) -> str:
    entries = " ".join(f'i{ALL[i]}{ALL[j]}="{tensor[i, j]:.12g}"' for i in range(3) for j in range(i, 3))
    origin = f'<origin xyz="{write_numbers(com)}"/>'
    return f'<link name="{name}"><inertial>{origin}<mass value="{mass}"/><inertia {entries}/></inertial></link>'


def write_joint(parent: str, child: str, place: Array, turn: Array) -> str:
    angles = (
        np.arctan2(turn[2, 1], turn[2, 2]),
        np.arctan2(-turn[2, 0], np.hypot(turn[2, 1], turn[2, 2])),
        np.arctan2(turn[1, 0], turn[0, 0]),
    )
    return (
        f'<joint name="to_{child}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{write_numbers(place)}" rpy="{write_numbers(np.array(angles))}"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" effort="20" velocity="8"/></joint>'
    )


def write_legs(
    folder: Path,
    sides: tuple[str, str] = ("left_", "right_"),
    mirror: Array = ACROSS_Y,
    base: Array = UNTURNED,
    frame: Array = ACROSS_Y,
    centre: Array | None = None,
    tensor: Array | None = None,
) -> list[Finding]:
    """Lint two legs of three links; return what is said of left and right.

    mirror : the reflection of the structure, in the base's frame as it is before ``base`` turns it
    frame : improper, by which the right links' frames follow from the images of the left ones
    centre, tensor : of the right thigh, in its frame, where they are not the images
    """
    text = [write_link("trunk", 9.0, np.zeros(3), 0.2 * np.eye(3))]
    places = {
        "thigh": np.array([0.05, 0.1, -0.1]),
        "shank": np.array([0.01, 0.06, -0.4]),
        "foot": np.array([0.0, 0.02, -0.35]),
    }
    bodies = {
        "thigh": (3.0, np.array([0.01, 0.03, -0.18]), THIGH),
        "shank": (1.5, np.array([0.0, -0.01, -0.15]), THIGH / 4),
        "foot": (0.6, np.array([0.05, 0.012, -0.03]), FOOT),
    }
    for n, side in enumerate(sides):
        parent = "trunk"
        for k, (part, place) in enumerate(places.items()):
            mass, com, moments = bodies[part]
            if n == 0:
                placed, turn = (base @ place, base) if k == 0 else (place, np.eye(3))
            else:
                into = frame.T  # a vector of the left frame's image, in the right frame
                placed = base @ mirror @ place if k == 0 else into @ place
                turn = base @ mirror @ frame if k == 0 else np.eye(3)
                com = into @ com
                moments = into @ moments @ into.T
                if part == "thigh":
                    com = com if centre is None else centre
                    moments = moments if tensor is None else tensor
            text.append(write_link(f"{side}{part}", mass, com, moments))
            text.append(write_joint(parent, f"{side}{part}", placed, turn))
            parent = f"{side}{part}"
    (folder / "legs.urdf").write_text(f'<robot name="legs">{"".join(text)}</robot>')
    return [one for one in lint(folder / "legs.urdf").findings if one.check == "left and right"]


@pytest.mark.parametrize("sides", [("left_", "right_"), ("l_", "r_"), ("LHip", "RHip"), ("L_", "R_"), ("FL_", "FR_")])
def test_mirrored_legs_are_clean_whatever_their_names(sides: tuple[str, str], tmp_path: Path) -> None:
    assert write_legs(tmp_path, sides) == []
    assert len(write_legs(tmp_path, sides, tensor=THIGH)) == 1


@pytest.mark.parametrize("seed", range(8))
def test_the_plane_may_be_any_and_frames_may_have_other_axes(seed: int, tmp_path: Path) -> None:
    """Of mirrored limbs nothing is said, however the base is turned, and whichever axes the right frames have exchanged."""
    rng = np.random.default_rng(seed)
    frame = np.eye(3)[rng.permutation(3)] * rng.choice([-1.0, 1.0], 3)
    frame *= -np.sign(np.linalg.det(frame))
    base = placement(rng).rotation
    assert write_legs(tmp_path, base=base, frame=frame) == []
    com = frame.T @ np.array([0.01, -0.03, -0.18])
    (found,) = write_legs(tmp_path, base=base, frame=frame, centre=com)
    assert "the structure is mirrored" in found.why


def test_a_centre_that_was_copied_is_found_with_the_number_to_write(tmp_path: Path) -> None:
    (found,) = write_legs(tmp_path, centre=np.array([0.01, 0.03, -0.18]))
    assert (found.place, found.level) == ("links left_thigh, right_thigh", "warning")
    assert found.given == "centres 0.01 0.03 -0.18 and 0.01 0.03 -0.18 m"
    assert found.why.endswith("is at 0.01 -0.03 -0.18 m of right_thigh: y with the other sign")
    assert found.write == 'xyz="0.01 -0.03 -0.18" there, or the image of it in left_thigh, if they are alike'


def test_a_tensor_that_was_copied_is_found_with_its_entries(tmp_path: Path) -> None:
    """Talos says of itself "Missing reflects of inertias": y is mirrored, so ixy and iyz have the other sign."""
    (found,) = write_legs(tmp_path, tensor=THIGH)
    assert found.given == "ixy 0.004, iyz 0.005 kg m^2 of right_thigh"
    assert found.why == "the structure is mirrored, and the image of left_thigh has ixy -0.004, iyz -0.005"


def test_other_masses_and_moments_are_found_as_before(tmp_path: Path) -> None:
    (found,) = write_legs(tmp_path, tensor=2 * THIGH * np.outer([1, -1, 1], [1, -1, 1]))
    assert found.why == "their moments differ"


def test_a_part_that_is_mounted_twice_is_no_mirror_image_and_right(tmp_path: Path) -> None:
    """Two arms of one kind at the two sides of a stand: the places of their flanges are mirrored, their numbers equal."""
    text = ['<link name="stand"/>']
    for side, y in (("left", 0.3), ("right", -0.3)):
        parent = "stand"
        for part, place in (("base", [0.0, y, 0.8]), ("upper", [0.0, 0.0, 0.2]), ("lower", [0.4, 0.0, 0.0])):
            name = f"{side}_{part}"
            text.append(write_link(name, 3.0, np.array([0.02, 0.04, 0.1]), THIGH))
            text.append(write_joint(parent, name, np.array(place), np.eye(3)))
            parent = name
    (tmp_path / "stand.urdf").write_text(f'<robot name="stand">{"".join(text)}</robot>')
    assert not [one for one in lint(tmp_path / "stand.urdf").findings if one.check == "left and right"]


def test_mechanisms_of_other_formats_are_held_to_it_too(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")

    def write(name: str, sign: int, centre: float) -> str:
        foot = f'<body name="{name}_foot" pos="0 {0.05 * sign} -0.4"><joint axis="0 1 0"/>{inertial(0.0)}</body>'
        return f'<body name="{name}_leg" pos="0 {0.1 * sign} 0"><joint axis="1 0 0"/>{inertial(centre)}{foot}</body>'

    def inertial(centre: float) -> str:
        return f'<inertial pos="0 {centre} -0.2" mass="2" diaginertia="0.03 0.03 0.004"/>'

    for right, number in ((-0.03, 0), (0.03, 1)):
        text = write("left", 1, 0.03) + write("right", -1, right)
        (tmp_path / "legs.xml").write_text(f"<mujoco><worldbody>{text}</worldbody></mujoco>")
        found = [one for one in lint(tmp_path / "legs.xml").findings if one.check == "left and right"]
        assert len(found) == number, found


# What is true of these files by their text: images in which a sign is missing, or stands at the wrong entry.
KNOWN = {
    "talos_data/robots/talos_reduced.urdf": {"links arm_left_1_link, arm_right_1_link": "ixy"},
    "tiago_description/robots/tiago_dual.urdf": {
        "links arm_left_1_link, arm_right_1_link": "ixy",
        "links arm_left_4_link, arm_right_4_link": "ixy",
        "links arm_left_7_link, arm_right_7_link": "centres",
    },
    "anymal_c_simple_description/urdf/anymal.urdf": {},
    "solo_description/robots/solo12.urdf": {},
}


@pytest.mark.parametrize("name", KNOWN)
def test_robots_have_what_their_texts_have(name: str) -> None:
    try:
        file = find_robots_folder() / name
    except Exception as problem:  # the package is not installed
        pytest.skip(str(problem))
    found = [
        one for one in lint(file, meshes=False).findings if one.check == "left and right" and "mirrored, and" in one.why
    ]
    assert {one.place: one.given.split()[0] for one in found} == KNOWN[name]
