"""Beams in closed loops in Exudyn: both formulations against flexinv, the cause of what is left, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import loop_examples as examples
import numpy as np
import pytest
from numpy.typing import NDArray

from crosscheck.engines.base import sample_times
from crosscheck.engines.exudyn import adapter as exudyn
from crosscheck.engines.exudyn import loops as exudyn_loops
from crosscheck.engines.exudyn.models import chain as exudyn_chain
from crosscheck.engines.exudyn.models import layout as exudyn_layout
from crosscheck.engines.exudyn.models import planar as exudyn_planar
from crosscheck.engines.exudyn.models import planar_connectors as exudyn_flat
from crosscheck.engines.flexinv import adapter as ours
from crosscheck.measures.record import Record, check
from flexinv.files.load_cases import Case, load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Attachment, Beam, Closure, Force, Link, Mechanism, Placement, Section, Spring
from flexinv.model.motion import Motion

Array = NDArray[np.float64]
BEAMS = ("exudyn-ancf", "exudyn-ge")
MODELS = Path(__file__).resolve().parents[4] / "models"
QUANTITIES = ("torque", "tip", "deflection", "axial", "wrench", "reaction")


def smooth(joint: str, start: float, end: float, duration: float) -> Motion:
    """Return a move with five derivatives zero at both ends: jumps of the jerk ring modes that no step here resolves."""
    s = np.linspace(0.0, 1.0, 201)
    part = s**6 * (462 - 1980 * s + 3465 * s**2 - 3080 * s**3 + 1386 * s**4 - 252 * s**5)
    return Motion.from_samples(duration * s, {joint: start + (end - start) * part})


def four_bar(duration: float = 0.1) -> tuple[Mechanism, Case]:
    """The model's linkage with a short move of its crank."""
    mechanism = load_mechanism(MODELS / "four_bar_flexible")
    case = load_cases(MODELS / "four_bar_flexible", mechanism)["turn"]
    return mechanism, replace(
        case, motion=smooth("A", 0.3, 0.5, duration), end=duration, sample=duration / 20, step=duration / 400
    )


def slider_crank() -> tuple[Mechanism, Case]:
    """The model's linkage, the crank moves by a quarter turn."""
    mechanism = load_mechanism(MODELS / "slider_crank_flexible")
    case = load_cases(MODELS / "slider_crank_flexible", mechanism)["turn"]
    return mechanism, replace(case, motion=smooth("main", 0.0, 1.6, 0.03), end=0.03, sample=1e-3, step=2e-5)


def run(mechanism: Mechanism, case: Case, engine: str, step: float, elements: int = 4, error: bool = True) -> Record:
    assert exudyn.unsupported(mechanism, case, engine) is None
    record = exudyn.run(mechanism, case, engine, {"step": step, "elements": elements, "error": error})
    check(record, sample_times(case))
    return record


def off(record: Record, other: Record, quantity: str) -> float:
    """Largest difference in a quantity over the range."""
    names = [n for n in record.series if n.startswith(f"{quantity}/") and n in other.series]
    assert names
    span = max(np.ptp(other.series[n].values) for n in names)
    return float(max(np.abs(record.series[n].values - other.series[n].values).max() for n in names) / span)


@pytest.mark.parametrize("engine", BEAMS)
def test_a_coupler_that_bends(engine: str) -> None:
    """Under gravity, from static equilibrium."""
    mechanism, case = four_bar()
    record, other = run(mechanism, case, engine, 2.5e-4), ours.run(mechanism, case, "flexinv", {"error": False})
    assert record.settings["elements_per_beam"] == [2, 4, 8]
    for quantity in QUANTITIES:
        assert off(record, other, quantity) < 5e-4, quantity  # error bar 2e-4; 2e-3 is what the design asks for
    shape = record.series["deflection/coupler/y"]
    assert np.ptp(shape.values) > 1e-3  # [m]: it bends


