"""Quantities of which an accuracy is asked: efforts of drives, tips and free coordinates, each in parts of its range."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flexinv.analysis.evaluation import FirstStep, second_step, with_drives
from flexinv.kinematics.mesh import Mesh
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

# A range below this part of the largest of its unit (of the mechanism's length, of a radian) is taken to be that part: nobody
# asks for digits of what hardly moves.
SMALLEST = 1e-3


class Quantities(NamedTuple):
    """Efforts (samples, drives) [N m], [N], tips (samples, links, 3) [m], free coordinates (samples, n) [rad], [m], [-]."""

    torque: Array
    tip: Array
    free: Array

    def rows(self, every: int) -> Quantities:
        """Return every ``every``-th sample [-]."""
        return Quantities(*(part[::every] for part in self))


@dataclass(frozen=True)
class Ranges:
    """Ranges over time, of efforts [N m], [N], tips [m] and free coordinates [rad], [m], [-]; none below `SMALLEST`."""

    torque: Array
    tip: Array
    free: Array

    def errors(self, difference: Quantities) -> Array:
        """Return differences (samples, quantities) in parts of the ranges [-]: efforts, tips, free coordinates side by side."""
        tip = np.linalg.norm(difference.tip, axis=2)
        parts = (np.abs(difference.torque) / self.torque, tip / self.tip, np.abs(difference.free) / self.free)
        return np.hstack(parts)


def quantities(mesh: Mesh, first: FirstStep, free: Array) -> Quantities:
    """Return the results of the second step [N m], [N], [m] and free coordinates; free : (nq,) mask of these [-]."""
    found = second_step(mesh, first)
    tau = with_drives(mesh.mechanism, first, found.tau, found.reaction)[0]
    if first.geared is not None:
        tau = tau - first.geared
    return Quantities(tau[:, mesh.mechanism.actuated], np.swapaxes(found.tip, 0, 1), first.joints[0][:, free])


def free_coordinates(mechanism: Mechanism, passive: set[str]) -> Array:
    """Return a mask (nq,) [-] of the coordinates of joints without a motion."""
    out = np.zeros(mechanism.nq, dtype=bool)
    for name in passive:
        out[mechanism.q_slices[name]] = True
    return out


def ranges(mesh: Mesh, known: Quantities) -> Ranges:
    """Return the ranges of quantities over time [N m], [N], [m], [rad]."""
    m = mesh.mechanism
    force = np.array([f for joint in m.joints for f in KINDS[joint.kind].translations], dtype=bool)[m.actuated]
    torque = np.ptp(known.torque, axis=0)
    peak = np.abs(known.torque).max(axis=0)
    for own in (force, ~force):
        torque[own] = np.maximum(torque[own], SMALLEST * peak[own].max(initial=0.0))
    tip = np.maximum(np.linalg.norm(np.ptp(known.tip, axis=0), axis=1), SMALLEST * mesh.length)
    free = np.maximum(np.ptp(known.free, axis=0), SMALLEST)
    tiny = np.finfo(float).tiny
    return Ranges(np.maximum(torque, tiny), np.maximum(tip, tiny), free)
