"""Campaign: one robot told twice is the same machine, and a fault that is told beside is named alone.

300 pairs of 60 machines by changes that change nothing (`retelling`), one to six at once; 100 of them again with a fault on top.
That a pair really is one machine is checked by `pin.rnea` and `mj_inverse` on what was written, not by this project.

python campaigns/same_robot.py                       # all; prints counts, and each failure with how to repeat it
python campaigns/same_robot.py --only 17             # one pair again, with all that is said of it
python campaigns/same_robot.py --faults --only 17    # one fault again
python campaigns/same_robot.py --seed 2026           # all with other random trees, changes and faults
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from efforts_agree import WrittenMachine, disagreement
from faults import Fault, fits, plant
from machines import ROOT, machine, names_of_machines
from retelling import CHANGES, RewrittenMechanism, told_first, turn_base, turn_world

from crosscheck.engines.mujoco.export import build_mjcf
from crosscheck.engines.shared.export_files import NotExported
from crosscheck.engines.shared.urdf_text import write_urdf
from crosscheck.equivalence.compare import compare
from crosscheck.equivalence.result import REPAIRED, Comparison
from flexinv.errors import InputError
from flexinv.model.mechanism import Mechanism

SEED = 34
PAIRS, FAULTS, MOST = 300, 100, 6
AGREE = 1e-9  # of the largest effort: what two engines' rounding leaves of two files of one machine
FORMATS = ("urdf", "mjcf", "memory")
REFUSED = "the engines that judge refuse this pair"


@dataclass(frozen=True)
class Pair:
    """One machine told twice: number, its name, the changes, and what was written; fault : on top, in the second."""

    number: int
    name: str
    changes: tuple[str, ...]
    first: WrittenMachine
    second: WrittenMachine
    fault: Fault | None = None

    @property
    def words(self) -> str:
        """Return the pair in a line."""
        forms = f"{self.first.form} and {self.second.form}"
        return f"{self.number}: {self.name}, {forms}: {', '.join(self.changes) or 'formats'}"


@dataclass(frozen=True)
class Outcome:
    """What came of a pair: named are the differences that are no conventions; asked : the joints had to be told."""

    pair: Pair
    comparison: Comparison | None
    words: str = ""
    apart: float = 0.0
    asked: bool = False
    named: list[str] = field(default_factory=list)

    @property
    def same(self) -> bool:
        """Return True where nothing but conventions is named, and efforts agree."""
        return (
            self.comparison is not None and not self.named and self.comparison.judged.after <= self.comparison.tolerance
        )

    @property
    def refused(self) -> bool:
        """Return True where the engines that judge do not take the pair."""
        return self.words.startswith(REFUSED)

    @property
    def told(self) -> bool:
        """Return True where the fault that was planted is named."""
        assert self.pair.fault is not None
        return self.comparison is not None and any(fits(self.pair.fault, d) for d in self.comparison.differences)

    @property
    def false(self) -> list[str]:
        """Return what is named beside the fault."""
        assert self.pair.fault is not None
        if self.comparison is None:
            return []
        return [
            d.words for d in self.comparison.differences if d.family != "convention" and not fits(self.pair.fault, d)
        ]


def pair_of(number: int, folder: Path, faulty: bool = False, seed: int = SEED) -> Pair | None:
    """Return a pair by its number, written into a folder; None where a fault cannot be planted or a robot is not there."""
    dice = np.random.default_rng([seed, number, int(faulty)])
    names = names_of_machines()
    name = names[number % len(names)]
    first = told_first(_plain(machine(name, seed)))
    forms = [form for form in FORMATS if _sayable(first.mechanism, form)]
    count = int(dice.integers(1, MOST + 1))
    chosen = [str(c) for c in dice.choice([*CHANGES, "formats"], count, replace=False)]
    own = str(dice.choice(forms))
    fault, second = None, first
    if faulty:
        planted = plant(first.mechanism, dice)
        if planted is None:
            return None
        mechanism, fault = planted
        second = replace(first, mechanism=mechanism)
    made = []
    # A URDF does not say what pulls it: under gravity that is turned it is another machine.
    told_of_gravity = own != "urdf"
    for change, ways in CHANGES.items():
        if change in chosen:
            way = ways[int(dice.integers(len(ways)))]
            if way is turn_world and not told_of_gravity:
                way = turn_base
            second = way(second, dice)
            made.append(change if len(ways) == 1 else way.__name__.replace("_", " "))
    other = own
    if "formats" in chosen or not _sayable(second.mechanism, own):
        others = [form for form in FORMATS if form != own and _sayable(second.mechanism, form)]
        other = str(dice.choice(others)) if others else own
    if not _sayable(second.mechanism, other):
        return None
    both = _written(first, own, folder, "a"), _written(second, other, folder, "b")
    return Pair(number, name, tuple(made), *both, fault)


def _plain(mechanism: Mechanism) -> Mechanism:
    """Two files of one folder: what is not said in one of the formats is left out of both."""
    joints = tuple(replace(j, weight=1.0, drive=None) for j in mechanism.joints)
    return replace(mechanism, joints=joints)


def _sayable(mechanism: Mechanism, form: str) -> bool:
    if form == "memory":
        return True
    if form == "urdf":
        kinds = {joint.kind for joint in mechanism.joints}
        springs = any(joint.stiffness for joint in mechanism.joints)
        upright = np.array_equal(mechanism.gravity, [0.0, 0.0, -9.81])
        return not kinds & {"spherical", "helical"} and not springs and upright
    try:
        return not build_mjcf(mechanism)[0].floored
    except NotExported:
        return False


def _written(rewritten: RewrittenMechanism, form: str, folder: Path, name: str) -> WrittenMachine:
    if form == "memory":
        return WrittenMachine(rewritten, form)
    path = folder / f"{name}.{'urdf' if form == 'urdf' else 'xml'}"
    path.write_text(write_urdf(rewritten.mechanism) if form == "urdf" else build_mjcf(rewritten.mechanism)[1])
    return WrittenMachine(rewritten, form, path)


def tried(pair: Pair) -> Outcome:
    """Compare a pair, with the joints told where names and structure leave them open."""
    apart = 0.0
    if pair.fault is None:
        try:
            apart = disagreement(pair.first, pair.second, pair.number)
        except Exception as error:  # what an engine that judges raises is its word; the pair counts as refused
            return Outcome(pair, None, f"{REFUSED}: {' '.join(str(error).split())[:300]}")
        if apart > AGREE:
            return Outcome(pair, None, f"this is no pair: its engines differ by {apart:.1e}", apart)
    asked = False
    sides = [written.path or written.rewritten.mechanism for written in (pair.first, pair.second)]
    for match in (None, _counterparts(pair)):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                comparison = compare(*sides, match=match)
            named = [d.words for d in comparison.differences if d.family != "convention"]
            return Outcome(pair, comparison, comparison.sentence, apart, asked, named)
        except InputError as error:
            if "--match" not in str(error) or match is not None:
                return Outcome(pair, None, " ".join(str(error).split())[:300], apart, asked)
            asked = True
        except Exception as error:  # a fault of the comparison, which counts as a miss and stops nothing
            return Outcome(pair, None, f"compare raises {type(error).__name__}: {error}", apart, asked)
    raise AssertionError("unreachable")


def _counterparts(pair: Pair) -> dict[str, str]:
    """By joint of the first the joint of the second that it is."""
    result = {}
    for name, count in pair.second.rewritten.joints.items():
        kind = pair.first.rewritten.mechanism.joint_of[name].kind
        ends = (".1", ".2") if kind == "universal" else ("",)
        if name != ROOT and kind != "free":
            result |= {name + end: count.name + end for end in ends}
    return result


def outcomes(numbers: Iterable[int], faulty: bool = False, seed: int = SEED) -> Iterator[Outcome]:
    """Yield what comes of pairs by their numbers; those of robots that are not installed are left out."""
    for number in numbers:
        with tempfile.TemporaryDirectory() as folder:
            try:
                pair = pair_of(number, Path(folder), faulty, seed)
            except FileNotFoundError:
                continue
            if pair is not None:
                yield tried(pair)


def faults(count: int, seed: int = SEED) -> Iterator[Outcome]:
    """Yield the first pairs in which a fault can be planted."""
    made = 0
    for number in range(10 * count):
        for one in outcomes([number], True, seed):
            made += 1
            yield one
        if made == count:
            return


def say(*words: object) -> None:
    """Write a line."""
    sys.stdout.write(" ".join(map(str, words)) + "\n")
    sys.stdout.flush()


def followed(outcomes: Iterable[Outcome]) -> Iterator[Outcome]:
    """Yield outcomes, with a line on the error output for each as it comes."""
    for one in outcomes:
        right = one.same if one.pair.fault is None else one.told and not one.false
        sys.stderr.write(f"{time.strftime('%H:%M:%S')} {'ok' if right else 'MISS'} {one.pair.words}\n")
        sys.stderr.flush()
        yield one


def _say_pair(one: Outcome, whole: bool) -> None:
    say(one.pair.words, "|", "" if one.pair.fault is None else one.pair.fault.words, "|", one.words)
    for words in one.named if one.pair.fault is None else one.false:
        say("    named:", words)
    if whole and one.comparison is not None:
        for group in ("causes", "conventions", "limits", "rounding", "unseen"):
            for d in getattr(one.comparison.judged, group):
                say(f"    {group}: {d.words}")
        say(
            f"    engines differ by {one.apart:.1e}; repaired to {one.comparison.judged.after:.1e}; {one.comparison.matched}"
        )


def main() -> None:
    """Run the campaign, or one pair of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--faults", action="store_true", help="only pairs with a fault on top")
    parser.add_argument("--same", action="store_true", help="only pairs without one")
    parser.add_argument(
        "--only", type=int, nargs="+", metavar="NUMBER", help="these pairs alone, with all that is said"
    )
    parser.add_argument("--pairs", type=int, default=PAIRS)
    parser.add_argument("--seed", type=int, default=SEED, help="of random trees, changes and faults")
    given = parser.parse_args()
    seed = given.seed
    whole = bool(given.only)
    begun = time.perf_counter()
    if not given.faults:
        _say_pairs(outcomes(given.only or range(given.pairs), False, seed), whole, seed)
    if not given.same:
        _say_faults(outcomes(given.only, True, seed) if whole else faults(FAULTS, seed), whole, seed)
    say(f"{time.perf_counter() - begun:.0f} s")


