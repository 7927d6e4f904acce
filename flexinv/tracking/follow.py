"""follow: a path of a frame becomes joint torques, so that the deformed mechanism, not only a rigid one, follows it.

Stable inversion: from torque to tip a flexible arm is not of minimum phase: marched forward in time, the motion that belongs to a
prescribed tip grows without bound.  Solved as a boundary-value problem, at rest at both ends of a window, it is bounded: what
grows forward in time is fixed by the end (the arm moves before its tip does), what decays by the start.
All instants are unknown at once (`collocation`), and Newton solves for them; the first guess is the rigid mechanism on the path,
and where Newton does not converge from there the beams begin stiffer.
Source: Devasia, Chen, Paden, *Nonlinear inversion-based output tracking*, IEEE Trans. Automatic Control 41, 1996; as a
boundary-value problem of multibody systems Seifried, *Dynamics of Underactuated Multibody Systems*, 2014, ch. 4.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from flexinv.analysis.accurate import FEWEST_IN_STRETCH, check_accuracy, solve_within_accuracy
from flexinv.analysis.evaluation import FirstStep, assemble_solution, build_rigid_first_step
from flexinv.analysis.refinement import Problem, StepGrid
from flexinv.analysis.simulate import simulate
from flexinv.analysis.solution import Solution
from flexinv.analysis.solve import add_error_bars, solve
from flexinv.analysis.task import Settings
from flexinv.dynamics.system import Trajectory
from flexinv.errors import ConvergenceError, InputError, ModelWarning
from flexinv.inverse.inverse_dynamics import compute_applied_forces
from flexinv.kinematics.mesh import Mesh, build
from flexinv.kinematics.nodal_motion import fill_passive
from flexinv.linearized.modal_damping import apply_stated_ratio
from flexinv.model.by_value import ByValue
from flexinv.model.mechanism import Attachment, Mechanism
from flexinv.model.motion import Motion
from flexinv.tracking.collocation import FreeLayout, Horizon, NodePoses, RotationTooLarge
from flexinv.tracking.frame_path import Path
from flexinv.tracking.internal_motion import SWINGING, describe_zeros, find_internal_rates, find_swings, take_step
from flexinv.tracking.inverse_kinematics import Frame, PathMotion, RigidPath, list_drive_columns, resolve_frame
from flexinv.typing import Array, Complex
from flexinv.validation import check_choice, check_flag, check_kind, check_seconds

# Part of the motion inside that is left at the ends of a window that is chosen here, and that is refused in any.
LEFT = 1e-6
RESTLESS = 1e-2
# More instants than this are a mistake in `step` or in the window far more often than a wish: a gigabyte of equations.
MOST_INSTANTS = 20_000
# Newton stops when an increment, relative to the mechanism's length or in radians, is below this: the next would be its square.
INCREMENT = 1e-8
MOST_ITERATIONS = 20
# An increment this large, in lengths of the mechanism or radians, means that Newton is lost.
LOST = 30.0
# Continuation begins this many times as stiff, and gives up where the factor has to fall by less than SMALLEST_FACTOR in one go.
STIFF = 1000.0
SMALLEST_FACTOR = 1.02
RIGID_BODY = "rigid"
JOINT_SPACE = "joint space"
INVERSION = "stable inversion"


@dataclass(frozen=True, eq=False)
class Following(ByValue):
    """A path, and three ways to make a frame follow it.

    solution : stable inversion, the *deformed* frame on the path; its joints move before the path begins and after it ends
    rigid : as if the beams were rigid; reach : its joint motion
    wanted : (samples, 3) [m] where the frame shall be; time : (samples,) [s], 0 where the path begins
    unrest : speed left at the ends of the window over the largest [-]; frame : what follows
    """

    path: Path
    frame: Frame
    time: Array
    wanted: Array
    solution: Solution
    rigid: Solution
    reach: PathMotion
    unrest: tuple[float, float]

    @cached_property
    def joint_space(self) -> Solution:
        """The joints on the rigid mechanism's motion, beams bending: the naive answer, by `solve` [m, rad, s, N, N m]."""
        if self.solution is self.rigid:
            return self.rigid
        m = self.solution.mechanism
        q = self.reach.q
        time = self.time - self.time[0]
        given = {j.name: q[:, m.q_slices[j.name]] for j in m.moving_joints if j.actuated}
        rest = {j.name: q[0, m.q_slices[j.name]] for j in m.moving_joints if not j.actuated}
        motion = Motion.from_samples(time, given, rest=True)
        step = float(self.time[1] - self.time[0])
        # the end: rounding of the first time must not lose the last sample
        return replace(
            solve(m, motion, step, end=float(time[-1]), initial=_resolve_initial(m), start=rest), time=self.time
        )

    @property
    def feed_forwards(self) -> dict[str, Solution]:
        """The three by name, from the simplest on [N m], [N]."""
        return {RIGID_BODY: self.rigid, JOINT_SPACE: self.joint_space, INVERSION: self.solution}

    def distance(self, solution: Solution) -> Array:
        """Return the distance of a solution's frame from its prescribed position, (samples,) [m]."""
        if len(check_kind("solution", solution, Solution).time) != len(self.time):
            raise InputError(f"solution has {len(solution.time)} samples, expected the {len(self.time)} of this path")
        return np.asarray(np.linalg.norm(self.frame.compute_poses(solution.nodes).x - self.wanted, axis=1))

    def replay(self, name: str, spectral_radius: float = 0.8) -> Solution:
        """Return the motion that a feed-forward's torques give the flexible mechanism, by `simulate` [m, rad, s]."""
        ways = {RIGID_BODY: "rigid beams", JOINT_SPACE: "beams bend", INVERSION: "the deformed frame on the path"}
        check_choice("name", name, ways)
        torque = self.feed_forwards[name].torque
        q = self.solution.q[0]
        m = self.solution.mechanism
        step = float(self.time[1] - self.time[0])
        places = {j.name: q[m.q_slices[j.name]] for j in m.moving_joints}
        return simulate(m, self.time, torque, step, spectral_radius, _resolve_initial(m), start=places)


