"""Springs that come to no length: an error that names spring and instant, at samples and between them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import flexinv

SLIDE = """title = "t"
source = "s"
gravity_m_per_s2 = [0, 0, 0]
[links.mass]
kind = "rigid"
mass_kg = 1
com_m = [0, 0, 0]
inertia_kgm2 = 0
[joints.x]
kind = "prismatic"
parent = "world"
child = "mass"
axis = [1, 0, 0]
[springs.coil]
first = {{ link = "world", xyz_m = [0, {aside}, 0] }}
second = {{ link = "mass" }}
stiffness_N_per_m = 100
rest_m = {rest}
"""
THROUGH = flexinv.Motion.point_to_point({"x": -0.4}, {"x": 0.6}, duration=1.0)


def mechanism(folder: Path, aside: float, rest: float) -> flexinv.Mechanism:
    (folder / "mechanism.toml").write_text(SLIDE.format(aside=aside, rest=rest), encoding="utf-8")
    return flexinv.load_mechanism(folder)


@pytest.mark.parametrize("step", [0.1, 1e-2, 7e-3, 1e-3])
def test_a_spring_without_length_is_an_error(tmp_path: Path, step: float) -> None:
    with pytest.raises(flexinv.InputError, match=r"spring 'coil' has no length there") as caught:
        flexinv.solve(mechanism(tmp_path, 0.0, 0.05), THROUGH, step=step)
    match = re.search(r"t = (\S+) s", str(caught.value))
    assert match is not None
    place = THROUGH.evaluate(mechanism(tmp_path, 0.0, 0.05), [float(match[1])])[0][0, 0]
    speed = 2.0  # at most
    fine = step < 2e-2  # where the quintic is exact to 1e-9: its error is h^6 q^(6) / 46080, q^(6) up to (2 pi)^5
    assert abs(place) < speed * (1e-9 if fine else 1e-4)


def test_springs_that_stay_regular_are_left_alone(tmp_path: Path) -> None:
    passing = flexinv.solve(mechanism(tmp_path, 1e-3, 0.05), THROUGH, step=1e-3)
    assert np.isfinite(passing.torque).all()
    smooth = flexinv.solve(mechanism(tmp_path, 0.0, 0.0), THROUGH, step=1e-2)
    assert smooth.torque[:, 0] == pytest.approx(smooth.qdd[:, 0] + 100 * smooth.q[:, 0], abs=1e-12)


def test_in_a_march(tmp_path: Path) -> None:
    """A mass that flies through the spring's other end: found within the step."""
    free = mechanism(tmp_path, 0.0, 0.05)
    (tmp_path / "mechanism.toml").write_text(
        SLIDE.format(aside=0.0, rest=0.05).replace("axis = [1, 0, 0]", "axis = [1, 0, 0]\nactuated = false"),
        encoding="utf-8",
    )
    free = flexinv.load_mechanism(tmp_path)
    still = flexinv.Motion((), 0.5)
    with pytest.raises(flexinv.InputError, match=r"spring 'coil' has no length there"):
        flexinv.solve(free, still, step=1e-3, start={"x": -0.3}, start_rate={"x": 4.0})
