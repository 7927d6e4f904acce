"""Exported C libraries against Python, bit by bit: every mechanism of the gallery, and random ones, at their motions.

    python campaigns/exported.py                        # all of them; some minutes
    python campaigns/exported.py --only ur5 --random 0
    python campaigns/exported.py --random 5 --seed 7

Each library is linked with a program in C, which runs as a process of its own.  What it answers is held against
`TorqueFunction.sample` of rigid mechanisms and the steps of `Controller`: the same machine code on the same numbers, so that not
one bit may differ.  What the objects need of the system is looked up (`nm -u`).  Mechanisms that are not exported stand in
EXCEPTIONS, with the words of their refusal; the command ends with 1 where another one is refused, or where anything differs.
Random mechanisms are drawn until so many were compared; what Python's single steps refuse, or the library, is shown.
"""

from __future__ import annotations

import itertools
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import click
import numpy as np

if __name__ == "__main__":
    ROOT = Path(__file__).resolve().parents[1]
    sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "shared")]

import flexinv
from crosscheck.engines.flexinv_c.adapter import plan_case, unsupported
from crosscheck.engines.flexinv_c.program import LibrarySettings, Question, make_linked_program
from flexinv.errors import FlexinvError, InputError
from flexinv.export.acting_sets import list_acting_sets
from flexinv.export.machine_code import NEEDED
from flexinv.files.load_cases import Case, load_cases
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

MODELS = Path(__file__).resolve().parents[1] / "models"
# Folder of models/ -> how its refusal reads: closures that act for a while beside beams, which
# no single step in Python takes either.
EXCEPTIONS = {
    "two_arms_flexible": "closures that act for a while",
}
MOST_CALLS = 1000  # of one case
MARCHED = 1e-9  # of the largest effort: the march of `solve` is the same, the sums behind it stand in another order


@dataclass(frozen=True)
class Outcome:
    """What became of one case: calls, largest difference over the range [-], and in words what is wrong, "" where nothing is."""

    name: str
    calls: int
    difference: float
    wrong: str


# Compares a mechanism by its name, itself and its cases.
Comparison = Callable[[str, Mechanism, dict[str, Case]], Iterable[Outcome]]


def compare_case(mechanism: Mechanism, case: Case, folder: Path) -> Outcome:
    """Return what a library answers at one case [N m], [N], held against Python; folder : into which it is exported."""
    name = f"{mechanism.name}/{case.name}"
    mechanism = case.meshed(mechanism)
    plan = plan_case(mechanism, case)
    made = flexinv.export_c(mechanism, folder, **asdict(plan.settings))
    missing = list_missing(folder)
    if missing:
        return Outcome(name, 0, np.inf, f"its objects need {', '.join(missing)}")
    questions = plan.questions[:MOST_CALLS]
    answers = np.array(make_linked_program(mechanism, folder, made.name).ask(questions))
    if any(
        len(force.time) > 1 for force in mechanism.forces
    ):  # which no controller in Python is given from call to call
        return compare_with_solve(name, mechanism, case, questions, answers)
    expected = (
        compute_rigid(mechanism, questions) if mechanism.is_rigid else march(mechanism, case, questions, plan.settings)
    )
    apart = float(np.abs(answers - expected).max()) / (float(np.abs(expected).max()) or 1.0)
    return Outcome(name, len(questions), apart, "" if apart == 0.0 else "not the same bits")


def compare_with_solve(
    name: str, mechanism: Mechanism, case: Case, questions: list[Question], answers: Array
) -> Outcome:
    """Return what became of a case whose forces depend on time [N m], [N]: its steps beside those of `solve`.

    Raises InputError for a case that single steps do not make, whose accelerations jump.
    """
    if (reason := unsupported(mechanism, case, "flexinv-c")) is not None:
        raise InputError(reason)
    s = flexinv.solve(
        mechanism, case.motion, case.step, end=case.end, spectral_radius=case.spectral_radius, initial=case.initial,
        start=case.start,
    )  # fmt: skip
    expected = s.torque_all[: len(questions)]
    apart = float(np.abs(answers - expected).max()) / (float(np.abs(expected).max()) or 1.0)
    return Outcome(name, len(questions), apart, "" if apart <= MARCHED else f"more than {MARCHED:g}")


