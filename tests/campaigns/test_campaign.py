"""Faults beyond the dictionary: what is drawn, planted and undone, and what the judge makes of every kind of answer."""

from __future__ import annotations

import importlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from campaigns.beyond import judge
from campaigns.beyond.campaign import CAMPAIGNS, OWN, Bench, Campaign, CampaignRequest, make_results, run
from campaigns.beyond.catalogue import RECIPES, draw, make_fault
from campaigns.beyond.fault import ALL, CorrectAnswer, Fault, FaultScenario, join_faults
from campaigns.beyond.planting import RUNS, apply_fault
from campaigns.beyond.shown import describe_campaign
from campaigns.beyond.trial import _judge_trial, compute_effect
from crosscheck.commands.selftest import command
from crosscheck.engines import ENGINES
from crosscheck.measures.mechanisms import read_mechanism
from crosscheck.measures.record import Record, torque_series
from crosscheck.verdicts.plan import discover, make_task
from flexinv.files.load_cases import load_cases

MODELS = Path(__file__).resolve().parents[2] / "models"


def scene(name: str, case: str, engine: str, models: Path = MODELS) -> FaultScenario:
    """A scene with an effort of 1 everywhere: enough to draw from."""
    mechanism = read_mechanism(models / name)
    known = load_cases(models / name, mechanism)[case]
    time = make_task(models / name, mechanism, known).time
    effort = torque_series(mechanism, np.ones((time.size, mechanism.nv)))
    return FaultScenario(mechanism, known, engine, Record("flexinv", time=time, series=effort))


def answer(cause: str, target: str = "", words: str = "") -> dict[str, str]:
    return {"cause": cause, "target": target, "words": words}


HEAVY = Fault(
    "mass of link2", ((CorrectAnswer(("mass",), ("link2", "joint2")),),), (CorrectAnswer(("com",), ("link2",)),)
)
ROTOR = Fault("rotor of joint1", ((CorrectAnswer(("rotor",), ("joint1",)),),))
MASS2, COM2, MASS1 = (
    answer(c, t) for c, t in (("body mass", "link2"), ("centre of mass shifted", "link2"), ("body mass", "link1"))
)


@pytest.mark.parametrize(
    ("named", "expected"),
    [
        ([MASS2], "right"),
        ([MASS1, MASS2], "in set"),
        ([COM2, MASS1, MASS2], "in set"),
        ([COM2, MASS1, MASS2, MASS2], "wide"),
        ([COM2], "near"),
        ([MASS1], "wrong"),
        ([MASS1, COM2], "wrong"),
        ([answer("mass scale")], "wrong"),
        ([answer("a name that nobody knows", "link2")], "wrong"),
        ([answer("body mass", "link20")], "wrong"),
        ([answer("body mass", "link2/body")], "right"),
        ([MASS1] * 4, "wrong"),
    ],
)  # fmt: skip
def test_an_answer_is_judged_by_quantity_and_place(named: list[dict[str, str]], expected: str) -> None:
    assert judge.judge_fault(named, HEAVY, "above", alarm=True) == expected


@pytest.mark.parametrize(
    ("effect", "alarm", "expected"),
    [
        ("above", True, "unknown"),
        ("above", False, "accepted"),
        ("between", True, "unknown"),
        ("between", False, "silent"),
        ("below", False, "silent"),
        ("below", True, "silent"),  # a certificate line sees more than the efforts
    ],
)
def test_nothing_named_is_judged_by_the_exit_code(effect: Any, alarm: bool, expected: str) -> None:
    assert judge.judge_fault([], HEAVY, effect, alarm) == expected


def test_a_name_below_the_bars_has_to_be_true_as_well() -> None:
    assert judge.judge_fault([MASS1], HEAVY, "below", alarm=True) == "wrong"
    assert judge.judge_fault([MASS2], HEAVY, "below", alarm=True) == "right"


def test_a_fault_of_all_places_is_not_named_by_one() -> None:
    lost = Fault("rotors", ((CorrectAnswer(("rotor",), (ALL,)),),))
    assert judge.judge_answer(answer("rotor inertia dropped"), lost) == "right"
    assert judge.judge_answer(answer("rotor inertia", "joint1"), lost) == "wrong"


