"""Records of machines: reading, cutting, filtering, and that an unseen half stays unseen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from crosscheck.measured import arm
from crosscheck.measured.filters import lag, low_pass, undo_lag
from crosscheck.measured.recording import Recording, read_recording
from crosscheck.studies import measured_arm
from flexinv.errors import InputError
from flexinv.files.load_mechanism import load_mechanism

H = 0.004
TIME = H * np.arange(2500)


@pytest.fixture(scope="module")
def record(root: Path) -> Recording:
    return read_recording(root / "models" / measured_arm.FLEXIBLE / measured_arm.RECORD, arm.COLUMNS)


# ------------------------------------------------------------------------------------------------------------ files


def test_the_record_is_what_the_study_says(record: Recording) -> None:
    assert record.spacing == pytest.approx(H, abs=1e-12)
    assert record.size * record.spacing == pytest.approx(measured_arm.PART * measured_arm.PARTS)
    counts = record.signals["shoulder_deg"] / (360.0 / (4 * 1024 * 100))
    assert np.abs(counts - np.round(counts)).max() < 0.02  # encoder counts, written with five decimals: to 0.6 % of one


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time_s,a_deg\n0,1\n0.1,2\n", "line 1 has no column b_A; it has time_s, a_deg"),
        ("time_s,a_deg,b_A\n0,1,1\n0.1,2,2\n0.3,2,2\n", "column time_s is not evenly spaced by 0.15 s"),
        ("time_s,a_deg,b_A\n0,1,nan\n0.1,2,2\n", "a number is missing"),
    ],
)
def test_bad_records_are_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "r.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        read_recording(tmp_path / "r.csv", ("a_deg", "b_A"))


def test_parts_share_no_sample_and_leave_none_out(record: Recording) -> None:
    cuts = [record.cut(measured_arm.PART * k, measured_arm.PART) for k in range(measured_arm.PARTS)]
    for name, whole in record.signals.items():
        np.testing.assert_array_equal(np.concatenate([cut.signals[name] for cut in cuts]), whole)
    with pytest.raises(InputError, match="the record goes from 0 to 20 s"):
        record.cut(16.0, 5.0)


def test_every_split_has_each_part_once() -> None:
    for split in measured_arm.SPLITS:
        assert sorted(split.seen + split.unseen) == list(range(measured_arm.PARTS))


def test_an_unseen_half_that_is_spoilt_changes_nothing_of_the_seen_one(root: Path, record: Recording) -> None:
    """Not a digit: parts are cut before they are smoothed and differentiated."""
    mechanism = load_mechanism(root / "models" / measured_arm.RIGID)
    for split in measured_arm.SPLITS:
        spoilt = {name: values.copy() for name, values in record.signals.items()}
        for part in split.unseen:
            rows = slice(round(measured_arm.PART / H) * part, round(measured_arm.PART / H) * (part + 1))
            for values in spoilt.values():
                values[rows] = 1e3
        seen = measured_arm.parts(record, split.seen, mechanism)
        again = measured_arm.parts(Recording(0.0, record.spacing, spoilt), split.seen, mechanism)
        for ours, theirs in zip(seen, again, strict=True):
            for name in ("q", "qd", "qdd", "measured", "raw", "used"):
                np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))


# ---------------------------------------------------------------------------------------------------------- filters


@pytest.mark.parametrize(
    ("frequency", "left"), [(1.9, 1.0), (7.5, 1 / (1 + 0.5**8)), (15.0, 0.5), (33.0, 1 / (1 + 2.2**8))]
)
def test_the_low_pass_has_its_stated_gain_and_no_delay(frequency: float, left: float) -> None:
    """In the middle, far from the ends; the bilinear transform warps frequencies by (pi f h)^2 / 3, 0.02 of 33 Hz."""
    wave = np.sin(2 * np.pi * frequency * TIME)
    inner = slice(500, 2000)
    rest = low_pass(wave, H, 15.0)[inner] - left * wave[inner]
    assert np.abs(rest).max() < 2e-3  # 8 * 0.02 of the gain at 33 Hz, which is 1.8e-3; at 15 Hz 8 / 2 * 1e-4 of 0.5


def test_the_gauges_filter_is_its_differential_equation() -> None:
    """y'' + 2 d w y' + w^2 y = w^2 x of a sine that began at rest, by its steady answer once the start has died away."""
    frequency, damping, at = 2.0, 0.9, 1.9
    wave = np.sin(2 * np.pi * at * TIME)
    ratio = at / frequency
    answer = 1.0 / (1.0 - ratio**2 + 2j * damping * ratio)
    steady = np.abs(answer) * np.sin(2 * np.pi * at * TIME + np.angle(answer))
    # A sine drawn linearly between samples is smaller by (2 pi f h)^2 / 12 = 2e-4.
    assert np.abs(lag(wave, H, frequency, damping) - steady)[1000:].max() < 3e-4
    assert lag(np.full(50, 0.7), H, frequency, damping) == pytest.approx(0.7, abs=1e-12)  # it stood still before


def test_the_lag_can_be_undone() -> None:
    wave = np.exp(-(((TIME - 5.0) / 0.4) ** 2))
    back = undo_lag(lag(wave, H, 2.0, 0.9), H, 2.0, 0.9)
    # Differences of second order, twice: (h / 0.4 s)^2 times the fourth derivative's size of some ten.
    assert np.abs(back - wave).max() < 1e-3
