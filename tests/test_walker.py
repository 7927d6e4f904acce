"""models/walker: its motion is the one that tests/walker.py states, and its feet's reactions carry the whole body."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import walker
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import flexinv
from flexinv.files.load_cases import Case, load_cases
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

FOLDER = Path(__file__).resolve().parent.parent / "models" / "walker"
FEET = {"left": ("left_stands", "left_lands"), "right": ("right_stands", "right_lands")}
HEEL, TOES = -0.25 * 0.152 * walker.HEIGHT, 0.75 * 0.152 * walker.HEIGHT  # of the foot, from the ankle [m]


@cache
def walk() -> tuple[Mechanism, Case, flexinv.Solution]:
    mechanism = flexinv.load_mechanism(FOLDER)
    case = load_cases(FOLDER, mechanism)["walk"]
    return mechanism, case, flexinv.solve(mechanism, case.motion, case.step, start=case.start)


def reaction(foot: str) -> Array:
    """Force and moment on a foot at its sole under the ankle, (samples, 6); axes are the world's, the foot stays flat."""
    loops = walk()[2].loops
    assert loops is not None
    return np.asarray(sum(loops.reaction[name] for name in FEET[foot]))


def stands(foot: str) -> NDArray[np.bool_]:
    mechanism, _, s = walk()
    intervals = [i for c in mechanism.closures if c.name in FEET[foot] for i in c.active]
    # a switching instant and a sample are the same up to rounding of decimals
    return np.any([(s.time >= a - 1e-9) & (s.time < b - 1e-9) for a, b in intervals], axis=0)


def test_the_samples_are_what_the_script_writes() -> None:
    """Up to the last digits of another machine: coefficients of `walker.soft` add up to 1e4, so its end is known to 2e-12."""
    kept = (FOLDER / "gait.csv").read_text(encoding="utf-8").splitlines()
    made = walker.rows()
    assert kept[0] == made[0]
    numbers = [np.array([row.split(",") for row in rows[1:]], dtype=float) for rows in (kept, made)]
    assert numbers[0] == pytest.approx(numbers[1], abs=1e-11)


def test_masses_are_the_tables() -> None:
    """Winter's table 4.1: HAT 0.678, thigh 0.1, leg 0.0465, foot 0.0145 of 70 kg."""
    mechanism, _, _ = walk()
    mass = {link.name: sum(b.inertia.mass for b in link.bodies) for link in mechanism.links}
    parts = {"torso": 0.678, "left_thigh": 0.1, "right_shank": 0.0465, "left_foot": 0.0145}
    for name, part in parts.items():
        assert mass[name] == pytest.approx(70 * part, rel=1e-12)
    assert sum(mass.values()) == pytest.approx(70.0, rel=1e-12)


def test_torso_and_feet_follow_their_paths() -> None:
    """The floating base follows from the feet that stand: hips and lean as the script has them."""
    mechanism, _, s = walk()
    base = s.q[:, mechanism.q_slices["base"]]
    path = walker.torso(s.time)
    lean = Rotation.from_quat(base[:, 3:]).as_rotvec()[:, 2]
    # samples are exact, and the loops are closed to 1e-11
    assert np.abs(np.column_stack([base[:, :2], lean]) - path).max() < 1e-10
    for foot in FEET:
        sole = s.tip[f"{foot}_foot"][:, :2] - (TOES, 0.0)
        assert np.abs(sole - walker.foot(foot, s.time)).max() < 1e-10


def test_the_feet_carry_the_whole_body() -> None:
    """Sum of forces and moments about the world's origin = rate of momentum less weight, by the motion of all bodies."""
    _, _, s = walk()
    force, moment = np.zeros((len(s.time), 3)), np.zeros((len(s.time), 3))
    for foot in FEET:
        wrench = reaction(foot)
        at = np.pad(walker.foot(foot, s.time), ((0, 0), (0, 1)))
        force += wrench[:, :3]
        moment += wrench[:, 3:] + np.cross(at, wrench[:, :3])
    rate, turn = _momentum_rates(s)
    size = 70 * 9.81
    assert np.abs(force - rate).max() < 1e-11 * size  # rounding times the condition of the loops
    assert np.abs(moment - turn).max() < 1e-11 * size


