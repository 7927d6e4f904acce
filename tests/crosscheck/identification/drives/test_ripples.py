"""Ripples: periods a turn of an effort that follows an angle are found and named; gravity and noise are none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import spoiled_drives

from crosscheck.identification.drives.evidence import TermEvidence
from crosscheck.identification.drives.ripples import Ripple, RippleScan, find_ripples

ORDER = 20
SIZE = 0.3  # [N m]


def scan_arm(folder: Path, order: float) -> list[RippleScan]:
    log = spoiled_drives.make_log(
        folder,
        lambda q, qd, qdd, load: np.column_stack([np.zeros(len(q)), SIZE * np.sin(order * q[:, 1] + 0.7)]),
    )
    return find_ripples(spoiled_drives.fit_log(folder, log))


def test_a_ripple_is_found_by_its_order(tmp_path: Path) -> None:
    """With the order within three of its errors and the steps of the scan, and its size within a tenth."""
    shoulder, elbow = scan_arm(tmp_path, ORDER)
    assert shoulder.found == ()
    (one,) = elbow.found
    apart = float(np.diff(elbow.orders)[0])
    assert abs(one.order - ORDER) < 3.0 * one.error + apart
    assert abs(one.amplitude - SIZE) < 0.1 * SIZE
    assert elbow.amplitudes.argmax() == np.abs(elbow.orders - one.order).argmin()


def test_nothing_follows_the_angle_where_nothing_does(tmp_path: Path) -> None:
    assert [scan.found for scan in scan_arm(tmp_path, 0.0)] == [(), ()]


@pytest.mark.parametrize(
    ("order", "error", "ratio", "said"),
    [
        (2.01, 0.1, 0.0, "twice a turn of the joint: an oval bearing"),
        (200.3, 1.0, 100.0, "twice a turn of the motor: the wave generator of a harmonic drive"),
        (49.9, 0.2, 50.0, "once a turn of the motor: an eccentric shaft"),
        (31.4, 0.05, 0.0, "31.4 a turn of the joint: teeth of a gear or belt"),
        (160.0, 0.5, 100.0, "160 a turn of the joint: teeth of a gear or belt"),
    ],
)
def test_an_order_is_named_by_what_turns_so(order: float, error: float, ratio: float, said: str) -> None:
    nothing = TermEvidence(10.0, 1.0, np.ones(2), np.ones(2))
    assert Ripple("elbow", order, error, SIZE, "N m", ratio, nothing).words.startswith(said)