def test_what_is_said_of_all_efforts_is_said_of_all_places() -> None:
    tared = Fault("means taken off", ((CorrectAnswer(("effort offset",), (ALL, "joint1")),),))
    said = answer("effort offset taken off", "the mean", "of all efforts the mean is taken off")
    assert judge.judge_answer(said, tared) == "right"
    assert judge.judge_answer({**said, "words": "of one effort the mean is taken off"}, tared) == "wrong"
    assert judge.judge_answer(said, Fault("offset", ((CorrectAnswer(("effort offset",), ("joint1",)),),))) == "wrong"


def test_which_stiffness_is_read_from_the_target() -> None:
    softer = Fault("EI_z", ((CorrectAnswer(("EI_z",), ("link",)),),))
    assert judge.judge_answer(answer("section stiffness", "link: EI_z"), softer) == "right"
    assert judge.judge_answer(answer("section stiffness", "link: EI_y"), softer) == "wrong"
    assert judge.judge_answer(answer("section stiffness", "other: EI_z"), softer) == "wrong"


def test_two_faults_want_both_names_in_one_answer() -> None:
    two = join_faults(HEAVY, ROTOR)
    rotor = answer("rotor inertia", "joint1")
    assert judge.judge_answer(answer("body mass + rotor inertia", "link2 + joint1"), two) == "right"
    assert judge.judge_answer(answer("body mass + rotor inertia", "link1 + joint1"), two) == "wrong"
    assert judge.judge_answer(rotor, two) == "near"
    assert judge.judge_answer(answer("body mass + rotor inertia", "link2 + joint1"), HEAVY) == "wrong"


def test_what_together_is_the_same_is_right_together_only() -> None:
    wider = replace(
        HEAVY, same=((CorrectAnswer(("beam mass",), ("link",)),), (CorrectAnswer(("EI_z",), ("link",)),)),
        parts=((CorrectAnswer(("section size",)),),)
    )  # fmt: skip
    weight, bends = answer("beam mass", "link"), answer("section stiffness", "link: EI_z")
    assert judge.judge_answer(weight, wider) == judge.judge_answer(bends, wider) == "near"
    assert judge.judge_answer(answer("beam mass + section stiffness", "link + link: EI_z"), wider) == "right"


def test_later_names_are_read_by_their_words() -> None:
    assert "load friction" in judge.find_kinds(answer("friction by load", "joint1"))
    assert "effort offset" in judge.find_kinds(answer("bias", "joint1", "a constant effort of 2 N m"))
    assert judge.find_kinds(answer("zzz", "joint1")) == ()


def scenes() -> Iterator[FaultScenario]:
    for chosen in CAMPAIGNS.values():
        for bench in chosen.benches:
            for engine in bench.engines:
                yield scene(bench.mechanism, bench.case, engine, OWN if bench.in_package else MODELS)


@pytest.fixture(scope="module")
def everywhere() -> list[FaultScenario]:
    return list(scenes())


def test_every_quantity_that_is_right_can_be_said(everywhere: Sequence[FaultScenario]) -> None:
    """A misspelt kind would make an answer that is right a wrong one."""
    sayable = {k for kinds in judge.KINDS.values() for k in kinds} | {k for _, kinds in judge.WORDS for k in kinds}
    sayable |= {"EA", "GA_y", "GA_z", "GJ", "EI_y", "EI_z"}
    seen = set()
    for recipe in RECIPES:
        for one in everywhere:
            rng = np.random.default_rng(1)
            for size in recipe.sizes:
                fault = recipe.draw(one, rng, size)
                if fault is not None:
                    seen.add(recipe.name)
                    kinds = {k for part in (*fault.parts, fault.near) for truth in part for k in truth.kinds}
                    assert kinds <= sayable, (recipe.name, kinds - sayable)
    assert {recipe.name for recipe in RECIPES} == seen  # none of them is never possible


def test_faults_are_drawn_again_from_their_seed(everywhere: Sequence[FaultScenario]) -> None:
    known = everywhere[:12]
    first, again, other = (draw(known, [1.0] * len(known), 60, seed) for seed in (3, 3, 4))
    assert first == again
    assert first != other
    assert [make_fault(d, known[d.scene]).words for d in first] == [make_fault(d, known[d.scene]).words for d in again]  # type: ignore[union-attr]
    assert {d.number for d in first} == set(range(1, 61))
    assert len({d.recipes[0] for d in first}) == 60  # every recipe before any twice
    assert any(len(d.recipes) == 2 for d in first)


