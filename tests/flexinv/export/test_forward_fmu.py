"""FMUs of forward dynamics: the motion of `flexinv.simulate` step by step, and that of an inverse FMU whose torques drive it."""

from __future__ import annotations

import importlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from c_library import needs_compiler
from fmu_driver import driven, needs_fmpy
from four_bar_example import four_bar
from rigid_trees import chain
from scipy.spatial.transform import Rotation

import flexinv
from flexinv.errors import InputError
from flexinv.model.links import Body, Inertia
from flexinv.model.mechanism import Mechanism, with_retardation
from flexinv.typing import Array

pytestmark = [needs_compiler, needs_fmpy]
STEP = 2e-3  # [s]
STEPS = 60
# The same kernel makes the same steps; Python reads angles off rotations, which loses the last digits of some radians.
READ_ANGLE = 1e-12
READ_RATE = 1e-10  # of the largest: a rounding of 1e-15 rad within a sixteenth of a step, some of them
READ_ACCELERATION = 1e-8  # of the largest: what Newton's last increment leaves, over a sixteenth of a step squared
ROUNDED_DAMPING = 1e-9  # [rad]: one rounding of 1e-16 in stresses, over the axial strains of a thin strip, marched on
LOAD = Inertia(0.3, np.array([0.02, -0.01, 0.05]), np.diag([1e-3, 2e-3, 1.5e-3]))


@pytest.fixture(scope="module")
def bending() -> Mechanism:
    return replace(flexinv.load_mechanism("models/flex_two_link"), gravity=np.array([0.0, -9.81, 0.0]))


@pytest.fixture(scope="module")
def rigid() -> Mechanism:
    return flexinv.load_mechanism("models/rigid_3r")


