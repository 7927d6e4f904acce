"""Starts of closed loops: values stated of the joints are kept as the loops close, or an error names what contradicts them.

Coordinates are moved onto the closures set by set, from those of which nothing was stated to all; the first set that closes the
loops and keeps what was stated is taken.  Rates follow in the same order, G qd = 0.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexinv.constraints.allocation import STILL_RATE, count_ranks
from flexinv.constraints.closures import Rows, build_constraint_rows, find_acting_closures, list_velocity_scales
from flexinv.constraints.continuation import Follower, build_start_follower, close_rates, solve_closed_start
from flexinv.constraints.joint_descriptions import (
    find_owner,
    find_place,
    write_numbers,
    write_start,
    write_unit,
    write_value,
)
from flexinv.constraints.open_loops import TRIES, find_nearest_closed
from flexinv.errors import ConvergenceError, InputError
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import (
    compute_nearest_difference,
    integrate_configuration,
    list_sliding_coordinates,
)
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Joint, Mechanism
from flexinv.model.owned_cache import make_owner_cache
from flexinv.typing import Array, Mask, Triple

# Where a motion decides where joints are, a start picks the branch.  A joint found further from it than this [rad], a slide than
# half of this times the mechanism's length, is on another branch, or the start is a slip of the pen.
ANOTHER_BRANCH = 1.0
# Closer than this the branch is the one that was meant: branches that lie so close meet in a dead point nearby.
SAME_BRANCH = 0.1
# Where nothing but the start decides it is kept, but for what people round away: two decimals, half a degree.
TYPED_DIGITS = 0.01
# Rates of passive joints that were found on a deformed mechanism belong to other places than those of the undeformed one, where
# the loops are closed: they may be off by this part of the largest rate.
SAGGED = 0.5
# How far places lie from which freedoms are counted [rad], of the length: far enough for singular values to be no rounding.
AWAY = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5)
CLOSED_PLACES = 4  # closed ones that are looked at where the loops do not close near what is stated


@dataclass(frozen=True)
class StatedStart:
    """Known values of a start: q (nq,), qd, qdd (nv,) [rad or m, s] with zeros or guesses where nothing is stated.

    places, rates : (nv,) what is stated; passive : (nv,) coordinates of joints without a drive, or that no motion gives
    place : how far passive joints may be from what is stated [rad], of the length; rate : the same of the largest rate [-]
    """

    q: Array
    qd: Array
    qdd: Array
    places: Mask
    rates: Mask
    passive: Mask
    place: float = TYPED_DIGITS
    rate: float = TYPED_DIGITS

    def compute_deviations(self, off: Array) -> tuple[float, float, float]:
        """Return by how much drives, and all joints, are further off than they may be, and how far they are (nv,) [-]."""
        drives = np.where(self.passive, 0.0, off).max(initial=0.0)
        all_ = off.max(initial=0.0)
        return max(drives / TYPED_DIGITS - 1.0, 0.0), max(all_ / self.place - 1.0, 0.0), all_

    def list_movable_sets(self, stated: Mask) -> list[Mask]:
        """Return masks (nv,) of the coordinates that may move, in the order in which they are tried [-]."""
        order = (self.passive & ~stated, ~stated, self.passive, ~stated | self.passive, np.ones_like(stated))
        return [one for k, one in enumerate(order) if not any((one == other).all() for other in order[:k])]


def find_consistent_start(mesh: Mesh, start: StatedStart, rows: Rows, time: float) -> Triple:
    """Return q (nq,), qd, qdd (nv,) [rad or m, s] on the closures ``rows`` at a time [s], with all that is stated.
    Raises InputError where the closures contradict what is stated, ConvergenceError where the loops do not close.
    """
    sets = start.list_movable_sets(start.places)
    if (q := _find_configuration(mesh, start, rows, sets)) is None:
        Follower(mesh, rows, sets[-1]).find_start(time, start.q)  # says which closure stays open
        raise AssertionError("the loops close from the start")
    off = compute_start_offset(mesh, start.places, start.q, q)
    if start.compute_deviations(off)[:2] != (0.0, 0.0):
        raise _make_contradiction_error(mesh, "start", start.places, start.q, q, off, time)
    qd = start.qd.copy()
    qdd = start.qdd.copy()
    close_rates(mesh, rows, q, qd, qdd, start.list_movable_sets(start.rates), orders=(1,))
    check_rates(mesh, start.rates, start.qd, qd, time, start.rate)
    close_rates(mesh, rows, q, qd, qdd, start.list_movable_sets(np.zeros_like(start.rates)), orders=(2,))
    return q, qd, qdd


def check_static(mesh: Mesh, start: StatedStart, begun: Array, rate: Array, q: Array, qd: Array, time: float) -> None:
    """Raise InputError unless what is stated is where the loops were closed unbent, or where beams have come to rest.

    begun (nq,), rate (nv,) : unbent; q (nq,), qd (nv,) : at rest under gravity and loads [rad], [m], [1/s]
    """
    off = np.minimum(*(compute_start_offset(mesh, start.places, start.q, one) for one in (begun, q)))
    if off.max(initial=0.0) > TYPED_DIGITS:
        raise _make_contradiction_error(mesh, "start", start.places, start.q, q, off, time)
    nearer = np.where(np.abs(rate - start.qd) < np.abs(qd - start.qd), rate, qd)
    check_rates(mesh, start.rates, start.qd, nearer, time)


def compute_start_offset(mesh: Mesh, stated: Mask, guess: Array, q: Array) -> Array:
    """Return the distance of q from a guess (nq,) where that is stated, else 0, (nv,) [rad], of the mechanism's length."""
    return np.where(
        stated, np.abs(compute_nearest_difference(mesh.mechanism, guess, q)) / list_velocity_scales(mesh), 0.0
    )


