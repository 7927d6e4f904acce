"""Closed loops, springs and forces in Exudyn, in time: redundant coordinates, drives where the motion gives joints.

The joints that the motion leaves out are connectors with free axes; Exudyn's integrator moves them.  Its multipliers are
the efforts of drives on the joints that the motion gives; where actuators stand on other joints, or on more of them,
the same virtual work is shared out to them with least norm (`exudyn_chain`).  What rotors, damping, dry friction and
springs in joints take joins in there, on passive joints too.

A start with speed or acceleration costs some 20 steps of transient: the engine finds its initial accelerations without
what the motion prescribes, and takes none from outside (1.13.6: SetODE2Coordinates_tt has no effect on either
integrator, measured).  The record's settings say so; the error bars do not cover the sample at the start.

Three runs, with 2 h, h and h / 2: (4 fine - coarse) / 3 of the last two is the result, and what it differs from that
of the first two its error bar.
"""

from __future__ import annotations

import contextlib
import time as clock
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from crosscheck.budget import Family, limit_of, with_bars
from crosscheck.engines import assembly, exudyn_chain, exudyn_closing, exudyn_planar, exudyn_spatial
from crosscheck.engines.base import Options, sample_times
from crosscheck.engines.exudyn_frames import Array, effort_axes, joint_q
from crosscheck.engines.exudyn_layout import Layout, lay_out
from crosscheck.engines.exudyn_march import Made
from crosscheck.engines.exudyn_parts import Outcome
from crosscheck.engines.exudyn_solve import NewtonStalled, Plan, grid, step_size
from crosscheck.engines.prescribed import missing_motion, passive_effort, rotor_effort, spring_effort
from crosscheck.record import Series, reaction_series, torque_series, vector_series, wrench_series
from flexinv.files.case import Case
from flexinv.mechanism import Mechanism

STEPS = 2000  # of the coarse run: the extrapolated torque of the four-bar is within 1e-8 of the range
NEWTON = (1e-10, 1e-9, 1e-8)  # of increments, relative and absolute: the next one where a run stalls
# A pair of unit vectors whose product is smaller is perpendicular up to the digits of a file.
PERPENDICULAR = 1e-9


@dataclass(frozen=True)
class Model:
    """What is integrated: layout at the closed start, plane (None in space), equations that each closure keeps."""

    mechanism: Mechanism
    case: Case
    layout: Layout
    plane: Array | None
    free: frozenset[str]
    held: dict[str, list[int]]

    @property
    def left_out(self) -> list[str]:
        """Closures whose equations are not all needed (in the plane they are)."""
        full = {c.name: sum(exudyn_closing.HELD[c.kind]) for c in self.mechanism.closures}
        return [] if self.plane is not None else [n for n, rows in self.held.items() if sum(rows) < full[n]]


# A motion starts with acceleration when its first one is more than this part of its largest: splines round by less.
STARTED = 1e-2


def unsupported(mechanism: Mechanism, case: Case) -> str | None:
    """Return why Exudyn cannot do this mechanism with closures, springs or forces in time, or None."""
    if not mechanism.closures and (reason := missing_motion(mechanism, case)):
        return reason
    if switched := [c.name for c in mechanism.closures if c.active]:
        return f"closures act all the time here; switched: {', '.join(switched)}"
    if reason := assembly.unsupported(mechanism) or exudyn_spatial.unsupported(mechanism):
        return reason
    for joint in mechanism.joints:
        lean = joint.kind == "universal" and abs(joint.axis @ joint.second_axis) > PERPENDICULAR
        if lean and joint.name in assembly.left_out(mechanism, case):
            return f"joint {joint.name}: a connector holds the axes of a universal joint perpendicular; these lean"
    return _jerked_start(mechanism, case)


def _jerked_start(mechanism: Mechanism, case: Case) -> str | None:
    """Return why a loop that starts with acceleration is no comparison: the engine cannot be told of it."""
    _, _, qdd = case.motion.evaluate(mechanism, np.linspace(0.0, case.end, 101))
    largest = np.abs(qdd).max(axis=0, initial=0.0)
    started = np.abs(qdd[0]) > STARTED * largest
    if not mechanism.closures or not (started & (largest > 0.0)).any():
        return None
    name = mechanism.velocity_names[int(np.argmax(started & (largest > 0.0)))]
    return (
        f"'{name}' starts with acceleration: in a loop Exudyn finds its initial accelerations without what the motion "
        "prescribes and takes none from outside, which leaves some 20 steps of transient as large as the effort itself"
    )


def model_of(mechanism: Mechanism, case: Case) -> Model:
    """Return what is integrated.  Raises AssemblyError where the loops do not close at the start."""
    q, qd, _ = exudyn_chain.closed_motion(mechanism, case, np.zeros(1))
    layout = lay_out(mechanism, q[0], qd[0])
    held = exudyn_closing.independent(mechanism, case) if mechanism.closures else {}
    plane = exudyn_planar.plane_of(mechanism, layout)
    # in the plane every closure is two equations; where some of these are redundant too, the spatial model leaves them out
    flat = not isinstance(plane, str) and sum(map(sum, held.values())) == 2 * len(mechanism.closures)
    free = frozenset(assembly.left_out(mechanism, case))
    return Model(mechanism, case, layout, plane if flat and not isinstance(plane, str) else None, free, held)


