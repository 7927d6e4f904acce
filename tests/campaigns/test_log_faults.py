"""Faults of logs: a share of the campaign, and what its judge makes of every kind of answer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from campaigns.log_faults.answers import judge_causes
from campaigns.log_faults.machines import (
    ARM,
    ELASTIC,
    ENCODER_NOISE,
    SPACING,
    WORLDS,
    Body,
    compute_load,
    integrate_elastic_link,
    sample_motion,
)  # fmt: skip
from campaigns.log_faults.plants import LOGGER, MACHINE, parse_plants
from campaigns.log_faults.trial import HERE, make_record, read_rows, run_row
from crosscheck.identification.causes.cause import NamedCause
from flexinv.files.load_mechanism import load_mechanism
from flexinv.rigid.joint_torques import joint_torques

ROWS = {row.number: row for row in read_rows()}
# Of the pendulum, which is identified in the least time: untouched, offset, sign, clock, spikes that nobody has a name for.
SHARE = {1: "right", 27: "right", 35: "right", 147: "right", 55: "right"}


def name(cause: str, place: str, size: float, error: float = 0.0, alike: str = "") -> NamedCause:
    evidence = "the cost falls by 50" + (f"; next to as likely: {alike}" if alike else "")
    return NamedCause(cause, place, "", size, error, 50.0, evidence)


OFFSET = name("offset of the effort", "elbow", 0.5, 0.01)
DRAG = name("coulomb friction beside what is known", "shoulder", 0.2)
NOT_KNOWN = name("no cause that is known", "torque/elbow", 12.0)
PAYLOAD = name("payload beside what is known", "fore, 2.3 times as far out as its centre of mass", 1.0)
SLOW = name("slow clock, relative error", "the times", 0.1, alike="delay of the effort of elbow, 0.02 s")
LATE = "effort delay @ elbow = 0.02 s | angle delay @ elbow = -0.02 s"
TWO = "effort offset @ elbow = 0.5 N m; payload @ fore = 1 kg"


@pytest.mark.parametrize(
    ("right", "named", "other_day", "word"),
    [
        ("effort offset @ elbow = 0.5 N m", [OFFSET], False, "right"),
        ("effort offset @ elbow = 0.55 N m", [OFFSET], False, "right"),  # off by 0.05, allowed 3 * 0.01 + 5 % of 0.55
        ("effort offset @ elbow = 0.6 N m", [OFFSET], False, "wrong size"),
        ("effort offset @ elbow = 0.6 N m", [OFFSET], True, "right"),
        ("effort offset @ shoulder = 0.5 N m", [OFFSET], False, "wrong name"),
        ("effort offset @ elbow = 0.5 N m", [OFFSET, DRAG], False, "wrong name"),
        ("effort offset @ elbow = 0.5 N m", [OFFSET, DRAG], True, "right"),
        ("effort offset @ elbow = 0.5 N m + coulomb friction @ shoulder", [OFFSET, DRAG], False, "right"),
        ("backlash @ elbow = 0.1 rad", [NOT_KNOWN], False, "unknown"),
        ("backlash @ elbow = 0.1 rad", [], False, "silent"),
        ("nothing", [], False, "right"),
        ("nothing", [NOT_KNOWN], False, "wrong name"),
        ("nothing", [NOT_KNOWN], True, "unknown"),
        ("nothing", [OFFSET], False, "wrong name"),
        ("effort noise @ elbow | nothing", [], False, "right"),
        (TWO, [OFFSET], False, "in part"),
        (TWO, [OFFSET, PAYLOAD], False, "right"),
        (LATE, [name("delay of the efforts", "all joints", 0.02)], False, "right"),
        (LATE, [SLOW], False, "in set"),
        ("tilt @ y = 0.1 rad", [name("tilt of gravity", "the world's y axis", -0.1)], False, "right"),
        ("clock @ * = 1.25 -", [name("slow clock, relative error", "the times", -0.2)], False, "right"),
        ("effort gain @ elbow = 1.1 -", [name("torque constant, relative error", "elbow", 0.15)], False, "wrong size"),
    ],
)  # fmt: skip
def test_the_judge(right: str, named: list[NamedCause], other_day: bool, word: str) -> None:
    assert judge_causes(right, tuple(named), "", other_day).word == word


def test_a_refusal_is_right_where_the_log_deserves_it() -> None:
    assert judge_causes("refused | effort dropout @ elbow", (), "no number at 3 s", False).word == "right"
    assert judge_causes("clock @ * = 2 -", (), "sampled at -345 Hz", False).word == "wrong name"


def test_the_closed_form_is_inverse_dynamics() -> None:
    """Gravity, Coriolis and inertia of the arm's drawing by flexinv.joint_torques, from the same numbers, to rounding."""
    drawing = load_mechanism(HERE / "models" / "arm")
    as_drawn = replace(ARM, bodies=(Body(0, 5.6, (0.2, 0.0), 0.11), Body(1, 2.6, (0.15, 0.01), 0.04)))
    motion = sample_motion(ARM, np.random.default_rng(3), moves=False)
    load = compute_load(as_drawn, motion) + ARM.rotor * motion.acceleration
    effort = joint_torques(drawing, motion.angle, motion.rate, motion.acceleration, passive=False)
    assert np.abs(load - effort).max() < 1e-12 * np.abs(effort).max()


def test_the_elastic_gear_carries_the_load() -> None:
    """k (theta - q) + d (theta' - q') is the effort of the link on its own motion; splines differentiate that to 1e-3."""
    motor = sample_motion(ELASTIC, np.random.default_rng(3), moves=True)
    link = integrate_elastic_link(ELASTIC, motor)
    passed = ELASTIC.spring * (motor.angle - link.angle) + ELASTIC.damper * (motor.rate - link.rate)
    load = compute_load(ELASTIC, link)
    assert np.abs(passed - load).max() < 1e-3 * np.abs(load).max()


def test_every_kind_of_fault_changes_a_log() -> None:
    """Beside the same motion and noise without it, the largest change is above the noise of efforts, encoders or clocks."""
    rows = {plant.kind: (row, plant) for row in reversed(ROWS.values()) for plant in parse_plants(row.faults)}
    assert set(rows) == set(MACHINE) | set(LOGGER)
    for kind, (row, plant) in rows.items():
        record, good = (make_record(replace(row, faults=text)) for text in (row.faults, ""))
        if record.time.shape != good.time.shape or not np.isfinite(record.effort).all():
            continue  # lost rows and empty cells
        world = WORLDS[row.machine]
        off = [
            np.abs(record.effort - good.effort).max() / world.noise,
            np.abs(record.angle - good.angle).max() / ENCODER_NOISE,
            np.abs(record.time - good.time).max() / SPACING,
        ]
        assert max(off) > 2.0, (kind, plant)


def test_a_share_of_the_campaign() -> None:
    for number, word in SHARE.items():
        row = ROWS[number]
        trial = run_row(row)
        assert judge_causes(row.right, trial.named, trial.refused, row.day == "other").word == word, (row, trial.named)
