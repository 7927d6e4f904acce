"""What a diagnosis does not compute: fine marches of causes that explain nothing, sizes that only the efforts know."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from crosscheck.causes import diagnosis
from crosscheck.causes import model as models
from crosscheck.causes import naming as naming_module
from crosscheck.causes.diagnosis import diagnose
from crosscheck.causes.dictionary import DICTIONARY
from crosscheck.causes.fit import fit, list_candidates
from crosscheck.causes.model import make_model
from crosscheck.causes.naming import find_causes
from crosscheck.causes.quantities import Quantities
from crosscheck.causes.subject import Subject
from crosscheck.engines import ENGINES, adapter
from crosscheck.measures.record import Record, save
from flexinv.files.load_cases import load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.typing import Array

MODELS = Path(__file__).resolve().parents[3] / "models"


def subject_of(name: str, case: str) -> Subject:
    mechanism = load_mechanism(MODELS / name)
    return Subject(mechanism, load_cases(MODELS / name, mechanism)[case])


def humming(time: Array) -> Array:
    """What no cause of the dictionary gives: a hum of its own, 3 % of the range."""
    return 0.03 * np.sin(170.0 * time + 1.0)


def test_a_rough_march_shows_where_a_size_is_worth_a_look() -> None:
    model = make_model(subject_of("flex_one_link", "cycloid"))
    assert model.rough.base.options["step"] == pytest.approx(5e-4)  # half a sample; the columns take 1e-4
    off = np.abs(model.rough.torque - model.torque).max() / np.ptp(model.torque)
    assert 0.0 < off < 3e-3  # (w h)^2 / 12 of its second bending, 394 rad/s
    stiffer = DICTIONARY["section stiffness"].change(model.rough.base, "link: EI_z", np.array([0.1]))
    fine = model.compute_difference(replace(stiffer, options={}))
    rough = model.rough.compute_difference(stiffer)
    assert np.linalg.norm(rough - fine) < 0.1 * np.linalg.norm(fine)  # ROUGH_ERROR


@pytest.mark.parametrize(("name", "case"), [("rigid_3r", "quintic"), ("flex_one_link", "bang_bang")])
def test_where_nothing_marches_or_steps_meet_jumps_no_march_is_rougher(name: str, case: str) -> None:
    model = make_model(subject_of(name, case))
    assert model.rough is model


def test_causes_that_explain_nothing_take_no_fine_march(monkeypatch: pytest.MonkeyPatch) -> None:
    model = make_model(subject_of("flex_one_link", "cycloid"))
    known = list_candidates(model, DICTIONARY)
    steps: list[float] = []
    march = models.solve

    def count(mesh: Any, motion: Any, step: float, **options: Any) -> Any:
        steps.append(step)
        return march(mesh, motion, step, **options)

    monkeypatch.setattr(models, "solve", count)
    naming = find_causes(model, humming(model.states.time), 1e-9, known)
    assert not naming.named
    assert len(steps) > 50  # sizes far away were looked at
    assert min(steps) == pytest.approx(5e-4)
    (near,) = (one for one in known if (one.cause.name, one.target) == ("section stiffness", "link: EI_z"))
    fit(model, near.columns[:, 0], near)  # the check sees the fine march of a cause that comes near
    assert min(steps) == pytest.approx(1e-4)


def test_sizes_are_asked_of_other_quantities_only_where_those_differ(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The efforts themselves are no other quantity: what fits leave of them they leave."""
    subject = subject_of("flex_one_link", "cycloid")
    engine = adapter(ENGINES["flexinv"])
    record = engine.run(subject.mechanism, subject.case, "flexinv", {"error": False})
    save(record, tmp_path / "ours")
    asked: list[str] = []

    def fit_size(quantities: Quantities, fit: Any) -> Any:
        asked.append(fit.cause.name)
        return fit

    monkeypatch.setattr(Quantities, "fit_size", fit_size)
    few = {name: DICTIONARY[name] for name in ("base acceleration", "viscous damping", "section stiffness")}
    monkeypatch.setattr(diagnosis, "collect_causes", lambda: few)
    monkeypatch.setattr(naming_module, "collect_causes", lambda: few)
    for shaken in ("torque", "tip"):
        save(shake(record, {"torque", shaken}), tmp_path / "theirs")
        answer = diagnose(
            str(MODELS / "flex_one_link"), "cycloid", "exudyn-ge", str(tmp_path / "theirs"), str(tmp_path / "ours")
        )
        assert not answer["named"]
        assert bool(asked) is (shaken == "tip")


def shake(record: Record, quantities: set[str]) -> Record:
    """Return a record in which these quantities hum."""
    series = {
        name: replace(one, values=one.values + humming(record.time) * np.ptp(one.values))
        if one.quantity in quantities
        else one
        for name, one in record.series.items()
    }
    return replace(record, engine="exudyn-ge", series=series)
