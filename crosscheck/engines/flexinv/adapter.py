"""flexinv itself, as one engine among the others: ``flexinv.solve`` on the samples of the case.

The error bars of a march come from two refinements of its step and two of its mesh (`crosscheck.measures.budget`); those of
closed formulas from rounding, as for every engine.
"""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from dataclasses import replace
from importlib import metadata

import numpy as np
from numpy.typing import NDArray

from crosscheck.engines.base import Options, beside, sample_times
from crosscheck.engines.flexinv.determinacy import find_determinate_parts
from crosscheck.measures.budget import Family, add_error_bars
from crosscheck.measures.record import (
    BudgetLine,
    Record,
    Series,
    make_internal_series,
    make_reaction_series,
    make_wrench_series,
    series,
    torque_series,
    vector_series,
)
from flexinv.analysis.solution import Solution
from flexinv.analysis.solve import solve
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import WORLD, Mechanism
from flexinv.parts.reductions import find_reduction

# Of the largest torque: closure forces cancel at passive joints up to rounding, which conditions of up to 1e6 enlarge.
ROUNDING = 1e-9
PARTS = ("step", "mesh")  # what is refined


# What this adapter offers beside (`crosscheck.engines.base`).
MESHES = True
certify = beside("crosscheck.engines.flexinv.certificate", "certify")


def version() -> str:
    """Return the version of flexinv."""
    try:
        return metadata.version("flexinv")
    except metadata.PackageNotFoundError:
        return "source tree"


def abilities() -> str:
    """Return one sentence: what flexinv can do here."""
    return (
        "Rigid, flexible and mixed trees with every joint kind: torques, joint wrenches, tips, deflections, internal "
        "forces, error bars by refinement, power and momentum balance."
    )


def unsupported(mechanism: Mechanism, case: Case, engine: str) -> str | None:
    """Return the reason why flexinv cannot do this case, or None."""
    return None


def run(mechanism: Mechanism, case: Case, engine: str, options: Options) -> Record:
    """Return torque and wrench [N], [N m], tip and deflection [m], axial and internal forces on the sample times.

    options : "error" False leaves the error bars of a march away (they take four more runs); "refinement" k takes steps and
    meshes 2^k times as fine [-], "finer_step" and "finer_mesh" k one of both
    """
    finer = {part: 2 ** (int(options.get("refinement", 0)) + int(options.get(f"finer_{part}", 0))) for part in PARTS}
    mechanism = apply_refinement(case.meshed(mechanism), finer["mesh"])
    case = replace(case, step=case.step / finer["step"])
    start = clock.perf_counter()
    solution, made = solve_case(mechanism, case)
    wall = clock.perf_counter() - start
    budget: Mapping[str, BudgetLine] = {}
    if bool(options.get("error", True)) and needs_integration(mechanism, case):
        made, budget = add_error_bars(made, run_refinements(mechanism, case, made))
    return Record(
        engine=engine,
        version=version(),
        settings=describe_settings(mechanism, solution),
        time=sample_times(case),
        series=made,
        wall_time=wall,
        budget=budget,
    )


def solve_case(mechanism: Mechanism, case: Case, finer: int = 1) -> tuple[Solution, dict[str, Series]]:
    """Return the solution with ``finer`` steps in one step of the case, and its series [N], [N m], [m] on the samples."""
    solution = solve(
        mechanism,
        case.motion,
        case.step / finer,
        end=case.end,
        spectral_radius=case.spectral_radius,
        initial=case.initial,
        start=case.start,
    )
    rows = slice(None, None, finer * round(case.sample / case.step))
    return solution, collect_series(mechanism, solution, rows)


def needs_integration(mechanism: Mechanism, case: Case) -> bool:
    """Return True if the case is integrated in time: with beams, or with joints that move freely in a tree."""
    if mechanism.closures or not mechanism.is_rigid:
        return not mechanism.is_rigid
    given = set(case.motion.joints(mechanism))
    return any(joint.nv and joint.name not in given for joint in mechanism.joints)


def run_refinements(mechanism: Mechanism, case: Case, made: Mapping[str, Series]) -> list[Family]:
    """Return the runs with half and a quarter of the step [s], and with two finer meshes: more order, or more elements.

    The error of higher orders falls faster than with any power of the mesh width; the differences of such runs shrink
    all the same by a factor from one to the next, and the first of them is nearly the whole error.
    """
    step = Family("step", (made, solve_case(mechanism, case, 2)[1], solve_case(mechanism, case, 4)[1]), 0)
    if mechanism.is_rigid:
        return [step]
    return [step, Family("mesh", (made, *(solve_case(apply_refinement(mechanism, k), case)[1] for k in (2, 4))), 0)]


def apply_refinement(mechanism: Mechanism, finer: int) -> Mechanism:
    """Return the mechanism with beams meshed so many times as fine [-]: more order, or more elements where the order is 1."""
    if mechanism.is_rigid or finer == 1:
        return mechanism
    linear = max((link.beam.order for link in mechanism.beams if link.beam is not None), default=0) == 1
    return mechanism.refined(elements=finer) if linear else mechanism.refined(order=finer)


