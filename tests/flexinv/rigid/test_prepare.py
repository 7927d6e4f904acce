"""The kernel of rigid inverse dynamics: the same torques as the sums over the nodes, whatever the joints and the layout."""

from __future__ import annotations

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flexible_examples import spatial_tree
from loop_examples import loaded_tree
from rigid_trees import KINDS, chain, tree, without_drives

import flexinv
from crosscheck.studies.robot_sweep import sample_states
from flexinv.inverse.inverse_dynamics import compute_applied_forces, compute_inverse_dynamics, compute_spring_efforts
from flexinv.kernels.simd import BLOCK
from flexinv.kinematics.mesh import build
from flexinv.kinematics.nodal_motion import compute_rigid_motion
from flexinv.model.mechanism import Mechanism
from flexinv.rigid.prepare import TorqueFunction, prepare
from flexinv.rnea.body_table import build_bodies
from flexinv.typing import Array

State = tuple[Array, Array, Array]
# Rounding of some hundred operations of each of a few bodies, relative to the largest effort.
ROUNDING = 1e-13


def states(mechanism: Mechanism, samples: int, seed: int = 0) -> State:
    return sample_states(mechanism, samples, np.random.default_rng(seed))


def by_nodes(mechanism: Mechanism, q: Array, qd: Array, qdd: Array, passive: bool = True) -> Array:
    """tau = L T P with every node on its own."""
    mesh = build(mechanism)
    motion = compute_rigid_motion(mesh, q, qd, qdd)
    tau = compute_inverse_dynamics(
        mesh, motion, qd, qdd, compute_applied_forces(mesh, motion, np.zeros(len(q))), passive
    ).torque
    return tau + compute_spring_efforts(mechanism, q, history=False) if passive else tau


def error(values: Array, expected: Array) -> float:
    return float(abs(values - expected).max() / abs(expected).max())


def many_branches() -> Mechanism:
    """Two roots, and branches that end, go on and branch again: every way in which a state can begin."""
    kinds = (
        "revolute",
        "spherical",
        "prismatic",
        "continuous",
        "revolute",
        "universal",
        "free",
        "revolute",
        "prismatic",
    )
    parents = ("world", "l0", "l0", "l2", "l2", "l0", "world", "l6", "l6")
    return tree(tuple((f"l{k}", kind, parent) for k, (kind, parent) in enumerate(zip(kinds, parents, strict=True))))


MECHANISMS = {
    **{kind: chain(kind) for kind in KINDS},
    "every kind": tree(),
    "branches": many_branches(),
    "loaded": replace(loaded_tree()[0], forces=loaded_tree()[0].forces[1:]),
}


@pytest.mark.parametrize("passive", [True, False])
@pytest.mark.parametrize("name", MECHANISMS)
def test_bodies_give_the_torques_of_the_nodes(name: str, passive: bool) -> None:
    mechanism = MECHANISMS[name]
    state = states(mechanism, BLOCK + 7)
    assert error(prepare(mechanism, passive).torques(*state), by_nodes(mechanism, *state, passive)) < ROUNDING


def test_lumped_nodes_of_an_undeformed_beam_collapse_exactly() -> None:
    """The bodies of a mesh with beams, moved as rigid ones, against the sum over all its nodes."""
    mesh = build(spatial_tree())
    mechanism = mesh.mechanism
    table = build_bodies(mesh)
    rigid = TorqueFunction(mechanism, True, 1, mesh, table, prepare(tree())._own.__class__(1, table.size))
    state = states(mechanism, 20)
    assert error(rigid.torques(*state), by_nodes(mechanism, *state)) < ROUNDING


