"""Numbers of joints that engines' own attributes of USD state: passive ones, limits, couplings; each in the unit of its schema.

    newton:*          angles in degrees: damping is per degree [N m s/deg]; armature and friction have no angle in them
    physxJointAxis:*  as newton's: viscousFrictionCoefficient is per degree, maxJointVelocity in degrees; of one axis, so it goes
                      before physxJoint:*, which is of all
    mjc:*             as in an MJCF: per radian; angles such as springref as the scene's ``mjc:compiler:angle`` says
    mimic             newton  q = coef0 + coef1 q_of,  PhysX  q + gearing q_of + offset = 0;  coef0, offset in degrees [deg], [m]

Where attributes of two engines say different things of one joint, the engines make different machines of it: the first is taken,
and what differs is a feature, "contradiction".  Source: NewtonJointAPI, NewtonMimicAPI (newton-usd-schemas 0.6), MjcJointAPI,
MjcEqualityJointAPI (mujoco-usd-converter 0.8), PhysxJointAxisAPI, PhysxMimicJointAPI (physx-usd-schemas 25.11).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from crosscheck.lifting.assembly import JointFields
from crosscheck.lifting.reader_dynamics import Feature, Parameter
from flexinv.model.mechanism import WORLD, Attachment, Closure

DEGREE = np.pi / 180
ENDLESS = 1e6  # [deg/s], [unit/s]: PhysX's word for a speed without limit
SAME = 1e-5  # relative: single precision, and numbers that were printed in it
TURNS = ("revolute", "spherical")


@dataclass(frozen=True)
class Units:
    """Units of a stage: metre [m] and kilogram [kg] of its numbers; radian : angles of MuJoCo's attributes are in radians."""

    meter: float = 1.0
    kilogram: float = 1.0
    radian: bool = True

    def compute_coordinate_unit(self, kind: str) -> float:
        """Return the unit of a coordinate that USD and most engines state [rad], [m]: a degree, or that of lengths."""
        return DEGREE if kind in TURNS else self.meter

    def compute_effort_unit(self, kind: str) -> float:
        """Return the unit of an effort [N m], [N]."""
        return self.kilogram * self.meter ** (2 if kind in TURNS else 1)

    def compute_inertia_unit(self, kind: str) -> float:
        """Return the unit of an armature [kg m^2], [kg], and of what is per radian or per metre [N m s/rad], [N s/m]."""
        return self.kilogram * self.meter ** (2 if kind in TURNS else 0)


@dataclass(frozen=True)
class Attribute:
    """An attribute that states a number: its key, {} for the axis; unit : "inertia", "effort", or "per degree"."""

    key: str
    unit: str = "inertia"

    def read_value(self, prim: Any, kind: str, instances: tuple[str, ...], units: Units) -> float | None:
        """Return the number of a joint [kg m^2], [N m], [N m s/rad]; None where it states none."""
        for instance in instances if "{}" in self.key else ("",):
            number = read_number(prim, self.key.format(instance))
            if number is not None:
                return number * self._compute_unit(kind, units)
        return None

    def _compute_unit(self, kind: str, units: Units) -> float:
        if self.unit == "effort":
            return units.compute_effort_unit(kind)
        per = DEGREE if self.unit == "per degree" and kind in TURNS else 1.0
        return units.compute_inertia_unit(kind) / per


# By field of a `Joint`, the attributes that state it, the first that is there is taken.
PassiveKey = Literal["rotor_inertia", "damping", "friction", "stiffness"]
PASSIVE: dict[PassiveKey, tuple[Attribute, ...]] = {
    "rotor_inertia": (
        Attribute("newton:armature"),
        Attribute("physxJointAxis:{}:armature"),
        Attribute("physxJoint:armature"),
        Attribute("mjc:armature"),
    ),
    "damping": (
        Attribute("newton:damping", "per degree"),
        Attribute("physxJointAxis:{}:viscousFrictionCoefficient", "per degree"),
        Attribute("mjc:damping"),
    ),
    "friction": (
        Attribute("newton:friction", "effort"),
        Attribute("physxJointAxis:{}:dynamicFrictionEffort", "effort"),
        Attribute("mjc:frictionloss", "effort"),
    ),
    "stiffness": (Attribute("mjc:stiffness"),),
}
OFF_BY = {"damping": "mjc:flag:damper", "friction": "mjc:flag:frictionloss", "stiffness": "mjc:flag:spring"}
SPEEDS = ("newton:velocityLimit", "physxJointAxis:{}:maxJointVelocity", "physxJoint:maxJointVelocity")


