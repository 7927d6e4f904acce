"""Free rigid bodies: the bar of the energy guard is taken of the energy that is there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import flexinv

TOP = """title = "t"
source = "s"
gravity_m_per_s2 = [0, 0, 0]
[links.top]
kind = "rigid"
mass_kg = 1
com_m = [0, 0, 0]
inertia_kgm2 = { xx = 1, yy = 2, zz = 2.6, xy = 0, xz = 0, yz = 0 }
[joints.f]
kind = "free"
parent = "world"
child = "top"
"""


@pytest.mark.reported("D9")
def test_eulers_top_is_solved(tmp_path: Path) -> None:
    (tmp_path / "mechanism.toml").write_text(TOP, encoding="utf-8")
    mechanism = flexinv.load_mechanism(tmp_path)
    still = flexinv.Motion((), 6.0)
    s = flexinv.solve(mechanism, still, step=1.5e-2, start_rate={"f": [0, 0, 0, 2.0, 1.5, 1.0]})
    energy = s.balance.kinetic
    assert abs(energy - energy[0]).max() < 1e-3 * energy[0]  # the guard's own bar
    spin = np.einsum("sij,j,sj->si", s.nodes.rotation[:, -1], np.array([1.0, 2.0, 2.6]), s.nodes.omega[:, -1])
    assert abs(spin - spin[0]).max() < 1e-3 * np.linalg.norm(spin[0])
