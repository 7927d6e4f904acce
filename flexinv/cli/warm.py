"""``flexinv warm``: kernels are compiled beforehand, in parallel processes, and kept for all that come."""

from __future__ import annotations

import multiprocessing
import os
import sysconfig
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from importlib import import_module
from pathlib import Path

import click
import numpy as np

from flexinv.analysis.solution import Solution
from flexinv.analysis.solve import solve
from flexinv.errors import InputError
from flexinv.files.load_cases import Case, load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.kernels.compiler.choice import NUMBA, is_plain
from flexinv.kernels.compiler.source_stamps import PACKAGE, list_sources
from flexinv.linearized.natural_modes import natural_modes
from flexinv.linearized.steady_modes import steady_modes
from flexinv.model.mechanism import Mechanism

INSTALLED = Path(sysconfig.get_path("data")) / "share" / "flexinv" / "models"  # see pyproject.toml
CHECKOUT = Path(__file__).resolve().parents[2] / "models"
CPU_NAME = "NUMBA_CPU_NAME"


@click.command("warm")
@click.option(
    "--models", type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="Folder of the mechanisms that are computed for it.  [default: those of the checkout or of the installation]",
)  # fmt: skip
@click.option("--jobs", type=click.IntRange(1), default=os.cpu_count() or 1, show_default=True, help="Processes.")
@click.option(
    "--ship", type=click.Path(file_okay=False, path_type=Path),
    help=f"Write the machine code into this folder, for a wheel.  Set {CPU_NAME} to the level of processor that it is for.",
)  # fmt: skip
def warm(models: Path | None, jobs: int, ship: Path | None) -> None:
    """Compile the kernels beforehand, so that the first torque does not wait for them.

    Small mechanisms of every sort are computed: arms and loops, rigid and flexible, in the plane and in space.  What is
    compiled already is read only, so that a second call takes seconds.

    \b
      flexinv warm
      NUMBA_CPU_NAME=x86-64-v3 NUMBA_CPU_FEATURES= NUMBA_CACHE_DIR=build/v3 flexinv warm --ship build/machine_code/x86-64-v3
    """
    folder = models or next((path for path in (CHECKOUT, INSTALLED) if path.is_dir()), None)
    if folder is None:
        raise InputError(f"no folder {INSTALLED} with mechanisms to compute; name one with --models")
    if ship is not None:
        _check_shipping()
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(jobs, len(TASKS)), mp_context=context) as pool:
        waiting = {pool.submit(task, folder): name for name, task in TASKS.items()}
        with click.progressbar(as_completed(waiting), length=len(waiting), label="compiling kernels") as done:
            failed = [f"{waiting[one]}: {error}" for one in done if (error := one.exception()) is not None]
    if failed:
        raise InputError("; ".join(failed))
    if ship is not None:
        _write_kernels(ship)


def _check_shipping() -> None:
    """Raise InputError where machine code cannot be shipped."""
    if not os.environ.get(CPU_NAME):
        raise InputError(f"--ship: {CPU_NAME} is not set; for example {CPU_NAME}=x86-64-v3")
    if is_plain():
        raise InputError(
            "--ship: kernels are plain Numba here (flexinv.kernels.compiler), whose machine code cannot be shipped"
        )


def _write_kernels(folder: Path) -> None:
    """Write what was kept of all kernels that Python calls."""
    for module in list_sources(PACKAGE):
        import_module(f"flexinv.{module}")
    click.echo(f"{folder}: {NUMBA.write_shipped(folder, NUMBA.KERNELS)} kernels")


def _read_first_case(folder: Path, model: str) -> tuple[Mechanism, Case]:
    mechanism = load_mechanism(folder / model)
    return mechanism, next(iter(load_cases(folder / model, mechanism).values()))


def _solve(folder: Path, model: str, error: bool = False) -> tuple[Mechanism, Case, Solution]:
    mechanism, case = _read_first_case(folder, model)
    solution = solve(mechanism, case.motion, step=case.step, start=case.start, initial=case.initial, error=error)
    return mechanism, case, solution


def _run_planar_arm(folder: Path) -> None:
    from flexinv import Controller, differentiate, linear_model, simulate, solve_many

    mechanism, case, found = _solve(folder, "flex_one_link", error=True)
    simulate(mechanism, found.time, found.torque, step=case.step)
    controller = Controller.of(mechanism, step=case.step)
    controller.start(found.q[0], found.qd[0], found.qdd[0])
    controller.step(found.q[1], found.qd[1], found.qdd[1])
    solve_many(mechanism, [case.motion, case.motion], step=case.step, threads=1)
    linear_model(mechanism)
    differentiate(mechanism, case.motion, "gravity[0]", step=case.step)


def _run_spatial_arm(folder: Path) -> None:
    natural_modes(_solve(folder, "spatial_arm")[0])


def _run_tip_path(folder: Path) -> None:
    import flexinv

    mechanism, _ = _read_first_case(folder, "flex_two_link")
    arc = flexinv.Path.arc([0.3, 0, 0], [0.2, 0, 0], np.pi / 2, 0.2)
    near = {"joint1": -0.5, "joint2": 1.0}
    flexinv.follow(mechanism, arc, "link2", step=2e-3, start=near)
    steady_modes(mechanism, rates={"joint1": 1.0})


def _run_rigid_loop(folder: Path) -> None:
    from flexinv import prepare

    mechanism, _, found = _solve(folder, "four_bar")
    prepare(mechanism).torques(found.q, found.qd, found.qdd)


def _run_rigid_arm(folder: Path) -> None:
    from flexinv import prepare, torque_derivatives, torque_regressor

    mechanism, _, found = _solve(folder, "rigid_3r")
    state = found.q, found.qd, found.qdd
    prepared = prepare(mechanism)
    prepared.torques(*state)
    q, qd, qdd = (np.ascontiguousarray(a.T) for a in state)
    prepared.torques(q, qd, qdd, order="coordinates")
    prepared.sample(found.q[0], found.qd[0], found.qdd[0], np.empty(mechanism.nv))
    torque_derivatives(mechanism, *state)
    torque_regressor(mechanism, *state)


# Longest first.
TASKS: dict[str, Callable[[Path], object]] = {
    "a path of a tip": _run_tip_path,
    "a flexible loop": partial(_solve, model="four_bar_flexible"),
    "closures that act in time": partial(_solve, model="two_arms_flexible"),
    "an arm that bends in space": _run_spatial_arm,
    "an arm that bends in the plane": _run_planar_arm,
    "a damped arm": partial(_solve, model="flex_one_link_damped"),
    "a rigid loop": _run_rigid_loop,
    "a rigid arm": _run_rigid_arm,
}
