"""Searches of the fit: slopes are computed once at a place, and no step leads to where no machine can be marched."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import spoiled_drives

from campaigns.log_faults.machines import WORLDS, add_noise, run_machine, sample_motion, write_log
from campaigns.log_faults.trial import HERE
from crosscheck.identification.estimation import fit as fits
from crosscheck.identification.estimation.fit import Problem
from crosscheck.identification.identify import identify
from flexinv.typing import Array


def test_a_round_begins_with_the_slopes_of_the_one_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No two places that follow each other are the same one."""
    asked: list[bytes] = []
    compute = fits.compute_jacobian

    def compute_counted(task: Problem, z: Array) -> list[Array]:
        asked.append(z.tobytes())
        return compute(task, z)

    monkeypatch.setattr(fits, "compute_jacobian", compute_counted)
    spoiled_drives.fit_log(tmp_path, spoiled_drives.make_log(tmp_path))
    assert len(asked) > 3
    assert all(one != other for one, other in pairwise(asked))


@pytest.mark.slow
def test_no_step_leads_to_where_the_machine_cannot_be_marched(tmp_path: Path) -> None:
    """With wide priors the search tries an elastic drive of which a march makes energy, or whose mass is beyond all numbers."""
    world = WORLDS["elastic"]
    random = np.random.default_rng(101)
    record = add_noise(run_machine(world, sample_motion(world, random, moves=True)), world, random)
    found = identify(HERE / "models" / "elastic", [write_log("elastic", record, tmp_path / "A.csv")])
    (stiffness,) = (row for row in found.parameters if row.parameter == "joint stiffness")
    assert abs(stiffness.value / world.spring - 1.0) < 0.01
