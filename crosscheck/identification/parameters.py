"""Free parameters: kinds with unit and scale, places, what is known before, and their coordinates z, standard normal before.

value = known exp(error z)  for what is positive by its nature,   value = known + error z  for the rest
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from crosscheck.identification.points import list_point_sensors
from crosscheck.identification.pseudo_inertia import (
    COLUMNS,
    NAMES,
    ROWS,
    compute_prior_errors,
    compute_pseudo_inertia,
    compute_upper_factor,
    convert_to_com,
    make_plausible,
)
from crosscheck.identification.settings import OF_DRIVES, STRAINS, IdentifyTable, list_matching_names
from flexinv.errors import InputError
from flexinv.model.links import Link
from flexinv.model.mechanism import Body, Inertia, Joint, Mechanism, Section
from flexinv.model.parallel_axis import compute_parallel_axis_term
from flexinv.rigid.torque_regressor import compute_link_parameters
from flexinv.typing import Array
from flexinv.validation import find_nearest_word

Key = tuple[str, str]
Values = dict[Key, float]
MASS = "mass properties"
COUPLING = "motor coupling"
TWICE = ("viscous friction", "joint damping")  # the same friction of a measured joint, by its drive or by its joint
ZEROS = {"marker": "m", "accelerometer": "m/s^2"}  # units of the zeros of sensors at points
# A payload before a log tells it: so many times the mass of its link, nine tenths within a factor of 12, and as compact as cubes
# of 900 kg/m^3 are, nine tenths between a carton of 100 and a block of steel.  A moment of inertia is a sum over two axes, of
# which the larger counts: with errors so wide the middle of such sums is that of 900 kg/m^3 where that of each axis is of 2500.
LOAD_SHARE = 0.3
LOAD_DENSITY = 2500.0  # [kg/m^3]
LOAD_ERROR = 1.5
LOAD_SHAPE = 1.0  # of radii of gyration
LOAD_TURN = 0.3  # of the directions of its axes
GJ = 3  # column of a section's stiffness
# What is asked for under a name that is no parameter here -> where it is.
ELSEWHERE = {
    "backlash": "it is read off two encoders: write link_angle in [joints.NAME] and ask for --causes",
    "torque constant": 'it is the gain of the effort: write parameter = "effort gain"',
    "gravity direction": 'write parameter = "gravity tilt x", and another table with "gravity tilt y"',
    "angle offset": "angles are taken as they are: correct the column, or the placement of the joint in mechanism.toml",
    "marker position": 'it is the zero of the marker: write parameter = "marker zero"',
    "payload": f'on a beam write parameter = "payload mass"; on a rigid link it is part of that link: "{MASS}", '
    "or the difference of a log with it: --payload LINK=LOG",
}


@dataclass(frozen=True)
class ParameterKind:
    """A kind of parameter.

    unit : of one that turns and of one that slides; positive : by its nature
    places : "joint" measured, "drive" of one whose effort shows it, "warm drive" of which a temperature is logged, "coupling" of
        a motor with another joint, "any joint", "other joint" that no column measures, "link", "beam", "payload"
        of a beam, "spring", "gauge", "marker", "accelerometer", "world"; class_ : of the synthetic campaign
    known : joint -> value before, where the mechanism has one
    """

    name: str
    unit: tuple[str, str]
    positive: bool
    places: str
    class_: str
    known: Callable[[Joint], float] = lambda joint: 0.0
    solved: bool = False


def _make_kind(
    name: str, unit: str, positive: bool, places: str, class_: str, slides: str = "", **more: object
) -> ParameterKind:
    return ParameterKind(name, (unit, slides or unit), positive, places, class_, **more)  # type: ignore[arg-type]


KINDS = {
    k.name: k
    for k in (
        _make_kind(MASS, "-", False, "link", "mass properties"),
        _make_kind("rotor inertia", "kg m^2", True, "drive", "drives", "kg", known=lambda j: j.rotor_inertia),
        _make_kind("viscous friction", "N m s/rad", True, "drive", "friction", "N s/m", known=lambda j: j.damping),
        _make_kind("coulomb friction", "N m", True, "drive", "friction", "N", known=lambda j: j.friction),
        _make_kind("transition rate", "rad/s", True, "drive", "friction", "m/s"),
        _make_kind("stribeck share", "-", False, "drive", "friction"),
        _make_kind("stribeck rate", "rad/s", True, "drive", "friction", "m/s"),
        _make_kind("friction asymmetry", "N m", False, "drive", "friction", "N"),
        _make_kind("load friction", "-", False, "drive", "friction"),
        _make_kind("quadratic friction", "N m s^2/rad^2", False, "drive", "friction", "N s^2/m^2"),
        _make_kind("viscous friction per kelvin", "1/K", False, "warm drive", "friction"),
        _make_kind("coulomb friction per kelvin", "1/K", False, "warm drive", "friction"),
        _make_kind(COUPLING, "-", False, "coupling", "drives"),
        _make_kind("effort offset", "N m", False, "joint", "sensors", "N"),
        *(
            _make_kind(f"{sense} {name}", unit, positive, "joint" if sense == "effort" else sense, "sensors")
            for sense in ("effort", "gauge", *ZEROS)
            for name, unit, positive in (("gain", "-", True), ("delay", "s", False), ("lag", "s", True))
        ),
        _make_kind("gauge zero", "rad", False, "gauge", "sensors"),
        _make_kind("gauge slope", "rad/rad", False, "gauge", "sensors"),
        *(_make_kind(f"{sense} zero", unit, False, sense, "sensors") for sense, unit in ZEROS.items()),
        _make_kind(
            "joint stiffness", "N m/rad", True, "any joint", "drives", "N/m", known=lambda j: j.stiffness, solved=True
        ),
        _make_kind(
            "joint damping", "N m s/rad", True, "any joint", "drives", "N s/m", known=lambda j: j.damping, solved=True
        ),
        _make_kind(
            "joint friction", "N m", True, "other joint", "friction", "N", known=lambda j: j.friction, solved=True
        ),
        _make_kind("place x", "m", True, "any joint", "beams", solved=True),
        _make_kind("beam stiffness", "-", True, "beam", "beams", solved=True),
        _make_kind("torsion stiffness", "-", True, "beam", "beams", solved=True),
        _make_kind("beam damping", "s", True, "beam", "beams", solved=True),
        _make_kind("beam length", "m", True, "beam", "beams", solved=True),
        _make_kind("payload mass", "kg", True, "payload", "mass properties", solved=True),
        _make_kind("spring force", "-", True, "spring", "drives"),
        _make_kind("gravity tilt x", "rad", False, "world", "sensors"),
        _make_kind("gravity tilt y", "rad", False, "world", "sensors"),
    )
}


@dataclass(frozen=True)
class Parameter:
    """One free number: kind, place (with component, of mass properties), unit, value known before, its error, and scale.

    known [unit]; error : of the logarithm where positive [-], else [unit]
    load : link whose payload it is one of, which few logs have; "" : of the machine itself
    """

    kind: str
    place: str
    unit: str
    known: float
    error: float
    positive: bool
    load: str = ""

    @property
    def key(self) -> Key:
        """Kind and place [-]."""
        return self.kind, self.place

    def compute_value(self, z: float) -> float:
        """Return the value [unit] at a coordinate z [-]."""
        return self.known * float(np.exp(self.error * z)) if self.positive else self.known + self.error * z


@dataclass(frozen=True)
class ParameterSpace:
    """All free parameters of a mechanism.

    factors : L (4, 4) of the mass properties of links that are free, and of payloads
    more : m, h, I (10,) beside them [kg], [kg m], [kg m^2]
    """

    parameters: tuple[Parameter, ...]
    factors: Mapping[str, Array]
    more: Mapping[str, Array] = field(default_factory=dict)

    @property
    def loads(self) -> tuple[str, ...]:
        """Links that carry a payload in some of the logs [-]."""
        return tuple(dict.fromkeys(p.load for p in self.parameters if p.load))

    @property
    def changed_links(self) -> tuple[str, ...]:
        """Links whose mass properties are not those of the mechanism, in some of the logs at least [-]."""
        loads = self.loads
        return tuple(dict.fromkeys([n for n in self.factors if n not in map(make_load_place, loads)] + list(loads)))

    def compute_values(self, z: Array, load: str = "") -> Values:
        """Return the values [units of the parameters] at coordinates z (parameters,) [-]; load : link with its payload."""
        both = zip(self.parameters, z, strict=True)
        return {p.key: p.compute_value(float(x)) for p, x in both if p.load in ("", load)}

    def describe_parameters(self) -> list[str]:
        """Return the parameters in words [-]."""
        return [f"{p.kind} of {p.place}" for p in self.parameters]


def make_load_place(link: str) -> str:
    """Return the place of the parameters of a link's payload [-]."""
    return f"payload of {link}"


