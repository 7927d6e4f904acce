"""Closures: the equations that tie two frames of a mechanism, their rates, and the forces that belong to them.

Every constraint is a product of vectors that two frames A and B carry, in world axes:

    position   phi = u . d        u fixed in A, d = x_B - x_A
    direction  phi = u . w        u fixed in A, w fixed in B

so that phi' and phi'' follow from the motion of the two nodes alone, and a multiplier lambda is a pair of wrenches on
them: position u on B and -u on A (with the moments of the lever arms), direction w x u on B and u x w on A.  These go
through the same sums along the tree as all nodal forces, G^T lambda = (L T) P_lambda: topology is data.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from flexinv.constraints.equations import Rows as Rows
from flexinv.constraints.equations import fill_closure_samples
from flexinv.errors import InputError
from flexinv.kernels.so3 import find_vectors_across
from flexinv.kinematics.configuration import build_nodes
from flexinv.kinematics.mesh import Mesh, find_attachment_node
from flexinv.kinematics.nodal_motion import NodalMotion, list_sliding_coordinates
from flexinv.model.attachments import COUPLED_JOINTS
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import CLOSURES, GEARED, Closure, Mechanism
from flexinv.model.owned_cache import make_owner_cache
from flexinv.typing import Array, Indices, Mask, Triple

# A switching instant this close to a sample, in parts of the step, is that sample.
SAME_INSTANT = 1e-6
# Rounding of entries of G, of some tens of operations, over the mechanism's length or 1.
GRADIENT_ROUNDING = 1e-13


@make_owner_cache()
def build_constraint_rows(mesh: Mesh) -> Rows:
    """Return the constraints of a mesh's closures [m], [-]; raises InputError for a coupling of joints that it cannot tie."""
    m = mesh.mechanism
    table = [row for index, closure in enumerate(m.closures) for row in _list_rows(mesh, index, closure)]
    kinds: list[tuple[type, tuple[int, ...]]] = [(kind, ()) for kind in (np.int64, bool, np.int64, np.int64)]
    kinds += [*4 * [(float, (3,))], (float, (m.nv,)), (float, ())]
    parts = zip(kinds, zip(*table, strict=True) if table else 10 * [()], strict=True)
    columns: list[Any] = [np.array(part, kind).reshape(len(table), *shape) for (kind, shape), part in parts]
    _, directed, of_first, of_second, *_, gears, _ = columns
    geared = (np.abs(gears) * list_velocity_scales(mesh)).max(axis=1, initial=0.0)
    scale = np.where(geared > 0.0, geared, np.where(directed, 1.0, mesh.length))
    last = np.searchsorted(columns[0], columns[0], side="right")
    pattern = _build_jacobian_pattern(mesh, of_first, of_second, gears)
    columns += [pattern, scale, last, _find_places(m)]
    return Rows(*columns)


def _list_rows(mesh: Mesh, index: int, closure: Closure) -> list[tuple[Any, ...]]:
    """The first fields of `Rows` for each constraint of a closure."""
    nv = mesh.mechanism.nv
    if closure.kind == "coupling":
        return [(index, True, -1, -1, *np.zeros((4, 3)), _build_gear(mesh.mechanism, closure), closure.offset)]
    a = find_attachment_node(mesh, closure.first)
    b = find_attachment_node(mesh, closure.second)
    first = closure.first.placement
    second = closure.second.placement
    out: list[tuple[Any, ...]] = []
    for direction, u, w in _list_equations(closure):
        vectors = (first.position, second.position, first.rotation @ u, second.rotation @ w)
        out.append((index, direction, a, b, *vectors, np.zeros(nv), 0.0))
    return out


def _build_gear(mechanism: Mechanism, closure: Closure) -> Array:
    """The factors of a coupling (nv,)."""
    what = f"closure '{closure.name}': a coupling"
    gear = np.zeros(mechanism.nv)
    for name, factor in closure.factors:
        if name not in mechanism.joint_of or mechanism.joint_of[name].kind not in GEARED:
            known = ", ".join(j.name for j in mechanism.joints if j.kind in GEARED) or "none"
            raise InputError(f"{what} ties {COUPLED_JOINTS} ({known}), not {name!r}")
        gear[mechanism.v_slices[name].start] = factor
    if closure.active:
        raise InputError(f"{what} acts all the time; leave its active intervals out")
    return gear


