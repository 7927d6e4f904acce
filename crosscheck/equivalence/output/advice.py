"""Advice: which of two files looks wrong, and what to write in it, in its format's words, its own frames and names.

A file is suspected where `crosscheck.findings.bodies` finds the link's numbers odd and those of the other file not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from crosscheck.engines.shared.urdf_text import compute_roll_pitch_yaw
from crosscheck.equivalence.alignment.bases import BASE
from crosscheck.equivalence.alignment.member_alignment import SAME, MemberAlignment
from crosscheck.equivalence.difference import Difference
from crosscheck.equivalence.groups import find_counterpart
from crosscheck.equivalence.judge import Judgement
from crosscheck.equivalence.members import LEFT_LIMITS, SIGN, ZERO, format_vector
from crosscheck.equivalence.tree import Member, Tree
from crosscheck.findings.bodies import check_bodies
from crosscheck.findings.sides import check_sides
from crosscheck.findings.statements import LinkStatements, Mounting
from crosscheck.lifting.description import Description
from crosscheck.lifting.rigid import convert_to_quaternion, inverse, join_bodies, move_inertia
from flexinv.model.mechanism import WORLD, Placement

SIGN_ALONE = f"{SIGN} alone"  # where the limits of both files are the same numbers
INERTIAS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
URDF = {
    "mass": '<inertial> <mass value="{}"/>',
    "centre of mass": '<inertial> <origin xyz="{}" .../>',
    "joint axis": '<axis xyz="{}"/>',
    "position of joint": '<origin xyz="{}" .../>',
    "orientation of joint": '<origin rpy="{}" .../>',
    "damping": '<dynamics damping="{}" .../>',
    "dry friction": '<dynamics friction="{}" .../>',
    "rotor inertia": '<transmission> <actuator> <drake:rotor_inertia value="{}"/>',
    "gear": "<transmission> <joint> <mechanicalReduction>{}</mechanicalReduction>",
    "kind of joint": '<joint type="{}">',
    "lower limit": '<limit lower="{}" .../>',
    "upper limit": '<limit upper="{}" .../>',
    "effort limit": '<limit effort="{}" .../>',
    "velocity limit": '<limit velocity="{}" .../>',
    SIGN: '<axis xyz="..."/> with the opposite sign, and the limits exchanged with it',
    SIGN_ALONE: '<axis xyz="..."/> with the opposite sign; the limits stay as they are',
}
MJCF = {
    "mass": '<inertial mass="{}" .../>',
    "centre of mass": '<inertial pos="{}" .../>, counted from the anchor of the body\'s joint',
    "joint axis": '<joint axis="{}"/>',
    "position of joint": '<body pos="{}"> of the body that holds the joint, counted from joint to joint',
    "damping": '<joint damping="{}"/>',
    "dry friction": '<joint frictionloss="{}"/>',
    "rotor inertia": '<joint armature="{}"/>',
    "spring stiffness": '<joint stiffness="{}"/>',
    "gear": '<motor gear="{}"/>',
    "gravity": '<option gravity="{}"/>',
    "lower limit": '<joint range="{} ..."/>',
    "upper limit": '<joint range="... {}"/>',
    "effort limit": '<joint actuatorfrcrange="-{0} {0}"/>, or the forcerange of its actuator over its gear',
    SIGN: '<joint axis="..."/> with the opposite sign, and the range exchanged with it',
    SIGN_ALONE: '<joint axis="..."/> with the opposite sign; the range stays as it is',
}
SDF = {
    "mass": "<inertial> <mass>{}</mass>",
    "centre of mass": "<inertial> <pose>{} ...</pose>, along the axes of the link",
    "damping": "<axis> <dynamics> <damping>{}</damping>",
    "dry friction": "<axis> <dynamics> <friction>{}</friction>",
    "spring stiffness": "<axis> <dynamics> <spring_stiffness>{}</spring_stiffness>",
    "kind of joint": '<joint type="{}">',
    "lower limit": "<axis> <limit> <lower>{}</lower>",
    "upper limit": "<axis> <limit> <upper>{}</upper>",
    "effort limit": "<axis> <limit> <effort>{}</effort>",
    "velocity limit": "<axis> <limit> <velocity>{}</velocity>",
    "gravity": "<world> <gravity>{}</gravity>",
}
# In metres and kilograms: a stage that states metersPerUnit or kilogramsPerUnit has its numbers over these.
USD = {
    "mass": "float physics:mass = {} (of a stage in kilograms)",
    "centre of mass": "point3f physics:centerOfMass = ({}) (of a stage in metres)",
    "rotor inertia": "float physxJoint:armature = {} (of a stage in kilograms and metres)",
}
TOML = {
    "mass": "mass_kg = {}",
    "centre of mass": "com_m = [{}]",
    "joint axis": "axis = [{}]",
    "gravity": "gravity_m_per_s2 = [{}]",
    "length of beam": "length_m = {}",
    "initial twist": "curvature_per_m = {{ twist = {}, ... }}",
    "initial curvature about y": "curvature_per_m = {{ y = {}, ... }}",
    "initial curvature about z": "curvature_per_m = {{ z = {}, ... }}",
    "axial stiffness EA": "[sections....] EA_N = {}",
    "shear stiffness GA_y": "[sections....] GA_N = {{ y = {}, ... }}",
    "shear stiffness GA_z": "[sections....] GA_N = {{ z = {}, ... }}",
    "torsional stiffness GJ": "[sections....] GJ_Nm2 = {}",
    "bending stiffness EI_y": "[sections....] EI_Nm2 = {{ y = {}, ... }}",
    "bending stiffness EI_z": "[sections....] EI_Nm2 = {{ z = {}, ... }}",
    "mass per length": "[sections....] mass_per_length_kg_per_m = {}",
    "rotary inertia about y": "[sections....] rho_I_kgm = {{ y = {}, ... }}",
    "rotary inertia about z": "[sections....] rho_I_kgm = {{ z = {}, ... }}",
    "station of joint": "station = {}",
    "station of body": "station = {}",
}
WORDS = {"urdf": URDF, "mjcf": MJCF, "sdf": SDF, "usd": USD, "toml": TOML}
COMMAS = ("usd", "toml")  # formats whose vectors have commas
TENSOR = {
    "urdf": ("<inertial> <inertia {}/>, along the axes of the link (origin rpy 0 0 0)", (0, 1, 2, 3, 4, 5)),
    "mjcf": (
        '<inertial fullinertia="{}" .../>, in the order xx yy zz xy xz yz, instead of diaginertia and any turn of the inertial',
        (0, 3, 5, 1, 2, 4),
    ),
    "sdf": (
        "<inertial> <inertia> {}, along the axes of the link (no rotation in the inertial's <pose>)",
        (0, 1, 2, 3, 4, 5),
    ),
    "toml": ("inertia_kgm2 = {{ {} }}", (0, 1, 2, 3, 4, 5)),
}
BEAMS = [cause for cause, words in TOML.items() if words.startswith("[sections")]
# An entry of a tensor in the format's words: name, number.
ENTRY = {"urdf": '{}="{}"', "mjcf": "{1}", "sdf": "<{0}>{1}</{0}>", "toml": "{0} = {1}"}
# By cause what `check_bodies` and `check_sides` say of it.
CHECKS = {
    "mass": {"mass", "left and right"},
    "centre of mass": {"com", "left and right"},
    "inertia tensor": {"tensor", "default tensor", "mass without tensor", "tensor without mass", "left and right"},
}
# What stands before all that stands on the world; for these formats there are such words.
STANDS = {
    "urdf": 'a fixed joint from a new root link to {root}: <joint type="fixed"> <origin xyz="{xyz}" rpy="{rpy}"/>',
    "mjcf": 'all bodies of the <worldbody> within <frame pos="{xyz}" quat="{quat}">',
    "sdf": "<model> <pose>{xyz} {rpy}</pose>",
}
FRAMED = ("position of joint", "orientation of joint")  # of joints: they depend on the frames of two links
PLACED = (*FRAMED, "joint axis", SIGN, ZERO, "centre of mass", "inertia tensor")


@dataclass(frozen=True)
class ComparedDescriptions:
    """Both descriptions, their reduced trees, and the alignment by member of the first.

    rehung : links of the second whose frames stand elsewhere than in its file, because it is told from another root
    """

    descriptions: tuple[Description, Description]
    trees: tuple[Tree, Tree]
    alignments: Mapping[int, MemberAlignment]
    rehung: frozenset[str] = frozenset()

    def find_member_pair(self, difference: Difference) -> tuple[Member, Member, MemberAlignment] | None:
        """Return the members of both that a difference is about, and their alignment; None for one of several or of none."""
        k = self._find_member_number(difference)
        if k is None or k not in self.alignments:
            return None
        seat = self.alignments[k]
        one = self.trees[0].members[k]
        two = self.trees[1].members[seat.second]
        part = difference.place.partition(" ")[2].partition(" (on link ")
        return (
            (make_single_body_member(one, part[0]), make_single_body_member(two, part[0]), seat)
            if part[1]
            else (one, two, seat)
        )

    def find_merged_alignment(self, difference: Difference) -> MemberAlignment | None:
        """Return the seat of two members where a difference is about one of their bodies, and one file alone states it apart."""
        k = self._find_member_number(difference)
        if not difference.place.startswith("body ") or k is None or k not in self.alignments:
            return None
        seat = self.alignments[k]
        one = self.trees[0].members[seat.first]
        two = self.trees[1].members[seat.second]
        return seat if dict(one.parts).keys() != dict(two.parts).keys() else None

    def _find_member_number(self, difference: Difference) -> int | None:
        numbers = {index for index, _, _ in difference.changes}
        if len(numbers) == 1:
            return numbers.pop()
        kind, _, name = difference.place.partition(" ")
        if kind == "body":
            kind = "link"
            name = name.partition(" (on link ")[2].removesuffix(")")
        called = {k: one.name if kind == "link" else one.joint for k, one in enumerate(self.trees[0].members)}
        return next((k for k, label in called.items() if label == name), None)


def make_single_body_member(member: Member, part: str) -> Member:
    """Return a member as one of the bodies that make it up [kg, m, kg m^2]."""
    body = dict(member.parts)[part]
    return replace(member, name=part, mass=body.mass, com=body.com, tensor=body.tensor, parts=((part, body),))


def collect_advice(judgement: Judgement, sides: ComparedDescriptions) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Return by difference which file looks wrong, and what to write in A to have B's machine, in B to have A's [any unit]."""
    odd = [_collect_odd_numbers(description) for description in sides.descriptions]
    found = []
    for difference in (*judgement.causes, *judgement.conventions, *judgement.limits):
        merged = sides.find_merged_alignment(difference)
        both = sides.find_member_pair(difference) if difference.cause != BASE and merged is None else None
        if difference.cause == BASE:
            lines = list(_describe_base_change(difference, sides))
        elif merged is not None:
            lines = list(_describe_merged_body(difference, sides, merged))
        elif both is None or difference.place.startswith("all "):
            lines = list(_describe_common_change(difference, sides))
        else:
            doubts = [
                _describe_doubt(difference.cause, odd[0], both[0]),
                _describe_doubt(difference.cause, odd[1], both[1]),
            ]
            lines = [*_describe_suspect_file(doubts), *_describe_member_change(difference, sides, both)]
        if lines:
            found.append((difference.subject, tuple(lines)))
    return tuple(found)


