"""Arrays that are not plain floats of this machine: their numbers are right or an error, whatever was called before."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import flexinv

ARM = flexinv.load_mechanism(Path(__file__).resolve().parents[3] / "models" / "rigid_3r")
Q, QD, QDD = np.random.default_rng(1).uniform(-1, 1, (3, 3))
ASKED = flexinv.prepare(ARM)
RIGHT = ASKED.torques(Q, QD, QDD)


def unaligned(a: Any) -> Any:
    """The same numbers at an address that no float has."""
    return np.ndarray(a.shape, float, buffer=bytearray(b"\0" * 3 + a.tobytes()), offset=3)


class ForeignArray(np.ndarray):
    """An array of somebody else's kind."""


EQUAL: dict[str, Any] = {
    "plain": np.array,
    "list": np.ndarray.tolist,
    "tuple": tuple,
    "bytes reversed": lambda a: a.astype(">f8"),
    "unaligned": unaligned,
    "backwards": lambda a: a[::-1].copy()[::-1],
    "every second": lambda a: np.repeat(a, 2)[::2],
    "read-only": lambda a: np.frombuffer(a.tobytes()),
    "nothing masked": np.ma.masked_array,
    "objects": lambda a: a.astype(object),
    "longer": lambda a: a.astype(np.longdouble),
    "series": pd.Series,
    "of a kind": lambda a: a.view(ForeignArray),
}
WRONG: dict[str, tuple[Any, str]] = {
    "masked": (lambda a: np.ma.masked_array(a, [False, True, False]), "a masked array of which 1 are hidden"),
    "complex": (lambda a: a.astype(complex), "complex ones"),
    "dates": (lambda a: (1e9 * a).astype("M8[ns]"), "got dates; write seconds"),
    "spans": (lambda a: (1e9 * a).astype("m8[ns]"), "got spans of time; write seconds"),
    "texts": (lambda a: a.astype(str), "expected numbers"),
    "truths": (lambda a: a > 0, "True and False"),
    "nan": (lambda a: a * np.nan, "is nan, expected a finite number"),
    "in two dimensions": (lambda a: a[:, None], "has shape"),
    "too short": (lambda a: a[:2], "has shape"),
    "numbers and nothing": (lambda a: [*a[:2].tolist(), None], "expected numbers"),
}


@pytest.mark.reported("A2")
@pytest.mark.parametrize("place", range(3))
def test_numbers_are_numbers_whatever_was_called_before(place: int) -> None:
    """Numba keeps what it found of an array's kind, of which the order of bytes is no part: 1e89 after a first call."""
    for dress in itertools.chain.from_iterable(itertools.permutations(EQUAL, 2)):
        given: list[Any] = [Q, QD, QDD]
        given[place] = EQUAL[dress](given[place])
        out = np.zeros(3)
        assert ASKED.sample(*given, out) is out
        np.testing.assert_array_equal(out, RIGHT, err_msg=dress)
        np.testing.assert_array_equal(ASKED.torques(*given), RIGHT, err_msg=dress)


@pytest.mark.reported("A2")
@pytest.mark.parametrize("place", range(3))
@pytest.mark.parametrize("name", WRONG)
def test_what_are_no_numbers_is_refused(name: str, place: int) -> None:
    make, said = WRONG[name]
    given: list[Any] = [Q, QD, QDD]
    given[place] = make(given[place])
    for call in (lambda: ASKED.sample(*given, np.zeros(3)), lambda: ASKED.torques(*given)):
        with pytest.raises(flexinv.InputError, match=said):
            call()


@pytest.mark.parametrize(
    "out",
    [np.zeros(3, dtype=">f8"), np.zeros(3, dtype=np.float32), np.ma.masked_array(np.zeros(3)), [0.0] * 3],
)
def test_efforts_go_into_plain_floats_only(out: Any) -> None:
    with pytest.raises(flexinv.InputError, match="joint_torques: out "):
        ASKED.sample(Q, QD, QDD, out)


def test_a_controller_of_a_rigid_mechanism_takes_the_same() -> None:
    controller: Any = flexinv.Controller.of(ARM)
    np.testing.assert_array_equal(controller.step(Q, QD.astype(">f8"), QDD.tolist()), RIGHT)
    with pytest.raises(flexinv.InputError, match="a masked array"):
        controller.step(Q, QD, np.ma.masked_array(QDD, [True, False, False]))
