"""Models that mean harm: read as data, refused in words, shown as text, in a report that stays small."""

from __future__ import annotations

from pathlib import Path

import pytest
from crosscheck_examples import write_models

from crosscheck.report.write_report import render
from crosscheck.verdicts import results as store
from crosscheck.verdicts.plan import discover, make_case_row
from crosscheck.verdicts.results import CaseRow, Results, RunRow

SCRIPT = "<script>alert(1)<"
SECRET = "the content of a file that is none of a model's business"
ENTITY = '<?xml version="1.0"?><!DOCTYPE robot [<!ENTITY x SYSTEM "file://{file}">]><robot name="r"><link name="&x;"/></robot>'


@pytest.fixture
def report(root: Path, tmp_path: Path) -> Path:
    """A report over five models, four of which mean harm; no engine is needed to read them."""
    models = tmp_path / "models"
    (tmp_path / "secret.urdf").write_text(f'<robot name="{SECRET}"><link name="a"/></robot>')
    good = write_models(models, root, SCRIPT)
    assert len(good.parts) == len(models.parts) + 1
    large = write_models(models, root, "large")
    (large / "mechanism.toml").write_text('title = "' + "x" * 10_000_000 + '"\n')
    entity = write_models(models, root, "entity")
    (entity / "robot.urdf").write_text(ENTITY.format(file=tmp_path / "secret.urdf"))
    (entity / "mechanism.toml").write_text('source = "x"\n[urdf]\npath = "robot.urdf"\n')
    climbing = write_models(models, root, "climbing")
    (climbing / "mechanism.toml").write_text('source = "x"\n[urdf]\npath = "../../secret.urdf"\n')
    code = write_models(models, root, "code")
    (code / "mechanism.toml").write_text("title = __import__('os').system('touch harmed')\n")
    plan = discover(models)
    rows = [CaseRow(name, "", problem=message) for name, message in plan.broken]
    cases = (*rows, *map(make_case_row, plan.tasks))
    runs = tuple(RunRow(t.folder.name, t.case.name, SCRIPT, "error", message=f"{SCRIPT}/script>") for t in plan.tasks)
    out = tmp_path / "report"
    out.mkdir()
    results = Results("2026-03-01T01:00:00+00:00", finished=True, cases=cases, runs=runs)
    store.write(results, out / "results.json")
    render(results, out)
    return out


def test_harmful_models_are_rows_with_words(report: Path) -> None:
    problems = {c.mechanism: c.problem for c in store.read(report / "results.json").cases if c.problem}
    assert set(problems) == {"large", "entity", "climbing", "code"}
    assert "more than 1048576 bytes" in problems["large"]
    assert "DOCTYPE or ENTITY" in problems["entity"]
    assert "stays inside the models folder" in problems["climbing"]
    assert "expected: TOML" in problems["code"]
    assert not list(report.parent.rglob("harmed"))
    assert not Path("harmed").exists()


def test_the_report_shows_them_as_text_and_stays_small(report: Path) -> None:
    texts = {
        f: f.read_text(encoding="utf-8") for f in report.rglob("*") if f.suffix in (".html", ".md", ".xml", ".json")
    }
    for file, text in texts.items():
        assert SECRET not in text, file
        assert len(text) < 100_000, file
        if file.suffix in (".html", ".xml"):
            assert "<script>alert" not in text, file
    assert "&lt;script&gt;alert(1)&lt;" in texts[report / "index.html"]
    assert all(report in f.resolve().parents for f in report.rglob("*"))  # no name leads out of the folder
