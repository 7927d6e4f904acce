"""Sections that step inside an element: elements end there, results converge, and error bars cover what is left."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import flexinv
from flexinv.kinematics.mesh import build, list_section_breaks

TABLE = """[sections.{name}]
EA_N = 1e6
GA_N = 1e6
GJ_Nm2 = 10
EI_Nm2 = {{ y = 4, z = {bending} }}
mass_per_length_kg_per_m = 0.2
rho_I_kgm = {{ y = 1e-6, z = 1e-6, x = 2e-6 }}
"""


def stepped(folder: Path, stations: str) -> flexinv.Mechanism:
    text = 'title = "t"\nsource = "s"\ngravity_m_per_s2 = [0, -9.81, 0]\n'
    text += TABLE.format(name="thick", bending=4) + TABLE.format(name="thin", bending=1)
    text += f'[links.b]\nkind = "beam"\nlength_m = 1\nsection = [{stations}]\n'
    text += '[joints.j]\nkind = "revolute"\nparent = "world"\nchild = "b"\naxis = [0, 0, 1]\n'
    (folder / "mechanism.toml").write_text(text, encoding="utf-8")
    return flexinv.load_mechanism(folder)


def row(*pairs: tuple[float, str]) -> str:
    return ", ".join(f'{{ at = {at}, section = "{name}" }}' for at, name in pairs)


ABRUPT = row((0, "thick"), (0.4999, "thick"), (0.5001, "thin"), (1, "thin"))
STEP = row((0, "thick"), (0.5, "thick"), (0.5, "thin"), (1, "thin"))
MOVE = flexinv.Motion.point_to_point({"j": 0.0}, {"j": 1.0}, duration=0.5)


def sag(load: float) -> float:
    """Tip under its own weight by the linear beam: integral of M(s) (1 - s) / EI over both halves, M = load (1 - s)^2 / 2."""
    inner, outer = (1.0 - 0.5**4) / 8 / 4.0, 0.5**4 / 8 / 1.0
    shear = load / 2 / 1e6
    return load * (inner + outer) + shear


@pytest.mark.reported("D6")
@pytest.mark.parametrize("stations", [ABRUPT, STEP])
def test_the_tip_is_that_of_the_stepped_beam(tmp_path: Path, stations: str) -> None:
    """The default mesh, against the closed form of small deflections."""
    mechanism = stepped(tmp_path, stations)
    light = flexinv.Mechanism(
        mechanism.name, mechanism.links, mechanism.joints, np.array([0.0, -1e-3, 0.0]), title="t", source="s"
    )
    solution = flexinv.statics(light)
    assert -solution.tip["b"][0, 1] == pytest.approx(sag(0.2e-3), rel=5e-4)  # the lumped masses; 3.5 % without the cut


@pytest.mark.parametrize("stations", [ABRUPT, STEP])
def test_the_error_bar_covers_the_truth(tmp_path: Path, stations: str) -> None:
    mechanism = stepped(tmp_path, stations)
    coarse = flexinv.solve(mechanism, MOVE, step=2e-3, error=True)
    fine = flexinv.solve(mechanism.refined(elements=4), MOVE, step=5e-4, every=4, spectral_radius=0.8)
    assert coarse.torque_error is not None
    off = np.abs(coarse.torque - fine.torque)
    assert (off <= coarse.torque_error + 1e-3 * np.abs(fine.torque).max()).all()  # what the reference leaves itself


def test_elements_end_at_steps_and_not_in_tapers(tmp_path: Path) -> None:
    beam = stepped(tmp_path, STEP).beams[0].beam
    assert beam is not None
    assert list_section_breaks(beam) == [0.5, 0.5]
    taper = stepped(tmp_path, row((0, "thick"), (0.5, "thick"), (1, "thin"))).beams[0].beam
    assert taper is not None
    assert list_section_breaks(taper) == [0.5]  # a kink
    smooth = stepped(tmp_path, row((0, "thick"), (1, "thin"))).beams[0].beam
    assert smooth is not None
    assert list_section_breaks(smooth) == []


def test_mass_is_that_of_each_side(tmp_path: Path) -> None:
    mechanism = stepped(tmp_path, STEP.replace('"thin" }, { at = 1', '"thin" }, { at = 1'))
    assert build(mechanism).mass.sum() == pytest.approx(0.2, rel=1e-14)


@pytest.mark.parametrize(
    "stations",
    [
        row((0, "thick"), (0, "thin"), (1, "thin")),
        row((0, "thick"), (0.5, "thick"), (0.5, "thin"), (0.5, "thick"), (1, "thin")),
        row((0, "thick"), (0.6, "thick"), (0.5, "thin"), (1, "thin")),
    ],
)
def test_stations_that_make_no_sense_are_refused(tmp_path: Path, stations: str) -> None:
    with pytest.raises(flexinv.InputError, match="two equal ones between are a step"):
        stepped(tmp_path, stations)
