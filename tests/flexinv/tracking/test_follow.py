"""follow: the deformed tip stays on its path, as theorems of stable inversion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path as Folder

import numpy as np
import pytest
from flexible_examples import observed_order
from hub_arm import LENGTH, hub_arm, torque_by_frequency
from part_examples import make_bar, make_same_beam

import flexinv
from flexinv import Mechanism, Path, follow
from flexinv.kernels.dense import solve_tridiagonal
from flexinv.kinematics.mesh import build
from flexinv.model.mechanism import Body, Inertia, Joint, Link
from flexinv.model.part import Material
from flexinv.tracking.collocation import FreeLayout, Horizon
from flexinv.tracking.internal_motion import find_internal_rates
from flexinv.tracking.inverse_kinematics import RigidPath, resolve_frame

STROKE = 0.01  # [rad] of the hub arm: small, so that the linear theory holds to its square


def stiffened(m: Mechanism, factor: float) -> Mechanism:
    """Return the mechanism with every beam so many times as stiff."""

    def stiff(link: Link) -> Link:
        if link.beam is None:
            return link
        section = replace(link.beam.section, stiffness=factor * link.beam.section.stiffness)
        return replace(link, beam=replace(link.beam, section=section))

    return replace(m, links=tuple(stiff(link) for link in m.links))


def small_stroke(duration: float = 1.0) -> Path:
    return Path.arc([LENGTH, 0, 0], [0, 0, 0], STROKE, duration)


def two_links(root: Folder) -> tuple[Mechanism, Path, dict[str, float]]:
    m = flexinv.load_mechanism(root / "models" / "flex_two_link")
    return m, Path.arc([0.3, 0, 0], [0.2, 0, 0], np.pi / 2, 0.3), {"joint1": -0.5, "joint2": 1.0}


def horizon_of(m: Mechanism, path: Path, link: str, time: np.ndarray, start: dict[str, float]) -> Horizon:
    mesh = build(m)
    way = RigidPath(mesh, resolve_frame(mesh, link), path, start)
    return Horizon(FreeLayout(mesh), way, way.solve_joint_motion(time), time, float(time[1] - time[0]))


# -------------------------------------------------------------------------------------------------------- the equations


def spatial(root: Folder) -> Horizon:
    m = flexinv.load_mechanism(root / "models" / "spatial_arm")
    path = Path.arc([0.87766824456, 0, 0.15223989667], [0, 0, 0.15223989667], 0.6, 0.05)
    return horizon_of(m, path, "forearm", np.arange(-2, 12) * 5e-3, {"pitch": 0.3})


def tangent_error(horizon: Horizon, wrong: float = 0.0) -> float:
    """Largest difference between the linearisation and central differences, over the largest entry of a direction."""
    rng = np.random.default_rng(1)
    layout = horizon.layout
    at = layout.compute_undeformed_poses(horizon.reach.q)
    at = layout.apply_increments(at, 1e-2 * rng.normal(size=at.flat.shape) * layout.solver.topology.scale)
    below, own, above = horizon._compute_blocks(at, horizon.evaluate(at))
    own = own * (1 + wrong)
    y = rng.normal(size=at.flat.shape) @ layout.pick.T @ layout.pick
    step = 1e-6
    ahead, back = (horizon.evaluate(layout.apply_increments(at, s * step * y), want=False).residual for s in (1, -1))
    picked = y @ layout.pick.T
    felt = np.einsum("sij,sj->si", own, picked)
    felt[1:] += np.einsum("sij,sj->si", below[1:], picked[:-1])
    felt[:-1] += np.einsum("sij,sj->si", above[:-1], picked[1:])
    return float(np.abs((ahead - back) / (2 * step) - felt).max() / np.abs(felt).max())


# rounding 1e-16 / step and truncation step^2, both times the ratio of the stiffest to the softest direction
TANGENT = 1e-7


def test_the_linearisation_is_the_derivative(root: Folder) -> None:
    assert tangent_error(spatial(root)) < TANGENT
    m, path, start = two_links(root)
    assert tangent_error(horizon_of(m, path, "link2", np.arange(-2, 12) * 5e-3, start)) < TANGENT


def test_a_wrong_linearisation_is_caught(root: Folder) -> None:
    assert tangent_error(spatial(root), wrong=1e-5) > TANGENT


def test_elimination_along_time_solves_the_blocks() -> None:
    rng = np.random.default_rng(0)
    blocks, right = [rng.normal(size=(5, 3, 3)) for _ in range(3)], rng.normal(size=(5, 3))
    blocks[1][0] = 0.0  # singular by itself: pivots come from the block row after it
    dense = np.zeros((15, 15))
    for shift, part in zip((-1, 0, 1), blocks, strict=True):
        for k in range(5):
            if 0 <= k + shift < 5:
                dense[3 * k : 3 * k + 3, 3 * (k + shift) : 3 * (k + shift) + 3] = part[k]
    expected = np.linalg.solve(dense, right.reshape(-1)).reshape(5, 3)
    error = np.linalg.cond(dense) * 1e-15  # of either elimination
    np.testing.assert_allclose(solve_tridiagonal(*blocks, right), expected, rtol=0, atol=error * np.abs(expected).max())


# -------------------------------------------------------------------------------------------------------------- theorems


@pytest.mark.slow
@pytest.mark.parametrize("elastic", [True, False])
def test_linear_arm_against_the_exact_inverse(elastic: bool) -> None:
    """Euler-Bernoulli's beam inverted term by term of a Fourier series: what remains falls with the square of the step."""
    m, path = hub_arm(8, elastic=elastic), small_stroke()
    errors = []
    for h in (8e-3, 4e-3):
        f = follow(m, path, "link", h, before=2.0, after=2.0)
        pushed = path.evaluate(f.time)
        along = np.stack([-pushed.x[:, 1], pushed.x[:, 0]], axis=1) / LENGTH
        exact = torque_by_frequency(np.einsum("si,si->s", pushed.a[:, :2], along), h, elastic)
        errors.append(float(np.abs(f.solution.torque[:, 0] - exact).max() / np.abs(exact).max()))
    # h^2 / 12 times the square of the path's fastest part, some 20 rad/s; below them the stroke's square, 1e-4
    assert errors[1] < 6e-4
    assert errors[0] > 2.8 * errors[1]