def build_space(mechanism: Mechanism, settings: IdentifyTable, loads: Sequence[str] = ()) -> ParameterSpace:
    """Return the free parameters with what is known before [units of the parameters]; loads : links with payloads in some logs.

    Raises InputError: unknown kind, no such place, free twice, nothing known of what is positive.
    """
    parameters: dict[Key, Parameter] = {}
    factors: dict[str, Array] = {}
    for free in settings.free:
        kind = _find_kind(free.parameter)
        names = list_places(mechanism, settings, kind)
        chosen = list_matching_names(free.place, names)
        if not chosen:
            expected = f"one of {', '.join(names)}" if names else f"a mechanism that has a place for it ({kind.places})"
            if kind.name in OF_DRIVES and list_matching_names(free.place, _list_link_sensors(settings)):
                expected += (
                    ': the torque sensor is behind the gear, side = "link", which sees no rotor and no motor friction'
                )
            raise InputError(
                f"identify.toml, [[free]] {free.parameter}: place {', '.join(free.place)} means nothing here, "
                f"expected {expected}; remove the table or mend it"
            )
        for place in chosen:
            if kind.name == MASS:
                factors[place] = _compute_factor(compute_link_parameters(mechanism.link_of[place]), settings)
                errors = compute_prior_errors(factors[place], free.relative or free.error or 0.0)
                made = _make_mass_parameters(place, errors)
            else:
                made = [_make_parameter(mechanism, settings, kind, place, free.value, free.relative, free.error)]
            parameters |= {p.key: p for p in made}
    _check_friction_once(parameters)
    _check_loads(loads, list_places(mechanism, settings, KINDS[MASS]))
    for name in loads:
        place = make_load_place(name)
        factors[place] = _compute_factor(_compute_usual_load(mechanism.link_of[name]), settings)
        errors = compute_prior_errors(factors[place], LOAD_ERROR, LOAD_SHAPE, LOAD_TURN)
        parameters |= {p.key: p for p in _make_mass_parameters(place, errors, name)}
    return ParameterSpace(tuple(parameters.values()), factors)


