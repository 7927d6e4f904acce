"""A start at rest, anywhere: the undeformed mechanism, settled by long steps of the march, and then still.

A step of h from rest, of a scheme that keeps no rates, ends where  f(x + d) = 2 M d / h^2:  for a long h in equilibrium
(`dynamics.initial_state._find_rest_position`).  The kernel of the march makes it, with another scheme.  Where loops are to be
closed, or joints without drives could sink, one long step may pass a rest position by: then many of them follow the equilibrium
from the start, with the driven joints part of the way.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexinv.analysis.controller import FlexibleState
from flexinv.dynamics.generalized_alpha import ACCELERATIONS, build_generalized_alpha
from flexinv.dynamics.stepper import integrate_instants
from flexinv.export.machine_code import KernelCall
from flexinv.kinematics.configuration import fill_world_motion
from flexinv.kinematics.tree import Frames
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.planar.stepper import integrate_planar_motion
from flexinv.typing import Array

# What inertia leaves of the forces of a beam is 2 / (frequency times step)^2, 1e-8 and less; three such steps leave rounding.
SETTLING_STEP = 1e3  # [s]


@dataclass(frozen=True)
class RestStart:
    """Kernels of a start at rest, and the arrays [any unit] and words that its template names.

    still : arrays that are zero at rest; the results of the calls that settle and rest are the last two
    """

    template: str
    calls: list[KernelCall]
    places: Mapping[str, Array]
    texts: Mapping[str, str]
    still: list[NDArray[Any]]


def plan_rest_start(state: FlexibleState, motion: list[Array], prefix: str) -> RestStart:
    """Return the start at rest [m, rad] of a work space.

    motion : q, qd, qdd of the step, which are where the start has its position
    """
    rest = _plan_in_space(state, motion, prefix) if state.flat is None else _plan_in_plane(state, prefix)
    if state.passive or state.mechanism.closures:
        moved = [int(joint.actuated) for joint in state.mechanism.joints for _ in range(joint.nq)]
        texts = {
            "turns_of_joints": "".join(f"{{{first}, {count}}}, " for first, count in _list_turns(state.mechanism)),
            "moved_coordinates": ", ".join(map(str, moved)),
        }
        rest = replace(rest, template="rest_by_path", calls=rest.calls[1:], places={}, texts=texts)
    return rest if state.loads is None else replace(rest, still=[*rest.still, state.loads.wound])


def _plan_in_plane(state: FlexibleState, prefix: str) -> RestStart:
    """The march in a plane begins undeformed by itself, at the coordinates of all nodes."""
    assert state.flat is not None
    system = state.flat.system
    start = np.zeros((state.solver.mesh.size, 3))
    on, _, *rest = state.arguments
    settling = build_generalized_alpha(SETTLING_STEP, 0.0)
    ways = {"begin": (settling, start, False), "settle": (settling, on, False), "rest": (state.scheme, on, True)}
    calls = [
        KernelCall(f"{prefix}_kernel_{name}", integrate_planar_motion, (system, *way, *rest))
        for name, way in ways.items()
    ]
    nodes = ", ".join(map(str, state.flat.model.joints.node))
    places = {"at_start": start, "at_given": state.given}
    return RestStart("rest_in_plane", calls, places, {"joint_nodes": nodes}, _list_rates(system.state))


def _plan_in_space(state: FlexibleState, motion: list[Array], prefix: str) -> RestStart:
    """The march in space goes on from poses of the independent nodes, which are those of exact rigid kinematics."""
    undeformed = Frames(*(np.zeros((1, *part.shape)) for part in state.frames))
    settling = build_generalized_alpha(SETTLING_STEP, 0.0)
    rows = [part[None] for part in motion]
    calls = [
        KernelCall(f"{prefix}_kernel_begin", fill_world_motion, (state.nodes, *rows, state.joints, undeformed)),
        KernelCall(f"{prefix}_kernel_settle", integrate_instants, (state.system, settling, *state.arguments)),
        KernelCall(f"{prefix}_kernel_rest", integrate_instants, (state.system, ACCELERATIONS, *state.arguments)),
    ]
    free = np.flatnonzero(state.solver.topology.independent).tolist()
    nodes = ", ".join(map(str, free or [0]))  # C has no empty tables, and the first node may be placed as well
    unknowns = state.solver.state
    places = {"at_x": unknowns.x, "at_r": unknowns.r, "at_begun_x": undeformed.x, "at_begun_r": undeformed.r}
    return RestStart("rest_in_space", calls, places, {"free_nodes": nodes}, _list_rates(unknowns))


def _list_rates(unknowns: Any) -> list[NDArray[Any]]:
    """Unknowns of a march that are zero at rest, and the order of its prediction."""
    u = unknowns
    return [u.d, u.u, u.du, u.pseudo, u.trend, u.bend, u.u0, u.du0, u.order]


def _list_turns(mechanism: Mechanism) -> Iterator[tuple[int, int]]:
    """First coordinate and count of the cosines and sines and of the quaternions among the coordinates."""
    for joint in mechanism.joints:
        columns = mechanism.q_slices[joint.name]
        if KINDS[joint.kind].circle:
            yield columns.start, 2
        elif KINDS[joint.kind].has_quaternion:
            yield columns.stop - 4, 4
