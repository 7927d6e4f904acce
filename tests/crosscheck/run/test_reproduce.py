"""Minimal reproductions: what is written gives the engine's own efforts in a process that knows nothing of this project."""

from __future__ import annotations

import importlib
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import loop_examples as examples
import numpy as np
import pytest
from click.testing import CliRunner
from crosscheck_examples import write_models
from flexible_examples import arm
from rigid_trees import case_of, chain, tree

from crosscheck.cli import main
from crosscheck.engines import ENGINES, adapter
from crosscheck.engines.base import offered
from crosscheck.engines.exudyn import loops as exudyn_loops
from crosscheck.engines.exudyn import run_in_time
from crosscheck.engines.mujoco import flex as mujoco_flex
from crosscheck.engines.shared.export_files import NotExported
from crosscheck.engines.shared.urdf_text import compute_roll_pitch_yaw
from flexinv.analysis.solve import solve
from flexinv.files.load_cases import Case, load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.kernels.so3 import exp_so3
from flexinv.kinematics.nodal_motion import integrate_configuration
from flexinv.model.attachments import GasLaw, TableLaw
from flexinv.model.mechanism import Mechanism, Placement
from flexinv.model.motion import Motion
from flexinv.typing import Array

# Rounding of trees of ten bodies with efforts of some hundred N m, and of quaternions that MuJoCo norms again.
ROUNDING = 1e-12
# What test_engine_loops asks of the adapters, for the same reason.
NEAR = {"pinocchio": 1e-10, "mujoco": 1e-8}
# run.py without this project: importing it would be an error.
ALONE = (
    "import sys, runpy; sys.modules['flexinv'] = sys.modules['crosscheck'] = None; sys.path.insert(0, '.'); "
    "runpy.run_path('run.py', run_name='__main__')"
)


def swing(mechanism: Mechanism, duration: float = 0.2) -> tuple[Case, Array]:
    """A short motion of all joints and flexinv's efforts for it."""
    there = integrate_configuration(mechanism, mechanism.neutral, np.random.default_rng(5).uniform(-1, 1, mechanism.nv))
    motion = Motion.point_to_point(mechanism.neutral, there, duration)
    case = case_of(motion, duration, duration / 20)
    return case, solve(mechanism, motion, duration / 20).torque_all


def exported(mechanism: Mechanism, engine: str, folder: Path, case: Case, effort: Array) -> None:
    folder.mkdir(exist_ok=True)
    export = offered(adapter(ENGINES[engine]), "export")
    assert export is not None
    export(mechanism, case, engine, effort, folder)


def run(folder: Path) -> dict[str, float]:
    """Run run.py alone; return the difference of every coordinate over the whole."""
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [sys.executable, "-I", "-c", ALONE], cwd=folder, env=clean, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert (folder / "computed.csv").is_file()
    return {
        name: float(part) for name, part in re.findall(r"^  (\S+) +differs .*, (\S+) of the whole$", done.stdout, re.M)
    }


def grounded(placed: bool = False) -> Mechanism:
    """The tree of every joint but the spherical one, its free base at the world's frame or placed elsewhere."""
    kinds = (
        ("base", "free", "world"), ("shoulder", "revolute", "base"), ("wrist", "universal", "shoulder"),
        ("slider", "prismatic", "wrist"), ("flange", "fixed", "shoulder"), ("wheel", "continuous", "base"),
    )  # fmt: skip
    made = tree(kinds)
    return made if placed else replace(made, joints=(replace(made.joints[0], placement=Placement()), *made.joints[1:]))


@pytest.mark.parametrize(
    ("engine", "mechanism"),
    [("pinocchio", grounded()), ("pinocchio", grounded(placed=True)), ("mujoco", tree()), ("exudyn", tree())],
    ids=lambda x: str(x)[:9],
)
def test_every_joint_of_a_tree(engine: str, mechanism: Mechanism, tmp_path: Path) -> None:
    case, effort = swing(mechanism)
    exported(mechanism, engine, tmp_path, case, effort)
    result = run(tmp_path)
    assert len(result) == mechanism.nv
    assert max(result.values()) < ROUNDING


def posed(mechanism: Mechanism, case: Case) -> Array:
    """flexinv's efforts of all joints for a mechanism whose closures move some."""
    return solve(mechanism, case.motion, case.sample, start=case.start).torque_all


