"""The equivalence certificate: masses, inertia, gravity, axes, stiffness and closures as an engine's own model has them.

Every engine is asked at the same configurations; what it answers is compared with what flexinv computes from the
mechanism.  Where the certificate holds, the engines have the same mechanism, and dynamics may be compared.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any, NotRequired, TypedDict, cast

import numpy as np

from crosscheck.measures.record import LARGEST, PlainCertificate
from flexinv.typing import Array

# Exact in both: rounding of some thousand operations, and MuJoCo's floor of 2e-15 [kg], [kg m^2] under missing inertia.
EXACT = 1e-9
# What Newton leaves of a closure's equations in any engine [m], [-].
CLOSED = 1e-9
# A static probe of a beam: a load that bends by some 1e-4 of the length, so that geometry adds 1e-8, on a mesh whose error
# in statics under end loads is rounding for uniform sections and a part of the taper for others; as is that of its mass.
PROBED = 1e-3
# Of one mesh in two bases by as many modes: eigenvalues and factors of both leave up to 1e-5 of a part in space.
MESHED = 1e-4
# Derivatives of a torque, of some engines by differences of sixth order, which leave 1e-12.
SLOPES = 1e-9


# Of meshed links: twice the modes of the mechanism's file, so that what is left of a basis is within the bars of flexinv's;
# the slowest modes that are compared; axes of an interface's frame.
TIMES_MODES = 2
COMPARED_MODES = 4
INTERFACE_AXES = ("x", "y", "z", "rx", "ry", "rz")
# Lines whose numbers have no size in common: each is measured against its own.
EACH = ("beam_masses", "beam_moments", "stiffness", "part_stiffness", "part_frequencies", "springs")
# Lines that every mechanism has by its joints: where no name is the same, they are another mechanism's.
BY_JOINT = ("masses", "moments", "inertias", "axes")


@dataclass(frozen=True)
class Certificate:
    """Properties of one engine's model; empty where it cannot state them.

    mass : total of what moves [kg]; masses : of all that each moving joint carries up to the next [kg], by joint
    moments, inertias : of the same, first moment m c (3,) [kg m] and tensor (3, 3) [kg m^2] about the origin of the joint's
        child, along its axes; of what a beam carries, "link at 1", in the frame of its section
    beam_masses, beam_moments : of every straight beam alone [kg], about its root along its axis [kg m]
    com : (configurations, 3) [m], of what moves; mass_matrix : (configurations, nv, nv), rotor inertia included
    gravity : (configurations, nv) [N m] or [N], effort that holds the tree still
    torque_by_place, torque_by_rate : (configurations, nv, nv) derivatives of the efforts of the tree without springs, damping
        and rotors [N m/rad], [N m s/rad], at the rates and accelerations of `probe_states.list_probe_rates`
    axes : by joint with one coordinate, (configurations, 3) [-], in the world
    order : names of the joints in the engine's own order
    stiffness : by "link: EI_z" and so on, of the whole beam, length over the compliance of its sections [N], [N m^2]
    part_stiffness : of meshed links held at the root, by "link: interface x" and so on to "rz", a load over what the frame of the
        interface moves along it under this load alone [N/m], [N m/rad]
    part_frequencies : of meshed links with twice their modes, by "link: held 1" and so on, held at the root, and "link: free 1",
        held nowhere [Hz]
    damping, friction : by joint of what moves, viscous [N m s/rad], [N s/m] and dry [N m], [N]
    springs : by "name: stiffness" [N/m], [N m/rad], "name: rest" [m], [rad], "name: damping" [N s/m], of springs between points
        and in joints
    closure_points, closure_axes : by "name: first" and "name: second", where a closure holds each link (3,) [m] and the axis
        about which it lets it turn (3,) [-], in the frame of the link
    given : what flexinv computed for the engine, in words, by what it is; no check of the engine's own
    residual : largest closure equation [m], [-] in the engine's own motion; rank : of the closures' Jacobian
    """

    mass: float | None = None
    masses: Mapping[str, float] = field(default_factory=dict)
    beam_masses: Mapping[str, float] = field(default_factory=dict)
    beam_moments: Mapping[str, float] = field(default_factory=dict)
    moments: Mapping[str, Any] = field(default_factory=dict)
    inertias: Mapping[str, Any] = field(default_factory=dict)
    com: Any = None
    mass_matrix: Any = None
    gravity: Any = None
    torque_by_place: Any = None
    torque_by_rate: Any = None
    axes: Mapping[str, Any] = field(default_factory=dict)
    order: tuple[str, ...] = ()
    stiffness: Mapping[str, float] = field(default_factory=dict)
    part_stiffness: Mapping[str, float] = field(default_factory=dict)
    part_frequencies: Mapping[str, float] = field(default_factory=dict)
    damping: Mapping[str, float] = field(default_factory=dict)
    friction: Mapping[str, float] = field(default_factory=dict)
    springs: Mapping[str, float] = field(default_factory=dict)
    closure_points: Mapping[str, Any] = field(default_factory=dict)
    closure_axes: Mapping[str, Any] = field(default_factory=dict)
    given: Mapping[str, str] = field(default_factory=dict)
    residual: float | None = None
    rank: int | None = None

    @property
    def plain(self) -> PlainCertificate:
        """Return the certificate as JSON values."""
        values = {name: _convert_to_plain(value) for name, value in asdict(self).items()}
        return cast(PlainCertificate, values)


def build_certificate(plain: PlainCertificate) -> Certificate:
    """Return the certificate of JSON values; unknown keys are left out."""
    known = {f.name for f in fields(Certificate)}
    values: Mapping[str, Any] = {name: value for name, value in plain.items() if name in known}
    return Certificate(**values)


def _convert_to_plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _convert_to_plain(item) for key, item in value.items()}
    if isinstance(value, np.floating | np.integer):
        return value.item()
    return list(value) if isinstance(value, tuple) else value


class RestDynamics(TypedDict):
    """Parts of a certificate by configuration: centre of mass, mass matrix, gravity torque, axes of joints (see there)."""

    com: Array
    mass_matrix: Array
    gravity: Array
    axes: Mapping[str, Array]


class TorqueSlopes(TypedDict, total=False):
    """Parts of a certificate: derivatives of the tree's efforts by place and rate (see there)."""

    torque_by_place: Array
    torque_by_rate: Array


