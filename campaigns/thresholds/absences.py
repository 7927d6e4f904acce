"""Absences of thresholds: the value of each with which its check is off, and holds nothing back or lets nothing more pass.

Where a number is no check but a length, a resolution or a count of steps, there is no such value, and `WITHOUT_ABSENCE` says why.
"""

from __future__ import annotations

from typing import Any

import numpy as np

ANY = np.inf  # a bound that nothing reaches
ALL = 10**6  # more than there are
FAR = 1e12  # times a number that may be zero: of that it is zero still
# By module: the value of each threshold with which its check is off.
ABSENT: dict[str, dict[str, Any]] = {
    "crosscheck.causes.naming": {
        "UNEXPLAINED": FAR,  # a cause may leave whatever it leaves
        "SIMILAR": 0.0,  # none stands beside the best one, but for bars
        "ROUNDED": 0.0,  # no floor of rounding
        "HALF": ANY,  # bars may be all of a difference
        "MARCHED": 0.0,  # no floor of a march's steps
        "NOTHING": 0.0,  # an engine that gives nothing is asked about
        "MOST": ALL,  # all names are printed
        "TOLD": ALL,  # all causes are held against all else
    },
    "crosscheck.causes.model": {"ROUGH_ERROR": 0.0},
    "crosscheck.causes.fit": {
        "LARGEST": ANY,  # fits go as far as they go
        "PROPORTIONAL": 0.0,  # none goes farther than others
        "HALVINGS": 1,  # a step is taken or not
        "SMALL": 0.0,  # all sizes move
        "TINY": 0.0,  # a quarter of the linear size is tried, too
        "HOPELESS": ANY,  # all are refined
        "HALF_GAIN": ANY,  # a step that gains anything is taken
    },
    "crosscheck.causes.evidence": {
        "AGREES": FAR,  # sizes are as sure as the fit
        "SURE_PART": 0.0,  # no floor of differences
        "LIMITS": FAR,  # no line of a certificate contradicts
    },
    "crosscheck.causes.pairs": {
        "NUMBERS": ALL,  # all pairs are tried
        "LINEAR": ANY,  # whatever they leave in a linear look
        "DEPENDENT": 0.0,  # columns count as independent
    },
    "crosscheck.causes.quantities": {
        "SURE_TIMES": FAR,  # no other quantity contradicts
        "MARCHED": 0.0,  # no floor of a march's steps
    },
    "crosscheck.causes.quantity_causes": {"DISTANT": ANY},  # whatever a linear look leaves
    "crosscheck.causes.single_samples": {
        "FEWEST": 1,  # however few samples there are
        "FEW": 1.0,  # however many stand out
        "GAP": 0.0,  # however little
    },
    "crosscheck.identification.causes.name_causes": {
        "EVIDENCE": 0.0,  # the chance decides alone
        "CHANCE": 1.0,  # the evidence decides alone
        "ASKED": 0.0,  # all causes are followed up
        "ALIKE": 0.0,  # the largest drop is named
        "QUIET": 0.0,  # rare causes are asked for everywhere
        "LARGEST": ALL,  # as many causes are named as have evidence
        "TOGETHER": ALL,
        "REACH": ANY,  # places are looked for everywhere
        "PART": 0.0,  # a further cause may explain however little
        "REMAINDER": 0.0,
        "SURE": 0.0,  # sizes may be within their errors
    },
    "crosscheck.identification.causes.rounds": {
        "NOISE": ANY,  # whatever is left of a channel, causes are named
        "SEEN": 0.0,  # of each channel causes have to explain enough
        "MOST": 0.0,  # causes have to explain nothing
    },
    "crosscheck.identification.causes.signals": {
        "REACH": 0.0,  # a clipped sample spoils no other
        "HELD": 1,  # any two equal samples are held ones
        "QUIET": 0.0,  # a spike stands out from the steps beside it alone
        "EXACT": ANY,  # its values need not be multiples
        "LEAP": 0.0,  # held samples need no leap
        "AMONG_SMALLEST": 0.0,  # a sign and a dead band are not looked at
    },
    "crosscheck.identification.causes.dictionary": {
        "LATEST": ANY,
        "LARGEST_SCALE": ANY,
        "LARGEST_GAIN": ANY,
        "LARGEST_ANGLE": ANY,
        "STIFFER": ANY,
        "HEAVIER": ANY,
        "LITTLE": FAR,  # less than nothing may be there, of what there is
    },
    "crosscheck.identification.causes.gear_faults": {
        "LARGEST_PLAY": ANY,
        "LARGEST_PART": ANY,
        "FEWEST": 0.0,  # ripples of however few periods
    },
}
STEPS = "steps"
FINENESS = "fineness"
WIDTH = "width"
TWO_WAYS = "two ways"
FACTOR = "factor"
REASONS = {
    STEPS: "so many steps or tries: none is no search, and all of them take too long",
    FINENESS: "how finely is computed",
    WIDTH: "a width or a length of what is looked at: none is no look",
    TWO_WAYS: "it lets pass in one place and holds back in another",
    FACTOR: "a factor of error bars: absent it is 1, which is its half",
}
# Why the others have no absence: a word of `REASONS`, by module and name.
WITHOUT_ABSENCE: dict[str, dict[str, str]] = {
    "crosscheck.causes.naming": {
        "NOISE": FACTOR,
        "SHORTLIST": STEPS,
        "SCANNED": STEPS,
        "DEEPER": STEPS,
        "ROUNDS": STEPS,
    },
    "crosscheck.causes.model": {"FEWEST": FINENESS, "STEPS": FINENESS, "ROUGH_STEPS": FINENESS},
    "crosscheck.causes.evidence": {"ROUNDS": STEPS},
    "crosscheck.causes.pairs": {"TRIED": STEPS, "ROUNDS": STEPS, "FIRST": STEPS, "NEXT": STEPS},
    "crosscheck.causes.quantities": {"ROUNDS": STEPS},
    "crosscheck.causes.quantity_causes": {"REFINED": STEPS},
    "crosscheck.causes.repair": {"ROUNDS": STEPS},
    "crosscheck.identification.causes.name_causes": {
        "FOLLOWED": STEPS,
        "NEAREST": STEPS,
        "LITTLE": TWO_WAYS,
    },
    "crosscheck.identification.causes.rounds": {"ROUNDS": STEPS},
    "crosscheck.identification.causes.signals": {"BESIDE": WIDTH, "HALF": TWO_WAYS},
    "crosscheck.identification.causes.gear_faults": {"PASSED": WIDTH},
}


def find_absent_value(module: str, name: str) -> Any:
    """Return the value of a threshold [its own unit] with which its check is off; None where there is none."""
    return ABSENT.get(module, {}).get(name)
