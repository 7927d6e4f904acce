"""Efforts of both descriptions on the same motion: random states and an exciting motion, in A's coordinates.

A's coordinate q of a scalar joint is  q = sign q_B + offset;  of a ball R_B = T^T R_A T,  of a free base M_B = T^-1 M_A T,
v_B = Ad(T)^-1 v_A, and efforts by the dual:  tau_A = sign tau_B,  tau_A = Ad(T)^-T tau_B.  T: B's link frame in A's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from crosscheck.equivalence.alignment.member_alignment import MemberAlignment
from crosscheck.equivalence.tree import SCALARS, Member, Tree, build_mechanism
from crosscheck.lifting.rigid import (
    apply_placement,
    build_adjoint,
    compute_relative_pose,
    convert_to_quaternion,
    inverse,
    turned,
)
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Array, Mechanism, Placement
from flexinv.rigid.joint_torques import joint_torques

RANDOM = 60
ALONG = 100
SEED = 20
REACH = {"revolute": np.pi, "helical": np.pi, "prismatic": 0.5}
Law = Callable[[Mechanism, Array, Array, Array], Array]
# [s], harmonics of the exciting motion
PERIOD = 10.0
WAVES = 4


@dataclass(frozen=True)
class States:
    """States by joint: scalars (samples,) or poses; rates and accelerations (samples, nv) [rad, m, s].

    poses : of balls and free bases, by joint, one `Placement` a sample
    """

    q: Mapping[str, Array]
    poses: Mapping[str, list[Placement]]
    qd: Mapping[str, Array]
    qdd: Mapping[str, Array]

    @property
    def still(self) -> States:
        """Return the same places at rest [rad], [m]."""
        none = {name: np.zeros_like(rates) for name, rates in self.qd.items()}
        return States(self.q, self.poses, none, none)

    def apply_unit_acceleration(self, joint: str, k: int) -> States:
        """Return the same places at rest with a unit of one acceleration [rad/s^2], [m/s^2]."""
        rest = self.still
        push = rest.qdd[joint].copy()
        push[:, k] = 1.0
        return States(self.q, self.poses, rest.qd, {**rest.qdd, joint: push})


def sample_states(tree: Tree, seed: int = SEED, count: tuple[int, int] = (RANDOM, ALONG)) -> States:
    """Return random states, then samples of an exciting motion, within stated limits [rad], [m]; count : of each [-]."""
    rng = np.random.default_rng(seed)
    q = {}
    poses = {}
    qd = {}
    qdd = {}
    for joint, k in tree.moving.items():
        member = tree.members[k]
        size = KINDS[member.kind].v
        qd[joint] = np.vstack([rng.standard_normal((count[0], len(size))), np.zeros((count[1], len(size)))])
        qdd[joint] = np.vstack([rng.standard_normal((count[0], len(size))), np.zeros((count[1], len(size)))])
        if member.kind not in SCALARS:
            poses[joint] = _sample_poses(member, rng, sum(count))
            continue
        low, high = _find_coordinate_bounds(member)
        wave = _sample_fourier_series(rng, count[1], (high - low) / 2)
        q[joint] = np.concatenate([rng.uniform(low, high, count[0]), wave[0] + (low + high) / 2])
        qd[joint][count[0] :, 0], qdd[joint][count[0] :, 0] = wave[1:]
    return States(q, poses, qd, qdd)


def _find_coordinate_bounds(member: Member) -> tuple[float, float]:
    reach = REACH[member.kind]
    low = max(member.limits.lower, -reach)
    high = min(member.limits.upper, reach)
    return (low, high) if high - low > 0.1 * reach else (-reach, reach)


def _sample_fourier_series(rng: np.random.Generator, count: int, reach: float) -> Array:
    """Position, rate and acceleration (3, samples) of a Fourier series that stays within the reach [rad], [m]."""
    rate = 2 * np.pi / PERIOD * np.arange(1, WAVES + 1)[:, None]
    size = rng.dirichlet(np.ones(WAVES))[:, None] * reach
    phase = rng.uniform(0, 2 * np.pi, WAVES)[:, None]
    turn = rate * np.linspace(0.0, PERIOD, count) + phase
    return np.stack(
        [
            (size * np.sin(turn)).sum(0),
            (size * rate * np.cos(turn)).sum(0),
            -(size * rate**2 * np.sin(turn)).sum(0),
        ]
    )


def _sample_poses(member: Member, rng: np.random.Generator, count: int) -> list[Placement]:
    poses = []
    for _ in range(count):
        axis = rng.standard_normal(3)
        place = rng.uniform(-1, 1, 3) if member.kind == "free" else np.zeros(3)
        poses.append(Placement(place, turned(axis / np.linalg.norm(axis), rng.uniform(0, 3))))
    return poses


def evaluate_efforts(
    mechanism: Mechanism, states: States, joints: Mapping[str, str] | None = None, law: Law = joint_torques
) -> dict[str, Array]:
    """Return by joint of the states the efforts (samples, nv) [N m], [N]; joints : names there, others stand at zero.

    law : efforts (samples, nv) of the mechanism at q, qd, qdd, in its order; flexinv's, or those of a reader's own model
    """
    if not states.qd:
        return {}  # nothing moves
    names = joints if joints is not None else {name: name for name in states.qd}
    back = {second: first for first, second in names.items()}
    count = len(next(iter(states.qd.values())))
    q = np.tile(mechanism.neutral, (count, 1))
    qd = np.zeros((count, mechanism.nv))
    qdd = np.zeros((count, mechanism.nv))
    columns = {}
    for joint in mechanism.joints:
        for k in range(2) if joint.kind == "universal" else (None,):
            name = joint.name if k is None else f"{joint.name}.{k + 1}"
            if name not in back or not joint.nv:
                continue
            columns_of_first = back[name]
            at = mechanism.q_slices[joint.name]
            vat = mechanism.v_slices[joint.name]
            if k is not None:
                at = slice(at.start + k, at.start + k + 1)
                vat = slice(vat.start + k, vat.start + k + 1)
            q[:, at] = _build_configuration(joint.kind, states, columns_of_first)
            qd[:, vat] = states.qd[columns_of_first]
            qdd[:, vat] = states.qdd[columns_of_first]
            columns[columns_of_first] = vat
    torque = law(mechanism, q, qd, qdd)
    return {name: torque[:, vat] for name, vat in columns.items()}


def _build_configuration(kind: str, states: States, joint: str) -> Array:
    if kind == "continuous":
        return np.stack([np.cos(states.q[joint]), np.sin(states.q[joint])], axis=1)
    if kind in ("spherical", "free"):
        turns = np.array([convert_to_quaternion(pose.rotation) for pose in states.poses[joint]])
        places = np.array([pose.position for pose in states.poses[joint]])
        return np.hstack([places, turns]) if kind == "free" else turns
    return states.q[joint][:, None]


def evaluate_tree_efforts(tree: Tree, states: States) -> dict[str, Array]:
    """Return the efforts of a tree by joint (samples, nv) [N m], [N]."""
    return evaluate_efforts(build_mechanism(tree), states)


def map_states(states: States, tree: Tree, alignments: Mapping[str, MemberAlignment]) -> States:
    """Return states of A as states of B, by joint of A [rad], [m]."""
    q = {}
    poses = {}
    qd = {}
    qdd = {}
    for joint, k in tree.moving.items():
        seat = alignments[joint]
        kind = tree.members[k].kind
        if kind in SCALARS:
            q[joint] = seat.sign * (states.q[joint] - seat.offset)
            qd[joint] = seat.sign * states.qd[joint]
            qdd[joint] = seat.sign * states.qdd[joint]
            continue
        back = _build_velocity_map(kind, seat.frame)
        poses[joint] = [
            apply_placement(apply_placement(inverse(seat.frame), pose), seat.frame) for pose in states.poses[joint]
        ]
        qd[joint] = states.qd[joint] @ back.T
        qdd[joint] = states.qdd[joint] @ back.T
    return States(q, poses, qd, qdd)


def map_efforts_back(
    values: Mapping[str, Array], tree: Tree, alignments: Mapping[str, MemberAlignment]
) -> dict[str, Array]:
    """Return efforts of B as efforts of A's coordinates [N m], [N]."""
    made = {}
    for joint, k in tree.moving.items():
        kind = tree.members[k].kind
        dual = alignments[joint].sign if kind in SCALARS else _build_velocity_map(kind, alignments[joint].frame)
        made[joint] = values[joint] * dual if kind in SCALARS else values[joint] @ dual
    return made


def _build_velocity_map(kind: str, frame: Placement) -> Array:
    """A's velocity coordinates to B's."""
    return frame.rotation.T if kind == "spherical" else build_adjoint(compute_relative_pose(frame, Placement()))
