"""identified.toml says all that a mechanism file can: what is loaded from it reads as the run did."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import logged_arm
import numpy as np
import pytest

from crosscheck.identification.estimation.fit import Fit
from crosscheck.identification.identified_file import write_identified
from crosscheck.identification.identify import Identification, read_machine
from crosscheck.identification.logs.log import Log
from crosscheck.identification.readings import compute_readings, make_run
from crosscheck.identification.settings import read_settings
from crosscheck.identification.table import Row, list_parameter_rows
from flexinv.errors import InputError
from flexinv.files.load_mechanism import load_mechanism

ROUNDING = 1e-9  # of a reading's range: numbers are written with all their digits, sums are made in another order
ROBOT = """<robot name="arm"><link name="ground"/>{links}
<joint name="shoulder" type="continuous"><parent link="ground"/><child link="upper"/><axis xyz="0 1 0"/>
  <dynamics damping="3" friction="2"/></joint>
<joint name="elbow" type="continuous"><parent link="upper"/><child link="fore"/><origin xyz="0.4 0 0"/><axis xyz="0 1 0"/></joint>
<joint name="mount" type="fixed"><parent link="fore"/><child link="flange"/><origin xyz="0.3 0 0" rpy="0 0.3 0"/></joint>
</robot>"""
LINK = """<link name="{name}"><inertial><origin xyz="0.1 0.01 0"/><mass value="{mass}"/>
<inertia ixx="0.02" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
URDF = ROBOT.format(
    links="".join(LINK.format(name=n, mass=m) for n, m in (("upper", 6), ("fore", 2.4), ("flange", 0.5)))
)
DRIVE = """drive]
gear_ratio = 50
motor_inertia_kgm2 = 4e-5
viscous_Nms_per_rad = 4e-4
coulomb_Nm = 0.02
static_Nm = 0.021
"""
PAYLOAD = 'payload]]\nname = "tool"\nmass_kg = 1.8\ncom_m = [0, 0, 0.1]\nsphere = { radius_m = 0.04 }\n'
SPRING = """[springs.lift]
first = { link = "world", xyz_m = [-0.3, 0, 0.1] }
second = { link = "upper", xyz_m = [0.2, 0, 0] }
stiffness_N_per_m = 300
rest_m = 0.1
"""
TUBE = """[sections.tube]
shape = "tube"
outer_diameter_m = 0.02
wall_m = 0.002
E_Pa = 70e9
nu = 0.33
rho_kg_per_m3 = 2700
retardation_s = 1e-3
"""
STRIP = """[sections.strip]
EA_N = 1.4e6
GA_N = 4.6e5
GJ_Nm2 = 200
EI_Nm2 = { y = 300, z = 90 }
mass_per_length_kg_per_m = 0.5
rho_I_kgm = { y = 1e-4, z = 1e-4 }
retardation_s = { axial = 1e-3, shear = 2e-3, twist = 1e-3, bending = 3e-3 }
"""
OVER_A_URDF = f"""source = "test"
[urdf]
path = "arm.urdf"
{SPRING}[overlay.joints.elbow.{DRIVE}[[overlay.links.flange.{PAYLOAD}"""
BENDING_URDF = f"""source = "test"
[urdf]
path = "arm.urdf"
{TUBE}[overlay.links.fore.beam]
section = "tube"
to_joint = "mount"
y_axis = [0, 1, 0]
own_inertia = "replaced"
elements = 1
order = 2
"""
FORE = """kind = "rigid"
mass_kg = {fore}
com_m = [0.15, 0.02, 0]
inertia_kgm2 = {{ xx = 0.01, yy = 0.04, zz = 0.04 }}
"""
BEAM = """kind = "beam"
length_m = 0.3
section = [{{ at = 0, section = "strip" }}, {{ at = 1, section = "strip" }}]
elements = 1
order = 2
payload = [
  {{ name = "tip", station = 1, mass_kg = 0.4, com_m = [0, 0, 0.01], inertia_kgm2 = {{ xx = 1e-3, yy = 1e-3, zz = 1e-3 }} }},
  {{ name = "ring", station = 0.5, mass_kg = 0.2, com_m = [0, 0, 0], sphere = {{ radius_m = 0.03 }} }},
]
"""
ELBOW = "rotor_inertia_kgm2 = 0.1\ndamping_Nms_per_rad = 1.0\nfriction_Nm = 1.0\n"
ELASTIC = 'moves = "motor"\nstiffness_Nm_per_rad = 4e3\ndamping_Nms_per_rad = 5\n'
ARM = logged_arm.MECHANISM.format(**logged_arm.KNOWN)
DRIVEN = ARM.replace(ELBOW, f"[joints.elbow.{DRIVE}") + SPRING
BENDING = logged_arm.MECHANISM.replace(FORE, BEAM).format(**logged_arm.KNOWN)
BENDING = BENDING.replace(ELBOW, f"[joints.elbow.{DRIVE}{ELASTIC}") + STRIP
COUPLED = (
    ARM
    + """[links.disc]
kind = "rigid"
mass_kg = 1
com_m = [0, 0, 0]
inertia_kgm2 = { xx = 0.01, yy = 0.01, zz = 0.02 }
[joints.wheel]
kind = "revolute"
parent = "upper"
child = "disc"
axis = [0, 1, 0]
actuated = false
[closures.belt]
kind = "coupling"
factors = { wheel = 1, elbow = -3 }
"""
)
TREE = (
    *("mass properties", "rotor inertia", "viscous friction", "coulomb friction", "stribeck share", "spring force"),
    *("gravity tilt x", "gravity tilt y", "effort offset"),
)
BENT = ("beam stiffness", "beam damping", "viscous friction", "mass properties")
PLACES = {
    "joint stiffness": '["elbow.spring"]',
    "joint damping": '["elbow.spring", "wheel"]',
    "joint friction": '["wheel"]',
    "place x": '["elbow"]',
}
# What stands below, what is free, and how many of its samples of 4 ms are looked at.
CASES = {
    "a mechanism file": (DRIVEN, TREE, 200),
    "a URDF": (OVER_A_URDF, TREE, 200),
    "a URDF with a beam": (BENDING_URDF, BENT, 40),
    "beams and elastic drives": (
        BENDING, (*BENT, "torsion stiffness", "beam length", "joint stiffness", "joint damping", "place x", "payload mass"), 40,
    ),
    "a passive joint in a coupling": (COUPLED, ("joint friction", "joint damping", "viscous friction"), 100),
    "damping follows stiffness": (BENDING, ("beam stiffness", "torsion stiffness"), 40),
}  # fmt: skip