def _say_pairs(outcomes: Iterable[Outcome], whole: bool, seed: int) -> None:
    every = []
    for one in followed(outcomes):
        every.append(one)
        if whole or not one.same:
            _say_pair(one, whole)
            say(f"    again: python campaigns/same_robot.py --seed {seed} --same --only {one.pair.number}")
    asked = sum(one.asked for one in every)
    say(f"the same machine: {sum(one.same for one in every)} of {len(every)}, joints asked for in {asked}")
    say(f"  refused by the engines that judge: {sum(one.refused for one in every)}")
    repaired = sum(one.comparison is not None and one.comparison.judged.after <= REPAIRED for one in every)
    say(f"  efforts agree to {REPAIRED:g} of their range: {repaired}")
    counted = Counter(change for one in every for change in one.pair.changes)
    say("  changes:", ", ".join(f"{count} x {change}" for change, count in counted.items()))


def _say_faults(outcomes: Iterable[Outcome], whole: bool, seed: int) -> None:
    every = []
    for one in followed(outcomes):
        every.append(one)
        if whole or not one.told or one.false:
            _say_pair(one, whole)
            say(f"    again: python campaigns/same_robot.py --seed {seed} --faults --only {one.pair.number}")
    beside = sum(bool(one.false) for one in every)
    say(f"faults named: {sum(one.told for one in every)} of {len(every)}; with another name beside: {beside}")
    kinds = Counter((one.pair.fault.kind if one.pair.fault else "", one.told) for one in every)
    for kind in sorted({k for k, _ in kinds}):
        say(f"  {kind}: {kinds[kind, True]} named, {kinds[kind, False]} not")


if __name__ == "__main__":
    main()
