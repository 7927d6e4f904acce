"""Payloads anywhere on a link, joints plugged the other way, what another fault leaves; tried as campaigns/log_faults does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from campaigns.log_faults.machines import WORLDS, Body, add_noise, run_machine, sample_motion, write_log
from campaigns.log_faults.trial import HERE, Row, run_row
from crosscheck.identification.causes.cause import NamedCause
from crosscheck.identification.identify import identify


def run_arm(seed: int, faults: str, motion: str = "sines") -> tuple[NamedCause, ...]:
    """Return what is named in a log of the arm with faults."""
    return run_row(Row(0, "arm", "same", motion, seed, faults, "")).named


@pytest.mark.parametrize(
    ("faults", "link", "mass", "place"),
    [
        # On the axis of the forearm, whose centre of mass is 7.6 degrees beside it.
        ("payload @ 1 0.3 0.35", "fore", 0.3, "at x = 0.35 m"),
        ("payload @ 0 0.8 0.2", "upper", 0.8, "at its centre of mass"),
    ],
)
def test_a_payload_is_named_where_it_is(faults: str, link: str, mass: float, place: str) -> None:
    """Its mass within three errors and a hundredth; nothing else is named beside it."""
    (only,) = run_arm(998888, faults)
    assert only.name == "payload beside what is known"
    assert only.place.startswith(f"{link}, {place}")
    assert abs(only.size - mass) < 3.0 * only.error + 0.01 * mass


def test_joints_that_were_plugged_the_other_way_are_one_cause() -> None:
    (only,) = run_arm(123, "swapped joints @ 0 0")
    assert (only.name, only.place) == ("swapped columns of the joints", "shoulder and elbow")


def test_a_spike_as_large_as_the_range_is_no_wrap() -> None:
    (only,) = run_arm(57, "effort spikes @ 0 300 1", "moves")
    assert only.name == "spikes of the effort"


def test_what_a_cause_leaves_is_no_further_one() -> None:
    """Friction by load is not quite what a gear loses: what remains once looked like a payload of 0.03 kg."""
    (only,) = run_arm(998888, "load friction @ 0 0.1", "moves")
    assert (only.name, only.place) == ("efficiency of the gear less one", "shoulder")


def test_a_payload_on_an_inner_link_is_the_difference_of_two_logs(tmp_path: Path) -> None:
    """The moment m x about the shoulder, 0.3 kg m, to a hundredth; of mass and place apart the intervals hold the truth.

    Efforts show m x and m x^2 + I, and I of a compact body is next to nothing: what is known before of its size decides.
    """
    random = np.random.default_rng(5)
    arm = WORLDS["arm"]
    side = 0.08
    cube = Body(0, 1.0, (0.3, 0.0), side**2 / 6.0)
    files = []
    for name, world in (("empty", arm), ("loaded", replace(arm, bodies=(*arm.bodies, cube)))):
        record = add_noise(run_machine(world, sample_motion(world, random, moves=False)), world, random)
        files.append(write_log("arm", record, tmp_path / f"{name}.csv"))
    found = identify(HERE / "models" / "arm", files[:1], payloads={"upper": files[1]})
    load = {row.parameter: row for row in found.parameters if row.place == "payload of upper"}
    assert load["mass"].identifiable
    assert load["mass"].value * load["com x"].value == pytest.approx(0.3, rel=0.01)
    assert load["mass"].low <= 1.0 <= load["mass"].high
    assert load["com x"].low <= 0.3 <= load["com x"].high
