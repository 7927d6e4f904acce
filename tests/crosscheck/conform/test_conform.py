"""The ladder: a sound engine holds its rungs, a wrong sign is refused in a blind round, and numbers are new every time."""

from __future__ import annotations

import json
import shutil
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rogue_engines
from click.testing import CliRunner

from crosscheck.cli import main
from crosscheck.conform import blind, ladder
from crosscheck.run.run_state import INTERRUPTED
from crosscheck.verdicts.compare import Comparison
from crosscheck.verdicts.plan import discover
from crosscheck.verdicts.results import CaseRow, Results, RunRow, read
from flexinv.files.load_cases import load_cases
from flexinv.files.load_mechanism import load_mechanism

PROGRAMS = Path(rogue_engines.__file__).parent / "kit_programs"
CONFIG = f'[engines.mine]\ncommand = [{json.dumps(sys.executable)}, "./rigid.py", "{{kit}}", "{{out}}"]\n'


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder with a program in it: no models, nothing of ours."""
    shutil.copy(PROGRAMS / "rigid.py", tmp_path)
    text = CONFIG.replace("./rigid.py", str(tmp_path / "rigid.py"))
    (tmp_path / "crosscheck.toml").write_text(text)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def conform(*words: str) -> Any:
    return CliRunner().invoke(main, ["conform", *words, "--trust-commands"])


def test_every_rung_is_a_mechanism_with_one_case() -> None:
    tasks = discover(ladder.FOLDER).tasks
    assert {task.folder.name for task in tasks} == set(ladder.RUNGS)
    assert len(tasks) == len(ladder.RUNGS)
    assert all(len(task.case.limits) == 1 for task in tasks)


@pytest.mark.slow
def test_a_sound_program_holds_what_it_climbs(project: Path) -> None:
    done = conform("mine", "--rungs", "double_pendulum,loop,free_base")
    assert done.exit_code == 0, done.output
    assert "holds 3 of 13 rungs of crosscheck-ladder/1: double pendulum, loop, certificate" in done.output
    results = read(project / "reports" / "conform" / "results.json")
    (table,) = results.studies
    assert {row["verdict"] for row in table.rows if row["rung"] in ("double pendulum", "loop")} == {"within"}
    assert (project / "reports" / "conform" / "studies" / "conform.html").is_file()
    assert "double pendulum" in (project / "reports" / "conform" / "junit.xml").read_text()


@pytest.mark.slow
def test_a_blind_round_refuses_a_wrong_sign(project: Path) -> None:
    assert conform("mine", "--rungs", "drives", "--blind").exit_code == 0
    text = (project / "rigid.py").read_text()
    wrong = text.replace('joint["stiffness"] * (q[k] - joint["rest"])', 'joint["stiffness"] * (joint["rest"] - q[k])')
    assert wrong != text
    (project / "rigid.py").write_text(wrong)
    done = conform("mine", "--rungs", "drives", "--blind", "--seed", "7")
    assert done.exit_code == 1
    assert "blind (seed 7)" in done.output
    assert "not: drives" in done.output
    (table,) = read(project / "reports" / "conform" / "results.json").studies
    assert "seed 7, drawn when the round began" in table.text
    assert "Programs ran in an empty folder without this project in reach: mine." in table.text


@pytest.mark.slow
def test_a_program_cannot_ask_us_in_a_blind_round(project: Path) -> None:
    (project / "rigid.py").write_text("import flexinv\n")
    done = conform("mine", "--rungs", "double_pendulum", "--blind")
    assert done.exit_code == 2
    assert "flexinv is out of reach in a blind round" in done.output


def test_what_cannot_be_asked_is_said(project: Path) -> None:
    assert "leaves no engine" in conform("flexinv").output
    assert "--seed belongs to --blind" in conform("mine", "--seed", "1").output
    (project / "models" / "arm" / "records" / "adams").mkdir(parents=True)
    assert "adams is a record: it cannot be asked blind" in conform("adams", "--blind").output
    with (project / "crosscheck.toml").open("a") as config:
        config.write('[engines.plant]\nfmu = "plant.fmu"\n')
    (project / "plant.fmu").touch()
    assert "plant is an FMU, whose numbers are compiled in: it cannot be asked" in conform("plant", "--blind").output
    assert conform("nobody").exit_code == 2


def test_a_rung_whose_reference_was_interrupted_is_not_finished_and_a_failure_stays_one() -> None:
    here = ("loop", "turn")
    mine, ours = RunRow(*here, "mine", "ok"), RunRow(*here, "flexinv", "error", INTERRUPTED)
    row = Comparison(*here, "mine", "flexinv", "torque", "N m", "error", "flexinv: interrupted")
    cut = Results("", message="interrupted", cases=(CaseRow(*here),), runs=(mine, ours), comparisons=(row,))

    def said(results: Results) -> str:
        (rung,) = (one for one in ladder.list_rungs(results, "mine") if one.name == "loop")
        return rung.message

    assert (
        said(cut) == said(replace(cut, runs=(replace(mine, status="error", message=INTERRUPTED),))) == ladder.UNFINISHED
    )
    assert said(replace(cut, runs=(ours,), comparisons=())) == ladder.UNFINISHED  # interrupted before it began
    assert said(replace(cut, runs=(replace(mine, status="error", message="singular"), ours))) == "singular"
    assert said(replace(cut, message="")).startswith("does not hold")  # nothing was interrupted: the reference failed


def test_a_seed_changes_every_rung_and_keeps_what_has_to_stay(tmp_path: Path) -> None:
    blind.write_blind_models(ladder.FOLDER, tmp_path / "a", 1)
    blind.write_blind_models(ladder.FOLDER, tmp_path / "b", 1)
    blind.write_blind_models(ladder.FOLDER, tmp_path / "c", 2)
    for name in ladder.RUNGS:
        texts = [(tmp_path / x / name / "mechanism.toml").read_text() for x in "abc"]
        assert texts[0] == texts[1] != texts[2]
        old, new = load_mechanism(ladder.FOLDER / name), load_mechanism(tmp_path / "a" / name)
        assert [j.axis.tolist() for j in old.joints] == [j.axis.tolist() for j in new.joints]
        pairs = zip(old.links, new.links, strict=True)
        bodies = [pair for x, y in pairs for pair in zip(x.bodies, y.bodies, strict=True)]
        masses = [(a.inertia.mass, b.inertia.mass) for a, b in bodies]
        assert all(a != b and abs(b / a - 1.0) <= blind.MASS for a, b in masses)
        (one,), (other,) = (load_cases(f / name, m).values() for f, m in ((ladder.FOLDER, old), (tmp_path / "a", new)))
        assert (one.end, one.step, one.sample) == (other.end, other.step, other.sample)
        assert np.abs(one.motion.evaluate(old, [one.end])[0] - other.motion.evaluate(new, [one.end])[0]).max() > 0.0


def test_a_table_reads_the_same_after_it_was_written() -> None:
    plain = {"a b": 1.5, "c": {"d": [1, 2.5, [3.0]], "e": 'x "y" \\ ü\n', "f": True}, "g": [{"h": 1}], "i": {}}
    assert tomllib.loads(blind.format_toml(plain)) == plain
