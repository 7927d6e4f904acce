"""Answers of strangers, each wrong in one way, by program and by record: a row in words, nothing lost, the right exit code."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
import rogue_engines
from click.testing import CliRunner
from crosscheck_examples import write_models

from crosscheck.cli import main
from crosscheck.verdicts.results import Results, read

PROGRAMS = Path(rogue_engines.__file__).parent / "kit_programs"
LIMIT = 120  # [s]: none waits for it
FAILED = 2  # exit code: an engine has no answer
# What stands in the row of a program, by its mistake: no series of it is compared.
REFUSED = {
    "units": "column 'torque/pivot' is in Nmm, expected N m",
    "missing": "column 'torque/pivot [N m]' is missing",
    "doubled": "column 'torque/pivot' is there twice",
    "times": "column time [s], row 3: 0.0075 s, where the case has 0.005 s",
    "names": "column 'torque/robot_pivot': the mechanism has no such series; write 'torque/pivot'",
    "nan": "column 'torque/pivot': 1 of 151 values are no finite numbers, the first at t = 0.75 s (nan)",
    "infinite": "column 'torque/pivot': 1 of 151 values are no finite numbers, the first at t = 0.75 s (-inf)",
    "words": "row 152, column 'torque/pivot [N m]': 'n/a' is no number",
    "semicolons": "write commas between the columns",
    "nothing": "there is no header, expected 'time [s]'",
    "other-case": "an answer for mechanism 'crane', expected 'double_pendulum'",
    "other-digest": "an answer for the case 0123456789abcdef, which is not this one",
    "huge-json": "meta.json has 100 MB, expected at most 20 MB",
    "deep-json": "meta.json cannot be read: maximum recursion depth exceeded",
    "climbing": "series.csv leads out of its folder; expected a file",
}
# What stands in a line of the certificate, and whether the comparison fails by it: torques are right in all of these.
CERTIFIED = {
    "other-order": ("order of the joints", "of shoulder, elbow, wrist; expected pivot, knee", True),
    "other-joints": ("masses by joint", "of elbow, shoulder; expected knee, pivot", True),
    "other-size": ("broken certificate", "gravity: expected 2 numbers in each row, one per velocity", True),
    "huge-certificate": ("broken certificate", "certificate.json has 100 MB, expected at most 20 MB", True),
}


@pytest.fixture
def project(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    write_models(tmp_path / "team" / "models", root)
    monkeypatch.chdir(tmp_path / "team")
    return tmp_path / "team"


def answer(project: Path) -> Path:
    """A good answer to the kit of the project's case (``kit``), which most programs and records spoil."""
    assert CliRunner().invoke(main, ["kit", "double_pendulum", "--out", "kit", "--blind"]).exit_code == 0
    subprocess.run([sys.executable, str(PROGRAMS / "rigid.py"), "kit", "answer"], check=True)
    return project / "answer"


def run(*names: str, code: int) -> Results:
    """The results of a run of flexinv and these."""
    words = ["run", "--engines", ",".join(["flexinv", *names]), "--trust-commands", "--jobs", "1"]
    done = CliRunner().invoke(main, [*words, "--timeout", str(LIMIT)])
    assert done.exit_code == code, done.output
    return read(Path("reports/latest/results.json"))


def check(results: Results, name: str, prefix: str = "") -> None:
    """One mistake stands in its row in words, and is judged as it has to be."""
    (one,) = [row for row in results.runs if row.engine == name]
    kind = name.removeprefix(prefix)
    judged = {row.quantity: row.verdict for row in results.comparisons if row.engine == name}
    if kind in REFUSED:
        assert one.status == "error"
        assert REFUSED[kind] in one.message
        if not prefix:  # of a program the folder is gone: names of files in it, and how to get the answer again
            assert tempfile.gettempdir() not in one.message
            assert f"crosscheck export double_pendulum --case swing --engine {name} makes its kit again" in one.message
        assert set(judged.values()) == {"error"}
        return
    what, words, fails = CERTIFIED[kind]
    (line,) = [row for row in results.certificates if row.engine == name and not row.holds]
    assert (one.status, line.what) == ("ok", what)
    assert prefix or tempfile.gettempdir() not in line.words
    assert words in line.words
    assert judged["torque"] == ("deviation" if fails else "within")


@pytest.mark.slow
def test_every_bad_answer_of_a_program_is_a_row(project: Path) -> None:
    sound = ["good", "printing"]  # these compute what they answer
    kinds, known = [*sound, "crashing", *REFUSED, *CERTIFIED], answer(project)
    words = [sys.executable, str(PROGRAMS / "bad.py")]
    rows = [[*words, kind, "{kit}", "{out}", *([] if kind in sound else [str(known)])] for kind in kinds]
    texts = [f"[engines.{kind}]\ncommand = {json.dumps(row)}\n" for kind, row in zip(kinds, rows, strict=True)]
    (project / "crosscheck.toml").write_text("".join(texts))
    results = run(*kinds, code=FAILED)
    assert {row.engine for row in results.runs} == {"flexinv", *kinds}
    for kind in (*REFUSED, *CERTIFIED):
        check(results, kind)
    ended = {row.engine: (row.status, row.message) for row in results.runs}
    assert ended["crashing"] == ("error", "ProgramError: the program was killed by signal 6 (SIGABRT)")
    well = {row.engine for row in results.comparisons if row.verdict == "within" and row.quantity == "torque"}
    assert {*sound} <= well
    page, junit = (Path("reports/latest", name).read_text() for name in ("index.html", "junit.xml"))
    assert all(kind in page and kind in junit for kind in kinds)


@pytest.mark.slow
def test_every_bad_answer_in_a_record_is_a_row(project: Path) -> None:
    """Every third of the same files, laid where records are: they are read by the same code."""
    known, records = answer(project), project / "models" / "double_pendulum" / "records"
    kinds = ["good", *[*REFUSED, *CERTIFIED][::3], "climbing"]
    for kind in kinds:
        (folder := records / f"old-{kind}").mkdir(parents=True)
        words = [sys.executable, str(PROGRAMS / "bad.py"), kind, "kit", str(folder / "swing"), str(known)]
        subprocess.run(words, check=True)
    names = [f"old-{kind}" for kind in kinds]
    results = run(*names, code=FAILED)
    for name in names[1:]:
        check(results, name, "old-")
    (torque,) = [row for row in results.comparisons if row.engine == "old-good" and row.quantity == "torque"]
    assert torque.verdict == "within"


def test_a_spreadsheets_file_is_read(project: Path) -> None:
    """Its first bytes are a mark, its lines end as on Windows, and blanks follow its commas."""
    out = project / "models" / "double_pendulum" / "records" / "sheet" / "swing"
    shutil.copytree(answer(project), out)
    for name in ("series.csv", "meta.json"):
        text = (out / name).read_text().replace(",", ", ").replace("\n", "\r\n")
        (out / name).write_bytes(b"\xef\xbb\xbf" + text.encode())
    results = run("sheet", code=0)
    assert [row.verdict for row in results.comparisons if row.quantity == "torque"] == ["within"]
