"""Joints that stand during a log: identify.toml says where, and the machine is what it is there."""

from __future__ import annotations

from pathlib import Path

import logged_arm
import numpy as np
import pytest

from crosscheck.identification.identify import read_machine
from crosscheck.identification.logs.log import Log
from crosscheck.identification.readings import compute_readings, make_run
from flexinv.errors import InputError

LOG = """[joints.elbow]
angle = { column = "q2" }
effort = { column = "t2" }
"""
KINDS = {
    "revolute": 'kind = "revolute"',
    "prismatic": 'kind = "prismatic"',
    "helical": 'kind = "helical"\npitch_m = 0.2',
}
SLIDING = {
    "rotor_inertia_kgm2": "rotor_inertia_kg",
    "damping_Nms_per_rad": "damping_Ns_per_m",
    "friction_Nm": "friction_N",
}
TIME = 0.004 * np.arange(300)
SWING = 1.0 - np.cos(3.0 * TIME)


def write(folder: Path, kind: str, stands: str = "") -> Path:
    """Write the arm with another elbow [rad, m]; with ``stands`` no column measures it."""
    elbow = logged_arm.MECHANISM.partition("[joints.elbow]")
    text = elbow[2].replace('kind = "revolute"', KINDS[kind])
    for turning, sliding in SLIDING.items() if kind == "prismatic" else ():
        text = text.replace(turning, sliding)
    logged_arm.write_arm(folder, text=elbow[0] + elbow[1] + text)
    settings = logged_arm.IDENTIFY.replace("block_s = 1.0", f"block_s = 1.0\n{stands}")
    (folder / "identify.toml").write_text(settings.replace(LOG, "") if stands else settings)
    return folder


@pytest.mark.parametrize(
    ("kind", "said"), [("revolute", "deg = 30"), ("prismatic", "m = 0.15"), ("helical", "rad = 0.7")]
)
def test_a_joint_that_stands_is_one_whose_column_is_constant(kind: str, said: str, tmp_path: Path) -> None:
    value = {"revolute": np.pi / 6.0, "prismatic": 0.15, "helical": 0.7}[kind]
    efforts = []
    for name, stands in (("measured", ""), ("standing", f"stands.elbow = {{ {said} }}")):
        machine = read_machine(write(tmp_path / name, kind, stands))
        log = Log("log", TIME, {"q1": SWING, "q2": np.full(len(TIME), value)})
        run = make_run(machine, log, efforts=False, once=True)
        efforts.append(compute_readings(machine, run, {})[:, 0])
    assert np.abs(efforts[1] - efforts[0]).max() < 1e-12 * np.ptp(efforts[0])  # rounding


@pytest.mark.parametrize(
    ("stands", "says"),
    [
        (
            "stands.elbo = { deg = 30 }",
            r"a joint of one coordinate: shoulder, elbow(.|\n)*stands\.elbow = \{ deg = 30 \}",
        ),
        ("stands.shoulder = { deg = 30 }", r"\[joints.shoulder\], which measures it"),
        ("stands.elbow = { m = 0.1 }", "deg or rad of a joint that turns"),
        ("stands.elbow = {}", "deg or rad of a joint that turns"),
    ],
)
def test_what_cannot_stand_is_refused_in_words(stands: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=says):
        read_machine(write(tmp_path / "arm", "revolute", stands))


def test_a_joint_that_nothing_is_known_of_says_what_to_write(tmp_path: Path) -> None:
    folder = write(tmp_path / "arm", "revolute")
    (folder / "identify.toml").write_text((folder / "identify.toml").read_text().replace(LOG, ""))
    with pytest.raises(InputError, match=r"or stands\.elbow = \{ deg = 0 \} where it stands"):
        make_run(read_machine(folder), Log("log", TIME, {"q1": SWING}), efforts=False)
