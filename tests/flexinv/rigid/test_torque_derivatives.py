"""Derivatives of torques against differences of the torques and Pinocchio's."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import rigid_trees as trees
from flexible_examples import spatial_tree
from scipy.spatial.transform import Rotation

from crosscheck.engines.pinocchio import adapter as pinocchio
from crosscheck.engines.pinocchio.adapter import pin
from flexinv import joint_torques
from flexinv.errors import InputError
from flexinv.model.mechanism import Attachment, Mechanism, Spring
from flexinv.rigid import torque_derivatives as module
from flexinv.rigid.derivative_kernel import CarriedBodies
from flexinv.rigid.torque_derivatives import torque_derivatives
from flexinv.rigid.torque_regressor import sample_states
from flexinv.typing import Array

# Sums of some hundred products, each of the size of the largest.
ROUNDING = 1e-13
# Central differences of fourth order at 1e-3: truncation 1e-12 of the fifth derivative, rounding 1e-16 / 1e-3, of torques
# that are up to ten times as large as their derivatives.
STEP, DIFFERENCES = 1e-3, 1e-10


def moved(mechanism: Mechanism, q: Array, step: Array) -> Array:
    """q after a small motion in every joint's own coordinates; a free joint's displacement is in its child's frame."""
    out = q.copy()
    for joint in mechanism.joints:
        at, by = mechanism.q_slices[joint.name], step[mechanism.v_slices[joint.name]]
        if joint.kind in ("spherical", "free"):
            turn = Rotation.from_quat(q[at][-4:])
            out[at.stop - 4 : at.stop] = (turn * Rotation.from_rotvec(by[-3:])).as_quat()
            if joint.kind == "free":
                out[at.start : at.start + 3] += turn.apply(by[:3])
        elif joint.kind == "continuous":
            angle = np.arctan2(q[at][1], q[at][0]) + by[0]
            out[at] = np.cos(angle), np.sin(angle)
        else:
            out[at] += by
    return out


def differences(mechanism: Mechanism, q: Array, qd: Array, qdd: Array) -> tuple[Array, Array, Array]:
    """d tau / dq, dqd, dqdd (nv, nv) of one sample by central differences of fourth order."""

    def slope(which: int) -> Array:
        out = np.empty((mechanism.nv, mechanism.nv))
        for k, step in enumerate(STEP * np.eye(mechanism.nv)):

            def torque(factor: float, step: Array = step) -> Array:
                state = [q, qd, qdd]
                state[which] = moved(mechanism, q, factor * step) if which == 0 else state[which] + factor * step
                return joint_torques(mechanism, *state)

            out[:, k] = (8 * (torque(1) - torque(-1)) - (torque(2) - torque(-2))) / (12 * STEP)
        return out

    return slope(0), slope(1), slope(2)


def smooth(mechanism: Mechanism) -> Mechanism:
    """Without dry friction, which has no slope."""
    return replace(mechanism, joints=tuple(replace(j, friction=0.0) for j in mechanism.joints))


@pytest.mark.parametrize("kinds", [trees.TREE, trees.TREE[1:3]], ids=["tree", "arm"])
def test_differences_of_torques(kinds: tuple[tuple[str, str, str], ...]) -> None:
    """All kinds of joints, a fixed one and branches among them, springs and damping."""
    rooted = ((kinds[0][0], kinds[0][1], "world"), *kinds[1:])
    mechanism = smooth(trees.tree(rooted))
    sprung = tuple(replace(j, stiffness=2.5) if j.kind in ("revolute", "prismatic") else j for j in mechanism.joints)
    mechanism = replace(mechanism, joints=sprung)
    state = sample_states(mechanism, 3, seed=5)
    derivatives = torque_derivatives(mechanism, *state)
    for k, row in enumerate(zip(*state, strict=True)):
        for ours, theirs in zip(
            (derivatives.q, derivatives.qd, derivatives.qdd), differences(mechanism, *row), strict=True
        ):
            np.testing.assert_allclose(ours[k], theirs, rtol=0, atol=DIFFERENCES * np.abs(derivatives.q).max())


def test_pinocchio_has_the_same_derivatives() -> None:
    """Without a universal joint: there its own derivative is not that of its own torques (it takes the axes as constant)."""
    kinds = (*trees.TREE[:2], ("slider", "prismatic", "shoulder"), ("hip", "spherical", "slider"))
    mechanism = trees.without_drives(trees.tree(kinds))
    model = pinocchio.build(mechanism).model
    data = model.createData()
    state = sample_states(mechanism, 5, seed=6)
    derivatives = torque_derivatives(mechanism, *state, passive=False)
    for k, row in enumerate(zip(*state, strict=True)):
        by_q, by_qd, mass = pin.computeRNEADerivatives(model, data, *row)
        mass = np.triu(mass) + np.triu(mass, 1).T
        for ours, theirs in ((derivatives.q, by_q), (derivatives.qd, by_qd), (derivatives.qdd, mass)):
            np.testing.assert_allclose(ours[k], theirs, rtol=0, atol=ROUNDING * np.abs(theirs).max())


def test_a_far_base_loses_nothing() -> None:
    """A body a kilometre away: moments are taken about a point of it, not about the world's origin."""
    mechanism = smooth(trees.chain("free"))
    q, qd, qdd = sample_states(mechanism, 1, seed=7)
    far = q.copy()
    far[:, :3] += 1000.0
    near, there = torque_derivatives(mechanism, q, qd, qdd), torque_derivatives(mechanism, far, qd, qdd)
    # positions of a kilometre are known to 1e-13 m
    np.testing.assert_allclose(there.q, near.q, rtol=0, atol=1e-11 * np.abs(near.q).max())


def test_a_missing_term_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Masses about a point that is off by a millimetre show in the comparison with differences."""
    mechanism = smooth(trees.tree())
    state = sample_states(mechanism, 1, seed=5)

    def shifted(*given: Any) -> CarriedBodies:
        carried = CarriedBodies(*given)
        return carried._replace(h=carried.h + 1e-3)

    monkeypatch.setattr(module, "CarriedBodies", shifted)
    derivatives = torque_derivatives(mechanism, *state)
    exact = differences(mechanism, *(part[0] for part in state))
    assert np.abs(derivatives.q[0] - exact[0]).max() > 1e3 * DIFFERENCES * np.abs(exact[0]).max()


def test_one_sample_may_be_a_vector_and_blocks_do_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    mechanism = trees.tree()
    state = sample_states(mechanism, 5, seed=8)
    whole = torque_derivatives(mechanism, *state)
    monkeypatch.setattr(module, "NODAL_SAMPLES", 2)
    one = torque_derivatives(mechanism, *(part[3] for part in state))
    for ours, theirs in ((torque_derivatives(mechanism, *state).q, whole.q), (one.qd[0], whole.qd[3])):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=ROUNDING * np.abs(theirs).max())


def test_what_cannot_be_is_said() -> None:
    mechanism = trees.tree()
    tied = replace(mechanism, springs=(Spring("s", Attachment("base"), Attachment("wheel"), 3.0),))
    with pytest.raises(InputError, match=r"has springs between points.*take differences"):
        torque_derivatives(tied, *sample_states(tied, 1))
    arm = spatial_tree()
    with pytest.raises(InputError, match="beam links"):
        torque_derivatives(arm, *sample_states(arm, 1))