@dataclass
class PassiveTerms:
    """Passive numbers of one joint: fields of a `Joint`, what is said of them, and features that no mechanism can say."""

    joint_fields: JointFields = field(default_factory=JointFields)
    notes: list[str] = field(default_factory=list)
    features: list[Feature] = field(default_factory=list)


@dataclass(frozen=True)
class JointPrim:
    """A joint prim: the joint of the mechanism that it is, "" where it is none or several, its kind and its unit [rad], [m]."""

    prim: Any
    name: str
    kind: str
    unit: float


def read_number(prim: Any, key: str) -> float | None:
    """Return a number that is written in a prim [unit of the attribute]; None where none is."""
    attribute = prim.GetAttribute(key)
    if not attribute.HasAuthoredValue():
        return None
    values = np.ravel(attribute.Get())
    return float(values[0]) if values.size else None


def list_instances(prim: Any, kind: str, axis: str) -> tuple[str, ...]:
    """Return the names [-] by which applied schemas of PhysX call an axis of a joint: "rotX", "angular"."""
    way = "rot" if kind in TURNS else "trans"
    stated = axis or str(prim.GetAttribute("physics:axis").Get() or "X")
    return f"{way}{stated}", "angular" if kind in TURNS else "linear"


def read_passive_values(
    prim: Any, name: str, kind: str, axis: str, units: Units, off: frozenset[str] = frozenset()
) -> PassiveTerms:
    """Return rotor [kg m^2], damping [N m s/rad], friction [N m] and spring [N m/rad] of a joint.

    off : MuJoCo's flags that the scene switches off, such as "mjc:flag:spring"
    """
    passive_terms = PassiveTerms()
    instances = list_instances(prim, kind, axis)
    for key, attributes in PASSIVE.items():
        stated = {a.key.format(instances[0]): a.read_value(prim, kind, instances, units) for a in attributes}
        said = {field_name: value for field_name, value in stated.items() if value is not None}
        if not said:
            continue
        source, value = next(iter(said.items()))
        if key in OFF_BY and OFF_BY[key] in off:
            passive_terms.notes.append(f"{key} of joint {name}: {OFF_BY[key]} of the scene switches it off")
            continue
        if any(abs(other - value) > SAME * max(abs(other), abs(value)) for other in said.values()):
            passive_terms.notes.append(f"{key} of joint {name}: attributes of two engines differ; {source} is taken")
            passive_terms.features.append(
                Feature("contradiction", f"joint {name}", {f"{key} {k}": v for k, v in said.items()})
            )
        if value:
            _add_value(passive_terms, key, value, prim, (name, kind), units)
    passive_terms.features += _list_other_features(prim, name)
    return passive_terms


def _add_value(
    found: PassiveTerms, key: PassiveKey, value: float, prim: Any, joint: tuple[str, str], units: Units
) -> None:
    name, kind = joint
    if key != "stiffness":
        found.joint_fields[key] = value
        return
    rest = read_number(prim, "mjc:springref") or 0.0
    if kind == "spherical":
        found.features.append(Feature("ball-spring", f"joint {name}", {"stiffness": value}))
        return
    if kind == "revolute" and rest and not units.radian:
        rest *= DEGREE
    found.joint_fields["stiffness"] = value
    found.joint_fields["rest"] = rest * (units.meter if kind == "prismatic" else 1.0)


def _list_other_features(prim: Any, name: str) -> Iterator[Feature]:
    """Yield what engines do at a joint and no mechanism can say."""
    for key, kind, word in (
        ("physxJoint:jointFriction", "load-friction", "coefficient"),
        ("mjc:ref", "coordinate-reference", "ref"),
        ("mjc:actuatorgravcomp", "gravcomp-of-actuators", "on"),
    ):
        if value := read_number(prim, key):
            yield Feature(kind, f"joint {name}", {word: value}, felt=kind == "load-friction")
    damper = prim.GetAttribute("mjc:springdamper")
    if damper.HasAuthoredValue() and len(values := np.ravel(damper.Get())) == 2 and min(values) > 0.0:
        yield Feature("spring-damper", f"joint {name}", {"time and ratio": tuple(map(float, values))})


