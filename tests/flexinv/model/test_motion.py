"""Motions as theorems: qd and qdd are the derivatives of q in the mechanism's own layout, whatever the joint."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexinv.errors import InputError, ModelWarning
from flexinv.model.mechanism import WORLD, Joint, Link, Mechanism
from flexinv.model.motion import Motion
from flexinv.model.track import LAWS

KINDS = ("free", "revolute", "continuous", "spherical", "universal", "prismatic")
H = 1e-3  # [s], step of the differences below
STENCIL = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / (60.0 * H)  # sixth order


def chain(*kinds: str, actuated: bool = True) -> Mechanism:
    """A chain whose joints are named after their kind."""
    parents = [WORLD, *kinds]
    joints = tuple(Joint(k, k, parent, k, actuated=actuated) for k, parent in zip(kinds, parents, strict=False))
    return Mechanism("chain", tuple(Link(k) for k in kinds), joints)


ALL = chain(*KINDS)
START = {
    "free": [0.1, -0.2, 0.3, *Rotation.from_rotvec([0.3, -0.4, 0.5]).as_quat()],
    "revolute": -0.5,
    "continuous": 0.3,
    "spherical": Rotation.from_rotvec([1.0, 0.2, -0.3]).as_quat(),
    "universal": [0.1, 0.9],
    "prismatic": 0.05,
}
END = {
    "free": [1.1, 0.8, -0.3, *Rotation.from_rotvec([-0.9, 0.4, 1.5]).as_quat()],
    "revolute": 1.5,
    "continuous": 8.3,
    "spherical": Rotation.from_rotvec([-0.5, 1.2, 0.8]).as_quat(),
    "universal": [-1.1, 0.2],
    "prismatic": 0.35,
}


def wave(time: np.ndarray) -> dict[str, np.ndarray]:
    """Smooth samples of every joint; the rotation vectors turn about changing axes."""
    phases = np.arange(12)
    x = np.sin(1.7 * time[:, None] + phases) + 0.3 * np.cos(4.1 * time[:, None] - phases)  # (samples, 12)
    return {
        "free": np.hstack([x[:, :3], Rotation.from_rotvec(x[:, 3:6]).as_quat()]),
        "revolute": x[:, 6],
        "continuous": 9.0 * time + x[:, 7],
        "spherical": Rotation.from_rotvec(x[:, 8:11]).as_quat(),
        "universal": x[:, 10:12],
        "prismatic": x[:, 11],
    }


def derivative_errors(
    evaluate: Callable[[np.ndarray], tuple[np.ndarray, ...]], time: np.ndarray
) -> tuple[float, float]:
    """Largest error of qd and of qdd against sixth-order differences of q and of qd, joint by joint."""
    around = [evaluate(time + k * H) for k in range(-3, 4)]
    q, qd, qdd = evaluate(time)
    slope = sum(c * a[0] for c, a in zip(STENCIL, around, strict=True))  # (samples, nq)
    differences = np.empty_like(qd)
    for joint in ALL.joints:
        rows, columns = ALL.q_slices[joint.name], ALL.v_slices[joint.name]
        differences[:, columns] = velocity(joint.kind, q[:, rows], slope[:, rows])
    rate = sum(c * a[1] for c, a in zip(STENCIL, around, strict=True))
    return float(np.abs(differences - qd).max()), float(np.abs(rate - qdd).max())


def velocity(kind: str, q: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Velocity coordinates from dq/dt, by textbook formulas that the module under test does not use."""
    if kind == "continuous":  # cos * sin' - sin * cos'
        return (q[:, 0] * slope[:, 1] - q[:, 1] * slope[:, 0])[:, None]
    if kind == "spherical":
        x, y, z, w = q.T
        # omega = 2 E(q) q', rows of E: Shabana, Dynamics of Multibody Systems, eq. 2.111 (body frame), x y z w here
        rows = np.array([[w, z, -y, -x], [-z, w, x, -y], [y, -x, w, -z]])  # (3, 4, samples)
        return 2.0 * np.einsum("ijs,sj->si", rows, slope)
    if kind == "free":
        return np.hstack(
            [Rotation.from_quat(q[:, 3:]).inv().apply(slope[:, :3]), velocity("spherical", q[:, 3:], slope[:, 3:])]
        )
    return slope


