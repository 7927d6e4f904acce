"""What Pinocchio was given, as URDF, with the motion and the expected effort in the order of its own parser."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from crosscheck.engines.base import sample_times
from crosscheck.engines.export_files import Array, Motion, check_rigid, check_tree, write
from crosscheck.engines.urdf_text import urdf
from flexinv.files.case import Case
from flexinv.mechanism import COORDINATES, Joint, Mechanism

Indices = NDArray[np.intp]


def export(mechanism: Mechanism, case: Case, engine: str, effort: Array, folder: Path) -> None:
    """Write ``model.urdf`` and what goes with it; effort : (samples, nv) [N m] or [N] expected, in mechanism order.

    Raises NotExported for beams, loops, springs, given forces, and for joints that URDF does not have.
    """
    check_tree(mechanism, engine)
    check_rigid(mechanism, engine)
    time = sample_times(case)
    text = urdf(mechanism)
    free = mechanism.joints[0].kind == "free"
    model = pin.buildModelFromXML(text, *([pin.JointModelFreeFlyer()] if free else []))
    q_order, v_order = _order(mechanism, model)
    q, qd, qdd = case.motion.evaluate(mechanism, time)
    q_names, v_names = (
        [names[k] for k in order]
        for names, order in ((mechanism.coordinate_names, q_order), (mechanism.velocity_names, v_order))
    )
    motion = Motion(
        time, q[:, q_order], qd[:, v_order], qdd[:, v_order], effort[:, v_order], q_names, v_names
    )  # fmt: skip
    drives = {
        key: np.array([getattr(j, key) for j in mechanism.joints for _ in range(j.nv)])[v_order].tolist()
        for key in ("rotor_inertia", "damping", "friction")
    }
    settings = {"engine": engine, "free_base": free, "gravity_m_per_s2": mechanism.gravity.tolist(), **drives}
    write(folder, motion, "run_pinocchio.py.txt", {"model.urdf": text}, settings)


def _order(mechanism: Mechanism, model: pin.Model) -> tuple[Indices, Indices]:
    """Return which of the mechanism's coordinates stands at every place of the model's q and v."""
    q, v = np.zeros(model.nq, dtype=np.intp), np.zeros(model.nv, dtype=np.intp)
    for joint in mechanism.joints:
        first_q, first_v = mechanism.q_slices[joint.name].start, mechanism.v_slices[joint.name].start
        for name, nq, nv in _parts(mechanism, joint):
            theirs = model.joints[model.getJointId(name)]
            q[theirs.idx_q : theirs.idx_q + nq] = first_q + np.arange(nq)
            v[theirs.idx_v : theirs.idx_v + nv] = first_v + np.arange(nv)
            first_q, first_v = first_q + nq, first_v + nv
    return q, v


def _parts(mechanism: Mechanism, joint: Joint) -> list[tuple[str, int, int]]:
    """Return name, nq and nv of the model's joints that make up one of the mechanism."""
    if joint.kind == "free" and joint is mechanism.joints[0]:
        return [("root_joint", 7, 6)]
    if joint.kind == "universal":
        return [(f"{joint.name}.{k}", 1, 1) for k in (1, 2)]
    q, v = COORDINATES[joint.kind]
    return [(joint.name, len(q), len(v))] if v else []
