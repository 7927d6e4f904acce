"""Solution: names, units, error bars, limits, and the messages of `solve`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flexible_examples import HALF_TURN, TREE_MOTION, arm, spatial_tree
from scipy.integrate import simpson

import flexinv
from flexinv.files.load_cases import load_cases
from flexinv.inverse.inverse_dynamics import compute_applied_forces, compute_drive_efforts, compute_inverse_dynamics
from flexinv.model.mechanism import WORLD, Attachment, Body, Inertia, Limits, Placement, Spring


@pytest.fixture(scope="module")
def tree() -> flexinv.Solution:
    return flexinv.solve(spatial_tree(), TREE_MOTION, step=2e-3, initial="static")


def test_shapes_and_names(tree: flexinv.Solution) -> None:
    samples = len(tree.time)
    assert tree.torque.shape == (samples, 4)
    assert tree.torque_names == ("slew", "luff", "middle", "wrist")
    assert tree.unactuated.shape == (samples, 0)
    assert {k: v.shape for k, v in tree.wrench.items()} == dict.fromkeys(
        ("slew", "luff", "middle", "wrist"), (samples, 6)
    )
    assert set(tree.deflection) == set(tree.internal) == {"boom"}
    assert tree.internal["boom"].shape[1:] == (len(tree.internal_stations["boom"]), 6)
    assert np.all(np.diff(tree.internal_stations["boom"]) > 0)


def test_frames_carry_units(tree: flexinv.Solution) -> None:
    frame = tree.frame()
    assert frame.index.name == "time [s]"
    assert {"torque slew [N m]", "force wrist [N]", "position wrist [m]", "rate slew [rad/s]"} <= set(frame)
    assert frame["force wrist [N]"].to_numpy() == pytest.approx(tree.torque[:, 3])
    assert all(c.endswith("]") for c in [*frame, *tree.tip_frame(), *tree.wrench_frame()])


def test_wrench_along_the_axis_is_the_torque(tree: flexinv.Solution) -> None:
    """The joint's wrench, projected on its axis, is the effort less what the drive itself takes."""
    drive = compute_drive_efforts(tree.mechanism, tree.qd, tree.qdd)
    slew = tree.wrench["slew"][:, 3:] @ [0, 0, 1] + drive[:, 0]
    wrist = tree.wrench["wrist"][:, :3] @ [0, 1, 0] + drive[:, 3]
    assert slew == pytest.approx(tree.torque[:, 0], abs=1e-12 * np.ptp(tree.torque[:, 0]))  # rounding
    assert wrist == pytest.approx(tree.torque[:, 3], abs=1e-12 * np.ptp(tree.torque[:, 3]))


def test_the_root_is_in_equilibrium_with_its_joint() -> None:
    """A hub that carries the beam alone gives it what its root section has, in motion, too; a body on the root does not count."""
    s = flexinv.solve(arm(1, 4), HALF_TURN, step=5e-4, end=0.1)
    hub = -s.wrench[next(iter(s.wrench))]
    largest = np.abs(hub).max(axis=0)
    assert (np.abs(s.root["link"] - hub) <= 1e-9 * np.where(largest > 0, largest, largest.max())).all()
    names = [c for c in s.internal_frame() if " at root " in c]
    assert names[-1] == "bending_z link at root [N m]"
    m = arm(1, 4)
    heavy = replace(m.links[0], bodies=(*m.links[0].bodies, Body("clamp", Inertia(5.0), 0.0)))
    other = flexinv.solve(replace(m, links=(heavy, *m.links[1:])), HALF_TURN, step=5e-4, end=0.1)
    assert np.abs(other.root["link"] - s.root["link"]).max() <= 1e-9 * np.abs(s.root["link"]).max()


def test_internal_forces_continue_the_root_wrench() -> None:
    """Bending moment along the arm, extrapolated to the root, is the hub torque (constant inertia near the hub is small)."""
    s = flexinv.solve(arm(2, 8), HALF_TURN, step=5e-4)
    station, moment = s.internal_stations["link"], s.internal["link"][:, :, 5]
    fit = np.polyfit(station[:6], moment[:, :6].T, 5)[-1]  # value at station 0, sample by sample
    # the hub turns the root section: its torque is minus the section's moment on what lies beyond; 1e-3: extrapolation
    assert abs(fit + s.torque[:, 0]).max() < 1e-3 * abs(s.torque).max()


def test_factors_of_a_flexible_tree(tree: flexinv.Solution) -> None:
    drive = compute_drive_efforts(tree.mechanism, tree.qd, tree.qdd)
    for sample in (0, 60, 200):
        f = tree.factors(sample)
        gap = f.L @ f.T @ f.P + drive[sample] - tree.torque_all[sample]
        assert abs(gap).max() < 1e-12 * abs(tree.torque_all).max()  # rounding


def test_error_bars_cover_the_error() -> None:
    """Bars from refinement hold against a solution that is finer in both step and mesh."""
    coarse = flexinv.solve(arm(1, 4), HALF_TURN, step=1e-3, error=True)
    fine = flexinv.solve(arm(2, 6), HALF_TURN, step=1e-4)
    gap = abs(coarse.torque - fine.torque[::10])
    assert coarse.torque_error is not None
    assert coarse.tip_error is not None
    assert np.mean(gap <= coarse.torque_error) > 0.98  # a bar is an estimate: nearly everywhere
    assert coarse.torque_error.max() < 10 * gap.max()  # and not a blanket
    assert coarse.tip_error["link"].shape == coarse.time.shape


