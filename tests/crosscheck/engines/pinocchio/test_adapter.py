"""The door to Pinocchio: records, refusals, URDF with overlays, and faults in its map that the tests see."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import kane
import numpy as np
import pytest
import rigid_trees as trees

from crosscheck.engines.base import sample_times
from crosscheck.engines.pinocchio import adapter as pinocchio
from crosscheck.engines.pinocchio import model as pinocchio_model
from crosscheck.measures.record import check
from crosscheck.studies.robot_sweep import sample_states
from flexinv.files.from_urdf import from_urdf
from flexinv.model.mechanism import Beam, Body, Inertia, Mechanism, Section
from flexinv.model.motion import Motion

ROUNDING = 1e-13  # a few hundred roundings of the largest effort


def moved(mechanism: Mechanism) -> Motion:
    q = sample_states(mechanism, 2, np.random.default_rng(2))[0]
    return Motion.point_to_point(q[0], q[1], 0.5)


def test_a_record_of_all_quantities() -> None:
    mechanism = trees.tree()
    case = trees.case_of(moved(mechanism), 0.5, 0.05)
    record = pinocchio.run(mechanism, case, "pinocchio", {})
    check(record, sample_times(case))
    q, qd, qdd = case.motion.evaluate(mechanism, record.time)
    expected = np.array([kane.torque(mechanism, *row) for row in zip(q, qd, qdd, strict=True)])
    for k, name in enumerate(mechanism.velocity_names):
        np.testing.assert_allclose(
            record.series[f"torque/{name}"].values, expected[:, k], rtol=0, atol=ROUNDING * np.abs(expected).max()
        )
    assert record.series["torque/slider_joint"].unit == "N"
    assert "wrench/hip_joint/mz" in record.series
    assert "wrench/flange_joint/fx" not in record.series  # a fixed joint is no joint of Pinocchio
    assert {f"tip/{link.name}/x" for link in mechanism.links} <= set(record.series)


def test_flexible_links_are_refused_by_name() -> None:
    mechanism, _ = trees.double_pendulum()
    section = Section(np.zeros(1), np.ones((1, 6)), np.ones(1), np.ones((1, 3)))
    bent = replace(mechanism.links[1], bodies=(), beam=Beam(0.4, section))
    flexible = replace(mechanism, links=(mechanism.links[0], bent))
    case = trees.case_of(Motion.point_to_point([0, 0], [1, 1], 1.0), 1.0, 0.1)
    assert pinocchio.unsupported(flexible, case, "pinocchio") == (
        "Pinocchio has rigid bodies only; flexible here: link2"
    )
    assert pinocchio.unsupported(mechanism, case, "pinocchio") is None


def test_joints_left_to_the_dynamics_are_refused_by_name() -> None:
    mechanism, _ = trees.double_pendulum()
    loose = replace(mechanism, joints=(mechanism.joints[0], replace(mechanism.joints[1], actuated=False)))
    case = trees.case_of(Motion.point_to_point({"j1": 0.0}, {"j1": 1.0}, 1.0), 1.0, 0.1)
    reason = pinocchio.unsupported(loose, case, "pinocchio")
    assert reason == "every joint must be given a motion here; left to the dynamics: j2"


@pytest.mark.parametrize("moment", [-1e-22, -1e-4])
def test_a_body_has_the_moments_that_are_stated(moment: float) -> None:
    """A rod's moment about itself is rounded below zero, and files state what no body has: Pinocchio's parser takes both."""
    mechanism, _ = trees.double_pendulum()
    stated = Inertia.build_unchecked(1.0, np.array([0.1, 0.0, 0.0]), np.diag([moment, 2e-3, 2e-3]))
    link = replace(mechanism.links[1], bodies=(Body("rod", stated),))
    built = pinocchio_model.build(replace(mechanism, links=(mechanism.links[0], link)))
    # Pinocchio adds the body to the empty one of its joint: a rounding or two of the largest moment.
    np.testing.assert_allclose(built.model.inertias[2].inertia, stated.tensor, rtol=0, atol=1e-15 * 2e-3)
    assert built.model.inertias[2].mass == 1.0


# -------------------------------------------------------------------------------------------------------------- URDF


@pytest.mark.parametrize("base", ["fixed", "free"])
@pytest.mark.parametrize("root", ["pelvis", "world"])
def test_a_urdf_by_its_own_parser(tmp_path: Path, base: str, root: str) -> None:
    mechanism = from_urdf(trees.urdf(tmp_path, root), base=base)
    state = sample_states(mechanism, 5, np.random.default_rng(1))
    result = pinocchio.compute_inverse_dynamics(pinocchio.build(mechanism), *state).torque
    result += pinocchio.passive_effort(mechanism, state[1])
    expected = np.array([kane.torque(mechanism, *row) for row in zip(*state, strict=True)])
    np.testing.assert_allclose(result, expected, rtol=0, atol=ROUNDING * np.abs(expected).max())


@pytest.mark.parametrize("reweighed", [False, True])
@pytest.mark.parametrize("base", ["fixed", "free"])
def test_what_is_laid_over_a_urdf_reaches_the_model(tmp_path: Path, base: str, reweighed: bool) -> None:
    mechanism = from_urdf(trees.urdf(tmp_path), base=base)
    loaded = trees.overlaid(mechanism)
    loaded = trees.reweighed(loaded) if reweighed else loaded
    state = sample_states(mechanism, 5, np.random.default_rng(1))
    result = pinocchio.compute_inverse_dynamics(pinocchio.build(loaded), *state).torque
    result += pinocchio.passive_effort(loaded, state[1])
    expected = np.array([kane.torque(loaded, *row) for row in zip(*state, strict=True)])
    np.testing.assert_allclose(result, expected, rtol=0, atol=ROUNDING * np.abs(expected).max())
    plain = pinocchio.compute_inverse_dynamics(pinocchio.build(mechanism), *state).torque
    assert np.abs(result - plain).max() > 1e-2 * np.abs(expected).max()


def test_a_urdf_that_is_not_the_mechanism_is_refused(tmp_path: Path) -> None:
    mechanism = from_urdf(trees.urdf(tmp_path))
    path = tmp_path / "robot.urdf"
    path.write_text(path.read_text().replace('name="mid"', 'name="other"'))
    with pytest.raises(ValueError, match=r"only Pinocchio: \['other'\]; only the mechanism: \['mid'\]"):
        pinocchio.build(mechanism)


# ---------------------------------------------------------------------------------------------- faults in the map


def test_the_turn_of_a_continuous_joint_matters(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without A the joint turns about z instead of its axis."""
    mechanism = trees.chain("continuous")
    state = sample_states(mechanism, 5, np.random.default_rng(1))
    right = pinocchio.compute_inverse_dynamics(pinocchio.build(mechanism), *state)
    monkeypatch.setattr(pinocchio_model, "_build_z_frame", lambda joint: pinocchio.pin.SE3.Identity())
    wrong = pinocchio.compute_inverse_dynamics(pinocchio.build(mechanism), *state)
    assert np.abs(wrong.torque - right.torque).max() > 1e-2 * np.abs(right.torque).max()


