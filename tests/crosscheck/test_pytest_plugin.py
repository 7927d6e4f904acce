"""`pytest models/`: one test per comparison, engines run once, and the words of a failure."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
import yaml
from click.testing import CliRunner
from crosscheck_examples import write_models

from crosscheck.cli import main
from crosscheck.commands.shared import terminal
from crosscheck.measures.record import Record
from crosscheck.report.failure import describe_failure
from crosscheck.run.isolation import Attempt
from crosscheck.run.run_cache import AttemptFolder
from crosscheck.verdicts.baseline import Baseline, judge_by_baseline, make_comparison_key
from crosscheck.verdicts.compare import Comparison
from crosscheck.verdicts.plan import discover

ROW = Comparison(
    mechanism="arm", case="swing", engine="exudyn-ge", reference="flexinv", quantity="torque", unit="N m",
    verdict="deviation", message="0.0125 of the range, the limit is 0.005", maximum=0.0125, rms=0.002, scale=1.0,
    limit=0.005, reason="meshes and steps differ", series="torque/hub", time=0.035, error_bar=2.5e-4,
)  # fmt: skip


def test_a_deviation_says_everything() -> None:
    assert describe_failure(ROW, "rotor inertia is missing", exported=True) == "\n".join(
        [
            "arm/swing, torque: exudyn-ge differs from flexinv by more than its limit",
            "  difference    0.013 N m, 0.013 of the range of 1 N m",
            "  where         torque/hub, at t = 0.035 s",
            "  limit         0.005 of the range: meshes and steps differ",
            "  error bars    2.5e-4 N m of both engines together: at most 2 % of the difference",
            "  cause         rotor inertia is missing",
            "  to accept     mend the model; or raise the limit in models/arm/cases.toml with its reason, "
            'crosscheck run arm/swing, then crosscheck bless --reason "..."',
            "  to look       crosscheck run arm/swing --engines exudyn-ge,flexinv",
            "  to reproduce  crosscheck export arm --case swing --engine exudyn-ge",
        ]
    )


def test_a_measurement_or_a_record_is_not_exported() -> None:
    assert "crosscheck export" in describe_failure(ROW, exported=True)
    assert "crosscheck export" not in describe_failure(ROW, exported=False)


def test_a_comparison_without_limit_asks_for_one() -> None:
    words = "no limit is stated for this quantity and engine: crosscheck verify proposes one"
    row = replace(ROW, verdict="unjudged", limit=None, reason="", message=words, error_bar=None, maximum=2.0)
    assert describe_failure(row) == "\n".join(
        [
            "arm/swing, torque: exudyn-ge is compared with flexinv, but no limit holds",
            "  difference    2 N m, 2 of the range of 1 N m",
            "  where         torque/hub, at t = 0.035 s",
            "  limit         none",
            f"  why           {words}",
            "  error bars    not both engines have one that a refinement has shown",
            "  to accept     state a limit with its reason in models/arm/cases.toml",
            "  to look       crosscheck run arm/swing --engines exudyn-ge,flexinv",
        ]
    )


def test_a_comparison_that_has_become_worse_says_since_when_it_is_blessed() -> None:
    known = Baseline({make_comparison_key(ROW): 0.001}, "looked at", "2026-03-01T01:00:00+00:00")
    row = judge_by_baseline(replace(ROW, verdict="within", message="", limit=0.05), known)
    assert describe_failure(row, "the viscous damping of hub differs by 0.05 N m s/rad").split("\n") == [
        "arm/swing, torque: exudyn-ge differs from flexinv by more than when it was blessed",
        "  difference    0.013 N m, 0.013 of the range of 1 N m",
        "  where         torque/hub, at t = 0.035 s",
        "  limit         0.05 of the range: meshes and steps differ",
        "  blessed       0.001 of the range; 5e-4 more is noise",
        "  error bars    2.5e-4 N m of both engines together: at most 2 % of the difference",
        "  cause         the viscous damping of hub differs by 0.05 N m s/rad",
        "  to accept     mend the cause; or crosscheck run arm/swing, look at its report, then "
        'crosscheck bless --reason "..."',
        "  to look       crosscheck run arm/swing --engines exudyn-ge,flexinv",
    ]


def test_a_comparison_that_nobody_has_blessed_says_how() -> None:
    row = judge_by_baseline(replace(ROW, verdict="within", message="", limit=0.05), Baseline())
    lines = describe_failure(row).split("\n")
    assert lines[0] == "arm/swing, torque: exudyn-ge is compared with flexinv, but nothing is blessed yet"
    accept = '  to accept     crosscheck run arm/swing, look at its report, then crosscheck bless --reason "..."'
    assert lines[5] == accept


def test_an_engine_that_failed_says_why() -> None:
    row = Comparison("arm", "swing", "mujoco", "flexinv", "tip", "", "error", "timeout: stopped after 9 s")
    assert describe_failure(row) == "\n".join(
        [
            "arm/swing, tip: mujoco cannot be compared with flexinv",
            "  why           timeout: stopped after 9 s",
            "  to look       crosscheck run arm/swing --engines mujoco,flexinv",
        ]
    )


DAMPED = """\
double_pendulum/swing, torque: damped differs from flexinv by more than its limit
  difference    0.16 N m, 0.0019 of the range of 82 N m
  where         torque/knee, at t = 0.25 s
  limit         1e-15 of the range: closed formulas on both sides: rounding of two links stays below 1e-14
  error bars    1e-15 N m of both engines together: less than 0.1 % of the difference
  cause         the viscous damping of knee differs by 0.05 N m s/rad or N s/m: explains 99.99% of the difference; \
