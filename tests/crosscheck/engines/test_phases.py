"""Mechanisms that open and close while they move, in the engines: phase by phase, with the engines' own switches."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from loop_examples import rack_and_pinion
from numpy.typing import NDArray

import flexinv
from crosscheck.engines.base import sample_times
from crosscheck.engines.exudyn import adapter as exudyn
from crosscheck.engines.exudyn.models import chain as exudyn_chain
from crosscheck.engines.flexinv import adapter as engine
from crosscheck.engines.flexinv.determinacy import find_determinate_parts
from crosscheck.engines.mujoco import adapter as mujoco
from crosscheck.engines.mujoco import loops as mujoco_loops
from crosscheck.engines.pinocchio import adapter as pinocchio
from crosscheck.engines.shared import loop_closure as assembly
from crosscheck.engines.shared import phases
from crosscheck.measures.record import Record, check
from flexinv.files.load_cases import Case, load_cases
from flexinv.model.mechanism import Attachment, Body, Closure, Inertia, Joint, Link, Mechanism, Placement

Array = NDArray[np.float64]
MODELS = Path(__file__).resolve().parents[3] / "models"
MODULES: dict[str, Any] = {"flexinv": engine, "pinocchio": pinocchio, "mujoco": mujoco, "mujoco-equality": mujoco}
# Asked for: 1e-10 and 1e-8 of the range.  The same samples, the same equations: rounding times the condition of the loops.
NEAR = 1e-10
SWITCHED = {"two_arms": "carry", "walker": "walk"}


@cache
def model(name: str) -> tuple[Mechanism, Case]:
    mechanism = flexinv.load_mechanism(MODELS / name)
    return mechanism, load_cases(MODELS / name, mechanism)[SWITCHED[name]]


@cache
def by(name: str, which: str) -> Record:
    return ran(which, *model(name))


def ran(which: str, mechanism: Mechanism, case: Case) -> Record:
    assert MODULES[which].unsupported(mechanism, case, which) is None
    record: Record = MODULES[which].run(mechanism, case, which, {})
    check(record, sample_times(case))
    return record


def apart(record: Record, other: Record, quantity: str, samples: slice = slice(None)) -> float:
    """Largest difference over the range of a quantity of ``other``."""
    names = [n for n, s in other.series.items() if s.quantity == quantity]
    assert names
    assert set(names) <= set(record.series)
    scale = max(np.ptp(other.series[n].values) for n in names)
    gap = max(np.abs(record.series[n].values[samples] - other.series[n].values[samples]).max() for n in names)
    return float(gap / scale)


@pytest.mark.slow
@pytest.mark.parametrize("which", ["pinocchio", "mujoco"])
@pytest.mark.parametrize("name", SWITCHED)
def test_an_engine_agrees_with_flexinv_through_the_switches(name: str, which: str) -> None:
    for quantity in ("torque", "tip", "reaction"):
        assert apart(by(name, which), by(name, "flexinv"), quantity) < NEAR


@pytest.mark.slow
@pytest.mark.parametrize("which", ["pinocchio", "mujoco"])
def test_a_closure_that_ceases_too_early_is_seen(which: str) -> None:
    """One hand holds the bar alone for 0.1 s."""
    mechanism, case = model("two_arms")
    early = tuple(replace(c, active=((0.5, 0.9),)) if c.name == "right" else c for c in mechanism.closures)
    wrong = ran(which, replace(mechanism, closures=early), case)
    for quantity in ("torque", "reaction"):
        assert apart(wrong, by("two_arms", "flexinv"), quantity) > 1e-2


def test_mujoco_switches_its_own_equalities() -> None:
    """``eq_active`` follows the intervals, and the rows of efc_J with it."""
    mechanism, _ = model("two_arms")
    built = mujoco.build(mechanism, extend=mujoco_loops.make_loop_extender(mechanism))
    for time, names in ((0.2, ["lies"]), (0.7, ["left", "right"]), (1.2, ["lies_again"])):
        data = mujoco_loops.build_data(built, phases.apply_active_closures(mechanism, time))
        on = [built.model.equality(k).name.split("/")[0] for k in range(built.model.neq) if data.eq_active[k]]
        assert on == names
        mujoco.mujoco.mj_fwdPosition(built.model, data)
        assert data.ne == 6 * len(names)  # a weld is six rows


def test_mujocos_native_result_is_the_open_tree_in_every_phase() -> None:
    """Its deviation is the soft constraint: no force where the motion closes the loops, on passive joints too."""
    mechanism, _ = model("two_arms")
    native, open_, ours = by("two_arms", "mujoco-equality"), _opened(), by("two_arms", "flexinv")
    for k, name in enumerate(mechanism.velocity_names):
        # Rounding of the closed position, some 1e-15 m, times a stiffness of 1e5 / s^2 times 4 kg over 1 - impedance = 1e-4
        assert native.series[f"torque/{name}"].values == pytest.approx(open_[:, k], abs=1e-4 * np.abs(open_).max())
    assert apart(native, ours, "torque") > 0.1
    assert "mj_inverse gives the efforts of the open tree" in native.message
    assert not [n for n in native.series if n.startswith("reaction")]


def _opened() -> Array:
    """Efforts of the two arms and the bar without closures, on the closed motion."""
    mechanism, case = model("two_arms")
    s = flexinv.solve(mechanism, case.motion, case.step, start=case.start)
    return flexinv.joint_torques(replace(mechanism, closures=()), s.q, s.qd, s.qdd)


def test_velocities_that_do_not_meet_are_named() -> None:
    """Of an engine whose coordinate moves at 0.5 rad/s before the grasp and stands still from there on."""
    mechanism, case = model("two_arms")
    time = sample_times(case)

    def closed(now: Mechanism, here: Case, span: Array) -> phases.State:
        rate = np.full((len(span), 1), 0.5 if span[0] < 0.5 else 0.0)
        return np.zeros((len(span), mechanism.nq)), rate, rate

    with pytest.raises(
        assembly.AssemblyError, match=r"from t = 0\.5 s on \(left, right\) change a rate by 0\.5 at once"
    ):
        phases.solve_phases(mechanism, case, time, closed)


def struck(impact: str) -> tuple[Mechanism, Case]:
    """A driven carriage strikes one that stands still, and takes it along: at 0.1 s, where it is at 0.2 m."""
    along = np.array([1.0, 0.0, 0.0])
    links = tuple(Link(n, (Body(n, Inertia(2.0, np.zeros(3), 0.1 * np.eye(3))),)) for n in ("driven", "caught"))
    joints = (
        Joint("drive", "prismatic", "world", "driven", axis=along),
        Joint("free", "prismatic", "world", "caught", axis=along, actuated=False),
    )
    stands = Closure(
        "stands", "fixed", Attachment("world", Placement(0.2 * along)), Attachment("caught"), active=((0.0, 0.1),)
    )
    coupled = Closure(
        "coupled", "fixed", Attachment("driven"), Attachment("caught"), active=((0.1, 9.0),), impact=impact
    )
    time = np.linspace(0, 0.2, 21)
    motion = flexinv.Motion.from_samples(time, {"drive": 0.2 + 1.5 * (time - 0.1) + 4.0 * (time - 0.1) ** 2})
    mechanism = Mechanism("carriages", links, joints, np.zeros(3), (stands, coupled))
    return mechanism, Case("c", "", motion, 0.01, 0.2, 0.01, ("torque",), (), start={"free": np.array([0.2])})


@pytest.mark.parametrize("which", ["pinocchio", "mujoco"])
def test_a_plastic_impact_is_gone_through_and_another_is_refused(which: str) -> None:
    """4 kg follow at 8 m/s^2 from the instant on; the impulse itself is no torque."""
    for name in ("flexinv", which):
        record = ran(name, *struck("plastic"))
        assert record.series["torque/drive"].values == pytest.approx([16.0] * 10 + [32.0] * 11, rel=1e-9)
    with pytest.raises(assembly.AssemblyError, match=r"from t = 0\.1 s on \(coupled\) change a rate by 1\.5 at once"):
        MODULES[which].run(*struck("error"), which, {})


def test_what_engines_do_not_take_of_closures_is_said() -> None:
    mechanism, case = struck("plastic")
    catching = replace(mechanism, closures=(mechanism.closures[0], replace(mechanism.closures[1], capture=True)))
    for which in ("pinocchio", "mujoco", "mujoco-equality"):
        reason = MODULES[which].unsupported(catching, case, which)
        assert reason == "closures tie frames that have met here; capturing: coupled"
    reason = exudyn.unsupported(mechanism, case, "exudyn-dae")
    assert reason == "a jump of velocity rings in index 3; closures with an impact: coupled"


@pytest.mark.parametrize("which", ["pinocchio", "mujoco"])
def test_drives_share_by_their_weights(which: str) -> None:
    """Two carriages tied together, of which both have drives: the efforts are as 1 / weight."""
    mechanism, case = struck("plastic")
    joints = (replace(mechanism.joints[0], weight=3.0), replace(mechanism.joints[1], actuated=True))
    tied = replace(mechanism, joints=joints, closures=(replace(mechanism.closures[1], active=()),))
    case = replace(case, start={"free": np.array([0.09])})
    for name in ("flexinv", which):
        series = ran(name, tied, case).series
        assert series["torque/drive"].values == pytest.approx([8.0] * 21, rel=1e-9)
        assert series["torque/free"].values == pytest.approx([24.0] * 21, rel=1e-9)
    both = exudyn_chain.split_sampled_efforts(tied, case, np.array([[0.1, 0.1]]), np.array([[32.0, 0.0]]))
    assert both[0] == pytest.approx([8.0, 24.0])


@pytest.mark.parametrize("which", ["pinocchio", "mujoco"])
def test_a_bar_that_nothing_holds_is_named(which: str) -> None:
    mechanism, case = model("two_arms")
    gone = (replace(mechanism.closures[0], active=((0.0, 0.25),)), *mechanism.closures[1:])
    with pytest.raises(
        assembly.AssemblyError, match=r"from t = 0\.25 s on no closure acts and turn, x, y has no motion"
    ):
        MODULES[which].run(replace(mechanism, closures=gone), case, which, {})


# ------------------------------------------------------------------------------------------------ closure reactions


def test_reactions_out_of_the_plane_are_not_determinate() -> None:
    """A planar loop of joints in space presses its closures out of the plane as it likes: two forces less, two moments less."""
    given = sorted(n for n in by("two_arms", "flexinv").series if n.startswith("reaction/left"))
    assert given == ["reaction/left/fx", "reaction/left/fy", "reaction/left/mz"]


def test_what_a_closure_cannot_exert_is_no_reaction() -> None:
    """A hinge has no moment about its axis, a ball none at all; of a linkage in space nothing is redundant."""
    made = {}
    for name in ("four_bar", "stewart_platform"):
        mechanism = flexinv.load_mechanism(MODELS / name)
        case = next(iter(load_cases(MODELS / name, mechanism).values()))
        s = flexinv.solve(mechanism, case.motion, 0.1, start=case.start)
        made |= {
            c: result.astype(int).tolist()
            for c, result in find_determinate_parts(s.mesh, s.nodes, s.time).reaction.items()
        }
    assert made["C"] == [1, 1, 0, 0, 0, 0]
    assert all(made[f"ball{k}"] == [1, 1, 1, 0, 0, 0] for k in range(1, 7))


def test_wrenches_of_joints_that_redundant_closures_leave_open_are_not_given() -> None:
    """Two of a Bricard linkage's hinges hold it against each other as they like: engines share what is unique alone."""
    mechanism = flexinv.load_mechanism(MODELS / "bricard")
    case = load_cases(MODELS / "bricard", mechanism)["fold"]
    ours, theirs = (MODULES[name].run(mechanism, case, name, {}).series for name in ("flexinv", "pinocchio"))
    given = [n for n in ours if n.startswith("wrench/")]
    force = max(float(np.abs(theirs[n].values).max()) for n in theirs if n.startswith("wrench/"))
    assert max(float(np.abs(ours[n].values - theirs[n].values).max()) for n in given) < 1e-9 * force  # loops' condition
    assert [n for n in theirs if n.startswith("wrench/") and n not in given]  # in these they are 6 % apart


