"""What Exudyn was given, as a Python script that builds the same system item by item, and what reads its efforts.

The tree of rigid bodies is written as arrays of ``KinematicTree66``; models in time are recorded while they run
(`exudyn_script`).  There the effort along a joint is one component of one reaction (see the heads of `exudyn_planar`,
`exudyn_spatial`): the moment or force along the connector's x axis, or the force of the coordinate connector.
"""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import numpy as np

from crosscheck.engines import exudyn as adapter
from crosscheck.engines import exudyn_rigid, exudyn_solve
from crosscheck.engines.base import sample_times
from crosscheck.engines.export_files import Array, Motion, NotExported, check_rigid, check_tree, write
from crosscheck.engines.exudyn_frames import compose, joint_pose, joint_q
from crosscheck.engines.exudyn_march import TREE, choose, layout_of
from crosscheck.engines.exudyn_script import Recorded, recording, source
from crosscheck.engines.exudyn_solve import Plan, grid
from flexinv.files.case import Case
from flexinv.mechanism import Mechanism, Placement

HEAD = '''"""The model, item by item, and the solver's settings."""

from __future__ import annotations

import exudyn as exu
import numpy as np
from exudyn.itemInterface import *  # noqa: F403


def section(massPerLength, inertia, stiffnessMatrix, dampingMatrix):
    made = exu.BeamSection()
    made.massPerLength, made.inertia = massPerLength, np.array(inertia)
    made.stiffnessMatrix, made.dampingMatrix = np.array(stiffnessMatrix), np.array(dampingMatrix)
    return made
'''
PLAIN = {"error": False}  # the runs that the result itself needs
COORDINATES = ("revolute", "continuous", "prismatic")


def export(mechanism: Mechanism, case: Case, engine: str, effort: Array, folder: Path) -> None:
    """Write model and script; effort : (samples, nv) [N m] or [N] expected, in mechanism order.

    Raises NotExported for loops, springs, given forces, and in time for joints of several coordinates.
    """
    check_tree(mechanism, engine)
    if engine == TREE:
        check_rigid(mechanism, engine)
    if (reason := adapter.unsupported(mechanism, case, engine)) is not None:
        raise NotExported(reason)
    time = sample_times(case)
    motion = Motion(
        time, *case.motion.evaluate(mechanism, time), effort, mechanism.coordinate_names, mechanism.velocity_names
    )  # fmt: skip
    settings: dict[str, Any] = {"engine": engine} | {
        key: [float(getattr(j, key)) for j in mechanism.joints for _ in range(j.nv)]
        for key in ("rotor_inertia", "damping", "friction")
    }
    if engine == TREE:
        _tree(mechanism, motion, settings, folder)
    else:
        _in_time(mechanism, case, engine, motion, settings, folder)


def _tree(mechanism: Mechanism, motion: Motion, settings: dict[str, Any], folder: Path) -> None:
    tree = exudyn_rigid.build(mechanism, wrench=False)
    angle, rate, rate2 = exudyn_rigid.elementary(mechanism, tree, motion.q, motion.v, motion.a)
    moving: dict[str, Any] = {}
    for name, (first, before, after) in tree.moving.items():
        joint = mechanism.joint_of[name]
        places = zip(*joint_pose(joint, joint_q(mechanism, joint, motion.q)), strict=True)
        frames = [compose(compose(before, Placement(*place)), after) for place in places]
        moving[f"moving_{first}"] = np.array([exudyn_rigid.transform66(frame) for frame in frames])
    moving |= {"transforms": np.array(tree.transforms), "inertias": np.array(tree.inertias), "velocity": tree.velocity}
    moving |= {"angle": angle, "rate": rate, "rate2": rate2}
    np.savez_compressed(folder / "model.npz", allow_pickle=False, **moving)
    settings |= {"types": tree.types, "parents": [int(p) for p in tree.parents], "gravity": mechanism.gravity.tolist()}
    write(folder, motion, "run_exudyn_tree.py.txt", {}, settings)


def _in_time(
    mechanism: Mechanism, case: Case, engine: str, motion: Motion, settings: dict[str, Any], folder: Path
) -> None:
    for joint in mechanism.joints:
        if joint.nv and joint.kind not in COORDINATES:
            raise NotExported(
                f"joint {joint.name!r}: its efforts depend on the position of a {joint.kind} joint; for models in time "
                f"{', '.join(COORDINATES)} joints are exported"
            )
    with recording() as runs:
        adapter.run(mechanism, case, engine, PLAIN)
    kept = _last_tries(runs)
    flat = choose(mechanism, case, engine, PLAIN).plane is not None
    texts = [source(run).replace("def build(", f"def build_{k}(", 1) for k, run in enumerate(kept)]
    told = inspect.getsource(exudyn_solve.settings)
    arrays: dict[str, Array] = {}
    for k, run in enumerate(kept):
        for d, driver in enumerate(run.drivers):
            arrays[f"offset_{k}_{d}"] = _table(run.plan, driver.offset)
            if driver.rate is not None:
                arrays[f"rate_{k}_{d}"] = _table(run.plan, driver.rate)
    np.savez_compressed(folder / "drivers.npz", allow_pickle=False, **arrays)
    settings["runs"] = [_run(mechanism, case, run, flat) for run in kept]
    settings["weights"] = [1.0] if len(kept) == 1 else [-1 / 3, 4 / 3]
    text = "\n\n".join([HEAD, told, *texts])
    write(folder, motion, "run_exudyn.py.txt", {"model.py": text}, settings)


def _last_tries(runs: list[Recorded]) -> list[Recorded]:
    """Return the run that held of every model: a stalled one is repeated at once with a looser tolerance."""
    last = {(run.plan.step, len(run.calls)): run for run in runs}
    return list(last.values())


def _table(plan: Plan, function: Any) -> Array:
    """Return what a user function gives at every step, (steps + 1, columns)."""
    return np.array([np.atleast_1d(function(None, float(t), 0, 0)) for t in grid(plan)])


def _run(mechanism: Mechanism, case: Case, run: Recorded, flat: bool) -> dict[str, Any]:
    plan = run.plan
    told = {
        name: getattr(plan, name)
        for name in (
            "end",
            "step",
            "sample",
            "steps",
            "index2",
            "spectral_radius",
            "tolerance",
            "extrapolate",
            "static_start",
        )
    }
    layout = layout_of(mechanism, case)
    effort = []
    for joint in mechanism.joints:
        if not joint.nv:
            continue
        if flat:
            axis = layout.start(layout.joint[joint.name]).rotation @ joint.axis
            plane = choose(mechanism, case, "", PLAIN).plane
            assert plane is not None
            effort.append([[int(run.reactions["motor", joint.name]), 0, -float(np.sign(plane[:, 2] @ axis))]])
        elif joint.kind == "prismatic":
            keys = [key for key in run.reactions if key[:2] == ("force", joint.name)]
            effort.append([[int(run.reactions[key]), 0, -1.0] for key in keys])
        else:
            effort.append([[int(run.reactions["moment", joint.name]), 0, -1.0]])
    return told | {"drivers": [int(d.number) for d in run.drivers], "effort": effort}
