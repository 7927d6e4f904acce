"""FMUs compiled from case kits: they give the reference's torques, are FMUs by FMPy's own check, and other kits are refused."""

from __future__ import annotations

import importlib.util
import json
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
EXACT = 1e-12  # of the range: closed formulas of a few links on both sides; loops leave 1e-14 of a length to Newton's method
MODELS = Path(__file__).resolve().parents[3] / "models"


def scene(rung: str) -> tuple[Mechanism, Case]:
    mechanism = load_mechanism(FOLDER / rung)
    return mechanism, next(iter(load_cases(FOLDER / rung, mechanism).values()))


@compiled
@pytest.mark.parametrize("rung", ["double_pendulum", "tree", "drives", "loop", "gears", "redundant_drives"])
def test_torques_are_those_of_the_reference(rung: str, tmp_path: Path) -> None:
    agrees(*scene(rung), tmp_path)


def agrees(mechanism: Mechanism, case: Case, tmp_path: Path) -> None:
    """The torques of the FMU that is compiled of a case are those of the reference."""
    write(mechanism, case, tmp_path / "kit")
    same(mechanism, case, make_fmu.make(tmp_path / "kit", tmp_path / "plant.fmu"))


def same(mechanism: Mechanism, case: Case, file: Path) -> None:
    """The torques of an FMU at a case are those of the reference."""
    result = fmu.open_adapter("plant", "", {"fmu": str(file), "cases": ["*"]}).run(mechanism, case, "plant", {})
    ours = adapter(ENGINES["flexinv"]).run(mechanism, case, "flexinv", {"error": False})
    size = max(float(np.ptp(s.values)) for s in ours.series.values() if s.quantity == "torque")
    for name, one in result.series.items():
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
        ("phases", "closures that are revolute or spherical or coupling alone are compiled here; phases has fixed"),
        ("beam_moving", "rigid links alone are compiled here; beam_moving bends"),
        ("free_base", "revolute and prismatic joints alone are compiled here; free_base has "),
    ],
)
def test_other_kits_are_refused_in_words(rung: str, words: str, tmp_path: Path) -> None:
    mechanism, case = scene(rung)
    write(replace(mechanism, name=rung), case, tmp_path / "kit")
    with pytest.raises(make_fmu.UnsupportedKit, match=words):
        make_fmu.make(tmp_path / "kit", tmp_path / "plant.fmu")


@compiled
@pytest.mark.skipif(not MODELS.is_dir(), reason="the models are not here: this is no checkout")
@pytest.mark.parametrize("name", ["bricard", "slider_crank", "geared_four_bar"])
def test_loops_of_the_models_are_those_of_the_reference(name: str, tmp_path: Path) -> None:
    """Bricard's six hinges leave a freedom that no count of equations shows; a slide; gears beside a loop."""
    mechanism = load_mechanism(MODELS / name)
    case = next(iter(load_cases(MODELS / name, mechanism).values()))
    agrees(mechanism, case, tmp_path)


@compiled
@pytest.mark.skipif(not MODELS.is_dir(), reason="the models are not here: this is no checkout")
def test_one_fmu_computes_a_loop_in_both_of_its_branches(tmp_path: Path) -> None:
    """A four-bar closes open and crossed: the FMU of one case is told where the others begin."""
    mechanism = load_mechanism(MODELS / "four_bar")
    cases = load_cases(MODELS / "four_bar", mechanism)
    write(mechanism, cases["crossed"], tmp_path / "kit")
    file = make_fmu.make(tmp_path / "kit", tmp_path / "plant.fmu")
    for name in ("turn", "crossed"):
        same(mechanism, cases[name], file)


@compiled
def test_a_loop_that_cannot_close_is_an_error_and_no_number(tmp_path: Path) -> None:
    """Far links: Newton's method has nowhere to go, and the FMU says so instead of giving efforts."""
    mechanism, case = scene("loop")
    write(mechanism, case, tmp_path / "kit")
    said = json.loads((tmp_path / "kit" / "case.json").read_text())
    for joint in said["mechanism"]["joints"]:
        joint["frame"]["position"] = [10.0 * x for x in joint["frame"]["position"]]
    said["mechanism"]["closures"][0]["second"]["frame"]["position"] = [99.0, 0.0, 0.0]
    (tmp_path / "kit" / "case.json").write_text(json.dumps(said))
    file = make_fmu.make(tmp_path / "kit", tmp_path / "plant.fmu")
    with pytest.raises(Exception, match="fmi2GetReal"):
        fmu.open_adapter("plant", "", {"fmu": str(file), "cases": ["*"]}).run(mechanism, case, "plant", {})


@compiled
def test_forward_dynamics_of_loops_is_refused(tmp_path: Path) -> None:
    write(*scene("loop"), tmp_path / "kit")
    with pytest.raises(make_fmu.UnsupportedKit, match="forward dynamics of trees alone"):
        make_fmu.make(tmp_path / "kit", tmp_path / "plant.fmu", forward=True)


@compiled
def test_every_mechanism_of_a_folder_has_its_fmu_or_a_reason(tmp_path: Path) -> None:
    refused = make_fmu.make_every(FOLDER, tmp_path / "fmus")
    made = {file.stem for file in (tmp_path / "fmus").glob("*.fmu")}
    assert made == {"double_pendulum", "tree", "drives", "loop", "gears", "redundant_drives"}
    assert {f.name for f in FOLDER.iterdir()} == made | set(refused)