def test_elastic_hub_is_left_at_rest() -> None:
    """Rotor 1 kg m^2, 100 N m/rad, 0.7 m, 4 kg/m, 0.6 N m^2, T = 1 s: what the tip still moves is below 1e-4 of the stroke."""
    f = follow(hub_arm(12), small_stroke(), "link", 4e-3)
    moved = f.replay("stable inversion")
    late = f.time >= 1.0
    assert f.distance(moved)[late].max() < 1e-4 * f.path.length
    assert f.distance(f.replay("rigid"))[late].max() > 0.1 * f.path.length
    assert np.abs(f.solution.q[f.time <= 0, 0]).max() > 1e-3 * STROKE  # it moves before its tip does


def test_modes_with_the_rotor_locked() -> None:
    m = hub_arm(14)
    modes = flexinv.natural_modes(m, free=["hub"])
    flat = np.abs(modes.displacement[:, :, 2]).max(axis=1) < 1e-6 * np.abs(modes.displacement[:, :, 1]).max(axis=1)
    expected = [2.732579, 17.132913, 47.992431]  # rad/s
    np.testing.assert_allclose(2 * np.pi * modes.frequency[flat][:3], expected, rtol=1e-5)


def test_what_runs_there_and_back_is_symmetric_in_time(root: Folder) -> None:
    """The law is symmetric and nothing is lost: seen backwards the motion is that from the end to the start."""
    m, path, start = two_links(root)
    f = follow(m, path, "link2", 2e-3, 0.06, 0.06, start)
    back = Path.arc(path.evaluate([path.duration]).x[0], [0.2, 0, 0], -np.pi / 2, path.duration)
    end = dict(zip(("joint1", "joint2"), f.solution.q[-1], strict=True))
    b = follow(m, back, "link2", 2e-3, 0.06, 0.06, end)
    # Newton's last increment, 1e-8, squared; torques carry it over h^2
    np.testing.assert_allclose(b.solution.q[::-1], f.solution.q, rtol=0, atol=1e-10)
    np.testing.assert_allclose(
        b.solution.torque[::-1], f.solution.torque, rtol=0, atol=1e-7 * np.ptp(f.solution.torque)
    )


def test_stiff_arm_follows_like_a_rigid_one(root: Folder) -> None:
    """What bends vanishes with the stiffness, and inverse kinematics with exact rates is left, up to h^2."""
    m, path, start = two_links(root)
    errors = []
    for h in (2e-3, 1e-3):
        f = follow(stiffened(m, 1e6), path, "link2", h, 0.01, 0.01, start)
        errors.append(float(np.abs(f.solution.torque - f.rigid.torque).max() / np.ptp(f.rigid.torque)))
    assert errors[1] < 2e-4
    assert observed_order(errors) > 1.9


