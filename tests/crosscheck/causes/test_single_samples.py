"""Outliers, dropouts and held values: where all other samples agree, they are what is wrong, and nothing else is named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crosscheck.causes.diagnosis import DiagnosisAnswer, diagnose
from crosscheck.causes.model import Model, make_model
from crosscheck.causes.selftest import replace_samples
from crosscheck.causes.single_samples import HELD, OUT, ZERO, Differences, find_suspects
from crosscheck.causes.subject import Subject
from crosscheck.engines import ENGINES, adapter
from crosscheck.measures.record import save
from crosscheck.run.child import make_certificate
from flexinv.files.load_cases import load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.typing import Array

MODELS = Path(__file__).resolve().parents[3] / "models"
ROWS = [31, 77, 90]


def diagnosed(
    folder: Path, changes: dict[str, Callable[[Array], Array]], model: str = "double_pendulum/swing"
) -> DiagnosisAnswer:
    """The diagnosis of Pinocchio whose efforts are changed after it gave them."""
    name, case = model.split("/")
    mechanism = load_mechanism(MODELS / name)
    motion = load_cases(MODELS / name, mechanism)[case]
    for called in ("pinocchio", "flexinv"):
        engine = adapter(ENGINES[called])
        record = engine.run(mechanism, motion, called, {"error": False})
        if called == "pinocchio":
            series = {
                key: replace(one, values=changes[key](one.values.copy())) if key in changes else one
                for key, one in record.series.items()
            }
            record = replace(record, series=series)
        save(replace(record, certificate=make_certificate(engine, mechanism, motion, called)), folder / called)
    return diagnose(str(MODELS / name), case, "pinocchio", str(folder / "pinocchio"), str(folder / "flexinv"))


def model_of_swing() -> Model:
    mechanism = load_mechanism(MODELS / "double_pendulum")
    return make_model(Subject(mechanism, load_cases(MODELS / "double_pendulum", mechanism)["swing"]))


def shifted(values: Array) -> Array:
    values[ROWS] += [3.0, -2.0, 1.0]
    return values


def dropped(values: Array) -> Array:
    values[ROWS] = 0.0
    return values


def held(values: Array) -> Array:
    for k in (40, 41, 42):
        values[k] = values[39]
    return values


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (shifted, "3 samples of 121 of the effort of knee stand out, the first at t = 0.31 s by 3 N m"),
        (dropped, "3 samples of 121 of the effort of knee are zero, the first at t = 0.31 s by "),
        (held, "3 samples of 121 of the effort of knee repeat the sample before, the first at t = 0.4 s by "),
    ],
)
def test_single_samples_are_named_with_what_they_are(
    change: Callable[[Array], Array], words: str, tmp_path: Path
) -> None:
    answer = diagnosed(tmp_path, {"torque/knee": change})
    assert [(one["cause"], one["target"]) for one in answer["named"]] == [("single samples", "knee")]
    assert words in answer["words"]
    assert "all other samples agree" in answer["words"]


def test_of_one_sample_the_words_are_for_one(tmp_path: Path) -> None:
    def drop(values: Array) -> Array:
        values[50] = 0.0
        return values

    words = diagnosed(tmp_path, {"torque/pivot": drop})["words"]
    assert words.startswith("1 sample of 121 of the effort of pivot is zero, at t = 0.5 s by ")


def test_two_joints_are_said_together(tmp_path: Path) -> None:
    answer = diagnosed(tmp_path, {"torque/knee": shifted, "torque/pivot": dropped})
    assert answer["named"][0]["target"] == "pivot, knee"
    assert "of knee stand out" in answer["words"]
    assert "of pivot are zero" in answer["words"]


def test_what_swells_and_sinks_is_no_single_sample(tmp_path: Path) -> None:
    """A smooth push of few samples: its neighbours differ nearly as much, and no gap lies between them."""

    def push(values: Array) -> Array:
        return values + np.exp(-(((np.arange(len(values)) - 75.0) / 2.0) ** 2))

    assert "single samples" not in {one["cause"] for one in diagnosed(tmp_path, {"torque/knee": push})["named"]}


def test_many_samples_are_no_single_ones(tmp_path: Path) -> None:
    def shake(values: Array) -> Array:
        values[::10] += 1.0
        return values

    assert "single samples" not in {one["cause"] for one in diagnosed(tmp_path, {"torque/knee": shake})["named"]}


def test_a_fault_beside_them_is_named_with_them(tmp_path: Path) -> None:
    """All samples are off by a scale, three by more: both are said, the scale with its size, the samples by what is beyond it."""
    answer = diagnosed(tmp_path, {"torque/knee": lambda values: shifted(1.05 * values)})
    assert [(one["cause"], one["target"]) for one in answer["named"]] == [("effort scale + single samples", "knee")]
    assert "the effort of knee is larger by the fraction 0.05" in answer["words"]
    assert "3 samples of 121 of the effort of knee stand out, the first at t = 0.31 s by 3 N m" in answer["words"]


def test_what_no_cause_explains_beside_them_stays_unknown(tmp_path: Path) -> None:
    """A hum of its own in all samples: the three are rough, and the rest has no name."""

    def hum(values: Array) -> Array:
        return shifted(values + np.sin(0.1 * np.arange(len(values))) ** 3)

    assert diagnosed(tmp_path, {"torque/knee": hum})["named"] == []


def test_the_suspects_are_what_is_stuck_and_what_is_rough() -> None:
    """A smooth difference has none; a sample that is off is one, and its neighbours are not."""
    time = np.linspace(0.0, 1.0, 101)
    expected = np.stack([np.sin(7.0 * time) + 2.0, np.cos(5.0 * time)], axis=1)
    smooth = 1.05 * expected
    swing = model_of_swing()
    calm = Differences(replace(swing, scale=np.ones(2)), time, smooth, expected, np.full(2, 1e-9))
    assert not find_suspects(calm).any()
    off = smooth.copy()
    off[[20, 50], 0] += [0.4, -0.1]
    off[70:73, 1] = off[69, 1]
    suspects = find_suspects(replace(calm, given=off))
    assert set(np.flatnonzero(suspects[:, 0])) >= {20, 50}
    assert not suspects[[19, 21, 49, 51], 0].any()
    assert set(np.flatnonzero(suspects[:, 1])) >= {70, 71, 72}
    assert suspects.sum(axis=0).max() <= 5  # of a hundred
    many = smooth.copy()
    many[10:30] = many[9]  # no single ones
    assert not find_suspects(replace(calm, given=many))[10:30].any()


@pytest.mark.parametrize("kind", [OUT, ZERO, HELD])
def test_a_bench_spoils_few_samples(kind: str) -> None:
    values = np.sin(np.linspace(0.1, 3.0, 61)) + 1.0
    changed = np.flatnonzero(replace_samples(values, kind) != values)
    assert len(changed) == 3  # a twentieth
    assert changed.min() >= 2
    assert changed.max() < len(values) - 1
