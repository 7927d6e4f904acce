"""The regressor against the torques themselves and Pinocchio's, and the parameters that torques can tell."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rigid_trees as trees
from flexible_examples import spatial_tree

from crosscheck.engines.pinocchio import adapter as pinocchio
from crosscheck.engines.pinocchio.adapter import pin
from flexinv import joint_torques
from flexinv.cli.commands import main
from flexinv.errors import InputError
from flexinv.model.mechanism import Inertia, Mechanism
from flexinv.rigid.torque_regressor import base_parameters, compute_link_parameters, sample_states, torque_regressor
from flexinv.typing import Array

# A few hundred roundings of the largest torque: ten terms for every link, through seven joints.
ROUNDING = 1e-13
# Without a fixed and a continuous joint, whose frames are not the links' in Pinocchio's model.
SIMPLE = (*trees.TREE[:4], ("hip", "spherical", "shoulder"))


def states(mechanism: Mechanism, samples: int = 7) -> tuple[Array, Array, Array]:
    return sample_states(mechanism, samples, seed=4)


def test_torque_is_the_regressor_times_the_parameters() -> None:
    """All kinds of joints, a fixed one among them, with rotors, dampers and dry friction."""
    mechanism = trees.tree()
    state = states(mechanism)
    regressor = torque_regressor(mechanism, *state, drives=True)
    expected = joint_torques(mechanism, *state)
    np.testing.assert_allclose(
        regressor.matrix @ regressor.values, expected, rtol=0, atol=ROUNDING * np.abs(expected).max()
    )
    assert len(regressor.names) == len(regressor.units) == len(regressor.values) == regressor.stacked().shape[1]


def test_springs_in_joints_are_linear_too() -> None:
    mechanism, _ = trees.double_pendulum()
    first = replace(mechanism.joints[0], stiffness=3.0, rest=0.2)
    wheel = replace(mechanism.joints[1], stiffness=2.0, rest=-0.1, kind="continuous")
    sprung = replace(mechanism, joints=(first, wheel))
    state = states(sprung)
    result, expected = torque_regressor(sprung, *state, drives=True), joint_torques(sprung, *state)
    np.testing.assert_allclose(result.matrix @ result.values, expected, rtol=0, atol=ROUNDING * np.abs(expected).max())


def test_pinocchio_has_the_same_matrix() -> None:
    """Ten columns per link, in its order; its joints' frames are our links' frames where none is fixed or continuous."""
    mechanism = trees.without_drives(trees.tree(SIMPLE))
    model = pinocchio.build(mechanism).model
    data = model.createData()
    state = states(mechanism)
    regressor = torque_regressor(mechanism, *state)
    for k, row in enumerate(zip(*state, strict=True)):
        theirs = pin.computeJointTorqueRegressor(model, data, *row)
        np.testing.assert_allclose(regressor.matrix[k], theirs, rtol=0, atol=ROUNDING * np.abs(theirs).max())
    own = [model.inertias[i].toDynamicParameters() for i in range(1, model.njoints)]
    np.testing.assert_allclose(regressor.values, np.concatenate(own), rtol=0, atol=ROUNDING * np.abs(own).max())


def test_another_order_of_the_inertia_is_seen() -> None:
    mechanism = trees.without_drives(trees.tree(SIMPLE))
    state = states(mechanism)
    ours, expected = torque_regressor(mechanism, *state), joint_torques(mechanism, *state)
    swapped = ours.values.reshape(-1, 10)[:, [0, 1, 2, 3, 4, 5, 7, 6, 8, 9]].ravel()  # Ixz before Iyy
    assert np.abs(ours.matrix @ swapped - expected).max() > 1e-2 * np.abs(expected).max()


def test_parameters_of_a_link_are_about_its_origin() -> None:
    mechanism, p = trees.double_pendulum()
    about = p["i1"] + p["m1"] * p["c1"] ** 2
    expected = [p["m1"], p["m1"] * p["c1"], 0, 0, 0, 0, about, 0, 0, about]
    np.testing.assert_allclose(compute_link_parameters(mechanism.links[0]), expected, rtol=1e-15)


def test_the_double_pendulum_has_four_base_parameters() -> None:
    """Textbook: I1 + m2 l1^2, m1 c1 + m2 l1, m2 c2, I2 (about the joints; here the pendulum swings in x-z)."""
    mechanism, p = trees.double_pendulum()
    found = base_parameters(torque_regressor(mechanism, *sample_states(mechanism, 40)))
    assert [found.names[k] for k in found.columns] == [
        "link1.hx", "link1.hz", "link1.Iyy", "link2.hx", "link2.hz", "link2.Iyy",
    ]  # fmt: skip
    assert found.expressions[0] == "link1.hx + 0.5 link2.m"
    assert found.expressions[2] == "link1.Iyy + 0.25 link2.m"
    i1, i2 = p["i1"] + p["m1"] * p["c1"] ** 2, p["i2"] + p["m2"] * p["c2"] ** 2
    exact = [p["m1"] * p["c1"] + p["m2"] * p["l1"], 0, i1 + p["m2"] * p["l1"] ** 2, p["m2"] * p["c2"], 0, i2]
    np.testing.assert_allclose(found.values, exact, rtol=0, atol=1e-12)
    assert "link1.m" in found.unseen
    assert "link2.Ixz" in found.unseen


def test_without_gravity_fewer_are_seen() -> None:
    mechanism, _ = trees.double_pendulum()
    weightless = replace(mechanism, gravity=np.zeros(3))
    found = base_parameters(torque_regressor(weightless, *sample_states(weightless, 40)))
    assert len(found.columns) == 4
    assert "link1.hx" in found.unseen


def test_base_parameters_give_the_torques_of_all() -> None:
    mechanism = trees.tree()
    full = torque_regressor(mechanism, *sample_states(mechanism, 60), drives=True)
    found = base_parameters(full)
    tau = full.stacked() @ full.values
    # columns that depend on others to DEPENDENT = 1e-9 were put to them
    np.testing.assert_allclose(full.stacked()[:, found.columns] @ found.values, tau, rtol=0, atol=1e-8 * abs(tau).max())
    fit = np.linalg.lstsq(full.stacked()[:, found.columns], tau, rcond=None)[0]
    np.testing.assert_allclose(fit, found.values, rtol=0, atol=1e-8 * np.abs(found.values).max())


def test_three_joints_in_general_position_have_the_known_number() -> None:
    """Revolute joints in general position: Gautier's rules, and the rank of Y itself."""
    mechanism = trees.without_drives(
        trees.tree((("a", "revolute", "world"), ("b", "revolute", "a"), ("c", "revolute", "b")))
    )
    full = torque_regressor(mechanism, *sample_states(mechanism, 60))
    assert len(base_parameters(full).columns) == np.linalg.matrix_rank(full.stacked(), tol=1e-9)
    # Gautier: of each revolute link three go to others (m, h along the axis, one of I); of the first, on a fixed axis that is
    # not along gravity, only I about the axis and two of h are left
    assert len(base_parameters(full).columns) == 3 + 7 + 7