def test_the_answer_of_two_steps_is_better_than_that_of_the_shorter() -> None:
    smooth = flexinv.Motion.point_to_point([0.0], [np.pi], 0.2, law="nonic")
    plain, half, fine = (flexinv.solve(arm(1, 8), smooth, step=step) for step in (1e-3, 5e-4, 2e-5))
    both = flexinv.solve(arm(1, 8), smooth, step=1e-3, error=True)
    errors = [abs(s.torque[:: len(s.time) // 200] - fine.torque[::50]).max() for s in (plain, half, both)]
    assert errors[2] < errors[1] / 10 < errors[0] / 30  # fourth order beside second
    assert both.settings["extrapolated"]
    assert both.torque_error is not None
    assert (abs(both.torque - fine.torque[::50]) <= both.torque_error).all()


def test_the_papers_incremental_mode_is_not_extrapolated() -> None:
    plain, barred = (
        flexinv.solve(arm(), HALF_TURN, step=1e-3, incremental=True, error=error) for error in (False, True)
    )
    np.testing.assert_array_equal(barred.torque, plain.torque)
    assert barred.torque_error is not None


def test_summary_against_limits() -> None:
    limited = replace(arm(), joints=(replace(arm().joints[0], limits=Limits(effort=2.0, velocity=40.0)),))
    row = flexinv.solve(limited, HALF_TURN, step=1e-3).summary().loc["hub"]
    assert row["effort / limit [-]"] == pytest.approx(row["peak effort"] / 2.0)
    assert row["speed / limit [-]"] == pytest.approx(2 * np.pi / 0.2 / 40.0, rel=1e-6)
    assert row["unit"] == "N m"


@pytest.mark.parametrize("pulled", [False, True])
def test_the_compiled_pass_is_the_second_step(pulled: bool) -> None:
    """Step by step, as the paper has it, and in one pass over nodes of rigid links and beams."""
    tree = spatial_tree()
    tip = Attachment(tree.links[-1].name, station=None if tree.links[-1].beam is None else 1.0)
    spring = Spring("line", Attachment(WORLD, Placement(np.array([0.1, -0.4, 0.3]))), tip, stiffness=3.0, damping=0.2)
    m = replace(tree, springs=(spring,)) if pulled else tree
    s = flexinv.solve(m, TREE_MOTION, step=2e-3)
    pulls = compute_applied_forces(s.mesh, s.nodes, s.time)
    assert (pulls is not None) == pulled
    tau = compute_inverse_dynamics(s.mesh, s.nodes, s.qd, s.qdd, pulls).torque
    largest = np.abs(tau).max()
    assert np.abs(s.torque_all - tau).max() < 1e-12 * largest  # rounding of sums over some twenty nodes
    assert (
        not pulled or np.abs(compute_inverse_dynamics(s.mesh, s.nodes, s.qd, s.qdd).torque - tau).max() > 1e-2 * largest
    )


def test_unactuated_base_takes_a_wrench(root: Path) -> None:
    talos = flexinv.load_mechanism(root / "models" / "talos")
    case = next(iter(load_cases(root / "models" / "talos", talos).values()))
    s = flexinv.solve(talos, case.motion, step=0.02)
    assert s.unactuated_names == tuple(f"root_joint.{c}" for c in ("vx", "vy", "vz", "wx", "wy", "wz"))
    assert {*s.torque_names, *s.unactuated_names} == {*talos.velocity_names}
    base, mass = s.mesh.joint_node["root_joint"], s.mesh.mass
    turn = s.nodes.rotation[:, base]  # the wrench is in the frame of the base
    force, moment = (np.einsum("sij,sj->si", turn, s.unactuated[:, part]) for part in (slice(3), slice(3, 6)))
    weight = mass.sum() * -talos.gravity
    lever = np.einsum("n,sni->si", mass, s.nodes.x - s.nodes.x[:, [base]])
    still = [0, -1]  # it carries the weight where all rests
    np.testing.assert_allclose(force[still], [weight, weight], rtol=0, atol=1e-14 * weight[2])  # rounding of sums
    np.testing.assert_allclose(moment[still], np.cross(lever, -talos.gravity)[still], rtol=0, atol=1e-12)  # of some N m
    impulse = simpson(force - weight, x=s.time, axis=0)  # from rest to rest
    assert (
        np.abs(impulse).max() < 1e-6 * weight[2]
    )  # Simpson's rule leaves 1e-8 at this step, 16 times less at half of it


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"step": 1.0}, r"step = 1 s is longer than the motion \(0\.5 s\)"),
        ({"step": 0.0}, "step = 0.0 s: expected a positive number"),
        ({"step": 1e-9}, r"gives 500000000 samples.*larger step"),
        ({"step": 1e-3, "spectral_radius": 1.5}, r"spectral_radius = 1\.5: expected 0"),
        ({"step": 1e-3, "initial": "resting"}, "initial = 'resting': expected 'consistent'"),
        ({"step": 1e-3, "end": -1.0}, r"end = -1\.0 s: expected a positive time"),
        ({"step": 0.2, "incremental": True}, "at least 4 samples"),
    ],
)
def test_bad_options_are_explained(options: dict[str, object], words: str) -> None:
    with pytest.raises(flexinv.InputError, match=words):
        flexinv.solve(arm(), HALF_TURN, **options)  # type: ignore[arg-type]


def test_joint_torques_explains_what_it_cannot_take() -> None:
    with pytest.raises(flexinv.InputError, match=r"beam links \(link\).*flexinv.solve"):
        flexinv.joint_torques(arm(), [0.0], [0.0], [0.0])
