"""Faults planted in a log are named first, with their size; nothing is named where there is none."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import logged_arm
import numpy as np
import planted_faults
import pytest
from once import made_once

import crosscheck
from crosscheck.identification.causes.cause import NamedCause
from crosscheck.identification.causes.encoders import DELAY, SCALE, TWIST
from crosscheck.identification.causes.name_causes import UNKNOWN, find_causes, find_remaining_causes
from crosscheck.identification.causes.signals import list_broken_columns
from crosscheck.identification.identify import Identification, read_machine, read_of
from crosscheck.identification.logs.log import Log, read_log
from crosscheck.identification.parameters import KINDS
from crosscheck.identification.readings import apply_delay, apply_first_order_lag
from flexinv.typing import Array

STIFF, LATER = 2e4, 0.003  # [N m/rad], [s] of the link angle


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> tuple[Identification, Log]:
    """The arm identified on one log, and another log of it, with a second encoder at the shoulder."""

    def make(home: Path) -> None:
        (home / "known").write_bytes(pickle.dumps(identify_arm(home / "models" / "arm")))

    return pickle.loads((made_once(tmp_path_factory, "arm", make) / "known").read_bytes())  # type: ignore[no-any-return]


def identify_arm(folder: Path) -> tuple[Identification, Log]:
    """Write logs of the arm into a folder; return what one tells, and the other."""
    logged_arm.write_arm(folder)
    text = (folder / "identify.toml").read_text()
    angle = 'angle = { column = "q1" }'
    (folder / "identify.toml").write_text(text.replace(angle, f'{angle}\nlink_angle = {{ column = "link1" }}'))
    for seed, name in enumerate(("one", "two")):
        table = logged_arm.frame(folder, seed)
        rotor = 0.3 * np.gradient(np.gradient(table["q1"], 0.004), 0.004)
        passed = table["t1"] - rotor - 4.0 * np.gradient(table["q1"], 0.004)
        passed -= 2.0 * np.tanh(np.gradient(table["q1"], 0.004) / 0.02)
        table["link1"] = apply_delay(table["q1"].to_numpy() - passed.to_numpy() / STIFF, 0.004, LATER)
        table.to_csv(folder / f"{name}.csv", index=False)
    return crosscheck.identify(folder, [folder / "one.csv"], days="one"), read_log(folder / "two.csv")


def changed(log: Log, column: str, values: Array) -> Log:
    return replace(log, columns={**log.columns, column: values})


def without_encoder(log: Log) -> Log:
    return replace(log, columns={k: v for k, v in log.columns.items() if k != "link1"})


def test_nothing_is_named_on_an_untouched_log(known: tuple[Identification, Log]) -> None:
    result, log = known
    assert find_causes(result, without_encoder(log)) == []


def test_motor_and_link_angle_disagree_by_twist_and_delay(known: tuple[Identification, Log]) -> None:
    result, log = known
    named = {one.name: one for one in find_causes(result, log)}
    assert set(named) == {TWIST, DELAY}
    assert named[TWIST].size == pytest.approx(STIFF, rel=0.05)
    assert named[DELAY].size == pytest.approx(LATER, rel=0.05)
    assert abs(named[DELAY].size - LATER) < 5.0 * named[DELAY].error


SPOIL: dict[str, Callable[[Array], Array]] = {
    "constant": lambda v: 1.3 * v,
    "delay": lambda v: apply_delay(v, 0.004, 0.008),
    "lag": lambda v: apply_first_order_lag(v, 0.004, 0.005),
    "sign": lambda v: -v,
    "thousand": lambda v: 1e3 * v,
    "steps": lambda v: 0.5 * np.round(v / 0.5),
    "clipped": lambda v: np.minimum(v, np.quantile(v, 0.9)),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "place", "column", "spoiled", "size"),
    [
        ("torque constant, relative error", "shoulder", "t1", "constant", 0.3),
        ("delay of the effort", "elbow", "t2", "delay", 0.008),
        ("delay of the angle", "shoulder", "q1", "delay", 0.008),
        ("first-order lag of the effort", "shoulder", "t1", "lag", 0.005),
        ("wrong sign of the effort", "elbow", "t2", "sign", -1.0),
        ("wrong sign of the angle", "shoulder", "q1", "sign", -1.0),
        ("wrong unit of the effort", "shoulder", "t1", "thousand", 1e3),
        ("quantisation of the effort", "shoulder", "t1", "steps", 0.5),
        ("clipped effort", "shoulder", "t1", "clipped", None),
    ],
)
def test_a_planted_fault_is_named_first_with_its_size(
    known: tuple[Identification, Log], name: str, place: str, column: str, spoiled: str, size: float | None
) -> None:
    """To a tenth: neighbours below 10 Hz, a delay and a lag, differ by their second order only."""
    result, log = known
    values = SPOIL[spoiled](log.columns[column])
    size = float(values.max()) if size is None else size
    first = find_causes(result, without_encoder(changed(log, column, values)))[0]
    assert (first.name.split(", the column")[0], first.place) == (name, place)
    assert first.size == pytest.approx(size, rel=0.1)
    assert name in first.words


@pytest.mark.slow
def test_efforts_that_all_come_late_are_one_cause(known: tuple[Identification, Log]) -> None:
    """A filter of the whole drive amplifier delays every joint: one name, and not one of each joint."""
    result, log = known
    late = log
    for column in ("t1", "t2"):
        late = changed(late, column, apply_delay(log.columns[column], log.spacing, 0.008))
    (only,) = find_causes(result, without_encoder(late))
    assert (only.name, only.place) == ("delay of the efforts", "all joints")
    assert only.size == pytest.approx(0.008, rel=0.1)


@pytest.mark.slow
def test_a_payload_forgotten_on_the_last_link_is_named(known: tuple[Identification, Log]) -> None:
    """That link has one body alone, as every link of a URDF: the payload is looked for on the line through its centre of mass."""
    result, log = known
    payloads = [one for one in planted_faults.planted(result, without_encoder(log)) if one.name.startswith("payload")]
    payload = payloads[0]
    assert payload.place.endswith(", at its centre of mass")
    good, words = planted_faults.verdict(payload, find_causes(result, payload.log), set())
    assert good, words


@pytest.mark.slow
def test_a_motion_that_no_solver_can_follow_is_no_hypothesis(root: Path) -> None:
    """The beams of a measured arm roll up along an angle in another unit; the sign of an effort is found all the same.

    What needs no march of the beams is free here: drives and sensors.
    """
    folder = root / "models" / "quanser_2dsfl"
    part, known = f"{folder / 'record.csv'}@0:5", read_machine(folder)
    free = tuple(one for one in known.settings.free if not KINDS[one.parameter].solved)
    identification = crosscheck.identify(
        known.mechanism, [part], settings=known.settings.model_copy(update={"free": free})
    )
    log = read_of(identification.machine, part)
    column = identification.machine.channels[0].column
    first = find_causes(identification, changed(log, column, -log.columns[column]))[0]
    assert (first.name, first.place) == ("wrong sign of the effort", "shoulder")


def test_the_campaign_plants_every_kind_and_judges_it(known: tuple[Identification, Log]) -> None:
    """What `python tests/shared/planted_faults.py` does with a real log: one of its faults, found and not found."""
    result, log = known
    every = {(one.name, one.place): one for one in planted_faults.planted(result, without_encoder(log))}
    kinds = {name for name, _ in every}
    assert {"delay of the effort", "first-order lag of the effort", "wrong sign of the effort"} <= kinds
    assert {"torque constant, relative error", "tilt of gravity"} <= kinds
    sign = every["wrong sign of the effort", "elbow"]
    named = find_causes(result, sign.log)
    assert planted_faults.verdict(sign, named, set())[0]
    assert not planted_faults.verdict(every["wrong sign of the effort", "shoulder"], named, set())[0]
    assert not planted_faults.verdict(sign, [], set())[0]


def test_swapped_columns_are_named(known: tuple[Identification, Log]) -> None:
    result, log = known
    for one, other, kind in (("t1", "t2", "efforts"), ("q1", "q2", "angles")):
        swapped = changed(changed(log, one, log.columns[other]), other, log.columns[one])
        named = find_causes(result, without_encoder(swapped))
        assert (named[0].name, named[0].place) == (f"swapped columns of the {kind}", "shoulder and elbow")
        assert len(named) == 1


def test_a_tilted_base_is_named_with_its_angle(known: tuple[Identification, Log], tmp_path: Path) -> None:
    """3 degrees about y, which both axes turn about; about x gravity leaves the plane by its cosine only."""
    result, log = known
    tilt = np.radians(3.0)
    tilted = f"gravity_m_per_s2 = [{-9.81 * np.sin(tilt)}, 0, {-9.81 * np.cos(tilt)}]"
    table = logged_arm.frame(tmp_path, 1, text=logged_arm.MECHANISM.replace("gravity_m_per_s2 = [0, 0, -9.81]", tilted))
    spoiled = replace(log, columns={name: table[name].to_numpy() for name in ("q1", "q2", "t1", "t2")})
    first = find_causes(result, spoiled)[0]
    assert (first.name, first.place) == ("tilt of gravity", "the world's y axis")
    assert abs(first.size) == pytest.approx(tilt, rel=0.15)


@pytest.fixture(scope="module")
def real(root: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Identification, Log, list[NamedCause]]:
    """The measured arm, its log, and what that shows as it is: found by one worker, and handed on as a pickle."""

    def make(home: Path) -> None:
        folder = root / "models" / "kuka_kr300"
        identification = crosscheck.identify(folder, [folder / "run_A.csv.gz"])
        log = read_log(folder / "run_A.csv.gz")
        (home / "known").write_bytes(pickle.dumps((identification, log, find_causes(identification, log))))

    return pickle.loads((made_once(tmp_path_factory, "kuka", make) / "known").read_bytes())  # type: ignore[no-any-return]


@pytest.mark.slow
def test_a_real_log_shows_its_two_encoders_and_no_more(real: tuple[Identification, Log, list[NamedCause]]) -> None:
    result, log, as_it_is = real
    assert {one.name for one in as_it_is} == {DELAY, TWIST, SCALE}
    assert {one.name for one in find_causes(result, log, seen=True)} == {one.name for one in as_it_is}
    later = {one.place: one.size for one in as_it_is if one.name == DELAY}
    assert all(
        size == pytest.approx(0.003, abs=2e-4) for size in later.values()
    )  # real: the link angles come 3 ms later
    column = "axis1_link_angle_rad"
    named = find_causes(result, changed(log, column, apply_delay(log.columns[column], log.spacing, 0.008)))
    size = next(one.size for one in named if (one.name, one.place) == (DELAY, "axis1"))
    assert size - later["axis1"] == pytest.approx(0.008, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("axis", [1, 3, 5])
@pytest.mark.parametrize(
    ("kind", "spoil", "size"),
    [("delay", apply_delay, 0.008), ("first-order lag", apply_first_order_lag, 0.005)],
    ids=["delay", "lag"],
)
def test_small_faults_in_a_real_log_are_seen_above_the_bandwidth(
    real: tuple[Identification, Log, list[NamedCause]], axis: int, kind: str, spoil: Callable[..., Array], size: float
) -> None:
    """Behind 10 Hz these are below evidence; above, the torque turns the motor's own inertia by whole radians too late."""
    result, log, as_it_is = real
    column = f"axis{axis}_motor_torque_Nm"
    named = find_causes(result, changed(log, column, spoil(log.columns[column], log.spacing, size)))
    assert (named[0].name, named[0].place) == (f"{kind} of the effort", f"axis{axis}")
    assert abs(named[0].size - size) < 3.0 * named[0].error + 0.05 * size  # an angle's own noise biases by some percent
    assert {one.name for one in named[1:]} <= {one.name for one in as_it_is}


