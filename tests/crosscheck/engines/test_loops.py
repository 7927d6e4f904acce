"""Closed loops, springs and forces in Pinocchio and MuJoCo: against flexinv, against each other, and with faults."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import loop_examples as examples
import numpy as np
import pinocchio as pin
import pytest
from loop_examples import Example
from numpy.typing import NDArray

import flexinv
from crosscheck.engines.base import sample_times
from crosscheck.engines.exudyn import adapter as exudyn
from crosscheck.engines.mujoco import adapter as mujoco
from crosscheck.engines.mujoco import flex as mujoco_flex
from crosscheck.engines.pinocchio import adapter as pinocchio
from crosscheck.engines.pinocchio import loops as pinocchio_loops
from crosscheck.engines.pinocchio.model import convert_to_engine
from crosscheck.engines.shared import loop_closure as assembly
from crosscheck.measures.record import WRENCH, XYZ, Record, check
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Attachment, Closure, Force, Mechanism, Placement

Array = NDArray[np.float64]
# What is asked for; rounding of the loops' small linear systems leaves some 1e-13 of the range (measured: 6e-14).
NEAR = {"pinocchio": 1e-10, "mujoco": 1e-8}
MODULES: dict[str, Any] = {"pinocchio": pinocchio, "mujoco": mujoco, "mujoco-equality": mujoco}
EXAMPLES: dict[str, Callable[[], Example]] = {
    "four-bar": examples.four_bar,
    "four-bar, spherical": partial(examples.four_bar, "spherical"),
    "four-bar, universal": partial(examples.four_bar, "universal"),
    "five-bar, two drives": partial(examples.five_bar, 2),
    "five-bar, three drives": partial(examples.five_bar, 3),
    "slider-crank, pin": partial(examples.slider_crank, "pin"),
    "slider-crank, prismatic": partial(examples.slider_crank, "prismatic"),
    "slider-crank, cylindrical": partial(examples.slider_crank, "cylindrical"),
    "slider-crank, point-on-line": partial(examples.slider_crank, "point-on-line"),
    "spatial": examples.spatial,
    "platform": examples.platform,
    "springs and forces in a loop": examples.loaded,
    "springs and forces on a tree": examples.loaded_tree,
}


def by(engine: str, example: Example) -> Record:
    module = MODULES[engine]
    assert module.unsupported(*example, engine) is None
    record: Record = module.run(*example, engine, {})
    check(record, sample_times(example[1]))
    return record


def reference(example: Example) -> dict[str, Array]:
    """flexinv's torques, tips, wrenches and closure reactions by series name."""
    mechanism, case = example
    s = flexinv.solve(mechanism, case.motion, case.sample, start=case.start)
    made = {f"torque/{name}": s.torque_all[:, k] for k, name in enumerate(mechanism.velocity_names)}
    for link, tip in s.tip.items():
        made |= {f"tip/{link}/{axis}": column for axis, column in zip(XYZ, tip.T, strict=True)}
    for quantity, wrenches in (("wrench", s.wrench), ("reaction", s.loops.reaction if s.loops else {})):
        for name, wrench in wrenches.items():
            made |= {f"{quantity}/{name}/{part}": column for part, column in zip(WRENCH, wrench.T, strict=True)}
    return made


def apart(record: Record, expected: dict[str, Array], quantity: str) -> float:
    """Largest difference over the largest value of a quantity."""
    ours = {n: s.values for n, s in record.series.items() if n.startswith(f"{quantity}/") and n in expected}
    assert ours
    size = max(np.abs(expected[n]).max() for n in ours)
    return float(max(np.abs(v - expected[n]).max() for n, v in ours.items()) / size)


@pytest.mark.parametrize("engine", NEAR)
@pytest.mark.parametrize("name", EXAMPLES)
def test_an_engine_agrees_with_flexinv(name: str, engine: str) -> None:
    example = EXAMPLES[name]()
    record, expected = by(engine, example), reference(example)
    for quantity in ("torque", "tip", "wrench", *(["reaction"] if example[0].closures else [])):
        assert apart(record, expected, quantity) < NEAR[engine]


