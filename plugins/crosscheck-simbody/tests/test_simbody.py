"""A C++ program on Simbody through the command door: it holds the rungs that it climbs, and refuses the others in words."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import simbody_build

from crosscheck.conform.ladder import CERTIFICATE

pytestmark = pytest.mark.skipif(bool(simbody_build.why_not()), reason=simbody_build.why_not() or "nothing is missing")

CLIMBED = {"double_pendulum", "tree", "free_base", "drives", "loop", "gears", "redundant_drives"}
# Of the range: rounding of closed formulas, which the loops' Newton iteration leaves at 1e-13 of a length.
EXACT = 1e-9
MODELS = Path(__file__).resolve().parents[3] / "models"
# A humanoid with a free base, spherical joints in loops, helical and universal joints, gas springs, seven bodies in loops.
HARD = ("talos", "stewart_platform", "screw_lift", "slider_crank", "kuka_kr300", "andrews_squeezer", "panda")


@pytest.fixture(scope="session")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simbody_build.build(tmp_path_factory.mktemp("simbody") / "program")


@pytest.fixture
def project(program: Path, tmp_path: Path) -> Path:
    simbody_build.engines(tmp_path / "crosscheck.toml", {"simbody": (program, "*")})
    return tmp_path


def results(folder: Path) -> dict[str, Any]:
    result: dict[str, Any] = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    return result


def test_it_holds_every_rung_that_it_climbs_and_says_why_it_leaves_the_others(project: Path) -> None:
    words = ("conform", "simbody", "--trust-commands", "--out", "ladder")
    done = simbody_build.crosscheck(project, *words)
    assert not done.returncode, done.stdout + done.stderr
    (table,) = results(project / "ladder")["studies"]
    said = {row["rung"].replace(" ", "_"): row for row in table["rows"]}
    assert {name for name, row in said.items() if row["verdict"] == "within"} == CLIMBED | {CERTIFICATE}
    assert max(said[name]["difference"] for name in CLIMBED) <= EXACT
    assert "closures that act for a while" in said["phases"]["message"]
    assert "this program integrates nothing in time" in said["beam_moving"]["message"]


def test_it_holds_a_blind_round(project: Path) -> None:
    words = ("conform", "simbody", "--trust-commands", "--blind", "--seed", "16", "--rungs", ",".join(sorted(CLIMBED)))
    done = simbody_build.crosscheck(project, *words, "--out", "blind")
    assert not done.returncode, done.stdout + done.stderr
    assert "blind" in done.stdout


def test_one_wrong_sign_is_refused_in_a_blind_round(tmp_path: Path) -> None:
    wrong = simbody_build.build(tmp_path / "wrong", SIGN)
    simbody_build.engines(tmp_path / "crosscheck.toml", {"wrong": (wrong, "*")})
    words = ("conform", "wrong", "--trust-commands", "--blind", "--seed", "16", "--rungs", "double_pendulum")
    done = simbody_build.crosscheck(tmp_path, *words)
    assert done.returncode == 1, done.stdout + done.stderr
    assert "double pendulum" in done.stdout.split("not:")[-1]


@pytest.mark.skipif(not MODELS.is_dir(), reason="the models are not here: this is no checkout")
@pytest.mark.slow
def test_it_agrees_on_machines(project: Path) -> None:
    words = ("run", *HARD, "--models", str(MODELS), "--config", "crosscheck.toml", "--trust-commands")
    done = simbody_build.crosscheck(project, *words, "--engines", "flexinv,simbody", "--out", "report")
    found = results(project / "report")
    assert {run["status"] for run in found["runs"]} == {"ok"}, done.stdout + done.stderr
    judged = [
        row for row in found["comparisons"] if row["engine"] == "simbody" and row["quantity"] in ("torque", "tip")
    ]
    assert {row["mechanism"] for row in judged} == set(HARD)
    assert max(row["fraction"] for row in judged) <= EXACT
    lines = [line for line in found["certificates"] if line["engine"] == "simbody"]
    assert all(line["holds"] for line in lines)
    assert {"joint-space mass matrix", "gravity torque"} <= {line["what"] for line in lines}


SIGN = (
    "return hasClosures() ? shared(tau) : tau;",
    "if (nv > 1) tau[1] = -tau[1];\n        return hasClosures() ? shared(tau) : tau;",
)
