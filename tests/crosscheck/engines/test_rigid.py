"""Pinocchio and MuJoCo against first principles and a closed form, joint kind by joint kind, and against each other.

The judge (`kane.py`) knows nothing of spatial algebra, of either engine or of flexinv's recursion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import kane
import numpy as np
import pytest
import rigid_trees as trees
import sympy
from numpy.typing import NDArray

from crosscheck.engines.mujoco import adapter as mujoco
from crosscheck.engines.pinocchio import adapter as pinocchio
from crosscheck.studies.robot_sweep import sample_states
from flexinv import joint_torques
from flexinv.model.mechanism import Body, Inertia, Joint, Mechanism, Placement

Array = NDArray[np.float64]
# Some thousand double-precision operations per effort: a few hundred roundings of the largest term.
ROUNDING = 1e-13
# A planted fault must be out of all proportion to rounding; the smallest one here, an inertia turned by 0.1 rad in one
# of fourteen bodies, shows as 1.8e-4 of the largest effort.
SEEN = 1e-4


@dataclass(frozen=True)
class Answer:
    torque: Array
    wrench: dict[str, Array]
    tip: dict[str, Array]


def by_pinocchio(mechanism: Mechanism, q: Array, qd: Array, qdd: Array) -> Answer:
    result = pinocchio.compute_inverse_dynamics(pinocchio.build(mechanism), q, qd, qdd)
    return Answer(result.torque + pinocchio.passive_effort(mechanism, qd), result.wrench, result.tip)


def by_mujoco(mechanism: Mechanism, q: Array, qd: Array, qdd: Array) -> Answer:
    with mujoco.collect_warnings() as words:
        result = mujoco.compute_inverse_dynamics(mechanism, mujoco.build(mechanism), q, qd, qdd)
    assert words == []
    return Answer(result.torque, result.wrench, result.tip)


Engine = Callable[[Mechanism, Array, Array, Array], Answer]
ENGINES = {"pinocchio": by_pinocchio, "mujoco": by_mujoco}


@pytest.fixture(params=ENGINES)
def engine(request: pytest.FixtureRequest) -> Engine:
    return ENGINES[request.param]


def states(mechanism: Mechanism, samples: int = 5) -> tuple[Array, Array, Array]:
    return sample_states(mechanism, samples, np.random.default_rng(11))


def first_principles(mechanism: Mechanism, q: Array, qd: Array, qdd: Array) -> Array:
    return np.array([kane.torque(mechanism, *row) for row in zip(q, qd, qdd, strict=True)])


def error(a: Array, b: Array) -> float:
    return float(np.abs(a - b).max() / np.abs(b).max())


# ------------------------------------------------------------------------------------------------ closed forms


def lagrangian(p: dict[str, float]) -> Callable[..., tuple[float, float]]:
    """tau = d/dt dL/dq' - dL/dq of the planar double pendulum, derived symbolically."""
    t = sympy.Symbol("t")
    names = sympy.symbols("a b da db dda ddb")
    a, b = sympy.Function("a")(t), sympy.Function("b")(t)

    def along(angle: sympy.Expr, length: float) -> sympy.Matrix:
        return sympy.Matrix([length * sympy.cos(angle), length * sympy.sin(angle)])

    first = along(a, p["c1"])
    second = along(a, p["l1"]) + along(a + b, p["c2"])
    energy = sum(
        m * x.diff(t).dot(x.diff(t)) / 2 + i * w**2 / 2 - m * p["g"] * x[1]
        for m, x, i, w in (
            (p["m1"], first, p["i1"], a.diff(t)),
            (p["m2"], second, p["i2"], (a + b).diff(t)),
        )
    )
    tau = [energy.diff(x.diff(t)).diff(t) - energy.diff(x) for x in (a, b)]
    plain = {
        a.diff(t, 2): names[4],
        b.diff(t, 2): names[5],
        a.diff(t): names[2],
        b.diff(t): names[3],
        a: names[0],
        b: names[1],
    }
    return sympy.lambdify(names, [sympy.expand(x).subs(plain) for x in tau])


