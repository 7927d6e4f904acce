"""The corpus of a small folder: written, the same bytes twice, judged from its files alone, never over files of others."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from crosscheck.cli import main
from crosscheck.corpus.audit import AuditRow, collect_by_class, is_target_met
from crosscheck.corpus.folder import MANIFEST, compute_digest
from crosscheck.corpus.judging import judge_answers, read_manifest
from crosscheck.measures.series_csv import read, write_table
from crosscheck.verdicts.plan import discover
from flexinv.errors import InputError

pytestmark = pytest.mark.slow  # what they share is computed once, and takes seconds

PROGRAMS = Path(__file__).parents[2] / "shared" / "kit_programs"
ALONE = "import sys, runpy; sys.modules['flexinv'] = sys.modules['crosscheck'] = None; sys.argv = sys.argv[1:]; "
ALONE += "runpy.run_path(sys.argv[0], run_name='__main__')"
NAMES = {"double_pendulum-swing", "rigid_one_link-cycloid"}
NOTES = """licence = "BSD-3-Clause"
licence_files = ["licences/text.txt"]

[mechanisms.rigid_one_link]
licence = "<b>secret</b>"
redistribute = false
recipe = "Ask <nobody>"

[engines.formula]
author = "textbook"
closed_form = true

[[published]]
mechanism = "rigid_one_link"
case = "cycloid"
series = "torque/hub"
at_s = 0.0
value = 0.0
unit = "N m"
source = "it begins at rest"
"""


def corpus(*words: str) -> Result:
    return CliRunner().invoke(main, ["corpus", *words])


@pytest.fixture(scope="module")
def models(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two mechanisms: one has a formula for its torque as a record, I qdd, and may not be passed on."""
    folder = tmp_path_factory.mktemp("small") / "models"
    for name in ("double_pendulum", "rigid_one_link"):
        shutil.copytree(root / "models" / name, folder / name)
    (folder / "licences").mkdir()
    (folder / "licences" / "text.txt").write_text("Do what you like.\n")
    (folder / "corpus.toml").write_text(NOTES)
    task = discover(folder, ["rigid_one_link/cycloid"]).tasks[0]
    (body,) = task.mechanism.links[0].bodies
    about_hub = body.inertia.tensor[2, 2] + body.inertia.mass * float(body.inertia.com @ body.inertia.com)
    qdd = task.case.motion.evaluate(task.mechanism, task.time)[2]
    record = folder / "rigid_one_link" / "records" / "formula" / "cycloid"
    record.mkdir(parents=True)
    write_table(record / "series.csv", ["time [s]", "torque/hub [N m]"], np.column_stack([task.time, about_hub * qdd]))
    return folder


@pytest.fixture(scope="module")
def written(models: Path) -> Path:
    """The corpus of one case of each, by two engines and the formula."""
    out = models.parent / "corpus"
    cases = ("double_pendulum/swing", "rigid_one_link/cycloid")
    words = ("--models", str(models), "--engines", "flexinv,pinocchio,formula", "--out", str(out), "--jobs", "1")
    done = corpus(*cases, *words)
    assert done.exit_code == 0, done.output
    assert "2 of 2 cases have a consensus in every torque" in " ".join(done.output.split())
    return out


def test_every_case_has_a_kit_a_page_and_a_line_of_the_manifest(written: Path) -> None:
    manifest = json.loads((written / "manifest.json").read_text())
    assert {one["id"]: one["status"] for one in manifest["cases"]} == {
        "double_pendulum-swing": "consensus",
        "rigid_one_link-cycloid": "closed form",
    }
    for one in manifest["cases"]:
        assert (written / "cases" / f"{one['id']}.html").is_file()
        files = {f.relative_to(written).as_posix() for f in (written / "kits" / one["id"]).rglob("*") if f.is_file()}
        assert files == set(one["files"])
        assert all(compute_digest(written / name) == stated for name, stated in one["files"].items())
    time, series = read(written / "kits" / "double_pendulum-swing" / "expected" / "series.csv")
    assert time.size == 121
    assert all(one.error is not None and (one.error >= 0.0).all() for one in series.values())


def test_what_may_not_be_passed_on_is_a_recipe(written: Path) -> None:
    kit = written / "kits" / "rigid_one_link-cycloid"
    assert not any((kit / name).exists() for name in ("case.json", "motion.csv", "robot.urdf", "tree.csv"))
    recipe = (kit / "RECIPE.md").read_text()
    assert "Ask <nobody>" in recipe
    (one,) = (x for x in json.loads((written / "manifest.json").read_text())["cases"] if x["id"] == kit.name)
    assert f'"digest": "{one["case.json"]}"' in recipe
    assert one["redistribute"] is False
    assert one["recipe"] == ["Ask <nobody>", "crosscheck kit rigid_one_link --case cycloid --blind --out kit"]
    assert all(step in recipe for step in one["recipe"])
    assert "Do what you like" in (written / "kits" / "double_pendulum-swing" / "text.txt").read_text()


def test_pages_escape_and_ask_nobody(written: Path) -> None:
    pages = [f.read_text() for f in written.rglob("*.html")]
    assert len(pages) == 3
    assert all("http" not in page for page in pages)
    assert not any("<b>secret</b>" in page for page in pages)
    assert any("&lt;b&gt;secret" in page for page in pages)
    assert any("it begins at rest" in page for page in pages)


