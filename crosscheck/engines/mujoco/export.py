"""Export for MuJoCo: MJCF that its viewer opens, with the motion and the expected effort in its coordinates.

The text is written from the compiled model, every number in full: ``MjSpec.to_xml`` of 4.0.0 rounds to six digits.
Slim capsules without mass make the bodies visible; inertias are explicit, so they change nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from crosscheck.engines.base import sample_times
from crosscheck.engines.mujoco import adapter
from crosscheck.engines.mujoco import loops as mujoco_loops
from crosscheck.engines.mujoco.joints import (
    BuiltModel,
    State,
    convert_effort_from_engine,
    convert_from_engine,
    describe_joint_refusal,
)
from crosscheck.engines.mujoco.mjcf import write_mjcf
from crosscheck.engines.mujoco.model import build
from crosscheck.engines.shared.export_files import (
    Array,
    Motion,
    NotExported,
    check_rigid,
    collect_sharing_settings,
    write,
    write_forces,
)
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Force, Joint, Mechanism

SUFFIX = {
    "free": (".vx", ".vy", ".vz", ".wx", ".wy", ".wz"),
    "spherical": (".wx", ".wy", ".wz"),
    "universal": (".1", ".2"),
}
PLACE = {"free": (".x", ".y", ".z", ".qw", ".qx", ".qy", ".qz"), "spherical": (".qw", ".qx", ".qy", ".qz"),
         "universal": (".1", ".2")}  # fmt: skip


UNBOUND = 1e9  # [rad], [m]: the other end of a range of which one end is stated


def build_mjcf(mechanism: Mechanism) -> tuple[BuiltModel, str]:
    """Return the model of a rigid mechanism and its MJCF: joints with limits, drives, closures, springs.

    Raises NotExported for beams, for what MJCF has no word for, and with MuJoCo's words where it refuses the mechanism.
    """
    check_rigid(mechanism, "mujoco")
    if strange := mujoco_loops.list_missing_equalities(mechanism):
        raise NotExported(f"closures ({', '.join(strange)}) have no equality constraint in MJCF: see pinocchio")
    for joint in mechanism.joints:
        if (reason := describe_joint_refusal(mechanism, joint)) is not None:
            raise NotExported(reason)
    try:
        built = build(mechanism, extend=_make_spec_extender(mechanism))
    except ValueError as error:
        raise NotExported(f"MuJoCo refuses it: {' '.join(str(error).split())}") from error
    if built.model.nv != mechanism.nv:
        raise NotExported(
            "a joint is made up of several of MuJoCo's that move in a ratio, which MJCF alone does not keep"
        )
    return built, write_mjcf(built.model, mechanism.name)


def export(mechanism: Mechanism, case: Case, engine: str, effort: Array, folder: Path) -> None:
    """Write ``model.xml`` and what goes with it; effort : (samples, nv) [N m] or [N] expected, in mechanism order.

    Raises NotExported for beams and for closures that none of MuJoCo's equalities makes up.
    """
    built, text = build_mjcf(mechanism)
    if (reason := adapter.unsupported(mechanism, case, engine)) is not None:
        raise NotExported(reason)
    time = sample_times(case)
    followed = adapter.solve_phases(mechanism, case, built, time)
    state = State(*(np.concatenate(part) for part in zip(*(state for _, state in followed), strict=True)))
    q_names = [""] * built.model.nq
    v_names = [""] * built.model.nv
    order = np.zeros(built.model.nv, dtype=np.intp)
    for joint in mechanism.joints:
        if joint.nv:
            _fill_names(q_names, built.q_at[joint.name], joint, PLACE)
            _fill_names(v_names, built.v_at[joint.name], joint, SUFFIX)
            columns = mechanism.v_slices[joint.name]
            order[built.v_at[joint.name] + np.arange(joint.nv)] = np.arange(columns.start, columns.stop)
    expected = _convert_efforts(mechanism, built, convert_from_engine(mechanism, built, state.q), effort)
    motion = Motion(time, state.q, state.v, state.a, expected, q_names, v_names)
    spans = ((phase.samples, [c.name for c in phase.mechanism.closures]) for phase, _ in followed)
    given = [{"site": _format_site_name(f), "follower": f.follower} for f in mechanism.forces]
    settings = {"engine": engine, "forces": given, **collect_sharing_settings(mechanism, order, spans)}
    write_forces(folder, mechanism, time)
    write(folder, motion, "run_mujoco.py.txt", {"model.xml": text}, settings)


def _make_spec_extender(mechanism: Mechanism) -> Callable[[Any], None]:
    """Return a function that adds closures, springs, limits, and a site for every given force, to an MjSpec."""
    furnish = mujoco_loops.make_loop_extender(mechanism)

    def add_parts(spec: Any) -> None:
        furnish(spec)
        for joint in mechanism.joints:
            if joint.kind in ("revolute", "prismatic") and np.isfinite([joint.limits.lower, joint.limits.upper]).any():
                made = spec.joint(joint.name)
                made.limited = True
                made.range = np.clip([joint.limits.lower, joint.limits.upper], -UNBOUND, UNBOUND)
            if joint.kind in ("revolute", "prismatic", "continuous") and np.isfinite(joint.limits.effort):
                made = spec.joint(joint.name)
                made.actfrclimited = True
                made.actfrcrange = [-joint.limits.effort, joint.limits.effort]
        for force in mechanism.forces:
            mujoco_loops.add_site(spec, force.at, _format_site_name(force), np.zeros(3))

    return add_parts


def _format_site_name(force: Force) -> str:
    return f"{force.name}/force"


def _fill_names(names: list[str], first: int, joint: Joint, suffixes: dict[str, tuple[str, ...]]) -> None:
    for k, suffix in enumerate(suffixes.get(joint.kind, ("",))):
        names[first + k] = joint.name + suffix


def _convert_efforts(mechanism: Mechanism, built_model: BuiltModel, q: Array, effort: Array) -> Array:
    """Return the mechanism's efforts as MuJoCo's generalized forces: the inverse of `mujoco.joints.effort_from_engine`.

    That map is orthogonal (it turns forces of free joints), so its transpose, column by column, is the inverse.
    """
    out = np.zeros_like(effort)
    for column in range(effort.shape[1]):
        unit = np.zeros_like(effort)
        unit[:, column] = 1.0
        out[:, column] = np.sum(convert_effort_from_engine(mechanism, built_model, q, unit) * effort, axis=1)
    return out