def _find_places(mechanism: Mechanism) -> Indices:
    """Places (nv,) of the coordinates that a coupling may tie, -1 for others."""
    place = np.full(mechanism.nv, -1, dtype=np.int64)
    for joint in mechanism.joints:
        if joint.kind in GEARED:
            place[mechanism.v_slices[joint.name].start] = mechanism.q_slices[joint.name].start
    return place


def compute_coupling_residuals(rows: Rows, q: Array, qd: Array, qdd: Array) -> Triple:
    """Return sum gear q - offset [rad], [m] and its two rates, (samples, rows) each; zero for rows that are no couplings.

    q : (samples, nq), qd, qdd : (samples, nv)
    """
    scalar = np.where(rows.place >= 0, q[:, rows.place], 0.0)
    return scalar @ rows.gear.T - rows.offset, qd @ rows.gear.T, qdd @ rows.gear.T


def move_second_frames(mechanism: Mechanism, original: Rows, now: Rows, motion: NodalMotion, which: Mask) -> Rows:
    """Return ``now`` with the second frames of the closures ``which`` (closures,) put where the first ones stand [m], [-].

    original : rows of the mechanism as it is written; motion : one sample.  A universal closure keeps its second axis.
    """
    (xa, ra), (xb, rb) = (_take_row_frames(motion, nodes) for nodes in (original.a, original.b))
    seen = np.einsum("rji,rj->ri", rb, xa + np.einsum("rij,rj->ri", ra, original.place_a) - xb)  # (row, xyz) from B
    w = now.w.copy()
    for k, index in enumerate(original.closure):
        closure = mechanism.closures[index]
        if which[index] and original.direction[k] and closure.kind != "universal":
            aligned = closure.first.placement.rotation @ closure.second.placement.rotation.T
            w[k] = rb[k].T @ ra[k] @ aligned @ original.w[k]
    return now._replace(place_b=np.where(which[original.closure][:, None], seen, now.place_b), w=w)


def _list_equations(closure: Closure) -> list[tuple[bool, Array, Array]]:
    """Rows (direction?, u in frame A, w in frame B) of one closure."""
    x, y, z = np.eye(3)
    across, also = find_vectors_across(closure.axis)
    position = (across, also) if closure.kind in ("prismatic", "cylindrical", "point-on-line") else (x, y, z)
    direction = {
        "fixed": ((x, y), (y, z), (z, x)),
        "prismatic": ((x, y), (y, z), (z, x)),
        "revolute": ((across, closure.axis), (also, closure.axis)),
        "cylindrical": ((across, closure.axis), (also, closure.axis)),
        "universal": ((closure.axis, closure.second_axis),),
    }.get(closure.kind, ())
    rows = [(False, u, np.zeros(3)) for u in position] + [(True, u, w) for u, w in direction]
    assert len(rows) == CLOSURES[closure.kind]
    return rows


def _take_row_frames(motion: NodalMotion, nodes: Indices) -> tuple[Array, Array]:
    """Place and axes of the rows' nodes at the first sample; the world (-1) stands still."""
    fixed = (nodes < 0)[:, None]
    return np.where(fixed, 0.0, motion.x[0, nodes]), np.where(fixed[..., None], np.eye(3), motion.rotation[0, nodes])


def evaluate_closures(mesh: Mesh, motion: NodalMotion, rows: Rows) -> tuple[Array, Array]:
    """Return phi [m], [-] and its two time derivatives, (samples, rows, 3), for given nodal motion, and "
    "`compute_constraint_jacobian`.

    phi'' = u''.w + 2 u'.w' + u.w''; those of couplings are zero (`compute_coupling_residuals`).
    """
    samples = len(motion.x)
    count = len(rows.closure)
    phi = np.zeros((samples, count, 3))
    g = np.zeros((samples, count, mesh.mechanism.nv))
    if count:
        fill_closure_samples(build_nodes(mesh), rows, motion.frames, phi, g)
    return phi, drop_rounding(mesh, rows.direction, g)


def compute_constraint_jacobian(mesh: Mesh, motion: NodalMotion, rows: Rows) -> Array:
    """Return G, (samples, rows, nv) [m/rad], [-], phi' = G qd: each row is the joint efforts of a unit multiplier."""
    return evaluate_closures(mesh, motion, rows)[1]


