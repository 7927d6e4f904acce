"""The paper's second step on the nodes of a mesh: P = M (a - g) at every finite-element node of a meshed link, and their torques.

The march knows a link's point masses; their motion against the link frame tells its amplitudes y, and these move every node:

    r = X + Phi y + y H y / 2        a = a_0 + R (al x r + w x (w x r) + 2 w x r' + r'')        P = M (a - g)

with the mass matrix M of the mesh.  Summed as wrenches P gives the torques of the point masses, to rounding: two ways to one
number.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexinv.errors import ConvergenceError, InputError
from flexinv.inverse.inverse_dynamics import NodalForces, compute_nodal_forces, compute_projected_efforts
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.parts.craig_bampton import Reduction
from flexinv.parts.point_masses import build_point_masses
from flexinv.parts.reductions import find_reduction
from flexinv.typing import Array, Indices

# Samples at which every solution compares both ways: a part of 1e5 nodes takes some milliseconds for each.
COMPARED = 12
# An interface that turns further has left what displacements of second order follow: at this turn a cantilever under a load at
# its tip is off by 1 % of its deflection (tests/flexinv/dynamics/test_meshed_links.py).
MOST_TURNED = 0.15  # [rad]
# Newton's iterations for amplitudes, of which three are enough where deformations are small, and where they stop [-].
MOST_ITERATIONS = 8
AMPLITUDE_ROUNDING = 1e-14


@dataclass(frozen=True)
class PartMotion:
    """The deformation of a meshed link at some samples, in its own frame.

    amplitudes, rates, accelerations : (samples, shapes) [m], [m/s], [m/s^2]; frame : the motion of the link frame, one node
    reduced : of the part; second : (n, 3, soft, soft) H of its nodes, as the point masses have it [1/m]
    """

    amplitudes: Array
    rates: Array
    accelerations: Array
    frame: NodalMotion
    reduced: Reduction
    second: Array

    @property
    def places(self) -> Array:
        """(samples, n, 3) where the mesh's nodes are in the link frame [m]."""
        shapes = _compute_bent_shapes(self.reduced.shapes, 0.5 * self.second, self.amplitudes)
        return np.asarray(self.reduced.points + np.einsum("snik,sk->sni", shapes, self.amplitudes))

    def compute_nodal_forces(self, gravity: Array) -> Array:
        """Return P = M (a - g) of every node of the mesh, (samples, n, 3) [N] along the axes of the link frame."""
        shapes = _compute_bent_shapes(self.reduced.shapes, self.second, self.amplitudes)
        r = self.places
        dr = np.einsum("snik,sk->sni", shapes, self.rates)  # (sample, node, xyz)
        ddr = np.einsum("snik,sk->sni", shapes, self.accelerations) + _compute_squared_rates(self.second, self.rates)
        w = self.frame.omega
        al = self.frame.alpha
        begin = np.einsum("sji,sj->si", self.frame.rotation[:, 0], self.frame.a[:, 0] - gravity)[:, None]
        a = begin + np.cross(al, r) + np.cross(w, np.cross(w, r)) + 2.0 * np.cross(w, dr) + ddr
        nodes = len(self.reduced.points)
        flat = a.transpose(1, 0, 2).reshape(nodes, -1)  # (node, sample xyz)
        return np.asarray((self.reduced.mass @ flat).reshape(nodes, len(r), 3).transpose(1, 0, 2))


def _compute_bent_shapes(shapes: Array, second: Array, amplitudes: Array) -> Array:
    """Shapes (samples, nodes, 3, shapes) as amplitudes (samples, shapes) bend them: Phi + H y."""
    soft = second.shape[3]
    out = np.repeat(shapes[None], len(amplitudes), axis=0)
    out[..., :soft] += np.einsum("nijk,sk->snij", second, amplitudes[:, :soft])
    return out


def _compute_squared_rates(second: Array, rates: Array) -> Array:
    """y' H y' (samples, nodes, 3) [m/s^2]."""
    soft = rates[:, : second.shape[3]]
    return np.asarray(np.einsum("nijk,sj,sk->sni", second, soft, soft, optimize=True))


def compute_part_motion(mesh: Mesh, motion: NodalMotion, link: str) -> PartMotion:
    """Return the deformation of a meshed link [m] from the motion of all nodes.  Raises InputError for a link without a mesh."""
    part = next((one.part for one in mesh.mechanism.meshed if one.name == link), None)
    if part is None:
        known = ", ".join(one.name for one in mesh.mechanism.meshed) or "none"
        raise InputError(f"link {link!r} has no mesh; those with one: {known}")
    number = [one.name for one in mesh.mechanism.meshed].index(link)
    return _find_amplitudes(mesh, motion, _list_meshed(mesh)[number], find_reduction(part))


def _list_meshed(mesh: Mesh) -> list[int]:
    """Numbers of the parts in the order of `Mechanism.meshed`."""
    links = [mesh.mechanism.links[int(k)].name for k in mesh.shapes.link]
    return [links.index(one.name) for one in mesh.mechanism.meshed]


def _find_point_masses(mesh: Mesh, number: int) -> Indices:
    of_parts = mesh.shapes.points
    return of_parts.node[of_parts.first[number] : of_parts.first[number + 1]]