@pytest.mark.slow
def test_what_would_hide_in_a_log_is_told(real: tuple[Identification, Log, list[NamedCause]]) -> None:
    """A fault twice as large as the least size that is told is named, one of a quarter is not."""
    result, log, _ = real
    told = {(one.name, one.place): one.size for one in find_remaining_causes(result, log).least}
    least = told["torque constant, relative error", "axis1"]
    for factor, seen in ((2.0, True), (0.25, False)):
        values = (1.0 + factor * least) * log.columns["axis1_motor_torque_Nm"]
        named = find_causes(result, changed(log, "axis1_motor_torque_Nm", values))
        assert (("torque constant, relative error", "axis1") in {(o.name, o.place) for o in named}) == seen
    assert told["delay of the effort", "axis1"] <= 0.002


@pytest.mark.parametrize("level", [0.0, -1.0])
def test_missing_samples_are_dropouts_also_at_an_extreme(known: tuple[Identification, Log], level: float) -> None:
    """Zeros in an effort that is negative throughout look like a limit, and a drive has none there; so do held values."""
    result, log = known
    values = -np.abs(log.columns["t1"]) - 2.0
    values[300:340] = level if level == 0.0 else values[300]
    (only,) = (
        one for one in list_broken_columns(result.machine, result.fit, changed(log, "t1", values)) if "drop" in one.name
    )
    assert (only.name, only.place) == ("dropouts of the effort", "shoulder")
    assert only.size == pytest.approx(40 / len(values), abs=1 / len(values))


