"""Stiffness of a drive by its two encoders: errors hold what parts of a log differ by, and what cannot be told is said."""

from __future__ import annotations

import logged_arm
import numpy as np
import pytest

import crosscheck
from crosscheck.identification.causes.encoders import TWIST, compare_encoders
from crosscheck.identification.logs.log import Log, read_log
from flexinv.typing import Array

STIFF = 2e4  # [N m/rad]


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> tuple[crosscheck.Identification, Log, Array]:
    """The arm with a second encoder at the shoulder, a log of it, and what passes its gear there [N m]."""
    folder = tmp_path_factory.mktemp("encoders") / "models" / "arm"
    logged_arm.write_arm(folder)
    text = (folder / "identify.toml").read_text()
    angle = 'angle = { column = "q1" }'
    (folder / "identify.toml").write_text(text.replace(angle, f'{angle}\nlink_angle = {{ column = "link1" }}'))
    table = logged_arm.frame(folder, 1)
    rate = np.gradient(table["q1"], 0.004)
    load = table["t1"] - 0.3 * np.gradient(rate, 0.004) - 4.0 * rate - 2.0 * np.tanh(rate / 0.02)
    table["link1"] = table["q1"]
    table.to_csv(folder / "log.csv", index=False)
    return crosscheck.identify(folder, [folder / "log.csv"], days="one"), read_log(folder / "log.csv"), load.to_numpy()


def spoil(arm: tuple[crosscheck.Identification, Log, Array], flexibility: Array) -> Log:
    """Return the log whose link angle is behind by a flexibility (samples,) [rad/(N m)] times the load less its mean."""
    _, log, load = arm
    noise = 1e-5 * np.random.default_rng(2).normal(size=len(load))
    link = log.columns["q1"] - flexibility * (load - load.mean()) + noise
    return Log(log.name, log.time, log.columns | {"link1": link})


def test_parts_of_a_log_that_differ_widen_the_error(arm: tuple[crosscheck.Identification, Log, Array]) -> None:
    """A drive that is a tenth softer in the second half of the log: the scatter alone is too sure."""
    result, log, load = arm
    soft = np.where(log.time > log.time.mean(), 1.1, 1.0) / STIFF
    sizes = []
    for flexibility in (np.full(len(load), 1.0 / STIFF), soft):
        (twist,) = (
            o for o in compare_encoders(result.machine, result.fit, spoil(arm, flexibility)).named if o.name == TWIST
        )
        sizes.append((twist.size, twist.error))
    (size, error), (other, wide) = sizes
    assert abs(size - STIFF) < 3.0 * error + 0.05 * STIFF
    assert wide > 3.0 * error
    assert STIFF / 1.1 - 3.0 * wide < other < STIFF + 3.0 * wide


def test_a_stiffness_that_no_twist_shows_cannot_be_told(arm: tuple[crosscheck.Identification, Log, Array]) -> None:
    result, _, load = arm
    found = compare_encoders(result.machine, result.fit, spoil(arm, np.zeros(len(load))))
    assert TWIST not in {one.name for one in found.named}
    (words,) = found.untold
    assert words.startswith(f"{TWIST} of shoulder: it cannot be told from this log")
