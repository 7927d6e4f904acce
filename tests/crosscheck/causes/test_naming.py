"""What the motor does not feel is named by where things are: a base that stands elsewhere, an axis the other way."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crosscheck.causes.diagnosis import diagnose
from crosscheck.causes.dictionary import DICTIONARY, collect_causes
from crosscheck.causes.evidence import CauseAssessment
from crosscheck.causes.fit import Fit, list_candidates
from crosscheck.causes.model import make_model
from crosscheck.causes.naming import MOST, UNEXPLAINED, ResidualQuestion, choose_causes, find_causes
from crosscheck.causes.pairs import AND, find_pairs
from crosscheck.causes.subject import Subject
from crosscheck.engines import ENGINES, adapter
from crosscheck.measures.record import Record, read_record, save
from crosscheck.run.child import make_certificate
from flexinv.files.load_cases import load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.links import Body

MODELS = Path(__file__).resolve().parents[3] / "models"


def records(folder: Path, mechanism: str, case: str, cause: str, target: str, size: list[float]) -> dict[str, str]:
    """Save what Pinocchio with a cause in its model and flexinv without it give; return what is asked of them."""
    result = load_mechanism(MODELS / mechanism)
    subject = Subject(result, load_cases(MODELS / mechanism, result)[case])
    harmed = DICTIONARY[cause].change(subject, target, np.array(size))
    for called, one in (("pinocchio", harmed), ("flexinv", subject)):
        engine = adapter(ENGINES[called])
        record = engine.run(one.mechanism, one.case, called, {"error": False})
        save(replace(record, certificate=make_certificate(engine, one.mechanism, one.case, called)), folder / called)
    return {
        "folder": str(MODELS / mechanism), "case": case, "engine": "pinocchio",
        "ours": str(folder / "pinocchio"), "theirs": str(folder / "flexinv"),
    }  # fmt: skip


def torques_apart(asked: dict[str, str]) -> float:
    one, other = (read_record(Path(asked[name])) for name in ("ours", "theirs"))
    names = [n for n, s in one.series.items() if s.quantity == "torque"]
    return max(float(np.abs(one.series[n].values - other.series[n].values).max()) for n in names)


@pytest.mark.parametrize(
    ("mechanism", "case", "cause", "target", "size", "words"),
    [
        ("double_pendulum", "swing", "joint misplaced", "pivot", [0.01, 0.0, 0.02], "by (0.01, 0, 0.02) m"),
        ("rigid_one_link", "cycloid", "axis sign", "hub", [1.0], "the axis of hub points the other way"),
    ],
)
def test_a_mistake_that_no_effort_shows_is_named(
    mechanism: str, case: str, cause: str, target: str, size: list[float], words: str, tmp_path: Path
) -> None:
    asked = records(tmp_path, mechanism, case, cause, target, size)
    assert torques_apart(asked) < 1e-12  # rounding of some N m
    answer = diagnose(**asked)
    assert [(one["cause"], one["target"]) for one in answer["named"]] == [(cause, target)]
    assert words in answer["words"]


def test_tips_that_no_mechanism_has_are_unknown(tmp_path: Path) -> None:
    """A tip that swings at a rhythm of its own; and where nothing differs nothing is asked."""
    asked = records(tmp_path, "rigid_one_link", "cycloid", "joint misplaced", "hub", [0.0, 0.0, 0.0])
    assert diagnose(**asked)["words"].startswith("the difference is inside the error bars")
    record: Record = read_record(tmp_path / "pinocchio")
    swung = {
        n: replace(s, values=s.values + 0.01 * np.sin(40 * record.time)) if s.quantity == "tip" else s
        for n, s in record.series.items()
    }
    save(replace(record, series=swung), tmp_path / "pinocchio")
    answer = diagnose(**asked)
    assert not answer["named"]
    assert any(
        words in answer["words"] for words in ("no cause of the dictionary shows", "no single cause", "is contradicted")
    )


@pytest.mark.parametrize(
    ("missed", "bar", "expected"),
    [
        pytest.param(0.0, 0.26, True, id="all of it is within the bars"),
        pytest.param(4.0, 0.26, False, id="one peak is not, though the bars add up to more than what is left"),
        pytest.param(0.0, 0.0, False, id="without bars half of it is too much to leave"),
    ],
)
def test_an_amplitude_explains_what_it_leaves_within_the_bars_or_a_tenth(
    missed: float, bar: float, expected: bool
) -> None:
    """Of a long step only the amplitude is fitted: it may leave UNEXPLAINED, or what the bars cover sample by sample."""
    mechanism = load_mechanism(MODELS / "flex_one_link")
    model = make_model(Subject(mechanism, load_cases(MODELS / "flex_one_link", mechanism)["cycloid"]))
    residual = np.ones(model.torque.size)
    residual[7] += missed
    residual_question = ResidualQuestion(model, residual, np.full(residual.size, bar))
    half = 0.55 * np.ones(residual.size)
    left = float(np.linalg.norm(residual - half) / np.linalg.norm(residual))
    assert UNEXPLAINED < left < 0.5
    assert residual_question.can_explain(Fit(DICTIONARY["time step"], "", np.ones(1), left, half)) is expected
    nearly = Fit(DICTIONARY["time step"], "", np.ones(1), UNEXPLAINED / 2, residual * (1 - UNEXPLAINED / 2))
    assert residual_question.can_explain(nearly)


PAIR = f"payload{AND}rotor inertia"


@pytest.mark.parametrize(
    ("name", "count", "named"), [("payload", 5, 5), ("payload", 2, 2), (PAIR, MOST, MOST), (PAIR, MOST + 1, 0)]
)
def test_one_name_at_many_places_is_an_answer_and_many_pairs_are_none(name: str, count: int, named: int) -> None:
    mechanism = load_mechanism(MODELS / "rigid_3r")
    model = make_model(Subject(mechanism, load_cases(MODELS / "rigid_3r", mechanism)["quintic"]))
    residual = np.ones(model.torque.size)
    cause = replace(DICTIONARY["payload"], name=name)
    heard = tuple(
        CauseAssessment(Fit(cause, f"place {k}", np.ones(cause.parameters), 0.0, residual)) for k in range(count)
    )
    naming = choose_causes(
        ResidualQuestion(model, residual, np.zeros(residual.size)), [one.fit for one in heard], heard, None
    )
    unknown = f"the cause is unknown: {count} explain it, and nothing that the engine gave tells them apart"
    assert len(naming.named) == named
    assert naming.words == ("" if named else unknown)


def test_a_pair_of_which_one_part_explains_all_is_that_part_alone() -> None:
    """Where a pair finds the size of one cause, and rounding for the other, it is the first."""
    mechanism = load_mechanism(MODELS / "double_pendulum")
    subject = Subject(mechanism, load_cases(MODELS / "double_pendulum", mechanism)["swing"])
    model = make_model(subject)
    causes = ("time offset", "rotor inertia")
    known = list_candidates(model, {n: DICTIONARY[n] for n in causes})
    residual = model.compute_difference(DICTIONARY["time offset"].change(subject, "", np.array([0.01])))
    residual_question = ResidualQuestion(model, residual, np.full(residual.size, 1e-9))
    explaining = find_pairs(model, residual, known, residual_question.can_explain, residual_question.part)
    (one,) = choose_causes(residual_question, explaining, tuple(map(CauseAssessment, explaining)), None).named
    assert (one.cause.name, one.size[0]) == ("time offset", pytest.approx(0.01, rel=1e-6))


@pytest.mark.slow
def test_a_rotary_inertia_is_found_whatever_its_size() -> None:
    """A thin strip has so little of it that a user may be wrong by orders of magnitude: width for thickness, mm^4 for m^4.

    Without error bars what is left of a march's column may be MARCHED, of its largest difference.
    """
    mechanism = load_mechanism(MODELS / "flex_one_link")
    subject = Subject(mechanism, load_cases(MODELS / "flex_one_link", mechanism)["cycloid"])
    model = make_model(subject)
    (link,) = mechanism.beams
    known = list_candidates(model, collect_causes())  # of the unharmed model, whatever the harm
    for factor in (2.0, 100.0):
        harmed = DICTIONARY["rotary inertia of the section"].change(
            subject, link.name, np.array([max(factor, 1e-3) - 1.0])
        )
        naming = find_causes(model, model.compute_difference(harmed), 1e-9, known)
        assert [f.cause.name for f in naming.named] == ["rotary inertia of the section"]
        assert float(naming.named[0].size[0]) == pytest.approx(factor - 1.0, rel=0.02)


@pytest.mark.parametrize(("left", "named"), [(UNEXPLAINED / 2, True), (0.3, False)])
def test_a_cause_that_bars_hide_is_named_only_where_it_explains_nearly_all(left: float, named: bool) -> None:
    """Bars of 0.3 of the difference: the right cause may leave more than HALF at NOISE of them, and is not among the fits."""
    mechanism = load_mechanism(MODELS / "flex_one_link")
    model = make_model(Subject(mechanism, load_cases(MODELS / "flex_one_link", mechanism)["cycloid"]))
    residual = np.ones(model.torque.size)
    residual_question = ResidualQuestion(model, residual, np.full(residual.size, 0.3))
    fit = Fit(DICTIONARY["rotor inertia"], "hub", np.ones(1), left, (1 - left) * residual)
    assert residual_question.can_explain(fit)
    naming = choose_causes(residual_question, [fit], (CauseAssessment(fit),), None)
    assert bool(naming.named) is named
    assert ("the error bars are 30% of the difference" in naming.words) is not named


@pytest.mark.slow
def test_a_factor_of_a_thousand_is_found_beside_a_small_one_that_looks_like_it() -> None:
    """A shear stiffness of a five-hundredth: 1 % softer in bending leaves 2 % of the difference, the right cause nothing."""
    mechanism = load_mechanism(MODELS / "flex_one_link")
    subject = Subject(mechanism, load_cases(MODELS / "flex_one_link", mechanism)["cycloid"])
    model = make_model(subject)
    (link,) = mechanism.beams
    harmed = DICTIONARY["shear factor"].change(subject, link.name, np.array([2e-3 - 1.0]))
    residual = model.compute_difference(harmed)
    naming = find_causes(model, residual, 5e-3 * float(np.abs(residual).max()))
    assert [f.cause.name for f in naming.named] == ["shear factor"]
    # Bars of half a per cent leave a size that acts by its inverse unsure by as much.
    assert float(naming.named[0].size[0]) == pytest.approx(2e-3 - 1.0, abs=0.01 * 2e-3)


@pytest.mark.parametrize(("place", "target"), [("double_pendulum/swing", "upper"), ("ur5/reach", "forearm_link")])
def test_a_parallel_axis_term_that_is_taken_off_twice_is_named(place: str, target: str) -> None:
    """No user means such a tensor; it explains all but rounding, and what does is named, however large its size."""
    mechanism, case = place.split("/")
    result = load_mechanism(MODELS / mechanism)
    subject = Subject(result, load_cases(MODELS / mechanism, result)[case])
    model = make_model(subject)

    def without(body: Body) -> Body:
        inertia = body.inertia
        distance = inertia.com @ inertia.com * np.eye(3) - np.outer(inertia.com, inertia.com)
        return replace(body, inertia=inertia.replace_unchecked(tensor=inertia.tensor - inertia.mass * distance))

    residual = model.compute_difference(subject.replace_body(target, without))
    naming = find_causes(model, residual, 1e-9)
    assert {f.target for f in naming.named} == {target}
    assert naming.named[0].residual < 1e-7
