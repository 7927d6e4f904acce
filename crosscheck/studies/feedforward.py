"""Feed-forward: torques that flexinv finds for the path of a tip drive the free arm of another engine; error of its tip."""

from __future__ import annotations

import functools
import pickle
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path as Folder
from typing import NotRequired, TypedDict

import numpy as np

from crosscheck.engines import ENGINES, NamedDoor, adapter, describe_missing_package, open_adapter
from crosscheck.engines.base import offered
from crosscheck.engines.shared.replay import DriveTorques
from crosscheck.measures.limits import Verdict
from crosscheck.measures.mechanisms import read_mechanism
from crosscheck.verdicts.study_table import StudyTable
from flexinv.errors import InputError
from flexinv.model.mechanism import Mechanism
from flexinv.tracking.follow import INVERSION, RIGID_BODY, Following, follow
from flexinv.tracking.task_file import PathTask, load_tasks
from flexinv.typing import Array

# What stable inversion has to reach in an engine that bends: of the path's length, and against the other two.
REACHED = 1e-3
BETTER = 30.0
# Rigid arms: the torque is linear between samples, an error of h^2 / 8 times its second derivative, 1e-5 of the path.
OF_RIGID = 1e-4
LONGEST = (
    120.0  # [s] of one replay of an engine from outside: a hang costs its own rows, and leaves time for the others
)

TEXT = f"""The tip of an arm shall run along a path. flexinv finds the torques, and they drive the same arm, all joints
free, in another engine, built there from primary data. Three feed-forwards stand side by side: torques of the rigid
arm; torques of the flexible arm whose joints move as the rigid arm's; and stable inversion, with which the deformed tip
is on the path and the joints move before the path begins. The largest distance of the tip from where it shall be,
over the length of the path. Stable inversion is within its bound below {REACHED:g}, and where both others are at least
{BETTER:g} times as far off. Rigid arms have one feed-forward only."""

COLUMNS = (
    ("mechanism", "mechanism", ""),
    ("task", "task", ""),
    ("engine", "engine", ""),
    ("feed_forward", "feed-forward", ""),
    ("error", "largest distance", "of the path's length"),
    ("better", "of stable inversion", "times"),
)


class TrackingRow(TypedDict):
    """A line of the table: distances over the length of the path [-]; without numbers where an engine gave none."""

    mechanism: str
    task: str
    engine: str
    feed_forward: NotRequired[str]
    error: NotRequired[float]
    better: NotRequired[float | None]
    verdict: Verdict
    message: NotRequired[str]


class ReplayAnswer(TypedDict, total=False):
    """Answer of a child process about a replay: tips by link (samples, 3) [m], or why the engine refuses."""

    tips: Mapping[str, list[list[float]]]
    refused: str


def run_study(models: str, engines: Sequence[NamedDoor] = ()) -> StudyTable:
    """Return the table of the report; distances over the length of the path [-].

    engines : doors of the project's own engines (`crosscheck.engines.open_adapter`), of which those take part that replay
    """
    rows: list[TrackingRow] = []
    for folder in sorted(file.parent for file in Folder(models).glob("*/mechanism.toml")):
        try:
            mechanism = read_mechanism(folder)
            tasks = load_tasks(folder, mechanism) if (folder / "cases.toml").is_file() else {}
        except InputError:
            continue  # the matrix of models says so
        for task in tasks.values():
            rows += list_task_rows(mechanism, task, engines, str(folder))
    if not rows:
        return {"status": "skipped", "message": "no model has a task: a table [tasks.NAME] in its cases.toml"}
    return {"text": TEXT, "columns": COLUMNS, "rows": rows}


def list_task_rows(
    mechanism: Mechanism, task: PathTask, engines: Sequence[NamedDoor] = (), folder: str = ""
) -> Iterator[TrackingRow]:
    """Yield one row per engine and feed-forward; distances over the length of the path [-]; folder : of the mechanism."""
    flexible = not mechanism.is_rigid
    mechanism = task.meshed(mechanism)
    path_following = solve_path_following(mechanism, task)
    names = path_following.feed_forwards if flexible else (RIGID_BODY,)
    for engine, replayed in {**collect_replays(flexible), **collect_outside_replays(engines, folder)}.items():
        try:
            errors = {
                name: compute_tip_error(
                    path_following, replayed(mechanism, path_following, name)[path_following.frame.name]
                )
                for name in names
            }
        except InputError as why:  # of an engine that was not asked for this mechanism, or cannot do it
            yield make_empty_row(mechanism.name, task.name, engine, "skipped", str(why))
            continue
        except ReplayError as why:
            yield make_empty_row(mechanism.name, task.name, engine, "error", str(why))
            continue
        for name in names:
            yield make_row(mechanism.name, task.name, engine, name, errors)


def solve_path_following(mechanism: Mechanism, task: PathTask) -> Following:
    """Return the solution that follows the path of a task [m, rad, s, N m]; the mechanism has the task's mesh already."""
    return follow(mechanism, task.path, task.frame, task.step, task.before, task.after, task.start)


def make_empty_row(model: str, task: str, engine: str, verdict: Verdict, message: str) -> TrackingRow:
    """Return a row of the table without numbers [-], and why: an engine that cannot do the task, or failed."""
    return {"mechanism": model, "task": task, "engine": engine, "verdict": verdict, "message": message}


