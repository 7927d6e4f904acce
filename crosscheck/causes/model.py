"""flexinv's own torques of a subject, quickly and as often as a fit asks: the columns of the dictionary come from here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from crosscheck.causes.apply import apply_effort_changes
from crosscheck.causes.subject import States, Subject
from crosscheck.engines.base import sample_times
from crosscheck.engines.flexinv.adapter import solve_case
from crosscheck.measures.record import Record, Series, compute_fingerprint, list_effort_units
from crosscheck.verdicts.compare import compute_signal_range
from flexinv.analysis.solution import Solution
from flexinv.analysis.solve import solve
from flexinv.constraints.allocation import REDUNDANT, count_ranks
from flexinv.constraints.closures import build_constraint_rows, compute_constraint_jacobian
from flexinv.inverse.inverse_dynamics import (
    compute_applied_forces,
    compute_internal_efforts,
    compute_nodal_forces,
    compute_projected_efforts,
)
from flexinv.kinematics.mesh import build
from flexinv.kinematics.nodal_motion import compute_rigid_motion
from flexinv.model.by_value import is_same
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import evaluate_motion
from flexinv.typing import Array, Mask

FEWEST = 100  # samples of a rigid mechanism that a fit looks at, or up to twice as many
# Of a flexible march, at least.  A thick strip that rings in short waves, 10 % softer in shear: with 1,200 steps the column has
# an error of 13 %, with 2,500 of 1.8 % (at single samples more than a named cause may leave), with 6,000 of 0.4 %.
STEPS = 4000
# Of a march that shows only whether a cause is worth a closer look.  Of 84 columns of a one-link arm half then have errors below
# 1.5 % and nine of ten below 13 %, which STEPS / 2 does not better: what is off by more hardly shows.
ROUGH_STEPS = 1000
ROUGH_ERROR = 0.1  # of an effect: what rough marches are allowed to be off by before a cause is given up


@dataclass(frozen=True)
class Model:
    """One case in flexinv, at the samples that a fit looks at.

    rows : their indices among the sample times of the case; states : the joint motion there
    torque : (samples, nv) [N m] or [N]; scale : (nv,) range of each coordinate's unit, [N m] or [N]
    seen : (samples, nv) which efforts count, None for all: the others are zero in every column
    """

    base: Subject
    rows: np.ndarray
    states: States
    torque: Array
    scale: Array
    seen: Mask | None = None

    def compute_torques(self, subject: Subject) -> Array:
        """Return the efforts of a changed subject at the same samples, (samples, nv) [N m] or [N]."""
        if subject.dense and self.base.mechanism.is_rigid:  # of a march every sample is looked at anyway
            states, effort = self._compute_all_samples(subject)
            for change in subject.effort:
                effort = change(subject.mechanism, states, effort)
            return np.asarray(effort[self.rows])
        effort = self.torque if self._has_same_march(subject) else _compute_model_efforts(self, subject)
        for change in subject.effort:
            effort = change(subject.mechanism, self.states, effort)
        return effort

    def _has_same_march(self, subject: Subject) -> bool:
        """Return True if a march of a subject is that of the unharmed one: what is done to efforts alone needs no other."""
        a = self.base
        b = subject
        return (
            not a.mechanism.is_rigid
            and a.mechanism is b.mechanism
            and a.case is b.case
            and dict(a.options) == dict(b.options)
        )

    def compute_difference(self, subject: Subject) -> Array:
        """Return the change of the efforts by the change of a subject, over the scale, (samples nv,) [-]."""
        return self.scale_efforts(self.compute_torques(subject) - self.torque)

    def scale_efforts(self, efforts: Array) -> Array:
        """Return efforts (samples, nv) over the scale as one column [-]."""
        part = efforts / self.scale
        return np.asarray((part if self.seen is None else np.where(self.seen, part, 0.0)).ravel())

    def compute_residual(self, engine: Record, reference: Record) -> Array:
        """Return the difference of an engine's record from a reference's, over the scale, (samples nv,) [-]."""
        names = [f"torque/{name}" for name in self.base.mechanism.velocity_names]
        pairs = [(engine.series[n].values, reference.series[n].values) for n in names]
        return self.scale_efforts(np.array([(a - b)[self.rows] for a, b in pairs]).T)

    def is_like(self, other: Model) -> bool:
        """Return True if another model has the same mechanism, case, samples, efforts and scale, number by number."""
        same = all(np.array_equal(getattr(self, name), getattr(other, name)) for name in ("rows", "torque", "scale"))
        return same and compute_fingerprint(self.base.mechanism, self.base.case) == compute_fingerprint(
            other.base.mechanism, other.base.case
        )

    def _compute_all_samples(self, subject: Subject) -> tuple[States, Array]:
        """Return joint motion and efforts (samples, nv) [N m], [N] at all sample times of the case."""
        same = subject.mechanism is self.base.mechanism and subject.case.motion is self.base.case.motion
        return self.everywhere if same else _compute_first_efforts(subject, sample_times(self.base.case))

    @property
    def whole(self) -> Model:
        """The same at all sample times of the case, where every effort counts."""
        states, torque = self.everywhere
        return replace(self, rows=np.arange(len(states.time)), states=states, torque=torque, seen=None)

    @cached_property
    def everywhere(self) -> tuple[States, Array]:
        """Joint motion and efforts (samples, nv) [N m], [N] of the unharmed subject at all sample times of the case."""
        return _compute_first_efforts(self.base, sample_times(self.base.case))

    def collect_series(self, subject: Subject) -> Mapping[str, Series]:
        """Return all that flexinv gives for a subject at all sample times, [N], [N m], [m], with the step of the columns."""
        case = (
            subject.case if subject.mechanism.is_rigid else replace(subject.case, step=find_coarse_step(subject, STEPS))
        )
        made = solve_case(case.meshed(subject.mechanism), case)[1]
        return apply_to_record(Record("flexinv", time=sample_times(case), series=made), subject).series

    @cached_property
    def unharmed(self) -> Mapping[str, Series]:
        """All that flexinv gives for the unharmed subject, as ``series`` [N], [N m], [m]."""
        return self.collect_series(self.base)

    @cached_property
    def rough(self) -> Model:
        """The same with efforts of marches of ROUGH_STEPS, which say where it is worth to look; itself where nothing marches."""
        base = self.base
        if base.mechanism.is_rigid or "step" in base.options:
            return self
        step = find_coarse_step(base, ROUGH_STEPS)
        if step == find_coarse_step(base, STEPS):
            return self
        rough = replace(self, base=base.update_options(step=step))
        return replace(rough, torque=_compute_model_efforts(rough, rough.base))

    @property
    def rough_error(self) -> float:
        """The part of an effect [-] that `rough` may be off by, 0 where it is the model itself."""
        return 0.0 if self.rough is self else ROUGH_ERROR

    @cached_property
    def shares(self) -> Array:
        """(samples, nv, nv) [-]: efforts of the drives of a closed mechanism per effort of its cut tree."""
        mechanism = self.base.mechanism
        mesh = build(mechanism)
        motion = compute_rigid_motion(mesh, self.states.q, self.states.qd, self.states.qdd)
        g = compute_constraint_jacobian(mesh, motion, build_constraint_rows(mesh))
        return np.array([_compute_share_matrix(one, mechanism.actuated) for one in g])


def make_model(subject: Subject, reference: Record | None = None) -> Model:
    """Return the model of a subject; the scale comes from a reference record where there is one, else from itself."""
    time = sample_times(subject.case)
    rigid = subject.mechanism.is_rigid
    fewest = FEWEST // 2 if subject.mechanism.closures else FEWEST
    rows = np.arange(0, len(time), find_stride(subject.mechanism, time, (len(time) - 1) // fewest) if rigid else 1)
    held, torque = _compute_first_efforts(subject, time[rows])
    shown = torque
    if reference is not None:
        shown = np.array([reference.series[f"torque/{n}"].values for n in subject.mechanism.velocity_names]).T
    return Model(subject, rows, held, torque, compute_effort_scales(subject.mechanism, shown))


def find_stride(mechanism: Mechanism, time: Array, most: int) -> int:
    """Return the largest stride up to ``most`` that keeps the samples, of time [s], at which closures begin or cease to act."""
    instants = {t for c in mechanism.closures for span in c.active for t in span if time[0] < t < time[-1]}
    samples = [round((t - time[0]) / (time[1] - time[0])) for t in instants]
    return max((k for k in range(1, most + 1) if not any(n % k for n in samples)), default=1)


def compute_effort_scales(mechanism: Mechanism, torque: Array) -> Array:
    """Return the range of the efforts of each coordinate's unit, (nv,) [N m] or [N]; 1 where there is none."""
    units = list_effort_units(mechanism)
    ranges = {u: compute_signal_range([torque[:, k] for k, v in enumerate(units) if v == u]) for u in set(units)}
    return np.array([ranges[u] or 1.0 for u in units])