def describe_settings(mechanism: Mechanism, solution: Solution) -> dict[str, object]:
    """Return the settings of the run, and the solution's own checks."""
    meshes = {link.name: f"{b.elements} x order {b.order}" for link in mechanism.links if (b := link.beam) is not None}
    for link in mechanism.meshed:
        assert link.part is not None
        reduced = find_reduction(link.part)
        meshes[link.name] = f"{len(reduced.points)} nodes, {len(reduced.modal_mass)} shapes"
    marched = {"Newton iterations per step": float(solution.iterations.mean())} if meshes else {}
    closed = (
        {"largest effort left at passive joints [N m], [N]": compute_residual_effort(solution)}
        if mechanism.closures
        else {}
    )
    elastic = np.abs(solution.torque_all - solution.reaction).max(initial=0.0)
    return {
        **solution.settings,
        **meshes,
        **marched,
        **closed,
        "largest difference of elastic reactions and L T P [N m], [N]": float(elastic),
        "largest power residual [W]": float(np.abs(solution.power_residual).max()),
        "largest momentum residual [N], [N m]": float(np.abs(solution.momentum_residual).max()),
    }


def collect_series(mechanism: Mechanism, solution: Solution, rows: slice) -> dict[str, Series]:
    """Return every series, in units of [N], [N m] and [m]; rows: which samples."""
    made = collect_torques(mechanism, solution, rows) | collect_shapes(mechanism, solution, rows)
    for link, tip in solution.tip.items():
        made |= vector_series(f"tip/{link}", "m", tip[rows])
    for link, deflection in solution.deflection.items():
        made |= vector_series(f"deflection/{link}", "m", deflection[rows])
    made |= collect_wrenches(mechanism, solution, rows)
    for joint in mechanism.joints:
        if mechanism.link_of[joint.child].beam is not None:
            made |= series(f"axial/{joint.child}", "N", solution.wrench[joint.name][rows, 0])
    for link, stations in solution.internal_stations.items():
        for k, station in enumerate(stations):
            made |= make_internal_series(link, f"{station:.4f}", solution.internal[link][rows, k])
    return made


def collect_wrenches(mechanism: Mechanism, solution: Solution, rows: slice) -> dict[str, Series]:
    """Return the wrenches of joints and, on its second frame, of every closure [N], [N m]: only determinate components."""
    if solution.loops is None:
        return {
            k: s for name, values in solution.wrench.items() for k, s in make_wrench_series(name, values[rows]).items()
        }
    sure = find_determinate_parts(solution.mesh, solution.nodes, solution.time)
    wrenches: dict[str, Series] = {}
    for name, values in solution.wrench.items():
        wrenches |= _take_determinate(make_wrench_series(name, values[rows]), sure.wrench[name])
    for closure in mechanism.closures:
        if closure.second.link == WORLD:
            continue  # there it is said at the first frame; a coupling has none
        values = solution.loops.reaction[closure.name][rows]
        wrenches |= _take_determinate(make_reaction_series(closure.name, values), sure.reaction[closure.name])
    return wrenches


def _take_determinate(six: dict[str, Series], sure: NDArray[np.bool_]) -> dict[str, Series]:
    return {name: one for (name, one), there in zip(six.items(), sure, strict=True) if there}


def collect_shapes(mechanism: Mechanism, solution: Solution, rows: slice) -> dict[str, Series]:
    """Return "shape/<link>/<place>/x", "y", "z" [m] in the world: nodes along a beam, the origin of other links.

    Of a meshed link its interfaces follow.

    They are drawn and not compared; the tip of every link, which is, follows them.
    """
    shapes: dict[str, Series] = {}
    mesh = solution.mesh
    parts = {link.name: link.part for link in mechanism.meshed if link.part is not None}
    for joint in mechanism.joints:
        name = joint.child
        places = {"origin": mesh.joint_node[joint.name]}
        if name in mesh.section_nodes:
            at = zip(mesh.section_stations[name], mesh.section_nodes[name], strict=True)
            places = {f"{station:.4f}": int(node) for station, node in at}
        elif name in parts:
            beside = [one.name for one in parts[name].moved if one.name != parts[name].tip]
            places |= {one: mesh.interface_node[(name, one)] for one in beside}
        for place, node in places.items():
            shapes |= vector_series(f"shape/{name}/{place}", "m", solution.nodes.x[rows, node])
    return shapes


def collect_torques(mechanism: Mechanism, solution: Solution, rows: slice) -> dict[str, Series]:
    """Return the effort of every coordinate [N m] or [N].

    Joints without a drive in loops give nothing; what rounding leaves there is not compared but in the settings.
    """
    effort = solution.torque_all[rows].copy()
    if mechanism.closures and compute_residual_effort(solution) <= ROUNDING * np.abs(effort).max():
        effort[:, ~mechanism.actuated] = 0.0
    return torque_series(mechanism, effort)


def compute_residual_effort(solution: Solution) -> float:
    """Return the largest effort at coordinates without a drive [N m], [N]."""
    return float(np.abs(solution.unactuated).max(initial=0.0))
