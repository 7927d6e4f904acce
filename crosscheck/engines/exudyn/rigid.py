"""Rigid mechanisms by Exudyn's ``KinematicTree66`` (Featherstone, Pluecker coordinates): tau = M qdd + f.

Conventions, as a map and its dual.

    joints        The tree knows Rx, Ry, Rz, Px, Py, Pz.  A turn about the axis n is Rz between two constant rotations C
                  and C^T with C e_z = n; universal: two of them.  Spherical and free joints: Rx, Ry, Rz (after Px,
                  Py, Pz) at zero, on a frame that is put where the joint stands at this sample.  There
                      rates = body velocity,  rates' = acceleration + (w x v for the slides,
                                                       (-wy wz, wx wz, -wx wy) for the turns R = Rx Ry Rz)
                  and the generalized forces are force and moment along the child's axes.
                  Prismatic: Pz between C and C^T, also at zero on a frame that moves, because
                  ``TranslationZ2T66Inverse(q)`` of 1.13.6 puts the child at -q while the rate counts as +q'.
    wrench        Six more coordinates of that kind, at rest, between a joint and its child: their generalized forces
                  are the force and the moment on the child, at the joint, in the child's frame.
    tau           actuator effort = M qdd + f + rotor inertia qdd + d qd + friction sign(qd)

Source: exudyn 1.13.6, kinematicTree.py (transformations are child X parent, inertias about the frame's origin).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from exudyn.kinematicTree import JointTransformMotionSubspace66, KinematicTree66, MassCOMinertia2T66
from exudyn.rigidBodyUtilities import HT2T66Inverse, T66toHT
from numpy.typing import NDArray

from crosscheck.engines.exudyn.models.frames import (
    Array,
    combine,
    compose,
    frame_along,
    inverse,
    joint_pose,
    joint_q,
    scalar_coordinate,
)
from flexinv.model.mechanism import WORLD, Inertia, Joint, Mechanism, Placement

LOCAL = ("Px", "Py", "Pz", "Rx", "Ry", "Rz")
Z_FIRST = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])  # columns: e_z, e_x, e_y
BALL = ("spherical", "free")
MOVING = ("prismatic", *BALL)


@dataclass(frozen=True)
class Tree:
    """Exudyn's tree of elementary joints and where the mechanism's coordinates are in it.

    types, transforms, inertias, parents : what ``KinematicTree66`` takes, one entry per elementary joint
    velocity : the elementary joint of every velocity coordinate (nv,)
    probe : first of the six coordinates at rest, by joint
    moving : first elementary joint of prismatic, spherical and free joints, the frame before and after their motion
    link : elementary joint that carries a link (-1 the world), and the link's frame in that frame
    """

    types: list[str]
    transforms: list[Array]
    inertias: list[Array]
    parents: list[int]
    velocity: NDArray[np.intp]
    probe: dict[str, int]
    moving: dict[str, tuple[int, Placement, Placement]]
    link: dict[str, tuple[int, Placement]]


@dataclass(frozen=True)
class RigidResult:
    """Effort of the bodies alone and what else the tree gives.

    torque : (samples, nv) [N m] or [N]; wrench : by joint (samples, 6) [N], [N m]; tip : by link (samples, 3) [m]
    """

    torque: Array
    wrench: dict[str, Array]
    tip: dict[str, Array]


def build(mechanism: Mechanism, wrench: bool) -> Tree:
    """Return Exudyn's tree of a rigid mechanism, with probes for the wrenches of its moving joints if asked."""
    tree = Tree([], [], [], [], np.zeros(mechanism.nv, dtype=np.intp), {}, {}, {WORLD: (-1, Placement())})
    for joint in mechanism.joints:
        carrier, frame = tree.link[joint.parent]
        frame = compose(frame, joint.placement)
        first = mechanism.v_slices[joint.name].start
        elements = list(_elements(joint))
        if joint.kind in MOVING:
            tree.moving[joint.name] = (len(tree.types), frame, elements[0][1])
        for k, (kind, turned) in enumerate(elements):
            carrier = _append(tree, kind, carrier, compose(frame, turned))
            frame = inverse(turned)
            tree.velocity[first + k] = carrier
        if wrench and joint.nv:
            tree.probe[joint.name] = len(tree.types)
            for kind in LOCAL:
                carrier = _append(tree, kind, carrier, frame)
                frame = Placement()
        tree.link[joint.child] = (carrier, frame)
        if carrier >= 0:
            bodies = combine([(b.inertia, Placement()) for b in mechanism.link_of[joint.child].bodies])
            tree.inertias[carrier] = tree.inertias[carrier] + inertia66(bodies, frame)
    return tree


