"""Bisect known changes, hold the answers against what is known, and print a table: environments, processor time, disk."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time as clock
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from crosscheck.bisect.search import count_halvings

HERE = Path(__file__).parent
FOUND = 0  # exit codes of the command
ALIKE = 1
REFUSED = 2


@dataclass(frozen=True)
class Known:
    """A change that is known: words of the command, its exit code, and what the answer has to say.

    changes : releases before and after each; says : words of the answer or of the refusal
    """

    name: str
    words: tuple[str, ...]
    changes: tuple[tuple[str, str], ...] = ()
    says: str = ""
    code: int = FOUND


MUJOCO = ("--package", "mujoco", "3.3.7..4.0.0")
NUMBER = ("--number", "height")

KNOWN = (
    Known("mujoco#2982, a fused link", (*MUJOCO, "--", "fuse_static.py"), (("3.10.0", "3.11.0"),)),
    Known(
        "the same by its distance, every change",
        (*MUJOCO, "--number", "distance", "--absolute", "1e-12", "--all", "--", "fuse_static.py"),
        (("3.5.0", "3.6.0"), ("3.10.0", "3.11.0")),
    ),
    Known("mujoco#3559, a turned tensor", (*MUJOCO, "--", "urdf_inertia.py"), (("3.13.0", "3.14.0"),)),
    Known("`<composite>`", (*MUJOCO, *NUMBER, "--", "cable.py"), says="cannot run from 4.0.0 on"),
    Known(
        "integrator `discrete`",
        (*MUJOCO, "--number", "angle", "--", "discrete.py"),
        says="cannot run up to 3.12.0 (3.13.0 is the first that runs)",
    ),
    Known("a script without a seed", (*MUJOCO, *NUMBER, "--", "flaky.py"), says="scatters by", code=REFUSED),
    Known(
        "click, a pure Python package",
        ("--package", "click", "8.0.0..", "--number", "exit", "--", "no_arguments.py"),
        (("8.1.8", "8.2.0"),),
    ),
    Known(
        "pin, a rotor's inertia, with holes",
        ("--package", "pin", "2.6.19..", "--number", "torque", "--", "armature.py"),
        (("2.7.0", "3.3.1"),),
    ),
    Known(
        "exudyn, a body that spins",
        ("--package", "exudyn", "..", "--number", "turn", "--", "spinning_body.py"),
        (("1.10.0", "1.11.0"),),
    ),
    Known(
        "keywords of MjSpec",
        ("--package", "mujoco", "..", "--number", "mass", "--", "spec.py"),
        says="cannot run up to 3.2.2 (3.2.3 is the first that runs)",
    ),
    Known(
        "a fall upon a box, twenty releases",
        ("--package", "mujoco", "3.3.4..4.0.0", *NUMBER, "--tolerance", "1e-3", "--", "fall.py"),
        (("3.3.7", "3.4.0"),),
    ),
)  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """What came out: whether it is right, and what it took [s], [GB]."""

    right: bool
    words: str
    environments: int
    bound: int
    processor: float
    wall: float
    disk: float


def run_known(known: Known, place: Path, store: Path, extra: Sequence[str]) -> Outcome:
    """Bisect one known change.  place : folder of its answer."""
    words = [str(HERE / word) if word.endswith(".py") else word for word in known.words]
    first = words.index("--")
    options = ["--out", str(place), "--environments", str(store), *extra]
    command = [sys.executable, "-m", "crosscheck", "bisect", *words[:first], *options, *words[first:]]
    begun = clock.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    wall = clock.perf_counter() - begun
    file = place / "answer.json"
    if done.returncode == REFUSED or not file.is_file():
        last = (done.stderr.strip().splitlines() or [""])[-1]
        return Outcome(done.returncode == known.code and known.says in last, last, 0, 0, 0.0, wall, 0.0)
    answer = json.loads(file.read_text(encoding="utf-8"))
    found = tuple((change["before"], change["after"]) for change in answer["changes"])
    told = "; ".join(answer["words"])
    right = done.returncode == known.code and known.says in told and (not known.changes or found == known.changes)
    costs = answer["costs"]
    right = right and costs["environments"] <= costs["bound"] + (
        0 if known.changes else count_halvings(costs["releases"])
    )
    return Outcome(right, told, costs["environments"], costs["bound"], costs["processor"], wall, costs["disk"])


def list_rows(outcomes: Sequence[tuple[Known, Outcome]]) -> Iterator[str]:
    """Yield the table of the outcomes, for a page."""
    yield "| change | right | environments (bound) | processor s | wall s | disk GB | answer |"
    yield "|---|---|--:|--:|--:|--:|---|"
    for known, one in outcomes:
        sign = "yes" if one.right else "**no**"
        yield (
            f"| {known.name} | {sign} | {one.environments} ({one.bound}) | {one.processor:.0f} | {one.wall:.0f} | {one.disk:.2f} "
            f"| {one.words.replace('|', '/')[:300]} |"
        )


def main() -> int:
    """Run all, or those whose names hold a word; return 1 where one is wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="Words of the names of those that are run.")
    parser.add_argument(
        "--environments", type=Path, help="Folder of the environments, kept; without it a temporary one."
    )
    parser.add_argument("--installer", default="auto")
    options = parser.parse_args()
    chosen = [known for known in KNOWN if not options.names or any(word in known.name for word in options.names)]
    outcomes = []
    with tempfile.TemporaryDirectory(prefix="bisect-") as place:
        store = options.environments or Path(place) / "environments"
        for k, known in enumerate(chosen):
            outcomes.append((known, run_known(known, Path(place) / str(k), store, ["--installer", options.installer])))
            sys.stderr.write(f"{known.name}: {outcomes[-1][1]}\n")
    sys.stdout.write("\n".join(list_rows(outcomes)) + "\n")
    return int(not all(one.right for _, one in outcomes))


if __name__ == "__main__":
    sys.exit(main())