@pytest.mark.parametrize("law", LAWS)
def test_rates_of_a_move_are_derivatives_of_it(law: str) -> None:
    motion = Motion.point_to_point(START, END, 2.0, hold=0.3, delay=0.2, law=law)
    time = np.linspace(-0.1, 2.6, 541)
    time = time[np.min(np.abs(time[:, None] - np.array([0.2, 2.2, *motion.jumps])), axis=1) > 3 * H]
    # truncation: H^6/140 times the 7th derivative, 8 rad * pi^7: 2e-13; rounding: the quintic adds terms of size 16,
    # 4e-15, times 8 rad, times the sum of the stencil's magnitudes, 110/(60 H)
    assert max(derivative_errors(lambda t: motion.evaluate(ALL, t), time)) < 4e-15 * 8.0 * 110.0 / (60.0 * H)


def test_rates_of_samples_are_derivatives_of_the_spline() -> None:
    knots = np.linspace(0.0, 1.5, 31)
    motion = Motion.from_samples(knots, wave(knots))
    time = np.linspace(0.01, 1.49, 371)
    time = time[np.min(np.abs(time[:, None] - knots), axis=1) > 3 * H]  # the fifth derivative jumps at the samples
    # between samples a quintic polynomial is differentiated exactly; normalising a quaternion leaves truncation of
    # H^6/140 * (5 rad/s)^7 = 6e-16; what is left is rounding: angles of 14 rad carry 3e-15, slopes 5 * 3e-15/(1/20)
    # (degree over interval), times the sum of the stencil's magnitudes
    assert max(derivative_errors(lambda t: motion.evaluate(ALL, t), time)) < 3e-13 * 110.0 / (60.0 * H)


def test_wrong_rates_are_caught() -> None:
    motion = Motion.point_to_point(START, END, 2.0)
    time = np.linspace(0.1, 1.9, 61)

    def in_the_wrong_frame(t: np.ndarray) -> tuple[np.ndarray, ...]:
        q, qd, qdd = motion.evaluate(ALL, t)
        turn = Rotation.from_quat(q[:, ALL.q_slices["free"]][:, 3:])
        qd = qd.copy()
        qd[:, :3] = turn.apply(qd[:, :3])  # the world's velocity in place of the body's
        return q, qd, qdd

    def without_transport(t: np.ndarray) -> tuple[np.ndarray, ...]:
        q, qd, qdd = motion.evaluate(ALL, t)
        qdd = qdd.copy()
        qdd[:, :3] += np.cross(qd[:, 3:6], qd[:, :3])  # R^T p'' in place of its difference to omega x v
        return q, qd, qdd

    assert derivative_errors(in_the_wrong_frame, time)[0] > 0.1
    assert derivative_errors(without_transport, time)[1] > 0.1


@pytest.mark.parametrize("law", LAWS)
def test_ends_are_the_given_configurations_at_rest(law: str) -> None:
    motion = Motion.point_to_point(START, END, 0.7, hold=0.4, law=law)
    assert motion.duration == pytest.approx(1.1)
    q, qd, qdd = motion.evaluate(ALL, [-1.0, 0.0, 0.7, 1.0, 1.1, 5.0])
    same = Motion.point_to_point(START, START, 1.0).evaluate(ALL, [0.5])[0]
    np.testing.assert_allclose(q[:2], np.repeat(same, 2, axis=0), rtol=0, atol=1e-15)
    # the geodesic arrives at R_0 exp(log(R_0^T R_1)): the sign of a quaternion is free, rounding of a few products
    there = Motion.point_to_point(END, END, 1.0).evaluate(ALL, [0.5])[0]
    for joint in ALL.joints:
        got, wanted = q[2:, ALL.q_slices[joint.name]], there[:, ALL.q_slices[joint.name]]
        if joint.kind in ("spherical", "free"):
            got = got * np.sign(got[:, -1:] * wanted[:, -1:]) ** (np.arange(joint.nq) >= joint.nq - 4)
        np.testing.assert_allclose(got, np.repeat(wanted, 4, axis=0), rtol=0, atol=2e-15)
    np.testing.assert_array_equal(qd[[0, 2, 3, 4, 5]], 0.0)
    np.testing.assert_array_equal(qdd[[0, 2, 3, 4, 5]], 0.0)


