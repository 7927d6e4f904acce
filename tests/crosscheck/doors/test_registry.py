"""Engines of a project: who may name a program, what is trusted, names that are taken; records and packages as full columns."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
import rogue_engines
from click.testing import CliRunner
from crosscheck_examples import write_models

from crosscheck.causes.dictionary import DICTIONARY, collect_causes
from crosscheck.cli import main
from crosscheck.doors import config, packages, trust
from crosscheck.doors.registry import ProjectEngines, collect_doors, compute_answer_digest
from crosscheck.engines import ENGINES, adapter, describe_missing_package, open_adapter
from crosscheck.engines.base import MEMBERS, offered
from crosscheck.verdicts.results import Results, read
from flexinv.errors import InputError

SHARED = Path(rogue_engines.__file__).parent
PROGRAM = f"""
[engines.mine]
command = [{json.dumps(sys.executable)}, "rigid.py", "{{kit}}", "{{out}}"]

[[engines.mine.limits]]
quantity = "torque"
maximum = 1e-12
reason = "closed formulas: rounding"
"""


@pytest.fixture
def project(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of a team's own: a mechanism, a program beside it, and a user who trusts nothing yet."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    home = tmp_path / "team"
    write_models(home / "models", root)
    shutil.copy(SHARED / "kit_programs" / "rigid.py", home)
    monkeypatch.chdir(home)
    return home


def call(*words: str) -> Any:
    return CliRunner().invoke(main, list(words))


def run(*words: str, code: int) -> Results:
    done = call("run", *words)
    assert done.exit_code == code, done.output
    return read(Path("reports/latest/results.json"))


# --- crosscheck.toml ------------------------------------------------------------------------------------------------


def test_a_file_is_found_above_the_models_up_to_the_repository(tmp_path: Path) -> None:
    models = tmp_path / "a" / "b" / "models"
    models.mkdir(parents=True)
    (tmp_path / "crosscheck.toml").touch()
    assert (
        config.find_config(models) is None
    )  # neither a repository nor the home folder: the folder above the models alone
    (tmp_path / ".git").mkdir()
    assert config.find_config(models) == tmp_path / "crosscheck.toml"
    (tmp_path / "a" / ".git").mkdir()
    assert config.find_config(models) is None
    (tmp_path / "a" / "b" / "crosscheck.toml").touch()
    assert config.find_config(models) == tmp_path / "a" / "b" / "crosscheck.toml"
    assert config.find_config(models, tmp_path / "crosscheck.toml") == tmp_path / "crosscheck.toml"


@pytest.mark.parametrize("place", ["crosscheck.toml", "arm/crosscheck.toml", "arm/records/mine/crosscheck.toml"])
def test_a_command_in_models_is_refused(tmp_path: Path, place: str) -> None:
    file = tmp_path / "models" / place
    file.parent.mkdir(parents=True)
    file.write_text(PROGRAM)
    with pytest.raises(InputError, match="a folder of models is data and names no programs"):
        config.find_config(tmp_path / "models")
    with pytest.raises(InputError, match="a folder of models is data"):
        config.find_config(tmp_path / "models", file)


def test_a_file_of_somebody_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "models").mkdir()
    file = tmp_path / "crosscheck.toml"
    file.write_text(PROGRAM)
    file.chmod(0o666)
    with pytest.raises(InputError, match="everybody may write it"):
        config.find_config(tmp_path / "models")
    file.chmod(0o644)
    if os.getuid() != 0:
        pytest.skip("only root can give a file to another user")
    os.chown(file, 12345, -1)
    with pytest.raises(InputError, match="belongs to another user"):
        config.find_config(tmp_path / "models")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[engines.mine]", "one of command, fmu and python"),
        ('[engines.mine]\ncommand = ["x", "{out}"]\npython = "a:b"', "command and python"),
        ('[engines.mine]\ncommand = ["x", "{kit}"]', "no {out}"),
        ('[engines.mine]\ncommand = "x {out}"', "should be a valid list"),
        ('[engines.mine]\ncomand = ["x", "{out}"]', "comand"),
        ('[engines."../mine"]\ncommand = ["x", "{out}"]', "an engine called '../mine'"),
        ('[engines.flexinv]\ncommand = ["x", "{out}"]', "an engine is called 'flexinv', which is taken"),
        ('[engines.mine]\nfmu = "../arm.fmu"', "expected a file inside"),
        ('[engines.mine]\npython = "os.system(1)"', "expected a module and an object in it"),
        ("engines = 3", "engines"),
    ],
)
def test_a_mistake_in_the_file_is_named(project: Path, text: str, complaint: str) -> None:
    (project / "crosscheck.toml").write_text(text)
    done = call("run", "--engines", "flexinv,*")
    assert done.exit_code == 2
    assert complaint in " ".join(done.output.replace("valid list", "valid list").split()) or complaint in done.output


# --- trust ----------------------------------------------------------------------------------------------------------


def test_a_new_or_changed_program_is_run_only_when_it_is_trusted(project: Path) -> None:
    file = project / "crosscheck.toml"
    file.write_text(PROGRAM)
    done = call("run", "--engines", "flexinv,mine")
    assert done.exit_code == 2
    assert "new or has changed" in done.output
    assert "crosscheck trust" in done.output
    assert not (project / "reports").exists()
    assert call("run", "--engines", "flexinv,pinocchio", "--studies", "").exit_code == 0  # it is not asked
    assert call("trust", "--yes").exit_code == 0
    known = collect_doors(project / "models")
    lines: list[str] = []
    known.check_trust(["mine"], False, lines.append)
    assert "rigid.py" in lines[0]
    file.write_text(PROGRAM.replace("rigid.py", "./rigid.py"))
    with pytest.raises(InputError, match="new or has changed"):
        collect_doors(project / "models").check_trust(["mine"], False, lines.append)
    collect_doors(project / "models").check_trust(["mine"], True, lines.append)  # in CI


@pytest.mark.parametrize("command", ["python scripts/mine.py {kit} {out}", "python -m scripts.mine {kit} {out}"])
def test_a_changed_file_of_a_program_is_named_and_not_run(project: Path, command: str) -> None:
    """What the script loads from its folder is trusted with it; data, databases and caches are not looked at."""
    (project / "scripts" / "parts").mkdir(parents=True)
    (project / "scripts" / "mine.py").write_text("from parts import torque\n")
    (project / "scripts" / "parts" / "torque.py").write_text("factor = 1.0\n")
    (project / "crosscheck.toml").write_text(f"[engines.mine]\ncommand = {command.split()}\n")
    assert call("trust", "--yes").exit_code == 0
    trusting = collect_doors(project / "models")
    trusting.check_trust(["mine"], False, lambda line: None)
    (project / "scripts" / "__pycache__").mkdir()
    (project / "scripts" / "__pycache__" / "mine.pyc").write_text("compiled")
    (project / "scripts" / "history.sqlite").write_text("a night")
    collect_doors(project / "models").check_trust(["mine"], False, lambda line: None)
    (project / "scripts" / "parts" / "torque.py").write_text("factor = 2.0\n")
    (project / "scripts" / "new.py").write_text("")
    words = r"mine, which has changed \(scripts/new.py is new, scripts/parts/torque.py has changed\): it runs"
    with pytest.raises(InputError, match=words):
        collect_doors(project / "models").check_trust(["mine"], False, lambda line: None)
    collect_doors(project / "models").check_trust(["mine"], True, lambda line: None)  # in CI


def test_a_program_beside_the_settings_is_trusted_with_its_folder_but_not_with_models(project: Path) -> None:
    (project / "crosscheck.toml").write_text(PROGRAM)
    assert "with 1 files of this project: rigid.py" in call("trust", "--yes").output
    (project / "models" / "double_pendulum" / "cases.toml").write_text("")
    collect_doors(project / "models").check_trust(["mine"], False, lambda line: None)


def test_a_program_among_too_many_files_has_to_have_its_own_folder(
    project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("crosscheck.doors.program_files.MOST_FILES", 1)
    (project / "crosscheck.toml").write_text(PROGRAM)
    (project / "other.py").write_text("")
    with pytest.raises(InputError, match="move the program into a folder of its own"):
        collect_doors(project / "models")


def test_trust_is_asked_for_and_remembered_beside_others(project: Path) -> None:
    (project / "crosscheck.toml").write_text(PROGRAM)
    assert CliRunner().invoke(main, ["trust"], input="n\n").exit_code == 2
    assert not trust.find_store().exists()
    trust.write_trusted_parts(project / "other.toml", {"x": {"": "1"}})
    assert CliRunner().invoke(main, ["trust"], input="y\n").exit_code == 0
    assert set(trust.read_store()) == {str(project / "other.toml"), str(project / "crosscheck.toml")}
    trust.find_store().write_text("[")
    assert trust.read_store() == {}


def test_there_may_be_nothing_to_trust(project: Path) -> None:
    assert "there is no crosscheck.toml" in call("trust").output
    (project / "crosscheck.toml").write_text("")
    assert "names no engines" in call("trust").output


# --- columns of the report ------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_program_is_a_full_column(project: Path) -> None:
    """Judged by its own limit, certified, in JUnit and in pytest; its mistake is named and repaired."""
    (project / "crosscheck.toml").write_text(PROGRAM)
    results = run("--engines", "flexinv,mine", "--trust-commands", code=0)
    judged = {c.quantity: c for c in results.comparisons if c.engine == "mine"}
    assert judged["torque"].verdict == "within"
    assert judged["torque"].error_bar is not None
    assert all(c.holds for c in results.certificates if c.engine == "mine")
    assert {"total mass", "gravity torque"} <= {c.what for c in results.certificates if c.engine == "mine"}
    assert "mine" in Path("reports/latest/junit.xml").read_text()
    assert "mine" in Path("reports/latest/index.html").read_text()
    text = (project / "rigid.py").read_text()
    (project / "rigid.py").write_text(
        text.replace('joint["damping"] * v[k]', '(joint["damping"] + 0.05 * (k == 1)) * v[k]')
    )
    results = run("--engines", "flexinv,mine", "--trust-commands", code=1)
    (result,) = [d for d in results.diagnoses if d.engine == "mine"]
    assert result.named[0]["cause"] == "viscous damping"
    assert result.repaired is not None
    assert result.repaired < 1e-9


def test_a_program_of_the_user_is_exported_with_what_runs_it(project: Path) -> None:
    """The folder names no script that is not there; the command that is printed gives an answer."""
    (project / "crosscheck.toml").write_text(PROGRAM)
    done = call("export", "double_pendulum", "--engine", "mine", "--out", "exported")
    assert done.exit_code == 0, done.output
    assert {f.name for f in Path("exported").iterdir()} == {"kit", "out", "expected.csv", "run.txt", "README.md"}
    page = Path("exported/README.md").read_text()
    assert "run.py" not in page + done.output
    assert "Needs" not in page
    assert f"\n    {shlex.join([sys.executable, 'rigid.py', 'kit', 'out'])}\n" in page
    head, command = done.output.splitlines()
    assert head == "exported: its program answers the kit there by"
    subprocess.run(command, shell=True, check=True, cwd="/")
    answer, expected = (Path("exported", name).read_text().splitlines() for name in ("out/series.csv", "expected.csv"))
    assert len(answer) == len(expected)


def test_records_and_fmus_are_not_exported(project: Path) -> None:
    (project / "models" / "double_pendulum" / "records" / "adams").mkdir(parents=True)
    assert collect_doors(project / "models").engines["adams"].exports is False
    done = call("export", "double_pendulum", "--engine", "adams")
    assert (done.exit_code, "there is no export for adams" in done.output) == (2, True)


@pytest.mark.slow
def test_a_record_is_judged_and_diagnosed_from_its_csv_alone(project: Path) -> None:
    """A colleague's answer with a wrong inertia: named, and repaired in the reference: the program is not here."""
    assert call("kit", "double_pendulum", "--out", "kit", "--blind").exit_code == 0
    case = json.loads(Path("kit/case.json").read_text())
    inertia = case["mechanism"]["links"][1]["bodies"][0]["inertia"]
    inertia[1][1] *= 1.4
    Path("kit/case.json").write_text(json.dumps(case))
    out = project / "models" / "double_pendulum" / "records" / "simscape" / "swing"
    out.parent.mkdir(parents=True)
    assert os.spawnl(os.P_WAIT, sys.executable, sys.executable, "rigid.py", "kit", str(out)) == 0
    (out / "certificate.json").unlink()
    results = run("--engines", "flexinv,simscape", code=1)
    (row,) = [c for c in results.comparisons if c.engine == "simscape" and c.quantity == "torque"]
    assert row.verdict == "deviation"  # the limits of the example are for all engines
    (result,) = [d for d in results.diagnoses if d.engine == "simscape"]
    assert result.where == "put into the reference"
    assert result.repaired is not None
    assert result.repaired < 1e-9
    assert any("inertia" in str(one["cause"]) for one in result.named)
    before = compute_answer_digest(collect_doors(project / "models").engines["simscape"], out.parents[2])
    (out / "meta.json").write_text("{}")
    assert compute_answer_digest(collect_doors(project / "models").engines["simscape"], out.parents[2]) != before