def follow(
    mechanism: Mechanism,
    path: Path,
    frame: str | Attachment,
    step: float | None = None,
    before: float | None = None,
    after: float | None = None,
    start: Mapping[str, ArrayLike] | None = None,
    error: bool = False,
    accuracy: float | None = None,
) -> Following:
    """Return the torques with which a frame of a mechanism, rigid, flexible or mixed, follows a path.

    Stable inversion: r(y_k, u_k, u'_k) - S tau_k = 0 and c(y_k) = 0 at all instants at once, at rest at both ends; of second
    order in the step. Where drives are more than the frame needs, they keep the self-motion of the rigid mechanism (shortest
    joint steps); where the frame cannot be moved in a direction (the length of a single arm), it is left there.

    frame : a link, whose tip follows, or an Attachment; step : between instants [s], or accuracy : as in `solve` [-]
    before, after : rest of the frame before and after the path, in which joints move already [s]; by default as long as what
        moves inside takes to fade to a millionth
    start : guess of joint coordinates at the start of the path [rad], [m]
    error : also with half the step and on a refined mesh: ``solution.torque_error``, ``solution.tip_error``
    Raises InputError for a path out of reach or too rough, and for a window too short; ConvergenceError if Newton fails.
    """
    check_kind("mechanism", mechanism, Mechanism)
    check_kind("path", path, Path)
    error = check_flag("error", error)
    asked = check_accuracy(accuracy, step) if accuracy is not None or step is None else None
    list_drive_columns(mechanism)
    _check_open(mechanism)
    if step is None:  # the coarsest one: steps divide the path's time
        step = path.duration / FEWEST_IN_STRETCH
    settings = _make_settings(check_seconds("step", step, "a positive number of seconds, for example step=1e-3"))
    runs = _Runs(path, frame, start, asked is None)
    way = runs.make_way(mechanism)
    time = _build_window(way, settings.step, before, after)
    if mechanism.is_rigid and all(j.actuated for j in mechanism.moving_joints):
        return _build_rigid_following(way, way.solve_joint_motion(time), time)
    if asked is None:
        mesh, first = runs.run(mechanism, time, (), settings)
        solution = assemble_solution(mesh, first, settings)
        horizon, left = runs.take_last()
        if error:
            solution = add_error_bars(solution, first, time, settings, runs.run, 2, True)
        return replace(_build_rigid_following(way, horizon.reach, time), solution=solution, unrest=left)
    problem = Problem(mechanism, StepGrid(time[[0, -1]], (len(time) - 1,)), runs.run, settings, asked)
    solution = solve_within_accuracy(problem)
    horizon, left = runs.take_last()
    _check_rest(horizon, left)
    way = runs.make_way(solution.mechanism)
    rigid = _build_rigid_following(way, way.solve_joint_motion(solution.time), solution.time)
    return replace(rigid, solution=solution, unrest=left)


def _check_open(mechanism: Mechanism) -> None:
    """Raise InputError for what a path cannot be followed with yet."""
    for what, items in (
        ("closures", mechanism.closures),
        ("springs between points", mechanism.springs),
    ):
        if items:
            raise InputError(
                f"mechanism '{mechanism.name}' has {what}: a path of a frame is followed by open mechanisms so far; "
                "give the joints a motion with solve instead"
            )


