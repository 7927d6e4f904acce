"""Results of a solution that a limit holds: forces and moments in joints, strains of fibres, distances of tips from a path.

Each is a list of numbers over their limit, whose size is at most 1, with its slopes by the variables of a motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexinv.analysis.solution import Solution
from flexinv.dynamics.section_strains import list_section_points
from flexinv.optimal_motion.motion_limits import MotionLimits, StrainLimit
from flexinv.sensitivity.sensitivities import Sensitivities
from flexinv.typing import Array

LOADS = {"force": slice(0, 3), "moment": slice(3, 6)}  # of a joint's wrench
PATH_PLACES = 401  # of a tip along the given motion


@dataclass(frozen=True)
class LimitedLoad:
    """Size of the force or the moment that a joint carries [N], [N m]."""

    kind: str
    name: str

    result = "wrench"

    def compute_values(self, solution: Solution) -> Array:
        """Return the size at every sample (samples,) [N], [N m]."""
        return np.asarray(np.linalg.norm(solution.wrench[self.name][:, LOADS[self.kind]], axis=1))

    def compute_slopes(self, found: Sensitivities) -> Array:
        """Return the derivatives of the size (samples, parameters) [N], [N m] per unit."""
        load = found.solution.wrench[self.name][:, LOADS[self.kind]]
        slopes = found.results["wrench"][self.name][:, LOADS[self.kind]]
        size = np.maximum(np.linalg.norm(load, axis=1), np.finfo(float).tiny)
        return np.asarray(np.einsum("si,sip->sp", load / size[:, None], slopes))


@dataclass(frozen=True)
class LimitedStrain:
    """Strain along the axis of the outermost fibres of a beam, epsilon + z kappa_y - y kappa_z [-], at y, z of both signs.

    root : (points of the first element,) shares of its strains in those at the root, where a clamped beam bends most
    """

    name: str
    limit: StrainLimit
    root: tuple[float, ...] = ()

    kind = "strain"
    result = "strain"

    def compute_values(self, solution: Solution) -> Array:
        """Return the strains of four fibres at every sample, at the root and all stations (samples points 4,) [-]."""
        return np.asarray((self._add_root(solution.strain[self.name]) @ self._build_fibres()).ravel())

    def compute_slopes(self, found: Sensitivities) -> Array:
        """Return their derivatives (samples points 4, parameters) [-] per unit."""
        strains = self._add_root(found.results["strain"][self.name])
        slopes = np.einsum("sgip,if->sgfp", strains, self._build_fibres())
        return np.asarray(slopes.reshape(-1, slopes.shape[-1]))

    def _add_root(self, strain: Array) -> Array:
        """The strains (samples, points, ...) with those at the root before them."""
        if not self.root:
            return strain
        at_root = np.tensordot(self.root, strain[:, : len(self.root)], axes=([0], [1]))
        return np.concatenate([at_root[:, None], strain], axis=1)

    def _build_fibres(self) -> Array:
        """Shares (6, 4) of a section's strains in those of its fibres."""
        out = np.zeros((6, 4))
        out[0] = 1.0
        for column, (y, z) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1))):
            out[4, column] = z * self.limit.z
            out[5, column] = -y * self.limit.y
        return out


@dataclass(frozen=True)
class LimitedPath:
    """Distance of a link's tip from the path (places, 3) that it takes in the given motion [m]."""

    name: str
    path: Array

    kind = "path"
    result = None

    def compute_values(self, solution: Solution) -> Array:
        """Return the distance at every sample (samples,) [m]."""
        return np.asarray(np.linalg.norm(self._find_offsets(solution.tip[self.name]), axis=1))

    def compute_slopes(self, found: Sensitivities) -> Array:
        """Return the derivatives of the distance (samples, parameters) [m] per unit."""
        offset = self._find_offsets(found.solution.tip[self.name])
        size = np.maximum(np.linalg.norm(offset, axis=1), np.finfo(float).tiny)
        return np.asarray(np.einsum("si,sip->sp", offset / size[:, None], found.tip[self.name]))

    def _find_offsets(self, tip: Array) -> Array:
        """Vectors (samples, 3) from the nearest point of the path to the tip."""
        first = self.path[:-1]
        along = np.diff(self.path, axis=0)
        square = np.maximum((along**2).sum(axis=1), np.finfo(float).tiny)
        part = np.einsum("sci,ci->sc", tip[:, None] - first, along) / square
        offset = tip[:, None] - first - np.clip(part, 0.0, 1.0)[..., None] * along
        nearest = (offset**2).sum(axis=2).argmin(axis=1)
        return np.asarray(offset[np.arange(len(tip)), nearest])


LimitedResult = LimitedLoad | LimitedStrain | LimitedPath


def list_limited_results(limits: MotionLimits, given: Solution) -> tuple[LimitedResult, ...]:
    """Return the results that have a limit [N], [N m], [-], [m]; given : the solution of the given motion."""
    out: list[LimitedResult] = [LimitedLoad(kind, joint) for kind in LOADS for joint in getattr(limits, kind)]
    shares = _list_root_shares(given)
    out += [LimitedStrain(beam, limit, shares[beam]) for beam, limit in limits.strain.items()]
    rows = np.unique(np.linspace(0, len(given.time) - 1, PATH_PLACES).round().astype(int))
    out += [LimitedPath(link, given.tip[link][rows]) for link in limits.path]
    return tuple(out)


def _list_root_shares(given: Solution) -> dict[str, tuple[float, ...]]:
    """Of each beam the shares by which the polynomial through the first element's strains goes on to the root [-]."""
    out = {}
    for name, _, order, station in list_section_points(given.mesh):
        places = station[: order[0]]
        others = [np.delete(places, k) for k in range(len(places))]
        shares = (np.prod(rest / (rest - place)) for place, rest in zip(places, others, strict=True))
        out[name] = tuple(float(share) for share in shares)
    return out


def list_needed_results(limited: Sequence[LimitedResult]) -> list[str]:
    """Return the names of the results of which derivatives are needed [-], as `differentiate` takes them."""
    return sorted({one.result for one in limited if one.result is not None})
