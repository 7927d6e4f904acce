"""The library of a rigid mechanism: one kernel, and tables of bodies of which each leaves some of the terms out.

    tau = M(q) q'' + c(q, q') + g(q) + friction(q') + springs(q) + applied(q, q')

All terms but the last come from the recursion of `rnea.recursion`.  A table without gravity, dampers and springs gives
M q'' + c, one with nothing but masses and gravity gives g; masses of zero leave what the joints take.  The matrix M is the
efforts of unit accelerations, one a column.  Springs between points and given forces are a second kernel
(`dynamics.applied_wrenches`).

With closed loops the efforts of the cut tree, those of the applied forces among them, are shared out by the first kernel, as
`prepare` does; what that leaves to Python (a motion that may not keep the loops, a position near a singular one) is a status.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.dynamics.applied_wrenches import build_applied_loads, fill_applied_efforts, make_scratch
from flexinv.errors import InputError
from flexinv.export.acting_sets import ActingSet, format_acting_sets, has_phases, list_acting_sets
from flexinv.export.given_forces import format_forces, list_moved_forces
from flexinv.export.library_plan import BLOCK_HEADER, GoldenSeries, LibraryPlan
from flexinv.export.machine_code import Entry, KernelCall, add_entry
from flexinv.export.memory_image import WORD, MemoryImage, list_arrays
from flexinv.export.names import format_numbers
from flexinv.export.payload_nodes import PAYLOAD
from flexinv.export.rigid.closed_samples import list_closed_samples
from flexinv.export.rigid.placing import (
    LoopCalls,
    build_loaded_mesh,
    format_loops,
    format_placing,
    make_loop_calls,
    make_placing_call,
)
from flexinv.kernels.memory import LINE
from flexinv.kernels.simd import BLOCK
from flexinv.kernels.threads.worker_pool import CELLS
from flexinv.kinematics.configuration import build_nodes
from flexinv.kinematics.mesh import Mesh
from flexinv.model.mechanism import Mechanism
from flexinv.model.owned_cache import make_read_only
from flexinv.rigid.blocks import CALL_CELLS, compute_torque_blocks
from flexinv.rigid.prepare import TorqueFunction, prepare
from flexinv.rnea import recursion
from flexinv.rnea.body_table import Bodies, find_carrier_nodes
from flexinv.rnea.loop_plan import sample_configurations
from flexinv.typing import Array, Triple

# Which terms a table has: masses, gravity, rotors, dampers and dry friction, springs.
TABLES = {
    "ALL": (1.0, 1.0, 1.0, 1.0, 1.0),
    "INERTIA": (1.0, 0.0, 1.0, 0.0, 0.0),
    "GRAVITY": (1.0, 1.0, 0.0, 0.0, 0.0),
    "FRICTION": (0.0, 1.0, 0.0, 1.0, 0.0),  # what weighs nothing does not feel gravity, by which closures accelerate
    "SPRINGS": (0.0, 1.0, 0.0, 0.0, 1.0),
    "APPLIED": (0.0, 1.0, 0.0, 0.0, 0.0),  # what is given in another place alone
}
REPLAYED_SAMPLES = 5  # samples of the self-test
# Of the self-test, in parts of the largest effort: on this processor no digit differs; elsewhere sums fuse in another order, and
# the sines of another libm differ in the last digit.
RIGID_TOLERANCE = 1e-13
_LAW = recursion.BODY_LAW
_MASSES = slice(recursion.BODY_MASS, recursion.BODY_LAW)


@dataclass(frozen=True)
class _Part:
    """The part of a block that belongs to a set of closures: its function, tables of bodies, and the call of its kernel."""

    function: TorqueFunction
    tables: Array
    call: KernelCall


class _Room(NamedTuple):
    """Motion and efforts of one block of samples, and what kernels work in, the same for all sets of closures."""

    q: Array
    qd: Array
    qdd: Array
    tau: Array
    strides: NDArray[np.uint64]
    work: Array
    counter: NDArray[np.uint64]
    nobody: NDArray[np.uint64]


def plan_rigid_library(mechanism: Mechanism, prefix: str, guess: Array | None = None) -> LibraryPlan:
    """Return the library [N m], [N] of a rigid mechanism, whose names begin with ``prefix``.

    guess : (nq,) near which loops are closed for the self-test and the examples [rad], [m], by default the neutral position
    Raises InputError where loops are not closed near it.
    """
    sets = list_acting_sets(mechanism)
    parts = _list_parts([prepare(one.mechanism, threads=1) for one in sets], f"{prefix}_kernel_torques")
    function = parts[0].function
    payloads = np.zeros((len(parts), len(mechanism.links), 10))
    call = parts[0].call
    applied = _make_applied_call(function.mesh, call, f"{prefix}_kernel_applied")
    placed = make_placing_call(mechanism, call, f"{prefix}_kernel_place")
    torques = [part.call for part in parts]
    closing = _list_loop_calls(mechanism, sets, placed, f"{prefix}_kernel_loops")
    calls = [placed, *([applied] if applied else []), *_list_calls(closing)]
    arrays = [one for each in (*torques, *calls) for one in list_arrays(each.arguments)]
    image = MemoryImage(BLOCK_HEADER, [*arrays, *(part.tables for part in parts), payloads])
    entries = [add_entry(image, one) for one in (*torques, *calls)]
    values = _format_places(image, call, payloads) | _format_parts(image, parts, entries, closing)
    values |= _format_tables(mechanism) | _format_applied(image, entries[len(parts) + 1 :])
    values |= format_loops(image, build_loaded_mesh(mechanism), list(closing.values()))
    values["gravity_terms"] = "".join(_format_gravity_terms(image, part.function) for part in parts)
    values |= format_placing(image, mechanism, placed, prefix)
    changes, texts = _format_changes(image, function.mesh, mechanism, prefix)
    values |= texts
    golden = _make_series([part.function for part in parts], guess)
    return LibraryPlan(
        "rigid",
        mechanism,
        entries,
        image,
        values,
        golden,
        ("links", "bodies", "rigid", "placed", "poses", *_list_readings(mechanism), *changes),
        golden.q[0] if mechanism.closures else None,
    )


def _list_readings(mechanism: Mechanism) -> list[str]:
    """Templates of what trees have beside torques, or loops."""
    if mechanism.closures:
        return ["turned", "wrenches", "loops"]
    return ["turned", "wrenches", "tree", *(["applied"] if mechanism.springs or mechanism.forces else [])]


def _format_changes(
    image: MemoryImage, mesh: Mesh, mechanism: Mechanism, prefix: str
) -> tuple[list[str], dict[str, str]]:
    """Templates and texts of what a program changes beside parameters: closures that act, and given forces."""
    parts = list[str]()
    texts = dict[str, str]()
    if has_phases(mechanism):
        parts.append("phases")
        texts |= format_acting_sets(mechanism, prefix)
    if list_moved_forces(mesh):
        parts.append("forces")
        texts |= format_forces(image, mesh, [build_applied_loads(mesh).forces.wrench], prefix)
    return parts, texts


def _list_parts(functions: Sequence[TorqueFunction], name: str) -> list[_Part]:
    """The part of each set of closures, beside the room that all of them share."""
    room = _make_room(functions)
    parts = list[_Part]()
    for k, function in enumerate(functions):
        tables: Array = make_read_only(
            np.stack([_make_table(function.bodies.numbers, *terms) for terms in TABLES.values()])
        )
        call = _make_block_call(function, tables[0], f"{name}_{k}" if k else name, room)
        parts.append(_Part(function, tables, call))
    return parts


def _list_loop_calls(
    mechanism: Mechanism, sets: Sequence[ActingSet], placed: KernelCall, name: str
) -> dict[int, LoopCalls]:
    """Number of each set that has closures -> the calls that add what they do to wrenches at joints."""
    return {
        k: make_loop_calls(mechanism, placed, one.acting, f"{name}_{k}" if k else name)
        for k, one in enumerate(sets)
        if one.acting.any()
    }


def _list_calls(closing: Mapping[int, LoopCalls]) -> list[KernelCall]:
    """Return all calls, set by set."""
    return [call for calls in closing.values() for call in calls[:3]]


def _format_parts(
    image: MemoryImage, parts: Sequence[_Part], entries: Sequence[Entry], closing: Mapping[int, LoopCalls]
) -> dict[str, str]:
    """Tables of what differs from one set of closures to the other, a row each."""
    rows = list[str]()
    links = list[str]()
    rates = list[str]()
    for k, (part, entry) in enumerate(zip(parts, entries, strict=False)):
        function = part.function
        samples = entry.find_argument(10)
        numbers = entry.find_argument(1) + 4 * WORD
        places = f"{samples}, {numbers}, {image.find_place(part.tables)}"
        closes = [one.name for one in closing[k][:3]] if k in closing else 3 * ["NULL"]
        width = image.find_place(closing[k].sample.width) if k in closing else 0
        sizes = f"{len(function.bodies.tree)}, {int(bool(function.loops))}"
        rows.append(f"    {{{part.call.name}, {', '.join(closes)}, {places}, {width}, {sizes}}}")
        links.append("{\n" + ",\n".join(_format_links(function.mesh, function.bodies)) + "\n}")
        rates.append("{" + ", ".join(map(str, _find_bodies_of_rates(function.mesh, function.bodies))) + "}")
    return {
        "phase_count": str(len(parts)), "phases": ",\n".join(rows), "links": ", ".join(links), "body_of_rate": ", ".join(rates),
    }  # fmt: skip


def _format_places(image: MemoryImage, torques: KernelCall, payloads: Array) -> dict[str, str]:
    """Places in the block of what the C file writes and reads."""
    q, qd, qdd, tau = (image.find_place(one) for one in torques.arguments[5:9])
    places = {
        "at_q": q, "at_qd": qd, "at_qdd": qdd, "at_tau": tau, "at_counter": image.find_place(torques.arguments[12]),
        "at_payloads": image.find_place(payloads),
    }  # fmt: skip
    return {name: str(place) for name, place in places.items()}


def _format_tables(mechanism: Mechanism) -> dict[str, str]:
    """Sizes of the tables of bodies, and the terms of the torques in words."""
    terms = ["M(q) qdd", "coriolis(q, qd)", "gravity(q)", "friction(qd)", "springs(q)"]
    terms += ["applied(q, qd)"] if mechanism.springs or mechanism.forces else []
    sizes = {
        "block": BLOCK, "columns": int(recursion.NUMBERS), "mass_column": recursion.BODY_MASS, "law_column": _LAW,
        "loops": int(bool(mechanism.closures)),
    }  # fmt: skip
    return {name: str(size) for name, size in sizes.items()} | {
        "tables": ", ".join(f"TABLE_{name}" for name in TABLES),
        "sum": f"`tau = {' + '.join(terms)}`",
        "neutral": format_numbers(mechanism.neutral),
    }


def _format_applied(image: MemoryImage, entries: Sequence[Entry]) -> dict[str, str]:
    """Places of the efforts against springs between points and given forces, and of their number of samples; 0 without them."""
    if not entries or entries[0].call.kernel is not fill_applied_efforts:
        return {"applied": "0", "at_applied": "0", "at_applied_samples": "0"}
    at = image.find_place(entries[0].call.arguments[-1])
    return {"applied": "1", "at_applied": str(at), "at_applied_samples": str(entries[0].find_argument(4))}


def _make_applied_call(mesh: Mesh, torques: KernelCall, name: str) -> KernelCall | None:
    """The call for springs between points and given forces of the samples of a block, None where there are none."""
    m = mesh.mechanism
    if not (m.springs or m.forces):
        return None
    widths = m.nq, m.nv, m.nv
    motion = tuple(one.reshape(BLOCK, width) for one, width in zip(torques.arguments[5:8], widths, strict=True))
    out = np.zeros((BLOCK, m.nv))
    system = build_nodes(mesh), build_applied_loads(mesh)
    return KernelCall(name, fill_applied_efforts, (*system, motion, make_scratch(mesh), 1, out))


def _make_room(functions: Sequence[TorqueFunction]) -> _Room:
    """Room for the motion and the efforts of one block of samples, and for the work of any of these functions."""
    m = functions[0].mechanism
    q, qd, qdd = make_read_only(tuple(np.zeros(BLOCK * width) for width in (m.nq, m.nv, m.nv)))
    strides = np.array([(m.nq, 1), *[(m.nv, 1)] * 3], dtype=np.uint64)
    size = max(max(one.bodies.size, one.plan.size) for one in functions)
    counter = np.zeros(CALL_CELLS + 1, dtype=np.uint64)
    nobody = np.zeros((0, CELLS), dtype=np.uint64)
    return _Room(q, qd, qdd, np.zeros(BLOCK * m.nv), strides, np.zeros((1, size + -size % LINE)), counter, nobody)


def _make_block_call(function: TorqueFunction, numbers: Array, name: str, room: _Room) -> KernelCall:
    """The call of one block of samples, with room for its motion and efforts."""
    b = function.bodies
    system = b.tree, numbers, b.columns, function.plan.plan, function.plan.fixed
    return KernelCall(
        name, compute_torque_blocks, (*system, *room[:5], np.uint64(1), room.work, room.counter, room.nobody)
    )


def _make_table(numbers: Array, mass: float, gravity: float, rotor: float, loss: float, spring: float) -> Array:
    """A table of bodies with each of these terms, or without it."""
    table = numbers.copy()
    table[0, :3] *= gravity
    table[1:, _MASSES] *= mass
    table[1:, _LAW : _LAW + 4] *= (rotor, loss, loss, spring)
    return table


def _format_links(mesh: Mesh, bodies: Bodies) -> Iterator[str]:
    """The body that carries each link, the node of its payload, and R [-], x [m] of its frame in the body's, as C has them."""
    carrier, turn, place = find_carrier_nodes(mesh)
    number = {int(node): i for i, node in enumerate(bodies.node)}
    loaded = build_loaded_mesh(mesh.mechanism)
    above = {joint.child: mesh.joint_node[joint.name] for joint in mesh.mechanism.joints}
    for link in mesh.mechanism.links:
        n = above[link.name]
        body = number[int(carrier[n])]
        axes = bodies.axes[body].T
        placement = f"{{{format_numbers((axes @ turn[n]).ravel())}}}, {{{format_numbers(axes @ place[n])}}}"
        yield f"    {{{body}, {loaded.body_node[link.name, PAYLOAD]}, {placement}}}"


