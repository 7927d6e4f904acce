"""A URDF as shipped: links and joints, their ``dynamics`` and ``limit``, mimic joints as couplings, gears of transmissions.

Source: http://wiki.ros.org/urdf/XML, http://wiki.ros.org/urdf/XML/Transmission; ``drake:`` elements by Drake's documentation of
``pydrake.multibody.parsing``.
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element

from crosscheck.lifting.description import Description
from crosscheck.lifting.printed import read_urdf_digits
from flexinv.errors import InputError
from flexinv.files.from_urdf import STANDARD_GRAVITY, describe_location, read_number, read_robot, read_urdf
from flexinv.model.mechanism import GEARED, WORLD, Attachment, Closure, Mechanism

DRAKE = "{http://drake.mit.edu}"
# Elements that say nothing of dynamics without contact.
SHAPES = {"visual", "collision", "material"}
KNOWN = {"link", "joint", "transmission", "material"}
PARTS = {"origin", "parent", "child", "axis", "limit", "dynamics", "mimic"}
ACTUATOR_PARTS = ("rotor_inertia", "gear_ratio")


def lift_urdf(path: Path, base: str = "fixed") -> Description:
    """Return the mechanism of a URDF [m, kg, rad] and what it drops.  base : "fixed" or "free".  Raises InputError."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        mechanism, warned = read_urdf(path, [], base, STANDARD_GRAVITY, ())
    robot = read_robot(path)
    couplings, dropped = mimics(robot, mechanism, path)
    gears, rotors, lost = _read_transmissions(robot, path)
    joints = tuple(replace(j, rotor_inertia=rotors.get(j.name, 0.0)) for j in mechanism.joints)
    lost = [*lost, *(f"actuator of {name}: there is no such joint" for name in gears if name not in mechanism.joint_of)]
    noted = [str(one.message) for one in caught]
    noted += [text for subject, text in warned.items() if subject != "mimic"]
    return Description(
        label=path.name,
        mechanism=replace(mechanism, joints=joints, closures=couplings),
        format="urdf",
        gears={name: gear for name, gear in gears.items() if name in mechanism.joint_of},
        dropped=(*dropped, *lost, *_list_other_tags(robot), *noted),
        printed=read_urdf_digits(robot),
        file=path,
        root_stated=False,
        gravity_stated=False,
    )


def mimics(robot: Element, mechanism: Mechanism, path: Path) -> tuple[tuple[Closure, ...], list[str]]:
    """Return couplings  q - multiplier q_of = offset [-], [rad], [m],  and in words those of joints that cannot be coupled."""
    made = []
    dropped = []
    here = Attachment(WORLD)
    for element in robot.findall("joint"):
        mimic = element.find("mimic")
        name = element.get("name", "")
        if mimic is None:
            continue
        other = mimic.get("joint", "")
        where = describe_location(path, element, "mimic")
        kinds = [mechanism.joint_of[n].kind for n in (name, other) if n in mechanism.joint_of]
        if len(kinds) < 2 or name == other:
            dropped.append(f"mimic of {name}: it names the joint {other!r}, which is none of the others")
        elif "fixed" in kinds:
            dropped.append(f"mimic of {name}: one of the two joints is fixed")
        elif set(kinds) <= {*GEARED, "continuous"}:
            factor = read_number(mimic, "multiplier", 1.0, where)
            offset = read_number(mimic, "offset", 0.0, where)
            made.append(
                Closure(f"mimic {name}", "coupling", here, here, factors=((name, 1.0), (other, -factor)), offset=offset)
            )
        else:
            dropped.append(f"mimic of {name}: of a {' and a '.join(kinds)} joint")
    return tuple(made), dropped


def _read_transmissions(robot: Element, path: Path) -> tuple[dict[str, float], dict[str, float], list[str]]:
    """Gears [-] and reflected rotors [kg m^2] by joint; what is no simple transmission is dropped."""
    gears: dict[str, float] = {}
    rotors: dict[str, float] = {}
    dropped: list[str] = []
    for element in robot.findall("transmission"):
        kind = _read_text(element.find("type")) or element.get("type", "")
        joints = element.findall("joint")
        if len(joints) != 1 or ("Simple" not in kind and kind):
            dropped.append(
                f"transmission {element.get('name', '')!r} of type {kind or 'none'!r}: only simple ones are read"
            )
            continue
        name = joints[0].get("name", "")
        ratio = 1.0
        for place in (element, *joints, *element.findall("actuator")):
            if text := _read_text(place.find("mechanicalReduction")):
                try:
                    ratio = _parse_float(text, describe_location(path, element, "mechanicalReduction"))
                except InputError:
                    dropped.append(f"transmission of {name}: its mechanicalReduction {text[:60]!r} is no number")
        gears[name] = ratio
        for actuator in element.findall("actuator"):
            inertia, gear = (
                read_number(actuator.find(DRAKE + key), "value", default, describe_location(path, actuator, key))
                for key, default in zip(ACTUATOR_PARTS, (0.0, 1.0), strict=True)
            )
            rotors[name] = rotors.get(name, 0.0) + inertia * gear**2
    return gears, rotors, dropped


def _read_text(element: Element | None) -> str:
    return "" if element is None or element.text is None else element.text.strip()


def _parse_float(text: str, where: str) -> float:
    return read_number(Element("mechanicalReduction", value=text), "value", 1.0, where)


def _list_other_tags(robot: Element) -> Iterator[str]:
    """Yield a line for each tag that the mechanism has no word for."""
    counted = Counter(part.tag for part in robot if part.tag not in KNOWN)
    counted.update(f"joint/{part.tag}" for j in robot.findall("joint") for part in j if part.tag not in PARTS)
    counted.update(
        f"link/{part.tag}" for k in robot.findall("link") for part in k if part.tag not in SHAPES | {"inertial"}
    )
    shapes = sum(1 for k in robot.findall("link") for part in k if part.tag == "collision")
    for tag, times in sorted(counted.items()):
        yield f"<{tag}> {times} times: extensions and safety data are not part of a mechanism"
    if shapes:
        yield f"<link/collision> {shapes} times: contact is not part of a mechanism"