def _find_configuration(mesh: Mesh, start: StatedStart, rows: Rows, sets: Sequence[Mask]) -> Array | None:
    """The closed configuration (nq,) that keeps what is stated, or comes nearest to it.

    Newton sets out from the start, and from where what is not stated has been brought as close to closed as it can be; where that
    keeps not all, one joint after the other is held alone.
    """
    best: tuple[tuple[float, float, float], Array] | None = None
    for held, free in _list_attempts(mesh, start, rows, sets):
        if (q := Follower(mesh, rows, free).solve(held)) is None:
            continue
        q = convert_to_nearest_turn(mesh.mechanism, start.q, q)
        missed = start.compute_deviations(compute_start_offset(mesh, start.places, start.q, q))
        if best is None or missed < best[0]:
            best = missed, q
        if missed[:2] == (0.0, 0.0):
            break
    return None if best is None else best[1]


def _list_attempts(mesh: Mesh, start: StatedStart, rows: Rows, sets: Sequence[Mask]) -> Iterator[tuple[Array, Mask]]:
    """Return the start of Newton's iteration (nq,), and which coordinates (nv,) it moves."""
    m = mesh.mechanism
    every = sets[-1]
    follower = Follower(mesh, rows, every)
    for k, free in enumerate(sets):
        yield start.q, free
        if k == 0:
            held = find_nearest_closed(replace(follower, unknown=every & ~start.places), start.q)
        yield held, free
    for joint in m.joints:
        mask = build_joint_mask(m, {joint.name}) & start.places & start.passive
        if mask.any():
            moves = (start.passive | ~start.places) & every
            yield find_nearest_closed(replace(follower, unknown=moves & ~mask), start.q), moves


def convert_to_nearest_turn(mechanism: Mechanism, guess: Array, q: Array) -> Array:
    """Return q (nq,) [rad], [m] with joints that turn within half a turn of a guess (nq,), but for those in couplings."""
    out = q.copy()
    geared = {name for c in mechanism.closures for name, _ in c.factors}
    for joint in mechanism.joints:
        kind = KINDS[joint.kind]
        if kind.repeats and not kind.circle and joint.name not in geared:
            columns = mechanism.q_slices[joint.name]
            out[columns] -= 2 * np.pi * np.round((q[columns] - guess[columns]) / (2 * np.pi))
    return out


