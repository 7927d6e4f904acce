"""Residual vibration: what a mechanism goes on swinging by after its joints have stopped, in closed form of its modes.

With the joints held at their last places, small motions about the rest position there are sums of modes phi_i of modal mass 1
(`linearized.modes`), d_i = phi_i . D phi_i their damping.  From velocities v and accelerations a of the nodes at the end,

    y(t) = sum_i phi_i (a_i cos(w_i t) + b_i sin(w_i t)),     w_i b_i = sum_n phi_i . M_n v,
    w_i^2 a_i = - sum_n phi_i . M_n a - d_i w_i b_i

    E = sum_i w_i^2 (a_i^2 + b_i^2) / 2,     reach of a tip = max over unit vectors u of sum_i |(u . phi_i a_i, u . phi_i b_i)|

Displacements would give a_i, too, but a beam that bends far comes nearer to its root without strain, which its axial modes would
take for one.  Frequencies without a common measure bring all modes to their largest in one direction at some time; damping makes
them less from the end on, and the reach a bound.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexinv.constraints.loop_starts import find_closed_at
from flexinv.errors import InputError
from flexinv.kinematics.mesh import Mesh, list_tips
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.linearized.modes import Modes, compute_modes
from flexinv.linearized.rest_position import compute_tip_displacements
from flexinv.model.by_value import ByValue
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array, Triple

if TYPE_CHECKING:
    import pandas as pd

STOPPED = 1e-6  # of its largest rate: a joint that moves by less has come to rest
ARROWS = 6  # arrows from which the largest reach is looked for
RISES = 50  # of the climb to the largest reach, which gains less than a rounding before


@dataclass(frozen=True, eq=False, repr=False)
class ResidualVibration(ByValue):
    """Vibration after the end of a motion, about the rest position with the joints held at their last places.

    modes : of that position; cosine, sine : (modes,) a_i, b_i [m kg^0.5]; reach : link -> largest distance of its tip from its
    rest place from then on [m], in loops, whose pins hold the tips, of any section of a beam
    missed : by how much the sum of modes misses the tips at the end, of their reach [-]: of the
    order of the angles by which beams bend, and a measure of what is no small motion
    """

    modes: Modes
    cosine: Array
    sine: Array
    reach: dict[str, float]
    missed: float

    @property
    def energy_by_mode(self) -> Array:
        """(modes,) kinetic and elastic energy [J] of each mode."""
        return 0.5 * self.modes.squared.real * (self.cosine**2 + self.sine**2)

    @property
    def energy(self) -> float:
        """Energy of the vibration [J]: the largest elastic energy above that at rest where all modes meet."""
        return float(self.energy_by_mode.sum())

    def frame(self) -> pd.DataFrame:
        """Return frequency [Hz], damping ratio [-] and energy [J] of each mode as a table."""
        import pandas

        columns = {
            "frequency [Hz]": self.modes.frequency,
            "ratio [-]": self.modes.ratio,
            "energy [J]": self.energy_by_mode,
        }
        return pandas.DataFrame(columns, index=pandas.RangeIndex(1, len(self.cosine) + 1, name="mode"))

    def __repr__(self) -> str:
        """Return energy [J] and reach [m] in a line."""
        reach = ", ".join(f"{link} {size:.4g} m" for link, size in self.reach.items())
        return f"ResidualVibration({self.energy:.4g} J; {reach})"


def compute_residual_vibration(
    mesh: Mesh, joints: Triple, free: tuple[str, ...], motion: NodalMotion, tips: dict[str, Array]
) -> ResidualVibration:
    """Return the vibration from the last sample of a nodal motion on [m], [J], joints held but for the free ones.

    joints : q (samples, nq), qd, qdd (samples, nv) [rad or m, s], at rest in the last sample; tips : link -> (samples, 3) [m]
    Raises InputError where no link bends, a joint that is held still moves, closures switch, a mode is unstable, or a free joint
    carries a rotor, whose part no node has; ConvergenceError where there is no rest position.
    """
    q, qd, qdd = joints
    _check_end_of_motion(mesh.mechanism, free, qd, qdd)
    name = mesh.mechanism.name
    turning = next((joint for joint in free if mesh.mechanism.joint_of[joint].rotor_inertia), None)
    if turning is not None:
        raise InputError(
            f"residual vibration of '{name}': joint '{turning}' is free and has a rotor; expected rotors on joints with a drive"
        )
    # of a loop whose beams are bent: from where it closes undeformed the rest position is found again
    begin = find_closed_at(mesh, q[-1]) if mesh.mechanism.closures else q[-1]
    modes = compute_modes(mesh, begin, free, None)
    unstable = next((word for word in modes.stability if word != "stable"), None)
    if unstable is not None:
        raise InputError(
            f"residual vibration of '{name}': {unstable} at the end of the motion; expected a rest position that is stable with "
            "all other joints held"
        )
    cosine, sine = (part[-1] for part in compute_amplitudes(modes, motion.take_samples(slice(-1, None))))
    shapes = compute_tip_displacements(
        mesh, np.concatenate([modes.displacement, modes.rotation], axis=-1).real, modes.orientation
    )
    reach = {link: _find_reach(shape, cosine, sine) for link, shape in shapes.items()}
    rest = compute_rest_places(modes)
    missed = max(float(np.linalg.norm(tips[link][-1] - rest[link] - cosine @ shape)) for link, shape in shapes.items())
    largest = max(reach.values())
    if mesh.mechanism.closures:
        reach |= {
            link.name: _find_largest_reach(modes.displacement[:, mesh.section_nodes[link.name]].real, cosine, sine)
            for link in mesh.mechanism.beams
        }
    return ResidualVibration(modes, cosine, sine, reach, missed / largest if largest else 0.0)


def compute_reach_by_mode(vibration: ResidualVibration) -> Array:
    """Return by how much each mode with an amplitude of 1 m kg^0.5 moves each link's tip (tips, modes) [m].

    In loops there are rows of the sections of all beams as well.
    """
    modes = vibration.modes
    mesh = modes.mesh
    motions = np.concatenate([modes.displacement, modes.rotation], axis=-1).real
    shapes = list(compute_tip_displacements(mesh, motions, modes.orientation).values())
    if mesh.mechanism.closures:
        nodes = [n for link in mesh.mechanism.beams for n in mesh.section_nodes[link.name]]
        shapes += [modes.displacement[:, n].real for n in nodes]
    return np.stack([np.linalg.norm(shape, axis=1) for shape in shapes])


def compute_rest_places(modes: Modes) -> dict[str, Array]:
    """Return link -> place of its tip (3,) [m] in the position of the modes."""
    return {name: modes.position[node] + modes.orientation[node] @ tip for name, node, tip in list_tips(modes.mesh)}


def _check_end_of_motion(mechanism: Mechanism, free: Collection[str], qd: Array, qdd: Array) -> None:
    """Raise InputError unless beams can swing at the end of rates qd (samples, nv) [rad/s], [m/s], with other joints at rest."""
    what = f"residual vibration of '{mechanism.name}'"
    if mechanism.is_rigid:
        raise InputError(f"{what}: no link is a beam, and nothing goes on swinging")
    if any(closure.active for closure in mechanism.closures):
        raise InputError(f"{what}: its closures switch; expected closures that act all along")
    for name in free:
        if name not in mechanism.joint_of:
            raise InputError(f"{what}: free joint {name!r}; expected names of {', '.join(mechanism.joint_of)}")
    for joint in mechanism.joints:
        columns = mechanism.v_slices[joint.name]
        for word, values in (("moves", qd[:, columns]), ("accelerates", qdd[:, columns])):
            size = np.abs(values).max(axis=1, initial=0.0)
            if joint.name not in free and size[-1] > STOPPED * size.max(initial=0.0):
                raise InputError(
                    f"{what}: joint '{joint.name}' still {word} by {size[-1]:.3g} rad or m at the last sample; expected one that "
                    "has come to rest there; solve to its end, and write hold = one step for a last sample behind it"
                )


def compute_amplitudes(modes: Modes, motion: NodalMotion) -> tuple[Array, Array]:
    """Return a_i and b_i (samples, modes) [m kg^0.5], with which stable modes would swing on from each sample.

    motion : of all nodes [m, rad, s]; a_i and b_i are linear in its rates and accelerations, whose derivatives give theirs.
    """
    squared = modes.squared.real
    rate = _compute_projection(modes, motion.v, motion.omega)
    acceleration = _compute_projection(modes, motion.a, motion.alpha)
    return -(acceleration + modes.friction * rate) / squared, rate / np.sqrt(squared)


def _compute_projection(modes: Modes, velocity: Array, spin: Array) -> Array:
    """(samples, modes) sum_n phi . M_n of rates or accelerations (samples, nodes, 3): world [m/s], own frame [rad/s]."""
    mesh = modes.mesh
    momentum = mesh.mass[:, None] * velocity
    turning = np.einsum("nij,snj->sni", mesh.inertia, spin)
    pushed = np.einsum("mni,sni->sm", modes.displacement.real, momentum)
    return np.asarray(pushed + np.einsum("mni,sni->sm", modes.rotation.real, turning))


def _find_largest_reach(shapes: Array, cosine: Array, sine: Array) -> float:
    """The largest of the distances [m] of some nodes with the shapes (modes, nodes, 3), which none passes by all its arrows."""
    bounds = np.hypot(cosine, sine) @ np.linalg.norm(shapes, axis=2)
    largest = 0.0
    for n in np.argsort(bounds)[::-1]:
        if bounds[n] <= largest:
            break
        largest = max(largest, _find_reach(shapes[:, n], cosine, sine))
    return largest


def _find_reach(shape: Array, cosine: Array, sine: Array) -> float:
    """The largest distance [m] of a tip with the shapes (modes, 3) from its rest place, all modes at their largest for it.

    The sum of what the modes give along a direction is convex: from the longest of their arrows it climbs to its largest.
    """
    arrows = np.stack([shape * cosine[:, None], shape * sine[:, None]], axis=1)  # (modes, 2, xyz)
    longest = np.argsort(np.linalg.norm(arrows.reshape(-1, 3), axis=1))[::-1][:ARROWS]
    return max((_find_largest_sum(arrows, arrows.reshape(-1, 3)[k]) for k in longest), default=0.0)


def _find_largest_sum(arrows: Array, start: Array) -> float:
    """The largest sum [m] of arrows (modes, 2, 3) turned to their largest, from the direction of ``start`` on."""
    reached = start
    for _ in range(RISES):
        size = np.linalg.norm(reached)
        if not size:
            return 0.0
        along = arrows @ (reached / size)  # (modes, 2)
        length = np.linalg.norm(along, axis=1, keepdims=True)
        phase = np.divide(along, length, out=np.zeros_like(along), where=length > 0.0)
        reached = np.einsum("mk,mki->i", phase, arrows)
    return float(np.linalg.norm(reached))
