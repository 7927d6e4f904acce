"""The measured arm: models identified on one half of a record, real or made up, and judged on the other."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crosscheck.measured import arm
from crosscheck.measured.arm import Sensed
from crosscheck.measured.fit import identify
from crosscheck.measured.recording import Recording, read_recording
from crosscheck.report.html import environment, study_view
from crosscheck.studies import measured_arm
from crosscheck.studies.measured_arm import FLEXIBLE, MESH, RECORD, RIGID, SPLITS, parts, together
from crosscheck.verdicts.results import Results, StudyRow
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Mechanism

PLANTED = {
    "reach 2": 0.06, "rotor 1": 0.12, "viscous 1": 2.5, "coulomb 1": 1.6, "offset 1": 0.1,
    "rotor 2": 0.004, "viscous 2": 0.12, "coulomb 2": 0.1, "offset 2": 0.004,
    "gain 1": 1.6, "zero 1": -0.0008, "slope 1": -0.003, "gain 2": 1.4, "zero 2": 0.0002, "slope 2": -0.0005,
}  # fmt: skip
CLAMPS = {"stiffness 1": 38.0, "damping 1": 0.3, "stiffness 2": 15.0, "damping 2": 0.05}
NOISE = (0.2, 0.01, 5e-4, 5e-4)  # [N m], [rad]: about half of what the models leave of the record


@pytest.fixture(scope="module")
def record(root: Path) -> Recording:
    return read_recording(root / "models" / FLEXIBLE / RECORD, arm.COLUMNS)


@pytest.fixture(scope="module")
def flexible(root: Path) -> Mechanism:
    return load_mechanism(root / "models" / FLEXIBLE)


@pytest.fixture(scope="module")
def rigid(root: Path) -> Mechanism:
    return load_mechanism(root / "models" / RIGID)


def sensors_only(
    mechanism: Mechanism, seen: tuple[Sensed, ...], flexible: Mechanism
) -> tuple[arm.Predict, tuple[arm.Parameter, ...]]:
    """The rigid arm as it is in its file: only the parameters of drives and gauges are open, and nothing is solved anew."""
    predict = arm.predictor(mechanism, seen, arm.flexibilities(flexible))
    return (lambda value: predict({"reach 2": PLANTED["reach 2"], **value})), arm.of_sensors()


def test_planted_parameters_of_sensors_come_back(record: Recording, rigid: Mechanism, flexible: Mechanism) -> None:
    """Readings of the rigid arm with planted friction, offsets and gains, and white noise: found to within four deviations."""
    seen = parts(record, (0,), rigid)
    predict, open_ = sensors_only(rigid, seen, flexible)
    noise = np.random.default_rng(5).normal(size=(seen[0].part.size, 4)) * NOISE
    fit = identify(predict, predict(PLANTED) + noise, together(seen, "used"), open_, 60)
    for name, value in fit.value.items():
        assert abs(value - PLANTED[name]) < 4.0 * fit.uncertainty[name]  # one of 14 beyond it: once in a thousand times
        assert fit.uncertainty[name] > 0.0


def test_a_shuffled_record_is_not_explained(record: Recording, rigid: Mechanism, flexible: Mechanism) -> None:
    """The same prediction explains most of the unseen half, and nothing of the same numbers in another order."""
    seen, unseen = parts(record, (0,), rigid), parts(record, (2,), rigid)
    predict, open_ = sensors_only(rigid, seen, flexible)
    fit = identify(predict, together(seen, "measured"), together(seen, "used"), open_, 60)
    predicted = sensors_only(rigid, unseen, flexible)[0](fit.value)
    measured = together(unseen, "measured")
    shuffled = np.random.default_rng(6).permutation(measured)
    for k in range(4):
        assert measured_arm.explained(measured[:, k], predicted[:, k]) > 0.7
        assert measured_arm.explained(shuffled[:, k], predicted[:, k]) < 0.0


@pytest.mark.slow
def test_planted_parameters_of_the_flexible_arm_come_back(record: Recording, flexible: Mechanism) -> None:
    planted = PLANTED | CLAMPS
    seen = parts(record, (0,), flexible)
    predict = arm.predictor(flexible.with_mesh(*MESH), seen, arm.flexibilities(flexible))
    noise = np.random.default_rng(7).normal(size=(seen[0].part.size, 4)) * NOISE
    open_ = (*arm.mechanical(True), *arm.of_sensors())
    fit = identify(predict, predict(planted) + noise, together(seen, "used"), open_, 60)
    for name, value in fit.value.items():
        assert abs(value - planted[name]) < 4.0 * fit.uncertainty[name]


@pytest.mark.slow
def test_the_model_holds_what_was_identified(record: Recording, flexible: Mechanism) -> None:
    """The mechanism file has the values of the second split's seen half, to half a unit of the digits that it writes."""
    seen = parts(record, SPLITS[1].seen, flexible)
    predict = arm.predictor(flexible.with_mesh(*MESH), seen, arm.flexibilities(flexible))
    open_ = (*arm.mechanical(True), *arm.of_sensors())
    fit = identify(predict, together(seen, "measured"), together(seen, "used"), open_, 62)
    written = {
        **{f"stiffness {k}": flexible.joint_of[name].stiffness for k, name in enumerate(arm.CLAMPS, 1)},
        **{f"damping {k}": flexible.joint_of[name].damping for k, name in enumerate(arm.CLAMPS, 1)},
        **{f"rotor {k}": flexible.joint_of[name].rotor_inertia for k, name in enumerate(arm.DRIVES, 1)},
        **{f"viscous {k}": flexible.joint_of[name].damping for k, name in enumerate(arm.DRIVES, 1)},
        "reach 2": flexible.joint_of["clamp2"].placement.position[0],
    }
    for name, value in written.items():
        # Where least squares stop, a tenth of the uncertainty off at most, and the two digits that are written.
        assert abs(value - fit.value[name]) < 0.1 * fit.uncertainty[name] + 0.01 * abs(value)