def test_wrenches_of_joints_of_a_planar_loop_in_space_are_unique_in_its_plane() -> None:
    mechanism = flexinv.load_mechanism(MODELS / "five_bar")
    s = flexinv.solve(mechanism, load_cases(MODELS / "five_bar", mechanism)["reach"].motion, 0.1)
    sure = find_determinate_parts(s.mesh, s.nodes, s.time).wrench
    assert set(sure) == {joint.name for joint in mechanism.joints}
    assert all(sure[name][[0, 1, 5]].all() for name in sure)


def test_a_loop_with_a_beam_leaves_nothing_open() -> None:
    """The same loop with a coupler that bends: what would press its hinges out of the plane strains the coupler."""
    mechanism = flexinv.load_mechanism(MODELS / "four_bar_flexible")
    case = next(iter(load_cases(MODELS / "four_bar_flexible", mechanism).values()))
    s = flexinv.solve(mechanism, case.motion, 1e-3, end=5e-3, start=case.start)
    sure = find_determinate_parts(s.mesh, s.nodes, s.time)
    assert all(result.all() for result in sure.wrench.values())
    assert sure.reaction["C"].tolist() == [True] * 5 + [False]  # a hinge exerts no moment about its axis


def test_reactions_carry_the_bar() -> None:
    """While the hands hold it, what they put on the bar is its mass times its acceleration less gravity."""
    mechanism, case = model("two_arms")
    record, (_, held), time = by("two_arms", "flexinv"), (0, slice(50, 100)), sample_times(case)
    s = flexinv.solve(mechanism, case.motion, case.step, start=case.start)
    x, y, turn = (mechanism.velocity_names.index(n) for n in ("x", "y", "turn"))
    total = np.zeros((len(time), 2))
    for hand, flip in (("left", 0.0), ("right", np.pi)):
        f = np.stack([record.series[f"reaction/{hand}/f{axis}"].values for axis in "xy"], axis=1)
        angle = s.q[:, turn] + flip
        c, n = np.cos(angle), np.sin(angle)
        total += np.stack([c * f[:, 0] - n * f[:, 1], n * f[:, 0] + c * f[:, 1]], axis=1)
    expected = 4.0 * (s.qdd[:, [x, y]] - mechanism.gravity[:2])
    assert np.abs(total - expected)[held].max() < 1e-11 * np.abs(expected).max()  # rounding times condition