def _find_bodies_of_rates(mesh: Mesh, bodies: Bodies) -> list[int]:
    """The body that each rate moves."""
    found = [0] * mesh.mechanism.nv
    for body, node in enumerate(bodies.node[1:], start=1):
        first = mesh.v_index[node]
        found[first : first + mesh.freedoms[node]] = [body] * int(mesh.freedoms[node])
    return found


def _make_series(functions: Sequence[TorqueFunction], guess: Array | None) -> GoldenSeries:
    """Samples of each set of closures, those near which a later one is not closed left out."""
    series = list[GoldenSeries]()
    phase = list[int]()
    for k, function in enumerate(functions):
        if not function.mechanism.closures:
            series.append(_make_sample_series(function))
        elif (found := _make_closed_series(function, guess)) is not None:
            series.append(found)
        elif k == 0:
            where = "near zero coordinates" if guess is None else "near start"
            raise InputError(
                f"export: the loops of mechanism {function.mechanism.name!r} are not closed {where}, away from singular "
                "positions; write start = a position near which they close (--start)"
            )
        else:
            continue
        phase += [k] * len(series[-1].q)
    q, qd, qdd, tau = (np.concatenate([getattr(one, name) for one in series]) for name in ("q", "qd", "qdd", "tau"))
    return GoldenSeries(q, qd, qdd, tau, RIGID_TOLERANCE, tuple(phase))


