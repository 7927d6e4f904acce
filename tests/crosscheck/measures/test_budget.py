"""Error bars: the order of a made error is found, bars cover it, and runs that do not converge are not extrapolated."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crosscheck.engines import ENGINES, adapter
from crosscheck.engines.shared import rounding as rounding_bars
from crosscheck.measures.budget import (
    FORMAL,
    UNORDERED,
    Family,
    add_error_bars,
    compute_error_bar,
    compute_extrapolated_bar,
    compute_richardson_limit,
    has_no_order,
)
from crosscheck.measures.metrics import compute_sprague_geers
from crosscheck.measures.record import Record, series
from flexinv.files.load_cases import load_cases
from flexinv.files.load_mechanism import load_mechanism

TIME = np.linspace(0.0, 1.0, 401)
EXACT = np.sin(7.0 * TIME)
SHAPE = np.cos(11.0 * TIME) + 0.3


def levels(order: float, size: float = 1e-2, count: int = 3) -> list[np.ndarray]:
    """Runs whose error is size * shape * h^order with h = 1, 1/2, 1/4, ..."""
    return [EXACT + size * SHAPE * 2.0 ** (-order * k) for k in range(count)]


@pytest.mark.parametrize("order", [1.0, 2.0, 3.7])
@pytest.mark.parametrize("value", [0, 1, 2])
def test_the_order_is_found_and_the_bar_is_the_error(order: float, value: int) -> None:
    """Up to order 2; of a higher one the bar believes 2 all the same: it is longer, by the extrapolation's own error."""
    runs = levels(order)
    error_bar = compute_error_bar(runs, value)
    assert error_bar.how == "Richardson"
    assert error_bar.order == pytest.approx(order, abs=1e-9)  # the error has one power of h, so only rounding is left
    error = np.abs(runs[value] - EXACT)
    assert (error_bar.bar >= error * (1 - 1e-9)).all()  # equal at the largest values, wider at zeros
    if order <= FORMAL:
        assert error_bar.bar.max() == pytest.approx(error.max(), rel=1e-6)


def test_an_order_that_is_too_high_makes_no_short_bar() -> None:
    """A mesh error of order 5 covers a step error of order 2 in the first runs; the next run stays inside the bar."""
    runs = [EXACT + SHAPE * (1e-2 * h**5 + 1e-5 * h**2) for h in (1.0, 0.5, 0.25, 0.125)]
    error_bar = compute_error_bar(runs[:3])
    assert error_bar.order == pytest.approx(5.0, abs=0.2)
    assert error_bar.order is not None
    assert (np.abs(runs[3] - runs[2]) <= error_bar.bar).all()
    believed = np.abs(runs[2] - runs[1]) / (2.0**error_bar.order - 1.0)  # what Richardson's formula would say
    assert np.abs(runs[3] - runs[2]).max() > 0.9 * believed.max()


def test_runs_that_do_not_converge_get_the_largest_difference() -> None:
    swinging = [EXACT + 1e-2 * SHAPE * s for s in (1.0, -0.5, 0.25)]
    slow = levels(0.3)
    growing = levels(2.0)[::-1]
    noise = list(EXACT + 0.016 * np.random.default_rng(2).standard_normal((3, TIME.size)))
    for runs, how in ((swinging, "largest difference"), (slow, UNORDERED), (growing, UNORDERED), (noise, UNORDERED)):
        error_bar = compute_error_bar(runs)
        assert (error_bar.how, error_bar.order) == (how, None)
        assert has_no_order({"how": {"step": error_bar.how}}) == (how == UNORDERED)
        assert error_bar.bar.max() == pytest.approx(max(np.abs(runs[-1] - one).max() for one in runs))


def test_rounding_has_no_order() -> None:
    noise = np.random.default_rng(0).standard_normal((3, TIME.size)) * 1e-15
    assert compute_error_bar(list(EXACT + noise)).how == "rounding"
    two = compute_error_bar(levels(2.0)[:2])
    assert (two.order, two.how) == (None, "difference of two runs")


def test_the_bar_of_an_extrapolated_result_covers_its_error_and_is_shorter_than_that_of_the_runs() -> None:
    runs = [EXACT + 1e-2 * SHAPE * (h**2 + 0.3 * h**4) for h in (1.0, 0.5, 0.25)]
    extrapolated_bar = compute_extrapolated_bar(runs)
    error = np.abs((4.0 * runs[2] - runs[1]) / 3.0 - EXACT)
    assert (extrapolated_bar.bar >= error).all()
    assert extrapolated_bar.bar.max() < np.abs(runs[1] - EXACT).max()
    coarse, fine = (a * 3 / 4 + 0.3 * b * 15 / 16 for a, b in ((1.0, 1.0), (1 / 4, 1 / 16)))  # |L1 - L0|, |L2 - L1|
    assert extrapolated_bar.order == pytest.approx(np.log2(coarse / fine))
    wild = compute_extrapolated_bar([EXACT + 1e-2 * SHAPE * s for s in (1.0, -0.5, 0.25)])
    assert wild.how == "largest difference"


