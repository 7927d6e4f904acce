"""follow: a path of a frame becomes joint torques, so that the deformed mechanism, not only a rigid one, follows it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexinv.analysis.evaluation import FirstStep, rigid_motion_of, solution_after
from flexinv.analysis.extrapolation import extrapolated, thinned, weights
from flexinv.analysis.settings import Settings
from flexinv.analysis.simulate import simulate
from flexinv.analysis.solution import Solution
from flexinv.analysis.solve import OF_STEPS, finer_meshes, scaled_difference, solve, with_bars
from flexinv.errors import InputError
from flexinv.inverse.applied_forces import applied_forces
from flexinv.kinematics.configuration_arrays import fill_passive
from flexinv.kinematics.mesh import Mesh, build
from flexinv.model.mechanism import Attachment, Mechanism
from flexinv.model.motion import Motion
from flexinv.tracking.collocation import Horizon, Layout, Task
from flexinv.tracking.frame_path import Path
from flexinv.tracking.inverse_kinematics import Frame, Reach, RigidWay, drive_columns, frame_of
from flexinv.tracking.stable_inversion import Inverse, internal_rates, invert, unrest
from flexinv.typing import Array
from flexinv.validation import choice, flag, of_kind, seconds

# Part of the motion inside that is left at the ends of a window that is chosen here, and that is refused in any.
LEFT, RESTLESS = 1e-6, 1e-2
# A rate whose real part is a smaller part of it swings: it has no end to wait for.
SWINGING = 1e-3
# More instants than this are a mistake in `step` or in the window far more often than a wish: a gigabyte of equations.
MOST_INSTANTS = 20_000
RIGID, JOINT_SPACE, INVERSION = "rigid", "joint space", "stable inversion"


@dataclass(frozen=True)
class Following:
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
    reach: Reach
    unrest: tuple[float, float]

    @cached_property
    def joint_space(self) -> Solution:
        """The joints on the rigid mechanism's motion, beams bending: the naive answer, by `solve` [m, rad, s, N, N m]."""
        if self.solution is self.rigid:
            return self.rigid
        return _joint_space(self.solution.mechanism, self.reach, self.time, float(self.time[1] - self.time[0]))

    @property
    def feed_forwards(self) -> dict[str, Solution]:
        """The three by name, from the simplest on [N m], [N]."""
        return {RIGID: self.rigid, JOINT_SPACE: self.joint_space, INVERSION: self.solution}

    def distance(self, solution: Solution) -> Array:
        """Return the distance of a solution's frame from its prescribed position, (samples,) [m]."""
        if len(of_kind("solution", solution, Solution).time) != len(self.time):
            raise InputError(f"solution has {len(solution.time)} samples, expected the {len(self.time)} of this path")
        return np.asarray(np.linalg.norm(self.frame.poses(solution.nodes).x - self.wanted, axis=1))

    def replay(self, name: str, spectral_radius: float = 0.8) -> Solution:
        """Return the motion that a feed-forward's torques give the flexible mechanism, by `simulate` [m, rad, s]."""
        choice(
            "name", name, {RIGID: "rigid beams", JOINT_SPACE: "beams bend", INVERSION: "the deformed frame on the path"}
        )
        torque, q = self.feed_forwards[name].torque, self.solution.q[0]
        m = self.solution.mechanism
        places = {j.name: q[m.q_slices[j.name]] for j in m.joints if j.nv}
        step = float(self.time[1] - self.time[0])
        return simulate(m, self.time, torque, step, spectral_radius, _initial(m), start=places)


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
    of_kind("mechanism", mechanism, Mechanism)
    of_kind("path", path, Path)
    error = flag("error", error)
    if accuracy is not None or step is None:
        from flexinv.accuracy.accurate import check_accuracy

        return _accurately(mechanism, path, frame, check_accuracy(accuracy, step), (before, after, start))
    mesh = build(mechanism)
    _check(mechanism)
    step = seconds("step", step, "a positive number of seconds, for example step=1e-3")
    way = RigidWay(mesh, frame_of(mesh, frame), path, start)
    time = _window(way, step, before, after)
    out = _beside_rigid(way, time)
    if _is_stiff(mechanism):
        return out
    out, first = _followed(out, mesh, step)
    if not error:
        return out
    return _with_error(out, first, path, frame, step, start)


