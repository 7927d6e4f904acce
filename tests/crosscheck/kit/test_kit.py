"""A case kit is enough: programs that have never heard of this project answer it; its files are deterministic and described."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pydantic
import pytest
from click.testing import CliRunner
from packaging.version import Version

from crosscheck.cli import main
from crosscheck.engines import ENGINES, adapter
from crosscheck.kit import schemas
from crosscheck.kit.answer import read_answer
from crosscheck.kit.resolved import build_case_file
from crosscheck.kit.tables import CaseFile, CertificateFile, MetaFile
from crosscheck.kit.write import write
from crosscheck.measures.certificate import build_certificate, checks
from crosscheck.measures.record import Record
from crosscheck.measures.series_csv import read
from crosscheck.verdicts.plan import Task, discover
from flexinv.errors import InputError
from flexinv.files.load_cases import load_cases
from flexinv.files.load_mechanism import load_mechanism

PROGRAMS = Path(__file__).parents[2] / "shared" / "kit_programs"
ALONE = "import sys, runpy; sys.modules['flexinv'] = sys.modules['crosscheck'] = None; sys.argv = sys.argv[1:]; "
ALONE += "runpy.run_path(sys.argv[0], run_name='__main__')"


def kit(root: Path, out: Path, name: str, case: str, *more: str) -> Path:
    """A kit, by the command."""
    words = ["kit", name, "--case", case, "--models", str(root / "models"), "--out", str(out / "kit"), *more]
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 0, done.output
    return out / "kit"


def one(root: Path, name: str, case: str) -> Task:
    return discover(root / "models", [f"{name}/{case}"]).tasks[0]


def ask(program: str, kit: Path, out: Path) -> None:
    """A program answers a kit in a process in which this project cannot be imported."""
    words = [sys.executable, "-c", ALONE, str(PROGRAMS / program), str(kit), str(out)]
    done = subprocess.run(words, capture_output=True, text=True, cwd=kit, env={"PATH": ""}, timeout=120)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "case", "program", "enough"),
    [
        # closed formulas on both sides, a few links: rounding
        ("double_pendulum", "swing", "rigid.py", 1e-13),
        ("four_bar", "turn", "rigid.py", 1e-13),
        # a chain of 12 rods against a beam: its error falls with the square of their length, and its bar is stated
        pytest.param("flex_one_link", "cycloid", "beam.py", 1e-2, marks=pytest.mark.slow),
    ],
)
def test_a_kit_is_enough_for_numpy_alone(
    root: Path, tmp_path: Path, name: str, case: str, program: str, enough: float
) -> None:
    folder, task = kit(root, tmp_path, name, case), one(root, name, case)
    ask(program, folder, tmp_path / "out")
    answer = read_answer(tmp_path / "out", task.mechanism, task.case, "numpy")
    ours = read(folder / "expected" / "series.csv")[1]
    torques = [n for n in ours if n.startswith("torque/")]
    size = max(float(np.ptp(ours[n].values)) for n in torques)
    for n in torques:
        error = float(np.abs(answer.series[n].values - ours[n].values).max())
        bar = answer.series[n].error
        assert error <= enough * size
        assert bar is None or error <= float(bar.max())
    said = json.loads((folder / "expected" / "certificate.json").read_text())
    assert all(
        line.holds for line in checks("", "", "", build_certificate(answer.certificate), build_certificate(said))
    )
    assert bool(answer.certificate) == (program == "rigid.py")


def test_the_sign_of_an_axial_force_is_the_one_that_the_kit_states(root: Path) -> None:
    """A beam that spins fast is pulled outward: its joint pulls it inward, against x."""
    task = one(root, "flex_one_link", "cycloid")
    (asked,) = [one for one in build_case_file(task.mechanism, task.case).case.asked if one.quantity == "axial"]
    assert asked.meaning.endswith("below 0 where the beam is pulled outward")
    record = adapter(ENGINES["flexinv"]).run(task.mechanism, task.case, "flexinv", {"error": False})
    fastest = int(np.argmin(np.abs(record.time - 0.1)))
    assert record.series["axial/link"].values[fastest] < -4.0  # rho A omega^2 L^2 / 2 of the rigid turn is 4.4 N


@pytest.mark.slow
def test_the_same_case_gives_the_same_files_and_a_blind_kit_no_values(root: Path, tmp_path: Path) -> None:
    first = kit(root, tmp_path / "1", "double_pendulum", "swing")
    again = kit(root, tmp_path / "2", "double_pendulum", "swing")
    blind = kit(root, tmp_path / "3", "double_pendulum", "swing", "--blind")
    files = {f.relative_to(first): f.read_bytes() for f in first.rglob("*") if f.is_file()}
    assert files == {f.relative_to(again): f.read_bytes() for f in again.rglob("*") if f.is_file()}
    assert {f.parts[0] for f in files} >= {
        "case.json",
        "motion.csv",
        "probe.csv",
        "probe_rates.csv",
        "tree.csv",
        "robot.urdf",
        "README.md",
    }
    left = {f.relative_to(blind) for f in blind.rglob("*") if f.is_file()}
    assert left == {f for f in files if f.parts[0] != "expected"}
    assert all((blind / f).read_bytes() == files[f] for f in left if f.name != "README.md")


def test_every_case_of_every_mechanism_has_a_kit(root: Path) -> None:
    for folder in sorted(f.parent for f in (root / "models").glob("*/mechanism.toml")):
        mechanism = load_mechanism(folder)
        for case in load_cases(folder, mechanism).values():
            file = build_case_file(mechanism, case)
            assert CaseFile.model_validate_json(file.model_dump_json()) == file
            assert sum(len(j.q) for j in file.mechanism.joints) == mechanism.nq == len(file.case.coordinates)
            assert build_case_file(mechanism, case, 2).digest != file.digest


def test_a_mechanism_says_the_same_in_its_kit(root: Path) -> None:
    data = build_case_file(*_pair(root, "ur5_flexible_forearm")).mechanism
    mechanism = load_mechanism(root / "models" / "ur5_flexible_forearm")
    for link, said in zip(mechanism.links, data.links, strict=True):
        assert [b.mass for b in said.bodies] == [b.inertia.mass for b in link.bodies]
        assert (said.beam is None) == (link.beam is None)
        if link.beam is not None and said.beam is not None:
            assert said.beam.section.EI_z == link.beam.section.stiffness[:, 5].tolist()
    for joint, told in zip(mechanism.joints, data.joints, strict=True):
        assert told.frame.rotation == joint.placement.rotation.tolist()


def _pair(root: Path, name: str) -> tuple[Any, Any]:
    mechanism = load_mechanism(root / "models" / name)
    return mechanism, next(iter(load_cases(root / "models" / name, mechanism).values()))


@pytest.mark.skipif(
    Version(pydantic.VERSION) < Version("2.12"), reason="an older pydantic writes the same schemas in other words"
)
@pytest.mark.parametrize("name", schemas.NAMES)
def test_the_shipped_schemas_are_those_of_the_tables(name: str) -> None:
    assert schemas.read_schema(name) == schemas.write_schema(name)  # else: crosscheck/kit/schema/ is to be written anew
    done = CliRunner().invoke(main, ["schema", name])
    assert (done.exit_code, done.output) == (0, schemas.write_schema(name))


def test_schemas_are_written_and_know_the_keys(tmp_path: Path) -> None:
    assert CliRunner().invoke(main, ["schema", "--out", str(tmp_path / "s")]).exit_code == 0
    assert {f.name for f in (tmp_path / "s").iterdir()} == {f"{n}.schema.json" for n in schemas.NAMES}
    assert CliRunner().invoke(main, ["schema"]).exit_code == 2
    whole = json.loads((tmp_path / "s" / "mechanism.schema.json").read_text())["$defs"]
    assert {"RevoluteTable", "BeamLinkTable", "TubeTable", "UniversalClosureTable", "DriveTable"} <= set(whole)
    assert whole["RotaryDrive"]["properties"]["drive"]["anyOf"]
    cases = json.loads((tmp_path / "s" / "cases.schema.json").read_text())["$defs"]
    assert {"CaseTable", "AngleTable", "PoseStartTable", "LimitTable"} <= set(cases)


SERIES = "time [s],torque/pivot [N m],torque/knee [N m]"
WRONG = {
    "holds no series.csv": {},
    "'torque/knee [N m]' is missing": {"series.csv": (SERIES.rpartition(",")[0], 2)},
    "is there twice": {"series.csv": (SERIES + ",torque/knee [N m]", 4)},
    "'torque/knee' is in N, expected N m": {"series.csv": (SERIES[:-1].replace("knee [N m", "knee [N") + "]", 3)},
    "the mechanism has no such series; write 'torque/knee'": {"series.csv": (SERIES.replace("knee", "kneee"), 3)},
    "an answer for mechanism 'ur5'": {"meta.json": '{"mechanism": "ur5"}'},
    "an answer for case 'lift'": {"meta.json": '{"name": "lift"}'},
    "an answer for the case 0123": {"meta.json": '{"case": "0123"}'},
    "cannot be read": {"meta.json": "[" * 100_000},
    "wall_time: Input should be a finite number": {"meta.json": '{"wall_time": NaN}'},
    "the whole: Input should be": {"meta.json": "3"},
    "Extra inputs are not permitted": {"meta.json": '{"toool": "x"}'},
}


@pytest.mark.parametrize("complaint", WRONG)
def test_a_wrong_answer_is_refused_in_words(root: Path, tmp_path: Path, complaint: str) -> None:
    task = one(root, "double_pendulum", "swing")
    for name, content in WRONG[complaint].items():
        if isinstance(content, tuple):
            header, count = content
            rows = [",".join([repr(float(t)), *["0.0"] * (count - 1)]) for t in task.time]
            content = "\n".join([header, *rows])
        (tmp_path / name).write_text(content)
    with pytest.raises(InputError) as caught:
        read_answer(tmp_path, task.mechanism, task.case, "they")
    assert complaint in str(caught.value)


def _answer(task: Task, folder: Path, change: Any = None) -> Path:
    folder.mkdir(exist_ok=True)
    rows = [[float(t), 0.0, 0.0] for t in task.time]
    if change:
        rows = change(rows)
    text = "\n".join([SERIES, *(",".join(map(repr, row)) for row in rows)])
    (folder / "series.csv").write_text(text + "\n")
    return folder


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (lambda rows: rows[:-1], "has 120 times, not the 121 of the case"),
        (lambda rows: [[t * 1.001, *r] for t, *r in rows], "row 4: 0.02002 s, where the case has 0.02 s"),
        (
            lambda rows: [[t, float("nan"), x] for t, _, x in rows],
            "'torque/pivot': 121 of 121 values are no finite numbers",
        ),
        (lambda rows: [*rows[:5], rows[5][:2], *rows[6:]], "row 7 has 2 cells, the header 3"),
        (lambda rows: [], "has 0 times"),
    ],
)
def test_wrong_rows_are_refused_in_words(root: Path, tmp_path: Path, change: Any, complaint: str) -> None:
    task = one(root, "double_pendulum", "swing")
    with pytest.raises(InputError) as caught:
        read_answer(_answer(task, tmp_path / "out", change), task.mechanism, task.case, "they")
    assert complaint in str(caught.value)


def test_an_answer_is_not_followed_out_of_its_folder(root: Path, tmp_path: Path) -> None:
    task = one(root, "double_pendulum", "swing")
    real = _answer(task, tmp_path / "elsewhere")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "series.csv").symlink_to(real / "series.csv")
    with pytest.raises(InputError, match="leads out of its folder"):
        read_answer(tmp_path / "out", task.mechanism, task.case, "they")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ('{"mass": "heavy"}', "mass: Input should be a valid number"),
        ('{"gravity": [[1.0]]}', "gravity: expected 2 numbers in each row"),
        ('{"mass_matrix": [[[1.0, 2.0], [3.0]]]}', "mass_matrix: expected 2 rows of 2 numbers"),
        ('{"mass": 1' + " " * 21_000_000 + "}", "has 21 MB, expected at most 20 MB"),
        ('{"mass": 1.5}', ""),
    ],
)
def test_a_certificate_that_cannot_be_read_is_a_problem_in_words(
    root: Path, tmp_path: Path, text: str, problem: str
) -> None:
    task = one(root, "double_pendulum", "swing")
    (_answer(task, tmp_path / "out") / "certificate.json").write_text(text)
    record = read_answer(tmp_path / "out", task.mechanism, task.case, "they")
    assert record.status == "ok"
    if problem:
        assert problem in record.certificate["broken"]
    else:
        assert record.certificate == {"mass": 1.5}


def test_a_program_may_say_that_it_cannot(root: Path, tmp_path: Path) -> None:
    task = one(root, "double_pendulum", "swing")
    (tmp_path / "meta.json").write_text('{"skipped": "no pendulums", "tool": "they"}')
    record = read_answer(tmp_path, task.mechanism, task.case, "they")
    assert (record.status, record.message) == ("skipped", "no pendulums")


def test_the_kit_command_refuses_a_folder_that_is_not_empty(root: Path, tmp_path: Path) -> None:
    (tmp_path / "kit").mkdir()
    (tmp_path / "kit" / "mine.txt").write_text("mine")
    words = [
        "kit",
        "double_pendulum",
        "--case",
        "swing",
        "--models",
        str(root / "models"),
        "--out",
        str(tmp_path / "kit"),
    ]
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 2
    assert "is there already" in done.output


def test_tables_of_an_answer_have_a_word_on_every_key() -> None:
    for table in (CertificateFile, MetaFile):
        assert all(field.description for field in table.model_fields.values())


def test_a_kit_can_be_written_without_the_command(root: Path, tmp_path: Path) -> None:
    task = one(root, "double_pendulum", "swing")
    record = Record("flexinv", time=task.time, series={}, certificate={"problem": "not asked"})
    write(task.mechanism, task.case, tmp_path / "kit", record)
    assert not (tmp_path / "kit" / "expected" / "certificate.json").exists()
