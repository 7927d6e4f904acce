"""Feed-forward replayed in engines: torques of flexinv drive arms that others built."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rogue_replays

from crosscheck.engines.mujoco import replay as mujoco_replay
from crosscheck.engines.pinocchio import replay as pinocchio_replay
from crosscheck.engines.shared.replay import DriveTorques
from crosscheck.studies import feedforward
from crosscheck.studies.feedforward import BETTER, REACHED
from flexinv import load_mechanism
from flexinv.tracking.follow import INVERSION, JOINT_SPACE, RIGID_BODY
from flexinv.tracking.task_file import load_tasks


def rows_of(root: Path, model: str) -> dict[tuple[str, str], dict[str, object]]:
    mechanism = load_mechanism(root / "models" / model)
    (task,) = load_tasks(root / "models" / model, mechanism).values()
    rows = feedforward.list_task_rows(mechanism, task)
    return {(str(row["engine"]), str(row["feed_forward"])): row for row in rows}


@pytest.mark.slow
def test_rigid_arm_on_a_line_in_every_rigid_engine(root: Path) -> None:
    rows = rows_of(root, "rigid_3r")
    assert {engine for engine, _ in rows} == {"flexinv", "pinocchio", "mujoco"}
    assert all(row["verdict"] == "within" for row in rows.values()), rows


@pytest.mark.slow
@pytest.mark.parametrize("model", ["flex_one_link", "flex_two_link"])
def test_tips_of_the_papers_arms_stay_on_their_arcs_in_exudyn(root: Path, model: str) -> None:
    rows = rows_of(root, model)
    assert {engine for engine, _ in rows} == {"flexinv", "exudyn-ge"}
    assert all(row["verdict"] == "within" for row in rows.values()), rows
    for engine in ("flexinv", "exudyn-ge"):
        best, others = rows[engine, INVERSION]["error"], [rows[engine, n]["error"] for n in (RIGID_BODY, JOINT_SPACE)]
        assert best <= REACHED
        assert min(others) >= BETTER * best


@pytest.mark.parametrize("engine", [pinocchio_replay, mujoco_replay])
def test_a_wrong_torque_is_seen(root: Path, engine: object) -> None:
    """A torque of one thousandth more takes the tip away by about as much of its way."""
    m = load_mechanism(root / "models" / "rigid_one_link")
    torque = np.sin(2 * np.pi * np.linspace(0.0, 1.0, 401))[:, None]
    link = m.links[-1].name
    tips = [engine.replay(m, DriveTorques(np.zeros(m.nq), 1e-3, f * torque))[link] for f in (1.0, 1.001)]  # type: ignore[attr-defined]
    moved = np.linalg.norm(np.diff(tips[0], axis=0), axis=1).sum()
    away = np.linalg.norm(tips[1] - tips[0], axis=1).max()
    assert 1e-4 * moved < away < 1e-2 * moved


def test_rows_judge() -> None:
    """What is off by more than its bound, and what is not so much worse than stable inversion, deviates."""
    errors = {RIGID_BODY: 3e-2, JOINT_SPACE: 5e-2, INVERSION: 9e-4}
    verdicts = [feedforward.make_row("arm", "arc", "engine", name, errors)["verdict"] for name in errors]
    assert verdicts == ["within", "within", "within"]
    worse = feedforward.make_row("arm", "arc", "engine", INVERSION, errors | {INVERSION: 1.1e-3})
    assert worse["verdict"] == "deviation"
    assert "more than 0.001" in worse["message"]
    near = feedforward.make_row("arm", "arc", "engine", RIGID_BODY, errors | {RIGID_BODY: 2e-2})
    assert near["verdict"] == "deviation"
    assert "less than 30 times" in near["message"]
    nan = feedforward.make_row("arm", "arc", "engine", RIGID_BODY, {RIGID_BODY: float("nan")})
    assert nan["verdict"] == "deviation"


def test_what_exudyn_cannot_be_given_is_said(root: Path) -> None:
    exudyn_replay = pytest.importorskip("crosscheck.engines.exudyn.replay")
    m = load_mechanism(root / "models" / "spatial_arm")
    with pytest.raises(ValueError, match="without gravity"):
        exudyn_replay.replay(m, DriveTorques(np.zeros(m.nq), 1e-3, np.zeros((3, 2))), 2, 1e-3)


def test_without_its_models_the_study_is_skipped(tmp_path: Path) -> None:
    assert feedforward.run_study(str(tmp_path))["status"] == "skipped"


@pytest.fixture(scope="module")
def of_rogues(root: Path) -> dict[str, dict[str, object]]:
    """The rows of a table in which engines from outside behave badly, by engine."""
    mechanism = load_mechanism(root / "models" / "rigid_3r")
    (task,) = load_tasks(root / "models" / "rigid_3r", mechanism).values()
    here = str(Path(rogue_replays.__file__).parent)
    names = ("Crashing", "Hanging", "Failing", "Blurred", "Refusing", "Missing", "Replay")
    jobs = [{"module": f"rogue_replays:{name}Adapter", "path": here, "engine": name} for name in names]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(feedforward, "LONGEST", 6.0)  # [s]: a child process begins within some of them
        return {str(row["engine"]): row for row in feedforward.list_task_rows(mechanism, task, jobs)}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("engine", "verdict", "words"),
    [
        ("Crashing", "error", "killed by signal 6 (SIGABRT)"),
        ("Hanging", "error", "stopped after the time limit of 6 s"),
        ("Failing", "error", "ArithmeticError: singular"),
        ("Blurred", "error", "is no finite number"),
        ("Missing", "error", "rogue_replays has no 'MissingAdapter'"),
        ("Refusing", "skipped", "no arms of three joints"),
        ("Replay", "deviation", "more than 0.0001"),
    ],
)
def test_a_replay_that_behaves_badly_is_a_row_in_words(
    of_rogues: dict[str, dict[str, object]], engine: str, verdict: str, words: str
) -> None:
    assert of_rogues[engine]["verdict"] == verdict
    assert words in str(of_rogues[engine]["message"])
    assert {of_rogues[name]["verdict"] for name in ("flexinv", "pinocchio", "mujoco")} == {"within"}  # nothing is lost