def _followed(out: Following, mesh: Mesh, step: float) -> tuple[Following, FirstStep]:
    """The way of a mechanism that bends, from its way as if it were rigid; and its first step [m, rad, s, N]."""
    horizon = _horizon(out, mesh, step)
    found = invert(horizon)
    left, first = unrest(out.time, found), _first(horizon, found)
    _check_rest(horizon, left)
    return replace(out, solution=solution_after(mesh, first, _settings(step)), unrest=left), first


def _beside_rigid(way: RigidWay, time: Array) -> Following:
    """A path as if nothing bent: the answer of a rigid mechanism whose joints are all driven, and the guess of all others."""
    mesh, reach = way.mesh, way.reach(time)
    rigid = solution_after(
        mesh, rigid_motion_of(mesh, time, (reach.q, reach.qd, reach.qdd)), _settings(float(time[1] - time[0]))
    )
    return Following(way.path, way.frame, time, way.path.evaluate(time).x, rigid, rigid, reach, (0.0, 0.0))


def _is_stiff(mechanism: Mechanism) -> bool:
    return mechanism.is_rigid and all(j.actuated for j in mechanism.joints if j.nv)


def _horizon(of: Following, mesh: Mesh, step: float) -> Horizon:
    wanted = of.path.evaluate(of.time)
    return Horizon(Layout.of(mesh), Task(of.frame, wanted, of.reach, mesh.length, of.path.duration), of.time, step)


def _accurately(
    mechanism: Mechanism, path: Path, frame: str | Attachment, asked: float,
    window: tuple[float | None, float | None, Mapping[str, ArrayLike] | None],
) -> Following:  # fmt: skip
    """The path followed as exactly as was asked; instants of the coarsest step divide the path's time."""
    from flexinv.accuracy.accurate import accurate
    from flexinv.accuracy.refinement import Problem, Run
    from flexinv.accuracy.step_grid import FEWEST_IN_STRETCH, StepGrid

    coarsest, (before, after, start) = path.duration / FEWEST_IN_STRETCH, window
    _check(mechanism)
    mesh = build(mechanism)
    way = RigidWay(mesh, frame_of(mesh, frame), path, start)
    ends = _window(way, coarsest, before, after)
    left = []

    def run(meshed: Mechanism, steps: Array, _: tuple[int, ...], settings: Settings) -> Run:
        own = build(meshed)
        out = _beside_rigid(RigidWay(own, frame_of(own, frame), path, start), steps)
        horizon = _horizon(out, own, settings.step)
        found = invert(horizon)
        left.append((horizon, unrest(steps, found)))
        moves = {joint.name for joint in meshed.joints if joint.nv}
        return Run(own, _first(horizon, found), _settings(settings.step), moves)

    grid = StepGrid(ends[[0, -1]], (len(ends) - 1,))
    if _is_stiff(mechanism):
        return _beside_rigid(way, grid.steps(1))
    solution = accurate(Problem(mechanism, grid, run, _settings(coarsest), asked))
    _check_rest(*left[-1])
    out = _beside_rigid(RigidWay(solution.mesh, frame_of(solution.mesh, frame), path, start), solution.time)
    return replace(out, solution=solution, unrest=left[-1][1])


def _check(mechanism: Mechanism) -> None:
    drive_columns(mechanism)
    for what, items in (("closures", mechanism.closures), ("springs between points", mechanism.springs)):
        if items:
            raise InputError(
                f"mechanism '{mechanism.name}' has {what}: a path of a frame is followed by open mechanisms so far; "
                "give the joints a motion with solve instead"
            )


def _window(way: RigidWay, step: float, before: float | None, after: float | None) -> Array:
    """Instants (samples,) [s], 0 among them."""
    mesh, frame, path = way.mesh, way.frame, way.path
    for name, value in (("before", before), ("after", after)):
        seconds(name, 0.0 if value is None else value, "a time, 0 or more [s], or None to choose it here", zero=True)
    if step > path.duration / 4:
        raise InputError(
            f"step = {step:g} s is too long for a path of {path.duration:g} s: write step = {path.duration / 200:g}"
        )
    ends = np.array([0.0, path.duration])
    if before is None or after is None:
        reach = way.reach(ends)
        horizon = Horizon(
            Layout.of(mesh), Task(frame, path.evaluate(ends), reach, mesh.length, path.duration), ends, step
        )
        waits = [_fading(internal_rates(horizon, k)) for k in (0, -1)]
    first, last = (given if given is not None else waits[k] for k, given in enumerate((before, after)))
    count = np.ceil(np.array([first, path.duration + last]) / step * (1 - 1e-9))
    if count.sum() > MOST_INSTANTS:
        raise InputError(
            f"step = {step:g} s gives {count.sum():.0f} instants in {first + path.duration + last:.3g} s, "
            f"more than {MOST_INSTANTS}: write a larger step, or shorter before and after"
        )
    return np.asarray(step * np.arange(-max(count[0], 1), max(count[1], 1) + 1))


