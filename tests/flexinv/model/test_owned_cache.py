"""Results belong to their owner: they are kept with it, go with it, and are not copied with it."""

from __future__ import annotations

import copy
import gc
import pickle
import weakref
from dataclasses import dataclass

import numpy as np
import pytest
from flexible_examples import arm

from flexinv.kinematics.mesh import build
from flexinv.model.owned_cache import ATTRIBUTE, make_owner_cache
from flexinv.planar.detection import find_plane


@dataclass(frozen=True, eq=False)
class Owner:
    number: float


CALLS: list[float] = []


@make_owner_cache(most=2)
def raised(owner: Owner, power: float) -> float:
    CALLS.append(power)
    return owner.number**power


def test_a_result_is_computed_once_for_each_owner_and_key() -> None:
    CALLS.clear()
    one, two = Owner(2.0), Owner(3.0)
    assert [raised(one, 2.0), raised(one, 2.0), raised(two, 2.0)] == [4.0, 4.0, 9.0]
    assert CALLS == [2.0, 2.0]
    for power in (3.0, 4.0, 2.0):  # an owner keeps two: the first went
        raised(one, power)
    assert CALLS == [2.0, 2.0, 3.0, 4.0, 2.0]


def test_copies_begin_without_results() -> None:
    one = Owner(2.0)
    raised(one, 2.0)
    for other in (copy.deepcopy(one), pickle.loads(pickle.dumps(one))):
        assert other.number == 2.0
        assert other.__dict__[ATTRIBUTE] == {}


@make_owner_cache()
def listed(owner: Owner, count: int) -> list[np.ndarray]:
    return [np.full(count, owner.number)]


@make_owner_cache(frozen=False)
def work_space(owner: Owner) -> np.ndarray:
    return np.zeros(3)


def test_arguments_by_name_are_no_part_of_a_key() -> None:
    """They were left out of it: the square was returned where the cube was asked for."""
    one = Owner(3.0)
    assert raised(one, 2.0) == 9.0
    with pytest.raises(TypeError, match="raised: power by name: its arguments are given by position"):
        raised(one, power=3.0)
    assert raised(one, 3.0) == 27.0


def test_what_is_kept_cannot_be_written_to() -> None:
    one = Owner(2.0)
    (kept,) = listed(one, 2)
    with pytest.raises(ValueError, match="read-only"):
        kept[:] = 1.0
    np.testing.assert_array_equal(listed(one, 2)[0], [2.0, 2.0])
    work_space(one)[:] = 1.0


def test_a_mesh_goes_with_its_mechanism() -> None:
    mechanism = arm()
    mesh = build(mechanism)
    assert build(mechanism) is mesh
    assert find_plane(mesh) is find_plane(mesh)
    gone = weakref.ref(mesh)
    del mechanism, mesh
    gc.collect()
    assert gone() is None
