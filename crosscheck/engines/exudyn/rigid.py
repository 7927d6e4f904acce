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
from typing import NamedTuple

import numpy as np
from exudyn.kinematicTree import JointTransformMotionSubspace66, KinematicTree66, MassCOMinertia2T66
from exudyn.rigidBodyUtilities import HT2T66Inverse, T66toHT

from crosscheck.engines.exudyn.models.frames import (
    Array,
    build_frame_along,
    compose,
    compute_joint_pose,
    compute_joint_twist,
    compute_scalar_coordinate,
    inverse,
    join_inertias,
    take_joint_q,
)
from flexinv.model.mechanism import WORLD, Inertia, Joint, Mechanism, Placement

LOCAL = ("Px", "Py", "Pz", "Rx", "Ry", "Rz")
Z_FIRST = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])  # columns: e_z, e_x, e_y
BALL = ("spherical", "free")


@dataclass(frozen=True)
class Tree:
    """Exudyn's tree of elementary joints and where the mechanism's coordinates are in it.

    types, transforms, inertias, parents : what ``KinematicTree66`` takes, one entry per elementary joint
    share : (nv, elementary joints) motion of each elementary joint per unit of a velocity coordinate [-], [m/rad]
    probe : first of the six coordinates at rest, by joint
    moving : first elementary joint of spherical and free joints and of slides, the frame before and after what moves
    link : elementary joint that carries a link (-1 the world), and the link's frame in that frame
    """

    types: list[str]
    transforms: list[Array]
    inertias: list[Array]
    parents: list[int]
    share: dict[tuple[int, int], float]
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
    tree = Tree([], [], [], [], {}, {}, {}, {WORLD: (-1, Placement())})
    for joint in mechanism.joints:
        carrier, frame = tree.link[joint.parent]
        frame = compose(frame, joint.placement)
        first = mechanism.v_slices[joint.name].start
        elements = list(_list_elementary_joints(joint))
        if elements and elements[0].kind != "Rz":
            tree.moving[joint.name] = (len(tree.types), frame, elements[0].frame)
        for one in elements:
            carrier = _add_elementary_joint(tree, one.kind, carrier, compose(frame, one.frame))
            frame = inverse(one.frame)
            tree.share[first + one.coordinate, carrier] = one.share
        if wrench and joint.nv:
            tree.probe[joint.name] = len(tree.types)
            for kind in LOCAL:
                carrier = _add_elementary_joint(tree, kind, carrier, frame)
                frame = Placement()
        tree.link[joint.child] = (carrier, frame)
        if carrier >= 0:
            bodies = join_inertias([(b.inertia, Placement()) for b in mechanism.link_of[joint.child].bodies])
            tree.inertias[carrier] = tree.inertias[carrier] + build_inertia66(bodies, frame)
    return tree


class Element(NamedTuple):
    """An elementary joint: its kind, the constant frame in which it acts, its coordinate of the joint, its share of that."""

    kind: str
    frame: Placement
    coordinate: int
    share: float


def _list_elementary_joints(joint: Joint) -> Iterator[Element]:
    """Yield the elementary joints that make up a joint; one with a single coordinate slides and turns as its twist says."""
    if joint.kind in BALL:
        yield from (Element(kind, Placement(), k, 1.0) for k, kind in enumerate(LOCAL[-joint.nv :]))
    elif joint.kind == "universal":
        for k, axis in enumerate((joint.axis, joint.second_axis)):
            yield Element("Rz", Placement(np.zeros(3), build_frame_along(axis) @ Z_FIRST.T), k, 1.0)
    elif joint.nv:
        along = Placement(np.zeros(3), build_frame_along(joint.axis) @ Z_FIRST.T)
        twist = compute_joint_twist(joint, np.zeros(joint.nq), np.ones(1))
        for kind, part in zip(("Pz", "Rz"), twist, strict=True):
            if part.any():
                yield Element(kind, along, 0, float(part @ joint.axis))


def _add_elementary_joint(tree: Tree, kind: str, parent: int, frame: Placement) -> int:
    tree.types.append(kind)
    tree.transforms.append(build_transform66(frame))
    tree.inertias.append(np.zeros((6, 6)))
    tree.parents.append(parent)
    return len(tree.types) - 1


def build_transform66(frame: Placement) -> Array:
    """Return Exudyn's transformation (6, 6) of a frame in its parent's frame."""
    h = np.eye(4)
    h[:3, :3] = frame.rotation
    h[:3, 3] = frame.position
    return np.asarray(HT2T66Inverse(h))


