"""Base parameters: the sums that torques tell are told, also where single links are not."""

from __future__ import annotations

from pathlib import Path

import logged_arm
import numpy as np
import pytest
import spoiled_drives

from crosscheck.identification.estimation.base_parameters import BaseRow, list_base_rows
from crosscheck.identification.estimation.fit import Fit, fit
from crosscheck.identification.identify import read_machine
from crosscheck.identification.machine import Machine

# Of the true arm: second moments about the joints, the rotor of the first joint, and first moments.
UPPER = 0.1 + 5.0 * 0.2**2 + 0.3
FORE = 0.04 + 3.0 * 0.15**2
LENGTH = 0.4


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[Machine, Fit]:
    folder = tmp_path_factory.mktemp("base")
    terms = spoiled_drives.fit_log(folder, spoiled_drives.make_log(folder))
    return terms.machine, fit(terms.task, terms.z)


def test_the_arm_has_the_six_sums_of_a_double_pendulum(found: tuple[Machine, Fit]) -> None:
    """By hand, about y: I1 + rotor + m2 l^2, m1 c1 + m2 l and its z, I2, m2 c2 and its z; the second rotor is not free."""
    rows = list_base_rows(*found)
    assert len(rows) == 6
    heavy = next(row for row in rows if row.words.startswith("upper.Iyy"))
    assert heavy.low < UPPER + 3.0 * LENGTH**2 < heavy.high
    light = next(row for row in rows if row.words == "fore.Iyy")
    assert light.low < FORE < light.high
    moment = next(row for row in rows if row.words.startswith("upper.hx"))
    assert moment.low < 5.0 * 0.2 + 3.0 * LENGTH < moment.high
    assert moment.identifiable
    assert (moment.high - moment.low) < 0.05 * moment.value  # masses alone are known to a fifth


def test_their_errors_are_those_of_draws(found: tuple[Machine, Fit]) -> None:
    """Draws of z by the covariance scatter as the interval says: it is linear, and mass properties nearly are."""
    machine, known = found
    rows = list_base_rows(machine, known)
    random = np.random.default_rng(0)
    drawn = random.multivariate_normal(known.z, 1e-4 * known.covariance, 400)
    values = np.array([[row.value for row in list_base_rows(machine, Fit(*_replace_z(known, z)))] for z in drawn[:60]])
    for row, scatter in zip(rows, values.std(axis=0), strict=True):
        half = 1e-2 * 0.5 * (row.high - row.low) / 1.645
        assert 0.7 * half < scatter < 1.3 * half  # of 60 draws a standard deviation is known to a tenth


def _replace_z(known: Fit, z: np.ndarray) -> tuple[object, ...]:
    return (z, known.covariance, known.spread, known.agree, known.kappa, known.block, known.held, known.unsure)


def test_other_mechanisms_have_none(tmp_path: Path, found: tuple[Machine, Fit]) -> None:
    text = logged_arm.IDENTIFY.replace('"mass properties"', '"effort gain"')
    logged_arm.write_arm(tmp_path)
    (tmp_path / "identify.toml").write_text(text)
    assert list_base_rows(read_machine(tmp_path), found[1]) == list[BaseRow]()