def test_second_order_in_time(root: Folder) -> None:
    m, path, start = two_links(root)
    runs = [follow(m, path, "link2", h, 0.06, 0.06, start).solution for h in (2e-3, 1e-3, 5e-4)]
    coarse, middle, fine = (run.torque[:: 2**k] for k, run in enumerate(runs))
    steps = np.abs(middle - coarse).max(), np.abs(fine - middle).max()
    assert steps[0] > 3.5 * steps[1]


def test_deformed_tip_is_on_the_path_and_the_torque_is_that_of_its_motion(root: Folder) -> None:
    m, path, start = two_links(root)
    f = follow(m, path, "link2", 1e-3, start=start)
    assert f.distance(f.solution).max() < 1e-12 * path.length  # rounding, and Newton's last increment squared
    assert f.distance(f.joint_space).max() > 1e-2 * path.length
    peak = np.abs(f.solution.torque).max()
    np.testing.assert_allclose(f.solution.reaction, f.solution.torque_all, rtol=0, atol=1e-8 * peak)
    # the power balance holds with velocities and accelerations of one instant
    assert np.abs(f.solution.power_residual).max() < 1e-9 * np.abs(f.solution.torque * f.solution.qd).max()
    errors = {name: f.distance(f.replay(name)).max() / path.length for name in f.feed_forwards}
    assert errors["stable inversion"] < 1e-3
    assert 30 * errors["stable inversion"] < min(errors["rigid"], errors["joint space"])


def test_in_space_with_a_payload_and_gravity(root: Folder) -> None:
    """Two drives, three directions: the frame is on the path where the drives can move it."""
    m = flexinv.load_mechanism(root / "models" / "spatial_arm")
    path = Path.arc([0.87766824456, 0, 0.15223989667], [0, 0, 0.15223989667], 0.6, 0.5)
    f = follow(m, path, "forearm", 4e-3, start={"pitch": 0.3})
    missed = f.frame.compute_poses(f.solution.nodes).x - f.wanted
    off = np.einsum("srt,sr->st", f.reach.within, missed)
    assert np.abs(off).max() < 1e-10
    assert f.distance(f.solution).max() < 2e-3 * path.length  # the forearm, bent, is a little shorter
    assert f.distance(f.joint_space).max() > 0.05 * path.length
    assert abs(f.solution.q[0, 1] - 0.3) > 1e-3  # it is held higher, because the forearm sags


def test_more_drives_than_the_frame_needs(root: Folder) -> None:
    m = flexinv.load_mechanism(root / "models" / "ur5_flexible_forearm")
    start = {"shoulder_lift_joint": -1.3, "elbow_joint": 1.5, "wrist_1_joint": -0.8, "wrist_2_joint": -1.0}
    path = Path.line([0.55156153, 0.10915, 0.34262517], [0.65, 0.2, 0.25], 0.5)
    f = follow(m, path, "wrist_3_link", 5e-3, start=start)
    assert f.distance(f.solution).max() < 1e-10
    assert f.distance(f.joint_space).max() > 1e-3 * path.length


def test_a_frame_that_no_drive_moves_is_an_error(root: Folder) -> None:
    robot, here = flexinv.load_mechanism(root / "models" / "ur5"), np.zeros(3)
    with pytest.raises(flexinv.InputError, match="no drive moves the frame on 'base'; follow a frame on a link behind"):
        follow(robot, Path.line(here, here, 1.0), "base", 0.1)


def test_slow_paths_have_errors_that_cover_the_difference_to_finer_ones(root: Folder) -> None:
    m, path, start = two_links(root)
    f = follow(m, path, "link2", 2e-3, start=start, error=True)
    fine = follow(m.refined(order=2), path, "link2", 1e-3, -f.time[0], f.time[-1] - path.duration, start)
    assert f.solution.torque_error is not None
    off = np.abs(f.solution.torque - fine.solution.torque[::2])
    assert (off <= 1.2 * f.solution.torque_error).all()
    assert f.solution.torque_error.max() < 0.02 * np.ptp(f.solution.torque)


def test_rates_inside_are_those_of_the_zeros() -> None:
    """Torque to tip of the linear arm: zeros at the pairs +-8.8 and +-47.8 1/s, where the exact gain's numerator vanishes."""
    m = hub_arm(10)
    rates = find_internal_rates(horizon_of(m, small_stroke(), "link", np.array([0.0, 1.0]), {}), 0)
    real = np.sort(rates.real[np.abs(rates.imag) < 1e-6 * np.abs(rates)])
    for rate, wanted in zip(real[real > 1.0][:2], (_zero(5.0, 15.0), _zero(30.0, 60.0)), strict=True):
        assert rate == pytest.approx(wanted, rel=1e-5)


