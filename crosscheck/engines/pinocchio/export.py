"""Export for Pinocchio: URDF, with the motion and the expected effort in the order of its own parser.

URDF has no loops, springs and forces: closures go along as the vectors of their equations (`loop_closure.equations`), and the
script does with Pinocchio's Jacobians what `pinocchio.loops` does.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NotRequired, TypedDict

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from crosscheck.engines.base import sample_times
from crosscheck.engines.pinocchio import adapter
from crosscheck.engines.pinocchio import phases as pinocchio_phases
from crosscheck.engines.shared import loop_closure as assembly
from crosscheck.engines.shared.export_files import (
    Array,
    JointNumbers,
    JointSpring,
    Motion,
    NotExported,
    SharingSettings,
    check_rigid,
    collect_sharing_settings,
    write,
    write_forces,
)
from crosscheck.engines.shared.urdf_text import has_implicit_root, write_urdf
from flexinv.files.load_cases import Case
from flexinv.model.attachments import GasLaw, Spring
from flexinv.model.mechanism import Attachment, Closure, Joint, Mechanism

Indices = NDArray[np.intp]


class CoordinatePlaces(TypedDict):
    """Places of the coordinates of a joint in Pinocchio's q, and of its first one in v."""

    q: list[int]
    v: int


class FactorRow(CoordinatePlaces):
    """A joint of a coupling, with its factor [-], [rad/m]."""

    factor: float


class AttachmentRow(TypedDict):
    """A link and a frame on it: position [m], rotation matrix by rows [-]."""

    link: str
    position: list[float]
    rotation: list[list[float]]


class ClosureRow(TypedDict):
    """A closure: ends and vectors of its equations [-]; of a coupling offset [rad], [m] and joints."""

    name: str
    kind: str
    first: NotRequired[AttachmentRow]
    second: NotRequired[AttachmentRow]
    positions: NotRequired[list[list[float]]]
    directions: NotRequired[list[list[list[float]]]]
    offset: NotRequired[float]
    coupled: NotRequired[list[FactorRow]]


class GasRow(TypedDict):
    """The law of a gas spring: force / (1 - (l - rest) / travel)^exponent [N], [m], [-]."""

    force: float
    travel: float
    exponent: float


class TableRow(TypedDict):
    """The law of a table: start [m] (null for the first), and coefficients of falling powers of l - start, of each piece."""

    pieces: list[list[float | None]]


class SpringRow(TypedDict):
    """A spring between two points [N/m], [m], [N s/m]; law : of one that is not linear."""

    name: str
    first: AttachmentRow
    second: AttachmentRow
    stiffness: float
    rest: float
    damping: float
    law: GasRow | TableRow | None


class ForceRow(TypedDict):
    """A given force: where it acts, and whether it turns with the link."""

    name: str
    at: AttachmentRow
    follower: bool


class LoopParts(TypedDict):
    """Parts that a URDF does not have: closures, springs and given forces."""

    closures: list[ClosureRow]
    springs: list[SpringRow]
    joint_springs: list[JointSpring]
    forces: list[ForceRow]


class ExportSettings(JointNumbers, SharingSettings, LoopParts):
    """All that ``settings.json`` says."""

    engine: str
    free_base: bool
    gravity_m_per_s2: list[float]


def export(mechanism: Mechanism, case: Case, engine: str, effort: Array, folder: Path) -> None:
    """Write ``model.urdf`` and what goes with it; effort : (samples, nv) [N m] or [N] expected, in mechanism order.

    Raises NotExported for beams and for joints that URDF does not have.
    """
    check_rigid(mechanism, engine)
    text = write_urdf(mechanism)
    if (reason := adapter.unsupported(mechanism, case, engine)) is not None:
        raise NotExported(reason)
    time = sample_times(case)
    free = has_implicit_root(mechanism)
    model = pin.buildModelFromXML(text, *([pin.JointModelFreeFlyer()] if free else []))
    q_order, v_order = _find_coordinate_order(mechanism, model)
    followed = pinocchio_phases.solve_phases(mechanism, case, adapter.build(mechanism), time)
    q, qd, qdd = (np.concatenate(part) for part in zip(*(state for _, state in followed), strict=True))
    q_names, v_names = (
        [names[k] for k in order]
        for names, order in ((mechanism.coordinate_names, q_order), (mechanism.velocity_names, v_order))
    )
    motion = Motion(
        time, q[:, q_order], qd[:, v_order], qdd[:, v_order], effort[:, v_order], q_names, v_names
    )  # fmt: skip
    spans = ((phase.samples, [c.name for c in phase.mechanism.closures]) for phase, _ in followed)
    settings: ExportSettings = {
        "engine": engine,
        "free_base": free,
        "gravity_m_per_s2": mechanism.gravity.tolist(),
        **_collect_joint_numbers(mechanism, v_order),
        **collect_sharing_settings(mechanism, v_order, spans),
        **_collect_loop_parts(mechanism, np.argsort(q_order), np.argsort(v_order)),
    }
    write_forces(folder, mechanism, time)
    write(folder, motion, "run_pinocchio.py.txt", {"model.urdf": text}, settings)