@pytest.mark.parametrize("samples", [1, 2, BLOCK - 1, BLOCK, 3 * BLOCK + 5])
def test_every_layout_gives_the_same(samples: int) -> None:
    """Bit for bit, as the operations are the same."""
    mechanism = tree()
    q, qd, qdd = states(mechanism, samples)
    f = prepare(mechanism)
    plain = f.torques(q, qd, qdd)
    columns = [np.ascontiguousarray(a.T) for a in (q, qd, qdd)]
    assert np.array_equal(f.torques(*columns, order="coordinates").T, plain)
    assert np.array_equal(f.torques(*(a.T for a in columns)), plain)  # samples first, columns in memory
    assert np.array_equal(f.torques(columns[0].T, qd, columns[2].T), plain)  # mixed
    wide = np.zeros((samples, 2 * mechanism.nv))
    wide[:, ::2] = qd
    assert np.array_equal(f.torques(q, wide[:, ::2], qdd), plain)  # in pieces
    for given in (q, qd, qdd):
        given.flags.writeable = False
    assert np.array_equal(f.torques(q, qd, qdd), plain)
    out = np.empty_like(plain)
    assert f.torques(q, qd, qdd, out=out) is out
    assert np.array_equal(out, plain)
    upright = np.empty(plain.shape[::-1])
    assert f.torques(*columns, out=upright, order="coordinates") is upright
    assert np.array_equal(upright.T, plain)


def test_one_sample_alone() -> None:
    mechanism = tree()
    q, qd, qdd = states(mechanism, 5)
    f = prepare(mechanism)
    together, out = f.torques(q, qd, qdd), np.empty(mechanism.nv)
    for k in range(5):
        assert f.sample(q[k], qd[k], qdd[k], out) is out
        assert error(out, together[k]) < ROUNDING
        assert np.array_equal(f.torques(q[k], qd[k], qdd[k]), out)
    columns = np.asfortranarray(q)
    assert np.array_equal(f.sample(columns[4], qd[4], qdd[4], out), f.torques(q[4], qd[4], qdd[4]))  # with a stride
    loaded = MECHANISMS["loaded"]
    one = tuple(a[0] for a in states(loaded, 1))
    assert np.array_equal(prepare(loaded).sample(*one, np.empty(loaded.nv)), flexinv.joint_torques(loaded, *one))


def test_threads_give_the_same() -> None:
    mechanism = tree()
    state = states(mechanism, 5000)
    alone = prepare(mechanism, threads=1).torques(*state)
    assert np.array_equal(prepare(mechanism, threads=4).torques(*state), alone)
    with ThreadPoolExecutor(4) as pool:  # callers at the same time, through one prepared function
        for result in pool.map(lambda _: prepare(mechanism).torques(*state), range(8)):
            assert np.array_equal(result, alone)


def test_far_angles_keep_their_digits() -> None:
    """Beyond the reach of the polynomials' reduction the library's sine and cosine take over, lane by lane."""
    mechanism = chain("revolute")
    q, qd, qdd = states(mechanism, 10)
    turns = 2 * np.pi * np.round(10.0 ** np.arange(10))[:, None]
    expected = by_nodes(mechanism, q + turns, qd, qdd)
    assert error(prepare(mechanism).torques(q + turns, qd, qdd), expected) < ROUNDING


@pytest.mark.parametrize("name", MECHANISMS)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_no_number_that_is_not_finite_gets_through(name: str, value: float) -> None:
    """Whichever coordinate it is: every one of them reaches an effort, if only as 0 x NaN."""
    mechanism = MECHANISMS[name]
    f = prepare(mechanism, passive=False)
    state = states(mechanism, 3)
    for label, given in zip(("q", "qd", "qdd"), state, strict=True):
        for column in range(given.shape[1]):
            kept, given[1, column] = given[1, column], value
            with pytest.raises(
                flexinv.InputError, match=rf"{label}\[1, {column}\] is {value}, expected a finite number"
            ):
                f.torques(*state)
            with pytest.raises(flexinv.InputError, match=rf"{label}\[{column}\] is {value}"):
                f.sample(*(a[1] for a in state), np.empty(mechanism.nv))
            given[1, column] = kept