def plans_of(model: Model, options: Options) -> list[Plan]:
    """Return the runs from coarse to fine, steps in [s]; without "error" those two that the result needs."""
    case = model.case
    wanted = float(options.get("step", case.end / STEPS)) / 2 ** int(options.get("refinement", 0))
    behind = 1 if options.get("error", True) else 0
    moving = any(rate.any() for rate in case.motion.evaluate(model.mechanism, np.zeros(1))[1:])
    plan = Plan(
        end=(len(sample_times(case)) - 1) * case.sample,
        step=step_size(case.sample, wanted * 2**behind),
        sample=case.sample,
        index2=model.plane is not None and not case.motion.jumps and not moving,
        spectral_radius=0.5,
        tolerance=NEWTON[0],
        extrapolate=moving,
    )
    return [replace(plan, step=plan.step / 2**k) for k in range(behind + 2)]


def in_time(mechanism: Mechanism, case: Case, options: Options) -> Made:
    """Return torque [N m] or [N], tip [m] and, where unique, wrench [N], [N m], each with its bar."""
    start = clock.perf_counter()
    model = model_of(mechanism, case)
    state = exudyn_chain.closed_motion(mechanism, case, sample_times(case))
    done = [_march(model, plan) for plan in plans_of(model, options)]
    runs = [_series(model, outcome, state) for outcome, _ in done]
    made, budget = with_bars(limit_of(runs), [Family("step", runs, "limit")])
    return Made(made, _settings(model, [plan for _, plan in done]), clock.perf_counter() - start, budget)


def _march(model: Model, plan: Plan) -> tuple[Outcome, Plan]:
    for tolerance in NEWTON[:-1]:
        one = replace(plan, tolerance=tolerance)
        with contextlib.suppress(NewtonStalled):
            return _integrate(model, one), one
    last = replace(plan, tolerance=NEWTON[-1])
    return _integrate(model, last), last


def _integrate(model: Model, plan: Plan) -> Outcome:
    m, layout = model.mechanism, model.layout
    q, qd, _ = model.case.motion.evaluate(m, grid(plan))
    if model.plane is None:
        return exudyn_spatial.run(exudyn_spatial.build(m, layout, False, 1, model.free, model.held), plan, q)
    return exudyn_planar.run(exudyn_planar.build(m, layout, model.plane, False, 1, model.free), plan, q, qd)


def _series(model: Model, outcome: Outcome, state: tuple[Array, Array, Array]) -> dict[str, Series]:
    m, (q, qd, qdd) = model.mechanism, state
    torque = rotor_effort(m, qdd) + passive_effort(m, qd) + spring_effort(m, q)
    made: dict[str, Series] = {}
    for name, wrench in outcome.wrench.items():
        joint = m.joint_of[name]
        if name not in model.free:
            axes = np.concatenate(effort_axes(joint, joint_q(m, joint, q)), axis=2)
            torque[:, m.v_slices[name]] += np.einsum("svc,sc->sv", axes, wrench)  # (sample, coordinate)
        made |= wrench_series(name, wrench)
    for name, wrench in outcome.closure.items():
        made |= reaction_series(name, wrench)
    if m.closures:
        torque = exudyn_chain.shared(m, model.case, q, torque)
    if model.left_out or (m.closures and not _driven(model)):
        made = {}  # not the reactions that belong to these efforts
    for link in m.links:
        position, rotation = outcome.pose[model.layout.link[link.name].group]
        frame = model.layout.link[link.name].placement
        made |= vector_series(
            f"tip/{link.name}", "m", position + rotation @ (frame.position + frame.rotation @ link.tip)
        )
    return torque_series(m, torque) | made


def _driven(model: Model) -> bool:
    """Return whether drives stand on the very joints that the motion gives, and take nothing on the others."""
    m = model.mechanism
    given = all(j.actuated is (j.name not in model.free) for j in m.joints if j.nv)
    quiet = all(
        not any((j.rotor_inertia, j.damping, j.friction, j.stiffness)) for j in m.joints if j.name in model.free
    )
    return given and quiet


def _settings(model: Model, plans: list[Plan]) -> dict[str, Any]:
    flat = model.plane is not None
    return {
        "model": "planar bodies" if flat else "bodies with Euler parameters",
        "closures": "RevoluteJoint2D" if flat else "GenericJoint",
        "redundant equations left out of": model.left_out,
        "step_s": [plan.step for plan in plans],
        "integrator": plans[0].integrator,
        "newton_tolerance": [plan.tolerance for plan in plans],
        "start": "in motion: the first some 20 steps are a transient" if plans[0].extrapolate else "at rest",
        "extrapolation": "(4 fine - coarse) / 3: the error is of order h^2",
    }