def _collect_joint_numbers(mechanism: Mechanism, order: Indices) -> JointNumbers:
    """Return rotor inertia, damping and friction; order : the mechanism's coordinate at every place."""
    by_coordinate = [j for j in mechanism.joints for _ in range(j.nv)]
    return {
        "rotor_inertia": np.array([j.rotor_inertia for j in by_coordinate])[order].tolist(),
        "damping": np.array([j.damping for j in by_coordinate])[order].tolist(),
        "friction": np.array([j.friction for j in by_coordinate])[order].tolist(),
    }


def _collect_loop_parts(mechanism: Mechanism, q_at: Indices, v_at: Indices) -> LoopParts:
    """Return closures, springs and given forces in words; q_at, v_at : where the mechanism's coordinates stand."""

    def find_indices(name: str) -> CoordinatePlaces:
        q = mechanism.q_slices[name]
        v = mechanism.v_slices[name]
        return {"q": q_at[q].tolist(), "v": int(v_at[v.start])}

    return {
        "closures": [_convert_closure(mechanism, c, find_indices) for c in mechanism.closures],
        "springs": [
            {
                "name": s.name,
                "first": _convert_attachment(s.first),
                "second": _convert_attachment(s.second),
                "stiffness": s.stiffness,
                "rest": s.rest,
                "damping": s.damping,
                "law": _convert_law(s),
            }
            for s in mechanism.springs
        ],
        "joint_springs": [
            {"joint": j.name, "stiffness": j.stiffness, "rest": j.rest, **find_indices(j.name)}
            for j in mechanism.joints
            if j.stiffness
        ],
        "forces": [{"name": f.name, "at": _convert_attachment(f.at), "follower": f.follower} for f in mechanism.forces],
    }


def _convert_law(spring: Spring) -> GasRow | TableRow | None:
    """Return the law of a spring in numbers, None for a linear one."""
    if spring.law is None:
        return None
    if isinstance(spring.law, GasLaw):
        return {"force": spring.law.force, "travel": spring.law.travel, "exponent": spring.law.exponent}
    first, *others = spring.law.list_pieces().tolist()
    return {"pieces": [[None, *first[1:]], *others]}


def _convert_closure(mechanism: Mechanism, closure: Closure, number: Callable[[str], CoordinatePlaces]) -> ClosureRow:
    if closure.kind == "coupling":
        rows: list[FactorRow] = [{"factor": factor, **number(name)} for name, factor in closure.factors]
        return {"name": closure.name, "kind": closure.kind, "offset": closure.offset, "coupled": rows}
    along, pairs = assembly.build_equation_vectors(closure)
    return {
        "name": closure.name,
        "kind": closure.kind,
        "first": _convert_attachment(closure.first),
        "second": _convert_attachment(closure.second),
        "positions": [u.tolist() for u in along],
        "directions": [[u.tolist(), w.tolist()] for u, w in pairs],
    }


def _convert_attachment(at: Attachment) -> AttachmentRow:
    """Return an attachment: link, and its frame there."""
    return {"link": at.link, "position": at.placement.position.tolist(), "rotation": at.placement.rotation.tolist()}


def _find_coordinate_order(mechanism: Mechanism, model: pin.Model) -> tuple[Indices, Indices]:
    """Return the mechanism's coordinate at every index of the model's q and v."""
    q = np.zeros(model.nq, dtype=np.intp)
    v = np.zeros(model.nv, dtype=np.intp)
    for joint in mechanism.joints:
        first_q = mechanism.q_slices[joint.name].start
        first_v = mechanism.v_slices[joint.name].start
        for name, nq, nv in _list_model_joints(joint, has_implicit_root(mechanism) and joint is mechanism.joints[0]):
            theirs = model.joints[model.getJointId(name)]
            q[theirs.idx_q : theirs.idx_q + nq] = first_q + np.arange(nq)
            v[theirs.idx_v : theirs.idx_v + nv] = first_v + np.arange(nv)
            first_q = first_q + nq
            first_v = first_v + nv
    return q, v


def _list_model_joints(joint: Joint, root: bool) -> list[tuple[str, int, int]]:
    """Return name, nq and nv of the model's joints that make up one of the mechanism; root : the reader adds it."""
    if root:
        return [("root_joint", 7, 6)]
    if joint.kind == "universal":
        return [(f"{joint.name}.{k}", 1, 1) for k in (1, 2)]
    return [(joint.name, joint.nq, joint.nv)] if joint.nv else []