def test_a_mechanism_closed_elsewhere_is_the_same() -> None:
    """The slider-crank cut at its pin and at its slide: one torque."""
    torques = [
        by("pinocchio", examples.slider_crank(cut)).series["torque/A"].values for cut in ("prismatic", "cylindrical")
    ]
    assert torques[0] == pytest.approx(torques[1], abs=1e-12 * np.abs(torques[0]).max())  # rounding


# ------------------------------------------------------------------------------------- the engines' own constraints


def test_mujocos_equality_constraints_return_the_open_tree() -> None:
    """The deviation has its cause: the native result is the cut tree's effort, passive joints included."""
    for name in ("four-bar", "five-bar, two drives", "platform", "springs and forces in a loop"):
        example = EXAMPLES[name]()
        record, expected = by("mujoco-equality", example), reference(example)
        assert apart(record, expected, "torque") > 0.1
        assert "mj_inverse gives the efforts of the open tree" in record.message
        mechanism, case = example
        built, time = pinocchio.build(mechanism), sample_times(case)
        state = pinocchio_loops.solve_motion(mechanism, case, built, time)
        opened = pinocchio_loops.solve_efforts(replace(mechanism, closures=()), built, time, state)
        moving = np.abs(state[1]).min(axis=1) > 0.0  # dry friction at rest is MuJoCo's own, see the head of `mujoco`
        for k, velocity in enumerate(mechanism.velocity_names):
            values = record.series[f"torque/{velocity}"].values
            # Rounding of the closed position, some 1e-14 m, times a stiffness of 1e5 / s^2 times 1e4 kg: the constraint's
            # inertia over 1 - impedance (measured: 1e-5)
            assert values[moving] == pytest.approx(opened.torque[moving, k], abs=1e-4 * np.abs(opened.torque).max())


def test_mujoco_says_which_closures_it_has_no_equality_for() -> None:
    mechanism, case = examples.four_bar("universal")
    assert mujoco.unsupported(mechanism, case, "mujoco-equality") == (
        "no equality constraint of MuJoCo makes up the closures C: see mujoco"
    )
    tree = examples.loaded_tree()
    assert mujoco.unsupported(*tree, "mujoco-equality") == "no closed loop: see mujoco"


@pytest.mark.parametrize(
    ("kind", "contact"), [("spherical", pin.ContactType.CONTACT_3D), ("fixed", pin.ContactType.CONTACT_6D)]
)
def test_pinocchios_constraint_models_span_our_rows(kind: str, contact: pin.ContactType) -> None:
    """Its getConstraintsJacobian after calc() at a closed position, where it has a model for the kind."""
    mechanism, case = examples.spatial()
    built = pinocchio.build(mechanism)
    q, v, _ = pinocchio_loops.solve_motion(mechanism, case, built, sample_times(case))
    data, closure = built.model.createData(), mechanism.closures[0]
    tree = pinocchio_loops.Tree(replace(mechanism, closures=(replace(closure, kind=kind),)), built, data)
    position = convert_to_engine(built, q, v, v)[0][7]
    if kind == "fixed":  # frames that coincide where the ball lets them differ
        tree.compute_frame_pairs(position, 0 * v[7])
        turn = tree.compute_frame(closure.second).r.T @ tree.compute_frame(closure.first).r
        second = replace(closure.second, placement=Placement(closure.second.placement.position, turn))
        closure = replace(closure, kind=kind, second=second)
        tree = replace(tree, mechanism=replace(mechanism, closures=(closure,)))
    rows = assembly.assemble_rows(tree.mechanism.closures, tree.compute_frame_pairs(position, 0 * v[7])).g
    ends = [(built.link[e.link][0], built.link[e.link][1] * _se3(e)) for e in (closure.first, closure.second)]
    model = pin.RigidConstraintModel(contact, built.model, ends[0][0], ends[0][1], ends[1][0], ends[1][1])
    rigid = model.createData()
    model.calc(built.model, data, rigid)
    theirs = pin.getConstraintsJacobian(built.model, data, [model], [rigid])
    both = np.vstack([theirs, rows])
    assert np.linalg.matrix_rank(both) == np.linalg.matrix_rank(theirs) == np.linalg.matrix_rank(rows)