def test_double_pendulum_is_its_lagrangian(engine: Engine) -> None:
    mechanism, parameters = trees.double_pendulum()
    formula = lagrangian(parameters)
    q, qd, qdd = states(mechanism, 20)
    expected = np.array([formula(*a, *b, *c) for a, b, c in zip(q, qd, qdd, strict=True)])
    assert error(engine(mechanism, q, qd, qdd).torque, expected) < ROUNDING


def test_the_judge_is_the_lagrangian() -> None:
    mechanism, parameters = trees.double_pendulum()
    formula = lagrangian(parameters)
    q, qd, qdd = states(mechanism, 20)
    expected = np.array([formula(*a, *b, *c) for a, b, c in zip(q, qd, qdd, strict=True)])
    assert error(first_principles(mechanism, q, qd, qdd), expected) < ROUNDING


# ---------------------------------------------------------------------------------------- every joint, everything


@pytest.mark.parametrize("kind", trees.KINDS)
def test_every_joint_kind_on_a_moving_base(engine: Engine, kind: str) -> None:
    mechanism = trees.chain(kind)
    state = states(mechanism)
    assert error(engine(mechanism, *state).torque, first_principles(mechanism, *state)) < ROUNDING


def test_a_branching_tree_of_all_kinds(engine: Engine) -> None:
    mechanism = trees.tree()
    state = states(mechanism)
    assert error(engine(mechanism, *state).torque, first_principles(mechanism, *state)) < ROUNDING


def test_flexinv_is_the_judge_too() -> None:
    mechanism = trees.tree()
    state = states(mechanism)
    assert error(joint_torques(mechanism, *state), first_principles(mechanism, *state)) < ROUNDING


def test_wrenches_act_on_the_child_at_the_joint_in_the_childs_frame(engine: Engine) -> None:
    mechanism = trees.tree()
    state = states(mechanism)
    result = engine(mechanism, *state).wrench
    assert set(result) >= {j.name for j in mechanism.joints if j.nv}
    for name, wrench in result.items():
        joint = mechanism.joint_of[name]
        expected = np.array([kane.wrench(mechanism, joint, *row) for row in zip(*state, strict=True)])
        assert error(wrench, expected) < ROUNDING, name


def test_tips_of_all_links(engine: Engine) -> None:
    mechanism = trees.tree()
    state = states(mechanism)
    for name, tip in engine(mechanism, *state).tip.items():
        expected = np.array([kane.tip(mechanism, mechanism.link_of[name], q) for q in state[0]])
        assert error(tip, expected) < ROUNDING, name


def test_the_two_engines_agree() -> None:
    """To 1e-12 of the largest effort, over more states than the judge has time for."""
    mechanism = trees.tree()
    state = sample_states(mechanism, 100, np.random.default_rng(5))
    assert error(by_pinocchio(mechanism, *state).torque, by_mujoco(mechanism, *state).torque) < 1e-12


# --------------------------------------------------------------------------------------------------- conventions

DRIVES = {
    "rotor_inertia": lambda qd, qdd: qdd,
    "damping": lambda qd, qdd: qd,
    "friction": lambda qd, qdd: np.sign(qd),
}


@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("kind", [k for k in trees.KINDS if k != "free"])
def test_what_a_drive_adds(engine: Engine, kind: str, drive: str) -> None:
    """tau = M a + bias + I_rotor a + d v + f sign(v): one at a time, exactly that much, nowhere else."""
    bare = trees.without_drives(trees.chain(kind))
    joint = bare.joints[-1]
    driven = replace(bare, joints=(*bare.joints[:-1], replace(joint, **{drive: 0.6})))
    q, qd, qdd = states(bare)
    expected = np.zeros_like(qd)
    part = bare.v_slices[joint.name]
    expected[:, part] = 0.6 * DRIVES[drive](qd, qdd)[:, part]
    plain = engine(bare, q, qd, qdd).torque
    added = engine(driven, q, qd, qdd).torque - plain
    assert np.abs(added - expected).max() < ROUNDING * np.abs(plain).max()