@pytest.mark.parametrize(
    ("out", "words"),
    [
        (np.zeros((3, 2)), r"out is an array of float64, shape \(3, 2\), expected an array of float64, shape \(2, 1\)"),
        (np.zeros((2, 1), dtype=np.float32), "out is an array of float32"),
        (np.zeros((4, 1))[::2], "cannot be written to in one piece"),
        ([0.0], r"out is \[0.0\]"),
    ],
)
def test_bad_places_for_the_result_are_explained(out: Array, words: str) -> None:
    mechanism = replace(loaded_tree()[0], forces=())
    one = Mechanism("one", mechanism.links[:1], (replace(mechanism.joints[0], kind="revolute"),))
    with pytest.raises(flexinv.InputError, match=words):
        prepare(one).torques(*np.zeros((3, 2, 1)), out=out)


def test_bad_orders_and_threads_are_explained() -> None:
    mechanism = tree()
    state = states(mechanism, 3)
    with pytest.raises(flexinv.InputError, match="order = 'rows', expected 'samples' or 'coordinates'"):
        prepare(mechanism).torques(*state, order="rows")  # type: ignore[arg-type]
    with pytest.raises(flexinv.InputError, match=r"q has shape \(3, 17\).*needs \(17, samples\)"):
        prepare(mechanism).torques(*state, order="coordinates")
    with pytest.raises(flexinv.InputError, match="threads = 0: expected 1 or more"):
        prepare(mechanism, threads=0)
    with pytest.raises(flexinv.InputError, match=r"qd has shape \(4,\)"):
        prepare(mechanism).sample(state[0][0], np.zeros(4), state[2][0], np.zeros(mechanism.nv))


# A child process of its own: what it holds at most beside input and output, which are there before the first call.
MEMORY = """
import pathlib, resource, sys
import numpy as np
import flexinv

def peak():
    status = pathlib.Path("/proc/self/status")  # Linux: ru_maxrss would count what the parent held when it forked
    if status.exists():
        (line,) = (line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return 1024 * int(line.split()[1])
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)

arm = flexinv.load_mechanism(sys.argv[1])
f = flexinv.prepare(arm)
state = [np.zeros((1_000_000, n)) for n in (arm.nq, arm.nv, arm.nv)]
tau = np.zeros((1_000_000, arm.nv))
for a in (*state, tau):
    a += 0.1  # touched, so that the memory is there
f.torques(*(a[:4096] for a in state))  # loads the machine code of those who help
before = peak()
f.torques(*state, out=tau)
most = peak()
assert np.isfinite(tau).all()
print(most - before, most, sum(a.nbytes for a in (*state, tau)))
"""


@pytest.mark.slow
def test_a_million_samples_stream() -> None:
    """The aim: under 300 MB beside input and output, the interpreter and its libraries included."""
    model = Path(__file__).resolve().parents[3] / "models" / "panda"
    for _ in range(2):  # the first one may have to compile, which takes memory too
        run = subprocess.run([sys.executable, "-c", MEMORY, str(model)], capture_output=True, text=True, check=True)
    more, most, given = (int(word) for word in run.stdout.split())
    assert most - given < 300e6
    assert more < 1e6  # a cell for every block


def _massless(mechanism: Mechanism) -> Mechanism:
    """The same tree without inertia: nothing but the rules of arithmetic carries a fault to the root."""
    links = tuple(replace(link, bodies=()) for link in mechanism.links)
    return without_drives(replace(mechanism, links=links))


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize(
    "mechanism", [tree(), many_branches(), _massless(many_branches())], ids=["tree", "branches", "massless"]
)
def test_a_number_that_is_not_finite_is_found_wherever_it_stands(mechanism: Mechanism, value: float) -> None:
    """Only the wrench at the root is looked at: everything beyond has to reach it, of every joint kind."""
    function = prepare(mechanism, threads=1)
    good = states(mechanism, 150, seed=5)
    function.torques(*good)
    for which, label in enumerate(("q", "qd", "qdd")):
        for column in range(good[which].shape[1]):
            bad = [a.copy() for a in good]
            bad[which][141, column] = value
            with pytest.raises(flexinv.InputError, match=rf"{label}\[141, {column}\] is {value}"):
                function.torques(*bad)
