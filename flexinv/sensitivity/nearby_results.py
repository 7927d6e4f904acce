"""Derivatives of what follows from the motion of nodes and joints: wrenches, resultants, strains, energies, forces of closures.

The tangents of a march say how nodes, joints and multipliers move with a parameter.  A little further along them, at x + s dx,
forces are evaluated anew and the second step of the scheme is made.  What it gives is a function R of s and of the parameter:

    dR/dp = d/ds R(x + s dx, p) + d/dp R(x, p)

Both are differences, and nothing is marched.  They are apart because places are known to rounding: a change of a parameter may be
small, and the rounding of moves as small, times the stiffness of a beam along its axis, is much of a force.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

import numpy as np

from flexinv.analysis.evaluation import FirstStep, run_second_step
from flexinv.analysis.loops import PhaseHistory, add_reaction_forces
from flexinv.analysis.solution import Solution, compute_root_resultants
from flexinv.constraints.closures import list_phases
from flexinv.dynamics.section_strains import compute_section_strains, split_by_beam
from flexinv.errors import InputError
from flexinv.inverse.inverse_dynamics import NodalForces, compute_applied_forces
from flexinv.inverse.nodal_sums import SecondStepArrays
from flexinv.kernels.so3 import exp_so3
from flexinv.kinematics.nodal_motion import NodalMotion, integrate_configuration
from flexinv.sensitivity.march_states import FreeSystem, build_march_states, sample_forces
from flexinv.sensitivity.parameters import CENTRAL, TWO_SIDED, ParameterVariation
from flexinv.sensitivity.tangent_records import TangentHistories
from flexinv.typing import Array, Triple
from flexinv.validation import check_names, find_nearest_word, shown

ResultTable = Mapping[str, Mapping[str, Array]]  # what -> of which joint, beam, closure or kind -> (samples, ...)

# Order -> the change [m] or [rad] of the largest pose, and the weights of R(k s) over s.  Sections move along straight lines, not
# along arcs: what stretches them, times an axial stiffness, is much of a force.  Order six leaves 1e-15 out and loses two digits,
# order two leaves 1e-7 out and loses three.
ORDERS: Mapping[int, tuple[float, Mapping[int, float]]] = {6: (3e-3, CENTRAL), 2: (3e-4, TWO_SIDED)}


def check_results(of: Collection[str], order: int) -> tuple[str, ...]:
    """Return the names of results that are differentiated [-]; raises InputError for one that is none, and another order."""
    if order not in ORDERS:
        raise InputError(f"order = {shown(order)}: expected one of {', '.join(map(str, ORDERS))}")
    names = tuple(check_names("of", of, "results, for example ['wrench']"))
    for name in names:
        if name not in COLLECTED:
            like = find_nearest_word(name, COLLECTED)
            hint = f"; write {like!r}" if like else ""
            raise InputError(f"of: {name!r}: expected one of {', '.join(COLLECTED)}{hint}")
    return names


class NearbyResults:
    """Results beside a solution, along the tangents of its march.

    system : all joints are unknowns; tangents : with rates, accelerations and multipliers
    multiplier : (samples, rows) of the solution's closures [N], [N m]; of : names of results; order : of differences along x
    """

    def __init__(
        self, system: FreeSystem, solution: Solution, tangents: TangentHistories, multiplier: Array, of: Sequence[str],
        order: int,
    ) -> None:  # fmt: skip
        """Record what is moved."""
        self.system = system
        self.solution = solution
        self.tangents = tangents
        self.multiplier = multiplier
        self.of = of
        self.change, self.weights = ORDERS[order]

    def differentiate(
        self, variations: Sequence[ParameterVariation], beside: Mapping[int, Sequence[FreeSystem]]
    ) -> dict[str, dict[str, Array]]:
        """Return the derivatives (samples, ..., parameters) of the results by parameters [any unit].

        beside : of the parameters that change the mechanism the systems at their setups
        Raises ConvergenceError where an element turns too much.
        """
        columns = []
        for k, variation in enumerate(variations):
            moves = [(change, weight, self.system) for change, weight in self._list_moves(k)]
            for weight, system in zip(variation.weights, beside.get(k, ()), strict=False):
                moves.append((0.0, weight, system))
            columns.append(self._join_moved(k, moves))
        return {
            name: {key: np.stack([column[name][key] for column in columns], axis=-1) for key in columns[0][name]}
            for name in self.of
        }

    def _list_moves(self, k: int) -> Iterator[tuple[float, float]]:
        """Changes of a parameter along x, and the weights of what is found there; changes of 1 where nothing moves."""
        largest = float(np.abs(self.tangents.pose[..., k]).max())
        step = self.change / largest if largest > 0.0 else 1.0
        for place, weight in self.weights.items():
            yield place * step, weight / step

    def _join_moved(self, k: int, moves: Sequence[tuple[float, float, FreeSystem]]) -> dict[str, dict[str, Array]]:
        """The sum of results at changes of a parameter, each times its weight."""
        out: dict[str, dict[str, Array]] = {}
        for change, weight, system in moves:
            found = self._collect_moved(k, change, system)
            for name, parts in found.items():
                table = out.setdefault(name, {})
                for key, value in parts.items():
                    table[key] = table[key] + weight * value if key in table else weight * value
        return out

    def _collect_moved(self, k: int, change: float, system: FreeSystem) -> ResultTable:
        """The results where parameter k is another by a change, with the mechanism of a system."""
        joints = self._move_joints(k, change)
        states = build_march_states(system, self._move_sections(k, change), joints, self.solution.time)
        states = states._replace(multiplier=self.multiplier + change * self.tangents.multiplier[..., k])
        record = sample_forces(system, states, trajectory=True)
        closed = states.multiplier[:, : system.constraints]
        trajectory = record.trajectory._replace(multipliers=np.ascontiguousarray(closed))
        time = self.solution.time
        mesh = system.mesh
        first = FirstStep(trajectory, time, joints, compute_applied_forces(mesh, trajectory.motion, time))
        if mesh.mechanism.closures:
            phase = list_phases(mesh.mechanism, time)[0]
            first = add_reaction_forces(mesh, first, PhaseHistory(mesh, phase, None))
        found = run_second_step(mesh, first)
        return {name: COLLECTED[name](system, first, found) for name in self.of}

    def _move_joints(self, k: int, change: float) -> Triple:
        """Coordinates of all joints, rates and accelerations along the tangents."""
        solution = self.solution
        unknown = self.system.unknown
        pose, rate, acceleration = (
            change * part[:, unknown, k]
            for part in (self.tangents.pose, self.tangents.rate, self.tangents.acceleration)
        )
        mechanism = self.system.mesh.mechanism
        if mechanism.nq == mechanism.nv:
            moved = solution.q + pose
        else:
            steps = zip(solution.q, pose, strict=True)
            moved = np.stack([integrate_configuration(mechanism, q, step) for q, step in steps])
        return moved, solution.qd + rate, solution.qdd + acceleration

    def _move_sections(self, k: int, change: float) -> NodalMotion:
        """Motion of the sections of beams along the tangents; other nodes are left where they are."""
        nodes = self.solution.nodes
        at = self.system.first[:, None] + np.arange(6)
        pose, rate, acceleration = (
            change * part[:, at, k] for part in (self.tangents.pose, self.tangents.rate, self.tangents.acceleration)
        )
        moved = NodalMotion(*(part.copy() for part in nodes.parts))
        s = self.system.sections
        moved.x[:, s] += pose[..., :3]
        moved.rotation[:, s] = moved.rotation[:, s] @ exp_so3(pose[..., 3:])
        for part, change_of_part in (
            (moved.v, rate[..., :3]),
            (moved.omega, rate[..., 3:]),
            (moved.a, acceleration[..., :3]),
            (moved.alpha, acceleration[..., 3:]),
        ):
            part[:, s] += change_of_part
        return moved


def _collect_wrenches(system: FreeSystem, first: FirstStep, found: SecondStepArrays) -> Mapping[str, Array]:
    """Joint -> (samples, 6) force [N] and moment [N m] on the child."""
    return dict(zip(system.mesh.joint_node, found.wrench, strict=True))


def _collect_resultants(system: FreeSystem, first: FirstStep, found: SecondStepArrays) -> Mapping[str, Array]:
    """Beam -> (samples, points, 6) stress resultants [N], [N m]."""
    return split_by_beam(system.mesh, first.trajectory.internal)[0]


def _collect_root_resultants(system: FreeSystem, first: FirstStep, found: SecondStepArrays) -> Mapping[str, Array]:
    """Beam -> (samples, 6) stress resultants at its root [N], [N m]."""
    mesh = system.mesh
    forces = NodalForces(found.force, found.moment)
    motion = first.trajectory.motion
    return {link.name: compute_root_resultants(mesh, link, motion, forces) for link in mesh.mechanism.beams}


def _collect_strains(system: FreeSystem, first: FirstStep, found: SecondStepArrays) -> Mapping[str, Array]:
    """Beam -> (samples, points, 6) strains [-], [1/m]."""
    return compute_section_strains(system.mesh, first.trajectory.motion)


def _collect_deflections(system: FreeSystem, first: FirstStep, found: SecondStepArrays) -> Mapping[str, Array]:
    """Beam -> (samples, 3) of its tip [m]."""
    names = (link.name for link in system.mesh.mechanism.beams)
    return dict(zip(names, found.deflection, strict=True))


def _collect_energies(system: FreeSystem, first: FirstStep, found: SecondStepArrays) -> Mapping[str, Array]:
    """Kind of energy -> (samples,) [J]."""
    return {"kinetic": found.kinetic, "potential": found.potential, "elastic": first.trajectory.energy[:, 0]}


def _collect_reactions(system: FreeSystem, first: FirstStep, found: SecondStepArrays) -> Mapping[str, Array]:
    """Closure -> (samples, 6) force [N] and moment [N m]."""
    return {} if first.loops is None else first.loops.reaction


COLLECTED: dict[str, Callable[[FreeSystem, FirstStep, SecondStepArrays], Mapping[str, Array]]] = {
    "wrench": _collect_wrenches,
    "internal": _collect_resultants,
    "root": _collect_root_resultants,
    "strain": _collect_strains,
    "deflection": _collect_deflections,
    "energy": _collect_energies,
    "reaction": _collect_reactions,
}
