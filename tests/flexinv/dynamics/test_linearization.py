"""The linearisation of a flexible mechanism, and where there is none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flexinv.dynamics.initial_state import begin_undeformed
from flexinv.dynamics.linearization import compute_matrices
from flexinv.dynamics.solver import Solver
from flexinv.errors import ConvergenceError
from flexinv.files.load_mechanism import load_mechanism
from flexinv.kernels.so3 import exp_so3
from flexinv.kinematics.mesh import build


@pytest.mark.parametrize("angle", [2.4, 2.6])  # [rad] on both sides of what an element may turn, 2.5
def test_an_element_that_turns_too_much_has_no_matrices(root: Path, angle: float) -> None:
    solver = Solver.build_for(build(load_mechanism(root / "models" / "flex_one_link")), set())
    joints = begin_undeformed(solver, np.zeros(1), np.zeros(1), np.zeros(1))
    solver.state.r[-1] = exp_so3(np.array([0.0, 0.0, angle]))
    if angle < 2.5:
        assert np.isfinite(compute_matrices(solver, joints).stiffness.toarray()).all()
        return
    with pytest.raises(
        ConvergenceError, match=r"link 'link', where it is linearised: element 0 turns by more than 2\.5 rad"
    ):
        compute_matrices(solver, joints)
