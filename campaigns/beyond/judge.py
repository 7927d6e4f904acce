"""Judgement of named causes against planted ones: by the quantity that each is about, and its place.

A cause of the dictionary is known here by its public name only.  `KINDS` says which quantities an answer by that name is about;
a name that is not in it is read by the words in `WORDS`, and one that no word fits is no answer to anything.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal, get_args

from campaigns.beyond.fault import ALL, CorrectAnswer, Fault

LARGEST = 3  # names in a set that helps a reader
Outcome = Literal[
    "right",
    "in set",
    "near",
    "unknown",
    "wide",
    "wrong",
    "accepted",
    "refused",
    "silent",
    "seen",
    "false alarm",
    "failed",
]
OUTCOMES: tuple[Outcome, ...] = get_args(Outcome)
GOOD: tuple[Outcome, ...] = ("right", "in set")
BAD: tuple[Outcome, ...] = ("wrong", "accepted", "wide", "false alarm", "failed")

KINDS: dict[str, tuple[str, ...]] = {
    "rotor inertia": ("rotor",),
    "rotor inertia dropped": ("rotor",),
    "viscous damping": ("viscous",),
    "damping dropped": ("viscous",),
    "dry friction": ("dry friction",),
    "friction dropped": ("dry friction",),
    "implicit damping": ("implicit damping",),
    "joint stiffness": ("joint spring",),
    "zero offset": ("angle offset",),
    "axis sign": ("axis sign",),
    "axis tilted": ("axis tilt",),
    "joint misplaced": ("placement",),
    "gravity sign": ("gravity size",),
    "gravity off": ("gravity size",),
    "gravity twice": ("gravity size",),
    "gravity magnitude": ("gravity size",),
    "base acceleration": ("gravity vector",),
    "mass scale": ("mass",),
    "body mass": ("mass",),
    "missing body": ("missing body", "mass"),
    "payload": ("payload",),
    "centre of mass shifted": ("com",),
    "inertia about the origin": ("inertia",),
    "inertia about the wrong point": ("inertia",),
    "inertial frame rotated": ("inertia",),
    "rotary inertia dropped": ("inertia",),
    "fixed joint fused wrongly": ("orientation", "placement"),
    "order of efforts": ("effort order",),
    "order of coordinates": ("coordinate order",),
    "effort sign": ("effort sign",),
    "effort sign of a joint": ("effort sign",),
    "effort scale": ("effort scale", "gear ratio"),
    "time offset": ("time shift",),
    "velocity terms dropped": ("velocity terms",),
    "base acceleration convention": ("acceleration convention",),
    "base acceleration convention (spatial)": ("acceleration convention",),
    "soft constraint": ("closure softness",),
    "section stiffness": ("stiffness",),  # and the one that its target names
    "shear factor": ("GA",),
    "beam mass": ("beam mass",),
    "rotary inertia of the section": ("rho I",),
    "beam damping": ("beam damping",),
    "beam damping dropped": ("beam damping",),
    "beam length": ("beam length", "length"),
    "section turned": ("section turned",),
    "curvature dropped": ("curvature",),
    "lumped mass": ("lumped mass",),
    "time step": ("step",),
    "numerical damping": ("numerical damping",),
    "asymmetric friction": ("dry friction",),
    "Stribeck friction": ("stribeck",),
    "smoothed friction": ("smoothed friction",),
    "quadratic damping": ("quadratic drag",),
    "gear efficiency": ("gear efficiency", "load friction"),
    "effort offset": ("effort offset",),
    "viscous damping exchanged": ("viscous exchanged", "viscous"),
    "dry friction exchanged": ("dry friction exchanged", "dry friction"),
    "rotor inertia exchanged": ("rotor exchanged", "rotor"),
    "weight of a drive": ("weights",),
    "drive at another joint": ("drive place",),
    "bodies exchanged": ("mix-up",),
    "sign of products of inertia": ("inertia",),
    "moments of inertia exchanged": ("inertia",),
    "order of the inertia's numbers": ("inertia",),
    "moment of inertia": ("inertia",),
    "centre of mass mirrored": ("com",),
    "effort scale of all": ("effort scale",),
    "coordinate scale": ("motion", "gear ratio"),
    "speed scale": ("velocity terms", "motion"),
    "acceleration terms dropped": ("acceleration terms",),
    "acceleration scale": ("acceleration terms", "motion"),
    "time scale": ("time scale", "motion"),
    "length scale": ("length",),
    "centres of mass scaled": ("com",),
    "inertia scale": ("inertia",),
    "mass without inertia": ("mass",),
    "rotor inertia scale": ("rotor",),
    "damping scale": ("viscous",),
    "friction scale": ("dry friction",),
    "motions exchanged": ("motion", "coordinate order"),
    "motion law": ("motion",),
    "efforts late": ("time shift",),
    "low-pass filter": ("filter",),
    "moving average": ("filter",),
    "resampled": ("resampling",),
    "quantisation": ("quantisation",),
    "saturation": ("saturation",),
    "effort offset taken off": ("effort offset",),
    "drift": ("drift",),
    "column given twice": ("wrong column",),
    "differentiated motion": ("derivative",),
    "link length": ("length", "placement"),
    "joint frame turned": ("orientation",),
    "closure point misplaced": ("closure",),
    "closure frame turned": ("closure",),
    "coupling ratio": ("gear ratio", "closure"),
    "coupling offset": ("closure",),
    "clamp misplaced": ("clamp",),
    "clamp turned": ("clamp",),
    "initial curvature": ("curvature",),
    "body along the beam": ("placement", "com"),
    "spring stiffness": ("spring stiffness",),
    "spring rest length": ("spring rest",),
    "spring damping": ("spring damping",),
    "spring missing": ("spring stiffness",),
    "spring end misplaced": ("closure", "placement"),
    "rest of a joint spring": ("joint spring", "spring rest"),
    "given force": ("force",),
    "force at the tip": ("force",),
    "given force missing": ("force",),
    "axes of a given force": ("force",),
    "modulus of elasticity": ("E", "stiffness"),
    "shear modulus": ("GA", "GJ"),
    "density": ("beam mass", "mass"),
    "cross-section area": ("EA", "beam mass"),
    "section width": ("section size",),
    "section height": ("section size",),
    "section size": ("section size",),
    "wall thickness": ("section size",),
}
# What the dictionary could say when the catalogue was written: a mistake that is nothing of it is new to it.
OLD = frozenset(
    {
        "EA",
        "EI_y",
        "EI_z",
        "GA",
        "GA_y",
        "GA_z",
        "GJ",
        "acceleration convention",
        "angle offset",
        "axis sign",
        "axis tilt",
        "beam damping",
        "beam length",
        "beam mass",
        "closure softness",
        "com",
        "coordinate order",
        "curvature",
        "dry friction",
        "effort order",
        "effort scale",
        "effort sign",
        "gear ratio",
        "gravity size",
        "gravity vector",
        "implicit damping",
        "inertia",
        "joint spring",
        "length",
        "lumped mass",
        "mass",
        "missing body",
        "numerical damping",
        "orientation",
        "payload",
        "placement",
        "rho I",
        "rotor",
        "section turned",
        "step",
        "stiffness",
        "time shift",
        "velocity terms",
        "viscous",
    }
)
# For names that came later: the first pattern that fits decides.
WORDS: tuple[tuple[str, tuple[str, ...]], ...] = (
    (r"damping.*exchanged|exchanged.*damping|damping.*wrong joint", ("viscous exchanged", "mix-up")),
    (r"friction.*exchanged|exchanged.*friction|friction.*wrong joint", ("dry friction exchanged", "mix-up")),
    (r"rotor.*exchanged|exchanged.*rotor|rotor.*wrong joint", ("rotor exchanged", "mix-up")),
    (r"column", ("wrong column", "effort order")),
    (r"exchanged|mixed up|mix-up|swapped|each other", ("mix-up", "effort order", "coordinate order", "section turned")),
    (r"drive.*(another joint|sits|place)|actuator on", ("drive place",)),
    (r"rank|kind of.*closure|closure.*kind", ("closure rank", "closure")),
    (r"angle of the section|section angle|section.*turned by", ("section angle", "clamp")),
    (r"elements|mesh", ("mesh",)),
    (r"smoothed (sign|friction)|tanh", ("smoothed friction", "dry friction")),
    (r"reported point|point of the tip|tip point", ("tip",)),
    (r"weight", ("weights",)),
    (r"branch|other side", ("branch",)),
    (r"closure.*(soft|stays)", ("closure softness",)),
    (r"closure|loop clos", ("closure",)),
    (r"coupling|gear.*ratio", ("gear ratio", "effort scale", "closure")),
    (r"stribeck", ("stribeck",)),
    (r"load.*friction|friction.*load|efficiency", ("load friction", "gear efficiency")),
    (r"quadratic|drag|air|square of (the|its) (rate|speed)", ("quadratic drag", "medium")),
    (r"cogging|ripple", ("ripple",)),
    (r"retardation|kelvin|beam damping", ("beam damping",)),
    (r"damper|spring damping", ("spring damping", "viscous")),
    (r"viscous|damping", ("viscous",)),
    (r"friction", ("dry friction",)),
    (r"rotor|armature", ("rotor",)),
    (r"rest length|spring rest", ("spring rest", "joint spring")),
    (r"spring", ("spring stiffness", "joint spring")),
    (r"given force|external force|force on|wrench on", ("force",)),
    (r"low-pass|filter|smooth|average", ("filter",)),
    (r"difference|derivative|differentiat", ("derivative",)),
    (r"noise|repeat", ("noise",)),
    (r"quanti[sz]|bits", ("quantisation",)),
    (r"saturat|clip|limit of", ("saturation",)),
    (r"outlier|spike|lost samples|dropped sample", ("outliers", "dropped samples")),
    (r"held|resampl|every few|coarse samples", ("resampling",)),
    (r"drift", ("drift",)),
    (r"offset of the effort|effort offset|bias|constant effort", ("effort offset",)),
    (r"time scale|clock|faster|slower|duration|other law|another law|motion law", ("motion", "time scale")),
    (r"late|delay|time offset", ("time shift",)),
    (r"acceleration.*(missing|dropped)", ("acceleration terms",)),
    (r"density|all masses", ("mass", "beam mass")),
    (r"width|thickness|wall|diameter|section size|larger section|scaled section", ("section size",)),
    (r"young|modulus|elastic", ("E", "stiffness")),
    (r"shear", ("GA",)),
    (r"torsion", ("GJ", "stiffness")),
    (r"clamp", ("clamp",)),
    (r"bow|curvature", ("curvature",)),
    (r"length of|longer|shorter", ("length", "beam length", "placement")),
    (r"centre of mass|centres of mass", ("com",)),
    (r"inertia|tensor", ("inertia",)),
    (r"orientation|frame of .* turned", ("orientation",)),
    (r"base|tilted ground", ("base pose", "gravity vector")),
    (r"gravity", ("gravity size",)),
    (r"effort|torque|unit", ("effort scale",)),
    (r"mass", ("mass",)),
)


def find_kinds(named: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the kinds of a named cause: by its name, else by the words in it; of a beam's stiffness also the component."""
    name = str(named["cause"])
    target = str(named.get("target", ""))
    if name in KINDS:
        return (*KINDS[name], *(re.findall(r"\b(?:EA|GA_y|GA_z|GJ|EI_y|EI_z)\b", target)))
    text = f"{name} {named.get('words', '')}".lower()
    for pattern, kinds in WORDS:
        if re.search(pattern, name.lower()) or (pattern and re.search(pattern, text)):
            return (*kinds, *(re.findall(r"\b(?:EA|GA_y|GA_z|GJ|EI_y|EI_z)\b", target)))
    return ()