@make_owner_cache()
def find_picked_start(
    mesh: Mesh, time: float, passive: Mask, stated: Mask, q: Array, qd: Array, qdd: Array
) -> Array | None:
    """Return the closed q (nq,) [rad], [m] on the branch that a start picks, None where Newton finds it from there.

    passive : (nv,) coordinates that no motion gives, at their start if it is stated; q, qd, qdd : of all joints at a time [s]
    """
    rows = build_constraint_rows(mesh).take_active(find_acting_closures(mesh.mechanism, time))
    stated_start = StatedStart(
        q, qd, qdd, places=stated & passive, rates=np.zeros_like(stated), passive=passive, place=SAME_BRANCH
    )
    follower = Follower(mesh, rows, passive)
    if follower.find_closed_state(q, qd, qdd) is None and follower.solve(q) is None:
        return _find_configuration(mesh, stated_start, rows, [passive])
    plain = solve_closed_start(mesh, (q, qd, qdd), time, passive, rows)[0]
    near = convert_to_nearest_turn(mesh.mechanism, q, plain)
    if compute_start_offset(mesh, stated_start.places, q, plain).max(initial=0.0) <= SAME_BRANCH:
        return None if np.allclose(near, plain, rtol=0.0, atol=ANOTHER_BRANCH) else near
    return _find_configuration(mesh, stated_start, rows, [passive])


def find_closed_at(mesh: Mesh, q: Array, drives_move: bool = False) -> Array:
    """Return the configuration (nq,) [rad], [m] closed at t = 0 with drives at q (nq,), and of those the nearest to q.

    drives_move : where the joints without drives cannot close the loops (there may be none), drives do, by what is rounded away
    Raises InputError where drives would have to move further; q as it is where nothing closes and drives stay.
    """
    m = mesh.mechanism
    rest = np.zeros(mesh.mechanism.nv)
    follower = build_start_follower(mesh)
    passive = build_joint_mask(m, {j.name for j in m.joints if not j.actuated})
    every = follower.unknown
    stated_start = StatedStart(q, rest, rest, places=every, rates=~every, passive=passive, place=SAME_BRANCH)
    if (
        configuration := _find_configuration(
            mesh, stated_start, follower.rows, [passive, every] if drives_move else [passive]
        )
    ) is None:
        return follower.find_start(0.0, q) if drives_move else q
    off = compute_start_offset(mesh, ~passive, q, configuration)
    if off.max(initial=0.0) > TYPED_DIGITS:
        raise _make_contradiction_error(mesh, "q", ~passive, q, configuration, off, 0.0)
    return configuration


def find_closed_anywhere(mesh: Mesh, q: Array) -> Array:
    """Return a configuration (nq,) [rad], [m] closed at t = 0: near q, or where joints stand anywhere.

    Of several places the one whose closures are of the largest rank: which of them Newton finds first, rounding decides, and a
    folded loop says nothing of the mechanism.
    Raises ConvergenceError, which names the closure that stays open.
    """
    m = mesh.mechanism
    random = np.random.default_rng(1)
    follower = build_start_follower(mesh)
    near = follower.solve(q)
    if near is not None:
        return near
    found: list[Array] = []
    for _ in range(TRIES):
        place = follower.solve(
            find_nearest_closed(
                follower, integrate_configuration(m, q, list_velocity_scales(mesh) * random.uniform(-1.0, 1.0, m.nv))
            )
        )
        found += [place] if place is not None else []
        if len(found) == CLOSED_PLACES:
            break
    if not found:
        return follower.find_start(0.0, q)
    return max(
        found, key=lambda place: int(count_ranks(np.linalg.svd(follower.evaluate_closures(place)[1], compute_uv=False)))
    )


def list_closed_nearby(mesh: Mesh, q: Array) -> list[Array]:
    """Return closed configurations (nq,) [rad], [m] to which a mechanism can move from a closed one, in no special direction."""
    m = mesh.mechanism
    random = np.random.default_rng(1)
    follower = build_start_follower(mesh)
    closed_nearby = []
    _, values, right = np.linalg.svd(follower.evaluate_closures(q)[1])
    allowed = right[int(count_ranks(values)) if len(values) else 0 :]
    for size in AWAY if len(allowed) else ():
        along = allowed.T @ random.normal(size=len(allowed))
        step = size * list_velocity_scales(mesh) * along / np.abs(along).max()
        if (place := follower.solve(integrate_configuration(m, q, step))) is not None:
            closed_nearby.append(place)
    return closed_nearby