def _se3(at: Attachment) -> pin.SE3:
    return pin.SE3(at.placement.rotation, at.placement.position)


# -------------------------------------------------------------------------------------------- faults that must show


def closure(change: Callable[[Closure], Closure]) -> Callable[[Mechanism], Mechanism]:
    return lambda m: replace(m, closures=(change(m.closures[0]),))


def spring(**change: float) -> Callable[[Mechanism], Mechanism]:
    return lambda m: replace(m, springs=(replace(m.springs[0], **change),))  # type: ignore[arg-type]


def force(index: int, change: Callable[[Force], Force]) -> Callable[[Mechanism], Mechanism]:
    return lambda m: replace(m, forces=tuple(change(f) if k == index else f for k, f in enumerate(m.forces)))


def moved_by(at: Attachment, dx: float) -> Attachment:
    return replace(at, placement=Placement(at.placement.position + np.array([dx, 0.0, 0.0]), at.placement.rotation))


FAULTS: dict[str, Callable[[Mechanism], Mechanism]] = {
    "closure 1 mm off": closure(lambda c: replace(c, second=moved_by(c.second, 1e-3))),
    "spring too stiff": spring(stiffness=41.0),
    "spring too long": spring(rest=0.21),
    "damper left out": spring(damping=0.0),
    "force constant": force(0, lambda f: replace(f, wrench=f.wrench[:1], time=f.time[:1])),
    "force follows": force(0, lambda f: replace(f, follower=True)),
    "thrust does not follow": force(1, lambda f: replace(f, follower=False)),
    "thrust along the link": force(1, lambda f: replace(f, at=replace(f.at, placement=Placement(f.at.placement.position)))),
    "force at another point": force(0, lambda f: replace(f, at=moved_by(f.at, 0.01))),
    "moment left out": force(0, lambda f: replace(f, wrench=f.wrench * (1, 1, 1, 0, 0, 0))),
    "springs in joints left out": lambda m: replace(m, joints=tuple(replace(j, stiffness=0.0) for j in m.joints)),
    "their rest left out": lambda m: replace(m, joints=tuple(replace(j, rest=0.0) for j in m.joints)),
    "damping of a passive joint left out": lambda m: replace(
        m, joints=tuple(j if j.actuated else replace(j, damping=0.0) for j in m.joints)
    ),
    "rotor of a passive joint left out": lambda m: replace(
        m, joints=tuple(j if j.actuated else replace(j, rotor_inertia=0.0) for j in m.joints)
    ),
}  # fmt: skip


@pytest.mark.parametrize("engine", NEAR)
def test_a_planted_fault_is_seen(engine: str) -> None:
    mechanism, case = examples.loaded()
    expected = reference((mechanism, case))
    for name, fault in FAULTS.items():
        wrong = by(engine, (fault(mechanism), case))
        assert apart(wrong, expected, "torque") > 1e-4, name  # a million times what is asked for


def test_a_fault_in_the_rates_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without G' v the accelerations of the passive joints are wrong, and with them the torque."""
    example = examples.four_bar()
    expected = reference(example)
    right = assembly.assemble_rows

    def without_bias(*arguments: object) -> assembly.ClosureRows:
        rows = right(*arguments)  # type: ignore[arg-type]
        return replace(rows, bias=0 * rows.bias)

    monkeypatch.setattr(assembly, "assemble_rows", without_bias)
    assert apart(by("pinocchio", example), expected, "torque") > 1e-2