def open_tree(mechanism: Mechanism, states: States) -> Array:
    """Return the efforts of the rigid tree without its closures, (samples, nv) [N m] or [N]."""
    mesh = build(mechanism)
    motion = compute_rigid_motion(mesh, states.q, states.qd, states.qdd)
    acting = compute_applied_forces(mesh, motion, states.time)
    forces = compute_nodal_forces(mesh, motion, acting)
    drives = compute_internal_efforts(mechanism, states.q, states.qd, states.qdd)
    return np.asarray(compute_projected_efforts(mesh, motion, forces) + drives)


def is_tree(subject: Subject) -> bool:
    """Return True if all joint motion is prescribed: a rigid tree without passive joints."""
    mechanism = subject.mechanism
    given = subject.case.motion.joints(mechanism)
    return mechanism.is_rigid and not mechanism.closures and all(j.name in given for j in mechanism.joints if j.nv)


def apply_to_record(record: Record, subject: Subject) -> Record:
    """Return an engine's record [N m], [N], [m] with what the subject does to efforts, along the motion of all joints."""
    if not subject.effort:
        return record
    time = sample_times(subject.case)
    mechanism = subject.mechanism
    motion = subject.case.motion
    given = motion.joints(mechanism)
    if all(j.name in given for j in mechanism.joints if j.nv):
        return apply_effort_changes(record, subject, States(time, *motion.evaluate(mechanism, time)))
    return apply_effort_changes(
        record, subject, _compute_first_efforts(subject, time)[0]
    )  # what closures move is left out of the motion


