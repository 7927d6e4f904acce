"""Cost of flexinv's time integration: over elements, over threads, and in closed loops beside trees of the same size."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.flexible import SAMPLE
from benchmarks.targets import add_verdict, drop_metric, make_metric
from benchmarks.timing import Call, Times, compute_time_ratio, describe_disturbance, run_calls_in_turns
from flexinv.analysis.solution import Solution
from flexinv.analysis.solve import solve
from flexinv.analysis.solve_many import solve_many
from flexinv.files.load_cases import load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.kernels.threads.affinity import count_processors
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.rigid.prepare import prepare

EXPONENT = 1.05  # of the time over the number of elements
TWO_THREADS = 1.8  # times as fast as one
LEANING = 1e-5  # [m/s^2]: what makes a mechanism in a plane spatial, and changes nothing that matters
# times as long as the tree
LOOP_MARCH = 1.3
LOOP_RIGID = 2.0
LOOP_SAMPLES = 4096
RIGID_LOOPS = (
    "four_bar", "slider_crank", "five_bar", "five_bar_redundant", "geared_four_bar", "andrews_squeezer",
    "stewart_platform", "bricard",
)  # fmt: skip
SECONDS = 4.0
SCENARIOS = {"spatial_arm": 4, "flex_one_link": 8}  # short calls: processors are halves of a core for some of them only
MESHES = {1: (4, 8, 16, 32, 64, 128, 256), 4: (1, 2, 4, 8, 16, 32, 64)}

ELEMENTS_TEXT = f"""Time of the whole solve over the number of elements, steps of {SAMPLE:g} s. The exponent is that of the line
between the last two meshes: where the elements, not the steps' own work, take the time."""
ELEMENTS_COLUMNS = (
    ("arm", "arm", ""),
    ("order", "order", ""),
    ("elements", "elements per link", ""),
    ("time", "one step", "µs"),
    ("iterations", "Newton iterations", "per step"),
    ("exponent", "exponent", "-"),
    ("asked", "at most", "-"),
)
ELEMENTS_PLOT = {"x": "elements", "y": "time", "group": "curve", "log": True}
OTHER_TEXT = """Closed loops: the same mechanism with and without its closure, the passive joints free, over the whole motion; in
the plane, and with gravity leaning out of it by a millionth, which makes both spatial. Rigid loops: both are given the
consistent motion of all joints, by flexinv.solve with all that it returns, and by a prepared function that returns torques
alone; beside them the closed mechanism that finds its passive joints, of which nothing is asked. One thread.
Threads: solve_many with some scenarios, each a whole motion, on one thread and on two. Only compiled code runs side by side.
Scenarios that are alike, as the second's, march many in one compiled call; of a few milliseconds each, they are limited by the
memory that their series take, which threads share, and nothing is asked of them."""
OTHER_COLUMNS = (
    ("what", "what", ""),
    ("method", "method", ""),
    ("time", "time", "ms"),
    ("ratio", "ratio", "-"),
    ("asked", "asked", ""),
    ("message", "", ""),
)


def run_element_study(
    models: str, orders: dict[str, list[int]] | None = None, seconds: float = SECONDS
) -> dict[str, Any]:
    """Return the table over elements; times [us], exponents [-]."""
    rows = []
    for model, case, plane in (("flex_one_link", "cycloid", True), ("spatial_arm", "reach", False)):
        mechanism = replace(load_mechanism(Path(models) / model), gravity=np.zeros(3))
        motion = load_cases(Path(models) / model, mechanism)[case].motion
        for order, meshes in ({int(k): tuple(v) for k, v in orders.items()} if orders else MESHES).items():
            kept = meshes if plane else meshes[: max(2, len(meshes) - 2)]
            rows += _list_element_rows(model, mechanism, motion, order, kept, seconds)
    return {"text": ELEMENTS_TEXT, "columns": ELEMENTS_COLUMNS, "rows": rows, "plot": ELEMENTS_PLOT}


