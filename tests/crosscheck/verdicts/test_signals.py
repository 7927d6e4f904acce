"""Blessed signals: what moves by more than error bars is told with what has changed, and what lies inside of them is silent."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from crosscheck_examples import write_models

from crosscheck.cli import main
from crosscheck.measures.record import Record, Series
from crosscheck.verdicts.provenance import Provenance, join_provenance, read_provenance, write_provenance
from crosscheck.verdicts.results import Results, read
from crosscheck.verdicts.signals import (
    SAMPLES,
    SignalsError,
    describe_series,
    describe_signals,
    find_moves,
    read_signals,
    write_signals,
)

TIME = np.linspace(0.0, 1.0, 301)
KEY = ("arm", "swing", "mujoco", "torque/hub")
# From 0.001 to 50 %, of both signs.
CHANGES = [sign * size for size in np.geomspace(1e-5, 0.5, 20) for sign in (1.0, -1.0)]


def series(values: np.ndarray, bar: float | None) -> Series:
    error = None if bar is None else np.full(values.shape, bar)
    return Series("torque/hub", "N m", values, error)


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("bars", [0.5, 3.5])
def test_what_moves_by_three_bars_is_told_and_what_moves_by_less_than_one_is_silent(change: float, bars: float) -> None:
    """The bar is a part of the change, or several changes wide: the move is told, or it is not."""
    values = 5.0 * np.sin(9.0 * TIME) + 1.0
    bar = abs(change) * np.abs(values).max() * bars / 3.0
    before, after = (describe_series(series(v, bar)) for v in (values, (1.0 + change) * values))
    move = find_moves(KEY, before, after)
    if bars > 3.0:
        assert move is None
    else:
        assert move is not None
        assert move.share == pytest.approx(abs(change) * 6.0 / before.size, rel=0.6)  # the peak, or an offset sample
        assert "torque/hub" in move.words


def test_a_shift_in_time_moves_values_although_peak_and_rms_stay() -> None:
    values = np.sin(2.0 * np.pi * TIME)
    before, after = (describe_series(series(v, 1e-4)) for v in (values, np.roll(values, 3)))
    assert before.peak == pytest.approx(after.peak)
    move = find_moves(KEY, before, after)
    assert move is not None
    assert move.what == "value"


def test_an_engine_without_bars_is_taken_to_repeat_to_a_millionth_of_the_range() -> None:
    values = np.cos(TIME)
    before = describe_series(series(values, None))
    assert find_moves(KEY, before, describe_series(series(values * (1.0 + 1e-7), None))) is None
    assert find_moves(KEY, before, describe_series(series(values * (1.0 + 1e-5), None))) is not None


def test_last_digits_are_silent_however_short_a_bar_is() -> None:
    values = np.cos(TIME)
    before = describe_series(series(values, 0.0))
    assert find_moves(KEY, before, describe_series(series(values * (1.0 + 1e-12), 0.0))) is None


def test_a_signal_that_is_zero_throughout_has_not_moved_and_one_that_begins_to_act_has() -> None:
    nothing = describe_series(series(np.zeros(301), 0.0))
    assert find_moves(KEY, nothing, nothing) is None
    assert find_moves(KEY, nothing, describe_series(series(np.cos(TIME), 0.0))) is not None


def test_a_series_that_is_not_given_any_more_or_in_another_unit_is_told() -> None:
    before = describe_series(series(np.cos(TIME), 1e-6))
    for after in (None, replace(before, unit="N")):
        move = find_moves(KEY, before, after)
        assert move is not None
        assert move.words == "arm/swing mujoco: torque/hub was 1 N m and is not given any more"


def test_signals_come_back_from_their_table_within_their_bars(tmp_path: Path) -> None:
    """Ten digits of a value, and bars that are not shorter: what is written and read has not moved."""
    rng = np.random.default_rng(7)
    record = Record("mujoco", time=TIME, series={"torque/hub": series(rng.normal(size=301), 1e-7)})
    (signal,) = describe_signals(record, ["torque"]).values()
    assert describe_signals(record, ["tip"]) == {}
    write_signals(tmp_path, {KEY: signal})
    (read_back,) = read_signals(tmp_path).values()
    assert read_back.values.shape == (SAMPLES,)
    assert (read_back.bars >= signal.bars).all()
    assert find_moves(KEY, read_back, signal) is None
    written = (tmp_path / "signals.csv").read_bytes()
    write_signals(tmp_path, {KEY: read_back})  # as a blessing of another part does
    assert (tmp_path / "signals.csv").read_bytes() == written
    (tmp_path / "signals.csv").write_text((tmp_path / "signals.csv").read_text().replace("N m,", "N m,nan", 1))
    with pytest.raises(SignalsError, match=r"signals\.csv, line 2"):
        read_signals(tmp_path)


def test_what_changed_is_named_in_the_order_of_nearness(tmp_path: Path) -> None:
    run = "arm/swing mujoco"
    before = Provenance(
        files={"arm": {"mechanism.toml": "1", "cases.toml": "1"}},
        engines={run: {"model": "1", "version": "3.9", "settings": "1"}},
        packages={"numpy": "2.1"},
        code={"flexinv": "1"},
    )
    write_provenance(tmp_path, before)
    assert read_provenance(tmp_path) == before
    assert before.describe_source_changes(before, "arm", "swing", "mujoco") == ""

    def after(**changes: object) -> str:
        return replace(before, **changes).describe_source_changes(before, "arm", "swing", "mujoco")  # type: ignore[arg-type]

    engine = {"model": "1", "version": "3.9", "settings": "1"}
    files = {"arm": {"mechanism.toml": "2", "cases.toml": "1"}}
    assert after(files=files) == ""  # a comment: what engines were given is the same
    assert after(files=files, engines={run: {**engine, "model": "2"}}) == "the model arm (mechanism.toml)"
    assert after(engines={run: {**engine, "version": "4.0"}}) == "the version of mujoco (3.9 -> 4.0)"
    assert after(engines={run: {**engine, "settings": "2"}}) == "the settings of mujoco"
    both = after(packages={"numpy": "2.2"}, code={"flexinv": "2"})
    assert both == "versions of packages (numpy) and our own code (flexinv)"
    assert join_provenance(before, replace(before, files={"other": {}})).files == {**before.files, "other": {}}


@pytest.fixture
def project(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    write_models(tmp_path / "models", root)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("CROSSCHECK_KEPT", "")
    return tmp_path


def run(code: int) -> Results:
    words = ["run", "--engines", "flexinv,pinocchio", "--studies", "", "--baseline", "blessed", "--jobs", "1"]
    done = CliRunner().invoke(main, words)
    assert done.exit_code == code, done.output
    return read(Path("reports/latest/results.json"))


def test_a_changed_mass_that_all_engines_follow_is_one_change_of_the_model(project: Path) -> None:
    """Every difference stays within its limit: only values tell.  Untouched files and comments are silent."""
    run(code=1)  # nothing is blessed yet
    done = CliRunner().invoke(main, ["bless", "--reason", "a first look", "--baseline", "blessed"])
    assert done.exit_code == 0, done.output
    assert "signals blessed" in done.output
    file = project / "models" / "double_pendulum" / "mechanism.toml"
    text = file.read_text()
    file.write_text(f"# a comment\n{text}")
    assert run(code=0).moves == ()
    assert "mass_kg = 1.0" in text
    file.write_text(text.replace("mass_kg = 1.0", "mass_kg = 1.1", 1))
    results = run(code=1)
    assert {row.verdict for row in results.comparisons} == {"within"}
    assert list(results.moves_by_reason) == ["the model double_pendulum (mechanism.toml)"]
    assert {move.engine for move in results.moves} == {"flexinv", "pinocchio"}
    for name in ("index.html", "summary.md", "junit.xml"):
        page = Path("reports/latest", name).read_text()
        assert "changed since: the model double" in page.replace("\\_", "_").replace("&#95;", "_")
    done = CliRunner().invoke(main, ["bless", "--reason", "a heavier rod", "--baseline", "blessed"])
    assert "moved by more than their error bars" in done.output
    assert "the model double_pendulum (mechanism.toml)" in done.output
    assert run(code=0).moves == ()


def test_what_an_engine_iterates_may_move_by_its_tolerance_and_rounding_of_other_components_is_silent() -> None:
    """Exudyn's DAE repeats to a millionth of the largest component on another processor, Pinocchio to rounding of it."""
    main_part = np.sin(9.0 * TIME)

    def describe(engine: str, shift: float, component: float) -> dict[str, Any]:
        parts = {"tip/hand/x": main_part + shift, "tip/hand/z": np.full_like(TIME, component)}
        made = {name: Series(name, "m", values, np.full_like(TIME, 1e-15)) for name, values in parts.items()}
        return describe_signals(Record(engine, time=TIME, series=made), ["tip"])

    for engine, silent, told in (("exudyn-dae", 5e-7, 1e-5), ("pinocchio", 5e-10, 1e-8)):
        before = describe(engine, 0.0, 1e-17)
        small = describe(engine, silent, -3e-17)
        large = describe(engine, told, told)
        for name in before:
            assert find_moves((*KEY[:3], name), before[name], small[name]) is None
            assert find_moves((*KEY[:3], name), before[name], large[name]) is not None