def _fading(rates: NDArray[np.complex128]) -> float:
    """Time [s] in which the slowest of the rates that fade has faded to LEFT; none where none does."""
    fading = rates.real[rates.real > SWINGING * np.abs(rates)]
    return float(-np.log(LEFT) / fading.min()) if len(fading) else 0.0


def _check_rest(horizon: Horizon, left: tuple[float, float]) -> None:
    ends = (-float(horizon.time[0]), float(horizon.time[-1]) - horizon.task.duration)
    for name, given, sample, rest in zip(("before", "after"), ends, (0, -1), left, strict=True):
        if rest <= RESTLESS:
            continue
        rates = internal_rates(horizon, sample)
        fades = _fading(rates)
        swings = rates.imag[(rates.real <= SWINGING * np.abs(rates)) & (rates.imag > 0)]
        if given < fades:
            advice = f"write {name} = {fades:.3g}, in which what moves inside fades"
        elif len(swings):
            advice = (
                f"inside something swings without end (slowest at {swings.min() / (2 * np.pi):.3g} Hz): give the path more time, "
                "law = 'nonic', or the joint without a drive damping"
            )
        else:
            advice = "give the path more time, or law = 'nonic'"
        raise InputError(
            f"{name} = {given:.3g} s: at that end of the window the mechanism should rest and moves at {rest:.1%} of its largest "
            f"speed; {advice}"
        )


def _joint_space(mechanism: Mechanism, reach: Reach, time: Array, step: float) -> Solution:
    driven = [j.name for j in mechanism.joints if j.nv and j.actuated]
    columns = {name: reach.q[:, mechanism.q_slices[name]] for name in driven}
    motion = Motion.from_samples(time - time[0], columns, rest=True)
    rest = {j.name: reach.q[0, mechanism.q_slices[j.name]] for j in mechanism.joints if j.nv and not j.actuated}
    # the end: rounding of the first time must not lose the last sample
    found = solve(mechanism, motion, step, end=float(time[-1] - time[0]), initial=_initial(mechanism), start=rest)
    return replace(found, time=time)


def _first(horizon: Horizon, found: Inverse) -> FirstStep:
    mesh = horizon.layout.solver.mesh
    m = mesh.mechanism
    q, qd, qdd = horizon.task.reach.q.copy(), np.zeros((len(horizon.time), m.nv)), np.zeros((len(horizon.time), m.nv))
    moves = {joint.name for joint in m.joints if joint.nv}
    fill_passive(mesh, found.trajectory.motion, moves, q, qd, qdd)
    found.trajectory.iterations[:] = found.iterations
    applied = applied_forces(mesh, found.trajectory.motion, horizon.time)
    return FirstStep(found.trajectory, horizon.time, (q, qd, qdd), applied, smooth=moves)


def _initial(mechanism: Mechanism) -> str:
    return "static" if np.any(mechanism.gravity) or mechanism.forces else "consistent"


def _settings(step: float) -> Settings:
    return Settings(float(step), spectral_radius=1.0, initial="static", tolerance=None)


def _with_error(
    out: Following, first: FirstStep, path: Path, frame: str | Attachment, step: float, start: Mapping[str, ArrayLike] | None
) -> Following:  # fmt: skip
    """The answer extrapolated from steps h and h/2, with error bars as in `solve`."""
    mechanism, rough, bars = out.solution.mechanism, out.solution, []

    def again(meshed: Mechanism, steps: Array, own: float) -> tuple[Following, FirstStep]:
        mesh = build(meshed)
        return _followed(_beside_rigid(RigidWay(mesh, frame_of(mesh, frame), path, start), steps), mesh, own)

    fine, half = again(mechanism, out.time[0] + step / 2 * np.arange(2 * len(out.time) - 1), step / 2)
    both = extrapolated(mechanism, [first, thinned(half, 2)], weights((1, 2)))
    better = solution_after(rough.mesh, both, _settings(step))
    bars.append(scaled_difference(rough, fine.solution, 2, OF_STEPS))
    for finer, factor in finer_meshes(mechanism):
        bars.append(scaled_difference(rough, again(finer, out.time, step)[0].solution, 1, factor))
    return replace(out, solution=with_bars(better, bars))
