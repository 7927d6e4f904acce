"""Forces of closures from their multipliers, on nodes and as wrenches on second links; impulses of closures that begin to act.

Closures that begin to act on frames in relative motion stop it at once, perfectly plastic.  They and the drives, which keep
their own velocities, give impulses:  M (v+ - v-) = G^T Lambda + S J,  G v+ = 0.
Impulses are the inverse dynamics of the jump of velocity, so the same L T P gives them: P = M (v+ - v-).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexinv.constraints.closures import Rows, Stretch, evaluate_closures
from flexinv.constraints.equations import Ends, add_multiplier_forces
from flexinv.errors import InputError
from flexinv.inverse.inverse_dynamics import NodalForces, compute_projected_efforts
from flexinv.kernels.memory import make_contiguous
from flexinv.kinematics.mesh import Mesh, find_attachment_node
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.model.mechanism import WORLD
from flexinv.model.owned_cache import make_owner_cache
from flexinv.typing import Array, Mask

# Frames that meet with a relative velocity below this part of the fastest node's (of the mechanism's length, or 1 rad, per
# second where all is slower: from rest to rest there is nothing else to compare with) meet at rest: Newton leaves 1e-13,
# splines of samples 1e-9.
MEETING = 1e-6
# Frames further apart than this part of the mechanism's length (or 1 rad) have not met.
APART = 1e-6
# Nodal motion (one sample) and rates (nv,) of the joints on one side of an instant.
Side = tuple[NodalMotion, Array]


@dataclass(frozen=True)
class Impact:
    """Plastic impact: impulses and energy loss at the instant at which closures begin to act.

    time [s]; closures : names of those that begin to act
    torque : (nv,) impulses of the drives [N m s], [N s]; reaction : closure -> (6,) impulse [N s] and its moment [N m s] on the
        second link, at the closure and in its axes there; work : of the drives' impulses [J]; energy : lost energy [J]
    """

    time: float
    closures: tuple[str, ...]
    torque: Array
    reaction: dict[str, Array]
    work: float
    energy: float


def compute_closure_wrenches(
    mesh: Mesh, motion: NodalMotion, rows: Rows, multipliers: Array
) -> tuple[NodalForces, dict[str, Array]]:
    """Return the nodal forces [N], [N m] of multipliers, and by closures what each exerts on its second link.

    That is a wrench at its frame there and in its axes, (samples, 6) [N], [N m]; a coupling ties no frames: it has none.
    multipliers : (samples, rows) of the closures, or of their impulses
    """
    closures = mesh.mechanism.closures
    force, moment = np.zeros((2, *motion.x.shape))
    wrench = np.zeros((len(closures), len(motion.x), 6))
    add_multiplier_forces(
        rows, _list_end_frames(mesh), motion.frames, make_contiguous(multipliers), force, moment, wrench
    )
    shown = {c.name: reaction for c, reaction in zip(closures, wrench, strict=True) if c.kind != "coupling"}
    return NodalForces(force, moment), shown


def compute_phased_wrenches(
    mesh: Mesh, motion: NodalMotion, stretches: list[Stretch], multipliers: Array
) -> tuple[NodalForces, dict[str, Array]]:
    """Return the nodal forces and wrenches of `compute_closure_wrenches` [N], [N m], with the frames of each phase."""
    if len(stretches) == 1:
        return compute_closure_wrenches(mesh, motion, stretches[0].rows, multipliers)
    parts = [
        compute_closure_wrenches(mesh, motion.take_samples(s.span), s.rows, multipliers[s.span]) for s in stretches
    ]
    force, moment = (np.concatenate([getattr(forces, name) for forces, _ in parts]) for name in ("force", "moment"))
    return NodalForces(force, moment), {
        name: np.concatenate([forces[name] for _, forces in parts]) for name in parts[0][1]
    }


@make_owner_cache()
def _list_end_frames(mesh: Mesh) -> Ends:
    """Return the frames in which the closures report their wrenches; couplings have none, node -1."""
    closures = mesh.mechanism.closures
    second = np.array([c.second.link != WORLD for c in closures], dtype=bool)
    ends = [c.second if of_second else c.first for c, of_second in zip(closures, second, strict=True)]
    node = [
        -1 if c.kind == "coupling" else find_attachment_node(mesh, at) for c, at in zip(closures, ends, strict=True)
    ]
    place, turn = (np.array([getattr(at.placement, name) for at in ends]) for name in ("position", "rotation"))
    return Ends(np.array(node, dtype=np.int64), second, place.reshape(-1, 3), turn.reshape(-1, 3, 3))


def check_meeting(mesh: Mesh, rows: Rows, motion: NodalMotion, begins: Mask, time: float) -> None:
    """Raise InputError where closures begin to act [s] on frames that have not met, or that move against each other.

    rows : with the frames that they will tie; motion : one sample, just before; begins : (closures,)
    Frames may stand apart where the closure captures, and move where its impact is plastic.
    """
    m = mesh.mechanism
    scale = np.where(rows.direction, 1.0, mesh.length)
    apart, rate = np.abs(evaluate_closures(mesh, motion, rows)[0][0, :, :2].T) / scale
    fastest = max(np.abs(motion.v).max() / mesh.length, np.abs(motion.omega).max(), 1.0)
    for index in np.flatnonzero(begins):
        closure = m.closures[int(index)]
        members = np.flatnonzero(rows.closure == index)
        worst = int(members[np.argmax(apart[members])])
        if apart[worst] > APART:
            gap = f"{apart[worst]:.2g} rad" if rows.direction[worst] else f"{apart[worst] * mesh.length:.2g} m"
            raise InputError(
                f"mechanism '{m.name}', t = {time:g} s: closure '{closure.name}' begins to act on frames that are {gap} apart; "
                "bring them together, or write capture = true to tie them where they stand"
            )
        worst = int(members[np.argmax(rate[members])])
        if closure.impact == "error" and rate[worst] > MEETING * fastest:
            speed = f"{rate[worst]:.3g} rad/s" if rows.direction[worst] else f"{rate[worst] * mesh.length:.3g} m/s"
            raise InputError(
                f"mechanism '{m.name}', t = {time:g} s: closure '{closure.name}' begins to act on frames that move against each "
                f"other with {speed}, which takes an impulse; let the frames meet with equal velocities, or write "
                'impact = "plastic"'
            )


def compute_impulses(mesh: Mesh, sides: tuple[Side, Side], pushed: NodalForces | None = None) -> Array:
    """Return the impulse along every joint coordinate, (nv,) [N m s], [N s], as inverse dynamics of a jump of velocity gives it.

    pushed : impulses of the closures on the nodes; without them before drives and closures share it
    """
    (one, before), (two, after) = sides
    force = mesh.mass[:, None] * (two.v - one.v)  # (1, node, xyz)
    spin = np.einsum("nij,snj->sni", mesh.inertia, two.omega - one.omega)
    moment = np.einsum("snij,snj->sni", two.rotation, spin)
    if pushed is not None:
        force = force - pushed.force
        moment = moment - pushed.moment
    tau = compute_projected_efforts(mesh, two, NodalForces(force, moment))[0]
    return np.asarray(tau + mesh.mechanism.drive_table[0] * (after - before))  # with the rotors


def make_impact(
    mesh: Mesh, rows: Rows, begins: Mask, sides: tuple[Side, Side], torque: Array, multipliers: Array, time: float
) -> Impact:
    """Return the impact [N s], [N m s], [J] at an instant [s] from the impulses of the drives (nv,) and of the rows (rows,)."""
    (one, before), (two, after) = sides
    work = float(torque @ (before + after)) / 2
    lost = _compute_kinetic_energy(mesh, one, before) - _compute_kinetic_energy(mesh, two, after) + work
    reaction = {
        name: values[0] for name, values in compute_closure_wrenches(mesh, two, rows, multipliers[None])[1].items()
    }
    names = tuple(c.name for c, begun in zip(mesh.mechanism.closures, begins, strict=True) if begun)
    return Impact(time, names, torque, reaction, work, lost)


def _compute_kinetic_energy(mesh: Mesh, motion: NodalMotion, qd: Array) -> float:
    """Kinetic energy [J] of nodes and rotors at one instant."""
    moving = np.einsum("n,ni,ni->", mesh.mass, motion.v[0], motion.v[0])
    turning = np.einsum("nij,ni,nj->", mesh.inertia, motion.omega[0], motion.omega[0])
    return float(0.5 * (moving + turning + mesh.mechanism.drive_table[0] @ qd**2))
