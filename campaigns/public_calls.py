"""Random calls of the public interface: an answer is that of the clean call, and a refusal says why.

    python campaigns/public_calls.py                      # 3,000 calls with seed 1; some minutes
    python campaigns/public_calls.py --calls 200 --seed 7
    python campaigns/public_calls.py --only 412           # one of them, with what was raised

Each call takes an entrance (`public_entrances`) and puts one or two of its arguments into another dress (`dresses`).  What is
expected is computed by its clean twin, the same call with plain floats, so that no answers have to be kept.  A call is

    right       accepted, and its result is that of the clean twin, bit for bit
    refused     a FlexinvError with words, or a TypeError of Python's own signature
    raw         another exception
    nonsense    accepted although it means nothing, or with another result than its clean twin
    lost        refused although all that was given has to be taken, and the clean twin is

The command ends with 1 where one is raw, nonsense or lost.
"""

from __future__ import annotations

import sys
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from campaigns.dresses import KINDS, NOTHING, ArgumentForm
from campaigns.public_entrances import Entrance, entrances
from flexinv.errors import FlexinvError
from flexinv.model.by_value import is_same

SHORTEST = 20  # letters of a refusal that says something
UNKNOWN_ARGUMENT = 0.02  # part of the calls that have an argument too many
TWO = 0.25  # part of the calls with two dressed arguments


@dataclass(frozen=True)
class Trial:
    """One call: an entrance, its arguments, those of its clean twin (None: there is none), and whether it has to be taken."""

    number: int
    entrance: Entrance
    arguments: dict[str, Any]
    clean: dict[str, Any] | None
    taken: bool
    words: str


@dataclass(frozen=True)
class Outcome:
    """What became of a call: a word of the head of this file, and what was said."""

    word: str
    said: str = ""


def trial(number: int, seed: int) -> Trial:
    """Return a call by its number [-] and the seed of all."""
    random = np.random.default_rng([seed, number])
    known = entrances()
    weights = np.array([one.weight for one in known])
    entrance = known[int(random.choice(len(known), p=weights / weights.sum()))]
    given, clean, words, taken = entrance.clean, entrance.clean, list[str](), True
    meant = True
    if random.random() < UNKNOWN_ARGUMENT:
        return Trial(number, entrance, {**given, "wrong_argument": 1}, None, False, "an argument too many")
    names = list(entrance.slots)
    count = min(len(names), 2 if random.random() < TWO else 1)
    for name in random.choice(names, count, replace=False):
        slot = entrance.slots[name]
        dresses = [dress for dress in KINDS[slot.kind] if dress.name not in slot.may]
        dress: ArgumentForm = dresses[int(random.integers(len(dresses)))]
        given[name], own = dress.make(slot.value, random)
        meant = meant and own is not NOTHING
        taken = taken and dress.taken
        clean[name] = own
        words.append(f"{name}: {dress.name}")
    return Trial(number, entrance, given, clean if meant else None, taken, ", ".join(words))


def judged(one: Trial) -> Outcome:
    """Return what becomes of a call and of its clean twin."""
    result, error = attempt(one.entrance.call, one.arguments)
    if error is None:
        if one.clean is None:
            return Outcome("nonsense", f"accepted: {result!r:.200}")
        expected, own = attempt(one.entrance.call, one.clean)
        if own is not None:
            return Outcome("nonsense", f"accepted, and the clean twin is refused: {own}")
        return (
            Outcome("right")
            if is_same(result, expected)
            else Outcome("nonsense", f"{result!r:.150} is not {expected!r:.150}")
        )
    if not isinstance(error, FlexinvError):
        own_signature = isinstance(error, TypeError) and "wrong_argument" in one.arguments
        return Outcome("refused", str(error)) if own_signature else Outcome("raw", f"{type(error).__name__}: {error}")
    if len(str(error)) < SHORTEST:
        return Outcome("raw", f"no words: {error}")
    if one.taken and one.clean is not None and attempt(one.entrance.call, one.clean)[1] is None:
        return Outcome("lost", str(error))
    return Outcome("refused", str(error))


def attempt(call: Callable[..., Any], given: dict[str, Any]) -> tuple[Any, Exception | None]:
    """Return what a call gives [any unit], or what it raises."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return call(**given), None
        except Exception as error:
            return None, error


def run(calls: int, seed: int, first: int = 0) -> Iterator[tuple[Trial, Outcome]]:
    """Yield the calls [-] and what becomes of them."""
    for number in range(first, first + calls):
        one = trial(number, seed)
        yield one, judged(one)


@click.command(help=__doc__.split("\n\n")[0])
@click.option("--calls", default=3000, show_default=True, help="Number of calls.")
@click.option("--seed", default=1, show_default=True, help="Seed of all.")
@click.option("--only", type=int, help="Make one call by its number, and show what it raises.")
def main(calls: int, seed: int, only: int | None) -> None:
    """Run the campaign and print a table."""
    if only is not None:
        one = trial(only, seed)
        click.echo(f"{one.entrance.name}({one.words}): {judged(one)}")
        error = attempt(one.entrance.call, one.arguments)[1]
        if error is not None:
            click.echo("".join(traceback.format_exception(error)))
        return
    tally, wrong = Counter[str](), 0
    for one, outcome in run(calls, seed):
        tally[outcome.word] += 1
        if outcome.word in ("raw", "nonsense", "lost"):
            wrong += 1
            click.echo(f"{one.number:5d} {outcome.word:9s} {one.entrance.name}({one.words}): {outcome.said:.300}")
    click.echo(", ".join(f"{count} {word}" for word, count in sorted(tally.items())) + f" of {calls} calls")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