@dataclass
class _Runs:
    """Inversions of one path on any mesh, at any instants.

    checked : whether each has to be at rest at both ends; last : the equations of the last, and what moves at both ends
    """

    path: Path
    frame: str | Attachment
    start: Mapping[str, ArrayLike] | None
    checked: bool
    last: tuple[Horizon, tuple[float, float]] | None = None

    def make_way(self, meshed: Mechanism) -> RigidPath:
        """The path of the mechanism as if nothing bent."""
        mesh = build(apply_stated_ratio(meshed))
        return RigidPath(mesh, resolve_frame(mesh, self.frame), self.path, self.start)

    def run(self, meshed: Mechanism, steps: Array, _: tuple[int, ...], settings: Settings) -> tuple[Mesh, FirstStep]:
        """Solve at the instants ``steps`` [s], as `refinement.Problem.run`."""
        way = self.make_way(meshed)
        horizon = Horizon(FreeLayout(way.mesh), way, way.solve_joint_motion(steps), steps, settings.step)
        first, left = _solve_inversion(horizon)
        self.last = (horizon, left)
        if self.checked:
            _check_rest(horizon, left)
        return way.mesh, first

    def take_last(self) -> tuple[Horizon, tuple[float, float]]:
        """The equations of the last run, and what moves at both ends of the window."""
        assert self.last is not None
        return self.last


def _solve_inversion(horizon: Horizon) -> tuple[FirstStep, tuple[float, float]]:
    """The first step [m, rad, s, N] of a mechanism that bends, and what moves at both ends of the window [-]."""
    mesh = horizon.way.mesh
    time = horizon.time
    q = horizon.reach.q.copy()
    trajectory = solve_stable_inversion(horizon)
    moves = mesh.mechanism.moving_names
    qd, qdd = (np.zeros((len(time), mesh.mechanism.nv)) for _ in range(2))
    fill_passive(mesh, trajectory.motion, moves, q, qd, qdd)
    applied = compute_applied_forces(mesh, trajectory.motion, time)
    return FirstStep(trajectory, time, (q, qd, qdd), applied, smooth=moves), compute_end_speeds(trajectory)


def _build_rigid_following(way: RigidPath, reach: PathMotion, time: Array) -> Following:
    """A path as if nothing bent: the answer of a rigid mechanism whose joints are all driven, and the guess of all others."""
    first = build_rigid_first_step(way.mesh, time, (reach.q, reach.qd, reach.qdd))
    rigid = assemble_solution(way.mesh, first, _make_settings(float(time[1] - time[0])))
    return Following(way.path, way.frame, time, way.path.evaluate(time).x, rigid, rigid, reach, (0.0, 0.0))


def _build_window(way: RigidPath, step: float, before: float | None, after: float | None) -> Array:
    """Instants (samples,) [s], 0 among them."""
    path = way.path
    for name, value in (("before", before), ("after", after)):
        check_seconds(
            name, 0.0 if value is None else value, "a time, 0 or more [s], or None to choose it here", zero=True
        )
    move = path.duration
    ends = np.array([0.0, path.duration])
    if step > move / 4:
        raise InputError(f"step = {step:g} s is too long for a path of {move:g} s: write step = {move / 200:g}")
    if before is None or after is None:
        horizon = Horizon(FreeLayout(way.mesh), way, way.solve_joint_motion(ends), ends, step)
        waits = [_compute_fading_time(find_internal_rates(horizon, k)) for k in (0, -1)]
    first, last = (given if given is not None else waits[k] for k, given in enumerate((before, after)))
    count = np.ceil(np.array([first, move + last]) / step * (1 - 1e-9))
    if count.sum() > MOST_INSTANTS:
        raise InputError(
            f"step = {step:g} s gives {count.sum():.0f} instants in {first + move + last:.3g} s, more than {MOST_INSTANTS}: "
            "write a larger step, or shorter before and after"
        )
    return step * np.arange(-max(count[0], 1), max(count[1], 1) + 1)


def _compute_fading_time(rates: Complex) -> float:
    """Time [s] in which the slowest of the rates that fade has faded to LEFT; none where none does."""
    fading = rates.real[rates.real > SWINGING * np.abs(rates)]
    return float(-np.log(LEFT) / fading.min()) if len(fading) else 0.0