def test_dry_friction_of_a_joint_at_rest_is_zero(engine: Engine) -> None:
    """sign(0) = 0, also where the joint is about to move."""
    mechanism = trees.chain("revolute")
    q, qd, qdd = states(mechanism)
    qd[:] = 0.0
    assert error(engine(mechanism, q, qd, qdd).torque, first_principles(mechanism, q, qd, qdd)) < ROUNDING


def test_dry_friction_at_a_crawl(engine: Engine) -> None:
    """Far below any speed of a machine the friction is still all there."""
    mechanism = trees.chain("revolute")
    q, qd, qdd = states(mechanism)
    qd = 1e-6 * np.sign(qd)
    assert error(engine(mechanism, q, qd, qdd).torque, first_principles(mechanism, q, qd, qdd)) < ROUNDING


def test_damping_of_a_free_joint_acts_in_the_body(engine: Engine) -> None:
    mechanism = trees.chain("free")
    q, qd, qdd = states(mechanism)
    part = mechanism.v_slices[mechanism.joints[0].name]
    added = engine(mechanism, q, qd, qdd).torque - engine(trees.without_drives(mechanism), q, qd, qdd).torque
    assert error(added[:, part], 0.7 * qd[:, part]) < 1e-12  # a difference of two efforts a hundred times as large


def test_weight_points_along_gravity(engine: Engine) -> None:
    """A body at rest on a free joint is held by -m g at its centre, turned into the body's frame."""
    mechanism = trees.without_drives(trees.tree((("body", "free", "world"),)))
    q, qd, qdd = states(mechanism)
    tau = engine(mechanism, q, 0 * qd, 0 * qdd).torque
    mass = sum(body.inertia.mass for body in mechanism.links[0].bodies)
    for row, force in zip(q, tau[:, :3], strict=True):
        axes = mechanism.joints[0].placement.rotation @ kane.quaternion(row[3:])
        np.testing.assert_allclose(axes @ force, -mass * mechanism.gravity, rtol=0, atol=ROUNDING * 100)


def test_a_free_base_carries_the_whole_momentum(engine: Engine) -> None:
    """Without gravity and outer forces on the joints, a rotated base feels d/dt (sum m c') and nothing of its place."""
    mechanism = replace(trees.tree(), gravity=np.zeros(3))
    state = states(mechanism)
    moved = state[0].copy()
    moved[:, :3] += 7.0
    one, other = engine(mechanism, *state).torque, engine(mechanism, moved, *state[1:]).torque
    assert error(one, other) < ROUNDING


# ---------------------------------------------------------------------------------------------------------- traps


def rod_and_point(massless: bool) -> Mechanism:
    """A thin rod (no inertia about its axis), a point mass, and if asked a massless cross between two hinges."""
    mechanism, _ = trees.double_pendulum()
    link = mechanism.links[1]
    point = Body("point", Inertia(0.4, np.array([0.3, 0.0, 0.0])))
    if massless:
        links = (replace(mechanism.links[0], bodies=()), replace(link, bodies=(*link.bodies, point)))
    else:
        links = (mechanism.links[0], replace(link, bodies=(point,)))
    turned = replace(mechanism.joints[1], axis=np.array([0.6, 0.0, 0.8]))
    return replace(mechanism, links=links, joints=(mechanism.joints[0], turned))


@pytest.mark.parametrize("massless", [False, True])
def test_rods_points_and_massless_links(engine: Engine, massless: bool) -> None:
    mechanism = rod_and_point(massless)
    state = states(mechanism)
    # MuJoCo's floor of 2e-15 kg m^2 beside 1e-2 kg m^2: 2e-13 of the effort at most
    assert error(engine(mechanism, *state).torque, first_principles(mechanism, *state)) < 3e-13


