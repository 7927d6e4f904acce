"""Records reach kernels at one address, whoever has made them, and nothing of them is lost on the way."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest

from flexinv.kernels.compiler.code_cache import make_jit_decorator
from flexinv.kernels.compiler.record_types import RecordType, resolve_argument_type
from flexinv.kernels.jit import jit_inner
from flexinv.kernels.records import join_records, send_by_address, take_record
from flexinv.typing import Array

called = make_jit_decorator(
    _nrt=False, no_cfunc_wrapper=True
)  # not kept on disk: what is kept asks for no inner kernel


@send_by_address
class Body(NamedTuple):
    mass: float
    fixed: bool
    place: Array


@send_by_address
class Pair(NamedTuple):
    first: Body
    gap: float
    second: Body


class ByValue(NamedTuple):
    mass: float
    place: Array


def body(mass: float) -> Body:
    return Body(mass, mass > 2.0, mass * np.arange(3.0))


PAIR = Pair(body(2.0), 0.5, body(3.0))
ADDRESS = "arg.one"


@jit_inner
def weight(one: Any) -> Any:
    return one.mass * one.place[2] + (100.0 if one.fixed else 0.0)


@jit_inner
def both(pair: Any) -> Any:
    return weight(pair.first) + pair.gap * weight(pair.second)


@called
def of_python(pair: Any) -> Any:
    return both(pair)


@called
def made_here(mass: float, place: Any, gap: float) -> Any:
    return both(Pair(Body(mass, False, place), gap, Body(mass + 1.0, True, place)))


@called
def made_of_given(pair: Any, gap: float) -> Any:
    return both(Pair(pair.second, gap, pair.first))


@called
def one_of_two(pair: Any, given: bool, place: Any) -> Any:
    return weight(pair.first if given else Body(1.0, False, place))


@called
def of_a_stack(stack: Any, number: int) -> Any:
    return weight(take_record(stack, number))


@called
def moved(one: Any, by: float) -> Any:
    for i in range(one.place.shape[0]):
        one.place[i] += by
    return weight(one)


WANTED = 2.0 * 4.0 + 0.5 * (3.0 * 6.0 + 100.0)


def test_a_record_of_python_arrives_whole() -> None:
    assert of_python(PAIR) == WANTED


def test_records_that_a_kernel_makes_arrive_whole() -> None:
    place = np.arange(3.0)
    assert made_here(2.0, place, 0.5) == 2.0 * 2.0 + 0.5 * (3.0 * 2.0 + 100.0)
    assert made_of_given(PAIR, 0.5) == (3.0 * 6.0 + 100.0) + 0.5 * 2.0 * 4.0


@pytest.mark.parametrize("given", [True, False])
def test_a_variable_may_be_a_record_of_either_origin(given: bool) -> None:
    assert one_of_two(PAIR, given, np.arange(3.0)) == (8.0 if given else 2.0)


def test_records_of_a_stack() -> None:
    stack = join_records([body(2.0), body(3.0)])
    assert [of_a_stack(stack, k) for k in range(2)] == [8.0, 118.0]


def test_what_lies_in_its_arrays_may_be_written() -> None:
    """The promise is made of the record, not of the arrays that it names."""
    one = body(2.0)
    assert moved(one, 1.0) == 2.0 * 5.0
    assert one.place.tolist() == [1.0, 3.0, 5.0]


def test_a_call_hands_over_one_address_with_its_promises() -> None:
    assert of_python(PAIR) == WANTED
    (signature,) = both.overloads
    assert [type(one) for one in signature] == [RecordType]
    (inner,) = (one.library for one in weight.overloads.values())
    (line,) = (one for one in str(inner._final_module).splitlines() if one.startswith("define") and "weight" in one)
    assert line.count("%") == 3  # result, error, record
    told = line.replace("captures(none)", "nocapture")  # as LLVM has written it before 21
    assert "noalias nocapture %arg.one" in told or "nocapture noalias %arg.one" in told


def test_other_named_tuples_go_by_value() -> None:
    from numba import typeof

    assert not isinstance(resolve_argument_type(typeof(ByValue(1.0, np.zeros(3)))), RecordType)
    assert isinstance(resolve_argument_type(typeof(body(1.0))), RecordType)


def test_types_are_told_apart_by_what_is_in_them_and_alike_in_all_processes() -> None:
    from numba import typeof

    plain, flat, short = (
        typeof(Body(1.0, True, np.zeros(n, kind))) for n, kind in ((3, float), ((3, 3), float), (3, "f4"))
    )
    assert len({str(one) for one in (plain, flat, short)}) == 3
    assert str(plain) == str(typeof(body(7.0)))
    with pytest.raises(AttributeError, match="lost"):
        _ = PAIR.first.lost  # type: ignore[attr-defined]