def test_families_add_up_and_a_family_that_is_missing_leaves_no_bar() -> None:
    made = [series("torque/j", "N m", run) for run in levels(2.0)]
    both, lines = add_error_bars(made[0], [Family("step", made, 0), Family("mesh", made, 0)])
    once, _ = add_error_bars(made[0], [Family("step", made, 0)])
    assert np.allclose(both["torque/j"].error, 2.0 * once["torque/j"].error)
    assert set(lines["torque/j"]["order"]) == {"step", "mesh"}
    assert lines["torque/j"]["peak_bar"] > 0.0
    none, lines = add_error_bars(made[0], [Family("step", made, 0), Family("mesh", (made[0], {}, {}), 0)])
    assert none["torque/j"].error is None
    assert not lines
    limit = compute_richardson_limit(made)["torque/j"].values
    assert np.abs(limit - EXACT).max() < 1e-15  # the error is h^2 alone


# ------------------------------------------------------------------------------------------------------- the engines


def run(root: Path, model: str, engine: str, name: str = "", end: float | None = None, **options: int) -> Record:
    """Run one engine on a case (the first one) of a model as the child process does; end : in place of the case's own [s]."""
    mechanism = load_mechanism(root / "models" / model)
    cases = load_cases(root / "models" / model, mechanism)
    case = cases[name or next(iter(cases))]
    case = case if end is None else replace(case, end=end)
    driver = adapter(ENGINES[engine])
    record = driver.run(mechanism, case, engine, options)
    return rounding_bars.add_rounding_bars(driver, record, mechanism, case, {})


@pytest.mark.parametrize(
    ("model", "engine"),
    [
        ("double_pendulum", "flexinv"),
        ("double_pendulum", "pinocchio"),
        ("double_pendulum", "mujoco"),
        ("double_pendulum", "exudyn"),
        pytest.param("four_bar", "flexinv", marks=pytest.mark.slow),
        pytest.param("four_bar", "mujoco", marks=pytest.mark.slow),
    ],
)
def test_closed_formulas_have_bars_of_rounding(root: Path, model: str, engine: str) -> None:
    record = run(root, model, engine)
    torques = {n: s for n, s in record.series.items() if s.quantity == "torque"}
    size = max(np.abs(s.values).max() for s in torques.values())
    bars = [s.error for s in torques.values()]
    assert all(bar is not None for bar in bars)
    widest = max(float(bar.max()) for bar in bars if bar is not None)
    # 8 last digits of the input times the condition of a small mechanism: some 1e-15 to 1e-12 of the largest torque.
    assert 1e-16 * size < widest < 1e-11 * size
    assert "closed formulas" in str(record.budget[next(iter(torques))]["how"])


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["flexinv", "exudyn-ancf", "exudyn-ge", "mujoco-flex"])
def test_marches_have_bars_from_three_runs(root: Path, engine: str) -> None:
    # The move and half its length of free swinging.  MuJoCo's rod has half its usual points: the bars are four times as wide,
    # still a third of what is asked, and it takes an eighth of the time.
    options = {"elements": 16} if engine == "mujoco-flex" else {}
    record = run(root, "flex_one_link", engine, "cycloid", 0.3, **options)
    for name in ("torque/hub", "tip/link/y", "deflection/link/y"):
        one, line = record.series[name], record.budget[name]
        assert one.error is not None
        assert 0.0 < one.error.max() < 0.05 * np.ptp(one.values), name
        assert line["peak_bar"] < 0.05 * line["peak"]
        assert "difference of two runs" not in line["how"].values()
    torque = record.budget["torque/hub"]["order"]
    assert all(order is None or order > 0.5 for order in torque.values())
    if engine == "flexinv":
        # Generalized-alpha: order 2 in the step.  The torque (to 3e-5 of its range) still has modes that the step does not
        # resolve, and comes to its order later; the tip has it, the next term being 1e-3 of the first.
        assert record.budget["tip/link/y"]["order"]["step"] == pytest.approx(2.0, abs=0.01)


# ------------------------------------------------------------------------------------------------------------ metrics


def test_sprague_and_geers_tell_scale_from_shift() -> None:
    angle = 2.0 * np.pi * np.arange(1000) / 1000.0
    wave, shifted = np.sin(angle), np.sin(angle + 0.2)
    scaled = compute_sprague_geers(1.1 * wave, wave)
    assert scaled["magnitude"] == pytest.approx(0.1)
    assert scaled["phase"] == pytest.approx(0.0, abs=1e-12)
    moved = compute_sprague_geers(shifted, wave)
    assert moved["magnitude"] == pytest.approx(0.0, abs=1e-12)
    assert moved["phase"] == pytest.approx(0.2 / np.pi)
    assert compute_sprague_geers(-wave, wave)["phase"] == pytest.approx(1.0)
    both = compute_sprague_geers(1.1 * shifted, wave)
    assert both["comprehensive"] == pytest.approx(np.hypot(0.1, 0.2 / np.pi))
    assert compute_sprague_geers(wave, 0.0 * wave) == {}
    assert compute_sprague_geers(np.full(3, np.nan), wave[:3]) == {}


def test_a_record_with_bars_keeps_them(root: Path) -> None:
    record = run(root, "double_pendulum", "pinocchio")
    assert rounding_bars.add_rounding_bars(adapter(ENGINES["pinocchio"]), record, None, None, {}) is record  # type: ignore[arg-type]
    failed = replace(record, status="error")
    assert rounding_bars.add_rounding_bars(adapter(ENGINES["pinocchio"]), failed, None, None, {}) is failed  # type: ignore[arg-type]