def _list_link_sensors(settings: IdentifyTable) -> list[str]:
    """The joints whose efforts are measured behind the gear."""
    return [name for name, table in settings.joints.items() if table.has_link_sensor]


def _check_friction_once(parameters: Mapping[Key, Parameter]) -> None:
    """Raise InputError where the viscous friction of a joint is free under two names."""
    drive, joint = TWICE
    for kind, place in parameters:
        if kind == joint and (drive, place) in parameters:
            raise InputError(
                f"identify.toml, [[free]] {joint}: {place} has its {drive} free, too, and both are the same friction, "
                f"expected one of them; remove {place} from one of the two tables"
            )


def _check_loads(loads: Sequence[str], links: list[str]) -> None:
    """Raise InputError where a payload is on no rigid link with mass."""
    for name in loads:
        if name not in links:
            near = find_nearest_word(name, links) or (links or ["LINK"])[-1]
            expected = f"a rigid link with mass: {', '.join(links)}"
            raise InputError(f"identify: a payload on {name!r}, expected {expected}; write --payload {near}=LOG")


def _compute_factor(ten: Array, settings: IdentifyTable) -> Array:
    """The factor L (4, 4) of a body with m, h, I (10,) [kg], [kg m], [kg m^2] that are known before."""
    return compute_upper_factor(compute_pseudo_inertia(make_plausible(ten, settings.least_radius_m)))


