"""Forward FMUs: torques of inverse dynamics bring them where the motion goes; what is none is refused in words."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pendulum_fmu
import pytest
import tree_fmu

import flexinv
from crosscheck.commands.shared.options import RunSelection
from crosscheck.doors import fmu, registry
from crosscheck.doors.fmu_replay import ForwardFmuAdapter, compute_tips
from crosscheck.engines import ENGINES, adapter
from crosscheck.engines.shared.replay import DriveTorques
from crosscheck.studies import STUDIES, feedforward
from crosscheck.verdicts.plan import Task, discover
from flexinv.errors import InputError
from flexinv.tracking.task_file import load_tasks
from flexinv.typing import Array

compiled = pytest.mark.skipif(bool(pendulum_fmu.why_not()), reason=pendulum_fmu.why_not() or "nothing is missing")
REPLAYED = 1e-12  # [m], of an arm of half a metre: the same steps, summed up in another order
INTERFACES = [("ModelExchange",), ("CoSimulation",)]


@pytest.fixture(scope="module")
def arm(root: Path) -> Task:
    return discover(root / "models", ["rigid_3r/quintic"]).tasks[0]


def opened(file: Path, **settings: Any) -> ForwardFmuAdapter:
    adapter = fmu.open_adapter("plant", "models/rigid_3r", {"fmu": str(file), "cases": ["*"], **settings})
    assert isinstance(adapter, ForwardFmuAdapter)
    return adapter


def drive(task: Task, spacing: float) -> tuple[DriveTorques, dict[str, Array]]:
    """The torques of a case's motion between two rests, and the tips that belong to them."""
    time = np.arange(round(task.case.end / spacing) + 1) * spacing
    q, qd, qdd = task.case.motion.evaluate(task.mechanism, time)
    torque = flexinv.joint_torques(task.mechanism, q, qd, qdd)
    tips = [compute_tips(task.mechanism, row) for row in q]
    wanted = {link.name: np.array([at[link.name] for at in tips]) for link in task.mechanism.links}
    return DriveTorques(q[0], spacing, np.asarray(torque)[:, task.mechanism.actuated]), wanted


@pytest.mark.parametrize("case", ["rigid_3r/quintic", "screw_lift", "quanser_2dsfl_rigid", "ur5"])
def test_tips_are_those_of_the_reference(root: Path, case: str) -> None:
    """Closed formulas on both sides: rounding of a few products of rotations, 1e-16 each, over a reach of a metre."""
    task = discover(root / "models", [case]).tasks[0]
    record = adapter(ENGINES["flexinv"]).run(task.mechanism, task.case, "flexinv", {"error": False})
    q = task.case.motion.evaluate(task.mechanism, record.time)[0]
    for k in range(0, len(q), 20):
        for name, place in compute_tips(task.mechanism, q[k]).items():
            theirs = [record.series[f"tip/{name}/{axis}"].values[k] for axis in "xyz"]
            np.testing.assert_allclose(place, theirs, rtol=0, atol=1e-13)


@compiled
@pytest.mark.slow
@pytest.mark.parametrize("kinds", INTERFACES)
def test_torques_of_a_motion_make_the_motion(arm: Task, tmp_path: Path, kinds: tuple[str, ...]) -> None:
    """Torques are linear between samples (or constant): half the spacing leaves a fourth of the error."""
    plant = opened(tree_fmu.build(tmp_path, "rigid_3r/quintic", forward=True, kinds=kinds))
    errors = []
    for spacing in (0.01, 0.005):
        given, wanted = drive(arm, spacing)
        result = plant.replay(arm.mechanism, given)
        errors.append(max(float(np.abs(result[name] - wanted[name]).max()) for name in wanted))
    assert errors[1] <= 1e-3
    assert 3.5 <= errors[0] / errors[1] <= 4.5


@compiled
@pytest.mark.slow
@pytest.mark.parametrize("kinds", INTERFACES)
def test_it_stands_in_the_table_of_feed_forwards(root: Path, tmp_path: Path, kinds: tuple[str, ...]) -> None:
    file = tree_fmu.build(tmp_path, "rigid_3r/quintic", forward=True, kinds=kinds)
    folder = root / "models" / "rigid_3r"
    mechanism = flexinv.load_mechanism(folder)
    (task,) = load_tasks(folder, mechanism).values()
    settings = {"fmu": str(file), "cases": ["rigid_3r/*"]}
    job = {"module": registry.FMU, "settings": settings, "engine": "plant"}
    rows = list(feedforward.list_task_rows(mechanism, task, [job], str(folder)))
    (row,) = [row for row in rows if row["engine"] == "plant"]
    assert row["verdict"] == "within"
    elsewhere = str(root / "models" / "rigid_one_link")
    rows = list(feedforward.list_task_rows(mechanism, task, [job], elsewhere))
    (row,) = [row for row in rows if row["engine"] == "plant"]
    assert (row["verdict"], row["message"]) == ("skipped", "crosscheck.toml asks it for rigid_3r/* only")


