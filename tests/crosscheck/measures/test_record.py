"""Records survive the way to disk, and records that are not whole are refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crosscheck.arrays import write_arrays
from crosscheck.measures import record as r
from flexinv.model.mechanism import Joint, Link, Mechanism

TIME = np.linspace(0.0, 1.0, 11)


def example() -> r.Record:
    series = r.vector_series("tip/arm", "m", np.outer(np.sin(TIME), [1.0, 2.0, 3.0])) | r.series(
        "torque/shoulder", "N m", np.cos(TIME), error=np.full(11, 1e-3)
    )
    settings = {"step": 1e-4, "mesh": [4, 1]}
    return r.Record("an engine", version="1.2", settings=settings, time=TIME, series=series, wall_time=0.25)


def test_a_record_comes_back_from_disk_as_it_was(tmp_path: Path) -> None:
    given = example()
    r.save(given, tmp_path / "a.b")
    back = r.read_record(tmp_path / "a.b")
    assert r.compute_fingerprint(back) == r.compute_fingerprint(given)
    assert (back.settings, back.engine, back.wall_time) == (given.settings, given.engine, given.wall_time)
    for name, one in given.series.items():
        np.testing.assert_array_equal(back.series[name].values, one.values)
        assert back.series[name].unit == one.unit
    assert back.series["torque/shoulder"].error is not None


def test_a_file_has_the_arrays_that_were_given_and_no_objects(tmp_path: Path) -> None:
    """Not one more, which a keyword is that the oldest NumPy does not know; and nothing that is read back as a program."""
    write_arrays(tmp_path / "a.npz", {"time": TIME, "names": np.array(["a", "bc"])})
    with np.load(tmp_path / "a.npz", allow_pickle=False) as back:
        assert back.files == ["time", "names"]
        np.testing.assert_array_equal(back["time"], TIME)
    with pytest.raises(ValueError, match="'odd' holds objects"):
        write_arrays(tmp_path / "b.npz", {"time": TIME, "odd": np.array([object()])})
    assert not (tmp_path / "b.npz").exists()


def test_no_pickle_is_read(tmp_path: Path) -> None:
    r.save(example(), tmp_path / "a")
    np.savez(tmp_path / "a.npz", time=np.array([object()]), s0=np.zeros(1))
    with pytest.raises(r.RecordError, match="no record at"):
        r.read_record(tmp_path / "a")


@pytest.mark.parametrize("damage", ["absent", "cut off", "words missing", "not JSON"])
def test_a_damaged_record_is_named(tmp_path: Path, damage: str) -> None:
    stem = tmp_path / "a"
    r.save(example(), stem)
    if damage == "absent":
        stem.with_suffix(".npz").unlink()
    elif damage == "cut off":
        stem.with_suffix(".npz").write_bytes(stem.with_suffix(".npz").read_bytes()[:200])
    elif damage == "words missing":
        stem.with_suffix(".json").write_text(json.dumps({"engine": "x"}))
    else:
        stem.with_suffix(".json").write_text("{")
    with pytest.raises(r.RecordError, match="no record at"):
        r.read_record(stem)


def test_a_whole_record_passes_the_check_and_a_damaged_one_does_not() -> None:
    good = example()
    r.check(good, TIME)
    r.check(replace(good, status="error", series={}), TIME)
    with pytest.raises(r.RecordError, match=r"gives 5 of 11 samples and stops at t = 0.4 s of 1 s"):
        r.check(replace(good, time=TIME[:5]), TIME)
    with pytest.raises(r.RecordError, match="other sample times"):
        r.check(replace(good, time=TIME + 1e-6), TIME)
    with pytest.raises(r.RecordError, match="gives no series"):
        r.check(replace(good, series={}), TIME)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("where", ["values", "error"])
def test_values_that_are_not_finite_are_refused(value: float, where: str) -> None:
    good = example()
    one = good.series["torque/shoulder"]
    bad = np.cos(TIME)
    bad[4] = value
    series = {**good.series, one.name: replace(one, **{where: bad})}
    with pytest.raises(r.RecordError, match=r"torque/shoulder: 1 of 11 .* not finite, the first at t = 0.4 s"):
        r.check(replace(good, series=series), TIME)


def test_columns_have_to_fit() -> None:
    with pytest.raises(r.RecordError, match="2 names and 2 units"):
        r.make_column_series(["a", "b"], ["m", "m"], np.zeros((5, 3)))
    with pytest.raises(r.RecordError, match="error bars of shape"):
        r.make_column_series(["a"], ["m"], np.zeros((5, 1)), np.zeros(5))
    assert list(r.make_wrench_series("j", np.zeros((2, 6)))) == [f"wrench/j/{c}" for c in r.WRENCH]
    assert r.make_internal_series("b", "0.5", np.zeros((2, 6)))["internal/b/0.5/twist"].unit == "N m"


def test_efforts_have_the_units_of_their_joints() -> None:
    kinds = ("free", "prismatic", "revolute", "fixed", "universal", "spherical", "continuous")
    joints = tuple(Joint(k, k, "world", f"link {k}") for k in kinds)
    mechanism = Mechanism("m", tuple(Link(j.child) for j in joints), joints)
    expected = ["N"] * 3 + ["N m"] * 3 + ["N"] + ["N m"] * (1 + 2 + 3 + 1)
    assert list(r.list_effort_units(mechanism)) == expected
    torque = r.torque_series(mechanism, np.zeros((2, mechanism.nv)))
    assert torque["torque/prismatic"].unit == "N"


def test_a_fingerprint_changes_with_the_data_only() -> None:
    mechanism = Mechanism("m", (Link("a"),), (Joint("j", "revolute", "world", "a"),))
    same = Mechanism("m", (Link("a"),), (Joint("j", "revolute", "world", "a"),))
    other = Mechanism("m", (Link("a", tip=np.array([0.0, 0.0, 1e-12])),), mechanism.joints)
    assert r.compute_fingerprint(mechanism) == r.compute_fingerprint(same)
    assert r.compute_fingerprint(mechanism) != r.compute_fingerprint(other)
    assert r.compute_fingerprint([1.0, "1.0"]) != r.compute_fingerprint(["1.0", 1.0])


@pytest.mark.parametrize(
    ("what", "words"), [("status", "status 'great', expected one of ok"), ("message", "expected words")]
)
def test_a_record_says_how_it_went_in_the_known_words(what: str, words: str, tmp_path: Path) -> None:
    r.save(r.Record(engine="e", **{what: "great" if what == "status" else 3}), tmp_path / "r")
    with pytest.raises(r.RecordError, match=f"e gives the .*{words}"):
        r.read_record(tmp_path / "r")