def _list_element_rows(
    model: str, mechanism: Mechanism, motion: Motion, order: int, meshes: tuple[int, ...], seconds: float
) -> list[dict[str, Any]]:
    end = 200 * SAMPLE
    meshed = {n: mechanism.with_mesh(n, order) for n in meshes}
    calls = {str(n): Call(lambda m=m: solve(m, motion, SAMPLE, end=end)) for n, m in meshed.items()}  # type: ignore[misc]
    times = run_calls_in_turns(calls, seconds)
    rows: list[dict[str, Any]] = []
    for n in meshes:
        iterations = float(solve(meshed[n], motion, SAMPLE, end=end).iterations.mean())
        taken = times[str(n)].compute_quartiles().median
        named = {"arm": model, "order": order, "elements": n, "curve": f"{model}, order {order}"}
        rows.append(named | {"time": 1e6 * taken * SAMPLE / end, "iterations": iterations})
    grown = compute_time_ratio(times[str(meshes[-1])], times[str(meshes[-2])]).median
    exponent = float(np.log(grown) / np.log(meshes[-1] / meshes[-2]))
    name = f"{model}, order {order}: exponent of the time over elements"
    rows[-1] |= {"exponent": exponent, "asked": EXPONENT, "metric": make_metric(name, exponent, "-", upper=EXPONENT)}
    return [add_verdict(row) for row in rows]


def run_loop_study(models: str, seconds: float = SECONDS) -> dict[str, Any]:
    """Return the table of closed loops and of threads; times [ms], ratios [-]."""
    folder = Path(models)
    rows = [
        *_list_flexible_loop_rows(folder, seconds),
        *_list_rigid_loop_rows(folder, seconds),
        *_list_thread_rows(folder, seconds),
    ]
    return {"text": OTHER_TEXT, "columns": OTHER_COLUMNS, "rows": rows}


def _list_flexible_loop_rows(folder: Path, seconds: float) -> list[dict[str, Any]]:
    """A four-bar with a coupler that bends: closed, cut in the plane, cut in space."""
    closed = load_mechanism(folder / "four_bar_flexible")
    case = load_cases(folder / "four_bar_flexible", closed)["turn"]
    tree = replace(closed, closures=())
    options: dict[str, Any] = {"step": SAMPLE, "start": case.start}
    rows = []
    for where, gravity in (("the plane", tree.gravity), ("space", tree.gravity + np.array([0.0, 0.0, LEANING]))):
        calls = {
            f"closed, in {where}": _make_march_call(replace(closed, gravity=gravity), case.motion, options),
            f"tree in {where}": _make_march_call(replace(tree, gravity=gravity), case.motion, options),
        }
        times = run_calls_in_turns(calls, seconds)
        rows += _compare_loop_with_tree(
            "four-bar with a flexible coupler", "march of a flexible loop", times, f"closed, in {where}", LOOP_MARCH
        )
    return rows


def _make_march_call(mechanism: Mechanism, motion: Motion, options: dict[str, Any]) -> Call:
    return Call(lambda: solve(mechanism, motion, **options))


def _list_rigid_loop_rows(folder: Path, seconds: float) -> list[dict[str, Any]]:
    """A five-bar and its tree, with the motion of all joints as the closed mechanism finds it."""
    closed = load_mechanism(folder / "five_bar")
    case = load_cases(folder / "five_bar", closed)["reach"]
    step = 1e-3
    solution = solve(closed, case.motion, step, start=case.start)
    given = Motion.from_samples(solution.time, solution.q, [joint.name for joint in closed.joints if joint.nv])
    tree = replace(closed, closures=())
    solved = {
        "closed, given": Call(lambda: solve(closed, given, step)),
        "closed, passive joints found": Call(lambda: solve(closed, case.motion, step, start=case.start)),
        "tree": Call(lambda: solve(tree, given, step)),
    }
    what = "rigid loop with a given motion"
    times = run_calls_in_turns(solved, seconds)
    rows = _compare_loop_with_tree("five-bar, solved", f"{what}, solved", times, "closed, given", LOOP_RIGID)
    own = compute_time_ratio(times["closed, passive joints found"], times["tree"])
    rows[1]["ratio"] = own.median
    for model in RIGID_LOOPS:
        rows += _list_prepared_loop_rows(folder, model, LOOP_RIGID, seconds)
    return rows