def _make_mass_parameters(place: str, errors: Array, load: str = "") -> list[Parameter]:
    """The ten parameters of a body with these errors [-] of what is known of it before."""
    return [Parameter(MASS, f"{place}.{n}", "-", 0.0, e, False, load) for n, e in zip(NAMES, errors, strict=True)]


def _compute_usual_load(link: Link) -> Array:
    """A payload before a log tells it, m, h, I (10,) [kg], [kg m], [kg m^2]: small, on the link, at its tip if there is one."""
    mass, com = np.split(convert_to_com(compute_link_parameters(link))[:4], [1])
    where = link.tip if np.any(link.tip) else com
    load = float(LOAD_SHARE * mass[0])
    tensor = load * (load / LOAD_DENSITY) ** (2.0 / 3.0) / 6.0 * np.eye(3)
    tensor += compute_parallel_axis_term(load, where)
    return np.concatenate([[load], load * where, tensor[ROWS, COLUMNS]])


def _find_kind(name: str) -> ParameterKind:
    if name in KINDS:
        return KINDS[name]
    hint = ELSEWHERE.get(name, f'write parameter = "{find_nearest_word(name, list(KINDS)) or MASS}"')
    raise InputError(f"identify.toml, [[free]]: parameter {name!r}, expected one of {', '.join(KINDS)}; {hint}")


def _list_drive_places(mechanism: Mechanism, settings: IdentifyTable) -> dict[str, list[str]]:
    """The joints that are measured, and of their drives those that efforts show, that are warmed, and that follow others."""
    measured = [j.name for j in mechanism.joints if j.name in settings.joints]
    drives = [name for name in measured if not settings.joints[name].has_link_sensor]
    return {
        "joint": measured,
        "drive": drives,
        "warm drive": [name for name in drives if settings.joints[name].temperature is not None],
        "coupling": [f"{name}/{other}" for name in drives for other in settings.joints[name].follows],
    }


def list_places(mechanism: Mechanism, settings: IdentifyTable, kind: ParameterKind) -> list[str]:
    """Return the places at which a kind of parameter may be free [-]."""
    return {
        **_list_drive_places(mechanism, settings),
        "any joint": [j.name for j in mechanism.joints],
        "other joint": [j.name for j in mechanism.joints if j.nv and j.name not in settings.joints],
        "link": [
            link.name for link in mechanism.links if link.beam is None and sum(b.inertia.mass for b in link.bodies) > 0
        ],
        "beam": [link.name for link in mechanism.beams],
        "payload": list(_list_payloads(mechanism)),
        "spring": [s.name for s in mechanism.springs],
        "gauge": list(settings.gauges),
        **{kind: [one.place for one in list_point_sensors(settings) if one.kind == kind] for kind in ZEROS},
        "world": ["world"],
    }[kind.places]


def _find_beam_value(mechanism: Mechanism, kind: ParameterKind, place: str) -> float:
    """Length [m] or retardation time [s] of a beam, or the mass of a payload on it [kg]."""
    if kind.name == "payload mass":
        return float(_list_payloads(mechanism)[place].inertia.mass)
    beam = mechanism.link_of[place].beam
    if beam is None:
        return 0.0
    if kind.name == "beam length":
        return beam.length
    if beam.section.damping is None:
        return 0.0
    return float(beam.section.damping_matrices[0, 5, 5] / beam.section.stiffness_matrices[0, 5, 5])


def _list_payloads(mechanism: Mechanism) -> dict[str, Body]:
    """The bodies that beams carry, by the place ``beam/payload`` of their mass."""
    return {f"{link.name}/{body.name}": body for link in mechanism.beams for body in link.bodies}