def test_the_order_of_joints_matters(tmp_path: Path) -> None:
    """The URDF parser sorts siblings by name; a mechanism file need not."""
    mechanism = from_urdf(trees.urdf(tmp_path))
    turned = replace(
        mechanism,
        links=tuple(sorted(mechanism.links, key=lambda k: ["pelvis", "z_arm", "hand", "tool", "a_arm"].index(k.name))),
        joints=tuple(sorted(mechanism.joints, key=lambda j: ["root_joint", "zed", "mid", "end", "abe"].index(j.name))),
    )
    state = sample_states(turned, 5, np.random.default_rng(1))
    built = pinocchio.build(turned)
    result = pinocchio.compute_inverse_dynamics(built, *state).torque + pinocchio.passive_effort(turned, state[1])
    expected = np.array([kane.torque(turned, *row) for row in zip(*state, strict=True)])
    np.testing.assert_allclose(result, expected, rtol=0, atol=ROUNDING * np.abs(expected).max())
    assert built.v_order.tolist() != sorted(built.v_order.tolist())
    unmapped = replace(built, v_order=np.sort(built.v_order), q_order=np.sort(built.q_order))
    wrong = pinocchio.compute_inverse_dynamics(unmapped, *state).torque + pinocchio.passive_effort(turned, state[1])
    assert np.abs(wrong - expected).max() > 1e-2 * np.abs(expected).max()


def test_words_about_itself() -> None:
    assert pinocchio.version().count(".") == 2
    assert pinocchio.abilities().endswith("no flexible links.")