def build_inertia66(body: Inertia, frame: Placement) -> Array:
    """Return Exudyn's inertia (6, 6) of a body whose frame is ``frame`` in the frame of the elementary joint."""
    com = frame.position + frame.rotation @ body.com
    return np.asarray(MassCOMinertia2T66(body.mass, com, frame.rotation @ body.tensor @ frame.rotation.T))


def compute_inverse_dynamics(mechanism: Mechanism, q: Array, qd: Array, qdd: Array, wrench: bool = True) -> RigidResult:
    """Return M(q) qdd + f(q, qd) of the bodies at every sample, wrenches at moving joints, tips.

    q : (samples, nq); qd, qdd : (samples, nv); units of ``RigidResult``
    """
    tree = build(mechanism, wrench)
    effort = np.zeros((len(q), len(tree.types)))
    tip = {link.name: np.zeros((len(q), 3)) for link in mechanism.links}
    moved = {n: compute_moving_pose(mechanism, mechanism.joint_of[n], q) for n in tree.moving}
    angle, rate, rate2 = compute_elementary_motion(mechanism, tree, q, qd, qdd)
    share = build_share_matrix(mechanism, tree)
    for s in range(len(q)):
        transforms = list(tree.transforms)
        for name, (first, before, after) in tree.moving.items():
            pose = Placement(moved[name][0][s], moved[name][1][s])
            transforms[first] = build_transform66(compose(compose(before, pose), after))
        exu = KinematicTree66(tree.types, transforms, tree.inertias, tree.parents, gravity=mechanism.gravity)
        mass, force = exu.ComputeMassMatrixAndForceTerms(angle[s], rate[s])
        effort[s] = mass @ rate2[s] + force
        _fill_tips(mechanism, tree, transforms, angle[s], {name: t[s] for name, t in tip.items()})
    probes = {name: effort[:, k : k + 6] for name, k in tree.probe.items()}
    return RigidResult(effort @ share.T, probes, tip)


def compute_moving_pose(mechanism: Mechanism, joint: Joint, q: Array) -> tuple[Array, Array]:
    """Return position (samples, 3) [m] and rotation (samples, 3, 3) of the frame in ``Tree.moving`` for q (samples, nq).

    A ball's is the child's; of a joint that slides only the way is in it, and what turns turns behind it.
    """
    p, r = compute_joint_pose(joint, take_joint_q(mechanism, joint, q))
    return (p, r) if joint.kind in BALL else (p, np.tile(np.eye(3), (len(q), 1, 1)))


def build_share_matrix(mechanism: Mechanism, tree: Tree) -> Array:
    """Return ``Tree.share`` as a matrix (nv, elementary joints) [-], [m/rad]."""
    out = np.zeros((mechanism.nv, len(tree.types)))
    for (v, element), share in tree.share.items():
        out[v, element] = share
    return out


def compute_elementary_motion(
    mechanism: Mechanism, tree: Tree, q: Array, qd: Array, qdd: Array
) -> tuple[Array, Array, Array]:
    """Return coordinates, rates and accelerations [rad], [m], [s] of the elementary joints, (samples, elementary)."""
    share = build_share_matrix(mechanism, tree)
    angle = np.zeros((len(q), len(tree.types)))
    rate = qd @ share
    rate2 = qdd @ share
    for joint in mechanism.joints:
        v = mechanism.v_slices[joint.name]
        at = np.flatnonzero(share[v].any(axis=0))
        part = take_joint_q(mechanism, joint, q)
        if joint.kind in BALL:
            w = qd[:, v][:, -3:]
            turns = np.stack([-w[:, 1] * w[:, 2], w[:, 0] * w[:, 2], -w[:, 0] * w[:, 1]], axis=1)  # (sample, xyz)
            rate2[:, at[-3:]] += turns
            if joint.kind == "free":
                rate2[:, at[:3]] += np.cross(w, qd[:, v][:, :3])
        elif joint.kind == "universal":
            angle[:, at] = part
        elif joint.nv:
            turning = at[[tree.types[element] == "Rz" for element in at]]
            angle[:, turning] = compute_scalar_coordinate(joint, part)[:, None] * share[v, turning]
    return angle, rate, rate2


def _fill_tips(mechanism: Mechanism, tree: Tree, transforms: list[Array], angle: Array, tip: dict[str, Array]) -> None:
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
