"""The paper's incremental mode on its first example: the torque error over the number of steps."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import NotRequired, TypedDict

import numpy as np

from crosscheck.measures.limits import Verdict
from crosscheck.measures.mechanisms import read_mechanism
from crosscheck.verdicts.study_table import StudyPlot, StudyTable
from flexinv.analysis.solve import solve
from flexinv.files.load_cases import Case, load_cases
from flexinv.kinematics.nodal_motion import ORDER
from flexinv.model.mechanism import Mechanism
from flexinv.rigid.joint_torques import joint_torques

STEPS = (10, 20, 50, 100, 200, 400)  # the paper's, and two more in which the leading term of the error stands alone
# cases of the paper's motion
MODEL = "rigid_3r"
LAWS = ("cycloid", "quintic")
# The one-sided formulas at the ends have an error c h^2 (1 + h / T + ...) with the motion's time scale T = 1 / (2 pi) s.
# From h = 1/200 to 1/400 s that makes the observed order log2((1 + 0.031) / (1 + 0.016)) = 0.02 larger or smaller.
SLACK = 0.02

TEXT = f"""The paper takes accelerations from differences of nodal positions between successive steps. Its own first
example, the rigid arm with three links (q from 0 to 90, -60, 45 degrees in 1 s), against the exact torque on the same
samples: the largest difference of any joint over the range of the largest torque.

The difference formulas are central inside and one-sided at the ends, all of order {ORDER} in the step: from
{STEPS[-2]} to {STEPS[-1]} steps the observed order has to be {ORDER} to within {SLACK}. Few steps may fall faster: the
cycloid's fourth derivative is zero at its ends, so the one-sided formulas are of order 3 there."""

COLUMNS = (
    ("law", "time law", ""),
    ("steps", "steps", ""),
    ("error", "largest error", "of the range"),
    ("rms", "RMS error", "of the range"),
    ("order", "observed order", ""),
)


PLOT: StudyPlot = {"x": "steps", "y": "error", "group": "law", "log": True}


class StepsRow(TypedDict):
    """A line of the table: errors over the range of the torque [-], and the order [-] observed from the line before."""

    law: str
    steps: int
    error: float
    rms: float
    order: float | None
    verdict: Verdict
    message: NotRequired[str]


def run_study(models: str) -> StudyTable:
    """Return the table of the report; errors over the range of the torque [-]."""
    folder = Path(models) / MODEL
    if not folder.is_dir():
        return {"status": "skipped", "message": f"there is no {MODEL} among the models"}
    mechanism = read_mechanism(folder)
    cases = [case for name, case in load_cases(folder, mechanism).items() if name in LAWS]
    rows = [row for case in cases for row in list_case_rows(mechanism, case)]
    return {"text": TEXT, "columns": COLUMNS, "rows": rows, "plot": PLOT}


def list_case_rows(mechanism: Mechanism, case: Case) -> list[StepsRow]:
    """Return one row per number of steps; errors over the range [-]."""
    errors = [compute_incremental_error(mechanism, case, steps) for steps in STEPS]
    orders = [None] + [
        compute_observed_order(*pair) for pair in pairwise(zip(STEPS, (e for e, _ in errors), strict=True))
    ]
    rows: list[StepsRow] = [
        {"law": case.name, "steps": n, "error": e, "rms": rms, "order": p, "verdict": "within"}
        for n, (e, rms), p in zip(STEPS, errors, orders, strict=True)
    ]
    final = orders[-1]
    if final is None or not abs(final - ORDER) <= SLACK:
        rows[-1] |= {"verdict": "deviation", "message": f"observed order {final}, expected {ORDER}"}
    return rows


def compute_incremental_error(mechanism: Mechanism, case: Case, steps: int) -> tuple[float, float]:
    """Return the largest and the RMS error of the incremental mode with so many steps, over the torque's range [-]."""
    solution = solve(mechanism, case.motion, case.motion.duration / steps, incremental=True)
    exact = joint_torques(mechanism, solution.q, solution.qd, solution.qdd)
    difference = (solution.torque_all - exact) / np.ptp(exact, axis=0).max()
    worst = int(np.abs(difference).max(axis=0).argmax())
    return float(np.abs(difference).max()), float(np.sqrt(np.mean(difference[:, worst] ** 2)))


def compute_observed_order(coarse: tuple[int, float], fine: tuple[int, float]) -> float:
    """Return ``log(e_coarse / e_fine) / log(n_fine / n_coarse)`` [-] of two (steps, error)."""
    return float(np.log(coarse[1] / fine[1]) / np.log(fine[0] / coarse[0]))