put into the reference, 1e-15 of the range remains of 1.9e-03.
  to accept     mend the model; or raise the limit in models/double_pendulum/cases.toml with its reason, \
crosscheck run double_pendulum/swing, then crosscheck bless --reason "..."
  to look       crosscheck run double_pendulum/swing --engines damped,flexinv"""


def pytest_on(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run pytest as a user would, in a process of its own that knows nothing of this run."""
    command = [sys.executable, "-m", "pytest", "-p", "crosscheck.pytest_plugin", "-p", "no:cacheprovider", *words]
    root = str(Path(__file__).resolve().parents[2])
    there = ("PYTEST", "CI", "BUILD_NUMBER")  # with the latter two pytest repeats whole messages in its summary
    clean = {name: value for name, value in os.environ.items() if not name.startswith(there)}
    return subprocess.run(
        command,
        cwd=folder,
        env=clean | {"PYTHONPATH": root, "TMPDIR": str(folder)},
        capture_output=True,
        text=True,
        timeout=120,
    )


@pytest.mark.slow
def test_every_comparison_is_a_test(root: Path, tmp_path: Path) -> None:
    """Two processes of xdist, three engines: sound ones pass, what Exudyn integrates in time differs by more than its bars."""
    cases = write_models(tmp_path / "models", root) / "cases.toml"
    text = cases.read_text().replace('engines = ["*"]', 'engines = ["pino*", "exudyn-dae"]', 1)
    # the swing of models/double_pendulum, whose difference is more than twice the error bars of both
    text = text.replace("step_s = 5e-3", "step_s = 1e-3\nsample_s = 0.01")
    text = text.replace("duration_s = 0.5\nhold_s = 0.25", 'law = "quintic"\nduration_s = 1.2')
    cases.write_text(text.replace("to_deg = 90", "to_deg = 120").replace("to_deg = -45", "to_deg = -75"))
    xml = tmp_path / "tests.xml"
    options = ["models", "-n", "2", "--crosscheck-engines=flexinv,pinocchio,exudyn-dae", f"--junitxml={xml}", "-v"]
    done = pytest_on(tmp_path, *options, "-k", "torque or (tip and pinocchio)")
    assert done.returncode == 1, done.stdout + done.stderr
    result = {t.get("name"): t for t in ET.parse(xml).iter("testcase")}
    assert set(result) == {
        f"double_pendulum-swing-{engine}"
        for engine in ("pinocchio-torque", "pinocchio-tip", "exudyn-dae-torque")
    }  # fmt: skip
    failed = {name: t.find("failure") for name, t in result.items() if t.find("failure") is not None}
    assert set(failed) == {"double_pendulum-swing-exudyn-dae-torque"}
    text = failed["double_pendulum-swing-exudyn-dae-torque"].text or ""
    assert "double_pendulum/swing, torque: exudyn-dae differs from flexinv by more than its limit" in text
    assert re.search(r"  difference    \S+ N m, \S+ of the range of \S+ N m\n  where         torque/\w+, at t = ", text)
    assert "Traceback" not in text
    properties = {
        p.get("name"): float(p.get("value", ""))
        for p in result["double_pendulum-swing-pinocchio-torque"].iter("property")
    }
    assert properties["limit"] == 1e-12
    assert 0 < properties["fraction"] < 1e-12
    assert not list(tmp_path.glob("crosscheck-*")), "records and scratch folders are removed"