def list_missing(folder: Path) -> list[str]:
    """Return what the objects of a library need of the system beyond what they may [-]."""
    own, needed = set[str](), set[str]()
    for file in sorted((folder / "lib").rglob("*.o")):
        lines = subprocess.run(["nm", str(file)], capture_output=True, text=True, check=True).stdout.splitlines()
        needed |= {line.split()[-1] for line in lines if " U " in f" {line}"}
        own |= {line.split()[-1] for line in lines if " U " not in f" {line}"}
    return sorted(needed - own - NEEDED - {"_GLOBAL_OFFSET_TABLE_"})


def compute_rigid(mechanism: Mechanism, questions: list[Question]) -> Array:
    """Return the efforts of single samples [N m], [N]."""
    functions = [flexinv.prepare(one.mechanism, threads=1) for one in list_acting_sets(mechanism)]
    rest = np.zeros(mechanism.nv)
    return np.array([functions[one.phase].sample(one.q, one.qd, one.qdd, rest.copy()) for one in questions])


def march(mechanism: Mechanism, case: Case, questions: list[Question], settings: LibrarySettings) -> Array:
    """Return the efforts of a controller's steps [N m], [N], from the start of a library."""
    controller = flexinv.Controller.of(mechanism, step=case.step, spectral_radius=case.spectral_radius)
    rest = np.zeros(mechanism.nv)
    begins = controller.start(np.array(settings.start), rest, rest, initial=case.initial).copy()
    steps = [controller.step(one.q, one.qd, one.qdd).copy() for one in questions[1:]]
    return np.array([begins, *steps])


def list_gallery(only: str) -> Iterator[tuple[str, Mechanism, dict[str, Case]]]:
    """Yield the mechanisms of models/ [m, kg] by their names, with their cases."""
    for file in sorted(MODELS.glob("*/mechanism.toml")):
        if only in ("", file.parent.name):
            mechanism = flexinv.load_mechanism(file.parent)
            yield file.parent.name, mechanism, load_cases(file.parent, mechanism)


def compare_random(count: int, seed: int, compare: Comparison) -> Iterator[Outcome]:
    """Yield what became of random mechanisms, until so many of them were compared: those that are refused do not count."""
    left = count
    for name, mechanism, cases in list_random(seed) if count else ():
        outcomes = list(compare(name, mechanism, cases))
        yield from outcomes
        left -= any(one.calls for one in outcomes)
        if left <= 0:
            return


def list_random(seed: int) -> Iterator[tuple[str, Mechanism, dict[str, Case]]]:
    """Yield random mechanisms [m, kg] of all families, one after the other, with their cases."""
    from fuzz_grammar import example

    for number in itertools.count():
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            one = example(number, seed)
            (folder / "mechanism.toml").write_text(one.mechanism)
            (folder / "cases.toml").write_text(one.cases)
            try:
                mechanism = flexinv.load_mechanism(folder)
                yield f"random {number}", mechanism, load_cases(folder, mechanism)
            except FlexinvError:  # that it is refused is what fuzzing is about
                continue


def compare_all(name: str, mechanism: Mechanism, cases: dict[str, Case], known: bool) -> Iterator[Outcome]:
    """Yield what became of the cases of a mechanism; known : refusals must stand in EXCEPTIONS."""
    for case in cases.values():
        with tempfile.TemporaryDirectory() as folder:
            try:
                yield compare_case(mechanism, case, Path(folder) / "library")
            except (InputError, flexinv.ConvergenceError) as refusal:
                said = str(refusal)
                meant = not known or (name in EXCEPTIONS and EXCEPTIONS[name] in said)
                yield Outcome(f"{name}/{case.name}", 0, 0.0, "" if meant else f"refused: {said}")
                click.echo(f"    {name}/{case.name}: {said}")
            except FlexinvError as error:
                yield Outcome(f"{name}/{case.name}", 0, np.inf, str(error))


def add_source_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options that say what is exported [-]: of the gallery, and so many at random."""
    for option in (
        click.option("--seed", default=1, show_default=True),
        click.option("--random", "count", default=30, show_default=True, help="Random mechanisms beside the gallery."),
        click.option("--only", default="", help="One folder of models/."),
    ):
        command = option(command)
    return command


@click.command()
@add_source_options
def main(only: str, count: int, seed: int) -> None:
    """Compare all libraries with Python; end with 1 where one differs or is refused without being listed."""
    warnings.simplefilter("ignore")
    wrong = 0
    of_gallery = (one for source in list_gallery(only) for one in compare_all(*source, known=True))
    for one in itertools.chain(of_gallery, compare_random(count, seed, partial(compare_all, known=False))):
        wrong += bool(one.wrong)
        click.echo(f"{one.name:44} {one.calls:5} calls  {one.difference:9.2e}  {one.wrong}")
    click.echo(f"{wrong} wrong")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