def _list_prepared_loop_rows(folder: Path, model: str, most: float, seconds: float) -> list[dict[str, Any]]:
    """A closed mechanism and its tree through prepared functions, coordinate-major."""
    closed = load_mechanism(folder / model)
    case = next(iter(load_cases(folder / model, closed).values()))
    solution = solve(closed, case.motion, case.end / (LOOP_SAMPLES - 1), start=case.start)
    calls = {
        name: _make_torque_call(m, solution)
        for name, m in (("closed, given", closed), ("tree", replace(closed, closures=())))
    }
    name = f"rigid loop with a given motion, {model}, torques"
    return _compare_loop_with_tree(
        f"{model}, prepared, {LOOP_SAMPLES} samples", name, run_calls_in_turns(calls, seconds), "closed, given", most
    )


def _make_torque_call(mechanism: Mechanism, motion: Solution) -> Call:
    function = prepare(mechanism, threads=1)
    q, qd, qdd = (np.ascontiguousarray(a.T) for a in (motion.q, motion.qd, motion.qdd))
    out = np.empty_like(qd)
    return Call(lambda: function.torques(q, qd, qdd, out=out, order="coordinates"))


def _compare_loop_with_tree(
    what: str, name: str, times: dict[str, Times], first: str, most: float | None
) -> list[dict[str, Any]]:
    """Rows of times, the trees' with how many times as long the closed mechanism takes."""
    rows = []
    for method, own in times.items():
        row: dict[str, Any] = {"what": what, "method": method, "time": 1e3 * own.compute_quartiles().median}
        if method.startswith("tree"):
            found = compute_time_ratio(times[first], own)
            one = make_metric(
                f"{name}: times as long as the {method}",
                found.median,
                "-",
                upper=most,
                spread=f"{found.low:.3g} .. {found.high:.3g}",
            )
            row |= {"ratio": found.median, "asked": f"at most {most:g}" if most else "nothing", "metric": one}
        rows.append(add_verdict(row))
    return rows


def _list_thread_rows(folder: Path, seconds: float) -> list[dict[str, Any]]:
    """The same scenarios on one thread and on two."""
    rows = []
    for model, case, step, asked in (
        ("spatial_arm", "reach", SAMPLE, TWO_THREADS),
        ("flex_one_link", "cycloid", SAMPLE / 2, None),
    ):
        mechanism = load_mechanism(folder / model)
        motion = load_cases(folder / model, mechanism)[case].motion
        counts = (1, 2) if count_processors() > 1 else (1,)
        scenarios = SCENARIOS[model]
        calls = {str(n): _make_scenario_call(mechanism, [motion] * scenarios, step, n) for n in counts}
        times = run_calls_in_turns(calls, 2 * seconds)  # long calls, of which a busy host spoils many
        for n in counts:
            row: dict[str, Any] = {"what": f"solve_many, {scenarios} times {model}", "method": f"{n} threads"}
            row["time"] = 1e3 * times[str(n)].compute_quartiles().median
            if n > 1:
                found = compute_time_ratio(times["1"], times[str(n)])
                message = describe_disturbance(times[str(n)])
                spread = f"{found.low:.3g} .. {found.high:.3g}"
                name = f"solve_many, {model}: times as fast with two threads"
                row |= {"asked": asked and f"at least {asked:g}"}
                row |= {
                    "ratio": found.median,
                    "metric": make_metric(name, found.median, "-", lower=asked, spread=spread),
                }
                row = drop_metric(row, "ratio", message) if message else row
            rows.append(add_verdict(row))
    return rows


def _make_scenario_call(mechanism: Mechanism, motions: list[Motion], step: float, threads: int) -> Call:
    return Call(lambda: solve_many(mechanism, motions, step, threads=threads).all(), threads)