def test_the_second_campaign_has_other_mechanisms_or_motions() -> None:
    cases = [{(b.mechanism, b.case) for b in CAMPAIGNS[name].benches} for name in ("first", "second")]
    assert not cases[0] & cases[1]
    assert CAMPAIGNS["first"].seed != CAMPAIGNS["second"].seed
    assert min(one.count for one in CAMPAIGNS.values()) >= 150


def test_a_planted_fault_is_in_runs_and_certificates_and_gone_afterwards() -> None:
    here = scene("double_pendulum", "swing", "pinocchio")
    module = importlib.import_module("crosscheck.engines.pinocchio.adapter")
    fault = next(f for f in _of("size of gravity", here) if f is not None)

    def asked() -> tuple[float, float]:
        record = module.run(here.mechanism, here.case, "pinocchio", {})
        gravity = module.certify(here.mechanism, here.case, "pinocchio").gravity
        return float(np.abs(record.series["torque/pivot"].values).max()), float(np.abs(gravity).max())

    before = asked()
    with apply_fault(fault, "pinocchio"):
        during = asked()
    assert before == asked()
    assert all(a != b for a, b in zip(before, during, strict=True))


def test_another_engine_is_left_alone_while_a_fault_is_planted() -> None:
    here = scene("double_pendulum", "swing", "pinocchio")
    module = importlib.import_module("crosscheck.engines.mujoco.adapter")
    run_it = lambda: module.run(here.mechanism, here.case, "mujoco", {}).series["torque/pivot"].values  # noqa: E731
    before = run_it()
    with apply_fault(next(f for f in _of("no gravity", here) if f is not None), "pinocchio"):
        assert np.array_equal(before, run_it())


@pytest.mark.parametrize(("module", "function"), RUNS)
def test_noise_of_every_run_goes_where_an_adapter_makes_its_series(module: str, function: str) -> None:
    home, noise = importlib.import_module(module), Fault("noise", (), raw=dict)
    own = getattr(home, function)
    with apply_fault(noise, "exudyn-ancf"):
        assert getattr(home, function) is not own
    assert getattr(home, function) is own


def _of(name: str, here: FaultScenario) -> Iterator[Fault | None]:
    recipe = next(r for r in RECIPES if r.name == name)
    for size in recipe.sizes:
        yield recipe.draw(here, np.random.default_rng(0), size)


def test_noise_is_never_the_same_twice() -> None:
    here = scene("double_pendulum", "swing", "mujoco")
    fault = list(_of("noise of the output", here))[-1]
    assert fault is not None
    first, second = (fault.record(here.reference, here.mechanism, here.case) for _ in range(2))
    assert not np.array_equal(first.series["torque/pivot"].values, second.series["torque/pivot"].values)


@pytest.mark.parametrize(("by", "expected"), [(1e-6, "below"), (0.011, "above"), (0.0095, "between")])
def test_an_effect_is_measured_against_the_bars(by: float, expected: str) -> None:
    """A limit of 1 % of the range, an unharmed engine that is 0.1 % off."""
    here = discover(MODELS, ("rigid_3r/quintic",)).tasks[0]
    limits = tuple(replace(one, maximum=0.01) for one in here.case.limits)
    here = replace(here, case=replace(here.case, limits=limits, quantities=("torque",)))
    ramp = np.linspace(0.0, 1.0, here.time.size)[:, None] * np.ones(3)

    def record(engine: str, more: float) -> Record:
        return Record(engine, time=here.time, series=torque_series(here.mechanism, ramp + more))

    unharmed = record("mujoco", 0.001 if by < 0.01 else 0.0005)
    harmed = record("mujoco", by + (0.001 if by < 0.01 else 0.0005))
    assert compute_effect(HEAVY, here, record("flexinv", 0.0), unharmed, harmed)[0] == expected


@pytest.mark.parametrize(
    ("planted_one", "deviate", "failed", "expected"),
    [
        (True, False, (), "silent"),
        (True, False, ("total mass",), "seen"),
        (True, True, ("total mass",), "false alarm"),
        (False, False, ("total mass",), "false alarm"),
        (False, True, (), "false alarm"),
    ],
)
def test_a_certificate_may_see_what_no_motion_shows(
    planted_one: bool, deviate: bool, failed: tuple[str, ...], expected: str
) -> None:
    fault = HEAVY if planted_one else replace(HEAVY, parts=())
    assert _judge_trial((), fault, "below", bool(failed) or deviate, deviate, failed) == expected


