"""Export for MuJoCo's flex: MJCF of both meshes, with the joints' motion at every step of its integration."""

from __future__ import annotations

from pathlib import Path
from typing import TypedDict

import numpy as np

from crosscheck.arrays import write_arrays
from crosscheck.engines.base import sample_times
from crosscheck.engines.mujoco import flex as adapter
from crosscheck.engines.mujoco.mjcf import write_mjcf
from crosscheck.engines.mujoco.rod import build_flexible_model, build_rod
from crosscheck.engines.shared.export_files import Array, JointNumbers, Motion, NotExported, write
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism


class ExportedRun(TypedDict):
    """A model and the number of its steps in a sample [-]."""

    model: str
    stride: int


class FlexSettings(JointNumbers):
    """All that ``settings.json`` says."""

    engine: str
    runs: list[ExportedRun]
    joints: list[str]


def export(mechanism: Mechanism, case: Case, engine: str, effort: Array, folder: Path) -> None:
    """Write two models and what goes with them; effort : (samples, nv) [N m] or [N] expected, in mechanism order.

    Raises NotExported for what the flex cannot be.
    """
    if (reason := adapter.unsupported(mechanism, case, engine)) is not None:
        raise NotExported(reason)
    time = sample_times(case)
    models = {}
    runs: list[ExportedRun] = []
    steps: dict[str, Array] = {}
    for k, elements in enumerate((adapter.ELEMENTS // 2, adapter.ELEMENTS)):
        rod = build_rod(mechanism, elements)
        step, stride = adapter.plan_steps(case, rod)
        models[f"model_{k}.xml"] = write_mjcf(
            build_flexible_model(mechanism, rod, step).model, mechanism.name, rod.section[1]
        )
        every = np.arange((len(time) - 1) * stride + 1) * step
        q, qd, qdd = case.motion.evaluate(mechanism, every)
        steps |= {f"q_{k}": adapter.convert_to_angles(mechanism, q), f"v_{k}": qd, f"a_{k}": qdd}
        runs.append({"model": f"model_{k}.xml", "stride": stride})
    write_arrays(folder / "steps.npz", steps)
    state = case.motion.evaluate(mechanism, time)
    motion = Motion(time, *state, effort, mechanism.coordinate_names, mechanism.velocity_names)
    by_coordinate = [j for j in mechanism.joints for _ in range(j.nv)]
    settings: FlexSettings = {
        "engine": engine,
        "runs": runs,
        "joints": [j.name for j in mechanism.joints if j.nv],
        "rotor_inertia": [float(j.rotor_inertia) for j in by_coordinate],
        "damping": [float(j.damping) for j in by_coordinate],
        "friction": [float(j.friction) for j in by_coordinate],
    }
    write(folder, motion, "run_mujoco_flex.py.txt", models, settings)
