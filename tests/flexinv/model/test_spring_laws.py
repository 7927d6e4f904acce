"""Laws of springs: gas and table against their formulas, in every form that computes them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from complaints import Planted, check_complaint
from kernels import fill_pulls

import flexinv
from flexinv.dynamics.loads import build_spring_laws
from flexinv.errors import InputError
from flexinv.model.attachments import GasLaw, SpringLaw, TableLaw
from flexinv.model.mechanism import Attachment, Body, Inertia, Joint, Link, Mechanism, Placement, Spring

X = np.array([1.0, 0.0, 0.0])
GAS = GasLaw(40.0, 0.8, 1.3)
TABLE = TableLaw(np.array([0.3, 0.5, 0.6, 0.9]), np.array([-10.0, 2.0, 4.0, 40.0]))
HOLD = flexinv.Motion.point_to_point({"hold": 0.0}, {"hold": 0.0}, 0.1)


@pytest.mark.parametrize("law", [GAS, TABLE, GasLaw(-40.0, -0.8, 1.3)], ids=["gas", "table", "strut"])
def test_the_slope_is_that_of_the_pull(law: SpringLaw) -> None:
    """The march's pull is the law's, and its slope that of the pull.

    Central differences of 1e-6 m: 1e-12 of third derivatives, and rounding of 1e-16 over 1e-6; rows of the table left out.
    """
    length = np.linspace(0.26, 0.95, 29)
    result = (law.evaluate_pull(length + 1e-6, 0.5) - law.evaluate_pull(length - 1e-6, 0.5)) / 2e-6
    at = Attachment("link")
    found = np.zeros((29, 2))
    fill_pulls(build_spring_laws([Spring("spring", at, at, 0.0, 0.5, law=law)]), 0, length, found)
    np.testing.assert_allclose(
        found[:, 0], law.evaluate_pull(length, 0.5), rtol=1e-14, atol=1e-14
    )  # rounding of a few products
    assert np.allclose(found[:, 1], result, rtol=1e-6, atol=1e-6)


def test_a_gas_does_the_work_of_its_expansion() -> None:
    """Isothermal gas: the work from rest to l is force travel ln(1 / (1 - (l - rest) / travel))."""
    length = np.linspace(0.5, 0.9, 20001)
    work = np.trapezoid(GasLaw(40.0, 0.8).evaluate_pull(length, 0.5), length)
    assert work == pytest.approx(40.0 * 0.8 * np.log(2.0), rel=1e-8)  # trapezoids of 2e-5 m


def test_a_table_is_monotone_and_goes_through_its_rows() -> None:
    assert np.allclose(TABLE.evaluate_pull(TABLE.length, 0.0), TABLE.force, rtol=0, atol=1e-13)  # rounding
    assert (np.diff(TABLE.evaluate_pull(np.linspace(0.1, 1.2, 500), 0.0)) > 0).all()


def slider(law: SpringLaw | None, stiffness: float = 0.0) -> Mechanism:
    """Return 2 kg on a spring along x from the world, rest length 0.5 m, beside a joint that is held."""

    def body(name: str) -> Link:
        return Link(name, (Body(name, Inertia(2.0, np.zeros(3), np.diag([0.1, 0.2, 0.3]))),))

    joints = (
        Joint("hold", "revolute", "world", "held"),
        Joint("slide", "prismatic", "world", "mass", axis=X, actuated=False),
    )
    spring = Spring("spring", Attachment("world", Placement(-0.2 * X)), Attachment("mass"), stiffness, 0.5, 0.0, law)
    return Mechanism("slider", (body("held"), body("mass")), joints, np.zeros(3), springs=(spring,))


@pytest.mark.parametrize("law", [GAS, TABLE], ids=["gas", "table"])
def test_the_march_has_the_same_law_as_the_inverse_dynamics(law: SpringLaw) -> None:
    """The accelerations of the march are -pull / m with the pull of the formulas, to Newton's tolerance."""
    solution = flexinv.solve(slider(law), HOLD, step=1e-3, start={"slide": 0.45})
    pull = law.evaluate_pull(solution.q[:, 1] + 0.2, 0.5)
    assert np.allclose(solution.qdd[:, 1], -pull / 2.0, rtol=1e-8, atol=1e-8)
    assert np.ptp(solution.q[:, 1]) > 0.01  # it has moved through a part of the law


def test_a_table_of_two_rows_is_a_linear_spring() -> None:
    """50 N/m from 0.5 m: the same motion to Newton's tolerance of 1e-10 over 100 steps."""
    straight = TableLaw(np.array([0.4, 0.7]), np.array([-5.0, 10.0]))
    result = [flexinv.solve(m, HOLD, step=1e-3, start={"slide": 0.4}).q for m in (slider(straight), slider(None, 50.0))]
    assert np.allclose(*result, rtol=0, atol=1e-9)


def test_forces_that_double_are_seen() -> None:
    """A law of twice the force moves the mass elsewhere: the checks above can fail."""
    laws = (GAS, GAS.scale_forces(2.0))
    moved = [flexinv.solve(slider(law), HOLD, step=1e-3, start={"slide": 0.45}).q[-1, 1] for law in laws]
    assert abs(moved[0] - moved[1]) > 1e-3


GOOD = """title = "t"
source = "test"
gravity_m_per_s2 = [0, 0, 0]
[links.mass]
kind = "rigid"
mass_kg = 2
com_m = [0, 0, 0]
inertia_kgm2 = 0
[joints.slide]
kind = "prismatic"
parent = "world"
child = "mass"
axis = [1, 0, 0]
[springs.s]
first = { link = "world", xyz_m = [-0.5, 0, 0] }
second = { link = "mass" }
law = "table"
length_m = [0.4, 0.7]
force_N = [-5, 10]
"""
BAD: dict[str, Planted] = {
    "law": ('law = "table"', 'law = "tabel"', "springs.s", "law", 'law = "tabel"', '"linear", "gas"', 'law = "table"'),
    "order": ("[0.4, 0.7]", "[0.7, 0.4]", "springs.s", "length_m", "[0.7, 0.4]", "increasing", "length_m = [0.60"),
    "count": ("[-5, 10]", "[-5, 10, 3]", "springs.s", "force_N", "3 numbers", "2 numbers", "2 numbers"),
}


def load(folder: Path, text: str) -> Mechanism:
    (folder / "sprung").mkdir(exist_ok=True)
    (folder / "sprung" / "mechanism.toml").write_text(text, encoding="utf-8")
    return flexinv.load_mechanism(folder / "sprung")


@pytest.mark.parametrize("case", BAD.values(), ids=BAD.keys())
def test_messages_about_laws(tmp_path: Path, case: Planted) -> None:
    with pytest.raises(InputError) as caught:
        load(tmp_path, GOOD.replace(case[0], case[1]))
    check_complaint(str(caught.value), tmp_path / "sprung" / "mechanism.toml", case)


def test_a_file_gives_the_law(tmp_path: Path) -> None:
    law = load(tmp_path, GOOD).springs[0].law
    assert isinstance(law, TableLaw)
    assert law.evaluate_pull(0.55, 0.0) == pytest.approx(2.5)
    gas = 'law = "gas"\nforce_N = 10\nrest_m = 0.6\ntravel_m = 0.5\n'
    assert load(tmp_path, GOOD[: GOOD.index('law = "table"')] + gas).springs[0].law == GasLaw(10.0, 0.5, 1.0)
