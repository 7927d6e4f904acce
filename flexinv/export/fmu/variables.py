"""Variables of an FMU: motion, efforts, parameters and readings by name and unit, and where the C file keeps them.

A variable's value reference is its place in the list.  Names are those of crosscheck's door:

    NAME.q, NAME.qd, NAME.qdd, NAME.tau    of each coordinate and each rate, as the mechanism names them
    phase                                  which closures act, where they come and go
    BEAM.deflection.x ..., LINK.tip.x ...  readings
    gravity.x ..., JOINT.friction, JOINT.damping, LINK.payload.mass, .payload.centre.x ..., .payload.inertia.xx ...
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from flexinv.errors import InputError
from flexinv.export.acting_sets import has_phases, list_acting_sets
from flexinv.export.library_plan import LibraryPlan
from flexinv.export.names import format_line
from flexinv.kinematics.nodal_motion import list_sliding_coordinates
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array
from flexinv.validation import find_nearest_word

INPUT_ROLE = "input"  # roles, which FMI calls causalities
PARAMETER_ROLE = "parameter"
OUTPUT_ROLE = "output"
VECTOR_PARTS = ("x", "y", "z")
TENSOR_PARTS = ("xx", "yy", "zz", "xy", "xz", "yz")
NO_VARIABLE = -1  # a place that no variable has
# Unit of a rate -> of its coordinate, rate, acceleration, effort, damping, as FMI writes them.
FMI_UNITS = {False: ("rad", "rad/s", "rad/s2", "N.m", "N.m.s/rad"), True: ("m", "m/s", "m/s2", "N", "N.s/m")}
_ENDED = "at the end of the communication step"


@dataclass(frozen=True)
class Variable:
    """A variable of type Float64: its role is its causality, start : where one is needed [unit]."""

    name: str
    role: str
    unit: str
    says: str
    start: float | None = None


@dataclass
class Interface:
    """All variables of an FMU, and the tables of the C file.

    places : name in the template -> value references; groups : parameters that are set together, as rows of C
    held : value reference of the parameter that holds torques, 0 without one
    """

    variables: list[Variable] = field(default_factory=list)
    places: dict[str, list[int]] = field(default_factory=dict)
    groups: list[str] = field(default_factory=list)
    held: int = 0

    def add(self, name: str, role: str, unit: str, says: str, start: float | None = None) -> int:
        """Add a variable; return its value reference [-]."""
        self.variables.append(Variable(format_line(name), role, unit, says, start))
        return len(self.variables) - 1

    def add_group(self, kind: str, which: int, first: int) -> None:
        """Add the parameters from value reference ``first`` on, which C sets together [-]."""
        self.groups.append(f"{{{kind}, {which}, {first}, {len(self.variables) - first}}}")

    def find(self, role: str) -> list[int]:
        """Return the value references of all variables of a role [-]."""
        return [k for k, one in enumerate(self.variables) if one.role == role]


def list_inverse_variables(plan: LibraryPlan, payloads: Sequence[str]) -> Interface:
    """Return motion in, efforts out [rad or m, s, N m], [N]; payloads : links that carry something that changes."""
    m = plan.mechanism
    made = Interface()
    start = m.neutral if plan.start is None else plan.start
    given = [m.is_rigid or bool(driven) for driven in m.actuated]
    _add_coordinates(made, m, given, start)
    for part, unit in (("qd", 1), ("qdd", 2)):
        says = ("rate" if unit == 1 else "acceleration") + f" {_ENDED}"
        made.places[f"{part}_at"] = _add_rates(made, m, INPUT_ROLE, (part, unit), says, given, 0.0)
    if has_phases(m):
        _add_phase(made, m)
    asked = [bool(driven) or (m.is_rigid and not m.closures) for driven in m.actuated]
    made.places["tau_at"] = _add_rates(made, m, OUTPUT_ROLE, ("tau", 3), f"effort of the drive {_ENDED}", asked)
    if not m.is_rigid:
        add_readings(made, m)
    add_parameters(made, plan, payloads)
    return made


def list_forward_variables(plan: LibraryPlan, payloads: Sequence[str]) -> Interface:
    """Return efforts in, motion out [N m], [N], [rad or m, s]; payloads : links that carry something that changes."""
    m = plan.mechanism
    made = Interface()
    driven = [bool(one) for one in m.actuated]
    every = [True] * m.nv
    says = f"effort of the drive {_ENDED}, or from its beginning on (torque.held)"
    made.places["tau_at"] = _add_rates(made, m, INPUT_ROLE, ("tau", 3), says, driven, 0.0)
    _add_coordinates(made, m, every)
    made.places["qd_at"] = _add_rates(made, m, OUTPUT_ROLE, ("qd", 1), f"rate {_ENDED}", every)
    # What closures do to accelerations stands in another place than those that the march goes on with.
    open_tree = [not m.closures] * m.nv
    made.places["qdd_at"] = _add_rates(made, m, OUTPUT_ROLE, ("qdd", 2), f"acceleration {_ENDED}", open_tree)
    add_readings(made, m)
    add_parameters(made, plan, payloads)
    made.held = made.add("torque.held", PARAMETER_ROLE, "1", "0: torques are linear over a step; 1: constant", 0.0)
    return made


def _add_phase(made: Interface, mechanism: Mechanism) -> None:
    """Add the number of the closures that act [-], which an importer may wire to a signal."""
    sets = ", ".join(f"{k} {one.name} (first at {one.first:g} s)" for k, one in enumerate(list_acting_sets(mechanism)))
    made.add_group("PHASE", 0, made.add("phase", INPUT_ROLE, "1", f"closures that act: {sets}", 0.0))


def add_readings(made: Interface, mechanism: Mechanism) -> None:
    """Add deflections of beams and tips of links [m]."""
    made.places["deflection_at"] = [
        _add_vector(made, f"{beam.name}.deflection", "tip in the frame of the root, less its undeformed place")
        for beam in mechanism.beams
    ]
    made.places["tip_at"] = [_add_vector(made, f"{link.name}.tip", "tip in the world") for link in mechanism.links]


def add_parameters(made: Interface, plan: LibraryPlan, payloads: Sequence[str]) -> None:
    """Add gravity [m/s^2], friction and damping of drives [N m], [N], [s], and payloads of some links [kg], [m]."""
    m = plan.mechanism
    first = len(made.variables)
    for axis, value in zip(VECTOR_PARTS, m.gravity, strict=True):
        made.add(f"gravity.{axis}", PARAMETER_ROLE, "m/s2", "gravity in the world", float(value))
    made.add_group("GRAVITY", 0, first)
    slides = list_sliding_coordinates(m)
    for joint in m.joints:
        span = m.v_slices[joint.name]
        for i in range(span.start, span.stop):
            if KINDS[joint.kind].scalar and m.actuated[i]:
                first = len(made.variables)
                units = FMI_UNITS[bool(slides[i])]
                name = m.velocity_names[i]
                made.add(f"{name}.friction", PARAMETER_ROLE, units[3], "dry friction", float(m.drive_table[2, i]))
                made.add(f"{name}.damping", PARAMETER_ROLE, units[4], "viscous friction", float(m.drive_table[1, i]))
                made.add_group("FRICTION", i, first)
    for k, beam in enumerate(m.beams if "damping" in plan.parts else ()):
        says = "damping of the beam, in parts of what the mechanism states"
        made.add_group("DAMPING_TIMES", k, made.add(f"{beam.name}.damping", PARAMETER_ROLE, "1", says, 1.0))
    _add_payloads(made, plan, payloads)


def _add_payloads(made: Interface, plan: LibraryPlan, payloads: Sequence[str]) -> None:
    """Add what some links carry: mass [kg], centre [m] and inertia [kg m^2] of each."""
    m = plan.mechanism
    numbers = [link.name for link in m.links] if plan.kind == "rigid" else list(payloads)
    for name in payloads:
        if name not in m.link_of:
            write = find_nearest_word(name, m.link_of) or next(iter(m.link_of))
            raise InputError(f"export_fmu: payloads: there is no link {name!r}; write payloads=({write!r},)")
        first = len(made.variables)
        made.add(f"{name}.payload.mass", PARAMETER_ROLE, "kg", "what the link carries beside its own mass", 0.0)
        for axis in VECTOR_PARTS:
            made.add(
                f"{name}.payload.centre.{axis}", PARAMETER_ROLE, "m", "its centre of mass in the link's frame", 0.0
            )
        for axis in TENSOR_PARTS:
            made.add(f"{name}.payload.inertia.{axis}", PARAMETER_ROLE, "kg.m2", "its inertia about that centre", 0.0)
        made.add_group("PAYLOAD", numbers.index(name), first)


def check_variable_names(made: Interface) -> None:
    """Raise InputError where two variables [-] have one name."""
    seen = set[str]()
    for one in made.variables:
        if one.name in seen:
            raise InputError(
                f"export_fmu: two variables of the FMU would be {one.name!r}; name the link of a payload once, or rename a joint "
                "or a link"
            )
        seen.add(one.name)


def _add_coordinates(made: Interface, mechanism: Mechanism, asked: Sequence[bool], start: Array | None = None) -> None:
    """Add coordinates of joints that are ``asked`` for: inputs that ``start`` (nq,) somewhere [rad], [m], else outputs."""
    m = mechanism
    role = OUTPUT_ROLE if start is None else INPUT_ROLE
    made.places["q_at"] = [NO_VARIABLE] * m.nq
    for i, unit in enumerate(list_coordinate_units(m)):
        if asked[_find_rate(m, i)]:
            name = f"{m.coordinate_names[i]}.q"
            begins = None if start is None else float(start[i])
            made.places["q_at"][i] = made.add(name, role, unit, f"position {_ENDED}", begins)


def _find_rate(mechanism: Mechanism, coordinate: int) -> int:
    """A rate of the joint that a coordinate belongs to."""
    for joint in mechanism.joints:
        places = mechanism.q_slices[joint.name]
        if places.start <= coordinate < places.stop:
            return int(mechanism.v_slices[joint.name].start)
    raise AssertionError(coordinate)


def list_coordinate_units(mechanism: Mechanism) -> list[str]:
    """Return the unit of each coordinate as FMI writes it [-]: rad, m, or 1 for a part of a rotation."""
    slides = list_sliding_coordinates(mechanism)
    units = list[str]()
    for joint in mechanism.joints:
        first = mechanism.v_slices[joint.name].start
        for k in range(joint.nq):
            moves = joint.nq == joint.nv or (joint.nq > 4 and k < 3)
            units.append(FMI_UNITS[bool(slides[first + k])][0] if moves else "1")
    return units


def _add_rates(
    made: Interface, mechanism: Mechanism, role: str, part: tuple[str, int], says: str, asked: Iterable[bool],
    start: float | None = None,
) -> list[int]:  # fmt: skip
    """Add a part of the motion, or the efforts, of rates; return the value reference of each."""
    word, unit = part
    slides = list_sliding_coordinates(mechanism)
    rows = zip(mechanism.velocity_names, slides, asked, strict=True)
    return [
        made.add(f"{name}.{word}", role, FMI_UNITS[bool(slide)][unit], says, start) if is_asked else NO_VARIABLE
        for name, slide, is_asked in rows
    ]


def _add_vector(made: Interface, name: str, says: str) -> int:
    """Add three outputs; return the value reference of the first."""
    first = len(made.variables)
    for axis in VECTOR_PARTS:
        made.add(f"{name}.{axis}", OUTPUT_ROLE, "m", says)
    return first


def list_units(made: Interface) -> Iterator[str]:
    """Yield the units of all variables, each once, and the second [-]."""
    yield from sorted({"s", *(one.unit for one in made.variables)})
