"""Strain gauges read what the moment at their place makes of them: closed formulas of a cantilever with a mass at its tip."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from crosscheck.identification.identify import read_machine
from crosscheck.identification.logs.log import Log
from crosscheck.identification.readings import compute_readings, make_run
from flexinv.errors import InputError

MECHANISM = """source = "test"
gravity_m_per_s2 = [0, -9.81, 0]
[sections.strip]
EA_N = 1e6
GA_N = 4e5
GJ_Nm2 = 4e3
EI_Nm2 = 4e3
mass_per_length_kg_per_m = 1e-4
rho_I_kgm = 0
[links.arm]
kind = "beam"
length_m = 0.5
section = "strip"
elements = 2
order = 2
payload = [{ name = "tip", station = 1, mass_kg = 2, com_m = [0, 0, 0], inertia_kgm2 = 0 }]
[joints.hub]
kind = "revolute"
parent = "world"
child = "arm"
axis = [0, 0, 1]
"""
IDENTIFY = """bandwidth_Hz = 10
initial = "static"
[joints.hub]
angle = { column = "q" }
[gauges.one]
beam = "arm"
column = "g"
%s
[[free]]
parameter = "gauge zero"
error = 1e-4
"""
MOMENT = 2.0 * 9.81 * 0.5  # of the mass at the root [N m]; the beam's own weight is 1/40000 of that of the mass


def read_gauge(folder: Path, keys: str) -> tuple[float, str]:
    """Return what a gauge reads of an arm that rests, and its unit."""
    (folder / "mechanism.toml").write_text(MECHANISM)
    (folder / "identify.toml").write_text(IDENTIFY % keys)
    machine = read_machine(folder)
    log = Log("log", 0.004 * np.arange(60), {"q": np.zeros(60)})
    told = compute_readings(machine, make_run(machine, log, efforts=False), {})
    return float(told[30, 0]), machine.channels[0].unit


@pytest.mark.parametrize(
    ("keys", "expected", "unit"),
    [
        ('joint = "hub"', -MOMENT * 0.5 / (3.0 * 4e3), "rad"),
        ('joint = "hub"\nsign = -1', MOMENT * 0.5 / (3.0 * 4e3), "rad"),
        ('joint = "hub"\nsign = -1\nflexibility_rad_per_Nm = 0.1', MOMENT * 0.1, "rad"),
        ('joint = "hub"\nunit = "um/m"\nheight_m = 2e-3', -MOMENT * 2e-3 / 4e3, "m/m"),
        ('station = 0\nunit = "um/m"\nheight_m = 2e-3', -MOMENT * 2e-3 / 4e3, "m/m"),
        ('station = 0.7\nunit = "um/m"\nheight_m = 2e-3', -0.3 * MOMENT * 2e-3 / 4e3, "m/m"),
        ('station = 0.7\nunit = "um/m"\nheight_m = 2e-3\nsign = -1', 0.3 * MOMENT * 2e-3 / 4e3, "m/m"),
    ],
)
def test_a_gauge_reads_the_moment_at_its_place(keys: str, expected: float, unit: str, tmp_path: Path) -> None:
    """The tip hangs down by M L^2 / (3 EI) = 0.2 mm, which shortens the lever by far less than 1e-4 of it."""
    told, of = read_gauge(tmp_path, keys)
    assert of == unit
    assert told == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ("", "neither joint nor station"),
        ('joint = "hub"\nstation = 0.5', "both joint and station"),
        ('joint = "hup"', 'joint = "hub"'),
        ('joint = "hub"\nunit = "um/m"', "height_m"),
        ('joint = "hub"\nheight_m = 1e-3', "height_m"),
        ("station = 0.5\nsign = 2", "key sign"),
    ],
)
def test_a_gauge_without_a_place_or_a_measure_is_refused(keys: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=rf"gauges\.one(.|\n)*{says}"):
        read_gauge(tmp_path, keys)
