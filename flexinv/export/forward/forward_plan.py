"""The library of forward dynamics: the march in space with every joint free, as `analysis.simulate.simulate` makes it.

One kernel, `dynamics.stepper.integrate_instants`, under four schemes:

    step          the time step
    early         a part of a step soon after a sudden start
    accelerations where the mechanism stands, for torques that begin or jump
    resolved      the same, as far as a step resolves it

The C file puts them in the order of `dynamics.initial_state.begin_step`.  The block begins at rest at a position, undeformed or
in the equilibrium with its drives held there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from flexinv.analysis.initial_motion import begin_motion
from flexinv.constraints.closures import build_constraint_rows
from flexinv.constraints.continuation import solve_closed_start
from flexinv.dynamics import generalized_alpha
from flexinv.dynamics.generalized_alpha import ACCELERATIONS, RESOLVED, build_generalized_alpha, build_start_scheme
from flexinv.dynamics.initial_state import CERTAIN, begin_from_state, compute_joint_motion
from flexinv.dynamics.loads import build_load_table
from flexinv.dynamics.solver import Solver, build_coordinate_map
from flexinv.dynamics.stepper import SLIPPED, SUDDEN_START, TURNED_TOO_MUCH, integrate_instants
from flexinv.dynamics.system import Instants
from flexinv.export.flexible.beam_damping import format_damping
from flexinv.export.flexible.flexible_plan import MarchSettings
from flexinv.export.flexible.parameters import format_spatial_parameters
from flexinv.export.flexible.step_advice import warn_of_long_step
from flexinv.export.forward.rotations import format_rotations
from flexinv.export.library_plan import BLOCK_HEADER, LibraryPlan
from flexinv.export.machine_code import KernelCall, add_entry
from flexinv.export.memory_image import WORD, MemoryImage, list_arrays
from flexinv.export.names import format_numbers
from flexinv.export.payload_nodes import add_payload_bodies
from flexinv.export.readings import format_beams, format_poses
from flexinv.kinematics.mesh import build
from flexinv.kinematics.tree import Frames, Joints
from flexinv.linearized.modal_damping import apply_stated_ratio
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

FOUND = "Of the last step, or of the start."


def plan_forward_library(mechanism: Mechanism, prefix: str, settings: MarchSettings) -> LibraryPlan:
    """Return the library [rad or m, s] that torques move, whose names begin with ``prefix``.

    Raises ConvergenceError where the position has no equilibrium, or loops do not close near it.
    """
    mesh = build(apply_stated_ratio(add_payload_bodies(mechanism, settings.payloads)))
    m = mesh.mechanism
    solver = Solver.build_for(mesh, m.moving_names, lambda at, _: np.zeros((len(at), m.nv)))
    begins, joints = _begin_at_rest(solver, settings)
    if not m.is_rigid:
        warn_of_long_step(m, begins, settings.step)
    calls = _list_calls(solver, joints, settings, prefix)
    image = MemoryImage(BLOCK_HEADER, [one for call in calls for one in list_arrays(call.arguments)])
    entries = [add_entry(image, call) for call in calls]
    instants: Instants = calls[0].arguments[2]
    values = _format_places(image, solver, instants) | _format_march(solver, settings)
    values |= {f"at_{word}_result": str(one.result) for word, one in zip(_SCHEMES, entries, strict=True)}
    values["start_numbers"] = format_numbers(begins)
    values |= format_rotations(image, mesh, values)
    frames = Frames(*(part[0] for part in solver.instant[:6]))
    values |= format_poses(image, mesh, frames, FOUND)
    parts = ["links", "forward", "poses"]
    if m.beams:
        values |= format_beams(image, mesh, solver.instant.internal, prefix)
        parts += ["turned", "beams"]
    t = solver.topology
    numbers = t.drives, t.mass, t.inertia, t.gravity, instants.joints.p[0]
    values |= format_spatial_parameters(image, mesh, numbers, settings.payloads, prefix)
    damping = format_damping(image, mesh, solver.elements)
    values |= damping or {}
    parts += ["parameters", *(["damping"] if damping else []), *(["bodies", "payloads"] if settings.payloads else [])]
    return LibraryPlan("forward", m, entries, image, values, None, tuple(parts), begins, settings.step)


_SCHEMES = ("step", "early", "accelerations", "resolved")


def _begin_at_rest(solver: Solver, settings: MarchSettings) -> tuple[Array, Joints]:
    """Put a solver to rest; return the coordinates (nq,) with loops closed, and the relative motion of the nodes."""
    mesh = solver.mesh
    m = mesh.mechanism
    still = np.zeros(m.nv)
    now = [settings.start, still, still]
    if m.closures:
        rows = build_constraint_rows(mesh)
        now = list(solve_closed_start(mesh, (now[0], still, still), 0.0, ~m.actuated, rows))
    begin_motion(solver, now, 0.0, settings.initial, "at the start")
    s = solver.state
    s.u[:] = 0.0
    s.du[:] = 0.0
    begin_from_state(s)
    return np.array(now[0]), compute_joint_motion(mesh, now[0], still, still)


def _list_calls(solver: Solver, joints: Joints, settings: MarchSettings, prefix: str) -> list[KernelCall]:
    """The kernel under each of its schemes."""
    scheme = build_generalized_alpha(settings.step, settings.spectral_radius)
    rows = Joints(*(np.array(part[None]) for part in joints))
    none = np.zeros(solver.mesh.mechanism.nv)
    terms = solver.compute_coupling_terms(settings.start[None], none[None], none[None])
    efforts = np.zeros((1, len(solver.topology.scale)))
    instants = Instants(rows, build_load_table(solver.mesh, np.zeros(1)), efforts, terms)
    ways: Sequence[Any] = (scheme, build_start_scheme(scheme), ACCELERATIONS, scheme._replace(mode=RESOLVED))
    return [
        KernelCall(
            f"{prefix}_kernel_{word}", integrate_instants, solver.prepare_arguments(way, instants, solver.instant)
        )
        for word, way in zip(_SCHEMES, ways, strict=True)
    ]


def _format_places(image: MemoryImage, solver: Solver, instants: Instants) -> dict[str, str]:
    """Places of the unknowns and of what moves them, and room for what is set aside."""
    s = solver.state
    arrays = {
        "x": s.x, "d": s.d, "u": s.u, "du": s.du, "pseudo": s.pseudo, "trend": s.trend, "bend": s.bend, "u0": s.u0, "du0": s.du0,
        "r": s.r, "place": s.place, "order": s.order, "efforts": instants.efforts, "multipliers": solver.border.ties.multiplier,
    }  # fmt: skip
    places = {f"at_{name}": image.find_place(part) for name, part in arrays.items()}
    unknowns = len(solver.topology.scale)
    rooms = {
        "found": unknowns,
        "before": unknowns,
        "kept_x": s.x.size,
        "kept_forces": len(solver.border.ties.multiplier),
    }
    return {name: str(place) for name, place in places.items()} | {
        f"at_{name}": str(image.add_room(WORD * max(count, 1))) for name, count in rooms.items()
    }


def _format_march(solver: Solver, settings: MarchSettings) -> dict[str, str]:
    """Numbers of the march, and the unknown of each rate."""
    topology = solver.topology
    g = generalized_alpha
    numbers = {
        "passes": g.PASSES, "early_steps": g.EARLY, "substeps": g.SUBSTEPS, "sudden_start": SUDDEN_START,
        "too_much": TURNED_TOO_MUCH, "slipped": SLIPPED, "unknowns": len(topology.scale),
        "multiplier_count": len(solver.border.ties.multiplier), "node_numbers": solver.state.x.size,
    }  # fmt: skip
    sizes = {
        "start_rounding": g.START_ROUNDING, "sudden_part": g.SUDDEN, "dominant": g.DOMINANT, "certain": CERTAIN,
        "last_digit": float(np.finfo(float).eps * solver.mesh.length), "march_step": settings.step,
    }  # fmt: skip
    moved = build_coordinate_map(solver.mesh, topology)
    return {name: str(one) for name, one in numbers.items()} | {name: float(one).hex() for name, one in sizes.items()} | {
        "driven": ", ".join(str(int(one)) for one in solver.mesh.mechanism.actuated),
        "scales": format_numbers(topology.scale), "unknown_of_rate": ", ".join(map(str, moved.argmax(axis=1).tolist())),
        "coordinates_of_rates": ", ".join(_list_coordinates(solver.mesh.mechanism)),
    }  # fmt: skip


def _list_coordinates(mechanism: Mechanism) -> Iterator[str]:
    """Of each rate its first coordinate, and what that is: `templates/forward.c.in`."""
    for joint in mechanism.joints:
        kind = KINDS[joint.kind]
        said = "COSINE" if kind.circle else "OF_ROTATION" if kind.has_quaternion else "NUMBER"
        first = mechanism.q_slices[joint.name].start
        for k in range(joint.nv):
            yield f"{{{first + k}, {said}}}"
