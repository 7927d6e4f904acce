"""Mechanisms with passive joints of every kind in arbitrary states of motion, seen by the march's own kernels."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flexinv.dynamics.generalized_alpha import DYNAMIC, Scheme
from flexinv.dynamics.initial_state import begin_undeformed, compute_joint_motion
from flexinv.dynamics.solver import Solver
from flexinv.kernels.so3 import exp_so3, tangent3
from flexinv.kinematics.mesh import build
from flexinv.kinematics.tree import Frames, Joints
from flexinv.model.mechanism import (
    Attachment,
    Beam,
    Body,
    Force,
    Inertia,
    Joint,
    Link,
    Mechanism,
    Placement,
    Section,
    Spring,
)
from flexinv.typing import Array

MANY = ("spherical", "universal", "free")  # joints without a spring
PASSIVE_KINDS = ("revolute", "continuous", "prismatic", "spherical", "universal", "helical", "free")
# dv = CV dx and da = CA dx: any numbers, the linearisation is to hold for all
SCHEME = Scheme(DYNAMIC, 1.0, 3.0, 7.0, 0.25, 0.5, 0.0, 0.0)
SOFT = Section(np.zeros(1), np.array([[9.0, 4.0, 5.0, 3.0, 5.0, 4.0]]), np.array([0.3]), np.array([[0.2, 0.1, 0.1]]))


def branching(kind: str) -> Mechanism:
    """A beam on a driven hub; at its end a passive rigid body and a curved beam that carries one more passive body."""
    axis, second = np.array([0.36, 0.48, 0.8]), np.array([0.8, -0.6, 0.0])

    def placed(*psi: float) -> Placement:
        return Placement(np.array([0.1, 0.0, 0.2]), exp_so3(np.array(psi)))

    def body(mass: float) -> Body:
        return Body("body", Inertia(mass, np.array([0.5, 0.2, -0.3]), np.diag([0.3, 0.4, 0.5])))

    rotor = 0.0 if kind == "free" else 0.2
    links = (
        Link("beam", (), Beam(1.0, SOFT, 2, 2)),
        Link("passive", (body(0.4),)),
        Link("curved", (), Beam(0.8, SOFT, 1, 3, np.array([0.3, 0.5, -0.4]))),
        Link("last", (body(0.2),)),
    )
    joints = (
        Joint("hub", "revolute", "world", "beam"),
        Joint(
            "free", kind, "beam", "passive", placed(0.3, 0.2, 0.1), axis=axis, second_axis=second, rotor_inertia=rotor,
            damping=0.3, friction=0.1, stiffness=0.0 if kind in MANY else 1.3, rest=0.2, actuated=False,
            pitch=0.9 if kind == "helical" else 0.0,
        ),
        Joint("elbow", "revolute", "beam", "curved", placed(0.1, 0.5, 0.4), axis=np.array([0.0, 1.0, 0.0])),
        Joint("swing", "revolute", "curved", "last", placed(0.0, 0.3, 0.0), damping=0.2, actuated=False),
    )  # fmt: skip
    m = Mechanism(f"branching, {kind}", links, joints, gravity=np.array([1.0, -2.0, -9.0]))
    return _pulled(m, ("beam", 0.5), ("last", None), ("curved", 1.0), ("passive", None))


def _pulled(m: Mechanism, *points: tuple[str, float | None]) -> Mechanism:
    """Forces and moments, dead ones and followers, and springs between the points and to the world."""
    rng = np.random.default_rng(3)
    ends = [Attachment(link, Placement(rng.normal(size=3)), station) for link, station in points]
    wrenches = rng.normal(size=(2 * len(ends), 1, 6))
    forces = tuple(Force(f"F{k}", ends[k // 2], wrench, follower=k % 2 == 1) for k, wrench in enumerate(wrenches))
    world = Attachment("world", Placement(np.array([0.5, 0.5, 0.5])))
    springs = tuple(
        Spring(f"S{k}", a, b, 5.0, 0.3 * k, 0.7) for k, (a, b) in enumerate(zip([world, *ends], ends, strict=False))
    )
    return replace(m, forces=forces, springs=springs)


def hanging(kind: str) -> Mechanism:
    """A passive joint on the world: its freedoms are a block there; a beam is driven on the body it carries."""
    links = (
        Link("body", (Body("body", Inertia(1.0, np.array([0.1, 0.2, 0.3]), np.diag([0.3, 0.4, 0.5]))),)),
        Link("beam", (), Beam(0.8, SOFT, 1, 2)),
    )
    joints = (
        Joint(
            "root",
            kind,
            "world",
            "body",
            axis=np.array([0.6, 0.0, 0.8]),
            actuated=False,
            pitch=0.9 * (kind == "helical"),
        ),
        Joint(
            "drive",
            "revolute",
            "body",
            "beam",
            Placement(np.array([0.1, 0.0, 0.0]), exp_so3(np.array([0.1, 0.2, 0.3]))),
        ),
    )
    m = Mechanism(f"hanging, {kind}", links, joints, gravity=np.array([0.0, 0.0, -9.0]))
    return _pulled(m, ("body", None), ("beam", 1.0))


@dataclass
class MovingSolver:
    """A solver in a state of motion: increments d, velocities u and accelerations du, loads on all nodes."""

    solver: Solver
    joints: Joints
    d: Array
    u: Array
    du: Array

    def at(self, direction: Array, h: float) -> tuple[Frames, Array]:
        """Motion of all nodes and residual, moved by h along increments ``direction`` in the scheme's way."""
        s = self.solver
        turned = self.rates() @ direction
        s.state.d[:] = self.d + h * turned
        s.state.u[:] = self.u + h * SCHEME.cv * turned
        s.state.du[:] = self.du + h * SCHEME.ca * turned
        joints = Joints(*(part.copy() for part in self.joints))
        assert s.evaluate(SCHEME, joints) == -1
        return Frames(*(part.copy() for part in s.frames)), s.work.residual[0].copy()

    def rates(self) -> Array:
        """What increments (dx, theta, dq) make of d: rotation vectors change by H^-1 theta."""
        out, t = np.eye(len(self.d)), self.solver.topology
        for node in range(len(t.parent)):
            first = int(t.offset[t.block[node]])
            if t.independent[node]:
                own = slice(first + 3, first + 6)
            elif t.triple[node] >= 0:
                start = int(first + t.column[node] + t.triple[node])
                own = slice(start, start + 3)
            else:
                continue
            out[own, own] = np.linalg.inv(tangent3(self.d[own]))
        return out


def scene(mechanism: Mechanism) -> MovingSolver:
    rng = np.random.default_rng(11)
    passive = {joint.name for joint in mechanism.joints if not joint.actuated}
    solver = Solver.build_for(build(mechanism), passive)
    qd, qdd = rng.normal(size=(2, mechanism.nv))
    begin_undeformed(solver, mechanism.neutral, qd, qdd)
    solver.update_loads(0.0, mechanism.neutral, qd, qdd)
    solver.border.ties.multiplier[:] = rng.normal(size=len(solver.border.ties.a))
    unknowns = solver.increment.shape[1]
    joints = compute_joint_motion(solver.mesh, mechanism.neutral, qd, qdd)
    return MovingSolver(solver, joints, *(0.2 * rng.normal(size=(3, unknowns))))