def test_rotation_takes_the_geodesic_at_constant_axis() -> None:
    motion = Motion.point_to_point(START, END, 1.0)
    _, qd, qdd = motion.evaluate(ALL, np.linspace(0.1, 0.9, 9))
    turn = Rotation.from_quat(START["spherical"]).inv() * Rotation.from_quat(END["spherical"])
    omega = qd[:, ALL.v_slices["spherical"]]
    np.testing.assert_allclose(np.cross(omega, turn.as_rotvec()), 0.0, rtol=0, atol=1e-14)  # rounding of products ~5
    np.testing.assert_allclose(np.cross(qdd[:, ALL.v_slices["spherical"]], turn.as_rotvec()), 0.0, rtol=0, atol=1e-14)


def test_both_quaternion_signs_turn_the_shorter_way() -> None:
    start = {"spherical": [0.0, 0.0, 0.0, 1.0]}
    end = Rotation.from_rotvec([0.0, 0.0, 0.4]).as_quat()
    for sign in (1.0, -1.0):
        _, qd, _ = Motion.point_to_point(start, {"spherical": sign * end}, 1.0).evaluate(chain("spherical"), [0.5])
        np.testing.assert_allclose(qd, [[0.0, 0.0, 0.8]], rtol=0, atol=1e-15)  # cycloid: twice the mean speed


def test_continuous_joint_turns_as_far_as_the_angle_says() -> None:
    one = chain("continuous")
    for start, end, peak in ((0.0, 7.0, 14.0), ([1.0, 0.0], [np.cos(7.0), np.sin(7.0)], 2.0 * (7.0 - 2.0 * np.pi))):
        _, qd, _ = Motion.point_to_point({"continuous": start}, {"continuous": end}, 1.0).evaluate(one, [0.5])
        assert qd[0, 0] == pytest.approx(peak, rel=1e-15)


def test_arrays_and_names_give_the_same_motion() -> None:
    time = np.linspace(0.0, 1.0, 11)
    named = Motion.point_to_point(START, END, 1.0)
    short = [np.concatenate([np.atleast_1d(c[k]) for k in KINDS]) for c in (START, END)]
    by_position = Motion.point_to_point(*short, 1.0)
    for a, b in zip(named.evaluate(ALL, time), by_position.evaluate(ALL, time), strict=True):
        np.testing.assert_array_equal(a, b)
    full = [named.evaluate(ALL, [t])[0][0] for t in (0.0, 1.0)]
    q, _, _ = Motion.point_to_point(*full, 1.0).evaluate(ALL, [0.0])
    np.testing.assert_allclose(q[0], full[0], rtol=0, atol=1e-15)


@pytest.mark.parametrize(("degree", "order"), [(3, 2), (5, 4)])
def test_sampled_acceleration_converges_at_the_order_of_the_spline(degree: int, order: int) -> None:
    """A spline of degree k through samples h apart has an acceleration error of h^(k-1), de Boor, chapter XII."""
    time = np.linspace(0.4, 1.1, 211)
    errors = []
    fine = np.linspace(0.0, 1.5, 601)
    exact = Motion.from_samples(fine, wave(fine)).evaluate(ALL, time)[2]  # (1.5/600)^4: a thousandth of what follows
    for count in (31, 61):
        knots = np.linspace(0.0, 1.5, count)
        errors.append(
            np.abs(Motion.from_samples(knots, wave(knots), degree=degree).evaluate(ALL, time)[2] - exact).max()
        )
    # halving h divides the error by 2^order up to the next power of h (10 %)
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.2)


