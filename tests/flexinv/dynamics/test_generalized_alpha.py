"""Generalized-alpha on a linear oscillator: second order, the spectral radius asked for, energy kept without damping."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from kernels import oscillate

import flexinv
from flexinv.dynamics.dofs import Topology
from flexinv.dynamics.generalized_alpha import Scheme, build_generalized_alpha
from flexinv.dynamics.system import State
from flexinv.elements.shapes import build_shapes
from flexinv.errors import InputError
from flexinv.typing import Array

RHOS = (0.0, 0.5, 0.8, 1.0)


def no_nodes() -> Topology:
    """Unknowns without nodes: only the integrator's formulas act."""
    none, index = np.zeros(0), np.zeros(0, dtype=np.int64)
    axes = np.zeros((0, 6, 3))
    return Topology(
        index, index, np.zeros(0, dtype=np.bool_), *(index,) * 10, axes, axes,
        np.zeros((5, 0)), none, none, np.zeros((0, 3, 3)), np.zeros(3), 1.0, build_shapes(index, [], [], []), index,
    )  # fmt: skip


def marched(scheme: Scheme, squared: float, steps: int, starts: Array) -> tuple[Array, State]:
    """x (steps + 1, starts) of u' = -squared x from rows x, u, u', pseudo acceleration of ``starts`` (4, starts)."""
    x, u, du, pseudo = starts
    state = State(
        np.zeros((0, 3)), np.zeros((0, 3, 3)), *(np.zeros(len(x)) for _ in range(10)), order=np.zeros(1, dtype=np.int64)
    )
    state.u0[:], state.du0[:], state.pseudo[:] = u, du, pseudo
    history = np.zeros((steps + 1, len(x)))
    history[0] = x
    oscillate(no_nodes(), scheme, state, history, squared)
    return history, state


def cosine_error(h: float, rho: float) -> float:
    """Largest error of one period of cos(2 pi t)."""
    squared, steps = (2 * np.pi) ** 2, round(1 / h)
    start = np.array([[1.0], [0.0], [-squared], [-squared]])
    x, _ = marched(build_generalized_alpha(h, rho), squared, steps, start)
    return float(np.abs(x[:, 0] - np.cos(2 * np.pi * h * np.arange(steps + 1))).max())


@pytest.mark.parametrize("rho", RHOS)
def test_second_order(rho: float) -> None:
    errors = [cosine_error(h, rho) for h in (1 / 200, 1 / 400, 1 / 800)]
    # the next term of the error is one power of h smaller: (1 / 400) times some 2 pi
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2.0, abs=2 * np.pi / 400)


def amplification(scheme: Scheme, squared: float) -> Array:
    """One step as a matrix on (h^2 squared x, h u, h^2 A) with u' = -squared x throughout: entries of size one."""
    h = scheme.h
    scale = np.array([1 / (h**2 * squared), 1 / h, 1 / h**2])
    x0, u0, pseudo = np.diag(scale)
    x, state = marched(scheme, squared, 1, np.array([x0, u0, -squared * x0, pseudo]))
    return np.array([x[1], state.u0, state.pseudo]) / scale[:, None]


@pytest.mark.parametrize("rho", RHOS)
def test_high_frequencies_shrink_by_the_spectral_radius(rho: float) -> None:
    frequency = 1e6  # per step
    radius = np.abs(np.linalg.eigvals(amplification(build_generalized_alpha(1.0, rho), frequency**2))).max()
    # In the limit all three eigenvalues are equal: terms 1/(beta frequency^2), beta from 1/4 to 1, split them by the cube root.
    assert radius == pytest.approx(rho, abs=np.cbrt(4 / frequency**2))


@pytest.mark.parametrize("rho", RHOS)
@pytest.mark.parametrize("frequency", [1e-2, 0.3, 1.0, 3.0, 30.0, 1e3])
def test_no_frequency_grows(rho: float, frequency: float) -> None:
    radius = np.abs(np.linalg.eigvals(amplification(build_generalized_alpha(1.0, rho), frequency**2))).max()
    assert radius <= 1.0 + 1e-12  # eigenvalues of a 3 x 3 matrix of size one


def test_without_damping_the_amplitude_stays() -> None:
    """rho = 1: over 1000 periods of ten steps no part of the amplitude is lost."""
    h, squared = 0.1, (2 * np.pi) ** 2
    start = np.array([[1.0], [0.0], [-squared], [-squared]])
    kept = [marched(build_generalized_alpha(h, rho), squared, 10_000, start)[0][:, 0] for rho in (1.0, 0.5)]
    first, last = np.abs(kept[0][:100]).max(), np.abs(kept[0][-100:]).max()
    # both maxima are taken over some samples of a rotation that visits all phases: 100 samples, phase 2 pi / 100
    assert last == pytest.approx(first, rel=(2 * np.pi / 100) ** 2 / 2)
    assert np.abs(kept[1][-100:]).max() < 0.1  # and the test sees damping


@pytest.mark.parametrize(("step", "rho", "complaint"), [(1e-3, 1.1, "spectral_radius = 1.1"), (1e-3, -0.1, "expected 0"),
                                                        (0.0, 0.8, "step = 0.0 s"), (np.inf, 0.8, "step = inf s")])  # fmt: skip
def test_impossible_schemes_are_refused(step: float, rho: float, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        build_generalized_alpha(step, rho)


def test_a_smooth_march_in_space_takes_one_iteration_a_step(root: Path) -> None:
    """Auxiliary accelerations go on as a parabola, so near the answer that one increment is enough; not where they jump."""
    model = root / "models" / "spatial_arm"
    arm = flexinv.load_mechanism(model)
    case = flexinv.load_cases(model, arm)["reach"]
    iterations = {}
    for law in ("nonic", "bang-bang"):
        tracks = tuple(replace(track, law=law) for track in case.motion.tracks)
        motion = replace(case.motion, tracks=tracks)
        iterations[law] = flexinv.solve(arm, motion, step=1e-3, initial="static").iterations
    assert (iterations["nonic"][4:] == 1).all()
    assert (iterations["bang-bang"][1:] > 1).any()
