"""Deviations are diagnosed in a process of their own, from records on disk: cause, size, repair, what would separate."""

from __future__ import annotations

import html
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import rogue_engines as rogue
from crosscheck_examples import example_run, write_models

from crosscheck.causes.diagnosis import Answer, check_by_full_runs, diagnose, make_diagnoses
from crosscheck.causes.dictionary import DICTIONARY
from crosscheck.causes.fit import Fit
from crosscheck.causes.model import apply_to_record, make_model
from crosscheck.causes.naming import NamedCauses
from crosscheck.causes.repair import add_to_reference, apply_repair
from crosscheck.causes.subject import Subject
from crosscheck.engines import ENGINES, adapter
from crosscheck.measures.certificate import Check
from crosscheck.measures.record import save
from crosscheck.report.explanations import collect_warnings, list_certificates
from crosscheck.report.markdown import escape
from crosscheck.report.write_report import render
from crosscheck.run.isolation import ChildProcesses, ask
from crosscheck.run.questions import Question, list_questions, read_diagnosis, split_by_case
from crosscheck.verdicts.baseline import UNBLESSED
from crosscheck.verdicts.compare import Comparison
from crosscheck.verdicts.plan import discover
from crosscheck.verdicts.results import CaseRow, Results, RunRow
from flexinv.errors import InputError
from flexinv.files.load_cases import load_cases
from flexinv.files.load_mechanism import load_mechanism

# One mechanism harmed in three ways that the motion tells apart: cause, target, size.
HARMED = (("mass scale", "", 0.1), ("viscous damping", "hub", 0.01), ("rotor inertia", "hub", 0.01))
MODELS = Path(__file__).resolve().parents[3] / "models"


def harmed_question(folder: Path, place: str, cause: str, target: str, size: float) -> Question:
    """Save what a harmed Pinocchio and flexinv give, and return what is asked of them."""
    mechanism, case = place.split("/")
    folder.mkdir(exist_ok=True)
    result = load_mechanism(MODELS / mechanism)
    subject = Subject(result, load_cases(MODELS / mechanism, result)[case])
    harmed = DICTIONARY[cause].change(subject, target, np.array([size]))
    for name, one in (("pinocchio", harmed), ("flexinv", subject)):
        save(adapter(ENGINES[name]).run(one.mechanism, one.case, name, {"error": False}), folder / name)
    options = {"folder": str(MODELS / mechanism), "case": case, "engine": "pinocchio"}
    stems = {"ours": str(folder / "pinocchio"), "theirs": str(folder / "flexinv")}
    return Question((mechanism, case, "pinocchio", "flexinv"), options | stems)


@pytest.mark.slow
def test_a_cause_is_named_with_its_size_and_taken_out(tmp_path: Path) -> None:
    asked = harmed_question(tmp_path, "double_pendulum/swing", "viscous damping", "knee", 0.05)
    answer, ending = ask(asked.job, 120.0, ChildProcesses())
    assert ending.status == "ok", ending.printed
    diagnosis = read_diagnosis(asked, answer, ending.message)
    assert [one["cause"] for one in diagnosis.named] == ["viscous damping"]
    assert diagnosis.words.startswith(
        "the viscous damping of knee differs by 0.05 N m s/rad or N s/m: explains 99.99% of the"
    )
    assert " of the range remains of " in diagnosis.words
    # The size is found to rounding, and so is what remains.
    assert diagnosis.repaired is not None
    assert diagnosis.repaired < 1e-12
    assert diagnosis.separate == ""


def test_causes_that_look_alike_come_with_what_tells_them_apart(tmp_path: Path) -> None:
    asked = harmed_question(tmp_path, "rigid_one_link/cycloid", "mass scale", "", 0.1)
    answer = diagnose(**asked.options)
    assert {one["cause"] for one in answer["named"]} == {"mass scale", "body mass"}  # of one body: the same
    assert "This motion cannot tell it from" in answer["words"]
    assert answer["separate"]


