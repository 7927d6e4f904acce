"""Steps of a march: by what one step a sample leaves a stiffness off is seen at the fit; steps are added until it is small."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from identify_campaign import CLASSES, TRUE_STEPS, fit_with_steps, logged, moving, read_random_machine

from crosscheck.identification.estimation.fit import Fit, Problem, build_problem, fit
from crosscheck.identification.estimation.march_steps import (
    MOST,
    OFF,
    build_finer_run,
    choose_steps,
    count_steps,
    replace_steps,
)
from crosscheck.identification.identify import read_machine
from crosscheck.identification.logs.log import Log
from crosscheck.identification.machine import Machine
from crosscheck.identification.readings import make_run

QUIET = 0.02  # [N m], the spread of which noise is a part: the stiffness is told to less than the error of a step


@pytest.fixture(scope="module")
def machine() -> Machine:
    """A random elastic drive of which the spring alone is free: two marches a slope."""
    whole = read_random_machine("drives", 2, np.random.default_rng([2, CLASSES.index("drives")]))
    free = [one for one in whole.settings.free if one.parameter in ("joint stiffness", "joint damping")]
    return read_machine(whole.mechanism, whole.settings.model_copy(update={"free": free}))


@pytest.fixture(scope="module")
def log(machine: Machine) -> Log:
    """A log of the drive as it is, with little noise on its effort and none on its angle."""
    random = np.random.default_rng(5)
    motion = moving(machine, random, "drives")
    noisy = logged(machine, motion, np.zeros(2), random, {"t0": QUIET})
    return replace(noisy, columns=noisy.columns | {"q0": motion.q[:, 0]})


@pytest.fixture(scope="module")
def found(machine: Machine, log: Log) -> tuple[Problem, Fit]:
    task = build_problem(machine, (make_run(machine, log),))
    return task, fit(task)


def fit_with(task: Problem, steps: int, start: Fit) -> Fit:
    """The fit with so many steps a sample [-]."""
    finer = replace_steps(task.machine, steps)
    return fit(replace(task, machine=finer, runs=tuple(build_finer_run(finer, run) for run in task.runs)), start.z)


def compute_distance(one: Fit, other: Fit) -> float:
    """Standard errors by which two fits differ in the combination of parameters that is worst [-]."""
    between = one.z - other.z
    return float(np.sqrt(between @ np.linalg.solve(one.covariance, between)))


def test_steps_are_added_until_their_error_is_small(found: tuple[Problem, Fit]) -> None:
    """Against the steps with which the log was made; OFF is of the error's leading term, and the next is a part of it."""
    task, coarse = found
    finer, chosen = fit_with_steps(task.machine, task.runs[0])
    steps = finer.machine.settings.every
    assert steps is not None
    assert 1 < steps < MOST
    true = fit_with(task, TRUE_STEPS, coarse)
    assert compute_distance(true, coarse) > 5.0 * OFF
    assert compute_distance(true, chosen) < OFF
    assert count_steps(task, replace(coarse, spread=1e-4 * coarse.spread)) == MOST


def test_enough_steps_are_not_changed(found: tuple[Problem, Fit]) -> None:
    """Where noise hides it, one step a sample serves; where identify.toml says how many, so many are made."""
    task, coarse = found
    loud = replace(coarse, spread=1e3 * coarse.spread)
    assert choose_steps(task, loud, None) is None
    assert choose_steps(task, coarse, None) is not None
    assert choose_steps(task, coarse, 1) is None


def test_trees_have_no_steps() -> None:
    machine = read_random_machine("rigid", 2, np.random.default_rng([2, 0]))
    random = np.random.default_rng(0)
    z = np.zeros(len(machine.space.parameters))
    run = make_run(machine, logged(machine, moving(machine, random, "rigid"), z, random))
    task = build_problem(machine, (run,))
    count = len(z)
    none = Fit(z, np.eye(count), np.ones(1), np.ones(1), 1.0, np.ones(1), (), ())
    assert choose_steps(task, none, None) is None