def _zero(low: float, high: float) -> float:
    """The zero [1/s] of the tip's response to a moment at the pinned root: sin(z) + sinh(z) with z^4 = -rho s^2 L^4 / EI."""
    from scipy.optimize import brentq

    def tip(s: float) -> float:
        z = (4.0 / 0.6) ** 0.25 * np.sqrt(s + 0j) * np.exp(0.25j * np.pi) * LENGTH
        return float(((np.sin(z) + np.sinh(z)) / z).real)

    return float(brentq(tip, low, high))


# ---------------------------------------------------------------------------------------- zeros that swing


def with_tool(m: Mechanism, ahead: float) -> Mechanism:
    """Put a tool of 0.3 kg on the tip of the second link, its centre of mass so far ahead [m]."""
    tool = Body("tool", Inertia(0.3, np.array([ahead, 0.0, 0.0]), np.diag([1e-5, 1e-4, 1e-4])), 1.0)
    return replace(m, links=tuple(replace(one, bodies=(tool,)) if one.name == "link2" else one for one in m.links))


@pytest.mark.reported("D12")
def test_a_tool_ahead_of_the_tip_swings_on_and_the_tip_stays_on_its_path(root: Folder) -> None:
    """Its zeros are +-15.8i 1/s: bounded from rest on, no rest at the end, and the torques give that motion by another scheme."""
    m, _, start = two_links(root)
    arm, slow = with_tool(m, 0.05), Path.arc([0.3, 0, 0], [0.2, 0, 0], np.pi / 2, 1.2)
    with pytest.warns(flexinv.ModelWarning, match=r"something swings on inside .*zeros: \+-15.79i 1/s, 2.51 Hz"):
        f = follow(arm, slow, "link2", 6e-3, start=start)
    assert f.distance(f.solution).max() < 1e-12 * slow.length  # rounding, and Newton's last increment squared
    assert f.unrest[0] < 1e-6  # it begins at rest
    assert f.unrest[1] > 1e-2
    assert f.distance(f.replay("stable inversion")).max() < 1e-3 * slow.length  # of the steps: 2e-4 of the length


@pytest.mark.reported("D12")
def test_a_motion_that_is_not_found_names_the_zeros(root: Folder) -> None:
    m, _, start = two_links(root)
    fast = Path.arc([0.3, 0, 0], [0.2, 0, 0], np.pi / 2, 0.3)
    with pytest.raises(flexinv.ConvergenceError, match=r"\(zeros: \+-15.79i 1/s, 2.51 Hz; \+-542"):
        follow(with_tool(m, 0.05), fast, "link2", 3e-3, start=start)


def test_a_meshed_arm_follows_as_its_beam_does() -> None:
    """Torques of two links with a load are those of beams: the mesh's own error, 9e-5 of its frequency, is most of 2e-5."""
    load = Inertia(0.3, np.array([0.0, 0.01, 0.02]), 1e-4 * np.eye(3))
    soft = Material.build_isotropic(70e9, 0.0, 2700.0)
    path = Path.line([0.6, 0, 0.3], [0.7, 0, 0.1], 0.5)
    found = []
    for meshed in (False, True):
        at = {"interface": "tip"} if meshed else {"station": 1.0}
        links = []
        for name, length, bodies in (("a", 0.5, ()), ("b", 0.4, (Body("load", load, **at),))):
            part = make_bar("hexahedron27", length=length, count=(20, 1, 1), material=soft) if meshed else None
            links.append(Link(name, bodies, part=part, beam=None if meshed else make_same_beam(length=length)))
        y = np.array([0.0, 1.0, 0.0])
        joints = (Joint("hub", "revolute", "world", "a", axis=y), Joint("elbow", "revolute", "a", "b", axis=y, **at))
        arm = Mechanism("two", tuple(links), joints)
        found.append(follow(arm, path, "b", step=4e-3, before=0.03, after=0.03, start={"hub": -0.8, "elbow": 1.0}))
    beam, mesh = (one.solution.torque for one in found)
    assert np.abs(mesh - beam).max() < 2e-5 * np.ptp(beam, axis=0).max()
    distance = (
        found[1].distance(found[1].solution).max()
    )  # the load twists the arm off its plane, where no drive moves it
    assert distance < 0.01 * found[1].distance(found[1].joint_space).max()
    assert np.abs(found[1].solution.balance.meshes).max() < 1e-12 * np.abs(mesh).max()