def opening() -> tuple[Mechanism, Case]:
    """Two arms grasp a bar, carry it and put it down."""
    folder = Path(__file__).resolve().parents[3] / "models" / "two_arms"
    mechanism = load_mechanism(folder)
    return mechanism, load_cases(folder, mechanism)["carry"]


LOOPS: dict[str, Callable[[], tuple[Mechanism, Case]]] = {
    "redundant drives": partial(examples.five_bar, 3),
    "slide": partial(examples.slider_crank, "pin"),
    "space": examples.spatial,
    "springs and forces in a loop": examples.loaded,
    "springs and forces on a tree": examples.loaded_tree,
    "gear": examples.rack_and_pinion,
    "opens and closes": opening,
}


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["pinocchio", "mujoco"])
@pytest.mark.parametrize("name", LOOPS)
def test_loops_springs_and_forces(engine: str, name: str, tmp_path: Path) -> None:
    mechanism, case = LOOPS[name]()
    exported(mechanism, engine, tmp_path, case, posed(mechanism, case))
    result = run(tmp_path)
    assert len(result) == mechanism.nv
    assert max(result.values()) < NEAR[engine]


LAWS = {
    "gas": GasLaw(12.0, 0.9, 1.4),
    "table": TableLaw(np.array([0.3, 0.5, 0.6, 0.8]), np.array([-3.0, 1.0, 4.0, 20.0])),
}


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["pinocchio", "exudyn-dae"])
@pytest.mark.parametrize("law", LAWS)
def test_springs_that_are_not_linear_are_exported_with_their_law(
    engine: str, law: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The lengths of this motion reach from 0.2 m to 0.9 m, beyond both ends of the table; MuJoCo has no such springs."""
    monkeypatch.setattr(exudyn_loops, "STEPS", 500)
    mechanism, case = examples.loaded_tree()
    spring = replace(mechanism.springs[0], stiffness=0.0, law=LAWS[law])
    mechanism = replace(mechanism, springs=(spring,))
    exported(mechanism, engine, tmp_path, case, posed(mechanism, case))
    # in time: what test_engine_exudyn_loops asks of these steps, and the corners of a table's slope beside
    assert max(run(tmp_path).values()) < {"pinocchio": NEAR["pinocchio"], "exudyn-dae": 1e-4}[engine]


@pytest.mark.parametrize(("engine", "file"), [("pinocchio", "model.urdf"), ("mujoco", "model.xml")])
def test_another_model_is_another_effort(engine: str, file: str, tmp_path: Path) -> None:
    """The script computes from the model that lies beside it: one mass changed there is seen."""
    mechanism = chain("revolute")
    case, effort = swing(mechanism)
    exported(mechanism, engine, tmp_path, case, effort)
    model = tmp_path / file
    text, count = re.subn(r'(mass(?: value)?=")[1-9][\d.]*', r"\g<1>9", model.read_text(), count=1)
    assert count == 1
    model.write_text(text)
    assert max(run(tmp_path).values()) > 0.1


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["exudyn-ge", "exudyn-ancf"])
def test_a_beam_in_time(engine: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The script repeats the run of the adapter, which gives the same difference from flexinv to rounding."""
    monkeypatch.setattr(run_in_time, "STEPS", {True: 1000, False: 1000})
    mechanism = arm()
    motion = Motion.point_to_point([0.0], [0.3], 0.1, law="quintic")
    case = case_of(motion, 0.1, 2e-3)
    effort = solve(mechanism, motion, 2e-3).torque_all
    exported(mechanism, engine, tmp_path, case, effort)
    record = importlib.import_module("crosscheck.engines.exudyn.adapter").run(mechanism, case, engine, {"error": False})
    assert run(tmp_path)["hub"] < 5e-3  # 20 steps of flexinv's second-order march
    computed = np.loadtxt(tmp_path / "computed.csv", delimiter=",", skiprows=1)[:, 1]
    # the same calls with the same numbers: what is left is a sum in another order
    np.testing.assert_allclose(computed, record.series["torque/hub"].values, rtol=0, atol=ROUNDING * np.ptp(effort))
    model = tmp_path / "model.py"
    model.write_text(model.read_text().replace("massPerLength=0.056", "massPerLength=0.06"))
    assert run(tmp_path)["hub"] > 0.02


@pytest.mark.slow
def test_a_flex_of_mujoco(tmp_path: Path) -> None:
    """The script integrates both meshes again: the adapter's own result, to rounding."""
    mechanism = arm()
    motion = Motion.point_to_point([0.0], [0.05], 0.02, law="quintic")
    case = case_of(motion, 0.02, 1e-3)
    exported(mechanism, "mujoco-flex", tmp_path, case, np.zeros((21, 1)))
    run(tmp_path)
    series = mujoco_flex.run(mechanism, case, "mujoco-flex", {"error": False}).series
    ours = series["torque/hub"].values
    computed = np.loadtxt(tmp_path / "computed.csv", delimiter=",", skiprows=1)[:, 1]
    # thousands of explicit steps with the same numbers: rounding grows a little on the way
    np.testing.assert_allclose(computed, ours, rtol=0, atol=1e-9 * np.ptp(ours))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["springs and forces in a loop", "springs and forces on a tree", "space"])