def _elements(joint: Joint) -> Iterator[tuple[str, Placement]]:
    """Yield the elementary joints and the constant frame in which each acts."""
    if joint.kind in BALL:
        yield from ((kind, Placement()) for kind in LOCAL[-joint.nv :])
    elif joint.kind != "fixed":
        kind = "Pz" if joint.kind == "prismatic" else "Rz"
        for axis in (joint.axis, joint.second_axis)[: joint.nv]:
            yield kind, Placement(np.zeros(3), frame_along(axis) @ Z_FIRST.T)


def _append(tree: Tree, kind: str, parent: int, frame: Placement) -> int:
    tree.types.append(kind)
    tree.transforms.append(transform66(frame))
    tree.inertias.append(np.zeros((6, 6)))
    tree.parents.append(parent)
    return len(tree.types) - 1


def transform66(frame: Placement) -> Array:
    """Return Exudyn's transformation (6, 6) of a frame in its parent's frame."""
    h = np.eye(4)
    h[:3, :3], h[:3, 3] = frame.rotation, frame.position
    return np.asarray(HT2T66Inverse(h))


def inertia66(body: Inertia, frame: Placement) -> Array:
    """Return Exudyn's inertia (6, 6) of a body whose frame is ``frame`` in the frame of the elementary joint."""
    com = frame.position + frame.rotation @ body.com
    return np.asarray(MassCOMinertia2T66(body.mass, com, frame.rotation @ body.tensor @ frame.rotation.T))


def inverse_dynamics(mechanism: Mechanism, q: Array, qd: Array, qdd: Array, wrench: bool = True) -> RigidResult:
    """Return M(q) qdd + f(q, qd) of the bodies at every sample, wrenches at moving joints, tips.

    q : (samples, nq); qd, qdd : (samples, nv); units of ``RigidResult``
    """
    tree = build(mechanism, wrench)
    effort = np.zeros((len(q), len(tree.types)))
    tip = {link.name: np.zeros((len(q), 3)) for link in mechanism.links}
    moved = {n: joint_pose(mechanism.joint_of[n], joint_q(mechanism, mechanism.joint_of[n], q)) for n in tree.moving}
    angle, rate, rate2 = elementary(mechanism, tree, q, qd, qdd)
    for s in range(len(q)):
        transforms = list(tree.transforms)
        for name, (first, before, after) in tree.moving.items():
            pose = Placement(moved[name][0][s], moved[name][1][s])
            transforms[first] = transform66(compose(compose(before, pose), after))
        exu = KinematicTree66(tree.types, transforms, tree.inertias, tree.parents, gravity=mechanism.gravity)
        mass, force = exu.ComputeMassMatrixAndForceTerms(angle[s], rate[s])
        effort[s] = mass @ rate2[s] + force
        _tips(mechanism, tree, transforms, angle[s], {name: t[s] for name, t in tip.items()})
    probes = {name: effort[:, k : k + 6] for name, k in tree.probe.items()}
    return RigidResult(effort[:, tree.velocity], probes, tip)


def elementary(mechanism: Mechanism, tree: Tree, q: Array, qd: Array, qdd: Array) -> tuple[Array, Array, Array]:
    """Return coordinates, rates and accelerations [rad], [m], [s] of the elementary joints, (samples, elementary)."""
    angle, rate, rate2 = (np.zeros((len(q), len(tree.types))) for _ in range(3))
    rate[:, tree.velocity], rate2[:, tree.velocity] = qd, qdd
    for joint in mechanism.joints:
        v = mechanism.v_slices[joint.name]
        at = tree.velocity[v]
        part = joint_q(mechanism, joint, q)
        if joint.kind in BALL:
            w = qd[:, v][:, -3:]
            turns = np.stack([-w[:, 1] * w[:, 2], w[:, 0] * w[:, 2], -w[:, 0] * w[:, 1]], axis=1)  # (sample, xyz)
            rate2[:, at[-3:]] += turns
            if joint.kind == "free":
                rate2[:, at[:3]] += np.cross(w, qd[:, v][:, :3])
        elif joint.kind == "universal":
            angle[:, at] = part
        elif joint.kind in ("revolute", "continuous"):
            angle[:, at[0]] = scalar_coordinate(joint, part)
    return angle, rate, rate2


def _tips(mechanism: Mechanism, tree: Tree, transforms: list[Array], angle: Array, tip: dict[str, Array]) -> None:
    """Fill in the tips by chaining Exudyn's own transformations from the world outward."""
    chain: list[Array] = []
    for kind, parent, fixed, a in zip(tree.types, tree.parents, transforms, angle, strict=True):
        step = JointTransformMotionSubspace66(kind, a)[0] @ fixed
        chain.append(step if parent < 0 else step @ chain[parent])
    poses = [T66toHT(np.linalg.inv(x)) for x in chain]
    for name, point in tip.items():
        carrier, frame = tree.link[name]
        local = frame.position + frame.rotation @ mechanism.link_of[name].tip
        point[:] = local if carrier < 0 else poses[carrier][:3, :3] @ local + poses[carrier][:3, 3]
