"""Loops in lanes beside rows G, one sample after the other."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from loop_examples import Example
from rigid_trees import TREE, tree, unit

import flexinv
from crosscheck.studies.robot_sweep import sample_states
from flexinv.constraints.closures import build_constraint_rows, compute_constraint_jacobian, evaluate_closures
from flexinv.kinematics.mesh import build
from flexinv.kinematics.nodal_motion import compute_rigid_motion
from flexinv.model.mechanism import WORLD, Attachment, Closure, Mechanism, Placement
from flexinv.rigid.blocks import CALL_CELLS
from flexinv.rigid.prepare import TorqueFunction, prepare
from flexinv.typing import Array

MODELS = Path(__file__).resolve().parents[2] / "models"


# Two eliminations of the same equations differ by rounding of their largest effort, the multipliers among them, over the smallest
# pivot: some hundreds here.
ROUNDING = 1e-12


def reference(f: TorqueFunction, state: tuple[Array, Array, Array]) -> Array:
    """Efforts of the cut tree, shared out by `shares`."""
    assert f.loops is not None
    tau = prepare(replace(f.mechanism, closures=()), f.passive, threads=1).torques(*state)
    return f.loops.compute_shares(*state, tau).tau


def doubts(f: TorqueFunction, samples: int) -> list[int]:
    """Which blocks the kernel has left to `shares`."""
    blocks = -(-samples // 128)
    return np.flatnonzero(f._own.counter[CALL_CELLS : CALL_CELLS + blocks]).tolist()


def largest(f: TorqueFunction, state: tuple[Array, Array, Array]) -> float:
    return float(np.abs(prepare(replace(f.mechanism, closures=()), f.passive, threads=1).torques(*state)).max())


def solved(example: Example, samples: int) -> tuple[Mechanism, tuple[Array, Array, Array]]:
    mechanism, case = example
    s = flexinv.solve(mechanism, case.motion, step=case.end / (samples - 1), start=case.start)
    return mechanism, (np.array(s.q), np.array(s.qd), np.array(s.qdd))


def closed_tree(
    kind: str,
    seed: int,
    drives: int,
    parts: tuple[tuple[str, str, str], ...] = TREE,
    bodies: tuple[str, str] = ("hip", "slider"),
) -> tuple[Mechanism, tuple[Array, Array, Array]]:
    """A tree of all kinds of joints, closed where it stands; samples of motions that keep the closure there.

    drives : how many more there are than freedoms; negative, how many fewer; bodies : between which it is closed
    """
    random = np.random.default_rng(seed)
    mechanism, (near, far) = tree(parts, seed), bodies
    q = sample_states(mechanism, 1, random)[0]
    one, other = bodies if seed % 2 and kind != "fixed" else (WORLD, near if seed % 2 else far)
    rest = np.zeros((1, mechanism.nv))
    motion, mesh = compute_rigid_motion(build(mechanism), q, rest, rest), build(mechanism)

    def pose(link: str) -> tuple[Array, Array]:
        if link == WORLD:
            return np.zeros(3), np.eye(3)
        node = next(mesh.joint_node[j.name] for j in mechanism.joints if j.child == link)
        return motion.x[0, node], motion.rotation[0, node]

    (xa, ra), (xb, rb) = pose(one), pose(other)
    seat = Placement(random.normal(size=3), np.linalg.qr(random.normal(size=(3, 3)))[0])
    seat = replace(seat, rotation=seat.rotation * np.sign(np.linalg.det(seat.rotation)))
    there = Placement(rb.T @ (xa + ra @ seat.position - xb), rb.T @ ra @ seat.rotation)
    axis = unit(random)
    across = np.cross(axis, unit(random))
    ends = Attachment(one, seat), Attachment(other, there)
    closure = Closure("C", kind, *ends, axis=axis, second_axis=across / np.linalg.norm(across))
    closed = replace(mechanism, closures=(closure,))
    return driven(closed, q, drives, random)


def driven(
    closed: Mechanism, q: Array, drives: int, random: np.random.Generator
) -> tuple[Mechanism, tuple[Array, Array, Array]]:
    """The drives, and motions of 150 samples at one configuration."""
    mesh, rest = build(closed), np.zeros((1, closed.nv))
    rows = build_constraint_rows(mesh)
    g = compute_constraint_jacobian(mesh, compute_rigid_motion(mesh, q, rest, rest), rows)[0]
    _, values, right = np.linalg.svd(g)
    rank = int((values > 1e-10 * values[0]).sum())
    qd = random.normal(size=(150, closed.nv - rank)) @ right[rank:]
    states = np.repeat(q, 150, axis=0)
    turning = evaluate_closures(mesh, compute_rigid_motion(mesh, states, qd, 0 * qd), rows)[0][:, :, 2]
    qdd = random.normal(size=qd.shape) @ right[rank:].T @ right[rank:] - turning @ np.linalg.pinv(g, rcond=1e-10).T
    passive: list[str] = []
    for joint in random.permutation(
        np.array([j.name for j in closed.joints if j.nv])
    ):  # as long as they are independent
        columns = [i for n in (*passive, joint) for i in range(*closed.v_slices[n].indices(closed.nv))]
        own = np.linalg.svd(g[:, columns], compute_uv=False)
        if len(columns) <= rank - drives and own[-1] > 1e-2 * values[0]:
            passive.append(str(joint))
    joints = tuple(replace(j, actuated=j.name not in passive, weight=random.uniform(0.5, 2.0)) for j in closed.joints)
    return replace(closed, joints=joints), (states, qd, qdd)
