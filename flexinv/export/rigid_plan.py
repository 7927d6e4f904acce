"""The library of a rigid tree: one kernel, and tables of bodies of which each leaves some of the terms out.

    tau = M(q) q'' + c(q, q') + g(q) + friction(q') + springs(q)

All terms come from the recursion of `rnea.recursion`.  A table without gravity, dampers and springs gives M q'' + c, one with
nothing but masses and gravity gives g; masses of zero leave what the joints take.  The matrix M is the efforts of unit
accelerations, one a column.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flexinv.export.library_plan import BLOCK_HEADER, GoldenSeries, LibraryPlan, refuse_parts
from flexinv.export.machine_code import KernelCall, add_entry
from flexinv.export.memory_image import WORD, MemoryImage, list_arrays
from flexinv.export.names import format_numbers
from flexinv.kernels.simd import BLOCK
from flexinv.kernels.threads.worker_pool import CELLS
from flexinv.kinematics.mesh import Mesh
from flexinv.model.mechanism import Mechanism
from flexinv.model.owned_cache import make_read_only
from flexinv.rigid.blocks import CALL_CELLS, compute_torque_blocks
from flexinv.rigid.prepare import TorqueFunction, prepare
from flexinv.rnea import recursion
from flexinv.rnea.body_table import Bodies, find_carrier_nodes
from flexinv.rnea.loop_plan import sample_configurations
from flexinv.typing import Array

# Which terms a table has: masses, gravity, rotors, dampers and dry friction, springs.
TABLES = {
    "ALL": (1.0, 1.0, 1.0, 1.0, 1.0),
    "INERTIA": (1.0, 0.0, 1.0, 0.0, 0.0),
    "GRAVITY": (1.0, 1.0, 0.0, 0.0, 0.0),
    "FRICTION": (0.0, 0.0, 0.0, 1.0, 0.0),
    "SPRINGS": (0.0, 0.0, 0.0, 0.0, 1.0),
}
REPLAYED_SAMPLES = 5  # samples of the self-test
# Of the self-test, in parts of the largest effort: on this processor no digit differs; elsewhere sums fuse in another order, and
# the sines of another libm differ in the last digit.
RIGID_TOLERANCE = 1e-13
_LAW = recursion.BODY_LAW
_MASSES = slice(recursion.BODY_MASS, recursion.BODY_LAW)


def plan_rigid_library(mechanism: Mechanism, prefix: str) -> LibraryPlan:
    """Return the library [N m], [N] of a rigid tree, whose names begin with ``prefix``; InputError where none can be made."""
    parts = {"closures": mechanism.closures, "springs between points": mechanism.springs, "forces": mechanism.forces}
    refuse_parts(mechanism, parts, "flexinv.prepare(mechanism)")
    function = prepare(mechanism, threads=1)
    bodies = function.bodies
    tables: Array = make_read_only(np.stack([_make_table(bodies.numbers, *terms) for terms in TABLES.values()]))
    payloads = np.zeros((len(mechanism.links), 10))
    call = _make_block_call(function, tables[0], f"{prefix}_kernel_torques")
    image = MemoryImage(BLOCK_HEADER, [*list_arrays(call.arguments), tables, payloads])
    entry = add_entry(image, call)
    q, qd, qdd, tau = (image.find_place(one) for one in call.arguments[5:9])
    values = {
        "block": BLOCK, "at_q": q, "at_qd": qd, "at_qdd": qdd, "at_tau": tau,
        "at_samples": entry.find_argument(10), "at_counter": image.find_place(call.arguments[12]),
        "at_numbers": entry.find_argument(1) + 4 * WORD, "at_tables": image.find_place(tables),
        "at_payloads": image.find_place(payloads), "bodies": len(bodies.tree), "columns": int(recursion.NUMBERS),
        "mass_column": recursion.BODY_MASS, "law_column": _LAW,
        "tables": ", ".join(f"TABLE_{name}" for name in TABLES),
    }  # fmt: skip
    texts = {
        "neutral": format_numbers(mechanism.neutral),
        "links": ",\n".join(_format_links(function.mesh, bodies)),
        "body_of_rate": ", ".join(map(str, _find_bodies_of_rates(function.mesh, bodies))),
    }
    written = {name: str(value) for name, value in values.items()} | texts
    return LibraryPlan("rigid", mechanism, [entry], image, written, _make_sample_series(function))


def _make_block_call(function: TorqueFunction, numbers: Array, name: str) -> KernelCall:
    """The call of one block of samples, with room for its motion and efforts."""
    m = function.mechanism
    b = function.bodies
    q, qd, qdd = make_read_only(tuple(np.zeros(BLOCK * width) for width in (m.nq, m.nv, m.nv)))
    strides = np.array([(m.nq, 1), *[(m.nv, 1)] * 3], dtype=np.uint64)
    counter = np.zeros(CALL_CELLS + 1, dtype=np.uint64)
    nobody = np.zeros((0, CELLS), dtype=np.uint64)
    system = b.tree, numbers, b.columns, function.plan.plan, function.plan.fixed
    series = q, qd, qdd, np.zeros(BLOCK * m.nv), strides, np.uint64(1)
    return KernelCall(
        name, compute_torque_blocks, (*system, *series, np.zeros((1, b.size + -b.size % 8)), counter, nobody)
    )


def _make_table(numbers: Array, mass: float, gravity: float, rotor: float, loss: float, spring: float) -> Array:
    """A table of bodies with each of these terms, or without it."""
    table = numbers.copy()
    table[0, :3] *= gravity
    table[1:, _MASSES] *= mass
    table[1:, _LAW : _LAW + 4] *= (rotor, loss, loss, spring)
    return table


def _format_links(mesh: Mesh, bodies: Bodies) -> Iterator[str]:
    """The body that carries each link, and R [-], x [m] of the link's frame in the body's, as initialisers of C."""
    carrier, turn, place = find_carrier_nodes(mesh)
    number = {int(node): i for i, node in enumerate(bodies.node)}
    above = {joint.child: mesh.joint_node[joint.name] for joint in mesh.mechanism.joints}
    for link in mesh.mechanism.links:
        n = above[link.name]
        body = number[int(carrier[n])]
        axes = bodies.axes[body].T
        yield f"    {{{body}, {{{format_numbers((axes @ turn[n]).ravel())}}}, {{{format_numbers(axes @ place[n])}}}}}"


def _find_bodies_of_rates(mesh: Mesh, bodies: Bodies) -> list[int]:
    """The body that each rate moves."""
    found = [0] * mesh.mechanism.nv
    for body, node in enumerate(bodies.node[1:], start=1):
        first = mesh.v_index[node]
        found[first : first + mesh.freedoms[node]] = [body] * int(mesh.freedoms[node])
    return found


def _make_sample_series(function: TorqueFunction) -> GoldenSeries:
    """Samples of joints that stand and move anyhow, the same ones every time."""
    m = function.mechanism
    q = sample_configurations(m, REPLAYED_SAMPLES)
    qd, qdd = np.random.default_rng(2).uniform(-1.0, 1.0, (2, REPLAYED_SAMPLES, m.nv))
    return GoldenSeries(q, qd, qdd, function.torques(q, qd, qdd), RIGID_TOLERANCE)