def check_branch(mesh: Mesh, names: Collection[str], guess: Array, q: Array) -> None:
    """Raise ConvergenceError unless the joints ``names``, whose start was stated, are found near their guess (nq,) [rad], [m]."""
    m = mesh.mechanism
    off = compute_start_offset(mesh, build_joint_mask(m, names), guess, q)
    most = np.where(list_sliding_coordinates(m), 0.5 * ANOTHER_BRANCH, ANOTHER_BRANCH)
    worst = int(np.argmax(off / most)) if off.size else 0
    if off.size and not off[worst] <= most[worst]:
        raise ConvergenceError(
            f"mechanism '{m.name}', t = 0 s: the loops close on another branch: "
            f"{_describe_distance(find_owner(m, worst), m, guess, q)}; "
            "give starts of the passive joints that belong together, start = {...}; nearest is "
            + write_start(m, [j.name for j in m.joints if j.name in names], q, places=True)
        )


def check_rates(mesh: Mesh, stated: Mask, given: Array, qd: Array, time: float, most: float = TYPED_DIGITS) -> None:
    """Raise InputError where rates qd (nv,) [rad or m, s] are not the ``stated`` ones (nv,) of ``given`` (nv,).

    most : how far they may be from them, over the largest [-]
    """
    m = mesh.mechanism
    unit = list_velocity_scales(mesh)
    off = np.where(stated, np.abs(qd - given) / unit, 0.0)
    # a pendulum of the mechanism's length tells slow from fast
    still = STILL_RATE * max(1.0, float(np.sqrt(np.linalg.norm(m.gravity) / mesh.length)))
    if not off.max(initial=0.0) <= still + most * np.abs(np.where(stated, given, 0.0) / unit).max(initial=0.0):
        raise _make_contradiction_error(mesh, "start_rate", stated, given, qd, off, time)


def build_joint_mask(mechanism: Mechanism, names: Collection[str]) -> Mask:
    """Return a mask (nv,) [-] of the velocity coordinates of the named joints."""
    return np.array([j.name in names for j in mechanism.joints for _ in range(j.nv)], dtype=bool)


# ------------------------------------------------------------------------------------------------- what errors say


def _make_contradiction_error(
    mesh: Mesh, argument: str, stated: Mask, given: Array, values: Array, off: Array, time: float
) -> InputError:
    """The error for values ``given`` by an argument that the closures contradict: they are ``off`` (nv,) what is ``values``."""
    m = mesh.mechanism
    places = argument != "start_rate"
    worst = find_owner(m, int(np.argmax(off))).name
    names = [j.name for j in m.joints if stated[m.v_slices[j.name]].any()]
    kept = [n for n in names if n != worst and (not places or off[m.v_slices[n]].max(initial=0.0) <= TYPED_DIGITS)]
    others = ", ".join(f"{name} = {write_value(m, name, given, places)}" for name in kept)
    follow = " into its places" if argument == "q" else ", or leave out the joints that shall follow"
    return InputError(
        f"mechanism '{m.name}', t = {time:g} s: {argument} of joint '{worst}' is {write_value(m, worst, given, places)}, the "
        f"closures give {write_value(m, worst, values, places)}{f' with {others}' if others else ''}; write "
        f"{argument}={write_start(m, names, values, places)}{follow}"
    )


def _describe_distance(joint: Joint, mechanism: Mechanism, guess: Array, q: Array) -> str:
    """Return the position of a joint and its distance from its start, in words."""
    columns = mechanism.q_slices[joint.name]
    kind = KINDS[joint.kind]
    a = find_place(joint, guess[columns])
    b = find_place(joint, q[columns])
    d = compute_nearest_difference(mechanism, guess, q)[mechanism.v_slices[joint.name]]
    if kind.scalar and not any(kind.translations):
        start, now, off = np.degrees([part[int(np.argmax(np.abs(d)))] for part in (a, b, d)])
        return f"joint '{joint.name}' at {now:.1f} deg, {abs(off):.0f} deg from its start of {start:.1f} deg"
    unit = write_unit(joint, places=True)
    away = f"{write_numbers(np.abs(d))} from its start of {write_numbers(a)} {unit}"
    return f"joint '{joint.name}' at {write_numbers(b)} {unit}, {away}"
