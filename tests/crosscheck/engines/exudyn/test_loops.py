"""Closed loops, springs and forces in Exudyn in time: against Pinocchio and flexinv, with faults, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import loop_examples as examples
import numpy as np
import pytest
from loop_examples import Example
from numpy.typing import NDArray

import flexinv
from crosscheck.engines.base import sample_times
from crosscheck.engines.exudyn import adapter as exudyn
from crosscheck.engines.exudyn import loops as exudyn_loops
from crosscheck.engines.exudyn.models import chain as exudyn_chain
from crosscheck.engines.exudyn.models import connectors as exudyn_closing
from crosscheck.engines.exudyn.models import planar as exudyn_planar
from crosscheck.engines.pinocchio import adapter as pinocchio
from crosscheck.measures.record import Record, check
from flexinv.model.mechanism import Mechanism

Array = NDArray[np.float64]
# Of the range: what is asked for.  The steps here (1000 and 2000 a run) leave an extrapolated error of order h^4, at most
# 3e-7 (measured).
NEAR = 1e-6
STEP = {"step": 1e-3}
EXAMPLES: dict[str, Callable[[], Example]] = {
    "four-bar": examples.four_bar,
    "five-bar, two drives": partial(examples.five_bar, 2),
    "five-bar, three drives": partial(examples.five_bar, 3),
    "slider-crank, pin": partial(examples.slider_crank, "pin"),
    "slider-crank, cylindrical": partial(examples.slider_crank, "cylindrical"),
    "slider-crank, point-on-line": partial(examples.slider_crank, "point-on-line"),
    "spatial": examples.spatial,
    "platform": examples.platform,
    "springs and forces in a loop": examples.loaded,
    "springs and forces on a tree": examples.loaded_tree,
}


def by_exudyn(example: Example) -> Record:
    assert exudyn.unsupported(*example, "exudyn-dae") is None
    record = exudyn.run(*example, "exudyn-dae", STEP)
    check(record, sample_times(example[1]))
    return record


def apart(record: Record, other: Record, quantity: str) -> tuple[float, float]:
    """Largest difference in a quantity and the largest part of it that the error bars do not explain, over the range."""
    names = [n for n in record.series if n.startswith(f"{quantity}/") and n in other.series]
    assert names
    span = max(np.ptp(other.series[n].values) for n in names)
    off = [np.abs(record.series[n].values - other.series[n].values) for n in names]
    bars = [record.series[n].error for n in names]
    beyond = [(a - bar).max() for a, bar in zip(off, bars, strict=True) if bar is not None]
    return float(max(a.max() for a in off) / span), float(max(beyond) / span)


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
def test_exudyn_agrees_with_pinocchio(name: str) -> None:
    example = EXAMPLES[name]()
    record, other = by_exudyn(example), pinocchio.run(*example, "pinocchio", {})
    for quantity in ("torque", "tip"):
        assert apart(record, other, quantity)[0] < NEAR


@pytest.mark.parametrize(
    "name", ["spatial", "springs and forces on a tree", "five-bar, two drives", "slider-crank, cylindrical"]
)
def test_wrenches_where_they_are_unique(name: str) -> None:
    """Of joints with and without drives, and of closures."""
    example = EXAMPLES[name]()
    example = (
        replace(example[0], joints=tuple(replace(j, damping=0.0, rotor_inertia=0.0) for j in example[0].joints)),
        example[1],
    )
    record, other = by_exudyn(example), pinocchio.run(*example, "pinocchio", {})
    for quantity in ("wrench", *(["reaction"] if example[0].closures else [])):
        assert apart(record, other, quantity)[0] < NEAR


def test_wrenches_are_left_out_where_they_are_not() -> None:
    """Friction of the slide and a third drive leave them to more than the joints that the motion gives."""
    for name in ("slider-crank, pin", "five-bar, three drives"):
        assert not [n for n in by_exudyn(EXAMPLES[name]()).series if n.startswith(("wrench", "reaction"))]


@pytest.fixture
def in_space(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let planar mechanisms be run by the model in space, where their loops have redundant equations."""
    monkeypatch.setattr(exudyn_planar, "find_plane", lambda *what: "in space for the test")