@pytest.mark.parametrize("engine", BEAMS)
def test_a_rod_that_bends_without_shear_and_rotary_inertia(engine: str) -> None:
    """What separates the cable from the other beams is nothing else: without both, all three agree."""
    mechanism, case = slider_crank()
    beam = mechanism.link_of["rod"].beam
    assert beam is not None
    stiffness = beam.section.stiffness * (1, 100, 100, 1, 1, 1)
    thin = replace(beam.section, stiffness=stiffness, rotary_inertia=1e-4 * beam.section.rotary_inertia)
    links = tuple(replace(k, beam=replace(beam, section=thin)) if k.name == "rod" else k for k in mechanism.links)
    slender = replace(mechanism, links=links)
    other = ours.run(slender, case, "flexinv", {"error": False})
    record = run(slender, case, engine, 4e-5)
    for quantity in QUANTITIES:
        assert off(record, other, quantity) < 1e-4, quantity  # measured 7e-5 of the exact beam, 8e-6 of the cable
    if engine == "exudyn-ancf":
        whole = ours.run(mechanism, case, "flexinv", {"error": False})
        assert off(run(mechanism, case, engine, 4e-5), whole, "deflection") > 3e-4


def test_error_bars_cover_the_difference_of_a_finer_run() -> None:
    mechanism, case = four_bar()
    coarse, fine = (run(mechanism, case, "exudyn-ge", step) for step in (1e-3, 2.5e-4))
    for name in ("torque/A", "deflection/coupler/y"):
        bar = coarse.series[name].error
        assert bar is not None
        assert np.abs(coarse.series[name].values - fine.series[name].values).max() < bar.max()


def test_a_planted_fault_is_seen() -> None:
    mechanism, case = four_bar()
    other = ours.run(mechanism, case, "flexinv", {"error": False})
    beam = mechanism.link_of["coupler"].beam
    assert beam is not None
    soft = replace(beam.section, stiffness=0.98 * beam.section.stiffness)
    links = tuple(replace(k, beam=replace(beam, section=soft)) if k.name == "coupler" else k for k in mechanism.links)
    wrong = run(replace(mechanism, links=links), case, "exudyn-ge", 5e-4)
    assert off(wrong, other, "deflection") > 5e-3  # 2 % softer: ten times what a right one keeps


def test_damping_and_springs_in_passive_joints() -> None:
    mechanism, case = four_bar()
    joints = tuple(replace(j, damping=0.02 if j.name == "D" else 0.01) for j in mechanism.joints)
    damped = replace(mechanism, joints=joints)
    sprung = tuple(replace(j, stiffness=0.5, rest=0.4) if j.name == "D" else j for j in joints)
    a, b = (run(one, case, "exudyn-ge", 5e-4) for one in (replace(damped, joints=sprung), damped))
    # In equilibrium the spring's moment k (q_D - rest), times the rocker's turn per turn of the crank, joins the torque.
    nudge = replace(case, motion=Motion.point_to_point({"A": 0.3 - 1e-4}, {"A": 0.3 + 1e-4}, 1.0), end=1.0, sample=0.5)
    angle = exudyn_chain.evaluate_closed_motion(mechanism, nudge, sample_times(nudge))[0][:, mechanism.q_slices["D"]][
        :, 0
    ]
    moment = 0.5 * (angle[1] - 0.4) * (angle[2] - angle[0]) / 2e-4
    added = a.series["torque/A"].values[0] - b.series["torque/A"].values[0]
    assert abs(added - moment) < 1e-3 * abs(
        moment
    )  # the coupler bends by 1e-2 of its length, which shortens it by 1e-4
    other = ours.run(damped, case, "flexinv", {"error": False})
    assert off(b, other, "torque") < 2e-3
    assert off(run(mechanism, case, "exudyn-ge", 5e-4), other, "torque") > 1e-2


def carrying() -> tuple[Mechanism, Case]:
    """The closed phase of models/two_arms_flexible alone: two arms with flexible forearms carry a bar, six drives."""
    mechanism = load_mechanism(MODELS / "two_arms_flexible")
    case = load_cases(MODELS / "two_arms_flexible", mechanism)["carry"]
    hands = [c for c in mechanism.closures if c.name in ("left", "right")]
    held = tuple(replace(c, active=(), capture=False, impact="error") for c in hands)
    time = np.linspace(0.0, 0.5, 101)
    q = case.motion.evaluate(mechanism, 0.5 + time)[0]
    given = {n: q[:, mechanism.q_slices[n]][:, 0] for n in case.motion.joints(mechanism)}
    motion = Motion.from_samples(time, given, rest=True)
    return replace(mechanism, closures=held), replace(case, motion=motion, end=0.5, sample=0.025, step=1e-3)


