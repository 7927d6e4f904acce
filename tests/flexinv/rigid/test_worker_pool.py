"""Threads that help: they take part, they are not waited for, and they leave no trace in a forked child or at the end."""

from __future__ import annotations

import gc
import math
import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
from rigid_trees import tree

from crosscheck.studies.robot_sweep import sample_states
from flexinv.kernels.threads.affinity import (
    _make_processor_finder,
    count_processors,
    move_from_processor,
    move_to_processor,
    processor_now,
    read_granted_processors,
)
from flexinv.kernels.threads.worker_pool import ANSWER, CELLS, DONE, EMPTY, OFFERED, OWNER, STATE, TAKEN, Helpers
from flexinv.rigid.blocks import HELPERS, collect, compute_torque_blocks
from flexinv.rigid.prepare import TorqueFunction, prepare
from flexinv.rnea.loop_plan import NO_LOOPS
from flexinv.typing import Array

SAMPLES = 2000
PATIENCE = 120.0  # s: on a busy machine a thread may wait for its turn as long as one call takes, but not for ever
NONE = NO_LOOPS.plan, NO_LOOPS.fixed
OTHERS = 12345  # the owner of an offer that somebody else has made


def function() -> tuple[TorqueFunction, list[Array], Array]:
    mechanism = tree()
    state = list(sample_states(mechanism, SAMPLES, np.random.default_rng(0)))
    return prepare(mechanism, threads=2), state, prepare(mechanism, threads=1).torques(*state)


def call(f: TorqueFunction, state: list[Array], mails: np.ndarray) -> tuple[Array, np.ndarray]:
    """The kernel itself, on mails that no helper watches: efforts and counter."""
    b, own, tau = f.bodies, f._own, np.zeros_like(state[1])
    strides = np.array([(a.shape[1], 1) for a in (*state, tau)], dtype=np.uint64)
    flat = [a.reshape(-1) for a in (*state, tau)]
    motion = (*flat, strides, np.uint64(SAMPLES))
    assert compute_torque_blocks(b.tree, b.numbers, b.columns, *NONE, *motion, own.work, own.counter, mails)
    return tau, own.counter


def test_a_helper_takes_part() -> None:
    f = prepare(tree(), threads=2)
    state = [np.repeat(a, 100, axis=0) for a in sample_states(f.mechanism, SAMPLES, np.random.default_rng(0))]
    alone = prepare(tree(), threads=1).torques(*state)
    f.torques(*state)  # which compiles what helpers do before there are any
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        mail = HELPERS.prepare_mailboxes(1, wake=True)[0]
        mail[ANSWER] = OTHERS
        assert np.array_equal(f.torques(*state), alone)
        if mail[ANSWER] == 0:  # it has worked, and found every number finite
            return
    pytest.fail("no helper ever began")


@pytest.mark.skipif(
    processor_now() < 0 or count_processors() < 2, reason="needs a system that tells, and two processors"
)
def test_a_helper_that_begins_leaves_the_collector_of_garbage_alone() -> None:
    """It is one for all threads: who switches it for his own measurements switches it for the caller."""
    seen = list[bool]()
    helpers = Helpers(lambda mail, looks: seen.append(gc.isenabled()))
    helpers.prepare_mailboxes(1, wake=True)
    end = time.monotonic() + PATIENCE
    while len(seen) < 2 and time.monotonic() < end:
        time.sleep(1e-3)
    helpers.end_helpers()
    assert seen
    assert all(seen)


@pytest.mark.skipif(
    processor_now() < 0 or count_processors() < 2, reason="needs a system that tells, and two processors"
)
def test_a_thread_leaves_the_processor_of_its_caller_and_may_come_back() -> None:
    def run(other: int) -> None:
        allowed = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {other})
        os.sched_setaffinity(0, allowed)
        for _ in range(100):  # until the system leaves it where it goes
            before = processor_now()
            move_from_processor(before)
            now = processor_now()
            if now != before:
                break
        result.append((before, now, os.sched_getaffinity(0) == allowed))

    result: list[tuple[int, int, bool]] = []
    for one in sorted(os.sched_getaffinity(0))[:2]:
        thread = Thread(target=run, args=(one,))
        thread.start()
        thread.join()
    assert all(free for *_, free in result)
    assert all(now != before for before, now, _ in result)


@pytest.mark.skipif(
    processor_now() < 0 or count_processors() < 2, reason="needs a system that tells, and two processors"
)
def test_threads_begin_on_processors_of_their_own() -> None:
    allowed = sorted(os.sched_getaffinity(0))

    def run(number: int) -> int:
        for _ in range(100):  # until the system leaves it where it goes
            move_to_processor(number, allowed[0])
            now = processor_now()
            if now == allowed[number % len(allowed)]:
                break
        assert os.sched_getaffinity(0) == set(allowed)
        return now

    with ThreadPoolExecutor(1) as pool:
        result = list(pool.map(run, range(len(allowed) + 1)))
    assert result == [*allowed, allowed[0]]


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        ({"cpu.max": "150000 100000"}, 1.5),
        ({"cpu.max": "max 100000"}, math.inf),
        ({"cpu/cpu.cfs_quota_us": "50000", "cpu/cpu.cfs_period_us": "100000"}, 0.5),
        ({"cpu/cpu.cfs_quota_us": "-1", "cpu/cpu.cfs_period_us": "100000"}, math.inf),
        ({"cpu.max": "in words"}, math.inf),
        ({}, math.inf),
    ],
)
def test_a_container_has_the_processors_that_it_is_given(
    files: dict[str, str], expected: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text + "\n")
    monkeypatch.setattr("flexinv.kernels.threads.affinity.GROUP", tmp_path)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(4)), raising=False)
    assert read_granted_processors() == expected
    assert count_processors() == {1.5: 2, 0.5: 1, math.inf: 4}[expected]