def test_loops_springs_and_forces_in_time(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The script repeats the run of the adapter to rounding, drives that share the work included."""
    monkeypatch.setattr(exudyn_loops, "STEPS", 500)
    mechanism, case = LOOPS[name]()
    exported(mechanism, "exudyn-dae", tmp_path, case, posed(mechanism, case))
    assert max(run(tmp_path).values()) < 1e-5  # what test_engine_exudyn_loops asks of its error of h^2
    exudyn = importlib.import_module("crosscheck.engines.exudyn.adapter")
    series = exudyn.run(mechanism, case, "exudyn-dae", {"error": False}).series
    ours = np.stack([series[f"torque/{name}"].values for name in mechanism.velocity_names], axis=1)
    computed = np.loadtxt(tmp_path / "computed.csv", delimiter=",", skiprows=1)[:, 1:]
    np.testing.assert_allclose(computed, ours, rtol=0, atol=NEAR["pinocchio"] * np.ptp(ours))


@pytest.mark.slow
def test_closures_that_open_and_close_in_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The script switches the connectors as the adapter does; a grasp too late is seen."""
    mechanism, case = opening()
    case = replace(case, end=0.75, sample=0.05)  # [s]: they take the bar at 0.5
    monkeypatch.setattr(exudyn_loops, "STEPS", 300)
    exported(mechanism, "exudyn-dae", tmp_path, case, posed(mechanism, case)[: round(case.end / case.sample) + 1])
    assert max(run(tmp_path).values()) < 1e-5  # what test_engine_exudyn_phases asks of these steps
    settings = tmp_path / "settings.json"
    told = json.loads(settings.read_text())
    for one in told["runs"]:
        one["acting"][1]["from"] += 0.1  # [s]: they take it too late
    settings.write_text(json.dumps(told))
    assert max(run(tmp_path).values()) > 1e-2


@pytest.mark.slow
def test_a_loop_of_beams_in_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exudyn_loops, "STEPS", 500)
    folder = Path(__file__).resolve().parents[3] / "models" / "four_bar_flexible"
    mechanism = load_mechanism(folder)
    case = replace(load_cases(folder, mechanism)["turn"], end=0.05)
    exported(mechanism, "exudyn-ge", tmp_path, case, np.zeros((11, mechanism.nv)))
    run(tmp_path)
    series = (
        importlib.import_module("crosscheck.engines.exudyn.adapter")
        .run(mechanism, case, "exudyn-ge", {"error": False})
        .series
    )
    ours = np.stack([series[f"torque/{name}"].values for name in mechanism.velocity_names], axis=1)
    computed = np.loadtxt(tmp_path / "computed.csv", delimiter=",", skiprows=1)[:, 1:]
    assert np.ptp(ours[:, 0]) > 0.5  # [N m]
    # the same calls with the same numbers, through Newton's increments of 1e-10
    np.testing.assert_allclose(computed, ours, rtol=0, atol=1e-8 * np.ptp(ours))


@pytest.mark.slow
def test_a_rigid_chain_in_time(tmp_path: Path) -> None:
    mechanism = chain("prismatic")
    case, effort = swing(mechanism)
    exported(mechanism, "exudyn-dae", tmp_path, case, effort)
    assert max(run(tmp_path).values()) < 1e-3  # index 3 at some thousand steps


