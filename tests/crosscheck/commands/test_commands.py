"""The command line of crosscheck: what it prints, what it writes, and its exit codes."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time as clock
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result
from crosscheck_examples import write_models

from crosscheck.causes.fault_benches import BENCHES
from crosscheck.cli import main
from crosscheck.commands import selftest
from crosscheck.commands.shared.options import RunSelection
from crosscheck.commands.shared.terminal import Failure
from crosscheck.engines import ENGINES, Engine
from crosscheck.studies import STUDIES
from crosscheck.verdicts.results import read
from crosscheck.verdicts.scope import Scope

Invoke = Callable[..., Result]


@pytest.fixture
def invoke() -> Invoke:
    return lambda *words: CliRunner().invoke(main, list(map(str, words)))


@pytest.fixture
def models(root: Path, tmp_path: Path) -> Path:
    return write_models(tmp_path / "models", root).parent


def test_a_sound_run_has_exit_code_0_and_writes_everything(models: Path, tmp_path: Path, invoke: Invoke) -> None:
    out = tmp_path / "report"
    done = invoke("run", "--models", models, "--engines", "flexinv,pino*", "--studies", "", "--jobs", 1, "--out", out)
    assert done.exit_code == 0, done.output
    assert "All 4 comparisons are within their limits." in done.output
    assert "double_pendulum/swing pinocchio" in done.output
    names = {p.name for p in out.iterdir()}
    assert names >= {"index.html", "results.json", "summary.md", "junit.xml", "series", "cases", "data", "assets"}
    (out / "index.html").unlink()
    again = invoke("report", out)
    assert again.exit_code == 0
    assert (out / "index.html").is_file()


def test_a_missing_engine_has_exit_code_2_and_still_a_report(
    models: Path, tmp_path: Path, invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    gone = Engine("pinocchio", "x", "no_such_package", "python -m pip install pin")
    monkeypatch.setattr(
        "crosscheck.doors.registry.ENGINES", {"pinocchio": gone, "mujoco": replace(gone, name="mujoco")}
    )
    out = tmp_path / "report"
    done = invoke("run", "double_pendulum", "--models", models, "--out", out)
    assert done.exit_code == 2
    assert "python -m pip install pin" in done.output
    assert "python -m pip install pin" in (out / "index.html").read_text()
    listed = invoke("engines")
    assert "missing" in listed.output


@pytest.mark.skipif(sys.platform != "linux", reason="finds the child processes in /proc")
def test_ctrl_c_ends_the_engines_and_still_writes_a_report(models: Path, tmp_path: Path) -> None:
    out = tmp_path / "report"
    command = [sys.executable, "-m", "crosscheck", "run", "--models", str(models), "--out", str(out), "--jobs", "1"]
    run = subprocess.Popen(
        command, stderr=subprocess.PIPE, text=True, cwd=Path(__file__).resolve().parents[3], preexec_fn=_hear_ctrl_c
    )
    children = Path(f"/proc/{run.pid}/task")
    end = clock.monotonic() + 60.0
    while not (started := offspring(children)) and clock.monotonic() < end:
        clock.sleep(0.02)
    assert started
    run.send_signal(signal.SIGINT)
    _, printed = run.communicate(timeout=120.0)
    assert run.returncode == 2, printed
    assert "interrupted before everything was run" in printed
    assert all(not Path(f"/proc/{pid}").exists() for pid in started)
    results = read(out / "results.json")
    assert {r.engine for r in results.runs} == set(ENGINES)
    assert (out / "index.html").is_file()


def _hear_ctrl_c() -> None:
    """A shell's background job ignores Ctrl-C, and so do its children: this one is to hear it."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def offspring(tasks: Path) -> list[str]:
    """Children of all threads of a process."""
    try:
        return [pid for t in os.listdir(tasks) for pid in (tasks / t / "children").read_text().split()]
    except OSError:
        return []


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("run", "tail"), "nothing to run is called 'tail'; mechanisms here: double_pendulum"),
        (
            ("run", "--engines", ""),
            "--engines '' names no engine: nothing would be compared; write two or more of flexinv,",
        ),
        (("run", "--engines", ","), "--engines ',' names no engine: nothing would be compared"),
        (("run", "--engines", "mujoco"), "--engines 'mujoco' leaves only mujoco: nothing would be compared"),
        (("verify", "double_pendulum", "--engines", "flexinv"), "--engines 'flexinv' leaves only flexinv"),
        (("nightly", "--engines", "flexinv"), "--engines 'flexinv' leaves only flexinv"),
        (("run", "--engines", "adams"), "no engine is called 'adams'; known: flexinv, pinocchio"),
        (("run", "--studies", "weather"), "no study is called 'weather'"),
        (("run", "--timeout", "0"), "0.0 is not in the range"),
        (("run", "--timeout", "nan"), "nan is no span of time; write seconds, such as 900"),
        (("run", "--timeout", "inf"), "inf is no span of time"),
        (("run", "--jobs", "0"), "0 is not in the range"),
        (("dance",), "No such command 'dance'"),
    ],
)
def test_wrong_words_have_exit_code_2_and_say_what_is_right(
    models: Path, invoke: Invoke, words: tuple[str, ...], message: str
) -> None:
    where = ("--models", models) if words[0] != "dance" else ()
    done = invoke(*words, *where)
    assert done.exit_code == 2
    assert message in done.output