def test_a_joint_that_stands_still_has_no_dropouts(known: tuple[Identification, Log]) -> None:
    """An encoder repeats its value while the joint stands, and creeps by a step of its own; a held one leaps when it goes on."""
    result, log = known
    column = result.machine.settings.joints["shoulder"].angle.column
    angle = log.columns[column]
    still = np.concatenate([angle, np.full(60, angle[-1]), [angle[-1] + 1e-6], np.full(60, angle[-1] + 1e-6)])[120:]
    held = angle.copy()
    fastest = int(np.argmax(np.abs(np.gradient(angle))[20:-20]))
    held[fastest : fastest + 20] = held[fastest]

    def list_dropouts(values: np.ndarray) -> list[str]:
        breaks = list_broken_columns(result.machine, result.fit, changed(log, column, values))
        return [one.place for one in breaks if one.name == "dropouts of the angle"]

    assert list_dropouts(still[: len(angle)]) == []
    assert list_dropouts(held) == ["shoulder"]


@pytest.mark.parametrize(
    ("name", "size", "spoil"),
    [
        ("drift of the effort", 1.5, lambda v, ramp: v + 1.5 * ramp),
        ("drift of the torque constant, relative", 0.1, lambda v, ramp: v * (1.0 + 0.1 * ramp)),
        ("ripple of the angle, 1 a turn", 0.02, lambda v, ramp: v + 0.02 * np.sin(v + 0.5)),
        ("drift of the angle", 0.03, lambda v, ramp: v + 0.03 * ramp),
    ],
)
def test_what_changes_within_a_log_is_named_with_its_size(
    known: tuple[Identification, Log], name: str, size: float, spoil: Callable[[Array, Array], Array]
) -> None:
    """A ripple has sine and cosine of its own, which are one cause with the amplitude."""
    result, whole = known
    log = without_encoder(whole)
    joint = result.machine.channels[0].place
    column = (
        result.machine.settings.joints[joint].angle.column if "angle" in name else result.machine.channels[0].column
    )
    values = log.columns[column]
    plain = replace(
        result,
        machine=replace(
            result.machine,
            settings=result.machine.settings.model_copy(
                update={
                    "joints": {
                        n: t.model_copy(update={"link_angle": None}) for n, t in result.machine.settings.joints.items()
                    }
                }
            ),
        ),
    )
    found = find_causes(plain, changed(log, column, spoil(values, np.linspace(0.0, 1.0, len(values)))))
    assert [(one.name, one.place) for one in found] == [(name, joint)]
    assert abs(found[0].size - size) < 3.0 * found[0].error + 0.05 * size