def test_records_are_found_by_case_and_by_what_they_say(project: Path) -> None:
    folder = project / "models" / "double_pendulum"
    (folder / "records" / "adams").mkdir(parents=True)
    job = (collect_doors(project / "models").engines["adams"].door, "adams", str(folder))
    from crosscheck.verdicts.plan import discover

    task = discover(project / "models").tasks[0]
    asked = lambda: open_adapter(*job).unsupported(task.mechanism, task.case, "adams")  # noqa: E731
    assert asked() == "nobody recorded this case"
    (folder / "records" / "adams" / "meta.json").write_text('{"name": "lift"}')
    assert asked() == "nobody recorded this case"
    (folder / "records" / "adams" / "meta.json").write_text('{"name": "swing"}')
    assert asked() is None
    (folder / "records" / "adams" / "swing").symlink_to(project)
    with pytest.raises(InputError, match="leads out of its folder"):
        asked()
    (folder / "records" / "a b").mkdir()
    with pytest.raises(InputError, match="an engine called 'a b'"):
        collect_doors(project / "models")


@pytest.mark.slow
def test_an_object_is_an_engine_without_installation(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (project / "my_engine.py").write_text(
        "from rogue_engines import *\n"
        "class Mine:\n"
        "    version = staticmethod(lambda: '3.1')\n"
        "    abilities = staticmethod(lambda: 'swings')\n"
        "    unsupported = staticmethod(lambda mechanism, case, engine: None)\n"
        "    run = staticmethod(lambda mechanism, case, engine, options: pinocchio(mechanism, case, engine, options))\n"
    )
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(project), str(SHARED)]))
    monkeypatch.syspath_prepend(str(project))
    results = run("--engines", "flexinv,Mine", "--engine", "my_engine:Mine", code=0)
    assert {r.version for r in results.runs if r.engine == "Mine"} == {"3.1"}
    assert {e.abilities for e in results.engines if e.name == "Mine"} == {"swings"}
    assert call("run", "--engine", "my engine").exit_code == 2
    assert "which is taken" in call("run", "--engine", "mujoco=my_engine:Mine").output