def write_folder(folder: Path, mechanism: str, free: tuple[str, ...]) -> None:
    """Write a mechanism with its URDF and an identify.toml in which ``free`` [units of the parameters] are free."""
    (folder / "arm.urdf").write_text(URDF)
    (folder / "mechanism.toml").write_text(mechanism)
    tables = []
    for kind in free:
        places = PLACES.get(kind, '["*"]')
        value = "value = 0.2\n" if "friction" in kind or "damping" in kind or kind.startswith("rotor") else ""
        tables.append(f'[[free]]\nparameter = "{kind}"\nplace = {places}\n{value}error = 0.02\n')
    if "mass properties" in free:
        tables[free.index("mass properties")] = '[[free]]\nparameter = "mass properties"\nrelative = 0.3\n'
    head = logged_arm.IDENTIFY.split("[[free]]", maxsplit=1)[0]
    (folder / "identify.toml").write_text(head + "".join(tables))


def make_log(count: int) -> Log:
    time = 0.004 * np.arange(count)
    swing = (1.0 - np.cos(4.0 * time)) * np.array([[0.5], [0.4]])
    return Log("log", time, {"q1": swing[0], "q2": swing[1]})


def make_rows(folder: Path) -> Identification:
    """Return what an identification holds [unit of each] that has found some parameters, with no log and no fit."""
    machine = read_machine(folder)
    count = len(machine.space.parameters)
    z = np.random.default_rng(1).normal(size=count)
    none = np.zeros(0)
    found = Fit(z, 0.01 * np.eye(count), none, none, 1.0, none, (), ())
    rows = list_parameter_rows(machine.space, found)
    return cast(Identification, SimpleNamespace(machine=machine, fit=found, parameters=rows, shown=[]))


@pytest.mark.parametrize("case", CASES)
def test_what_is_loaded_reads_as_the_run_did(case: str, tmp_path: Path) -> None:
    text, free, count = CASES[case]
    write_folder(tmp_path, text, free)
    found = make_rows(tmp_path)
    write_identified(found, tmp_path / "mechanism.toml", tmp_path / "identified.toml")
    written = (tmp_path / "identified.toml").read_text()
    log = make_log(count)
    run = make_run(found.machine, log, efforts=False, once=True)
    told = compute_readings(found.machine, run, found.machine.space.compute_values(found.fit.z))
    loaded = read_machine(
        load_mechanism(tmp_path / "identified.toml"), found.machine.settings.model_copy(update={"free": []})
    )
    again = compute_readings(
        loaded, make_run(loaded, log, efforts=False, once=True), dict(list_in_comments(written, found.parameters))
    )
    assert np.abs(again - told).max() <= ROUNDING * np.ptp(told, axis=0).min()
    before = compute_readings(found.machine, run, found.machine.space.compute_values(np.zeros(len(found.fit.z))))
    assert np.abs(told - before).max() > 1e3 * ROUNDING * np.ptp(
        told
    )  # so that a number that is not written would be seen


def list_in_comments(text: str, rows: list[Row]) -> list[tuple[tuple[str, str], float]]:
    """The parameters that the file names as no part of a mechanism file, with their values [unit of each]."""
    comments = text.partition("no part of a mechanism file")[2]
    return [((r.parameter, r.place), r.value) for r in rows if f"{r.parameter} of {r.place}:" in comments]