def _find_amplitudes(mesh: Mesh, motion: NodalMotion, number: int, reduced: Reduction) -> PartMotion:
    """Amplitudes and their rates from the point masses' motion against the frame; their shapes have full rank."""
    root = int(mesh.shapes.root[number])
    points = _find_point_masses(mesh, number)
    masses = build_point_masses(reduced)
    back = motion.rotation[:, root].transpose(0, 2, 1)[:, None]
    w = motion.omega[:, root, None]
    al = motion.alpha[:, root, None]

    def convert_to_frame(vector: Array) -> Array:
        return (back @ (vector[:, points] - vector[:, root, None])[..., None])[..., 0]

    p = convert_to_frame(motion.x)
    dp = convert_to_frame(motion.v) - np.cross(w, p)
    ddp = convert_to_frame(motion.a) - np.cross(al, p) - np.cross(w, np.cross(w, p)) - 2.0 * np.cross(w, dp)
    amplitudes = _solve_amplitudes(masses.shapes, masses.second, p - masses.place)
    slopes = _compute_bent_shapes(masses.shapes, masses.second, amplitudes)
    inverse = np.linalg.pinv(slopes.reshape(len(p), -1, amplitudes.shape[1]))
    rates = (inverse @ dp.reshape(len(p), -1, 1))[..., 0]
    accelerations = (inverse @ (ddp - _compute_squared_rates(masses.second, rates)).reshape(len(p), -1, 1))[..., 0]
    frame = NodalMotion(*(part[:, root : root + 1] for part in motion.parts))
    return PartMotion(amplitudes, rates, accelerations, frame, reduced, masses.nodal)


def _solve_amplitudes(shape: Array, second: Array, moved: Array) -> Array:
    """Amplitudes (samples, shapes) of displacements (samples, points, 3) = Phi y + y H y / 2 [m], by Newton's method."""
    count = shape.shape[2]
    found = np.zeros((len(moved), count))
    for _ in range(MOST_ITERATIONS):
        half = _compute_bent_shapes(shape, 0.5 * second, found)
        left = moved - np.einsum("spik,sk->spi", half, found)
        slope = _compute_bent_shapes(shape, second, found).reshape(len(moved), -1, count)
        step = (np.linalg.pinv(slope) @ left.reshape(len(moved), -1, 1))[..., 0]
        found = found + step
        if np.abs(step).max(initial=0.0) <= AMPLITUDE_ROUNDING * np.abs(found).max(initial=0.0):
            break
    return found


def compare_torques(mesh: Mesh, motion: NodalMotion, time: Array) -> Array:
    """Return torques by P of all nodes of all meshes less those of the point masses, (samples compared, nv) [N m], [N].

    Of many samples `COMPARED` are looked at, evenly spaced; without meshed links none.
    Raises ConvergenceError where a mesh deforms too far at one of the times [s] (`MOST_TURNED`).
    """
    if not mesh.mechanism.meshed:
        return np.empty((0, mesh.mechanism.nv))
    _check_turns(mesh, motion, time)
    picked = np.unique(np.linspace(0, len(motion.x) - 1, min(COMPARED, len(motion.x))).astype(np.int64))
    some = NodalMotion(*(part[picked] for part in motion.parts))
    whole = compute_nodal_forces(mesh, some)
    gap = NodalForces(np.zeros_like(whole.force), np.zeros_like(whole.force))
    gravity = np.asarray(mesh.mechanism.gravity)
    for number, link in zip(_list_meshed(mesh), mesh.mechanism.meshed, strict=True):
        assert link.part is not None
        moved = _find_amplitudes(mesh, some, number, find_reduction(link.part))
        force = moved.compute_nodal_forces(gravity)
        points = _find_point_masses(mesh, number)
        root = int(mesh.shapes.root[number])
        turn = some.rotation[:, root]
        arm = some.x[:, points] - some.x[:, root, None]
        gap.force[:, root] += np.einsum("sij,sj->si", turn, force.sum(axis=1)) - whole.force[:, points].sum(axis=1)
        moment = np.cross(moved.places, force).sum(axis=1)
        gap.moment[:, root] += np.einsum("sij,sj->si", turn, moment) - np.cross(arm, whole.force[:, points]).sum(axis=1)
    return compute_projected_efforts(mesh, some, gap)


def _check_turns(mesh: Mesh, motion: NodalMotion, time: Array) -> None:
    """Raise ConvergenceError where an interface turns too far against its link frame."""
    for (name, interface), node in mesh.interface_node.items():
        part = int(mesh.shapes.part[node])
        if part < 0:
            continue
        root = int(mesh.shapes.root[part])
        across = np.einsum("sji,sjk->sik", motion.rotation[:, root], motion.rotation[:, node])
        turn = np.arccos(np.clip((np.trace(across, axis1=1, axis2=2) - 1.0) / 2.0, -1.0, 1.0))
        worst = int(turn.argmax())
        if turn[worst] > MOST_TURNED:
            raise ConvergenceError(
                f"mechanism '{mesh.mechanism.name}', link '{name}', at t = {time[worst]:g} s: interface '{interface}' turns by "
                f"{turn[worst]:.2g} rad against the link frame, more than {MOST_TURNED:g} rad, which shapes of a mesh do not "
                "follow; divide the part into several links that fixed joints tie, or check forces, units and E_Pa"
            )