@pytest.mark.slow
def test_a_release_that_turns_joints_instead_of_markers_gives_the_same(tmp_path: Path) -> None:
    """Exudyn before 1.13 has no localHT.  The release that is installed here turns joints as well as markers: to the bit."""
    mechanism, case = examples.spatial()
    exported(mechanism, "exudyn-dae", tmp_path, case, posed(mechanism, case))
    text = (tmp_path / "run.py").read_text()
    assert run(tmp_path)
    today = (tmp_path / "computed.csv").read_bytes()
    asked = 'untold = "localHT" not in'
    assert asked in text
    (tmp_path / "run.py").write_text(text.replace(asked, 'untold = "localHT" in'))
    run(tmp_path)
    assert (tmp_path / "computed.csv").read_bytes() == today
    (tmp_path / "run.py").write_text(text.replace(asked, 'untold = "localHT" in').replace("TURNS[int(number)] @", ""))
    with pytest.raises(AssertionError):  # joints that are not turned do not fit
        run(tmp_path)


def test_what_cannot_be_exported_is_said(tmp_path: Path) -> None:
    loop, loop_case = examples.four_bar("universal")
    none = np.zeros((1, 1))
    case, effort = swing(chain("spherical"))
    for engine, words, mechanism, what in (
        (
            "mujoco",
            r"closures \(C\) have no equality constraint in MJCF: see pinocchio",
            loop,
            loop_case,
        ),
        ("pinocchio", r"beams \(link\) are exported for exudyn-ancf and exudyn-ge, not for pinocchio", arm(), case),
        ("pinocchio", "URDF has no spherical joint .* see mujoco", chain("spherical"), case),
        (
            "exudyn-dae",
            "depend on the position of a spherical joint; for models in time revolute",
            chain("spherical"),
            case,
        ),
    ):
        with pytest.raises(NotExported, match=words):
            exported(mechanism, engine, tmp_path, what, none)
    assert effort.shape[1] == 4


def test_a_folder_that_holds_files_is_not_written_into(root: Path, tmp_path: Path) -> None:
    models = write_models(tmp_path / "models", root).parent
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "run.py").write_text("keep me")
    command = [
        "export",
        "double_pendulum",
        "--models",
        str(models),
        "--engine",
        "mujoco",
        "--out",
        str(tmp_path / "mine"),
    ]
    done = CliRunner().invoke(main, command)
    assert done.exit_code == 2
    assert "is there already: write --out with a new or an empty folder" in done.output
    assert [(f.name, f.read_text()) for f in (tmp_path / "mine").iterdir()] == [("run.py", "keep me")]


@pytest.mark.slow
def test_the_command_writes_a_folder_that_explains_itself(root: Path, tmp_path: Path) -> None:
    models = write_models(tmp_path / "models", root).parent
    out = tmp_path / "bug"
    command = ["export", "double_pendulum", "--models", str(models), "--engine", "mujoco", "--out", str(out)]
    done = CliRunner().invoke(main, command)
    assert done.exit_code == 0, done.output
    assert {f.name for f in out.iterdir()} == {
        "README.md", "model.xml", "motion.csv", "expected.csv", "settings.json", "run.py",
    }  # fmt: skip
    assert "| settings.json | what the model's format does not carry" in (out / "README.md").read_text()
    assert "forces.csv" not in (out / "README.md").read_text()
    assert "# double_pendulum/swing in mujoco" in (out / "README.md").read_text()
    assert "python -m pip install mujoco" in (out / "README.md").read_text()
    result = run(out)
    assert set(result) == {"pivot", "knee"}
    assert max(result.values()) < ROUNDING
    refused = CliRunner().invoke(main, [*command[:-3], "exudyn-ge"])
    assert refused.exit_code == 2
    assert "double_pendulum/swing in exudyn-ge: no link bends: see exudyn and exudyn-dae" in refused.output
    unknown = CliRunner().invoke(main, [*command, "--case", "jump"])
    assert unknown.exit_code == 2
    assert "nothing to run is called 'double_pendulum/jump'" in unknown.output


def test_angles_of_a_urdf_keep_their_digits() -> None:
    random = np.random.default_rng(1)
    turns = [exp_so3(v) for v in random.uniform(-3, 3, (20, 3))]
    turns += [exp_so3(np.array([0.0, s * np.pi / 2, 0.0])) @ exp_so3(np.array([0.3, 0, 0])) for s in (1, -1)]
    for r in turns:
        roll, pitch, yaw = (exp_so3(a * e) for a, e in zip(compute_roll_pitch_yaw(r), np.eye(3), strict=True))
        np.testing.assert_allclose(yaw @ pitch @ roll, r, atol=1e-15 * 4)  # three products