def _describe_suspect_file(doubts: list[str]) -> Iterator[str]:
    """Yield which file to mend, where the numbers of one look wrong by themselves."""
    for n, side in enumerate("AB"):
        if doubts[n] and not doubts[1 - n]:
            yield f"mend {side}: {doubts[n]}"


def _collect_odd_numbers(description: Description) -> dict[str, list[tuple[str, str]]]:
    """By link the check and the words of what looks odd in its numbers."""
    mechanism = description.mechanism
    links = {
        link.name: LinkStatements(
            link.name, join_bodies([part.inertia for part in link.bodies]), True, bool(link.bodies)
        )
        for link in mechanism.links
    }
    lengths = sorted(float(np.linalg.norm(joint.placement.position)) for joint in mechanism.joints)
    found: dict[str, list[tuple[str, str]]] = {}
    mountings = [
        Mounting(joint.parent, joint.child, joint.placement) for joint in mechanism.joints if joint.station is None
    ]
    for one in (*check_bodies(links, float(sum(lengths[-6:])) or 1.0), *check_sides(links, mountings)):
        for name in one.place.partition(" ")[2].split(", "):
            found.setdefault(name, []).append((one.check, f"{one.given}: {one.why}"))
    return found


def _describe_doubt(cause: str, odd: Mapping[str, list[tuple[str, str]]], member: Member) -> str:
    names = [member.name, *(name for name, _ in member.parts if name != member.name)]
    words = [f"{n}, {text}" for n in names for check, text in odd.get(n, ()) if check in CHECKS.get(cause, ())]
    return words[0] if words else ""