# ---------------------------------------------------------------------------------------------------------- couplings


@pytest.mark.parametrize("which", ["pinocchio", "mujoco"])
def test_a_coupling_ties_two_coordinates(which: str) -> None:
    """tau = (J + m r^2) q'' + d q' + m g r, and no wrench between frames."""
    mechanism, case = rack_and_pinion()
    q, qd, qdd = (part[:, 0] for part in case.motion.evaluate(mechanism, sample_times(case)))
    expected = (0.02 + 3.0 * 0.05**2) * qdd + 0.1 * qd + 3.0 * 9.81 * 0.05
    for name in ("flexinv", which):
        record = ran(name, mechanism, case)
        assert record.series["torque/turn"].values == pytest.approx(
            expected, abs=1e-12 * np.abs(expected).max() + 1e-12
        )
        assert record.series["tip/rack/y"].values == pytest.approx(0.05 * q + 0.02, abs=1e-12)
        assert not [n for n in record.series if n.startswith("reaction")]


def test_mujocos_joint_equality_is_soft_too() -> None:
    """The drive turns the pinion alone, and the rack asks for its own weight and acceleration."""
    mechanism, case = rack_and_pinion()
    _, qd, qdd = (part[:, 0] for part in case.motion.evaluate(mechanism, sample_times(case)))
    native = ran("mujoco-equality", mechanism, case)
    # rounding of the position, 1e-17 m, times a stiffness of 1e5 / s^2 times 3 kg over 1 - impedance = 1e-4
    assert native.series["torque/turn"].values == pytest.approx(0.02 * qdd + 0.1 * qd, abs=1e-6)
    assert native.series["torque/lift"].values == pytest.approx(3.0 * (0.05 * qdd + 9.81), abs=1e-6)


def test_exudyn_says_that_it_has_no_coupling() -> None:
    reason = exudyn.unsupported(*rack_and_pinion(), "exudyn-dae")
    assert reason == "closures without a connector of Exudyn between redundant coordinates: gear"
