"""One sample at a time, the first call of a fresh process, and chains of more and more joints."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.engines import open_calls
from benchmarks.rigid import ROBOTS
from benchmarks.targets import add_verdict, make_metric
from benchmarks.timing import Call, Times, compute_time_ratio, run_calls_in_turns
from crosscheck.studies.robot_sweep import remove_damping, sample_states
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Body, Inertia, Joint, Link, Mechanism, Placement
from flexinv.rigid.prepare import prepare

ONE_SAMPLE = 5.0  # [us] for one sample through a prepared handle
FIRST_CALL = 1.0  # [s] for the first call of a fresh process whose machine code is there
JOINTS = (1, 2, 4, 8, 16, 32, 64)
CHAIN_SAMPLES = 4_096
STARTS = 3  # fresh processes; the fastest counts, as starting is what the system does, too
SECONDS = 1.0

TEXT = f"""One sample: through a prepared function (flexinv.prepare), which writes into an array that is there, beside pin.rnea
and mj_inverse. First call: a fresh process imports flexinv, reads a robot and computes the torques of one sample; the machine
code has been kept by a process before it. It is the processor's time, which does not count waiting for others, in the fastest
of {STARTS} processes."""
COLUMNS = (
    ("what", "what", ""),
    ("method", "method", ""),
    ("time", "time", "µs"),
    ("quartiles", "quartiles", "µs"),
    ("asked", "at most", "µs"),
)
CHAIN_TEXT = f"""Chains of revolute joints, each turned against the one before; {CHAIN_SAMPLES} samples by coordinate,
one thread."""
CHAIN_COLUMNS = (
    ("joints", "joints", ""),
    ("method", "method", ""),
    ("time", "one sample", "ns"),
    ("per_joint", "one sample and joint", "ns"),
    ("faster", "faster than rneaInParallel", "-"),
)
CHAIN_PLOT = {"x": "joints", "y": "time", "group": "method", "log": True}
FRESH = """
import json, sys
from time import process_time
start = process_time()
import numpy as np, flexinv
imported = process_time()
robot = flexinv.load_mechanism(sys.argv[1])
read = process_time()
zero = np.zeros((1, robot.nv))
flexinv.joint_torques(robot, np.zeros((1, robot.nq)), zero, zero)
print(json.dumps([imported - start, read - imported, process_time() - read]))
"""


def run_study(models: str, robots: list[str] | None = None, seconds: float = SECONDS) -> dict[str, Any]:
    """Return the table of single samples and of the first call; times [us]."""
    rows = []
    for robot in robots or ROBOTS:
        rows += _list_single_sample_rows(robot, remove_damping(load_mechanism(Path(models) / robot)), seconds)
    return {"text": TEXT, "columns": COLUMNS, "rows": [*rows, *_list_first_call_rows(Path(models) / "ur5")]}


def _list_single_sample_rows(robot: str, mechanism: Mechanism, seconds: float) -> list[dict[str, Any]]:
    pinocchio = open_calls("pinocchio")
    mujoco = open_calls("mujoco")
    state = sample_states(mechanism, 1, np.random.default_rng(1))
    q, qd, qdd = (np.ascontiguousarray(part[0]) for part in state)
    function = prepare(mechanism, passive=False)
    out = np.empty(mechanism.nv)
    calls = {
        "flexinv, prepared": Call(lambda: function.sample(q, qd, qdd, out)),
        "pin.rnea": Call(pinocchio.prepare_loop(mechanism, *state)[0]),
        "mj_inverse": Call(mujoco.prepare_loop(mechanism, *state)[0]),
    }
    rows = []
    for method, times in run_calls_in_turns(calls, seconds).items():
        row = _make_row(f"{robot}, one sample", method, times)
        if method.startswith("flexinv"):
            name = f"{robot}: one sample through a prepared function"
            row |= {"asked": ONE_SAMPLE, "metric": make_metric(name, row["time"], "us", upper=ONE_SAMPLE)}
        rows.append(add_verdict(row))
    return rows


def _make_row(what: str, method: str, times: Times) -> dict[str, Any]:
    s = times.compute_quartiles()
    quartiles = f"{1e6 * s.low:.3g} .. {1e6 * s.high:.3g}"
    return {"what": what, "method": method, "time": 1e6 * s.median, "quartiles": quartiles}


def _list_first_call_rows(model: Path) -> list[dict[str, Any]]:
    """One start that keeps the machine code, then some that find it."""
    command = [sys.executable, "-c", FRESH, str(model.resolve())]
    parts = []
    for _ in range(1 + STARTS):
        done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2])
        parts.append(json.loads(done.stdout))
    imported, read, computed = min(parts[1:], key=sum)
    total = imported + read + computed
    named = {"what": f"{model.name}, first call in a fresh process"}
    rows = [
        named | {"method": method, "time": 1e6 * value}
        for method, value in (("importing", imported), ("reading", read), ("torques", computed))
    ]
    one = make_metric("first call in a fresh process", total, "s", upper=FIRST_CALL)
    rows.append(named | {"method": "all of it", "time": 1e6 * total, "asked": 1e6 * FIRST_CALL, "metric": one})
    return [add_verdict(row) for row in rows]


# ------------------------------------------------------------------------------------------------------------ chains


def build_rod_chain(joints: int) -> Mechanism:
    """Return a chain of rods of 0.3 m and 1 kg [-], every joint turned by 90 degrees against the one before."""
    rod = Body("rod", Inertia(1.0, np.array([0.15, 0.0, 0.0]), np.diag([1e-4, 7.5e-3, 7.5e-3])))
    turned = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    placement = Placement(np.array([0.3, 0.0, 0.0]), turned)
    links = tuple(Link(f"rod{k}", (rod,)) for k in range(joints))
    made = tuple(
        Joint(
            f"joint{k}",
            "revolute",
            "world" if k == 0 else f"rod{k - 1}",
            f"rod{k}",
            Placement() if k == 0 else placement,
        )
        for k in range(joints)
    )
    return Mechanism(f"chain of {joints}", links, made, gravity=np.array([0.0, 0.0, -9.81]))


def run_chain_study(models: str = "", joints: list[int] | None = None, seconds: float = SECONDS) -> dict[str, Any]:
    """Return the table over joints; times [ns].  The chains are made here: no models are read."""
    pinocchio = open_calls("pinocchio")
    rows = []
    for count in joints or JOINTS:
        mechanism = build_rod_chain(count)
        state = sample_states(mechanism, CHAIN_SAMPLES, np.random.default_rng(count))
        given = [np.ascontiguousarray(part.T) for part in state]
        function = prepare(mechanism, passive=False, threads=1)
        out = np.empty((mechanism.nv, CHAIN_SAMPLES))
        calls = {
            "flexinv": Call(lambda f=function, g=given, o=out: f.torques(*g, out=o, order="coordinates")),  # type: ignore[misc]
            "rneaInParallel": Call(pinocchio.prepare_parallel(mechanism, *state, 1)[0]),
        }
        times = run_calls_in_turns(calls, seconds)
        for method, own in times.items():
            value = 1e9 * own.compute_quartiles().median / CHAIN_SAMPLES
            row = {"joints": count, "method": method, "time": value, "per_joint": value / count}
            if method == "flexinv":
                row["faster"] = compute_time_ratio(times["rneaInParallel"], own).median
            rows.append(add_verdict(row))
    return {"text": CHAIN_TEXT, "columns": CHAIN_COLUMNS, "rows": rows, "plot": CHAIN_PLOT}
