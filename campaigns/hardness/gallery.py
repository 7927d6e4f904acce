"""Libraries for other processors beside this one's: every mechanism of models/ at its motions, and 30 random ones."""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Iterator
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np

import flexinv
from campaigns.exported import EXCEPTIONS, MOST_CALLS, Outcome, compare_random, list_gallery
from campaigns.hardness.processors import MARCHED, RIGID, RUNS
from crosscheck.engines.flexinv_c.adapter import plan_case
from crosscheck.engines.flexinv_c.program import make_linked_program
from flexinv.errors import ConvergenceError, FlexinvError, InputError
from flexinv.export.machine_code import NATIVE, TARGETS
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

LEAST_CALLS = 20  # of a case
RANDOM = 30
SEED = 1


def list_gallery_rows(scale: float) -> Iterator[str]:
    """Yield lines about the efforts of other processors beside this one's [-]: every motion of models/, 30 random mechanisms."""
    calls = max(int(scale * MOST_CALLS), LEAST_CALLS)
    of_gallery = (one for source in list_gallery("") for one in compare_processors(*source, calls, known=True))
    drawn = partial(compare_processors, calls=calls, known=False)
    for one in itertools.chain(of_gallery, compare_random(max(int(scale * RANDOM), 1), SEED, drawn)):
        yield f"{one.name}: {one.calls} calls, {one.difference:.1e}{'; WRONG: ' + one.wrong if one.wrong else ''}"


def compare_processors(
    name: str, mechanism: Mechanism, cases: dict[str, Case], calls: int, known: bool
) -> Iterator[Outcome]:
    """Yield what the libraries of each other processor answer at the cases of a mechanism, beside this one's.

    calls : of a case; known : a refusal is wrong, unless it stands in EXCEPTIONS
    """
    allowed = RIGID if mechanism.is_rigid else MARCHED
    for case in cases.values():
        try:
            answers = list_answers(case.meshed(mechanism), case, calls)
        except (InputError, ConvergenceError) as refusal:
            yield Outcome(
                f"{name}/{case.name}", 0, 0.0, f"refused: {refusal}" if known and name not in EXCEPTIONS else ""
            )
            continue
        except FlexinvError as error:
            yield Outcome(f"{name}/{case.name}", 0, np.inf, str(error))
            continue
        expected = answers.pop(NATIVE)
        most = float(np.abs(expected).max()) or 1.0
        for target, one in answers.items():
            apart = float(np.abs(one - expected).max()) / most
            wrong = "" if apart <= allowed else f"more than {allowed:g}"
            yield Outcome(f"{name}/{case.name} {target}", len(expected), apart, wrong)


def list_answers(mechanism: Mechanism, case: Case, calls: int) -> dict[str, Array]:
    """Return the efforts (calls, nv) of the first calls of a case [N m], [N], by the processor of the library."""
    plan = plan_case(mechanism, case)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "library"
        made = flexinv.export_c(mechanism, folder, tuple(TARGETS), **asdict(plan.settings))
        programs = {t: make_linked_program(mechanism, folder, made.name, t, RUNS.get(t, ())) for t in TARGETS}
        return {t: np.array(one.ask(plan.questions[:calls])) for t, one in programs.items()}