def _make_parameter(
    mechanism: Mechanism,
    settings: IdentifyTable,
    kind: ParameterKind,
    place: str,
    value: float | None,
    relative: float | None,
    error: float | None,
) -> Parameter:
    joint = mechanism.joint_of.get(place)
    slides = joint is not None and joint.kind == "prismatic"
    strained = kind.places == "gauge" and settings.gauges[place].unit in STRAINS
    unit = {"rad": "m/m", "rad/rad": "1/rad"}.get(kind.unit[0], kind.unit[0]) if strained else kind.unit[slides]
    known = find_prior_value(mechanism, settings, kind, place) if value is None else value
    if kind.positive and known <= 0.0:
        raise InputError(
            f"identify.toml, [[free]] {kind.name} of {place}: nothing is known of it before (the mechanism says 0), expected "
            f"a value > 0 [{unit}]; write value = 0.1, with a relative error as wide as you like"
        )
    if kind.positive:
        wide = relative if relative is not None else float(np.log1p((error or 0.0) / known))
        return Parameter(kind.name, place, unit, known, wide, True)
    return Parameter(
        kind.name, place, unit, known, error if error is not None else (relative or 0.0) * abs(known or 1.0), False
    )


def find_prior_value(mechanism: Mechanism, settings: IdentifyTable, kind: ParameterKind, place: str) -> float:
    """Return the value of a parameter in the mechanism [unit of the parameter]."""
    joint = mechanism.joint_of.get(place)
    if kind.name in ("transition rate", "stribeck rate"):
        return settings.still_rad_per_s * (1.0 if kind.name == "transition rate" else 10.0)
    if kind.name == COUPLING:
        name, _, other = place.partition("/")
        return float(settings.joints[name].follows[other])
    if kind.places == "drive" and place in settings.joints and settings.joints[place].has_link_sensor:
        return 0.0
    if kind.name in ("beam stiffness", "torsion stiffness", "spring force") or kind.name.endswith(" gain"):
        return 1.0
    if kind.places in ("beam", "payload"):
        return _find_beam_value(mechanism, kind, place)
    if kind.name == "place x" and joint is not None:
        return float(joint.placement.position[0])
    return kind.known(joint) if joint is not None else 0.0


def _apply_section_values(section: Section, beam: str, values: Mapping[Key, float]) -> Section:
    """A section with factors of its stiffness [-] and a retardation time [s], by which damping follows stiffness."""
    factor = values.get(("beam stiffness", beam), 1.0)
    turn = values.get(("torsion stiffness", beam))
    if turn is not None:
        section.check_independent(f"identify: torsion stiffness of {beam}")

    def scale(table: Array) -> Array:
        out = table * factor
        if turn is not None:
            out[:, GJ] *= turn
        return out

    stiff = scale(section.stiffness)
    rate = values.get(("beam damping", beam))
    kept = None if section.damping is None else scale(section.damping)
    return replace(section, stiffness=stiff, damping=kept if rate is None else stiff * rate)


def _apply_payload_mass(body: Body, beam: str, values: Mapping[Key, float]) -> Body:
    """A body that a beam carries, with another mass [kg]: its centre and its radii of gyration stay."""
    mass = values.get(("payload mass", f"{beam}/{body.name}"))
    if mass is None:
        return body
    inertia = body.inertia
    return replace(body, inertia=Inertia(mass, inertia.com, inertia.tensor * (mass / inertia.mass)))


def apply_values(mechanism: Mechanism, values: Mapping[Key, float]) -> Mechanism:
    """Return the mechanism with those values [units of the parameters] that time integration has to know."""

    def apply_joint_values(joint: Joint) -> Joint:
        changes: dict[str, object] = {}
        for name in ("stiffness", "damping", "friction"):
            kind = f"joint {name}"
            if (kind, joint.name) in values:
                changes[name] = values[kind, joint.name]
        if ("place x", joint.name) in values:
            position = joint.placement.position.copy()
            position[0] = values["place x", joint.name]
            changes["placement"] = replace(joint.placement, position=position)
        return replace(joint, **changes) if changes else joint  # type: ignore[arg-type]

    links = []
    for link in mechanism.links:
        beam = link.beam
        if beam is not None:
            length = values.get(("beam length", link.name), beam.length)
            beam = replace(beam, length=length, section=_apply_section_values(beam.section, link.name, values))
            link = replace(
                link, beam=beam, bodies=tuple(_apply_payload_mass(b, link.name, values) for b in link.bodies)
            )
        links.append(link)
    return replace(mechanism, joints=tuple(apply_joint_values(j) for j in mechanism.joints), links=tuple(links))