def test_where_no_thread_can_be_moved_none_is_asked_to(monkeypatch: pytest.MonkeyPatch) -> None:
    """macOS, and systems that tell where a thread is without letting Python move it."""
    monkeypatch.delattr(os, "sched_setaffinity", raising=False)
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    assert _make_processor_finder()() == -1
    assert count_processors() >= 1


def test_numbers_that_are_not_finite_are_counted_by_all() -> None:
    f, state, _ = function()
    state[0][:] = np.nan
    for _ in range(20):
        with pytest.raises(ValueError, match=r"q\[0, 0\] is nan"):
            f.torques(*state)
        assert f._own.counter[1] == len(state[0])


def test_a_helper_that_has_not_begun_is_not_waited_for() -> None:
    f, state, alone = function()
    mails = np.zeros((1, CELLS), dtype=np.uint64)
    tau, counter = call(f, state, mails)
    assert np.array_equal(tau, alone)
    assert counter[1] == 0
    assert (mails[0, STATE], mails[0, OWNER]) == (EMPTY, 0)  # the offer was withdrawn


@pytest.mark.parametrize("state_of", [OFFERED, TAKEN, DONE])
def test_a_helper_of_others_is_left_alone(state_of: int) -> None:
    f, state, alone = function()
    mails = np.zeros((1, CELLS), dtype=np.uint64)
    mails[0, STATE], mails[0, OWNER], mails[0, ANSWER] = state_of, OTHERS, 7
    tau, counter = call(f, state, mails)
    assert np.array_equal(tau, alone)
    assert counter[1] == 0
    assert (mails[0, STATE], mails[0, OWNER], mails[0, ANSWER]) == (state_of, OTHERS, 7)


def test_a_helper_that_is_held_up_is_asked_again() -> None:
    prepare(tree(), threads=2)
    counter, mails = np.array([0, 2], dtype=np.uint64), np.zeros((1, CELLS), dtype=np.uint64)
    mails[0, STATE], mails[0, OWNER] = TAKEN, counter.ctypes.data
    whole = *NONE, np.uint64(SAMPLES), np.zeros((2, 1)), counter, mails
    assert not collect(*whole)
    assert mails[0, STATE] == TAKEN
    mails[0, STATE], mails[0, ANSWER] = DONE, 3
    assert collect(*whole)
    assert counter[1] == 5
    assert (mails[0, STATE], mails[0, OWNER]) == (EMPTY, 0)


PROGRAM = """
import os, sys
import numpy as np
from flexinv import prepare
from rigid_trees import tree

f, alone = prepare(tree(), threads=3), prepare(tree(), threads=1)
state = [np.tile(tree().neutral, (3000, 1)), *(np.ones((3000, tree().nv)) for _ in range(2))]
expected = alone.torques(*state)
for _ in range(20):
    assert np.array_equal(f.torques(*state), expected)
for _ in range(5 if sys.argv[1] == "fork" else 0):
    child = os.fork()
    for _ in range(20):
        assert np.array_equal(f.torques(*state), expected)
    if child == 0:
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
"""  # and the program ends while its helpers watch


@pytest.mark.slow
@pytest.mark.parametrize("way", ["fork", "end"])
def test_helpers_neither_outlive_a_fork_nor_the_program(way: str) -> None:
    if way == "fork" and not hasattr(os, "fork"):
        pytest.skip("this system does not fork")
    tests = Path(__file__).resolve().parents[2] / "shared"
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join((str(tests.parent), str(tests)))}
    for _ in range(1 if way == "fork" else 2):
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM, way], capture_output=True, text=True, timeout=120, env=paths
        )
        assert done.returncode == 0, done.stderr


SWITCHED = """
import sys, threading
import numpy as np
import flexinv
from rigid_trees import tree

f = flexinv.prepare(tree(), threads=4)
rng = np.random.default_rng(0)
q = np.repeat(f.mechanism.neutral[None], 4000, axis=0)
qd, qdd = rng.normal(size=(2, 4000, f.mechanism.nv))
tau = [f.torques(q, qd, qdd) for _ in range(3)]
np.save(sys.argv[1], tau[-1])
print(sum(t.name == "flexinv" for t in threading.enumerate()))
"""


def switched(root: Path, out: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    variables = {**os.environ, "PYTHONPATH": str(root / "tests" / "shared"), **environment}
    return subprocess.run([sys.executable, "-c", SWITCHED, str(out)], env=variables, capture_output=True, text=True)


@pytest.mark.slow
def test_the_switch_leaves_no_helper(root: Path, tmp_path: Path) -> None:
    """FLEXINV_THREADS=1: no thread beside the caller's, and the same torques to the last bit."""
    on, off = (switched(root, tmp_path / f"{n}.npy", FLEXINV_THREADS=n) for n in ("2", "1"))
    assert (on.stdout.strip(), off.stdout.strip()) == ("1", "0"), on.stderr + off.stderr
    np.testing.assert_array_equal(np.load(tmp_path / "1.npy"), np.load(tmp_path / "2.npy"))


def test_a_switch_that_is_no_number_is_an_error(root: Path, tmp_path: Path) -> None:
    result = switched(root, tmp_path / "tau.npy", FLEXINV_THREADS="off")
    assert "FLEXINV_THREADS = 'off': expected a whole number of threads" in result.stderr
