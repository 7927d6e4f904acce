"""What one call hands out no later call reads: whoever writes into a result spoils that result alone."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexinv
from flexinv.elements.quadrature import build_reference
from flexinv.kinematics.mesh import build
from flexinv.model.by_value import is_same
from flexinv.model.owned_cache import make_read_only

MODELS = Path(__file__).resolve().parents[3] / "models"
BENT, RIGID, LOOP, SPATIAL = (
    flexinv.load_mechanism(MODELS / name) for name in ("flex_one_link", "rigid_3r", "four_bar", "spatial_arm")
)
TURN = flexinv.Motion.point_to_point({"hub": 0.0}, {"hub": 1.0}, duration=0.2)
REACH = flexinv.Motion.point_to_point(RIGID.neutral, RIGID.neutral + 0.5, duration=0.2)
CRANK = next(iter(flexinv.load_cases(MODELS / "four_bar", LOOP).values())).motion
STATE = np.random.default_rng(1).uniform(-1, 1, (3, 4, 3))
SWING = flexinv.Motion.point_to_point(SPATIAL.neutral, SPATIAL.neutral + 0.1, duration=0.1)
CALLS: dict[str, Callable[[], Any]] = {
    "solve": lambda: flexinv.solve(BENT, TURN, step=1e-2),
    "solve, rigid": lambda: flexinv.solve(RIGID, REACH, step=1e-2),
    "solve, closed": lambda: flexinv.solve(LOOP, CRANK, step=CRANK.duration / 40),
    "solve, in space": lambda: flexinv.solve(SPATIAL, SWING, step=1e-2),
    "solve_many": lambda: flexinv.solve_many(BENT, [TURN, TURN], step=1e-2),
    "solve_in_parts": lambda: list(flexinv.solve_in_parts(BENT, TURN, step=1e-2, part=10)),
    "statics": lambda: flexinv.statics(BENT, [flexinv.Load("link", force=[0, 0.1, 0])]),
    "simulate": lambda: flexinv.simulate(BENT, [0.0, 0.1], [[0.0], [0.1]], step=1e-2),
    "natural_modes": lambda: flexinv.natural_modes(BENT),
    "linear_model": lambda: flexinv.linear_model(BENT),
    "joint_torques": lambda: flexinv.joint_torques(RIGID, *STATE),
    "nodal": lambda: flexinv.prepare(RIGID).nodal(*STATE),
    "torque_derivatives": lambda: flexinv.torque_derivatives(RIGID, *STATE),
    "torque_regressor": lambda: flexinv.torque_regressor(RIGID, *STATE),
    "evaluate": lambda: TURN.evaluate(BENT, [0.0, 0.1]),
    "build": lambda: build(BENT),
    "prepare": lambda: flexinv.prepare(RIGID),
}


def arrays(part: Any) -> Iterator[np.ndarray[Any, Any]]:
    """Yield the arrays of a result, however deep they lie."""
    if isinstance(part, np.ndarray):
        yield part
    elif isinstance(part, tuple | list):
        for one in part:
            yield from arrays(one)
    elif isinstance(part, dict):
        yield from arrays(list(part.values()))
    elif is_dataclass(part):
        yield from arrays([getattr(part, field.name) for field in fields(part)])


@pytest.mark.parametrize("name", CALLS)
def test_who_writes_into_a_result_spoils_that_result_alone(name: str) -> None:
    result = CALLS[name]()
    pristine = copy.deepcopy(result)
    seen = 0
    for part in arrays(result):
        seen += 1
        if part.flags.writeable:
            part[...] = 7
    assert seen
    assert is_same(CALLS[name](), pristine)


def test_a_mesh_cannot_be_written_to() -> None:
    """It is kept with its mechanism: twice the masses would be twice the torque of the next call."""
    first = flexinv.solve(RIGID, REACH, step=1e-2)
    for part in arrays(first.mesh):
        assert not part.flags.writeable
    with pytest.raises(ValueError, match="read-only"):
        first.mesh.mass[:] *= 2.0
    np.testing.assert_array_equal(flexinv.solve(RIGID, REACH, step=1e-2).torque, first.torque)


def test_tables_that_all_share_cannot_be_written_to() -> None:
    f = flexinv.prepare(RIGID)
    for shared in (f.bodies, f.plan, build_reference(4)):
        assert not any(part.flags.writeable for part in arrays(shared))


def test_freezing_reaches_every_array() -> None:
    deep: Any = ({"a": [np.zeros(2)]}, np.ones(3), "text", 1.0)
    assert make_read_only(deep) is deep
    assert not any(part.flags.writeable for part in arrays(deep))
