"""Faults of outside engines behind the three doors: a share of ``campaigns/door_faults.py``, and what its judge sees."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import door_faults as campaign
import pytest

# Every door; wrong by terms, by sign and in time; bars that are stated, and that refinements show; and a right answer.
SHARE = {
    "f003": ["refined"],
    "f004": ["wide"],
    "f005": ["refined"],
    "f006": ["wide"],
    "f007": ["none"],
    "f011": ["wide"],
    "f014": ["none"],
    # Another cause leaves less than the bars: shear of a five-hundredth looks like a softer beam, and bars hide a scale.
    "f107": ["wide"],
    "f145": ["slow"],
}


def test_the_list_has_all_doors_machines_and_bars() -> None:
    faults = campaign.read_faults()
    planted = [row for row in faults if row["fault"] != "none"]
    assert len(planted) >= 120
    assert {row["door"] for row in planted} == {"record", "command", "package"}
    assert {row["machine"] for row in planted} == {"arm", "pendulum", "loop", "strip", "boom"}
    bars = {bars for row in planted for bars in row["bars"].split()}
    assert bars == {"none", "honest", "wide", "narrow", "zero", "refined", "settling", "coarse", "slow", "restless"}
    assert all(row["expected"] == ("within" if row["fault"] == "none" else "refused") for row in faults)


def test_the_judge_of_the_campaign_sees_what_is_wrong() -> None:
    (fault,) = campaign.read_faults(("f006",))
    right = campaign.Result(fault, "none", "deviation", 0.3, 1e-6, ("gravity off : gravity is not applied",), "")
    assert right.problem == ""
    assert replace(right, names=()).problem == ""
    assert replace(right, names=("payload load: a payload is missing",)).problem.startswith("wrong name")
    assert replace(right, verdict="explained").problem == "accepted: explained"
    assert replace(right, verdict="within").problem == "accepted: within"
    assert replace(right, verdict="error", message="no column").problem == "not judged: error no column"
    (honest,) = campaign.read_faults(("f001",))
    assert replace(right, fault=honest, names=()).problem == "false alarm: deviation"


@pytest.mark.slow
def test_faults_behind_every_door_are_refused_and_named(tmp_path: Path) -> None:
    faults = [row | {"bars": " ".join(SHARE[row["id"]])} for row in campaign.read_faults(tuple(SHARE))]
    results = campaign.run(campaign.make_project(faults, tmp_path), faults)
    assert [one.problem for one in results] == [""] * len(SHARE), campaign.table(results)