def make_row(model: str, task: str, engine: str, name: str, errors: Mapping[str, float]) -> TrackingRow:
    """Return a row of the table; errors of all feed-forwards over the length of the path [-]."""
    best = errors.get(INVERSION)
    better = None if best is None or name == INVERSION else errors[name] / best
    if best is None:
        bad = f"more than {OF_RIGID:g}" if not errors[name] <= OF_RIGID else ""
    elif name == INVERSION:
        bad = f"more than {REACHED:g}" if not errors[name] <= REACHED else ""
    else:
        bad = f"less than {BETTER:g} times that of stable inversion" if not errors[name] >= BETTER * best else ""
    row: TrackingRow = {
        "mechanism": model,
        "task": task,
        "engine": engine,
        "feed_forward": name,
        "error": errors[name],
        "better": better,
        "verdict": "deviation" if bad else "within",
    }
    if bad:
        row["message"] = bad
    return row


def compute_tip_error(following: Following, tip: Array) -> float:
    """Return the largest distance of a tip (samples, 3) [m] from where it shall be, over the length of the path [-]."""
    return float(np.linalg.norm(tip - following.wanted, axis=1).max() / following.path.length)


Replayed = Callable[[Mechanism, Following, str], dict[str, Array]]


def collect_replays(flexible: bool) -> dict[str, Replayed]:
    """Return the replays of a feed-forward, by engine, flexinv itself first: tips by link (samples, 3) [m]."""
    out: dict[str, Replayed] = {"flexinv": lambda m, found, name: found.replay(name).tip}
    for engine in ("exudyn-ge",) if flexible else ("pinocchio", "mujoco"):
        if describe_missing_package(ENGINES[engine]) is None:
            out[engine] = {"exudyn-ge": _run_exudyn, "pinocchio": _run_pinocchio, "mujoco": _run_mujoco}[engine]
    return out


class ReplayError(RuntimeError):
    """A replay that came to no end, in words: its engine crashed, hung or gave no numbers."""


def collect_outside_replays(engines: Sequence[NamedDoor], folder: str = "") -> dict[str, Replayed]:
    """Return the replays of the project's own engines, by name: tips by link (samples, 3) [m]; folder : of the mechanism.

    Each runs in a process of its own: native code that crashes or hangs there is a row of the table and no more.
    """
    return {
        door["engine"]: functools.partial(_run_outside_replay, door, folder)
        for door in engines
        if _has_replay(door, folder)
    }


def _has_replay(door: NamedDoor, folder: str) -> bool:
    """Return True if an engine has a replay, or cannot even be opened: then its row says why."""
    try:
        return offered(open_adapter(door, door["engine"], folder), "replay") is not None
    except Exception:
        return True


def _run_outside_replay(
    door: NamedDoor, models: str, m: Mechanism, following: Following, name: str
) -> dict[str, Array]:
    """Return the tips of a replay in a child process.  Raises InputError where it cannot do that, and ReplayError."""
    from crosscheck.engines.job_files import StudyRequest
    from crosscheck.run.isolation import ChildProcesses, ask, open_scratch_folder

    drive = _make_drive(following, name)
    with open_scratch_folder() as folder:
        given = folder / "given.pickle"
        given.write_bytes(pickle.dumps((dict(door), models, m, drive)))
        request: StudyRequest = {
            "kind": "study",
            "module": __name__,
            "function": "run_replay_file",
            "options": {"file": str(given)},
        }
        answer, ending = ask(request, LONGEST, ChildProcesses())
    if ending.status != "ok":
        raise ReplayError(ending.message)
    if "refused" in answer:
        raise InputError(answer["refused"])
    return {link: np.array(tip) for link, tip in answer["tips"].items()}


def run_replay_file(file: str) -> ReplayAnswer:
    """Return the answer of a child process about the replay in a file: tips by link (samples, 3) [m], or why there are none."""
    door, folder, mechanism, drive = pickle.loads(Folder(file).read_bytes())
    replay = offered(open_adapter(door, door["engine"], folder), "replay")
    assert replay is not None
    try:
        tips = replay(mechanism, drive)
    except InputError as why:
        return {"refused": str(why)}
    broken = [name for name, tip in tips.items() if not np.isfinite(tip).all()]
    if broken:
        raise ReplayError(f"its tip of {broken[0]} is no finite number")
    return {"tips": {name: np.asarray(tip).tolist() for name, tip in tips.items()}}


def _make_drive(following: Following, name: str) -> DriveTorques:
    spacing = float(following.time[1] - following.time[0])
    return DriveTorques(following.solution.q[0], spacing, following.feed_forwards[name].torque)


def _run_exudyn(m: Mechanism, following: Following, name: str) -> dict[str, Array]:
    drive = _make_drive(following, name)
    return _run_replay("exudyn-ge", m, drive, elements=8, step=drive.spacing / 2)


def _run_pinocchio(m: Mechanism, following: Following, name: str) -> dict[str, Array]:
    return _run_replay("pinocchio", m, _make_drive(following, name))


def _run_mujoco(m: Mechanism, following: Following, name: str) -> dict[str, Array]:
    return _run_replay("mujoco", m, _make_drive(following, name))


def _run_replay(engine: str, mechanism: Mechanism, drive: DriveTorques, **settings: float) -> dict[str, Array]:
    replay = offered(adapter(ENGINES[engine]), "replay")
    assert replay is not None
    tips: dict[str, Array] = replay(mechanism, drive, **settings)
    return tips