def is_true_cause(named: Mapping[str, Any], truth: CorrectAnswer) -> bool:
    """Return True if a named cause gives one of the quantities of a truth, at one of its places."""
    if not set(find_kinds(named)) & set(truth.kinds):
        return False
    target = str(named.get("target", ""))
    if not truth.places:
        return True
    if not target or target.lower() == ALL or "all efforts" in str(named.get("words", "")):
        return ALL in truth.places
    words = {target, *re.split(r"[\s,:;()/]+", target), *target.split(", "), *target.split(": ")}
    return any(place in words or re.search(rf"(?<![\w.]){re.escape(place)}(?![\w])", target) for place in truth.places)


def split_causes(named: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the causes of one answer: two at once stand as "cause + cause", with their places in the same order."""
    names = str(named["cause"]).split(" + ")
    if len(names) == 1:
        return [named]
    places = str(named.get("target", "")).split(" + ")
    words = re.split(r"; and |; | and ", str(named.get("words", "")))
    words = words if len(words) == len(names) else [""] * len(names)
    places = places if len(places) == len(names) else [str(named.get("target", ""))] * len(names)
    return [{"cause": n, "target": p, "words": w} for n, p, w in zip(names, places, words, strict=True)]


def judge_answer(named: Mapping[str, Any], fault: Fault) -> Literal["right", "near", "wrong"]:
    """Return the worth of one answer: right if its causes are all the planted ones and no other; near if half right."""
    found = split_causes(named)
    if any(parts and _is_complete(found, parts) for parts in (fault.parts, fault.same)):
        return "right"
    half = [*(truth for part in (*fault.parts, *fault.same) for truth in part), *fault.near]
    return "near" if all(any(is_true_cause(cause, truth) for truth in half) for cause in found) else "wrong"


def _is_complete(found: Sequence[Mapping[str, Any]], parts: Sequence[Sequence[CorrectAnswer]]) -> bool:
    """Return True if the causes give every part, and nothing else."""
    met = [any(is_true_cause(cause, truth) for cause in found for truth in part) for part in parts]
    true = [any(is_true_cause(cause, truth) for part in parts for truth in part) for cause in found]
    return all(met) and all(true)


def judge_named_causes(named: Sequence[Mapping[str, Any]], fault: Fault) -> Outcome:
    """Return the outcome of an answer that names something: alone, in a set, in a set too wide, half right, wrong."""
    worth = [judge_answer(one, fault) for one in named]
    if "right" in worth:
        if len(named) > LARGEST:
            return "wide"
        return "right" if len(named) == 1 else "in set"
    if len(named) > LARGEST:
        return "wide" if "near" in worth else "wrong"
    return "near" if worth and worth[0] == "near" else "wrong"


def judge_fault(
    named: Sequence[Mapping[str, Any]], fault: Fault, effect: Literal["above", "between", "below"], alarm: bool
) -> Outcome:
    """Return the outcome of one fault.

    effect : of the fault, against the error bars; alarm : whether the run ended with a deviation or a failed certificate
    """
    if named:
        return judge_named_causes(named, fault)
    if effect == "above":
        return "unknown" if alarm else "accepted"
    return "unknown" if alarm and effect == "between" else "silent"


def is_new(row: Mapping[str, Any]) -> bool:
    """Return True if a mistake, or one of two at once, is of no kind in the dictionary of the day."""
    return any(not OLD & {k for truth in part for k in truth["kinds"]} for part in row.get("right", ()))


def compute_shares(outcomes: Iterable[tuple[Outcome, str]]) -> dict[str, Any]:
    """Return the number of faults by outcome, and the share of those above the bars named right or in a set [-].

    outcomes : of every fault, with its effect against the bars
    """
    known = list(outcomes)
    counts: dict[str, int] = {}
    for result, _ in known:
        counts[result] = counts.get(result, 0) + 1
    above = [result for result, effect in known if effect == "above" and result not in ("refused", "failed")]
    good = sum(result in GOOD for result in above)
    return {
        "faults": len(known),
        "counts": counts,
        "above": len(above),
        "good": good,
        "share": good / len(above) if above else 0.0,
        "bad": sum(counts.get(result, 0) for result in BAD),
    }