@compiled
@pytest.mark.slow
def test_native_code_that_crashes_is_a_row_and_no_more(root: Path, tmp_path: Path) -> None:
    file = tree_fmu.build(tmp_path, "rigid_3r/quintic", forward=True, flags=("-DCRASHING",))
    folder = root / "models" / "rigid_3r"
    mechanism = flexinv.load_mechanism(folder)
    (task,) = load_tasks(folder, mechanism).values()
    door = {"module": registry.FMU, "settings": {"fmu": str(file), "cases": ["*"]}, "engine": "plant"}
    rows = {
        str(row["engine"]): row
        for row in feedforward.list_task_rows(mechanism, task, [{**door, "mechanism": str(folder)}])
    }
    assert (rows["plant"]["verdict"], rows["plant"]["message"]) == ("error", "killed by signal 6 (SIGABRT)")
    assert {rows[name]["verdict"] for name in ("flexinv", "pinocchio", "mujoco")} == {"within"}


@compiled
@pytest.mark.slow
def test_a_plant_that_is_another_one_is_seen(arm: Task, tmp_path: Path) -> None:
    """Without gravity the arm is somewhere else: far beyond the bound of the table."""
    plant = opened(tree_fmu.build(tmp_path, "rigid_3r/quintic", forward=True, flags=("-DWEIGHTLESS",)))
    given, wanted = drive(arm, 0.01)
    result = plant.replay(arm.mechanism, given)
    assert max(float(np.abs(result[name] - wanted[name]).max()) for name in wanted) > 1e3 * feedforward.OF_RIGID


@compiled
def test_it_gives_no_torques_and_says_so(arm: Task, tmp_path: Path) -> None:
    plant = opened(tree_fmu.build(tmp_path, "rigid_3r/quintic", forward=True))
    assert "a forward FMU: torques drive it" in str(plant.unsupported(arm.mechanism, arm.case, "plant"))
    with pytest.raises(InputError, match="a forward FMU"):
        plant.run(arm.mechanism, arm.case, "plant", {})
    assert plant.version() == "0.1"
    assert "forward dynamics" in plant.abilities()


@compiled
@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('initial="exact"', "", "'joint1.q' cannot be set where it starts; write initial=\"exact\" there"),
        ('name="joint2.tau"', 'name="b.tau"', "has no input 'joint2.tau'; it has joint1.tau, b.tau, joint3.tau"),
        ('unit="N.m"', 'unit="N"', "'joint1.tau' is in N, expected N.m"),
        ('fmiVersion="2.0"', 'fmiVersion="2.0" numberOfEventIndicators="1"', "the FMU has events; write it for co-simulation"),
    ],
)  # fmt: skip
def test_what_is_no_plant_is_refused(arm: Task, tmp_path: Path, old: str, new: str, complaint: str) -> None:
    file = tree_fmu.build(tmp_path, "rigid_3r/quintic", forward=True)
    pendulum_fmu.rewrite(file, old, new)
    given, _ = drive(arm, 0.05)
    with pytest.raises(InputError) as error:
        opened(file).replay(arm.mechanism, given)
    assert complaint in str(error.value)


@compiled
def test_mechanisms_that_it_is_not_for_are_refused(root: Path, arm: Task, tmp_path: Path) -> None:
    file = tree_fmu.build(tmp_path, "rigid_3r/quintic", forward=True)
    given, _ = drive(arm, 0.05)
    for name, complaint in (
        ("flex_one_link", "tips are those of open trees of rigid links"),
        ("four_bar", "tips are those of open trees of rigid links"),
        ("talos", "joints with more than one coordinate have no names in an FMU"),
    ):
        with pytest.raises(InputError, match=complaint):
            opened(file).replay(flexinv.load_mechanism(root / "models" / name), given)


def test_only_who_asks_is_told_of_the_projects_engines() -> None:
    assert [study.name for study in STUDIES.values() if study.asks] == ["feedforward", "ladder"]