def read_speed_limit(prim: Any, kind: str, axis: str, units: Units) -> float:
    """Return the largest speed of a joint [rad/s], [m/s]; infinite where none is stated."""
    for key in SPEEDS:
        for instance in list_instances(prim, kind, axis) if "{}" in key else ("",):
            number = read_number(prim, key.format(instance))
            if number is not None and 0.0 < number < ENDLESS:
                return number * units.compute_coordinate_unit(kind)
    return np.inf


def read_effort_limit(prim: Any, kind: str, units: Units) -> float:
    """Return the largest effort [N m], [N] by MuJoCo's range of actuator forces; infinite where none is stated."""
    limited = str(prim.GetAttribute("mjc:actuatorfrclimited").Get() or "auto")
    low, high = (read_number(prim, f"mjc:actuatorfrcrange:{end}") or 0.0 for end in ("min", "max"))
    if limited == "false" or low >= high:
        return np.inf
    return max(abs(low), abs(high)) * units.compute_effort_unit(kind)


def build_couplings(joints: Mapping[Any, JointPrim]) -> tuple[list[Closure], list[str], list[Feature]]:
    """Return the laws  q - factor q_of = offset [rad], [m]  of joints that mimic others, by prim path; what is lost; features."""
    made: list[Closure] = []
    lost: list[str] = []
    features: list[Feature] = []
    for one in joints.values():
        law = _read_mimic_law(one)
        if law is None:
            continue
        path, factor, offset = law
        other = joints.get(path)
        if other is None or not other.name or not one.name or (one.kind in TURNS) != (other.kind in TURNS):
            lost.append(f"mimic of {one.prim.GetPath()}: of {path}, which is no single joint of its kind in the tree")
            place = f"joint {one.name or one.prim.GetName()}"
            features.append(Feature("mimic", place, {"of": str(path), "factor": factor, "offset": offset}, felt=False))
            continue
        here = Attachment(WORLD)
        factors = (one.name, 1.0), (other.name, -factor)
        made.append(Closure(f"mimic {one.name}", "coupling", here, here, factors=factors, offset=offset * one.unit))
        features += _list_higher_orders(one, other, (offset * one.unit, factor))
    return made, lost, features


def _read_mimic_law(one: JointPrim) -> tuple[Any, float, float] | None:
    """Prim path of what a joint mimics, factor [-], offset in the units of the stage [deg]."""
    prim = one.prim
    enabled = prim.GetAttribute("newton:mimicEnabled").Get()
    if targets := prim.GetRelationship("newton:mimicJoint").GetTargets():
        law = targets[0], _read_factor(prim, "newton:mimicCoef1"), read_number(prim, "newton:mimicCoef0") or 0.0
        return law if enabled is None or enabled else None
    if targets := prim.GetRelationship("mjc:target").GetTargets():
        offset = read_number(prim, "mjc:coef0") or 0.0
        in_degrees = offset / DEGREE if one.kind in TURNS else offset  # MuJoCo's is in radians, always
        return targets[0], _read_factor(prim, "mjc:coef1"), in_degrees
    for axis in ("rotX", "rotY", "rotZ", "transX", "transY", "transZ"):
        start = f"physxMimicJoint:{axis}"
        if targets := prim.GetRelationship(f"{start}:referenceJoint").GetTargets():
            return targets[0], -_read_factor(prim, f"{start}:gearing"), -(read_number(prim, f"{start}:offset") or 0.0)
    return None


def _read_factor(prim: Any, name: str) -> float:
    factor = read_number(prim, name)
    return 1.0 if factor is None else factor


def _list_higher_orders(one: JointPrim, other: JointPrim, linear: tuple[float, float]) -> Iterator[Feature]:
    more = tuple(read_number(one.prim, f"mjc:coef{k}") or 0.0 for k in (2, 3, 4))
    if any(more):
        names = one.name, other.name
        numbers: dict[str, Parameter] = {"polycoef": (*linear, *more)}
        yield Feature("coupling-law", f"joints {', '.join(names)}", numbers, felt=False, joints=names)