def _compute_first_efforts(subject: Subject, time: Array) -> tuple[States, Array]:
    if is_tree(subject):
        states = States(time, *evaluate_motion(subject.case.motion, subject.mechanism, time))
        return states, open_tree(subject.mechanism, states)
    solution, rows = _solve_march(subject, time)
    states = States(time, solution.q[rows], solution.qd[rows], solution.qdd[rows])
    return states, _collect_efforts(subject.mechanism, solution)[rows]


def _compute_model_efforts(model: Model, subject: Subject) -> Array:
    time = model.states.time
    if is_tree(subject):
        states = States(time, *evaluate_motion(subject.case.motion, subject.mechanism, time))
        return open_tree(subject.mechanism, states)
    if subject.mechanism.is_rigid and _has_same_motion(model.base, subject):
        tree = open_tree(subject.mechanism, model.states)
        return np.asarray(np.einsum("sij,sj->si", model.shares, tree))  # (sample, coordinate)
    solution, rows = _solve_march(subject, time)
    return _collect_efforts(subject.mechanism, solution)[rows]


def _has_same_motion(base: Subject, subject: Subject) -> bool:
    """Return True if a rigid mechanism's closures move it, and share its efforts, as before: nothing there was changed."""
    a = base.mechanism
    b = subject.mechanism
    joints = all(
        is_same(one.placement, two.placement)
        and is_same(one.axis, two.axis)
        and (one.kind, one.actuated, one.weight) == (two.kind, two.actuated, two.weight)
        for one, two in zip(a.joints, b.joints, strict=True)
    )
    always = not any(c.active for c in a.closures)
    tied = bool(a.closures) and is_same(a.closures, b.closures)
    return always and tied and joints and base.case.motion is subject.case.motion


def _solve_march(subject: Subject, time: Array) -> tuple[Solution, slice]:
    case = subject.case
    spacing = float(time[1] - time[0])
    step = spacing if subject.mechanism.is_rigid and subject.mechanism.closures else find_coarse_step(subject, STEPS)
    solution = solve(
        case.meshed(subject.mechanism),
        case.motion,
        step,
        end=float(time[-1]),
        spectral_radius=float(subject.options.get("spectral_radius", case.spectral_radius)),
        initial=case.initial,
        start=case.start,
    )
    return solution, slice(None, None, round(spacing / step))


def find_coarse_step(subject: Subject, fewest: int) -> float:
    """Return a step [s] of the march for columns: what is asked for, or the longest that divides the samples, meets jumps
    and takes ``fewest`` steps or more."""
    case = subject.case
    if "step" in subject.options:
        return float(subject.options["step"])
    parts = round(case.sample / case.step)
    fine = [k for k in range(1, parts + 1) if parts % k == 0 and case.end / (k * case.step) >= fewest]
    return float(1 if case.motion.jumps else max(fine, default=1)) * case.step


def _collect_efforts(mechanism: Mechanism, solution: Solution) -> Array:
    """Return the efforts; in loops those of the drives alone: what closures leave at other joints is rounding."""
    return np.where(mechanism.actuated, solution.torque_all, 0.0) if mechanism.closures else solution.torque_all


def _compute_share_matrix(g: Array, driven: np.ndarray) -> Array:
    """Return S pinv(N_driven^T) N^T, (nv, nv) [-], with G N = 0: efforts of least norm."""
    _, values, right = np.linalg.svd(g)
    motions = right[count_ranks(values) :].T
    out = np.zeros((len(driven), len(driven)))
    out[driven] = np.linalg.pinv(motions[driven].T, rcond=REDUNDANT) @ motions.T
    return out


def drop_closures(subject: Subject) -> Subject:
    """Return the cut tree of a subject (its joint motion has to be given in full)."""
    return replace(subject, mechanism=replace(subject.mechanism, closures=()))
