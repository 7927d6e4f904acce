"""Loops that do not close from where they are told to: the nearest that they come to it, and what the error says to do.

Newton fails for one of three reasons, which need three answers: another guess of the passive joints closes the loops; they close
only where the motion puts its joints elsewhere; or they close nowhere, since links are too short, or would have to bend.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from flexinv.constraints.closures import list_velocity_scales
from flexinv.constraints.joint_descriptions import write_start
from flexinv.errors import OpenLoops
from flexinv.kinematics.nodal_motion import integrate_configuration
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

if TYPE_CHECKING:
    from flexinv.constraints.continuation import Follower

# Guesses from which loops are closed where nothing is said of their joints.
TRIES = 20
# Damped least squares end after so many steps, or with a step that small [rad], [-]: the result is only where Newton begins.
MOST_STEPS = 60
SMALL_STEP = 1e-6
LONGEST_STEP = 0.5
# Of the largest diagonal entry: links in a row leave a direction without stiffness, which must not divide by zero.
LEAST_DAMPING = 1e-12
GIVE_Q = "give q, a configuration near one in which they close"


@contextmanager
def replace_advice(advice: str | Callable[[], str]) -> Iterator[None]:
    """Say another advice where loops do not close, for verbs and commands whose configuration is not called ``start``.

    advice : or a function that returns it, where it costs something
    """
    try:
        yield
    except OpenLoops as error:
        raise error.replace_advice(advice if isinstance(advice, str) else advice()) from None


def find_nearest_closed(follower: Follower, q: Array) -> Array:
    """Return q (nq,) [rad], [m] with loops as close to closed as the unknown coordinates bring them, by damped least squares."""
    m = follower.mesh.mechanism
    sizes = list_velocity_scales(follower.mesh)
    damping = 1e-3
    free = follower.unknown
    phi, g = follower.evaluate_closures(q)
    for _ in range(MOST_STEPS if free.any() else 0):
        a = g[:, free]
        step = np.zeros(m.nv)
        normal = a.T @ a
        normal[np.diag_indices_from(normal)] += damping * max(normal.diagonal().max(), np.finfo(float).tiny)
        step[free] = -np.linalg.solve(normal, a.T @ phi)
        step *= min(1.0, LONGEST_STEP / max(np.abs(step).max(), SMALL_STEP))
        tried = integrate_configuration(m, q, sizes * step)
        found, gradient = follower.evaluate_closures(tried)
        if not found @ found < phi @ phi:
            damping *= 8.0
            continue
        q = tried
        phi = found
        g = gradient
        damping = max(damping / 8.0, LEAST_DAMPING)
        if np.abs(step).max() < SMALL_STEP:
            break
    return q


def make_open_loops_error(follower: Follower, time: float, guess: Array) -> OpenLoops:
    """Return the error for loops that do not close from a guess (nq,) [rad], [m]: which stays open, why, and what to write."""
    m = follower.mesh.mechanism
    gap = _describe_largest_gap(follower, guess)
    said = f"mechanism '{m.name}', t = {time:g} s: the loops do not close from this start ({gap})"
    return OpenLoops(said, partial(_find_advice, follower, guess.copy()))


def _find_advice(follower: Follower, guess: Array) -> tuple[str, str]:
    """Advice for loops that do not close from a guess (nq,), and places of joints from which they close, or ""."""
    m = follower.mesh.mechanism
    unknown = follower.unknown
    unknown_joints = [joint.name for joint in m.joints if unknown[m.v_slices[joint.name]].any()]
    closed, nearest = _find_closed(follower, guess)
    if closed is not None:
        example = write_start(m, unknown_joints, closed, True)
        return f"give a guess of these joints from which they close: start = {example}", example
    every = follower.replace_unknown(np.ones_like(unknown))
    if not unknown.all():
        closed, nearest = _find_closed(every, guess)
    if closed is not None:
        return _describe_other_motion(m, unknown_joints, closed), ""
    bend = " unless links bend; a march begins with links unbent" if m.beams else ""
    gap = _describe_largest_gap(every, nearest)
    return (
        f"no guess of {TRIES + 1} closes them, with all joints free{bend}: at best {gap}; "
        "change lengths or placements of links by that much, or tie the two ends by a spring instead of a closure"
    ), ""


def _describe_other_motion(mechanism: Mechanism, unknown_joints: Sequence[str], closed: Array) -> str:
    """Advice for loops that close only with other places (nq,) of the moved joints; unknown_joints : all others."""
    held = [joint.name for joint in mechanism.moving_joints if joint.name not in unknown_joints]
    fewer = ", or give fewer coordinates a motion" if len(held) > 1 else ""
    return (
        f"where the motion puts {', '.join(held)} none of {TRIES + 1} guesses closes them; they close for example with "
        f"{write_start(mechanism, held, closed, True)}: begin the motion where they do{fewer}"
    )


def _find_closed(follower: Follower, guess: Array) -> tuple[Array | None, Array]:
    """A closed configuration (nq,) from the guess or random ones, None where none is found; and the nearest to closed."""
    m = follower.mesh.mechanism
    random = np.random.default_rng(1)
    nearest = guess
    least = np.inf
    sizes = np.where(follower.unknown, list_velocity_scales(follower.mesh), 0.0)
    for k in range(TRIES + 1):
        begin = guess if k == 0 else integrate_configuration(m, guess, sizes * random.uniform(-np.pi, np.pi, m.nv))
        near = find_nearest_closed(follower, begin)
        if (solution := follower.solve(near)) is not None:
            return solution, solution
        if (left := float(np.linalg.norm(follower.evaluate_closures(near)[0]))) < least:
            nearest = near
            least = left
    return None, nearest


def _describe_largest_gap(follower: Follower, q: Array) -> str:
    """The closure that is open most, and its gap."""
    phi = np.abs(follower.evaluate_closures(q)[0])
    rows = follower.rows
    worst = int(np.argmax(phi))
    name = follower.mesh.mechanism.closures[int(rows.closure[worst])].name
    is_coupling = bool(rows.gear[worst].any())
    size = 1.0 if rows.direction[worst] else float(rows.scale[worst])
    unit = "" if is_coupling else " rad" if rows.direction[worst] else " m"
    return f"closure '{name}' is open by {phi[worst] * size:.3g}{unit}"
