"""FMUs compiled from case kits: they give the reference's torques, are FMUs by FMPy's own check, and other kits are refused."""

from __future__ import annotations

import importlib.util
import shutil
from dataclasses import replace
from pathlib import Path

import make_fmu
import numpy as np
import pytest

from crosscheck.conform.ladder import FOLDER
from crosscheck.doors import fmu
from crosscheck.engines import ENGINES, adapter
from crosscheck.kit.write import write
from flexinv.files.load_cases import Case, load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Mechanism

WHY_NOT = "FMPy is not installed" if importlib.util.find_spec("fmpy") is None else "there is no C compiler"
compiled = pytest.mark.skipif(importlib.util.find_spec("fmpy") is None or shutil.which("gcc") is None, reason=WHY_NOT)
EXACT = 1e-12  # of the range: closed formulas of a few links on both sides


def scene(rung: str) -> tuple[Mechanism, Case]:
    mechanism = load_mechanism(FOLDER / rung)
    return mechanism, next(iter(load_cases(FOLDER / rung, mechanism).values()))


@compiled
@pytest.mark.parametrize("rung", ["double_pendulum", "tree", "drives"])
def test_torques_are_those_of_the_reference(rung: str, tmp_path: Path) -> None:
    mechanism, case = scene(rung)
    write(mechanism, case, tmp_path / "kit")
    file = make_fmu.make(tmp_path / "kit", tmp_path / "plant.fmu")
    theirs = fmu.opened("plant", "", {"fmu": str(file), "cases": ["*"]}).run(mechanism, case, "plant", {})
    ours = adapter(ENGINES["flexinv"]).run(mechanism, case, "flexinv", {"error": False})
    size = max(float(np.ptp(s.values)) for s in ours.series.values() if s.quantity == "torque")
    for name, one in theirs.series.items():
        assert float(np.abs(one.values - ours.series[name].values).max()) <= EXACT * size, name


@compiled
@pytest.mark.parametrize("forward", [False, True])
def test_fmpy_finds_nothing_wrong_with_them(forward: bool, tmp_path: Path) -> None:
    validate = importlib.import_module("fmpy.validation").validate_fmu
    write(*scene("tree"), tmp_path / "kit")
    assert validate(str(make_fmu.make(tmp_path / "kit", tmp_path / "plant.fmu", forward))) == []


@pytest.mark.parametrize(
    ("rung", "words"),
    [
        ("loop", "trees alone are compiled here; loop has closures"),
        ("beam_moving", "rigid links alone are compiled here; beam_moving bends"),
        ("free_base", "revolute and prismatic joints alone are compiled here; free_base has "),
    ],
)
def test_other_kits_are_refused_in_words(rung: str, words: str, tmp_path: Path) -> None:
    mechanism, case = scene(rung)
    write(replace(mechanism, name=rung), case, tmp_path / "kit")
    with pytest.raises(make_fmu.Refused, match=words):
        make_fmu.make(tmp_path / "kit", tmp_path / "plant.fmu")
