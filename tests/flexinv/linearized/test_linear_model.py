"""State spaces: the same roots as the modes, the same motion as the march, and other people's control libraries."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import control
import numpy as np
import pytest
import rigid_trees as trees
import scipy.signal
from flexible_examples import STRIP

import flexinv
from flexinv.analysis.overview import resolve_start_configuration
from flexinv.errors import InputError
from flexinv.files.load_cases import load_cases
from flexinv.linearized.linear_model import linear_model
from flexinv.linearized.steady_modes import steady_modes
from flexinv.model.mechanism import WORLD, Beam, Body, Inertia, Joint, Link, Mechanism
from flexinv.rigid.torque_derivatives import torque_derivatives
from flexinv.typing import Array

# Eigenvalues of matrices that were transformed and solved with: some thousand roundings of the largest that are compared.
ROUNDING = 1e-9


def arm(rotor: float = 0.02) -> Mechanism:
    """A strip on a hub with a rotor and a damper, a ball at its tip."""
    ball = Body("ball", Inertia(0.1), 1.0)
    joint = Joint("hub", "revolute", WORLD, "strip", rotor_inertia=rotor, damping=0.03)
    return Mechanism("arm", (Link("strip", (ball,), Beam(0.4, STRIP, 1, 4)),), (joint,), gravity=np.zeros(3))


def slowest(a: Array, count: int) -> Array:
    values = np.linalg.eigvals(a)
    values = values[values.imag > 1.0]
    return values[np.argsort(np.abs(values))][:count]


@pytest.mark.parametrize("rates", [{}, {"hub": 9.0}])
def test_its_poles_are_the_roots_of_the_modes(rates: dict[str, float]) -> None:
    model = linear_model(arm(), rates=rates)
    modes = steady_modes(arm(), rates=rates, free=["hub"])
    swinging = modes.root[modes.root.imag > 1.0][:4]
    np.testing.assert_allclose(slowest(model.A, 4), swinging, rtol=ROUNDING)
    held = linear_model(arm(), rates=rates, accelerated=["hub"])
    np.testing.assert_allclose(slowest(held.A, 4), steady_modes(arm(), rates=rates, count=4).root, rtol=ROUNDING)


def test_libraries_for_control_take_it() -> None:
    model = linear_model(arm(), modes=3)
    system = scipy.signal.StateSpace(*model.matrices)
    time, response = scipy.signal.impulse(system, T=np.linspace(0.0, 0.1, 11))
    named = control.ss(*model.matrices, states=model.states, inputs=model.inputs, outputs=model.outputs)
    assert named.input_labels == ["hub effort"]
    assert named.output_labels == ["hub", "hub rate", "strip tip x", "strip tip y", "strip tip z"]
    theirs = control.impulse_response(named, time)
    np.testing.assert_allclose(theirs.outputs[0, 0], response[:, 0], rtol=0, atol=1e-9 * np.abs(response).max())
    frequency = 30.0
    theirs = named(1j * frequency)
    own = model.C @ np.linalg.solve(1j * frequency * np.eye(len(model.A)) - model.A, model.B) + model.D
    np.testing.assert_allclose(theirs, own, rtol=1e-9, atol=1e-12 * np.abs(own).max())
    assert len(model.state_units) == len(model.states) == 6
    assert model.input_units == ("N m",)
    assert model.output_units == ("rad", "rad/s", "m", "m", "m")


def test_a_small_torque_moves_both_alike() -> None:
    """The state space against the march of the same mechanism under a torque that is smooth and small."""
    time = np.linspace(0.0, 0.2, 2001)
    torque = 1e-4 * np.sin(np.pi * time / 0.2) ** 2
    solution = flexinv.simulate(arm(), time, torque[:, None], step=1e-4)
    model = linear_model(arm())
    _, result, _ = scipy.signal.lsim(model.matrices, torque, time)
    for name, series in (("hub", solution.q[:, 0]), ("strip tip y", solution.tip["strip"][:, 1])):
        ours = result[:, model.outputs.index(name)]
        # time error of the march, (h omega)^2 / 12 of the 50 Hz that are excited most, and 1e-4 of squares of the angle
        np.testing.assert_allclose(ours, series, rtol=0, atol=2e-4 * np.abs(series).max())


def test_another_rotor_is_seen() -> None:
    heavier, own = slowest(linear_model(arm(0.03)).A, 1), slowest(linear_model(arm()).A, 1)
    assert abs(heavier / own - 1).max() > 0.01


def test_a_given_acceleration_moves_both_alike() -> None:
    motion = flexinv.Motion.point_to_point({"hub": 0.0}, {"hub": 1e-3}, duration=0.1, hold=0.1, law="quintic")
    solution = flexinv.solve(arm(), motion, step=1e-4)
    model = linear_model(arm(), accelerated=["hub"])
    assert model.inputs == ("hub acceleration",)
    assert model.input_units == ("rad/s^2",)
    _, result, _ = scipy.signal.lsim(model.matrices, solution.qdd[:, 0], solution.time)
    for name, series in (("hub", solution.q[:, 0]), ("strip tip y", solution.tip["strip"][:, 1])):
        ours = result[:, model.outputs.index(name)]
        np.testing.assert_allclose(ours, series, rtol=0, atol=2e-4 * np.abs(series).max())


def test_a_rigid_mechanism_is_its_torques_derivatives() -> None:
    """x'' = -M^-1 (C x' + K x - tau), in other coordinates: the same response, and the effort that holds it as bias."""
    mechanism, _ = trees.double_pendulum()
    mechanism = replace(mechanism, joints=tuple(replace(j, damping=0.3) for j in mechanism.joints))
    at = np.array([0.4, -0.7])
    model = linear_model(mechanism, at)
    slopes = torque_derivatives(mechanism, at, np.zeros(2), np.zeros(2))
    mass, damping, stiffness = (part[0] for part in (slopes.qdd, slopes.qd, slopes.q))
    s = 0.7 + 3.0j
    exact = np.linalg.inv(s * s * mass + s * damping + stiffness)
    result = model.C[:2] @ np.linalg.solve(s * np.eye(4) - model.A, model.B)
    np.testing.assert_allclose(result, exact, rtol=ROUNDING)
    holding = flexinv.joint_torques(mechanism, at, np.zeros(2), np.zeros(2))
    np.testing.assert_allclose(model.bias, holding, rtol=ROUNDING)


def test_what_cannot_be_accelerated_is_said(root: Path) -> None:
    with pytest.raises(InputError, match=r"accelerated joint 'hup': expected one of hub"):
        linear_model(arm(), accelerated=["hup"])
    loop = flexinv.load_mechanism(root / "models" / "four_bar")
    first = loop.joints[0].name
    with pytest.raises(InputError, match=r"has closures.*efforts of the drives are the inputs"):
        linear_model(loop, accelerated=[first])


def test_a_loop_has_its_drive_as_input(root: Path) -> None:
    loop = flexinv.load_mechanism(root / "models" / "four_bar")
    case = next(iter(load_cases(root / "models" / "four_bar", loop).values()))
    model = linear_model(loop, resolve_start_configuration(loop, case))
    drives = [n for n, driven in zip(loop.velocity_names, loop.actuated, strict=True) if driven]
    assert model.inputs == tuple(f"{name} effort" for name in drives)
    assert model.A.shape == (2, 2)  # one freedom
    assert np.abs(model.B).max() > 0