def answers(written: Path, folder: Path) -> Path:
    """A program that has never heard of this project answers the one kit that is there."""
    kit, out = written / "kits" / "double_pendulum-swing", folder / "double_pendulum-swing"
    folder.mkdir()
    blind = folder.parent / "blind"
    shutil.copytree(kit, blind, ignore=shutil.ignore_patterns("expected", "consensus.json"))
    words = [sys.executable, "-c", ALONE, str(PROGRAMS / "rigid.py"), str(blind), str(out)]
    done = subprocess.run(words, capture_output=True, text=True, cwd=blind, env={"PATH": ""}, timeout=120)
    assert done.returncode == 0, done.stderr
    return folder


def test_answers_to_the_kits_alone_are_judged_from_the_corpus_alone(
    written: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where there are no models: what is judged from is the corpus, and nothing else."""
    monkeypatch.chdir(tmp_path)
    assert "Directory 'models' does not exist" in corpus("--out", "new").output
    folder = answers(written, tmp_path / "answers")
    done = corpus("--judge", str(folder), "--against", str(written))
    assert done.exit_code == 0, done.output
    assert "lie inside the consensus, in 1 cases" in done.output
    file = folder / "double_pendulum-swing" / "series.csv"
    lines = file.read_text().splitlines()
    column = lines[0].split(",").index("torque/knee [N m]")
    cells = lines[60].split(",")
    lines[60] = ",".join([*cells[:column], repr(float(cells[column]) * (1.0 + 1e-6)), *cells[column + 1 :]])
    file.write_text("\n".join(lines) + "\n")
    done = corpus("--judge", str(folder), "--against", str(written))
    assert done.exit_code == 1
    assert "outside  double_pendulum-swing torque/knee, 0.826 % of the samples" in done.output  # 1 of 121


def test_answers_that_cannot_be_judged_are_explained(
    written: Path, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    with pytest.raises(InputError, match="holds no answer"):
        judge_answers(tmp_path, written)
    (tmp_path / "double_pendulum-swin").mkdir()
    with pytest.raises(InputError, match="write 'double_pendulum-swing'"):
        judge_answers(tmp_path, written)
    (tmp_path / "double_pendulum-swin").rename(tmp_path / "double_pendulum-swing")
    with pytest.raises(InputError, match="nothing was answered"):
        judge_answers(tmp_path, written)
    (tmp_path / "double_pendulum-swing" / "meta.json").write_text('{"case": "0123456789abcdef"}')
    with pytest.raises(InputError, match="an answer for the case 0123456789abcdef"):
        judge_answers(tmp_path, written)
    assert corpus("--judge", str(tmp_path), "--against", str(tmp_path)).exit_code == 2
    (tmp_path / "double_pendulum-swing" / "meta.json").write_text('{"skipped": "too hard"}')
    assert corpus("--judge", str(tmp_path), "--against", str(written)).exit_code == 2  # skipped is not passed
    changed = tmp_path_factory.mktemp("corpus") / "changed"
    shutil.copytree(written, changed)
    with (changed / "kits" / "double_pendulum-swing" / "consensus.json").open("a") as file:
        file.write("\n")
    with pytest.raises(InputError, match="changed or lost"):
        judge_answers(tmp_path, changed)


def test_a_folder_of_others_is_left_alone(models: Path, tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    done = corpus("rigid_one_link", "--models", str(models), "--out", str(tmp_path))
    assert done.exit_code == 2
    assert "thesis.txt, which crosscheck did not write" in " ".join(done.output.split())
    assert (tmp_path / "thesis.txt").read_text() == "mine"


def test_the_same_input_gives_the_same_bytes_and_the_audit_holds(models: Path, written: Path, tmp_path: Path) -> None:
    cases = ("double_pendulum/swing", "rigid_one_link/cycloid")
    words = ("--models", str(models), "--engines", "flexinv,pinocchio,formula", "--out", str(tmp_path), "--jobs", "1")
    done = corpus(*cases, *words, "--audit")
    assert done.exit_code == 0, done.output
    first, again = (
        {f.relative_to(x): f.read_bytes() for f in x.rglob("*") if f.is_file()} for x in (written, tmp_path)
    )
    apart = {Path(name) for name in ("machine.json", "audit.json", "index.html", ".crosscheck")}
    assert {n: b for n, b in first.items() if n not in apart} == {n: b for n, b in again.items() if n not in apart}
    audit = json.loads((tmp_path / "audit.json").read_text())
    assert [one["kind"] for one in audit["classes"]] == ["rigid"]
    assert audit["classes"][0]["share"] >= audit["target"]


def test_an_audit_misses_its_target_by_class() -> None:
    rows = [AuditRow("rigid", "a", "x", 1, 100, 100, "w", 1.0), AuditRow("beams", "b", "x", 1, 100, 94, "w", 0.94)]
    assert [one.share for one in collect_by_class(rows)] == [1.0, 0.94]
    assert not is_target_met(rows)
    assert is_target_met(rows[:1])
    assert not is_target_met([])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (None, "there is no such file, expected the manifest of a corpus"),
        ("{", "is no manifest of a corpus"),
        ("[]", "is no manifest of a corpus"),
        ('{"format": "corpus/99", "cases": []}', "has format 'corpus/99', expected"),
    ],
)
def test_what_is_no_manifest_is_refused_in_words(text: str | None, expected: str, tmp_path: Path) -> None:
    if text is not None:
        (tmp_path / MANIFEST).write_text(text)
    with pytest.raises(InputError) as refused:
        read_manifest(tmp_path)
    said = str(refused.value)
    assert said.startswith(f"{tmp_path / MANIFEST}")
    assert expected in said
    assert said.count(MANIFEST) == 1  # one clear error, none wrapped into another
    assert said.endswith("write one with crosscheck corpus --out")