def test_samples_are_met_and_signs_do_not_matter() -> None:
    knots = np.linspace(0.0, 1.5, 31)
    samples = wave(knots)
    flipped = dict(samples)
    flipped["spherical"] = samples["spherical"] * np.where(np.arange(31) % 2, -1.0, 1.0)[:, None]
    flipped["continuous"] = np.angle(np.exp(1j * samples["continuous"]))  # wrapped into -pi..pi
    one, two = (Motion.from_samples(knots, s) for s in (samples, flipped))
    q, qd, _ = one.evaluate(ALL, knots)
    np.testing.assert_allclose(two.evaluate(ALL, knots)[1], qd, rtol=0, atol=1e-12)  # 9 rad/s, rounding of wrapping
    np.testing.assert_allclose(q[:, ALL.q_slices["revolute"]][:, 0], samples["revolute"], rtol=0, atol=1e-14)
    turned = Rotation.from_quat(q[:, ALL.q_slices["spherical"]]).inv() * Rotation.from_quat(samples["spherical"])
    np.testing.assert_allclose(turned.magnitude(), 0.0, rtol=0, atol=1e-14)


def test_names_give_the_columns_of_samples() -> None:
    knots = np.linspace(0.0, 1.0, 9)
    values = np.stack([knots**2, np.sin(knots), knots**3], axis=1)
    two = chain("universal", "revolute")
    q, _, _ = Motion.from_samples(knots, values, names=["revolute", "universal"]).evaluate(two, knots)
    np.testing.assert_allclose(q, values[:, [1, 2, 0]], rtol=0, atol=1e-15)


def test_rest_makes_samples_start_and_stop_smoothly() -> None:
    knots = np.linspace(0.0, 1.0, 21)
    one = chain("revolute")
    for degree, smooth in ((5, True), (3, False)):
        motion = Motion.from_samples(knots, {"revolute": np.sin(3.0 * knots)}, rest=True, degree=degree)
        _, qd, qdd = motion.evaluate(one, [0.0, 1.0])
        np.testing.assert_allclose(qd, 0.0, rtol=0, atol=1e-12)  # banded solve, speeds of 3 over intervals of 1/20
        assert bool(np.abs(qdd).max() < 1e-10) is smooth  # slopes of that rounding over 1/20
        assert motion.jumps == (() if smooth else (0.0, 1.0))


def test_a_motion_that_ends_moving_says_so_when_evaluated_beyond() -> None:
    knots = np.linspace(0.0, 1.0, 21)
    motion = Motion.from_samples(knots, {"revolute": np.sin(knots)})
    motion.evaluate(chain("revolute"), [1.0])
    with pytest.warns(
        ModelWarning, match="^joint 'revolute': the samples end while moving, then stop at once; evaluate"
    ):
        _, qd, _ = motion.evaluate(chain("revolute"), [1.0, 1.1])
    assert qd[0, 0] == pytest.approx(np.cos(1.0), abs=3e-7)  # (1/20)^5, the order of a quintic's slope
    assert qd[1, 0] == 0.0


def test_merge_joins_joints_and_lets_the_shorter_rest() -> None:
    two = chain("revolute", "prismatic")
    long = Motion.point_to_point({"revolute": 0.0}, {"revolute": 1.0}, 1.0, law="bang-bang")
    short = Motion.point_to_point({"prismatic": 0.0}, {"prismatic": 0.2}, 0.4, delay=0.1, law="bang-bang")
    both = Motion.merge(long, short)
    assert both.duration == 1.0
    np.testing.assert_allclose(both.jumps, [0.0, 0.1, 0.3, 0.5, 1.0], rtol=0, atol=1e-15)
    q, _, qdd = both.evaluate(two, [0.0, 0.1, 0.5, 1.0])
    np.testing.assert_allclose(q[:, 1], [0.0, 0.0, 0.2, 0.2], rtol=0, atol=1e-16)
    np.testing.assert_allclose(qdd[:, 1], [0.0, 5.0, 0.0, 0.0], rtol=0, atol=1e-14)
    np.testing.assert_allclose(qdd[:, 0], [4.0, 4.0, -4.0, -4.0], rtol=0, atol=1e-14)  # at the end: from the left
    assert both.joints(two) == ("revolute", "prismatic")


