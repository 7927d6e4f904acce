"""Steps of a march: as many a sample as leave an error of the parameters that is small beside their own.

A march of second order with n steps a sample leaves readings off by  e = 4/3 (r_2n - r_n),  which a second march at the fit
tells, and so parameters by  dz = C J^T W e,  C their covariance.  That is  d = (dz^T C^-1 dz)^1/2  standard errors of that
combination of them which is worst, and the fit needs  n (d / d_0)^1/2  steps.  What a step leaves counts as noise, which hides
a part of it: the fit with more steps is asked again.
"""

from __future__ import annotations

from dataclasses import replace
from math import ceil

import numpy as np

from crosscheck.identification.estimation.fit import Fit, Problem, compute_jacobian
from crosscheck.identification.machine import Machine
from crosscheck.identification.readings import Run
from crosscheck.identification.responses.response import build_response, is_marched

OFF = 0.2  # standard errors that a combination of parameters may be off: a 90 % interval that is off by so much holds 89.3 %
MOST = 16  # steps a sample: of what is faster a log tells nothing
SECOND = 4.0 / 3.0  # of what twice as many steps change an error of second order is


def choose_steps(task: Problem, found: Fit, stated: int | None) -> Problem | None:
    """Return the problem with as many steps a sample as its parameters need; None where those that it has are enough.

    found : parameters (parameters,) of the machine [-]; stated : steps that identify.toml says, which stay [-]
    """
    if stated is not None or not any(is_marched(run.response) for run in task.runs):
        return None
    steps = count_steps(task, found)
    if steps <= (task.machine.settings.every or 1):
        return None
    finer = replace_steps(task.machine, steps)
    return replace(task, machine=finer, runs=tuple(build_finer_run(finer, run) for run in task.runs))


def count_steps(task: Problem, found: Fit) -> int:
    """Return the steps a sample [-] that leave the parameters (parameters,) found with one off by `OFF` at most."""
    alone = replace(task, days=(), moved=())
    now = task.machine.settings.every or 1
    twice = replace_steps(task.machine, 2 * now)
    finer = replace(alone, machine=twice, runs=tuple(build_finer_run(twice, run, once=True) for run in task.runs))
    coarse, fine = (one.collect_counted_samples(one.predict(found.z)) for one in (alone, finer))
    weight = 1.0 / (found.spread * np.sqrt(found.agree))
    slopes = compute_jacobian(alone, found.z)
    parts = zip(weight, slopes, coarse, fine, strict=True)
    pull = sum((w**2 * SECOND * (j.T @ (f - c)) for w, j, c, f in parts), np.zeros(len(found.z)))
    off = float(np.sqrt(pull @ found.covariance @ pull))
    needed = ceil(now * float(np.sqrt(off / OFF)))
    return min(MOST, max(1, needed))


def replace_steps(machine: Machine, steps: int) -> Machine:
    """Return a machine whose marches make so many steps a sample [-]."""
    return replace(machine, settings=machine.settings.model_copy(update={"every": steps}))


def build_finer_run(machine: Machine, run: Run, once: bool = False) -> Run:
    """Return a run [s, rad, N m] with the response of a machine; once : it is asked for at one set of values."""
    return replace(run, response=build_response(machine.mechanism, machine.space, machine.settings, run.motion, once))