def test_sums_count_and_judge() -> None:
    rows = [
        {"number": k, "mechanism": "m", "case": "c", "engine": "mujoco", "topic": "t", "outcome": o, "effect": e, "fault": "f"}
        for k, (o, e) in enumerate([("silent", "below"), ("right", "above"), ("unknown", "above"), ("silent", "below")])
    ]  # fmt: skip
    campaign_request = CampaignRequest(CAMPAIGNS["first"], MODELS, Path("."))
    good = make_results(campaign_request, rows, 1.0)
    assert (good["sums"]["above"], good["sums"]["share"], good["met"], good["unharmed"]["tried"]) == (2, 0.5, True, 1)
    for outcome in judge.BAD:
        spoilt = make_results(campaign_request, [*rows, {**rows[1], "number": 9, "outcome": outcome}], 1.0)
        assert not spoilt["met"], outcome
    assert not make_results(campaign_request, [{**rows[0], "outcome": "false alarm"}, *rows[1:]], 1.0)["met"]
    assert "NOT met" in next(describe_campaign(make_results(campaign_request, [*rows, {**rows[2], "number": 9}], 1.0)))


@pytest.mark.slow
def test_a_small_campaign_runs_for_real(tmp_path: Path) -> None:
    chosen = Campaign("small", (Bench("double_pendulum", "swing", ("pinocchio", "mujoco")),), 3, 4)
    told: list[int] = []
    results = run(CampaignRequest(chosen, MODELS, tmp_path, jobs=2), lambda done, total, row: told.append(done))
    assert told == list(range(1, 6))  # three faults, and both engines unharmed
    assert json.loads((tmp_path / "beyond.json").read_text()) == json.loads(json.dumps(results))
    assert sorted(file.name for file in tmp_path.iterdir()) == ["beyond.json"]  # nothing else is written or removed
    assert [row["number"] for row in results["rows"]] == [0, 0, 1, 2, 3]
    assert all(
        row["outcome"] in (*judge.GOOD, *judge.BAD, "near", "unknown", "silent", "seen", "refused")
        for row in results["rows"]
    )
    assert "failed" not in results["sums"]["counts"], results["rows"]
    alone = run(replace(CampaignRequest(chosen, MODELS, tmp_path, jobs=1), only=(3,)))["rows"]
    assert [(r["number"], r["fault"], r["outcome"]) for r in alone] == [
        (r["number"], r["fault"], r["outcome"]) for r in results["rows"] if r["number"] == 3
    ]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--mechanisms", "four_baz"], "campaign first has no mechanism 'four_baz'"),
        (["--only", "x"], "expected numbers of faults"),
        (["--models", "tests"], "write --models"),
    ],
)
def test_what_cannot_be_asked_is_said(words: list[str], expected: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(MODELS.parent)
    result = CliRunner().invoke(command, ["--beyond", *words])
    assert result.exit_code == 2
    assert expected in result.output.replace("\n", " ")


def test_engines_of_the_campaigns_are_known() -> None:
    assert {e for one in CAMPAIGNS.values() for bench in one.benches for e in bench.engines} <= set(ENGINES)


def test_a_tensor_in_another_order_is_planted_whatever_its_signs() -> None:
    """Slots xx, xy, yy, xz, yz, zz get xx, yy, zz, xy, xz, yz; where yz < 0 the constructor refused it as no inertia."""
    pin = pytest.importorskip("pinocchio")
    faults = importlib.import_module("campaigns.beyond.engines.pinocchio")
    tensor = np.array([[0.10, 0.02, -0.01], [0.02, 0.20, -0.03], [-0.01, -0.03, 0.25]])
    model = SimpleNamespace(inertias=[pin.Inertia(2.0, np.array([0.1, 0.2, 0.3]), tensor)])
    faults.replace_inertia_order(SimpleNamespace(model=model, joint={"j": (0, None)}), "j")
    wrong = np.asarray(model.inertias[0].inertia)
    np.testing.assert_array_equal(wrong[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]], [0.10, 0.20, 0.25, 0.02, -0.01, -0.03])
    assert model.inertias[0].mass == 2.0