def test_neither_a_dead_band_nor_a_late_signal_has_dropouts(known: tuple[Identification, Log]) -> None:
    """A dead band is zero where the effort is small; zeros anywhere are missing samples, as are values that are held."""
    result, log = known
    effort = log.columns["t1"]

    def list_dropouts(values: Array) -> list[str]:
        breaks = list_broken_columns(result.machine, result.fit, changed(log, "t1", values))
        return [one.place for one in breaks if one.name == "dropouts of the effort"]

    small = np.abs(effort) < 0.1 * np.abs(effort).max()
    assert list_dropouts(np.where(small, 0.0, effort)) == []
    late = np.concatenate([np.full(20, effort[0]), effort[:-20]])
    assert list_dropouts(late) == []
    zeros = effort.copy()
    zeros[300:340] = 0.0
    held = effort.copy()
    held[300:340] = held[300]
    assert list_dropouts(zeros) == list_dropouts(held) == ["shoulder"]


def test_more_than_two_things_at_once_are_not_named(known: tuple[Identification, Log]) -> None:
    """Two are, with their sizes; a third one makes all of them unknown, in words that say what comes nearest."""
    result, whole = known
    log = without_encoder(whole)
    ramp = np.linspace(0.0, 1.0, len(log.time))
    two = changed(log, "t1", log.columns["t1"] * (1.0 + 0.1 * ramp))
    two = changed(two, "t2", two.columns["t2"] + 0.6)
    assert {one.name for one in find_causes(result, two)} == {
        "drift of the torque constant, relative",
        "offset of the effort",
    }
    three = changed(two, "q2", two.columns["q2"] + 0.05)
    found = find_causes(result, three)
    assert [one.name for one in found] == [UNKNOWN]
    assert "which is not enough" in found[0].evidence