@pytest.fixture(scope="module")
def arm(bending: Mechanism, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flexinv.export_fmu(bending, tmp_path_factory.mktemp("forward") / "arm.fmu", kind="forward", step=STEP)


def make_torque(mechanism: Mechanism, size: float, first: float = 0.0) -> tuple[Array, Array]:
    """Times, and torques of the drives that differ; ``first`` : with which they begin."""
    time = STEP * np.arange(STEPS + 1)
    count = int(mechanism.actuated.sum())
    return time, first + np.outer(np.sin(40.0 * time), size * np.arange(1, count + 1))


def name_torques(mechanism: Mechanism) -> list[str]:
    return [f"{n}.tau" for n, driven in zip(mechanism.velocity_names, mechanism.actuated, strict=True) if driven]


def run(file: Path, mechanism: Mechanism, torque: Array, **values: float) -> tuple[Array, Array]:
    """Coordinates and rates at all instants."""
    outputs = [f"{n}.q" for n in mechanism.coordinate_names] + [f"{n}.qd" for n in mechanism.velocity_names]
    inputs = name_torques(mechanism)
    held = values.get("torque.held") == 1.0
    with driven(file) as fmu:
        fmu.begin(values | dict(zip(inputs, torque[0], strict=True)))
        rows = [fmu.get(*outputs), *fmu.replay(inputs, torque[:-1] if held else torque[1:], outputs, STEP)]
    return np.split(np.array(rows), [mechanism.nq], axis=1)  # type: ignore[return-value]


def simulate(mechanism: Mechanism, time: Array, torque: Array, start: Array | None = None) -> flexinv.Solution:
    began = mechanism.neutral if start is None else start
    starts = dict(zip(mechanism.coordinate_names, began, strict=True))
    return flexinv.simulate(mechanism, time, torque, step=STEP, initial="static", start=starts)


def assert_motion(result: tuple[Array, Array], expected: flexinv.Solution) -> None:
    np.testing.assert_allclose(result[0], expected.q, rtol=0, atol=READ_ANGLE)
    rates = np.abs(expected.qd).max()
    np.testing.assert_allclose(result[1], expected.qd, rtol=0, atol=READ_RATE * max(rates, 1.0))
    assert np.ptp(expected.q, axis=0).max() > 0.01


@pytest.mark.parametrize("first", [0.0, 0.02])
def test_an_arm_that_bends_moves_as_simulate_moves_it(arm: Path, bending: Mechanism, first: float) -> None:
    """Torques that begin elsewhere than what holds the arm are a sudden start: its first steps are made in parts."""
    time, torque = make_torque(bending, 0.01, first)
    assert_motion(run(arm, bending, torque), simulate(bending, time, torque))


def test_held_torques_are_steps_of_a_staircase(arm: Path, bending: Mechanism) -> None:
    time, torque = make_torque(bending, 0.01)
    twice = np.repeat(time, 2)[1:-1]
    stairs = np.repeat(torque[:-1], 2, axis=0)
    result = run(arm, bending, torque, **{"torque.held": 1.0})
    expected = simulate(bending, twice, stairs)
    assert_motion(result, expected)
    linear = run(arm, bending, torque)
    assert np.abs(linear[0] - result[0]).max() > 1e-4  # the parameter does something


@pytest.mark.parametrize("fmi", ["3.0", "2.0"])
def test_a_rigid_arm_feels_gravity_payload_and_friction(rigid: Mechanism, tmp_path: Path, fmi: str) -> None:
    last = rigid.links[-1].name
    file = flexinv.export_fmu(rigid, tmp_path / "arm.fmu", fmi=fmi, kind="forward", step=STEP, payloads=(last,))
    assert importlib.import_module("fmpy.validation").validate_fmu(str(file)) == []
    gravity = np.array([1.0, -2.0, -9.0])
    joints = (replace(rigid.joints[0], damping=0.5), *rigid.joints[1:])
    heavy = replace(rigid.with_body(last, Body("load", LOAD)), gravity=gravity, joints=joints)
    time, torque = make_torque(rigid, 0.5)
    i = LOAD.tensor
    numbers = {"mass": LOAD.mass, "inertia.xx": i[0, 0], "inertia.yy": i[1, 1], "inertia.zz": i[2, 2]}
    numbers |= {f"centre.{axis}": one for axis, one in zip("xyz", LOAD.com, strict=True)}
    values = {f"{last}.payload.{name}": float(one) for name, one in numbers.items()} | {"joint1.damping": 0.5}
    values |= {f"gravity.{axis}": float(one) for axis, one in zip("xyz", gravity, strict=True)}
    assert_motion(run(file, rigid, torque, **values), simulate(heavy, time, torque))


def test_damping_of_beams_is_a_parameter(bending: Mechanism, tmp_path: Path) -> None:
    """So many times that of the mechanism; products of two numbers round in another order."""
    flat = replace(bending, gravity=np.zeros(3))
    damped = [with_retardation(flat, seconds) for seconds in (1e-3, 3e-3)]
    file = flexinv.export_fmu(damped[0], tmp_path / "arm.fmu", kind="forward", step=STEP)
    time, torque = make_torque(flat, 0.002)
    result = run(file, damped[0], torque, **{"link1.damping": 3.0, "link2.damping": 3.0})
    expected = simulate(damped[1], time, torque).q
    np.testing.assert_allclose(result[0], expected, rtol=0, atol=ROUNDED_DAMPING)
    assert np.abs(run(file, damped[0], torque)[0] - expected).max() > 1e-4


def test_a_loop_moves_as_simulate_moves_it(tmp_path: Path) -> None:
    bar = four_bar()
    guess = np.array([0.3, 0.8, 1.8])
    file = flexinv.export_fmu(bar, tmp_path / "bar.fmu", kind="forward", step=STEP, start=guess)
    with driven(file) as fmu:
        fmu.begin({"A.tau": 0.0})
        start = np.array(fmu.get("A.q", "B.q", "D.q"))
        assert "A.qdd" not in fmu.places
    time, torque = make_torque(bar, 1.0)
    assert_motion(run(file, bar, torque), simulate(bar, time, torque, start))


def test_torques_of_the_inverse_fmu_give_its_motion_back(tmp_path: Path) -> None:
    """Up to the steps' error, as `flexinv.simulate` does with the torques of `flexinv.solve` (docs/howto/tip-path.md)."""
    step = 5e-4
    link = flexinv.load_mechanism("models/flex_one_link")
    files = [
        flexinv.export_fmu(link, tmp_path / f"{kind}.fmu", kind=kind, step=step) for kind in ("inverse", "forward")
    ]
    turn = flexinv.Motion.point_to_point({"hub": 0.0}, {"hub": np.pi}, duration=0.2, hold=0.1)
    time = step * np.arange(601)
    q, qd, qdd = turn.evaluate(link, time)
    with driven(files[0]) as inverse, driven(files[1]) as forward:
        inverse.begin({"hub.q": q[0, 0]})
        names = ["hub.q", "hub.qd", "hub.qdd"]
        told = ["hub.tau", "link.deflection.y"]
        torque = np.array([inverse.get(*told), *inverse.replay(names, np.hstack([q, qd, qdd])[1:], told, step)])
        forward.begin({"hub.tau": torque[0, 0]})
        asked = ["hub.q", "link.deflection.y"]
        moved = np.array([forward.get(*asked), *forward.replay(["hub.tau"], torque[1:, :1], asked, step)])
    error = np.abs(moved[:, 0] - q[:, 0]).max()
    again = flexinv.simulate(link, time, torque[:, :1], step=step)
    assert error < 1e-6 * np.pi
    assert error <= np.abs(again.q - q).max() + READ_ANGLE
    assert np.abs(moved[:, 1] - torque[:, 1]).max() < 1e-6  # [m], of a deflection of some centimetres
    assert np.abs(torque[:, 1]).max() > 0.01


def test_a_step_that_fails_leaves_the_arm_where_it_was(arm: Path, bending: Mechanism) -> None:
    _, torque = make_torque(bending, 0.01, 0.02)
    inputs = name_torques(bending)
    outputs = [f"{n}.q" for n in bending.coordinate_names]
    with driven(arm) as fmu, driven(arm) as other:
        for one in (fmu, other):
            one.begin(dict(zip(inputs, torque[0], strict=True)))
            one.replay(inputs, torque[1:3], outputs, STEP)  # in parts: the start is sudden
        for values, said in (
            ({"joint1.tau": 1e9}, "step: "),
            ({"joint1.tau": float("nan")}, "a number that is given is infinite or not a number"),
            ({"torque.held": 0.5}, "a mass, an inertia, friction or an index that cannot be"),
        ):
            fmu.set(values)
            with pytest.raises(Exception, match="failed with status 2"):
                fmu.step(2 * STEP, STEP)
            assert said in fmu.said[-1]
        fmu.set({"torque.held": 0.0})
        results = [one.replay(inputs, torque[3:9], outputs, STEP, 2) for one in (fmu, other)]
    assert np.array_equal(*results)


def test_a_continuous_joint_gives_the_cosine_and_the_sine_of_its_angle(bending: Mechanism, tmp_path: Path) -> None:
    """From an angle of its own, beyond half a turn, as a hub of an arm that bends."""
    hub = replace(bending.joints[0], kind="continuous")
    arm = replace(bending, joints=(hub, *bending.joints[1:]), gravity=np.zeros(3))
    angle = 3.138  # [rad]
    start = np.array([np.cos(angle), np.sin(angle), 0.2])
    file = flexinv.export_fmu(arm, tmp_path / "arm.fmu", kind="forward", step=STEP, start=start)
    time, torque = make_torque(arm, 0.005, 0.02)
    expected = flexinv.simulate(
        arm, time, torque, step=STEP, initial="static", start={hub.name: start[:2], bending.joints[1].name: 0.2}
    )
    assert expected.q[:, 1].min() < 0.0 < expected.q[0, 1]  # across pi
    assert_motion(run(file, arm, torque), expected)


def test_joints_with_quaternions_give_what_python_reads_off_rotations(tmp_path: Path) -> None:
    """A ball joint on a turning arm, driven; and a base that floats, with an arm: both turned to begin with.

    The quaternion begins on the side of the start, and goes on without jumps.
    """
    turned = Rotation.from_rotvec([0.2, -0.1, 2.9]).as_quat()
    for kind in ("spherical", "free"):
        m = replace(chain(kind), gravity=np.array([0.3, 0.2, -0.5]))
        if kind == "free":
            m = replace(m, joints=(replace(m.joints[0], actuated=False), *m.joints[1:]))
        start = m.neutral.copy()
        (joint,) = (one for one in m.joints if one.kind == kind)
        span = m.q_slices[joint.name]
        start[span] = turned if kind == "spherical" else [0.4, -0.2, 0.3, *-turned]
        file = flexinv.export_fmu(
            m, tmp_path / f"{kind}.fmu", kind="forward", step=STEP, start=start, initial="consistent"
        )
        assert importlib.import_module("fmpy.validation").validate_fmu(str(file)) == []
        time, torque = make_torque(m, 10.0, 2.0)
        begins = {one.name: start[m.q_slices[one.name]] for one in m.joints}
        expected = flexinv.simulate(m, time, torque, step=STEP, start=begins)
        outputs = [f"{n}.qdd" for n in m.velocity_names]
        assert_motion(run(file, m, torque), expected)
        with driven(file) as fmu:
            fmu.begin(dict(zip(name_torques(m), torque[0], strict=True)))
            rows = fmu.replay(name_torques(m), torque[1:], outputs, STEP)
        most = np.abs(expected.qdd).max()
        np.testing.assert_allclose(rows, expected.qdd[1:], rtol=0, atol=READ_ACCELERATION * most)
        assert np.abs(np.diff(expected.q[:, span], axis=0)).max() < 0.1
        assert expected.q[0, span][-1] * turned[-1] * (1.0 if kind == "spherical" else -1.0) > 0.0


def test_what_no_torques_move_is_refused(bending: Mechanism, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="the time between two calls in seconds"):
        flexinv.export_fmu(bending, tmp_path / "x.fmu", kind="forward")
    assert not list(tmp_path.iterdir())
