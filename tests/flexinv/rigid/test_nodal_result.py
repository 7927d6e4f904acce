"""The optional outputs of a prepared function: the same efforts, and what `solve` finds in its nodes, joints and closures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rigid_trees import tree

import flexinv
from crosscheck.studies.robot_sweep import sample_states
from flexinv.files.load_cases import load_cases

MODELS = Path(__file__).resolve().parents[3] / "models"
# Two ways to the same sums, rounding of some tens of terms; through closures enlarged by their condition, some tens again.
ROUNDING = 1e-12
# Springs: the wheel turns without end, and samples have no turns before them.
WOUND = ("shoulder_joint", "slider_joint", "wheel_joint")


def test_of_a_tree() -> None:
    """The wrench of the root's joint holds up the whole: F = sum of the nodal forces; efforts are those of `torques`."""
    whole = tree()
    wound = tuple(replace(j, stiffness=0.6, rest=0.2) if j.name in WOUND else j for j in whole.joints)
    mechanism = replace(whole, joints=wound)
    f, state = flexinv.prepare(mechanism), sample_states(mechanism, 20, np.random.default_rng(1))
    result, tau = f.nodal(*state), f.torques(*state)
    assert np.abs(result.torque - tau).max() < ROUNDING * np.abs(tau).max()
    base = result.node["base"]
    force = np.einsum("sij,sj->si", result.motion.rotation[:, base], result.wrench["base_joint"][:, :3])
    assert np.abs(force - result.forces.force.sum(axis=1)).max() < ROUNDING * np.abs(force).max()
    body = result.body["hip", "own"]
    assert result.motion.x[:, body].shape == (20, 3)
    assert np.abs(result.forces.force[:, body]).max() > 0.0
    assert not result.reaction
    columns = f.nodal(*(np.ascontiguousarray(a.T) for a in state), order="coordinates")
    assert np.array_equal(columns.torque, result.torque)
    one = f.nodal(*(a[3] for a in state))
    assert np.abs(one.torque[0] - tau[3]).max() < ROUNDING * np.abs(tau).max()


@pytest.mark.parametrize(
    "mechanism", [tree(), flexinv.load_mechanism(MODELS / "andrews_squeezer")], ids=["tree", "loops"]
)
def test_no_samples_give_no_efforts(mechanism: flexinv.Mechanism) -> None:
    """As where a stream is cut into parts and the last one is empty."""
    f, state = flexinv.prepare(mechanism), [np.zeros((0, n)) for n in (mechanism.nq, mechanism.nv, mechanism.nv)]
    assert f.torques(*state).shape == f.nodal(*state).torque.shape == (0, mechanism.nv)


def test_without_what_resists() -> None:
    mechanism = tree()
    f, state = flexinv.prepare(mechanism, passive=False), sample_states(mechanism, 5, np.random.default_rng(2))
    tau = f.torques(*state)
    assert np.abs(f.nodal(*state).torque - tau).max() < ROUNDING * np.abs(tau).max()


@pytest.mark.parametrize("name", ["four_bar", "andrews_squeezer"])
def test_of_loops(name: str) -> None:
    """Motion, wrenches and reactions are those of `solve`, springs and given forces among them."""
    mechanism = flexinv.load_mechanism(MODELS / name)
    case = next(iter(load_cases(MODELS / name, mechanism).values()))
    s = flexinv.solve(mechanism, case.motion, step=case.end / 30, start=case.start)
    result = flexinv.prepare(mechanism).nodal(s.q, s.qd, s.qdd)
    assert s.loops is not None
    largest = max(np.abs(w).max() for w in s.wrench.values())
    assert np.abs(result.torque - s.torque_all).max() < ROUNDING * np.abs(s.torque_all).max()
    assert np.array_equal(result.motion.a, s.nodes.a)
    for ours, theirs in ((result.wrench, s.wrench), (result.reaction, s.loops.reaction)):
        assert ours.keys() == theirs.keys()
        for own in ours:
            assert np.abs(ours[own] - theirs[own]).max() < 10 * ROUNDING * largest  # the condition, see above


def test_what_it_cannot_take() -> None:
    f, rest = flexinv.prepare(tree()), np.zeros(tree().nv)
    with pytest.raises(flexinv.InputError, match="q has shape"):
        f.nodal(rest, rest, rest)
    q = np.array(tree().neutral)
    with pytest.raises(flexinv.InputError, match=r"qd\[2\] is nan"):
        f.nodal(q, np.where(np.arange(len(rest)) == 2, np.nan, rest), rest)
