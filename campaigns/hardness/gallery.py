"""Every motion of every mechanism of models/: efforts of libraries for other processors beside those of this one's library."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np

import flexinv
from campaigns.exported import EXCEPTIONS, MOST_CALLS, list_gallery
from campaigns.hardness.processors import MARCHED, RIGID, RUNS
from crosscheck.engines.flexinv_c.adapter import plan_case
from crosscheck.engines.flexinv_c.program import make_linked_program
from flexinv.errors import InputError
from flexinv.export.machine_code import NATIVE, TARGETS
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

LEAST_CALLS = 20


def list_gallery_rows(scale: float) -> Iterator[str]:
    """Yield lines about the efforts of other processors beside this one's [-], at every motion of every mechanism of models/."""
    calls = max(int(scale * MOST_CALLS), LEAST_CALLS)
    for name, mechanism, cases in list_gallery(""):
        for case in cases.values():
            try:
                answers = list_answers(case.meshed(mechanism), case, calls)
            except InputError as refusal:
                yield f"{name}/{case.name}: {'' if name in EXCEPTIONS else 'WRONG: '}not exported: {refusal}"
                continue
            yield f"{name}/{case.name}: {describe_differences(answers, RIGID if mechanism.is_rigid else MARCHED)}"


def list_answers(mechanism: Mechanism, case: Case, calls: int) -> dict[str, Array]:
    """Return the efforts (calls, nv) of the first calls of a case [N m], [N], by the processor of the library."""
    plan = plan_case(mechanism, case)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "library"
        made = flexinv.export_c(mechanism, folder, tuple(TARGETS), **asdict(plan.settings))
        programs = {t: make_linked_program(mechanism, folder, made.name, t, RUNS.get(t, ())) for t in TARGETS}
        return {t: np.array(one.ask(plan.questions[:calls])) for t, one in programs.items()}


def describe_differences(answers: dict[str, Array], allowed: float) -> str:
    """Return by how much the efforts (calls, nv) of each processor differ from this one's, in parts of the largest [-]."""
    expected = answers[NATIVE]
    most = float(np.abs(expected).max()) or 1.0
    apart = {t: float(np.abs(one - expected).max()) / most for t, one in answers.items() if t != NATIVE}
    wrong = [t for t, one in apart.items() if not one <= allowed]
    said = ", ".join(f"{t} {one:.1e}" for t, one in apart.items())
    return f"{len(expected)} calls, {said}{'; WRONG: ' + ', '.join(wrong) if wrong else ''}"