# A conftest of a user who has an engine of their own: here Pinocchio with a damper that the model does not have.
OWN_ENGINE = """
import os, sys
sys.path.insert(0, {tests!r})
os.environ["PYTHONPATH"] += os.pathsep + {tests!r}
import rogue_engines
from crosscheck.engines import ENGINES
ENGINES["damped"] = rogue_engines.engine("damped")
"""


@pytest.mark.slow
def test_a_failure_names_the_cause_and_how_to_bless(root: Path, tmp_path: Path) -> None:
    """Word for word, from the run of both engines to the diagnosis; the same difference inside its limit is not blessed."""
    write_models(tmp_path / "models", root)
    loose = write_models(tmp_path / "models", root, "loose") / "cases.toml"
    loose.write_text(loose.read_text().replace("maximum = 1e-12", "maximum = 0.5", 1))
    (tmp_path / "models" / "conftest.py").write_text(
        OWN_ENGINE.format(tests=str(Path(__file__).resolve().parents[1] / "shared"))
    )
    blessed = tmp_path / "reports" / "baseline"
    blessed.mkdir(parents=True)
    (blessed / "blessed.json").write_text('{"reason": "", "date": "2026-03-01", "versions": {}}')
    known = ["mechanism,case,engine,reference,quantity,unit,fraction"]
    known += [f"{name},swing,pinocchio,flexinv,torque,N m,1e-14" for name in ("double_pendulum", "loose")]
    (blessed / "metrics.csv").write_text("\n".join(known) + "\n")
    options = ["models", "--crosscheck-engines=pinocchio,damped", "-k", "torque", "-rA"]
    said = pytest_on(tmp_path, *options).stdout
    # error bars and remainder are rounding, which is not the same on every machine
    assert f"\n{DAMPED}\n" in re.sub(r"\d(\.\d+)?e-1\d ", "1e-15 ", said)
    assert "loose/swing, torque: damped is compared with flexinv, but nothing is blessed yet" in said
    assert said.count("  cause         the viscous damping of knee differs by 0.05 N m s/rad") == 1
    assert len(re.findall(r"^PASSED .*-swing-pinocchio-torque$", said, re.M)) == 2
    (blessed / "metrics.csv").write_text("what is this")
    said = pytest_on(tmp_path, "models/loose", "--crosscheck-engines=pinocchio", "-k", "torque").stdout
    assert "metrics.csv has other columns than mechanism, case" in said
    assert "Traceback" not in said


@pytest.mark.slow
def test_a_model_that_cannot_be_read_is_an_error_of_collection(tmp_path: Path) -> None:
    folder = tmp_path / "models" / "broken"
    folder.mkdir(parents=True)
    (folder / "mechanism.toml").write_text("links = [")
    (folder / "cases.toml").write_text("")
    done = pytest_on(tmp_path, "models")
    assert done.returncode == 2
    assert "ERROR models/broken/cases.toml" in done.stdout
    assert "InputError" in done.stdout
    unknown = pytest_on(tmp_path, "models", "--crosscheck-engines=adams")
    assert "no engine is called 'adams'; known: flexinv, pinocchio" in unknown.stdout + unknown.stderr


def test_the_plugin_waits_until_it_is_needed() -> None:
    """It is loaded in every pytest run of the environment: then it imports nothing but pytest."""
    code = "import crosscheck.pytest_plugin, sys; sys.exit(bool({'numpy', 'click', 'flexinv'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0


