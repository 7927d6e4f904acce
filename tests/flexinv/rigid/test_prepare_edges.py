"""Prepared functions where callers are unusual: results over the input, many threads at once, Ctrl-C, other processes."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from loop_examples import loaded_tree
from rigid_trees import chain, tree

import flexinv
from crosscheck.studies.robot_sweep import sample_states
from flexinv.kernels.threads.worker_pool import CELLS, DONE, EMPTY, OWNER, STATE, TAKEN
from flexinv.model.mechanism import Mechanism
from flexinv.rigid.blocks import HELPERS
from flexinv.rigid.prepare import WORTH_HELP, prepare
from flexinv.typing import Array

TESTS = Path(__file__).resolve().parents[2] / "shared"
SAMPLES = 700


def states(mechanism: Mechanism, samples: int = SAMPLES) -> list[Array]:
    return list(sample_states(mechanism, samples, np.random.default_rng(0)))


def python(code: str, *words: str, **more: str) -> str:
    """What a fresh process prints."""
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join((str(TESTS.parent), str(TESTS))), **more}
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, timeout=120, env=paths)
    assert done.returncode == 0, done.stderr
    return done.stdout


# --------------------------------------------------------------------------------------------- results over the input


@pytest.mark.parametrize("mechanism", [tree(), replace(loaded_tree()[0], forces=loaded_tree()[0].forces[1:])])
@pytest.mark.parametrize("shift", [0, 1, 100])
def test_efforts_may_be_written_over_what_they_come_from(mechanism: Mechanism, shift: int) -> None:
    """By blocks a shifted result would overwrite what the next block reads; springs and forces are added after all others."""
    f, (q, qd, qdd) = prepare(mechanism), states(mechanism)
    expected = f.torques(q, qd, qdd)
    for k in (1, 2):
        room = np.zeros((SAMPLES + shift, mechanism.nv))
        given = [q, qd, qdd]
        room[:SAMPLES] = given[k]
        given[k], out = room[:SAMPLES], room[shift:]
        assert f.torques(*given, out=out) is out
        assert np.array_equal(out, expected)
        one = [a[3].copy() for a in (q, qd, qdd)]
        assert np.array_equal(f.sample(*one, one[k]), f.torques(q[3], qd[3], qdd[3]))


# ------------------------------------------------------------------------------------------------------ many at once

TOGETHER = """
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier
import numpy as np
import flexinv
from rigid_trees import tree

mechanism, ready = tree(), Barrier(8)
state = [np.tile(mechanism.neutral, (2000, 1)), *(np.full((2000, mechanism.nv), 0.5) for _ in range(2))]

def first(_):
    ready.wait()
    return flexinv.joint_torques(mechanism, *state)

with ThreadPoolExecutor(8) as pool:
    found = list(pool.map(first, range(8)))
print(sum(np.array_equal(one, found[0]) for one in found))
"""


def test_threads_may_call_first_at_the_same_time() -> None:
    """Each finds the kernel compiled, or waits until another has compiled it."""
    assert python(TOGETHER).split() == ["8"]


def test_ctrl_c_waits_for_a_helper_that_writes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Else it would write where memory has been given back, and take blocks of the next call."""
    f = prepare(tree(), threads=2)
    state = states(f.mechanism, WORTH_HELP)
    f.torques(*state)
    mails, seen = np.zeros((1, CELLS), dtype=np.uint64), []
    mails[0, STATE], mails[0, OWNER] = (
        TAKEN,
        f._own.prepare_cells(WORTH_HELP).ctypes.data,
    )  # as if a helper were at work
    monkeypatch.setattr(HELPERS, "prepare_mailboxes", lambda count, wake: mails)

    def interrupted(seconds: float) -> None:
        seen.append(int(mails[0, STATE]))
        mails[0, STATE] = DONE  # it ends a moment later
        raise KeyboardInterrupt

    monkeypatch.setattr(time, "sleep", interrupted)
    with pytest.raises(KeyboardInterrupt):
        f.torques(*state)
    assert seen == [TAKEN]
    assert mails[0, STATE] == EMPTY  # it was waited for


# ----------------------------------------------------------------------------------------------------- other processes


def test_a_prepared_function_goes_to_another_process() -> None:
    f = prepare(tree(), passive=False, threads=1)
    result = pickle.loads(pickle.dumps(f))
    assert (result.passive, result.threads) == (False, 1)
    assert np.array_equal(result.torques(*states(f.mechanism)), f.torques(*states(f.mechanism)))


PLAIN = """
import sys
import numpy as np
from crosscheck.studies.robot_sweep import sample_states
from flexinv.rigid.prepare import prepare
from rigid_trees import tree

np.save(sys.argv[1], prepare(tree()).torques(*sample_states(tree(), 3, np.random.default_rng(0))))
"""


def test_without_compiling_the_kernel_is_the_python_that_it_is_written_in(tmp_path: Path) -> None:
    """To look into it with a debugger.  Rounding of products and sums that fuse only in machine code, of some tens of terms."""
    python(PLAIN, str(tmp_path / "tau.npy"), NUMBA_DISABLE_JIT="1")
    compiled = prepare(tree()).torques(*states(tree(), 3))
    assert abs(np.load(tmp_path / "tau.npy") - compiled).max() < 1e-13 * abs(compiled).max()


# ---------------------------------------------------------------------------------------------------------- bad input


@pytest.mark.parametrize("kind", ["spherical", "free"])
def test_a_quaternion_of_zeros_is_explained(kind: str) -> None:
    f = prepare(chain(kind))
    q, qd, qdd = states(f.mechanism, 5)
    joint = next(j.name for j in f.mechanism.joints if j.kind == kind)
    q[2, f.mechanism.q_slices[joint]] = 0.0
    words = f"q of joint '{joint}' at sample 2 has the quaternion 0, 0, 0, 0; expected x, y, z, w of norm 1"
    for call in (f.torques, f.nodal):
        with pytest.raises(flexinv.InputError, match=words):
            call(q, qd, qdd)
    with pytest.raises(flexinv.InputError, match="at sample 0 has the quaternion 0, 0, 0, 0"):
        f.sample(q[2], qd[2], qdd[2], np.empty(f.mechanism.nv))


def test_cosine_and_sine_of_no_angle_are_explained() -> None:
    """A joint that turns without end and a q of zeros; six digits are enough."""
    f = prepare(chain("continuous"))
    q, qd, qdd = states(f.mechanism, 5)
    own = f.mechanism.q_slices["body_joint"]
    tau = f.torques(q, qd, qdd)
    assert np.abs(f.torques(np.round(q, 6), qd, qdd) - tau).max() < 1e-5 * np.abs(tau).max()  # as they are rounded
    q[2, own] = 0.0
    words = "q of joint 'body_joint' at sample 2 has cosine and sine 0, 0, whose squares sum to 0; expected those of its angle"
    for call in (f.torques, f.nodal):
        with pytest.raises(flexinv.InputError, match=words):
            call(q, qd, qdd)
    q[2, own] = 0.6, 0.81
    with pytest.raises(flexinv.InputError, match=r"at sample 0 has cosine and sine 0\.6, 0\.81"):
        f.sample(q[2], qd[2], qdd[2], np.empty(f.mechanism.nv))