def test_times_of_a_grid_hit_the_jumps() -> None:
    one = chain("revolute")
    motion = Motion.point_to_point({"revolute": 0.0}, {"revolute": 1.0}, 0.6, hold=0.1, law="bang-bang")
    grid = np.arange(0, 701) * 1e-3
    right, left = (motion.evaluate(one, grid, side=side)[2][:, 0] for side in ("right", "left"))
    peak = pytest.approx(4.0 / 0.36, rel=1e-14)
    assert (right[0], -right[300], right[600]) == (peak, peak, 0.0)
    assert (left[0], left[300], -left[600]) == (0.0, peak, peak)
    different = np.flatnonzero(right != left)
    np.testing.assert_array_equal(different, [0, 300, 600])


def test_passive_joints_stay_at_zero_and_are_not_listed() -> None:
    two = chain("revolute", "spherical", actuated=False)
    motion = Motion.point_to_point({"revolute": 0.0}, {"revolute": 1.0}, 1.0)
    q, qd, _ = motion.evaluate(two, [0.0, 0.5])
    np.testing.assert_array_equal(q[:, 1:], [[0, 0, 0, 1], [0, 0, 0, 1]])
    np.testing.assert_array_equal(qd[:, 1:], 0.0)
    assert motion.joints(two) == ("revolute",)