class PassiveElements(TypedDict):
    """Parts of a certificate: damping, friction and springs (see there)."""

    damping: Mapping[str, float]
    friction: Mapping[str, float]
    springs: Mapping[str, float]


class ClosureEnds(TypedDict):
    """Parts of a certificate: points and axes of closures (see there)."""

    closure_points: Mapping[str, Array]
    closure_axes: Mapping[str, Array]


class AttachmentData(PassiveElements, ClosureEnds):
    """Parts of a certificate: all that is stated of joints, springs and closures."""


class CheckLine(TypedDict):
    """A line of a certificate: the fields of `Check` that come after its place."""

    what: str
    unit: str
    holds: bool
    error: NotRequired[float]
    scale: NotRequired[float]
    limit: NotRequired[float]
    words: NotRequired[str]


@dataclass(frozen=True)
class Check:
    """One line of a certificate: the largest difference [unit], what it is measured against, and what is allowed [-]."""

    mechanism: str
    case: str
    engine: str
    what: str
    unit: str
    holds: bool
    error: float | None = None
    scale: float | None = None
    limit: float | None = None
    words: str = ""


def checks(mechanism: str, case: str, engine: str, theirs: Certificate, ours: Certificate) -> tuple[Check, ...]:
    """Return every line that both certificates have; words say where the largest difference is [unit of the line]."""
    here = (mechanism, case, engine)
    lines = [
        *_list_number_lines(theirs, ours),
        *_list_order_lines(theirs, ours),
        *_list_closure_lines(theirs, ours),
        *_list_supplied_lines(theirs),
    ]
    return tuple(Check(*here, **line) for line in lines)


def _list_supplied_lines(theirs: Certificate) -> Iterator[CheckLine]:
    """Lines that say who computed what an engine was given."""
    for what, words in theirs.given.items():
        yield {"what": what, "unit": "-", "holds": True, "words": words}


def is_certified(lines: tuple[Check, ...]) -> bool:
    """Return True if there is a certificate and every line of it holds."""
    return bool(lines) and all(line.holds for line in lines)


