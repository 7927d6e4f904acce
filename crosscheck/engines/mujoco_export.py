"""What MuJoCo was given, as MJCF that its viewer opens, with the motion and the expected effort in its coordinates.

The text is written from the compiled model, every number in full: ``MjSpec.to_xml`` of 4.0.0 rounds to six digits.
Slim capsules without mass make the bodies visible; inertias are explicit, so they change nothing.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import mujoco
import numpy as np

from crosscheck.engines import mujoco as adapter
from crosscheck.engines.base import sample_times
from crosscheck.engines.export_files import Array, Motion, check_rigid, check_tree, write
from crosscheck.engines.mujoco_model import Built, build
from flexinv.files.case import Case
from flexinv.mechanism import Joint, Mechanism

KINDS = {"mjJNT_FREE": "free", "mjJNT_BALL": "ball", "mjJNT_SLIDE": "slide", "mjJNT_HINGE": "hinge"}
SUFFIX = {
    "free": (".vx", ".vy", ".vz", ".wx", ".wy", ".wz"),
    "spherical": (".wx", ".wy", ".wz"),
    "universal": (".1", ".2"),
}
PLACE = {"free": (".x", ".y", ".z", ".qw", ".qx", ".qy", ".qz"), "spherical": (".qw", ".qx", ".qy", ".qz"),
         "universal": (".1", ".2")}  # fmt: skip


def export(mechanism: Mechanism, case: Case, engine: str, effort: Array, folder: Path) -> None:
    """Write ``model.xml`` and what goes with it; effort : (samples, nv) [N m] or [N] expected, in mechanism order.

    Raises NotExported for beams, loops, springs and given forces.
    """
    check_tree(mechanism, engine)
    check_rigid(mechanism, engine)
    time = sample_times(case)
    q, qd, qdd = case.motion.evaluate(mechanism, time)
    built = build(mechanism)
    state = adapter.to_engine(mechanism, built, q, qd, qdd)
    q_names, v_names = [""] * built.model.nq, [""] * built.model.nv
    for joint in mechanism.joints:
        if joint.nv:
            _name(q_names, built.q_at[joint.name], joint, PLACE)
            _name(v_names, built.v_at[joint.name], joint, SUFFIX)
    expected = _to_engine(mechanism, built, q, effort)
    motion = Motion(time, state.q, state.v, state.a, expected, q_names, v_names)
    write(folder, motion, "run_mujoco.py.txt", {"model.xml": mjcf(built.model, mechanism.name)}, {"engine": engine})


def _name(names: list[str], first: int, joint: Joint, suffixes: dict[str, tuple[str, ...]]) -> None:
    for k, suffix in enumerate(suffixes.get(joint.kind, ("",))):
        names[first + k] = joint.name + suffix


def _to_engine(mechanism: Mechanism, built: Built, q: Array, effort: Array) -> Array:
    """Return the mechanism's efforts as MuJoCo's generalized forces: the inverse of `mujoco.effort_from_engine`.

    That map is orthogonal (it turns forces of free joints), so its transpose, column by column, is the inverse.
    """
    out = np.zeros_like(effort)
    for column in range(effort.shape[1]):
        unit = np.zeros_like(effort)
        unit[:, column] = 1.0
        out[:, column] = np.sum(adapter.effort_from_engine(mechanism, built, q, unit) * effort, axis=1)
    return out


def mjcf(model: Any, name: str) -> str:
    """Return the MJCF of a compiled model of rigid bodies and joints."""
    root = ET.Element("mujoco", model=name)
    ET.SubElement(root, "compiler", angle="radian", fusestatic="false")
    ET.SubElement(root, "option", gravity=_text(model.opt.gravity))
    bodies = {0: ET.SubElement(root, "worldbody")}
    for k in range(1, model.nbody):
        body = bodies[k] = ET.SubElement(bodies[model.body_parentid[k]], "body", _body(model, k))
        if model.body_mass[k] > 0:
            inertia = {"mass": model.body_mass[k], "diaginertia": model.body_inertia[k]}
            placed = {"pos": model.body_ipos[k], "quat": model.body_iquat[k]}
            ET.SubElement(body, "inertial", {key: _text(value) for key, value in (placed | inertia).items()})
        for j in range(model.body_jntadr[k], model.body_jntadr[k] + model.body_jntnum[k]):
            ET.SubElement(body, "joint", _joint(model, j))
        for end in [model.body_pos[c] for c in range(k + 1, model.nbody) if model.body_parentid[c] == k] + [
            model.body_ipos[k]
        ]:
            if np.linalg.norm(end) > 0:
                shape = {"type": "capsule", "fromto": _text([0, 0, 0, *end]), "size": _text(np.linalg.norm(end) / 20)}
                ET.SubElement(body, "geom", shape | {"mass": "0", "contype": "0", "conaffinity": "0"})
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _body(model: Any, k: int) -> dict[str, str]:
    return {"name": model.body(k).name, "pos": _text(model.body_pos[k]), "quat": _text(model.body_quat[k])}


def _joint(model: Any, j: int) -> dict[str, str]:
    kind, dof = KINDS[mujoco.mjtJoint(model.jnt_type[j]).name], model.jnt_dofadr[j]
    out = {"name": model.joint(j).name, "type": kind}
    if kind in ("slide", "hinge"):
        out["axis"] = _text(model.jnt_axis[j])
    numbers = {"armature": model.dof_armature, "damping": model.dof_damping, "frictionloss": model.dof_frictionloss}
    out |= {key: _text(values[dof]) for key, values in numbers.items() if np.any(values[dof])}
    if model.dof_frictionloss[dof]:
        out["solreffriction"] = _text(model.dof_solref[dof])
    return out


def _text(numbers: Any) -> str:
    return " ".join(repr(float(x)) for x in np.ravel(numbers))