def test_a_payload_is_identified_from_torques() -> None:
    mechanism = trees.without_drives(trees.tree(SIMPLE))
    heavier = Inertia(0.7, np.array([0.1, -0.2, 0.05]), np.diag([0.01, 0.02, 0.025]))
    last = mechanism.links[-1]
    loaded = replace(last, bodies=(replace(last.bodies[0], inertia=heavier),))
    other = replace(mechanism, links=(*mechanism.links[:-1], loaded))
    state = sample_states(mechanism, 30)
    full = torque_regressor(mechanism, *state)
    change = (joint_torques(other, *state) - joint_torques(mechanism, *state)).ravel()
    result = np.linalg.lstsq(full.stacked(), change, rcond=1e-10)[0]
    np.testing.assert_allclose(full.stacked() @ result, change, rtol=0, atol=1e-11 * np.abs(change).max())


def test_what_cannot_be_is_said() -> None:
    with pytest.raises(InputError, match="links that bend"):
        torque_regressor(spatial_tree(), *(np.zeros(spatial_tree().nv) for _ in range(3)))
    mechanism, _ = trees.double_pendulum()
    still = replace(mechanism, gravity=np.zeros(3))
    nothing = torque_regressor(still, *(np.zeros((1, 2)) for _ in range(3)))
    with pytest.raises(InputError, match="the regressor is zero"):
        base_parameters(nothing)


def test_the_command_prints_the_combinations(capsys: pytest.CaptureFixture[str], root: Path) -> None:
    main(["parameters", str(root / "models" / "double_pendulum")])
    words = capsys.readouterr().out
    assert words.splitlines()[0] == "double_pendulum: 6 base parameters of 20, 13 without effect"
    assert re.search(r"kg m\^2 +upper.Iyy \+ lower.m\n", words)