def _check_rest(horizon: Horizon, left: tuple[float, float]) -> None:
    ends = (-float(horizon.time[0]), float(horizon.time[-1]) - horizon.way.path.duration)
    for name, given, sample, rest in zip(("before", "after"), ends, (0, -1), left, strict=True):
        if rest <= RESTLESS:
            continue
        fades = _compute_fading_time(rates := find_internal_rates(horizon, sample))
        swings = bool(((rates.real <= SWINGING * np.abs(rates)) & (rates.imag > 0)).any())
        if given >= fades and swings and name == "after":
            warnings.warn(
                f"mechanism '{horizon.way.mesh.mechanism.name}': when the path has ended something swings on inside at "
                f"{rest:.1%} of the largest speed, and its drives with it ({describe_zeros(rates)}): the frame stays on its "
                f"path; "
                "give the path more time, the swinging joint or beam damping, or follow a point further out on the tool",
                ModelWarning,
                stacklevel=3,
            )
            continue
        advice = "give the path more time, or law = 'nonic'"
        if given < fades:
            advice = f"write {name} = {fades:.3g}, in which what moves inside fades"
        raise InputError(
            f"{name} = {given:.3g} s: at that end of the window the mechanism should rest and moves at {rest:.1%} of its largest "
            f"speed ({describe_zeros(rates)}); {advice}"
        )


def _resolve_initial(mechanism: Mechanism) -> str:
    return "static" if np.any(mechanism.gravity) or mechanism.forces else "consistent"


def _make_settings(step: float) -> Settings:
    return Settings(float(step), spectral_radius=1.0, initial="static", tolerance=None)


def solve_stable_inversion(horizon: Horizon) -> Trajectory:
    """Return the bounded motion [m, rad, s, N] of a frame on its path, from the rigid mechanism's as the first guess.

    r(y_k, u_k, u'_k) - S tau_k = 0,  c(y_k) = 0  at all instants k, at rest at the first and the last.  Where something swings
    inside that is not at rest at the last by itself, it begins at rest and swings on.
    Raises ConvergenceError where Newton finds no motion, from stiffer beams neither.
    """
    resting, stiffness = _find_by_continuation(horizon, swing=False)
    if resting is not None and (max(compute_end_speeds(resting)) <= RESTLESS or not find_swings(horizon, 1.0).count):
        return resting
    swinging, softest = _find_by_continuation(horizon, swing=True)
    if swinging is not None:
        return swinging
    if resting is not None:
        return resting  # what moves at its ends is judged where both of them are known
    stiffness = min(stiffness, softest)
    raise ConvergenceError(
        f"mechanism '{horizon.way.mesh.mechanism.name}': no bounded motion found whose frame on '{horizon.way.frame.name}' "
        f"follows the path, only with beams {stiffness:.3g} times as stiff "
        f"({describe_zeros(find_internal_rates(horizon, 0))}); give the "
        "path more time, a smaller step, or check the stiffness"
    )


def _find_by_continuation(horizon: Horizon, swing: bool) -> tuple[Trajectory | None, float]:
    """The motion, from stiffer beams where Newton does not find it at once, and how stiff they are in the last that is found.

    swing : whether what swings inside may swing on at the end of the window
    """
    stiffness = 1.0
    factor = STIFF ** (1 / 4)
    if (found := _run_newton(horizon, horizon.rigid, stiffness, swing)) is None:
        found = _run_newton(horizon, horizon.rigid, STIFF, swing)
        stiffness = STIFF
    while found is not None and stiffness > 1.0:
        target = max(1.0, stiffness / factor)
        if (softer := _run_newton(horizon, found[0], target, swing)) is not None:
            found = softer
            stiffness = target
        elif (factor := np.sqrt(factor)) < SMALLEST_FACTOR:
            break
    return (found[1], 1.0) if found is not None and stiffness == 1.0 else (None, stiffness)


def _run_newton(horizon: Horizon, at: NodePoses, stiffness: float, swing: bool) -> tuple[NodePoses, Trajectory] | None:
    """Newton's method on all instants; None where it does not converge."""
    swings = find_swings(horizon, stiffness) if swing else None
    for iteration in range(1, MOST_ITERATIONS + 1):
        try:
            now = horizon.evaluate(at, stiffness)
            if swings is not None and swings.count:
                at, y = take_step(horizon, at, now, swings)
            else:
                y = horizon.solve_increments(at, now)
        except (RotationTooLarge, np.linalg.LinAlgError):
            return None
        size = float(np.abs(y / horizon.layout.solver.topology.scale).max(initial=0.0))
        if not size < LOST:
            return None
        at = horizon.layout.apply_increments(at, y)
        if size < INCREMENT:
            trajectory = horizon.evaluate(at, stiffness, want=False).trajectory
            trajectory.iterations[:] = iteration
            return at, trajectory
    return None


def compute_end_speeds(trajectory: Trajectory) -> tuple[float, float]:
    """Return the speed just inside the start and the end of a window over the largest in it [-]: zero where it is long enough."""
    speed = np.abs(trajectory.motion.v).max(axis=(1, 2))
    first, last = speed[[1, -2]] / (float(speed.max()) or 1.0)
    return float(first), float(last)