def _describe_common_change(difference: Difference, sides: ComparedDescriptions) -> Iterator[str]:
    """Yield the lines for one factor on all numbers of a kind, or for the same number in several joints."""
    if difference.place.startswith("joints ") and difference.changes:
        members = [sides.trees[0].members[k] for k, _, _ in difference.changes]
        others = [sides.trees[1].members[sides.alignments[k].second] for k, _, _ in difference.changes]
        for n, (side, other, changed_members, value) in enumerate(
            (("A", "B", members, difference.second), ("B", "A", others, difference.first))
        ):
            description = sides.descriptions[n]
            if text := describe_quantity(description.format, difference.cause, value):
                names = ", ".join(member.joint for member in changed_members)
                yield f"to make {side} ({description.label}) like {other}, in each of the joints {names}: {text}"
    factor = difference.second.partition(" ")[0]
    if difference.second.endswith("times that of A"):
        yield f"to make A like B, multiply it by {factor} everywhere"
        yield f"to make B like A, divide it by {factor} everywhere"


def _describe_merged_body(
    difference: Difference, sides: ComparedDescriptions, alignment: MemberAlignment
) -> Iterator[str]:
    """Yield what to write of one body where it stands alone, and of the whole where it does not [kg], [m], [kg m^2]."""
    members = sides.trees[0].members[alignment.first], sides.trees[1].members[alignment.second]
    names = _find_body_names(difference, members, alignment)
    values = difference.second, difference.first
    wholes = (
        move_inertia(alignment.frame, members[1].inertia),
        move_inertia(inverse(alignment.frame), members[0].inertia),
    )
    for n, (side, other) in enumerate((("A", "B"), ("B", "A"))):
        head = f"to make {side} ({sides.descriptions[n].label}) like {other}, in"
        if _has_reframed_link(sides, alignment) and n:
            continue  # the number would be one in frames that B's file has not
        if len(members[n].parts) > 1 and names[n]:
            if not n or difference.cause == "mass" or _is_same_frame(alignment):
                yield f"{head} body {names[n]}, in the frame of link {members[n].name}: {difference.cause} {values[n]}"
        else:
            whole = wholes[n]
            more = list(dict(members[1 - n].parts))[:6]
            apart = f", of which {other} states {', '.join(more)} apart" if len(more) > 1 else ""
            tensor = format_vector(whole.tensor[np.triu_indices(3)])
            numbers = f"mass {whole.mass:.9g}, centre of mass {format_vector(whole.com)}, inertia tensor {tensor}"
            yield f"{head} link {members[n].name}{apart}: {numbers}"