def test_values_cannot_change_after_the_fact() -> None:
    start = np.zeros(1)
    motion = Motion.point_to_point(start, [1.0], 1.0)
    start[0] = 7.0
    assert motion.evaluate(chain("revolute"), [0.0])[0][0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        motion.tracks[0].values[0, 0] = 7.0


GRID = np.linspace(0.0, 1.0, 11)
ZERO = {"revolute": 0.0}
BAD_MOVES = {
    "duration = 0.0 s: expected a positive time": lambda: Motion.point_to_point(ZERO, ZERO, 0.0),
    "duration = nan s: expected a positive time": lambda: Motion.point_to_point(ZERO, ZERO, np.nan),
    "hold = -1.0 s: expected a time, 0 or more": lambda: Motion.point_to_point(ZERO, ZERO, 1.0, hold=-1.0),
    "law = 'linear': expected one of cycloid": lambda: Motion.point_to_point(ZERO, ZERO, 1.0, law="linear"),
    "start gives revolute, end gives prismatic: expected the same joints in both": lambda: Motion.point_to_point(
        ZERO, {"prismatic": 1.0}, 1.0
    ),
    "start has 2 numbers, end has 3: expected as many in both": lambda: Motion.point_to_point([0, 0], [1, 1, 1], 1.0),
    "end, joint 'revolute': nan; expected finite numbers": lambda: Motion.point_to_point(
        ZERO, {"revolute": np.nan}, 1.0
    ),
    "start: expected numbers, got ['a']": lambda: Motion.point_to_point(["a"], [0.0], 1.0),
    "time: sample 3 at 0.3 s does not come after sample 2 at 0.4 s; sort the samples": lambda: Motion.from_samples(
        [0, 0.1, 0.4, 0.3, 0.5, 0.6], np.zeros((6, 1))
    ),
    "time starts at 5 s: expected 0; write time - time[0]": lambda: Motion.from_samples(GRID + 5, np.zeros((11, 1))),
    "5 samples: a spline of degree 5 needs at least 6": lambda: Motion.from_samples(GRID[:5], np.zeros((5, 1))),
    "degree = 4: expected 5 (smooth jerk) or 3": lambda: Motion.from_samples(GRID, np.zeros((11, 1)), degree=4),
    "time: a gap of 1.4 s after sample 6 at 0.6 s, more than 1 s; fill the gap, or write max_gap": lambda: (
        Motion.from_samples([0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 2.0], np.zeros((8, 1)))
    ),
    "q: nan at sample 4, column 1; expected finite numbers": lambda: Motion.from_samples(
        GRID, np.where(np.arange(22).reshape(11, 2) == 9, np.nan, 0.0)
    ),
    "q: expected 11 rows, one per time, got shape (10, 1)": lambda: Motion.from_samples(GRID, np.zeros((10, 1))),
    "time: nan at sample 2; expected finite numbers": lambda: Motion.from_samples([0, 1, np.nan], np.zeros((3, 1))),
    "names: a, a: expected each joint once": lambda: Motion.from_samples(GRID, np.zeros((11, 2)), names=["a", "a"]),
    "merge: expected at least one motion": Motion.merge,
    "merge: two motions give joint 'revolute'; expected each joint once": lambda: Motion.merge(
        *[Motion.point_to_point(ZERO, ZERO, 1.0)] * 2
    ),
    "merge: a motion of all joints by position": lambda: Motion.merge(Motion.point_to_point([0.0], [0.0], 1.0)),
}


@pytest.mark.parametrize("message", BAD_MOVES)
def test_bad_motion_is_refused_with_advice(message: str) -> None:
    with pytest.raises(InputError) as caught:
        BAD_MOVES[message]()
    assert str(caught.value).startswith(message)


TURN = Rotation.from_rotvec([0.0, 0.0, 2.0]).as_quat()
BAD_FOR_A_MECHANISM = {
    "a motion for joint 'revolut', which does not exist; write 'revolute'; chain moves by revolute": (
        ("revolute",),
        lambda: Motion.point_to_point({"revolut": 0.0}, {"revolut": 1.0}, 1.0),
    ),
    "a motion for joint 'fixed', which is fixed; chain moves by revolute": (
        ("revolute", "fixed"),
        lambda: Motion.point_to_point({"fixed": 0.0}, {"fixed": 1.0}, 1.0),
    ),
    "the motion gives no joint 'prismatic', which has an actuator; give it a motion (start = end holds it)": (
        ("revolute", "prismatic", "universal"),
        lambda: Motion.point_to_point(ZERO, ZERO, 1.0),
    ),
    "4 coordinates: expected 3 (or 2, with one angle per continuous joint): revolute 1, continuous 2": (
        ("revolute", "continuous"),
        lambda: Motion.point_to_point([0.0] * 4, [0.0] * 4, 1.0),
    ),
    "3 coordinates: expected 1: revolute 1": (("revolute",), lambda: Motion.point_to_point([0.0] * 3, [1.0] * 3, 1.0)),
    "joint 'universal' (universal) takes 2 numbers, got 3": (
        ("universal",),
        lambda: Motion.point_to_point({"universal": [0, 0, 0]}, {"universal": [0, 0, 1]}, 1.0),
    ),
    "joint 'continuous' (continuous) takes 1 or 2 numbers, got 3": (
        ("continuous",),
        lambda: Motion.point_to_point({"continuous": [0, 0, 0]}, {"continuous": [0, 0, 1]}, 1.0),
    ),
    "joint 'continuous': (2, 0) is no cosine and sine; write the angle [rad]": (
        ("continuous",),
        lambda: Motion.point_to_point({"continuous": [1, 0]}, {"continuous": [2, 0]}, 1.0),
    ),
    "joint 'spherical': a quaternion of norm 2; expected x, y, z, w of norm 1 (neutral: 0, 0, 0, 1)": (
        ("spherical",),
        lambda: Motion.point_to_point({"spherical": [0, 0, 0, 1]}, {"spherical": [2, 0, 0, 0]}, 1.0),
    ),
    "joint 'spherical': turns by 115 deg between samples 0 and 1; a spline of rotations needs samples less than 90": (
        ("spherical",),
        lambda: Motion.from_samples(GRID[:6], {"spherical": np.array([[0, 0, 0, 1], *[TURN] * 5])}),
    ),
}


@pytest.mark.parametrize("message", BAD_FOR_A_MECHANISM)
def test_motion_that_does_not_fit_the_mechanism_is_refused_with_advice(message: str) -> None:
    kinds, make = BAD_FOR_A_MECHANISM[message]
    with pytest.raises(InputError) as caught:
        make().evaluate(chain(*kinds), GRID)
    assert str(caught.value).startswith(message)