def test_one_question_for_each_engine_that_deviates_from_the_reference(tmp_path: Path) -> None:
    plan = discover(MODELS, ["double_pendulum/swing"])
    here = ("double_pendulum", "swing")
    runs = tuple(
        RunRow(*here, engine, "ok", series=f"series/{engine}") for engine in ("flexinv", "pinocchio", "mujoco")
    )
    row = Comparison(*here, "pinocchio", "flexinv", "torque", "N m", "deviation", maximum=1.0, scale=2.0)
    rows = (
        row,
        replace(row, engine="mujoco", verdict="within"),
        replace(row, engine="mujoco", quantity="tip", verdict="within"),
    )
    questions = list_questions(Results("now", runs=runs, comparisons=rows), plan, tmp_path)
    assert [q.place for q in questions] == [(*here, "pinocchio", "flexinv")]
    elsewhere = (*rows, replace(row, quantity="tip"), replace(row, engine="mujoco", quantity="tip"))
    questions = list_questions(Results("now", runs=runs, comparisons=elsewhere), plan, tmp_path)
    assert {q.place[2] for q in questions} == {"pinocchio", "mujoco"}
    assert len(questions) == 2
    unblessed = replace(row, verdict="unjudged", message=UNBLESSED)  # the first night would ask of everything
    assert not list_questions(Results("now", runs=runs, comparisons=(unblessed,)), plan, tmp_path)
    assert not list_questions(
        Results("now", runs=runs[:1], comparisons=rows), plan, tmp_path
    )  # its series was not saved


@pytest.mark.slow
def test_the_cause_stands_in_the_matrix_and_in_every_summary(root: Path, tmp_path: Path) -> None:
    """From a run with an engine that has a damper too many to the cell, the list of troubles, Markdown and JUnit."""
    write_models(tmp_path / "models", root)
    engines = {"flexinv": ENGINES["flexinv"], "damped": rogue.engine("damped")}
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(Path(rogue.__file__).parent))
        results = example_run(tmp_path / "models", tmp_path / "out", engines)
    (one,) = results.diagnoses
    assert one.words.startswith("the viscous damping of knee differs by 0.05 N m s/rad or N s/m: explains 99.99%")
    index, summary = ((tmp_path / "out" / name).read_text() for name in ("index.html", "summary.md"))
    assert '<span class="cause">viscous damping (knee)</span>' in index
    assert f"cause: {one.words}" in html.unescape(index)
    (row,) = [line for line in summary.splitlines() if line.startswith("| double\\_pendulum/swing | damped | viscous")]
    assert row == f"| double\\_pendulum/swing | damped | viscous damping (knee) | {escape(one.words)} |"
    assert "✗ 0.0019: viscous damping (knee) |" in summary
    failed = ET.parse(tmp_path / "out" / "junit.xml").findall(".//failure")
    assert sum(f"cause: {one.words}" in str(f.get("message")) for f in failed) == 1
    clean = replace(results, diagnoses=(replace(one, named=(), words="no single cause explains it."),))
    render(clean, tmp_path / "out")  # nothing is named where nothing explains it
    assert 'class="cause"' not in (tmp_path / "out" / "index.html").read_text()


@pytest.mark.slow
def test_engines_of_one_case_are_diagnosed_together_and_told_the_same(tmp_path: Path) -> None:
    """What is computed once for all of them does not depend on what one of them gave."""
    asked = [
        harmed_question(tmp_path / str(k), "rigid_one_link/cycloid", cause, target, size)
        for k, (cause, target, size) in enumerate(HARMED)
    ]
    (together,) = split_by_case([asked[0], *(replace(one, place=(*asked[0].place[:2], "x", "y")) for one in asked[1:])])
    answer, ending = ask(together.job, 120.0, ChildProcesses())
    assert ending.status == "ok", ending.printed
    alone = [diagnose(**one.options) for one in asked]
    assert [one["words"] for one in answer["answers"]] == [one["words"] for one in alone]
    assert len({one["words"] for one in alone}) == len(HARMED)


