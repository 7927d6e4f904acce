"""Answers: what is right for a planted fault, what was named, and the verdict on both.

An answer is ``name @ place = size unit + name @ place``: after + stands what a practitioner would accept beside it.  Answers of
one fault are separated by |, those of several faults by ;.  Names are a practitioner's; `read_answer` turns what crosscheck says
into them.  A place * is any place.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from campaigns.log_faults.machines import ELASTIC
from crosscheck.identification.causes.cause import NamedCause

ERRORS = 3.0  # a size is right within so many of its standard errors ...
PART = 0.05  # ... and this part of itself
MOST_IN_SET = 3  # causes that are said to be as likely
UNKNOWN = "unknown"
NOTHING = "nothing"
REFUSED = "refused"
# What differs on another day, by an amount that is not judged.
FRICTION = ("friction scale", "viscous friction", "coulomb friction", "friction asymmetry", "effort offset")
# Names that crosscheck has for what a practitioner calls otherwise.
NAMES = {
    "offset of the effort": "effort offset",
    "torque constant, relative error": "effort gain",
    "wrong sign of the effort": "effort sign",
    "wrong unit of the effort": "effort unit",
    "wrong side of the gear": "effort unit",
    "clipped effort": "effort clipped",
    "quantisation of the effort": "effort resolution",
    "delay of the effort": "effort delay",
    "delay of the efforts": "effort delay",
    "first-order lag of the effort": "effort lag",
    "swapped columns of the efforts": "swapped efforts",
    "offset of the angle": "angle offset",
    "scale of the angle (gear), relative error": "angle gain",
    "wrong gear before the angle": "angle gain",
    "wrong sign of the angle": "angle sign",
    "wrong unit of the angle": "angle unit",
    "quantisation of the angle": "angle resolution",
    "delay of the angle": "angle delay",
    "swapped columns of the angles": "swapped angles",
    "slow clock, relative error": "clock",
    "friction, relative error": "friction scale",
    "viscous friction beside what is known": "viscous friction",
    "coulomb friction beside what is known": "coulomb friction",
    "rotor inertia beside what is known": "rotor inertia",
    "payload beside what is known": "payload",
    "spring beside what is known": "spring",
    "tilt of gravity": "tilt",
    "size of gravity, relative error": "gravity",
    "drift of the effort": "effort drift",
    "drift of the torque constant, relative": "gain drift",
    "growth of friction, relative": "friction drift",
    "drift of the angle": "angle drift",
    "ripple of the angle, 1 a turn": "angle ripple",
    "ripple of the angle, 2 a turn": "angle ripple",
    "efficiency of the gear less one": "gear efficiency",
    "spikes of the effort": "effort spikes",
    "spikes of the angle": "angle spikes",
    "dropouts of the effort": "effort dropout",
    "dropouts of the angle": "angle frozen",
    "jump of the angle": "angle jump",
    "backlash of the gear": "backlash",
    "part of the effort of another joint, carried too": "coupled effort",
    "step of the effort": "effort step",
    "settling of the effort's zero": "effort drift",
    "oscillation of the effort": "oscillation",
    "dry friction that changes with the angle": "friction of the angle",
    "stiction beside what is known": "stiction",
    "quadratic friction beside what is known": "drag of the squared rate",
    "saturation of the effort": "iron saturation",
    "curvature of the effort's sensor": "bent sensor",
    "gain of positive efforts alone": "one-sided gain",
    "dead band of the effort": "dead band",
    "part of the reading of another effort": "crosstalk",
    "part of the angle of another joint": "coupled angle",
    "twist of the gear by its load": "gear stiffness",
    "angle from the world": "absolute angle",
    "stiffness of the joint": "stiffness of the joint",
    "swapped columns of the joints": "swapped joints",
    "copied column of the effort": "copied effort",
    "effort without its sign": "effort unsigned",
    "wrapped effort": "overflow",
    "no cause that is known": UNKNOWN,
}
FACTORS = ("clock", "effort gain", "angle gain", "gravity", "gear efficiency")
PLACES = {"the world's y axis": "y", "the world's x axis": "x", "the world": "*", "all joints": "*", "the times": "*"}
RIPPLE = re.compile(r"ripple of the effort, .* a turn")
PAIR = re.compile(r" and ")  # of joints whose columns are swapped
FAR = re.compile(r", (?:[-\d.e]+ times as far out as its centre of mass|at its centre of mass|at x = .* m$)")
ALIKE = re.compile(r"next to as likely: (.+)$")
SAID = re.compile(r"(?P<name>.+) of (?P<place>[^,]+), (?P<size>[-+\d.e]+)(?: .*)?$")


@dataclass(frozen=True)
class Answer:
    """A name with its place and size [unit of it], its standard error, and what may stand beside it."""

    name: str
    place: str
    size: float | None = None
    error: float = 0.0
    beside: tuple[Answer, ...] = ()


@dataclass(frozen=True)
class Verdict:
    """A verdict, and what was wrong in words."""

    word: str
    said: str = ""


def parse_answers(text: str) -> list[list[Answer]]:
    """Return the right answers [units as written] of every fault of a row."""
    return [[_parse_answer(option) for option in part.split("|")] for part in text.split(";")]


def _parse_answer(text: str) -> Answer:
    first, *others = (piece.strip() for piece in text.split(" + "))
    what, _, size = first.partition(" = ")
    name, _, place = what.partition(" @ ")
    number = float(size.split()[0]) if size else None
    return Answer(name.strip(), place.strip(), number, beside=tuple(_parse_answer(other) for other in others))


def read_answer(name: str, place: str, size: float, error: float) -> Answer:
    """Return a named cause in the names of answers, with factors for relative errors and the base for gravity [-]."""
    first = name.partition(", ")[0]  # behind it stands where, when or how fast
    own = "effort ripple" if RIPPLE.fullmatch(name) else NAMES.get(name) or NAMES.get(first, first)
    where = FAR.sub("", place)
    where = "*" if PAIR.search(where) else PLACES.get(where, where)
    if own.startswith("length of the link"):
        own = "length"
    if own == "gear stiffness":  # of one unit of load
        return Answer(own, where, 1.0 / size, error / size**2)
    if own == "stiffness of the joint":
        return Answer("gear stiffness", where, ELASTIC.spring * (1.0 + size), ELASTIC.spring * error)
    if own == "clock":
        return Answer(own, where, 1.0 / (1.0 + size), error)
    if own in FACTORS:
        return Answer(own, where, 1.0 + size, error)
    return Answer(own, where, -size if own == "tilt" else size, error)


def list_said(cause: NamedCause) -> list[Answer]:
    """Return a named cause, and those that its evidence calls next to as likely [units of the answers]."""
    said = [read_answer(cause.name, cause.place, cause.size, cause.error)]
    alike = ALIKE.search(cause.evidence)
    for text in FAR.sub("", alike[1]).split("; ") if alike else ():
        if found := SAID.match(text):
            said.append(read_answer(found["name"], found["place"], float(found["size"]), cause.error))
    return said[:MOST_IN_SET]


def has_name_of(said: Answer, right: Answer) -> bool:
    """Return True where name and place of what is said are right."""
    return said.name == right.name and (said.place == right.place or "*" in (said.place, right.place))


def has_size_of(said: Answer, right: Answer) -> bool:
    """Return True where the size [unit of it] is right within its error; a factor is held against what it differs from 1."""
    if right.size is None or said.size is None:
        return True
    whole = right.size - 1.0 if right.name in FACTORS else right.size
    return abs(said.size - right.size) <= ERRORS * said.error + PART * abs(whole)


def judge_causes(right: str, named: tuple[NamedCause, ...], refused: str, other_day: bool) -> Verdict:
    """Return the verdict [-] on what was named, by the right answers of a row.

    refused : the words that refused the log, or none; other_day : friction and offsets differ, too
    """
    parts = parse_answers(right)
    accepts_nothing = any(one.name == NOTHING for part in parts for one in part)
    if refused:
        is_right = any(one.name == REFUSED for part in parts for one in part)
        return Verdict("right") if is_right else Verdict("wrong name", f"refused: {refused}")
    causes = [cause for cause in named if NAMES.get(cause.name) != UNKNOWN]
    unknown = len(causes) < len(named)
    judged = [(*_judge_cause(list_said(cause), parts, other_day), cause.words) for cause in causes]
    for word in ("wrong name", "wrong size"):
        if said := "; ".join(words for verdict, _, words in judged if verdict == word):
            return Verdict(word, said)
    found = {part for _, part, _ in judged if part >= 0}
    in_set = any(verdict == "in set" for verdict, _, _ in judged)
    if len(found) == len(parts):
        return Verdict("in set" if in_set else "right")
    if accepts_nothing:
        return _judge_untouched(unknown, other_day or right != NOTHING)
    return Verdict("in part" if found else "unknown" if unknown else "silent")


def _judge_untouched(unknown: bool, may_differ: bool) -> Verdict:
    if unknown:
        return Verdict("unknown") if may_differ else Verdict("wrong name", "something unknown in a good log")
    return Verdict("right")


def _judge_cause(said: list[Answer], parts: list[list[Answer]], other_day: bool) -> tuple[str, int]:
    """Verdict on one named cause, and the fault that it names (-1: none, but it is accepted)."""
    sized = ("wrong name", -1)
    for k, one in enumerate(said):
        drawn_anew = other_day and one.name in FRICTION
        for p, options in enumerate(parts):
            alike = [option for option in options if has_name_of(one, option)]
            if any(drawn_anew or has_size_of(one, option) for option in alike):
                return ("in set" if k else "right"), p
            if alike and not k:
                sized = ("wrong size", p)
            if drawn_anew and any(option.name in FRICTION and option.place == one.place for option in options):
                return "right", p
        beside = [b for options in parts for option in options for b in option.beside]
        if drawn_anew or any(has_name_of(one, b) for b in beside):
            return "right", -1
    return sized
