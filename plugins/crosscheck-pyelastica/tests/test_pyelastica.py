"""PyElastica through the package door: a soft arm within its error bars, second order in the mesh, and refusals in words."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("elastica", reason="PyElastica is not installed (python -m pip install pyelastica)")

import crosscheck_pyelastica as engine

from crosscheck.conform.ladder import FOLDER, RUNGS
from crosscheck.doors.outside_bars import of_package
from crosscheck.engines import ENGINES, adapter
from crosscheck.measures.budget import is_checked
from flexinv.files.load_cases import Case, load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Mechanism

MECHANISM = """
title = "A soft arm of rubber that is turned in a horizontal plane"
source = "made for this test"
gravity_m_per_s2 = [0, 0, 0]
[sections.rubber]
EA_N = 2e4
GA_N = 6e3
GJ_Nm2 = 0.004
EI_Nm2 = { y = 0.005, z = 0.005 }
mass_per_length_kg_per_m = 0.1
rho_I_kgm = { y = 2.5e-6, z = 2.5e-6 }
[links.arm]
kind = "beam"
length_m = 0.3
section = "rubber"
elements = 4
order = 5
[joints.hub]
kind = "revolute"
parent = "world"
child = "arm"
axis = [0, 0, 1]
"""
CASES = """
source = "made for this test"
[cases.turn]
title = "A quarter of a turn in 0.5 s, quintic"
step_s = 2e-4
sample_s = 5e-3
quantities = ["torque", "tip", "deflection", "axial"]
[cases.turn.motion]
law = "quintic"
duration_s = 0.5
joints.hub = { from_deg = -90, to_deg = 0 }
"""


def scene(folder: Path) -> tuple[Mechanism, Case]:
    mechanism = load_mechanism(folder)
    return mechanism, next(iter(load_cases(folder, mechanism).values()))


@pytest.fixture
def soft(tmp_path: Path) -> tuple[Mechanism, Case]:
    (tmp_path / "mechanism.toml").write_text(MECHANISM, encoding="utf-8")
    (tmp_path / "cases.toml").write_text(CASES, encoding="utf-8")
    return scene(tmp_path)


def errors(mechanism: Mechanism, case: Case, count: int) -> dict[str, float]:
    """Largest differences from the reference, over the range of the quantity."""
    result = adapter(ENGINES["flexinv"]).run(mechanism, case, "flexinv", {"error": False})
    theirs = engine.marched(mechanism, case, count)
    sizes = {
        quantity: max(float(np.ptp(s.values)) for s in result.series.values() if s.quantity == quantity)
        for quantity in {s.quantity for s in theirs.values()}
    }
    return {n: float(np.abs(s.values - result.series[n].values).max()) / sizes[s.quantity] for n, s in theirs.items()}


def test_a_soft_arm_converges_with_the_square_of_its_elements(soft: tuple[Mechanism, Case]) -> None:
    """The tip lags by a third of the arm's length; half an element behind the hub, twice the elements leave a fourth."""
    mechanism, case = soft
    coarse, fine = errors(mechanism, case, 5), errors(mechanism, case, 10)
    for name in ("torque/hub", "tip/arm/x", "tip/arm/y", "deflection/arm/y"):
        assert coarse[name] / fine[name] >= 3.0, name
        assert fine[name] <= 5e-3, name
    assert fine["axial/arm"] <= 2e-2


@pytest.mark.slow
def test_error_bars_hold(soft: tuple[Mechanism, Case]) -> None:
    """Three runs that crosscheck asks for show them, so that they count.

    Both are estimates: the reference adds a tenth, and the counts of elements are not quite doubled: half as much again.
    """
    mechanism, case = soft
    result = adapter(ENGINES["flexinv"]).run(mechanism, case, "flexinv", {"error": False})
    theirs = of_package(engine, mechanism, case, "pyelastica", {})
    for name in ("torque/hub", "tip/arm/x", "tip/arm/y"):
        one = theirs.series[name]
        assert is_checked(theirs.budget, name)
        assert one.error is not None
        assert np.abs(one.values - result.series[name].values).max() <= 1.5 * one.error.max(), name
        assert one.error.max() <= 1e-2 * np.ptp(one.values), name


@pytest.mark.parametrize("rung", RUNGS)
def test_it_climbs_what_it_says(rung: str) -> None:
    reason = engine.unsupported(*scene(FOLDER / rung), "pyelastica")
    assert (reason is None) == (rung == "beam_moving"), reason


def test_what_it_cannot_do_is_said(soft: tuple[Mechanism, Case]) -> None:
    mechanism, case = soft
    assert engine.unsupported(mechanism, case, "pyelastica") is None
    assert "undeformed" in str(engine.unsupported(mechanism, replace(case, initial="static"), "pyelastica"))
    (link,) = mechanism.links
    assert link.beam is not None
    section = replace(link.beam.section, stiffness=link.beam.section.stiffness * 1e8)
    hard = replace(mechanism, links=(replace(link, beam=replace(link.beam, section=section)),))
    assert "explicit steps" in str(engine.unsupported(hard, case, "pyelastica"))


def test_a_step_beyond_the_bound_is_not_taken_for_an_answer(
    soft: tuple[Mechanism, Case], monkeypatch: pytest.MonkeyPatch
) -> None:
    mechanism, case = soft
    monkeypatch.setattr(engine, "SAFE", 20.0)
    with np.errstate(all="ignore"), pytest.raises(RuntimeError, match="the rod has blown up"):
        engine.marched(mechanism, case, 10)