def _find_body_names(
    difference: Difference, members: tuple[Member, Member], alignment: MemberAlignment
) -> tuple[str, str]:
    """The body that a difference is about as each side calls it; "" where a side has none that is this body and no more."""
    name = difference.place.partition(" ")[2].partition(" (on link ")[0]
    parts = dict(members[0].parts), {label: move_inertia(alignment.frame, body) for label, body in members[1].parts}
    # The difference was found of a body of A where it changes that part, and of one of B where it changes the whole.
    mine = 0 if any(field.startswith("part ") for _, field, _ in difference.changes) else 1
    rest = join_bodies(body for label, body in parts[mine].items() if label != name)
    size = max(float(np.linalg.norm(body.com)) for label in parts for body in label.values())
    other = find_counterpart(parts[1 - mine], rest, size)
    return (other, name) if mine else (name, other)


def _describe_base_change(difference: Difference, sides: ComparedDescriptions) -> Iterator[str]:
    """Yield what stands before the root of either file so that it stands as the other does."""
    motion = difference.motion or Placement()
    for description, side, other, frame in zip(sides.descriptions, "AB", "BA", (motion, inverse(motion)), strict=True):
        root = next((joint.child for joint in description.mechanism.joints if joint.parent == WORLD), "")
        if words := STANDS.get(description.format, ""):
            x, y, z, w = convert_to_quaternion(frame.rotation)
            turns = {
                "rpy": format_vector(np.array(compute_roll_pitch_yaw(frame.rotation))),
                "quat": format_vector(np.array([w, x, y, z])),
            }
            what = words.format(root=root, xyz=format_vector(frame.position), **turns)
            yield f"to make {side} ({description.label}) like {other}: {what}"


def _describe_member_change(
    difference: Difference, sides: ComparedDescriptions, both: tuple[Member, Member, MemberAlignment]
) -> Iterator[str]:
    values = _convert_values(difference, both)
    for n, (side, other) in enumerate((("A", "B"), ("B", "A"))):
        words = _describe_new_value(difference, sides, both, n, values[n])
        if words:
            place = difference.place.partition(" ")[0]
            member = (both[0], both[1])[n]
            called = member.joint if place == "joint" else member.name
            yield f"to make {side} ({sides.descriptions[n].label}) like {other}, in {place} {called}{words}"


