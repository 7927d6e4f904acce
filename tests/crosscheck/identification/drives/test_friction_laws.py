"""Laws of friction: what is planted is chosen, with its size, and nothing where nothing is."""

from __future__ import annotations

from pathlib import Path

import logged_arm
import numpy as np
import pytest
import spoiled_drives

from crosscheck.identification.drives.evidence import EVIDENCE, Terms, add_columns, build_terms, judge_term
from crosscheck.identification.drives.friction_laws import FrictionTerm, choose_friction_laws
from crosscheck.identification.identify import identify
from crosscheck.identification.logs.log import Log
from flexinv.typing import Array

SIZES = {"Stribeck": 0.8, "load": 0.1, "quadratic": 0.5, "asymmetric": 0.4}
WARM = 'temperature = { column = "warm", reference_degC = 20 }'
THINNER = -0.02  # [1/K]


def add_friction(term: str, q: Array, qd: Array, load: Array) -> Array:
    """Return what a term adds to the effort of the elbow, whose dry friction is 1 N m, and none to the shoulder's."""
    v = qd[:, 1]
    side = np.tanh(v / 0.02)
    law = {
        "Stribeck": side * np.exp(-((v / 0.18) ** 2)),
        "load": side * np.abs(load[:, 1]),
        "quadratic": np.abs(v) * v,
        "asymmetric": np.abs(side),
    }[term]
    return np.column_stack([np.zeros_like(v), SIZES[term] * law])


def make_log(folder: Path, term: str) -> Log:
    return spoiled_drives.make_log(folder, (lambda q, qd, qdd, load: add_friction(term, q, qd, load)) if term else None)


def fit_arm(folder: Path, term: str, text: str = logged_arm.IDENTIFY) -> Terms:
    return spoiled_drives.fit_log(folder, make_log(folder, term), text)


def list_chosen(terms: Terms) -> list[FrictionTerm]:
    return [one for one in choose_friction_laws(terms) if one.chosen]


@pytest.mark.parametrize("term", SIZES)
def test_a_term_that_is_planted_is_chosen_with_its_size(tmp_path: Path, term: str) -> None:
    """Within three of its errors; the bump of Stribeck is a share of the dry friction, which is a quarter larger without it."""
    (one,) = list_chosen(fit_arm(tmp_path, term))
    assert (one.joint, one.term) == ("elbow", term)
    assert one.evidence.gain > 2.0 * EVIDENCE
    off = 0.25 * SIZES[term] if term == "Stribeck" else 0.0
    assert abs(one.size - SIZES[term]) < 3.0 * one.evidence.errors[0] + off


def test_nothing_is_chosen_where_nothing_is(tmp_path: Path) -> None:
    assert list_chosen(fit_arm(tmp_path, "")) == []


def test_by_evidence_the_term_is_free_and_its_interval_holds_the_truth(tmp_path: Path) -> None:
    logged_arm.write_arm(tmp_path)
    (tmp_path / "identify.toml").write_text('friction = "evidence"\n' + logged_arm.IDENTIFY)
    found = identify(tmp_path, [make_log(tmp_path, "load")])
    (row,) = [row for row in found.parameters if row.parameter == "load friction"]
    assert row.place == "elbow"
    assert row.low < SIZES["load"] < row.high
    (one,) = list_chosen(build_terms(found.task, found.days))  # told still, and free now
    assert one.free
    assert found.seen[1].rms < 0.02  # noise of 0.05 N m, of which the low-pass leaves a sixth


def test_a_term_that_is_free_and_not_there_is_not_needed(tmp_path: Path) -> None:
    table = '[[free]]\nparameter = "stribeck share"\nplace = ["elbow"]\nerror = 0.5\n'
    laws = choose_friction_laws(fit_arm(tmp_path, "", logged_arm.IDENTIFY + table))
    (one,) = [law for law in laws if law.free]
    assert not one.chosen
    assert one.evidence.gain < EVIDENCE


def test_friction_that_follows_the_temperature_is_told_where_it_is_logged(tmp_path: Path) -> None:
    warm = np.linspace(20.0, 50.0, 2000)

    def thin(q: Array, qd: Array, qdd: Array, load: Array) -> Array:
        return (np.exp(THINNER * (warm - 20.0)) - 1.0)[:, None] * np.array([4.0, 0.0]) * qd

    log = spoiled_drives.make_log(tmp_path, thin)
    log.columns["warm"] = warm  # type: ignore[index]
    text = logged_arm.IDENTIFY.replace('effort = { column = "t1" }', f'effort = {{ column = "t1" }}\n{WARM}')
    (one,) = list_chosen(spoiled_drives.fit_log(tmp_path, log, text))
    assert (one.joint, one.term) == ("shoulder", "viscous per kelvin")
    # To first order: over 30 K the exponential bends by a quarter.
    assert abs(one.size - THINNER) < 3.0 * one.evidence.errors[0] + 0.25 * abs(THINNER)


def make_line(noise: Array, slope: float) -> tuple[Terms, list[Array]]:
    """Return residuals of one channel (counted,) with nothing that explains them, and a column that does by ``slope``."""
    x = np.random.default_rng(3).normal(size=(len(noise), 1))
    part = np.repeat(np.arange(10.0), len(noise) // 10)
    none = np.zeros((len(noise), 0))
    empty = Terms(None, np.zeros(0), np.zeros((0, 0)), (none,), (noise + slope * x[:, 0],), (part,), np.ones(1))  # type: ignore[arg-type]
    terms = add_columns(empty, [np.zeros((len(noise), 1))])
    return terms, [terms.weights[0] * x]


def test_the_gain_is_that_of_the_parts_left_out(tmp_path: Path) -> None:
    """By hand: the slope of nine parts tells the tenth, and white noise counts sample by sample."""
    noise = np.random.default_rng(4).normal(size=400)
    terms, (x,) = make_line(noise, 0.5)
    evidence = judge_term(terms, [x])
    y = terms.residuals[0]
    held = np.concatenate([
        y[rows] - x[rows, 0] * (x[~rows, 0] @ y[~rows]) / (x[~rows, 0] @ x[~rows, 0])
        for rows in (np.arange(400) // 40 == k for k in range(10))
    ])  # fmt: skip
    most = 0.5 * 400 * np.log((y @ y) / (held @ held))
    assert 0.8 * most < evidence.gain <= most * (1.0 + 1e-9)  # neighbours of noise that agree by chance count as one
    assert abs(evidence.sizes[0] - (x[:, 0] @ y) / (x[:, 0] @ x[:, 0])) < 1e-6


def test_chance_makes_no_evidence() -> None:
    """Of 200 columns that explain nothing the gain passes `EVIDENCE` with a chance of 200 times 2e-4, and is mostly below 0."""
    random = np.random.default_rng(5)
    terms, _ = make_line(random.normal(size=400), 0.0)
    gains = [judge_term(terms, [random.normal(size=(400, 1))]).gain for _ in range(200)]
    assert max(gains) < EVIDENCE
    assert np.median(gains) < 0.0