def test_what_fails_beside_others_has_no_answer_and_the_others_have_theirs(tmp_path: Path) -> None:
    good = harmed_question(tmp_path, "rigid_one_link/cycloid", "mass scale", "", 0.1)
    lost = {**good.options, "ours": str(tmp_path / "nowhere")}
    first, second = make_diagnoses([lost, good.options])["answers"]
    assert first is None
    assert {one["cause"] for one in second["named"]} == {"mass scale", "body mass"}


@pytest.mark.slow
def test_a_run_with_two_engines_that_deviate_diagnoses_both(root: Path, tmp_path: Path) -> None:
    """One has a damper too many, the other gives efforts of nothing that is known."""
    write_models(tmp_path / "models", root)
    engines = {"flexinv": ENGINES["flexinv"], "damped": rogue.engine("damped"), "fine": rogue.engine("fine")}
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(Path(rogue.__file__).parent))
        results = example_run(tmp_path / "models", tmp_path / "out", engines)
    words = {one.engine: one.words for one in results.diagnoses}
    assert list(words) == ["damped", "fine"]
    assert words["damped"].startswith("the viscous damping of knee differs by 0.05 N m s/rad or N s/m: explains 99.99%")
    assert words["fine"].startswith("no single cause explains it")


def test_a_diagnosis_that_fails_says_so() -> None:
    diagnosis = read_diagnosis(Question(("m", "c", "e", "flexinv"), {}), None, "stopped after the time limit of 1 s")
    assert diagnosis.words == "not diagnosed: stopped after the time limit of 1 s"


@pytest.mark.parametrize(
    ("line", "verdict", "words"),
    [
        (Check("m", "c", "e", "total mass", "kg", True), "within", "holds"),
        (Check("m", "c", "e", "total mass", "kg", False), "deviation", "another mechanism: total mass"),
        (Check("m", "c", "e", "no certificate", "-", False, words="why"), "unjudged", "no certificate"),
    ],
)
def test_dynamics_without_a_certificate_are_labelled(line: Check, verdict: str, words: str) -> None:
    results = Results("now", certificates=(line,))
    case = CaseRow("m", "c")
    assert [(sheet.verdict, sheet.text) for sheet in list_certificates(results, case)] == [(verdict, words)]
    assert collect_warnings(results, case) == ({} if verdict == "within" else {"e": words})


def test_a_cause_that_cannot_be_taken_out_is_put_into_the_reference() -> None:
    """Shear that is 4.7 times stiffer: less by the fraction 4.7 is no beam, and the other way is tried."""
    folder = MODELS / "flex_one_link"
    mechanism = load_mechanism(folder)
    subject = Subject(mechanism, load_cases(folder, mechanism)["cycloid"])
    cause, size = DICTIONARY["shear factor"], np.array([4.7])
    with pytest.raises(InputError, match="leaves next to nothing"):
        cause.change(subject, "link", -size)
    flexinv = adapter(ENGINES["flexinv"])
    reference = flexinv.run(mechanism, subject.case, "flexinv", {"error": False})
    harmed = cause.change(subject, "link", size)
    record = flexinv.run(harmed.mechanism, harmed.case, "flexinv", {"error": False})
    fit = Fit(cause, "link", size, 0.0, np.zeros(0))
    found_left = apply_repair(make_model(subject, reference), fit, "exudyn-ancf", reference, record)
    assert found_left.where == "put into the reference"
    assert found_left.left == 0.0  # the same computation twice