def _describe_new_value(
    difference: Difference,
    sides: ComparedDescriptions,
    both: tuple[Member, Member, MemberAlignment],
    n: int,
    value: str,
) -> str:
    """Return the words for a member of A (n = 0) or of B (n = 1); "" where no number is right in its file's frames."""
    cause = difference.cause
    seat = both[2]
    parts = _list_massive_parts((both[0], both[1])[n])
    if n and _is_in_other_frames(cause, sides, both):
        return ""
    if cause in CHECKS and len(parts) > 1:
        return f", together with what is fixed to it ({', '.join(parts[:6])}): {cause} {value}"
    if difference.place.startswith("body ") and cause in CHECKS and cause != "mass":
        link = sides.trees[n].members[seat.second if n else seat.first].name
        return f", in the frame of link {link}: {cause} {value}"
    if cause == ZERO and not n:
        return f", turn or shift the joint's frame along its axis by {value} {difference.unit}, and the limits back"
    text = describe_quantity(sides.descriptions[n].format, _resolve_cause_name(difference, seat, n), value)
    return text and f": {text}"


def _list_massive_parts(member: Member) -> list[str]:
    return [name for name, body in member.parts if body.mass or body.tensor.any()]


def _is_in_other_frames(cause: str, sides: ComparedDescriptions, both: tuple[Member, Member, MemberAlignment]) -> bool:
    """Return True if the number of B would be one in frames that its file has not, or in those of A."""
    if cause in PLACED and _has_reframed_link(sides, both[2]):
        return True
    return cause in FRAMED and _has_moved_frame(sides, both)


def _has_moved_frame(sides: ComparedDescriptions, both: tuple[Member, Member, MemberAlignment]) -> bool:
    """Return True if a frame of the member or of its carrier stands elsewhere in B."""
    carrier = sides.alignments.get(both[0].parent)
    return any(not _is_same_frame(seat) for seat in (both[2], carrier) if seat is not None)


def _has_reframed_link(sides: ComparedDescriptions, alignment: MemberAlignment) -> bool:
    """Return True if B's link or the one that carries it has another frame here than in its file."""
    members = sides.trees[1].members
    member = members[alignment.second]
    return member.name in sides.rehung or (member.parent >= 0 and members[member.parent].name in sides.rehung)


def _is_same_frame(alignment: MemberAlignment) -> bool:
    off = max(np.abs(alignment.frame.position).max(), np.abs(alignment.frame.rotation - np.eye(3)).max())
    return bool(off <= SAME) and alignment.sign > 0 and not alignment.offset


def _resolve_cause_name(difference: Difference, alignment: MemberAlignment, side: int) -> str:
    """The cause as a side calls it: B's lower limit is A's upper one where the coordinate counts the other way."""
    cause = difference.cause
    if cause == SIGN and LEFT_LIMITS in difference.hints:
        return SIGN_ALONE
    if side and alignment.sign < 0 and cause in ("lower limit", "upper limit"):
        return "upper limit" if cause == "lower limit" else "lower limit"
    return cause


def _convert_values(difference: Difference, both: tuple[Member, Member, MemberAlignment]) -> tuple[str, str]:
    """Return the value of B in A's frame and coordinate, and that of A in B's."""
    one, _, seat = both
    cause = difference.cause
    back = inverse(seat.frame)
    there = move_inertia(back, one.inertia)
    if cause == "centre of mass":
        return difference.second, format_vector(there.com)
    if cause == "inertia tensor":
        return difference.second, format_vector(there.tensor[np.triu_indices(3)])
    if cause == "joint axis":
        return difference.second, format_vector(seat.sign * back.rotation @ one.axis)
    if cause in ("lower limit", "upper limit") and difference.first != "none":
        return difference.second, f"{seat.sign * (float(difference.first) - seat.offset):.9g}"
    return difference.second, difference.first


def describe_quantity(kind: str, cause: str, value: str) -> str:
    """Return a format's words for a quantity [any unit]; "" where it has none."""
    varies = cause in BEAMS and " " in value  # numbers at several stations: the section says them in a table
    if not value or value == "none" or kind not in WORDS or varies:
        return ""
    if cause == "inertia tensor":
        return _describe_tensor(kind, value) if kind in TENSOR else ""
    words = WORDS[kind].get(cause, "")
    value = value.removesuffix(" rpy")
    return words.format(", ".join(value.split()) if kind in COMMAS else value) if words else ""


def _describe_tensor(kind: str, value: str) -> str:
    pattern, order = TENSOR[kind]
    numbers = [value.split()[k] for k in order]
    names = [name.removeprefix("i") for name in INERTIAS] if kind == "toml" else INERTIAS
    entries = [ENTRY[kind].format(name, x) for name, x in zip(names, numbers, strict=True)]
    return pattern.format((", " if kind in COMMAS else " ").join(entries))
