"""Time of one step with a meshed link, beside steps with beams: ``python campaigns/part_steps.py``.

The arm of models/meshed_arm marches as it is, with geometric stiffening, and with beams of 12 and 18 unknowns in place of its
forearm.  A step's time is the slope of `solve`'s processor time over the number of steps; ratios are to a beam of as many
unknowns as the mesh has, between the two.  Best of several rounds, all machines in turn.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import click
import numpy as np

import flexinv
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion

MODEL = Path(__file__).resolve().parents[1] / "models" / "meshed_arm"
STEPS = (1e-3, 1.25e-4)  # [s]
ROUNDS = 8
BEAM = """[links.forearm]
kind = "beam"
length_m = 0.35
elements = 1
order = {order}
section = "tube"

[sections.tube]
shape = "tube"
outer_diameter_m = 0.04
wall_m = 0.003
E_Pa = 2.5e9
nu = 0.35
rho_kg_per_m3 = 1150
retardation_s = 2e-5

"""


def main() -> None:
    """Print microseconds a step and their ratios."""
    arm = flexinv.load_mechanism(MODEL)
    motion = next(iter(flexinv.load_cases(MODEL, arm).values())).motion
    text = (MODEL / "mechanism.toml").read_text()
    with tempfile.TemporaryDirectory() as folder:
        machines = {
            "mesh": arm,
            "mesh that stiffens": _load(text.replace("stiffening = false", ""), Path(folder) / "stiff"),
            "beam, 12": _load(_replace_by_beam(text, 2), Path(folder) / "12"),
            "beam, 18": _load(_replace_by_beam(text, 3), Path(folder) / "18"),
        }
    best = {name: np.full(len(STEPS), np.inf) for name in machines}
    for _ in range(ROUNDS):
        for name, machine in machines.items():
            best[name] = np.minimum(best[name], [_time_solve(machine, motion, step) for step in STEPS])
    steps = motion.duration / np.array(STEPS)
    slopes = {name: 1e6 * float(np.diff(times)[0] / np.diff(steps)[0]) for name, times in best.items()}
    of_beam = float(np.interp(14.0, (12.0, 18.0), (slopes["beam, 12"], slopes["beam, 18"])))
    for name, slope in slopes.items():
        click.echo(f"{name:20}{slope:8.1f} us a step{slope / of_beam:8.2f} of a beam's with 14 unknowns")


def _load(text: str, folder: Path) -> Mechanism:
    """A mechanism of a text, beside the mesh of the model."""
    folder.mkdir()
    (folder / "mechanism.toml").write_text(text)
    (folder / "forearm.inp").write_bytes((MODEL / "forearm.inp").read_bytes())
    return flexinv.load_mechanism(folder)


def _replace_by_beam(text: str, order: int) -> str:
    """The model with a beam in place of its mesh."""
    first = text.index("[links.forearm]")
    last = text.index("[links.hand]")
    behind = text[last:].replace('interface = "flange"', "station = 1.0")
    return text[:first] + BEAM.format(order=order) + behind


def _time_solve(machine: Mechanism, motion: Motion, step: float) -> float:
    """Processor time of one solution [s]."""
    start = time.process_time()
    flexinv.solve(machine, motion, step=step, initial="static")
    return time.process_time() - start


if __name__ == "__main__":
    main()