def test_answers_are_kept_and_failures_are_not(root: Path, tmp_path: Path) -> None:
    folder = write_models(tmp_path / "models", root)
    (task,) = discover(folder.parent).tasks
    attempt_folder = AttemptFolder(tmp_path / "kept")
    skipped = Attempt(Record(engine="x", status="skipped", message="has no beams"), "printed", 1.5)
    with attempt_folder.take_lock(task, "x"):
        assert attempt_folder.find(task, "x") is None
        attempt_folder.add_answer(task, "x", skipped)
        attempt_folder.add_answer(task, "y", replace(skipped, record=Record(engine="y", status="error")))
    result = attempt_folder.find(task, "x")
    assert result is not None
    assert (result.record.message, result.printed, result.elapsed) == ("has no beams", "printed", 1.5)
    assert attempt_folder.find(task, "y") is None
    assert attempt_folder.find(task, "x", {"step": 1.0}) is None
    loose = replace(task, case=replace(task.case, limits=()))
    assert attempt_folder.find(loose, "x") is not None  # limits judge, they do not compute
    other = replace(task, case=replace(task.case, step=task.case.step / 2))
    assert attempt_folder.find(other, "x") is None
    record = tmp_path / "measured.csv"
    record.write_text("time [s]\n0\n")
    measured = replace(task, case=replace(task.case, measured=record))
    attempt_folder.add_answer(measured, "x", skipped)
    assert attempt_folder.find(measured, "x") is not None
    record.write_text("time [s]\n1\n")  # another measurement
    assert attempt_folder.find(measured, "x") is None
    for file in (tmp_path / "kept").glob("*.json"):
        file.write_text("{")
    assert attempt_folder.find(task, "x") is None


WORKFLOWS = sorted((Path(__file__).resolve().parents[2] / "docs" / "workflows").glob("*.yml"))


@pytest.mark.parametrize("file", WORKFLOWS, ids=lambda f: f.stem)
def test_workflows_are_sound(file: Path, tmp_path: Path) -> None:
    workflow = yaml.safe_load(file.read_text())
    assert {"name", True, "permissions", "jobs"} <= set(workflow)  # YAML 1.1 reads the key `on` as true
    jobs = list(workflow["jobs"].values())
    (job,) = [one for one in jobs if any("run" in step for step in one["steps"])]  # one that publishes runs no command
    commands = [step["run"] for step in job["steps"] if "run" in step]
    assert any(command.startswith("crosscheck ") for command in commands)
    for command in commands:
        words = command.split()
        if words[0] == "crosscheck":
            help_text = CliRunner().invoke(main, [words[1], "--help"])
            assert help_text.exit_code == 0, f"{file.name}: {command}"
            assert all(word in help_text.output for word in words if word.startswith("--"))
    assert {step["uses"].split("@")[0] for step in job["steps"] if "uses" in step} >= {
        "actions/checkout",
        "actions/setup-python",
    }
    # In a project of somebody else: flexinv comes from where a variable says, and nothing of ours has to be there.
    assert workflow["env"]["FLEXINV"] == "${{ vars.FLEXINV || '.[all]' }}"
    (install,) = [command for command in commands if "pip install" in command]
    told = install.replace("python -m pip install", "printf '%s\\n'")
    for has, words in ((True, ["--constraint", "constraints.txt"]), (False, [])):
        (tmp_path / "constraints.txt").unlink(missing_ok=True)
        if has:
            (tmp_path / "constraints.txt").touch()
        done = subprocess.run(
            ["bash", "-e", "-c", told],
            cwd=tmp_path,
            env=os.environ | {"FLEXINV": "a @ b"},
            capture_output=True,
            text=True,
        )
        assert (done.returncode, done.stdout.split("\n")[:-1]) == (0, [*words, "a @ b"])
    assert not any("cache-dependency-path" in step.get("with", {}) for step in job["steps"])


def test_a_job_on_github_gets_the_summary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page, out = tmp_path / "page.md", tmp_path / "report"
    out.mkdir()
    (out / "summary.md").write_text("# All is well\n" + "| a | b |\n" * 20)
    terminal.add_step_summary(out)
    assert not page.exists()
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(page))
    terminal.add_step_summary(out)
    assert page.read_text() == (out / "summary.md").read_text()
    monkeypatch.setattr(terminal, "LARGEST_SUMMARY", 105)
    page.unlink()
    terminal.add_step_summary(out)
    lines = page.read_text().splitlines()
    assert lines[-1] == "Cut off here: the whole is summary.md of the report."
    assert lines[-3] == "| a | b |"


def test_the_environment_is_told_of_the_plugin(root: Path) -> None:
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    assert project["entry-points"]["pytest11"] == {"crosscheck.pytest_plugin": "crosscheck.pytest_plugin"}