def test_a_failure_of_the_harness_is_not_a_deviation(
    models: Path, tmp_path: Path, invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fall(*_: object) -> None:
        raise ZeroDivisionError("unforeseen")

    monkeypatch.setattr("crosscheck.report.write_report.render", fall)
    monkeypatch.setattr(
        "crosscheck.doors.registry.ENGINES", dict.fromkeys("ef", Engine("e", "x", "no_such_package", "never"))
    )
    done = invoke("run", "double_pendulum", "--models", models, "--out", tmp_path / "o")
    assert done.exit_code == 2
    assert "the harness failed: ZeroDivisionError: unforeseen" in done.output


def test_what_is_no_report_is_refused(tmp_path: Path, invoke: Invoke) -> None:
    assert "cannot read" in invoke("report", tmp_path).output
    (tmp_path / "results.json").write_text('{"schema": 99}')
    done = invoke("report", tmp_path)
    assert (done.exit_code, "schema 1" in done.output) == (2, True)


def test_list_shows_mechanisms_cases_and_what_cannot_be_read(models: Path, invoke: Invoke) -> None:
    done = invoke("list", "--models", models)
    assert done.exit_code == 0
    for word in ("double_pendulum", "swing", "torque, tip, wrench"):
        assert word in done.output
    (models / "double_pendulum" / "mechanism.toml").write_text("links = [")
    done = invoke("list", "--models", models)
    assert done.exit_code == 2
    assert "cannot be read" in done.output


def test_every_help_teaches(invoke: Invoke) -> None:
    assert "Exit codes" in invoke("--help").output
    context = click.Context(main)
    names = main.list_commands(context)  # every file of crosscheck/commands
    assert {"run", "report", "list", "engines"} <= set(names)
    for name in names:
        command = main.get_command(context, name)
        assert command is not None
        assert command.name == name
        text = invoke(name, "--help").output
        assert len(command.help or "") > 40
        assert all(getattr(p, "help", "") for p in command.params if p.param_type_name == "option"), command.name
        assert "Usage" in text


def test_no_line_of_the_overview_is_cut_off() -> None:
    shown = CliRunner().invoke(main, ["--help"], terminal_width=80).output
    assert "..." not in shown.partition("Commands:")[2]


# --- a project of somebody else ---------------------------------------------------------------------------------------


def asked(models: Path, names: tuple[str, ...] = (), studies: str | None = None) -> list[str]:
    """The studies of a run."""
    work = RunSelection(names, models, "*", studies, "", False, 1, 60.0, None, (), False).prepare_work(
        lambda line: None
    )
    return [study.name for study in work.studies]


def test_a_run_is_told_what_the_command_line_asks_for(models: Path) -> None:
    """By that a night knows what it misses, whatever is left out."""
    selection = RunSelection(("double_*",), models, "flexinv, pin*", "", "", False, 1, 60.0, None, (), False)
    assert selection.prepare_work(lambda line: None).options.scope == Scope(("double_*",), ("flexinv", "pin*"))


def test_studies_belong_to_a_folder_of_models(root: Path, models: Path) -> None:
    assert asked(models) == []
    assert asked(models, studies="rob*") == ["robots"]
    assert asked(root / "models") == list(STUDIES)
    assert asked(root / "models", ("flex_one_link",)) == []
    (models / "studies.toml").write_text('studies = ["incremental"]')
    assert asked(models) == ["incremental"]
    assert asked(models, studies="") == []
    for text, message in (
        ('studies = ["robot"]', "no study is called 'robot'; known: robots,"),
        ('studies = "robots"', 'expected one list of names; write studies = ["robots"]'),
        ("studies = [", "studies.toml"),
    ):
        (models / "studies.toml").write_text(text)
        with pytest.raises(Failure) as said:
            asked(models)
        assert message in said.value.message


def test_the_benches_are_found_where_they_were_installed(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tasks = (root / "flexinv" / "cli" / "warm.py").read_text()
    computed = re.findall(r'(?:_solve\(folder, |_solve, model=)"(\w+)"', tasks)
    names = {bench.mechanism for bench in BENCHES} | set(computed)  # `crosscheck selftest` and `flexinv warm`
    assert "four_bar_flexible" in names
    files = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["setuptools"]["data-files"]
    assert files == {f"share/flexinv/models/{name}": [f"models/{name}/*"] for name in names}
    monkeypatch.setattr(selftest, "INSTALLED", root / "models")
    monkeypatch.chdir(tmp_path)
    assert selftest.find_model_folder(names, None) == root / "models"
    with pytest.raises(Failure, match=r"the benches need flexinv's own models: .* has no ur5; write --models"):
        selftest.find_model_folder(["ur5"], tmp_path)


# --- what is broken, full, or not there -------------------------------------------------------------------------------


def absent(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two engines that are not installed: everything but the engines runs at once."""
    gone = {name: Engine(name, "x", "no_such_package", "never") for name in ("flexinv", "pinocchio")}
    monkeypatch.setattr("crosscheck.doors.registry.ENGINES", gone)


def test_one_model_that_cannot_be_read_ends_no_other_and_is_named_with_its_reason(
    root: Path, models: Path, tmp_path: Path, invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    absent(monkeypatch)
    endless = write_models(models, root, "endless") / "cases.toml"
    endless.write_text(endless.read_text().replace("step_s = 5e-3\n", "step_s = 5e-3\nend_s = 1e12\n"))
    done = invoke("run", "--studies", "", "--models", models, "--out", tmp_path / "out")
    said = " ".join(done.output.split())
    assert done.exit_code == 2
    assert "1 model cannot be read (endless)" in said
    assert "! endless model: InputError: " in said
    assert (
        "end_s = 1e+12 and sample_s = 0.005 make 2e+14 samples, expected at most 1e+07; write a shorter end_s" in said
    )
    assert {(r.mechanism, r.engine) for r in read(tmp_path / "out" / "results.json").runs} == {
        ("double_pendulum", "flexinv"),
        ("double_pendulum", "pinocchio"),
    }


@pytest.mark.parametrize("words", [("run",), ("report",), ("bless", "--reason", "x", "--from")])
def test_a_full_disk_is_said_in_words(
    words: tuple[str, ...], models: Path, tmp_path: Path, invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    absent(monkeypatch)
    out = tmp_path / "out"
    assert invoke("run", "double_pendulum", "--models", models, "--out", out).exit_code == 2

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("crosscheck.output_folder.replace", full)
    where = ("double_pendulum", "--models", models, "--out", tmp_path / "new") if words == ("run",) else (out,)
    done = invoke(*words, *where)
    assert done.exit_code == 2
    assert "No space left on device" in done.output
    assert "Traceback" not in done.output
    assert "the harness failed" not in done.output


def test_a_page_of_a_job_that_cannot_be_written_is_told_and_changes_nothing(
    models: Path, tmp_path: Path, invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    absent(monkeypatch)
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(tmp_path))
    done = invoke("run", "double_pendulum", "--models", models, "--out", tmp_path / "out")
    assert "the summary could not be added to the page of this job" in done.output
    assert "Traceback" not in done.output
    assert "2 runs failed" in done.output


def test_a_report_over_a_file_or_with_damaged_series_is_one_error(models: Path, tmp_path: Path, invoke: Invoke) -> None:
    (tmp_path / "file").write_text("")
    where = ("--models", models, "--engines", "pinocchio,mujoco", "--jobs", 1)
    done = invoke("run", "double_pendulum", *where, "--out", tmp_path / "file" / "sub")
    assert done.exit_code == 2
    assert "cannot be written to: Not a directory; write another folder" in " ".join(done.output.split())
    assert "Traceback" not in done.output
    out = tmp_path / "out"
    invoke("run", "double_pendulum", *where, "--out", out)
    (series,) = out.glob("series/*/pinocchio.npz")
    series.write_bytes(series.read_bytes()[:100])
    done = invoke("report", out)
    assert done.exit_code == 2
    assert f"no record at {series.with_suffix('')}" in "".join(done.output.splitlines())
    assert "Traceback" not in done.output


def test_nothing_is_copied_without_end(tmp_path: Path, invoke: Invoke) -> None:
    done = invoke("new", "x", "--from-urdf", "/dev/zero", "--models", tmp_path)
    assert done.exit_code == 2
    assert "expected: a URDF" in done.output
    assert list(tmp_path.iterdir()) == []


def without(module: str, *words: str) -> subprocess.CompletedProcess[str]:
    """`crosscheck` where a package is not installed."""
    code = f"import sys; sys.modules[{module!r}] = None; from crosscheck.start import main; main()"
    return subprocess.run(
        [sys.executable, "-c", code, *words], capture_output=True, text=True, cwd=Path(__file__).resolve().parents[3]
    )


@pytest.mark.parametrize("module", ["rich", "jinja2", "packaging", "filelock"])
def test_what_is_not_installed_is_said_with_what_to_install(module: str) -> None:
    done = without(module, "run")
    assert done.returncode == 2
    assert done.stderr.startswith(
        f"Error: crosscheck needs {module}, which is not installed; to install what it needs (flexinv[report]): "
    )
    assert "'rich>=13'" in done.stderr


def test_the_list_of_commands_says_what_each_says_of_itself() -> None:
    shown = {line.split()[0]: line.split(None, 1)[1] for line in list_commands_in_help()}
    for name in main.list_commands(click.Context(main)):
        command = main.get_command(click.Context(main), name)
        assert command is not None
        assert shown[name] == command.get_short_help_str(80)


def list_commands_in_help() -> list[str]:
    done = CliRunner().invoke(main, ["--help"], terminal_width=200, max_content_width=200)
    return done.output.partition("Commands:\n")[2].strip().splitlines()


@pytest.mark.slow
def test_without_a_database_everything_but_nights_runs() -> None:
    done = without("sqlalchemy", "--help")
    assert done.returncode == 0
    assert "run       Run mechanisms in all engines" in done.stdout
    assert (
        "nightly   Run everything, judge it, and add it to the history." in done.stdout
    )  # none is imported for the list
    night = without("sqlalchemy", "nightly", "--jobs", "1")
    assert night.returncode == 2
    assert "flexinv[history]" in night.stderr


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="/dev/full")
def test_a_reader_that_goes_away_is_no_deviation() -> None:
    command = [sys.executable, "-m", "crosscheck", "engines"]
    folder = Path(__file__).resolve().parents[3]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder) as listing:
        assert listing.stdout is not None
        assert listing.stderr is not None
        listing.stdout.close()
        said = listing.stderr.read()
        assert listing.wait(120.0) == 2
    assert "Traceback" not in said
    with open("/dev/full", "w") as full:
        done = subprocess.run([*command[:-1], "--help"], stdout=full, stderr=subprocess.PIPE, text=True, cwd=folder)
    assert done.returncode == 2
    assert "No space left on device" in done.stderr
    assert "Traceback" not in done.stderr
