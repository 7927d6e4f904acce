"""A share of the campaign of public calls (`python campaigns/public_calls.py`), and whether its judge sees what is wrong."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest

from campaigns.dresses import KINDS, NOTHING
from campaigns.public_calls import Trial, judged, run, trial
from campaigns.public_entrances import Entrance, entrances
from flexinv import __all__ as public
from flexinv.errors import InputError

SHARE, SEED = 250, 1
# Names that are no calls of their own: results, which verbs make, and errors.
RESULTS = {
    "BaseParameters", "Batch", "ExportedLibrary", "Following", "LimitUse", "LinearModel", "Modes", "OptimizedMotion", "Regressor",
    "ResidualVibration", "Sensitivities", "Gradient", "ModeSlopes", "ShapedMotion", "SteadyModes", "TorqueDerivatives",
    "ConvergenceError", "FlexinvError", "InputError", "ModelWarning", "Case", "Load", "TorqueSummary", "__version__",
}  # fmt: skip


def test_a_share_of_the_calls_is_answered_or_refused_with_words() -> None:
    tally = Counter[str]()
    for one, outcome in run(SHARE, SEED):
        tally[outcome.word] += 1
        assert outcome.word in ("right", "refused"), f"{one.entrance.name}({one.words}): {outcome}"
    assert tally["right"] > SHARE / 6
    assert tally["refused"] > SHARE / 2


@pytest.mark.parametrize("entrance", entrances(), ids=[one.name for one in entrances()])
def test_the_clean_call_of_an_entrance_is_right(entrance: Entrance) -> None:
    """Else every refusal would do.  (`identify` has no log here: its answer is an error of the file.)"""
    if entrance.name == "crosscheck.identify":
        with pytest.raises(InputError, match=r"identify\.toml"):
            entrance.call(**entrance.clean)
        return
    assert judged(Trial(0, entrance, entrance.clean, entrance.clean, True, "clean")).word == "right"


def test_every_public_name_has_an_entrance() -> None:
    drawn = {one.name.split(".")[0].split(" ")[0] for one in entrances()}
    assert set(public) - RESULTS - drawn == set()
    assert {"crosscheck.compare", "crosscheck.assert_same", "crosscheck.identify", "crosscheck.lint"} <= {
        one.name for one in entrances()
    }


def test_a_number_is_one_call() -> None:
    one, other = trial(17, SEED), trial(17, SEED)
    assert (one.entrance.name, one.words) == (other.entrance.name, other.words)


def call(x: Any) -> Any:
    """Take what it is given, raise what Python raises, and forget what it was given where that is one number."""
    return float(np.asarray(x, dtype=float).sum()) if np.ndim(x) else 1.0


def outcome(given: Any, clean: Any, taken: bool = True) -> str:
    entrance = Entrance("planted", call)
    return judged(Trial(0, entrance, {"x": given}, None if clean is NOTHING else {"x": clean}, taken, "")).word


def test_the_judge_sees_what_is_wrong() -> None:
    numbers = np.array([1.0, 2.0])
    assert outcome(numbers.tolist(), numbers) == "right"
    assert outcome(np.ma.masked_array(numbers, [True, False]), NOTHING) == "nonsense"
    assert outcome(numbers + 1, numbers) == "nonsense"
    assert outcome(object(), NOTHING) == "nonsense"
    assert outcome(["x"], NOTHING) == "raw"

    def refuse(x: Any) -> Any:
        if isinstance(x, list):
            raise InputError("x: expected an array, got a list; write np.array(x)")
        return 1.0

    def speechless(x: Any) -> Any:
        raise InputError("no")

    for made, word in ((refuse, "lost"), (speechless, "raw")):
        one = Trial(0, Entrance("planted", made), {"x": [1.0]}, {"x": numbers}, True, "")
        assert judged(one).word == word


def test_dresses_stand_for_what_numpy_reads() -> None:
    """A dress that has to be taken has a clean value of the same numbers."""
    random = np.random.default_rng(1)
    for dress in KINDS["numbers"]:
        given, clean = dress.make(np.array([0.5, 1.0, -1.5]), random)
        if dress.taken:
            np.testing.assert_array_equal(np.asarray(given, dtype=float), clean, err_msg=dress.name)
