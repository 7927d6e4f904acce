"""Closures that act for a while in Exudyn, in one integration: constraints that a user function switches before a step.

Every closure stands in the model once for each phase in which it acts, with the equations that are independent there; of
the joints that the motion gives, as many have drives in a phase as it has freedoms, the others are connectors with free
axes for that while (drives on both sides of a bar that two hands hold would contradict each other by rounding, and make the
matrix singular).  ``activeConnector`` of all these is set before every step (``SetPreStepUserFunction``).

The engine's positions are held at position level in every phase (index 3), so that the step which arrives at a switching
instant can be made with the constraints of the phase that begins there: its multipliers are those just after the instant.
What a connector that does not act gives is zero; so joints and closures are the sum of their connectors.

Efforts are shared out phase by phase (`exudyn.chain.shared`); the reactions of closures follow that share,

    G^T dlambda = tau_engine - tau           of least norm

and belong to the determinate components; wrenches of joints are not given.

One integration after the other, each started where the one before has ended, would have a transient of some 20 steps after
every instant at which anything moves, as the walker's torso does: the engine takes no initial accelerations (`exudyn.lead_in`).
"""

from __future__ import annotations

import contextlib
import time as clock
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy  # its parts are loaded when they are asked for

from crosscheck.engines.base import Options, sample_times
from crosscheck.engines.exudyn import lead_in as exudyn_lead
from crosscheck.engines.exudyn import loops as exudyn_loops
from crosscheck.engines.exudyn import script as exudyn_script
from crosscheck.engines.exudyn.integration import NewtonStalled, Plan, compute_step_size, compute_step_times
from crosscheck.engines.exudyn.models import chain as exudyn_chain
from crosscheck.engines.exudyn.models import connectors as exudyn_closing
from crosscheck.engines.exudyn.models import spatial as exudyn_spatial
from crosscheck.engines.exudyn.models.frames import Array, compute_effort_axes, take_joint_q
from crosscheck.engines.exudyn.models.layout import Layout, build_layout
from crosscheck.engines.exudyn.models.parts import Outcome
from crosscheck.engines.exudyn.run_in_time import DAE, TimedRun, TimedSettings, collect_link_series
from crosscheck.engines.shared import loop_closure as assembly
from crosscheck.engines.shared import phases
from crosscheck.engines.shared.phases import Phase, State
from crosscheck.engines.shared.prescribed import compute_spring_effort, passive_effort, rotor_effort
from crosscheck.engines.shared.wrenches import compute_closure_forces, compute_reactions
from crosscheck.measures.budget import Family, add_error_bars, compute_richardson_limit
from crosscheck.measures.record import Series, make_reaction_series, torque_series
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Attachment, Closure, Joint, Mechanism
from flexinv.model.owned_cache import make_owner_cache

LOOSE = {"revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic"}


@dataclass(frozen=True)
class SwitchingSchedule:
    """Schedule of the connectors: joints and closures that act in each phase.

    mechanism : with a closure for every variant; held : equations that each keeps; free : joints that never have a drive
    acting : by phase, the names of joints and closures whose connectors act; starts : of the phases [s]
    """

    mechanism: Mechanism
    held: dict[str, list[int]]
    free: frozenset[str]
    acting: list[frozenset[str]]
    starts: list[float]

    def list_active_names(self, time: float) -> frozenset[str]:
        """Return the names that act at a time [s]: at an instant, those of the phase that begins there."""
        now = sum(start <= time + phases.SAME for start in self.starts)
        return self.acting[max(now - 1, 0)]


def solve_phases(mechanism: Mechanism, case: Case) -> list[tuple[Phase, State]]:
    """Return all phases with q (samples, nq), qd, qdd (samples, nv) [rad or m, s] of all joints."""
    return list(_solve_phases(case, mechanism))


@make_owner_cache(most=2)
def _solve_phases(case: Case, mechanism: Mechanism) -> list[tuple[Phase, State]]:
    result = phases.solve_phases(mechanism, case, sample_times(case), exudyn_chain.evaluate_closed_motion)
    for _, state in result:  # several callers share them
        for part in state:
            part.flags.writeable = False
    return result


