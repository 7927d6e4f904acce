"""flexinv itself, as one engine among the others: ``flexinv.solve`` on the samples of the case.

The error bars of torque and tip come from flexinv's own refinements (half the step, a finer mesh).
"""

from __future__ import annotations

import time as clock
from importlib import metadata

import numpy as np

from crosscheck.engines.base import Options, sample_times
from crosscheck.record import (
    Record,
    Series,
    internal_series,
    reaction_series,
    series,
    torque_series,
    vector_series,
    wrench_series,
)
from flexinv.determinate import determinate
from flexinv.files.case import Case
from flexinv.mechanism import WORLD, Mechanism
from flexinv.scheme import solve
from flexinv.solution import Solution

# Of the largest torque: closure forces cancel at passive joints up to rounding, which conditions of up to 1e6 enlarge.
ROUNDING = 1e-9


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
    """Return why flexinv cannot do this case, or None."""
    return None


def run(mechanism: Mechanism, case: Case, engine: str, options: Options) -> Record:
    """Return torque and wrench [N], [N m], tip and deflection [m], axial and internal forces on the sample times.

    options : "error" False leaves the error bars away (they take two more runs; of rigid mechanisms there are none:
        closed formulas have no step and no mesh)
    """
    time = sample_times(case)
    mechanism = case.meshed(mechanism)
    start = clock.perf_counter()
    solution = solve(
        mechanism,
        case.motion,
        case.step,
        error=bool(options.get("error", True)) and not mechanism.is_rigid,
        end=case.end,
        spectral_radius=case.spectral_radius,
        initial=case.initial,
        start=case.start,
    )
    wall = clock.perf_counter() - start
    stride = round(case.sample / case.step)
    rows = slice(None, None, stride)
    return Record(
        engine=engine,
        version=version(),
        settings=settings(mechanism, solution),
        time=time,
        series=all_series(mechanism, solution, rows),
        wall_time=wall,
    )


def settings(mechanism: Mechanism, solution: Solution) -> dict[str, object]:
    """Return what was used, and what the solution says of itself."""
    meshes = {link.name: f"{b.elements} x order {b.order}" for link in mechanism.links if (b := link.beam) is not None}
    marched = {"Newton iterations per step": float(solution.iterations.mean())} if meshes else {}
    closed = {"largest effort left at passive joints [N m], [N]": left_over(solution)} if mechanism.closures else {}
    return {
        **solution.settings,
        **meshes,
        **marched,
        **closed,
        "largest power residual [W]": float(np.abs(solution.power_residual).max()),
        "largest momentum residual [N], [N m]": float(np.abs(solution.momentum_residual).max()),
    }


def all_series(mechanism: Mechanism, solution: Solution, rows: slice) -> dict[str, Series]:
    """Return every series, in units of [N], [N m] and [m]; rows: which samples."""
    made = torques(mechanism, solution, rows)
    for link, tip in solution.tip.items():
        made |= vector_series(f"tip/{link}", "m", tip[rows], tip_bars(solution, link, rows))
    for link, deflection in solution.deflection.items():
        made |= vector_series(f"deflection/{link}", "m", deflection[rows])
    for name, wrench in solution.wrench.items():
        made |= wrench_series(name, wrench[rows])
    made |= reactions(mechanism, solution, rows)
    for joint in mechanism.joints:
        if mechanism.link_of[joint.child].beam is not None:
            made |= series(f"axial/{joint.child}", "N", solution.wrench[joint.name][rows, 0])
    for link, stations in solution.internal_stations.items():
        for k, station in enumerate(stations):
            made |= internal_series(link, f"{station:.4f}", solution.internal[link][rows, k])
    return made


def reactions(mechanism: Mechanism, solution: Solution, rows: slice) -> dict[str, Series]:
    """Return the wrench of every closure on its second frame [N], [N m]: the components that are determinate, no others."""
    if solution.loops is None:
        return {}
    sure = determinate(solution.mesh, solution.nodes, solution.time)
    made: dict[str, Series] = {}
    for closure in mechanism.closures:
        wrench = solution.loops.reaction[closure.name][rows]
        if closure.second.link == WORLD:
            continue  # there it is said at the first frame
        all_six = reaction_series(closure.name, wrench)
        made |= {name: one for (name, one), there in zip(all_six.items(), sure[closure.name], strict=True) if there}
    return made


def torques(mechanism: Mechanism, solution: Solution, rows: slice) -> dict[str, Series]:
    """Return the effort of every coordinate [N m] or [N], with error bars where there is an actuator.

    Joints without a drive in loops give nothing; what rounding leaves there is not compared but in the settings.
    """
    effort = solution.torque_all[rows].copy()
    if mechanism.closures and left_over(solution) <= ROUNDING * np.abs(effort).max():
        effort[:, ~mechanism.actuated] = 0.0
    made = torque_series(mechanism, effort)
    if solution.torque_error is not None:
        for k, name in enumerate(solution.torque_names):
            one = made[f"torque/{name}"]
            made |= series(one.name, one.unit, one.values, solution.torque_error[rows, k])
    return made


def left_over(solution: Solution) -> float:
    """Return the largest effort at coordinates without a drive [N m], [N]."""
    return float(np.abs(solution.unactuated).max(initial=0.0))


def tip_bars(solution: Solution, link: str, rows: slice) -> np.ndarray | None:
    """Return the error bar of a tip's three coordinates [m], the same for each, or None."""
    if solution.tip_error is None:
        return None
    bars: np.ndarray = np.repeat(solution.tip_error[link][rows, None], 3, axis=1)
    return bars
