"""Check cases answered by a program that shares nothing with their authors, and judged from the kits of the corpus alone."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest
import simbody_build
from test_simbody import MODELS, SIGN

pytestmark = [
    pytest.mark.skipif(bool(simbody_build.why_not()), reason=simbody_build.why_not() or "nothing is missing"),
    pytest.mark.skipif(not MODELS.is_dir(), reason="the models are not here: this is no checkout"),
    pytest.mark.slow,
]
# A tree, a loop in the plane, a gear, a screw, seven bodies in loops, gas springs, and a platform in space.
CASES = (
    *("double_pendulum", "four_bar", "geared_four_bar", "screw_lift", "andrews_squeezer/turn", "kuka_kr300/sweep"),
    "stewart_platform",
)
SECRET = ("expected", "consensus.json", "LICENCE.md", "*.txt")  # what a kit is asked without


@pytest.fixture(scope="module")
def corpus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The check cases of some rigid mechanisms, by two engines of different authors."""
    folder = tmp_path_factory.mktemp("corpus")
    words = (
        "corpus",
        *CASES,
        "--models",
        str(MODELS),
        "--engines",
        "flexinv,pinocchio,mujoco",
        "--jobs",
        "1",
        "--out",
        "corpus",
    )
    done = simbody_build.crosscheck(folder, *words)
    assert not done.returncode, done.stdout + done.stderr
    return folder / "corpus"


def answered(program: Path, corpus: Path, folder: Path) -> set[str]:
    """Let a program answer every kit, without what is expected; return the ids that it answered."""
    for kit in sorted(file.parent for file in (corpus / "kits").glob("*/case.json")):
        blind, answer = folder / "blind" / kit.name, folder / "answers" / kit.name
        shutil.copytree(kit, blind, ignore=shutil.ignore_patterns(*SECRET))
        subprocess.run([str(program), str(blind), str(answer)], check=True, cwd=blind, env={"PATH": ""})
    return {file.parent.name for file in (folder / "answers").glob("*/series.csv")}


def test_answers_of_another_author_lie_inside_the_consensus(corpus: Path, tmp_path: Path) -> None:
    """In a folder without models: a corpus and answers are all there is."""
    program = simbody_build.build(tmp_path / "program")
    cases = json.loads((corpus / "manifest.json").read_text(encoding="utf-8"))["cases"]
    assert answered(program, corpus, tmp_path) == {one["id"] for one in cases}
    done = simbody_build.crosscheck(tmp_path, "corpus", "--judge", "answers", "--against", str(corpus))
    assert not done.returncode, done.stdout + done.stderr
    *lines, last = done.stdout.splitlines()
    assert last.endswith(f"lie inside the consensus, in {len(cases)} cases.")
    assert {line.split()[0] for line in lines} == {"inside"}


def test_a_folder_that_is_no_kit_is_said(tmp_path: Path) -> None:
    program = simbody_build.build(tmp_path / "program")
    done = subprocess.run([str(program), "nothing", "out"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (2, "nothing/ holds no case.json: expected a case kit\n")
    assert not (tmp_path / "out").exists()


def test_one_wrong_sign_lies_outside(corpus: Path, tmp_path: Path) -> None:
    program = simbody_build.build(tmp_path / "program", SIGN)
    answered(program, corpus, tmp_path)
    done = simbody_build.crosscheck(tmp_path, "corpus", "--judge", "answers", "--against", str(corpus))
    assert done.returncode == 1, done.stdout + done.stderr
    outside = [line for line in done.stdout.splitlines() if line.startswith("outside")]
    assert any("double_pendulum-swing torque/knee" in line for line in outside)
    assert not any(" tip/" in line for line in outside)  # nothing else was changed