def _list_number_lines(theirs: Certificate, ours: Certificate) -> Iterator[CheckLine]:
    for what, unit, name, limit in (
        ("total mass", "kg", "mass", EXACT),
        ("centre of mass", "m", "com", EXACT),
        ("joint-space mass matrix", "kg m^2, kg", "mass_matrix", EXACT),
        ("gravity torque", "N m, N", "gravity", EXACT),
        ("torque by place", "N m/rad, N/m", "torque_by_place", SLOPES),
        ("torque by rate", "N m s/rad, N s/m", "torque_by_rate", SLOPES),
    ):
        a = getattr(theirs, name)
        b = getattr(ours, name)
        if a is not None and b is not None:
            line = _make_line(what, unit, np.asarray(a), np.asarray(b), limit)
            yield _compare_with_inertia(line, ours) if name.startswith("torque") else line
    for what, unit, name, limit in (
        ("masses by joint", "kg", "masses", EXACT),
        ("first moments by joint", "kg m", "moments", EXACT),
        ("inertias by joint", "kg m^2", "inertias", EXACT),
        ("joint axes", "-", "axes", EXACT),
        ("masses of beams", "kg", "beam_masses", PROBED),
        ("first moments of beams", "kg m", "beam_moments", PROBED),
        ("section stiffness", "N, N m^2", "stiffness", PROBED),
        ("stiffness of meshes at interfaces", "N/m, N m/rad", "part_stiffness", MESHED),
        ("frequencies of meshes", "Hz", "part_frequencies", MESHED),
        ("joint damping", "N m s/rad, N s/m", "damping", EXACT),
        ("joint friction", "N m, N", "friction", EXACT),
        ("springs", "N/m, m, N s/m", "springs", EXACT),
        ("closure points", "m", "closure_points", EXACT),
        ("closure axes", "-", "closure_axes", EXACT),
    ):
        a = getattr(theirs, name)
        b = getattr(ours, name)
        both = [key for key in b if key in a]
        if both:
            yield _make_worst_line(
                what, unit, {k: (np.asarray(a[k]), np.asarray(b[k])) for k in both}, limit, name in EACH
            )
        elif a and b and name in BY_JOINT:
            words = f"of {', '.join(sorted(a))}; expected {', '.join(sorted(b))}"
            yield {"what": what, "unit": unit, "holds": False, "words": words}


def _make_line(what: str, unit: str, a: Array, b: Array, limit: float, words: str = "") -> CheckLine:
    if a.shape != b.shape:
        return {"what": what, "unit": unit, "holds": False, "words": f"of shape {a.shape}, expected {b.shape}"}
    size = float(np.abs(a).max(initial=0.0))
    if not size <= LARGEST:
        too_large = f"a number of {size:.3g}, expected at most {LARGEST:g}"
        return {"what": what, "unit": unit, "holds": False, "words": ": ".join(filter(None, [words, too_large]))}
    error = float(np.abs(a - b).max(initial=0.0))
    scale = float(np.abs(b).max(initial=0.0))
    good = error <= limit * (scale or 1.0)
    return {"what": what, "unit": unit, "holds": good, "error": error, "scale": scale, "limit": limit, "words": words}


def _compare_with_inertia(line: CheckLine, ours: Certificate) -> CheckLine:
    """A line of slopes, measured against the largest inertia at 1 rad/s^2 where they are less: many are zero but for rounding."""
    if "error" in line and ours.mass_matrix is not None:
        line["scale"] = max(line["scale"], float(np.abs(np.asarray(ours.mass_matrix)).max(initial=0.0)))
        line["holds"] = line["error"] <= line["limit"] * (line["scale"] or 1.0)
    return line


def _make_worst_line(
    what: str, unit: str, pairs: Mapping[str, tuple[Array, Array]], limit: float, each: bool
) -> CheckLine:
    """Return the line of the key that is farthest off; each : measured against its own size, else the largest one."""
    whole = max(float(np.abs(b).max(initial=0.0)) for _, b in pairs.values()) or 1.0
    lines = {key: _make_line(what, unit, a, b, limit, key) for key, (a, b) in pairs.items()}
    key = max(
        lines, key=lambda k: (lines[k].get("error", np.inf)) / ((lines[k].get("scale") or 1.0) if each else whole)
    )
    line = lines[key]
    if not each and "error" in line:
        line["scale"] = whole
        line["holds"] = line["error"] <= limit * whole
    return line


def _list_order_lines(theirs: Certificate, ours: Certificate) -> Iterator[CheckLine]:
    if theirs.order and ours.order:
        same = sorted(theirs.order) == sorted(ours.order)
        words = "the same" if tuple(theirs.order) == tuple(ours.order) else "mapped by name: " + ", ".join(theirs.order)
        if not same:
            words = f"of {', '.join(theirs.order)}; expected {', '.join(ours.order)}"
        yield {"what": "order of the joints", "unit": "-", "holds": same, "words": words}


def _list_closure_lines(theirs: Certificate, ours: Certificate) -> Iterator[CheckLine]:
    if theirs.residual is not None:
        good = theirs.residual <= CLOSED
        yield {"what": "closure residual", "unit": "m, -", "holds": good, "error": theirs.residual, "limit": CLOSED}
    if theirs.rank is not None and ours.rank is not None:
        words = f"{theirs.rank} independent equations, expected {ours.rank}"
        if theirs.rank != ours.rank:
            words += f": a closure ties {'less' if theirs.rank < ours.rank else 'more'} than it should"
        yield {"what": "rank of the closures", "unit": "-", "holds": theirs.rank == ours.rank, "words": words}