def test_a_massless_link_at_the_end(engine: Engine) -> None:
    """Nothing beyond a joint: its effort is zero, and no division by its mass spoils the others."""
    mechanism, _ = trees.double_pendulum()
    mechanism = replace(mechanism, links=(mechanism.links[0], replace(mechanism.links[1], bodies=())))
    state = states(mechanism)
    tau = engine(mechanism, *state).torque
    assert np.abs(tau[:, 1]).max() < 1e-13  # N m: the floor's weight at arm's length
    assert error(tau, first_principles(mechanism, *state)) < ROUNDING


def test_flat_plates_turned_in_space(engine: Engine) -> None:
    """I_z = I_x + I_y exactly: rounding of the principal axes must not make an impossible body of it."""
    for seed in range(20):
        random = np.random.default_rng(seed)
        axes = trees.placement(random).rotation
        a, b = random.uniform(0.1, 100.0, 2)
        plate = Inertia(1.0, np.zeros(3), axes @ np.diag([a, b, a + b]) @ axes.T)
        mechanism, _ = trees.double_pendulum()
        links = (mechanism.links[0], replace(mechanism.links[1], bodies=(Body("plate", plate),)))
        mechanism = replace(mechanism, links=links)
        state = states(mechanism, 2)
        assert error(engine(mechanism, *state).torque, first_principles(mechanism, *state)) < ROUNDING


# --------------------------------------------------------------------------------------------- the checks can fail


def faults() -> dict[str, Callable[[Mechanism], Mechanism]]:
    """One wrong datum each, in the model that an engine gets."""

    def joint(change: Callable[[Joint], Joint], name: str) -> Callable[[Mechanism], Mechanism]:
        return lambda m: replace(m, joints=tuple(change(j) if j.name == name else j for j in m.joints))

    def body(change: Callable[[Inertia], Inertia]) -> Callable[[Mechanism], Mechanism]:
        def of(m: Mechanism) -> Mechanism:
            first = m.links[1].bodies[0]
            bodies = (replace(first, inertia=change(first.inertia)), *m.links[1].bodies[1:])
            return replace(m, links=(m.links[0], replace(m.links[1], bodies=bodies), *m.links[2:]))

        return of

    turn = kane.about(np.array([0.0, 0.0, 1.0]), 0.1)
    return {
        "armature left out": joint(lambda j: replace(j, rotor_inertia=0.0), "shoulder_joint"),
        "damping left out": joint(lambda j: replace(j, damping=0.0), "shoulder_joint"),
        "friction left out": joint(lambda j: replace(j, friction=0.0), "shoulder_joint"),
        "axis sign": joint(lambda j: replace(j, axis=-j.axis), "slider_joint"),
        "axes of a universal joint exchanged": joint(
            lambda j: replace(j, axis=j.second_axis, second_axis=j.axis), "wrist_joint"
        ),
        "inertia turned": body(lambda i: i.replace_unchecked(tensor=turn @ i.tensor @ turn.T)),
        "mass about the wrong point": body(lambda i: i.replace_unchecked(com=np.zeros(3))),
        "payload lost": lambda m: replace(
            m, links=(*m.links[:3], replace(m.links[3], bodies=m.links[3].bodies[:1]), *m.links[4:])
        ),
        "gravity off": lambda m: replace(m, gravity=np.zeros(3)),
        "base turned": joint(lambda j: replace(j, placement=Placement(j.placement.position)), "base_joint"),
    }


@pytest.mark.parametrize("fault", faults())
def test_a_planted_fault_is_seen(engine: Engine, fault: str) -> None:
    mechanism = trees.tree()
    state = states(mechanism)
    wrong = engine(faults()[fault](mechanism), *state).torque
    assert error(wrong, first_principles(mechanism, *state)) > SEEN
