"""Draws follow the curved set that logs leave, intervals hold their values, and a prior that is wrong is left and said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize

import crosscheck
from crosscheck.identification.estimation.fit import Fit
from crosscheck.identification.estimation.posterior import _Factors, sample_posterior
from crosscheck.identification.identify import Identification
from crosscheck.identification.logs.log import Log
from crosscheck.identification.parameters import Parameter, ParameterSpace
from crosscheck.identification.pseudo_inertia import (
    MassPropertyMap,
    compute_pseudo_inertia,
    compute_ten_parameters,
    compute_upper_factor,
    move_mass_properties,
)
from crosscheck.identification.table import CONFLICT, Row
from flexinv.typing import Array

EMPTY = np.zeros(0)
PENDULUM = """source = "a test"
gravity_m_per_s2 = [0, 0, -9.81]
[links.arm]
kind = "rigid"
mass_kg = 1.0
com_m = [0.3, 0, 0]
inertia_kgm2 = { xx = 0.01, yy = 0.03, zz = 0.03, xy = 0, xz = 0, yz = 0 }
[joints.q]
kind = "revolute"
parent = "world"
child = "arm"
axis = [0, -1, 0]
"""
SETTINGS = """bandwidth_Hz = 10
still_rad_per_s = 0.05
block_s = 2
[joints.q]
angle = { column = "q_rad" }
effort = { column = "tau_Nm" }
"""


def identify_pendulum(
    folder: Path, free: str, mass: float = 1.0, rotor: float = 0.0, dry: float = 0.0, gain: float = 1.0, seed: int = 1
) -> Identification:
    """Identify a pendulum [kg, kg m^2, N m] of a log of 20 s with noise of 0.05 N m."""
    (folder / "mechanism.toml").write_text(PENDULUM)
    (folder / "identify.toml").write_text(SETTINGS + free)
    time = np.arange(0.0, 20.0, 0.01)
    rates = np.array([2.1, 3.7, 5.3])
    sizes = np.array([0.6, 0.3, 0.15])
    turn = rates * time[:, None]
    q = np.sin(turn) @ sizes
    qd = np.cos(turn) @ (sizes * rates)
    qdd = -np.sin(turn) @ (sizes * rates**2)
    effort = mass * (9.81 * 0.3 * np.cos(q) + 0.12 * qdd) + rotor * qdd + dry * np.tanh(qd / 0.05)
    noise = np.random.default_rng(seed).normal(0.0, 0.05, len(time))
    return crosscheck.identify(folder, [Log("made", time, {"q_rad": q, "tau_Nm": gain * (effort + noise)})])


def find_row(found: Identification, name: str) -> Row:
    return next(row for row in found.parameters if row.parameter == name)


def test_slopes_of_mass_properties_are_difference_quotients() -> None:
    random = np.random.default_rng(0)
    ten = np.array([2.0, 0.2, 0.1, -0.3, 0.3, 0.01, 0.35, 0.02, -0.01, 0.28])
    factor = compute_upper_factor(compute_pseudo_inertia(ten))
    x = 0.3 * random.normal(size=(3, 10))
    step = 1e-6
    quotient = np.stack(
        [
            (move_mass_properties(factor, x + one) - move_mass_properties(factor, x - one)) / (2.0 * step)
            for one in step * np.eye(10)
        ],
        axis=-1,
    )
    slopes = MassPropertyMap.build_for(factor[None]).compute_slopes(x[:, None])[:, 0]
    assert np.allclose(slopes, quotient, atol=1e-8)  # rounding over the step


def test_mass_properties_are_those_of_the_product_of_factors() -> None:
    """P = (L U) (L U)^T entry by entry, of two links at once; 1e-14 is rounding."""
    random = np.random.default_rng(1)
    roots = random.normal(size=(2, 4, 4))
    factors = np.array([compute_upper_factor(one @ one.T + np.eye(4)) for one in roots])
    x = 0.3 * random.normal(size=(3, 2, 10))
    moved = MassPropertyMap.build_for(factors).move(x)
    for sample, link in np.ndindex(3, 2):
        a, d1, d2, d3, s12, s23, s13, *t = x[sample, link]
        rows = [
            [np.exp(d1), s12, s13, t[0]],
            [0.0, np.exp(d2), s23, t[1]],
            [0.0, 0.0, np.exp(d3), t[2]],
            [0.0, 0.0, 0.0, 1.0],
        ]
        half = factors[link] @ np.array(rows) * np.exp(a)
        expected = compute_ten_parameters(half @ half.T)
        assert np.abs(moved[sample, link] - expected).max() < 1e-14 * np.abs(expected).max()


def sum_is_told(width: float) -> tuple[ParameterSpace, Fit, Array]:
    """Two frictions, known to 1 with errors of a width each, whose sum the logs tell to be 4 +- 0.05; their exact quantiles."""
    names = ("a", "b")
    space = ParameterSpace(tuple(Parameter("viscous friction", n, "N m s/rad", 1.0, width, True) for n in names), {})
    z = minimize(lambda z: z @ z + ((np.exp(width * z).sum() - 4.0) / 0.05) ** 2, [0.5, 0.4]).x
    slope = width * np.exp(width * z) / 0.05
    fit = Fit(z, np.linalg.inv(np.eye(2) + np.outer(slope, slope)), EMPTY, EMPTY, 1.0, EMPTY, (), ())
    grid = np.linspace(-6.0, 6.0, 3001)
    value = np.exp(width * grid)
    cost = grid[:, None] ** 2 + grid**2 + ((value[:, None] + value - 4.0) / 0.05) ** 2
    part = np.cumsum(np.exp(-0.5 * cost).sum(axis=1))
    return space, fit, np.interp([0.05, 0.25, 0.5, 0.75, 0.95], part / part[-1], value)


@pytest.mark.parametrize("width", [0.3, 1.0])
def test_draws_of_a_told_sum_have_the_quantiles_of_quadrature(width: float) -> None:
    """1,000 draws of which some hundred are independent scatter by 0.15; the normal law about the mode errs by 1 and more."""
    space, fit, exact = sum_is_told(width)
    drawn = np.exp(width * sample_posterior(space, fit, np.random.default_rng(1)))
    assert np.allclose(np.quantile(drawn[:, 0], [0.05, 0.25, 0.5, 0.75, 0.95]), exact, atol=0.25)
    assert np.std(drawn.sum(axis=1)) < 0.07  # all on the curve: 0.05, and the scatter of so many draws
    normal = fit.z + np.random.default_rng(2).normal(size=(1000, 2)) @ np.linalg.cholesky(fit.covariance).T
    assert np.std(np.exp(width * normal).sum(axis=1)) > 0.12


def test_draws_of_what_is_linear_are_normal() -> None:
    names = [f"p{k}" for k in range(3)]
    space = ParameterSpace(tuple(Parameter("effort offset", n, "N m", 0.0, 1.0, False) for n in names), {})
    slopes = np.array([[3.0, 1.0, 0.0], [0.0, 2.0, 2.0]])
    covariance = np.linalg.inv(slopes.T @ slopes + np.eye(3))
    z = covariance @ slopes.T @ [1.0, -2.0]
    drawn = sample_posterior(space, Fit(z, covariance, EMPTY, EMPTY, 1.0, EMPTY, (), ()), np.random.default_rng(3))
    assert np.allclose(drawn.mean(axis=0), z, atol=0.1)  # three standard errors of 1,000 draws
    assert np.allclose(np.cov(drawn.T), covariance, atol=0.15)


@pytest.mark.parametrize("relative", [0.2, 2.5])
def test_values_lie_in_their_intervals_and_what_has_no_influence_is_not_told(tmp_path: Path, relative: float) -> None:
    """About its axis y a pendulum shows m x, m z and its inertia there, and nothing of the other entries."""
    found = identify_pendulum(tmp_path, f'[[free]]\nparameter = "mass properties"\nrelative = {relative}\n', mass=1.1)
    for row in found.parameters:
        assert row.low <= row.value <= row.high
        assert row.before_low <= row.before <= row.before_high
    told = {row.parameter for row in found.parameters if row.identifiable}
    assert "com z" in told
    assert not told & {"com y", "Ixx", "Ixy", "Ixz", "Iyz", "Izz"}
    mass = find_row(found, "mass")
    assert mass.low < 1.1 < mass.high


@pytest.mark.parametrize("prior", [5.0, 0.001])
def test_friction_is_found_from_a_prior_that_is_wrong_by_a_factor(tmp_path: Path, prior: float) -> None:
    """At the prior most of the effort is left; taken for noise, it would hold the fit there."""
    free = f'[[free]]\nparameter = "coulomb friction"\nvalue = {prior}\nrelative = 1.5\n'
    found = identify_pendulum(tmp_path, free, dry=5.0)
    row = find_row(found, "coulomb friction")
    assert row.identifiable
    assert row.value == pytest.approx(5.0, abs=0.02)  # noise of 0.05 N m at 2,000 samples, and its low-pass
    assert row.low < 5.0 < row.high
    assert found.seen[0].explained > 0.999


@pytest.mark.parametrize(("rotor", "says"), [(0.1, False), (0.15, True)])
def test_data_that_contradict_the_prior_say_so(tmp_path: Path, rotor: float, says: bool) -> None:
    """A rotor inertia known to 2 %; logs of a rotor that is half as large again."""
    free = '[[free]]\nparameter = "rotor inertia"\nvalue = 0.1\nrelative = 0.02\n'
    found = identify_pendulum(tmp_path, free, rotor=rotor)
    row = find_row(found, "rotor inertia")
    assert (abs(row.conflict) > CONFLICT) is says
    assert any("contradict" in words and "rotor inertia of q" in words for words in found.words) is says
    assert row.alone == pytest.approx(rotor, rel=0.02)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_free_gain_leaves_the_scale_to_the_masses(tmp_path: Path, seed: int) -> None:
    """A current of unknown constant tells gain times mass: both intervals hold the truth, and lean to neither side."""
    free = (
        '[[free]]\nparameter = "mass properties"\nrelative = 0.2\n'
        '[[free]]\nparameter = "effort gain"\nrelative = 2.5\n'
        '[[free]]\nparameter = "coulomb friction"\nvalue = 0.3\nrelative = 1.5\n'
    )
    found = identify_pendulum(tmp_path, free, dry=0.5, gain=0.125, seed=seed)
    table = {row.parameter: row for row in found.parameters}
    for name, truth in (("effort gain", 0.125), ("mass", 1.0), ("coulomb friction", 0.5)):
        row = table[name]
        assert row.low < truth < row.high
        below = np.log(row.value / row.low)
        above = np.log(row.high / row.value)
        assert 0.5 < below / above < 2.0


def test_factors_solve_as_inverses_do_and_a_singular_matrix_spoils_no_other() -> None:
    """Rounding of twelve equations with a condition number of some hundred; of a singular matrix there is no number."""
    random = np.random.default_rng(3)
    matrices = random.normal(size=(5, 12, 12))
    matrices[2] = 0.0
    right = random.normal(size=(5, 12))
    factors = _Factors.build_from(matrices.copy())
    every = factors.solve(right)
    rows = np.array([4, 0, 1])
    expected = np.linalg.solve(matrices[rows], right[rows, :, None])[..., 0]
    np.testing.assert_allclose(factors.solve(right[rows], rows), expected, rtol=1e-10)
    np.testing.assert_array_equal(every[rows], factors.solve(right[rows], rows))
    assert not np.isfinite(every[2]).any()
    assert factors.solve(right[:0], rows[:0]).shape == (0, 12)