# ------------------------------------------------------------------------------------------------------- the study


def row(model: str, explained: float, signal: int = 1) -> dict[str, object]:
    return {"model": model, "signal": arm.CHANNELS[signal][0], "explained": explained, "deviation": 0.01}


@pytest.mark.parametrize(
    ("rigid_share", "flexible_share", "verdict"),
    [
        (0.91, 0.98, "within"),
        (0.91, 0.90, "deviation"),  # below its floor
        (0.97, 0.96, "within"),  # worse than the rigid one, but not beyond both deviations
        (0.99, 0.96, "deviation"),
        (0.91, float("nan"), "deviation"),
    ],
)
def test_verdicts(rigid_share: float, flexible_share: float, verdict: str) -> None:
    rows = measured_arm.judged(SPLITS[1], [row("rigid", rigid_share), row("flexible", flexible_share)])
    assert rows[0]["verdict"] == "within"  # the rigid model is there to be compared with
    assert rows[1]["verdict"] == verdict


def test_without_its_models_the_study_is_skipped(tmp_path: Path) -> None:
    assert measured_arm.study(str(tmp_path))["status"] == "skipped"


@pytest.mark.slow
def test_the_rigid_model_of_the_study(record: Recording, rigid: Mechanism, flexible: Mechanism) -> None:
    """The figures of the README for the rigid model, to the last digit that it gives, and the rows that carry them."""
    split = SPLITS[1]
    found = measured_arm.outcome(rigid, record, split, arm.flexibilities(flexible))
    seen, unseen = (parts(record, which, rigid) for which in (split.seen, split.unseen))
    rows = list(measured_arm.table(split, "rigid", found, seen, unseen))
    assert [r["explained"] for r in rows] == pytest.approx([0.989, 0.914, 0.918, 0.878], abs=6e-4)
    assert {key for key, _, _ in measured_arm.COLUMNS} == set(rows[0])
    assert all(r["replay"] > 0.999 for r in rows)
    names = [f["title"] for f in measured_arm.figures(unseen[0], {"rigid": found})]
    assert names == [name for name, _ in arm.CHANNELS]


def test_figures_and_tables_are_on_the_page() -> None:
    wicked = "<img src=x onerror=alert(1)>"
    table = {
        "title": wicked,
        "columns": [("name", "name", ""), ("size", "size", "m")],
        "rows": [{"name": wicked, "size": 0.5}],
    }
    figure = {"title": wicked, "x": "time [s]", "y": "torque [N m]", "curves": {wicked: {"x": [0, 1], "y": [0.1, 0.2]}}}
    study = StudyRow(
        "s",
        "A study",
        rows=({"a": 1, "verdict": "within"},),
        columns=(("a", "a", ""),),
        figures=(figure,),
        tables=(table,),
    )
    view = study_view(Results("now"), study)
    text = environment().get_template("study.html.j2").render(**view)
    assert 'id="figure0"' in text
    assert 'id="studyfigures"' in text
    assert '<td class="number">0.5</td>' in text
    assert wicked not in text
    assert text.count("<table>") == 2
    bare = (
        environment()
        .get_template("study.html.j2")
        .render(**study_view(Results("now"), replace(study, figures=(), tables=())))
    )
    assert "figure0" not in bare
    assert bare.count("<table>") == 1
