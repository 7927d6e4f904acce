"""Torques of many samples: flexinv beside Pinocchio in a loop and over threads, and MuJoCo, on the same motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from benchmarks.engines import open_calls
from benchmarks.targets import add_verdict, compute_required_speed, drop_metric, make_metric
from benchmarks.timing import Call, Spread, Times, compute_time_ratio, describe_disturbance, run_calls_in_turns
from crosscheck.studies.robot_sweep import LARGEST_ERROR, remove_damping, sample_states
from flexinv.files.load_mechanism import load_mechanism
from flexinv.kernels.threads.affinity import count_processors
from flexinv.model.mechanism import Mechanism
from flexinv.rigid.prepare import prepare
from flexinv.typing import Array

Order = Literal["coordinates", "samples"]
State = tuple[Array, Array, Array]
ROBOTS = ("ur5", "panda", "talos")
SAMPLES = (100, 1_000, 4_096, 32_768, 131_072)
IN_A_LOOP = 1_000  # samples that loops in Python go over, at most: each of them takes as long as the others
SECONDS = 1.5  # for each size of one robot, by which every call gets some ten repetitions or more
ORDERS: tuple[Order, ...] = ("coordinates", "samples")

TEXT = f"""Random states, the same for all. "By coordinate" is an array (coordinates, samples), in which one coordinate of all
samples lies together; "by sample" one (samples, coordinates). Pinocchio's matrices are in the order that it likes best, and
both write into arrays that are there. Loops in Python go over {IN_A_LOOP} samples. Torques differ by at most
{LARGEST_ERROR:g} of the largest, or nothing is timed.