# --------------------------------------------------------------------------------------------------- what is refused


def test_loops_that_do_not_close_are_named() -> None:
    mechanism, case = examples.four_bar()
    far = replace(mechanism.closures[0], second=Attachment("rocker", Placement(np.array([9.0, 0.0, 0.0]))))
    with pytest.raises(assembly.AssemblyError, match=r"the loops do not close at t = 0 s"):
        pinocchio.run(replace(mechanism, closures=(far,)), case, "pinocchio", {})


def test_a_motion_that_gives_too_little_is_named() -> None:
    mechanism, case = examples.five_bar(2)
    less = replace(
        case,
        motion=flexinv.Motion.point_to_point({"A": 2.2}, {"A": 1.5}, 0.6),
        start={**case.start, "E": np.array([0.9])},
    )
    with pytest.raises(assembly.AssemblyError, match=r"leave 1 of 3 coordinates open at t = 0 s"):
        mujoco.run(mechanism, less, "mujoco", {})


def test_a_position_out_of_reach_is_named() -> None:
    mechanism, case = examples.four_bar()
    short = replace(mechanism.closures[0], first=moved_by(mechanism.closures[0].first, -0.35))
    with pytest.raises(assembly.AssemblyError, match=r"the loops cannot be followed beyond t = 0\.\d+ s|leave 1 of 2"):
        pinocchio.run(
            replace(mechanism, closures=(short,)),
            replace(case, start={"B": np.array([0.5]), "D": np.array([2.4])}),
            "pinocchio",
            {},
        )


def test_drives_that_cannot_hold_are_named() -> None:
    mechanism, case = examples.four_bar()
    loose = replace(mechanism, joints=tuple(replace(j, actuated=False) for j in mechanism.joints))
    for engine in NEAR:
        with pytest.raises(assembly.AssemblyError, match=r"the actuated joints cannot hold the mechanism"):
            MODULES[engine].run(loose, case, engine, {})


REFUSED: dict[str, tuple[Example, str]] = {
    "closure": (examples.four_bar(), "closed loops (C)"),
    "spring": (examples.loaded_tree(), "springs (spring)"),
    "force": (examples.loaded_tree(), "applied forces (load, thrust)"),
    "springs in joints": (examples.loaded_tree(), "springs in joints (J, K)"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_the_formulation_of_open_trees_refuses(what: str) -> None:
    example, words = REFUSED[what]
    reason = exudyn.unsupported(*example, "exudyn")
    assert reason is not None
    assert words in reason
    for engine in ("exudyn-ancf", "exudyn-ge"):  # these do all of it, but for beams
        assert exudyn.unsupported(*example, engine) == "no link bends: see exudyn-dae"


def test_mujocos_flex_refuses_springs() -> None:
    mechanism, case = _with_beam()
    assert "springs (spring)" in str(mujoco_flex.unsupported(mechanism, case, "mujoco-flex"))


def _with_beam() -> tuple[Mechanism, Case]:
    mechanism, case = examples.loaded_tree()
    section = flexinv.model.mechanism.Section(np.zeros(1), np.ones((1, 6)), np.ones(1), np.ones((1, 3)))
    hand = replace(mechanism.links[1], beam=flexinv.model.mechanism.Beam(0.3, section), bodies=())
    return replace(mechanism, links=(mechanism.links[0], hand), forces=()), case


def test_a_jacobian_that_is_rounding_ties_nothing() -> None:
    """A second bearing of a shaft: no singular value is large enough to show that all are small."""
    g, tree, one = np.array([[1e-16, 0.0], [2e-17, -1e-16]]), np.array([3.0, -2.0]), np.ones(2)
    effort = assembly.split_efforts(g, tree, one > 0, one)
    np.testing.assert_allclose(effort, tree, rtol=1e-15)
    assert np.abs(assembly.solve_multipliers(g, tree, effort)).max() == 0.0