@pytest.mark.parametrize(
    ("case", "expected"),
    [
        ("a mechanism file", {"stribeck share", "effort offset"}),
        ("a URDF", {"stribeck share", "effort offset"}),
        ("a URDF with a beam", set()),
        ("beams and elastic drives", set()),
        ("a passive joint in a coupling", set()),
    ],
)
def test_only_what_no_file_can_say_stands_in_comments(case: str, expected: set[str], tmp_path: Path) -> None:
    text, free, _ = CASES[case]
    write_folder(tmp_path, text, free)
    found = make_rows(tmp_path)
    write_identified(found, tmp_path / "mechanism.toml", tmp_path / "identified.toml")
    rest = list_in_comments((tmp_path / "identified.toml").read_text(), found.parameters)
    assert {kind for (kind, _), _ in rest} == expected


DRIVEN_CURRENT = 'effort = { column = "t2", unit = "A", side = "SIDE" }'
BARE_CURRENT = 'effort = { column = "t2", unit = "A", constant_Nm_per_A = 9.0 }'
MOTOR = "[joints.elbow.drive]\ngear_ratio = 50\ntorque_constant_Nm_per_A = 0.2\n"


@pytest.mark.parametrize("side", ["motor", "joint", ""])
def test_the_gain_of_a_current_is_a_torque_constant(side: str, tmp_path: Path) -> None:
    """Of the motor where the joint has a drive; else a comment has the line to write.  Readings [N m] then are those in A."""
    write_folder(tmp_path, ARM.replace(ELBOW, MOTOR) if side else ARM, ("effort gain", "effort offset"))
    settings = tmp_path / "identify.toml"
    current = DRIVEN_CURRENT.replace("SIDE", side) if side else BARE_CURRENT
    settings.write_text(settings.read_text().replace('effort = { column = "t2" }', current))
    found = make_rows(tmp_path)
    write_identified(found, tmp_path / "mechanism.toml", tmp_path / "identified.toml")
    written = (tmp_path / "identified.toml").read_text()
    values = found.machine.space.compute_values(found.fit.z)
    gain = values.pop(("effort gain", "elbow"))
    log = make_log(100)
    told = compute_readings(
        found.machine, make_run(found.machine, log, efforts=False), values | {("effort gain", "elbow"): gain}
    )
    if not side:
        line = re.findall(r"write (constant_Nm_per_A = [\d.]+) into effort of \[joints.elbow\]", written)[0]
        settings.write_text(settings.read_text().replace("constant_Nm_per_A = 9.0", line))
    assert ("effort gain of elbow" in written) == (not side)
    used = read_settings(tmp_path, found.machine.mechanism).model_copy(update={"free": []})
    loaded = read_machine(load_mechanism(tmp_path / "identified.toml"), used)
    channel = loaded.channels[1]
    again = compute_readings(loaded, make_run(loaded, log, efforts=False), values)
    stated = {"motor": 0.2, "joint": 10.0, "": 9.0}[side]
    assert (channel.unit, channel.factor) == ("N m", pytest.approx(stated / gain, rel=ROUNDING))
    assert np.abs(again[:, 1] - told[:, 1] * channel.factor).max() <= ROUNDING * np.ptp(again[:, 1])
    low, high = re.findall(r"90 %: (\S+) to (\S+) N m/A", written)[0]
    assert float(low) < float(high)


def test_a_payload_of_a_flange_is_part_of_what_was_found(tmp_path: Path) -> None:
    """A flange of 0.5 kg with a tool of 1.8 kg on a fixed joint: the file has one body there, with the mass of both."""
    write_folder(tmp_path, OVER_A_URDF, TREE)
    found = make_rows(tmp_path)
    write_identified(found, tmp_path / "mechanism.toml", tmp_path / "identified.toml")
    row = next(r for r in found.parameters if (r.parameter, r.place) == ("mass", "flange"))
    (body,) = load_mechanism(tmp_path / "identified.toml").link_of["flange"].bodies
    assert row.before == pytest.approx(2.3, rel=1e-9)
    assert body.inertia.mass == pytest.approx(row.value, rel=1e-12)


def test_a_mass_beside_a_beam_is_refused(tmp_path: Path) -> None:
    write_folder(tmp_path, BENDING_URDF + "[overlay.links.fore]\nmass_kg = 1\n", BENT)
    with pytest.raises(InputError, match=r"\[overlay.links.fore\], key mass_kg(.|\n)*that of a beam is its section's"):
        load_mechanism(tmp_path)


def test_friction_of_a_passive_joint_is_felt_through_its_coupling(tmp_path: Path) -> None:
    """A wheel that turns three times as fast as the elbow: 3 c of its dry friction at the elbow, and nothing at the shoulder."""
    write_folder(tmp_path, COUPLED, ("joint friction",))
    machine = read_machine(tmp_path)
    run = make_run(machine, make_log(150), efforts=False)
    less, more = (compute_readings(machine, run, {("joint friction", "wheel"): c}) for c in (0.1, 0.5))
    middle = slice(60, 90)  # the elbow turns at 1.2 rad/s and more
    assert (
        np.abs((more - less)[middle] - [0.0, 3.0 * 0.4]).max() < 1e-3
    )  # the low-pass at 10 Hz, 0.2 s from where it began
