"""Residual vibration: what a mechanism goes on swinging by after its joints have stopped, in closed form of its modes.

With the joints held at their last places, small motions about the rest position there are sums of modes phi_i of modal mass 1
(`linearized.modes`).  From the state at the end, displacements d and velocities v of the nodes against the rest position,

    y(t) = sum_i phi_i (a_i cos(w_i t) + b_i sin(w_i t)),     a_i = sum_n phi_i . M_n d,     b_i = sum_n phi_i . M_n v / w_i

    E = sum_i w_i^2 (a_i^2 + b_i^2) / 2,     reach of a tip = max over unit vectors u of sum_i |(u . phi_i a_i, u . phi_i b_i)|

Frequencies without a common measure bring all modes to their largest in one direction at some time; damping makes them less from
the end on, and the reach a bound.  Large residual motions are no sums of modes: ``left_out`` says how much of the state is none.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexinv.errors import InputError
from flexinv.kernels.so3 import log_so3
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.linearized.modes import Modes, compute_modes
from flexinv.linearized.rest_position import compute_tip_displacements
from flexinv.model.by_value import ByValue
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

if TYPE_CHECKING:
    import pandas as pd

STOPPED = 1e-6  # of its largest rate: a joint that moves by less has come to rest
ARROWS = 6  # arrows from which the largest reach is looked for
RISES = 50  # of the climb to the largest reach, which gains less than a rounding before


@dataclass(frozen=True, eq=False, repr=False)
class ResidualVibration(ByValue):
    """Vibration after the end of a motion, about the rest position with the joints held at their last places.

    modes : of that position; cosine, sine : (modes,) a_i, b_i [m kg^0.5]; reach : link -> largest distance of its tip from its
    rest place from then on [m]; left_out : part of the state at the end that is no small motion [-]
    """

    modes: Modes
    cosine: Array
    sine: Array
    reach: dict[str, float]
    left_out: float

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
    mesh: Mesh, q: Array, qd: Array, free: tuple[str, ...], motion: NodalMotion
) -> ResidualVibration:
    """Return the vibration from the last sample of a nodal motion on [m], [J], joints held at q (nq,) but for the free ones.

    qd : (samples, nv) rates of the joints [rad/s], [m/s], of which the last have to be at rest
    Raises InputError where no link bends, a joint that is held still moves, closures switch, a mode is unstable, or a free joint
    carries a rotor, whose part no node has; ConvergenceError where there is no rest position.
    """
    _check_end_of_motion(mesh.mechanism, free, qd)
    name = mesh.mechanism.name
    turning = next((joint for joint in free if mesh.mechanism.joint_of[joint].rotor_inertia), None)
    if turning is not None:
        raise InputError(
            f"residual vibration of '{name}': joint '{turning}' is free and has a rotor; expected rotors on joints with a drive"
        )
    modes = compute_modes(mesh, q, free, None)
    unstable = next((word for word in modes.stability if word != "stable"), None)
    if unstable is not None:
        raise InputError(
            f"residual vibration of '{name}': {unstable} at the end of the motion; expected a rest position that is stable with "
            "all other joints held"
        )
    displacement = motion.x[-1] - modes.position
    turn = log_so3(np.swapaxes(modes.orientation, 1, 2) @ motion.rotation[-1])
    cosine = _compute_projection(modes, displacement, turn)
    sine = _compute_projection(modes, motion.v[-1], motion.omega[-1]) / np.sqrt(modes.squared.real)
    left = displacement - np.tensordot(cosine, modes.displacement.real, 1)
    size, left_size = (float(np.sqrt(np.sum(mesh.mass[:, None] * part**2))) for part in (displacement, left))
    moves = np.concatenate([modes.displacement, modes.rotation], axis=-1).real
    shapes = compute_tip_displacements(mesh, moves, modes.orientation)
    reach = {link: _find_reach(shape, cosine, sine) for link, shape in shapes.items()}
    return ResidualVibration(modes, cosine, sine, reach, left_size / size if size else 0.0)


def _check_end_of_motion(mechanism: Mechanism, free: Collection[str], qd: Array) -> None:
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
        rate = np.abs(qd[:, columns]).max(axis=1, initial=0.0)
        if joint.name not in free and rate[-1] > STOPPED * rate.max(initial=0.0):
            raise InputError(
                f"{what}: joint '{joint.name}' still moves by {rate[-1]:.3g} rad/s or m/s at the last sample; expected a motion "
                "that has come to rest there; solve to its end, and write hold = one step where it ends between two samples"
            )


def _compute_projection(modes: Modes, displacement: Array, turn: Array) -> Array:
    """(modes,) sum_n phi . M_n of a field: displacement (nodes, 3) [m] world, turn (nodes, 3) [rad] own frame, or rates."""
    mesh = modes.mesh
    momentum = mesh.mass[:, None] * displacement
    spin = np.einsum("nij,nj->ni", mesh.inertia, turn)
    pushed = np.einsum("mni,ni->m", modes.displacement.real, momentum)
    return np.asarray(pushed + np.einsum("mni,ni->m", modes.rotation.real, spin))


def _find_reach(shape: Array, cosine: Array, sine: Array) -> float:
    """The largest distance [m] of a tip with the shapes (modes, 3) from its rest place, all modes at their largest for it.

    The sum of what the modes give along a direction is convex: from the longest of their arrows it climbs to its largest.
    """
    arrows = np.stack([shape * cosine[:, None], shape * sine[:, None]], axis=1)  # (modes, 2, xyz)
    longest = np.argsort(np.linalg.norm(arrows.reshape(-1, 3), axis=1))[::-1][:ARROWS]
    return max((_find_highest(arrows, arrows.reshape(-1, 3)[k]) for k in longest), default=0.0)


def _find_highest(arrows: Array, start: Array) -> float:
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