def test_two_flexible_arms_carry_a_bar() -> None:
    """Fixed and prismatic closures, passive slides, bodies without mass, and more drives than the rigid loop has freedoms."""
    mechanism, case = carrying()
    record, other = (
        run(mechanism, case, "exudyn-ge", 5e-4, error=False),
        ours.run(mechanism, case, "flexinv", {"error": False}),
    )
    for quantity in ("torque", "tip", "deflection", "axial", "wrench"):
        assert off(record, other, quantity) < 5e-4, quantity  # measured 8e-5 with half of both steps


def test_springs_and_forces_on_a_loop_with_a_beam() -> None:
    """A spring and a force that hold on to the beam's middle, a force that follows a rigid link."""
    mechanism, case = four_bar()
    middle = Attachment("coupler", station=0.5)
    spring = Spring("spring", Attachment("world", Placement(np.array([0.1, -0.3, 0.0]))), middle, 60.0, 0.2, 0.5)
    push = np.array([[0.5, -0.4, 0.0, 0.0, 0.0, 0.05], [-0.2, 0.8, 0.0, 0.0, 0.0, -0.02]])
    follower = Force("thrust", Attachment("rocker", Placement(np.array([0.2, 0.0, 0.0]))), 10 * push[:1], follower=True)
    forces = (Force("load", middle, push, np.array([0.0, 0.1])), follower)
    loaded = replace(mechanism, springs=(spring,), forces=forces)
    record, other = run(loaded, case, "exudyn-ge", 5e-4), ours.run(loaded, case, "flexinv", {"error": False})
    for quantity in QUANTITIES:
        assert off(record, other, quantity) < 1e-3, quantity
    for without in ({"springs": ()}, {"forces": forces[1:]}, {"forces": forces[:1]}):
        wrong = run(replace(loaded, **without), case, "exudyn-ge", 1e-3, error=False)  # type: ignore[arg-type]
        assert off(wrong, other, "torque") > 1e-2, without


# -------------------------------------------------------------------------------------------------------- in space


def spatial() -> tuple[Mechanism, Case]:
    """Crank, universal joint, a round coupler that bends and twists, ball, rocker; from static equilibrium."""
    mechanism, case = examples.spatial()
    stiffness = np.array([[2.1e6, 6e5, 6e5, 30.0, 40.0, 40.0]])
    section = Section(np.zeros(1), stiffness, np.array([0.9]), np.array([[2e-5, 1e-5, 1e-5]]))
    closure = replace(mechanism.closures[0], first=Attachment("coupler", station=1.0))
    links = (mechanism.links[0], Link("coupler", (), Beam(0.55, section, 1, 6)), mechanism.links[2])
    motion = smooth("A", 0.5, 2.0, 0.5)
    case = replace(case, motion=motion, end=0.5, sample=0.025, step=1e-3, initial="static")
    return replace(mechanism, links=links, closures=(closure,)), case


@pytest.mark.parametrize("engine", ["exudyn-ge", pytest.param("exudyn-ancf", marks=pytest.mark.slow)])
def test_a_coupler_in_space(engine: str) -> None:
    mechanism, case = spatial()
    record, other = (
        run(mechanism, case, engine, 1e-3, error=False),
        ours.run(mechanism, case, "flexinv", {"error": False}),
    )
    assert record.settings["model"] == "bodies with Euler parameters"
    for quantity in QUANTITIES:
        assert off(record, other, quantity) < 5e-4, (
            quantity
        )  # 4 and 8 elements: measured 2e-4, four times less with 8 and 16
    assert min(np.ptp(record.series[f"deflection/coupler/{axis}"].values) for axis in "yz") > 1e-3  # [m]


def test_the_plane_in_space(monkeypatch: pytest.MonkeyPatch) -> None:
    """The planar linkage by the spatial model: its joints and closures are of other kinds there."""
    monkeypatch.setattr(exudyn_planar, "find_plane", lambda *what: "in space for the test")
    mechanism, case = four_bar()
    record = run(mechanism, case, "exudyn-ge", 5e-4, elements=8, error=False)
    assert record.settings["closures"] == "GenericJoint"
    other = ours.run(mechanism, case, "flexinv", {"error": False})
    for quantity in ("torque", "tip", "deflection", "axial", "wrench", "reaction"):
        assert off(record, other, quantity) < 2e-3, quantity  # linear elements: 9e-4 of the deflection, measured