# --- installed packages ---------------------------------------------------------------------------------------------


class Points:
    """Entry points of a package that is installed for a while: a folder of metadata on the path, as pip writes it."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch, text: str) -> None:
        info = folder / "guest-1.0.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: guest\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(text)
        monkeypatch.syspath_prepend(str(folder))


def test_an_installed_package_brings_engines_and_causes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Points(
        tmp_path,
        monkeypatch,
        "[crosscheck.engines]\nguest = rogue_engines\n[crosscheck.causes]\nguest = guest_causes:ROWS\nbad = guest_causes:BAD\n",
    )
    (tmp_path / "guest_causes.py").write_text(
        "from dataclasses import replace\n"
        "from crosscheck.causes.dictionary import DICTIONARY\n"
        "ROWS = [replace(DICTIONARY['viscous damping'], name='a guest of a cause')]\nBAD = [3]\n"
    )
    installed_engines = packages.list_installed_engines()
    assert installed_engines["guest"].module == "rogue_engines"
    assert adapter(installed_engines["guest"]).version() == "0.rogue"
    with pytest.warns(UserWarning, match="package guest: no causes at guest_causes:BAD"):
        known = collect_causes()
    assert set(known) - set(DICTIONARY) == {"a guest of a cause"}


def test_a_package_takes_no_name_of_ours(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Points(tmp_path, monkeypatch, "[crosscheck.engines]\nmujoco = rogue_engines\n")
    with pytest.raises(InputError, match="package guest: an engine is called 'mujoco', which is taken"):
        packages.list_installed_engines()


def test_our_engines_come_through_the_same_door(root: Path) -> None:
    import tomllib

    stated = tomllib.loads((root / "pyproject.toml").read_text())["project"]["entry-points"][packages.ENGINE_GROUP]
    assert stated == {name: engine.module for name, engine in ENGINES.items()}
    assert all(point.dist is not None for point in metadata.entry_points(group=packages.ENGINE_GROUP))


@pytest.mark.parametrize("name", ENGINES)
def test_our_adapters_name_what_they_offer(name: str) -> None:
    engine = ENGINES[name]
    if (reason := describe_missing_package(engine)) is not None:
        pytest.skip(reason)
    one = adapter(engine)
    assert (offered(one, "export") is not None) == engine.exports
    assert all(callable(member) for member in (offered(one, m) for m in MEMBERS) if member is not None)


def test_without_doors_nothing_changes(root: Path) -> None:
    known = collect_doors(root / "models")
    assert isinstance(known, ProjectEngines)
    assert dict(known.engines) == {**ENGINES, **packages.list_installed_engines()}
    assert compute_answer_digest(ENGINES["pinocchio"], root / "models" / "ur5") == ""