def plan_switching(mechanism: Mechanism, case: Case, followed: list[tuple[Phase, State]]) -> SwitchingSchedule:
    """Return the variants of closures and which connectors act in which phase."""
    variants: dict[tuple[str, tuple[int, ...]], Closure] = {}
    acting = []
    given = [j for j in mechanism.joints if j.nv and j.name not in assembly.find_unprescribed_joints(mechanism, case)]
    for phase, (q, _, _) in followed:
        middle = q[len(q) // 2]
        driven = choose_drives(phase, given, middle)
        on = {j.name for j in mechanism.joints if j.nv and (j.name in driven or j not in given)}
        independent_axes = exudyn_closing.find_independent_axes_at(phase.mechanism, phase.case, middle)
        loose = [_make_free_connector(j) for j in given if j.name not in driven]
        for closure, axes in [
            *((c, tuple(independent_axes[c.name])) for c in phase.mechanism.closures),
            *((c, exudyn_closing.HELD[c.kind]) for c in loose),
        ]:
            name = f"{closure.name}/{''.join(map(str, axes))}"
            variants[closure.name, axes] = replace(closure, name=name)
            on.add(name)
        acting.append(frozenset(on))
    return SwitchingSchedule(
        mechanism=replace(mechanism, closures=tuple(variants.values())),
        held={c.name: list(axes) for (_, axes), c in variants.items()},
        free=frozenset(assembly.find_unprescribed_joints(mechanism, case)),
        acting=acting,
        starts=[float(phase.time[0]) for phase, _ in followed],
    )


def choose_drives(phase: Phase, given: list[Joint], q: Array) -> set[str]:
    """Return the joints with prescribed motion that have drives in a phase: as many as it has degrees of freedom.

    Those whose coordinates the motions that the closures allow tell apart best, at q (nq,) [rad], [m].
    """
    m = phase.mechanism
    tree = exudyn_chain.Tree(m, phase.case)
    g = assembly.assemble_rows(m.closures, tree.compute_frame_pairs(q, np.zeros(m.nv))).g
    motions = assembly.compute_null_space(g)
    columns = np.array([k for j in given for k in range(m.v_slices[j.name].start, m.v_slices[j.name].stop)])
    _, _, order = scipy.linalg.qr(motions[columns].T, pivoting=True, mode="economic")
    chosen = set(columns[order[: motions.shape[1]]].tolist())
    names = {j.name for j in given if set(range(m.nv)[m.v_slices[j.name]]) <= chosen}
    if sum(m.joint_of[name].nv for name in names) != motions.shape[1]:
        raise assembly.AssemblyError(
            f"at t = {phase.time[0]:g} s the motion gives parts of joints twice: no choice of drives"
        )
    return names


def _make_free_connector(joint: Joint) -> Closure:
    """A joint without its drive, as a connector with a free axis."""
    ends = Attachment(joint.parent, joint.placement), Attachment(joint.child)
    return Closure(f"{joint.name}/loose", LOOSE[joint.kind], *ends, axis=joint.axis)


def has_switched_closures(mechanism: Mechanism) -> bool:
    """Return True if closures act only for a while."""
    return any(c.active for c in mechanism.closures)


def describe_refusal(mechanism: Mechanism, case: Case) -> str | None:
    """Return the reason why the switching cannot be done, or None."""
    given = [j for j in mechanism.joints if j.nv and j.name not in assembly.find_unprescribed_joints(mechanism, case)]
    if wrong := [j.name for j in given if j.kind not in LOOSE]:
        return f"where closures switch, joints with a motion are hinges or slides here; others: {', '.join(wrong)}"
    if hard := [c.name for c in mechanism.closures if c.impact != "error"]:
        return f"a jump of velocity rings in index 3; closures with an impact: {', '.join(hard)}"
    if moving := [j.name for j in exudyn_lead.list_joints_in_motion(mechanism, case)]:
        return f"mechanisms that open and close start at rest here; in motion: {', '.join(moving)}"
    always = tuple(replace(c, active=()) for c in mechanism.closures)
    return exudyn_loops.describe_refusal(replace(mechanism, closures=always), case, DAE)


def integrate_phases(mechanism: Mechanism, case: Case, options: Options) -> TimedRun:
    """Return torque [N m] or [N], tip [m] and determinate reactions [N], [N m], each with its bar."""
    start = clock.perf_counter()
    run = ClosedRun(mechanism, case, solve_phases(mechanism, case))
    done = [run.integrate_with_retries(plan) for plan in plan_runs(mechanism, case, options)]
    runs = [run.collect_series(outcome) for outcome, _ in done]
    made, budget = add_error_bars(compute_richardson_limit(runs), [Family("step", runs, "limit")])
    return TimedRun(made, run.describe_settings([plan for _, plan in done]), clock.perf_counter() - start, budget)


def plan_runs(mechanism: Mechanism, case: Case, options: Options) -> list[Plan]:
    """Return the runs from coarse to fine, steps in [s]; without "error" those two that the result needs."""
    wanted = float(options.get("step", case.end / exudyn_loops.STEPS)) / 2 ** int(options.get("refinement", 0))
    behind = 1 if options.get("error", True) else 0
    plan = Plan(
        end=(len(sample_times(case)) - 1) * case.sample,
        step=compute_step_size(case.sample, wanted * 2**behind),
        sample=case.sample,
        index2=False,
        spectral_radius=0.5,
        tolerance=exudyn_loops.NEWTON[0],
        extrapolate=any(rate.any() for rate in case.motion.evaluate(mechanism, np.zeros(1))[1:]),
    )
    return [replace(plan, step=plan.step / 2**k) for k in range(behind + 2)]


@dataclass(frozen=True)
class ClosedRun:
    """A mechanism and its case with the closed motion of all phases."""

    mechanism: Mechanism
    case: Case
    followed: list[tuple[Phase, State]]

    @cached_property
    def switching(self) -> SwitchingSchedule:
        """Return the schedule of the connectors."""
        return plan_switching(self.mechanism, self.case, self.followed)

    @cached_property
    def layout(self) -> Layout:
        """Bodies where they start."""
        q, qd, _ = (part[0] for part in self.followed[0][1])
        return build_layout(self.mechanism, q, qd)

    def integrate_with_retries(self, plan: Plan) -> tuple[Outcome, Plan]:
        """Integrate; the plan comes back with the tolerance that held."""
        for tolerance in exudyn_loops.NEWTON[:-1]:
            one = replace(plan, tolerance=tolerance)
            with contextlib.suppress(NewtonStalled):
                return self._integrate(one), one
        last = replace(plan, tolerance=exudyn_loops.NEWTON[-1])
        return self._integrate(last), last

    def _integrate(self, plan: Plan) -> Outcome:
        s = self.switching
        d = exudyn_spatial.build(s.mechanism, self.layout, False, 1, s.free, s.held)
        connectors = {name: numbers for name, numbers in d.model.joint.items() if name not in s.free}
        connectors |= {name: (number,) for name, number in d.model.closure.items()}
        add_switching(d.model.mbs, connectors, s, plan)
        return exudyn_spatial.run(d, plan, self.case.motion.evaluate(s.mechanism, compute_step_times(plan))[0])

    def collect_series(self, outcome: Outcome) -> dict[str, Series]:
        """Return the series of one run, efforts and reactions shared out phase by phase."""
        m = self.mechanism
        q, qd, qdd = (np.concatenate(parts) for parts in zip(*(state for _, state in self.followed), strict=True))
        torque = rotor_effort(m, qdd) + passive_effort(m, qd) + compute_spring_effort(m, q)
        for joint in (m.joint_of[name] for name in outcome.wrench if name not in self.switching.free):
            axes = np.concatenate(compute_effort_axes(joint, take_joint_q(m, joint, q)), axis=2)
            torque[:, m.v_slices[joint.name]] += np.einsum("svc,sc->sv", axes, outcome.wrench[joint.name])
        made: dict[str, Series] = {}
        reaction = {c.name: _compute_closure_wrench(outcome.closure, c.name, len(q)) for c in m.closures}
        for phase, _ in self.followed:
            torque[phase.samples], change = _split_phase_efforts(phase, q[phase.samples], torque[phase.samples])
            for name, wrench in change.items():
                reaction[name][phase.samples] += wrench
        for name, wrench in reaction.items():
            made |= make_reaction_series(name, wrench)
        return torque_series(m, torque) | made | collect_link_series(m, self.layout, outcome)

    def describe_settings(self, plans: list[Plan]) -> TimedSettings:
        """Return the engine's settings, for the reader of the report."""
        drives = [sorted(on & set(self.mechanism.joint_of) - self.switching.free) for on in self.switching.acting]
        return {
            "model": "bodies with Euler parameters",
            "closures": "GenericJoint, activeConnector switched before the step that arrives at an instant",
            "drives of the phases": drives,
            "step_s": [plan.step for plan in plans],
            "integrator": plans[0].integrator,
            "newton_tolerance": [plan.tolerance for plan in plans],
            "extrapolation": "(4 fine - coarse) / 3: the error is of order h^2",
        }


def add_switching(mbs: Any, connectors: dict[str, tuple[Any, ...]], switching: SwitchingSchedule, plan: Plan) -> None:
    """Let only those connectors (name -> object numbers) act whose phase it is, from the start and before every step."""

    def turn(on: frozenset[str], before: frozenset[str] | None) -> None:
        for name, numbers in connectors.items():
            if before is None or (name in on) != (name in before):
                for number in numbers:
                    mbs.SetObjectParameter(number, "activeConnector", name in on)

    numbers = {name: tuple(map(int, members)) for name, members in connectors.items()}
    acting = (tuple(n for name in numbers if name in on for n in numbers[name]) for on in switching.acting)
    taken = tuple(n for members in numbers.values() for n in members)
    exudyn_script.add_switch_record(mbs, taken, tuple(zip(switching.starts, acting, strict=True)))
    state = [switching.list_active_names(0.0)]
    turn(state[0], None)

    def update_connectors(mbs: Any, t: float) -> bool:
        on = switching.list_active_names(t)
        if on != state[0]:
            turn(on, state[0])
            state[0] = on
        return True

    mbs.SetPreStepUserFunction(update_connectors)


def _compute_closure_wrench(wrenches: dict[str, Array], closure: str, samples: int) -> Array:
    """Return the sum of the wrenches of all variants of a closure, (samples, 6)."""
    parts = [wrench for name, wrench in wrenches.items() if name.rsplit("/", 1)[0] == closure]
    return np.asarray(sum(parts, np.zeros((samples, 6))))


def compute_drive_shares(mechanism: Mechanism, followed: list[tuple[Phase, State]]) -> Array:
    """Return the drives' efforts per effort of the joints that the motion gives, (samples, nv, nv) [-]."""
    q = np.concatenate([state[0] for _, state in followed])
    drive_shares = np.zeros((len(q), mechanism.nv, mechanism.nv))
    for phase, _ in followed:
        states = q[phase.samples]
        for k, unit in enumerate(np.eye(mechanism.nv)):
            drive_shares[phase.samples, :, k] = _split_phase_efforts(phase, states, np.tile(unit, (len(states), 1)))[0]
    return drive_shares


def _split_phase_efforts(phase: Phase, q: Array, torque: Array) -> tuple[Array, dict[str, Array]]:
    """Efforts (samples, nv) of the drives, and what this share adds to the closures' wrenches (samples, 6)."""
    m = phase.mechanism
    made = np.empty_like(torque)
    wrench = np.empty((len(q), len(m.closures), 6))
    for k, (pairs, rows) in enumerate(exudyn_chain.list_closure_rows(m, phase.case, q)):
        made[k] = assembly.split_efforts(rows.g, torque[k], m.actuated, m.weights)
        change = assembly.solve_multipliers(rows.g, torque[k], made[k])
        wrench[k] = compute_reactions(compute_closure_forces(m, pairs, rows, change), pairs)
    return made, {c.name: wrench[:, k] for k, c in enumerate(m.closures)}