def test_damping_of_passive_joints_in_space_is_refused() -> None:
    mechanism, case = spatial()
    damped = tuple(replace(j, damping=0.1) if j.name == "D" else j for j in mechanism.joints)
    reason = exudyn.unsupported(replace(mechanism, joints=damped), case, "exudyn-ge")
    assert reason == "joint D: damping and springs of joints without a drive have a connector in the plane only"


# --------------------------------------------------------------------------------------------------------- refused


def test_what_beams_in_loops_cannot_be() -> None:
    mechanism, case = four_bar()

    def reason(engine: str = "exudyn-ge", **change: object) -> str | None:
        return exudyn.unsupported(replace(mechanism, **change), case, engine)  # type: ignore[arg-type]

    assert reason("exudyn-dae") == "exudyn-dae has rigid bodies only; flexible here: coupler"
    tree_only = (
        "this formulation has open trees and their drives only; here: closed loops (C); see exudyn-ancf and exudyn-ge"
    )
    assert reason("exudyn") == tree_only
    driven = tuple(replace(j, actuated=True) for j in mechanism.joints)
    words = "with links that bend the drives stand on the very joints that the motion gives; here not so: B, D"
    assert reason(joints=driven) == words
    rough = tuple(replace(j, friction=0.1) if j.name == "D" else j for j in mechanism.joints)
    assert (
        reason(joints=rough)
        == "joint D: no connector here for rotor inertia or dry friction of a joint without a drive"
    )


def test_beams_that_start_in_motion_are_refused() -> None:
    mechanism, case = four_bar()
    time = np.linspace(0.0, 0.1, 11)
    reason = exudyn.unsupported(
        mechanism, replace(case, motion=Motion.from_samples(time, {"A": 0.3 + time})), "exudyn-ge"
    )
    assert reason is not None
    assert reason.startswith("joint A starts in motion: ")
    assert reason.endswith(", and how a link that bends came to its start is not known")


def test_rigid_loops_are_not_for_beams() -> None:
    mechanism = load_mechanism(MODELS / "four_bar")
    case = load_cases(MODELS / "four_bar", mechanism)["turn"]
    assert exudyn.unsupported(mechanism, case, "exudyn-ge") == "no link bends: see exudyn-dae"


def test_a_closure_out_of_the_plane_is_not_planar() -> None:
    mechanism, case = four_bar()
    model = exudyn_loops.build_model(mechanism, case, "exudyn-ge")
    tilted = Closure("C", "universal", mechanism.closures[0].first, mechanism.closures[0].second)
    for closure, words in (
        (tilted, "closure C is universal"),
        (
            replace(tilted, kind="revolute", axis=np.array([0.0, 0.6, 0.8])),
            "the axis of closure C is not parallel to the others",
        ),
        (replace(tilted, kind="point-on-line"), "the axis of closure C is not in the plane of the others"),
    ):
        other = replace(mechanism, closures=(closure,))
        assert exudyn_planar.find_plane(other, model.layout, frozenset(model.free)) == words


def test_sliding_dampers_are_refused() -> None:
    mechanism, _ = slider_crank()
    damped = tuple(replace(j, damping=1.0) if j.name == "slide" else j for j in mechanism.joints)
    words = "joint slide: damping and springs of prismatic joints without a drive have no connector here"
    assert exudyn_flat.describe_unmodelled_effort(replace(mechanism, joints=damped), frozenset({"slide"})) == words


# ------------------------------------------------------------------------------------------------------------ mesh


def test_stations_that_are_equal_up_to_rounding_share_a_node() -> None:
    """0.1 + 0.2 is not 0.3: between the two would be an element of 1e-17 of the length."""
    mechanism, _ = four_bar()
    beam = mechanism.link_of["coupler"].beam
    assert beam is not None
    cells = exudyn_layout.build_mesh(beam, (0.0, 0.3, 0.1 + 0.2, 1.0 - 1e-16, 1.0), 10)
    assert len(cells.lengths) == 10
    assert cells.lengths.min() > 0.9 * beam.length / 10
    assert cells.find_node(0.3) == cells.find_node(0.1 + 0.2) == 3
    assert cells.fraction[0] == 0.0
    assert cells.fraction[-1] == 1.0
    apart = exudyn_layout.build_mesh(beam, (0.0, 0.3, 0.3 + 1e-6, 1.0), 10)
    assert len(apart.lengths) == 11  # what is apart stays apart
