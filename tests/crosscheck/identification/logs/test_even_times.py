"""Signals at uneven times are taken at even ones: what is smooth stays what it is, and no spline swings out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from logged_arm import jitter

from crosscheck.identification.logs.even_times import take_even_times
from crosscheck.identification.logs.log import Log, read_log
from flexinv.errors import InputError


def test_a_smooth_signal_stays_what_it_is() -> None:
    """Cubic splines err by 5/384 h^4 q'''': h = 12 ms at most, q'''' = (2 pi 2 Hz)^4; linear pieces by h^2 q''/8, 6e-3."""
    at = jitter(np.arange(0.0, 4.0, 0.004), 0)
    even, columns = take_even_times([(at, {"q": np.sin(4.0 * np.pi * at)})])
    assert np.ptp(np.diff(even)) < 1e-12
    assert np.abs(columns["q"] - np.sin(4.0 * np.pi * even)).max() < 5.0 / 384.0 * 0.012**4 * (4.0 * np.pi) ** 4 * 2.0


def test_two_samples_at_nearly_the_same_time_do_not_swing_out() -> None:
    at = np.sort(np.append(np.arange(0.0, 1.0, 0.01), 0.5 + 1e-6))
    values = np.where(at > 0.5, 1.0, 0.0)
    columns = take_even_times([(at, {"q": values})])[1]
    assert (columns["q"].min(), columns["q"].max()) == (0.0, 1.0)


def test_slower_signals_and_silence(tmp_path: Path) -> None:
    quick, slow = np.arange(0.0, 2.0, 0.01), np.arange(0.0, 2.0, 0.05)
    slow = slow[(slow < 0.5) | (slow > 1.3)]
    even, columns = take_even_times([(quick, {"a": quick}), (slow, {"b": slow})])
    last, first = slow[slow < 0.5][-1], slow[slow > 0.5][0]
    said = (even < last - 0.005) | (even > first + 0.005)  # at the ends of the gap rounding decides
    assert np.isnan(columns["b"][(even > last + 0.005) & (even < first - 0.005)]).all()
    assert np.abs(columns["b"] - np.minimum(even, slow[-1]))[said].max() < 1e-12
    assert np.abs(columns["a"] - even).max() < 1e-12


def test_uneven_steps_of_a_file_are_said_and_gaps_refused(tmp_path: Path) -> None:
    time = np.arange(0.0, 4.0, 0.004)
    at = jitter(time, 1)
    pd.DataFrame({"time_s": at, "q": np.sin(at)}).to_csv(tmp_path / "log.csv", index=False)
    log = read_log(tmp_path / "log.csv")
    assert np.abs(log.read_column("q") - np.sin(log.time)).max() < 1e-9
    assert "of its steps are uneven" in log.notes[0]
    assert "taken at even steps of 0.004 s" in log.notes[0]
    assert log.take_interval(1.0, 2.0).notes == log.notes
    pd.DataFrame({"time_s": time, "q": time}).to_csv(tmp_path / "even.csv", index=False)
    assert read_log(tmp_path / "even.csv").notes == Log("", time, {}).notes
    pd.DataFrame({"time_s": at + 0.1 * (at > 2.0), "q": at}).to_csv(tmp_path / "gap.csv", index=False)
    with pytest.raises(InputError, match=r"gap\.csv: times jump at [\d.]+ s by 0\.1"):
        read_log(tmp_path / "gap.csv")
