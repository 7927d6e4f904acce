"""flexinv as an engine: its record holds what its solution says, in the units and under the names of the contract."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crosscheck.engines.base import sample_times
from crosscheck.engines.flexinv import adapter as engine
from crosscheck.measures.record import Record, check
from flexinv.analysis.solve import solve
from flexinv.files.load_cases import Case, load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion


def case(motion: Motion, step: float, sample: float) -> Case:
    return Case("c", "", motion, step, motion.duration, sample, ("torque",), ())


@pytest.fixture(scope="module")
def flexible(root: Path) -> tuple[Mechanism, Case, Record]:
    mechanism = load_mechanism(root / "models" / "flex_one_link")
    one = case(Motion.point_to_point([0.0], [0.3], 0.02), 1e-3, 2e-3)
    return mechanism, one, engine.run(mechanism, one, "flexinv", {})


def test_a_record_is_the_solution_on_the_sample_times(flexible: tuple[Mechanism, Case, Record]) -> None:
    mechanism, one, record = flexible
    check(record, sample_times(one))
    solution = solve(mechanism, one.motion, one.step)
    values = {name: s.values for name, s in record.series.items()}
    np.testing.assert_array_equal(values["torque/hub"], solution.torque_all[::2, 0])
    for k, axis in enumerate("xyz"):
        np.testing.assert_array_equal(values[f"tip/link/{axis}"], solution.tip["link"][::2, k])
        np.testing.assert_array_equal(values[f"deflection/link/{axis}"], solution.deflection["link"][::2, k])
        np.testing.assert_array_equal(values[f"wrench/hub/m{axis}"], solution.wrench["hub"][::2, 3 + k])
    np.testing.assert_array_equal(values["axial/link"], solution.wrench["hub"][::2, 0])
    assert sum(name.startswith("internal/link/") for name in values) == 4 * 6  # order 4 has four Gauss points
    assert record.settings["link"] == "1 x order 4"


def test_flexible_torques_and_tips_have_error_bars(flexible: tuple[Mechanism, Case, Record]) -> None:
    mechanism, one, record = flexible
    for name in ("torque/hub", "tip/link/y"):
        bar = record.series[name].error
        assert bar is not None
        assert 0.0 < bar.max() < np.ptp(record.series[name].values)
    internal = next(s for s in record.series.values() if s.quantity == "internal")
    assert internal.error is None  # its places move with the mesh
    plain = engine.run(mechanism, one, "flexinv", {"error": False})
    assert plain.series["torque/hub"].error is None


def test_joints_without_a_drive_in_a_loop_give_nothing(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What rounding leaves there has no range to be compared with; anything larger is shown."""
    mechanism = load_mechanism(root / "models" / "slider_crank")
    one = replace(load_cases(root / "models" / "slider_crank", mechanism)["turns"], step=0.02, sample=0.02)
    record = engine.run(mechanism, one, "flexinv", {})
    check(record, sample_times(one))
    assert np.abs(record.series["torque/main"].values).max() > 1.0
    for name in ("crank_pin", "slide"):
        assert np.abs(record.series[f"torque/{name}"].values).max() == 0.0
    left = record.settings["largest effort left at passive joints [N m], [N]"]
    assert isinstance(left, float)
    assert 0.0 < left < 1e-12
    monkeypatch.setattr(engine, "ROUNDING", 1e-16)
    told = engine.run(mechanism, one, "flexinv", {}).series
    assert max(np.abs(told[f"torque/{name}"].values).max() for name in ("crank_pin", "slide")) == left


def test_rigid_mechanisms_and_unactuated_bases_have_every_torque(root: Path) -> None:
    mechanism = load_mechanism(root / "models" / "double_pendulum")
    one = case(Motion.point_to_point([0.0, 0.0], [1.0, -1.0], 0.1), 1e-2, 1e-2)
    record = engine.run(mechanism, one, "flexinv", {})
    assert {n for n in record.series if n.startswith("torque/")} == {f"torque/{n}" for n in mechanism.velocity_names}
    assert all(s.error is None for s in record.series.values())
    assert engine.unsupported(mechanism, one, "flexinv") is None


def test_a_meshed_link_is_drawn_with_all_of_its_interfaces(root: Path) -> None:
    mechanism = load_mechanism(root / "models" / "four_bar_bracket")
    one = next(iter(load_cases(root / "models" / "four_bar_bracket", mechanism).values()))
    solution = solve(mechanism, one.motion, one.step, end=2 * one.step, start=one.start)
    shapes = engine.collect_shapes(mechanism, solution, slice(None))
    (link,) = mechanism.meshed
    part = link.part
    assert part is not None
    places = [name.split("/")[2] for name in shapes if name.startswith(f"shape/{link.name}/") and name.endswith("/x")]
    assert places == ["origin", *(each.name for each in part.moved if each.name != part.tip)]
    for place in places[1:]:
        ends = [np.array([shapes[f"shape/{link.name}/{at}/{x}"].values[0] for x in "xyz"]) for at in ("origin", place)]
        stressless = np.linalg.norm(part.interface_of[place].origin)
        # the march starts undeformed: rounding alone
        assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(stressless, rel=1e-9)
