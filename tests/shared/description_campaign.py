"""Campaign: faults planted in descriptions by `description_faults`, and what `crosscheck compare` names.

python tests/shared/description_campaign.py --count 200 --seed 1
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from description_faults import Fault, Unfit, plant

from crosscheck.equivalence.compare import compare
from crosscheck.equivalence.difference import Difference
from crosscheck.equivalence.result import Comparison
from flexinv.errors import InputError
from flexinv.files.urdf_table import robots_folder

SIZE = 0.02  # relative: how well a size has to be told
ROBOTS = (
    "panda_description/urdf/panda.urdf", "ur_description/urdf/ur5_robot.urdf", "talos_data/robots/talos_arm.urdf",
    "kinova_description/robots/kinova.urdf", "iiwa_description/urdf/iiwa14.urdf", "solo_description/robots/solo12.urdf",
    "anymal_c_simple_description/urdf/anymal.urdf", "tiago_description/robots/tiago.urdf", "talos_data/robots/talos_full_v2.urdf",
    "hyq_description/robots/hyq_no_sensors.urdf",
)  # fmt: skip


@dataclass(frozen=True)
class Trial:
    """One planted file: the faults, and of them those that were named first, of the right size; others: named for nothing."""

    robot: str
    faults: list[Fault]
    named: list[bool]
    others: list[str]
    words: str = ""

    @property
    def good(self) -> bool:
        return all(self.named)


def fits(fault: Fault, found: Difference) -> bool:
    """Return True if a difference names the fault: quantity, element, size."""
    places = {fault.element, *fault.also}
    words = set(found.place.replace(",", " ").split())
    same = found.cause == fault.quantity or found.cause in fault.also
    return same and bool(places & words) and abs(found.size - fault.size) <= SIZE * fault.size + 1e-12


def tried(file: Path, original: Path, faults: list[Fault]) -> Trial:
    """Compare an original with its faulty copy."""
    try:
        found = compare(original, file)
    except InputError as error:
        return Trial(original.name, faults, [False] * len(faults), [], str(error))
    return judged(original.name, found, faults)


def judged(robot: str, found: Comparison, faults: list[Fault]) -> Trial:
    """Return which faults are among the first differences named, and what else is named."""
    every = [*found.judged.causes, *found.judged.conventions, *found.judged.limits]
    unseen = [*found.judged.unseen]
    first = [*every[: len(faults)], *([] if len(every) >= len(faults) else unseen)]
    named = [any(fits(fault, d) for d in first) for fault in faults]
    others = [d.words for d in every if not any(fits(fault, d) for fault in faults)]
    return Trial(robot, faults, named, others, found.sentence)


def campaign(count: int, seed: int, at_once: int = 1, robots: tuple[str, ...] = ROBOTS) -> Iterator[Trial]:
    """Yield trials of faults in URDFs, drawn from a seed."""
    made = draw = 0
    with tempfile.TemporaryDirectory() as folder:
        while made < count:
            draw += 1
            original = robots_folder() / robots[draw % len(robots)]
            try:
                text, faults = plant(original.read_text(), seed * 100000 + draw, at_once)
            except (Unfit, FileNotFoundError):
                continue
            file = Path(folder) / original.name
            file.write_text(text)
            made += 1
            yield tried(file, original, faults)


def say(*words: object) -> None:
    sys.stdout.write(" ".join(map(str, words)) + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--at-once", type=int, default=1)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    trials, kinds = [], Counter[tuple[str, bool]]()
    for trial in campaign(given.count, given.seed, given.at_once):
        trials.append(trial)
        for fault, named in zip(trial.faults, trial.named, strict=True):
            kinds[fault.kind, named] += 1
        if not trial.good or trial.others:
            say(trial.robot, [vars(f) for f in trial.faults], trial.named, trial.others[:4], trial.words[:200])
    good, false = sum(t.good for t in trials), sum(bool(t.others) for t in trials)
    say(f"named first with their sizes: {good} of {len(trials)}; with a false name beside: {false}")
    for kind in sorted({k for k, _ in kinds}):
        say(f"  {kind}: {kinds[kind, True]} named, {kinds[kind, False]} not")
    if given.out:
        rows = [
            {"robot": t.robot, "faults": [vars(f) for f in t.faults], "named": t.named, "others": t.others}
            for t in trials
        ]
        given.out.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
