"""Statics: the rest position of a mechanism under gravity and loads, and the torques that hold it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from flexinv.errors import InputError
from flexinv.evaluate import evaluate
from flexinv.integrate import STATICS
from flexinv.inverse import NodalForces
from flexinv.kinematics import Solver, Trajectory, equilibrium, record_instant, start_undeformed
from flexinv.march import CONVERGED
from flexinv.mechanism import Array, Body, Inertia, Mechanism
from flexinv.mesh import build
from flexinv.solution import Solution


def _vector() -> Array:
    return np.zeros(3)


@dataclass(frozen=True)
class Load:
    """A force and a moment on one link.

    link : name; station : on a beam the fraction 0..1 of the length [-], 1 the tip
    point : on a rigid link the point of application in the link frame, (3,) [m]
    force : (3,) [N]; moment : (3,) [N m]; world axes, or with ``follower`` axes that turn with the section (link)
    """

    link: str
    force: ArrayLike = field(default_factory=_vector)
    moment: ArrayLike = field(default_factory=_vector)
    station: float = 1.0
    point: ArrayLike = field(default_factory=_vector)
    follower: bool = False


def statics(mechanism: Mechanism, loads: Sequence[Load] = (), q: ArrayLike | None = None) -> Solution:
    """Return the equilibrium under gravity and loads with all joints held at ``q``: a Solution of one sample.

    Zero of the residual  f_elastic - m g - loads = 0  on all free nodes; loads are raised in steps as large as Newton converges.
    ``torque`` holds the joints; ``tip``, ``deflection``, ``wrench``, ``internal`` are those of the rest position.

    q : (nq,) [rad], [m], all joints at zero by default

    Raises InputError for a load that cannot act, ConvergenceError with the part of the load that was reached.
    """
    at = mechanism.neutral if q is None else np.asarray(q, dtype=float)
    if at.shape != (mechanism.nq,) or not np.isfinite(at).all():
        raise InputError(
            f"statics: q has shape {at.shape}, expected ({mechanism.nq},) finite numbers: {mechanism.coordinate_names}"
        )
    checked = [_checked(mechanism, load) for load in loads]
    if mechanism.closures:
        raise InputError(
            f"statics: mechanism '{mechanism.name}' has closures, whose passive joints would have to give way: not solved yet; "
            "write flexinv.solve(mechanism, motion, step=..., initial='static') with a motion at rest"
        )
    acting = [*(spring.name for spring in mechanism.springs), *(force.name for force in mechanism.forces)]
    if acting:
        raise InputError(
            f"statics: mechanism '{mechanism.name}' has springs or applied forces ({', '.join(acting)}), not solved here yet; "
            "write forces as loads=[flexinv.Load(link, force=...)], or of a rigid mechanism flexinv.joint_torques at rest"
        )
    mesh = build(_with_load_points(mechanism, checked))
    solver = Solver.of(mesh, set())
    for k, load in enumerate(checked):
        rows = solver.loads.follower if load.follower else solver.loads.dead
        rows[mesh.body_node[(load.link, _point_name(k))]] += np.concatenate([load.force, load.moment])
    rest = np.zeros(mechanism.nv)
    start_undeformed(solver, at, rest, rest)
    joints = equilibrium(solver, at, "statics")
    status, count, size = solver.newton(STATICS, joints)
    if status != CONVERGED:
        raise solver.complain(status, count, size, "statics")
    out = Trajectory.empty(1, mesh)
    record_instant(solver, 0, out)
    out.iterations[0] = count
    settings: dict[str, float | int | str | bool] = {"statics": True, "incremental": False}
    row = rest[None]
    return evaluate(mesh, out, np.zeros(1), at[None], row, row, set(), settings, _applied(solver))


def _applied(solver: Solver) -> NodalForces:
    """All loads in world axes at the rest position."""
    dead, follower, turn = solver.loads.dead, solver.loads.follower, solver.frames.r
    force = dead[:, :3] + np.einsum("nij,nj->ni", turn, follower[:, :3])  # (node, xyz)
    moment = dead[:, 3:] + np.einsum("nij,nj->ni", turn, follower[:, 3:])
    return NodalForces(force[None], moment[None])


def _point_name(index: int) -> str:
    return f"load {index}"


def _with_load_points(mechanism: Mechanism, loads: Sequence[Load]) -> Mechanism:
    """Put a massless body where each load acts, so that the mesh has a node there."""
    links = {link.name: link for link in mechanism.links}
    for k, load in enumerate(loads):
        link = links[load.link]
        point = np.asarray(load.point, dtype=float)
        station = None if link.beam is None else float(load.station)
        body = Body(_point_name(k), Inertia(0.0, point), station)
        links[load.link] = replace(link, bodies=(*link.bodies, body))
    return replace(mechanism, links=tuple(links.values()))


def _checked(mechanism: Mechanism, load: Load) -> Load:
    if load.link not in mechanism.link_of:
        raise InputError(
            f"load: no link {load.link!r} in '{mechanism.name}'; its links are {', '.join(mechanism.link_of)}"
        )
    vectors = {}
    for name, unit in (("force", "N"), ("moment", "N m"), ("point", "m")):
        value = np.asarray(getattr(load, name), dtype=float)
        if value.shape != (3,) or not np.isfinite(value).all():
            raise InputError(f"load on {load.link!r}: {name} = {value}, expected three finite numbers [{unit}]")
        vectors[name] = value
    if not 0.0 <= load.station <= 1.0:
        raise InputError(f"load on {load.link!r}: station = {load.station}, expected a fraction 0 to 1 of the length")
    return replace(load, force=vectors["force"], moment=vectors["moment"], point=vectors["point"])
