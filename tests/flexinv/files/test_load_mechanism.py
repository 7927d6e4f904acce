"""Mechanism files: what the keys mean, formulas of sections and shapes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexinv.analysis.statics import Load, statics
from flexinv.errors import InputError
from flexinv.files.joints import JOINT_TABLES, compute_rpy_rotation
from flexinv.files.load_mechanism import load_mechanism
from flexinv.files.sections import compute_rectangle_torsion
from flexinv.files.toml_tables import Table, make_optional_key
from flexinv.files.values import convert_number, find_correction, split_unit
from flexinv.model.joint_kinds import KINDS as COORDINATES
from flexinv.model.links import describe_impossible_inertia
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array
from flexinv.validation import find_nearest_word

HEAD = 'source = "test"\ngravity_m_per_s2 = [0, 0, 0]\n'
BASE = '[joints.base]\nkind = "fixed"\nparent = "world"\nchild = "link"\n'


def load(tmp_path: Path, text: str) -> Mechanism:
    file = tmp_path / "models" / "arm" / "mechanism.toml"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text, encoding="utf-8")
    return load_mechanism(file.parent)


def inertia_of(tmp_path: Path, keys: str) -> tuple[float, Array, Array]:
    link = load(tmp_path, f'{HEAD}[links.link]\nkind = "rigid"\n{keys}\n{BASE}').links[0]
    inertia = link.bodies[0].inertia
    return inertia.mass, inertia.com, inertia.tensor


@pytest.mark.parametrize(
    ("keys", "com", "moments"),
    [
        ("rod = { length_m = 0.6 }", [0.3, 0, 0], [0, 0.06, 0.06]),
        ("rod = { length_m = 0.6, axial_inertia_kgm2 = 1e-3 }", [0.3, 0, 0], [1e-3, 0.06, 0.06]),
        ("com_m = [0, 0, 1]\nbox = { size_m = [0.3, 0.6, 0.9] }", [0, 0, 1], [0.195, 0.15, 0.075]),
        ("cylinder = { length_m = 0.6, radius_m = 0.2 }", [0.3, 0, 0], [0.04, 0.08, 0.08]),
        ('cylinder = { length_m = 0.6, radius_m = 0.2, along = "z" }', [0, 0, 0.3], [0.08, 0.08, 0.04]),
        ('rod = { length_m = 0.6, along = "y" }', [0, 0.3, 0], [0.06, 0, 0.06]),
        ("com_m = [0, 0, 0]\nsphere = { radius_m = 0.5 }", [0, 0, 0], [0.2, 0.2, 0.2]),
        ("com_m = [0, 0, 0]\ninertia_kgm2 = 0", [0, 0, 0], [0, 0, 0]),
    ],
)
def test_shapes(tmp_path: Path, keys: str, com: list[float], moments: list[float]) -> None:
    """Textbook moments of a body of 2 kg; 1e-15 is rounding of numbers below 1."""
    mass, centre, tensor = inertia_of(tmp_path, f"mass_kg = 2\n{keys}")
    assert mass == 2
    assert np.array_equal(centre, com)
    assert np.abs(tensor - np.diag(moments)).max() < 1e-15


def test_tip_is_the_far_end_unless_stated(tmp_path: Path) -> None:
    text = f'{HEAD}[links.link]\nkind = "rigid"\nmass_kg = 1\nrod = {{ length_m = 0.6, along = "z" }}\n'
    assert np.array_equal(load(tmp_path, text + BASE).links[0].tip, [0, 0, 0.6])
    assert np.array_equal(load(tmp_path, text + "tip_m = [1, 2, 3]\n" + BASE).links[0].tip, [1, 2, 3])


def test_two_ways_to_write_an_inertia(tmp_path: Path) -> None:
    by_name = "inertia_kgm2 = { xx = 1, yy = 2, zz = 2.5, xy = 0.1, xz = 0.2, yz = 0.3 }"
    by_rows = "inertia_kgm2 = [[1, 0.1, 0.2], [0.1, 2, 0.3], [0.2, 0.3, 2.5]]"
    first = inertia_of(tmp_path, f"mass_kg = 1\ncom_m = [0, 0, 0]\n{by_name}")[2]
    assert np.array_equal(first, inertia_of(tmp_path, f"mass_kg = 1\ncom_m = [0, 0, 0]\n{by_rows}")[2])


def test_every_cloud_of_masses_has_a_possible_inertia() -> None:
    """The inertia of any particles passes, whatever the frame; taken off by a thousandth too much it does not."""
    rng = np.random.default_rng(3)
    for _ in range(50):
        points = rng.normal(size=(2, 3)) if rng.random() < 0.5 else rng.normal(size=(6, 3))  # a line, or a cloud
        tensor = sum(p @ p * np.eye(3) - np.outer(p, p) for p in points - points.mean(axis=0))
        assert describe_impossible_inertia(tensor) == ""
        moments, axes = np.linalg.eigh(tensor)
        moments[2] = (moments[0] + moments[1]) * 1.001
        assert "exceeds the sum" in describe_impossible_inertia((axes * moments) @ axes.T)


@pytest.mark.parametrize(
    ("ratio", "factor"), [(1.0, 0.1406), (1.5, 0.1958), (2.0, 0.2287), (3.0, 0.2633), (10.0, 0.3123), (1e4, 0.3333)]
)
def test_torsion_of_a_rectangle(ratio: float, factor: float) -> None:
    """J = factor a b^3 as tabulated by Timoshenko and Goodier to three or four digits."""
    assert compute_rectangle_torsion(ratio * 0.02, 0.02) == pytest.approx(
        factor * ratio * 0.02**4, abs=1e-4 * ratio * 0.02**4
    )
    assert compute_rectangle_torsion(0.02, ratio * 0.02) == compute_rectangle_torsion(ratio * 0.02, 0.02)


def section_of(tmp_path: Path, keys: str) -> tuple[Array, float, Array]:
    text = f'{HEAD}[sections.s]\n{keys}\n[links.link]\nkind = "beam"\nlength_m = 1\nsection = "s"\n{BASE}'
    beam = load(tmp_path, text).links[0].beam
    assert beam is not None
    return beam.section.stiffness[0], float(beam.section.mass_per_length[0]), beam.section.rotary_inertia[0]


MATERIAL = "E_Pa = 200e9\nnu = 0.25\nrho_kg_per_m3 = 8000\n"
G = 80e9


def test_rectangle(tmp_path: Path) -> None:
    """EI_z bends in x-y: it grows with the cube of the size along y."""
    stiffness, mass, rotary = section_of(tmp_path, f'shape = "rectangle"\nsize_y_m = 0.01\nsize_z_m = 0.03\n{MATERIAL}')
    a, iy, iz = 3e-4, 0.01 * 0.03**3 / 12, 0.03 * 0.01**3 / 12
    k = 10 * 1.25 / (12 + 11 * 0.25)
    torsion = 0.2633 * 0.03 * 0.01**3
    expected = [200e9 * a, k * G * a, k * G * a, G * torsion, 200e9 * iy, 200e9 * iz]
    # 2e-4: the table's factor 0.2633 of the torsion constant has four digits
    assert np.allclose(stiffness, expected, rtol=2e-4, atol=0)
    assert mass == pytest.approx(2.4, rel=1e-14)
    assert np.allclose(rotary, 8000 * np.array([iy + iz, iy, iz]), rtol=1e-14, atol=0)


def test_circle_and_tube(tmp_path: Path) -> None:
    """A tube is the difference of two circles, in everything but the shear factor; a full one is a circle."""

    def circle(d: float) -> Array:
        return section_of(tmp_path, f'shape = "circle"\ndiameter_m = {d}\nshear_factor = 1\n{MATERIAL}')[0]

    tube = f'shape = "tube"\nouter_diameter_m = 0.05\nwall_m = 0.01\n{MATERIAL}'
    hollow = section_of(tmp_path, tube + "shear_factor = 1")[0]
    assert np.allclose(hollow, circle(0.05) - circle(0.03), rtol=1e-13, atol=0)
    full = section_of(tmp_path, tube.replace("wall_m = 0.01", "wall_m = 0.025"))[0]
    cowper = section_of(tmp_path, f'shape = "circle"\ndiameter_m = 0.05\n{MATERIAL}')[0]
    assert np.allclose(full, cowper, rtol=1e-14, atol=0)
    assert cowper[1] / circle(0.05)[1] == pytest.approx(6 * 1.25 / (7 + 6 * 0.25), rel=1e-14)


def test_thin_tube_has_cowpers_shear_factor(tmp_path: Path) -> None:
    """Cowper: 2 (1 + nu) / (4 + 3 nu) for a wall that is thin; here it is 1e-4 of the diameter."""
    thin = f'shape = "tube"\nouter_diameter_m = 0.1\nwall_m = 1e-5\n{MATERIAL}'
    ratio = section_of(tmp_path, thin)[0][1] / section_of(tmp_path, thin + "shear_factor = 1")[0][1]
    assert ratio == pytest.approx(2.5 / 4.75, rel=1e-3)


def test_shear_modulus_instead_of_poissons_ratio(tmp_path: Path) -> None:
    by_nu = f'shape = "circle"\ndiameter_m = 0.05\n{MATERIAL}'
    by_g = by_nu.replace("nu = 0.25", "G_Pa = 80e9")
    assert np.allclose(section_of(tmp_path, by_nu)[0], section_of(tmp_path, by_g)[0], rtol=1e-14, atol=0)


NUMBERS = "EA_N = 1\nGA_N = 2\nGJ_Nm2 = 3\nEI_Nm2 = { y = 4, z = 5 }\nmass_per_length_kg_per_m = 6\n"


@pytest.mark.parametrize(
    ("stated", "read"),
    [("{ y = 1, z = 2 }", [3, 1, 2]), ("{ x = 7, y = 1, z = 2 }", [7, 1, 2]), ("2", [4, 2, 2]), ("0", [0, 0, 0])],
)
def test_section_by_numbers(tmp_path: Path, stated: str, read: list[float]) -> None:
    stiffness, mass, rotary = section_of(tmp_path, f"{NUMBERS}rho_I_kgm = {stated}")
    assert np.array_equal(stiffness, [1, 2, 2, 3, 4, 5])
    assert mass == 6
    assert np.array_equal(rotary, read)


BEAM = (
    f"{HEAD}[sections.a]\n{NUMBERS}rho_I_kgm = 0\n[sections.b]\n{NUMBERS.replace('6', '12')}rho_I_kgm = 1\n"
    '[links.link]\nkind = "beam"\nlength_m = 2\nsection = [{ at = 0, section = "a" }, { at = 1, section = "b" }]\n'
    "elements = 3\norder = 2\ncurvature_per_m = { twist = 0.1, z = 0.5 }\nroot = { xyz_m = [0.1, 0, 0] }\n"
    '[[links.link.payload]]\nname = "motor"\nstation = 0\nmass_kg = 1\ncom_m = [0, 0, 0]\ninertia_kgm2 = 0\n'
)


def test_beam_of_varying_section(tmp_path: Path) -> None:
    link = load(tmp_path, BEAM + BASE).links[0]
    beam = link.beam
    assert beam is not None
    assert (beam.length, beam.elements, beam.order) == (2, 3, 2)
    assert np.array_equal(beam.section.stations, [0, 1])
    assert np.array_equal(beam.section.mass_per_length, [6, 12])
    assert np.array_equal(beam.curvature, [0.1, 0, 0.5])
    assert np.array_equal(beam.placement.position, [0.1, 0, 0])
    assert [(body.name, body.station) for body in link.bodies] == [("motor", 0)]


def tapered(tmp_path: Path, first: str, last: str) -> Mechanism:
    """A beam of 2 m between two sections of aluminium."""
    sections = f"[sections.a]\n{first}\n{MATERIAL}[sections.b]\n{last}\n{MATERIAL}"
    along = 'section = [{ at = 0, section = "a" }, { at = 1, section = "b" }]\nelements = 4\norder = 12\n'
    return load(tmp_path, f'{HEAD}{sections}\n[links.link]\nkind = "beam"\nlength_m = 2\n{along}{BASE}')


def test_a_round_taper_bends_as_it_should(tmp_path: Path) -> None:
    """Diameter D at the root, d at the tip under a force F: 64 F L^3 / (3 pi E D^3 d); interpolated EI gave about half of it."""
    m = tapered(tmp_path, 'shape = "circle"\ndiameter_m = 0.02', 'shape = "circle"\ndiameter_m = 0.004')
    beam = m.links[0].beam
    assert beam is not None
    young = beam.section.stiffness[0, 0] / (np.pi * 0.02**2 / 4)
    bend = statics(m, [Load("link", force=[0, 1e-3, 0])]).deflection["link"][0, 1]
    exact = 64 * 1e-3 * 2.0**3 / (3 * np.pi * young * 0.02**3 * 0.004)
    assert bend == pytest.approx(exact, rel=1e-4)  # shear of a rod a hundred diameters long is 6e-5 of it


@pytest.mark.parametrize(
    ("first", "last", "middle"),
    [
        ("rectangle|size_y_m = 0.02|size_z_m = 0.03", "rectangle|size_y_m = 0.004|size_z_m = 0.01",
         "rectangle|size_y_m = 0.012|size_z_m = 0.02"),
        ("tube|outer_diameter_m = 0.06|wall_m = 0.003", "tube|outer_diameter_m = 0.03|wall_m = 0.002",
         "tube|outer_diameter_m = 0.045|wall_m = 0.0025"),
    ],
)  # fmt: skip
def test_halfway_along_a_taper_is_the_shape_of_half_the_way(tmp_path: Path, first: str, last: str, middle: str) -> None:
    keys = ["shape = " + f'"{text.split("|")[0]}"\n' + "\n".join(text.split("|")[1:]) for text in (first, last, middle)]
    beam = tapered(tmp_path, *keys[:2]).links[0].beam
    assert beam is not None
    s = beam.section
    stiffness, mass, _ = section_of(tmp_path, f"{keys[2]}\n{MATERIAL}")
    result = [np.interp(0.5, s.stations, column) for column in s.stiffness.T]
    assert result == pytest.approx(stiffness.tolist(), rel=1e-5)
    assert np.interp(0.5, s.stations, s.mass_per_length) == pytest.approx(mass, rel=1e-5)
    # between the stations, too, what is linear is the taper
    at = (s.stations[:-1] + s.stations[1:]) / 2
    widths = [float(text.split("|")[2].split("=")[1]) for text in (first, last)]
    if first.startswith("rectangle"):
        y = 0.02 + at * (0.004 - 0.02)
        z = widths[0] + at * (widths[1] - widths[0])
        young = s.stiffness[0, 0] / (0.02 * 0.03)
        np.testing.assert_allclose(np.interp(at, s.stations, s.stiffness[:, 5]), young * z * y**3 / 12, rtol=1.01e-5)


def test_sections_by_numbers_and_of_two_shapes_stay_linear(tmp_path: Path) -> None:
    m = tapered(
        tmp_path, 'shape = "circle"\ndiameter_m = 0.02', 'shape = "rectangle"\nsize_y_m = 0.01\nsize_z_m = 0.01'
    )
    beam = m.links[0].beam
    assert beam is not None
    assert np.array_equal(beam.section.stations, [0, 1])


def test_several_joints_along_one_link_in_the_order_of_the_file(tmp_path: Path) -> None:
    parts = "".join(
        f'[links.{name}]\nkind = "rigid"\nmassless = true\n'
        f'[joints.to_{name}]\nkind = "fixed"\nparent = "{parent}"\nchild = "{name}"\n{station}\n'
        for name, parent, station in [
            ("z", "link", "station = 0.5"), ("leaf", "z", ""), ("b", "link", "station = 1"), ("a", "world", ""),
        ]
    )  # fmt: skip
    mechanism = load(tmp_path, BEAM + parts + BASE)
    assert [joint.name for joint in mechanism.joints] == ["to_a", "base", "to_z", "to_leaf", "to_b"]
    assert [link.name for link in mechanism.links] == [joint.child for joint in mechanism.joints]
    assert mechanism.joint_of["to_z"].station == 0.5


KINDS = {
    "revolute": "axis = [0, 0, 1]\nlimits = { effort_Nm = 1, velocity_rad_per_s = 2, lower_rad = -3, upper_rad = 4 }",
    "continuous": "axis = [0, 1, 0]\nrotor_inertia_kgm2 = 1\ndamping_Nms_per_rad = 2\nfriction_Nm = 3",
    "prismatic": "axis = [1, 0, 0]\nrotor_inertia_kg = 1\ndamping_Ns_per_m = 2\nfriction_N = 3",
    "helical": "axis = [0, 0, 1]\npitch_m = -0.005\nrotor_inertia_kgm2 = 1\ndamping_Nms_per_rad = 2\nfriction_Nm = 3",
    "universal": "axis = [1, 0, 0]\nsecond_axis = [0, 1, 0]\nactuated = false",
    "spherical": "damping_Nms_per_rad = 2",
    "fixed": "",
    "free": "",
}


@pytest.mark.parametrize("kind", list(COORDINATES))
def test_every_kind_of_joint(tmp_path: Path, kind: str) -> None:
    assert set(KINDS) == set(JOINT_TABLES) == set(COORDINATES)
    link = '[links.link]\nkind = "rigid"\nmassless = true\n'
    joint = load(tmp_path, HEAD + link + BASE.replace("fixed", kind) + KINDS[kind]).joints[0]
    assert joint.kind == kind
    assert joint.actuated is (kind not in ("universal", "fixed", "free"))
    assert joint.pitch == (-0.005 if kind == "helical" else 0.0)
    if kind in ("continuous", "prismatic", "helical"):
        assert (joint.rotor_inertia, joint.damping, joint.friction) == (1, 2, 3)
    if kind == "revolute":
        assert (joint.limits.effort, joint.limits.velocity, joint.limits.lower, joint.limits.upper) == (1, 2, -3, 4)
    if kind == "universal":
        assert np.array_equal(joint.second_axis, [0, 1, 0])


def test_a_screw_without_pitch_is_refused(tmp_path: Path) -> None:
    link = '[links.link]\nkind = "rigid"\nmassless = true\n'
    text = HEAD + link + BASE.replace("fixed", "helical") + "axis = [0, 0, 1]\npitch_m = 0"
    with pytest.raises(InputError, match=r"(?s)key pitch_m.*a pitch other than zero \[m\].*kind = \"revolute\""):
        load(tmp_path, text)


def test_roll_pitch_yaw_are_urdfs() -> None:
    rng = np.random.default_rng(5)
    for rpy in rng.uniform(-4, 4, (20, 3)):
        expected = Rotation.from_euler("xyz", rpy).as_matrix()  # extrinsic, about fixed axes
        assert np.abs(compute_rpy_rotation(rpy) - expected).max() < 1e-15 * 4  # products of three rounded factors


def test_quarter_turns_in_degrees_are_exact(tmp_path: Path) -> None:
    text = HEAD + '[links.link]\nkind = "rigid"\nmassless = true\n' + BASE + "placement = { rpy_deg = [90, 0, -90] }"
    assert np.array_equal(load(tmp_path, text).joints[0].placement.rotation, [[0, 0, -1], [-1, 0, 0], [0, 1, 0]])


@pytest.mark.parametrize(
    ("key", "parts"),
    [
        ("length_m", ("length", "m")),
        ("mass_per_length_kg_per_m", ("mass_per_length", "kg_per_m")),
        ("rho_kg_per_m3", ("rho", "kg_per_m3")),
        ("EI_Nm2", ("EI", "Nm2")),
        ("elements", ("elements", "")),
    ],
)
def test_unit_of_a_key(key: str, parts: tuple[str, str]) -> None:
    assert split_unit(key) == parts


def test_conversion_of_units() -> None:
    assert convert_number(400, "mm", "m") == 0.4
    assert convert_number([90, 180], "deg", "rad") == [
        pytest.approx(np.pi / 2, rel=1e-11),
        pytest.approx(np.pi, rel=1e-11),
    ]
    assert convert_number({"y": 1}, "GPa", "Pa") == {"y": 1e9}
    assert convert_number(1, "kg", "m") is None
    assert convert_number("1", "mm", "m") is None
    assert find_correction("size_mm", [1, 2], ["size_m", "mass_kg"]) == ("size_m", [0.001, 0.002])
    assert find_correction("colour", 1, ["size_m"]) is None


def test_the_beginning_of_a_key_is_enough_to_guess_it() -> None:
    known = ("motor_inertia_kgm2", "gear_ratio", "coulomb_Nm")
    assert find_nearest_word("gear", known) == "gear_ratio"
    assert find_nearest_word("gaer_ratio", known) == "gear_ratio"
    assert find_nearest_word("wheel", known) is None


def test_examples_of_keys_are_lines_that_can_be_written() -> None:
    """A value alone takes the name of its key, a list of words too; the head of a table and another key's line stand."""

    class Pairs(Table):
        words: object = make_optional_key("two words", "[a, b]")
        truths: object = make_optional_key("two truths", "[true, false]")
        table: object = make_optional_key("a table", "[links.tip.tube]")
        tables: object = make_optional_key("tables", "[[springs]]")
        line: object = make_optional_key("another key", "rpy_deg = [0, 0, 90]")

    told = {name: field.examples for name, field in Pairs.model_fields.items()}
    assert told == {
        "words": ["words = [a, b]"],
        "truths": ["truths = [true, false]"],
        "table": ["[links.tip.tube]"],
        "tables": ["[[springs]]"],
        "line": ["rpy_deg = [0, 0, 90]"],
    }


@pytest.mark.parametrize("name", ["robot.urdf", "arm.xml", "arm.sdf"])
def test_a_robot_file_that_is_not_there_is_called_by_its_name(name: str, tmp_path: Path) -> None:
    """Not as a folder with a mechanism.toml in it."""
    with pytest.raises(InputError) as error:
        load_mechanism(tmp_path / name)
    first, given, *_ = str(error.value).splitlines()
    assert first == str(tmp_path / name)
    assert given.split() == ["given:", "there", "is", "no", "such", "file"]