def _momentum_rates(s: flexinv.Solution) -> tuple[Array, Array]:
    """m (a - g) and its moment about the origin, summed over all bodies; spins only about z, rates by hand."""
    m = s.mechanism
    names = list(m.velocity_names)
    base = m.q_slices["base"]
    lean = Rotation.from_quat(s.q[:, base][:, 3:]).as_rotvec()[:, 2]
    v = s.qd[:, m.v_slices["base"]]
    dv = s.qdd[:, m.v_slices["base"]]
    turn = Rotation.from_rotvec(np.outer(lean, (0.0, 0.0, 1.0)))
    hips = (s.q[:, base][:, :3], turn.apply(dv[:, :3] + np.cross(v[:, 3:], v[:, :3])))
    frames = {"torso": (*hips, lean, v[:, 5], dv[:, 5])}
    for joint in m.joints[1:]:
        x, a, angle, w, al = frames[joint.parent]
        k = names.index(joint.name)
        x, a = _carried(x, a, angle, w, al, joint.placement.position)
        zero = Rotation.from_matrix(joint.placement.rotation).as_rotvec()[2]
        q = s.q[:, m.q_slices[joint.name]][:, 0]
        frames[joint.child] = (x, a, angle + zero + q, w + s.qd[:, k], al + s.qdd[:, k])
    force, moment = np.zeros((len(lean), 3)), np.zeros((len(lean), 3))
    for link in m.links:
        inertia = link.bodies[0].inertia
        x, a, angle, w, al = frames[link.name]
        x, a = _carried(x, a, angle, w, al, inertia.com)
        part = inertia.mass * (a - m.gravity)
        force += part
        moment += np.cross(x, part) + np.outer(inertia.tensor[2, 2] * al, (0.0, 0.0, 1.0))
    return force, moment


def _carried(x: Array, a: Array, angle: Array, w: Array, al: Array, point: Array) -> tuple[Array, Array]:
    """Place and acceleration of a point of a body that turns about z."""
    c, n = np.cos(angle), np.sin(angle)
    arm = np.stack([c * point[0] - n * point[1], n * point[0] + c * point[1], np.zeros_like(c)], axis=1)
    across = np.stack([-arm[:, 1], arm[:, 0], arm[:, 2]], axis=1)
    return x + arm, a + al[:, None] * across - w[:, None] ** 2 * arm


def test_the_floor_only_pushes_and_the_pressure_stays_under_the_feet() -> None:
    for foot in FEET:
        wrench = reaction(foot)[stands(foot)]
        assert wrench[:, 1].min() > 100.0  # [N]; both feet together carry 687
        pressure = wrench[:, 5] / wrench[:, 1]
        assert pressure.min() > HEEL
        assert pressure.max() < TOES
        assert np.abs(wrench[:, 0] / wrench[:, 1]).max() < 0.2  # the floor need not be rough
        assert np.abs(reaction(foot)[~stands(foot)]).max() == 0.0


def test_drives_are_redundant_on_both_feet_only() -> None:
    """On both feet six drives move three freedoms, on one foot six: preload there is none."""
    _, _, s = walk()
    assert s.loops is not None
    assert s.loops.preload.shape[2] == 3
    preload = np.abs(s.loops.preload).max(axis=(1, 2))
    assert np.array_equal(preload > 0.0, stands("left") & stands("right"))


def test_torques_jump_where_the_feet_take_over_and_the_motion_does_not() -> None:
    """At 1.5 s the left foot lifts: least norm of three freedoms becomes the one answer of six."""
    _, _, s = walk()
    k = 75
    assert s.time[k] == pytest.approx(1.5)
    step = np.abs(np.diff(s.torque, axis=0)).max(axis=1)
    assert step[k - 1] > 3 * step[k - 2]
    jerk = np.abs(np.diff(s.qdd, axis=0)).max(axis=1)
    assert jerk[k - 1] < 2 * jerk[k - 2] + 1e-6