def _make_sample_series(function: TorqueFunction) -> GoldenSeries:
    """Samples of joints that stand and move anyhow, the same ones every time."""
    m = function.mechanism
    q = sample_configurations(m, REPLAYED_SAMPLES)
    qd, qdd = np.random.default_rng(2).uniform(-1.0, 1.0, (2, REPLAYED_SAMPLES, m.nv))
    return GoldenSeries(q, qd, qdd, function.torques(q, qd, qdd), RIGID_TOLERANCE)


def _make_closed_series(function: TorqueFunction, guess: Array | None) -> GoldenSeries | None:
    """Samples of closed loops around a guess (nq,), of which nothing is in doubt: else the library would refuse them."""
    m = function.mechanism
    samples = []
    efforts = []
    for sample in list_closed_samples(function.mesh, m.neutral if guess is None else guess):
        if _is_refused(function, sample):
            continue
        samples.append(sample)
        efforts.append(function.torques(*sample))
        if len(samples) == REPLAYED_SAMPLES:
            break
    if not samples:
        return None
    q, qd, qdd = (np.array(part) for part in zip(*samples, strict=True))
    return GoldenSeries(q, qd, qdd, np.array(efforts), RIGID_TOLERANCE)


def _is_refused(function: TorqueFunction, sample: Triple) -> bool:
    """Return True [-] for a sample q (nq,), qd, qdd (nv,) of which the kernel is in doubt, so that the library refuses it."""
    arguments = list(_make_block_call(function, function.bodies.numbers, "", _make_room([function])).arguments)
    arguments[5:8] = (make_read_only(np.array(part)) for part in sample)
    compute_torque_blocks(*arguments)
    return bool(arguments[12][1:4].any())


def _format_gravity_terms(image: MemoryImage, function: TorqueFunction) -> str:
    """Numbers of the loops' plan that gravity is in: where they stand, what they are without it, and by how much of x, y, z.

    Where a closure ends in the world that accelerates by -g, as the recursion has it.
    """
    if not function.mechanism.closures:
        return ""
    directions = np.vstack([np.zeros(3), np.eye(3)])
    plans = [prepare(replace(function.mechanism, gravity=g), threads=1).plan for g in directions]
    assert all(np.array_equal(one.plan, function.plan.plan) for one in plans)
    without, *along = (one.fixed for one in plans)
    slopes = np.array(along) - without
    first = image.find_place(function.plan.fixed)
    rows = [
        f"    {{{first + WORD * k}, {format_numbers(without[k : k + 1])}, {{{format_numbers(slopes[:, k])}}}}},\n"
        for k in np.flatnonzero(slopes.any(axis=0)).tolist()
    ]
    return "".join(rows)