def test_a_filter_cannot_be_taken_out_and_is_put_into_the_reference() -> None:
    """Minus its time constant is no filter, which the engine's efforts would go through after its run."""
    folder = MODELS / "double_pendulum"
    mechanism = load_mechanism(folder)
    subject = Subject(mechanism, load_cases(folder, mechanism)["swing"])
    cause, size = DICTIONARY["low-pass filter"], np.array([0.01])
    target = next(iter(cause.targets(subject)))
    engine, reference = (adapter(ENGINES[n]).run(mechanism, subject.case, n, {}) for n in ("pinocchio", "flexinv"))
    harmed = apply_to_record(engine, cause.change(subject, target, size))
    fit = Fit(cause, target, size, 0.0, np.zeros(0))
    found_left = apply_repair(make_model(subject, reference), fit, "pinocchio", reference, harmed)
    assert found_left.where == "put into the reference"
    assert found_left.left is not None
    assert found_left.left < 1e-12  # rounding of two engines


def test_a_repair_that_gives_no_number_leaves_the_diagnosis_without_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Taken out of the engine the cause leaves NaN; put into the reference it leaves 0.25 of the range."""
    tree = SimpleNamespace(mechanism=SimpleNamespace(closures=()), effort=None)
    cause = SimpleNamespace(sized=True, linear=False, plant=None, guess=(), change=lambda *_: tree)
    fit = SimpleNamespace(cause=cause, target="", size=np.ones(1))
    monkeypatch.setattr("crosscheck.causes.repair._run", lambda engine, *_: engine)
    left = {("e", "flexinv"): np.array([0.25]), ("other", "reference"): np.array([np.nan])}
    model = SimpleNamespace(base=tree, compute_residual=lambda a, b: left[a, b])
    result = apply_repair(model, fit, "other", "reference", "e")  # type: ignore[arg-type]
    assert (result.left, result.where) == (0.25, "put into the reference")


def test_a_size_is_corrected_by_what_full_runs_leave(tmp_path: Path) -> None:
    """The model's columns come from a coarser march: a size that is 2 % wrong is right after a full run or two."""
    folder = MODELS / "flex_one_link"
    mechanism = load_mechanism(folder)
    subject = Subject(mechanism, load_cases(folder, mechanism)["cycloid"])
    cause, size = DICTIONARY["section stiffness"], np.array([-0.05])
    flexinv = adapter(ENGINES["flexinv"])
    reference = flexinv.run(mechanism, subject.case, "flexinv", {"error": False})
    harmed = cause.change(subject, "link: EI_z", size)
    record = flexinv.run(harmed.mechanism, harmed.case, "flexinv", {"error": False})
    model = make_model(subject, reference)
    wrong = Fit(cause, "link: EI_z", 1.02 * size, 0.0, np.zeros(model.torque.size))
    at_once = add_to_reference(model, wrong, record, np.inf)
    corrected = add_to_reference(model, wrong, record, 0.0)
    assert at_once.fit is wrong
    # Each round leaves a few per cent of what was left before; two of them a thousandth.
    assert corrected.left < 3e-3 * at_once.left
    assert corrected.fit.size == pytest.approx(size, rel=1e-4)


def test_a_cause_that_full_runs_refute_is_not_named() -> None:
    """It explains the difference in the model's columns, and half of it is left in a run with it: something else is wrong."""
    folder = MODELS / "double_pendulum"
    mechanism = load_mechanism(folder)
    subject = Subject(mechanism, load_cases(folder, mechanism)["swing"])
    engine, reference = (adapter(ENGINES[n]).run(mechanism, subject.case, n, {}) for n in ("pinocchio", "flexinv"))
    model = make_model(subject, reference)
    fit = Fit(DICTIONARY["viscous damping"], "knee", np.array([0.05]), 1e-3, np.zeros(model.torque.size))
    naming = NamedCauses((fit,), None, 0.1, 1e-9, "")
    settled, repaired = check_by_full_runs(Answer(model, engine, reference, naming, True, 0.0), "pinocchio", None)
    assert settled.named == ()
    assert repaired.left is not None
    assert settled.words.startswith(
        "the cause is unknown: viscous damping would explain 99.99% of the difference, but "
    )
    assert settled.words.endswith("of the range remains of 1.0e-01, more than the error bars")