Faster: how many times as long rneaInParallel takes with as many threads. A native loop in C++ was not built here: the
wheel's rneaInParallel with one thread is Pinocchio's own loop in C++, compiled for any processor."""

COLUMNS = (
    ("robot", "robot", ""),
    ("samples", "samples", ""),
    ("method", "method", ""),
    ("threads", "threads", ""),
    ("time", "one sample", "ns"),
    ("quartiles", "quartiles", "ns"),
    ("faster", "faster than rneaInParallel", "-"),
    ("asked", "asked", "-"),
    ("difference", "torques differ by", "of the largest"),
    ("message", "", ""),
)
PLOT = {"x": "samples", "y": "time", "group": "curve", "log": True}


def find_required_ratio(samples: int, order: Order) -> float | None:
    """Return the demanded ratio of flexinv's speed to rneaInParallel's [-], at equal threads; None: nothing is demanded."""
    if samples >= 32_768:
        return compute_required_speed(20.0 if order == "coordinates" else 15.0)
    return (
        compute_required_speed(15.0) if samples >= 4_096 else compute_required_speed(10.0) if samples >= 1_000 else None
    )


def run_study(
    models: str, robots: list[str] | None = None, samples: list[int] | None = None, seconds: float = SECONDS
) -> Any:
    """Return the table: times [ns] by robot, number of samples and method."""
    rows = []
    for robot in robots or ROBOTS:
        mechanism = remove_damping(load_mechanism(Path(models) / robot))
        for count in samples or SAMPLES:
            rows += list_robot_rows(robot, mechanism, count, seconds)
    return {"text": TEXT, "columns": COLUMNS, "rows": rows, "plot": PLOT}


def list_robot_rows(robot: str, mechanism: Mechanism, samples: int, seconds: float) -> list[dict[str, Any]]:
    """Return the rows of one robot and one number of samples, torques compared before they are timed; seconds [s]."""
    state = sample_states(mechanism, samples, np.random.default_rng(samples))
    calls = {}
    differences = {}
    for name, (call, torque, per) in prepare_methods(mechanism, state).items():
        calls[name] = call
        differences[name] = (torque(), per)
    reference, _ = differences[("rneaInParallel", 1)]
    largest = np.abs(reference).max()
    apart = {name: float(np.abs(tau - reference[: len(tau)]).max() / largest) for name, (tau, _) in differences.items()}
    named = {" ".join(map(str, name)): call for name, call in calls.items()}
    if max(apart.values()) > LARGEST_ERROR:
        return [
            _make_deviation_row(robot, samples, name, value) for name, value in apart.items() if value > LARGEST_ERROR
        ]
    times = run_calls_in_turns(named, seconds)
    rows = []
    for (method, threads), (_, per) in differences.items():
        own = times[f"{method} {threads}"]
        row = _make_row(robot, samples, method, threads, own, per) | {"difference": apart[method, threads]}
        beside = times[f"rneaInParallel {threads}"]
        message = describe_disturbance(own, beside)
        if method.startswith("flexinv"):
            row |= _judge_speed(robot, samples, method, threads, compute_time_ratio(beside, own))
            row = drop_metric(row, "faster", message) if message else row
        elif message:
            row |= {"verdict": "skipped", "message": message}
        rows.append(add_verdict(row))
    return rows


def _make_row(robot: str, samples: int, method: str, threads: int, times: Times, per: int) -> dict[str, Any]:
    spread = times.compute_quartiles()
    return {
        "robot": robot,
        "samples": samples,
        "method": method,
        "threads": threads,
        "time": 1e9 * spread.median / per,
        "quartiles": f"{1e9 * spread.low / per:.4g} .. {1e9 * spread.high / per:.4g}",
        "curve": f"{robot} {method}, {threads} thread{'s' * (threads > 1)}",
    }


def _judge_speed(robot: str, samples: int, method: str, threads: int, found: Spread) -> dict[str, Any]:
    order: Order = "coordinates" if "coordinate" in method else "samples"
    name = f"{robot}: times as fast as rneaInParallel, {samples} samples by {order[:-1]}, {threads} thread{'s' * (threads > 1)}"
    spread = f"{found.low:.3g} .. {found.high:.3g}"
    limit = find_required_ratio(samples, order)
    return {
        "faster": found.median,
        "asked": limit,
        "metric": make_metric(name, found.median, "-", lower=limit, spread=spread),
    }


def _make_deviation_row(robot: str, samples: int, name: tuple[str, int], apart: float) -> dict[str, Any]:
    return {"robot": robot, "samples": samples, "method": name[0], "threads": name[1], "difference": apart} | {
        "verdict": "deviation",
        "curve": robot,
    }


Work = tuple[Callable[[], Array], Callable[[Array], Array]]
Method = tuple[Call, Callable[[], Array], int]


def prepare_methods(mechanism: Mechanism, state: State) -> Mapping[tuple[str, int], Method]:
    """Return by name and threads: the call, what gives its torques (samples, nv) [N m], and its number of samples."""
    pinocchio = open_calls("pinocchio")
    mujoco = open_calls("mujoco")
    few: State = (state[0][:IN_A_LOOP], state[1][:IN_A_LOOP], state[2][:IN_A_LOOP])
    methods: dict[tuple[str, int], Method] = {}
    counts = sorted({1, min(2, count_processors())})
    for threads in counts:
        for order in ORDERS:
            methods[f"flexinv by {order[:-1]}", threads] = _make_flexinv_method(mechanism, state, order, threads)
        methods["rneaInParallel", threads] = _make_method(
            pinocchio.prepare_parallel(mechanism, *state, threads), len(state[0]), threads
        )
    methods["pin.rnea in a loop", 1] = _make_method(pinocchio.prepare_loop(mechanism, *few), len(few[0]))
    methods["mj_inverse in a loop", 1] = _make_method(mujoco.prepare_loop(mechanism, *few), len(few[0]))
    return methods


def _make_method(work: Work, samples: int, threads: int = 1) -> Method:
    run, said = work
    return Call(run, threads), lambda: said(run()), samples


def _make_flexinv_method(mechanism: Mechanism, state: State, order: Order, threads: int) -> Method:
    function = prepare(mechanism, passive=False, threads=threads)
    q, qd, qdd = (np.ascontiguousarray(part.T if order == "coordinates" else part) for part in state)
    out = np.empty_like(qd)

    def run() -> Array:
        return function.torques(q, qd, qdd, out, order)

    return Call(run, threads), lambda: run().T if order == "coordinates" else run(), len(state[0])