@pytest.mark.parametrize("stated", ["rigid_3r.fmu", "{mechanism}.fmu"])
def test_a_run_tells_it_of_them_with_the_content_of_their_files(root: Path, tmp_path: Path, stated: str) -> None:
    words = {"scheduler": "", "resume": False, "jobs": 1, "timeout": 1.0, "engine": (), "trust_commands": True}
    told = []
    for content in (b"one", b"two"):
        (tmp_path / "rigid_3r.fmu").write_bytes(content)
        config(tmp_path, stated)
        run_selection = RunSelection(
            names=("rigid_3r/quintic",),
            models=root / "models",
            engines="flexinv,plants",
            studies="feedforward,robots",
            config=tmp_path / "crosscheck.toml",
            **words,
        )
        work = run_selection.prepare_work(lambda _: None)
        options = {study.name: study.options for study in work.studies}
        assert set(options["robots"]) == {"models"}
        (job,) = options["feedforward"]["engines"]
        assert (job["engine"], job["module"]) == ("plants", registry.FMU)
        told.append(job)
    assert told[0] != told[1]  # what was kept of the other file is not taken


def config(folder: Path, stated: str) -> registry.ProjectEngines:
    (folder / "models").mkdir(exist_ok=True)
    (folder / "crosscheck.toml").write_text(f'[engines.plants]\nfmu = "{stated}"\n')
    return registry.collect_doors(folder / "models")


def test_the_fmus_of_many_mechanisms_are_one_engine(tmp_path: Path) -> None:
    (tmp_path / "fmus").mkdir()
    (tmp_path / "fmus" / "arm.fmu").write_bytes(b"one")
    first = config(tmp_path, "fmus/{mechanism}.fmu")
    assert first.engines["plants"].settings is not None
    (tmp_path / "fmus" / "leg.fmu").write_bytes(b"two")
    second = config(tmp_path, "fmus/{mechanism}.fmu")
    assert (
        first.programs[0].trusted_parts != second.programs[0].trusted_parts
    )  # another program: trust is asked for again
    stamps = {
        registry.compute_answer_digest(second.engines["plants"], tmp_path / "models" / name)
        for name in ("arm", "leg", "none")
    }
    assert len(stamps) == 3
    none = fmu.open_adapter("plants", str(tmp_path / "models" / "none"), second.engines["plants"].settings or {})
    assert isinstance(none, fmu.FmuAdapter)
    assert none.version() == ""


@pytest.mark.parametrize("stated", ["../{mechanism}.fmu", "/{mechanism}.fmu", "none/{mechanism}.fmu", "none.fmu"])
def test_files_elsewhere_are_refused(tmp_path: Path, stated: str) -> None:
    (tmp_path / "project").mkdir()
    (tmp_path / "arm.fmu").write_bytes(b"one")
    with pytest.raises(InputError, match="expected a file inside"):
        config(tmp_path / "project", stated)


def test_a_mechanism_without_an_fmu_is_skipped(arm: Task, tmp_path: Path) -> None:
    none = fmu.open_adapter("plants", "models/rigid_3r", {"fmu": str(tmp_path / "{mechanism}.fmu"), "cases": ["*"]})
    assert none.unsupported(arm.mechanism, arm.case, "plants") == "there is no FMU rigid_3r.fmu"


@compiled
def test_what_flexinv_exports_is_replayed_step_by_step(root: Path, tmp_path: Path) -> None:
    """An arm that bends, which tells its tips itself; the torques are linear between samples, as its own are."""
    two = flexinv.load_mechanism(root / "models" / "flex_two_link")
    step = 1e-3
    time = step * np.arange(101)
    torque = np.outer(np.sin(60.0 * time), [0.02, 0.01])
    start = np.array([0.2, -0.4])
    file = flexinv.export_fmu(two, tmp_path / "arm.fmu", kind="forward", step=step, start=start)
    result = opened(file).replay(two, DriveTorques(start, step, torque))
    begins = dict(zip(two.coordinate_names, start, strict=True))
    expected = flexinv.simulate(two, time, torque, step=step, initial="static", start=begins)
    for link in two.links:
        np.testing.assert_allclose(result[link.name], expected.tip[link.name], rtol=0, atol=REPLAYED)
    rigid = flexinv.load_mechanism(root / "models" / "rigid_3r")
    elsewhere = opened(flexinv.export_fmu(rigid, tmp_path / "rigid.fmu", fmi="2.0", kind="forward", step=step))
    with pytest.raises(InputError, match=r"begins at \[0.0, 0.0, 0.0\], .* export it with --start 0.1,0.2,0.3"):
        elsewhere.replay(rigid, DriveTorques(np.array([0.1, 0.2, 0.3]), step, np.zeros((3, 3))))