def _build_jacobian_pattern(mesh: Mesh, a: Indices, b: Indices, gear: Array) -> Mask:
    """Mask (rows, nv) of entries that G may have: joints on one way only from a row's nodes to the world, and of its coupling."""
    jacobian_pattern = np.asarray(gear != 0.0)
    for k, ends in enumerate(zip(a.tolist(), b.tolist(), strict=True)):
        for node in ends:
            while node >= 0:
                first = mesh.v_index[node]
                if first >= 0:
                    jacobian_pattern[k, first : first + mesh.freedoms[node]] ^= True
                node = mesh.parent[node]
    return jacobian_pattern


@make_owner_cache()
def list_velocity_scales(mesh: Mesh) -> Array:
    """Return the scale of each velocity coordinate, (nv,): the mechanism's length [m] for slides, 1 for all others."""
    return np.where(list_sliding_coordinates(mesh.mechanism), mesh.length, 1.0)


def compute_gradient_rounding(mesh: Mesh, direction: Mask) -> Array:
    """Return the rounding of each entry of G, (rows, nv) [m/rad], [-]; direction : (rows,) as of `Rows`."""
    return GRADIENT_ROUNDING * np.where(direction[:, None], 1.0, mesh.length / list_velocity_scales(mesh))


def drop_rounding(mesh: Mesh, direction: Mask, g: Array) -> Array:
    """Return G (samples, rows, nv) [m/rad], [-], set to zero in place where all of a sample is rounding.

    So it is where closures tie nothing: a second bearing of a shaft.  Ranks are told from the largest entry, which then is none.
    """
    least = compute_gradient_rounding(mesh, direction)
    if len(g) and (np.abs(g[0]) <= least).all():  # else there is one that ties something
        g[(np.abs(g) <= least).all(axis=(1, 2))] = 0.0
    return g


@make_owner_cache()
def list_coordinate_scales(mesh: Mesh) -> Array:
    """Return the scale of each coordinate, (nq,): the mechanism's length [m] for positions, 1 for all others."""
    kinds = [KINDS[joint.kind] for joint in mesh.mechanism.joints]
    return np.array([mesh.length if k < sum(one.translations) else 1.0 for one in kinds for k in range(len(one.q))])


# ----------------------------------------------------------------- phases: the stretches of a motion in which closures act


@dataclass(frozen=True)
class Phase:
    """Samples ``first`` to before ``last``, in which the closures of ``active`` (closures,) act."""

    first: int
    last: int
    active: Mask


@dataclass(frozen=True)
class Stretch:
    """A phase and the constraints of all closures, with the frames [m] that they tie in it."""

    phase: Phase
    rows: Rows

    @property
    def span(self) -> slice:
        """Samples of the phase."""
        return slice(self.phase.first, self.phase.last)


def list_phases(mechanism: Mechanism, time: Array) -> list[Phase]:
    """Return the phases of a grid ``time`` (samples,) [s], uniform at its start; a closure acts from its start to before its end.
    Raises InputError when a closure begins or ceases between two samples.
    """
    step = float(time[1] - time[0]) if len(time) > 1 else 1.0
    cuts = {0}
    for closure in mechanism.closures:
        for instant in (t for interval in closure.active for t in interval if time[0] < t < time[-1]):
            sample = int(np.abs(time - instant).argmin())
            if abs(time[sample] - instant) > SAME_INSTANT * step:
                raise InputError(
                    f"mechanism '{mechanism.name}', closure '{closure.name}': it switches at {instant:g} s, between two samples "
                    f"({step:g} s apart); write step = {(instant - time[0]) / max(1, sample):.10g} or another that meets it"
                )
            cuts.add(sample)
    bounds = [*sorted(cuts), len(time)]
    slack = SAME_INSTANT * step
    return [
        Phase(first, last, find_acting_closures(mechanism, float(time[first]) + slack))
        for first, last in pairwise(bounds)
    ]


def find_acting_closures(mechanism: Mechanism, time: float) -> Mask:
    """Return a mask (closures,) of the closures that act at ``time`` [s]."""
    acts = [not c.active or any(start <= time < end for start, end in c.active) for c in mechanism.closures]
    return np.array(acts, dtype=bool)
