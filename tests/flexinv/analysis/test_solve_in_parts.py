"""solve_in_parts: the samples of one march, part by part, in the memory of a part."""

from __future__ import annotations

import tracemalloc
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from flexible_examples import arm, spatial_tree
from rigid_trees import chain, tree

import flexinv
from flexinv import InputError, Mechanism, Motion, Solution, solve_in_parts

# The motion of a few instants may be rounded otherwise than that of many, and accelerations know positions over step^2.
ROUNDING = 1e-9
JUMPS = Motion.point_to_point([0.0], [0.5], 0.2, law="bang-bang", hold=0.1)


def falling() -> tuple[Mechanism, Motion, dict[str, Any]]:
    """A tree of every joint kind whose passive joints turn more than once: a wheel, a ball, a base that floats."""
    whole = tree()
    joints = tuple(
        replace(j, actuated=j.kind in ("revolute", "prismatic"), friction=0.0, stiffness=0.0) for j in whole.joints
    )
    mechanism = replace(whole, joints=joints)
    driven = [j.name for j in joints if j.actuated and j.nv]
    motion = Motion.point_to_point(dict.fromkeys(driven, 0.0), dict.fromkeys(driven, 0.3), 0.4)
    return mechanism, motion, {"start_rate": {"wheel_joint": 40.0}}


def spatial() -> tuple[Mechanism, Motion, dict[str, Any]]:
    mechanism = spatial_tree()
    return (
        mechanism,
        Motion.point_to_point(np.zeros(mechanism.nq), np.full(mechanism.nq, 0.3), 0.3),
        {"initial": "static"},
    )


def winding(driven: bool) -> tuple[Mechanism, Motion, dict[str, Any]]:
    """A wheel on an arm winds a spring up over two turns, by its drive or thrown."""
    whole = chain("continuous")
    joints = tuple(
        replace(j, stiffness=0.5, actuated=driven, friction=0.0) if j.kind == "continuous" else j for j in whole.joints
    )
    mechanism, ends = replace(whole, joints=joints), {"arm_joint": 0.3, "body_joint": 13.0}
    ends = ends if driven else {"arm_joint": 0.3}
    motion = Motion.point_to_point(dict.fromkeys(ends, 0.0), ends, 0.3)
    return mechanism, motion, {} if driven else {"start_rate": {"body_joint": 60.0}}


CASES: Mapping[str, tuple[Mechanism, Motion, dict[str, Any]]] = {
    "plane": (arm(), JUMPS, {}),
    "one of three": (arm(), JUMPS, {"every": 3}),
    "space": spatial(),
    "rigid": (chain("prismatic"), Motion.point_to_point([0.0, 0.0], [1.0, 0.2], 0.3), {}),
    "falling": falling(),
    "winding": winding(True),
    "wound by itself": winding(False),
}


def joined(parts: list[Solution], of: Any) -> np.ndarray:
    return np.concatenate([of(part)[min(k, 1) :] for k, part in enumerate(parts)])


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("part", [1000, 50, 7])  # all at once; the jump at 0.1 s ends a part; it falls into one
def test_parts_are_those_of_the_whole(name: str, part: int) -> None:
    mechanism, motion, options = CASES[name]
    whole = flexinv.solve(mechanism, motion, 2e-3, **options)
    parts = list(solve_in_parts(mechanism, motion, 2e-3, part=part, **options))
    assert len(parts) == max(1, -(-(len(whole.time) - 1) // part))
    assert all(len(one.time) <= part + 1 for one in parts)
    for of in (
        lambda s: s.time, lambda s: s.q, lambda s: s.torque, lambda s: s.nodes.x, lambda s: s.balance.power,
        lambda s: s.reaction, lambda s: s.torque_all, *(lambda s, n=n: s.tip[n] for n in whole.tip),
    ):  # fmt: skip
        np.testing.assert_allclose(
            joined(parts, of), of(whole), rtol=0.0, atol=ROUNDING * max(1.0, abs(of(whole)).max())
        )
    for one, after in pairwise(parts):
        np.testing.assert_array_equal(one.torque[-1], after.torque[0])


def test_a_march_takes_the_memory_of_a_part() -> None:
    """20,000 steps of an arm: its histories take 60 times what those of 300 take."""
    motion = Motion.point_to_point([0.0], [0.5], 2.0)
    flexinv.solve(arm(), motion, 1e-4, end=1e-3)  # which compiles, or reads, what would count as well

    def peak(run: Any) -> int:
        tracemalloc.start()
        run()
        result = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return int(result)

    whole = peak(lambda: flexinv.solve(arm(), motion, 1e-4))
    some = peak(lambda: [part.torque.max() for part in solve_in_parts(arm(), motion, 1e-4, part=300)])
    assert some < whole / 10  # a chunk of the march and the grid of times are there as well


def test_the_march_goes_on_when_asked() -> None:
    """Nothing is marched before, and what fails does so in its own part."""
    done: list[int] = []
    parts = solve_in_parts(arm(), JUMPS, 2e-3, part=20, progress=done.append)
    assert sum(done) == 0
    next(parts)
    assert sum(done) == 20


def test_what_cannot_be_is_explained() -> None:
    with pytest.raises(InputError, match="part = 0: expected the number of samples of a part"):
        next(solve_in_parts(arm(), JUMPS, 2e-3, part=0))
    with pytest.raises(InputError, match="every = 0: expected 1"):
        next(solve_in_parts(arm(), JUMPS, 2e-3, every=0))
    with pytest.raises(InputError, match="initial = 'at rest': expected 'consistent'"):
        next(solve_in_parts(arm(), JUMPS, 2e-3, initial="at rest"))