@pytest.mark.usefixtures("in_space")
def test_redundant_equations_are_told() -> None:
    record = by_exudyn(examples.slider_crank("pin"))
    assert record.settings["redundant equations left out of"] == ["C"]
    mechanism, case = examples.slider_crank("pin")
    held = exudyn_closing.find_independent_axes(mechanism, case)
    assert sum(held["C"]) == 2  # of five: the plane holds the other three


@pytest.mark.usefixtures("in_space")
def test_redundant_equations_are_singular_in_exudyn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without leaving any out, the engine gives up."""
    full = {"C": list(exudyn_closing.HELD["revolute"])}
    monkeypatch.setattr(exudyn_closing, "find_independent_axes", lambda mechanism, case: full)
    with pytest.raises(Exception, match="failed"):
        exudyn.run(*examples.slider_crank("pin"), "exudyn-dae", STEP)


def test_kinematics_of_the_cut_tree_are_flexinvs() -> None:
    for name in ("spatial", "platform"):
        mechanism, case = EXAMPLES[name]()
        s = flexinv.solve(mechanism, case.motion, case.sample, start=case.start)
        closed_motion = exudyn_chain.evaluate_closed_motion(mechanism, case, sample_times(case))
        for ours, theirs in zip(closed_motion, (s.q, s.qd, s.qdd), strict=True):
            assert np.abs(ours - theirs).max() < 1e-12 * np.abs(theirs).max()  # rounding of small linear systems


# -------------------------------------------------------------------------------------------- faults that must show


def joint(name: str, **change: float) -> Callable[[Mechanism], Mechanism]:
    return lambda m: replace(m, joints=tuple(replace(j, **change) if j.name == name else j for j in m.joints))  # type: ignore[arg-type]


FAULTS: dict[str, Callable[[Mechanism], Mechanism]] = {
    "spring left out": lambda m: replace(m, springs=()),
    "spring without length": lambda m: replace(m, springs=(replace(m.springs[0], rest=0.0),)),
    "damper left out": lambda m: replace(m, springs=(replace(m.springs[0], damping=0.0),)),
    "load left out": lambda m: replace(m, forces=m.forces[1:]),
    "thrust in the world": lambda m: replace(m, forces=(m.forces[0], replace(m.forces[1], follower=False))),
    "passive spring left out": joint("B", stiffness=0.0),
    "passive damping left out": joint("B", damping=0.0),
    "passive rotor left out": joint("D", rotor_inertia=0.0),
}


@pytest.mark.slow
def test_a_planted_fault_is_seen() -> None:
    mechanism, case = examples.loaded()
    other = pinocchio.run(mechanism, case, "pinocchio", {})
    coarse = {"step": 5e-3, "error": False}
    for name, fault in FAULTS.items():
        wrong = exudyn.run(fault(mechanism), case, "exudyn-dae", coarse)
        assert apart(wrong, other, "torque")[0] > 1e-3, name  # a thousand times what is asked for
    right = exudyn.run(mechanism, case, "exudyn-dae", coarse)
    assert apart(right, other, "torque")[0] < 1e-4  # at this step; a tenth of what the faults show


def test_the_multipliers_need_their_share(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a third drive the effort that Exudyn gives on the prescribed joints is not the one of least norm."""
    example = examples.five_bar(3)
    other = pinocchio.run(*example, "pinocchio", {})
    monkeypatch.setattr(exudyn_chain, "split_sampled_efforts", lambda mechanism, case, q, effort: effort)
    assert apart(by_exudyn(example), other, "torque")[0] > 0.05


# ---------------------------------------------------------------------------------------------------- what is refused


def test_other_formulations_point_to_the_one_that_closes_loops() -> None:
    reason = exudyn.unsupported(*examples.four_bar(), "exudyn")
    assert reason == "this formulation has open trees and their drives only; here: closed loops (C); see exudyn-dae"


def test_leaning_axes_of_a_passive_universal_joint_are_refused() -> None:
    mechanism, case = examples.spatial()
    lean = np.array([0.0, 0.8, 0.6])
    joints = tuple(replace(j, second_axis=lean) if j.name == "B" else j for j in mechanism.joints)
    reason = exudyn_loops.describe_refusal(replace(mechanism, joints=joints), case, "exudyn-dae")
    assert reason == "joint B: a connector holds the axes of a universal joint perpendicular; these lean"
