"""An MJCF with the masses, damping, dry friction, armature and stiffness that were identified; all else stays, byte by byte.

Only ``<inertial>`` of bodies and attributes of joints change, the old values stand beside them in a comment.  What were masses of
shapes and numbers of classes, the element itself then says.  MuJoCo reads the written file again:

    numbers       m, h, I of every body and the numbers of every joint that were written, to `ROUNDED`
    efforts       mj_inverse of the file against the mechanism with what was identified (`check_efforts`)

A body's frame is found from that of the mechanism's link by both machines with all joints at zero.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from crosscheck.identification.identify import Identification
from crosscheck.identification.pseudo_inertia import QUANTITIES
from crosscheck.identification.responses.response import replace_masses
from crosscheck.identification.write_back.elements import (
    Edit,
    apply_edits,
    format_comment,
    write_attribute,
)
from crosscheck.identification.write_back.identified import (
    ROUNDED,
    check_joint_number,
    check_link_numbers,
    check_new_file,
    collect_joint_values,
    compute_identified_links,
    describe_rest,
    write_checked,
)
from crosscheck.identification.write_back.mjcf_file import MjcfBody, MjcfFile, read_mjcf
from crosscheck.identification.write_back.same_efforts import (
    check_efforts,
    find_link_frames,
    list_carried_links,
    match_joints,
)
from crosscheck.lifting.rigid import compute_relative_pose, join_bodies, move_inertia
from flexinv.errors import InputError
from flexinv.model.mechanism import Body, Inertia, Joint, Link, Mechanism
from flexinv.rigid.torque_regressor import compute_link_parameters

# kind of parameter -> attribute of <joint>
LAWS = {
    "viscous friction": "damping",
    "joint damping": "damping",
    "coulomb friction": "frictionloss",
    "joint friction": "frictionloss",
    "rotor inertia": "armature",
    "joint stiffness": "stiffness",
}
# attribute of <joint> -> field of a mechanism's joint
FIELDS = {"damping": "damping", "frictionloss": "friction", "armature": "rotor_inertia", "stiffness": "stiffness"}
PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))  # of fullinertia in a tensor


@dataclass(frozen=True)
class Written:
    """Numbers that are written into an MJCF.

    identified : the mechanism with what was found; bodies : by name, in the frame of the lifted link [kg], [m], [kg m^2]
    values : by joint of the file and attribute [kg m^2], [N m s/rad], [N m], [N m/rad]; links : whose mass properties are said
    """

    identified: Mechanism
    bodies: Mapping[str, Inertia]
    values: Mapping[tuple[str, str], float]
    links: tuple[str, ...]


def write_mjcf(identification: Identification, old: Path, new: Path) -> list[str]:
    """Write an MJCF of the machine with what was identified [kg], [m], [kg m^2], [N m s/rad], [N m], [N m/rad].

    old : the user's file, with the names of the mechanism's joints; return in words what it cannot say, or says otherwise
    Raises InputError: the new file is there already, a machine that bends, another machine, bodies that have no place in the
    file, a written file that does not have the numbers or the efforts that were identified.
    """
    check_new_file("--write-mjcf", new)
    mechanism = identification.machine.mechanism
    if not mechanism.is_rigid:
        raise InputError(
            f"--write-mjcf {new}: links of {mechanism.name} bend, expected rigid ones, as bodies of an MJCF are"
        )
    file = read_mjcf(old)
    written = _collect_written(identification, file)
    edits = [_replace_inertial(file, file.bodies[name], numbers) for name, numbers in written.bodies.items()]
    edits += [_replace_joint(file, name, written.values) for name in dict.fromkeys(name for name, _ in written.values)]
    write_checked(new, apply_edits(file.text, edits), lambda: _check(file, new, written))
    said = {(quantity, link) for link in written.links for quantity in QUANTITIES}
    names = match_joints(old, mechanism, file.description.mechanism)
    said |= {(r.parameter, r.place) for r in identification.parameters if r.parameter in LAWS and r.place in names}
    return [*describe_rest(identification.parameters, said, "this MJCF"), *_describe_gravity(file, mechanism)]


# ------------------------------------------------------------------------------------------------------ what is written


def _collect_written(identification: Identification, file: MjcfFile) -> Written:
    mechanism = identification.machine.mechanism
    lifted = file.description.mechanism
    names = match_joints(file.path, mechanism, lifted)
    rows = [row for row in identification.parameters if row.parameter in LAWS and row.place in names]
    joint_values = collect_joint_values(rows, LAWS)
    ten = compute_identified_links(identification)
    identified = replace_masses(mechanism, ten)
    identified = replace(identified, joints=tuple(_replace_numbers(joint, joint_values) for joint in identified.joints))
    bodies: dict[str, Inertia] = {}
    links: list[str] = []
    lifted_groups = list_carried_links(lifted)
    for joint, group in list_carried_links(identified).items():
        if any(name in ten for name in group):
            parts = _match_bodies(file, identified, group, lifted_groups.get(names.get(joint, ""), []))
            free = {body: parts[body] for body in parts if not ten.keys().isdisjoint(parts[body])}
            bodies |= _move_links(lifted, identified, free)
            links += [name for own_links in free.values() for name in own_links if name in ten]
    return Written(
        identified, bodies, {(names[name], key): value for (name, key), value in joint_values.items()}, tuple(links)
    )


def _replace_numbers(joint: Joint, values: Mapping[tuple[str, str], float]) -> Joint:
    """A joint with what was identified of it, and without the drive that it came from."""
    fields = {FIELDS[attribute]: value for (name, attribute), value in values.items() if name == joint.name}
    return replace(joint, drive=None, **fields)  # type: ignore[arg-type]


def _match_bodies(file: MjcfFile, mechanism: Mechanism, group: list[str], others: list[str]) -> dict[str, list[str]]:
    """By body the links that it is, of links that move as one; others : those of the file that move with them.

    Links are bodies by their names, or all of them are the only body; of links that stand in the world there may be none.
    """
    heavy = [name for name in group if _has_mass(mechanism.link_of[name])]
    has = [name for name in others if _has_mass(file.description.mechanism.link_of[name])]
    bodies = has or [name for name in others if name in file.bodies][:1]
    if set(heavy) == set(bodies):
        return {name: [name] for name in heavy}
    if len(bodies) > 1:
        raise InputError(
            f"{file.path}: bodies {', '.join(bodies)} move as one, as links {', '.join(heavy)} of {mechanism.name} do; expected "
            "the same names, or one body: else nobody knows to which body a mass belongs; write them as one body"
        )
    return dict.fromkeys(bodies, heavy)


def _move_links(lifted: Mechanism, mechanism: Mechanism, parts: Mapping[str, list[str]]) -> dict[str, Inertia]:
    """By body its links as one [kg], [m], [kg m^2], in the frame of the lifted link."""
    here = find_link_frames(mechanism)
    there = find_link_frames(lifted)
    return {
        body: join_bodies(
            move_inertia(compute_relative_pose(there[body], here[link]), one.inertia)
            for link in links
            for one in mechanism.link_of[link].bodies
        )
        for body, links in parts.items()
    }


def _has_mass(link: Link) -> bool:
    return any(body.inertia.mass > 0.0 for body in link.bodies)


# ---------------------------------------------------------------------------------------------------------------- edits


def _replace_inertial(file: MjcfFile, body: MjcfBody, inertia: Inertia) -> Edit:
    """The inertial of a body [kg], [m], [kg m^2] along the axes of its frame, and what stood there before."""
    pos = _format_numbers(inertia.com + body.model.anchor)
    tensor = _format_numbers(inertia.tensor[place] for place in PLACES)
    new = f'<inertial pos="{pos}" mass="{inertia.mass!r}" fullinertia="{tensor}"/>'.encode()
    element = body.element.find_child("inertial")
    if element is not None:
        return Edit(element.start, element.end, format_comment(element.describe()) + new)
    before = file.description.mechanism.link_of[body.model.name].bodies
    place = body.element.inside  # a body that moves, or has a mass, has more than a tag
    shapes = [
        f"of its shapes, mass={b.inertia.mass!r} pos={_format_numbers(b.inertia.com + body.model.anchor)}"
        for b in before
    ]
    return Edit(place, place, format_comment("; ".join(shapes)) + new)


def _replace_joint(file: MjcfFile, name: str, values: Mapping[tuple[str, str], float]) -> Edit:
    """The element of a joint with its numbers; what its actuators add is taken off, numbers of higher order stay."""
    joint, element = file.joints[name]
    text = file.text[element.start : element.end]
    before = []
    for attribute, value in ((key, one) for (place, key), one in values.items() if place == name):
        number = joint.numbers[attribute]
        added = getattr(file.description.mechanism.joint_of[name], FIELDS[attribute]) - number
        if value < added:
            raise InputError(
                f"{file.path}: actuators give joint {name} {attribute} {added:g}, more than the {value:g} that was identified; "
                f"write less {attribute} into them"
            )
        stated = element.attributes.get(attribute, "")
        text = write_attribute(text, attribute, " ".join([repr(value - added), *stated.split()[1:]]))
        before.append(f"{attribute}={stated or f'{number!r}, not stated here'}")
    return Edit(element.start, element.end, format_comment("; ".join(before)) + text)


def _format_numbers(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(x)) for x in numbers)


# --------------------------------------------------------------------------------------------------------------- checks


def _check(old: MjcfFile, new: Path, written: Written) -> None:
    """Raise InputError where MuJoCo does not read from a file what was written, or computes other efforts."""
    again = read_mjcf(new).description
    if lost := [
        words for words in again.dropped if words.startswith("geometry:") and words not in old.description.dropped
    ]:
        raise InputError(f"{new}: {lost[0]}; write it into the folder of {old.path}, beside the files that it names")
    for name, inertia in written.bodies.items():
        expected = compute_link_parameters(Link(name, (Body(name, inertia),)))
        check_link_numbers(new, name, compute_link_parameters(again.mechanism.link_of[name]), expected)
    for (name, attribute), value in written.values.items():
        found = getattr(again.mechanism.joint_of[name], FIELDS[attribute])
        check_joint_number(new, attribute, name, found, value)
    _check_known_numbers(old.path, written.identified, again.mechanism)
    check_efforts(new, written.identified, again)


def _check_known_numbers(old: Path, identified: Mechanism, lifted: Mechanism) -> None:
    """Raise InputError where a number of a joint that was taken as known is another one in the file [unit of each]."""
    for name, other in match_joints(old, identified, lifted).items():
        for attribute, field in FIELDS.items():
            known = getattr(identified.joint_of[name], field)
            found = getattr(lifted.joint_of[other], field)
            if abs(known - found) > ROUNDED * abs(known):
                raise InputError(
                    f"{old}: {attribute} of joint {other} is {found:g}, actuators on it included, expected {known:g} of "
                    f"{identified.name}, with which was identified: write the same into both, or let [[free]] find it"
                )


def _describe_gravity(file: MjcfFile, mechanism: Mechanism) -> Iterator[str]:
    """Yield in words that the file has another gravity than the mechanism [m/s^2]."""
    stated = file.description.mechanism.gravity
    if not np.allclose(stated, mechanism.gravity, rtol=0.0, atol=1e-12):
        keeps = f"gravity: the file keeps {_format_numbers(stated)} m/s^2"
        yield f"{keeps}, masses were identified with {_format_numbers(mechanism.gravity)} of {mechanism.name}"
